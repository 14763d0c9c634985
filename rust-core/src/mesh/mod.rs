//! Reads and checks artists' triangle meshes, splits them into parts, finds and aligns the face.

mod align;
mod canonical;
mod check;
pub(crate) mod dijkstra;
pub(crate) mod direction;
pub(crate) mod features;
mod find_landmarks;
mod fixed;
mod foreign_formats;
mod front_view;
mod gltf;
pub mod ibug;
mod landmark_file;
pub(crate) mod lips;
mod mouth;
mod normals;
mod obj;
pub mod parts;
mod ply;
pub(crate) mod polygons;
mod read;
mod roles;
pub mod simplify;
pub(crate) mod snap;
pub(crate) mod sphere;
mod subdivide;
mod texture;
pub(crate) mod tree;

pub use align::{Fit, Similarity};
pub use canonical::{align_to_canonical, canonical_landmarks};
pub use check::MeshReport;
pub use find_landmarks::{LandmarkFinder, MODEL as LANDMARK_MODEL};
pub use fixed::{FIVE_POINTS, FixedLandmark, LandmarkPlace};
pub use front_view::FrontView;
pub(crate) use front_view::depth_at;
pub use gltf::{GlbPart, GlbTarget, glb_parts, glb_targets};
pub(crate) use gltf::{glb_chunks, glb_scalars, target_name};
pub use mouth::Mouth;
pub(crate) use obj::obj_text;
pub use parts::Parts;
pub use read::{NamedMesh, read_mesh_file};
pub use roles::{ObjectNames, Part, PartChoices, PartRole, PartSelector, RoleSource};
pub(crate) use texture::texture_coordinates;
pub use tree::{ClosestPlace, SurfaceTree};

use ibug::LANDMARKS;

/// A triangle mesh in the user's own units, axes and vertex order.
///
/// ```
/// use anyface::mesh::Mesh;
///
/// let head = concat!(env!("CARGO_MANIFEST_DIR"), "/../weights/shared/default_head/head.obj");
/// let mesh = Mesh::read(head)?;
/// assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.positions.len()));
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// `[V]`, positions in the user's units; all finite.
    pub positions: Vec<[f32; 3]>,
    /// `[F]`, vertex numbers, each below `V`; polygons arrive triangulated.
    pub triangles: Vec<[u32; 3]>,
}

/// The 68 iBUG landmarks of a mesh, on its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    /// `[68]`, in the mesh's own units and axes.
    pub positions: [[f32; 3]; 68],
    /// The vertex nearest to each landmark.
    pub vertices: [u32; 68],
    /// Confidence of each, 0 to 1; 1 where the caller is certain of it.
    pub confidence: [f32; 68],
}

/// Landmarks as a caller gives them.
#[derive(Debug, Clone, PartialEq)]
pub enum LandmarkSource {
    /// 68 points in the mesh's own units. Each moves to the nearest suitable place on the surface.
    Positions(Vec<[f32; 3]>),
    /// 68 vertex numbers.
    Vertices(Vec<u32>),
    /// 68 points, each with a vertex number and a confidence. A point that lies at its vertex stays
    /// on that vertex: the two rims of closed lips may lie in one place, and a point alone cannot
    /// say which one it means. All other points move to the nearest suitable place on the surface,
    /// as if they had no vertex number.
    Known(Vec<KnownLandmark>),
}

/// A landmark that was found before, or that a caller knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLandmark {
    /// In the mesh's own units.
    pub position: [f32; 3],
    /// The vertex that it may lie on.
    pub vertex: u32,
    /// Confidence with which it was found, 0 to 1; 1 where the caller is certain of it.
    pub confidence: f32,
}

impl From<&Landmarks> for LandmarkSource {
    fn from(known: &Landmarks) -> LandmarkSource {
        let landmark = |n: usize| KnownLandmark {
            position: known.positions[n],
            vertex: known.vertices[n],
            confidence: known.confidence[n],
        };
        LandmarkSource::Known((0..LANDMARKS).map(landmark).collect())
    }
}

impl Mesh {
    /// A text of 32 hexadecimal digits that is the same for meshes with the same positions, to the bit, and the same
    /// triangles, in the same order.
    pub fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(self.positions.len() as u64).to_le_bytes());
        for x in self.positions.as_flattened() {
            hasher.update(&x.to_le_bytes());
        }
        for v in self.triangles.as_flattened() {
            hasher.update(&v.to_le_bytes());
        }
        hasher.finalize().to_hex()[..32].to_owned()
    }
}

/// An axis of the mesh's own frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Axis {
    PosX,
    NegX,
    PosY,
    NegY,
    PosZ,
    NegZ,
}

impl Axis {
    /// Every axis. The directions in which meshes commonly face come first.
    pub const ALL: [Axis; 6] = [
        Axis::PosZ,
        Axis::NegY,
        Axis::PosY,
        Axis::NegZ,
        Axis::PosX,
        Axis::NegX,
    ];

    /// Unit vector along the axis.
    pub fn direction(self) -> [f64; 3] {
        match self {
            Axis::PosX => [1.0, 0.0, 0.0],
            Axis::NegX => [-1.0, 0.0, 0.0],
            Axis::PosY => [0.0, 1.0, 0.0],
            Axis::NegY => [0.0, -1.0, 0.0],
            Axis::PosZ => [0.0, 0.0, 1.0],
            Axis::NegZ => [0.0, 0.0, -1.0],
        }
    }
}

impl std::fmt::Display for Axis {
    /// `+x`, `-x` and so on.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Axis::PosX => "+x",
            Axis::NegX => "-x",
            Axis::PosY => "+y",
            Axis::NegY => "-y",
            Axis::PosZ => "+z",
            Axis::NegZ => "-z",
        })
    }
}
