//! Turns a take into weights of the shapes of its mesh, for files that avatars and engines open.

use std::sync::Arc;

use ndarray::{Array1, Array2, Array3, ArrayView3, Axis, s};

use super::moved::Moved;
use crate::{
    Result,
    face::Rig,
    job::ProgressFn,
    mesh::ibug::LANDMARKS,
    motion::Life,
    rig::{ARKIT, SolveOptions, is_of_mouth, meeting_lips, parts::GAZE_DEGREES, solve},
};

/// Visemes for which VRM has expressions, in the order of [`VOWELS`].
pub(super) const VOWEL_SHAPES: [&str; 5] =
    ["viseme_aa", "viseme_I", "viseme_U", "viseme_E", "viseme_O"];
/// The VRM expressions for them.
pub(super) const VOWELS: [&str; 5] = ["aa", "ih", "ou", "ee", "oh"];

/// The shapes of a take's mesh, for which its weights are solved.
#[derive(Debug, Clone)]
pub struct TakeShapes {
    rig: Arc<Rig>,
    lips: Vec<[u32; 2]>,
}

impl TakeShapes {
    /// `landmarks`: the vertex nearest to each landmark. They determine where the lips meet.
    pub fn new(rig: Arc<Rig>, landmarks: &[u32; LANDMARKS]) -> TakeShapes {
        TakeShapes {
            rig,
            lips: meeting_lips(landmarks),
        }
    }

    /// The same with another rig of the same mesh.
    pub(super) fn of_rig(&self, rig: Rig) -> TakeShapes {
        TakeShapes {
            rig: Arc::new(rig),
            lips: self.lips.clone(),
        }
    }

    pub(super) fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Pairs of vertices of the upper and the lower lip that meet.
    pub(super) fn lips(&self) -> &[[u32; 2]] {
        &self.lips
    }

    /// Solves a clip `[T, V, 3]` in mesh units for weights `[T, 52]` of [`ARKIT`]. The weights of
    /// `eyeLook` shapes come from the gaze of the take, because the clip does not turn the eyes.
    ///
    /// # Errors
    /// Those of [`solve`].
    pub(super) fn arkit(
        &self,
        moved: ArrayView3<'_, f32>,
        life: Option<&Life>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        self.weights_of(&ARKIT, moved, life, progress)
    }

    /// Solves a clip as [`TakeShapes::arkit`] does for weights `[T, S]` of the shapes `names` `[S]`.
    ///
    /// # Errors
    /// Those of [`solve`].
    pub(super) fn weights_of(
        &self,
        names: &[&str],
        moved: ArrayView3<'_, f32>,
        life: Option<&Life>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let looks = looks(moved.dim().0, life);
        let is_looking = looks.iter().any(|w| *w > 0.0);
        let mut weights = Array2::zeros((moved.dim().0, names.len()));
        for (mut column, name) in weights.columns_mut().into_iter().zip(names) {
            if let Some(place) = ARKIT.iter().position(|known| known == name) {
                column.assign(&looks.column(place));
            }
        }
        let left = if is_looking {
            self.without(names, &weights, moved)
        } else {
            moved.to_owned()
        };
        let is_free = |name: &&str| !(is_looking && name.starts_with("eyeLook"));
        let free: Vec<&str> = names.iter().copied().filter(is_free).collect();
        let place = |name: &str| names.iter().position(|known| *known == name);
        let take = |s: &str, t, w| {
            if let Some(place) = place(s) {
                weights[[t, place]] = w;
            }
        };
        self.solve(&free, left.view(), take, progress)?;
        Ok(weights)
    }

    /// [`TakeShapes::arkit`] of a whole take, stretch by stretch if it is long.
    ///
    /// # Errors
    /// Those of [`solve`], and `Io` of the file in which a long take waits.
    pub(super) fn arkit_of(
        &self,
        moved: &mut Moved,
        life: Option<&Life>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        moved.solve(ARKIT.len(), |range, part| {
            let life = life.map(|life| life.frames_of(range));
            self.arkit(part, life.as_ref(), progress)
        })
    }

    /// Weights `[T, 5]` of [`VOWELS`], solved without any other shapes of the mouth.
    ///
    /// # Errors
    /// Those of [`solve`].
    pub(super) fn vowels(
        &self,
        moved: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let others = ARKIT.into_iter().filter(|name| !is_of_mouth(name));
        let names: Vec<&str> = VOWEL_SHAPES.into_iter().chain(others).collect();
        let mut weights = Array2::zeros((moved.dim().0, VOWELS.len()));
        let take = |s, t, w| {
            if let Some(vowel) = VOWEL_SHAPES.iter().position(|known| *known == s) {
                weights[[t, vowel]] = w;
            }
        };
        self.solve(&names, moved, take, progress)?;
        Ok(weights)
    }

    /// The clip minus the displacements that these weights `[T, S]` of the shapes `names` `[S]` cause.
    fn without(
        &self,
        names: &[&str],
        weights: &Array2<f32>,
        moved: ArrayView3<'_, f32>,
    ) -> Array3<f32> {
        let mut left = moved.to_owned();
        for (name, column) in names.iter().zip(weights.columns()) {
            let Some(shape) = self.shape(name) else {
                continue;
            };
            for (mut frame, w) in left.outer_iter_mut().zip(column) {
                if *w > 0.0 {
                    frame.scaled_add(-w, &self.rig.deltas.index_axis(Axis(0), shape));
                }
            }
        }
        left
    }

    /// Solves for the shapes of these names that the rig has. `take` receives name, frame and weight.
    fn solve<'a>(
        &self,
        names: &[&'a str],
        moved: ArrayView3<'_, f32>,
        mut take: impl FnMut(&'a str, usize, f32),
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let known: Vec<(&str, usize)> = names
            .iter()
            .filter_map(|name| Some((*name, self.shape(name)?)))
            .collect();
        let places: Vec<usize> = known.iter().map(|(_, place)| *place).collect();
        let part = Rig {
            names: known.iter().map(|(name, _)| (*name).to_owned()).collect(),
            deltas: self.rig.deltas.select(Axis(0), &places),
            reports: Vec::new(),
        };
        let options = SolveOptions::default();
        let solved = solve(&part, known.len(), moved, &self.lips, &options, progress)?;
        for (column, (name, _)) in solved.weights.columns().into_iter().zip(&known) {
            column
                .iter()
                .enumerate()
                .for_each(|(t, w)| take(name, t, *w));
        }
        Ok(())
    }

    fn shape(&self, name: &str) -> Option<usize> {
        self.rig.names.iter().position(|known| known == name)
    }
}

/// Weights `[T, 52]` with the gaze in the `eyeLook` shapes. All other weights are 0.
pub(super) fn looks(frames: usize, life: Option<&Life>) -> Array2<f32> {
    let mut weights = Array2::zeros((frames, ARKIT.len()));
    if let Some(life) = life {
        for (mut column, name) in weights.columns_mut().into_iter().zip(ARKIT) {
            if name.starts_with("eyeLook") {
                column.assign(&look_weights(name, life));
            }
        }
    }
    weights
}

/// Weights `[T]` of the shape of this name, which begins with `eyeLook`, from the gaze of a take.
pub(super) fn look_weights(name: &str, life: &Life) -> Array1<f32> {
    let [up, down, inward, outward] = GAZE_DEGREES;
    // The right eye comes first. It looks in when it looks to the subject's left.
    let (eye, way, inner) = match name.strip_suffix("Right") {
        Some(way) => (0, way, 1.0),
        None => (1, name.trim_end_matches("Left"), -1.0),
    };
    let (axis, sign, most) = match way {
        "eyeLookUp" => (1, 1.0, up),
        "eyeLookDown" => (1, -1.0, down),
        "eyeLookIn" => (0, inner, inward),
        _ => (0, -inner, outward),
    };
    let angles = life.gaze.slice(s![.., eye, axis]);
    angles.mapv(|a| (sign * a.to_degrees() / most).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::SILENT;

    /// A rig in which each of these shapes moves two vertices of its own along y.
    fn rig(names: &[&str]) -> Arc<Rig> {
        let mut deltas = Array3::zeros((names.len(), 2 * names.len(), 3));
        for shape in 0..names.len() {
            deltas
                .slice_mut(s![shape, 2 * shape..2 * shape + 2, 1])
                .fill(0.01);
        }
        Arc::new(Rig {
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            deltas,
            reports: Vec::new(),
        })
    }

    fn number(name: &str) -> usize {
        let place = ARKIT.iter().position(|known| *known == name);
        place.expect("a name of ARKit")
    }

    #[test]
    fn eyes_look_where_the_take_has_them_look() {
        let shapes = TakeShapes::new(
            rig(&["eyeLookUpLeft", "eyeLookInRight", "jawOpen"]),
            &[0; 68],
        );
        let mut life = Life::still(2);
        life.gaze[[1, 0, 0]] = 15f32.to_radians();
        life.gaze[[1, 1, 1]] = 12.5f32.to_radians();
        let mut moved = Array3::zeros((2, 6, 3));
        moved.slice_mut(s![1, 4.., 1]).fill(0.005);
        let weights = shapes.arkit(moved.view(), Some(&life), SILENT).unwrap();
        let at = |t: usize, name: &str| weights[[t, number(name)]];
        assert!((at(1, "eyeLookUpLeft") - 0.5).abs() < 1e-6);
        assert!((at(1, "eyeLookInRight") - 0.5).abs() < 1e-6);
        assert!(
            (at(1, "jawOpen") - 0.5).abs() < 0.02,
            "{}",
            at(1, "jawOpen")
        );
        assert!(at(0, "eyeLookUpLeft") == 0.0 && at(0, "jawOpen") < 0.02);
    }

    #[test]
    fn vowels_are_solved_beside_brows() {
        let shapes = TakeShapes::new(rig(&["viseme_aa", "viseme_U", "browInnerUp"]), &[0; 68]);
        let mut moved = Array3::zeros((1, 6, 3));
        moved.slice_mut(s![0, 2..4, 1]).fill(0.008);
        moved.slice_mut(s![0, 4.., 1]).fill(0.01);
        let weights = shapes.vowels(moved.view(), SILENT).unwrap();
        assert!((weights[[0, 2]] - 0.8).abs() < 0.01, "{weights}");
        assert_eq!((weights[[0, 0]], weights[[0, 1]]), (0.0, 0.0));
    }
}
