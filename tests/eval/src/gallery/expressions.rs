//! What the frames of a gallery show, as weights of ARKit channels.

/// What a frame shows.
pub(super) struct Expression {
    pub title: &'static str,
    /// ARKit channels with their weights.
    pub channels: &'static [(&'static str, f32)],
}

/// One movement each.
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
    Expression {
        title: "blink",
        channels: &[("eyeBlinkLeft", 1.0), ("eyeBlinkRight", 1.0)],
    },
];

/// Six feelings by the action units of Ekman and Friesen, both sides alike: 6 and 12; 1, 4 and 15; 4, 5, 7
/// and 23; 1, 2, 4, 5, 7 and 20; 1, 2, 5 and 26; 9, 15 and 16.
pub(super) const FEELINGS: [Expression; 6] = [
    Expression {
        title: "happy",
        channels: &[
            ("cheekSquintLeft", 0.8),
            ("cheekSquintRight", 0.8),
            ("mouthSmileLeft", 0.8),
            ("mouthSmileRight", 0.8),
        ],
    },
    Expression {
        title: "sad",
        channels: &[
            ("browInnerUp", 0.9),
            ("browDownLeft", 0.3),
            ("browDownRight", 0.3),
            ("mouthFrownLeft", 0.7),
            ("mouthFrownRight", 0.7),
        ],
    },
    Expression {
        title: "angry",
        channels: &[
            ("browDownLeft", 1.0),
            ("browDownRight", 1.0),
            ("eyeWideLeft", 0.3),
            ("eyeWideRight", 0.3),
            ("eyeSquintLeft", 0.5),
            ("eyeSquintRight", 0.5),
            ("mouthPressLeft", 0.6),
            ("mouthPressRight", 0.6),
        ],
    },
    Expression {
        title: "afraid",
        channels: &[
            ("browInnerUp", 0.9),
            ("browOuterUpLeft", 0.4),
            ("browOuterUpRight", 0.4),
            ("browDownLeft", 0.3),
            ("browDownRight", 0.3),
            ("eyeWideLeft", 0.7),
            ("eyeWideRight", 0.7),
            ("mouthStretchLeft", 0.7),
            ("mouthStretchRight", 0.7),
        ],
    },
    Expression {
        title: "surprised",
        channels: &[
            ("browInnerUp", 0.9),
            ("browOuterUpLeft", 0.9),
            ("browOuterUpRight", 0.9),
            ("eyeWideLeft", 0.7),
            ("eyeWideRight", 0.7),
            ("jawOpen", 0.4),
        ],
    },
    Expression {
        title: "disgusted",
        channels: &[
            ("noseSneerLeft", 0.9),
            ("noseSneerRight", 0.9),
            ("mouthFrownLeft", 0.5),
            ("mouthFrownRight", 0.5),
            ("mouthLowerDownLeft", 0.5),
            ("mouthLowerDownRight", 0.5),
        ],
    },
];
