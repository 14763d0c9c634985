//! The delay of one curve against another, finer than a frame.

use super::Moments;

/// Correlations of a prediction with the truth at delays of −`most` to `most` frames, summed over
/// clips.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LagCurve {
    at: Vec<Moments>,
}

impl LagCurve {
    /// Correlates one clip. Delays shift the curves within the clip, so clips never mix.
    pub fn of(prediction: &[f64], truth: &[f64], most: usize) -> Self {
        let count = prediction.len().min(truth.len());
        let reach = most as isize;
        let at = |lag: isize| {
            let late = (lag.max(0) as usize).min(count);
            let early = ((-lag).max(0) as usize).min(count);
            Moments::of(
                &prediction[late..count - early],
                &truth[early..count - late],
            )
        };
        LagCurve {
            at: (-reach..=reach).map(at).collect(),
        }
    }

    /// Adds another clip, which must have the same `most`.
    pub fn add(&mut self, other: &LagCurve) {
        self.at.resize(other.at.len(), Moments::default());
        for (sum, more) in self.at.iter_mut().zip(&other.at) {
            sum.add(more);
        }
    }

    /// The delay in frames at which the correlation is best, and that correlation.
    ///
    /// A positive delay means that the prediction is late. A parabola through the best frame and
    /// its neighbours gives the delay between frames; at either end of the range it is a whole
    /// number.
    pub fn best(&self) -> (f64, f64) {
        let r: Vec<f64> = self.at.iter().map(Moments::r).collect();
        let middle = r.len() / 2;
        // On a tie, a delay of zero wins.
        let best = (0..r.len()).fold(middle, |best, k| if r[k] > r[best] { k } else { best });
        let Some(&top) = r.get(best) else {
            return (0.0, 0.0);
        };
        let frames = best as f64 - middle as f64;
        if best == 0 || best + 1 == r.len() {
            return (frames, top);
        }
        let (offset, height) = parabola([r[best - 1], top, r[best + 1]]);
        (frames + offset, height)
    }
}

/// Place, −½ to ½, and height of the extremum of the parabola through three values at −1, 0 and 1.
/// The middle value must be the largest or smallest of the three.
pub(super) fn parabola([before, here, after]: [f64; 3]) -> (f64, f64) {
    let bend = before - 2.0 * here + after;
    if bend.abs() > 1e-12 {
        let offset = (0.5 * (before - after) / bend).clamp(-0.5, 0.5);
        (offset, here - 0.25 * (before - after) * offset)
    } else {
        (0.0, here)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(delay: f64) -> Vec<f64> {
        let at = |t: i32| f64::from(t) - delay;
        (0..200)
            .map(|t| (at(t) * 0.37).sin() + (at(t) * 0.23).cos())
            .collect()
    }

    #[test]
    fn a_delay_between_frames_is_found() {
        for delay in [0.0, 0.3, -1.4, 2.5] {
            let (lag, r) = LagCurve::of(&wave(delay), &wave(0.0), 5).best();
            assert!((lag - delay).abs() < 0.03, "{delay}: {lag}");
            assert!(r > 0.98, "{r}");
        }
    }

    #[test]
    fn clips_add_up() {
        let mut both = LagCurve::of(&wave(1.0), &wave(0.0), 4);
        both.add(&LagCurve::of(&wave(3.0), &wave(2.0), 4));
        assert!((both.best().0 - 1.0).abs() < 0.03);
        assert_eq!(LagCurve::default().best(), (0.0, 0.0));
        assert_eq!(LagCurve::of(&[1.0], &[1.0], 3).best(), (0.0, 0.0));
    }

    #[test]
    fn a_parabola_gives_back_its_top() {
        let y = |x: f64| 3.0 - 2.0 * (x - 0.2).powi(2);
        let (place, height) = parabola([y(-1.0), y(0.0), y(1.0)]);
        assert!((place - 0.2).abs() < 1e-12 && (height - 3.0).abs() < 1e-12);
    }
}
