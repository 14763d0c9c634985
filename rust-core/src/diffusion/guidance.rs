//! Classifier-free guidance, Ho & Salimans 2021, and a second condition that acts only where a mask
//! allows it.

use ndarray::{Array2, ArrayRef2, Zip};

/// `G_∅ + α (G_AC − G_∅)`, `[T, C]`.
pub fn guided(
    unconditional: &ArrayRef2<f32>,
    conditional: &ArrayRef2<f32>,
    alpha: f32,
) -> Array2<f32> {
    Zip::from(unconditional)
        .and(conditional)
        .map_collect(|none, with| none + alpha * (with - none))
}

/// `base + βZ ⊙ (G_ACF − other)`, Cafe-Talk eq. 6, in place; `mask` is βZ, `[T, C]`.
///
/// `other` is `G_∅`, as the paper prints it, or `G_AC`. With `G_AC` the speech does not count
/// `α + β` times in a slot.
///
/// # Panics
/// If the shapes differ.
pub fn mask_guided(
    base: &mut Array2<f32>,
    fine: &ArrayRef2<f32>,
    other: &ArrayRef2<f32>,
    mask: &ArrayRef2<f32>,
) {
    let add = |base: &mut f32, mask: &f32, fine: &f32, other: &f32| {
        if *mask != 0.0 {
            *base += mask * (fine - other);
        }
    };
    Zip::from(base).and(mask).and(fine).and(other).for_each(add);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_outside_the_mask_keep_their_bits() {
        let x = |seed: f32| {
            Array2::from_shape_fn((6, 3), |(t, c)| (t as f32 * 0.7 + c as f32 + seed).sin())
        };
        let (none, conditional, fine) = (x(0.0), x(1.0), x(2.0));
        let base = guided(&none, &conditional, 1.5);
        let mut out = base.clone();
        let mask = ndarray::array![0.0, 0.0, 2.0, 0.0, 0.5, 0.0];
        let mask = mask.insert_axis(ndarray::Axis(1)) * ndarray::array![[1.0, 1.0, 0.0]];
        mask_guided(&mut out, &fine, &conditional, &mask);
        assert_eq!(out.column(2), base.column(2));
        for t in [0, 1, 3, 5] {
            assert_eq!(out.row(t), base.row(t));
        }
        assert!(
            (out[[2, 1]] - (base[[2, 1]] + 2.0 * (fine[[2, 1]] - conditional[[2, 1]]))).abs()
                < 1e-6
        );
        assert_eq!(guided(&none, &conditional, 0.0), none);
    }
}
