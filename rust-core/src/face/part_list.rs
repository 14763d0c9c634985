//! The parts of a head and their roles.

use std::cell::OnceCell;

use serde::{Deserialize, Serialize};

use super::{box3::Box3, role_rules::RoleRules};
use crate::{
    Error, Result,
    mesh::{
        Landmarks, Mesh, Part, PartChoices, PartRole, Parts, RoleSource, Similarity, SurfaceTree,
        ibug::LANDMARKS,
        lips::{Lip, lip_of_vertices},
        parts::weld_seams,
    },
};

/// A part with fewer landmarks than this (lashes, a brow) is not skin; its landmarks move to the
/// skin beside it.
const LANDMARKS_OF_SKIN: usize = 7;
/// How far along the surface a lip reaches when the lips are separated, centimetres.
const LIP_CM: f32 = 4.0;

/// The connected parts of a mesh, after its seams are sewn up, with their roles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartList {
    /// In the order of their numbers.
    pub parts: Vec<Part>,
    /// Part of each vertex.
    pub(crate) connected: Parts,
    /// Vertices that must never be sewn up: closed lips that only touch.
    pub(super) keep_apart: Vec<u32>,
}

impl PartList {
    /// Finds the parts of a mesh in its own units.
    ///
    /// # Errors
    /// `Mesh` if no landmark lies on a usable face or the caller's choices leave no skin;
    /// `InvalidInput` for a choice that names no part.
    pub fn find(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to_canonical: &Similarity,
        choices: &PartChoices,
    ) -> Result<PartList> {
        let cm = |p: [f32; 3]| to_canonical.apply(p).map(|x| 100.0 * x);
        let canonical = Mesh {
            positions: mesh.positions.iter().map(|&p| cm(p)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let positions = landmarks.positions.map(cm);
        PartList::of_canonical(&canonical, mesh, &positions, &landmarks.vertices, choices)
    }

    /// [`PartList::find`] for a mesh whose canonical twin (centimetres) is known.
    pub(crate) fn of_canonical(
        canonical: &Mesh,
        mesh: &Mesh,
        landmarks: &[[f32; 3]; LANDMARKS],
        vertices: &[u32; LANDMARKS],
        choices: &PartChoices,
    ) -> Result<PartList> {
        let groups = weld_seams(&canonical.positions, &canonical.triangles, &[]);
        let keep_apart = touching_lips(canonical, &groups, vertices);
        let connected = if keep_apart.is_empty() {
            sewn_parts(canonical, &groups)
        } else {
            let (positions, triangles) = (&canonical.positions, &canonical.triangles);
            sewn_parts(canonical, &weld_seams(positions, triangles, &keep_apart))
        };
        let lists = connected.vertices();
        let chosen = choices.of_parts(&connected)?;
        let carries_landmarks = parts_of_skin(&connected, vertices)?;
        let is_skin: Vec<bool> = (0..lists.len())
            .map(|p| chosen[p].map_or(carries_landmarks[p], |role| role == PartRole::Skin))
            .collect();
        if !is_skin.contains(&true) {
            return Err(Error::Mesh(
                "expected the role skin for a part that carries landmarks, got other roles for all of them"
                    .into(),
            ));
        }
        let names = choices.names.of_parts(&lists);
        let roles = roles(canonical, landmarks, (&lists, &names), &is_skin, &chosen);
        let parts = (0..lists.len()).map(|p| {
            let bounds = Box3::of(lists[p].iter().map(|&v| mesh.positions[v as usize]));
            Part {
                number: p as u32,
                name: names[p].map(str::to_owned),
                role: roles[p],
                source: match chosen[p] {
                    Some(_) => RoleSource::Caller,
                    None => RoleSource::Shape,
                },
                vertices: lists[p].len(),
                low: bounds.low,
                high: bounds.high,
            }
        });
        Ok(PartList {
            parts: parts.collect(),
            connected,
            keep_apart,
        })
    }

    /// `[V]`: the part of each vertex, [`crate::mesh::parts::NO_PART`] for one without a face.
    pub fn of_vertex(&self) -> &[u32] {
        &self.connected.of_vertex
    }

    /// Whether a vertex belongs to a part of this role.
    pub fn is(&self, vertex: usize, role: PartRole) -> bool {
        let part = self.connected.of_vertex[vertex] as usize;
        self.parts.get(part).is_some_and(|part| part.role == role)
    }
}

/// The role of each part.
fn roles(
    canonical: &Mesh,
    landmarks: &[[f32; 3]; LANDMARKS],
    (lists, names): (&[Vec<u32>], &[Option<&str>]),
    is_skin: &[bool],
    chosen: &[Option<PartRole>],
) -> Vec<PartRole> {
    let rules = RoleRules::of(landmarks);
    let known = |p: usize| {
        if is_skin[p] {
            Some(PartRole::Skin)
        } else {
            chosen[p]
        }
    };
    let tree = OnceCell::new();
    let skin =
        || tree.get_or_init(|| skin_tree(canonical, &skin_vertices(lists, is_skin, canonical)));
    let unknown: Vec<usize> = (0..lists.len()).filter(|&p| known(p).is_none()).collect();
    let points = |&p: &usize| -> Vec<[f32; 3]> {
        let list = lists[p].iter();
        list.map(|&v| canonical.positions[v as usize]).collect()
    };
    let points: Vec<Vec<[f32; 3]>> = unknown.iter().map(points).collect();
    let names: Vec<Option<&str>> = unknown.iter().map(|&p| names[p]).collect();
    let mut unknown_roles = rules.roles(&points, &names, skin).into_iter();
    (0..lists.len())
        .map(|p| {
            known(p).unwrap_or_else(|| unknown_roles.next().expect("a role for each unknown part"))
        })
        .collect()
}

/// `[V]`, whether a vertex belongs to a part that is skin.
fn skin_vertices(lists: &[Vec<u32>], is_skin: &[bool], mesh: &Mesh) -> Vec<bool> {
    let mut vertices = vec![false; mesh.positions.len()];
    for (list, _) in lists.iter().zip(is_skin).filter(|(_, skin)| **skin) {
        list.iter().for_each(|&v| vertices[v as usize] = true);
    }
    vertices
}

/// The surface of the triangles whose corners are all skin.
pub(super) fn skin_tree(mesh: &Mesh, is_skin: &[bool]) -> SurfaceTree {
    let of_skin = |t: &[u32; 3]| t.iter().all(|&v| is_skin[v as usize]);
    let numbered = mesh.triangles.iter().enumerate();
    let faces: Vec<u32> = numbered
        .filter(|(_, t)| of_skin(t))
        .map(|(f, _)| f as u32)
        .collect();
    SurfaceTree::of_faces(mesh, &faces)
}

/// Vertices of closed lips that only coincide. Sewing them up would glue the mouth shut.
/// `groups`: for each vertex the one that stands for it when all seams are sewn up.
pub(super) fn touching_lips(mesh: &Mesh, groups: &[u32], vertices: &[u32; LANDMARKS]) -> Vec<u32> {
    let sewn: Vec<u32> = (0..groups.len() as u32)
        .filter(|&v| groups[v as usize] != v)
        .collect();
    if sewn.is_empty() {
        return Vec::new();
    }
    let lips = lip_of_vertices(mesh, &vertices[49..54], &vertices[55..60], LIP_CM);
    let differ = |v: u32| {
        let pair = (lips[v as usize], lips[groups[v as usize] as usize]);
        matches!(
            pair,
            (Some(Lip::Upper), Some(Lip::Lower)) | (Some(Lip::Lower), Some(Lip::Upper))
        )
    };
    let apart = sewn.into_iter().filter(|&v| differ(v));
    apart.flat_map(|v| [v, groups[v as usize]]).collect()
}

/// Connected parts of a mesh whose seams are sewn up.
pub(super) fn sewn_parts(mesh: &Mesh, groups: &[u32]) -> Parts {
    let sewn = mesh.triangles.iter().map(|t| t.map(|v| groups[v as usize]));
    let mut parts = Parts::of(mesh.positions.len(), &sewn.collect::<Vec<_>>());
    for v in 0..groups.len() {
        parts.of_vertex[v] = parts.of_vertex[groups[v] as usize];
    }
    parts
}

/// `[parts]`, whether a part is skin.
pub(super) fn parts_of_skin(parts: &Parts, vertices: &[u32; LANDMARKS]) -> Result<Vec<bool>> {
    let mut count = vec![0; parts.count];
    for &v in vertices {
        if let Some(count) = count.get_mut(parts.of_vertex[v as usize] as usize) {
            *count += 1;
        }
    }
    let most = count.iter().copied().max().unwrap_or(0);
    if most == 0 {
        return Err(Error::Mesh(
            "expected landmarks on faces, got all 68 on vertices without a face".into(),
        ));
    }
    let needed = LANDMARKS_OF_SKIN.min(most);
    Ok(count.iter().map(|&c| c >= needed).collect())
}
