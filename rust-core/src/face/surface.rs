//! The skin of a face and what everything else follows.

use super::{
    PartList, Skin,
    binding::{Follows, bind},
};
use crate::{
    Result,
    mesh::{Landmarks, Mesh, Similarity, ibug::LANDMARKS},
};

/// A mesh in canonical centimetres, its skin, and what moves each of its vertices.
pub struct FaceSurface {
    /// `[V]`, canonical centimetres.
    pub positions: Vec<[f32; 3]>,
    /// `[68]`, of the neutral face, canonical centimetres.
    pub landmarks: [[f32; 3]; LANDMARKS],
    /// The part on which landmark motion is solved.
    pub skin: Skin,
    /// `[V]`, what each vertex follows.
    pub follows: Vec<Follows>,
}

impl FaceSurface {
    /// `proxy`: the skin is solved on a proxy of at most this many vertices. `None`: on the skin
    /// itself.
    ///
    /// # Errors
    /// `Mesh` if no landmark lies on a usable face.
    pub(super) fn find(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to_canonical: &Similarity,
        parts: &PartList,
        proxy: Option<usize>,
    ) -> Result<FaceSurface> {
        let cm = |p: [f32; 3]| to_canonical.apply(p).map(|x| 100.0 * x);
        let mesh = Mesh {
            positions: mesh.positions.iter().map(|&p| cm(p)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let vertices = landmarks.vertices;
        let landmarks = landmarks.positions.map(cm);
        let skin = Skin::find(&mesh, &landmarks, &vertices, parts, proxy)?;
        let follows = bind(&mesh, parts, &skin.is_skin, &landmarks);
        Ok(FaceSurface {
            positions: mesh.positions,
            landmarks,
            skin,
            follows,
        })
    }

    /// Positions of the skin's rows and of the landmarks in decimetres, the unit of the networks.
    pub fn decimetres(&self) -> (Vec<[f32; 3]>, [[f32; 3]; LANDMARKS]) {
        let positions = self.skin.operators.positions.iter();
        (
            positions.map(|p| (0.1 * p.as_vec3()).into()).collect(),
            self.landmarks.map(|p| p.map(|x| 0.1 * x)),
        )
    }

    /// Rows of the skin that a vertex of the mesh follows, and their shares.
    pub fn rows_followed(&self, vertex: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let corners = match self.follows[vertex] {
            Follows::Skin(corners) => Some(corners),
            _ => None,
        };
        let shares = corners.into_iter().flatten();
        shares
            .filter(|(_, share)| *share != 0.0)
            .flat_map(|(v, share)| {
                let rows = self.skin.spread.row(v);
                rows.map(move |(row, weight)| (row as usize, share * weight))
            })
    }

    /// Vertices of the skin that any vertex of the mesh follows, ascending.
    pub fn followed(&self) -> Vec<u32> {
        let mut used = vec![false; self.positions.len()];
        for follows in &self.follows {
            if let Follows::Skin(corners) = follows {
                let shares = corners.iter().filter(|(_, share)| *share != 0.0);
                shares.for_each(|(v, _)| used[*v as usize] = true);
            }
        }
        (0..used.len() as u32)
            .filter(|&v| used[v as usize])
            .collect()
    }
}
