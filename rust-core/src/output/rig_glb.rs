//! Writes a mesh with all shapes of its rig as morph targets into the GLB that it came from.

use std::{
    collections::{BTreeMap, HashSet},
    io::Write,
    path::Path,
};

use glam::Vec3;
use serde::Serialize;

use super::{
    glb::{Document, document, write_document},
    mesh_targets::with_file_targets,
    scene::Scene,
    targets::{NOSE, Target, Targets, units_per_metre},
    vrm::{Existing, add_expressions},
};
use crate::{
    Error, Result,
    face::Rig,
    job::Unfinished,
    mesh::{Landmarks, Mesh, glb_parts},
};

/// A shape that moves no vertex of an object by more than this is not worth a target there, metres on a head of
/// human size.
const LEAST_OF_OBJECT_M: f32 = 1e-4;
/// The face is the box of the landmarks and this much of its largest side all around: from the chin to the middle of the
/// forehead, and as deep as the mouth.
const MARGIN: f32 = 0.3;
/// An object with this share of its vertices in the face belongs to it, such as teeth, lashes and beards.
const LEAST_INSIDE: f32 = 0.9;
/// Vertices of two objects in one place are sewn together if they are this near, metres on a head of human size.
const SEAM_M: f32 = 1e-4;

/// An object of a GLB that has shapes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ShapedObject {
    /// Name of its node, or of its mesh if the node has none.
    pub name: String,
    /// How many shapes it got.
    pub new: usize,
    /// How many shapes it had already under their names. They stay as they are.
    pub kept: usize,
}

/// Writes a mesh with all shapes of its rig as morph targets.
///
/// `source`: the bytes of the file that the mesh was read from. All else in a GLB or VRM stays: bones, skins,
/// materials, pictures, animations, other meshes and targets. The object with the skin gets every
/// shape, also those that move nothing of it. An object that lies in the face, such as teeth, lashes and eyes, or
/// that is sewn to skin that moves, such as a neck, gets those that move it. A shape that an object has already stays.
/// In a VRM, expressions that move nothing yet move the shapes. A mesh that came from no GLB gets a new one.
///
/// Returns the objects with shapes.
///
/// # Errors
/// `ShapeMismatch` if the rig is not the mesh's, `InvalidInput` for a GLB that is not the mesh's, `Io` if the file
/// cannot be written.
pub fn write_rig_glb(
    path: &Path,
    rig: &Rig,
    (mesh, landmarks): (&Mesh, &Landmarks),
    source: Option<&[u8]>,
) -> Result<Vec<ShapedObject>> {
    rig.check_mesh(mesh)?;
    let scene = Scene {
        mesh,
        landmarks: &landmarks.positions,
        life: None,
        source,
        sound: None,
    };
    let document = with_shapes(rig, &scene, landmarks)?;
    let objects = shaped_objects(&document);
    let (unfinished, mut file) = Unfinished::create(path)?;
    write_document((&mut file, path), document)?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    unfinished.finish()?;
    Ok(objects)
}

/// The document with the shapes.
pub(super) fn with_shapes(rig: &Rig, scene: &Scene<'_>, landmarks: &Landmarks) -> Result<Document> {
    let (rig, file_targets) = with_file_targets(rig, scene.glb())?;
    let mut targets = Targets::of_whole_rig(&rig, landmarks);
    if let Some(source) = scene.glb() {
        let objects = Objects::read(source, landmarks)?;
        // The writer refuses the file of another mesh.
        if objects.of_vertex.len() == scene.mesh.positions.len() {
            keep_to_head(&mut targets, &objects, (scene.mesh, landmarks));
        }
    }
    let targets = targets.on_file_targets(&file_targets);
    let mut document = document(scene, &targets)?;
    add_expressions(&mut document, &targets, Existing::Keep)?;
    Ok(document)
}

/// Takes the shapes from objects that do not belong to the face, such as hats, sleeves and books, and traces of
/// shapes from all objects but the one with the skin.
fn keep_to_head(targets: &mut Targets, objects: &Objects, (mesh, landmarks): (&Mesh, &Landmarks)) {
    let scale = units_per_metre(&landmarks.positions);
    let least = LEAST_OF_OBJECT_M * scale;
    let inside = objects.in_face(mesh, landmarks);
    let sewn = objects.sewn_to_face(&targets.shapes, mesh, (least, SEAM_M * scale));
    for shape in &mut targets.shapes {
        let mut largest = vec![0.0f32; objects.count];
        for (v, moved) in &shape.moved {
            let largest = &mut largest[objects.of_vertex[*v as usize]];
            *largest = largest.max(length(moved));
        }
        let keeps = |object: usize| {
            let is_moved = largest[object] > least && (inside[object] || sewn[object]);
            object == objects.face || is_moved
        };
        let keeps: Vec<bool> = (0..objects.count).map(keeps).collect();
        let of_vertex = &objects.of_vertex;
        shape.moved.retain(|(v, _)| keeps[of_vertex[*v as usize]]);
    }
}

/// The objects of a file.
struct Objects {
    count: usize,
    /// Number of the one with the skin.
    face: usize,
    /// `[V]`, the number of each vertex' object.
    of_vertex: Vec<usize>,
}

impl Objects {
    /// `source`: the bytes of a GLB, whose nodes with meshes are the objects.
    fn read(source: &[u8], landmarks: &Landmarks) -> Result<Objects> {
        let mut numbers: BTreeMap<usize, usize> = BTreeMap::new();
        let mut of_vertex = Vec::new();
        for part in glb_parts(source)? {
            let next = numbers.len();
            let number = *numbers.entry(part.node).or_insert(next);
            of_vertex.resize(part.vertices.end, number);
        }
        Ok(Objects {
            count: numbers.len(),
            face: of_vertex
                .get(landmarks.vertices[NOSE] as usize)
                .copied()
                .unwrap_or(0),
            of_vertex,
        })
    }

    /// Whether most vertices of each object lie in the face.
    fn in_face(&self, mesh: &Mesh, landmarks: &Landmarks) -> Vec<bool> {
        let points = landmarks.positions.iter().map(|p| Vec3::from(*p));
        let (low, high) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
        let margin = MARGIN * (high - low).max_element();
        let mut counts = vec![(0, 0); self.count];
        for (object, place) in self.of_vertex.iter().zip(&mesh.positions) {
            let place = Vec3::from(*place);
            let is_inside = place.cmpge(low - margin).all() && place.cmple(high + margin).all();
            let (inside, all) = &mut counts[*object];
            *inside += usize::from(is_inside);
            *all += 1;
        }
        let share = |(inside, all): (usize, usize)| inside as f32 >= LEAST_INSIDE * all as f32;
        counts.into_iter().map(share).collect()
    }

    /// Whether a vertex of each object moves in one place with a vertex of the skin. Vertices move by more than
    /// `least`, and lie in one place within `near`.
    fn sewn_to_face(&self, shapes: &[Target], mesh: &Mesh, (least, near): (f32, f32)) -> Vec<bool> {
        let moved = shapes.iter().flat_map(|shape| &shape.moved);
        let moved = moved.filter(|(_, moved)| length(moved) > least);
        let moved: HashSet<u32> = moved.map(|(v, _)| *v).collect();
        let cell = |v: u32| mesh.positions[v as usize].map(|x| (x / near).floor() as i64);
        let of_face = |v: &&u32| self.of_vertex[**v as usize] == self.face;
        let skin: HashSet<[i64; 3]> = moved.iter().filter(of_face).map(|v| cell(*v)).collect();
        let mut sewn = vec![false; self.count];
        for v in moved {
            let object = self.of_vertex[v as usize];
            let [x, y, z] = cell(v);
            let mut around = (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]);
            sewn[object] = sewn[object] || around.any(|cell| skin.contains(&cell));
        }
        sewn
    }
}

fn length(moved: &[f32; 3]) -> f32 {
    Vec3::from(*moved).length()
}

fn shaped_objects(document: &Document) -> Vec<ShapedObject> {
    let name = |list: &str, number: usize| document.json[list][number]["name"].as_str();
    let objects = document.bound.iter().map(|bound| {
        let name = name("nodes", bound.node).or_else(|| name("meshes", bound.mesh));
        ShapedObject {
            name: name.map_or_else(|| format!("node {}", bound.node), str::to_owned),
            new: bound.new,
            kept: bound.targets.len() - bound.new,
        }
    });
    objects.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    /// A face of 68 vertices, teeth, a hat, and a neck that shares a place with the chin.
    #[test]
    fn only_objects_in_the_face_and_sewn_to_it_get_shapes() {
        let points = *canonical_landmarks();
        let (mouth, chin) = (points[62], points[8]);
        let away = |[x, y, z]: [f32; 3], up: f32| [x, y + up, z];
        let mut positions = points.to_vec();
        positions.extend([away(mouth, 0.001), away(mouth, 0.002)]);
        positions.extend([away(points[27], 0.15), away(points[27], 0.2)]);
        positions.extend([chin, away(chin, -0.2)]);
        let of_vertex = (0..74).map(|v: usize| v.saturating_sub(66) / 2).collect();
        let mesh = Mesh {
            positions,
            triangles: Vec::new(),
        };
        let landmarks = Landmarks {
            positions: points,
            vertices: std::array::from_fn(|n| n as u32),
            confidence: [1.0; 68],
        };
        let objects = Objects {
            count: 4,
            face: 0,
            of_vertex,
        };
        let shape = |by: f32| Target {
            name: "jawOpen".to_owned(),
            moved: (0..74).map(|v| (v, [0.0, -by, 0.0])).collect(),
        };
        let mut targets = Targets::at_rest(vec![shape(1e-3), shape(5e-5)]);
        keep_to_head(&mut targets, &objects, (&mesh, &landmarks));
        let moved = targets
            .shapes
            .iter()
            .map(|shape| shape.moved.iter().map(|(v, _)| *v).collect());
        let moved: Vec<Vec<u32>> = moved.collect();
        assert_eq!(moved[0], (0..70).chain(72..74).collect::<Vec<u32>>());
        assert_eq!(moved[1], (0..68).collect::<Vec<u32>>());
    }
}
