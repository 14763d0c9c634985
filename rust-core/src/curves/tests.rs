use ndarray::{Array2, Array3};
use proptest::prelude::*;

use super::*;
use crate::job::SILENT;

/// The value at frame `x`, computed as in Blender: find the parameter, here by bisection, then
/// evaluate the four points.
fn bezier(points: [[f64; 2]; 4], x: f64) -> f64 {
    let at = |t: f64, c: usize| {
        let u = 1.0 - t;
        u * u * u * points[0][c]
            + 3.0 * u * u * t * points[1][c]
            + 3.0 * u * t * t * points[2][c]
            + t * t * t * points[3][c]
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at(middle, 0) < x {
            low = middle
        } else {
            high = middle
        }
    }
    at(low, 1)
}

fn drawn(values: &[f64], curve: &[Key]) -> Vec<f64> {
    let mut heights = values.to_vec();
    for pair in curve.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (from, to) = (a.row as f64, b.row as f64);
        let reach = REACH * (to - from);
        let points = [
            [from, values[a.row]],
            [from + reach, values[a.row] + reach * a.slope],
            [to - reach, values[b.row] - reach * b.slope],
            [to, values[b.row]],
        ];
        for row in a.row + 1..b.row {
            heights[row] = bezier(points, row as f64);
        }
    }
    heights
}

proptest! {
    #[test]
    fn every_frame_is_within_its_limit_and_fixed_ones_are_exact(
        values in proptest::collection::vec(-1.0f64..1.0, 1..90),
        smooth in 0usize..6,
        limit in 0.001f64..0.5,
        fixed in proptest::collection::vec(proptest::bool::weighted(0.1), 90),
    ) {
        let mut values = values;
        for _ in 0..smooth {
            for at in 1..values.len() {
                values[at] = 0.5 * (values[at] + values[at - 1]);
            }
        }
        let count = values.len();
        let curve = fit(&values, &vec![limit; count], &fixed[..count]).unwrap();
        prop_assert_eq!(curve[0].row, 0);
        prop_assert_eq!(curve[curve.len() - 1].row, count - 1);
        prop_assert!(curve.windows(2).all(|pair| pair[0].row < pair[1].row));
        for (t, height) in drawn(&values, &curve).iter().enumerate() {
            prop_assert!((height - values[t]).abs() <= limit * (1.0 + 1e-6));
            if fixed[t] {
                prop_assert!(curve.iter().any(|key| key.row == t));
            }
        }
        for (a, b) in drawn(&values, &curve).iter().zip(evaluate(&values, &curve)) {
            prop_assert!((a - b).abs() < 1e-9);
        }
    }
}

#[test]
fn an_arch_needs_its_ends_and_its_top() {
    let values: Vec<f64> = (0..=40)
        .map(|t| (f64::from(t) / 40.0 * std::f64::consts::PI).sin())
        .collect();
    let curve = fit(&values, &[0.02; 41], &[false; 41]).unwrap();
    assert!(curve.len() <= 3, "{curve:?}");
    let constant = fit(&[0.3; 41], &[0.002; 41], &[false; 41]).unwrap();
    assert_eq!(constant.len(), 2);
    assert!(constant.iter().all(|key| key.slope.abs() < 1e-9));
}

/// Ten shapes of 400 vertices and smooth weights over 120 frames.
fn moving() -> (Array2<f32>, Array3<f32>) {
    let weights = Array2::from_shape_fn((120, 10), |(t, k)| {
        (0.11 * (k + 1) as f32 * t as f32 * 0.4 + k as f32).sin() / (k + 1) as f32
    });
    let shapes = Array3::from_shape_fn((10, 400, 3), |(k, v, c)| {
        ((k * 7 + v * 3 + c) as f32 * 0.37).sin() * 5.0
    });
    (weights, shapes)
}

#[test]
fn the_sum_of_all_curves_stays_within_the_tolerance_on_every_vertex() {
    let (weights, shapes) = moving();
    let touching: Vec<bool> = (0..120).map(|t| (40..44).contains(&t) || t == 70).collect();
    let fitted = on_face(weights.view(), shapes.view(), 0.2, &touching, SILENT).unwrap();
    let mut missed = Array2::<f32>::zeros((120, 10));
    for (k, curve) in fitted.curves.iter().enumerate() {
        let values: Vec<f64> = weights.column(k).iter().map(|&w| f64::from(w)).collect();
        for (t, height) in drawn(&values, curve).iter().enumerate() {
            missed[[t, k]] = (height - values[t]) as f32;
        }
        for edge in [40, 43, 70] {
            assert!(
                curve.iter().any(|key| key.row == edge),
                "curve {k}, frame {edge}"
            );
        }
    }
    let flat = shapes.to_shape((10, 1200)).unwrap();
    let moved = missed.dot(&flat);
    let mut worst = 0.0f32;
    for (t, row) in moved.rows().into_iter().enumerate() {
        let off = row
            .as_slice()
            .unwrap()
            .chunks(3)
            .map(|v| v[0].hypot(v[1]).hypot(v[2]));
        let off = off.fold(0.0, f32::max);
        assert!(
            off <= if touching[t] { 0.0201 } else { 0.2001 },
            "frame {t}: {off}"
        );
        worst = worst.max(off);
    }
    assert!((f64::from(worst) - fitted.error).abs() < 1e-4);
    let keys: usize = fitted.curves.iter().map(Vec::len).sum();
    assert!(keys < 600, "{keys} keys of 1200");
}

#[test]
fn one_curve_and_none_are_fitted_too() {
    let (weights, shapes) = moving();
    for count in [0, 1] {
        let (weights, shapes) = (
            weights.slice(ndarray::s![.., ..count]),
            shapes.slice(ndarray::s![..count, .., ..]),
        );
        let fitted = on_face(weights, shapes, 0.2, &[false; 120], SILENT).unwrap();
        assert_eq!(fitted.curves.len(), count);
        assert!(fitted.error <= 0.2);
    }
    let none = weights.slice(ndarray::s![..0, ..]);
    let fitted = on_face(none, shapes.view(), 0.2, &[], SILENT).unwrap();
    assert!(fitted.curves.iter().all(Vec::is_empty));
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    assert!(fit(&[0.0, 1.0], &[0.1], &[false; 2]).is_err());
    assert!(fit(&[0.0, f64::NAN], &[0.1; 2], &[false; 2]).is_err());
    assert!(fit(&[0.0, 1.0], &[0.1, 0.0], &[false; 2]).is_err());
    assert!(fit_each(&[vec![0.0]], &[0.1, 0.2], &[false]).is_err());
    let (weights, shapes) = moving();
    let few = shapes.slice(ndarray::s![..3, .., ..]);
    assert!(on_face(weights.view(), few, 0.2, &[false; 120], SILENT).is_err());
    let stop = |_| false;
    let stopped = on_face(weights.view(), shapes.view(), 0.2, &[false; 120], &stop);
    assert!(matches!(stopped, Err(crate::Error::Cancelled)));
}
