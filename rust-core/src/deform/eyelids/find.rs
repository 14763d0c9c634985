//! Finds which vertices the lids of an eye carry along, and by which share. This runs once, in the
//! neutral face.
//!
//! 1. The eye's opening gives the edges of both lids, at [`SAMPLES`] places each. For each place,
//!    the skin vertex of that lid nearest to it becomes a rim vertex, if it lies within
//!    [`RIM_OF_WIDTH`] widths of the eye. A place on the edge moves as the two rim vertices beside
//!    it do, so no vertex has to lie on the edge itself.
//! 2. A vertex may be carried along if it follows skin and lies within three widths of the eye's
//!    centre, or of its front where the eye is shallow. Its root is its own position if it is skin, and otherwise the position of the skin
//!    that it follows.
//! 3. A root between both edges belongs to the eye itself. Any other root belongs to the lid on its
//!    side of the line midway between the edges.
//! 4. The share falls with the distance from the edge. It falls more slowly behind the edge,
//!    because the lining of the lid must come along ([`follow_share`]). Distances are relative to
//!    the size of the eye.
//! 5. A part counts as lashes if at least [`LASH_SHARE`] of its vertices have their root within
//!    [`LASH_CM`] of the edge of one lid. All its vertices then follow that lid fully, wherever
//!    they lie.
//! 6. Flat triangles cut into a ball, so the lids are lifted off it. The lift is the sagitta of the
//!    widest step between two neighbouring rim vertices, less the clearance that the lids already
//!    have.
//!
//! The cost is a few passes over `V`, plus a few times [`SAMPLES`] distances for each vertex near
//! the eye.
//!
//! What can go wrong: on a very coarse mesh, or where the landmarks lie off the eye, a lid may have
//! fewer than two rim vertices. Such an eye gets no lids. A few outliers in the rim do not change
//! the lift, because it depends on the lower quartile of the clearances and is at most the second
//! value of [`CLEAR_CM`].
//!
//! Lengths are canonical centimetres.

use glam::Vec3;

use super::{
    BETWEEN_LIDS, Between, Eyelids, Rim, RimVertex, Stem, Touched, between_samples, elevation,
};
use crate::{
    face::{
        Face, FaceSurface,
        binding::Follows,
        eyes::{EyeFrame, LidDrive, Lids, Opening, SAMPLES},
        lids::follow_share,
        nearest::nearest_between,
    },
    mesh::{Parts, Similarity, canonical_landmarks, ibug::EYES},
};

/// Least clearance of the lids from the ball, and the most by which they are lifted.
const CLEAR_CM: (f32, f32) = (0.01, 0.04);
/// On an eye of canonical size, a part counts as lashes if most of its roots lie within this
/// distance of the edge of one lid.
const LASH_CM: f32 = 0.35;
const LASH_SHARE: f32 = 0.6;
/// A rim vertex lies within this distance of its place on the edge, in widths of the eye.
const RIM_OF_WIDTH: f32 = 0.2;

/// Finds the lids of a face. An eye with too few rim vertices has none.
pub(in crate::deform) fn eyelids(face: &Face, surface: &FaceSurface) -> Vec<Eyelids> {
    let drives = face.openings().drives();
    let lids = drives.iter().filter_map(|drive| {
        let neutral = Neutral {
            surface,
            parts: &face.parts.connected,
            opening: drive.opening,
        };
        neutral.eyelids(drive, &face.to_canonical)
    });
    lids.collect()
}

/// One eye of a neutral head.
struct Neutral<'a> {
    surface: &'a FaceSurface,
    parts: &'a Parts,
    opening: &'a Opening,
}

impl Neutral<'_> {
    fn eyelids(&self, drive: &LidDrive<'_>, to_canonical: &Similarity) -> Option<Eyelids> {
        let EyeFrame { axes, .. } = self.opening.frame;
        let back = to_canonical.inverse();
        let rims = [self.rim(0)?, self.rim(1)?];
        let touched = self.touched();
        Some(Eyelids {
            eyes: (drive.eyes.iter())
                .map(|&(eye, openings)| (EYES[eye].pairs, openings))
                .collect(),
            larger: drive.larger,
            silent: drive.silent.clone(),
            alone: drive.is_alone,
            at_rest: self.opening.lids != Lids::Close,
            axes: axes.map(|axis| back.rotate(axis)),
            up: back.rotate([0.0, 1.0, 0.0]),
            to_cm: 100.0 * to_canonical.scale as f32,
            ball: self.opening.ball,
            lift: self.lift(&rims),
            rims,
            touched,
        })
    }

    /// The rim of a lid: the vertices nearest to its edge, and how the edge follows them.
    fn rim(&self, lid: usize) -> Option<Rim> {
        let edge = &self.opening.edges[lid];
        let mut vertices = self.nearest_to(edge, lid as u8);
        vertices.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
        vertices.dedup_by_key(|v| v.vertex);
        if vertices.len() < 2 {
            return None;
        }
        let samples = edge.iter().map(|p| between(&vertices, p[0]));
        Some(Rim {
            samples: samples.collect(),
            edge: edge.to_vec(),
            rest: edge.iter().map(|p| elevation(*p)).collect(),
            vertices,
        })
    }

    /// For each sample of a lid's edge, the nearest vertex of that lid's skin, if one is near.
    fn nearest_to(&self, edge: &[[f32; 3]; SAMPLES], lid: u8) -> Vec<RimVertex> {
        let mut nearest = [(f32::INFINITY, 0u32, [0.0f32; 3]); SAMPLES];
        for (v, &p) in self.surface.positions.iter().enumerate() {
            let p = self.opening.frame.local(p);
            let far = Vec3::from(p).length_squared() > self.reach(2.0).powi(2);
            if far || !self.surface.skin.is_skin[v] || self.lid_of(p) != lid {
                continue;
            }
            for (best, at) in nearest.iter_mut().zip(edge) {
                let away = Vec3::from(p).distance((*at).into());
                if away < best.0 {
                    *best = (away, v as u32, p);
                }
            }
        }
        let reach = RIM_OF_WIDTH * self.opening.width;
        let near = nearest.iter().filter(|(away, ..)| *away < reach);
        near.map(|&(_, vertex, place)| RimVertex { vertex, place })
            .collect()
    }

    /// The distance from the ball's centre of a point that lies so many widths of the eye away. The
    /// centre of a shallow eye lies deep in the head.
    fn reach(&self, widths: f32) -> f32 {
        let width = self.opening.width;
        widths * width + (self.opening.ball.radius - width).max(0.0)
    }

    /// The lid on which a point lies: 0 for the upper one, 1 for the lower one.
    fn lid_of(&self, p: [f32; 3]) -> u8 {
        let k = self.opening.sample_at(p[0]).round() as usize;
        let edges = &self.opening.edges;
        let middle = 0.5 * (elevation(edges[0][k]) + elevation(edges[1][k]));
        u8::from(elevation(p) < middle)
    }

    /// Everything that the lids carry along.
    fn touched(&self) -> Vec<Touched> {
        let lashes = self.lashes();
        let mut touched = Vec::new();
        for v in 0..self.surface.follows.len() {
            let Some((place, whole)) = self.root(v) else {
                continue;
            };
            let p = self.opening.frame.local(self.surface.positions[v]);
            let part = self.parts.of_vertex[v] as usize;
            let lash = if self.surface.skin.is_skin[v] {
                None
            } else {
                lashes.get(part).copied().flatten()
            };
            let (lid, place, share) = match lash {
                Some(lid) => (lid, self.on_edge(lid, p[0]), 1.0),
                None => {
                    let lid = if self.opening.is_between(place) {
                        BETWEEN_LIDS
                    } else {
                        self.lid_of(place)
                    };
                    (lid, place, whole.min(1.0) * self.share(lid, place))
                }
            };
            let stem = (!self.surface.skin.is_skin[v]).then(|| Stem {
                offset: std::array::from_fn(|i| p[i] - place[i]),
                is_lash: lash.is_some(),
            });
            if share > 0.0 {
                touched.push(Touched {
                    vertex: v as u32,
                    lid,
                    at: self.opening.sample_at(place[0]),
                    share,
                    place,
                    stem,
                });
            }
        }
        touched
    }

    /// The position of the skin that moves a vertex near the eye, in the eye's frame, and the share
    /// by which the vertex follows it.
    fn root(&self, v: usize) -> Option<([f32; 3], f32)> {
        let local = |v: usize| self.opening.frame.local(self.surface.positions[v]);
        let Follows::Skin(corners) = self.surface.follows[v] else {
            return None;
        };
        let p = local(v);
        let whole: f32 = corners.iter().map(|(_, share)| share).sum();
        if whole <= 0.0 || Vec3::from(p).length_squared() > self.reach(3.0).powi(2) {
            return None;
        }
        if self.surface.skin.is_skin[v] {
            return Some((p, whole));
        }
        let along = |i: usize| {
            corners
                .iter()
                .map(move |&(v, share)| share * local(v as usize)[i])
        };
        let place = std::array::from_fn(|i| along(i).sum::<f32>() / whole);
        Some((place, whole))
    }

    /// For each part, the lid whose lashes it is, if any.
    fn lashes(&self) -> Vec<Option<u8>> {
        let mut counts = vec![[0usize; 3]; self.parts.count];
        for v in 0..self.surface.follows.len() {
            let part = self.parts.of_vertex[v] as usize;
            let Some(counts) = counts
                .get_mut(part)
                .filter(|_| !self.surface.skin.is_skin[v])
            else {
                continue;
            };
            counts[2] += 1;
            if let Some((place, _)) = self.root(v) {
                let away = [0, 1].map(|lid| self.off_edge(lid, place).0);
                let lid = usize::from(away[1] < away[0]);
                counts[lid] += usize::from(away[lid] < LASH_CM * self.size());
            }
        }
        let lid = |[upper, lower, all]: [usize; 3]| {
            let enough = (LASH_SHARE * all as f32).max(1.0);
            let most = [upper, lower]
                .into_iter()
                .position(|count| count as f32 >= enough)?;
            Some(most as u8)
        };
        counts.into_iter().map(lid).collect()
    }

    /// The point on a lid's edge at the coordinate `across`.
    fn on_edge(&self, lid: u8, across: f32) -> [f32; 3] {
        between_samples(
            &self.opening.edges[usize::from(lid)],
            self.opening.sample_at(across),
        )
    }

    /// Distance of a position from a lid's edge, and how far it lies behind the edge.
    fn off_edge(&self, lid: u8, place: [f32; 3]) -> (f32, f32) {
        let edge = &self.opening.edges[usize::from(lid)];
        let pieces = edge.windows(2).map(|ends| {
            let nearest = nearest_between(place.into(), ends[0].into(), ends[1].into());
            (nearest.distance(place.into()), nearest)
        });
        let nearest = pieces.min_by(|a, b| a.0.total_cmp(&b.0));
        let (distance, nearest) = nearest.expect("an edge has more than one sample");
        (distance, nearest[2] - place[2])
    }

    /// Width of this eye relative to that of the canonical face.
    fn size(&self) -> f32 {
        let marks = canonical_landmarks();
        self.opening.width / (100.0 * Vec3::from(marks[45]).distance(marks[42].into()))
    }

    /// The share by which a position follows its lid.
    fn share(&self, lid: u8, place: [f32; 3]) -> f32 {
        if lid == BETWEEN_LIDS {
            return 1.0;
        }
        let (distance, behind) = self.off_edge(lid, place);
        let size = self.size();
        follow_share(f64::from(distance / size), f64::from(behind / size)) as f32
    }

    /// How far the lids must be lifted so that their edges clear the ball as they slide over it.
    /// Flat triangles between rim vertices cut into the ball by the square of their size.
    fn lift(&self, rims: &[Rim; 2]) -> f32 {
        let heights = rims.iter().flat_map(|rim| &rim.vertices).map(|v| {
            let length = Vec3::from(v.place).length();
            length - self.opening.ball.radius_below(v.place, length)
        });
        let mut heights: Vec<f32> = heights.collect();
        heights.sort_by(f32::total_cmp);
        let low = heights[heights.len() / 4];
        let steps = rims.iter().flat_map(|rim| rim.vertices.windows(2));
        let steps = steps.map(|ends| ends[1].place[0] - ends[0].place[0]);
        let widest = steps.fold(0.0, f32::max).min(0.5 * self.opening.width);
        let sagitta = widest * widest / (8.0 * self.opening.ball.radius);
        (CLEAR_CM.0 + sagitta - low).clamp(0.0, CLEAR_CM.1)
    }
}

/// The two rim vertices on either side of `across`, with their shares.
fn between(vertices: &[RimVertex], across: f32) -> Between {
    let after = vertices.partition_point(|v| v.place[0] < across);
    let after = after.clamp(1, vertices.len() - 1);
    let (a, b) = (vertices[after - 1].place[0], vertices[after].place[0]);
    let along = ((across - a) / (b - a).max(1e-6)).clamp(0.0, 1.0);
    [(after as u32 - 1, 1.0 - along), (after as u32, along)]
}
