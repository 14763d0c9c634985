//! The expressions of a face under their VRM names, and the rig's shapes that show them.

use crate::{
    output::take_shapes::{VOWEL_SHAPES, VOWELS},
    rig::ARKIT,
};

/// What becomes of an expression that the avatar has already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Existing {
    /// The new one takes its place.
    Replace,
    /// It stays. If it moves and colours nothing, it moves the shapes of the new one.
    Keep,
}

/// An expression.
pub(super) struct Expression {
    pub name: String,
    /// Whether VRM 1 defines it.
    pub is_preset: bool,
    /// Its preset in VRM 0. `None` if VRM 0 has none for it.
    pub old_preset: Option<&'static str>,
    /// Names of shapes, each with its weight.
    pub parts: Vec<(&'static str, f32)>,
    /// The field of VRM 1 that blocks the expressions which move the same part of the face, while
    /// this one shows.
    pub takes_over: Option<&'static str>,
}

/// A mixture of shapes: its name in VRM 1, its preset in VRM 0, and the names or stems of ARKit's
/// shapes with their weights.
type Mixture = (
    &'static str,
    Option<&'static str>,
    &'static [(&'static str, f32)],
);

/// Presets that are mixtures.
///
/// The feelings follow the action units of EMFACS (Ekman & Friesen 1983): happy 6, 12; angry 4, 5,
/// 7, 23, 10; sad 1, 4, 15, 17; surprised 1, 2, 5, 26. Relaxed is a weak 12 with slightly lowered
/// lids. The weights are our own choice.
const MIXTURES: [Mixture; 12] = [
    ("blink", Some("blink"), &[("eyeBlink", 1.0)]),
    ("blinkLeft", Some("blink_l"), &[("eyeBlinkLeft", 1.0)]),
    ("blinkRight", Some("blink_r"), &[("eyeBlinkRight", 1.0)]),
    (
        "happy",
        Some("joy"),
        &[
            ("mouthSmile", 0.8),
            ("cheekSquint", 0.6),
            ("eyeSquint", 0.3),
        ],
    ),
    (
        "angry",
        Some("angry"),
        &[
            ("browDown", 0.9),
            ("eyeSquint", 0.4),
            ("noseSneer", 0.4),
            ("mouthPress", 0.5),
            ("mouthFrown", 0.3),
        ],
    ),
    (
        "sad",
        Some("sorrow"),
        &[
            ("browInnerUp", 0.8),
            ("mouthFrown", 0.7),
            ("mouthShrugLower", 0.4),
            ("eyeSquint", 0.2),
        ],
    ),
    (
        "relaxed",
        Some("fun"),
        &[("mouthSmile", 0.4), ("eyeBlink", 0.2)],
    ),
    (
        "surprised",
        None,
        &[
            ("browInnerUp", 0.7),
            ("browOuterUp", 0.8),
            ("eyeWide", 0.8),
            ("jawOpen", 0.35),
        ],
    ),
    ("lookUp", Some("lookup"), &[("eyeLookUp", 1.0)]),
    ("lookDown", Some("lookdown"), &[("eyeLookDown", 1.0)]),
    (
        "lookLeft",
        Some("lookleft"),
        &[("eyeLookOutLeft", 1.0), ("eyeLookInRight", 1.0)],
    ),
    (
        "lookRight",
        Some("lookright"),
        &[("eyeLookInLeft", 1.0), ("eyeLookOutRight", 1.0)],
    ),
];
/// VRM 0's vowels, in the order of [`VOWELS`].
const OLD_VOWELS: [&str; 5] = ["a", "i", "u", "e", "o"];
/// Shapes that the vowels contain. An avatar that receives both would open its mouth twice.
const OF_VOWELS: [&str; 4] = ["jawOpen", "mouthClose", "mouthFunnel", "mouthPucker"];

/// Names of the shapes that expressions use.
pub(super) fn shapes_of_expressions() -> impl Iterator<Item = &'static str> {
    ARKIT.into_iter().chain(VOWEL_SHAPES)
}

/// Every expression with at least one shape that `is_there`: VRM's presets, then ARKit's 52 shapes
/// under their names in Perfect Sync.
pub(super) fn expressions(is_there: impl Fn(&str) -> bool) -> Vec<Expression> {
    let vowels = VOWELS.iter().zip(OLD_VOWELS).zip(VOWEL_SHAPES);
    let vowels = vowels.map(|((name, old), shape)| Expression {
        name: (*name).to_owned(),
        is_preset: true,
        old_preset: Some(old),
        parts: vec![(shape, 1.0)],
        takes_over: None,
    });
    let mixtures = MIXTURES.iter().map(|(name, old, parts)| Expression {
        name: (*name).to_owned(),
        is_preset: true,
        old_preset: *old,
        parts: parts.iter().flat_map(both_sides).collect(),
        takes_over: None,
    });
    let shapes = ARKIT.iter().map(|name| Expression {
        name: perfect_sync(name),
        is_preset: false,
        old_preset: None,
        parts: vec![(*name, 1.0)],
        takes_over: match *name {
            _ if name.starts_with("eyeBlink") => Some("overrideBlink"),
            _ if name.starts_with("eyeLook") => Some("overrideLookAt"),
            _ if OF_VOWELS.contains(name) => Some("overrideMouth"),
            _ => None,
        },
    });
    let all = vowels.chain(mixtures).chain(shapes).map(|mut expression| {
        expression.parts.retain(|(shape, _)| is_there(shape));
        expression
    });
    all.filter(|expression| !expression.parts.is_empty())
        .collect()
}

/// The ARKit shape of that name, or the left and right shapes of that stem.
fn both_sides(part: &(&str, f32)) -> Vec<(&'static str, f32)> {
    let (stem, weight) = *part;
    let is_of = |name: &&&str| match name.strip_prefix(stem) {
        Some(side) => ["", "Left", "Right"].contains(&side),
        None => false,
    };
    ARKIT
        .iter()
        .filter(is_of)
        .map(|name| (*name, weight))
        .collect()
}

/// The name in Perfect Sync: `JawOpen` for `jawOpen`.
pub(super) fn perfect_sync(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_a_shape_of_the_rig() {
        let all = expressions(|_| true);
        assert_eq!(all.len(), 5 + 12 + 52);
        let known: Vec<&str> = shapes_of_expressions().collect();
        for expression in &all {
            let is_known = |(shape, _): &(&str, f32)| known.contains(shape);
            assert!(expression.parts.iter().all(is_known), "{}", expression.name);
        }
        for (name, _, parts) in MIXTURES {
            for part in parts {
                assert!(!both_sides(part).is_empty(), "{name}: {}", part.0);
            }
        }
    }

    #[test]
    fn a_face_without_an_eye_has_no_blink_of_it() {
        let all = expressions(|shape| shape != "eyeBlinkLeft");
        let find = |name: &str| all.iter().find(|expression| expression.name == name);
        assert!(find("blinkLeft").is_none() && find("EyeBlinkLeft").is_none());
        assert_eq!(find("blink").unwrap().parts, [("eyeBlinkRight", 1.0)]);
        assert_eq!(
            find("EyeBlinkRight").unwrap().takes_over,
            Some("overrideBlink")
        );
    }
}
