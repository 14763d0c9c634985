//! What the parts that are not skin do: teeth, tongue, eyeballs, lashes, hair, clothes.
//!
//! A head often has dozens of parts (ICT's has 56), of which one or two are skin. Each other part
//! is told by its shape and its place beside the landmarks, a simple rule of thumb:
//!
//! - roundish or small in an eye: rests with the skull;
//! - behind the lips: below the line between the lips it follows the jaw, above it rests; a part
//!   taller than [`TALL_CM`], such as gums with a tongue, passes from one to the other;
//! - anything else follows the skin nearest to where it is rooted, fading with its distance.
//!
//! Lengths are canonical centimetres.

use super::nearest::{PointGrid, distance};
use crate::{mesh::Parts, motion::LANDMARKS};

/// Height of a mouth part beyond which it is taken to hold upper and lower jaw at once.
const TALL_CM: f32 = 3.2;
/// Over this height such a part passes from the jaw to the skull, above the lips' line.
const PASSAGE_CM: f32 = 0.4;
/// Distance from the skin within which a part follows fully, and from which on it rests.
const FOLLOW_CM: (f32, f32) = (1.0, 4.0);
/// Vertices of a part so much further from the skin than its nearest count as its roots.
const ROOT_CM: f32 = 0.15;
/// A part larger than this (hair, clothes) follows the skin vertex by vertex.
const SMALL_CM: f32 = 6.0;

/// What moves a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Follows {
    /// It is vertex `0` of the skin, and moves by a share `1` of it.
    Skin(u32, f32),
    /// The lower jaw, by a share.
    Jaw(f32),
    /// Nothing: it rests with the skull.
    Skull,
}

/// Decides for every vertex what it follows.
///
/// `positions`: `[V]`. `parts`: of all vertices. `skin`: `[V]`, whether a vertex is skin; skin
/// follows itself. `landmarks`: of the neutral face.
pub fn bind(
    positions: &[[f32; 3]],
    parts: &Parts,
    skin: &[bool],
    landmarks: &[[f32; 3]; LANDMARKS],
) -> Vec<Follows> {
    let mut follows: Vec<Follows> = (0..positions.len() as u32)
        .map(|v| match skin[v as usize] {
            true => Follows::Skin(v, 1.0),
            false => Follows::Skull,
        })
        .collect();
    let skin_vertices: Vec<u32> = (0..positions.len() as u32)
        .filter(|&v| skin[v as usize])
        .collect();
    let skin_points: Vec<_> = skin_vertices
        .iter()
        .map(|&v| positions[v as usize])
        .collect();
    let place = Place::of(landmarks);
    let grid = PointGrid::new(&skin_points, 0.5);
    for part in parts.vertices() {
        let others: Vec<u32> = part.into_iter().filter(|&v| !skin[v as usize]).collect();
        if others.is_empty() {
            continue;
        }
        let bounds = Box3::of(others.iter().map(|&v| positions[v as usize]));
        if place.is_eye(&bounds) {
            continue;
        }
        if place.is_in_mouth(&bounds) {
            for &v in &others {
                follows[v as usize] = place.jaw_share(&bounds, positions[v as usize]);
            }
            continue;
        }
        let moved_by = follow_skin(positions, &others, &bounds, &grid);
        for (&v, (skin, share)) in others.iter().zip(moved_by) {
            follows[v as usize] = match share > 0.0 {
                true => Follows::Skin(skin_vertices[skin as usize], share),
                false => Follows::Skull,
            };
        }
    }
    follows
}

/// Skin point and share for each vertex of a part; share 0 beyond reach.
fn follow_skin(
    positions: &[[f32; 3]],
    part: &[u32],
    bounds: &Box3,
    grid: &PointGrid<'_>,
) -> Vec<(u32, f32)> {
    let nearest: Vec<Option<(u32, f32)>> = part
        .iter()
        .map(|&v| grid.nearest(positions[v as usize], FOLLOW_CM.1))
        .collect();
    let fade = |d: f32| ((FOLLOW_CM.1 - d) / (FOLLOW_CM.1 - FOLLOW_CM.0)).clamp(0.0, 1.0);
    if bounds.largest() > SMALL_CM {
        let share = |hit: &Option<(u32, f32)>| hit.map_or((0, 0.0), |(i, d)| (i, fade(d)));
        return nearest.iter().map(share).collect();
    }
    let hits = nearest.iter().flatten();
    let least = hits.map(|&(_, d)| d).fold(f32::INFINITY, f32::min);
    if least == f32::INFINITY {
        return vec![(0, 0.0); part.len()];
    }
    let (roots, skin_of_root): (Vec<_>, Vec<_>) = part
        .iter()
        .zip(&nearest)
        .filter_map(|(&v, hit)| hit.map(|hit| (v, hit)))
        .filter(|(_, (_, d))| *d <= least + ROOT_CM)
        .map(|(v, (skin, _))| (positions[v as usize], skin))
        .unzip();
    let root_grid = PointGrid::new(&roots, 0.5);
    part.iter()
        .map(|&v| {
            let root = root_grid.nearest(positions[v as usize], 2.0 * SMALL_CM);
            (
                skin_of_root[root.map_or(0, |(r, _)| r as usize)],
                fade(least),
            )
        })
        .collect()
}

/// Where eyes and mouth are.
struct Place {
    eyes: [([f32; 3], f32); 2],
    mouth: [f32; 3],
    mouth_width: f32,
}

impl Place {
    fn of(landmarks: &[[f32; 3]; LANDMARKS]) -> Place {
        let eye = |first: usize| {
            let width = distance(landmarks[first], landmarks[first + 3]);
            (mean(&landmarks[first..first + 6]), width)
        };
        Place {
            eyes: [eye(36), eye(42)],
            mouth: mean(&landmarks[60..68]),
            mouth_width: distance(landmarks[48], landmarks[54]),
        }
    }

    /// Roundish, or smaller than the opening, and within reach of an eyeball's place.
    fn is_eye(&self, bounds: &Box3) -> bool {
        self.eyes.iter().any(|&(centre, width)| {
            let middle = bounds.middle();
            let beside = (0..2).all(|i| (middle[i] - centre[i]).abs() < 0.6 * width);
            let depth = middle[2] - centre[2];
            let near = beside && depth > -1.2 * width && depth < 0.3 * width;
            let round = bounds.smallest() > 0.55 * width;
            near && bounds.largest() < 2.0 * width && (round || bounds.largest() < 0.6 * width)
        })
    }

    /// Within the mouth's width, behind the lips.
    fn is_in_mouth(&self, bounds: &Box3) -> bool {
        let unit = self.mouth_width / 5.0;
        let offset = |p: [f32; 3], i: usize| (p[i] - self.mouth[i]) / unit;
        let (low, high) = (bounds.low, bounds.high);
        let across = offset(low, 0) > -4.5 && offset(high, 0) < 4.5;
        let height = offset(low, 1) > -4.5 && offset(high, 1) < 4.0;
        let depth = offset(high, 2) < 0.3 && offset(low, 2) > -12.0;
        across && height && depth
    }

    fn jaw_share(&self, bounds: &Box3, position: [f32; 3]) -> Follows {
        let height = |y: f32| y - self.mouth[1];
        let share = if bounds.high[1] - bounds.low[1] > TALL_CM * self.mouth_width / 5.0 {
            1.0 - ((height(position[1]) - 0.1) / PASSAGE_CM).clamp(0.0, 1.0)
        } else {
            f32::from(height(bounds.middle()[1]) < 0.0)
        };
        match share > 0.0 {
            true => Follows::Jaw(share),
            false => Follows::Skull,
        }
    }
}

fn mean(points: &[[f32; 3]]) -> [f32; 3] {
    let count = points.len() as f32;
    std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f32>() / count)
}

/// An axis-aligned box.
struct Box3 {
    low: [f32; 3],
    high: [f32; 3],
}

impl Box3 {
    fn of(points: impl Iterator<Item = [f32; 3]>) -> Box3 {
        let empty = Box3 {
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
        };
        points.fold(empty, |b, p| Box3 {
            low: std::array::from_fn(|i| b.low[i].min(p[i])),
            high: std::array::from_fn(|i| b.high[i].max(p[i])),
        })
    }

    fn middle(&self) -> [f32; 3] {
        std::array::from_fn(|i| 0.5 * (self.low[i] + self.high[i]))
    }

    fn extents(&self) -> [f32; 3] {
        std::array::from_fn(|i| self.high[i] - self.low[i])
    }

    fn largest(&self) -> f32 {
        self.extents().into_iter().fold(0.0, f32::max)
    }

    fn smallest(&self) -> f32 {
        self.extents().into_iter().fold(f32::INFINITY, f32::min)
    }
}
