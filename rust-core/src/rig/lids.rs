//! Makes the lids meet in a blink, and keeps them from passing through each other in other shapes.
//!
//! How far a lid has to travel depends on how wide the eye is open, and this differs between heads
//! more than a network trained on two faces can know. So each shape that narrows an eye is scaled
//! as a whole: a blink until the lids meet, any other shape only down, if its lids would cross.

use ndarray::{Array3, Axis};

use super::ARKIT;
use crate::mesh::ibug::LANDMARKS;

/// Pairs of upper and lower lid landmarks of each eye: the subject's right one, then the left one.
const LIDS: [(&str, [(usize, usize); 2]); 2] = [
    ("Right", [(37, 41), (38, 40)]),
    ("Left", [(43, 47), (44, 46)]),
];
/// The most by which a blink is stretched, as a factor.
const MOST: f32 = 1.6;
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

#[cfg(test)]
mod tests {
    use super::*;

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
