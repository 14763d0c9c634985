//! Decides which parts of a head are eyes. An eye is round and sits in a socket, on a stalk or on
//! the face. Whatever lies on such a ball or inside it belongs to the eye.
//!
//! A ball at an eye of the landmarks may be egg-shaped. Anywhere else (a third eye, the eye of a
//! cyclops, eyes on stalks) it must be a sphere of the size of an eye that touches skin. It must
//! lie above the tip of the nose and away from the ears, where earrings hang. Lashes are as wide as
//! an eye but not round. Cards of single lashes are as small as a pupil but stand out of the ball.
//!
//! Avatars often have only the front of an eye: a cap of a ball, or a shallow disc behind the lids.
//! It lies at an eye of the landmarks, is about as wide as high, and has points on all sides and in
//! its middle, where lashes have none. A part that is called an eye and lies at one is an eye
//! whatever its shape.
//! Lengths are canonical centimetres.

use glam::Vec3;

use super::box3::Box3;
use crate::mesh::{SurfaceTree, ibug::LANDMARKS, sphere::fit_sphere};

/// Points within this share of the first fit's radius belong to the inside of an eye.
const INSIDE: f32 = 0.93;
/// A part is a sphere if the root mean square distance of its points from the fit is less than this
/// share of the radius.
const ROUND: f32 = 0.12;
/// Least extent of a ball, as a share of the radius: more than half of the ball must be there.
const LEAST_EXTENT: f32 = 1.0;
/// Least ratio of smallest to largest extent of an egg at the place of an eye.
const EGG: f32 = 0.55;
/// Range of the largest extent of an egg, in widths of the eye.
const EGG_WIDTHS: (f32, f32) = (0.5, 2.0);
/// On each of its four sides (right, left, above, below), a ball has at least this share of its
/// points.
const SIDE_SHARE: f32 = 0.1;
/// A point lies on a side if it is farther than this from the middle, as a share of the radius.
const SIDE: f32 = 0.2;
/// Points of a part on or in a ball lie at most this far from its centre, as a share of the radius.
const ON_BALL: f32 = 1.2;
/// They also lie within this angle of the middle of their part, seen from the centre, unless the
/// whole part lies inside the ball.
const CAP_DEG: f32 = 48.0;
/// The middle of a cap lies at most this far from straight ahead: within the first angle for a
/// narrow cap such as a slit pupil, within the second for a cap about as wide as high. Skin at the
/// corner of the eye lies farther aside.
const FRONT_DEG: (f32, f32) = (12.0, 60.0);
/// A cap is about as wide as high if its smaller extent is more than this share of the larger.
const AS_WIDE: f32 = 0.75;
/// In an eye without a ball, each part is smaller than this, in widths of the eye.
const SMALL: f32 = 0.6;
/// The middle of such a part lies less than this beside that of the eye, in widths of the eye.
const SMALL_BESIDE: f32 = 0.3;
/// Such a part stands out less than this in front of the middle of the eye, in widths of the eye.
const SMALL_BEFORE: f32 = 0.2;
/// The middle of the front of an eye lies less than this beside that of the eye, in widths of the
/// eye.
const FRONT_BESIDE: f32 = 0.35;
/// Range of the largest extent of the front of an eye, in widths of the eye.
const FRONT_WIDTHS: (f32, f32) = (0.6, 2.0);
/// Least ratio of its smaller to its larger extent, seen from the front.
const FRONT_ROUND: f32 = 0.5;
/// At least this share of its points lies in its middle, which is this share of its extent.
const FRONT_MIDDLE: (f32, f32) = (0.1, 0.6);
/// At least this share lies in its centre column, which is this share of its width, in the upper half
/// and in the lower half. An arc of lashes lacks one of them.
const FRONT_CENTRE: (f32, f32) = (0.03, 0.4);
/// Words in the names of eyes, and words of names that are no eyes though they contain one.
const EYE_WORDS: [&str; 8] = [
    "eye", "eyes", "eyeball", "eyeballs", "cornea", "sclera", "iris", "pupil",
];
const BESIDE_EYE_WORDS: [&str; 16] = [
    "brow",
    "brows",
    "eyebrow",
    "eyebrows",
    "lash",
    "lashes",
    "eyelash",
    "eyelashes",
    "lid",
    "lids",
    "shadow",
    "liner",
    "socket",
    "occlusion",
    "glasses",
    "patch",
];
/// A part that is called an eye lies at most this far beside an eye, before and behind it, in widths
/// of the eye.
const NAMED_BESIDE: f32 = 0.6;
const NAMED_DEPTH: (f32, f32) = (-1.5, 0.4);
/// It is at most this large, in widths of the eye.
const NAMED_WIDTHS: f32 = 2.5;
/// Range of the radius of a ball elsewhere: as a share of the mean width of both eyes if they have
/// no balls, otherwise of the radius of a ball at the eyes.
const ELSEWHERE_OF_WIDTH: (f32, f32) = (0.2, 1.5);
const ELSEWHERE_OF_BALL: (f32, f32) = (0.5, 2.0);
/// Skin holds a ball if the nearest skin lies this far from the centre, as a range of shares of the
/// radius.
const HELD_DISTANCES: (f32, f32) = (0.2, 1.35);
/// Ears begin at this share of the way from the middle of the face to the jaw hinges.
const EARS: f32 = 0.8;

/// A ball.
#[derive(Clone, Copy)]
struct Ball {
    centre: [f32; 3],
    radius: f32,
}

/// Where eyes may be.
pub(super) struct EyeParts {
    /// Centre and width of both eyes of the landmarks; the subject's right eye comes first.
    eyes: [([f32; 3], f32); 2],
    nose_tip: [f32; 3],
    brows_y: f32,
    /// Sideways distance from the middle of the face to where the ears begin.
    ears_x: f32,
    middle_x: f32,
}

impl EyeParts {
    pub(super) fn new(
        landmarks: &[[f32; 3]; LANDMARKS],
        eyes: [([f32; 3], f32); 2],
        brows_y: f32,
    ) -> EyeParts {
        let (right, left) = (landmarks[0][0], landmarks[16][0]);
        EyeParts {
            eyes,
            nose_tip: landmarks[30],
            brows_y,
            ears_x: EARS * 0.5 * (left - right).abs(),
            middle_x: 0.5 * (left + right),
        }
    }

    /// Whether each part, a list of points, belongs to an eye. `names`: what the file calls the
    /// parts. `skin` is called only when the surface of the face is needed to decide.
    pub(super) fn find<'a>(
        &self,
        parts: &[Vec<[f32; 3]>],
        names: &[Option<&str>],
        skin: impl Fn() -> &'a SurfaceTree,
    ) -> Vec<bool> {
        let at_eye: Vec<Option<Ball>> = parts.iter().map(|p| self.ball_at_an_eye(p)).collect();
        let spheres: Vec<Option<Ball>> = parts.iter().map(|points| sphere(points)).collect();
        let mut balls: Vec<Ball> = at_eye.iter().copied().flatten().collect();
        let elsewhere = spheres.iter().copied().flatten();
        let elsewhere = elsewhere.filter(|ball| self.may_be_elsewhere(ball, &balls));
        let elsewhere: Vec<Ball> = elsewhere.filter(|ball| is_held_by(ball, skin())).collect();
        balls.extend(elsewhere);
        let is_eye = |(p, points): (usize, &Vec<[f32; 3]>)| {
            at_eye[p].is_some()
                || spheres[p]
                    .is_some_and(|candidate| balls.iter().any(|ball| same(ball, &candidate)))
                || balls.iter().any(|ball| lies_on(ball, points))
                || self.is_small(points, &balls)
                || (self.is_front(points, &balls) && !names[p].is_some_and(is_beside_eye))
                || names[p].is_some_and(|name| is_name_of_eye(name) && self.is_at_an_eye(points))
        };
        parts.iter().enumerate().map(is_eye).collect()
    }

    /// The part as a ball, if it is one at an eye of the landmarks.
    fn ball_at_an_eye(&self, points: &[[f32; 3]]) -> Option<Ball> {
        let bounds = Box3::of(points.iter().copied());
        let (middle, largest) = (bounds.middle(), bounds.largest());
        let is_egg = bounds.smallest() > EGG * largest;
        let at = self.eyes.iter().any(|&(centre, width)| {
            let depth = middle[2] - centre[2];
            let size = EGG_WIDTHS.0 * width..EGG_WIDTHS.1 * width;
            let beside = (0..2).all(|i| (middle[i] - centre[i]).abs() < 0.6 * width);
            beside && depth > -1.2 * width && depth < 0.3 * width && size.contains(&largest)
        });
        (is_egg && at).then_some(Ball {
            centre: middle,
            radius: 0.5 * largest,
        })
    }

    /// Whether a ball away from the landmarks has the size and the place of an eye.
    fn may_be_elsewhere(&self, ball: &Ball, at_eyes: &[Ball]) -> bool {
        let within =
            |(low, high): (f32, f32), of: f32| (low * of..high * of).contains(&ball.radius);
        let width = 0.5 * (self.eyes[0].1 + self.eyes[1].1);
        let size = match at_eyes {
            [] => within(ELSEWHERE_OF_WIDTH, width),
            known => known
                .iter()
                .any(|eye| within(ELSEWHERE_OF_BALL, eye.radius)),
        };
        let [x, y, _] = ball.centre;
        let is_nose = Vec3::from(ball.centre).distance(self.nose_tip.into()) < 1.2 * ball.radius;
        let at_ears = (x - self.middle_x).abs() > self.ears_x && y < self.brows_y;
        size && !is_nose && !at_ears && y > self.nose_tip[1]
    }

    /// Whether a part is the front of an eye that has no ball.
    fn is_front(&self, points: &[[f32; 3]], balls: &[Ball]) -> bool {
        let bounds = Box3::of(points.iter().copied());
        let middle = bounds.middle();
        let half = [0, 1].map(|i| 0.5 * (bounds.high[i] - bounds.low[i]));
        let [less, more] = [half[0].min(half[1]), half[0].max(half[1])];
        let at = self.eyes.iter().any(|&(centre, width)| {
            let beside = (0..2).all(|i| (middle[i] - centre[i]).abs() < FRONT_BESIDE * width);
            let deep =
                middle[2] > centre[2] - width && bounds.high[2] < centre[2] + SMALL_BEFORE * width;
            let size = FRONT_WIDTHS.0 * width..FRONT_WIDTHS.1 * width;
            beside && deep && size.contains(&(2.0 * more)) && !has_ball(balls, centre, width)
        });
        if !at || less < FRONT_ROUND * more {
            return false;
        }
        let way = |p: &[f32; 3]| [0, 1].map(|i| (p[i] - middle[i]) / half[i]);
        let share = |is_there: &dyn Fn([f32; 2]) -> bool| {
            let there = points.iter().filter(|p| is_there(way(p))).count();
            there as f32 / points.len() as f32
        };
        let sides = [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)];
        sides
            .iter()
            .all(|&(axis, sign)| share(&|w| sign * w[axis] > SIDE) >= SIDE_SHARE)
            && share(&|w| w[0].hypot(w[1]) < FRONT_MIDDLE.1) >= FRONT_MIDDLE.0
            && [-1.0, 1.0].iter().all(|side| {
                let is_there = |w: [f32; 2]| w[0].abs() < FRONT_CENTRE.1 && side * w[1] > SIDE;
                share(&is_there) >= FRONT_CENTRE.0
            })
    }

    /// Whether a part lies where an eye is.
    fn is_at_an_eye(&self, points: &[[f32; 3]]) -> bool {
        let bounds = Box3::of(points.iter().copied());
        let middle = bounds.middle();
        self.eyes.iter().any(|&(centre, width)| {
            let beside = (0..2).all(|i| (middle[i] - centre[i]).abs() < NAMED_BESIDE * width);
            let depth = NAMED_DEPTH.0 * width..NAMED_DEPTH.1 * width;
            beside
                && depth.contains(&(middle[2] - centre[2]))
                && bounds.largest() < NAMED_WIDTHS * width
        })
    }

    /// Whether a part is a pupil, an iris or a highlight in an eye that has no ball.
    fn is_small(&self, points: &[[f32; 3]], balls: &[Ball]) -> bool {
        let bounds = Box3::of(points.iter().copied());
        let middle = bounds.middle();
        self.eyes.iter().any(|&(centre, width)| {
            let beside = (0..2).all(|i| (middle[i] - centre[i]).abs() < SMALL_BESIDE * width);
            let deep =
                middle[2] > centre[2] - width && bounds.high[2] < centre[2] + SMALL_BEFORE * width;
            let has_ball = has_ball(balls, centre, width);
            beside && deep && bounds.largest() < SMALL * width && !has_ball
        })
    }
}

/// Whether a ball lies at an eye.
fn has_ball(balls: &[Ball], eye: [f32; 3], width: f32) -> bool {
    let mut centres = balls.iter().map(|ball| Vec3::from(ball.centre));
    centres.any(|centre| centre.distance(eye.into()) < width)
}

/// Whether a name is that of an eye, such as `eye_left`, `EyeR` or `Wolf3D_Eyes`.
fn is_name_of_eye(name: &str) -> bool {
    has_word(name, &EYE_WORDS) && !is_beside_eye(name)
}

/// Whether a name is that of something at an eye, such as `lashes_left`.
fn is_beside_eye(name: &str) -> bool {
    has_word(name, &BESIDE_EYE_WORDS)
}

fn has_word(name: &str, known: &[&str]) -> bool {
    words(name).iter().any(|word| known.contains(&&**word))
}

/// The words of a name in lower case. They begin at capitals and after anything that is no letter.
pub(super) fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_small = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (was_small && letter.is_uppercase()) {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| letter.is_alphabetic()) {
            word.extend(letter.to_lowercase());
        }
        was_small = letter.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Whether points lie on all four sides of a ball. A sphere may fit lashes, but their points lie on
/// one side.
fn surround(points: &[[f32; 3]], ball: &Ball) -> bool {
    let least = SIDE_SHARE * points.len() as f32;
    let beyond = |axis: usize, sign: f32| {
        let away = |p: &&[f32; 3]| sign * (p[axis] - ball.centre[axis]) > SIDE * ball.radius;
        points.iter().filter(away).count() as f32
    };
    [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)]
        .iter()
        .all(|&(axis, sign)| beyond(axis, sign) >= least)
}

/// The sphere that the outside of a part forms, if it does.
fn sphere(points: &[[f32; 3]]) -> Option<Ball> {
    let (centre, radius, _) = fit_sphere(points.iter().copied())?;
    let outer = points.iter().copied();
    let outer = outer.filter(|p| Vec3::from(*p).distance(centre.into()) > INSIDE * radius);
    if 2 * outer.clone().count() < points.len() {
        return None;
    }
    let (centre, radius, off) = fit_sphere(outer)?;
    let bounds = Box3::of(points.iter().copied());
    let whole = bounds.smallest() > LEAST_EXTENT * radius && bounds.largest() < 2.5 * radius;
    let ball = Ball { centre, radius };
    (whole && off < ROUND * radius && surround(points, &ball)).then_some(ball)
}

/// Whether skin holds a ball.
fn is_held_by(ball: &Ball, skin: &SurfaceTree) -> bool {
    let place = skin.closest(ball.centre);
    let distances = HELD_DISTANCES.0 * ball.radius..HELD_DISTANCES.1 * ball.radius;
    place.is_some_and(|place| distances.contains(&(place.distance as f32)))
}

/// Whether two balls belong together, such as a cornea and the eye that it covers.
fn same(a: &Ball, b: &Ball) -> bool {
    Vec3::from(a.centre).distance(b.centre.into()) < 0.3 * a.radius
        && (0.7 * a.radius..1.4 * a.radius).contains(&b.radius)
}

/// Whether a part lies in a ball, or on it as a cap.
fn lies_on(ball: &Ball, points: &[[f32; 3]]) -> bool {
    let centre = Vec3::from(ball.centre);
    let ways: Vec<Vec3> = points.iter().map(|&p| Vec3::from(p) - centre).collect();
    let furthest = ways.iter().map(|way| way.length()).fold(0.0, f32::max);
    if furthest > ON_BALL * ball.radius {
        return false;
    }
    if furthest < INSIDE * ball.radius {
        return true;
    }
    let middle: Vec3 = ways.iter().sum();
    let size = middle.length();
    let least = CAP_DEG.to_radians().cos() * size;
    let bounds = Box3::of(points.iter().copied());
    let [wide, high] = [0, 1].map(|i| bounds.high[i] - bounds.low[i]);
    let is_round = wide.min(high) > AS_WIDE * wide.max(high);
    let front = [FRONT_DEG.0, FRONT_DEG.1][usize::from(is_round)];
    middle[2] > front.to_radians().cos() * size
        && ways
            .iter()
            .all(|way| way.dot(middle) >= least * way.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, canonical_landmarks};

    fn landmarks() -> [[f32; 3]; LANDMARKS] {
        canonical_landmarks().map(|p| p.map(|x| 100.0 * x))
    }

    fn middle(marks: &[[f32; 3]]) -> [f32; 3] {
        Box3::of(marks.iter().copied()).middle()
    }

    fn eye_parts() -> EyeParts {
        let marks = landmarks();
        let eye = |first: usize| {
            let width = Vec3::from(marks[first + 3]).distance(marks[first].into());
            (middle(&marks[first..first + 6]), width)
        };
        EyeParts::new(&marks, [eye(36), eye(42)], middle(&marks[17..27])[1])
    }

    /// Points of an ellipsoid, in the directions that `keep` accepts.
    fn ellipsoid(
        centre: [f32; 3],
        radii: [f32; 3],
        keep: impl Fn([f32; 3]) -> bool,
    ) -> Vec<[f32; 3]> {
        let turns =
            (0..24).flat_map(|i| (0..=12).map(move |j| (i as f32 * 0.2618, j as f32 * 0.2618)));
        let ways = turns.map(|(about, away)| {
            [
                away.sin() * about.cos(),
                away.sin() * about.sin(),
                away.cos(),
            ]
        });
        let chosen = ways.filter(|way| keep(*way));
        chosen
            .map(|way| std::array::from_fn(|i| centre[i] + radii[i] * way[i]))
            .collect()
    }

    fn ball(centre: [f32; 3], radius: f32) -> Vec<[f32; 3]> {
        ellipsoid(centre, [radius; 3], |_| true)
    }

    /// A strip along a lid, as wide as the eye's opening, that stands out of the lid like lashes.
    fn lashes(centre: [f32; 3]) -> Vec<[f32; 3]> {
        let along = (0..20).map(|k| (k as f32 - 9.5) / 9.5);
        along
            .flat_map(|x| {
                let root = [1.5 * x, 0.4 - 0.3 * x * x, 0.9 - 0.5 * x * x];
                [0.3, 0.9].map(|out| [root[0] * (1.0 + 0.2 * out), root[1] + out, root[2] + out])
            })
            .map(|p| std::array::from_fn(|i| centre[i] + p[i]))
            .collect()
    }

    /// Finds the eyes among parts. The skin is a wall through the eyes, as wide as the face.
    fn are_eyes(parts: &[Vec<[f32; 3]>]) -> Vec<bool> {
        are_named_eyes(parts, &vec![None; parts.len()])
    }

    fn are_named_eyes(parts: &[Vec<[f32; 3]>], names: &[Option<&str>]) -> Vec<bool> {
        let z = middle(&landmarks()[36..48])[2];
        let wall = Mesh {
            positions: vec![
                [-9.0, -9.0, z],
                [9.0, -9.0, z],
                [9.0, 12.0, z],
                [-9.0, 12.0, z],
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let tree = SurfaceTree::new(&wall);
        eye_parts().find(parts, names, || &tree)
    }

    #[test]
    fn balls_eggs_and_what_lies_on_them_are_eyes_and_lashes_are_not() {
        let [right, left] = eye_parts().eyes.map(|(centre, _)| centre);
        let behind = |c: [f32; 3]| [c[0], c[1], c[2] - 1.0];
        let cap = |way: [f32; 3]| way[2] > 0.85;
        // The wet line along a lid, and the skin of the corner.
        let strip = |w: [f32; 3]| (0.3..0.5).contains(&w[1]) && w[2] > 0.2;
        let strip = ellipsoid(behind(right), [1.3; 3], strip);
        let corner = |w: [f32; 3]| (0.2..0.65).contains(&w[0]) && w[1].abs() < 0.6 && w[2] > 0.5;
        let corner = ellipsoid(behind(right), [1.3; 3], corner);
        let parts = [
            ball(behind(right), 1.2),
            ellipsoid(behind(left), [1.1, 1.8, 1.1], |_| true),
            ellipsoid(behind(right), [1.26; 3], cap),
            ball(behind(right), 0.4),
            lashes(behind(right)),
            strip,
            corner,
            // Long lashes all along the upper lid: a sphere fits them.
            ellipsoid(behind(right), [1.7; 3], |w| w[1] > 0.3 && w[2] > -0.2),
        ];
        assert_eq!(
            are_eyes(&parts),
            [true, true, true, true, false, false, false, false]
        );
    }

    #[test]
    fn the_front_of_an_eye_is_an_eye_and_a_ring_of_lashes_is_not() {
        let [right, left] = eye_parts().eyes.map(|(centre, _)| centre);
        let behind = |c: [f32; 3]| [c[0], c[1], c[2] - 1.0];
        let parts = [
            // Caps of balls: nearly half of one, and a third.
            ellipsoid(behind(right), [1.2; 3], |w| w[2] > 0.1),
            ellipsoid(behind(left), [1.2; 3], |w| w[2] > 0.34),
            // A closed shallow disc, and the front of one.
            ellipsoid(right, [1.6, 1.3, 0.3], |_| true),
            ellipsoid(left, [1.6, 1.3, 0.3], |w| w[2] > 0.0),
            // Lashes all around the eye, and above it.
            ellipsoid(right, [1.5, 1.2, 0.4], |w| w[2].abs() < 0.5),
            ellipsoid(right, [1.5, 1.2, 0.4], |w| w[2].abs() < 0.5 && w[1] > 0.0),
            lashes(right),
        ];
        let expected = [true, true, true, true, false, false, false];
        assert_eq!(are_eyes(&parts), expected);
    }

    #[test]
    fn what_is_called_an_eye_and_lies_at_one_is_an_eye() {
        let right = eye_parts().eyes[0].0;
        let odd = |way: [f32; 3]| way[1] > 0.1 && way[0] > -0.2;
        let odd = ellipsoid(right, [1.7, 0.6, 0.3], odd);
        let elsewhere = odd.iter().map(|p| [p[0], p[1] - 6.0, p[2]]).collect();
        let parts = [odd.clone(), odd.clone(), odd, elsewhere];
        let names = [Some("EyeLeft"), Some("Eyelashes_L"), None, Some("eye_left")];
        assert_eq!(are_named_eyes(&parts, &names), [true, false, false, false]);
        for name in ["Wolf3D_Eyes", "eye.R", "Eyeball_01", "CC_Base_Eye"] {
            assert!(is_name_of_eye(name), "{name}");
        }
        for name in ["CC_Base_EyeOcclusion", "eyeBrow", "Eyelid", "keyed"] {
            assert!(!is_name_of_eye(name), "{name}");
        }
    }

    #[test]
    fn a_third_eye_and_eyes_on_stalks_are_found_and_other_balls_are_not() {
        let marks = landmarks();
        let between = middle(&[marks[36], marks[45]]);
        let at = |x: f32, y: f32, z: f32| [between[0] + x, between[1] + y, between[2] + z];
        let nose = [marks[30][0], marks[30][1] + 0.2, between[2] + 0.5];
        let parts = [
            ball(at(0.0, 4.0, -0.5), 1.2),
            ball(at(4.0, 5.5, 1.0), 1.2),
            ball(at(0.0, 4.0, 6.0), 1.2),
            ball(at(-3.0, 4.0, -0.1), 0.15),
            ball(at(8.0, -1.0, 0.5), 1.0),
            ball(nose, 1.0),
            ball(at(2.0, -8.0, 0.0), 1.2),
        ];
        assert_eq!(
            are_eyes(&parts),
            [true, true, false, false, false, false, false]
        );
    }

    #[test]
    fn cards_of_single_lashes_are_no_pupils() {
        let [(right, _), _] = eye_parts().eyes;
        let eye = [right[0], right[1], right[2] - 1.0];
        let card: Vec<[f32; 3]> = (0..8)
            .map(|k| {
                [
                    eye[0] + 0.1 * f32::from(k as u8 % 2),
                    eye[1] + 0.5 + 0.1 * k as f32,
                    eye[2] + 1.1 + 0.1 * k as f32,
                ]
            })
            .collect();
        assert_eq!(are_eyes(&[ball(eye, 1.2), card]), [true, false]);
    }
}
