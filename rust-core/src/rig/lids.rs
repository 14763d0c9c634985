//! Makes the lids meet in a blink, and keeps them from passing through each other in other shapes.
//!
//! How far a lid has to travel depends on how wide the eye is open, and this differs between heads
//! more than a network trained on two faces can know. So each shape that narrows an eye is scaled
//! as a whole: a blink until the lids meet, any other shape only down, if its lids would cross.
//!
//! Lids without a slit stay at rest in every shape, and the brow comes down in a blink instead.

use std::ops::Range;

use glam::Vec3;
use ndarray::{Array3, Axis, s};

use super::{ARKIT, names::arkit};
use crate::{deform::fade, mesh::ibug::LANDMARKS};

/// Pairs of upper and lower lid landmarks of each eye: the subject's right one, then the left one.
const LIDS: [(&str, [(usize, usize); 2]); 2] = [
    ("Right", [(37, 41), (38, 40)]),
    ("Left", [(43, 47), (44, 46)]),
];
/// The most by which a blink is stretched, as a factor.
const MOST: f32 = 1.6;
/// Landmarks of the brow of each eye, in the order of [`LIDS`].
const BROWS: [Range<usize>; 2] = [17..22, 22..27];
/// Landmarks of the lids of each eye, in the order of [`LIDS`].
const MARKS: [Range<usize>; 2] = [36..42, 42..48];
/// Within the first distance of lids that cannot close, no shape moves the skin. Beyond the second
/// distance all move it fully. Widths of the eye.
const REST_WIDTHS: (f32, f32) = (0.05, 0.65);
/// A shape that narrows the eye by less than this is left alone, centimetres.
const LEAST_CM: f32 = 0.05;

/// Scales the shapes of both eyes in `deltas` `[S, V, 3]`, which start with [`ARKIT`]'s.
///
/// `landmarks`: those of the neutral face, centimetres. `vertices`: the vertex nearest to each.
pub(super) fn meet(
    deltas: &mut Array3<f32>,
    landmarks: &[[f32; 3]; LANDMARKS],
    vertices: &[u32; LANDMARKS],
) {
    for (side, pairs) in LIDS {
        let opening: f32 = pairs
            .iter()
            .map(|&(u, l)| landmarks[u][1] - landmarks[l][1])
            .sum();
        for (s, name) in ARKIT.iter().enumerate() {
            if !(name.starts_with("eye") && name.ends_with(side)) {
                continue;
            }
            let mut shape = deltas.index_axis_mut(Axis(0), s);
            let at = |n: usize| shape[[vertices[n] as usize, 1]];
            let narrowing: f32 = pairs.iter().map(|&(u, l)| at(l) - at(u)).sum();
            if narrowing < pairs.len() as f32 * LEAST_CM {
                continue;
            }
            let most = if name.starts_with("eyeBlink") {
                MOST
            } else {
                1.0
            };
            let scale = (opening / narrowing).clamp(0.0, most);
            shape.mapv_inplace(|x| scale * x);
        }
    }
}

/// Leaves the lids of eyes that cannot close at rest, in every shape. In a blink the brow comes down
/// by `squint_cm`.
///
/// `can_close`: the subject's right eye, then the left one. `vertices`: the vertex nearest to each
/// landmark. `positions` `[V]`: centimetres.
pub(super) fn rest(
    deltas: &mut Array3<f32>,
    (can_close, squint_cm): ([bool; 2], f32),
    vertices: &[u32; LANDMARKS],
    positions: &[[f32; 3]],
) {
    let sides = LIDS.iter().zip(BROWS).zip(MARKS).zip(can_close);
    for ((((side, _), brow), marks), _) in sides.filter(|(_, can_close)| !can_close) {
        for (s, name) in ARKIT.iter().enumerate() {
            if name.starts_with("eye") && name.ends_with(side) {
                deltas.index_axis_mut(Axis(0), s).fill(0.0);
            }
        }
        let frown = deltas
            .index_axis(Axis(0), arkit(&format!("browDown{side}")))
            .to_owned();
        let count = brow.len() as f32;
        let drop = -brow.map(|n| frown[[vertices[n] as usize, 1]]).sum::<f32>() / count;
        if drop > LEAST_CM {
            let mut blink = deltas.index_axis_mut(Axis(0), arkit(&format!("eyeBlink{side}")));
            blink.scaled_add((squint_cm / drop).min(1.0), &frown);
        }
        let marks: Vec<[f32; 3]> = marks.map(|n| positions[vertices[n] as usize]).collect();
        let width = Vec3::from(marks[0]).distance(marks[3].into());
        let span = (REST_WIDTHS.0 * width, REST_WIDTHS.1 * width);
        for (v, p) in positions.iter().enumerate() {
            let share = fade::beyond(&marks, *p, span);
            if share < 1.0 {
                let mut shapes = deltas.slice_mut(s![..ARKIT.len(), v, ..]);
                shapes.mapv_inplace(|x| share * x);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lids_without_a_slit_rest_and_the_brow_comes_down_in_a_blink() {
        let vertices = std::array::from_fn(|n| n as u32);
        let mut deltas = Array3::zeros((ARKIT.len(), LANDMARKS, 3));
        let mut set = |name: &str, n: usize, y: f32| deltas[[arkit(name), n, 1]] = y;
        for side in ["Left", "Right"] {
            (36..48).for_each(|n| set(&format!("eyeBlink{side}"), n, -1.0));
            (17..27).for_each(|n| set(&format!("browDown{side}"), n, -0.6));
        }
        let positions: Vec<[f32; 3]> = (0..LANDMARKS).map(|n| [2.0 * n as f32, 0.0, 0.0]).collect();
        rest(&mut deltas, ([true, false], 0.3), &vertices, &positions);
        let at = |name: &str, n: usize| deltas[[arkit(name), n, 1]];
        assert_eq!(
            (at("eyeBlinkLeft", 43), at("eyeBlinkRight", 37)),
            (0.0, -1.0)
        );
        assert!((at("eyeBlinkLeft", 24) + 0.3).abs() < 1e-6);
        assert_eq!(at("eyeBlinkRight", 24), 0.0);
    }

    /// Shapes after `meet`. Every landmark is a vertex, the lids are `opening` apart, and each
    /// shape narrows the eyes by 1 cm.
    fn after(opening: f32) -> Array3<f32> {
        let mut landmarks = [[0.0; 3]; LANDMARKS];
        let mut deltas = Array3::zeros((52, LANDMARKS, 3));
        for (_, pairs) in LIDS {
            for (upper, lower) in pairs {
                landmarks[upper][1] = opening;
                deltas.slice_mut(ndarray::s![.., upper, 1]).fill(-0.8);
                deltas.slice_mut(ndarray::s![.., lower, 1]).fill(0.2);
            }
        }
        let vertices = std::array::from_fn(|n| n as u32);
        meet(&mut deltas, &landmarks, &vertices);
        deltas
    }

    fn gap(deltas: &Array3<f32>, name: &str, opening: f32) -> f32 {
        let s = ARKIT.iter().position(|n| *n == name).unwrap();
        opening + deltas[[s, 44, 1]] - deltas[[s, 46, 1]]
    }

    #[test]
    fn a_blink_closes_eyes_of_any_opening() {
        for opening in [0.1, 0.6, 1.0, 1.4] {
            assert!(gap(&after(opening), "eyeBlinkLeft", opening).abs() < 1e-5);
        }
    }

    #[test]
    fn other_shapes_stop_where_lids_meet_and_are_never_stretched() {
        assert!(gap(&after(0.4), "eyeLookDownLeft", 0.4).abs() < 1e-5);
        assert!((gap(&after(1.4), "eyeLookDownLeft", 1.4) - 0.4).abs() < 1e-5);
        assert!((gap(&after(0.4), "jawOpen", 0.4) + 0.6).abs() < 1e-5);
    }
}
