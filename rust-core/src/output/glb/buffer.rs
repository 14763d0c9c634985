//! The numbers of a glTF: bytes, and the views and accessors that say what they are.

use serde_json::{Value, json};

use crate::{Error, Result};

/// Kinds of numbers in accessors.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// Bytes that are added to one buffer of a document.
pub(super) struct Buffer {
    /// Number of the buffer.
    number: usize,
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// What the document has of both already.
    first_view: usize,
    first_accessor: usize,
}

/// Corners of a box about values.
type Bounds = (Vec<f32>, Vec<f32>);

impl Buffer {
    /// After `bytes` that the buffer has, and so many views and accessors of the document.
    pub(super) fn after(number: usize, bytes: Vec<u8>, views: usize, accessors: usize) -> Buffer {
        Buffer {
            number,
            bytes,
            views: Vec::new(),
            accessors: Vec::new(),
            first_view: views,
            first_accessor: accessors,
        }
    }

    /// The bytes, and what stands in the document for the new ones: views and accessors.
    pub(super) fn finish(self) -> (Vec<u8>, Vec<Value>, Vec<Value>) {
        (self.bytes, self.views, self.accessors)
    }

    fn view(&mut self, bytes: impl IntoIterator<Item = [u8; 4]>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let first = self.bytes.len();
        self.bytes.extend(bytes.into_iter().flatten());
        self.views.push(json!({
            "buffer": self.number, "byteOffset": first, "byteLength": self.bytes.len() - first,
        }));
        self.first_view + self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.first_accessor + self.accessors.len() - 1
    }

    /// An accessor of numbers; `kind`: `SCALAR`, `VEC3` or `VEC4`.
    ///
    /// # Errors
    /// `InvalidInput` for no numbers, which the format has no place for.
    pub(super) fn floats(
        &mut self,
        values: &[f32],
        kind: &str,
        bounds: Option<Bounds>,
    ) -> Result<usize> {
        let width = match kind {
            "SCALAR" => 1,
            "VEC3" => 3,
            _ => 4,
        };
        if values.is_empty() {
            let message = "expected at least one frame for a GLB, got none";
            return Err(Error::InvalidInput(message.into()));
        }
        let view = self.view(values.iter().map(|x| x.to_le_bytes()));
        let mut accessor = json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len() / width, "type": kind,
        });
        if let Some((low, high)) = bounds {
            (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        }
        Ok(self.accessor(accessor))
    }

    /// An accessor of points, with the box about them.
    ///
    /// # Errors
    /// `InvalidInput` for no points.
    pub(super) fn points(&mut self, points: &[[f32; 3]]) -> Result<usize> {
        self.floats(points.as_flattened(), "VEC3", Some(bounds(points)))
    }

    /// An accessor of the corners of triangles.
    pub(super) fn corners(&mut self, triangles: &[[u32; 3]]) -> usize {
        let corners = triangles.as_flattened();
        let view = self.view(corners.iter().map(|v| v.to_le_bytes()));
        self.accessor(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": corners.len(), "type": "SCALAR",
        }))
    }

    /// Displacements of `count` vertices of which these move, in the order of their numbers; only what moves takes room.
    pub(super) fn displacements(
        &mut self,
        count: usize,
        moved: &[(u32, [f32; 3])],
    ) -> Result<usize> {
        let mut points: Vec<[f32; 3]> = moved.iter().map(|(_, d)| *d).collect();
        if 4 * moved.len() > 3 * count {
            let mut all = vec![[0.0; 3]; count];
            moved.iter().for_each(|(v, d)| all[*v as usize] = *d);
            return self.points(&all);
        }
        let mut accessor = json!({"componentType": FLOAT, "count": count, "type": "VEC3"});
        if !moved.is_empty() {
            let indices = self.view(moved.iter().map(|(v, _)| v.to_le_bytes()));
            let values = self.view(points.as_flattened().iter().map(|x| x.to_le_bytes()));
            accessor["sparse"] = json!({
                "count": moved.len(),
                "indices": {"bufferView": indices, "componentType": UNSIGNED_INT},
                "values": {"bufferView": values},
            });
        }
        points.push([0.0; 3]);
        let (low, high) = bounds(&points);
        (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        Ok(self.accessor(accessor))
    }
}

fn bounds(points: &[[f32; 3]]) -> Bounds {
    let of = |pick: fn(f32, f32) -> f32, from: f32| {
        let axes = (0..3).map(|i| points.iter().map(|p| p[i]).fold(from, pick));
        axes.collect()
    };
    (of(f32::min, f32::INFINITY), of(f32::max, f32::NEG_INFINITY))
}
