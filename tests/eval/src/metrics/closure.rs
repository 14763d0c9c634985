//! Lip closure: whether and when the lips meet where a plosive or an m requires it.

use super::{lag::parabola, quantile};

/// The mouth counts as open at this quantile of the clip's gap.
const OPEN: f64 = 0.95;
/// How far outside the window to search for the gap's minimum, seconds.
const SEARCH_S: f64 = 0.1;

/// One closure that a sound of the speech requires.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// Smallest gap within the window, in the gap's unit.
    pub gap: f64,
    /// The smallest gap as a share of the clip's 95 % quantile; 1 where that quantile is 0.
    pub gap_share: f64,
    /// Time of the gap's minimum, searched up to 0.1 s outside the window, minus the window's
    /// middle, seconds.
    pub offset_s: f64,
}

/// The closures of a clip.
///
/// `gap`: the inner-lip gap, frame `t` at `t / fps` seconds; `windows`: start and end of each
/// closure, seconds. Skips windows that contain no frame of the clip.
pub fn closures(gap: &[f64], fps: f64, windows: &[(f64, f64)]) -> Vec<Closure> {
    let open = quantile(gap, OPEN);
    let closures_of_windows = windows.iter().filter_map(|&(from, to)| {
        let smallest = minimum(gap, fps, from, to)?;
        let place = minimum(gap, fps, from - SEARCH_S, to + SEARCH_S)?.0;
        Some(Closure {
            gap: smallest.1,
            gap_share: if open > 0.0 { smallest.1 / open } else { 1.0 },
            offset_s: place - 0.5 * (from + to),
        })
    });
    closures_of_windows.collect()
}

/// Time and value of the smallest gap in the frames from `from` to `to` seconds. Where neither
/// neighbouring frame is lower, a parabola through the three gives the time between frames.
fn minimum(gap: &[f64], fps: f64, from: f64, to: f64) -> Option<(f64, f64)> {
    let first = (from * fps).ceil().max(0.0) as usize;
    let last = ((to * fps).floor().max(-1.0) + 1.0) as usize;
    let least = (first..last.min(gap.len())).min_by(|a, b| gap[*a].total_cmp(&gap[*b]))?;
    let inner = least > 0 && least + 1 < gap.len();
    let offset = if inner && gap[least - 1] >= gap[least] && gap[least + 1] >= gap[least] {
        parabola([gap[least - 1], gap[least], gap[least + 1]]).0
    } else {
        0.0
    };
    Some(((least as f64 + offset) / fps, gap[least]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap of 10 that closes for a moment at 1 s and half closes at 2 s.
    fn gap() -> Vec<f64> {
        (0..75)
            .map(|t| match t {
                25 => 0.0,
                24 | 26 => 4.0,
                50 => 5.0,
                _ => 10.0,
            })
            .collect()
    }

    #[test]
    fn a_shut_mouth_in_the_window_is_a_closure() {
        let result = closures(&gap(), 25.0, &[(0.96, 1.04), (1.96, 2.04), (2.4, 2.6)]);
        let shares: Vec<f64> = result.iter().map(|c| c.gap_share).collect();
        assert_eq!(shares, [0.0, 0.5, 1.0]);
        let gaps: Vec<f64> = result.iter().map(|c| c.gap).collect();
        assert_eq!(gaps, [0.0, 5.0, 10.0]);
        assert!(result[0].offset_s.abs() < 1e-9);
    }

    #[test]
    fn a_late_minimum_is_late_even_outside_the_window() {
        let result = closures(&gap(), 25.0, &[(0.86, 0.94)]);
        assert!((result[0].offset_s - 0.1).abs() < 1e-9);
        assert_eq!(result[0].gap_share, 1.0);
    }

    #[test]
    fn windows_outside_the_clip_do_not_count() {
        assert!(closures(&gap(), 25.0, &[(-1.0, -0.5), (3.5, 4.0)]).is_empty());
        assert!(closures(&[], 25.0, &[(0.0, 1.0)]).is_empty());
    }
}
