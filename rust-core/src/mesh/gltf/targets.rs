//! Reads the morph targets of a file.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{
    GlbPart, SHOWN_AGAIN,
    accessor::Data,
    document::{Document, refusal},
    glb_chunks, glb_parts,
};
use crate::Result;

/// A morph target of a mesh in a GLB.
#[derive(Debug, Clone, PartialEq)]
pub struct GlbTarget {
    /// Number of its mesh.
    pub mesh: usize,
    /// Its number among the targets of that mesh.
    pub number: usize,
    /// Its name, or its number if the file names none.
    pub name: String,
    /// Vertices of the whole mesh that was read with their displacements at weight 1, mesh units,
    /// ordered by vertex number. Empty for a target that moves nothing.
    pub moved: Vec<(u32, [f32; 3])>,
}

/// The morph targets of every mesh that [`glb_parts`] lists, ordered by mesh and number.
///
/// # Errors
/// `Mesh` if the bytes are not a readable GLB or its targets do not fit their meshes.
pub fn glb_targets(bytes: &[u8]) -> Result<Vec<GlbTarget>> {
    let parts = glb_parts(bytes)?;
    let (json, binary) = glb_chunks(bytes)?;
    let wrong = |e: serde_json::Error| refusal(format!("its description: {e}"));
    let document: Document = serde_json::from_slice(json).map_err(wrong)?;
    let names: Value = serde_json::from_slice(json).map_err(wrong)?;
    let data = Data::new(&document, binary)?;
    let mut budget = SHOWN_AGAIN.saturating_add(bytes.len().saturating_mul(8));
    let mut targets = BTreeMap::<(usize, usize), GlbTarget>::new();
    for part in &parts {
        let primitive = &document.meshes[part.mesh].primitives[part.primitive];
        for (number, target) in primitive.targets.iter().enumerate() {
            let known = targets
                .entry((part.mesh, number))
                .or_insert_with(|| GlbTarget {
                    mesh: part.mesh,
                    number,
                    name: target_name(&names["meshes"][part.mesh], number),
                    moved: Vec::new(),
                });
            if let Some(accessor) = target["POSITION"].as_u64().map(|n| n as usize) {
                budget = budget
                    .checked_sub(data.count(accessor)?)
                    .ok_or_else(|| refusal("expected fewer targets for so small a file".into()))?;
                known.moved.extend(moved(&data, accessor, part)?);
            }
        }
    }
    Ok(targets.into_values().collect())
}

/// The numbers of accessors of single numbers, such as the weights of targets over time.
///
/// # Errors
/// `Mesh` if the bytes are not a readable GLB or have no such accessor.
pub(crate) fn glb_scalars(
    bytes: &[u8],
    accessors: impl IntoIterator<Item = usize>,
) -> Result<BTreeMap<usize, Vec<f32>>> {
    let (json, binary) = glb_chunks(bytes)?;
    let document: Document =
        serde_json::from_slice(json).map_err(|e| refusal(format!("its description: {e}")))?;
    let data = Data::new(&document, binary)?;
    let read = |accessor: usize| Ok((accessor, data.scalars(accessor)?));
    accessors.into_iter().map(read).collect()
}

/// The displacements of a part that are not zero, in the axes and units of the whole mesh.
fn moved(data: &Data<'_>, accessor: usize, part: &GlbPart) -> Result<Vec<(u32, [f32; 3])>> {
    // An accessor without data is all zeros, as exporters write an empty target.
    let known = data.document.accessors.get(accessor);
    let is_zero = known.is_some_and(|known| known.buffer_view.is_none() && known.sparse.is_none());
    if part.vertices.is_empty() || is_zero {
        return Ok(Vec::new());
    }
    let local = data.positions(accessor)?;
    if local.len() != part.vertices.len() {
        return Err(refusal(format!(
            "expected a target of {} vertices, got {}",
            part.vertices.len(),
            local.len()
        )));
    }
    let moved = part.vertices.clone().zip(local);
    let moved = moved.filter(|(_, d)| *d != [0.0; 3] && d.iter().all(|x| x.is_finite()));
    Ok(moved
        .map(|(v, d)| (v as u32, part.shown_displacement(v, d)))
        .collect())
}

/// The name of a target, from the extras of its mesh or of the mesh's first primitive.
pub(crate) fn target_name(mesh: &Value, number: usize) -> String {
    let of = |place: &Value| {
        place["extras"]["targetNames"][number]
            .as_str()
            .map(str::to_owned)
    };
    of(mesh)
        .or_else(|| of(&mesh["primitives"][0]))
        .unwrap_or_else(|| number.to_string())
}
