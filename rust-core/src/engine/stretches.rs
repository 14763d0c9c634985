//! Handles sounds of any length. It analyses and performs them one stretch at a time, so that a
//! night of speech needs no more memory than minutes of it.
//!
//! A sound longer than [`WHOLE_S`] is cut about every five minutes, where it is quietest.
//! Neighbouring stretches overlap by two seconds. Over the second in the middle of the overlap, the
//! motion of one stretch fades into the motion of the next. What is otherwise measured over the
//! whole sound, its loudness and the colour of the voice, is measured over each stretch.

use std::ops::Range;

use super::{Engine, Performance};
use crate::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, SoundFile, WHOLE_S},
    job::{Progress, ProgressFn},
    motion::{Life, Motion, MotionRequest, Stretch},
    speech::{HeardEmotion, Script, frames_of},
    spread::Movement,
};

/// Approximate length of a stretch.
const STRETCH_S: f64 = 300.0;
/// How far to either side of its nominal place a cut looks for quiet.
const AROUND_S: f64 = 30.0;
/// Length of sound that two neighbouring stretches share.
const OVERLAP_S: f64 = 2.0;
/// The seeds of two neighbouring stretches are so far apart.
const SEEDS: u64 = 1 << 32;
/// One motion fades into the next over this time, in the middle of the overlap.
const BLEND_S: f64 = 1.0;
/// A cut looks for this many consecutive quiet hops of 10 ms.
const QUIET_HOPS: usize = 100;
/// Length of a hop of [`SoundFile::energies`], seconds.
const HOP_S: f64 = 0.01;

/// A part of a long performance.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its motion.
    pub motion: Motion,
    /// Head, eyes and tongue, with as many frames as the motion.
    pub life: Life,
    /// The emotion heard in these frames, with times in seconds of the whole sound. `None` in the
    /// same cases as `Performance::heard_emotion`.
    pub heard_emotion: Option<HeardEmotion>,
}

impl<'a> From<&'a Part> for Movement<'a> {
    fn from(part: &'a Part) -> Movement<'a> {
        Movement::Motion(&part.motion).with_tongue(&part.life)
    }
}

impl Part {
    /// A part that holds a whole performance, which begins at frame `first` of the sound.
    fn of(performance: Performance, first: usize) -> Part {
        let start_s = first as f64 / performance.motion.fps();
        let heard = performance.heard_emotion();
        Part {
            heard_emotion: heard.map(|heard| heard.clone().later(start_s)),
            motion: performance.motion,
            life: performance.life,
        }
    }

    /// Some rows of a part, which begins at frame `first` of the sound.
    fn rows(&self, rows: Range<usize>, first: usize) -> Part {
        let second = |row: usize| (first + row) as f64 / self.motion.fps();
        let span_s = second(rows.start)..second(rows.end);
        let heard = self.heard_emotion.as_ref();
        Part {
            heard_emotion: heard.map(|heard| heard.between(span_s)),
            motion: self.motion.frames_of(rows.clone()),
            life: self.life.frames_of(rows),
        }
    }
}

impl Engine {
    /// Performs a sound of any length, and hands over the motion part by part, in order. A sound of
    /// at most [`WHOLE_S`] is performed whole, as by [`Engine::perform`]; a longer one, one stretch
    /// at a time. All parts together have one frame for every `1 / fps` seconds of sound or part
    /// thereof.
    ///
    /// `take` gets a part, and a function to report its progress as a share of the whole.
    ///
    /// # Errors
    /// Those of [`Engine::perform`] and of `take`.
    pub fn perform_in_parts(
        &self,
        sound: SoundFile,
        request: &MotionRequest,
        take: &mut dyn FnMut(Part, ProgressFn<'_>) -> Result<()>,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let duration_s = sound.levels.duration_s();
        let stretches = stretches(sound.energies(), duration_s, request.fps);
        self.perform_stretches(sound, &stretches, request, take, progress)
    }

    /// `stretches`: ranges of frames.
    fn perform_stretches(
        &self,
        sound: SoundFile,
        stretches: &[Range<usize>],
        request: &MotionRequest,
        take: &mut dyn FnMut(Part, ProgressFn<'_>) -> Result<()>,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        self.check(request)?;
        if stretches.len() > 1 && matches!(request.script.as_deref(), Some(Script::Text(_))) {
            return Err(Error::InvalidInput(format!(
                "text: expected times of its words for a sound longer than {WHOLE_S} s, got none; `anyface sounds \
                 --text` finds them, and its result goes into --sounds"
            )));
        }
        let (fps, levels) = (request.fps, sound.levels);
        // The ends are rounded outwards, so that each stretch of sound has all its frames and
        // perhaps one more.
        let sample = |frame: usize| frame as f64 / fps * f64::from(SAMPLE_RATE_HZ);
        let heard: Vec<Range<usize>> = stretches
            .iter()
            .map(|frames| {
                let end = (sample(frames.end).ceil() as usize).min(levels.samples);
                sample(frames.start) as usize..end
            })
            .collect();
        let count = stretches.len();
        let mut all = stretches.iter().enumerate().peekable();
        let mut before: Option<Part> = None;
        sound.stretches(&heard, &mut |waveform| {
            let Some((number, frames)) = all.next() else {
                return Ok(());
            };
            let share = move |p: Progress| {
                let fraction = (number as f32 + p.fraction) / count as f32;
                progress(Progress { fraction, ..p })
            };
            let mut request = request.after_second(frames.start as f64 / fps);
            request.seed = request.seed.wrapping_add(SEEDS * number as u64);
            request.starts_from = request.starts_from.filter(|_| number == 0);
            let part = Part::of(self.perform(&waveform, &request, &share)?, frames.start);
            drop(waveform);
            let shared = before.as_ref().map_or(0, |before| before.motion.frames());
            if let Some(before) = before.take() {
                let seam = Stretch::after(0.5 * (OVERLAP_S - BLEND_S), BLEND_S);
                let new = part.rows(0..shared, frames.start);
                let seam = Part {
                    heard_emotion: before.heard_emotion,
                    motion: before.motion.redone(&new.motion, &seam)?,
                    life: before.life.redone(&new.life, &seam, fps)?,
                };
                take(seam, &share)?;
            }
            let end = match all.peek() {
                Some((_, next)) => next.start - frames.start,
                None => frames.len(),
            };
            before = Some(part.rows(end..frames.len(), frames.start));
            let part = if shared == 0 && end == part.motion.frames() {
                part
            } else {
                part.rows(shared..end, frames.start)
            };
            take(part, &share)
        })
    }

    /// The most seconds of sound that are in memory at once when a sound of `duration_s` is
    /// performed in stretches.
    pub fn longest_stretch_s(duration_s: f64) -> f64 {
        if duration_s > WHOLE_S {
            STRETCH_S + AROUND_S + OVERLAP_S
        } else {
            duration_s
        }
    }
}

/// Divides the frames of a sound into one stretch, or into several that overlap.
///
/// `energies`: the sum of squares of each hop of 10 ms of the sound.
fn stretches(energies: &[f32], duration_s: f64, fps: f64) -> Vec<Range<usize>> {
    let frames = frames_of(duration_s, fps);
    if duration_s <= WHOLE_S {
        return std::iter::once(0..frames).collect();
    }
    let count = (duration_s / STRETCH_S).ceil() as usize;
    let cuts = (1..count).map(|k| quietest(energies, duration_s / count as f64 * k as f64));
    let overlap = (OVERLAP_S * fps).ceil() as usize;
    let starts = cuts.map(|cut_s| ((cut_s - 0.5 * OVERLAP_S) * fps).round() as usize);
    let starts: Vec<usize> = std::iter::once(0).chain(starts).collect();
    let ends = starts[1..].iter().map(|start| start + overlap);
    let ends = ends.chain([frames]);
    starts
        .iter()
        .zip(ends)
        .map(|(start, end)| *start..end)
        .collect()
}

/// The middle of the quietest second near a time.
fn quietest(energies: &[f32], near_s: f64) -> f64 {
    let hop = |time_s: f64| ((time_s / HOP_S) as usize).min(energies.len());
    let first = hop(near_s - AROUND_S);
    let around = &energies[first..hop(near_s + AROUND_S)];
    let loudness = around
        .windows(QUIET_HOPS)
        .map(|hops| hops.iter().sum::<f32>());
    let (place, _) = loudness
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((0, 0.0));
    (first + place) as f64 * HOP_S + 0.5 * QUIET_HOPS as f64 * HOP_S
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        CachePolicy, EngineOptions,
        conditions::{ControlCurve, EmotionCurve},
        job::SILENT,
        systems::SYSTEMS,
    };
    use ndarray::{Axis, concatenate};

    /// Six seconds of babble in a file, silent for one in the middle.
    fn babble(folder: &tempfile::TempDir) -> SoundFile {
        let path = folder.path().join("babble.wav");
        let spec = hound::WavSpec {
            channels: 1,
            sample_rate: 16_000,
            bits_per_sample: 32,
            sample_format: hound::SampleFormat::Float,
        };
        let mut file = hound::WavWriter::create(&path, spec).unwrap();
        for i in 0..6 * 16_000 {
            let t = i as f32 / 16_000.0;
            let voice: f32 = (1..12)
                .map(|k| (754.0 * k as f32 * t).sin() / k as f32)
                .sum();
            let loud = (0.5 - 0.5 * (25.0 * t).cos()).powi(2);
            let quiet = (2.5..3.5).contains(&t);
            file.write_sample(if quiet { 0.0 } else { 0.3 * voice * loud })
                .unwrap();
        }
        file.finalize().unwrap();
        SoundFile::read(&path, false, SILENT).unwrap()
    }

    #[test]
    fn parts_have_all_frames_and_go_over_into_each_other_in_every_system() {
        let folder = tempfile::tempdir().unwrap();
        for system in SYSTEMS {
            let engine = Engine::new(EngineOptions {
                system: Some(system.name.into()),
                cache: CachePolicy::Off,
                ..EngineOptions::default()
            });
            let engine = engine.unwrap();
            let mut request = MotionRequest {
                fps: 29.97,
                emotion: EmotionCurve::parse("happy:0.6").unwrap(),
                ..MotionRequest::default()
            };
            let keys = vec![(1.0, 0.8), (5.0, 1.2)];
            let curve = ControlCurve { value: 1.0, keys };
            if system.controls().any(|one| one.name == "articulation") {
                request.controls.set_curve("articulation", curve);
            }
            let whole = engine.perform(&babble(&folder).whole(SILENT).unwrap(), &request, SILENT);
            let whole = whole.unwrap().motion.values().to_owned();
            let (mut parts, mut lives) = (Vec::new(), 0);
            let mut take = |part: Part, _: ProgressFn<'_>| {
                lives += part.life.head.nrows();
                parts.push(part.motion.values().to_owned());
                Ok(())
            };
            let stretches = [0..120, 60..180];
            let sound = babble(&folder);
            engine
                .perform_stretches(sound, &stretches, &request, &mut take, SILENT)
                .unwrap();
            let views: Vec<_> = parts.iter().map(|part| part.view()).collect();
            let joined = concatenate(Axis(0), &views).unwrap();
            assert_eq!(joined.shape(), whole.shape(), "{}", system.name);
            assert_eq!(lives, 180);
            let largest_step = |motion: &ndarray::ArrayD<f32>| {
                let frames = motion.len_of(Axis(0));
                let steps = (1..frames).map(|t| {
                    let step = &motion.index_axis(Axis(0), t) - &motion.index_axis(Axis(0), t - 1);
                    step.iter().fold(0.0f32, |most, x| most.max(x.abs()))
                });
                steps.fold(0.0, f32::max)
            };
            let (parts, whole) = (largest_step(&joined), largest_step(&whole));
            assert!(
                parts < 1.7 * whole,
                "{}: {parts} after {whole}",
                system.name
            );
        }
    }

    #[test]
    fn what_has_a_time_comes_earlier_in_a_later_stretch() {
        let request = MotionRequest {
            closures: Some(vec![[1.0, 2.0], [9.5, 10.5], [12.0, 12.5]]),
            events: vec![crate::conditions::Event::parse("11-13:12").unwrap()],
            ..MotionRequest::default()
        };
        let later = request.after_second(10.0);
        assert_eq!(later.closures, Some(vec![[0.0, 0.5], [2.0, 2.5]]));
        assert_eq!(later.events[0].slot_s, [1.0, 3.0]);
        assert_eq!(request.after_second(13.0).events, []);
        assert_eq!(request.after_second(0.0), request);
    }

    #[test]
    fn long_sounds_are_cut_where_they_are_quiet_and_neighbours_overlap() {
        let mut energies = vec![1.0; 200_000];
        // Two quiet seconds near a third of the sound, one near two thirds.
        energies[65_000..65_200].fill(0.0);
        energies[134_000..134_100].fill(0.0);
        for fps in [24.0, 29.97, 60.0] {
            let all = stretches(&energies, 2000.0, fps);
            assert_eq!(all.len(), 7);
            assert_eq!((all[0].start, all[6].end), (0, frames_of(2000.0, fps)));
            for pair in all.windows(2) {
                assert_eq!(pair[0].end - pair[1].start, (2.0 * fps).ceil() as usize);
                assert!(pair[1].start > pair[0].start);
            }
            for frames in &all {
                assert!(frames.len() as f64 / fps < Engine::longest_stretch_s(2000.0) + AROUND_S);
            }
        }
        let [quiet, other] = [572.0, 858.0].map(|near_s| quietest(&energies, near_s));
        assert!(other != quiet);
        assert!((quietest(&energies, 660.0) - 650.5).abs() < 0.6);
        assert!((quietest(&energies, 1330.0) - 1340.5).abs() < 0.02);
        let whole = stretches(&energies[..60_000], WHOLE_S, 30.0);
        assert_eq!((whole.len(), &whole[0]), (1, &(0..18_000)));
    }
}
