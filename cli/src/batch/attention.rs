//! Decides which rows a person should look at, and why.

use super::ledger::Entry;

/// From these values on a person should look at the row: seconds with open lips in silence, seconds
/// of speech in which the lips stay closed, and millimetres a second.
const SILENT_OPEN_S: f64 = 0.3;
const STILL_S: f64 = 1.0;
const FAST_MM_S: f32 = 350.0;
/// A line counts as slow if it takes this many times what lines usually take for a second of sound,
/// and more than `SLOW_S` seconds in all.
const SLOW: f64 = 6.0;
const SLOW_S: f64 = 2.0;

/// How much a row needs a human eye, and why. Rows with larger numbers come first. `usual`: the
/// median seconds of work for a second of sound.
pub fn attention(entry: &Entry, usual: f64) -> (f64, Vec<String>) {
    let mut reasons = Vec::new();
    let mut sum = 0.0;
    let mut say = |weight: f64, reason: String| {
        sum += weight;
        reasons.push(reason);
    };
    if !entry.ok {
        say(1000.0, "failed".to_owned());
    }
    if !entry.warnings.is_empty() {
        let count = entry.warnings.len();
        say(100.0 + count as f64, "warnings".to_owned());
    }
    let lips = entry.lips.unwrap_or_default();
    if lips.silent_open_s >= SILENT_OPEN_S {
        let weight = 50.0 + 20.0 * lips.silent_open_s.min(2.0);
        say(
            weight,
            format!("lips are open for {:.1} s of silence", lips.silent_open_s),
        );
    }
    if lips.still_s >= STILL_S {
        let weight = 50.0 + 20.0 * lips.still_s.min(2.0);
        say(
            weight,
            format!("lips do not part in {:.1} s of speech", lips.still_s),
        );
    }
    if lips.fastest_mm_s >= FAST_MM_S {
        let weight = 30.0 * f64::from(lips.fastest_mm_s / FAST_MM_S).min(3.0);
        say(
            weight,
            format!("lips move at {:.0} mm/s", lips.fastest_mm_s),
        );
    }
    let usual_s = usual * entry.duration_s;
    if entry.ok && entry.seconds > SLOW_S && entry.seconds > SLOW * usual_s {
        say(10.0, format!("slow: {:.1} s", entry.seconds));
    }
    // Among rows without a reason, those with faster lips come first.
    sum += f64::from(lips.fastest_mm_s / FAST_MM_S).min(1.0);
    ((100.0 * sum).round() / 100.0, reasons)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::lips::{Gap, LipMotion};
    use anyface::audio::Waveform;

    /// Two seconds, of which the second is spoken.
    fn sound() -> Waveform {
        let voice = |i: usize| (i as f32 * 0.08).sin() * 0.5;
        let samples = (0..32_000).map(|i| if i < 16_000 { 0.0 } else { voice(i) });
        Waveform {
            samples: samples.collect(),
        }
    }

    fn gap(at: impl Fn(usize) -> f32) -> Gap {
        Gap {
            fps: 30.0,
            values: (0..60).map(at).collect(),
        }
    }

    #[test]
    fn lips_that_talk_while_somebody_speaks_need_no_eye() {
        let talking = gap(|t| {
            if t < 28 {
                0.0
            } else {
                3.0 + 3.0 * (t as f32).sin()
            }
        });
        let lips = LipMotion::of(&talking, &sound());
        assert_eq!(lips.silent_open_s, 0.0);
        assert!(lips.still_s < 0.2, "{lips:?}");
        let entry = Entry {
            ok: true,
            lips: Some(lips),
            ..Entry::default()
        };
        assert_eq!(attention(&entry, 1.0).1, Vec::<String>::new());
    }

    #[test]
    fn what_is_odd_is_said_in_words_and_comes_first() {
        let lips = |gap: Gap| Some(LipMotion::of(&gap, &sound()));
        let row = |lips, ok| Entry {
            ok,
            lips,
            ..Entry::default()
        };
        let babbling = row(lips(gap(|_| 6.0)), true);
        let dumb = row(lips(gap(|_| 0.0)), true);
        let jumping = row(lips(gap(|t| if t == 45 { 20.0 } else { 3.0 })), true);
        let failed = row(None, false);
        for (entry, words) in [
            (&babbling, "open for 0.7 s of silence"),
            (&dumb, "do not part in 1.0 s"),
            (&jumping, "mm/s"),
            (&failed, "failed"),
        ] {
            let (_, reasons) = attention(entry, 1.0);
            assert!(reasons.concat().contains(words), "{reasons:?}");
        }
        assert!(attention(&failed, 1.0).0 > attention(&dumb, 1.0).0);
        assert!(attention(&dumb, 1.0).0 > attention(&jumping, 1.0).0);
    }
}
