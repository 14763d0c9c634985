//! The mouths that are drawn, and how well a frame matches each of them.

use super::features::Frame;
use crate::{Error, Result, annotation::Symbols};

/// A mouth at rest stays for at least this long, seconds.
pub const REST_S: f64 = 0.2;
/// The cost of changing mouths.
pub const CHANGE: f64 = 1.5;
/// An opening, in mouth widths, or a width that is off by this much costs 1.
const OPEN: f64 = 0.05;
const WIDTH: f64 = 0.06;
/// The cost of an open mouth while the lips touch. A phone that calls for teeth or tongue saves it.
const UNSAID: f64 = 4.0;
/// The cost of any mouth but that of p, b and m while the lips close for a phone.
const CLOSED: f64 = 25.0;
/// The cost of teeth or tongue without such a phone, and of rest while a phone closes the lips.
const WITHOUT_REASON: f64 = 3.0;

/// A drawn mouth.
pub struct Mouth {
    pub name: &'static str,
    /// Opening in mouth widths, and width as a share of the width at rest.
    open: f64,
    width: f64,
    kind: Kind,
    pub is_rest: bool,
}

#[derive(PartialEq)]
enum Kind {
    /// Recognised by opening and width.
    Shape,
    /// Lips together.
    Closed,
    AtTeeth,
    Tongue,
}

const fn shape(name: &'static str, open: f64, width: f64) -> Mouth {
    mouth(name, open, width, Kind::Shape)
}

const fn mouth(name: &'static str, open: f64, width: f64, kind: Kind) -> Mouth {
    Mouth {
        name,
        open,
        width,
        kind,
        is_rest: false,
    }
}

const fn rest(name: &'static str) -> Mouth {
    Mouth {
        is_rest: true,
        ..mouth(name, 0.0, 1.0, Kind::Closed)
    }
}

static RHUBARB: [Mouth; 9] = [
    mouth("A", 0.0, 1.0, Kind::Closed),
    shape("B", 0.06, 1.0),
    shape("C", 0.16, 1.0),
    shape("D", 0.28, 1.0),
    shape("E", 0.15, 0.92),
    shape("F", 0.07, 0.86),
    mouth("G", 0.03, 1.0, Kind::AtTeeth),
    mouth("H", 0.14, 1.0, Kind::Tongue),
    rest("X"),
];
static PRESTON_BLAIR: [Mouth; 10] = [
    mouth("MBP", 0.0, 1.0, Kind::Closed),
    shape("etc", 0.06, 1.0),
    shape("E", 0.14, 1.02),
    shape("AI", 0.26, 1.0),
    shape("O", 0.18, 0.92),
    shape("U", 0.09, 0.88),
    shape("WQ", 0.04, 0.85),
    mouth("FV", 0.03, 1.0, Kind::AtTeeth),
    mouth("L", 0.14, 1.0, Kind::Tongue),
    rest("rest"),
];

impl Mouth {
    /// Whether it is drawn for p, b and m.
    pub fn closes_lips(&self) -> bool {
        self.kind == Kind::Closed && !self.is_rest
    }

    /// Whether it is drawn for vowels.
    pub fn is_vowel(&self) -> bool {
        ["C", "D", "E", "F", "AI", "O", "U"].contains(&self.name)
    }
}

pub fn of(symbols: Symbols) -> Result<&'static [Mouth]> {
    match symbols {
        Symbols::Rhubarb => Ok(&RHUBARB),
        Symbols::Papagayo => Ok(&PRESTON_BLAIR),
        other => Err(Error::InvalidInput(format!(
            "chart: expected the mouths of rhubarb or papagayo, got {}",
            other.name()
        ))),
    }
}

/// The cost of `mouth` in a frame. `closes`: whether the lips close for a phone in this pose.
pub fn cost(mouth: &Mouth, frame: &Frame, closes: bool) -> f64 {
    let widest = frame.open.clamp(0.0, 0.32);
    let far =
        ((widest - mouth.open) / OPEN).powi(2) + ((frame.width - mouth.width) / WIDTH).powi(2);
    // A closed mouth may have any width.
    let like = match mouth.kind {
        Kind::Closed => (widest / OPEN).powi(2) + if frame.touches { 0.0 } else { 1.0 },
        _ => far + if frame.touches { UNSAID } else { 0.0 },
    };
    let is_lips = mouth.closes_lips();
    let said = match mouth.kind {
        Kind::Closed if mouth.is_rest => WITHOUT_REASON * f64::from(u8::from(closes)),
        Kind::Closed => 0.3 * f64::from(u8::from(!closes)),
        Kind::AtTeeth if frame.at_teeth => -UNSAID,
        Kind::Tongue if frame.tongue => -UNSAID,
        Kind::AtTeeth | Kind::Tongue => WITHOUT_REASON,
        Kind::Shape => 0.0,
    };
    like + said + if closes && !is_lips { CLOSED } else { 0.0 }
}
