//! Compresses a moving mesh to a few shapes and their weights over time.
//!
//! Displacements `D` `[T, 3V]` become `weights · shapes`. The number of shapes is the smallest that
//! keeps every vertex in every frame within a stated distance of its place. The shapes are principal
//! components without centring, so that zero weights give the neutral mesh. Long clips go through a
//! randomised range finder with one power iteration (Halko, Martinsson, Tropp 2011, algorithm 4.4).
//! The reported error is measured on the result, not estimated.

mod reduced;
mod sparsify;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use self::{
    reduced::{Components, Reduced},
    sparsify::{MOVING, sparsify},
};
use super::VertexClip;
use crate::{
    Error, Result,
    job::{Progress, ProgressFn, report},
    nn::matrix::{self, product, view, view_mut},
};

/// Vertices whose error is measured together.
const VERTICES_PER_TASK: usize = 128;
/// The search for the number of components begins here, because a performance needs about this many.
const FIRST_COUNT: usize = 32;
/// A clip that needs at most this many shapes gets no rounds of weighting.
const FEW: usize = 40;
/// The most rounds that weight the vertices so that fewer shapes suffice.
const ROUNDS: usize = 3;
/// A round multiplies the weight of a vertex by at least this.
const LEAST_EXCESS: f32 = 0.05;

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
    let most = max_shapes.min(frames);
    let best = choose(&flat, most, vec![1.0; vertices], max_error, progress)?;
    let best = match best.error > max_error {
        true => choose_for_the_worst(&flat, most, best, max_error, progress)?,
        false => best,
    };
    let mut chosen = best.full.first(best.count);
    let error = match best.count > MOVING {
        true => {
            let Components { weights, shapes } = &mut chosen;
            sparsify(&flat, weights, shapes, max_error, best.error)
        }
        false => best.error,
    };
    report(progress, "compress", 1.0)?;
    Ok(normalised(&chosen, error, vertices, clip.fps))
}

/// Components, how many of them are used, and the error that these leave.
struct Choice {
    full: Components,
    count: usize,
    error: f32,
}

/// Searches once more among the motion that the worst vertices of `first` need.
///
/// The components of a long clip come from the few directions in time in which most vertices move.
/// A small part that moves in its own way, such as the tongue, may need others: in 50 s of speech on
/// the default head 256 components left it farther away than 0.1 mm; 193 of this second search do not.
fn choose_for_the_worst(
    flat: &Array2<f32>,
    most: usize,
    first: Choice,
    max_error: f32,
    progress: ProgressFn<'_>,
) -> Result<Choice> {
    let all = tasks_of(flat);
    let left = errors_of_vertices(flat, &first.full, first.count * 3 / 4, &all);
    let mut weights = vec![1.0; left.len()];
    emphasise(&mut weights, &left, max_error);
    // The first search has reported 0.6.
    let rest = |here: Progress| {
        progress(Progress {
            fraction: 0.6 + 0.4 * here.fraction,
            ..here
        })
    };
    let second = choose(flat, most, weights, max_error, &rest)?;
    Ok(match second.error < first.error {
        true => second,
        false => first,
    })
}

/// The first vertex of each group of [`VERTICES_PER_TASK`] vertices.
fn tasks_of(flat: &Array2<f32>) -> Vec<usize> {
    (0..flat.ncols() / 3).step_by(VERTICES_PER_TASK).collect()
}

/// Tries several weightings of the vertices, `weights` `[V]` first, for the fewest components, at
/// most `most`, that leave at most `max_error`.
fn choose(
    flat: &Array2<f32>,
    most: usize,
    mut weights: Vec<f32>,
    max_error: f32,
    progress: ProgressFn<'_>,
) -> Result<Choice> {
    let reduced = Reduced::new(flat, most, &weights, progress)?;
    let all = tasks_of(flat);
    let full = reduced.components(&weights)?;
    let (count, error) = fewest(flat, &full, max_error, FIRST_COUNT, &all);
    let mut best = Choice { full, count, error };
    for round in 0..ROUNDS {
        report(progress, "compress", 0.6 + 0.1 * round as f32)?;
        if best.count <= FEW || best.error > max_error {
            break;
        }
        let fewer = best.count * 3 / 4;
        let left = errors_of_vertices(flat, &best.full, fewer, &all);
        emphasise(&mut weights, &left, max_error);
        let full = reduced.components(&weights)?;
        // The vertices with the largest error before the round also have it afterwards. So the search
        // for the number of components measures only them. All vertices are measured once at the end.
        let worst = worst_tasks(&left, &all);
        let (count, _) = fewest(flat, &full, max_error, fewer, &worst);
        let error = largest_error(flat, &full, count, &all);
        if error <= max_error && count < best.count {
            best = Choice { full, count, error };
        }
    }
    Ok(best)
}

/// Raises the weights of vertices that are far from their place (`left` `[V]`, squared distances).
///
/// Principal components minimise the sum of squared errors, but here the largest error has to be
/// small. Raising the weights where the error is large brings it down (Lawson 1961).
fn emphasise(weights: &mut [f32], left: &[f32], max_error: f32) {
    for (weight, left) in weights.iter_mut().zip(left) {
        let excess = (left.sqrt() / max_error.max(f32::MIN_POSITIVE)).clamp(LEAST_EXCESS, 1e3);
        *weight *= excess;
    }
    let mean = weights.iter().sum::<f32>() / weights.len().max(1) as f32;
    weights.iter_mut().for_each(|weight| *weight /= mean);
}

/// The fewest components that leave at most `max_error`, and the error that they leave. If even all
/// components leave more, returns all.
///
/// The error falls as components are added, so doubling from `guess` and then bisection find their
/// number.
fn fewest(
    flat: &Array2<f32>,
    full: &Components,
    max_error: f32,
    guess: usize,
    tasks: &[usize],
) -> (usize, f32) {
    let most = full.shapes.ncols();
    let left = |count| largest_error(flat, full, count, tasks);
    let (mut few, mut many, mut error) = (0, 0, left(0));
    while error > max_error && many < most {
        few = many;
        many = (2 * many).clamp(guess.min(most), most);
        error = left(many);
    }
    while error <= max_error && many - few > 1 {
        let middle = few.midpoint(many);
        let error_there = left(middle);
        match error_there <= max_error {
            true => (many, error) = (middle, error_there),
            false => few = middle,
        }
    }
    (many, error)
}

/// The largest distance of any vertex in any frame from where the first `count` components put it.
fn largest_error(flat: &Array2<f32>, full: &Components, count: usize, tasks: &[usize]) -> f32 {
    let squares = errors_of_vertices(flat, full, count, tasks);
    squares.into_iter().fold(0.0, f32::max).sqrt()
}

/// The same for each vertex, squared. `tasks`: the first vertex of each group of
/// [`VERTICES_PER_TASK`] vertices to measure.
fn errors_of_vertices(
    flat: &Array2<f32>,
    full: &Components,
    count: usize,
    tasks: &[usize],
) -> Vec<f32> {
    let (frames, coordinates) = flat.dim();
    let weights = view(&full.weights).subcols(0, count);
    let errors_of = |&first: &usize| {
        let columns = 3 * VERTICES_PER_TASK.min(coordinates / 3 - first);
        let shapes = view(&full.shapes).subrows(3 * first, columns);
        let mut fitted = vec![0.0; frames * columns];
        if count > 0 {
            let shapes = shapes.subcols(0, count).transpose();
            product(view_mut(&mut fitted, columns), weights, shapes);
        }
        let mut longest = vec![0.0; columns / 3];
        let rows = matrix::values(flat).chunks_exact(coordinates);
        for (row, fitted) in rows.zip(fitted.chunks_exact(columns)) {
            raise_to_distance(&mut longest, &row[3 * first..3 * first + columns], fitted);
        }
        longest
    };
    tasks.par_iter().map(errors_of).flatten_iter().collect()
}

/// The sixteenth of `tasks` with the largest errors; `left` holds the errors of all their vertices.
fn worst_tasks(left: &[f32], tasks: &[usize]) -> Vec<usize> {
    let largest = |task: &[f32]| task.iter().copied().fold(0.0, f32::max);
    let errors = left.chunks(VERTICES_PER_TASK).map(largest);
    let mut ranked: Vec<(f32, usize)> = errors.zip(tasks.iter().copied()).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(tasks.len().div_ceil(16));
    ranked.into_iter().map(|(_, task)| task).collect()
}

/// Raises `longest` `[n]` to the squared distances between `there` and `fitted`, both `[n, 3]`.
fn raise_to_distance(longest: &mut [f32], there: &[f32], fitted: &[f32]) {
    let pairs = there.chunks_exact(3).zip(fitted.chunks_exact(3));
    for (longest, (a, b)) in longest.iter_mut().zip(pairs) {
        let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        *longest = longest.max(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    }
}

/// Scales the components so that the weights of each reach 1 or −1.
fn normalised(chosen: &Components, error: f32, vertices: usize, fps: f64) -> VertexBasis {
    let (frames, count) = chosen.weights.dim();
    let columns = chosen.weights.columns().into_iter();
    let largest = columns.map(|column| column.iter().fold(0.0f32, |m, w| m.max(w.abs())));
    let scale: Vec<f32> = largest.map(|m| if m > 0.0 { m } else { 1.0 }).collect();
    VertexBasis {
        shapes: Array3::from_shape_fn((count, vertices, 3), |(k, v, x)| {
            scale[k] * chosen.shapes[[3 * v + x, k]]
        }),
        weights: Array2::from_shape_fn((frames, count), |(t, k)| {
            (chosen.weights[[t, k]] / scale[k]).clamp(-1.0, 1.0)
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

    /// Many vertices move a little in many ways, which takes all shapes if the sum of errors counts.
    /// Few vertices move farther, each in its own way.
    #[test]
    fn a_small_part_with_motion_of_its_own_stays_within_the_bound() {
        let (frames, many, few, ways) = (160, 900, 8, 80);
        let noise = |seed: usize| {
            let x = (seed as f32 * 12.9898).sin() * 43_758.547;
            2.0 * (x - x.floor()) - 1.0
        };
        let of_way = |t: usize, way: usize| noise(1 + t * ways + way);
        let displacements = Array3::from_shape_fn((frames, many + few, 3), |(t, v, x)| {
            let coordinate = 3 * v + x;
            match v < many {
                true => (0..ways)
                    .map(|way| 0.02 * of_way(t, way) * noise(50_000 + coordinate * ways + way))
                    .sum(),
                false => 0.5 * noise(900_000 + t * 3 * (many + few) + coordinate),
            }
        });
        let clip = VertexClip {
            displacements,
            fps: 30.0,
        };
        let basis = compress(&clip, 0.35, 60, SILENT).unwrap();
        assert!(basis.max_error <= 0.35, "{}", basis.max_error);
        let unweighted = Reduced::new(&flat_of(&clip), 60, &[1.0; 908], SILENT).unwrap();
        let full = unweighted.components(&[1.0; 908]).unwrap();
        let all = tasks_of(&flat_of(&clip));
        assert!(largest_error(&flat_of(&clip), &full, 60, &all) > 0.35);
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
