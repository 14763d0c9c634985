//! Action units of the face and what shows them on ARKit's shapes.
//!
//! They are those of the Facial Action Coding System (Ekman & Friesen 1978); that each may be asked for on one side is
//! ours.

/// Left and right.
pub const SIDES: usize = 2;
/// A unit and the ARKit shapes that show it, without `Left` and `Right`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActionUnit {
    /// Its number.
    pub name: &'static str,
    /// What it does.
    pub label: &'static str,
    /// Stems of ARKit's names.
    pub shapes: &'static [&'static str],
    /// Whether it moves the mouth, where speech has the first say.
    pub is_lower: bool,
    /// Where both eyes look, yaw to the subject's left and pitch up, radians; 0 for a unit that turns no eye.
    pub gaze: [f32; 2],
}

const fn upper(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        name,
        label,
        shapes,
        is_lower: false,
        gaze: [0.0; 2],
    }
}

const fn lower(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        is_lower: true,
        ..upper(name, label, shapes)
    }
}

const fn eyes(name: &'static str, label: &'static str, gaze: [f32; 2]) -> ActionUnit {
    ActionUnit {
        gaze,
        ..upper(name, label, &[])
    }
}

/// How far eyes turn to a side, up or down, radians: as far as people look without turning the head.
const ASIDE: f32 = 0.4;
const UP: f32 = 0.3;

/// How many of [`ACTION_UNITS`] a network knows: the first ones. The others are put on what it gives.
pub const LEARNED_UNITS: usize = 16;

/// The sixteen units of Cafe-Talk in the order of the weights, and behind them those that no network has learned.
pub const ACTION_UNITS: [ActionUnit; 25] = [
    upper("1", "inner brow raiser", &["browInnerUp"]),
    upper("2", "outer brow raiser", &["browOuterUp"]),
    upper("4", "brow lowerer", &["browDown"]),
    upper("5", "upper lid raiser", &["eyeWide"]),
    upper("6", "cheek raiser", &["cheekSquint"]),
    upper("7", "lid tightener", &["eyeSquint"]),
    lower("9", "nose wrinkler", &["noseSneer"]),
    lower("10", "upper lip raiser", &["mouthUpperUp"]),
    lower("12", "lip corner puller", &["mouthSmile"]),
    lower("14", "dimpler", &["mouthDimple"]),
    lower("15", "lip corner depressor", &["mouthFrown"]),
    lower("17", "chin raiser", &["mouthShrugLower"]),
    lower("20", "lip stretcher", &["mouthStretch"]),
    lower("26", "jaw drop", &["jawOpen"]),
    lower("28", "lip suck", &["mouthRollLower", "mouthRollUpper"]),
    upper("45", "blink", &["eyeBlink"]),
    lower("18", "lip pucker", &["mouthPucker"]),
    lower("22", "lip funneler", &["mouthFunnel"]),
    lower("23", "lip tightener", &["mouthPress"]),
    lower("25", "lips part", &["mouthLowerDown", "mouthUpperUp"]),
    lower("34", "cheek puff", &["cheekPuff"]),
    eyes("61", "eyes turn left", [ASIDE, 0.0]),
    eyes("62", "eyes turn right", [-ASIDE, 0.0]),
    eyes("63", "eyes up", [0.0, UP]),
    eyes("64", "eyes down", [0.0, -UP]),
];

/// On which side of the face, the subject's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Side {
    /// Both.
    #[default]
    Both,
    /// The subject's left.
    Left,
    /// The subject's right.
    Right,
}

impl Side {
    /// A unit on this side: `12`, `45L`.
    pub fn written(self, unit: &str) -> String {
        let ending = match self {
            Side::Both => "",
            Side::Left => "L",
            Side::Right => "R",
        };
        format!("{unit}{ending}")
    }
}

impl ActionUnit {
    /// Whether its shapes have sides; one that has none is on both.
    pub fn has_sides(&self) -> bool {
        !matches!(self.name, "1" | "17" | "18" | "22" | "26" | "28" | "34") && !self.turns_eyes()
    }

    /// Whether it turns the eyes.
    pub fn turns_eyes(&self) -> bool {
        self.gaze != [0.0; 2]
    }

    /// Whether it moves a shape of ARKit's where it is asked for on a side.
    pub fn shows(&self, side: Side, shape: &str) -> bool {
        let on_side = match (self.has_sides(), side) {
            (true, Side::Left) => shape.ends_with("Left"),
            (true, Side::Right) => shape.ends_with("Right"),
            _ => true,
        };
        let turned = self.turns_eyes() && shape.starts_with("eyeLook");
        turned || (on_side && self.shapes.iter().any(|stem| shape.starts_with(stem)))
    }

    /// The number in [`ACTION_UNITS`] of `12`, `AU12` or `au 12`.
    pub fn find(name: &str) -> Option<usize> {
        let name = name.trim().to_ascii_lowercase();
        let digits = name.strip_prefix("au").unwrap_or(&name).trim();
        let digits = digits.trim_start_matches('0');
        ACTION_UNITS.iter().position(|unit| unit.name == digits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    #[test]
    fn every_unit_shows_on_shapes_of_arkit() {
        for unit in ACTION_UNITS {
            for stem in unit.shapes {
                let name = match unit.has_sides() {
                    true => format!("{stem}Left"),
                    false => (*stem).to_owned(),
                };
                assert!(ARKIT.contains(&name.as_str()), "{name}");
            }
        }
    }
}
