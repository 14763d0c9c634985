//! A file for a mesh that has none: positions, smooth normals, triangles, targets.

use serde_json::{Value, json};

use super::{
    animation::{NAME, Track, animation, head, times, weights},
    buffer::Buffer,
};
use crate::{
    Result,
    output::{
        scene::{Scene, is_z_up},
        targets::Targets,
    },
};

/// The document and its bytes.
pub(super) fn document(scene: &Scene<'_>, targets: &Targets) -> Result<(Value, Vec<u8>)> {
    let mut buffer = Buffer::after(0, Vec::new(), 0, 0);
    let count = scene.mesh.positions.len();
    let positions = buffer.points(&scene.mesh.positions)?;
    let normals = buffer.points(&scene.mesh.vertex_normals())?;
    let corners = buffer.corners(&scene.mesh.triangles);
    let mut primitive = json!({
        "attributes": {"POSITION": positions, "NORMAL": normals}, "indices": corners, "material": 0,
    });
    let mut mesh = json!({"name": NAME});
    let times = times(&mut buffer, targets)?;
    let mut tracks = Vec::new();
    if !targets.shapes.is_empty() {
        let mut accessors = Vec::new();
        for shape in &targets.shapes {
            let moved = buffer.displacements(count, &shape.moved)?;
            accessors.push(json!({"POSITION": moved}));
        }
        primitive["targets"] = json!(accessors);
        let names: Vec<&str> = targets.shapes.iter().map(|shape| &*shape.name).collect();
        mesh["weights"] = json!(vec![0; names.len()]);
        mesh["extras"] = json!({"targetNames": names});
        let all: Vec<usize> = (0..names.len()).collect();
        let sampler = weights(&mut buffer, times, targets, (&[], &all))?;
        tracks.push(Track {
            sampler,
            node: 0,
            path: "weights",
        });
    }
    mesh["primitives"] = json!([primitive]);
    let mut nodes = vec![json!({"name": NAME, "mesh": 0})];
    let mut root = 0;
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
    if is_z_up(scene)? {
        // The format's way up is y.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        nodes.push(
            json!({"name": "Upright", "rotation": [-half, 0.0, 0.0, half], "children": [root]}),
        );
        root = nodes.len() - 1;
    }
    let (bytes, views, accessors) = buffer.finish();
    let mut document = json!({
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
        document["animations"] = json!([animation(tracks, scene.sound)]);
    }
    Ok((document, bytes))
}
