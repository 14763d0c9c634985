//! Lips that meet, as more equations of a solve: where the motion closes them, that they are together counts more than
//! all else, so that shapes that only open a mouth rest there.

use ndarray::{Array1, Array2, ArrayView3, Axis, s};

use crate::mesh::ibug::{INNER_LIPS, LANDMARKS};

/// How much the gap counts in frames in which the lips are together, beside the whole face.
const WEIGHT: f64 = 3.0;
/// Lips are together below the first share of how far the mouth opens, and apart above the second.
const TOGETHER: f64 = 0.1;
const APART: f64 = 0.2;
/// The mouth opens as far as in this share of the frames at most.
const WIDE: f64 = 0.95;

/// Vertices of the upper and of the lower lip that meet; `vertices`: those nearest to the landmarks.
pub fn meeting_lips(vertices: &[u32; LANDMARKS]) -> Vec<[u32; 2]> {
    let pairs = INNER_LIPS.iter();
    let pairs = pairs.map(|(upper, lower)| [vertices[*upper], vertices[*lower]]);
    pairs.filter(|[upper, lower]| upper != lower).collect()
}

/// What a gap asks of the weights.
pub(super) struct Closures {
    /// `[S, S]`, products of the shapes' gaps.
    pub gram: Array2<f64>,
    /// `[T, S]`, those with the gap that is wanted.
    pub right: Array2<f64>,
    /// How much it counts in each frame, `[T]`, 0 where lips are apart.
    pub shares: Vec<f64>,
}

impl Closures {
    /// Of `of_shapes` `[S, 3 N]` and `of_frames` `[T, 3 N]`, [`gaps`] of the shapes and of the motion; `gram` `[S, S]` are
    /// products of whole shapes. `None` where the mouth does not open or no shape parts the lips.
    pub fn of(
        of_shapes: &Array2<f64>,
        of_frames: &Array2<f64>,
        gram: &Array2<f64>,
    ) -> Option<Closures> {
        let way = of_frames.sum_axis(Axis(0));
        let opening: Vec<f64> = of_frames
            .rows()
            .into_iter()
            .map(|row| row.dot(&way))
            .collect();
        let mut sorted = opening.clone();
        sorted.sort_by(f64::total_cmp);
        let wide = *sorted.get((WIDE * sorted.len() as f64) as usize)?;
        let gaps = of_shapes.dot(&of_shapes.t());
        let (all, own) = (gram.diag().sum(), gaps.diag().sum());
        if !(wide > 0.0 && all > 0.0 && own > 0.0 && (all / own).is_finite()) {
            return None;
        }
        let share = |open: &f64| {
            let x = ((APART - open / wide) / (APART - TOGETHER)).clamp(0.0, 1.0);
            WEIGHT * x * x * (3.0 - 2.0 * x)
        };
        Some(Closures {
            gram: &gaps * (all / own),
            right: of_frames.dot(&of_shapes.t()) * (all / own),
            shares: opening.iter().map(share).collect(),
        })
    }

    /// In another unit.
    pub fn divide(&mut self, unit: f64) {
        self.gram /= unit;
        self.right /= unit;
    }
}

/// How far the upper lip goes from the lower one, `[rows, 3 N]`. `lips`: `[N]` vertices of both that meet; `moved`: `[rows, V,
/// 3]`.
pub(crate) fn gaps(lips: &[[u32; 2]], moved: ArrayView3<'_, f32>) -> Array2<f64> {
    let mut out = Array2::zeros((moved.dim().0, 3 * lips.len()));
    for (row, mut out) in moved.outer_iter().zip(out.rows_mut()) {
        for (n, [upper, lower]) in lips.iter().enumerate() {
            let [upper, lower] = [upper, lower].map(|v| row.row(*v as usize));
            let apart: Array1<f64> = upper.mapv(f64::from) - lower.mapv(f64::from);
            out.slice_mut(s![3 * n..3 * n + 3]).assign(&apart);
        }
    }
    out
}
