//! Remakes a stretch of a motion. The rest stays bit for bit.

use std::ops::Range;

use ndarray::{Array, ArrayD, ArrayView, ArrayViewD, Axis, Dimension, Slice, aview1};

use super::{Life, Motion, WeightClip};
use crate::{Error, Result};

/// Longest time of a blend between old and new motion at either end, seconds. It is about a phone.
const BLEND_S: f64 = 0.1;
/// Largest part of a stretch that one blend may take.
const BLEND_PART: f64 = 0.25;

/// The stretch of a motion that is made again, in seconds.
///
/// At both ends the old and the new motion are blended within a tenth of a second, or within a
/// quarter of the stretch if that is less. An end at the start or end of the sound is not blended.
///
/// ```
/// use anyface::motion::{LandmarkClip, Motion, Stretch};
///
/// let of = |x: f32| Motion::Landmarks(LandmarkClip {
///     displacements: ndarray::Array3::from_elem((50, 68, 3), x), fps: 25.0,
/// });
/// let spliced = of(0.0).redone(&of(1.0), &Stretch::parse("0.4-1.2")?)?;
/// assert_eq!([0, 10, 20, 30, 49].map(|t| spliced.values()[[t, 0, 0]]), [0.0, 0.0, 1.0, 0.0, 0.0]);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    start_s: f64,
    end_s: f64,
    blend_s: f64,
}

impl Stretch {
    /// From `start_s` to `end_s`. A frame exactly at either time stays as it was, except at 0 s.
    ///
    /// # Errors
    /// `InvalidInput` for a time that is not finite or below 0, or an end that is not after the start.
    pub fn new(start_s: f64, end_s: f64) -> Result<Stretch> {
        if start_s >= 0.0 && end_s > start_s && end_s.is_finite() {
            Ok(Stretch {
                start_s,
                end_s,
                blend_s: BLEND_S,
            })
        } else {
            Err(Error::InvalidInput(format!(
                "redo: expected seconds of at least 0, the end after the start, got {start_s} to {end_s}"
            )))
        }
    }

    /// Everything from `start_s` on, where the old motion blends into the new one for `blend_s`.
    pub(crate) fn after(start_s: f64, blend_s: f64) -> Stretch {
        Stretch {
            start_s,
            end_s: f64::INFINITY,
            blend_s,
        }
    }

    /// Reads `1.2-2.0`, seconds.
    ///
    /// # Errors
    /// `InvalidInput` for anything else, and those of [`Stretch::new`].
    pub fn parse(text: &str) -> Result<Stretch> {
        let ends = text.split_once('-');
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let ends = ends.and_then(|(start, end)| Some((number(start)?, number(end)?)));
        let (start_s, end_s) = ends.ok_or_else(|| {
            let message = format!("redo: expected seconds as in 1.2-2.0, got {text:?}");
            Error::InvalidInput(message)
        })?;
        Stretch::new(start_s, end_s)
    }

    /// The frames that may change in a clip of `frames` frames.
    ///
    /// # Errors
    /// `InvalidInput` if there are none: the stretch lies beyond the end, or between two frames.
    pub fn frames(&self, frames: usize, fps: f64) -> Result<Range<usize>> {
        let changes = |t: &usize| self.share(*t, frames, fps) > 0.0;
        match ((0..frames).find(changes), (0..frames).rfind(changes)) {
            (Some(first), Some(last)) => Ok(first..last + 1),
            _ => Err(Error::InvalidInput(format!(
                "redo: expected a stretch that holds a frame of {frames} at {fps} fps ({} s), got {} \
                 to {} s",
                frames as f64 / fps,
                self.start_s,
                self.end_s
            ))),
        }
    }

    /// The share of the new motion in frame `t`, 0 to 1.
    fn share(&self, t: usize, frames: usize, fps: f64) -> f32 {
        let time_s = t as f64 / fps;
        let blend_s = self.blend_s.min(BLEND_PART * (self.end_s - self.start_s));
        let rise = |inside_s: f64, is_end: bool| {
            if is_end {
                1.0
            } else {
                (inside_s / blend_s).clamp(0.0, 1.0)
            }
        };
        let last_s = frames.saturating_sub(1) as f64 / fps;
        let before = rise(time_s - self.start_s, self.start_s <= 0.0);
        let after = rise(self.end_s - time_s, self.end_s > last_s);
        let x = before.min(after) as f32;
        x * x * (3.0 - 2.0 * x)
    }

    /// Takes the frames of the stretch from `new` and all others from `was`, blended at the ends.
    /// Both have the same shape, with the frames as the first axis.
    ///
    /// # Errors
    /// `ShapeMismatch` if the shapes differ, and those of [`Stretch::frames`].
    pub fn splice<D: Dimension>(
        &self,
        was: ArrayView<'_, f32, D>,
        new: ArrayView<'_, f32, D>,
        fps: f64,
    ) -> Result<Array<f32, D>> {
        if was.shape() != new.shape() {
            return Err(Error::ShapeMismatch {
                what: "motion that is made again",
                expected: format!("{:?}", was.shape()),
                got: format!("{:?}", new.shape()),
            });
        }
        let frames = was.shape()[0];
        let mut out = was.to_owned();
        for t in self.frames(frames, fps)? {
            let share = self.share(t, frames, fps);
            let rows = Slice::from(t..t + 1);
            let new = new.slice_axis(Axis(0), rows);
            let mut out = out.slice_axis_mut(Axis(0), rows);
            if share < 1.0 {
                out.zip_mut_with(&new, |was, new| *was += share * (new - *was))
            } else {
                out.assign(&new)
            }
        }
        Ok(out)
    }
}

impl Motion {
    /// This motion with the frames of `stretch` taken from `again`, blended at the ends. Every
    /// frame outside the stretch stays the same bit for bit.
    ///
    /// # Errors
    /// `InvalidInput` for motion of another kind or frame rate, or a stretch without a frame;
    /// `ShapeMismatch` for motion of another length.
    pub fn redone(&self, again: &Motion, stretch: &Stretch) -> Result<Motion> {
        if (self.kind(), self.fps()) != (again.kind(), again.fps()) {
            return Err(Error::InvalidInput(format!(
                "redo: expected {} at {} fps as before, got {} at {} fps",
                self.kind(),
                self.fps(),
                again.kind(),
                again.fps()
            )));
        }
        let values = stretch.splice(self.values(), again.values(), self.fps())?;
        let mut spliced = self.with_values(values);
        if let (Motion::Codes(spliced), Motion::Codes(again)) = (&mut spliced, again) {
            let fps = spliced.landmarks.fps;
            spliced.codes = stretch.splice(spliced.codes.view(), again.codes.view(), fps)?;
        }
        if let (Motion::Weights(spliced), Motion::Weights(again)) = (&mut spliced, again)
            && spliced.together.len() == again.together.len()
            && !again.together.is_empty()
        {
            let [was, new] = [&spliced.together, &again.together].map(|share| aview1(share));
            spliced.together = stretch.splice(was, new, spliced.fps)?.to_vec();
        }
        Ok(spliced)
    }

    /// A range of its frames.
    ///
    /// # Panics
    /// If the range ends behind the last frame.
    #[must_use]
    pub fn frames_of(&self, rows: Range<usize>) -> Motion {
        if let Motion::Weights(clip) = self {
            return Motion::Weights(clip.rows(&rows.collect::<Vec<_>>()));
        }
        let values: ArrayViewD<'_, f32> = self.values();
        let slice = Slice::from(rows);
        let values: ArrayD<f32> = values.slice_axis(Axis(0), slice).to_owned();
        let mut part = self.with_values(values);
        if let Motion::Codes(clip) = &mut part {
            clip.codes = clip.codes.slice_axis(Axis(0), slice).to_owned();
        }
        part
    }
}

impl Life {
    /// Head, eyes and tongue with `stretch` taken from `again`; see [`Motion::redone`].
    ///
    /// # Errors
    /// Those of [`Stretch::splice`].
    pub fn redone(&self, again: &Life, stretch: &Stretch, fps: f64) -> Result<Life> {
        Ok(Life {
            head: stretch.splice(self.head.view(), again.head.view(), fps)?,
            gaze: stretch.splice(self.gaze.view(), again.gaze.view(), fps)?,
            tongue: stretch.splice(self.tongue.view(), again.tongue.view(), fps)?,
        })
    }

    /// A range of its frames.
    ///
    /// # Panics
    /// If the range ends behind the last frame.
    #[must_use]
    pub fn frames_of(&self, rows: Range<usize>) -> Life {
        let slice = Slice::from(rows);
        Life {
            head: self.head.slice_axis(Axis(0), slice).to_owned(),
            gaze: self.gaze.slice_axis(Axis(0), slice).to_owned(),
            tongue: self.tongue.slice_axis(Axis(0), slice).to_owned(),
        }
    }

    /// Appends the frames of `next`.
    pub(crate) fn append(&mut self, next: &Life) {
        const FITS: &str = "a frame has the shape of every frame";
        self.head.append(Axis(0), next.head.view()).expect(FITS);
        self.gaze.append(Axis(0), next.gaze.view()).expect(FITS);
        self.tongue.append(Axis(0), next.tongue.view()).expect(FITS);
    }
}

impl WeightClip {
    /// Appends the frames of `next`, whose shapes have to be the same.
    pub(crate) fn append(&mut self, next: &WeightClip) {
        let rows = self.weights.append(Axis(0), next.weights.view());
        rows.expect("both clips have the shapes of one model");
        self.together.extend(&next.together);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;
    use crate::motion::{LandmarkClip, WeightClip};

    const FPS: f64 = 30.0;

    /// Sixty frames that differ from frame to frame and from `phase` to `phase`.
    fn motion(phase: f32) -> Motion {
        Motion::Landmarks(LandmarkClip {
            displacements: Array3::from_shape_fn((60, 68, 3), |(t, n, i)| {
                (phase + 0.1 * t as f32 + n as f32 + 0.3 * i as f32).sin()
            }),
            fps: FPS,
        })
    }

    fn frame(motion: &Motion, t: usize) -> ArrayD<f32> {
        motion.values().index_axis(Axis(0), t).to_owned()
    }

    #[test]
    fn frames_outside_stay_to_the_bit_and_the_middle_is_new_to_the_bit() {
        let (was, new) = (motion(0.0), motion(1.0));
        let spliced = was.redone(&new, &Stretch::new(0.5, 1.2).unwrap()).unwrap();
        for t in (0..=15).chain(36..60) {
            assert_eq!(frame(&spliced, t), frame(&was, t), "{t}");
        }
        for t in 18..=33 {
            assert_eq!(frame(&spliced, t), frame(&new, t), "{t}");
        }
        for t in [16, 17, 34, 35] {
            assert!(frame(&spliced, t) != frame(&was, t) && frame(&spliced, t) != frame(&new, t));
        }
    }

    #[test]
    fn the_ends_of_the_sound_are_not_blended() {
        let (was, new) = (motion(0.0), motion(1.0));
        let spliced = was.redone(&new, &Stretch::new(0.0, 9.0).unwrap()).unwrap();
        assert_eq!(spliced, new);
    }

    #[test]
    fn the_same_motion_again_changes_nothing() {
        let was = motion(0.0);
        assert_eq!(
            was.redone(&was, &Stretch::new(0.3, 1.5).unwrap()).unwrap(),
            was
        );
    }

    #[test]
    fn blends_never_go_beyond_both() {
        let stretch = Stretch::new(0.5, 1.2).unwrap();
        let shares: Vec<f32> = (0..60).map(|t| stretch.share(t, 60, FPS)).collect();
        let peak = shares.iter().position(|share| *share == 1.0).unwrap();
        assert!(shares[..peak].windows(2).all(|pair| pair[0] <= pair[1]));
        assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)));
    }

    #[test]
    fn stretches_are_read_and_checked() {
        assert_eq!(
            Stretch::parse("1.2-2.0").unwrap(),
            Stretch::new(1.2, 2.0).unwrap()
        );
        for text in ["1.2", "2-1", "a-b", "-1-2", "1-inf", "nan-2"] {
            let message = Stretch::parse(text).unwrap_err().to_string();
            assert!(message.starts_with("redo: expected"), "{text}: {message}");
        }
    }

    #[test]
    fn a_stretch_without_a_frame_or_other_motion_is_refused() {
        let was = motion(0.0);
        for (start, end) in [(5.0, 6.0), (0.51, 0.52)] {
            let message = was.redone(&was, &Stretch::new(start, end).unwrap());
            let message = message.unwrap_err().to_string();
            assert!(message.contains("holds a frame"), "{message}");
        }
        let stretch = Stretch::new(0.5, 1.0).unwrap();
        let shorter = was.frames_of(0..50);
        assert!(matches!(
            was.redone(&shorter, &stretch),
            Err(Error::ShapeMismatch { .. })
        ));
    }

    #[test]
    fn lips_of_weights_come_together_where_the_frames_are_that_were_taken() {
        let of = |weight: f32, share: f32| {
            Motion::Weights(WeightClip {
                names: vec!["jawOpen".to_owned()],
                weights: Array2::from_elem((50, 1), weight),
                fps: 25.0,
                together: (0..50).map(|t| if t == 20 { share } else { 0.0 }).collect(),
            })
        };
        let together = |motion: &Motion| match motion {
            Motion::Weights(clip) => clip.together.clone(),
            other => panic!("{}", other.kind()),
        };
        let part = together(&of(0.5, 1.0).frames_of(18..22));
        assert_eq!(part, [0.0, 0.0, 1.0, 0.0]);
        // A remade stretch brings its own closures, but none from outside of it.
        let stretch = Stretch::parse("0.4-1.2").unwrap();
        let spliced = of(0.5, 1.0).redone(&of(0.2, 0.0), &stretch).unwrap();
        assert!(together(&spliced).iter().all(|share| *share == 0.0));
        let later = Stretch::parse("1.2-1.8").unwrap();
        let outside = of(0.5, 1.0).redone(&of(0.2, 0.0), &later).unwrap();
        assert_eq!(together(&outside)[20], 1.0);
    }
}
