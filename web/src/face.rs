//! A head whose face was found.

use std::sync::{Arc, OnceLock};

use anyface::{
    job::SILENT,
    mesh::{GlbPart, GlbTarget, Mouth, PartRole, glb_parts},
    output::MeshTargets,
};
use ndarray::ArrayView3;
use wasm_bindgen::prelude::*;

/// A head whose face was found.
#[wasm_bindgen]
pub struct Face {
    pub(crate) face: anyface::Face,
    /// Bytes of the file that it was read from.
    pub(crate) file: Vec<u8>,
    parts: Vec<GlbPart>,
    /// What the morph targets of the file show; read when it is first asked for.
    targets: OnceLock<Option<Arc<MeshTargets>>>,
}

impl Face {
    pub(crate) fn new(face: anyface::Face, file: Vec<u8>) -> anyface::Result<Face> {
        let parts = if file.starts_with(b"glTF") {
            glb_parts(&file)?
        } else {
            Vec::new()
        };
        Ok(Face {
            face,
            file,
            parts,
            targets: OnceLock::new(),
        })
    }

    /// The morph targets of the file; nothing if none of them shows a shape that a take needs.
    fn own_targets(&self) -> Option<&MeshTargets> {
        let read = || MeshTargets::read(&self.file, &self.face).ok();
        self.targets.get_or_init(read).as_deref()
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

    /// Names of the morph targets of a GLB or VRM `[N]`, such as `jawOpen`. Empty if the file has none
    /// that shows a shape of the face by the tables of ARKit, Oculus, VRM, MMD, Character Creator, Daz or Ready
    /// Player Me.
    #[wasm_bindgen(js_name = targetNames)]
    pub fn target_names(&self) -> Vec<String> {
        let targets = self.own_targets().map_or(&[][..], MeshTargets::targets);
        targets.iter().map(|target| target.name.clone()).collect()
    }

    /// Where the morph targets stand in the file, `[N * 2]`: for each the number of its mesh, and its own
    /// among the targets of that mesh.
    #[wasm_bindgen(js_name = targetPlaces)]
    pub fn target_places(&self) -> Vec<u32> {
        let targets = self.own_targets().map_or(&[][..], MeshTargets::targets);
        let place = |target: &GlbTarget| [target.mesh, target.number].map(|n| n as u32);
        targets.iter().flat_map(place).collect()
    }

    /// Weights of the morph targets of the file, `[N]`, 0 to 1, that show displacements `[V * 3]` as
    /// `clipFrame` and `liveFrame` give them.
    ///
    /// # Errors
    /// If the file has no target that can show them, or the displacements are not those of this face.
    #[wasm_bindgen(js_name = targetWeights)]
    pub fn target_weights(&self, displacements: &[f32]) -> Result<Vec<f32>, JsError> {
        let targets = self.own_targets().ok_or_else(|| {
            JsError::new(
                "targetWeights: expected a GLB or VRM with morph targets for speech, got a head without; \
                 targetNames() tells",
            )
        })?;
        let vertices = self.face.mesh.positions.len();
        let moved = ArrayView3::from_shape((1, vertices, 3), displacements).map_err(|_| {
            let (wanted, got) = (3 * vertices, displacements.len());
            JsError::new(&format!(
                "displacements: expected three numbers for each of {vertices} vertices, {wanted} in all, got {got}"
            ))
        })?;
        let weights = targets.weights(moved, None, SILENT)?;
        Ok(weights.into_raw_vec_and_offset().0)
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
