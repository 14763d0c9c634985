//! Searches a mesh from all sides for the place and the pose of a face.

use std::sync::{
    Arc,
    atomic::{AtomicU64, AtomicUsize, Ordering},
};

use glam::DVec3;
use rayon::prelude::*;

use super::{
    consensus::lift,
    depth_view::{DepthBuffer, Window},
    network::LandmarkNetwork,
    pose_network::{PoseNetwork, Sighting},
    symmetry::{Plane, symmetry},
    view::{Frame, HALF_SIZE_M, MAX_PLACES, middle, on_face, turned},
};
use crate::{
    Error, Result,
    job::{Progress, ProgressFn, report},
    mesh::{Similarity, direction::unit},
    nn::conv2d::Picture,
};

/// A closer look at a face uses a window this many times the face's size.
const CLOSER: f32 = 1.35;
const CLOSER_LOOKS: usize = 3;

/// Faces taken from one picture.
const FACES_IN_A_PICTURE: usize = 2;

/// Number of candidates that get closer looks.
const LOOKED_AT: usize = 9;
/// Number of candidates that are passed on.
const KEPT: usize = 3;

/// Number of poses that are evaluated at once, the most promising first.
const PROMISED_AT_ONCE: usize = 32;

/// Number of views along the plane of symmetry, all around the mesh.
const VIEWS_IN_PLANE: usize = 12;

/// Sizes of the smaller windows on the plane of symmetry, as shares of the window on the whole
/// mesh. Only the landmark network looks through them. It knows faces that the pose network does
/// not.
const WINDOWS_ON_PLANE: [f32; 4] = [0.6, 0.42, 0.3, 0.21];

/// Added to the likeness of a face that looks in the stated direction, so that it wins where two
/// faces look alike.
const STATED_BONUS: f32 = 0.1;

/// An upright face at the stated front with a likeness above this makes other sides unnecessary.
const SURE: f32 = 0.75;
/// A face with at least this likeness makes the smaller windows unnecessary.
const LIKELY: f32 = 0.5;

/// The search of a mesh without a face takes about this many looks. Progress is a share of them.
const MAX_LOOKS: f32 = 1300.0;
const STAGE: &str = "landmarks";

/// Counts the looks at a mesh and asks the caller before each look whether to continue.
pub(super) struct Looks<'a> {
    progress: ProgressFn<'a>,
    count: AtomicUsize,
    /// Shared with [`Frame`]: the pixels that its pictures have tested.
    places: Arc<AtomicU64>,
}

impl<'a> Looks<'a> {
    pub fn new(progress: ProgressFn<'a>, frame: &Frame<'_>) -> Self {
        Looks {
            progress,
            places: Arc::clone(&frame.places),
            count: AtomicUsize::new(0),
        }
    }

    /// Counts another look. Returns whether the search continues.
    pub fn take(&self) -> bool {
        self.count.fetch_add(1, Ordering::Relaxed);
        let goes_on = (self.progress)(Progress {
            stage: STAGE,
            fraction: self.fraction(),
        });
        goes_on && !self.are_too_many()
    }

    fn are_too_many(&self) -> bool {
        self.places.load(Ordering::Relaxed) >= MAX_PLACES
    }

    /// # Errors
    /// `Cancelled` once the caller stops the search; `FaceNotFound` once the looks have cost too
    /// much.
    pub fn check(&self) -> Result<()> {
        if self.are_too_many() {
            return Err(Error::FaceNotFound(format!(
                "the mesh has so many large triangles over each other that pictures of it take too long (expected \
                 {MAX_PLACES} pixels of triangles at most, got more). Remove the triangles that lie over each other, \
                 or give all 68 landmarks"
            )));
        }
        report(self.progress, STAGE, self.fraction())
    }

    fn fraction(&self) -> f32 {
        (self.count.load(Ordering::Relaxed) as f32 / MAX_LOOKS).min(0.99)
    }
}

/// Where a face may be.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    /// From the frame to canonical metres.
    pub to_canonical: Similarity,
    /// 0 to 1. During the search, it is the pose network's probability. At the end, it is the
    /// landmark network's probability times its confidence.
    pub likeness: f32,
}

impl Candidate {
    /// How well the face is turned to the stated front with its top upwards, −1 to 1.
    fn uprightness(&self) -> f32 {
        let r = &self.to_canonical.rotation;
        r[1][1].min(r[2][2]) as f32
    }

    fn rank(&self) -> f32 {
        self.likeness + STATED_BONUS * self.uprightness().max(0.0)
    }
}

/// Both networks and what they look at. Once the caller stops the search, they see nothing.
#[derive(Clone, Copy)]
pub(super) struct Search<'a> {
    pub pose: &'a PoseNetwork,
    pub views: &'a LandmarkNetwork,
    pub frame: &'a Frame<'a>,
    pub looks: &'a Looks<'a>,
}

impl Search<'_> {
    /// Searches the stated front first. If there is no certain face, it searches all sides. If the
    /// mesh mirrors itself in a plane, it then searches for faces with this plane in their middle.
    /// If no face is likely even then, it looks through smaller windows on the plane. The result
    /// starts with the best candidate.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn run(&self) -> Result<Vec<Candidate>> {
        let all = directions();
        let stated = self.closest_looks(self.glances(&all[..1], None), None);
        self.looks.check()?;
        let sure = |c: &Candidate| c.likeness > SURE && c.uprightness() > 0.85;
        if stated.first().is_some_and(sure) {
            return Ok(stated);
        }
        let mut candidates = self.closest_looks(self.glances(&all, None), None);
        self.looks.check()?;
        if let Some(plane) = symmetry(self.frame) {
            let around = around(&plane);
            let glances = self.glances(&around, Some(&plane));
            candidates.extend(self.closest_looks(glances, Some(&plane)));
            if candidates.iter().all(|c| c.likeness < LIKELY) {
                candidates.extend(self.scan(&around, &plane));
            }
            self.looks.check()?;
        }
        Ok(distinct(candidates))
    }

    /// The faces that the pose network sees from the given sides.
    fn glances(&self, sides: &[Similarity], plane: Option<&Plane>) -> Vec<Candidate> {
        let by_side: Vec<Vec<Candidate>> = sides
            .par_iter()
            .map(|turn| {
                if !self.looks.take() {
                    return Vec::new();
                }
                let points = turned(self.frame, turn);
                let window = whole(self.frame.bounds_of(&points));
                self.glance(&points, turn, window, plane)
            })
            .collect();
        by_side.into_iter().flatten().collect()
    }

    /// Runs the landmark network in windows on the plane of symmetry, both ways up.
    fn scan(&self, around: &[Similarity], plane: &Plane) -> Vec<Candidate> {
        let poses: Vec<Similarity> = around
            .iter()
            .flat_map(|turn| {
                let points = turned(self.frame, turn);
                let poses = poses_on(self.frame.bounds_of(&points), plane);
                poses.into_iter().map(|pose| pose.compose(turn))
            })
            .collect();
        let closer = |c: &Candidate| {
            let lifted = lift(self.views, self.frame, &c.to_canonical, 0.0)?;
            let again = self.likely(&plane.align(&lifted, middle())?);
            (again.likeness > c.likeness).then_some(again)
        };
        self.likeliest(poses)
            .into_par_iter()
            .map(|c| closer(&c).unwrap_or(c))
            .collect()
    }

    /// The likeliest of many poses, judged by the landmark network.
    fn likeliest(&self, poses: Vec<Similarity>) -> Vec<Candidate> {
        // The likeness of a face is at most its presence, which needs only half of the network.
        let at_most = |to_canonical| Candidate {
            to_canonical,
            likeness: self.presence(&to_canonical),
        };
        let mut promised: Vec<Candidate> = poses.into_par_iter().map(at_most).collect();
        best_first(&mut promised);
        let mut candidates: Vec<Candidate> = Vec::new();
        for some in promised.chunks(PROMISED_AT_ONCE) {
            if candidates
                .get(LOOKED_AT - 1)
                .is_some_and(|last| last.rank() >= some[0].rank())
            {
                break;
            }
            candidates.par_extend(some.par_iter().map(|c| self.likely(&c.to_canonical)));
            best_first(&mut candidates);
            candidates.truncate(LOOKED_AT);
        }
        candidates
    }

    fn glance(
        &self,
        points: &[[f32; 3]],
        turn: &Similarity,
        window: Window,
        plane: Option<&Plane>,
    ) -> Vec<Candidate> {
        let buffer = self.frame.draw(points, window);
        self.pose
            .see(&buffer.features(), FACES_IN_A_PICTURE)
            .into_iter()
            .filter_map(|sighting| candidate(&sighting, &buffer, window, turn))
            .filter_map(|face| across(face, plane))
            .collect()
    }

    /// Refines the best candidates. The pose network views each several times, every time from a
    /// better estimate of its front. Then the landmark network judges it.
    fn closest_looks(
        &self,
        mut candidates: Vec<Candidate>,
        plane: Option<&Plane>,
    ) -> Vec<Candidate> {
        best_first(&mut candidates);
        candidates.truncate(LOOKED_AT);
        let looked: Vec<Option<Candidate>> = candidates
            .into_par_iter()
            .map(|candidate| {
                let last = (0..CLOSER_LOOKS).try_fold(candidate, |c, _| self.closer(&c, plane))?;
                let likeness = self.likeness(&last.to_canonical);
                Some(Candidate { likeness, ..last })
            })
            .collect();
        distinct(looked.into_iter().flatten().collect())
    }

    /// The same face, seen from its estimated front. `None` if it is no longer in sight.
    fn closer(&self, before: &Candidate, plane: Option<&Plane>) -> Option<Candidate> {
        let window = on_face(CLOSER * HALF_SIZE_M);
        let buffer = self.draw(&before.to_canonical, window)?;
        let sightings = self.pose.see(&buffer.features(), 1);
        let now = candidate(sightings.first()?, &buffer, window, &before.to_canonical)?;
        across(now, plane)
    }

    fn likely(&self, to_canonical: &Similarity) -> Candidate {
        Candidate {
            to_canonical: *to_canonical,
            likeness: self.likeness(to_canonical),
        }
    }

    /// The landmark network's probability of a face: the upper bound of `likeness`.
    fn presence(&self, to_canonical: &Similarity) -> f32 {
        let picture = self.picture(to_canonical);
        picture.map_or(0.0, |picture| self.views.presence(&picture))
    }

    /// How much the front view looks like a face to the landmark network.
    fn likeness(&self, to_canonical: &Similarity) -> f32 {
        let Some(picture) = self.picture(to_canonical) else {
            return 0.0;
        };
        let sight = self.views.see(&picture);
        let inner = &sight.confidence[17..];
        sight.presence * inner.iter().sum::<f32>() / inner.len() as f32
    }

    /// The landmark network's picture from the front.
    fn picture(&self, to_canonical: &Similarity) -> Option<Picture> {
        let buffer = self.draw(to_canonical, on_face(HALF_SIZE_M))?;
        Some(buffer.features())
    }

    /// One look at the frame turned by `turn`; `None` once the search must stop.
    fn draw(&self, turn: &Similarity, window: Window) -> Option<DepthBuffer> {
        let goes_on = self.looks.take();
        goes_on.then(|| {
            let points = turned(self.frame, turn);
            self.frame.draw(&points, window)
        })
    }
}

fn best_first(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| b.rank().total_cmp(&a.rank()));
}

/// The best candidates that differ from each other.
fn distinct(mut candidates: Vec<Candidate>) -> Vec<Candidate> {
    best_first(&mut candidates);
    let mut chosen: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        if chosen.len() < KEPT && chosen.iter().all(|k| differ(k, &candidate)) {
            chosen.push(candidate);
        }
    }
    chosen
}

/// Whether two candidates are more than 25° or half a face apart.
fn differ(a: &Candidate, b: &Candidate) -> bool {
    let step = a.to_canonical.compose(&b.to_canonical.inverse());
    let trace: f64 = (0..3).map(|i| step.rotation[i][i]).sum();
    let middle = middle();
    let moved = step.apply(middle);
    let shift: f32 = (0..3).map(|i| (moved[i] - middle[i]).powi(2)).sum();
    0.5 * (trace - 1.0) < 0.9 || shift.sqrt() > 0.05
}

/// Turns a candidate so that the plane of symmetry, if there is one, divides its face into left and
/// right. `None` if it would turn too far.
fn across(candidate: Candidate, plane: Option<&Plane>) -> Option<Candidate> {
    let Some(plane) = plane else {
        return Some(candidate);
    };
    plane
        .align(&candidate.to_canonical, middle())
        .map(|to_canonical| Candidate {
            to_canonical,
            ..candidate
        })
}

/// A window on the whole mesh.
fn whole([low, high]: [[f32; 3]; 2]) -> Window {
    let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-6);
    Window {
        centre: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
        half_size: 0.53 * extent,
    }
}

/// Possible poses of faces on the plane of symmetry (view x = its offset), from a view to canonical
/// metres: in several sizes, one above the other, each upright and upside down.
fn poses_on(bounds: [[f32; 3]; 2], plane: &Plane) -> Vec<Similarity> {
    let [low, high] = bounds;
    let mut poses = Vec::new();
    for half_size in WINDOWS_ON_PLANE.map(|part| part * whole(bounds).half_size) {
        let steps = ((high[1] - low[1]) / (0.6 * half_size)).ceil().max(1.0) as usize;
        for (step, side) in (0..steps).flat_map(|step| [(step, 1.0), (step, -1.0)]) {
            let y = high[1] - 0.6 * (0.5 + step as f32) * half_size;
            let turn = Similarity {
                scale: f64::from(HALF_SIZE_M / half_size),
                rotation: [[side, 0.0, 0.0], [0.0, side, 0.0], [0.0, 0.0, 1.0]],
                ..Similarity::IDENTITY
            };
            let at = turn.apply([plane.offset as f32, y, high[2]]);
            let to = middle();
            poses.push(Similarity {
                translation: std::array::from_fn(|i| f64::from(to[i] - at[i])),
                ..turn
            });
        }
    }
    poses
}

/// The views from the faces and corners of a cube, the stated front first.
fn directions() -> Vec<Similarity> {
    let mut towards = vec![
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 0.0, -1.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
    ];
    for corner in 0..8 {
        towards.push([0, 1, 2].map(|k| if corner >> k & 1 == 0 { 1.0 } else { -1.0 }));
    }
    towards
        .into_iter()
        .map(|d| looking_from(d.into()))
        .collect()
}

/// The rotation that turns `direction` to +z and keeps +y up where it can.
fn looking_from(direction: DVec3) -> Similarity {
    let z = unit(direction);
    let up = if z[1].abs() < 0.9 {
        DVec3::Y
    } else {
        DVec3::new(0.0, 0.0, -z[1])
    };
    let x = unit(up.cross(z));
    Similarity {
        rotation: [x, z.cross(x), z].map(Into::into),
        ..Similarity::IDENTITY
    }
}

/// Views along the plane of symmetry, all around the mesh. The plane is upright in each of them.
fn around(plane: &Plane) -> Vec<Similarity> {
    let (u, v) = plane.axes();
    let step = std::f64::consts::TAU / VIEWS_IN_PLANE as f64;
    let view = |k: usize| {
        let (s, c) = (step * k as f64).sin_cos();
        let z = c * u + s * v;
        let x = plane.normal;
        Similarity {
            rotation: [x, z.cross(x), z].map(Into::into),
            ..Similarity::IDENTITY
        }
    };
    (0..VIEWS_IN_PLANE).map(view).collect()
}

/// Converts a face seen in a view to a candidate in the frame. `None` where the picture is empty.
fn candidate(
    sighting: &Sighting,
    buffer: &DepthBuffer,
    window: Window,
    to_view: &Similarity,
) -> Option<Candidate> {
    let tight = sighting.size * window.half_size;
    let [x, y] = window.to_view(sighting.place);
    // The centre of the landmarks lies a little behind the surface.
    let surface = buffer.depth_at(sighting.place)?;
    let z = surface - 0.25 * tight;
    let centre = [x, y, z].map(f64::from);
    let scale = f64::from(HALF_SIZE_M / tight);
    let to = middle().map(f64::from);
    let turn = Similarity {
        scale,
        rotation: sighting.rotation,
        ..Similarity::IDENTITY
    };
    let at = turn.apply(centre.map(|c| c as f32)).map(f64::from);
    let from_view = Similarity {
        translation: std::array::from_fn(|i| to[i] - at[i]),
        ..turn
    };
    Some(Candidate {
        to_canonical: from_view.compose(to_view),
        likeness: sighting.presence,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_proper_rotations_and_cover_the_sphere() {
        let all = directions();
        for turn in &all {
            let [x, y, z] = turn.rotation;
            assert!((DVec3::from(x).cross(y.into()).dot(z.into()) - 1.0).abs() < 1e-12);
        }
        for step in 0..500 {
            let (a, b) = (f64::from(step) * 2.399_963, f64::from(step) / 250.0 - 0.998);
            let ring = (1.0 - b * b).sqrt();
            let d = [ring * a.cos(), b, ring * a.sin()];
            let nearest = all
                .iter()
                .map(|t| DVec3::from(t.rotation[2]).dot(d.into()))
                .fold(-1.0, f64::max);
            assert!(nearest > 40f64.to_radians().cos(), "{d:?}");
        }
    }

    #[test]
    fn the_first_direction_is_the_stated_front() {
        assert_eq!(directions()[0].rotation, Similarity::IDENTITY.rotation);
    }
}
