//! Combines the landmarks of several views into points in space.

use rayon::prelude::*;

use super::{
    depth_view::Window,
    network::LandmarkNetwork,
    view::{Frame, HALF_SIZE_M, Look, front, look, middle, turned},
};
use crate::mesh::{Similarity, canonical::stability, canonical_landmarks, ibug::LANDMARKS};

/// Angles of the views about the head's own vertical axis, as in training.
const VIEWS_DEGREES: [f32; 3] = [-40.0, 0.0, 40.0];

/// Half-size of a view's window for a quick look, metres.
pub(super) const GLANCE: [f32; 1] = [HALF_SIZE_M];
/// Half-sizes of the windows for the last look, metres. It uses two, because a heat map's pixel is
/// 3 mm wide and a character's mouth may be small.
pub(super) const LAST_LOOK: [f32; 2] = [0.93 * HALF_SIZE_M, 1.07 * HALF_SIZE_M];

/// A landmark this far from its place in the mean face counts half, metres. Where its rays miss
/// each other by this much, its confidence falls to 1/e.
const ROBUST_M: f32 = 0.006;

/// A fit is refused if its landmarks are further than this from the mean ones, weighted root
/// mean square, metres.
const WORST_LIFTED_RMS_M: f64 = 0.03;

/// Where the rays of the views meet.
#[derive(Clone)]
pub(super) struct Agreed {
    /// `[68]`, in the frame of the views (canonical metres, as far as the pose is known).
    pub positions: [[f32; 3]; LANDMARKS],
    /// `[68]`, 0 to 1: the mean confidence of the views, reduced where their rays miss each other.
    pub confidence: [f32; LANDMARKS],
    /// Probability of a face, 0 to 1, averaged over the views.
    pub presence: f32,
}

/// Improves the similarity to the canonical frame with one close front view.
///
/// Puts all landmarks except the jaw on the visible surface and fits them to the mean ones. The
/// weights are robust, because eyes without eyeballs give depths far behind the face. `None` where
/// the view's probability of a face is below `least_presence`, where fewer than 30 landmarks lie on
/// the surface, or where they do not fit.
pub(super) fn lift(
    network: &LandmarkNetwork,
    frame: &Frame,
    to_canonical: &Similarity,
    least_presence: f32,
) -> Option<Similarity> {
    let view = front(network, frame, to_canonical);
    if view.sight.presence < least_presence {
        return None;
    }
    let lifted: Vec<(usize, [f32; 3])> = (17..LANDMARKS)
        .filter_map(|i| {
            let z = view.buffer.depth_at(view.sight.places[i])?;
            Some((i, [view.points[i][0], view.points[i][1], z]))
        })
        .collect();
    if lifted.len() < 30 {
        return None;
    }
    let weights: Vec<f64> = lifted
        .iter()
        .map(|(i, _)| stability(*i) * f64::from(view.sight.confidence[*i].max(0.02)))
        .collect();
    Some(robust_fit(&lifted, &weights)?.compose(to_canonical))
}

/// Takes three views in the head's own frame through each window and finds where their rays meet.
pub(super) fn agree(
    network: &LandmarkNetwork,
    frame: &Frame,
    to_canonical: &Similarity,
    half_sizes: &[f32],
) -> Agreed {
    let points = turned(frame, to_canonical);
    let middle = middle();
    let views: Vec<(f32, f32)> = half_sizes
        .iter()
        .flat_map(|half_size| VIEWS_DEGREES.map(|degrees| (degrees.to_radians(), *half_size)))
        .collect();
    let looks: Vec<(f32, Look)> = views
        .into_par_iter()
        .map(|(angle, half_size)| {
            let turned: Vec<_> = points.iter().map(|p| turn_about_y(*p, angle)).collect();
            let [x, y, _] = turn_about_y(middle, angle);
            let window = Window {
                centre: [x, y],
                half_size,
            };
            (angle, look(network, frame, &turned, window))
        })
        .collect();
    meet(&looks)
}

impl Agreed {
    /// Multiplies the confidence of all landmarks by the probability of a face. On a cup, the views
    /// take any edge for a lip.
    pub fn trust_by_presence(&mut self) {
        let presence = self.presence;
        self.confidence
            .iter_mut()
            .for_each(|sure| *sure *= presence);
    }

    /// Sets the landmarks that the caller fixed. `fixed` is in the frame of the views.
    pub fn pin(&mut self, fixed: &[(usize, [f32; 3])]) {
        for (i, position) in fixed {
            self.positions[*i] = *position;
            self.confidence[*i] = 1.0;
        }
    }

    /// Fits the similarity to the canonical frame again, from the landmarks. `to_frame`: the
    /// similarity to the frame of the views, in which the landmarks are.
    pub fn fit(&self, to_frame: &Similarity) -> Option<Similarity> {
        let points: Vec<(usize, [f32; 3])> = self.positions.iter().copied().enumerate().collect();
        let weights: Vec<f64> = (0..LANDMARKS)
            .map(|i| stability(i) * f64::from(self.confidence[i].max(0.02)))
            .collect();
        Some(robust_fit(&points, &weights)?.compose(to_frame))
    }
}

fn turn_about_y([x, y, z]: [f32; 3], angle: f32) -> [f32; 3] {
    let (s, c) = angle.sin_cos();
    [c * x + s * z, y, c * z - s * x]
}

/// Finds each landmark by least squares over the views, weighted by confidence²:
/// view x = cos·x + sin·z, view y = y.
fn meet(looks: &[(f32, Look)]) -> Agreed {
    let mut positions = [[0.0; 3]; LANDMARKS];
    let mut confidence = [0.0; LANDMARKS];
    for i in 0..LANDMARKS {
        let rays: Vec<[f32; 5]> = looks
            .iter()
            .map(|(angle, look)| {
                let [u, v] = look.points[i];
                let (s, c) = angle.sin_cos();
                [c, s, u, v, look.sight.confidence[i].powi(2) + 1e-3]
            })
            .collect();
        let (point, miss) = meeting_point(&rays);
        let mean = looks
            .iter()
            .map(|(_, l)| l.sight.confidence[i])
            .sum::<f32>();
        positions[i] = point;
        confidence[i] = mean / looks.len() as f32 * (-(miss / ROBUST_M).powi(2)).exp();
    }
    let present: f32 = looks.iter().map(|(_, look)| look.sight.presence).sum();
    Agreed {
        positions,
        confidence,
        presence: present / looks.len() as f32,
    }
}

/// The point nearest to all rays, and the weighted root mean square of its distances from them.
/// `rays`: cos, sin, view x, view y, weight.
fn meeting_point(rays: &[[f32; 5]]) -> ([f32; 3], f32) {
    let sum = |f: &dyn Fn(&[f32; 5]) -> f32| rays.iter().map(|r| r[4] * f(r)).sum::<f32>();
    let total = sum(&|_| 1.0);
    let (cc, cs, ss) = (
        sum(&|r| r[0] * r[0]),
        sum(&|r| r[0] * r[1]),
        sum(&|r| r[1] * r[1]),
    );
    let (cu, su) = (sum(&|r| r[0] * r[2]), sum(&|r| r[1] * r[2]));
    let det = (cc * ss - cs * cs).max(1e-9);
    let x = (ss * cu - cs * su) / det;
    let z = (cc * su - cs * cu) / det;
    let y = sum(&|r| r[3]) / total;
    let miss = sum(&|r| (r[0] * x + r[1] * z - r[2]).powi(2) + (r[3] - y).powi(2)) / total;
    ([x, y, z], miss.sqrt())
}

/// Fits numbered points to the mean landmarks. In three rounds, points that do not fit lose weight.
/// `None` where the fit stays poor.
fn robust_fit(points: &[(usize, [f32; 3])], weights: &[f64]) -> Option<Similarity> {
    let mean = canonical_landmarks();
    let from: Vec<[f32; 3]> = points.iter().map(|(_, p)| *p).collect();
    let to: Vec<[f32; 3]> = points.iter().map(|(i, _)| mean[*i]).collect();
    let mut robust = weights.to_vec();
    let mut fit = Similarity::fit(&from, &to, Some(&robust)).ok()?;
    for _ in 0..3 {
        for (k, weight) in robust.iter_mut().enumerate() {
            let p = fit.similarity.apply(from[k]);
            let miss2: f32 = (0..3).map(|i| (p[i] - to[k][i]).powi(2)).sum();
            *weight = weights[k] / f64::from(1.0 + miss2 / (ROBUST_M * ROBUST_M));
        }
        fit = Similarity::fit(&from, &to, Some(&robust)).ok()?;
    }
    (fit.rms < WORST_LIFTED_RMS_M).then_some(fit.similarity)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_three_views_meet_in_the_point_they_show() {
        let point = [0.03, -0.02, 0.07];
        let mut rays: Vec<[f32; 5]> = VIEWS_DEGREES
            .iter()
            .map(|degrees| {
                let angle = degrees.to_radians();
                let [u, v, _] = turn_about_y(point, angle);
                [angle.cos(), angle.sin(), u, v, 0.5]
            })
            .collect();
        let (met, miss) = meeting_point(&rays);
        assert!((0..3).all(|i| (met[i] - point[i]).abs() < 1e-6) && miss < 1e-6);
        rays[0][2] += 0.03;
        rays[0][4] = 1e-4;
        let (met, _) = meeting_point(&rays);
        assert!((0..3).all(|i| (met[i] - point[i]).abs() < 1e-3), "{met:?}");
    }

    #[test]
    fn a_few_wild_points_do_not_turn_the_head() {
        let mut points: Vec<_> = canonical_landmarks().iter().copied().enumerate().collect();
        for i in 36..40 {
            points[i].1[2] -= 0.08;
        }
        let fit = robust_fit(&points, &[1.0; LANDMARKS]).unwrap();
        for (i, p) in points.iter().filter(|(i, _)| !(36..40).contains(i)) {
            let q = fit.apply(*p);
            let mean = canonical_landmarks()[*i];
            assert!((0..3).all(|k| (q[k] - mean[k]).abs() < 0.003), "{i}");
        }
    }
}
