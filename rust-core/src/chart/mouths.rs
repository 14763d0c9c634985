//! The mouths that are drawn, and how like one of them a frame is.

use super::features::Frame;
use crate::{Error, Result, annotation::Symbols};

/// A mouth at rest stands for at least so long, seconds.
pub const REST_S: f64 = 0.2;
/// What a change of mouths costs.
pub const CHANGE: f64 = 1.5;
/// How much of the opening, in mouth widths, and of the width count as much as 1.
const OPEN: f64 = 0.05;
const WIDTH: f64 = 0.06;
/// What it costs to show another mouth than that which is said, and one that nothing speaks for.
const UNSAID: f64 = 4.0;
const CLOSED: f64 = 25.0;
const WITHOUT_REASON: f64 = 3.0;

/// A drawn mouth.
pub struct Mouth {
    pub name: &'static str,
    /// Opening in mouth widths and share of the width at rest.
    open: f64,
    width: f64,
    kind: Kind,
    pub is_rest: bool,
}

#[derive(PartialEq)]
enum Kind {
    /// Told by opening and width.
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

/// What a mouth costs in a frame; `closes` where lips close for what is said in its pose.
pub fn cost(mouth: &Mouth, frame: &Frame, closes: bool) -> f64 {
    let widest = frame.open.clamp(0.0, 0.32);
    let far =
        ((widest - mouth.open) / OPEN).powi(2) + ((frame.width - mouth.width) / WIDTH).powi(2);
    // The lips of a closed mouth may be as wide as they like.
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
