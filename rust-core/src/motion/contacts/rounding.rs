//! Brings the lips forward where the sound says u, o, w and the like.

use ndarray::ArrayView2;

use crate::{
    Result,
    mesh::ibug::{CHIN, MOUTH},
    motion::{FaceModes, LandmarkClip},
    speech::LipRounding,
};

/// How far lips come forward in the roundest vowel, metres. It is the mean of facegood_zh's speaker
/// in frames of u, relative to where his jaw alone would draw the lips.
pub const ROUND_M: f32 = 3.3e-3;

/// Brings the lips of a clip forward where they are rounded, by as much `mouthPucker` as is missing.
///
/// # Errors
/// `Weights` for modes without `mouthPucker` or the jaw.
pub fn round_lips(
    clip: &mut LandmarkClip,
    rounding: &LipRounding,
    modes: &FaceModes,
) -> Result<()> {
    let (jaw, pucker) = (modes.mode("jawOpen")?, modes.mode("mouthPucker")?);
    let degrees = rounding.at_frames(clip.displacements.dim().0, clip.fps);
    for (mut face, degree) in clip.displacements.outer_iter_mut().zip(degrees) {
        let opening = face[[CHIN, 1]] / jaw[[CHIN, 1]];
        let forward_m = forward(face.view()) - opening * forward(jaw);
        let weight = shortfall(degree, forward_m) / forward(pucker);
        for n in MOUTH.filter(|_| weight > 0.0) {
            for axis in 0..3 {
                face[[n, axis]] += weight * pucker[[n, axis]];
            }
        }
    }
    Ok(())
}

/// How far lips that are `forward_m` metres forward fall short of a degree of rounding, metres.
pub fn shortfall(degree: f32, forward_m: f32) -> f32 {
    (degree * ROUND_M - forward_m.max(0.0)).max(0.0)
}

/// How far forward the lips of a frame `[68, 3]` are on average, metres.
pub fn forward(face: ArrayView2<'_, f32>) -> f32 {
    let sum: f32 = MOUTH.map(|n| face[[n, 2]]).sum();
    sum / MOUTH.len() as f32
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn rounded(clip: &mut LandmarkClip) {
        let mut degree = [0.0; 50];
        degree[20..30].fill(1.0);
        let modes = FaceModes::open(None).unwrap();
        round_lips(clip, &LipRounding::heard(degree.to_vec(), 25.0), &modes).unwrap();
    }

    #[test]
    fn lips_come_forward_slowly_and_no_farther_than_they_lack() {
        let still = LandmarkClip {
            displacements: Array3::zeros((100, 68, 3)),
            fps: 50.0,
        };
        let mut clip = still.clone();
        rounded(&mut clip);
        let at: Vec<f32> = clip
            .displacements
            .outer_iter()
            .map(|face| forward(face))
            .collect();
        assert!((at[50] - ROUND_M).abs() < 1e-5 && at[0] == 0.0 && at[99] == 0.0);
        let fastest = at
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).abs())
            .fold(0.0, f32::max);
        assert!(fastest < 0.06 / 50.0, "{fastest}");
        let width = |t: usize| clip.displacements[[t, 54, 0]] - clip.displacements[[t, 48, 0]];
        assert!((-5e-3..-2e-3).contains(&width(50)));
        let before = clip.clone();
        rounded(&mut clip);
        let change = &clip.displacements - &before.displacements;
        assert!(change.iter().all(|by| by.abs() < 1e-6));
    }
}
