//! Finds the role of each part that is not skin from its shape and its place beside the landmarks.
//!
//! A mesh names its parts in any language or not at all, so only names of eyes and clothes count, beside their
//! place. Most rules compare the box around a part with the landmarks. They are rules of thumb, and the first one that fits counts:
//!
//! 1. Round and in a socket: an eye, and the parts that lie on it or in it ([`EyeParts`]).
//! 2. Within the mouth's width and behind the lips: a part of the mouth. A part taller than [`TALL_CM`], such
//!    as gums with a tongue, holds both jaws. Otherwise its middle decides: below the line between the lips
//!    it follows the jaw, above it the skull.
//! 3. A frame across both eyes that hangs below them, or a plate in front of one eye: glasses, which rest
//!    with the skull.
//! 4. Large and reaching well above the brows: hair or a hat, which rest with the skull.
//! 5. Wider than the face and reaching well below the chin, without sharing vertices with the skin as a body does:
//!    clothes, which stay still.
//! 6. Any vertex within [`REACH_CM`] of the skin: lashes, brows, beards. The part follows the skin nearest to
//!    its roots.
//! 7. Anything else is no part of the face and stays still.
//!
//! The cost of rules 2 to 4 is one pass over the vertices of a part. Only rules 5 and 6, and eyes away from the
//! landmarks, ask for the nearest skin. The search tree is therefore a closure that builds it for the first
//! part that needs it, and rule 6 stops at the first vertex within reach.
//!
//! Not obvious: the order is part of the rules. Eyeballs, teeth and glasses lie within reach of the skin and
//! would follow it by rule 6, so that rule comes after theirs. A moustache stands out in front of the lips.
//! It is therefore not a part of the mouth and reaches rule 6. Glasses and hair have the same role, so their
//! order does not matter.
//!
//! What can go wrong: a rule can only see boxes. Long hair that ends below the brows' height follows the
//! skin, and a lamp near the cheek counts as a beard. A caller's choice of a role
//! ([`PartChoices`](crate::mesh::PartChoices)) overrides every rule.
//!
//! Lengths are canonical centimetres; those inside the mouth grow with the mouth's width.

use super::{
    box3::Box3,
    eye_parts::{EyeParts, words},
};
use crate::mesh::{PartRole, SurfaceTree, ibug::LANDMARKS};

/// A mouth part taller than this is taken to hold both the upper and the lower jaw.
const TALL_CM: f32 = 3.2;
/// Lengths inside the mouth are given for a mouth of this width.
const MOUTH_CM: f32 = 5.0;
/// Glasses hang at least this far below the middle of the eyes, in widths of an eye.
const BELOW_EYE: f32 = 0.3;
/// A lens stands at least this far in front of the middle of the eye.
const BEFORE_EYE_CM: f32 = 0.8;
/// Glasses are not higher than this.
const GLASSES_CM: f32 = 7.0;
/// Hair is at least this large and reaches at least this far above the brows.
const HAIR_CM: (f32, f32) = (8.0, 3.5);
/// Clothes are wider than this many widths of the face and reach this far below the chin.
const CLOTHES: (f32, f32) = (1.2, 5.0);
/// Words in the names of clothes.
const CLOTHES_WORDS: [&str; 12] = [
    "hat", "hood", "hoodie", "helmet", "outfit", "clothes", "clothing", "shirt", "jacket", "coat",
    "dress", "scarf",
];
/// A vertex this near to a vertex of the skin is the same one.
const SAME_CM: f64 = 0.01;
/// A part further from the skin than this does not follow it.
pub(super) const REACH_CM: f32 = 4.0;

/// Where eyes, brows and mouth are.
pub(super) struct RoleRules {
    landmarks: [[f32; 3]; LANDMARKS],
    /// Centre and width, the subject's right eye first.
    eyes: [([f32; 3], f32); 2],
    brows_y: f32,
    mouth: [f32; 3],
    mouth_width: f32,
}

impl RoleRules {
    pub(super) fn of(landmarks: &[[f32; 3]; LANDMARKS]) -> RoleRules {
        let eye = |first: usize| {
            let (a, b) = (landmarks[first], landmarks[first + 3]);
            let width = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt();
            (mean(&landmarks[first..first + 6]), width)
        };
        let (a, b) = (landmarks[48], landmarks[54]);
        RoleRules {
            landmarks: *landmarks,
            eyes: [eye(36), eye(42)],
            brows_y: mean(&landmarks[17..27])[1],
            mouth: mean(&landmarks[60..68]),
            mouth_width: (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt(),
        }
    }

    /// The roles of parts. `parts`: the positions of their vertices. `names`: what the file calls them. `skin`
    /// returns the face's surface and is called only where it is needed.
    pub(super) fn roles<'a>(
        &self,
        parts: &[Vec<[f32; 3]>],
        names: &[Option<&str>],
        skin: impl Fn() -> &'a SurfaceTree,
    ) -> Vec<PartRole> {
        let eyes =
            EyeParts::new(&self.landmarks, self.eyes, self.brows_y).find(parts, names, &skin);
        let each = parts.iter().zip(names).zip(eyes);
        each.map(|((points, name), is_eye)| {
            if is_eye {
                PartRole::Gaze
            } else if name.is_some_and(is_name_of_clothes) {
                PartRole::Still
            } else {
                self.role(points, &skin)
            }
        })
        .collect()
    }

    /// The role of a part that is not an eye.
    fn role<'a>(&self, points: &[[f32; 3]], skin: impl Fn() -> &'a SurfaceTree) -> PartRole {
        let bounds = Box3::of(points.iter().copied());
        if self.is_in_mouth(&bounds) {
            return self.jaw_or_skull(&bounds);
        }
        if self.is_glasses(&bounds) || self.is_hair(&bounds) {
            return PartRole::Skull;
        }
        let skin = skin();
        if self.is_clothes(&bounds) && !points.iter().any(|&p| is_of_skin(skin, p)) {
            return PartRole::Still;
        }
        if points.iter().any(|&p| is_near(skin, p)) {
            PartRole::Nearest
        } else {
            PartRole::Still
        }
    }

    /// Whether a part lies within the mouth's width and behind the lips.
    fn is_in_mouth(&self, bounds: &Box3) -> bool {
        let unit = self.mouth_unit();
        let offset = |p: [f32; 3], i: usize| (p[i] - self.mouth[i]) / unit;
        let (low, high) = (bounds.low, bounds.high);
        let across = offset(low, 0) > -4.5 && offset(high, 0) < 4.5;
        let height = offset(low, 1) > -4.5 && offset(high, 1) < 4.0;
        let depth = offset(high, 2) < 0.3 && offset(low, 2) > -12.0;
        across && height && depth
    }

    fn jaw_or_skull(&self, bounds: &Box3) -> PartRole {
        if bounds.high[1] - bounds.low[1] > TALL_CM * self.mouth_unit() {
            return PartRole::Mouth;
        }
        if bounds.middle()[1] < self.mouth[1] {
            PartRole::Jaw
        } else {
            PartRole::Skull
        }
    }

    /// The unit of lengths in the mouth, 1 on a human one.
    pub(super) fn mouth_unit(&self) -> f32 {
        self.mouth_width / MOUTH_CM
    }

    fn is_glasses(&self, bounds: &Box3) -> bool {
        let [right, left] = self.eyes;
        let covers = |(centre, width): ([f32; 3], f32)| {
            let across = bounds.low[0] < centre[0] && bounds.high[0] > centre[0];
            let below = bounds.low[1] < centre[1] - BELOW_EYE * width;
            across && below && bounds.high[1] > centre[1] && bounds.high[2] > centre[2]
        };
        let low = bounds.high[1] - bounds.low[1] < GLASSES_CM;
        let lens = |eye: ([f32; 3], f32)| {
            covers(eye) && bounds.low[2] > eye.0[2] + BEFORE_EYE_CM && bounds.largest() < GLASSES_CM
        };
        low && ((covers(right) && covers(left)) || lens(right) || lens(left))
    }

    fn is_clothes(&self, bounds: &Box3) -> bool {
        let face = (self.landmarks[16][0] - self.landmarks[0][0]).abs();
        let wide = bounds.high[0] - bounds.low[0];
        wide > CLOTHES.0 * face && bounds.low[1] < self.landmarks[8][1] - CLOTHES.1
    }

    fn is_hair(&self, bounds: &Box3) -> bool {
        bounds.largest() > HAIR_CM.0 && bounds.high[1] > self.brows_y + HAIR_CM.1
    }
}

/// Whether a name is that of clothes, such as `Wolf3D_Outfit_Top`.
fn is_name_of_clothes(name: &str) -> bool {
    let words = words(name);
    words.iter().any(|word| CLOTHES_WORDS.contains(&&**word))
}

/// Whether a point is a vertex of the skin.
fn is_of_skin(skin: &SurfaceTree, point: [f32; 3]) -> bool {
    let place = skin.closest(point);
    let is_corner = |at: [f64; 3]| at.iter().any(|share| *share > 0.98);
    place.is_some_and(|place| place.distance < SAME_CM && is_corner(place.barycentric))
}

fn is_near(skin: &SurfaceTree, point: [f32; 3]) -> bool {
    let place = skin.closest(point);
    place.is_some_and(|place| place.distance < f64::from(REACH_CM))
}

fn mean(points: &[[f32; 3]]) -> [f32; 3] {
    let count = points.len() as f32;
    std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f32>() / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, canonical_landmarks};

    /// The role of the corners of a box. The skin is a strip of triangles over the landmarks.
    fn role(low: [f32; 3], high: [f32; 3]) -> PartRole {
        let landmarks = canonical_landmarks().map(|p| p.map(|x| 100.0 * x));
        let skin = Mesh {
            positions: landmarks.to_vec(),
            triangles: (0..66).map(|n| [n, n + 1, n + 2]).collect(),
        };
        let corners: Vec<[f32; 3]> = (0..8)
            .map(|c| std::array::from_fn(|i| if c >> i & 1 == 0 { low[i] } else { high[i] }))
            .collect();
        let tree = SurfaceTree::new(&skin);
        RoleRules::of(&landmarks).roles(&[corners], &[None], || &tree)[0]
    }

    /// The role of a box around the middle of some landmarks, moved by `offset`, centimetres.
    fn about(marks: &[usize], offset: [f32; 3], half: [f32; 3]) -> PartRole {
        let landmarks = canonical_landmarks().map(|p| p.map(|x| 100.0 * x));
        let chosen: Vec<[f32; 3]> = marks.iter().map(|&n| landmarks[n]).collect();
        let centre = mean(&chosen);
        role(
            std::array::from_fn(|i| centre[i] + offset[i] - half[i]),
            std::array::from_fn(|i| centre[i] + offset[i] + half[i]),
        )
    }

    #[test]
    fn parts_are_told_by_shape_and_place() {
        let eye: Vec<usize> = (36..42).collect();
        let eyes: Vec<usize> = (36..48).collect();
        let lips: Vec<usize> = (60..68).collect();
        let brow: Vec<usize> = (17..22).collect();
        for (name, got, expected) in [
            (
                "eyeball",
                about(&eye, [0.0, 0.0, -1.2], [1.2; 3]),
                PartRole::Gaze,
            ),
            (
                "upper lashes",
                about(&eye, [0.0, 0.4, 0.4], [1.8, 0.5, 0.6]),
                PartRole::Nearest,
            ),
            (
                "brow",
                about(&brow, [0.0, 0.1, 0.2], [2.5, 0.5, 0.8]),
                PartRole::Nearest,
            ),
            (
                "lower teeth",
                about(&lips, [0.0, -1.0, -2.5], [3.0, 0.8, 2.0]),
                PartRole::Jaw,
            ),
            (
                "tongue",
                about(&lips, [0.0, -0.8, -3.5], [2.0, 1.2, 3.0]),
                PartRole::Jaw,
            ),
            (
                "upper teeth",
                about(&lips, [0.0, 1.0, -2.5], [3.0, 0.8, 2.0]),
                PartRole::Skull,
            ),
            (
                "gums with tongue",
                about(&lips, [0.0, 0.0, -4.5], [3.5, 2.4, 4.0]),
                PartRole::Mouth,
            ),
            (
                "glasses",
                about(&eyes, [0.0, -0.5, -4.0], [7.0, 2.5, 6.0]),
                PartRole::Skull,
            ),
            (
                "lens",
                about(&eye, [0.0, -0.3, 1.6], [2.2, 1.8, 0.2]),
                PartRole::Skull,
            ),
            (
                "hair",
                about(&brow, [3.0, 4.0, -8.0], [9.0, 7.0, 10.0]),
                PartRole::Skull,
            ),
            (
                "moustache",
                about(&[33, 51], [0.0, 0.0, 0.2], [2.5, 0.5, 0.5]),
                PartRole::Nearest,
            ),
            (
                "hoodie",
                about(&[8], [0.0, -9.0, -8.0], [16.0, 11.0, 10.0]),
                PartRole::Still,
            ),
            (
                "long beard",
                about(&[8], [0.0, -6.0, -1.0], [5.0, 8.0, 2.0]),
                PartRole::Nearest,
            ),
            (
                "lamp",
                about(&[30], [40.0, 0.0, 0.0], [3.0; 3]),
                PartRole::Still,
            ),
        ] {
            assert_eq!(got, expected, "{name}");
        }
    }
}
