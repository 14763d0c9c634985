//! Measures the time and memory that it takes to turn speech into landmark motion.

use serde::Serialize;

use super::{
    clip::Clip,
    speaker::{Speaker, Wish},
};
use crate::metrics::quantile;
use crate::stopwatch::{Stopwatch, forget_peak, peak_mib};
use anyface::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
};

const FPS: f64 = 30.0;
const SHORT_S: f64 = 5.0;
/// Runs of the short sound.
const RUNS: usize = 5;
const LONG_S: [f64; 3] = [60.0, 300.0, 1200.0];

/// Time and memory for one length of sound.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Timed {
    pub sound_s: f64,
    /// Speech encoder and denoiser together, processor time of all threads; see [`Stopwatch`].
    pub work_s: f64,
    /// The same in wall-clock time.
    pub elapsed_s: f64,
    /// Peak memory of the process during this run, MiB, where the system reports it.
    pub peak_mib: Option<f64>,
}

/// All runs, and the line through them.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Timing {
    pub threads: usize,
    pub runs: Vec<Timed>,
    /// Seconds of work per second of sound, and fixed seconds of work: least squares over the runs.
    pub line: Option<[f64; 2]>,
}

/// Times 5 seconds of sound; with `long` also 1, 5 and 20 minutes.
pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[Clip],
    long: bool,
) -> Result<Timing> {
    let samples = clips.iter().flat_map(|c| &c.waveform.samples);
    let spoken: Vec<f32> = samples.copied().collect();
    if spoken.is_empty() {
        return Err(Error::InvalidInput(
            "expected sound to time, got none".into(),
        ));
    }
    let mut runs = vec![short(speaker, wish, &spoken)?];
    for seconds in LONG_S.into_iter().filter(|_| long) {
        runs.push(time(speaker, wish, &spoken, seconds)?);
    }
    Ok(Timing {
        threads: rayon::current_num_threads(),
        line: line(&runs),
        runs,
    })
}

fn short(speaker: &Speaker, wish: &Wish, spoken: &[f32]) -> Result<Timed> {
    let runs: Vec<Timed> = (0..RUNS)
        .map(|_| time(speaker, wish, spoken, SHORT_S))
        .collect::<Result<_>>()?;
    let elapsed: Vec<f64> = runs.iter().map(|run| run.elapsed_s).collect();
    Ok(Timed {
        // A single run is too short for the system's count of processor time: take the mean.
        work_s: runs.iter().map(|run| run.work_s).sum::<f64>() / RUNS as f64,
        elapsed_s: quantile(&elapsed, 0.5),
        ..runs[RUNS - 1]
    })
}

fn time(speaker: &Speaker, wish: &Wish, spoken: &[f32], sound_s: f64) -> Result<Timed> {
    let count = (sound_s * f64::from(SAMPLE_RATE_HZ)) as usize;
    let waveform = Waveform {
        samples: spoken.iter().copied().cycle().take(count).collect(),
    };
    forget_peak();
    let stopwatch = Stopwatch::start();
    speaker.perform(&waveform, FPS, wish)?;
    Ok(Timed {
        sound_s,
        work_s: stopwatch.work_s(),
        elapsed_s: stopwatch.elapsed_s(),
        peak_mib: peak_mib(),
    })
}

/// Slope and offset; `None` for fewer than three runs.
fn line(runs: &[Timed]) -> Option<[f64; 2]> {
    let count = runs.len() as f64;
    let mean = |of: fn(&Timed) -> f64| runs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|r| r.sound_s), mean(|r| r.work_s));
    let along = runs.iter().map(|r| (r.sound_s - x) * (r.work_s - y));
    let power: f64 = runs.iter().map(|r| (r.sound_s - x).powi(2)).sum();
    let slope = along.sum::<f64>() / power;
    (runs.len() > 2).then_some([slope, y - slope * x])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found() {
        let runs = [1.0, 2.0, 5.0].map(|sound_s| Timed {
            sound_s,
            work_s: 0.5 + 0.1 * sound_s,
            elapsed_s: 1.0,
            peak_mib: None,
        });
        let [slope, offset] = line(&runs).unwrap();
        assert!((slope - 0.1).abs() < 1e-12 && (offset - 0.5).abs() < 1e-12);
        assert!(line(&runs[..2]).is_none());
    }
}
