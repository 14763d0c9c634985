//! How networks that see so many frames at once perform a sound of any length.

use std::ops::Range;

/// Windows of equal length that overlap; where they do, results are cross-faded.
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
    /// The windows of a clip of `total` frames: one every `frames − overlap` frames, the last one flush
    /// with the end. A clip no longer than a window is one window, an empty clip none.
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
}
