//! Converts frames to the outgoing rate and says when each is due.

use std::time::{Duration, Instant};

/// The weights and head rotation of a frame, which are interpolated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    pub shapes: [f32; 52],
    pub visemes: [f32; 15],
    pub head: [f32; 3],
}

/// An outgoing frame and the time at which it is due.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paced {
    /// Number of the frame, counted at the outgoing rate.
    pub number: u32,
    /// Time of the frame in the sound, in seconds.
    pub time_s: f64,
    pub weights: Weights,
    /// When the frame goes out.
    pub due: Instant,
}

/// Converts the frames of a stream to another rate by linear interpolation.
///
/// A frame between two frames of the stream goes out after the second has arrived, delayed by its distance
/// from the first. That is one frame of the stream later than without interpolation. The clocks of sound
/// cards differ from ours, but no drift builds up, because every delay counts from the arrival of a frame.
pub struct Pace {
    stream_fps: f64,
    fps: f64,
    before: Option<(f64, Weights)>,
    next: u32,
}

/// Times within this share of a frame are equal: they come from different divisions and round differently.
const SAME: f64 = 1e-6;

impl Pace {
    /// Converts from `stream_fps` to `fps` frames per second.
    pub fn new(stream_fps: f64, fps: f64) -> Pace {
        Pace {
            stream_fps,
            fps,
            before: None,
            next: 0,
        }
    }

    /// Returns the outgoing frames up to the stream's frame `index`, which arrived at `now`.
    pub fn take(&mut self, index: usize, weights: Weights, now: Instant) -> Vec<Paced> {
        let time_s = index as f64 / self.stream_fps;
        let (from_s, before) = self
            .before
            .replace((time_s, weights))
            .unwrap_or((time_s, weights));
        let is_same = self.fps == self.stream_fps;
        let mut paced = Vec::new();
        loop {
            let at_s = f64::from(self.next) / self.fps;
            if at_s > time_s + SAME / self.fps {
                return paced;
            }
            let share = if time_s > from_s {
                ((at_s - from_s) / (time_s - from_s)).clamp(0.0, 1.0)
            } else {
                1.0
            };
            let wait_s = if is_same {
                0.0
            } else {
                share * (time_s - from_s)
            };
            paced.push(Paced {
                number: self.next,
                time_s: at_s,
                weights: before.towards(&weights, share as f32),
                due: now + Duration::from_secs_f64(wait_s),
            });
            self.next += 1;
        }
    }
}

impl Weights {
    fn towards(&self, other: &Weights, share: f32) -> Weights {
        let mix = |a: f32, b: f32| a + share * (b - a);
        Weights {
            shapes: std::array::from_fn(|i| mix(self.shapes[i], other.shapes[i])),
            visemes: std::array::from_fn(|i| mix(self.visemes[i], other.visemes[i])),
            head: std::array::from_fn(|i| mix(self.head[i], other.head[i])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(value: f32) -> Weights {
        Weights {
            shapes: [value; 52],
            visemes: [value; 15],
            head: [value; 3],
        }
    }

    #[test]
    fn at_the_streams_own_rate_frames_go_out_as_they_come() {
        let (now, mut pace) = (Instant::now(), Pace::new(25.0, 25.0));
        for index in 0..5 {
            let paced = pace.take(index, weights(index as f32), now);
            let expected = Paced {
                number: index as u32,
                time_s: index as f64 / 25.0,
                weights: weights(index as f32),
                due: now,
            };
            assert_eq!(paced, [expected]);
        }
    }

    #[test]
    fn between_frames_weights_are_linear_and_no_more_than_a_frame_late() {
        let (now, mut pace) = (Instant::now(), Pace::new(25.0, 60.0));
        let mut all = Vec::new();
        for index in 0..26 {
            let came = now + Duration::from_millis(40 * index as u64);
            all.extend(pace.take(index, weights(index as f32), came));
        }
        assert_eq!(all.len(), 61);
        for (n, paced) in all.iter().enumerate() {
            assert_eq!(paced.number as usize, n);
            assert!((f64::from(paced.weights.head[2]) - 25.0 * paced.time_s).abs() < 1e-5);
            let late_s = (paced.due - now).as_secs_f64() - paced.time_s;
            assert!((0.0..0.0401).contains(&late_s), "{n}: {late_s}");
        }
        assert!(all.windows(2).all(|pair| pair[0].due <= pair[1].due));
    }

    #[test]
    fn fewer_frames_than_the_stream_has_are_a_choice_among_them() {
        let (now, mut pace) = (Instant::now(), Pace::new(25.0, 12.5));
        let all: Vec<Paced> = (0..5)
            .flat_map(|index| pace.take(index, weights(index as f32), now))
            .collect();
        let values: Vec<f32> = all.iter().map(|paced| paced.weights.shapes[0]).collect();
        assert_eq!(values, [0.0, 2.0, 4.0]);
    }
}
