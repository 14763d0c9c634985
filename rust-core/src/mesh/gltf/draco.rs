//! Primitives that are compressed by KHR_draco_mesh_compression.

use draco_core::{DecoderBuffer, MeshDecoder, decode_limits::DecodeLimits, mesh::Mesh as Stream};

use super::{
    accessor::Data,
    document::{Draco, refusal},
};
use crate::Result;

/// The numbers of a primitive.
pub(super) struct Decoded<'a> {
    stream: Stream,
    numbers: &'a Draco,
}

impl<'a> Decoded<'a> {
    /// `most`: number of triangles and of bytes for them that the scene may still have.
    pub(super) fn new(data: &Data<'_>, numbers: &'a Draco, most: usize) -> Result<Decoded<'a>> {
        let (bytes, _) = data.view(numbers.buffer_view)?;
        let limits = DecodeLimits::default()
            .with_max_points(most as u64)
            .with_max_faces(most as u64)
            .with_max_decoded_bytes(64 * most as u64);
        let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
        let mut stream = Stream::new();
        let decoded = MeshDecoder::new().decode(&mut buffer, &mut stream);
        decoded.map_err(|e| {
            refusal(format!(
                "the data of KHR_draco_mesh_compression cannot be read ({e}); write the file anew without \
                 compression, by `npx @gltf-transform/cli copy in.glb out.glb` or in Blender"
            ))
        })?;
        Ok(Decoded { stream, numbers })
    }

    pub(super) fn vertex_count(&self) -> usize {
        self.stream.num_points()
    }

    /// `N` numbers of an attribute for each vertex, as they are stored. `None` if the stream lacks
    /// the attribute.
    pub(super) fn attribute<const N: usize>(&self, name: &str) -> Option<Vec<[f32; N]>> {
        let attribute = *self.numbers.attributes.get(name)?;
        let attribute = self.stream.attribute_by_unique_id(attribute)?;
        let numbers = attribute.read_f32s(self.vertex_count(), N);
        Some(numbers.as_chunks::<N>().0.to_vec())
    }

    /// The corners of all triangles.
    pub(super) fn corners(&self) -> Vec<u32> {
        let faces = self.stream.faces().iter();
        faces.flatten().map(|point| point.0).collect()
    }
}
