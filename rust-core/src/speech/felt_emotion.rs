//! The feeling that is heard in a voice as emotion over time, for every system.

use ndarray::{Array2, Axis, s};

use super::feeling::{FeelingEncoder, FeltVoice};
use crate::conditions::{EMOTIONS, Emotion, EmotionCurve};

/// How sure a feeling must be before anything is shown. Set on the held-out recordings of four readers, of
/// which 98 of 100 then stay under an intensity of 0.05.
const CERTAINTY: f64 = 0.8;
/// Weight of the whole sound beside that of the moment.
const WHOLE_SHARE: f64 = 0.5;
/// Instants before and after that are heard with one, about a second.
const AROUND: usize = 6;

impl FeelingEncoder {
    /// What is felt in a voice: nothing where it is not told with certainty, and nothing of what was not
    /// taught. A sound shorter than 0.8 s is neutral.
    ///
    /// The probabilities of an instant are the mean of those a second about it and of the whole sound. What
    /// speaks against neutral counts from a certainty of 0.8, with which it begins, to 1, where it is shown
    /// in full. The mixture is the squares of the other probabilities, so that a doubt between two feelings
    /// seldom shows both. The rule is ours.
    pub fn emotion(&self, voice: &FeltVoice) -> EmotionCurve {
        let (times_s, shares) = self.instants(voice);
        let Some(whole) = shares.mean_axis(Axis(0)) else {
            return EmotionCurve::default();
        };
        let near = |k: usize| {
            let around = s![
                k.saturating_sub(AROUND)..(k + AROUND + 1).min(times_s.len()),
                ..
            ];
            shares.slice(around).mean_axis(Axis(0)).expect("an instant")
        };
        let key = |(k, time_s): (usize, &f64)| {
            let heard = WHOLE_SHARE * &whole + (1.0 - WHOLE_SHARE) * near(k);
            (*time_s, shown(&self.by_emotion(&heard.to_vec())))
        };
        EmotionCurve::Keys(times_s.iter().enumerate().map(key).collect())
    }

    /// Probabilities of the taught feelings as those of [`EMOTIONS`].
    fn by_emotion(&self, heard: &[f64]) -> [f64; EMOTIONS.len()] {
        let mut shares = [0.0; EMOTIONS.len()];
        for (name, share) in self.feelings().iter().zip(heard) {
            let place = EMOTIONS.iter().position(|known| known == name);
            shares[place.expect("checked when it was loaded")] = *share;
        }
        shares
    }

    /// The middle of what each instant hears, seconds, and the probabilities of the feelings, `[I, feelings]`.
    fn instants(&self, voice: &FeltVoice) -> (Vec<f64>, Array2<f64>) {
        let heard = self.of_numbers(&voice.numbers());
        let shares = heard.slice(s![.., heard.ncols() - self.feelings().len()..]);
        (
            (0..heard.nrows()).map(FeltVoice::middle_s).collect(),
            shares.to_owned(),
        )
    }
}

/// Probabilities of [`EMOTIONS`], of which the first is neutral, as what a face shows of them; see
/// [`FeelingEncoder::emotion`].
pub(super) fn shown(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    let felt: f64 = shares[1..].iter().sum();
    let intensity = ((felt - CERTAINTY) / (1.0 - CERTAINTY)).clamp(0.0, 1.0) as f32;
    if intensity == 0.0 {
        return Emotion::default();
    }
    let mut strength = shares.map(|share| share * share);
    strength[0] = 0.0;
    let sum: f64 = strength.iter().sum();
    Emotion {
        mixture: strength.map(|x| (x / sum) as f32),
        intensity,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::Waveform;

    fn encoder() -> FeelingEncoder {
        FeelingEncoder::open(None).unwrap()
    }

    fn sure_of(encoder: &FeelingEncoder, feeling: &str, share: f64) -> Emotion {
        let known = encoder.feelings();
        let rest = (1.0 - share) / (known.len() - 1) as f64;
        let told = |name: &String| if name == feeling { share } else { rest };
        shown(&encoder.by_emotion(&known.iter().map(told).collect::<Vec<_>>()))
    }

    #[test]
    fn only_what_is_certain_and_taught_is_shown() {
        let encoder = encoder();
        assert_eq!(sure_of(&encoder, "neutral", 0.21), Emotion::default());
        let angry = sure_of(&encoder, "angry", 0.97);
        let place = EMOTIONS.iter().position(|name| *name == "angry").unwrap();
        assert!(
            angry.mixture[place] > 0.99 && angry.intensity > 0.9,
            "{angry:?}"
        );
        assert!((angry.mixture.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        for (name, share) in EMOTIONS.iter().zip(angry.mixture) {
            assert!(encoder.feelings().iter().any(|known| known == name) || share == 0.0);
        }
    }

    #[test]
    fn silence_and_short_sounds_are_neutral() {
        let encoder = encoder();
        let of = |count: usize| Waveform {
            samples: (0..count).map(|i| (i as f32 * 0.08).sin()).collect(),
        };
        let short = encoder.emotion(&FeltVoice::of(&of(8_000)));
        assert_eq!(short, EmotionCurve::default());
        let keys = encoder.emotion(&FeltVoice::of(&of(48_000)));
        let EmotionCurve::Keys(keys) = keys else {
            panic!("expected keys, got {keys:?}")
        };
        assert!(keys.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert!(
            keys.iter()
                .all(|(_, emotion)| (0.0..=1.0).contains(&emotion.intensity))
        );
    }
}
