//! A file for a mesh that has none: positions, smooth normals, triangles, targets.

use glam::Vec3;
use serde_json::json;

use super::{
    animation::{NAME, Track, animation, head, times, weights},
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

/// Normals that turn by less than this are at rest, radians.
const LEAST_TURN: f32 = 0.02;

/// The document and its bytes.
pub(super) fn document(scene: &Scene<'_>, targets: &Targets) -> Result<Document> {
    let mut buffer = Buffer::after(0, Vec::new(), 0, 0);
    let corners = scene
        .source
        .and_then(|bytes| texture_coordinates(bytes, scene.mesh));
    let layout = Layout::new(scene.mesh, corners.as_deref());
    let count = layout.sources.len();
    let positions = buffer.points(&layout.spread(&scene.mesh.positions));
    let mut normals = scene.mesh.vertex_normals();
    // The format knows no normal of length 0, which a vertex without triangles has.
    normals
        .iter_mut()
        .filter(|normal| **normal == [0.0; 3])
        .for_each(|normal| *normal = [0.0, 1.0, 0.0]);
    let at_rest = buffer.points(&layout.spread(&normals));
    let mut attributes = json!({"POSITION": positions, "NORMAL": at_rest});
    if let Some(coordinates) = &layout.coordinates {
        attributes["TEXCOORD_0"] = json!(buffer.coordinates(coordinates));
    }
    let corners = buffer.corners(&layout.triangles, count);
    let mut primitive = json!({"attributes": attributes, "indices": corners, "material": 0});
    let mut mesh = json!({"name": NAME});
    let all: Vec<usize> = (0..targets.shapes.len()).collect();
    if !all.is_empty() {
        let mut accessors = Vec::new();
        for shape in &targets.shapes {
            let moved = buffer.displacements(count, &layout.moved(&shape.moved));
            let mut target = json!({"POSITION": moved});
            if targets.stand_alone {
                let turned = turned(scene.mesh, &normals, shape);
                target["NORMAL"] = json!(buffer.displacements(count, &layout.moved(&turned)));
            }
            accessors.push(target);
        }
        primitive["targets"] = json!(accessors);
        let names: Vec<&str> = targets.shapes.iter().map(|shape| &*shape.name).collect();
        mesh["weights"] = json!(vec![0; names.len()]);
        mesh["extras"] = json!({"targetNames": names});
    }
    let mut nodes = vec![json!({"name": NAME, "mesh": 0})];
    let (mut root, mut tracks) = (0, Vec::new());
    if targets.weights.nrows() > 0 {
        let times = times(&mut buffer, targets.weights.nrows(), targets.fps)?;
        if !all.is_empty() {
            tracks.push(Track {
                sampler: weights(&mut buffer, times, targets, (&[], &all))?,
                node: 0,
                path: "weights",
            });
        }
        if let Some([mut head, mut rest, sampler]) = head(&mut buffer, times, scene)? {
            rest["children"] = json!([0]);
            head["children"] = json!([1]);
            nodes.extend([rest, head]);
            root = 2;
            tracks.push(Track {
                sampler,
                node: root,
                path: "rotation",
            });
        }
    }
    mesh["primitives"] = json!([primitive]);
    if is_z_up(scene)? {
        // The format's way up is y.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        nodes.push(
            json!({"name": "Upright", "rotation": [-half, 0.0, 0.0, half], "children": [root]}),
        );
        root = nodes.len() - 1;
    }
    let (bytes, views, accessors) = buffer.finish();
    let mut json = json!({
        "asset": {"version": "2.0", "generator": concat!("Anyface ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [root]}],
        "nodes": nodes,
        "meshes": [mesh],
        "materials": [{
            "name": NAME, "doubleSided": true,
            "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.7},
        }],
        "buffers": [{"byteLength": bytes.len().next_multiple_of(4)}],
        "bufferViews": views,
        "accessors": accessors,
    });
    if !tracks.is_empty() {
        json["animations"] = json!([animation(tracks, scene.sound)]);
    }
    Ok(Document {
        json,
        binary: bytes,
        bound: vec![Bound {
            node: 0,
            mesh: 0,
            before: 0,
            shapes: all,
        }],
    })
}

/// By how much the normals differ where a shape is whole.
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
