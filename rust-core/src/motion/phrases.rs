//! Phrases of a sound: the speech between two pauses.

use crate::audio::{PROSODY_FPS, Prosody};

/// How long activity takes to rise before a phrase, and to fall after it, seconds.
const RAMP_S: f64 = 0.45;

/// A stretch of speech between pauses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phrase {
    /// When the voice begins, seconds.
    pub(super) start_s: f64,
    /// When the voice ends, seconds.
    pub(super) end_s: f64,
    /// Length of the silence before the phrase, seconds.
    pub(super) pause_s: f64,
}

/// Phrases in rising order.
#[derive(Debug, Clone, Default)]
pub(super) struct Phrases(pub(super) Vec<Phrase>);

impl Phrases {
    /// The stretches between pauses that contain a syllable. A sound without a voice has none.
    pub(super) fn of(prosody: &Prosody) -> Self {
        let last = prosody.level_db.len();
        let ends = prosody.pauses.iter().map(|pause| (pause.start, pause.end));
        let mut phrases: Vec<Phrase> = Vec::new();
        let mut from = 0;
        for (end, next) in ends.chain([(last, last)]) {
            let is_spoken = prosody.nuclei.iter().any(|t| (from..end).contains(t));
            if is_spoken {
                let start_s = from as f64 / PROSODY_FPS;
                let before_s = phrases.last().map_or(0.0, |phrase| phrase.end_s);
                phrases.push(Phrase {
                    start_s,
                    end_s: end as f64 / PROSODY_FPS,
                    pause_s: start_s - before_s,
                });
            }
            from = next;
        }
        Phrases(phrases)
    }

    /// Fades from the value of one phrase to that of the next within `change_s` seconds, centred on
    /// the start of the next phrase. `before` is the value before the first phrase. `values` has
    /// one value per phrase.
    pub(super) fn between(&self, values: &[f64], before: f64, change_s: f64, time_s: f64) -> f64 {
        let ends = |phrase: &Phrase| phrase.start_s + 0.5 * change_s <= time_s;
        let done = self.0.partition_point(ends);
        let of = |count: usize| count.checked_sub(1).map_or(before, |k| values[k]);
        let mut value = of(done);
        for (k, phrase) in self.0.iter().enumerate().skip(done) {
            let share = smooth_step((time_s - phrase.start_s) / change_s + 0.5);
            if share == 0.0 {
                break;
            }
            value += share * (of(k + 1) - of(k));
        }
        value
    }

    /// 1 while somebody speaks, 0 in pauses, smooth in between.
    pub(super) fn activity(&self, time_s: f64) -> f64 {
        let next = self.0.partition_point(|phrase| phrase.end_s < time_s);
        let near = self.0[next.saturating_sub(1)..].iter().take(2);
        near.map(|phrase| {
            let before_s = phrase.start_s - time_s;
            let after_s = time_s - phrase.end_s;
            smooth_step(1.0 - before_s.max(after_s) / RAMP_S)
        })
        .fold(0.0, f64::max)
    }
}

/// 0 below 0, 1 above 1, and a smooth rise in between.
pub(super) fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::audio::Waveform;

    /// A voice of four syllables a second, every fourth of them stressed. It pauses for `pause`
    /// frames at the end of every three seconds.
    pub(in crate::motion) fn speaking(seconds: usize, pause: usize) -> Prosody {
        let frames = 100 * seconds;
        let is_pause = |t: usize| t % 300 >= 300 - pause;
        let mut prosody = Prosody::of(&Waveform {
            samples: vec![0.0; 160 * frames],
        });
        prosody.nuclei = (5..frames).step_by(25).filter(|t| !is_pause(*t)).collect();
        for (k, &t) in prosody.nuclei.iter().enumerate() {
            let stressed = k % 4 == 0;
            prosody.level_db[t] = if stressed { -12.0 } else { -20.0 };
            prosody.pitch_hz[t] = if stressed { 140.0 } else { 110.0 };
        }
        prosody.pauses = (0..frames / 300)
            .map(|k| 300 * (k + 1) - pause..300 * (k + 1))
            .collect();
        prosody
    }

    #[test]
    fn phrases_lie_between_pauses_and_activity_follows_them() {
        let phrases = Phrases::of(&speaking(9, 100));
        assert_eq!(phrases.0.len(), 3);
        let second = phrases.0[1];
        assert_eq!(
            (second.start_s, second.end_s, second.pause_s),
            (3.0, 5.0, 1.0)
        );
        assert_eq!(phrases.activity(4.0), 1.0);
        assert_eq!(phrases.activity(2.5), 0.0);
        assert!((0.2..0.8).contains(&phrases.activity(2.8)));
        assert!((0.2..0.8).contains(&phrases.activity(5.2)));
    }

    #[test]
    fn silence_has_no_phrase() {
        let silence = Prosody::of(&Waveform {
            samples: vec![0.0; 16_000],
        });
        let phrases = Phrases::of(&silence);
        assert!(phrases.0.is_empty() && phrases.activity(0.5) == 0.0);
    }
}
