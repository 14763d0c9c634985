//! A new glTF for a mesh that came from no GLB: positions, smooth normals, triangles, targets.

use glam::Vec3;
use serde_json::{Value, json};

use super::{
    animation::{NAME, Track, WeightSource, animation, head, times, weights},
    buffer::Buffer,
    document::{Bound, Document},
    layout::Layout,
};
use crate::{
    Result,
    mesh::{Mesh, texture_coordinates},
    output::{
        scene::{Scene, is_z_up},
        targets::{Target, Targets},
    },
};

/// A target leaves out normals that turn by less than this, radians.
const LEAST_TURN: f32 = 0.02;

/// The document and its bytes.
pub(super) fn document(scene: &Scene<'_>, targets: &Targets) -> Result<Document> {
    let mut buffer = Buffer::after(0, Vec::new(), 0, 0);
    let mesh = face(&mut buffer, scene, targets);
    let all: Vec<usize> = (0..targets.shapes.len()).collect();
    let mut shown = Shown::moving(&mut buffer, scene, targets, &all)?;
    if is_z_up(scene)? {
        shown.stand_up();
    }
    let (bytes, views, accessors) = buffer.finish();
    let mut json = json!({
        "asset": {"version": "2.0", "generator": concat!("Anyface ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [shown.root]}],
        "nodes": shown.nodes,
        "meshes": [mesh],
        "materials": [{
            "name": NAME, "doubleSided": true,
            "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.7},
        }],
        "buffers": [{"byteLength": bytes.len().next_multiple_of(4)}],
        "bufferViews": views,
        "accessors": accessors,
    });
    if !shown.tracks.is_empty() {
        json["animations"] = json!([animation(shown.tracks, scene.sound)]);
    }
    Ok(Document {
        json,
        binary: bytes,
        bound: vec![Bound {
            node: 0,
            mesh: 0,
            new: all.len(),
            targets: all.into_iter().map(|shape| (shape, shape)).collect(),
        }],
    })
}

/// The mesh with its targets.
fn face(buffer: &mut Buffer, scene: &Scene<'_>, targets: &Targets) -> Value {
    let corners = scene
        .source
        .and_then(|bytes| texture_coordinates(bytes, scene.mesh));
    let layout = Layout::new(scene.mesh, corners.as_deref());
    let positions = buffer.points(&layout.spread(&scene.mesh.positions));
    let mut normals = scene.mesh.vertex_normals();
    // A vertex without triangles has a normal of length 0, which the format does not allow.
    normals
        .iter_mut()
        .filter(|normal| **normal == [0.0; 3])
        .for_each(|normal| *normal = [0.0, 1.0, 0.0]);
    let at_rest = buffer.points(&layout.spread(&normals));
    let mut attributes = json!({"POSITION": positions, "NORMAL": at_rest});
    if let Some(coordinates) = &layout.coordinates {
        attributes["TEXCOORD_0"] = json!(buffer.coordinates(coordinates));
    }
    let corners = buffer.corners(&layout.triangles, layout.sources.len());
    let mut primitive = json!({"attributes": attributes, "indices": corners, "material": 0});
    let mut mesh = json!({"name": NAME});
    if !targets.shapes.is_empty() {
        let shapes = targets.shapes.iter();
        let names: Vec<&str> = shapes.clone().map(|shape| &*shape.name).collect();
        let accessors = shapes.map(|shape| {
            let turned = || turned(scene.mesh, &normals, shape);
            target(buffer, &layout, shape, targets.stand_alone.then(turned))
        });
        primitive["targets"] = accessors.collect();
        mesh["weights"] = json!(vec![0; names.len()]);
        mesh["extras"] = json!({"targetNames": names});
    }
    mesh["primitives"] = json!([primitive]);
    mesh
}

/// One target. `turned`: the displacements of its normals, if the target has normals.
fn target(
    buffer: &mut Buffer,
    layout: &Layout,
    shape: &Target,
    turned: Option<Vec<(u32, [f32; 3])>>,
) -> Value {
    let count = layout.sources.len();
    let moved = buffer.displacements(count, &layout.moved(&shape.moved));
    let mut target = json!({"POSITION": moved});
    if let Some(turned) = turned {
        target["NORMAL"] = json!(buffer.displacements(count, &layout.moved(&turned)));
    }
    target
}

/// The nodes of the scene and the tracks that move them. The first node shows the mesh.
struct Shown {
    nodes: Vec<Value>,
    /// Number of the root node.
    root: usize,
    tracks: Vec<Track>,
}

impl Shown {
    /// The nodes, with tracks for the weights of `shapes` and the rotation of the head.
    fn moving(
        buffer: &mut Buffer,
        scene: &Scene<'_>,
        targets: &Targets,
        shapes: &[usize],
    ) -> Result<Shown> {
        let mut shown = Shown {
            nodes: vec![json!({"name": NAME, "mesh": 0})],
            root: 0,
            tracks: Vec::new(),
        };
        if targets.weights.nrows() == 0 {
            return Ok(shown);
        }
        let times = times(buffer, targets.weights.nrows(), targets.fps)?;
        if !shapes.is_empty() {
            let columns: Vec<WeightSource> =
                shapes.iter().map(|&k| WeightSource::Column(k)).collect();
            shown.tracks.push(Track {
                sampler: weights(buffer, times, targets, &columns)?,
                node: 0,
                path: "weights",
            });
        }
        if let Some([mut head, mut rest, sampler]) = head(buffer, times, scene)? {
            rest["children"] = json!([0]);
            head["children"] = json!([1]);
            shown.nodes.extend([rest, head]);
            shown.root = 2;
            shown.tracks.push(Track {
                sampler,
                node: shown.root,
                path: "rotation",
            });
        }
        Ok(shown)
    }

    /// Turns a scene upright whose up axis is z, because y is up in the format.
    fn stand_up(&mut self) {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        self.nodes.push(json!({
            "name": "Upright", "rotation": [-half, 0.0, 0.0, half], "children": [self.root],
        }));
        self.root = self.nodes.len() - 1;
    }
}

/// By how much the normals change when a shape has weight 1.
fn turned(mesh: &Mesh, normals: &[[f32; 3]], shape: &Target) -> Vec<(u32, [f32; 3])> {
    let mut moved = mesh.clone();
    for (v, by) in &shape.moved {
        let place = &mut moved.positions[*v as usize];
        *place = (Vec3::from(*place) + Vec3::from(*by)).to_array();
    }
    let new = moved.vertex_normals();
    let pairs = normals.iter().zip(&new).zip(0..);
    let turned = pairs.map(|((rest, new), v)| (v, Vec3::from(*new) - Vec3::from(*rest)));
    turned
        .filter(|(v, by)| by.length() > LEAST_TURN && new[*v as usize] != [0.0; 3])
        .map(|(v, by)| (v, by.to_array()))
        .collect()
}
