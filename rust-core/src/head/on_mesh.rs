//! Moves the vertices of a mesh by the field: finds where each vertex lies in the canonical pose of
//! the head most like the mesh, and how far an expression moves it from there.
//!
//! FaceTalk's codes move a head that has no vertices: its forward field takes any canonical point
//! to its place in an expression. A mesh can follow the field once the canonical point of each
//! vertex is known.
//!
//! Once for a face (the result is [`Placed`], which the cache keeps):
//! 1. [`Head::fit_scan`] finds the head most like the face at rest, and the similarity from the
//!    mesh to that head.
//! 2. [`canonical_points`] finds the canonical point of each vertex of the skin.
//! 3. Each vertex gets the share with which it follows the field. The share falls to 0 between
//!    [`NEAR_M`] and [`FAR_M`] away from the head's surface, and towards the landmarks of eyelids
//!    and lips, as [`BEYOND_M`] says. Shares are then averaged over neighbours. Copies at seams,
//!    lashes and brows follow the skin that they are bound to.
//!
//! In each frame ([`CodeField::beyond`]): the forward field takes the canonical point of a vertex
//! to one place under the code and to another at rest. The difference, turned back to the mesh's
//! axes and units and scaled by the smoothing of eq. 15, is the field's displacement. The result is
//! the vertex's share of this displacement, less the same share of the motion that the code's own
//! landmarks give. The caller adds the result to the motion of landmarks. So as its share grows, a
//! vertex goes from following landmarks to following the field.
//!
//! The code enters the forward field only before its last activation. All earlier layers are
//! evaluated once for each vertex ([`Trunks`]), so a frame costs only this activation and the last
//! layer for each follower. Frames are independent and run on all cores.
//!
//! Not obvious: the displacement is a difference of two values of the forward field, so a face at
//! rest stays exactly at rest, however well the head fits. Eyelids and lips keep to their
//! landmarks, because landmarks best say when they touch, and contacts are corrected after the sum.
//! The landmarks of a code are those of the mean head and not of the fitted one, because landmark
//! motion is canonical everywhere.
//!
//! What can go wrong: if a face is unlike every head of the model, the fit is refused with a
//! message, which the cache keeps too. The face then moves by its landmarks alone. The share is 0
//! for vertices far from the head's surface (ears, hair, neck) and for those whose canonical point
//! was not found.

use std::sync::Arc;

use glam::Vec3;
use ndarray::{Array3, ArrayView2, Axis};
use rayon::prelude::*;

use super::{COEFFICIENTS, Head, OneHead, ScanFit, ScanOptions, Trunks};
use crate::{
    Error, Result,
    cache::{Arrays, Cache},
    deform::fade,
    face::{CodeField, Face, PointGrid, binding::Follows},
    job::{ProgressFn, report},
    mesh::{Mesh, Similarity, ibug::LANDMARKS},
};

/// Cells along the longest side of the grid whose surface gives the searches their starts.
const STARTS: usize = 112;
/// A vertex nearer to the surface than this follows the field fully; metres.
const NEAR_M: f32 = 4e-3;
/// A vertex farther from the surface than this does not follow the field; metres.
const FAR_M: f32 = 1e-2;
/// Least cosine between the normals of a vertex and of the place where its search starts.
const SAME_WAY: f32 = 0.2;
/// Name under which the cache stores a refusal.
const REFUSED: &str = "refused";
const LOOKED_AT: usize = 32;
/// A vertex does not follow the field if its root misses it by more than this, metres.
const ROOT_M: f32 = 3e-4;
const FOUND_M: f32 = 2e-5;
const SIMPLE_STEPS: usize = 8;
const NEWTON_STEPS: usize = 4;
const DIFFERENCE_M: f32 = 5e-4;
/// The field has no effect within the first distance of eyelids and lips, and full effect beyond
/// the second; metres.
const BEYOND_M: (f32, f32) = (8e-3, 3e-2);

/// How strongly the field moves a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Factor on the share with which each vertex follows the field, 0 to 1.
    pub share: f32,
    /// σ of the smoothing of eq. 12, metres; 0 for none.
    pub sigma_m: f32,
}

impl Default for Reach {
    fn default() -> Self {
        Reach {
            share: 1.0,
            sigma_m: 0.0,
        }
    }
}

/// The field of one head on the vertices of a similar mesh.
pub struct HeadOnMesh {
    head: Arc<Head>,
    vertices: usize,
    placed: Placed,
    /// Vertices that follow followers: each with its followers' numbers and their shares.
    carried: Vec<(u32, Vec<(u32, f32)>)>,
    points: Trunks,
    at_rest: Vec<[f32; 3]>,
    /// Factor of the field's motion at each follower, eq. 15.
    smoothing: Vec<f32>,
    /// Of the mean head.
    landmarks: Trunks,
    landmarks_at_rest: Vec<[f32; 3]>,
}

/// The head most like a mesh, and where the mesh's vertices lie in it.
struct Placed {
    fit: ScanFit,
    /// Vertices that follow the field, in ascending order.
    followers: Vec<u32>,
    /// The share with which each follows, above 0 and at most 1.
    shares: Vec<f32>,
    /// Their canonical points.
    canonical: Vec<[f32; 3]>,
}

/// Fits a head to a face at rest, or says why no head is like the face. `cache` keeps the result.
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face; `Cancelled`.
pub fn fit_face(
    head: &Head,
    face: &Face,
    cache: &Cache,
    progress: ProgressFn<'_>,
) -> Result<std::result::Result<ScanFit, String>> {
    let placed = Placed::of_face(head, face, cache, progress)?;
    Ok(placed.map(|placed| placed.fit))
}

impl HeadOnMesh {
    /// Fits a head to a face at rest and finds the face's vertices in it, or says why no head is
    /// like the face. `cache` keeps the result.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face; `Cancelled`.
    pub fn new(
        head: Arc<Head>,
        face: &Face,
        reach: Reach,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<std::result::Result<HeadOnMesh, String>> {
        match Placed::of_face(&head, face, cache, progress)? {
            Ok(placed) => HeadOnMesh::of_placed(head, face, placed, reach).map(Ok),
            Err(complaint) => Ok(Err(complaint)),
        }
    }

    /// Does the same with a head that is already fitted.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count of coefficients or one that is not finite; `Mesh` if the
    /// landmarks lie on no usable face; `Cancelled`.
    pub fn of_fit(
        head: Arc<Head>,
        face: &Face,
        fit: ScanFit,
        reach: Reach,
        progress: ProgressFn<'_>,
    ) -> Result<HeadOnMesh> {
        let placed = Placed::new(&head, face, fit, progress)?;
        HeadOnMesh::of_placed(head, face, placed, reach)
    }

    fn of_placed(
        head: Arc<Head>,
        face: &Face,
        mut placed: Placed,
        reach: Reach,
    ) -> Result<HeadOnMesh> {
        let surface = face.surface()?;
        placed.shares.iter_mut().for_each(|s| *s *= reach.share);
        let one = head.one(head.identity_code(&placed.fit.coefficients)?)?;
        let smoothing = smoothing(&one.landmarks(), &placed.canonical, reach.sigma_m);
        let points = one.trunks(placed.canonical.clone());
        let mean = head.one(head.identity_code(&[0.0; COEFFICIENTS])?)?;
        let landmarks = mean.trunks(mean.landmarks());
        let rest = head.rest_code();
        Ok(HeadOnMesh {
            vertices: surface.skin.is_skin.len(),
            smoothing,
            carried: carried(&surface.follows, &surface.skin.sewn, &placed.followers),
            at_rest: points.at(&head, &rest)?,
            points,
            landmarks_at_rest: landmarks.at(&head, &rest)?,
            landmarks,
            placed,
            head: Arc::clone(&head),
        })
    }

    /// The fit of the head to the mesh.
    pub fn fit(&self) -> &ScanFit {
        &self.placed.fit
    }

    /// The share with which each vertex `[V]` follows the field.
    pub fn shares(&self) -> Vec<f32> {
        let mut out = vec![0.0; self.vertices];
        for (&v, &share) in self.placed.followers.iter().zip(&self.placed.shares) {
            out[v as usize] = share;
        }
        for (v, from) in &self.carried {
            out[*v as usize] = from
                .iter()
                .map(|(n, s)| s * self.placed.shares[*n as usize])
                .sum();
        }
        out
    }

    /// Displacements of followers from rest, mesh units and axes.
    fn moved(&self, code: &[f32]) -> Result<Vec<[f32; 3]>> {
        let back = self.placed.fit.to_head.inverse();
        let scale = back.scale as f32;
        let moved = self.points.at(&self.head, code)?;
        let by = |(to, from): ([f32; 3], &[f32; 3])| {
            back.rotate((Vec3::from(to) - Vec3::from(*from)).into())
                .map(|x| scale * x)
        };
        Ok(moved.into_iter().zip(&self.at_rest).map(by).collect())
    }
}

impl CodeField for HeadOnMesh {
    /// Of the mean head.
    fn landmarks(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>> {
        let mut out = Array3::zeros((codes.nrows(), LANDMARKS, 3));
        for (code, mut frame) in codes.rows().into_iter().zip(out.outer_iter_mut()) {
            let moved = self.landmarks.at(&self.head, &code.to_vec())?;
            let rows = moved.iter().zip(&self.landmarks_at_rest);
            for (mut row, (to, from)) in frame.rows_mut().into_iter().zip(rows) {
                (0..3).for_each(|axis| row[axis] = to[axis] - from[axis]);
            }
        }
        Ok(out)
    }

    fn beyond(&self, codes: ArrayView2<'_, f32>, base: &Array3<f32>) -> Result<Array3<f32>> {
        let mut out = Array3::zeros(base.dim());
        let frames = out.axis_iter_mut(Axis(0)).into_par_iter();
        let bases = base.axis_iter(Axis(0)).into_par_iter();
        frames
            .zip(bases)
            .enumerate()
            .try_for_each(|(t, (mut out, base))| {
                let moved = self.moved(&codes.row(t).to_vec())?;
                for (n, by) in moved.iter().enumerate() {
                    let (v, share, smooth) = (
                        self.placed.followers[n] as usize,
                        self.placed.shares[n],
                        self.smoothing[n],
                    );
                    for axis in 0..3 {
                        out[[v, axis]] = share * (smooth * by[axis] - base[[v, axis]]);
                    }
                }
                for (v, from) in &self.carried {
                    for &(n, share) in from {
                        let from = self.placed.followers[n as usize] as usize;
                        for axis in 0..3 {
                            out[[*v as usize, axis]] += share * out[[from, axis]];
                        }
                    }
                }
                Ok(())
            })?;
        Ok(out)
    }
}

impl Placed {
    /// Fits a head to a face and places the vertices in it, or says why no head is like the face.
    /// `cache` keeps the result.
    fn of_face(
        head: &Head,
        face: &Face,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<std::result::Result<Placed, String>> {
        let skin = &face.surface()?.skin;
        let place = || {
            let points: Vec<[f32; 3]> = (0..skin.is_skin.len())
                .filter(|&v| skin.is_skin[v])
                .map(|v| face.mesh.positions[v])
                .collect();
            let options = ScanOptions::default();
            match head.fit_scan(&points, &face.landmarks, &options, progress) {
                Ok(fit) => Ok(Ok(Placed::new(head, face, fit, progress)?)),
                Err(Error::InvalidInput(complaint)) => Ok(Err(complaint)),
                Err(other) => Err(other),
            }
        };
        let encode = |placed: &std::result::Result<Placed, String>| match placed {
            Ok(placed) => placed.to_arrays(),
            Err(complaint) => {
                let mut arrays = Arrays::default();
                arrays.insert_json(REFUSED, complaint);
                arrays
            }
        };
        let decode = |mut arrays: Arrays| match arrays.take_json(REFUSED) {
            Some(complaint) => Some(Err(complaint)),
            None => Placed::from_arrays(arrays).map(Ok),
        };
        let key = face.cache_key_of_mesh().text("field");
        cache.get_or_make(&key, decode, encode, place)
    }

    fn new(head: &Head, face: &Face, fit: ScanFit, progress: ProgressFn<'_>) -> Result<Placed> {
        let skin = &face.surface()?.skin;
        let one = head.one(head.identity_code(&fit.coefficients)?)?;
        let skin_vertices: Vec<u32> = (0..skin.is_skin.len() as u32)
            .filter(|&v| skin.is_skin[v as usize] && skin.sewn[v as usize] == v)
            .collect();
        let places: Vec<[f32; 3]> = skin_vertices
            .iter()
            .map(|&v| fit.to_head.apply(face.mesh.positions[v as usize]))
            .collect();
        let normals = skin.surface.vertex_normals();
        let turned = |v: &u32| turn_only(&fit.to_head, face, normals[*v as usize]);
        let normals: Vec<[f32; 3]> = skin_vertices.iter().map(turned).collect();
        let (canonical, reached) = canonical_points(&one, &places, &normals, progress)?;
        let touching: Vec<[f32; 3]> = face.landmarks.positions[36..]
            .iter()
            .map(|p| fit.to_head.apply(*p))
            .collect();
        let mut shares = vec![0.0; skin.is_skin.len()];
        let near = one.distance(&canonical);
        for (n, &v) in skin_vertices.iter().enumerate() {
            let near = fade::within(near[n].abs(), (NEAR_M, FAR_M));
            let share = near * fade::beyond(&touching, places[n], BEYOND_M);
            shares[v as usize] = if reached[n] { share } else { 0.0 };
        }
        fade::even_out(&mut shares, &skin.surface.triangles, &skin_vertices);
        let chosen: Vec<usize> = (0..skin_vertices.len())
            .filter(|&n| reached[n] && shares[skin_vertices[n] as usize] > 0.0)
            .collect();
        Ok(Placed {
            fit,
            followers: chosen.iter().map(|&n| skin_vertices[n]).collect(),
            shares: chosen
                .iter()
                .map(|&n| shares[skin_vertices[n] as usize])
                .collect(),
            canonical: chosen.iter().map(|&n| canonical[n]).collect(),
        })
    }

    fn to_arrays(&self) -> Arrays {
        let mut arrays = Arrays::default();
        let rows = self.followers.len();
        arrays.insert_u32("followers", &[rows], self.followers.clone());
        arrays.insert_f32("shares", &[rows], self.shares.clone());
        let canonical = self.canonical.as_flattened().to_vec();
        arrays.insert_f32("canonical", &[rows, 3], canonical);
        let coefficients = self.fit.coefficients.clone();
        arrays.insert_f32("coefficients", &[coefficients.len()], coefficients);
        let fit = &self.fit;
        let distances = (fit.mean_mm, fit.most_mm, fit.points);
        let way = (fit.metres_per_unit, fit.to_head);
        arrays.insert_json("fit", &(distances, way, &fit.warnings));
        arrays
    }

    fn from_arrays(mut arrays: Arrays) -> Option<Placed> {
        let (distances, way, warnings) = arrays.take_json("fit")?;
        let (mean_mm, most_mm, points) = distances;
        let (metres_per_unit, to_head) = way;
        Some(Placed {
            fit: ScanFit {
                coefficients: arrays.take_f32("coefficients")?.1,
                mean_mm,
                most_mm,
                points,
                metres_per_unit,
                to_head,
                warnings,
            },
            followers: arrays.take_u32("followers")?.1,
            shares: arrays.take_f32("shares")?.1,
            canonical: arrays.take_f32("canonical")?.1.as_chunks::<3>().0.to_vec(),
        })
    }
}

/// Weights of eq. 12 to 14 at canonical `points`: a Gaussian about the mouth, scaled to 0 to 1. We
/// added a second Gaussian about eyes and brows. All weights are 1 if `sigma_m` is 0.
fn smoothing(landmarks: &[[f32; 3]], points: &[[f32; 3]], sigma_m: f32) -> Vec<f32> {
    if sigma_m <= 0.0 {
        return vec![1.0; points.len()];
    }
    let upper: Vec<[f32; 3]> = [&landmarks[17..27], &landmarks[36..48]].concat();
    let centres = [centre(&landmarks[48..]), centre(&upper)];
    let weight = |p: &[f32; 3]| {
        let far = centres.map(|c| Vec3::from(*p).distance(c.into()) / sigma_m);
        let nearest = far[0].min(far[1]);
        (-0.5 * nearest * nearest).exp()
    };
    let mut weights: Vec<f32> = points.iter().map(weight).collect();
    let least = weights.iter().copied().fold(f32::INFINITY, f32::min);
    let most = weights.iter().copied().fold(0.0, f32::max);
    let range = (most - least).max(f32::MIN_POSITIVE);
    weights.iter_mut().for_each(|w| *w = (*w - least) / range);
    weights
}

fn centre(points: &[[f32; 3]]) -> [f32; 3] {
    std::array::from_fn(|axis| points.iter().map(|p| p[axis]).sum::<f32>() / points.len() as f32)
}

/// Turns a direction of the canonical frame into the axes of the fitted head.
fn turn_only(to_head: &Similarity, face: &Face, direction: [f32; 3]) -> [f32; 3] {
    to_head.rotate(face.to_canonical.inverse().rotate(direction))
}

/// Vertices that follow followers: copies at seams, lashes and brows.
fn carried(follows: &[Follows], sewn: &[u32], followers: &[u32]) -> Vec<(u32, Vec<(u32, f32)>)> {
    let place = |v: u32| {
        let row = followers.binary_search(&sewn[v as usize]);
        row.ok().map(|n| n as u32)
    };
    let all = follows
        .iter()
        .enumerate()
        .map(|(v, follows)| (v as u32, follows));
    all.filter(|(v, _)| followers.binary_search(v).is_err())
        .filter_map(|(v, follows)| {
            let Follows::Skin(corners) = follows else {
                return None;
            };
            let weighted = corners.iter().filter(|(_, share)| *share != 0.0);
            let from: Vec<(u32, f32)> = weighted
                .filter_map(|&(corner, share)| Some((place(corner)?, share)))
                .collect();
            (!from.is_empty()).then_some((v, from))
        })
        .collect()
}

/// Finds where points `[P]` of the face at rest, with their normals, lie in the canonical pose, and
/// whether the search reached them: the roots `x` of `forward(x) = p`, where `forward` is the
/// head's field in the pose at rest.
///
/// The field goes from the canonical pose to any other, but a vertex is known only in the pose at
/// rest. The backward field is a second network, trained beside the forward one. Its error would
/// put a vertex beside its place on the face, so the search inverts the forward field itself.
///
/// 1. Marching cubes on a grid with [`STARTS`] cells along its longest side finds the surface of
///    the head in the canonical pose, whose mouth is open. The forward field moves the vertices of
///    this surface to the pose at rest.
/// 2. Each point looks among the [`LOOKED_AT`] nearest of these vertices within [`FAR_M`] for the
///    nearest one whose normal points the same way. The search starts at the canonical place of
///    that vertex, plus the offset of the point from the vertex at rest.
/// 3. [`SIMPLE_STEPS`] fixed-point steps `x += p − forward(x)` follow. They need no slopes and
///    converge where the field is locally close to a translation, as it is on most of the face.
/// 4. [`NEWTON_STEPS`] Newton steps follow for the points that are left, with slopes by central
///    differences. They are for skin that the field turns or stretches. No step of either kind is
///    longer than [`NEAR_M`] along an axis.
///
/// For each point that is left, a fixed-point step costs one evaluation of the field. A Newton step
/// costs seven, six of them for the differences. Points within [`FOUND_M`] leave the search. The
/// surface costs as many distances as marching cubes needs on the grid, whatever the mesh.
///
/// Not obvious: the lips coincide at rest, so the root of a vertex of the lips is not unique. Only
/// the start decides on which lip the vertex lies, and the normals decide the start. The triangles
/// of a scan may be turned inside out. So the search finds starts for both signs of the normals and
/// takes the sign with more starts.
///
/// What can go wrong: a point may have no start (hair, an ear that the head lacks). A search may
/// end more than [`ROOT_M`] away from its point, or diverge. Both are reported as not reached, and
/// such a vertex does not follow the field. Where the slopes are close to singular, a Newton step
/// becomes a fixed-point step.
fn canonical_points(
    one: &OneHead<'_>,
    places: &[[f32; 3]],
    normals: &[[f32; 3]],
    progress: ProgressFn<'_>,
) -> Result<(Vec<[f32; 3]>, Vec<bool>)> {
    let surface = one.canonical_surface(STARTS, progress)?;
    report(progress, "points", 0.0)?;
    let rest = one.head.rest_code();
    let at_rest = Mesh {
        positions: one.mover(surface.positions.clone()).at(&rest)?,
        triangles: surface.triangles,
    };
    let mut search = RootSearch {
        one,
        rest,
        places,
        roots: places.to_vec(),
        reached: vec![false; places.len()],
        left: Vec::new(),
    };
    for (n, start) in starts(&at_rest, places, normals).into_iter().enumerate() {
        let Some(start) = start.map(|start| start as usize) else {
            continue;
        };
        search.roots[n] = std::array::from_fn(|axis| {
            surface.positions[start][axis] + places[n][axis] - at_rest.positions[start][axis]
        });
        search.left.push(n);
    }
    let steps = SIMPLE_STEPS + NEWTON_STEPS;
    for step in 0..steps {
        report(progress, "points", step as f32 / steps as f32)?;
        if search.left.is_empty() {
            break;
        }
        search.step(step >= SIMPLE_STEPS)?;
    }
    search.judge_rest()?;
    report(progress, "points", 1.0)?;
    Ok((search.roots, search.reached))
}

/// For each point, the nearest vertex of the head `at_rest` whose normal points the same way, if
/// one is near.
fn starts(at_rest: &Mesh, places: &[[f32; 3]], normals: &[[f32; 3]]) -> Vec<Option<u32>> {
    let towards = at_rest.vertex_normals();
    let grid = PointGrid::new(&at_rest.positions, NEAR_M);
    let start = |side: f32| -> Vec<Option<u32>> {
        let points = places.par_iter().zip(normals);
        points
            .map(|(p, normal)| {
                let near = grid.within(*p, FAR_M, LOOKED_AT);
                let same = |n: &u32| {
                    side * Vec3::from(*normal).dot(towards[*n as usize].into()) > SAME_WAY
                };
                near.into_iter().map(|(n, _)| n).find(same)
            })
            .collect()
    };
    // Triangles of a scan may be turned inside out.
    let (out, inside_out) = (start(1.0), start(-1.0));
    let count = |starts: &[Option<u32>]| starts.iter().flatten().count();
    if count(&out) >= count(&inside_out) {
        out
    } else {
        inside_out
    }
}

/// The search for the roots of many points at once.
struct RootSearch<'a> {
    one: &'a OneHead<'a>,
    /// Code of the pose at rest.
    rest: Vec<f32>,
    /// `[P]`, the points at rest.
    places: &'a [[f32; 3]],
    /// `[P]`, canonical.
    roots: Vec<[f32; 3]>,
    /// `[P]`, whether the forward field takes the root to within [`ROOT_M`] of its point.
    reached: Vec<bool>,
    /// Numbers of the points whose search goes on.
    left: Vec<usize>,
}

impl RootSearch<'_> {
    /// The roots of the points that are left.
    fn here(&self) -> Vec<[f32; 3]> {
        self.left.iter().map(|&n| self.roots[n]).collect()
    }

    fn step(&mut self, is_newton: bool) -> Result<()> {
        let here = self.here();
        let moved = self.one.mover(here.clone()).at(&self.rest)?;
        let slopes = is_newton
            .then(|| slopes_of(self.one, &here, &self.rest))
            .transpose()?;
        let mut still = Vec::new();
        for (row, &n) in self.left.iter().enumerate() {
            let off = Vec3::from(self.places[n]) - Vec3::from(moved[row]);
            let size = off.length();
            self.reached[n] = size < ROOT_M;
            if size < FOUND_M {
                continue;
            }
            let by = match &slopes {
                Some(slopes) => solve(slopes[row], off).unwrap_or(off),
                None => off,
            };
            (0..3).for_each(|axis| self.roots[n][axis] += by[axis].clamp(-NEAR_M, NEAR_M));
            still.push(n);
        }
        self.left = still;
        Ok(())
    }

    /// Checks whether the last step reached the points that are left.
    fn judge_rest(&mut self) -> Result<()> {
        if self.left.is_empty() {
            return Ok(());
        }
        let moved = self.one.mover(self.here()).at(&self.rest)?;
        for (&n, moved) in self.left.iter().zip(moved) {
            self.reached[n] = Vec3::from(self.places[n]).distance(moved.into()) < ROOT_M;
        }
        Ok(())
    }
}

/// Columns of the forward field's Jacobian at points `[P]`, by central differences.
fn slopes_of(one: &OneHead<'_>, points: &[[f32; 3]], code: &[f32]) -> Result<Vec<[[f32; 3]; 3]>> {
    let beside: Vec<[f32; 3]> = points
        .iter()
        .flat_map(|p| {
            (0..6).map(|n| {
                let mut p = *p;
                p[n / 2] += if n % 2 == 0 {
                    DIFFERENCE_M
                } else {
                    -DIFFERENCE_M
                };
                p
            })
        })
        .collect();
    let moved = one.mover(beside).at(code)?;
    let rows = moved.as_chunks::<6>().0.iter();
    let column = |m: &[[f32; 3]; 6], n: usize| {
        std::array::from_fn(|axis| (m[2 * n][axis] - m[2 * n + 1][axis]) / (2.0 * DIFFERENCE_M))
    };
    Ok(rows
        .map(|m| std::array::from_fn(|n| column(m, n)))
        .collect())
}

/// Solves `columns · x = y` by Cramer's rule. `None` if the columns hardly span space.
fn solve(columns: [[f32; 3]; 3], y: Vec3) -> Option<Vec3> {
    let [a, b, c] = columns.map(Vec3::from);
    let volume = a.dot(b.cross(c));
    let x = || Vec3::new(y.dot(b.cross(c)), a.dot(y.cross(c)), a.dot(b.cross(y)));
    (volume.abs() > 0.05).then(|| x() / volume)
}
