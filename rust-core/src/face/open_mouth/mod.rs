//! Lips that are one surface, parted: a seam, a cut along it, a bag behind it.
//!
//! The seam is the valley between the lips (`valley`), drawn over the surface as a level set (`trace`)
//! so that it crosses triangles where no edge follows it. The surface is cut there (`cut`) and a bag is
//! sewn to both banks (`bag`). No old vertex moves and none is lost: at rest the surface is the same.
//! Every new vertex and every corner of a new triangle says what it is made of, so that a caller can
//! carry texture coordinates, groups, normals, materials and shape keys over.

mod bag;
mod cut;
mod patch;
mod trace;
mod valley;

#[cfg(test)]
mod tests;

use glam::DVec3;

use crate::{
    Error, Result,
    mesh::{Landmarks, Mesh, Mouth, align_to_canonical},
};
use bag::sew_bag;
use cut::CutMesh;
pub use cut::TriangleSource;
use patch::{MouthFrame, Patch, Sewing};
use trace::{Node, trace};
use valley::SeamLine;

/// Fewest vertices of a slit that can open, both corners included.
const LEAST_VERTICES: usize = 3;

/// A mesh whose lips were one surface and can part now.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenedMouth {
    /// The old vertices with their numbers, where they were; then the new ones. The old triangles in
    /// their order, those that were cut in pieces; then the bag.
    pub mesh: Mesh,
    /// The landmarks, those of the inner lips on the rim of their own lip.
    pub landmarks: Landmarks,
    /// `[V', 3]`: old vertices and their shares, sum 1, of which each vertex is a mixture. Vertices of
    /// the bag take what lies before them at the rim.
    pub vertex_sources: Vec<[(u32, f32); 3]>,
    /// `[F']`.
    pub triangle_sources: Vec<TriangleSource>,
    /// From here on vertices are those of the bag.
    pub first_bag_vertex: usize,
    /// From here on triangles are those of the bag.
    pub first_bag_triangle: usize,
    /// Vertices of the upper lip's rim from the subject's right corner to the left one.
    pub upper_rim: Vec<u32>,
    /// The same of the lower lip; both rims share their ends.
    pub lower_rim: Vec<u32>,
}

/// Parts lips that are one surface and sews a bag behind them.
///
/// ```
/// use anyface::{mesh::{LandmarkSource, Mesh}, face::{FaceOptions, locate_landmarks, open_mouth}};
///
/// let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
/// let mesh = Mesh::read(head.join("head.obj"))?;
/// let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json"))?);
/// let found = locate_landmarks(&mesh, &FaceOptions { landmarks, ..Default::default() })?;
/// // The lips of this head part already.
/// assert!(open_mouth(&mesh, &found).is_err());
/// # Ok::<(), anyface::Error>(())
/// ```
///
/// # Errors
/// `InvalidInput` where the lips part already, stand apart before a pit, or the landmarks name no mouth; `Mesh` where the surface
/// between the lips has no line from corner to corner.
pub fn open_mouth(mesh: &Mesh, landmarks: &Landmarks) -> Result<OpenedMouth> {
    let mouth = Mouth::of(mesh, landmarks);
    if mouth != Mouth::Welded {
        return Err(Error::InvalidInput(format!(
            "open mouth: expected lips that are one surface, got some that part already ({})",
            mouth.name()
        )));
    }
    let to_canonical = align_to_canonical(landmarks)?;
    let frame = MouthFrame::of(landmarks, &to_canonical)?;
    let inner: [DVec3; 8] = std::array::from_fn(|i| frame.local_of(landmarks.positions[60 + i]));
    let found = |sewing: Sewing| -> Result<(Patch, SeamLine, Vec<Node>)> {
        let patch = Patch::around(mesh, landmarks, &frame, sewing)?;
        let seam = SeamLine::find(&patch, &inner)?;
        let line = trace(&patch, &seam, [inner[0], inner[4]])?;
        Ok((patch, seam, line))
    };
    let (patch, seam, line) = found(Sewing::Seams).or_else(|_| found(Sewing::Places))?;
    if line.len() < LEAST_VERTICES {
        return Err(Error::Mesh(
            "expected triangles smaller than the mouth, got one as wide as it".into(),
        ));
    }
    let above = |p: DVec3| p[1] - seam.height(p[0]);
    let mut cut = CutMesh::new(mesh, &patch, &line, above)?;
    let first_bag_vertex = cut.positions.len();
    let bag = sew_bag(&mut cut, mesh, &frame);
    let landmarks = landmarks_on_rims(&cut, landmarks, &frame);
    Ok(OpenedMouth::assemble(cut, bag, first_bag_vertex, landmarks))
}

impl OpenedMouth {
    fn assemble(
        cut: CutMesh,
        bag: Vec<[u32; 3]>,
        first_bag_vertex: usize,
        landmarks: Landmarks,
    ) -> OpenedMouth {
        let mut triangles: Vec<[u32; 3]> = cut.pieces.iter().map(|piece| piece.corners).collect();
        let source = |piece: &cut::Piece| TriangleSource {
            triangle: piece.source,
            corners: piece.shares,
        };
        let mut triangle_sources: Vec<TriangleSource> = cut.pieces.iter().map(source).collect();
        let first_bag_triangle = triangles.len();
        triangle_sources.extend(cut.sources_of_bag(&bag));
        triangles.extend(bag);
        OpenedMouth {
            mesh: Mesh {
                positions: cut.positions,
                triangles,
            },
            landmarks,
            vertex_sources: cut.sources,
            triangle_sources,
            first_bag_vertex,
            first_bag_triangle,
            upper_rim: cut.upper,
            lower_rim: cut.lower,
        }
    }
}

/// Puts the landmarks of the inner lips on the rims, each at its own place between the corners.
fn landmarks_on_rims(cut: &CutMesh, landmarks: &Landmarks, frame: &MouthFrame) -> Landmarks {
    let mut out = landmarks.clone();
    let local = |v: u32| frame.local_of(cut.positions[v as usize]);
    for n in 60..68 {
        let rim = if (61..64).contains(&n) {
            &cut.upper
        } else {
            &cut.lower
        };
        let wanted = frame.local_of(landmarks.positions[n]).x;
        let inner = match n {
            60 => 0..1,
            64 => rim.len() - 1..rim.len(),
            _ => 1..rim.len() - 1,
        };
        let away = |&&v: &&u32| (local(v).x - wanted).abs();
        let nearest = rim[inner].iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let vertex = *nearest.expect("a slit has vertices between its corners");
        out.vertices[n] = vertex;
        out.positions[n] = cut.positions[vertex as usize];
    }
    out
}
