//! A clip or a rig as morph targets: sparse shapes, each with a weight from 0 to 1 in every frame.
//!
//! Scene files hold no vertex positions over time, or hold them in a way that few programs can
//! read. All programs read shapes and weights, but many set weights below 0 to 0. So the weights
//! of a component are raised until none is below 0, and one more shape of weight 1 subtracts what
//! that adds. If all weights are 0, the mesh is at rest. If all weights are halved, so is the
//! motion.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, s};

use super::take_shapes::look_weights;
use crate::{
    deform::compression::VertexBasis,
    face::Rig,
    mesh::{Landmarks, canonical_landmarks, ibug::LANDMARKS},
    motion::Life,
    rig::EyeLook,
};

/// How far the shapes of a clip may leave a vertex from its place in any frame, metres on a head
/// of human size.
const MAX_ERROR_M: f32 = 7e-6;
/// How much further a vertex may be off because the shapes leave out small displacements, metres.
const MAX_LEFT_OUT_M: f32 = 2e-6;
/// A rig's shape lists the vertices that it moves by more than this along an axis, metres.
const LEAST_M: f32 = 2e-6;
/// Outer corners of the eyes.
const EYES: (usize, usize) = (36, 45);
/// The tip of the nose, which only the skin of a face has.
pub(super) const NOSE: usize = 30;

/// One shape.
pub(super) struct Target {
    pub name: String,
    /// Vertices with their displacements at weight 1, mesh units, ordered by vertex number.
    pub moved: Vec<(u32, [f32; 3])>,
}

impl Target {
    /// The shape of a rig with this name; `None` if the rig lacks it.
    fn of_rig(rig: &Rig, name: &str, landmarks: &[[f32; 3]; LANDMARKS]) -> Option<Target> {
        let place = rig.names.iter().position(|known| known == name)?;
        let shape = rig.deltas.index_axis(Axis(0), place);
        Some(Target {
            name: name.to_owned(),
            moved: sparse(shape, 1.0, least_displacement(landmarks)),
        })
    }
}

/// A target of a file that has the name of one of our shapes.
pub(super) struct FileTarget {
    pub mesh: usize,
    /// Its number among the targets of the mesh.
    pub number: usize,
    pub shape: &'static str,
    /// Whether it moves nothing, so that it can take the displacements of the shape.
    pub is_empty: bool,
}

/// Shapes, and their weights over time.
pub(super) struct Targets {
    pub shapes: Vec<Target>,
    /// `[T, N]`, within 0 to 1. No frames if nothing plays.
    pub weights: Arc<Array2<f32>>,
    /// Frames per second.
    pub fps: f64,
    /// Whether users look at the shapes one by one, so that each needs normals of its own.
    pub stand_alone: bool,
    /// Targets that the file of the mesh has already, as numbers of a mesh and of a target, and the
    /// column of their weights. Such a target is not made anew.
    pub in_file: BTreeMap<(usize, usize), usize>,
    /// Those of them that move nothing yet and take the displacements of their shape.
    pub empty: BTreeSet<(usize, usize)>,
    /// Whether targets of the file turn the eyes.
    pub eyes_in_file: bool,
    /// A vertex whose object gets every shape, also those that move nothing of it.
    pub whole_at: Option<u32>,
}

impl Targets {
    /// The error in mesh units that the basis of a clip may have. `landmarks`: those of its mesh at
    /// rest.
    pub(super) fn max_error(landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
        MAX_ERROR_M * units_per_metre(landmarks)
    }

    /// The shapes of a clip, from its basis. `landmarks`: those of its mesh at rest.
    pub(super) fn of_basis(mut basis: VertexBasis, landmarks: &[[f32; 3]; LANDMARKS]) -> Targets {
        leave_out(
            &mut basis.shapes,
            MAX_LEFT_OUT_M * units_per_metre(landmarks),
        );
        let VertexBasis {
            shapes: components,
            mut weights,
            fps,
            ..
        } = basis;
        let mut shapes = Vec::new();
        let mut back = Array2::zeros((components.dim().1, 3));
        for (k, shape) in components.outer_iter().enumerate() {
            let column = weights.column(k);
            let low = column.iter().copied().fold(0.0, f32::min);
            let range = column.iter().copied().fold(0.0, f32::max) - low;
            if range > 0.0 {
                // The weights of a long take are too large for a second copy of them.
                for mut row in weights.rows_mut() {
                    row[shapes.len()] = ((row[k] - low) / range).clamp(0.0, 1.0);
                }
                shapes.push(Target {
                    name: format!("Anyface {}", k + 1),
                    moved: sparse(shape, range, 0.0),
                });
                back.scaled_add(low, &shape);
            }
        }
        weights.slice_collapse(s![.., ..shapes.len()]);
        let moved = sparse(back.view(), 1.0, 0.0);
        if !moved.is_empty() {
            let name = "Anyface back".to_owned();
            shapes.push(Target { name, moved });
            let always = Array1::ones(weights.nrows());
            add_column(&mut weights, always.view());
        }
        Targets {
            shapes,
            weights: Arc::new(weights),
            fps,
            stand_alone: false,
            in_file: BTreeMap::new(),
            empty: BTreeSet::new(),
            eyes_in_file: false,
            whole_at: None,
        }
    }

    /// Adds shapes that turn the eyes with the gaze of a take. Shapes whose weight stays 0 are left
    /// out.
    pub(super) fn with_looks(mut self, eyes: &[EyeLook], life: &Life) -> Targets {
        for look in eyes {
            let weights = look_weights(look.name, life);
            if weights.iter().any(|w| *w > 0.0) {
                add_column(Arc::make_mut(&mut self.weights), weights.view());
                self.shapes.push(Target {
                    name: look.name.to_owned(),
                    moved: look.moved.clone(),
                });
            }
        }
        self
    }

    /// The shapes of a rig with these names, in this order, without weights over time. Shapes that
    /// the rig lacks and shapes that move nothing are left out.
    pub(super) fn of_rig<'a>(
        rig: &Rig,
        names: impl IntoIterator<Item = &'a str>,
        landmarks: &[[f32; 3]; LANDMARKS],
    ) -> Targets {
        let shapes = names
            .into_iter()
            .filter_map(|name| Target::of_rig(rig, name, landmarks))
            .filter(|shape| !shape.moved.is_empty());
        Targets::at_rest(shapes.collect())
    }

    /// All shapes of a rig, without weights over time. The object with the skin gets also those that
    /// move nothing, so that it has every name.
    pub(super) fn of_whole_rig(rig: &Rig, landmarks: &Landmarks) -> Targets {
        let names = rig.names.iter();
        let shapes = names.filter_map(|name| Target::of_rig(rig, name, &landmarks.positions));
        Targets {
            whole_at: Some(landmarks.vertices[NOSE]),
            ..Targets::at_rest(shapes.collect())
        }
    }

    /// Shapes without weights over time.
    pub(super) fn at_rest(shapes: Vec<Target>) -> Targets {
        Targets {
            weights: Arc::new(Array2::zeros((0, shapes.len()))),
            shapes,
            fps: 1.0,
            stand_alone: true,
            in_file: BTreeMap::new(),
            empty: BTreeSet::new(),
            eyes_in_file: false,
            whole_at: None,
        }
    }

    /// Shows shapes on targets that the file of the mesh has already: numbers of a mesh and of a
    /// target, and the name of the shape.
    pub(super) fn on_file_targets(mut self, file_targets: &[FileTarget]) -> Targets {
        let place = |name: &str| self.shapes.iter().position(|shape| shape.name == name);
        let places = file_targets
            .iter()
            .filter_map(|target| Some(((target.mesh, target.number), place(target.shape)?)));
        self.in_file = places.collect();
        let empty = file_targets.iter().filter(|target| target.is_empty);
        self.empty = empty.map(|target| (target.mesh, target.number)).collect();
        self
    }

    /// Whether shapes turn the eyes, so that no bones have to.
    pub(super) fn turn_eyes(&self) -> bool {
        let looks = |shape: &Target| shape.name.starts_with("eyeLook");
        self.eyes_in_file || self.shapes.iter().any(looks)
    }

    /// Whether a mesh of the file has any of these targets already.
    pub(super) fn has_in_file(&self, mesh: usize) -> bool {
        self.in_file.keys().any(|(of, _)| *of == mesh)
    }

    /// Weights over time `[T, N]` for targets that the file of the mesh has already.
    pub(super) fn of_file(
        in_file: BTreeMap<(usize, usize), usize>,
        weights: Array2<f32>,
        (fps, eyes_in_file): (f64, bool),
    ) -> Targets {
        Targets {
            shapes: Vec::new(),
            weights: Arc::new(weights),
            fps,
            stand_alone: false,
            in_file,
            empty: BTreeSet::new(),
            eyes_in_file,
            whole_at: None,
        }
    }

    /// Sets the weights over time to `[T, S]`, one column for each of `names`. Shapes that are not
    /// in `names` stay at 0.
    pub(super) fn playing(self, names: &[&str], weights: ArrayView2<'_, f32>, fps: f64) -> Targets {
        let mut target_weights = Array2::zeros((weights.nrows(), self.shapes.len()));
        for (mut column, shape) in target_weights.axis_iter_mut(Axis(1)).zip(&self.shapes) {
            if let Some(place) = names.iter().position(|name| *name == shape.name) {
                column.assign(&weights.column(place));
            }
        }
        Targets {
            weights: Arc::new(target_weights),
            fps,
            ..self
        }
    }
}

/// Adds a column to weights. Those of a long take lie column by column and grow where they are.
fn add_column(weights: &mut Array2<f32>, column: ArrayView1<'_, f32>) {
    let added = weights.push_column(column);
    added.expect("one weight for each frame");
}

/// Sets the smallest displacements of shapes `[K, V, 3]` to 0. No vertex loses more than `most` in
/// any frame, since the weights lie within −1 to 1.
fn leave_out(shapes: &mut ndarray::Array3<f32>, most: f32) {
    for mut vertex in shapes.axis_iter_mut(Axis(1)) {
        let length = |row: ArrayView1<'_, f32>| row.dot(&row).sqrt();
        let mut rows: Vec<(f32, usize)> = vertex.outer_iter().map(length).zip(0..).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut lost = 0.0;
        for (length, k) in rows {
            lost += length;
            if lost > most {
                break;
            }
            vertex.row_mut(k).fill(0.0);
        }
    }
}

/// The vertices that a shape `[V, 3]` times `scale` moves by more than `least` along an axis.
fn sparse(shape: ArrayView2<'_, f32>, scale: f32, least: f32) -> Vec<(u32, [f32; 3])> {
    let rows = shape.outer_iter().enumerate();
    let moved = rows.map(|(v, row)| (v as u32, [0, 1, 2].map(|i| scale * row[i])));
    moved
        .filter(|(_, moved)| moved.iter().any(|x| x.abs() > least))
        .collect()
}

/// A target lists the vertices that it moves by more than this along an axis, mesh units.
pub(super) fn least_displacement(landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    LEAST_M * units_per_metre(landmarks)
}

/// Units of the mesh in a metre, by the distance between the eyes.
pub(super) fn units_per_metre(landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    eye_span(landmarks) / eye_span(canonical_landmarks())
}

fn eye_span(landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    let [a, b] = [EYES.0, EYES.1].map(|n| glam::Vec3::from(landmarks[n]));
    a.distance(b)
}
