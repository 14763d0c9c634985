//! Liveliness of a voice, measured by how far its pitch moves.

use crate::audio::Prosody;

/// Bounds for the range of the syllables' pitch, from its 10th to its 90th percentile, semitones.
/// Up to the first bound a voice counts as a calm reading, from the second on as fully lively.
const RANGE: (f64, f64) = (8.0, 11.0);
/// A pitch this far from the median is an octave error of the tracker, semitones.
const FAR: f64 = 11.5;
/// A few syllables are weak evidence. The result is as if this many more syllables had been calm.
const DOUBT: f64 = 4.0;

/// The liveliness: 0 for a calm reading, 1 for lively speech, 0 where nobody speaks.
pub(super) fn liveliness(prosody: &Prosody) -> f64 {
    let mut pitches: Vec<f64> = prosody
        .nuclei
        .iter()
        .map(|t| highest_hz(prosody, *t))
        .filter(|hz| *hz > 0.0)
        .map(|hz| 12.0 * hz.log2())
        .collect();
    pitches.sort_by(f64::total_cmp);
    if let Some(median) = pitches.get(pitches.len() / 2).copied() {
        pitches.retain(|pitch| (pitch - median).abs() < FAR);
    }
    let Some(last) = pitches.len().checked_sub(1) else {
        return 0.0;
    };
    let at = |share: f64| pitches[(share * last as f64).round() as usize];
    let count = pitches.len() as f64;
    let lively = (at(0.9) - at(0.1) - RANGE.0) / (RANGE.1 - RANGE.0);
    count / (count + DOUBT) * lively.clamp(0.0, 1.0)
}

/// Highest pitch within 50 ms of a nucleus.
fn highest_hz(prosody: &Prosody, frame: usize) -> f64 {
    let end = (frame + 6).min(prosody.pitch_hz.len());
    let near = &prosody.pitch_hz[frame.saturating_sub(5)..end];
    f64::from(near.iter().copied().fold(0.0, f32::max))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::phrases::tests::speaking;

    #[test]
    fn a_calm_voice_is_not_lively_and_one_whose_pitch_leaps_is() {
        let calm = speaking(30, 60);
        assert_eq!(liveliness(&calm), 0.0);
        let mut lively = calm.clone();
        let stressed = |hz: &mut f32| *hz = if *hz > 120.0 { 210.0 } else { *hz };
        lively.pitch_hz.iter_mut().for_each(stressed);
        assert!(liveliness(&lively) > 0.9);
        let mut silent = calm;
        silent.nuclei.clear();
        assert_eq!(liveliness(&silent), 0.0);
    }
}
