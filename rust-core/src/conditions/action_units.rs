//! Action units of the face, and the ARKit shapes that show them.
//!
//! The units come from the Facial Action Coding System (Ekman & Friesen 1978). Requesting a unit on
//! one side only is our addition.

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
    /// Stems of the shapes that show it on one side, where those of `shapes` have no sides. May be empty.
    pub one_sided: &'static [&'static str],
    /// Whether it moves the mouth, where speech takes precedence.
    pub is_lower: bool,
    /// Where both eyes look: yaw to the subject's left and pitch up, radians. 0 if it turns no eye.
    pub gaze: [f32; 2],
    /// How far the eyes swing from the subject's right to the left while the unit lasts, radians to
    /// either side. The pitch of `gaze` is reached in the middle.
    pub swing: f32,
    /// Time in which it comes to its full strength, seconds. It takes [`OFFSET_OVER_ONSET`] times as
    /// long to go.
    pub onset_s: f64,
}

/// How many times longer a unit takes to go than to come, as for emotions.
pub const OFFSET_OVER_ONSET: f64 = 1.7;
/// Onset of blinks and of turning eyes, seconds: lids shut within a tenth of a second, and leaps of
/// the eyes are as fast.
const EYES_ONSET_S: f64 = 0.12;
/// Onset of brows, lids and cheeks, seconds.
const UPPER_ONSET_S: f64 = 0.3;
/// Onset of nose, mouth and jaw, seconds. Published onsets of smiles are 0.4 to 0.7 s.
const LOWER_ONSET_S: f64 = 0.6;

const fn upper(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        name,
        label,
        shapes,
        one_sided: &[],
        is_lower: false,
        gaze: [0.0; 2],
        swing: 0.0,
        onset_s: UPPER_ONSET_S,
    }
}

const fn lower(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        is_lower: true,
        onset_s: LOWER_ONSET_S,
        ..upper(name, label, shapes)
    }
}

const fn eyes(name: &'static str, label: &'static str, gaze: [f32; 2]) -> ActionUnit {
    ActionUnit {
        gaze,
        onset_s: EYES_ONSET_S,
        ..upper(name, label, &[])
    }
}

/// How far eyes turn to a side, radians: as far as people look without turning the head.
const ASIDE: f32 = 0.4;
/// How far eyes turn up or down, radians, by the same measure.
const UP: f32 = 0.3;

/// A network knows this many of [`ACTION_UNITS`], the first ones. The rest are added to its output.
pub const LEARNED_UNITS: usize = 16;

/// The sixteen units of Cafe-Talk in the order of the weights. After them come the units that no
/// network has learned.
pub const ACTION_UNITS: [ActionUnit; 27] = [
    // ARKit has one shape for both inner brows. On one side the outer raiser lifts the inner end too.
    ActionUnit {
        one_sided: &["browOuterUp"],
        ..upper("1", "inner brow raiser", &["browInnerUp"])
    },
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
    ActionUnit {
        onset_s: EYES_ONSET_S,
        ..upper("45", "blink", &["eyeBlink"])
    },
    lower("18", "lip pucker", &["mouthPucker"]),
    lower("22", "lip funneler", &["mouthFunnel"]),
    lower("23", "lip tightener", &["mouthPress"]),
    lower("25", "lips part", &["mouthLowerDown", "mouthUpperUp"]),
    lower("34", "cheek puff", &["cheekPuff"]),
    eyes("61", "eyes turn left", [ASIDE, 0.0]),
    eyes("62", "eyes turn right", [-ASIDE, 0.0]),
    eyes("63", "eyes up", [0.0, UP]),
    eyes("64", "eyes down", [0.0, -UP]),
    lower(CLOSING, "lips toward each other", &["mouthClose"]),
    ActionUnit {
        swing: ASIDE,
        ..eyes("68", "upward rolling of eyes", [0.0, UP])
    },
];

/// The unit that keeps the lips together.
const CLOSING: &str = "8";

/// A side of the face, from the subject's point of view.
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
    /// Writes a unit on this side: `12`, `45L`.
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
    /// Whether its shapes have sides. A unit without sides always acts on both.
    pub fn has_sides(&self) -> bool {
        !matches!(self.name, "8" | "17" | "18" | "22" | "26" | "28" | "34") && !self.turns_eyes()
    }

    /// Whether it turns the eyes.
    pub fn turns_eyes(&self) -> bool {
        self.gaze != [0.0; 2]
    }

    /// Whether it keeps the lips together: the speech does not move them while it lasts.
    pub fn closes_lips(&self) -> bool {
        self.name == CLOSING
    }

    /// Where both eyes look when the unit has gone through a share of its time, 0 to 1: yaw to the
    /// subject's left and pitch up, radians.
    pub fn gaze_at(&self, share: f32) -> [f32; 2] {
        let [yaw, pitch] = self.gaze;
        if self.swing == 0.0 {
            return self.gaze;
        }
        let (height, side) = (std::f32::consts::PI * share).sin_cos();
        [yaw - self.swing * side, pitch * height]
    }

    /// Whether it moves this ARKit shape when it is requested on `side`.
    pub fn shows(&self, side: Side, shape: &str) -> bool {
        let on_side = match (self.has_sides(), side) {
            (true, Side::Left) => shape.ends_with("Left"),
            (true, Side::Right) => shape.ends_with("Right"),
            _ => true,
        };
        let turned = self.turns_eyes() && shape.starts_with("eyeLook");
        let shapes = if side != Side::Both && !self.one_sided.is_empty() {
            self.one_sided
        } else {
            self.shapes
        };
        turned || (on_side && shapes.iter().any(|stem| shape.starts_with(stem)))
    }

    /// The index in [`ACTION_UNITS`] of `12`, `AU12` or `au 12`.
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
            let sided = format!("{}Left", unit.shapes.first().unwrap_or(&""));
            for side in [Side::Both, Side::Left, Side::Right] {
                let shown = ARKIT.iter().filter(|shape| unit.shows(side, shape));
                assert!(shown.count() >= unit.shapes.len(), "{} {side:?}", unit.name);
            }
            for stem in unit.shapes {
                let is_known = ARKIT.contains(stem) || ARKIT.contains(&sided.as_str());
                assert!(is_known, "{stem}");
            }
        }
    }
}
