//! The path on which lips come to a contact and part from it, for landmarks and blendshape weights.
//!
//! Twin of `approach` in `training/corpus/closures.py`.

use crate::speech::Contact;

/// The greatest speed at which lips come together and part, m/s. Each in 0.1 % of the frames, the
/// lips of grid_s1's tracked speaker close faster than 0.33 and part faster than 0.28.
const FASTEST_M_S: f64 = 0.28;
/// The greatest speed of lips whose motion a control or an expression enlarges, m/s.
const FASTEST_OF_ALL_M_S: f64 = 0.33;
/// Time in which lips reach their greatest speed, seconds.
const SPEED_UP_S: f64 = 0.02;
/// Half of the shortest touch, seconds. Because lips part slowly at first, they are within 0.5 mm of
/// touching for about 55 ms.
const HALF_TOUCH_S: f64 = 0.014;
/// Part of a long heard contact in which the lips still approach or already part, seconds.
const EDGES_S: f64 = 0.13;
/// The smallest opening is looked for this long before and after a heard contact, seconds.
const REACH_S: f64 = 0.02;
/// Openings within about this distance of the smallest one decide together when lips touch, metres.
const NEAR_M: f32 = 0.5e-3;
/// How sharply an opening bends into the path.
const SHARPNESS: i32 = 6;
/// A touch bounds the opening for this long before and after it, seconds.
const FAR_S: f64 = 0.15;
/// Openings below this count as closed, metres from touching.
const CLOSED_M: f32 = 0.75e-3;
/// Smaller shares leave a frame as it is.
const LEAST: f32 = 1e-3;

/// Lips that touch, or nearly so.
struct Touch {
    /// Start and end, seconds.
    span_s: [f64; 2],
    /// How far the lips remain from touching, metres.
    left: f64,
}

/// The share of the way to touching that lips go in each frame, `[T]`, 0 to 1.
///
/// `openings` `[T]`: how far the lips are from touching, metres. A heard contact is placed where the
/// opening is smallest within it, so that the motion keeps its own timing. Around it the opening stays
/// below what lips can reach: they speed up evenly and then move at the greatest speed of the recorded
/// speaker. No contact is placed in a frame that is `free`.
pub fn approach(openings: &[f32], contacts: &[Contact], fps: f64, free: &[bool]) -> Vec<f32> {
    let touches = contacts.iter().filter_map(|contact| {
        let span_s = touch(openings, contact, fps);
        let middle = (0.5 * (span_s[0] + span_s[1]) * fps).round() as usize;
        let middle = middle.min(openings.len().checked_sub(1)?);
        let left = f64::from((1.0 - contact.share) * openings[middle]);
        (free.get(middle) != Some(&true)).then_some(Touch { span_s, left })
    });
    let widest = widest(openings.len(), touches, fps);
    let bent = openings.iter().zip(widest);
    let mut shares: Vec<f32> = bent
        .map(|(opening, widest)| bend(*opening, widest))
        .collect();
    let is_free = shares.iter_mut().zip(free).filter(|(_, free)| **free);
    is_free.for_each(|(share, _)| *share = 0.0);
    shares
}

/// The share of the way to touching, `[T]`, 0 to 1, that takes changed lips back to their contacts.
///
/// `openings`, `before` `[T]`: how far the lips are from touching after and before the change, metres.
/// Near frames that were closed before, the lips open no wider than on the path around a contact, or
/// than before if that is wider. Nowhere do they move faster than lips can.
pub fn restore_contacts(openings: &[f32], before: &[f32], fps: f64) -> Vec<f32> {
    let closed = before
        .iter()
        .enumerate()
        .filter(|(_, opening)| **opening < CLOSED_M);
    let touches = closed.map(|(t, opening)| Touch {
        span_s: [t as f64 / fps; 2],
        left: f64::from(*opening),
    });
    let widest = widest(before.len(), touches, fps);
    let mut path: Vec<f32> = openings.to_vec();
    for (path, (before, widest)) in path.iter_mut().zip(before.iter().zip(widest)) {
        *path = path.min(before.max(widest as f32));
    }
    slow(&mut path, (FASTEST_OF_ALL_M_S / fps) as f32);
    let share = |(opening, path): (&f32, f32)| {
        if *opening > path {
            1.0 - path / opening
        } else {
            0.0
        }
    };
    openings.iter().zip(path).map(share).collect()
}

/// Lowers a path until no step is longer than `step`.
fn slow(path: &mut [f32], step: f32) {
    for t in 1..path.len() {
        path[t] = path[t].min(path[t - 1] + step);
    }
    for t in (1..path.len()).rev() {
        path[t - 1] = path[t - 1].min(path[t] + step);
    }
}

/// The widest opening of each frame that the touches allow, `[T]`, metres from touching.
fn widest(frames: usize, touches: impl Iterator<Item = Touch>, fps: f64) -> Vec<f64> {
    let mut widest = vec![f64::INFINITY; frames];
    for Touch { span_s, left } in touches {
        let [from_s, to_s] = span_s;
        let first = ((from_s - FAR_S) * fps).max(0.0) as usize;
        let end = (((to_s + FAR_S) * fps).ceil().max(0.0) as usize).min(frames);
        for t in first.min(end)..end {
            let time_s = t as f64 / fps;
            let apart_s = (from_s - time_s).max(time_s - to_s).max(0.0);
            widest[t] = widest[t].min(left + reach_m(apart_s));
        }
    }
    widest
}

/// The share that bends an opening smoothly below `widest`.
fn bend(opening: f32, widest: f64) -> f32 {
    if opening <= 0.0 {
        return 0.0;
    }
    let ratio = f64::from(opening) / widest;
    let share = 1.0 - (1.0 + ratio.powi(SHARPNESS)).powf(-1.0 / f64::from(SHARPNESS)) as f32;
    if share < LEAST { 0.0 } else { share }
}

/// How far lips can part within a time after touching, metres.
fn reach_m(time_s: f64) -> f64 {
    if time_s < SPEED_UP_S {
        FASTEST_M_S * time_s * time_s / (2.0 * SPEED_UP_S)
    } else {
        FASTEST_M_S * (time_s - 0.5 * SPEED_UP_S)
    }
}

/// Start and end of the touch in a contact, seconds. They lie at least one frame apart.
fn touch(openings: &[f32], contact: &Contact, fps: f64) -> [f64; 2] {
    let Contact { start_s, end_s, .. } = *contact;
    let (middle_s, half_s) = (0.5 * (start_s + end_s), 0.5 * (end_s - start_s));
    let half_frame_s = 0.5 / fps;
    if contact.lasts {
        let half_s = half_s.max(half_frame_s);
        return [middle_s - half_s, middle_s + half_s];
    }
    let touching_s = (half_s - 0.5 * EDGES_S).max(HALF_TOUCH_S);
    let room_s = (half_s - touching_s).max(0.0);
    let at_s = smallest(openings, [start_s - REACH_S, end_s + REACH_S], fps).unwrap_or(middle_s);
    let at_s = at_s.clamp(middle_s - room_s, middle_s + room_s);
    let touching_s = touching_s.max(half_frame_s);
    [at_s - touching_s, at_s + touching_s]
}

/// Time of the smallest opening between two times, seconds. It is a weighted mean of the frames,
/// in which those with nearly the smallest opening count most.
fn smallest(openings: &[f32], [from_s, to_s]: [f64; 2], fps: f64) -> Option<f64> {
    let first = (from_s * fps).ceil().max(0.0) as usize;
    let end = ((to_s * fps).floor() as usize + 1).min(openings.len());
    let frames = openings.get(first..end)?;
    let least = frames.iter().copied().fold(f32::INFINITY, f32::min);
    let weight = |opening: &f32| f64::from((-(opening - least) / NEAR_M).exp());
    let sum: f64 = frames.iter().map(weight).sum();
    let times = frames.iter().enumerate();
    let moment: f64 = times
        .map(|(t, opening)| weight(opening) * (first + t) as f64)
        .sum();
    (sum > 0.0).then(|| moment / sum / fps)
}

/// The path of parting lips in motion that comes frame by frame, so that later frames are unknown.
#[derive(Debug, Clone, Copy)]
pub struct Parting {
    /// How long ago the lips last touched, seconds, and how far from touching they were then, metres.
    last: Option<(f64, f64)>,
    step_s: f64,
}

impl Parting {
    /// Lips that have not touched yet, in motion of `fps` frames a second.
    pub fn new(fps: f64) -> Parting {
        Parting {
            last: None,
            step_s: fps.recip(),
        }
    }

    /// The share of the way to touching that lips go in the next frame, 0 to 1. `opening`: how far they
    /// are from touching, metres. `share`: the share that the sound asks for.
    pub fn next(&mut self, opening: f32, share: f32) -> f32 {
        let step_s = self.step_s;
        let last = self.last.map(|(time_s, left)| (time_s + step_s, left));
        let reached = last.map_or(f64::INFINITY, |(time_s, left)| left + reach_m(time_s));
        let opening = f64::from(opening);
        let left = opening.min(reached) * f64::from(1.0 - share);
        self.last = if share > 0.0 { Some((0.0, left)) } else { last };
        if opening > 0.0 {
            (1.0 - left / opening) as f32
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(start_s: f64, end_s: f64) -> Contact {
        Contact {
            start_s,
            end_s,
            share: 1.0,
            lasts: false,
        }
    }

    /// The opening that remains of 12 mm, metres.
    fn left(contacts: &[Contact], fps: f64, frames: usize) -> Vec<f32> {
        let openings = vec![0.012; frames];
        let shares = approach(&openings, contacts, fps, &[]);
        shares.iter().map(|share| 0.012 * (1.0 - share)).collect()
    }

    #[test]
    fn lips_touch_for_forty_to_ninety_milliseconds_and_move_as_fast_as_lips_do() {
        for length_s in [0.04, 0.08, 0.12] {
            let fps = 240.0;
            let left = left(&[heard(0.4, 0.4 + length_s)], fps, 240);
            let shut = left.iter().filter(|gap| **gap < 0.5e-3).count() as f64 / fps;
            assert!((0.04..0.09).contains(&shut), "{length_s}: {shut}");
            let steps = left
                .windows(2)
                .map(|pair| f64::from((pair[1] - pair[0]).abs()) * fps);
            assert!(steps.fold(0.0, f64::max) < 1.05 * FASTEST_M_S);
            let parting = left[120..].iter().take_while(|gap| **gap < 0.01).count() as f64 / fps;
            assert!(parting < 0.1, "{parting}");
            assert!(left[0] > 0.0119 && left[239] > 0.0119);
        }
    }

    #[test]
    fn a_contact_is_met_at_any_rate_and_a_long_one_lasts() {
        for fps in [12.0, 24.0, 25.0, 29.97, 60.0] {
            for at in 0..20 {
                let start_s = 0.3 + 0.007 * f64::from(at);
                let short = left(&[heard(start_s, start_s + 0.01)], fps, fps as usize);
                assert!(short.iter().any(|gap| *gap < 1e-6), "{fps}, {start_s}");
            }
            let long = left(&[heard(0.2, 0.8)], fps, fps as usize);
            let shut = long.iter().filter(|gap| **gap < 0.5e-3).count() as f64 / fps;
            assert!((0.4..0.7).contains(&shut), "{fps}: {shut}");
        }
    }

    #[test]
    fn lips_touch_when_they_are_nearest() {
        let fps = 100.0;
        let nearest = |t: usize| 0.004 + 0.1 * (t as f32 / 100.0 - 0.46).abs();
        let openings: Vec<f32> = (0..100).map(nearest).collect();
        let shares = approach(&openings, &[heard(0.4, 0.48)], fps, &[]);
        let shut: Vec<usize> = (0..100).filter(|t| shares[*t] > 0.999).collect();
        assert!(shut.contains(&46) && !shut.contains(&42), "{shut:?}");
    }

    #[test]
    fn a_closure_that_is_unsure_goes_part_of_the_way() {
        let half = Contact {
            share: 0.5,
            ..heard(0.4, 0.44)
        };
        let least = left(&[half], 50.0, 50).into_iter().fold(1.0, f32::min);
        assert!((0.005..0.0062).contains(&least), "{least}");
    }

    #[test]
    fn no_lips_move_faster_than_lips() {
        let fps = 60.0;
        let openings: Vec<f32> = (0..60)
            .map(|t| if t % 12 < 6 { 0.004 } else { 0.03 })
            .collect();
        let before: Vec<f32> = openings.iter().map(|opening| opening * 0.7).collect();
        let shares = restore_contacts(&openings, &before, fps);
        let after: Vec<f32> = openings
            .iter()
            .zip(shares)
            .map(|(o, s)| o * (1.0 - s))
            .collect();
        let steps = after.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f32::max) < 5.6e-3, "{after:?}");
        assert!(
            after.iter().zip(&openings).all(|(a, o)| a <= o)
                && after[3] == 0.004
                && after[8] > 0.015
        );
    }

    #[test]
    fn nothing_moves_where_a_frame_is_free() {
        let free = [true; 50];
        let shares = approach(&[0.01; 50], &[heard(0.4, 0.44)], 50.0, &free);
        assert_eq!(shares, [0.0; 50]);
    }

    #[test]
    fn lips_that_stream_close_at_once_and_part_along_the_path() {
        let mut parting = Parting::new(25.0);
        let shares = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let left: Vec<f32> = shares
            .iter()
            .map(|share| 0.012 * (1.0 - parting.next(0.012, *share)))
            .collect();
        assert_eq!((left[0], left[1], left[2]), (0.012, 0.012, 0.0));
        assert!(left[3] > 0.008 && left[3] < 0.011, "{left:?}");
        assert!((left[5] - 0.012).abs() < 1e-6);
        let steps = left.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(steps.fold(0.0, f32::max) < 0.33 / 25.0);
    }
}
