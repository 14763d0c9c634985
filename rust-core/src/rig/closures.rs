//! Adds equations to a solve so that lips meet. Where the motion closes the lips, their gap counts
//! more than all else. So shapes that only open the mouth stay at 0 there.

use ndarray::{Array1, Array2, ArrayView3, Axis, s};

use crate::mesh::ibug::{INNER_LIPS, LANDMARKS};

/// Weight of the gap against the whole face in frames with closed lips.
const WEIGHT: f64 = 3.0;
/// Lips count as closed below this share of the widest opening.
const TOGETHER: f64 = 0.1;
/// Lips count as open above this share of the widest opening.
const APART: f64 = 0.2;
/// The widest opening is this quantile of the frames' openings.
const WIDE: f64 = 0.95;

/// Pairs of an upper and a lower lip vertex that meet. `vertices`: the vertex nearest to each
/// landmark.
pub fn meeting_lips(vertices: &[u32; LANDMARKS]) -> Vec<[u32; 2]> {
    let pairs = INNER_LIPS.iter();
    let pairs = pairs.map(|(upper, lower)| [vertices[*upper], vertices[*lower]]);
    pairs.filter(|[upper, lower]| upper != lower).collect()
}

/// Equations for the weights that come from the gap between the lips.
pub(super) struct Closures {
    /// `[S, S]`, products of the shapes' gaps.
    pub gram: Array2<f64>,
    /// `[T, S]`, products of the motion's gap with the shapes' gaps.
    pub right: Array2<f64>,
    /// Weight in each frame, `[T]`; 0 where the lips are open.
    pub shares: Vec<f64>,
}

impl Closures {
    /// Makes the equations. `of_shapes` `[S, 3 N]` and `of_frames` `[T, 3 N]`: [`gaps`] of the
    /// shapes and of the motion. `gram` `[S, S]`: products of whole shapes. `None` if the mouth
    /// does not open or no shape parts the lips.
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
        let (all, of_lips) = (gram.diag().sum(), gaps.diag().sum());
        if !(wide > 0.0 && all > 0.0 && of_lips > 0.0 && (all / of_lips).is_finite()) {
            return None;
        }
        let share = |open: &f64| {
            let x = ((APART - open / wide) / (APART - TOGETHER)).clamp(0.0, 1.0);
            WEIGHT * x * x * (3.0 - 2.0 * x)
        };
        Some(Closures {
            gram: &gaps * (all / of_lips),
            right: of_frames.dot(&of_shapes.t()) * (all / of_lips),
            shares: opening.iter().map(share).collect(),
        })
    }

    /// Divides both sides of the equations by `unit`.
    pub fn divide(&mut self, unit: f64) {
        self.gram /= unit;
        self.right /= unit;
    }
}

/// Motion of the upper lip relative to the lower one, `[rows, 3 N]`. `lips`: `[N]` pairs of
/// vertices that meet. `moved`: `[rows, V, 3]`.
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
