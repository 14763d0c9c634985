//! Fits a head to a scan: finds coefficients for which the scan's points lie on the surface, eq. 17
//! without time.
//!
//! [`Head::fit_scan`] describes the method; `identity::slopes` computes the slopes. Twin of
//! `training/systems/facetalk/fit_codes.py`, which uses finite differences and neither poses nor aligns.

use faer::{Mat, Side, linalg::solvers::Solve};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};
use rayon::prelude::*;
use serde::Serialize;

use super::{COEFFICIENTS, Head, OneHead, identity::slopes::IdentitySlopes};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::{Landmarks, Similarity, align_to_canonical, ibug::LANDMARKS},
    nn::matrix,
};

/// Usual distance of points and landmarks from a head of the model (standard deviation).
const DISTANCE_M: f32 = 4e-4;
const LANDMARK_M: f32 = 3e-3;
/// Neighbouring points are not independent, so only this share of their number counts.
const POINT_SHARE: f32 = 0.05;
/// Points farther off than this count less and less (Cauchy).
const ROBUST_M: f32 = 3e-3;
const DAMPING: f64 = 0.1;
/// Points whose slopes are computed at a time.
const TOGETHER: usize = 100;
/// Points further than this from every landmark are not the face: hair, neck and shoulders.
const FACE_M: f32 = 0.035;
const LEAST_POINTS: usize = 300;
/// Above this mean distance a scan is refused.
const MAX_MM: f32 = 3.0;
/// Coefficients more than this many times further from the mean than usual do not describe a head.
const MAX_SPREAD: f32 = 2.0;
/// Usual size of the turns, moves and growth that are left after the landmarks are aligned (standard
/// deviation): radians, metres, share.
const PLACE: [f32; 7] = [0.05, 0.05, 0.05, 0.02, 0.02, 0.02, 0.03];
const UNKNOWN: usize = COEFFICIENTS + PLACE.len();

/// How a scan is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanOptions {
    /// Steps of Gauss-Newton.
    pub steps: usize,
    /// Number of points in a step. Each step draws new ones.
    pub points: usize,
    /// Seed that decides which points are drawn.
    pub seed: u64,
}

impl Default for ScanOptions {
    fn default() -> Self {
        ScanOptions {
            steps: 8,
            points: 1200,
            seed: 0,
        }
    }
}

/// Root mean square. For coefficients it says how far a head is from the mean one; random heads have
/// about 1.
fn rms(values: &[f32]) -> f32 {
    (values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32).sqrt()
}

/// A head fitted to a scan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScanFit {
    /// `[100]`.
    #[serde(skip)]
    pub coefficients: Vec<f32>,
    /// Mean distance of the scan's face from the head.
    pub mean_mm: f32,
    /// Nine of ten points lie nearer than this.
    pub most_mm: f32,
    /// Number of points of the scan that belong to the face.
    pub points: usize,
    /// Metres per unit of the scan on a head of human size.
    pub metres_per_unit: f64,
    /// From the scan's frame to the head's, metres.
    #[serde(skip)]
    pub to_head: Similarity,
    /// What the user should know.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

impl ScanFit {
    /// Checks a fit. `distances`: from the head's surface to the points of the scan's face, metres.
    ///
    /// # Errors
    /// `InvalidInput` where the distances are too large or the coefficients do not describe a head.
    fn checked(
        coefficients: Vec<f32>,
        mut distances: Vec<f32>,
        to_head: Similarity,
    ) -> Result<ScanFit> {
        distances.iter_mut().for_each(|s| *s = 1e3 * s.abs());
        distances.sort_by(f32::total_cmp);
        let mean_mm = distances.iter().sum::<f32>() / distances.len() as f32;
        let most_mm = distances[distances.len() * 9 / 10];
        if mean_mm > MAX_MM {
            return Err(wrong(format!(
                "expected a face within {MAX_MM} mm of a head that was learned, got {mean_mm:.1} mm on average and \
                 {most_mm:.1} mm at one point of ten"
            )));
        }
        let spread = rms(&coefficients);
        if spread > MAX_SPREAD {
            return Err(wrong(format!(
                "expected a face, got a shape that only a head {spread:.1} times as far from the mean as usual comes \
                 near to, to {mean_mm:.1} mm (at most {MAX_SPREAD} times)"
            )));
        }
        Ok(ScanFit {
            coefficients,
            mean_mm,
            most_mm,
            points: distances.len(),
            metres_per_unit: to_head.scale,
            warnings: unit_note(to_head.scale).into_iter().collect(),
            to_head,
        })
    }
}

fn wrong(complaint: String) -> Error {
    Error::InvalidInput(format!("scan: {complaint}"))
}

impl Head {
    /// Fits a head to a scan of a face at rest. `points`: `[P]` in the scan's units and axes.
    ///
    /// The unknowns are 100 coefficients, which have the prior N(0, 1), and a similarity of seven numbers
    /// from the scan to the head. Gauss-Newton finds both together, so that the scan lies on the head's
    /// surface.
    ///
    /// 1. The landmarks give the first similarity. Points within 3.5 cm of a landmark are the face; hair,
    ///    neck and shoulders are left out.
    /// 2. The first step uses the landmarks alone: the residuals are the head's own landmarks at rest minus
    ///    those of the scan. This brings the head near enough for distances to mean something.
    /// 3. Each of the next `options.steps` steps draws `options.points` new points of the face. The backward
    ///    field brings them to the canonical pose. Their signed distance there should become 0, and the chain
    ///    rule gives its slopes.
    /// 4. Every residual adds a row to the normal equations of the 107 unknowns, which Cholesky solves.
    ///    Points have Cauchy weights, so that far ones count less and less. The landmarks stay in every step
    ///    as a guide.
    /// 5. In the end the distances of all points of the face decide whether the fit is good.
    ///
    /// A step costs one evaluation of the field with its slopes for each drawn point, in blocks on all cores,
    /// and 107² products for each residual. The last check costs one distance for each point of the face.
    ///
    /// Not obvious: the slopes neglect how the forward and backward fields change with the coefficients, and
    /// how the backward field turns and stretches. The residuals are exact, so this costs extra steps but no
    /// accuracy where the steps converge. Neighbouring points are not independent. So each counts only a
    /// twentieth; otherwise the prior would have no effect. The prior of the similarity acts on each step and
    /// not on their sum.
    ///
    /// The same seed gives the same points and the same fit.
    ///
    /// # Errors
    /// `InvalidInput` for points that are not finite, for fewer than 300 points on the face, and where
    /// the fit stays above 3 mm or the result is not a head (these name the distance). `FaceNotFound`
    /// for landmarks that do not form a face. `Cancelled`.
    pub fn fit_scan(
        &self,
        points: &[[f32; 3]],
        landmarks: &Landmarks,
        options: &ScanOptions,
        progress: ProgressFn<'_>,
    ) -> Result<ScanFit> {
        if let Some(bad) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            let point = points[bad];
            return Err(wrong(format!(
                "expected finite points, got {point:?} at {bad}"
            )));
        }
        let mut to_head = align_to_canonical(landmarks)?;
        let face = face_points(points, landmarks, &to_head)?;
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        let mut coefficients = vec![0.0; COEFFICIENTS];
        let slopes = IdentitySlopes::new(&self.identity);
        for step in 0..=options.steps {
            report(progress, "fit", step as f32 / (options.steps + 1) as f32)?;
            // The first step uses the landmarks alone.
            let count = if step == 0 {
                0
            } else {
                options.points.min(face.len())
            };
            let some: Vec<[f32; 3]> = (0..count)
                .map(|_| face[(random.next_u64() % face.len() as u64) as usize])
                .collect();
            self.step(&slopes, &mut coefficients, &mut to_head, &some, landmarks)?;
        }
        report(progress, "fit", 1.0)?;
        let places: Vec<[f32; 3]> = face.iter().map(|p| to_head.apply(*p)).collect();
        let off = self.rest_distances(&coefficients, &places)?;
        ScanFit::checked(coefficients, off, to_head)
    }

    /// Signed distance in metres at points `[Q]` of the face at rest.
    fn rest_distances(&self, coefficients: &[f32], points: &[[f32; 3]]) -> Result<Vec<f32>> {
        let one = self.one(self.identity_code(coefficients)?)?;
        let posed = one.posed(&self.rest_code())?;
        Ok(posed.distance(points))
    }

    /// One step of Gauss-Newton, in place.
    fn step(
        &self,
        slopes: &IdentitySlopes,
        coefficients: &mut [f32],
        to_head: &mut Similarity,
        points: &[[f32; 3]],
        landmarks: &Landmarks,
    ) -> Result<()> {
        let rest = self.rest_code();
        let one = self.one(self.identity_code(coefficients)?)?;
        let mut system = System::new(coefficients);
        let marks = landmarks.positions.map(|p| to_head.apply(p));
        let places = one.posed(&rest)?.forward(&one.landmarks());
        let moved = self.landmark_slopes();
        for n in 0..LANDMARKS {
            let sure = landmarks.confidence[n].max(0.05) / LANDMARK_M;
            let turned = motion_of(marks[n]);
            for axis in 0..3 {
                let of_code = moved.chunks_exact(3 * LANDMARKS).map(|m| m[3 * n + axis]);
                let of_place = turned.iter().map(|t| -t[axis]);
                let row: Vec<f32> = of_code.chain(of_place).map(|x| x * sure).collect();
                system.add(&row, (places[n][axis] - marks[n][axis]) * sure);
            }
        }
        if !points.is_empty() {
            let places: Vec<[f32; 3]> = points.iter().map(|p| to_head.apply(*p)).collect();
            let canonical = one.posed(&rest)?.backward(&places);
            let blocks: Vec<PointSlopes> = canonical
                .par_chunks(TOGETHER)
                .map(|points| one.point_slopes(slopes, points))
                .collect();
            let rows = blocks.iter().flat_map(PointSlopes::rows);
            for (place, (distance, slope, of_code)) in places.iter().zip(rows) {
                let share = POINT_SHARE / (1.0 + (distance / ROBUST_M).powi(2));
                let sure = share.sqrt() / DISTANCE_M;
                let of_place = motion_of(*place).map(|t| (0..3).map(|a| slope[a] * t[a]).sum());
                let row = of_code.iter().copied().chain(of_place);
                let row: Vec<f32> = row.map(|x: f32| x * sure).collect();
                system.add(&row, distance * sure);
            }
        }
        let way = system.solved()?;
        coefficients.iter_mut().zip(&way).for_each(|(c, x)| *c += x);
        *to_head = moved_by(&way[COEFFICIENTS..]).compose(to_head);
        Ok(())
    }

    /// How far each coefficient moves the landmarks in the canonical pose, metres, `[100, 68 · 3]`.
    fn landmark_slopes(&self) -> Vec<f32> {
        let global_weight = self.identity_code.weight();
        let global_weight = global_weight.subcols(0, self.config.global_code);
        let mut out = vec![0.0; COEFFICIENTS * 3 * LANDMARKS];
        let to = matrix::view_mut(&mut out, 3 * LANDMARKS);
        matrix::product(to, global_weight, self.identity.landmarks());
        out.iter_mut().for_each(|x| *x *= self.config.scale_m);
        out
    }
}

/// Distances of points, metres, and their slopes.
pub(super) struct PointSlopes {
    /// `[Q]`.
    pub(super) distance: Vec<f32>,
    /// Slopes with the point, `[Q]`.
    pub(super) place: Vec<[f32; 3]>,
    /// Slopes with the coefficients, `[Q, 100]`.
    pub(super) coefficients: Vec<f32>,
}

impl PointSlopes {
    /// Distance, slopes with the point and slopes with the coefficients, point by point.
    fn rows(&self) -> impl Iterator<Item = (f32, [f32; 3], &[f32])> {
        let places = self
            .distance
            .iter()
            .copied()
            .zip(self.place.iter().copied());
        let both = places.zip(self.coefficients.chunks_exact(COEFFICIENTS));
        both.map(|((distance, place), code)| (distance, place, code))
    }
}

impl OneHead<'_> {
    /// Distances and slopes at canonical points `[Q]`, computed on the calling thread.
    pub(super) fn point_slopes(&self, slopes: &IdentitySlopes, points: &[[f32; 3]]) -> PointSlopes {
        let field = slopes.at(&self.field, &self.inside(points));
        let of_code = matrix::rows_of(&field.code, self.head.config.identity_code());
        let mut coefficients = vec![0.0; points.len() * COEFFICIENTS];
        let to = matrix::view_mut(&mut coefficients, COEFFICIENTS);
        let code = self.head.identity_code.weight().transpose();
        matrix::scaled_product(to, self.metres(), of_code, code);
        PointSlopes {
            distance: field.distance.iter().map(|s| s * self.metres()).collect(),
            place: field.place,
            coefficients,
        }
    }
}

/// Points of the scan that lie near its landmarks, in its own units.
///
/// # Errors
/// `InvalidInput` for too few points.
fn face_points(
    points: &[[f32; 3]],
    landmarks: &Landmarks,
    to_head: &Similarity,
) -> Result<Vec<[f32; 3]>> {
    let reach = (f64::from(FACE_M) / to_head.scale) as f32;
    let near = |p: &&[f32; 3]| {
        landmarks.positions.iter().any(|mark| {
            (0..3)
                .map(|axis| (p[axis] - mark[axis]).powi(2))
                .sum::<f32>()
                < reach * reach
        })
    };
    let face: Vec<[f32; 3]> = points.iter().filter(near).copied().collect();
    if face.len() < LEAST_POINTS {
        Err(wrong(format!(
            "expected at least {LEAST_POINTS} points on the face, got {} of {}",
            face.len(),
            points.len()
        )))
    } else {
        Ok(face)
    }
}

/// How a point moves under small turns about the axes, moves along them and growth.
fn motion_of([x, y, z]: [f32; 3]) -> [[f32; 3]; 7] {
    [
        [0.0, -z, y],
        [z, 0.0, -x],
        [-y, x, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [x, y, z],
    ]
}

/// The similarity of a small step. Its rotation is orthonormal.
fn moved_by(way: &[f32]) -> Similarity {
    let [x, y, z] = [0, 1, 2].map(|n| f64::from(way[n]));
    let angle = (x * x + y * y + z * z).sqrt().max(1e-12);
    let (sin, cos) = angle.sin_cos();
    let axis = [x, y, z].map(|v| v / angle);
    let cross = [
        [0.0, -axis[2], axis[1]],
        [axis[2], 0.0, -axis[0]],
        [-axis[1], axis[0], 0.0],
    ];
    let rotation = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let same = if i == j { cos } else { 0.0 };
            same + sin * cross[i][j] + (1.0 - cos) * axis[i] * axis[j]
        })
    });
    Similarity {
        scale: f64::from(way[6]).exp(),
        rotation,
        translation: [3, 4, 5].map(|n| f64::from(way[n])),
    }
}

/// Normal equations that include the prior.
struct System {
    gram: Vec<f64>,
    right: Vec<f64>,
}

impl System {
    fn new(coefficients: &[f32]) -> Self {
        let mut gram = vec![0.0; UNKNOWN * UNKNOWN];
        let mut right = vec![0.0; UNKNOWN];
        for (n, c) in coefficients.iter().enumerate() {
            gram[n * (UNKNOWN + 1)] = 1.0 + DAMPING;
            right[n] = -f64::from(*c);
        }
        for (n, size) in PLACE.iter().enumerate() {
            gram[(COEFFICIENTS + n) * (UNKNOWN + 1)] = f64::from(*size).powi(-2);
        }
        System { gram, right }
    }

    /// Adds a residual and its slopes `[107]`.
    fn add(&mut self, row: &[f32], residual: f32) {
        for (i, x) in row.iter().enumerate() {
            let x = f64::from(*x);
            self.right[i] -= x * f64::from(residual);
            let to = &mut self.gram[i * UNKNOWN..][..i + 1];
            to.iter_mut()
                .zip(row)
                .for_each(|(to, y)| *to += x * f64::from(*y));
        }
    }

    fn solved(&self) -> Result<Vec<f32>> {
        let gram = Mat::from_fn(UNKNOWN, UNKNOWN, |i, j| {
            self.gram[i.max(j) * UNKNOWN + i.min(j)]
        });
        let right = Mat::from_fn(UNKNOWN, 1, |i, _| self.right[i]);
        let factor = gram.llt(Side::Lower).map_err(|_| {
            Error::Numerics("scan: the fit has no unique step; are its points finite?".into())
        })?;
        let way = factor.solve(&right);
        Ok((0..UNKNOWN).map(|i| way[(i, 0)] as f32).collect())
    }
}

/// The warning about a scan that is not in metres.
fn unit_note(scale: f64) -> Option<String> {
    let unit = match scale {
        0.0005..0.002 => "millimetres",
        0.005..0.02 => "centimetres",
        0.5..2.0 => return None,
        _ => {
            return Some(format!(
                "the scan's unit is {scale:.4} m on a head of human size; the fitted head is in metres"
            ));
        }
    };
    Some(format!(
        "the scan is in {unit}; the fitted head is in metres"
    ))
}
