//! The numbers of a glTF: bytes, and the views and accessors that describe them.

use serde_json::{Value, json};

use super::bytes::Bytes;
use crate::{Error, Result};

// Component types of accessors.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;
/// Most vertices that 16 bits can number. The format reserves the last number.
const MAX_SHORT: usize = 0xFFFF;
// Targets of views, which tell graphics cards what a view holds.
const OF_VERTICES: u32 = 34962;
const OF_CORNERS: u32 = 34963;

/// Collects bytes for one buffer of a document, and their views and accessors.
pub struct Buffer {
    /// Number of the buffer.
    number: usize,
    bytes: Bytes,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Number of the first new view and of the first new accessor in the document.
    first_view: usize,
    first_accessor: usize,
}

/// Lowest and highest corner of the box around some values.
type Bounds = (Vec<f32>, Vec<f32>);

impl Buffer {
    /// Continues a buffer that already holds `bytes`. `views` and `accessors`: how many the document
    /// already has.
    pub fn after(number: usize, bytes: Vec<u8>, views: usize, accessors: usize) -> Buffer {
        Buffer {
            number,
            bytes: bytes.into(),
            views: Vec::new(),
            accessors: Vec::new(),
            first_view: views,
            first_accessor: accessors,
        }
    }

    /// The bytes, and the new views and accessors for the document.
    pub fn finish(self) -> (Bytes, Vec<Value>, Vec<Value>) {
        (self.bytes, self.views, self.accessors)
    }

    fn view<const N: usize>(
        &mut self,
        bytes: impl IntoIterator<Item = [u8; N]>,
        target: Option<u32>,
    ) -> usize {
        self.bytes.pad();
        let first = self.bytes.len();
        self.bytes.extend(bytes.into_iter().flatten());
        self.view_from(first, target)
    }

    /// Adds a view of the bytes from `first` on.
    fn view_from(&mut self, first: usize, target: Option<u32>) -> usize {
        let mut view = json!({
            "buffer": self.number, "byteOffset": first, "byteLength": self.bytes.len() - first,
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.first_view + self.views.len() - 1
    }

    /// Adds a view of vertex numbers below `count`. Returns the view and its component type.
    fn numbers(
        &mut self,
        values: impl Iterator<Item = u32>,
        count: usize,
        target: Option<u32>,
    ) -> (usize, u32) {
        if count <= MAX_SHORT {
            let short = values.map(|v| (v as u16).to_le_bytes());
            (self.view(short, target), UNSIGNED_SHORT)
        } else {
            (
                self.view(values.map(u32::to_le_bytes), target),
                UNSIGNED_INT,
            )
        }
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.first_accessor + self.accessors.len() - 1
    }

    /// Adds an accessor of numbers over time. `kind`: `SCALAR`, `VEC3` or `VEC4`.
    ///
    /// # Errors
    /// `InvalidInput` for no numbers, because the format allows no empty accessor.
    pub fn floats(&mut self, values: &[f32], kind: &str, bounds: Option<Bounds>) -> Result<usize> {
        if values.is_empty() {
            return Err(no_frames());
        }
        Ok(self.values(values, kind, bounds, None))
    }

    /// Adds an accessor of `count` numbers over time, which are asked for when they are written.
    /// `kind`: as of [`Buffer::floats`].
    ///
    /// # Errors
    /// `InvalidInput` for no numbers, because the format allows no empty accessor.
    pub fn later(
        &mut self,
        count: usize,
        kind: &str,
        values: impl Iterator<Item = f32> + 'static,
    ) -> Result<usize> {
        if count == 0 {
            return Err(no_frames());
        }
        self.bytes.pad();
        let first = self.bytes.len();
        self.bytes.add_numbers(count, values);
        let view = self.view_from(first, None);
        Ok(self.accessor(json!({
            "bufferView": view, "componentType": FLOAT, "count": count / width(kind), "type": kind,
        })))
    }

    fn values(
        &mut self,
        values: &[f32],
        kind: &str,
        bounds: Option<Bounds>,
        target: Option<u32>,
    ) -> usize {
        let view = self.view(values.iter().map(|x| x.to_le_bytes()), target);
        let mut accessor = json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len() / width(kind), "type": kind,
        });
        if let Some((low, high)) = bounds {
            (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        }
        self.accessor(accessor)
    }

    /// Adds an accessor of one point per vertex, with their bounding box.
    pub fn points(&mut self, points: &[[f32; 3]]) -> usize {
        let flat = points.as_flattened();
        self.values(flat, "VEC3", Some(bounds(points)), Some(OF_VERTICES))
    }

    /// Adds an accessor of texture coordinates, one pair per vertex.
    pub fn coordinates(&mut self, coordinates: &[[f32; 2]]) -> usize {
        let flat = coordinates.as_flattened();
        self.values(flat, "VEC2", None, Some(OF_VERTICES))
    }

    /// Adds an accessor of the corners of triangles in a mesh of `count` vertices.
    pub fn corners(&mut self, triangles: &[[u32; 3]], count: usize) -> usize {
        let corners = triangles.as_flattened();
        let (view, kind) = self.numbers(corners.iter().copied(), count, Some(OF_CORNERS));
        self.accessor(json!({
            "bufferView": view, "componentType": kind, "count": corners.len(), "type": "SCALAR",
        }))
    }

    /// Adds an accessor of displacements of `count` vertices. `moved`: the vertices that move, in the
    /// order of their numbers. Stores only these or all vertices, whichever takes fewer bytes.
    pub fn displacements(&mut self, count: usize, moved: &[(u32, [f32; 3])]) -> usize {
        let number_bytes = if count <= MAX_SHORT { 2 } else { 4 };
        if (12 + number_bytes) * moved.len() > 12 * count {
            let mut all = vec![[0.0; 3]; count];
            moved.iter().for_each(|(v, d)| all[*v as usize] = *d);
            return self.points(&all);
        }
        let mut points: Vec<[f32; 3]> = moved.iter().map(|(_, d)| *d).collect();
        let mut accessor = json!({"componentType": FLOAT, "count": count, "type": "VEC3"});
        if !moved.is_empty() {
            let (indices, kind) = self.numbers(moved.iter().map(|(v, _)| *v), count, None);
            let bytes = points.as_flattened().iter().map(|x| x.to_le_bytes());
            let values = self.view(bytes, None);
            accessor["sparse"] = json!({
                "count": moved.len(),
                "indices": {"bufferView": indices, "componentType": kind},
                "values": {"bufferView": values},
            });
        }
        points.push([0.0; 3]);
        let (low, high) = bounds(&points);
        (accessor["min"], accessor["max"]) = (json!(low), json!(high));
        self.accessor(accessor)
    }
}

/// Numbers of an element of an accessor.
fn width(kind: &str) -> usize {
    match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        _ => 4,
    }
}

fn no_frames() -> Error {
    Error::InvalidInput("expected at least one frame for a GLB, got none".into())
}

fn bounds(points: &[[f32; 3]]) -> Bounds {
    let of = |pick: fn(f32, f32) -> f32, from: f32| {
        let axes = (0..3).map(|i| points.iter().map(|p| p[i]).fold(from, pick));
        axes.collect()
    };
    (of(f32::min, f32::INFINITY), of(f32::max, f32::NEG_INFINITY))
}
