//! Binary glTF 2.0 (.glb): the triangles of the default scene.
//!
//! This does not use the gltf crate, which panics on accessors of signed or odd sizes, follows
//! nodes without end and does not know the quantised positions (KHR_mesh_quantization) that packers
//! of glTF write. This code reads only what decides where triangles lie, and reserves no more
//! memory than the file's size justifies.

mod accessor;
mod document;
mod draco;
mod matrix;
mod meshopt;
mod pack;
mod skin;
mod targets;

use std::ops::Range;

use accessor::Data;
use document::{Document, Node, Primitive, missing, refusal};
use draco::Decoded;
use glam::{DMat3, DVec3};
use matrix::{IDENTITY, Matrix, apply, matrix, product};
pub(super) use pack::{is_gltf_text, pack};
use skin::{Blend, Skins};
pub use targets::{GlbTarget, glb_targets};
pub(crate) use targets::{glb_scalars, target_name};

use super::Mesh;
use crate::{Result, job::check_json};

/// A file may give this many vertices and corners in addition to four for each of its bytes. Nodes
/// that show one mesh several times need them.
const SHOWN_AGAIN: usize = 4_000_000;
/// A skinned vertex, which needs a transform of its own, counts as this many more.
const SKINNED: usize = 3;
/// Largest JSON that is read, bytes. The data is separate.
const LARGEST_JSON: usize = 64 << 20;
/// The marks of the two kinds of chunks.
const JSON: &[u8] = b"JSON";
const BINARY: &[u8] = b"BIN\0";

/// Extensions for vertices that are read, or that leave vertices where they are.
const UNDERSTOOD: [&str; 6] = [
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
];
/// What the names of extensions contain that say where vertices lie. All others concern textures,
/// materials, animations, avatars and so on, and a reader of meshes need not know them.
const FOR_VERTICES: [&str; 3] = ["_mesh_", "_meshopt_", "compression"];

/// A primitive of a node, and its vertices in the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct GlbPart {
    /// Number of the node.
    pub node: usize,
    /// Number of its mesh.
    pub mesh: usize,
    /// Number of the primitive in that mesh.
    pub primitive: usize,
    /// Numbers of its vertices in the mesh that was read.
    pub vertices: Range<usize>,
    /// Transform from the mesh into the scene, in columns; the identity if each vertex has its own.
    pub placed: [[f32; 4]; 4],
    /// `[V]` for a skinned primitive whose vertices follow several joints: how each turns and
    /// scales displacements, in columns. Otherwise empty.
    pub blends: Vec<[[f32; 3]; 3]>,
}

impl GlbPart {
    /// The displacement of a vertex's stored position that shows as `displacement` in the scene. It
    /// is 0 where the file lets no displacement show. `vertex`: its number in the mesh that was
    /// read.
    pub fn stored_displacement(&self, vertex: usize, displacement: [f32; 3]) -> [f32; 3] {
        let shown = self.turn(vertex);
        if shown.determinant().abs() > 0.0 {
            let stored = shown.inverse() * DVec3::from_array(displacement.map(f64::from));
            stored.as_vec3().to_array()
        } else {
            [0.0; 3]
        }
    }

    /// How a displacement of a vertex's stored position shows in the scene.
    fn shown_displacement(&self, vertex: usize, displacement: [f32; 3]) -> [f32; 3] {
        let shown = self.turn(vertex) * DVec3::from_array(displacement.map(f64::from));
        shown.as_vec3().to_array()
    }

    /// How a vertex's displacements turn and scale on the way into the scene.
    fn turn(&self, vertex: usize) -> DMat3 {
        let [a, b, c] = match self.blends.get(vertex - self.vertices.start) {
            Some(blend) => *blend,
            None => [0, 1, 2].map(|c| [0, 1, 2].map(|r| self.placed[c][r])),
        };
        let column = |column: [f32; 3]| DVec3::from_array(column.map(f64::from));
        DMat3::from_cols(column(a), column(b), column(c))
    }
}

/// Reads every mesh of the default scene, one after the other, each moved by its node.
///
/// A skinned mesh is moved by its joints as they stand at rest instead, as the format demands.
/// Triangles, strips and fans are read, lines and points are skipped.
///
/// Returns the primitives too, in the order of their vertices.
pub(super) fn parse_glb(bytes: &[u8]) -> Result<(Mesh, Vec<GlbPart>)> {
    read(bytes)
}

/// The primitives of a GLB and their vertices in the mesh that [`Mesh::parse`] reads, in the order
/// of the vertices.
///
/// # Errors
/// `Mesh` if the bytes are not a readable GLB.
pub fn glb_parts(bytes: &[u8]) -> Result<Vec<GlbPart>> {
    Ok(read(bytes)?.1)
}

fn read(bytes: &[u8]) -> Result<(Mesh, Vec<GlbPart>)> {
    let (json, binary) = glb_chunks(bytes)?;
    if json.len() > LARGEST_JSON {
        return Err(refusal(format!(
            "expected a description of up to {LARGEST_JSON} bytes, got {}",
            json.len()
        )));
    }
    check_json(json).map_err(|e| refusal(format!("its description: {e}")))?;
    let document: Document =
        serde_json::from_slice(json).map_err(|e| refusal(format!("its description: {e}")))?;
    let for_vertices = |name: &&String| FOR_VERTICES.iter().any(|part| name.contains(part));
    let mut required = document.extensions_required.iter().filter(for_vertices);
    if let Some(unknown) = required.find(|name| !UNDERSTOOD.contains(&name.as_str())) {
        return Err(refusal(format!(
            "the file needs the extension {unknown} for its vertices, which Anyface does not read; write it anew \
             without that, as Blender does (Import → glTF 2.0, then Export → glTF 2.0)"
        )));
    }
    let data = Data::new(&document, binary)?;
    let mut reading = Reading {
        mesh: Mesh::default(),
        parts: Vec::new(),
        skins: Skins::new(&document),
        data,
        budget: SHOWN_AGAIN.saturating_add(bytes.len().saturating_mul(4)),
    };
    reading.scene()?;
    Ok((reading.mesh, reading.parts))
}

/// The JSON chunk and the data chunk; the data is empty if the file has none.
pub(crate) fn glb_chunks(bytes: &[u8]) -> Result<(&[u8], &[u8])> {
    let number = |at: usize| -> Result<u32> {
        let four = bytes.get(at..at + 4).and_then(|b| b.try_into().ok());
        four.map(u32::from_le_bytes)
            .ok_or_else(|| refusal(format!("expected a header, got {} bytes", bytes.len())))
    };
    let version = number(4)?;
    if version != 2 {
        return Err(refusal(format!("expected version 2, got {version}")));
    }
    let length = number(8)? as usize;
    let Some(whole) = bytes.get(..length) else {
        return Err(refusal(format!(
            "expected {length} bytes, got {}: the file ends early",
            bytes.len()
        )));
    };
    let (mut json, mut binary) = (None, None);
    let mut rest = whole.get(12..).unwrap_or_default();
    while let Some((head, after)) = rest.split_at_checked(8) {
        let size = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some((body, after)) = after.split_at_checked(size) else {
            return Err(refusal(format!(
                "expected a chunk of {size} bytes, got {}",
                after.len()
            )));
        };
        match &head[4..] {
            JSON if json.is_none() => json = Some(body),
            BINARY if binary.is_none() => binary = Some(body),
            _ => {}
        }
        rest = after;
    }
    let json = json.ok_or_else(|| refusal("expected a description, got none".into()))?;
    Ok((json, binary.unwrap_or_default()))
}

/// A scene that is being read into a mesh.
struct Reading<'a> {
    mesh: Mesh,
    parts: Vec<GlbPart>,
    skins: Skins,
    data: Data<'a>,
    /// Vertices and corners that may still be added.
    budget: usize,
}

impl Reading<'_> {
    /// Adds the meshes of all nodes of the scene, each node before those below it.
    fn scene(&mut self) -> Result<()> {
        let document = self.data.document;
        let Some(scene) = document.scenes.get(document.scene) else {
            return if document.scenes.is_empty() {
                Ok(())
            } else {
                Err(missing("scene", document.scene, document.scenes.len()))
            };
        };
        let count = document.nodes.len();
        let mut visited = vec![false; count];
        let mut left: Vec<(usize, Matrix)> = Vec::new();
        left.extend(scene.nodes.iter().rev().map(|&node| (node, IDENTITY)));
        while let Some((number, above)) = left.pop() {
            let Some(node) = document.nodes.get(number) else {
                return Err(missing("node", number, count));
            };
            if std::mem::replace(&mut visited[number], true) {
                return Err(refusal(format!(
                    "expected every node below one other, got node {number} twice"
                )));
            }
            let placed = product(above, matrix(node));
            self.add_node(number, node, placed)?;
            left.extend(node.children.iter().rev().map(|&child| (child, placed)));
        }
        Ok(())
    }

    fn add_node(&mut self, number: usize, node: &Node, placed: Matrix) -> Result<()> {
        let document = self.data.document;
        let Some(mesh) = node.mesh else {
            return Ok(());
        };
        let Some(document_mesh) = document.meshes.get(mesh) else {
            return Err(missing("mesh", mesh, document.meshes.len()));
        };
        for (k, primitive) in document_mesh.primitives.iter().enumerate() {
            let first = self.mesh.positions.len();
            let (placed, blends) = match self.add_primitive(primitive, (node.skin, placed))? {
                Blend::Whole(placed) => (placed, Vec::new()),
                Blend::Vertices(blends) => {
                    let turns = blends
                        .iter()
                        .map(|[a, b, c, _]| [a, b, c].map(|m| [m[0], m[1], m[2]]));
                    (IDENTITY, turns.collect())
                }
            };
            self.parts.push(GlbPart {
                node: number,
                mesh,
                primitive: k,
                vertices: first..self.mesh.positions.len(),
                placed,
                blends,
            });
        }
        Ok(())
    }

    /// Adds a primitive, and returns what placed its vertices.
    fn add_primitive(
        &mut self,
        primitive: &Primitive,
        (skin, placed): (Option<usize>, Matrix),
    ) -> Result<Blend> {
        let positions = primitive.attributes.get("POSITION");
        let (Some(&positions), 4..=6) = (positions, primitive.mode) else {
            return Ok(Blend::Whole(placed));
        };
        let first = self.mesh.positions.len();
        let draco = self.decode(primitive, positions)?;
        let positions = match &draco {
            Some(draco) => draco.attribute("POSITION").unwrap_or_default(),
            None => {
                self.pay(self.data.count(positions)?)?;
                self.data.positions(positions)?
            }
        };
        let vertex_count = positions.len();
        let blend = match skin {
            None => Blend::Whole(placed),
            Some(skin) => {
                let joints = self.data.document.skins.get(skin);
                let joints = joints.map_or(0, |skin| skin.joints.len());
                self.pay(joints.saturating_add(SKINNED.saturating_mul(vertex_count)))?;
                let attribute = |name: &str| self.fours(primitive, draco.as_ref(), name);
                let of = (skin, vertex_count);
                self.skins.blend(&self.data, of, attribute)?
            }
        };
        let place = |(v, p): (usize, [f32; 3])| match &blend {
            Blend::Whole(placed) => apply(*placed, p),
            Blend::Vertices(blends) => apply(blends[v], p),
        };
        let places = positions.into_iter().enumerate().map(place);
        self.mesh.positions.extend(places);
        let corners: Vec<u32> = match (&draco, primitive.indices) {
            (Some(draco), _) => draco.corners(),
            (None, Some(indices)) => {
                self.pay(self.data.count(indices)?)?;
                self.data.indices(indices)?
            }
            (None, None) => (0..vertex_count as u32).collect(),
        };
        if let Some(beyond) = corners.iter().find(|&&v| v as usize >= vertex_count) {
            return Err(refusal(format!(
                "expected vertex numbers below {vertex_count}, got {beyond}"
            )));
        }
        let mut add = |triangle: [u32; 3]| {
            self.mesh.triangles.push(triangle.map(|v| v + first as u32));
        };
        let (threes, _) = corners.as_chunks::<3>();
        match primitive.mode {
            // A stream of Draco has triangles, whatever the primitive had.
            _ if draco.is_some() => threes.iter().for_each(|t| add(*t)),
            4 => threes.iter().for_each(|t| add(*t)),
            // Every other triangle of a strip is turned. A triangle with a repeated corner is
            // skipped.
            5 => corners.windows(3).enumerate().for_each(|(i, t)| {
                if t[0] != t[1] && t[1] != t[2] && t[0] != t[2] {
                    add([t[i % 2], t[1 - i % 2], t[2]]);
                }
            }),
            _ => (2..corners.len()).for_each(|i| add([corners[0], corners[i - 1], corners[i]])),
        }
        Ok(blend)
    }

    /// The numbers of a primitive that is compressed as a whole.
    fn decode<'p>(
        &mut self,
        primitive: &'p Primitive,
        positions: usize,
    ) -> Result<Option<Decoded<'p>>> {
        let Some(draco) = &primitive.extensions.draco else {
            return Ok(None);
        };
        let draco = Decoded::new(&self.data, draco, self.budget)?;
        let (count, expected) = (draco.vertex_count(), self.data.declared_count(positions)?);
        if count != expected {
            return Err(refusal(format!(
                "expected {expected} vertices in the data of KHR_draco_mesh_compression, got {count}"
            )));
        }
        self.pay(count)?;
        Ok(Some(draco))
    }

    /// Four numbers of an attribute for each vertex; `None` if the primitive lacks it.
    fn fours(
        &self,
        primitive: &Primitive,
        draco: Option<&Decoded<'_>>,
        name: &str,
    ) -> Result<Option<Vec<[f32; 4]>>> {
        let Some(&accessor) = primitive.attributes.get(name) else {
            return Ok(None);
        };
        match draco.and_then(|draco| draco.attribute(name)) {
            Some(fours) => {
                let scale = self.data.scale(accessor)?;
                Ok(Some(
                    fours
                        .into_iter()
                        .map(|four| four.map(|x| scale * x))
                        .collect(),
                ))
            }
            None => self.data.fours(accessor).map(Some),
        }
    }

    fn pay(&mut self, count: usize) -> Result<()> {
        self.budget = self.budget.checked_sub(count).ok_or_else(|| {
            refusal(
                "expected few nodes for each mesh, got so many that the scene is too large".into(),
            )
        })?;
        match u32::try_from(self.mesh.positions.len() + count) {
            Ok(_) => Ok(()),
            Err(_) => Err(refusal("expected fewer than 4294967296 vertices".into())),
        }
    }
}

#[cfg(test)]
mod tests;
