//! Whether the face follows a control within the time slot set for it.

use std::ops::Range;

/// Frames on either side of a slot to compare it with (Cafe-Talk §4.2.1: 0.2 s at 25 fps).
const NEIGHBOURS: usize = 5;

/// Control rate of one unit: its largest value within the slot minus its mean over the five frames
/// before and the five frames after (Cafe-Talk eq. 7, Chen et al. 2025).
///
/// `values`: the unit's weight in every frame; `slot`: a range of frames, its end excluded. `None`
/// if the slot contains no frame of the clip or has no neighbouring frame.
pub fn control_rate(values: &[f64], slot: &Range<usize>) -> Option<f64> {
    let inside = values.get(slot.start..slot.end.min(values.len()))?;
    let most = inside.iter().copied().reduce(f64::max)?;
    let beside = beside(values.len(), slot);
    let count = beside.clone().count();
    let sum: f64 = beside.map(|t| values[t]).sum();
    (count > 0).then(|| most - sum / count as f64)
}

/// How much a slot changes the frames around it as a share of how much it changes its own frames.
/// Both are means of `|with − without|`.
///
/// `None` as for [`control_rate`], and if the slot changes nothing in its own frames.
pub fn control_leak(with: &[f64], without: &[f64], slot: &Range<usize>) -> Option<f64> {
    let count = with.len().min(without.len());
    let mean = |frames: &mut dyn Iterator<Item = usize>| {
        let (sum, count) = frames.fold((0.0, 0), |(sum, n), t| {
            (sum + (with[t] - without[t]).abs(), n + 1)
        });
        (count > 0).then(|| sum / f64::from(count))
    };
    let within = mean(&mut (slot.start..slot.end.min(count)))?;
    let around = mean(&mut beside(count, slot))?;
    (within > 0.0).then(|| around / within)
}

fn beside(count: usize, slot: &Range<usize>) -> impl Iterator<Item = usize> + Clone + use<> {
    let before = slot.start.saturating_sub(NEIGHBOURS)..slot.start.min(count);
    let behind = slot.end.min(count)..(slot.end + NEIGHBOURS).min(count);
    before.chain(behind)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.1 before frame 10, a peak of 0.9 within frames 10 to 15, 0.3 after them.
    fn peak() -> Vec<f64> {
        let value = |t: usize| match t {
            0..10 => 0.1,
            12 => 0.9,
            10..15 => 0.5,
            _ => 0.3,
        };
        (0..25).map(value).collect()
    }

    #[test]
    fn the_peak_counts_over_ten_neighbours() {
        let rate = control_rate(&peak(), &(10..15)).unwrap();
        assert!((rate - (0.9 - 0.2)).abs() < 1e-12);
    }

    #[test]
    fn at_the_ends_there_are_fewer_neighbours() {
        assert!((control_rate(&peak(), &(0..10)).unwrap() - (0.1 - 0.58)).abs() < 1e-12);
        assert_eq!(control_rate(&peak(), &(0..25)), None);
        assert_eq!(control_rate(&peak(), &(30..40)), None);
        assert_eq!(control_rate(&[], &(0..1)), None);
    }

    #[test]
    fn leak_is_what_goes_beyond_as_a_share() {
        let mut with = vec![0.0; 25];
        with[10..15].fill(0.8);
        with[15] = 0.8;
        let leak = control_leak(&with, &[0.0; 25], &(10..15)).unwrap();
        assert!((leak - 0.1).abs() < 1e-12);
        assert_eq!(control_leak(&with, &with, &(10..15)), None);
    }
}
