//! Runs networks that take windows of a fixed length on a sound of any length.

use std::ops::Range;

use ndarray::Array2;

use crate::Result;

/// Windows of equal length that overlap. Where they overlap, results are cross-faded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Windows {
    /// Frames per second.
    pub fps: f64,
    /// Frames of a window.
    pub frames: usize,
    /// Frames that neighbouring windows share, fewer than [`Windows::frames`].
    pub overlap: usize,
}

impl Windows {
    /// The windows of a clip of `total` frames: one every `frames − overlap` frames, the last one
    /// flush with the end. A clip no longer than a window is one window, an empty clip none.
    pub fn of(&self, total: usize) -> Vec<Range<usize>> {
        let Windows {
            frames, overlap, ..
        } = *self;
        match total {
            0 => Vec::new(),
            _ if total <= frames => std::iter::once(0..total).collect(),
            _ => (0..total - frames)
                .step_by(frames - overlap)
                .chain([total - frames])
                .map(|start| start..start + frames)
                .collect(),
        }
    }

    /// Makes a clip `[total, channels]` window by window. Where windows overlap, it averages their
    /// results with the weights of a ramp. `make` gets the frames of a window and its range of the
    /// progress, and returns `[frames, channels]`.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn cross_faded(
        &self,
        total: usize,
        channels: usize,
        mut make: impl FnMut(Range<usize>, (f32, f32)) -> Result<Array2<f32>>,
    ) -> Result<Array2<f32>> {
        let mut out = Array2::zeros((total, channels));
        let mut weight = vec![0.0f32; total];
        let windows = self.of(total);
        for (index, rows) in windows.iter().enumerate() {
            let part = |index: usize| index as f32 / windows.len() as f32;
            let values = make(rows.clone(), (part(index), part(index + 1)))?;
            for (t, row) in rows.clone().zip(values.rows()) {
                let share = ramp(t, rows, total, self.overlap);
                out.row_mut(t).scaled_add(share, &row);
                weight[t] += share;
            }
        }
        for (mut row, weight) in out.rows_mut().into_iter().zip(weight) {
            row /= weight;
        }
        Ok(out)
    }
}

/// Weight of frame `t` in a window. It rises and falls over the overlap and is 1 at the clip's own
/// ends.
fn ramp(t: usize, rows: &Range<usize>, frames: usize, overlap: usize) -> f32 {
    let side = |inner: usize, at_end: bool| {
        if at_end {
            1.0
        } else {
            ((inner + 1) as f32 / (overlap + 1) as f32).min(1.0)
        }
    };
    let left = side(t - rows.start, rows.start == 0);
    left.min(side(rows.end - 1 - t, rows.end == frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_comes_back_whatever_the_windows() {
        for (frames, window, overlap) in [
            (1, 32, 8),
            (32, 32, 8),
            (33, 32, 8),
            (71, 32, 8),
            (500, 32, 0),
        ] {
            let windows = Windows {
                fps: 25.0,
                frames: window,
                overlap,
            };
            let make = |rows: Range<usize>, _| {
                assert!(rows.len() <= window);
                Ok(Array2::from_elem((rows.len(), 2), 3.0))
            };
            let clip = windows.cross_faded(frames, 2, make).unwrap();
            assert!(clip.iter().all(|x| (x - 3.0).abs() < 1e-6), "{frames}");
            assert!(windows.of(0).is_empty());
        }
    }
}
