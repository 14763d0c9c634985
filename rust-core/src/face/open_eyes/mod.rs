//! Cuts free the eyes that are one surface with their lids, and adds a lining behind the lids and a
//! ball behind the eye.
//!
//! The cut follows the crease between lids and eye (`rim`). Large triangles beside it are divided
//! first. Then the skin is cut along a level set (`split`), so that the mesh needs no edges along
//! the crease. The piece inside becomes the front of an eyeball and keeps its texture and
//! everything carved into it. The lids get a lining (`sew`). No old vertex moves, so the surface at
//! rest stays the same.

mod rim;
mod sew;
mod space;
mod split;
mod trial;

use glam::Vec3;

use super::{
    Face,
    eyes::{Lids, Opening},
    opened::{FineMesh, OpenedFace},
};
use crate::{
    Error, Result,
    mesh::{Landmarks, Mesh, PartRole, ibug::EYES},
};
use rim::{Rim, skin_view};
use sew::{Behind, Socket};
use space::EyeSpace;
use split::{RimPlace, sheet, split};
pub use trial::EyeTrial;

/// Cuts free every eye of a face that is one surface with its lids.
///
/// # Errors
/// `InvalidInput` where no eye is one surface with its lids; `Mesh` where no single line on the
/// skin leads around such an eye.
pub fn open_eyes(face: &Face) -> Result<OpenedFace> {
    let joined: Vec<usize> = (0..2)
        .filter(|&eye| face.lids()[eye] == Lids::Joined)
        .collect();
    if joined.is_empty() {
        let [right, left] = face.lids().map(name);
        return Err(Error::InvalidInput(format!(
            "open eyes: expected an eye that is one surface with its lids, got a right eye {right} and a left eye {left}"
        )));
    }
    let mut fine = FineMesh::unchanged(&face.mesh);
    let mut sockets = Vec::new();
    for &eye in &joined {
        let opening = face
            .openings()
            .of_eye(eye)
            .expect("joined lids have an opening");
        let space = EyeSpace {
            frame: opening.frame,
            to_canonical: face.to_canonical,
        };
        let skin = view(face, opening, &space);
        let rim = Rim::of(opening, &skin);
        let width = opening.width;
        let place = |p| {
            let local = space.local_of(p);
            let away = rim.distance(local.truncate().as_vec2()).abs();
            (local / f64::from(width), f64::from(away / width))
        };
        let near = sheet(&fine, &space, &rim, width);
        fine = fine.refined(&near, place);
        let near = sheet(&fine, &space, &rim, width);
        let line = split(&mut fine, &near, &space, &rim)?;
        sockets.push((eye, opening, space, skin, line));
    }
    let first_inside_vertex = fine.mesh.positions.len();
    let mut behind = Behind::default();
    let mut landmarks = face.landmarks.clone();
    for (eye, opening, space, skin, line) in &sockets {
        let socket = Socket {
            space,
            radius: opening.ball.radius,
            width: opening.width,
            skin,
            line,
        };
        let sewn = socket.sew(&mut fine);
        behind.triangles.extend(sewn.triangles);
        behind.sources.extend(sewn.sources);
        put_on_rim(&mut landmarks, *eye, &fine.mesh, space, line);
    }
    Ok(assembled(fine, behind, first_inside_vertex, landmarks))
}

fn name(lids: Lids) -> &'static str {
    match lids {
        Lids::Close => "whose lids close",
        Lids::Shut => "that is sculpted shut",
        Lids::Joined => "that is one with its lids",
    }
}

/// Draws the skin around an eye in the eye's frame.
fn view(face: &Face, opening: &Opening, space: &EyeSpace) -> crate::mesh::FrontView {
    let mesh = &face.mesh;
    let skin = mesh.triangles.iter();
    let skin = skin.filter(|t| face.parts.is(t[0] as usize, PartRole::Skin));
    let corners = skin.map(|t| t.map(|v| space.local(mesh.positions[v as usize])));
    let reach = 2.0 * opening.width;
    let near = corners.filter(|t: &[Vec3; 3]| t.iter().all(|p| p.length() < reach));
    skin_view(near, opening.width)
}

/// Moves the landmarks of an eye to the nearest vertices on the rim of its lids.
fn put_on_rim(
    landmarks: &mut Landmarks,
    eye: usize,
    mesh: &Mesh,
    space: &EyeSpace,
    line: &[RimPlace],
) {
    let at = |v: u32| space.local(mesh.positions[v as usize]).truncate();
    for n in EYES[eye].lids.clone() {
        let mark = space.local(landmarks.positions[n]).truncate();
        let away = |place: &&RimPlace| at(place.lid).distance(mark);
        let nearest = line.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let vertex = nearest.expect("a rim has places").lid;
        landmarks.vertices[n] = vertex;
        landmarks.positions[n] = mesh.positions[vertex as usize];
    }
}

fn assembled(
    fine: FineMesh,
    behind: Behind,
    first_inside_vertex: usize,
    landmarks: Landmarks,
) -> OpenedFace {
    let mut mesh = fine.mesh;
    let first_lining_triangle = mesh.triangles.len();
    mesh.triangles.extend(behind.triangles);
    let mut triangle_sources = fine.triangle_sources;
    triangle_sources.extend(behind.sources);
    OpenedFace {
        first_inside_triangle: mesh.triangles.len(),
        mesh,
        landmarks,
        vertex_sources: fine.vertex_sources,
        triangle_sources,
        first_inside_vertex,
        first_lining_triangle,
        upper_rim: Vec::new(),
        lower_rim: Vec::new(),
    }
}
