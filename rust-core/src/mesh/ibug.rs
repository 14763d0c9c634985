//! The 68 landmarks of iBUG 300-W: which mirror each other, which face each other, and which form
//! one region. Left and right are the subject's.

use std::ops::Range;

use ndarray::{ArrayView2, ArrayViewMut2};

/// Number of landmarks `N`.
pub const LANDMARKS: usize = 68;

/// For each landmark, its mirror image on the other side of the face; itself on the midline.
pub const MIRROR: [usize; LANDMARKS] = [
    16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 26, 25, 24, 23, 22, 21, 20, 19, 18,
    17, 27, 28, 29, 30, 35, 34, 33, 32, 31, 45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40, 54, 53,
    52, 51, 50, 49, 48, 59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65,
];

/// The regions of a face, with the names that users see. Twin of `REGIONS` in
/// `blender-addon/scene/face/landmarks.py`.
pub const REGIONS: [(&str, Range<usize>); 5] = [
    ("mouth", MOUTH),
    ("eyes", LIDS),
    ("brows", BROWS),
    ("nose", 27..36),
    ("jaw", JAW),
];

/// Features that a face may lack. Left and right are the subject's.
pub(crate) const FEATURES: [(&str, Range<usize>); 5] = [
    ("right brow", 17..22),
    ("left brow", 22..27),
    ("right eye", 36..42),
    ("left eye", 42..48),
    ("nose", 27..36),
];

pub(crate) const JAW: Range<usize> = 0..17;
pub(crate) const BROWS: Range<usize> = 17..27;
pub(crate) const BRIDGE: Range<usize> = 27..31;
pub(crate) const LIDS: Range<usize> = 36..48;
pub(crate) const MOUTH: Range<usize> = 48..68;
pub(crate) const CHIN: usize = 8;
/// Corners of the mouth, right and left.
pub(crate) const CORNERS: [usize; 2] = [48, 54];

/// Pairs of inner-lip landmarks that face each other: upper and lower, from the subject's right to
/// left.
pub const INNER_LIPS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];
/// The same pairs on the outer borders of the lips.
pub(crate) const OUTER_LIPS: [(usize, usize); 5] =
    [(49, 59), (50, 58), (51, 57), (52, 56), (53, 55)];

/// Landmarks of the upper face: brows, bridge of the nose and lids.
pub(crate) fn upper_face() -> impl Iterator<Item = usize> {
    BROWS.chain(BRIDGE).chain(LIDS)
}

/// Landmarks that speech moves: jaw and mouth.
pub(crate) fn speaking() -> impl Iterator<Item = usize> {
    JAW.chain(MOUTH)
}

/// One eye: the mode that closes it, its landmarks, its pairs of upper and lower lid, and its brow.
pub(crate) struct Eye {
    pub(crate) mode: &'static str,
    pub(crate) lids: Range<usize>,
    pub(crate) pairs: [(usize, usize); 2],
    pub(crate) brow: Range<usize>,
}

pub(crate) static EYES: [Eye; 2] = [
    Eye {
        mode: "eyeBlink_R",
        lids: 36..42,
        brow: 17..22,
        pairs: [(37, 41), (38, 40)],
    },
    Eye {
        mode: "eyeBlink_L",
        lids: 42..48,
        brow: 22..27,
        pairs: [(43, 47), (44, 46)],
    },
];

/// Landmarks of the upper and the lower lip that meet. Each has the share by which it follows when
/// the lips of the column part or close.
pub(crate) struct LipColumn {
    /// Landmark and share, the inner lip first.
    pub(crate) upper: &'static [(usize, f32)],
    /// Landmark and share, the inner lip first.
    pub(crate) lower: &'static [(usize, f32)],
}

impl LipColumn {
    /// How far the lips of the column are apart in a face `[68, 3]`, metres more than in the neutral
    /// face.
    pub(crate) fn gap(&self, face: ArrayView2<'_, f32>) -> f32 {
        face[[self.upper[0].0, 1]] - face[[self.lower[0].0, 1]]
    }

    /// Parts the lips by `by` metres. Each lip moves half of that, and its outer landmarks move with
    /// the inner one.
    pub(crate) fn part(&self, face: &mut ArrayViewMut2<'_, f32>, by: f32) {
        for (n, share) in self.upper {
            face[[*n, 1]] += 0.5 * share * by;
        }
        for (n, share) in self.lower {
            face[[*n, 1]] -= 0.5 * share * by;
        }
    }
}

pub(crate) static LIP_COLUMNS: [LipColumn; 3] = [
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

/// Pairs of landmarks on which asymmetry acts, and how strongly: `(right, left, share)`.
pub(crate) const SIDES: [(usize, usize, f32); 9] = [
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirror_is_its_own_inverse_and_keeps_the_midline() {
        for n in 0..LANDMARKS {
            assert_eq!(MIRROR[MIRROR[n]], n);
        }
        for n in [8, 27, 30, 33, 51, 57, 62, 66] {
            assert_eq!(MIRROR[n], n);
        }
    }
}
