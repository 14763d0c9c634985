//! Makes events give way to speech: their jaw and chin follow the opening of the spoken mouth.
//!
//! Twin of `training/systems/cafe_talk/priority.py`. A jaw that stays down for a whole slot, or a
//! chin that stays up, hides the speech (Cafe-Talk's own table 4: lower units cost four times the
//! SyncD of upper ones). Here their strength depends on how far speech opens the mouth, relative to
//! the widest opening nearby. They give way where speech closes the mouth and act fully in silence.

use ndarray::{Array2, ArrayRef2};

/// Shapes that hold the mouth open or shut.
const YIELDING: [&str; 2] = ["jawOpen", "mouthShrugLower"];
const OPENS: &str = "jawOpen";
const CLOSES: &str = "mouthClose";
/// Frames to either side that count as near, 0.04 s each: a syllable or two.
const NEAR_FRAMES: usize = 12;
/// Up to this weight of `jawOpen`, nobody is speaking.
const RESTING: f32 = 0.03;

/// Columns of the shapes that give way and of those that measure the mouth's opening.
#[derive(Debug, Clone)]
pub(super) struct Priority {
    yielding: Vec<usize>,
    opens: Option<usize>,
    closes: Option<usize>,
}

impl Priority {
    /// Finds the columns among a model's shapes.
    pub(super) fn new(shapes: &[String]) -> Priority {
        let named = |target: &str| shapes.iter().position(|name| name == target);
        Priority {
            yielding: YIELDING.into_iter().filter_map(named).collect(),
            opens: named(OPENS),
            closes: named(CLOSES),
        }
    }

    /// Whether a mask `[T, S]` has a strength for a shape that gives way.
    pub(super) fn concerns(&self, mask: &ArrayRef2<f32>) -> bool {
        let is_requested = |&s: &usize| mask.column(s).iter().any(|strength| *strength != 0.0);
        self.yielding.iter().any(is_requested)
    }

    /// Lowers a mask `[T, S]` for speech. `spoken`: `[T, S]`, weights without events. The mouth's
    /// opening is `jawOpen − mouthClose`, relative to the widest opening within half a second. Its
    /// square multiplies the strengths of jaw and chin. Frames in which `over_speech` is true keep
    /// their strengths.
    pub(super) fn give_way(
        &self,
        mask: &mut Array2<f32>,
        spoken: &ArrayRef2<f32>,
        over_speech: &[bool],
    ) {
        let at = |t: usize, column: Option<usize>| column.map_or(0.0, |s| spoken[[t, s]]);
        let opening: Vec<f32> = (0..spoken.nrows())
            .map(|t| (at(t, self.opens) - at(t, self.closes)).max(0.0))
            .collect();
        for t in (0..opening.len()).filter(|&t| !over_speech[t]) {
            let last = (t + NEAR_FRAMES + 1).min(opening.len());
            let near = &opening[t.saturating_sub(NEAR_FRAMES)..last];
            let widest = near.iter().copied().fold(0.0, f32::max);
            let share = (opening[t] + RESTING) / (widest + RESTING);
            for &s in &self.yielding {
                mask[[t, s]] *= share * share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 60;

    fn shapes() -> Vec<String> {
        ["jawOpen", "mouthClose", "mouthSmileLeft"]
            .map(str::to_owned)
            .to_vec()
    }

    /// A jaw that opens by 0.3 in frames 20 to 23, 30 to 33 and 40 to 43.
    fn spoken() -> Array2<f32> {
        let opens = |t: usize| (20..44).contains(&t) && t % 10 < 4;
        Array2::from_shape_fn((FRAMES, 3), |(t, s)| match (s, opens(t)) {
            (0, true) => 0.3,
            (1, _) => 0.0,
            _ => 0.02,
        })
    }

    #[test]
    fn a_dropped_jaw_follows_the_speech_and_a_smile_stays() {
        let priority = Priority::new(&shapes());
        let mut mask = Array2::from_elem((FRAMES, 3), 1.5);
        priority.give_way(&mut mask, &spoken(), &[false; FRAMES]);
        assert_eq!(mask[[31, 0]], 1.5);
        assert!(mask[[26, 0]] < 0.1, "{}", mask[[26, 0]]);
        assert!(mask.column(2).iter().all(|strength| *strength == 1.5));
    }

    #[test]
    fn nothing_gives_way_in_silence_or_over_the_speech() {
        let priority = Priority::new(&shapes());
        let mut mask = Array2::from_elem((FRAMES, 3), 1.0);
        priority.give_way(&mut mask, &spoken(), &[true; FRAMES]);
        assert!(mask.iter().all(|strength| *strength == 1.0));
        priority.give_way(&mut mask, &spoken(), &[false; FRAMES]);
        assert!((0..8).chain(56..FRAMES).all(|t| mask[[t, 0]] == 1.0));
    }

    #[test]
    fn only_jaw_and_chin_are_its_concern() {
        let priority = Priority::new(&shapes());
        let mut mask = Array2::zeros((FRAMES, 3));
        mask[[9, 2]] = 1.0;
        assert!(!priority.concerns(&mask));
        mask[[9, 0]] = 0.1;
        assert!(priority.concerns(&mask));
    }
}
