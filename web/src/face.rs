//! A head whose face was found.

use anyface::mesh::{GlbPart, Mouth, PartRole, glb_parts};
use wasm_bindgen::prelude::*;

/// A head whose face was found.
#[wasm_bindgen]
pub struct Face {
    pub(crate) face: anyface::Face,
    /// Bytes of the file that it was read from.
    pub(crate) file: Vec<u8>,
    parts: Vec<GlbPart>,
}

impl Face {
    pub(crate) fn new(face: anyface::Face, file: Vec<u8>) -> anyface::Result<Face> {
        let parts = if file.starts_with(b"glTF") {
            glb_parts(&file)?
        } else {
            Vec::new()
        };
        Ok(Face { face, file, parts })
    }
}

#[wasm_bindgen]
impl Face {
    /// Rest positions of all vertices, `[V * 3]`.
    pub fn positions(&self) -> Vec<f32> {
        self.face.mesh.positions.as_flattened().to_vec()
    }

    /// Vertex numbers of all triangles, `[F * 3]`.
    pub fn triangles(&self) -> Vec<u32> {
        self.face.mesh.triangles.as_flattened().to_vec()
    }

    /// The 68 landmarks, `[68 * 3]`, units of the mesh.
    pub fn landmarks(&self) -> Vec<f32> {
        self.face.landmarks.positions.as_flattened().to_vec()
    }

    /// Transform from the axes of a face (x to its left, y up, z to the front; origin between the
    /// hinges of the jaw; metres) to the mesh: a matrix of four columns, `[16]`.
    pub fn place(&self) -> Vec<f32> {
        let place = self.face.to_canonical.inverse();
        let column = |c: usize| [0, 1, 2].map(|r| place.scale * place.rotation[r][c]);
        let turned = [0, 1, 2].map(column).map(|[x, y, z]| [x, y, z, 0.0]);
        let [x, y, z] = place.translation;
        let columns = [turned[0], turned[1], turned[2], [x, y, z, 1.0]];
        columns.as_flattened().iter().map(|x| *x as f32).collect()
    }

    /// Metres per unit of the mesh, if the head has human size.
    #[wasm_bindgen(getter, js_name = metresPerUnit)]
    pub fn metres_per_unit(&self) -> f64 {
        self.face.metres_per_unit()
    }

    /// Parts of a GLB, `[P * 5]`: for each the numbers of its node, mesh and primitive, of its
    /// first vertex and of the one after its last. Empty for other files.
    #[wasm_bindgen(js_name = glbParts)]
    pub fn glb_parts(&self) -> Vec<u32> {
        let numbers = |part: &GlbPart| {
            let GlbPart {
                node,
                mesh,
                primitive,
                ref vertices,
                ..
            } = *part;
            [node, mesh, primitive, vertices.start, vertices.end].map(|n| n as u32)
        };
        self.parts.iter().flat_map(numbers).collect()
    }

    /// Displacements `[V * 3]` as those of the positions that a GLB stores, which nodes and skins
    /// then turn and scale. Those of other files stay as they are.
    #[wasm_bindgen(js_name = storedDisplacements)]
    pub fn stored_displacements(&self, mut displacements: Vec<f32>) -> Vec<f32> {
        let (all, _) = displacements.as_chunks_mut::<3>();
        for part in &self.parts {
            for vertex in part.vertices.clone() {
                if let Some(displacement) = all.get_mut(vertex) {
                    *displacement = part.stored_displacement(vertex, *displacement);
                }
            }
        }
        displacements
    }

    /// Transforms by which the nodes of a GLB place its parts in the scene: matrices of four
    /// columns, `[P * 16]`; the identity where each vertex has its own.
    #[wasm_bindgen(js_name = glbPlaces)]
    pub fn glb_places(&self) -> Vec<f32> {
        let places = self.parts.iter().map(|part| part.placed.as_flattened());
        places.flatten().copied().collect()
    }

    /// Role of each vertex, `[V]`: 0 skin, 1 parts that follow the jaw, 2 parts that follow the
    /// skull, 3 the inside of a mouth, 4 lashes, brows and beards, 5 eyeballs, 6 anything else.
    pub fn roles(&self) -> Vec<u8> {
        let parts = &self.face.parts;
        let role = |part: u32| {
            let role = parts.parts.get(part as usize).map(|part| part.role);
            PartRole::ALL.iter().position(|known| Some(*known) == role)
        };
        let numbers = parts.of_vertex().iter().map(|part| role(*part));
        let other = PartRole::ALL.len() - 1;
        numbers
            .map(|number| number.unwrap_or(other) as u8)
            .collect()
    }

    /// Number of the part that each vertex belongs to, `[V]`. Triangles connect the vertices of a
    /// part.
    pub fn parts(&self) -> Vec<u32> {
        self.face.parts.of_vertex().to_vec()
    }

    /// Notes on what will not move as it should, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        let welded = "The lips of this head are one surface, so they stretch instead of parting. Anyface in Blender can \
                      part them.";
        let lips = (self.face.mouth() == Mouth::Welded).then(|| welded.to_owned());
        // After "; give" comes advice in terms of the command line, which a page has no use for.
        let rests = self.face.at_rest();
        let rests = rests.map(|rests| rests.split("; give").next().unwrap_or_default().to_owned());
        let rests = rests.map(|rests| format!("Some of this face was {rests}."));
        lips.into_iter().chain(rests).collect()
    }
}
