//! The pitch of a voice over time.
//!
//! Runs steps 1 to 5 of YIN (de Cheveigné & Kawahara 2002) on the sound at 4 kHz. That is enough
//! for prosody and takes a sixteenth of the work. The crates that offer YIN are no longer
//! maintained, so this is our own code. Cost: 200 × 68 multiplications a frame, about a second for
//! an hour of sound.

use super::SAMPLE_RATE_HZ;

/// Frames per second of the prosody tracks.
pub const PROSODY_FPS: f64 = 100.0;
/// Samples from one frame to the next.
pub(super) const HOP: usize = SAMPLE_RATE_HZ as usize / PROSODY_FPS as usize;
/// Samples of the sound for each sample of the tracker.
const DECIMATION: usize = 4;
const RATE_HZ: f32 = 4000.0;
/// Lags for 500 Hz down to 59 Hz.
const LAGS: std::ops::RangeInclusive<usize> = 8..=68;
/// 50 ms: three periods of a low voice.
const WINDOW: usize = 200;
/// Step 4: de Cheveigné & Kawahara 2002 use 0.1 for clean speech, but rooms need more.
const APERIODICITY: f32 = 0.2;
/// Rough voices exceed `APERIODICITY` at every lag. Then the best lag counts if it is below this.
const ROUGH: f32 = 0.4;
/// Windows below −50 dB of full scale hold no voice.
const LEAST_POWER: f32 = 1e-5;

/// Pitch of each of `frames` hops of 10 ms, Hz; 0 where there is no voice.
pub(super) fn pitch_track(samples: &[f32], frames: usize) -> Vec<f32> {
    let coarse = decimated(samples);
    let needed = WINDOW + LAGS.end() + 1;
    (0..frames)
        .map(|t| {
            let middle = (t * HOP + HOP / 2) / DECIMATION;
            let start = middle.saturating_sub(needed / 2);
            match coarse.get(start..start + needed) {
                Some(piece) => pitch(piece).unwrap_or(0.0),
                None => 0.0,
            }
        })
        .collect()
}

/// Every fourth sample after three running means of four: zeros at 4 and 8 kHz, −36 dB above 3 kHz.
fn decimated(samples: &[f32]) -> Vec<f32> {
    const WEIGHTS: [f32; 10] = [1.0, 3.0, 6.0, 10.0, 12.0, 12.0, 10.0, 6.0, 3.0, 1.0];
    let last = samples.len() as isize - 1;
    (0..samples.len() / DECIMATION)
        .map(|i| {
            let from = (i * DECIMATION) as isize - 3;
            let at = |k: usize| samples[(from + k as isize).clamp(0, last) as usize];
            (0..10).map(|k| WEIGHTS[k] * at(k)).sum::<f32>() / 64.0
        })
        .collect()
}

/// The pitch of one piece, `WINDOW + 69` samples at 4 kHz.
fn pitch(piece: &[f32]) -> Option<f32> {
    let mean = piece.iter().sum::<f32>() / piece.len() as f32;
    let piece: Vec<f32> = piece.iter().map(|x| x - mean).collect();
    let power = piece.iter().map(|x| x * x).sum::<f32>() / piece.len() as f32;
    if power < LEAST_POWER {
        return None;
    }
    let normalised = difference(&piece);
    let (first, last) = (*LAGS.start(), *LAGS.end());
    let periodic = (first..last).find(|lag| normalised[*lag] < APERIODICITY);
    let rough = || {
        (first..last)
            .min_by(|a, b| normalised[*a].total_cmp(&normalised[*b]))
            .filter(|lag| normalised[*lag] < ROUGH)
    };
    let mut lag = periodic.or_else(rough)?;
    while lag < last && normalised[lag + 1] < normalised[lag] {
        lag += 1;
    }
    if lag == first || lag == last {
        return None;
    }
    Some(RATE_HZ / (lag as f32 + vertex(&normalised[lag - 1..=lag + 1])))
}

/// Per lag, the squared difference from the piece that much later, over its mean up to that lag:
/// steps 2 and 3.
fn difference(piece: &[f32]) -> Vec<f32> {
    let mut total = 0.0;
    let mut normalised = vec![1.0];
    for lag in 1..=*LAGS.end() {
        let pairs = piece[..WINDOW].iter().zip(&piece[lag..lag + WINDOW]);
        let squared: f32 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
        total += squared;
        normalised.push(squared * lag as f32 / total.max(f32::MIN_POSITIVE));
    }
    normalised
}

/// How far the lowest point of the parabola through three values is from the middle one: step 5.
fn vertex(values: &[f32]) -> f32 {
    let curve = values[0] - 2.0 * values[1] + values[2];
    if curve > 0.0 {
        (0.5 * (values[0] - values[2]) / curve).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn buzz(hz: f32) -> Vec<f32> {
        (0..16_000)
            .map(|i| {
                let t = i as f32 / 16_000.0;
                (1..8)
                    .map(|k| 0.2 * (std::f32::consts::TAU * hz * k as f32 * t).sin() / k as f32)
                    .sum()
            })
            .collect()
    }

    #[test]
    fn voices_of_men_women_and_children_are_found() {
        for hz in [80.0, 120.0, 210.0, 300.0, 380.0] {
            let track = pitch_track(&buzz(hz), 100);
            for t in 10..90 {
                let error = (track[t] / hz - 1.0).abs();
                assert!(error < 0.02, "{hz} Hz came out as {} Hz", track[t]);
            }
        }
    }

    #[test]
    fn noise_and_quiet_hums_have_no_pitch() {
        let mut state = 1u32;
        let noise: Vec<f32> = (0..16_000)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state as f32 / u32::MAX as f32 - 0.5
            })
            .collect();
        let voiced = pitch_track(&noise, 100)
            .iter()
            .filter(|hz| **hz > 0.0)
            .count();
        assert!(voiced < 5, "{voiced} of 100 frames");
        let quiet: Vec<f32> = buzz(120.0).iter().map(|x| 0.003 * x).collect();
        assert!(pitch_track(&quiet, 100).iter().all(|hz| *hz == 0.0));
    }
}
