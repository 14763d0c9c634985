//! Motion of the eyeballs and the tongue in the shapes, which landmarks do not show.
//!
//! Lengths are canonical centimetres.

use glam::Vec3;

use crate::{
    face::{PartList, binding::Follows},
    mesh::{PartRole, Parts, ibug::LANDMARKS, sphere::fit_sphere},
};

/// How far an eye turns in a look at strength 1, degrees: up, down, in, out. ARKit does not define
/// it, and the available face models do not turn their eyeballs.
pub const GAZE_DEGREES: [f32; 4] = [25.0, 25.0, 30.0, 30.0];
/// The largest root mean square distance of an eyeball's vertices from its sphere, as a share of
/// the radius.
const ROUND: f32 = 0.12;
/// The least and the largest radius of an eyeball, as a share of the width of the eye's opening.
const EYE_RADIUS: (f32, f32) = (0.35, 0.9);
/// A part inside the eyeball and narrower than this share of it, such as an iris, turns with it.
const IRIS_SHARE: f32 = 0.6;
/// A part in the mouth that is deeper than this along the midline contains a tongue and is no row
/// of teeth, on a mouth 5 cm wide.
const TONGUE_DEPTH_CM: f32 = 2.2;
/// If such a part also reaches this far above the line of the lips, it is gums and tongue in one,
/// on a mouth 5 cm wide.
const GUMS_ABOVE_CM: f32 = 1.2;
/// How far the tip comes out in front of the lips at strength 1, on a mouth 5 cm wide.
const TONGUE_OUT_CM: f32 = 2.0;

/// An eyeball with all parts that turn with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Eyeball {
    /// Whether it is the subject's left one.
    pub is_left: bool,
    /// Centre of the sphere.
    pub centre: [f32; 3],
    /// Radius of the sphere.
    pub radius: f32,
    /// Vertex numbers.
    pub vertices: Vec<u32>,
}

/// A tongue that is a separate part of the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Tongue {
    /// Vertex numbers.
    pub vertices: Vec<u32>,
    /// `[vertices]`, displacement in tongueOut.
    pub out: Vec<[f32; 3]>,
}

/// Which way the eyes look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Gaze {
    Up,
    Down,
    In,
    Out,
}

impl Eyeball {
    /// Displacement of a vertex when the eye turns to `gaze` at strength 1. The eye rotates about
    /// its centre, but a blend shape contains only the two ends of the rotation.
    pub fn look(&self, gaze: Gaze, position: [f32; 3]) -> [f32; 3] {
        let inward = if self.is_left { -1.0 } else { 1.0 };
        let (degrees, side, up) = match gaze {
            Gaze::Up => (GAZE_DEGREES[0], 0.0, 1.0),
            Gaze::Down => (GAZE_DEGREES[1], 0.0, -1.0),
            Gaze::In => (GAZE_DEGREES[2], inward, 0.0),
            Gaze::Out => (GAZE_DEGREES[3], -inward, 0.0),
        };
        let (sin, cos) = degrees.to_radians().sin_cos();
        let from: [f32; 3] = std::array::from_fn(|i| position[i] - self.centre[i]);
        // The plane of the turn contains the line of sight, +z, and the direction of the turn.
        let along = side * from[0] + up * from[1];
        let (gain, depth) = (
            cos * along + sin * from[2] - along,
            cos * from[2] - sin * along - from[2],
        );
        [side * gain, up * gain, depth]
    }
}

/// Finds the eyeballs among the parts that rest with the skull.
pub fn eyeballs(
    positions: &[[f32; 3]],
    parts: &Parts,
    follows: &[Follows],
    landmarks: &[[f32; 3]; LANDMARKS],
) -> Vec<Eyeball> {
    let resting: Vec<Vec<u32>> = parts
        .vertices()
        .into_iter()
        .filter(|part| part.iter().all(|&v| follows[v as usize] == Follows::Skull))
        .collect();
    [(36, false), (42, true)]
        .into_iter()
        .filter_map(|(first, is_left)| {
            eyeball(positions, &resting, &landmarks[first..first + 6], is_left)
        })
        .collect()
}

fn eyeball(
    positions: &[[f32; 3]],
    parts: &[Vec<u32>],
    lids: &[[f32; 3]],
    is_left: bool,
) -> Option<Eyeball> {
    let opening: [f32; 3] =
        std::array::from_fn(|i| lids.iter().map(|p| p[i]).sum::<f32>() / lids.len() as f32);
    let width = Vec3::from(lids[0]).distance(lids[3].into());
    let fits = |part: &Vec<u32>| {
        let (centre, radius, off) = fit_sphere(part.iter().map(|&v| positions[v as usize]))?;
        let sideways = (0..2).all(|i| (centre[i] - opening[i]).abs() < 0.5 * width);
        let behind = opening[2] - centre[2];
        let right_size = radius > EYE_RADIUS.0 * width && radius < EYE_RADIUS.1 * width;
        let round = off < ROUND * radius && span(positions, part) > 1.2 * radius;
        let in_place = sideways && behind > 0.0 && behind < 1.5 * radius;
        (right_size && round && in_place).then_some((centre, radius))
    };
    // The largest ball is the eye. A cornea or an iris may lie on it or in it.
    let balls = parts
        .iter()
        .filter_map(|part| fits(part).map(|ball| (part.len(), ball)));
    let (_, (centre, radius)) = balls.max_by_key(|(size, _)| *size)?;
    let inside = |part: &Vec<u32>| {
        let within =
            |&v: &u32| Vec3::from(positions[v as usize]).distance(centre.into()) < 1.1 * radius;
        part.iter().all(within) && span(positions, part) < IRIS_SHARE * 2.0 * radius
    };
    let turning = parts
        .iter()
        .filter(|part| fits(part).is_some() || inside(part));
    Some(Eyeball {
        is_left,
        centre,
        radius,
        vertices: turning.flatten().copied().collect(),
    })
}

/// The tongue of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub enum TongueFound {
    /// A separate part.
    Own(Tongue),
    /// Sewn to the gums: it cannot come out without them.
    WithGums,
    /// None.
    None,
}

impl TongueFound {
    /// Why the tongue cannot move, if it cannot.
    pub fn complaint(&self) -> Option<&'static str> {
        match self {
            TongueFound::Own(_) => None,
            TongueFound::WithGums => {
                Some("the tongue is one part with the gums, so it cannot move by itself")
            }
            TongueFound::None => Some("no tongue was found in the mouth"),
        }
    }
}

/// Finds the tongue among the parts of the jaw and the mouth. It runs deep along the midline.
pub fn tongue(
    positions: &[[f32; 3]],
    parts: &PartList,
    landmarks: &[[f32; 3]; LANDMARKS],
) -> TongueFound {
    let unit = Vec3::from(landmarks[48]).distance(landmarks[54].into()) / 5.0;
    let lips = middle_of_lips(landmarks);
    let deep = |part: &Vec<u32>| {
        let midline = part
            .iter()
            .filter(|&&v| (positions[v as usize][0] - lips[0]).abs() < 0.4 * unit);
        let (low, high) = range(midline.map(|&v| positions[v as usize][2]));
        high - low > TONGUE_DEPTH_CM * unit
    };
    let above = |part: &Vec<u32>| {
        let (_, high) = range(part.iter().map(|&v| positions[v as usize][1]));
        high - lips[1] > GUMS_ABOVE_CM * unit
    };
    let lists = parts.connected.vertices();
    let of_jaw = parts.parts.iter().zip(lists);
    let of_jaw = of_jaw.filter(|(part, _)| matches!(part.role, PartRole::Jaw | PartRole::Mouth));
    let deep = of_jaw.filter_map(|(_, vertices)| deep(&vertices).then_some(vertices));
    let deep_parts: Vec<Vec<u32>> = deep.collect();
    match deep_parts
        .iter()
        .filter(|part| !above(part))
        .max_by_key(|part| part.len())
    {
        Some(part) => TongueFound::Own(come_out(positions, part, lips, unit)),
        None if deep_parts.is_empty() => TongueFound::None,
        None => TongueFound::WithGums,
    }
}

/// Moves the tip out between the lips. The root stays, and the rest stretches between the two.
fn come_out(positions: &[[f32; 3]], part: &[u32], lips: [f32; 3], unit: f32) -> Tongue {
    let depth = |v: u32| positions[v as usize][2];
    let (root, tip) = range(part.iter().map(|&v| depth(v)));
    let front: Vec<u32> = part
        .iter()
        .copied()
        .filter(|&v| depth(v) > tip - 0.3 * unit)
        .collect();
    let height = front.iter().map(|&v| positions[v as usize][1]).sum::<f32>() / front.len() as f32;
    let by = [0.0, lips[1] - height, lips[2] + TONGUE_OUT_CM * unit - tip];
    let out = part.iter().map(|&v| {
        let along = ((depth(v) - root) / (tip - root)).clamp(0.0, 1.0);
        // From root to tip, the tongue rises over the teeth early and stretches forward late.
        [0.0, along * (2.0 - along) * by[1], along * along * by[2]]
    });
    Tongue {
        out: out.collect(),
        vertices: part.to_vec(),
    }
}

/// The point midway between the lips.
pub fn middle_of_lips(landmarks: &[[f32; 3]; LANDMARKS]) -> [f32; 3] {
    std::array::from_fn(|i| 0.5 * (landmarks[62][i] + landmarks[66][i]))
}

fn range(values: impl Iterator<Item = f32>) -> (f32, f32) {
    values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    })
}

/// Largest extent along an axis.
fn span(positions: &[[f32; 3]], part: &[u32]) -> f32 {
    let along = |i: usize| {
        let (low, high) = range(part.iter().map(|&v| positions[v as usize][i]));
        high - low
    };
    (0..3).map(along).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(centre: [f32; 3], radius: f32) -> Vec<[f32; 3]> {
        let ring = |i: usize, j: usize| {
            let (up, around) = (0.3 + 0.35 * i as f32, 0.7 * j as f32);
            [up.sin() * around.cos(), up.sin() * around.sin(), up.cos()]
        };
        (0..72)
            .map(|k| ring(k / 9, k % 9))
            .map(|d| std::array::from_fn(|i| centre[i] + radius * d[i]))
            .collect()
    }

    #[test]
    fn a_sphere_is_found_from_its_points() {
        let (centre, radius, off) = fit_sphere(ball([3.0, 3.5, 8.0], 1.5).into_iter()).unwrap();
        for (got, want) in centre.iter().zip([3.0, 3.5, 8.0]) {
            assert!((got - want).abs() < 1e-4);
        }
        assert!((radius - 1.5).abs() < 1e-4 && off < 1e-4);
    }

    #[test]
    fn an_eye_keeps_its_shape_and_looks_where_it_is_told() {
        let eye = Eyeball {
            is_left: true,
            centre: [3.0, 3.0, 8.0],
            radius: 1.5,
            vertices: Vec::new(),
        };
        let pupil = [3.0, 3.0, 9.5];
        for (gaze, axis, sign) in [
            (Gaze::Up, 1, 1.0),
            (Gaze::Down, 1, -1.0),
            (Gaze::In, 0, -1.0),
            (Gaze::Out, 0, 1.0),
        ] {
            let moved = eye.look(gaze, pupil);
            assert!(sign * moved[axis] > 0.5, "{gaze:?} {moved:?}");
            for point in ball(eye.centre, 1.5) {
                let moved = eye.look(gaze, point);
                let there = std::array::from_fn(|i| point[i] + moved[i]);
                assert!((Vec3::from(there).distance(eye.centre.into()) - 1.5).abs() < 1e-4);
            }
        }
    }
}
