//! Names of the shapes, in the order in which Apple's ARKit capture tools write them.

/// The 52 ARKit shapes, in the column order of Live Link Face.
pub const ARKIT: [&str; 52] = [
    "eyeBlinkLeft",
    "eyeLookDownLeft",
    "eyeLookInLeft",
    "eyeLookOutLeft",
    "eyeLookUpLeft",
    "eyeSquintLeft",
    "eyeWideLeft",
    "eyeBlinkRight",
    "eyeLookDownRight",
    "eyeLookInRight",
    "eyeLookOutRight",
    "eyeLookUpRight",
    "eyeSquintRight",
    "eyeWideRight",
    "jawForward",
    "jawRight",
    "jawLeft",
    "jawOpen",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthRight",
    "mouthLeft",
    "mouthSmileLeft",
    "mouthSmileRight",
    "mouthFrownLeft",
    "mouthFrownRight",
    "mouthDimpleLeft",
    "mouthDimpleRight",
    "mouthStretchLeft",
    "mouthStretchRight",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    "mouthPressLeft",
    "mouthPressRight",
    "mouthLowerDownLeft",
    "mouthLowerDownRight",
    "mouthUpperUpLeft",
    "mouthUpperUpRight",
    "browDownLeft",
    "browDownRight",
    "browInnerUp",
    "browOuterUpLeft",
    "browOuterUpRight",
    "cheekPuff",
    "cheekSquintLeft",
    "cheekSquintRight",
    "noseSneerLeft",
    "noseSneerRight",
    "tongueOut",
];

/// Whether a shape of [`ARKIT`] moves jaw, lips, cheeks as they puff, or tongue.
pub fn is_of_mouth(shape: &str) -> bool {
    ["jaw", "mouth", "cheekPuff", "tongue"]
        .iter()
        .any(|stem| shape.starts_with(stem))
}

/// The 15 Oculus visemes.
pub const VISEMES: [&str; 15] = [
    "viseme_sil",
    "viseme_PP",
    "viseme_FF",
    "viseme_TH",
    "viseme_DD",
    "viseme_kk",
    "viseme_CH",
    "viseme_SS",
    "viseme_nn",
    "viseme_RR",
    "viseme_aa",
    "viseme_E",
    "viseme_I",
    "viseme_O",
    "viseme_U",
];

/// `mouthSmileLeft` for `mouthSmileRight`; the same name for a shape of both sides.
pub fn mirrored_name(name: &str) -> String {
    match (name.strip_suffix("Left"), name.strip_suffix("Right")) {
        (Some(stem), _) => format!("{stem}Right"),
        (_, Some(stem)) => format!("{stem}Left"),
        _ => name.to_owned(),
    }
}

/// The number of an ARKit shape. The name must be one of `ARKIT`.
pub(super) fn arkit(name: &str) -> usize {
    let place = ARKIT.iter().position(|known| *known == name);
    place.expect("the model's names were checked when it was loaded")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shape_has_a_mirror_image_among_the_shapes() {
        for name in ARKIT {
            let mirrored = mirrored_name(name);
            assert!(ARKIT.contains(&mirrored.as_str()), "{name}");
            assert_eq!(mirrored_name(&mirrored), name);
        }
    }
}
