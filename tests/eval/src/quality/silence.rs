//! How still the lips are when nobody speaks.

use serde::Serialize;

use super::{
    bootstrap::{estimate, median},
    clip::{Clip, gap_mm, rest_gap_mm},
    predictors::Performed,
    row::Row,
    scores::lips,
    speaker::{Speaker, Wish},
};
use crate::metrics::{self, quantile, rms_speeds, root_mean_square};
use anyface::{
    Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    mesh::ibug::LANDMARKS,
};

/// Pauses shorter than this do not count, seconds.
const PAUSE_S: f64 = 0.3;
/// Lips close after a word and open before the next, so this much at either end of a pause counts
/// neither as pause nor as speech, seconds.
const MARGIN_S: f64 = 0.1;
/// Level is measured in windows of this length, seconds.
const LEVEL_S: f64 = 0.05;
/// The limit of silence stays within these shares of the clip's loud level, its 95 % quantile:
/// −35 to −25 dB.
const SILENT_SHARE: (f64, f64) = (0.017_782_794, 0.056_234_133);
/// The limit of silence is this many times the clip's quiet level, its 10 % quantile.
const ABOVE_QUIET: f64 = 2.0;
/// Length of the digital silence, seconds.
const NOTHING_S: f64 = 4.0;
const NOTHING_FPS: f64 = 25.0;
const MM: f64 = 1000.0;

/// How the model moves the lips in four seconds of zeros.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct DigitalSilence {
    pub mm_per_s: f64,
    /// Mean distance of the lips from the neutral face.
    pub offset_mm: f64,
}

/// One clip: squared speeds in pauses and in speech, each as sum and count, and gaps above rest in
/// pauses, mm.
#[derive(Default)]
struct Record {
    gaps_mm: Vec<f64>,
    pause: (f64, f64),
    speech: (f64, f64),
    pauses_s: f64,
}

/// Measures all predictors on all sources. Clips without a pause are skipped.
pub(super) fn measure(performed: &[Performed]) -> Result<Vec<Row>> {
    let mut out = Vec::new();
    for source in performed {
        for (name, motions) in source.with_recording() {
            let records = motions
                .iter()
                .filter_map(|(clip, motion)| record(name, clip, motion.view()).transpose());
            let records: Vec<Record> = records.collect::<Result<_>>()?;
            if !records.is_empty() {
                out.push(score(&source.corpus.source, name, &records));
            }
        }
    }
    Ok(out)
}

fn score(source: &str, predictor: &str, records: &[Record]) -> Row {
    let rms = |of: &[&Record], part: fn(&Record) -> (f64, f64)| {
        let sums = of.iter().map(|r| part(r));
        let (sum, count) = sums.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (count > 0.0).then(|| (sum / count).sqrt())
    };
    let pause = |of: &[&Record]| rms(of, |r| r.pause);
    let speech = |of: &[&Record]| rms(of, |r| r.speech);
    let gap = |of: &[&Record]| median(of.iter().flat_map(|r| &r.gaps_mm).copied());
    let pauses_s: f64 = records.iter().map(|r| r.pauses_s).sum();
    Row::default()
        .with("source", "source", 0, source)
        .with("predictor", "predictor", 0, predictor)
        .with("clips", "clips", 0, records.len())
        .with("pauses_s", "pauses, s", 1, pauses_s)
        .with(
            "speech_mm_per_s",
            "speech, mm/s",
            1,
            estimate(records, speech),
        )
        .with(
            "pause_mm_per_s",
            "pauses, mm/s",
            1,
            estimate(records, pause),
        )
        .with("gap_mm", "gap, mm", 2, estimate(records, gap))
}

fn record(name: &str, clip: &Clip, motion: metrics::Clip<'_>) -> Result<Option<Record>> {
    let pauses = pauses(clip);
    if pauses.is_empty() {
        return Ok(None);
    }
    let face = clip.face(name);
    let (gap, rest) = (gap_mm(face, motion)?, rest_gap_mm(face)?);
    let region: Vec<usize> = (0..LANDMARKS).filter(|n| lips(*n)).collect();
    let mut out = Record {
        pauses_s: pauses.iter().map(|(from, to)| to - from).sum(),
        ..Record::default()
    };
    for (t, speed) in rms_speeds(motion, &region, clip.fps).iter().enumerate() {
        let (from, to) = (t as f64 / clip.fps, (t + 1) as f64 / clip.fps);
        let inside = |&(a, b): &(f64, f64)| from >= a + MARGIN_S && to <= b - MARGIN_S;
        let outside = |&(a, b): &(f64, f64)| to <= a || from >= b;
        let part = match (pauses.iter().any(inside), pauses.iter().all(outside)) {
            (true, _) => {
                out.gaps_mm.push(gap[t] - rest);
                &mut out.pause
            }
            (_, true) => &mut out.speech,
            _ => continue,
        };
        part.0 += (speed * MM).powi(2);
        part.1 += 1.0;
    }
    Ok((out.pause.1 > 0.0 && out.speech.1 > 0.0).then_some(out))
}

/// Start and end of each pause of a clip, seconds: by its phones, or by its level if it has none.
fn pauses(clip: &Clip) -> Vec<(f64, f64)> {
    let quiet = match &clip.phones {
        Some(phones) => {
            let spoken = phones.iter().filter(|p| !p.is_silence());
            let spoken: Vec<_> = spoken.map(|p| (p.from_s, p.to_s)).collect();
            between(&spoken, clip.waveform.duration_s())
        }
        None => below_level(&clip.waveform),
    };
    let long = |(from, to): &(f64, f64)| to - from >= PAUSE_S;
    quiet.into_iter().filter(long).collect()
}

/// The stretches from 0 to `end_s` that `spoken`, in order of time, leaves free.
fn between(spoken: &[(f64, f64)], end_s: f64) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let mut free_s = 0.0f64;
    for &(from, to) in spoken {
        out.push((free_s, from));
        free_s = free_s.max(to);
    }
    out.push((free_s, end_s));
    out
}

fn below_level(waveform: &Waveform) -> Vec<(f64, f64)> {
    let length = (LEVEL_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let level = |part: &[f32]| {
        let power: f64 = part.iter().map(|x| f64::from(*x).powi(2)).sum();
        (power / part.len() as f64).sqrt()
    };
    let levels: Vec<f64> = waveform.samples.chunks(length).map(level).collect();
    let loud = quantile(&levels, 0.95);
    let quiet = ABOVE_QUIET * quantile(&levels, 0.1);
    let limit = quiet.clamp(SILENT_SHARE.0 * loud, SILENT_SHARE.1 * loud);
    let at_s = |k: usize| k as f64 * LEVEL_S;
    let above = levels.iter().enumerate().filter(|(_, l)| **l >= limit);
    let above: Vec<_> = above.map(|(k, _)| (at_s(k), at_s(k + 1))).collect();
    between(&above, waveform.duration_s())
}

/// Measures the model's lips over the middle half of digital silence.
pub(super) fn nothing(speaker: &Speaker, wish: &Wish) -> Result<DigitalSilence> {
    let count = (NOTHING_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let waveform = Waveform {
        samples: vec![0.0; count],
    };
    let motion = speaker.perform(&waveform, NOTHING_FPS, wish)? * MM;
    let region: Vec<usize> = (0..LANDMARKS).filter(|n| lips(*n)).collect();
    let frames = motion.dim().0;
    let middle = motion.slice(ndarray::s![frames / 4..3 * frames / 4, .., ..]);
    let rest = ndarray::Array3::zeros(middle.dim());
    let of_lips = |clip: metrics::Clip<'_>| clip.select(ndarray::Axis(1), &region);
    Ok(DigitalSilence {
        mm_per_s: root_mean_square(&rms_speeds(middle, &region, NOTHING_FPS)),
        offset_mm: metrics::mean_vertex_error(of_lips(middle).view(), of_lips(rest.view()).view())?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quiet_stretch_between_tones_is_a_pause() {
        let samples = (0..32_000).map(|i| {
            if (8_000..16_000).contains(&i) {
                0.0001
            } else {
                (i as f32 * 0.3).sin()
            }
        });
        let quiet = below_level(&Waveform {
            samples: samples.collect(),
        });
        let longest = quiet
            .iter()
            .copied()
            .fold((0.0, 0.0), |best: (f64, f64), p| {
                if p.1 - p.0 > best.1 - best.0 { p } else { best }
            });
        assert!((longest.0 - 0.5).abs() < 1e-9 && (longest.1 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_spoken_is_free() {
        let free = between(&[(0.5, 1.0), (1.0, 1.2), (2.0, 2.5)], 3.0);
        assert_eq!(free, [(0.0, 0.5), (1.0, 1.0), (1.2, 2.0), (2.5, 3.0)]);
    }
}
