//! Which of the 68 iBUG landmarks belong together. `L` and `R` are the subject's.

use std::ops::Range;

pub(super) const JAW: Range<usize> = 0..17;
pub(super) const BROWS: Range<usize> = 17..27;
pub(super) const BRIDGE: Range<usize> = 27..31;
pub(super) const LIDS: Range<usize> = 36..48;
pub(super) const MOUTH: Range<usize> = 48..68;
pub(super) const CHIN: usize = 8;

/// What lies above speech.
pub(super) fn upper_face() -> impl Iterator<Item = usize> {
    BROWS.chain(BRIDGE).chain(LIDS)
}

/// What speech moves.
pub(super) fn speaking() -> impl Iterator<Item = usize> {
    JAW.chain(MOUTH)
}

/// One eye: its mode, its landmarks, and its pairs of upper and lower lid.
pub(super) struct Eye {
    pub(super) mode: &'static str,
    pub(super) lids: Range<usize>,
    pub(super) pairs: [(usize, usize); 2],
}

pub(super) static EYES: [Eye; 2] = [
    Eye {
        mode: "eyeBlink_R",
        lids: 36..42,
        pairs: [(37, 41), (38, 40)],
    },
    Eye {
        mode: "eyeBlink_L",
        lids: 42..48,
        pairs: [(43, 47), (44, 46)],
    },
];

/// A pair of inner lips that meet, and how much of their shift their neighbours follow.
pub(super) struct LipColumn {
    /// Inner landmark first.
    pub(super) upper: &'static [(usize, f32)],
    /// Inner landmark first.
    pub(super) lower: &'static [(usize, f32)],
}

pub(super) static LIP_COLUMNS: [LipColumn; 3] = [
    LipColumn {
        upper: &[(61, 1.0), (50, 1.0), (49, 0.5)],
        lower: &[(67, 1.0), (58, 1.0), (59, 0.5)],
    },
    LipColumn {
        upper: &[(62, 1.0), (51, 1.0)],
        lower: &[(66, 1.0), (57, 1.0)],
    },
    LipColumn {
        upper: &[(63, 1.0), (52, 1.0), (53, 0.5)],
        lower: &[(65, 1.0), (56, 1.0), (55, 0.5)],
    },
];

/// How much asymmetry takes hold: `(right, left, share)`.
pub(super) const SIDES: [(usize, usize, f32); 9] = [
    (17, 26, 1.0),
    (18, 25, 1.0),
    (19, 24, 1.0),
    (20, 23, 1.0),
    (21, 22, 1.0),
    (48, 54, 1.0),
    (60, 64, 1.0),
    (49, 53, 0.5),
    (59, 55, 0.5),
];
