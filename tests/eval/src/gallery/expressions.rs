//! The expressions in the frames of a gallery, as weights of ARKit channels.

/// The expression of a frame.
#[derive(Clone, Copy)]
pub(super) struct Expression {
    pub title: &'static str,
    /// ARKit channels with their weights. A name without a side moves both sides.
    pub channels: &'static [(&'static str, f32)],
}

/// Both eyes shut.
pub(super) const BLINK: Expression = Expression {
    title: "blink",
    channels: &[("eyeBlinkLeft", 1.0), ("eyeBlinkRight", 1.0)],
};

/// Expressions of a single movement.
pub(super) const MOVEMENTS: [Expression; 4] = [
    Expression {
        title: "jaw open",
        channels: &[("jawOpen", 0.6)],
    },
    Expression {
        title: "pucker",
        channels: &[("mouthPucker", 1.0)],
    },
    Expression {
        title: "smile",
        channels: &[("mouthSmileLeft", 0.8), ("mouthSmileRight", 0.8)],
    },
    BLINK,
];

/// Six emotions by the action units of Ekman and Friesen, the same on both sides: 6 and 12; 1, 4
/// and 15; 4, 5, 7 and 23; 1, 2, 4, 5, 7 and 20; 1, 2, 5 and 26; 9, 15 and 16.
pub(super) const HEARD_EMOTIONS: [Expression; 6] = [
    Expression {
        title: "happy",
        channels: &[("cheekSquint", 0.8), ("mouthSmile", 0.8)],
    },
    Expression {
        title: "sad",
        channels: &[("browInnerUp", 0.9), ("browDown", 0.3), ("mouthFrown", 0.7)],
    },
    Expression {
        title: "angry",
        channels: &[
            ("browDown", 1.0),
            ("eyeWide", 0.3),
            ("eyeSquint", 0.5),
            ("mouthPress", 0.6),
        ],
    },
    Expression {
        title: "afraid",
        channels: &[
            ("browInnerUp", 0.9),
            ("browOuterUp", 0.4),
            ("browDown", 0.3),
            ("eyeWide", 0.7),
            ("mouthStretch", 0.7),
        ],
    },
    Expression {
        title: "surprised",
        channels: &[
            ("browInnerUp", 0.9),
            ("browOuterUp", 0.9),
            ("eyeWide", 0.7),
            ("jawOpen", 0.4),
        ],
    },
    Expression {
        title: "disgusted",
        channels: &[
            ("noseSneer", 0.9),
            ("mouthFrown", 0.5),
            ("mouthLowerDown", 0.5),
        ],
    },
];
