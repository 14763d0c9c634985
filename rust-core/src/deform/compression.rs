//! Compresses a moving mesh to a few shapes and their weights over time.
//!
//! Displacements `D` `[T, 3V]` become `weights · shapes`. The shapes are principal components
//! without centring, so that zero weights give the neutral mesh. Few of them have to keep every
//! vertex in every frame within a stated distance of its place. Components minimise the sum of squared
//! errors instead of the largest, so the search weights vertices and frames by their errors and
//! looks again. It works on some of the vertices, then measures all of them, and adds those that are
//! too far from their place. The reported error is measured on the result, not estimated.

mod components;
mod sparsify;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use self::components::{Components, Importance};
pub(super) use self::sparsify::{MOVING, sparsify};
use super::VertexClip;
use crate::{
    Error, Result,
    job::{ProgressFn, Watch, report},
    nn::{
        matrix::{self, product, view, view_mut},
        vectors::{columns_of, largest, raise, squared_distances},
    },
};

/// Vertices whose error is measured together.
const VERTICES_PER_TASK: usize = 128;
/// Frames whose errors are measured together. Fewer cost less where a look ends at the first error.
const FRAMES_PER_PRODUCT: usize = 256;
/// A clip that needs at most this many shapes gets no rounds of weighting.
const FEW: usize = 40;
/// The search begins with about this many vertices, evenly spread over the mesh.
const SEARCHED: usize = 2500;
/// At most this many vertices join the search at a time.
const JOINING: usize = 800;
/// A vertex joins if its error is more than this share of the largest allowed one.
const NEAR_LIMIT: f32 = 0.5;
/// Rounds of weighting before all vertices are measured, each time.
const ROUNDS: [usize; 4] = [1, 8, 4, 4];
/// The most components that these rounds look for.
const MOST: usize = 256;
/// The range finder follows this many directions more than there are components.
const SPARE: usize = 16;
/// A round multiplies the importance of a vertex or frame by at least this.
const LEAST_EXCESS: f32 = 0.05;
/// The least importance. Smaller ones would lose the weights of a frame in rounding errors.
const LEAST_IMPORTANCE: f32 = 1e-3;

/// A clip as `weights · shapes`.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexBasis {
    /// `[K, V, 3]`, mesh units: the displacement at weight 1.
    pub shapes: Array3<f32>,
    /// `[T, K]`: the weights of each shape lie within [−1, 1] and reach at least one of the ends.
    pub weights: Array2<f32>,
    /// Largest distance of any vertex in any frame from its place in the clip, mesh units.
    pub max_error: f32,
    /// Frames per second.
    pub fps: f64,
}

impl VertexBasis {
    /// `[T, V, 3]`: `weights · shapes`, mesh units.
    pub fn displacements(&self) -> Array3<f32> {
        let (shapes, vertices, _) = self.shapes.dim();
        let flat = self
            .shapes
            .to_shape((shapes, 3 * vertices))
            .expect("row-major");
        let moved = self.weights.dot(&flat);
        moved
            .into_shape_with_order((self.weights.nrows(), vertices, 3))
            .expect("the same number of values")
    }
}

/// Finds a few principal shapes, at most `max_shapes`, that keep every vertex within `max_error` of
/// its place. If the error allows it, at most 20 of them have a weight other than 0 in any one frame.
///
/// `max_error`: mesh units, at least 0. If `max_shapes` are too few, the `max_error` of the result
/// is larger than this. A clip that does not move has no shapes.
///
/// # Errors
/// `InvalidInput` if `max_error` is negative, `max_shapes` is 0 or a displacement is not finite;
/// `Cancelled`.
pub fn compress(
    clip: &VertexClip,
    max_error: f32,
    max_shapes: usize,
    progress: ProgressFn<'_>,
) -> Result<VertexBasis> {
    if max_error.is_nan() || max_error < 0.0 || max_shapes == 0 {
        return Err(Error::InvalidInput(format!(
            "compression: expected an error of at least 0 and at least one shape, got {max_error} \
             and {max_shapes}"
        )));
    }
    let (frames, vertices, _) = clip.displacements.dim();
    let flat = clip.displacements.to_shape((frames, 3 * vertices));
    let flat = flat.expect("the same number of values").into_owned();
    if flat.iter().any(|x| !x.is_finite()) {
        let message = "compression: expected finite displacements, got NaN or infinity";
        return Err(Error::InvalidInput(message.into()));
    }
    report(progress, "compress", 0.0)?;
    let still = Components::none(frames, flat.ncols());
    let watch = Watch::new(progress, "compress", 0.0);
    let error = Errors::of(&flat, &still, 0, &watch)?.largest();
    if error <= max_error {
        return Ok(normalised(&still.weights, &still.shapes, error, clip.fps));
    }
    let best = choose(&flat, max_shapes.min(frames), max_error, progress)?;
    let Components {
        mut weights,
        shapes,
        ..
    } = best.components;
    let error = if weights.ncols() > MOVING {
        let watch = Watch::new(progress, "compress", 0.9);
        sparsify(
            &flat,
            &mut weights,
            &shapes,
            (max_error, best.error),
            &watch,
        )?
    } else {
        best.error
    };
    report(progress, "compress", 1.0)?;
    Ok(normalised(&weights, &shapes, error, clip.fps))
}

/// Components of all vertices, and the largest distance of any vertex from its place.
struct Choice {
    components: Components,
    error: f32,
}

/// Looks for the fewest components, at most `most`, that leave at most `max_error`. If even `most`
/// leave more, returns those that leave least.
///
/// The last attempt looks among all components of all vertices, in case the others missed the bound.
fn choose(
    flat: &Array2<f32>,
    most: usize,
    max_error: f32,
    progress: ProgressFn<'_>,
) -> Result<Choice> {
    let (frames, vertices) = (flat.nrows(), flat.ncols() / 3);
    let mut search = Search::new(most, max_error, frames, vertices);
    let steps = ROUNDS.iter().sum::<usize>() as f32;
    let mut done = 0;
    let mut best: Option<Choice> = None;
    for rounds in ROUNDS {
        let part = columns_of(flat.view(), &search.vertices);
        let mut least: Option<Least> = None;
        for _ in 0..rounds {
            let watch = Watch::new(progress, "compress", 0.8 * done as f32 / steps);
            search.round(&part, &mut least, &watch)?;
            done += 1;
        }
        let Some(least) = least else { break };
        let watch = Watch::new(progress, "compress", 0.8 * done as f32 / steps);
        let components = least.components.on(flat, least.count, &watch);
        let errors = Errors::of(flat, &components, least.count, &watch)?;
        let error = errors.largest();
        let enough = error <= max_error && (rounds > 1 || least.count <= FEW);
        if best
            .as_ref()
            .is_none_or(|best| error < best.error || enough)
        {
            best = Some(Choice { components, error });
        }
        if enough {
            break;
        }
        search.join(&errors, least.importance);
    }
    report(progress, "compress", 0.8)?;
    if let Some(best) = best.take_if(|best| best.error <= max_error) {
        return Ok(best);
    }
    let width = (most + SPARE).min(frames);
    let watch = Watch::new(progress, "compress", 0.8);
    let all = Components::find(flat, &search.importance, width, None, &watch)?;
    let (count, error) = fewest(flat, &all, most, max_error, &watch)?;
    let last = Choice {
        components: all.first(count),
        error,
    };
    Ok(best.filter(|best| best.error < error).unwrap_or(last))
}

/// Looks for components on some of the vertices.
struct Search {
    most: usize,
    max_error: f32,
    /// The numbers of the vertices, in ascending order.
    vertices: Vec<usize>,
    /// Of all vertices of the mesh; 1 for those that are not searched.
    importance: Importance,
}

/// Components of some vertices, how few of them suffice, and the importance that led to them.
struct Least {
    components: Components,
    count: usize,
    error: f32,
    importance: Importance,
}

impl Search {
    fn new(most: usize, max_error: f32, frames: usize, vertices: usize) -> Search {
        let step = vertices.div_ceil(SEARCHED).max(1);
        Search {
            most: most.min(MOST),
            max_error,
            vertices: (0..vertices).step_by(step).collect(),
            importance: Importance {
                frames: vec![1.0; frames],
                vertices: vec![1.0; vertices],
            },
        }
    }

    /// Keeps in `least` the fewest components of `part` `[T, 3n]` so far, and raises the importance
    /// of vertices and frames that would be too far from their place with a quarter fewer (Lawson
    /// 1961).
    fn round(
        &mut self,
        part: &Array2<f32>,
        least: &mut Option<Least>,
        watch: &Watch<'_>,
    ) -> Result<()> {
        let of_vertex = |&v: &usize| self.importance.vertices[v];
        let importance = Importance {
            frames: self.importance.frames.clone(),
            vertices: self.vertices.iter().map(of_vertex).collect(),
        };
        let width = least.as_ref().map_or(self.most, |least| least.count);
        let width = (width.min(self.most) + SPARE).min(part.nrows());
        let near = least.as_ref().map(|least| &least.components);
        let components = Components::find(part, &importance, width, near, watch)?;
        // Once a number suffices, only fewer are of interest.
        let most = match &*least {
            Some(least) if least.error <= self.max_error => least.count - 1,
            _ => self.most,
        };
        let (count, error) = fewest(part, &components, most, self.max_error, watch)?;
        let fewer = least.as_ref().map_or(count, |least| count.min(least.count)) * 3 / 4;
        let errors = Errors::of(part, &components, fewer, watch)?;
        let is_better = |least: &Least| {
            if error <= self.max_error {
                least.error > self.max_error || count < least.count
            } else {
                error < least.error
            }
        };
        if least.as_ref().is_none_or(is_better) {
            *least = Some(Least {
                components,
                count,
                error,
                importance: self.importance.clone(),
            });
        }
        let bound = self.max_error.max(f32::MIN_POSITIVE);
        let raise = |importance: &mut f32, error: &f32| {
            *importance *= (error / bound).clamp(LEAST_EXCESS, 1e3);
        };
        let frames = self.importance.frames.iter_mut();
        frames.zip(&errors.frames).for_each(|(a, e)| raise(a, e));
        for (&v, error) in self.vertices.iter().zip(&errors.vertices) {
            raise(&mut self.importance.vertices[v], error);
        }
        self.balance();
        Ok(())
    }

    /// Adds the vertices that are farthest from their place to the search, which goes on with
    /// `importance`. `errors`: of all vertices.
    fn join(&mut self, errors: &Errors, importance: Importance) {
        self.importance = importance;
        let mut ranked: Vec<usize> = (0..errors.vertices.len()).collect();
        ranked.retain(|&v| errors.vertices[v] > NEAR_LIMIT * self.max_error);
        ranked.sort_by(|&a, &b| errors.vertices[b].total_cmp(&errors.vertices[a]));
        ranked.truncate(JOINING);
        ranked.retain(|v| self.vertices.binary_search(v).is_err());
        let bound = self.max_error.max(f32::MIN_POSITIVE);
        for &v in &ranked {
            self.importance.vertices[v] = (errors.vertices[v] / bound).clamp(1.0, 1e3);
        }
        self.vertices.extend(ranked);
        self.vertices.sort_unstable();
        self.balance();
    }

    /// Brings the mean importance of frames and of the searched vertices to 1.
    fn balance(&mut self) {
        let mean = |sum: f32, count: usize| sum / count.max(1) as f32;
        let Importance { frames, vertices } = &mut self.importance;
        let of_frames = mean(frames.iter().sum(), frames.len());
        let searched = self.vertices.iter().map(|&v| vertices[v]).sum();
        let of_vertices = mean(searched, self.vertices.len());
        let scale = |importance: &mut f32, mean: f32| {
            *importance = (*importance / mean).max(LEAST_IMPORTANCE);
        };
        frames.iter_mut().for_each(|a| scale(a, of_frames));
        for &v in &self.vertices {
            scale(&mut vertices[v], of_vertices);
        }
    }
}

/// The fewest components, between 1 and `most`, that leave at most `max_error`, and the error that
/// they leave. If even `most` leave more, returns these. Found by bisection, because the error falls
/// as components are added.
fn fewest(
    flat: &Array2<f32>,
    components: &Components,
    most: usize,
    max_error: f32,
    watch: &Watch<'_>,
) -> Result<(usize, f32)> {
    let most = most.min(components.shapes.ncols());
    let (mut few, mut many) = (0, most);
    if exceeds(flat, components, most, max_error, watch)? {
        few = most;
    }
    while many - few > 1 {
        let middle = few.midpoint(many);
        if exceeds(flat, components, middle, max_error, watch)? {
            few = middle
        } else {
            many = middle
        }
    }
    let errors = Errors::of(flat, components, many, watch)?;
    Ok((many, errors.largest()))
}

/// The largest distance of each vertex `[V]` from its place in any frame, and of any vertex in each
/// frame `[T]`, mesh units.
struct Errors {
    vertices: Vec<f32>,
    frames: Vec<f32>,
}

impl Errors {
    /// Those that the first `count` components leave.
    fn of(
        flat: &Array2<f32>,
        components: &Components,
        count: usize,
        watch: &Watch<'_>,
    ) -> Result<Errors> {
        let squares_from = |&first: &usize| {
            let mut of_vertices = Vec::new();
            let mut of_frames = Vec::with_capacity(flat.nrows());
            for_each_frame(flat, components, count, first, watch, |squares| {
                of_vertices.resize(squares.len(), 0.0);
                raise(&mut of_vertices, squares);
                of_frames.push(largest(squares));
                true
            });
            (of_vertices, of_frames)
        };
        let squares: Vec<_> = tasks_of(flat).par_iter().map(squares_from).collect();
        watch.check()?;
        let mut errors = Errors {
            vertices: Vec::with_capacity(flat.ncols() / 3),
            frames: vec![0.0; flat.nrows()],
        };
        for (of_vertices, of_frames) in squares {
            errors.vertices.extend(of_vertices);
            raise(&mut errors.frames, &of_frames);
        }
        let Errors { vertices, frames } = &mut errors;
        let squares = vertices.iter_mut().chain(frames);
        squares.for_each(|square| *square = square.sqrt());
        Ok(errors)
    }

    fn largest(&self) -> f32 {
        largest(&self.vertices)
    }
}

/// Whether the first `count` components leave a vertex farther than `max_error` from its place.
fn exceeds(
    flat: &Array2<f32>,
    components: &Components,
    count: usize,
    max_error: f32,
    watch: &Watch<'_>,
) -> Result<bool> {
    let does_exceed = tasks_of(flat).par_iter().any(|&first| {
        let mut longest = 0.0;
        for_each_frame(flat, components, count, first, watch, |squares| {
            longest = largest(squares);
            longest <= max_error * max_error
        });
        longest > max_error * max_error
    });
    watch.check().map(|()| does_exceed)
}

/// The first vertex of each group of [`VERTICES_PER_TASK`] vertices.
fn tasks_of(flat: &Array2<f32>) -> Vec<usize> {
    (0..flat.ncols() / 3).step_by(VERTICES_PER_TASK).collect()
}

/// Calls `visit` with the squared distances of a group of vertices from their place in each frame,
/// until it returns false or the job is cancelled. `first`: of [`tasks_of`].
fn for_each_frame(
    flat: &Array2<f32>,
    components: &Components,
    count: usize,
    first: usize,
    watch: &Watch<'_>,
    mut visit: impl FnMut(&[f32]) -> bool,
) {
    let coordinates = flat.ncols();
    let columns = 3 * VERTICES_PER_TASK.min(coordinates / 3 - first);
    let shapes = view(&components.shapes).subrows(3 * first, columns);
    let shapes = shapes.subcols(0, count).transpose();
    let weights = view(&components.weights).subcols(0, count);
    let mut fitted = vec![0.0; FRAMES_PER_PRODUCT * columns];
    let mut squares = [0.0; VERTICES_PER_TASK];
    let squares = &mut squares[..columns / 3];
    let places = matrix::values(flat).chunks_exact(coordinates);
    let mut places = places.map(|row| &row[3 * first..3 * first + columns]);
    let starts = (0..flat.nrows()).step_by(FRAMES_PER_PRODUCT);
    for start in starts.take_while(|_| watch.is_wanted()) {
        let frames = FRAMES_PER_PRODUCT.min(flat.nrows() - start);
        let fitted = &mut fitted[..frames * columns];
        if count > 0 {
            product(
                view_mut(fitted, columns),
                weights.subrows(start, frames),
                shapes,
            )
        } else {
            fitted.fill(0.0)
        }
        for (fitted, place) in fitted.chunks_exact(columns).zip(&mut places) {
            squared_distances(place, fitted, squares);
            if !visit(squares) {
                return;
            }
        }
    }
}

/// Scales the components so that the weights of each reach 1 or −1.
fn normalised(weights: &Array2<f32>, shapes: &Array2<f32>, error: f32, fps: f64) -> VertexBasis {
    let (frames, count) = weights.dim();
    let vertices = shapes.nrows() / 3;
    let columns = weights.columns().into_iter();
    let largest = columns.map(|column| column.iter().fold(0.0f32, |m, w| m.max(w.abs())));
    let scale: Vec<f32> = largest.map(|m| if m > 0.0 { m } else { 1.0 }).collect();
    VertexBasis {
        shapes: Array3::from_shape_fn((count, vertices, 3), |(k, v, x)| {
            scale[k] * shapes[[3 * v + x, k]]
        }),
        weights: Array2::from_shape_fn((frames, count), |(t, k)| {
            (weights[[t, k]] / scale[k]).clamp(-1.0, 1.0)
        }),
        max_error: error,
        fps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::SILENT;

    /// Two smooth motions over `vertices`, and a small third.
    fn clip(frames: usize, vertices: usize) -> VertexClip {
        let displacements = Array3::from_shape_fn((frames, vertices, 3), |(t, v, x)| {
            let (t, v) = (t as f32 * 0.21, v as f32 * 0.37 + x as f32);
            let small = 1e-3 * (1.7 * t).cos() * (0.3 * v).sin();
            t.sin() * v.cos() + 0.3 * (2.3 * t).sin() * (2.0 * v).sin() + small
        });
        VertexClip {
            displacements,
            fps: 30.0,
        }
    }

    fn largest_difference(a: &Array3<f32>, b: &Array3<f32>) -> f32 {
        let squares = (a - b).mapv(|x| x * x).sum_axis(ndarray::Axis(2));
        squares.iter().fold(0.0f32, |m, &x| m.max(x)).sqrt()
    }

    #[test]
    fn stated_error_is_the_true_one_and_within_the_bound() {
        for (frames, vertices) in [(12, 50), (400, 300)] {
            let clip = clip(frames, vertices);
            for bound in [0.5, 0.01, 1e-4] {
                let basis = compress(&clip, bound, 32, SILENT).unwrap();
                let true_error = largest_difference(&basis.displacements(), &clip.displacements);
                assert!(basis.max_error <= bound, "{} of {bound}", basis.max_error);
                assert!((basis.max_error - true_error).abs() < 1e-5);
            }
            assert_eq!(
                compress(&clip, 0.01, 32, SILENT).unwrap().weights.ncols(),
                2
            );
        }
    }

    #[test]
    fn weights_touch_one_and_neutral_stays_neutral() {
        let mut moving = clip(60, 40);
        let first = ndarray::Axis(0);
        moving.displacements.index_axis_mut(first, 0).fill(0.0);
        let basis = compress(&moving, 1e-3, 32, SILENT).unwrap();
        for column in basis.weights.columns() {
            let largest = column.iter().fold(0.0f32, |m, w| m.max(w.abs()));
            assert!((largest - 1.0).abs() < 1e-6);
            assert!(column[0].abs() < 1e-4);
        }
    }

    #[test]
    fn still_and_empty_clips_have_no_shapes_and_bad_ones_are_errors() {
        for shape in [(5, 7, 3), (0, 7, 3), (5, 0, 3)] {
            let still = VertexClip {
                displacements: Array3::zeros(shape),
                fps: 30.0,
            };
            let basis = compress(&still, 0.0, 8, SILENT).unwrap();
            assert_eq!((basis.weights.dim(), basis.max_error), ((shape.0, 0), 0.0));
        }
        let mut bad = clip(5, 7);
        bad.displacements[[2, 3, 1]] = f32::NAN;
        assert!(compress(&bad, 0.1, 8, SILENT).is_err());
        assert!(compress(&clip(5, 7), -1.0, 8, SILENT).is_err());
    }

    fn noise(seed: usize) -> f32 {
        let x = (seed as f32 * 12.9898).sin() * 43_758.547;
        2.0 * (x - x.floor()) - 1.0
    }

    /// Displacements of 900 vertices in 160 frames. All move a little in many `ways`.
    fn many_ways(ways: usize) -> Array3<f32> {
        Array3::from_shape_fn((160, 900, 3), |(t, v, x)| {
            let of_way = |way| noise(1 + t * ways + way);
            let of_coordinate = |way| noise(50_000 + (3 * v + x) * ways + way);
            (0..ways)
                .map(|way| 0.02 * of_way(way) * of_coordinate(way))
                .sum()
        })
    }

    /// The largest error that `count` components leave which minimise the sum of all errors.
    fn error_of_principal(clip: &VertexClip, count: usize) -> f32 {
        let (frames, vertices, _) = clip.displacements.dim();
        let even = Importance {
            frames: vec![1.0; frames],
            vertices: vec![1.0; vertices],
        };
        let (flat, watch) = (flat_of(clip), Watch::new(SILENT, "test", 0.0));
        let components = Components::find(&flat, &even, count + SPARE, None, &watch).unwrap();
        let errors = Errors::of(&flat, &components, count, &watch).unwrap();
        errors.largest()
    }

    #[test]
    fn a_small_part_with_motion_of_its_own_stays_within_the_bound() {
        let mut displacements = many_ways(80);
        for ((t, v, x), moved) in displacements.indexed_iter_mut() {
            if v >= 892 {
                *moved = 0.5 * noise(900_000 + (t * 900 + v) * 3 + x);
            }
        }
        let clip = VertexClip {
            displacements,
            fps: 30.0,
        };
        let basis = compress(&clip, 0.35, 60, SILENT).unwrap();
        assert!(basis.max_error <= 0.35, "{}", basis.max_error);
        assert!(error_of_principal(&clip, 60) > 0.35);
    }

    #[test]
    fn moments_of_their_own_take_few_shapes() {
        let mut displacements = many_ways(60);
        for moment in 0..5 {
            displacements[[30 * moment + 3, 150 * moment, 1]] += 1.0;
        }
        let clip = VertexClip {
            displacements,
            fps: 30.0,
        };
        let basis = compress(&clip, 0.4, 100, SILENT).unwrap();
        assert!(basis.max_error <= 0.4, "{}", basis.max_error);
        assert!(basis.weights.ncols() <= 20, "{}", basis.weights.ncols());
        assert!(error_of_principal(&clip, 40) > 0.4);
    }

    fn flat_of(clip: &VertexClip) -> Array2<f32> {
        let (frames, vertices, _) = clip.displacements.dim();
        let flat = clip.displacements.to_shape((frames, 3 * vertices));
        flat.unwrap().into_owned()
    }

    #[test]
    fn too_few_shapes_are_reported_by_their_error() {
        let basis = compress(&clip(100, 60), 1e-6, 1, SILENT).unwrap();
        assert_eq!(basis.weights.ncols(), 1);
        assert!(basis.max_error > 0.1);
    }
}
