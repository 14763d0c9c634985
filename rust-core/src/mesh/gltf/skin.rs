//! Skins: how joints place the vertices of a mesh while they stand at rest.

use glam::{DMat4, DVec4};

use super::{
    accessor::Data,
    document::{Document, missing, refusal},
    matrix::{IDENTITY, Matrix, matrix},
};
use crate::Result;

/// A joint's matrix this near to the identity in every number counts as the identity. Writers
/// round inverse bind matrices to 32 bits, and a mesh at rest should keep its positions to the bit.
const NEAR: f64 = 1e-5;

/// What places the vertices of a primitive in the scene.
pub(super) enum Blend {
    /// One transform for all.
    Whole(Matrix),
    /// `[V]`, a transform for each vertex.
    Vertices(Vec<Matrix>),
}

/// Where all nodes stand.
pub(super) struct Skins {
    /// Transforms of nodes into the scene.
    worlds: Vec<DMat4>,
}

impl Skins {
    pub(super) fn new(document: &Document) -> Skins {
        let used = !document.skins.is_empty();
        let worlds = if used { worlds(document) } else { Vec::new() };
        Skins { worlds }
    }

    /// The transforms of a skinned primitive's `count` vertices: the mean of its joints' matrices,
    /// each the joint's transform times its inverse bind matrix. `attribute`: reads an attribute of
    /// the primitive, if it has it.
    pub(super) fn blend(
        &self,
        data: &Data<'_>,
        (skin, count): (usize, usize),
        attribute: impl Fn(&str) -> Result<Option<Vec<[f32; 4]>>>,
    ) -> Result<Blend> {
        let joints = self.joints(data, skin)?;
        let Some(first) = joints.first() else {
            return Err(refusal(format!("expected joints in skin {skin}, got none")));
        };
        if joints.iter().all(|joint| joint == first) {
            return Ok(Blend::Whole(rounded(*first)));
        }
        let mut blends = vec![(DMat4::ZERO, 0.0); count];
        for set in 0.. {
            let (numbers, weights) = (
                attribute(&format!("JOINTS_{set}"))?,
                attribute(&format!("WEIGHTS_{set}"))?,
            );
            let (Some(numbers), Some(weights)) = (numbers, weights) else {
                break;
            };
            if (numbers.len(), weights.len()) != (count, count) {
                return Err(refusal(format!(
                    "expected joints and weights of {count} vertices, got {} and {}",
                    numbers.len(),
                    weights.len()
                )));
            }
            for (blend, (numbers, weights)) in blends.iter_mut().zip(numbers.iter().zip(weights)) {
                add(blend, &joints, (*numbers, weights))?;
            }
        }
        // A vertex that no joint holds follows the first one, as viewers show it.
        let whole = |(sum, weight): (DMat4, f64)| if weight > 0.0 { sum / weight } else { *first };
        let blends = blends.into_iter().map(|blend| rounded(whole(blend)));
        Ok(Blend::Vertices(blends.collect()))
    }

    /// The matrices of a skin's joints.
    fn joints(&self, data: &Data<'_>, number: usize) -> Result<Vec<DMat4>> {
        let skins = &data.document.skins;
        let skin = skins.get(number);
        let skin = skin.ok_or_else(|| missing("skin", number, skins.len()))?;
        let binds = match skin.inverse_bind_matrices {
            Some(binds) => data.matrices(binds)?,
            None => vec![IDENTITY; skin.joints.len()],
        };
        if binds.len() < skin.joints.len() {
            return Err(refusal(format!(
                "expected {} inverse bind matrices in skin {number}, got {}",
                skin.joints.len(),
                binds.len()
            )));
        }
        let joint = |(joint, bind): (&usize, &Matrix)| {
            let world = self.worlds.get(*joint);
            let world = world.ok_or_else(|| missing("node", *joint, self.worlds.len()))?;
            let placed = *world * DMat4::from_cols_array_2d(&bind.map(|c| c.map(f64::from)));
            Ok(if placed.abs_diff_eq(DMat4::IDENTITY, NEAR) {
                DMat4::IDENTITY
            } else {
                placed
            })
        };
        skin.joints.iter().zip(&binds).map(joint).collect()
    }
}

/// Adds four joints to the weighted sum of a vertex and to the sum of its weights.
fn add(
    (sum, total): &mut (DMat4, f64),
    joints: &[DMat4],
    (numbers, weights): ([f32; 4], [f32; 4]),
) -> Result<()> {
    for (number, weight) in numbers.into_iter().zip(weights.map(f64::from)) {
        if weight > 0.0 {
            let joint = joints.get(number as usize);
            let joint = joint.ok_or_else(|| missing("joint", number as usize, joints.len()))?;
            *sum += *joint * weight;
            *total += weight;
        }
    }
    Ok(())
}

/// The transforms of all nodes into the scene. Nodes that are below each other in a circle get the
/// identity.
fn worlds(document: &Document) -> Vec<DMat4> {
    let mut worlds = vec![DMat4::IDENTITY; document.nodes.len()];
    let mut is_root = vec![true; document.nodes.len()];
    for child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_root) = is_root.get_mut(*child) {
            *is_root = false;
        }
    }
    let mut visited = vec![false; document.nodes.len()];
    let roots = is_root.iter().enumerate().filter(|(_, is_root)| **is_root);
    let mut left: Vec<(usize, DMat4)> = roots.map(|(node, _)| (node, DMat4::IDENTITY)).collect();
    while let Some((number, above)) = left.pop() {
        let Some(node) = document.nodes.get(number) else {
            continue;
        };
        if std::mem::replace(&mut visited[number], true) {
            continue;
        }
        let own = matrix(node).map(|column| column.map(f64::from));
        worlds[number] = above * DMat4::from_cols_array_2d(&own);
        left.extend(node.children.iter().map(|child| (*child, worlds[number])));
    }
    worlds
}

fn rounded(m: DMat4) -> Matrix {
    let column = |c: DVec4| c.as_vec4().to_array();
    [m.x_axis, m.y_axis, m.z_axis, m.w_axis].map(column)
}
