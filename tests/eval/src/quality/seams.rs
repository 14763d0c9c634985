//! Long sounds are performed in overlapping windows: does the motion jerk where they meet?
//!
//! The same sound is performed twice, the second time after half a stride of silence, so that its
//! windows meet elsewhere. Where the first performance has a seam, the second has none, and the
//! other way round. The ratio of the two at the same frames of the same speech shows what one seam
//! adds.

use std::ops::Range;

use ndarray::Array3;
use serde::Serialize;

use super::{
    bootstrap::{Estimate, estimate},
    clip::Clip,
    speaker::{Speaker, Wish},
};
use crate::metrics::{rms_accelerations, rms_speeds, root_mean_square};
use anyface::{
    Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    mesh::ibug::LANDMARKS,
    systems::Windows,
};

/// Length of the sound, seconds.
const LENGTH_S: f64 = 60.0;

/// Ratios of the motion where windows overlap to the motion elsewhere; 1 means no difference.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SeamScores {
    pub seconds: f64,
    pub window_frames: usize,
    pub overlap_frames: usize,
    pub seams: usize,
    /// Speed at seams over speed at all other frames.
    pub speed: Option<Estimate>,
    pub acceleration: Option<Estimate>,
    /// Speed at seams over speed at the same frames where the windows meet elsewhere.
    pub paired_speed: Option<Estimate>,
    pub paired_acceleration: Option<Estimate>,
}

/// Root mean squares of speed and acceleration at one seam.
#[derive(Clone, Copy)]
struct Seam {
    here: [f64; 2],
    elsewhere: [f64; 2],
    /// Over all frames without a seam, of the same performance.
    others: [f64; 2],
}

/// Measures the seams in `clips`, joined in a row up to `LENGTH_S`. `None` if there is no seam.
pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[Clip],
) -> Result<Option<SeamScores>> {
    let Some(windows) = speaker.engine.description().windows else {
        return Ok(None);
    };
    let fps = windows.fps;
    let sound = in_a_row(clips, fps);
    let stride = windows.frames - windows.overlap;
    let delay = stride / 2;
    let frames = (sound.duration_s() * fps).round() as usize;
    let plain = speaker.perform(&sound, fps, wish)?;
    let late = speaker.perform(&delayed(&sound, delay as f64 / fps), fps, wish)?;
    let meet = |frames: usize| seams(windows, frames);
    let moved = meet(frames + delay).into_iter();
    let moved = moved.filter_map(|r| Some(r.start.checked_sub(delay)?..r.end - delay));
    let moved: Vec<Range<usize>> = moved.collect();
    let late = late.slice(ndarray::s![delay.., .., ..]).to_owned();
    let curves = [curves(&plain, fps), curves(&late, fps)];
    let mut jumps = compare(&curves[0], &curves[1], &meet(frames), &moved);
    jumps.extend(compare(&curves[1], &curves[0], &moved, &meet(frames)));
    let ratio = |of: fn(&Seam) -> [f64; 2], k: usize| {
        estimate(&jumps, move |seams| {
            let here = seams.iter().map(|s| s.here[k]).collect::<Vec<_>>();
            let against = seams.iter().map(|s| of(s)[k]).collect::<Vec<_>>();
            let against = root_mean_square(&against);
            (against > 0.0).then(|| root_mean_square(&here) / against)
        })
    };
    Ok((!jumps.is_empty()).then(|| SeamScores {
        seconds: sound.duration_s(),
        window_frames: windows.frames,
        overlap_frames: windows.overlap,
        seams: jumps.len(),
        speed: ratio(|s| s.others, 0),
        acceleration: ratio(|s| s.others, 1),
        paired_speed: ratio(|s| s.elsewhere, 0),
        paired_acceleration: ratio(|s| s.elsewhere, 1),
    }))
}

/// Joins the clips, each cut to whole frames, up to `LENGTH_S`.
fn in_a_row(clips: &[Clip], fps: f64) -> Waveform {
    let frame = (f64::from(SAMPLE_RATE_HZ) / fps).round() as usize;
    let most = (LENGTH_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let mut samples: Vec<f32> = Vec::new();
    for clip in clips {
        let whole = clip.waveform.samples.len() / frame * frame;
        samples.extend(&clip.waveform.samples[..whole]);
    }
    samples.truncate(most / frame * frame);
    Waveform { samples }
}

fn delayed(sound: &Waveform, by_s: f64) -> Waveform {
    let mut samples = vec![0.0; (by_s * f64::from(SAMPLE_RATE_HZ)).round() as usize];
    samples.extend(&sound.samples);
    Waveform { samples }
}

/// Ranges of frames that two neighbouring windows share.
fn seams(windows: Windows, frames: usize) -> Vec<Range<usize>> {
    let windows = windows.of(frames);
    windows
        .windows(2)
        .map(|pair| pair[1].start..pair[0].end)
        .collect()
}

/// Speed and acceleration of all landmarks at every frame.
fn curves(motion: &Array3<f64>, fps: f64) -> [Vec<f64>; 2] {
    let all: Vec<usize> = (0..LANDMARKS).collect();
    [
        rms_speeds(motion.view(), &all, fps),
        rms_accelerations(motion.view(), &all, fps),
    ]
}

/// The seams of one performance that lie where the other one has none.
fn compare(
    here: &[Vec<f64>; 2],
    other: &[Vec<f64>; 2],
    seams: &[Range<usize>],
    other_seams: &[Range<usize>],
) -> Vec<Seam> {
    let free = |t: usize| !seams.iter().any(|r| r.contains(&t));
    let others = [0, 1].map(|k| {
        let values = here[k].iter().enumerate().filter(|(t, _)| free(*t));
        root_mean_square(&values.map(|(_, x)| *x).collect::<Vec<_>>())
    });
    let apart = |r: &&Range<usize>| {
        let mut against = other_seams.iter();
        against.all(|o| o.end <= r.start || o.start >= r.end)
    };
    let usable = seams.iter().filter(apart);
    usable
        .filter_map(|r| {
            let at = |curves: &[Vec<f64>; 2]| -> Option<[f64; 2]> {
                let speed = curves[0].get(r.clone())?;
                let acceleration = curves[1].get(r.clone())?;
                Some([root_mean_square(speed), root_mean_square(acceleration)])
            };
            Some(Seam {
                here: at(here)?,
                elsewhere: at(other)?,
                others,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::slice::from_ref;

    #[test]
    fn seams_are_where_windows_overlap() {
        let windows = Windows {
            fps: 25.0,
            frames: 12,
            overlap: 4,
        };
        assert_eq!(seams(windows, 28), [8..12, 16..20]);
        assert_eq!(seams(windows, 26), [8..12, 14..20]);
        assert!(seams(windows, 12).is_empty());
    }

    #[test]
    fn a_jerk_at_a_seam_shows_against_the_other_performance() {
        let calm = [vec![1.0; 40], vec![1.0; 40]];
        let mut jerky = calm.clone();
        for curve in &mut jerky {
            curve[10..14].fill(3.0);
        }
        let result = compare(&jerky, &calm, from_ref(&(10..14)), from_ref(&(20..24)));
        assert_eq!(result.len(), 1);
        assert_eq!(result[0].here, [3.0, 3.0]);
        assert_eq!(result[0].elsewhere, [1.0, 1.0]);
        assert_eq!(result[0].others, [1.0, 1.0]);
    }

    #[test]
    fn seams_that_meet_in_both_do_not_count() {
        let calm = [vec![1.0; 40], vec![1.0; 40]];
        assert!(compare(&calm, &calm, from_ref(&(10..14)), from_ref(&(12..16))).is_empty());
        assert!(compare(&calm, &calm, from_ref(&(38..44)), from_ref(&(12..16))).is_empty());
    }
}
