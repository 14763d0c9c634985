//! Parts lips that are one surface: finds a seam, cuts along it and sews a bag behind it.
//!
//! The seam is the valley between the lips (`valley`). Large triangles beside it are divided
//! (`refine`). It is then drawn over the surface as a level set (`trace`), so that it crosses
//! triangles where no edge follows it. The surface is cut there (`cut`), and inner sides of the
//! lips, which roll inward, and a bag are sewn to both banks (`bag`). A trial opening measures
//! whether the mouth is good (`trial`). No old vertex moves and none is lost, so the surface at
//! rest stays the same. Every new vertex and every corner of a new triangle names its sources, so
//! that a caller can carry over texture coordinates, groups, normals, materials and shape keys.

mod bag;
mod cut;
mod patch;
mod trace;
mod trial;
mod valley;

#[cfg(test)]
mod tests;

use glam::{DVec2, DVec3};

use super::opened::{FineMesh, OpenedFace, mixed};
use crate::{
    Error, Result,
    mesh::{
        Landmarks, Mesh, Mouth, align_to_canonical,
        ibug::{CORNERS, MIRROR, OUTER_LIPS},
        lips::{Lip, lip_of_landmark},
    },
};
use bag::{Bag, sew_bag};
use cut::CutMesh;
use patch::{MouthFrame, Patch, Sewing};
use trace::{Node, trace};
pub use trial::MouthTrial;
use valley::SeamLine;

/// The border of a lip lies at least this far from the seam in the middle of the mouth, in widths
/// (6 mm).
const LEAST_LIP: f64 = 0.12;
/// Fewest vertices of a slit that can open, both corners included.
const LEAST_VERTICES: usize = 3;

/// Parts lips that are one surface and sews a bag behind them.
///
/// ```
/// use anyface::{mesh::{LandmarkSource, Mesh}, face::{FaceOptions, locate_landmarks, open_mouth}};
///
/// let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
/// let mesh = Mesh::read(head.join("head.obj"))?;
/// let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json"))?);
/// let located = locate_landmarks(&mesh, &FaceOptions { landmarks, ..Default::default() })?;
/// // The lips of this head part already.
/// assert!(open_mouth(&mesh, &located).is_err());
/// # Ok::<(), anyface::Error>(())
/// ```
///
/// # Errors
/// `InvalidInput` where the lips part already, where they stand apart in front of a pit, or where the
/// landmarks mark no mouth. `Mesh` where no line leads from corner to corner on the surface between
/// the lips.
pub fn open_mouth(mesh: &Mesh, landmarks: &Landmarks) -> Result<OpenedFace> {
    let mouth = Mouth::of(mesh, landmarks);
    if mouth != Mouth::Welded {
        return Err(Error::InvalidInput(format!(
            "open mouth: expected lips that are one surface, got lips that part already ({})",
            mouth.name()
        )));
    }
    let to_canonical = align_to_canonical(landmarks)?;
    let frame = MouthFrame::of(landmarks, &to_canonical)?;
    let inner: [DVec3; 8] = std::array::from_fn(|i| frame.local_of(landmarks.positions[60 + i]));
    let find_line = |sewing: Sewing| -> Result<(FineMesh, Patch, SeamLine, Vec<Node>)> {
        let patch = Patch::around(mesh, landmarks, &frame, sewing)?;
        let seam = SeamLine::find(&patch, &inner)?;
        let fine = FineMesh::beside(mesh, &patch.faces, |p| {
            let local = frame.local(p);
            (local, seam.distance(local))
        });
        let patch = Patch::around(&fine.mesh, landmarks, &frame, sewing)?;
        let line = trace(&patch, &seam, [inner[0], inner[4]])?;
        Ok((fine, patch, seam, line))
    };
    let (fine, patch, seam, line) =
        find_line(Sewing::Seams).or_else(|_| find_line(Sewing::Places))?;
    if line.len() < LEAST_VERTICES {
        return Err(Error::Mesh(
            "expected triangles smaller than the mouth, got one as wide as the mouth".into(),
        ));
    }
    let above = |p: DVec3| p[1] - seam.height(p[0]);
    let mut cut = CutMesh::new(&fine.mesh, &patch, &line, above)?;
    let first_inside_vertex = cut.positions.len();
    let bag = sew_bag(&mut cut, &fine.mesh, &frame);
    let landmarks = landmarks_on_lips(&cut, landmarks, &frame, &seam);
    Ok(OpenedFace::assemble(
        cut,
        &fine,
        bag,
        first_inside_vertex,
        landmarks,
    ))
}

impl OpenedFace {
    fn assemble(
        cut: CutMesh,
        fine: &FineMesh,
        bag: Bag,
        first_inside_vertex: usize,
        landmarks: Landmarks,
    ) -> OpenedFace {
        let mut triangles: Vec<[u32; 3]> = cut.pieces.iter().map(|piece| piece.corners).collect();
        let first_lining_triangle = triangles.len();
        let skin = cut.pieces.iter().map(|piece| (piece.source, piece.shares));
        let inside = cut.sources_of_bag(&bag.faces);
        let inside = inside
            .iter()
            .map(|source| (source.triangle, source.corners));
        let of_old = |(piece, shares)| fine.triangle_sources[piece as usize].piece(shares);
        let triangle_sources = skin.chain(inside).map(of_old).collect();
        let first_inside_triangle = first_lining_triangle + bag.lip_faces;
        triangles.extend(bag.faces);
        OpenedFace {
            mesh: Mesh {
                positions: cut.positions,
                triangles,
            },
            landmarks,
            vertex_sources: (cut.sources.iter())
                .map(|shares| mixed(&fine.vertex_sources, *shares))
                .collect(),
            triangle_sources,
            first_inside_vertex,
            first_lining_triangle,
            first_inside_triangle,
            upper_rim: cut.upper,
            lower_rim: cut.lower,
        }
    }
}

/// Puts the landmarks of the inner lips on the rims, and those of the lips' borders on their own
/// side of the seam. A landmark on the wrong lip would drag that lip along. Left and right
/// landmarks mirror each other, with heights measured from the seam, so that the mouth opens alike
/// on both sides.
fn landmarks_on_lips(
    cut: &CutMesh,
    landmarks: &Landmarks,
    frame: &MouthFrame,
    seam: &SeamLine,
) -> Landmarks {
    let mut out = landmarks.clone();
    let local = |v: u32| frame.local_of(cut.positions[v as usize]);
    let place = |n: usize| frame.local_of(landmarks.positions[n]);
    for n in 60..68 {
        let is_upper = lip_of_landmark(n) == Some(Lip::Upper);
        let rim = if is_upper { &cut.upper } else { &cut.lower };
        let target = 0.5 * (place(n).x + 1.0 - place(MIRROR[n]).x);
        let inner = match n {
            60 => 0..1,
            64 => rim.len() - 1..rim.len(),
            _ => 1..rim.len() - 1,
        };
        let away = |&&v: &&u32| (local(v).x - target).abs();
        let nearest = rim[inner].iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let vertex = *nearest.expect("a slit has vertices between its corners");
        out.vertices[n] = vertex;
        out.positions[n] = cut.positions[vertex as usize];
    }
    let fronts = cut.fronts(frame);
    let borders = OUTER_LIPS
        .into_iter()
        .flat_map(|(upper, lower)| [(upper, 1.0), (lower, -1.0)]);
    for (n, side) in borders.chain(CORNERS.map(|n| (n, 1.0))) {
        let (here, mirrored) = (place(n), place(MIRROR[n]));
        let x = 0.5 * (here.x + 1.0 - mirrored.x);
        let lip = |p: DVec3| side * (p.y - seam.height(p.x));
        let mean = 0.5 * (lip(here) + lip(mirrored));
        let height = if CORNERS.contains(&n) {
            mean
        } else {
            mean.max(LEAST_LIP * (4.0 * x * (1.0 - x)).clamp(0.0, 1.0).sqrt())
        };
        let target = DVec2::new(x, seam.height(x) + side * height);
        if let Some((place, vertex)) = fronts.place(target) {
            out.vertices[n] = vertex;
            out.positions[n] = frame.point(place).as_vec3().into();
        }
    }
    out
}
