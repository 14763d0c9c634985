//! The ball that the lids of one eye slide over: a sphere with the bulge of the cornea.
//!
//! Points are given in an eye's own frame, about the centre of the ball. Its axes point across from
//! corner to corner, up, and out of the face. Lengths are canonical centimetres.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::ease;
use crate::mesh::sphere;

/// Radius of an eyeball as a share of the width of its eye: 12 mm to 28 mm on human heads.
const RADIUS_OF_WIDTH: f32 = 0.43;
/// A fitted radius is rejected outside this range, as factors of the usual radius.
const RADIUS_RANGE: (f32, f32) = (0.7, 2.0);
/// A shallow eye is a piece of a sphere of at most this many times the usual radius: 14 cm, which
/// rises by 1.5 mm over the width of a large eye. A flatter one counts as such a piece.
const FLATTEST: f32 = 8.0;
/// Its front is at least this wide, in widths of the eye.
const LEAST_ACROSS: f32 = 0.6;
/// Points within this share of the first fit's radius belong to the inside of the eye.
const INSIDE: f32 = 0.93;
/// The cornea bulges by at most this, as a share of the radius.
const MAX_BULGE: f32 = 0.25;
/// The eye turns and its cornea turns with it. So the bulge stays full up to the first angle beyond
/// the edge of the cornea, and is gone at the second.
const TURN_DEG: (f32, f32) = (6.0, 22.0);

/// A sphere about the origin of its eye's frame, with a bulge at the front.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Eyeball {
    pub radius: f32,
    /// How far the cornea bulges out of the sphere.
    bulge: f32,
    /// Cosines of the angles from the front axis at which the bulge is full, and at which it is
    /// gone.
    edge: (f32, f32),
}

impl Eyeball {
    /// Makes a sphere of `radius` with a cornea measured from `points` of the eye's surface.
    pub(crate) fn new(radius: f32, points: &[[f32; 3]]) -> Eyeball {
        let front = points.iter().filter_map(|&p| {
            let length = Vec3::from(p).length();
            let cosine = p[2] / length;
            (cosine > 0.5).then_some((cosine, length - radius))
        });
        let front: Vec<(f32, f32)> = front.collect();
        let bulge = front.iter().fold(0.0f32, |most, (_, out)| most.max(*out));
        let standing = front.iter().filter(|(_, out)| *out > 0.2 * bulge);
        let widest = standing.fold(1.0f32, |least, (cosine, _)| least.min(*cosine));
        let beside = |turn: f32| (widest.clamp(-1.0, 1.0).acos() + turn.to_radians()).cos();
        Eyeball {
            radius,
            bulge: bulge.min(MAX_BULGE * radius),
            edge: (beside(TURN_DEG.0), beside(TURN_DEG.1)),
        }
    }

    /// Distance from the centre to the surface below a point `p`, which is `length` away from the
    /// centre.
    #[inline]
    pub(crate) fn radius_below(&self, p: [f32; 3], length: f32) -> f32 {
        let (full, gone) = self.edge;
        let share = (p[2] / length.max(1e-6) - gone) / (full - gone).max(1e-6);
        self.radius + self.bulge * ease(share)
    }
}

/// Centre and radius of the least-squares sphere through the outermost of `points`. `None` if it
/// cannot be an eyeball behind an eye of this `width`.
pub(crate) fn fit_eyeball(points: &[[f32; 3]], width: f32) -> Option<([f32; 3], f32)> {
    let points = points.iter().copied();
    let (centre, radius, _) = sphere::fit_sphere(points.clone())?;
    let outer = points.filter(|p| Vec3::from(*p).distance(centre.into()) > INSIDE * radius);
    let (centre, radius, _) = sphere::fit_sphere(outer)?;
    let usual = radius_of(width);
    let range = RADIUS_RANGE.0 * usual..RADIUS_RANGE.1 * usual;
    range.contains(&radius).then_some((centre, radius))
}

/// Centre and radius of a sphere along `points` of the front of a shallow eye, such as a disc. The
/// sphere around a flat or hollow front touches its foremost points. `None` where the points are
/// narrower than an eye, as those of an iris are.
pub(crate) fn fit_shallow(points: &[[f32; 3]], width: f32) -> Option<([f32; 3], f32)> {
    let usual = radius_of(width);
    let front = points.iter().map(|p| p[2]).reduce(f32::max)?;
    let across = points.iter().map(|p| p[0]);
    let extent = across.clone().fold(f32::MIN, f32::max) - across.fold(f32::MAX, f32::min);
    if extent < LEAST_ACROSS * width {
        return None;
    }
    let range = RADIUS_RANGE.0 * usual..FLATTEST * usual;
    let fit = sphere::fit_sphere(points.iter().copied());
    let fit = fit.map(|(centre, radius, _)| (centre, radius));
    fit.filter(|(centre, radius)| range.contains(radius) && centre[2] < front)
        .or_else(|| {
            let middle = |i: usize| points.iter().map(|p| p[i]).sum::<f32>() / points.len() as f32;
            let radius = FLATTEST * usual;
            Some(([middle(0), middle(1), front - radius], radius))
        })
}

/// The usual radius of the ball behind an eye of this width.
pub(crate) fn radius_of(width: f32) -> f32 {
    RADIUS_OF_WIDTH * width
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of the front half of a sphere, with a cornea of another curvature in front and an
    /// iris inside.
    fn eye(centre: [f32; 3]) -> Vec<[f32; 3]> {
        let turns = (0..40).flat_map(|i| (0..20).map(move |j| (i as f32 * 0.157, j as f32 * 0.1)));
        turns
            .flat_map(|(about, away)| {
                let way = [
                    away.sin() * about.cos(),
                    away.sin() * about.sin(),
                    away.cos(),
                ];
                let out = 1.2 + 0.1 * (1.0 - away / 0.5).max(0.0);
                let at = |r: f32| std::array::from_fn(|i| centre[i] + r * way[i]);
                [Some(at(out)), (away < 0.4).then(|| at(0.8))]
            })
            .flatten()
            .collect()
    }

    #[test]
    fn the_sphere_is_found_beside_iris_and_cornea() {
        let (centre, radius) = fit_eyeball(&eye([3.0, 4.0, 7.0]), 2.8).unwrap();
        assert!((radius - 1.2).abs() < 0.05, "{radius}");
        let off = (0..3).map(|i| (centre[i] - [3.0, 4.0, 7.0][i]).abs());
        assert!(off.fold(0.0, f32::max) < 0.06, "{centre:?}");
    }

    #[test]
    fn a_shallow_front_is_a_piece_of_a_large_sphere() {
        let grid = (-9..10).flat_map(|i| (-9..10).map(move |j| [i, j].map(|k| 0.2 * k as f32)));
        let grid: Vec<[f32; 2]> = grid.filter(|[x, y]| x.hypot(*y) < 1.8).collect();
        let front = |bend: f32| -> Vec<[f32; 3]> {
            let at = grid
                .iter()
                .map(|[x, y]| [*x, *y, 5.0 - bend * (x * x + y * y)]);
            at.collect()
        };
        let (centre, radius) = fit_shallow(&front(0.1), 4.0).unwrap();
        assert!((radius - 5.0).abs() < 0.3 && (centre[2] + radius - 5.0).abs() < 0.02);
        for hollow in [0.0, -0.1] {
            let (centre, radius) = fit_shallow(&front(hollow), 4.0).unwrap();
            let foremost = front(hollow).iter().map(|p| p[2]).fold(0.0, f32::max);
            assert!(radius > 10.0 && (centre[2] + radius - foremost).abs() < 1e-4);
        }
        assert_eq!(fit_shallow(&[], 4.0), None);
    }

    #[test]
    fn what_can_be_no_eyeball_is_refused() {
        assert_eq!(fit_eyeball(&eye([0.0; 3]), 20.0), None);
        let flat: Vec<[f32; 3]> = (0..50).map(|k| [k as f32, (k * k) as f32, 0.0]).collect();
        assert_eq!(fit_eyeball(&flat, 2.8), None);
    }

    #[test]
    fn every_point_of_the_eye_lies_within_the_bulged_ball() {
        let points = eye([0.0; 3]);
        let ball = Eyeball::new(1.2, &points);
        for p in points {
            let length = Vec3::from(p).length();
            assert!(length < ball.radius_below(p, length) + 1e-4, "{p:?}");
        }
        assert_eq!(ball.radius_below([1.2, 0.0, 0.0], 1.2), 1.2);
    }
}
