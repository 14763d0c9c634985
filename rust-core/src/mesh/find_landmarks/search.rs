//! Where on a mesh the face is, seen from the stated front.

use rayon::prelude::*;

use super::{
    depth_view::Window,
    network::LandmarkNetwork,
    view::{Frame, Look, look},
};
use crate::{mesh::canonical_landmarks, motion::LANDMARKS};

/// Half-size of the window on a face of human size, metres; the network was trained around it.
pub(super) const HALF_SIZE_M: f32 = 0.105;

/// Windows under the top of the mesh, as parts of its larger extent: a bust down to the head of
/// a body with its arms stretched out.
const TOP_WINDOWS: [f32; 6] = [0.5, 0.36, 0.26, 0.18, 0.13, 0.09];

/// Below this no picture shows a face.
const LEAST_SCORE: f32 = 0.15;

/// How far the landmarks of a face may lie from the mean ones in one picture, metres.
const SPREAD_M: f32 = 0.016;

/// A face found in one picture: a window that fits it.
pub(super) struct Seen {
    pub window: Window,
}

/// The mean landmarks laid over those of a look.
struct FlatFit {
    /// View units per canonical metre.
    scale: f32,
    /// View place of the mean of all canonical landmarks.
    centre: [f32; 2],
    /// Root mean square distance, metres.
    rms: f32,
}

/// Looks through all windows, then twice through the best.
pub(super) fn search(network: &LandmarkNetwork, frame: &Frame) -> Option<Seen> {
    let glance = |window: Window| {
        let look = look(network, &frame.points, frame.triangles, window);
        let fit = fit_flat(&look);
        (score(&look, &fit), fit)
    };
    let best = windows(frame)
        .into_par_iter()
        .map(glance)
        .collect::<Vec<_>>()
        .into_iter()
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let closer = glance(best.1.window());
    (closer.0 > LEAST_SCORE).then(|| Seen {
        window: closer.1.window(),
    })
}

impl FlatFit {
    fn window(&self) -> Window {
        Window {
            centre: self.centre,
            half_size: (HALF_SIZE_M * self.scale).max(1e-6),
        }
    }
}

/// The whole mesh, and windows under its top centred on what is there.
fn windows(frame: &Frame) -> Vec<Window> {
    let (low, high) = (frame.low, frame.high);
    let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-6);
    let whole = Window {
        centre: [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
        half_size: 0.53 * extent,
    };
    let under_top = TOP_WINDOWS.iter().map(|part| {
        let half_size = part * extent;
        let bottom = high[1] - 2.0 * half_size;
        let (mut sum, mut count) = (0.0, 0);
        for &v in frame.triangles.iter().flatten() {
            let p = frame.points[v as usize];
            if p[1] >= bottom {
                sum += f64::from(p[0]);
                count += 1;
            }
        }
        Window {
            centre: [
                (sum / f64::from(count.max(1))) as f32,
                high[1] - 0.95 * half_size,
            ],
            half_size,
        }
    });
    std::iter::once(whole).chain(under_top).collect()
}

/// Presence, confidence and shape in one number from 0 to 1.
fn score(look: &Look, fit: &FlatFit) -> f32 {
    let inner = &look.sight.confidence[17..];
    let confidence = inner.iter().sum::<f32>() / inner.len() as f32;
    let shape = (-(fit.rms / SPREAD_M).powi(2)).exp();
    look.sight.presence * confidence * shape
}

/// Least-squares similarity of the plane, as complex numbers: `view = a · canonical + b`.
fn fit_flat(look: &Look) -> FlatFit {
    let mean = canonical_landmarks();
    let weight = |i: usize| {
        if i < 17 {
            0.2
        } else {
            look.sight.confidence[i].max(1e-3)
        }
    };
    let total: f32 = (0..LANDMARKS).map(weight).sum();
    let centroid = |of: &dyn Fn(usize) -> [f32; 2]| -> [f32; 2] {
        std::array::from_fn(|k| (0..LANDMARKS).map(|i| weight(i) * of(i)[k]).sum::<f32>() / total)
    };
    let flat = |i: usize| [mean[i][0], mean[i][1]];
    let (from, to) = (centroid(&flat), centroid(&|i| look.points[i]));
    let (mut re, mut im, mut spread, mut spread_to) = (0.0, 0.0, 0.0, 0.0);
    for i in 0..LANDMARKS {
        let p = [flat(i)[0] - from[0], flat(i)[1] - from[1]];
        let q = [look.points[i][0] - to[0], look.points[i][1] - to[1]];
        re += weight(i) * (p[0] * q[0] + p[1] * q[1]);
        im += weight(i) * (p[0] * q[1] - p[1] * q[0]);
        spread += weight(i) * (p[0] * p[0] + p[1] * p[1]);
        spread_to += weight(i) * (q[0] * q[0] + q[1] * q[1]);
    }
    let (a, b) = (re / spread, im / spread);
    let scale = a.hypot(b).max(1e-9);
    let left = (spread_to - scale * scale * spread).max(0.0) / total;
    let all: [f32; 2] =
        std::array::from_fn(|k| (0..LANDMARKS).map(|i| flat(i)[k]).sum::<f32>() / LANDMARKS as f32);
    let d = [all[0] - from[0], all[1] - from[1]];
    FlatFit {
        scale,
        centre: [to[0] + a * d[0] - b * d[1], to[1] + b * d[0] + a * d[1]],
        rms: left.sqrt() / scale,
    }
}
