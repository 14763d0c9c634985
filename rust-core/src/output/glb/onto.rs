//! Adds targets and an animation to the GLB that a mesh came from. Everything else in it stays.

use std::collections::{BTreeMap, BTreeSet};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

use super::{
    animation::{Track, WeightSource, animation, head, times, weights},
    bones::{turn_eyes, turn_head},
    buffer::Buffer,
    bytes::Bytes,
    document::{Bound, Document},
    weight_tracks::{Grown, widen},
};
use crate::{
    Error, Result,
    mesh::{GlbPart, glb_chunks, glb_parts, target_name},
    output::{
        scene::Scene,
        targets::{Target, Targets},
    },
};

/// The document and its bytes.
pub(super) fn add(source: &[u8], scene: &Scene<'_>, targets: &Targets) -> Result<Document> {
    // This also checks how much memory the document will take.
    let parts = parts_of(source, scene)?;
    let (json, binary) = glb_chunks(source)?;
    let document: Value = serde_json::from_slice(json).map_err(|e| wrong(e.to_string()))?;
    let place = NewBytes::of(&document);
    let buffer = place.buffer(&document, binary);
    let mut file = Extended {
        document,
        buffer,
        targets,
        times: None,
        tracks: Vec::new(),
        bound: Vec::new(),
        grown: Vec::new(),
    };
    let frames = targets.weights.nrows();
    if frames > 0 {
        file.times = Some(times(&mut file.buffer, frames, targets.fps)?);
    }
    for object in objects(&parts, targets)? {
        file.bind(&object)?;
    }
    widen(&mut file.document, (&mut file.buffer, source), &file.grown)?;
    file.animate(scene)?;
    let Extended {
        mut document,
        buffer,
        bound,
        ..
    } = file;
    let binary = place.write(&mut document, buffer, binary)?;
    Ok(Document {
        json: document,
        binary,
        bound,
    })
}

/// The parts of the mesh in the file, which must have as many vertices as the scene's mesh.
fn parts_of(source: &[u8], scene: &Scene<'_>) -> Result<Vec<GlbPart>> {
    let parts = glb_parts(source)?;
    let vertices = parts.last().map_or(0, |part| part.vertices.end);
    if vertices != scene.mesh.positions.len() {
        return Err(wrong(format!(
            "expected the file that the mesh of {} vertices was read from, got one with {vertices}",
            scene.mesh.positions.len()
        )));
    }
    Ok(parts)
}

/// Length of a list of the document; 0 if there is none.
fn length(document: &Value, name: &str) -> usize {
    document[name].as_array().map_or(0, Vec::len)
}

/// Where the new bytes go.
#[derive(Clone, Copy)]
enum NewBytes {
    /// After the bytes of the file's chunk, which is the first buffer.
    BehindChunk,
    /// Into a new buffer with this number, as base64 text, because the first buffer is not the chunk.
    InBuffer(usize),
}

impl NewBytes {
    fn of(document: &Value) -> NewBytes {
        let buffers = length(document, "buffers");
        if buffers == 0 || document["buffers"][0].get("uri").is_none() {
            NewBytes::BehindChunk
        } else {
            NewBytes::InBuffer(buffers)
        }
    }

    /// The buffer for the new bytes. `chunk`: the bytes of the file's chunk.
    fn buffer(self, document: &Value, chunk: &[u8]) -> Buffer {
        let (number, bytes) = match self {
            NewBytes::BehindChunk => (0, chunk.to_vec()),
            NewBytes::InBuffer(number) => (number, Vec::new()),
        };
        let views = length(document, "bufferViews");
        Buffer::after(number, bytes, views, length(document, "accessors"))
    }

    /// Adds the buffer to the document. `chunk`: the old bytes of the file's chunk. Returns the new
    /// ones.
    fn write(self, document: &mut Value, buffer: Buffer, chunk: &[u8]) -> Result<Bytes> {
        let (bytes, views, accessors) = buffer.finish();
        list(document, "bufferViews")?.extend(views);
        list(document, "accessors")?.extend(accessors);
        let buffers = list(document, "buffers")?;
        match self {
            NewBytes::BehindChunk => {
                if buffers.is_empty() {
                    buffers.push(json!({}));
                }
                buffers[0]["byteLength"] = json!(bytes.len().next_multiple_of(4));
                Ok(bytes)
            }
            NewBytes::InBuffer(_) => {
                let bytes = bytes.into_vec();
                let uri = format!(
                    "data:application/octet-stream;base64,{}",
                    STANDARD.encode(&bytes)
                );
                buffers.push(json!({"byteLength": bytes.len(), "uri": uri}));
                Ok(chunk.to_vec().into())
            }
        }
    }
}

/// The document of the file, and the additions to it.
struct Extended<'a> {
    document: Value,
    buffer: Buffer,
    targets: &'a Targets,
    /// Accessor of the frame times; `None` without frames.
    times: Option<usize>,
    tracks: Vec<Track>,
    bound: Vec<Bound>,
    grown: Vec<Grown>,
}

impl Extended<'_> {
    /// Adds to an object the shapes that move it, as targets, and the track of all weights. A shape that
    /// its mesh has as a target is not added again.
    fn bind(&mut self, object: &Object<'_>) -> Result<()> {
        let (parts, targets) = (&object.parts, self.targets);
        let mut shapes = targets_of(parts, targets);
        if shapes.is_empty() && !targets.has_in_file(object.mesh) {
            return Ok(());
        }
        let (node, mesh) = (object.node, self.mesh_of_its_own(object)?);
        let document = &self.document;
        let before = old_weights(&document["meshes"][mesh], &document["nodes"][node])?;
        let column = |number: usize| targets.in_file.get(&(object.mesh, number)).copied();
        let mut known: BTreeMap<usize, usize> = BTreeMap::new();
        for number in (0..before.len()).rev() {
            known.extend(column(number).map(|shape| (shape, number)));
        }
        let mut new = 0;
        for shape in &shapes {
            if let Some(number) = known.get(shape)
                && targets.empty.contains(&(object.mesh, *number))
                && moves(&targets.shapes[*shape], parts)
            {
                self.fill_target((mesh, *number), parts, *shape);
                new += 1;
            }
        }
        shapes.retain(|shape| !known.contains_key(shape));
        if !shapes.is_empty() {
            self.add_targets(mesh, parts, &before, &shapes)?;
            new += shapes.len();
            self.grown.push(Grown {
                node,
                mesh,
                before: before.len(),
                added: shapes.len(),
            });
        }
        if let Some(times) = self.times {
            let old = before.iter().enumerate().map(|(number, weight)| {
                column(number).map_or(WeightSource::Still(*weight), WeightSource::Column)
            });
            let new = shapes.iter().map(|&shape| WeightSource::Column(shape));
            let sources: Vec<WeightSource> = old.chain(new).collect();
            self.tracks.push(Track {
                sampler: weights(&mut self.buffer, times, targets, &sources)?,
                node,
                path: "weights",
            });
        }
        known.extend(shapes.into_iter().zip(before.len()..));
        self.bound.push(Bound {
            node,
            mesh,
            targets: known,
            new,
        });
        Ok(())
    }

    /// The mesh of an object. If other objects show the same mesh, the object gets a copy that shares
    /// its vertices, so that the others stay as they are.
    fn mesh_of_its_own(&mut self, object: &Object<'_>) -> Result<usize> {
        let nodes = self.document["nodes"].as_array().into_iter().flatten();
        let shows = |node: &&Value| node["mesh"].as_u64() == Some(object.mesh as u64);
        if nodes.filter(shows).count() < 2 {
            return Ok(object.mesh);
        }
        let copy = self.document["meshes"][object.mesh].clone();
        let meshes = list(&mut self.document, "meshes")?;
        meshes.push(copy);
        let number = meshes.len() - 1;
        self.document["nodes"][object.node]["mesh"] = json!(number);
        Ok(number)
    }

    /// Gives the displacements of a shape to a target that moves nothing.
    fn fill_target(&mut self, (mesh, number): (usize, usize), parts: &[&GlbPart], shape: usize) {
        for part in parts {
            let count = vertices_of(&self.document, part);
            let new = new_targets(&mut self.buffer, (part, count), self.targets, &[shape]);
            let primitive = &mut self.document["meshes"][mesh]["primitives"][part.primitive];
            for target in new {
                primitive["targets"][number]["POSITION"] = target["POSITION"].clone();
            }
        }
    }

    /// Adds shapes to the primitives of a mesh as targets. `before`: weights of its old targets.
    fn add_targets(
        &mut self,
        mesh: usize,
        parts: &[&GlbPart],
        before: &[f32],
        shapes: &[usize],
    ) -> Result<()> {
        let (node, targets) = (parts[0].node, self.targets);
        let document = &mut self.document;
        for part in parts {
            let count = vertices_of(document, part);
            let new = new_targets(&mut self.buffer, (part, count), targets, shapes);
            let primitive = &mut document["meshes"][mesh]["primitives"][part.primitive];
            list(primitive, "targets")?.extend(new);
        }
        name_targets(&mut document["meshes"][mesh], before.len(), shapes, targets)?;
        document["meshes"][mesh]["weights"] = json!(all_weights(before, shapes.len()));
        if document["nodes"][node].get("weights").is_some() {
            document["nodes"][node]["weights"] = json!(all_weights(before, shapes.len()));
        }
        Ok(())
    }

    /// Adds the rotation of the head, and an animation of all tracks.
    fn animate(&mut self, scene: &Scene<'_>) -> Result<()> {
        let (document, buffer) = (&mut self.document, &mut self.buffer);
        if let Some(times) = self.times {
            let faces: Vec<usize> = self.bound.iter().map(|bound| bound.node).collect();
            let turns = match turn_head(document, (&mut *buffer, times), scene, &faces)? {
                Some(bone) => Some(bone),
                // In a file with bones, a node above everything would turn the whole body with the head.
                None if document.get("skins").is_some() => None,
                None => turn_scene(document, &mut *buffer, times, scene)?,
            };
            self.tracks.extend(turns);
            if !self.targets.turn_eyes() {
                let eyes = turn_eyes(document, (buffer, times), scene)?;
                self.tracks.extend(eyes);
            }
        }
        if !self.tracks.is_empty() {
            let tracks = std::mem::take(&mut self.tracks);
            list(document, "animations")?.push(animation(tracks, scene.sound));
        }
        Ok(())
    }
}

/// Number of vertices in the primitive of a part, from the document. The mesh has none for a
/// primitive of lines or points, but that must have as many targets as the triangles.
fn vertices_of(document: &Value, part: &GlbPart) -> usize {
    let primitive = &document["meshes"][part.mesh]["primitives"][part.primitive];
    let count = match primitive["attributes"]["POSITION"].as_u64() {
        Some(accessor) => &document["accessors"][accessor as usize]["count"],
        None => &Value::Null,
    };
    count.as_u64().unwrap_or(0) as usize
}

fn wrong(message: String) -> Error {
    Error::InvalidInput(format!("glTF: {message}"))
}

/// A list in an object of the document. Creates it if it is missing.
fn list<'a>(of: &'a mut Value, name: &str) -> Result<&'a mut Vec<Value>> {
    let lists = of.as_object_mut();
    let lists = lists.ok_or_else(|| wrong(format!("expected an object with {name}")))?;
    let list = lists.entry(name).or_insert_with(|| json!([]));
    list.as_array_mut()
        .ok_or_else(|| wrong(format!("expected a list of {name}")))
}

/// A node that shows a mesh.
struct Object<'a> {
    node: usize,
    /// Its mesh in the file of the source.
    mesh: usize,
    parts: Vec<&'a GlbPart>,
}

/// The objects of the scene, in the order of their meshes. A mesh with targets that are driven must
/// belong to a single node.
fn objects<'a>(parts: &'a [GlbPart], targets: &Targets) -> Result<Vec<Object<'a>>> {
    let mut all: BTreeMap<(usize, usize), Vec<&GlbPart>> = BTreeMap::new();
    for part in parts {
        all.entry((part.mesh, part.node)).or_default().push(part);
    }
    let objects = all
        .into_iter()
        .map(|((mesh, node), parts)| Object { node, mesh, parts });
    let objects: Vec<Object<'_>> = objects.collect();
    let is_shared = |pair: &&[Object<'_>]| pair[0].mesh == pair[1].mesh;
    let mut shared = objects.windows(2).filter(is_shared);
    match shared.find(|pair| targets.has_in_file(pair[0].mesh)) {
        None => Ok(objects),
        Some(pair) => Err(wrong(format!(
            "expected each mesh with morph targets at one node, got mesh {} at several, which would all speak; give \
             the one that speaks a mesh of its own",
            pair[0].mesh
        ))),
    }
}

/// Whether a shape moves any vertex of these parts.
fn moves(shape: &Target, parts: &[&GlbPart]) -> bool {
    parts.iter().any(|part| !within(shape, part).is_empty())
}

/// Numbers of the shapes that an object gets: those that move any of its vertices, or all.
fn targets_of(parts: &[&GlbPart], targets: &Targets) -> Vec<usize> {
    let is_at = |vertex: u32| {
        let holds = |part: &&GlbPart| part.vertices.contains(&(vertex as usize));
        parts.iter().any(holds)
    };
    let gets_all = targets.whole_at.is_some_and(is_at);
    let shapes = targets.shapes.iter().enumerate();
    shapes
        .filter(|(_, shape)| gets_all || moves(shape, parts))
        .map(|(k, _)| k)
        .collect()
}

/// The vertices of a part that a shape moves, with their displacements.
fn within<'a>(shape: &'a Target, part: &GlbPart) -> &'a [(u32, [f32; 3])] {
    let at = |vertex: usize| shape.moved.partition_point(|(v, _)| (*v as usize) < vertex);
    &shape.moved[at(part.vertices.start)..at(part.vertices.end)]
}

/// Makes the targets of one primitive of `count` vertices, in the axes and units of its positions.
fn new_targets(
    buffer: &mut Buffer,
    (part, count): (&GlbPart, usize),
    targets: &Targets,
    shapes: &[usize],
) -> Vec<Value> {
    let mut added = Vec::new();
    for &k in shapes {
        let moved = within(&targets.shapes[k], part).iter().map(|(v, d)| {
            let stored = part.stored_displacement(*v as usize, *d);
            (v - part.vertices.start as u32, stored)
        });
        let moved: Vec<_> = moved.collect();
        let accessor = buffer.displacements(count, &moved);
        added.push(json!({"POSITION": accessor}));
    }
    added
}

/// The weights of the targets that the mesh already has.
fn old_weights(mesh: &Value, node: &Value) -> Result<Vec<f32>> {
    let primitives = mesh["primitives"].as_array().into_iter().flatten();
    let counts: BTreeSet<usize> = primitives
        .map(|primitive| primitive["targets"].as_array().map_or(0, Vec::len))
        .collect();
    let [count] = counts.iter().copied().collect::<Vec<_>>()[..] else {
        return Err(wrong(
            "expected as many targets in each primitive of a mesh".into(),
        ));
    };
    let weights = node["weights"].as_array().or(mesh["weights"].as_array());
    let weight = |k: usize| weights.and_then(|all| all.get(k)).and_then(Value::as_f64);
    Ok((0..count)
        .map(|k| weight(k).unwrap_or(0.0) as f32)
        .collect())
}

fn all_weights(before: &[f32], new: usize) -> Vec<f32> {
    let new = std::iter::repeat_n(0.0, new);
    before.iter().copied().chain(new).collect()
}

/// Adds the names of the new targets after those of the old ones.
fn name_targets(
    mesh: &mut Value,
    before: usize,
    shapes: &[usize],
    targets: &Targets,
) -> Result<()> {
    let known = (0..before).map(|number| json!(target_name(mesh, number)));
    let known: Vec<Value> = known.collect();
    // The names need an object. If `extras` is another value, it moves into a new object.
    match mesh["extras"].take() {
        Value::Null => mesh["extras"] = json!({}),
        object @ Value::Object(_) => mesh["extras"] = object,
        other => mesh["extras"] = json!({"extras": other}),
    }
    let names = list(&mut mesh["extras"], "targetNames")?;
    *names = known;
    names.extend(shapes.iter().map(|&k| json!(targets.shapes[k].name)));
    Ok(())
}

/// Moves all nodes of the scene below a node that turns with the head.
fn turn_scene(
    document: &mut Value,
    buffer: &mut Buffer,
    times: usize,
    scene: &Scene<'_>,
) -> Result<Option<Track>> {
    let Some([mut head, mut rest, sampler]) = head(buffer, times, scene)? else {
        return Ok(None);
    };
    let number = document["scene"].as_u64().unwrap_or(0) as usize;
    let shown = document["scenes"][number]["nodes"].take();
    let nodes = list(document, "nodes")?;
    let node = nodes.len() + 1;
    rest["children"] = shown;
    head["children"] = json!([node - 1]);
    nodes.extend([rest, head]);
    document["scenes"][number]["nodes"] = json!([node]);
    Ok(Some(Track {
        sampler,
        node,
        path: "rotation",
    }))
}
