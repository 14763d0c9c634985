//! The mesh in its stated frame, and one look at it through a window.

use std::{
    borrow::Cow,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use glam::DVec3;

use super::{
    depth_view::{self, DepthBuffer, Window},
    network::{LandmarkNetwork, Sight},
};
use crate::{
    Error, Result,
    mesh::{Axis, Mesh, Similarity, canonical_landmarks, ibug::LANDMARKS},
};

/// Larger meshes are thinned to at most this many triangles. That is enough for pictures of 256²
/// pixels, and the found landmarks are put on the whole mesh.
const MAX_TRIANGLES: usize = 800_000;

/// The most pixels that all pictures of a search together test. Heads take 5 to 18 million. A cat,
/// on which the longest search finds no face, takes 34 million.
pub(super) const MAX_PLACES: u64 = 1 << 28;

/// A mesh turned so that it faces +z with +y up, if the caller stated its axes correctly. Its
/// bounding box is centred, and the box's longest side is one.
pub(super) struct Frame<'a> {
    pub points: Vec<[f32; 3]>,
    pub triangles: Cow<'a, [[u32; 3]]>,
    pub from_mesh: Similarity,
    /// Deviation of the Gaussian that softens its pictures, pixels of the depth buffer; 0 for none.
    pub softness: f32,
    /// Number of pixels that all its pictures have tested; see [`DepthBuffer::places`].
    pub places: Arc<AtomicU64>,
}

/// Landmarks in one view.
pub(super) struct Look {
    /// `[68]`, view x and y.
    pub points: [[f32; 2]; LANDMARKS],
    pub sight: Sight,
    pub buffer: DepthBuffer,
}

impl Frame<'_> {
    /// The same mesh with softened pictures.
    pub fn soft(&self, softness: f32) -> Self {
        Frame {
            points: self.points.clone(),
            triangles: self.triangles.clone(),
            from_mesh: self.from_mesh,
            softness,
            places: Arc::clone(&self.places),
        }
    }

    /// Draws the mesh with its points turned. `points`: `[V]`.
    pub fn draw(&self, points: &[[f32; 3]], window: Window) -> DepthBuffer {
        let sharp = DepthBuffer::draw(points, &self.triangles, window);
        // A picture that was cut short uses up the whole budget, so that the search ends.
        let places = if sharp.places > depth_view::MAX_PLACES {
            MAX_PLACES
        } else {
            sharp.places
        };
        self.places.fetch_add(places, Ordering::Relaxed);
        if self.softness > 0.0 {
            sharp.softened(self.softness)
        } else {
            sharp
        }
    }

    /// Lowest and highest corner of the box around the triangles. `points`: `[V]`, turned.
    pub fn bounds_of(&self, points: &[[f32; 3]]) -> [[f32; 3]; 2] {
        let (low, high) = bounds(points, &self.triangles);
        [low, high]
    }
}

/// Turns the mesh into its stated frame.
///
/// # Errors
/// `InvalidInput` if both axes lie on one line, `Mesh` if the mesh has no size.
pub(super) fn stated_frame(mesh: &Mesh, forward: Axis, up: Axis) -> Result<Frame<'_>> {
    let (z, y) = (forward.direction(), up.direction());
    if z.iter().zip(&y).any(|(a, b)| a * b != 0.0) {
        let message = format!("axes: expected two different lines, got {forward} and {up} up");
        return Err(Error::InvalidInput(message));
    }
    let x = DVec3::from(y).cross(z.into()).into();
    let turn = Similarity {
        rotation: [x, y, z],
        ..Similarity::IDENTITY
    };
    let turned: Vec<_> = mesh.positions.iter().map(|p| turn.apply(*p)).collect();
    let (low, high) = bounds(&turned, &mesh.triangles);
    let size = (0..3)
        .map(|i| f64::from(high[i]) - f64::from(low[i]))
        .fold(0.0, f64::max);
    if !(size > 0.0 && size.is_finite()) {
        return Err(Error::Mesh(
            "expected a surface with some extent, got a point".into(),
        ));
    }
    let middle = |i: usize| 0.5 * (f64::from(low[i]) + f64::from(high[i]));
    let from_mesh = Similarity {
        scale: 1.0 / size,
        translation: std::array::from_fn(|i| -middle(i) / size),
        ..turn
    };
    let mut points: Vec<_> = mesh.positions.iter().map(|p| from_mesh.apply(*p)).collect();
    let mut triangles = Cow::Borrowed(&mesh.triangles[..]);
    while triangles.len() > MAX_TRIANGLES {
        let fewer = thinned(&mut points, &triangles);
        if fewer.len() == triangles.len() {
            break;
        }
        triangles = Cow::Owned(fewer);
    }
    Ok(Frame {
        points,
        triangles,
        from_mesh,
        softness: 0.0,
        places: Arc::default(),
    })
}

/// Removes about half of the triangles, evenly. Chooses triangles that share no corner and
/// collapses each into its first corner. Removes points that no triangle uses any more.
fn thinned(points: &mut Vec<[f32; 3]>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    const NOWHERE: u32 = u32::MAX;
    let mut goes_to = vec![NOWHERE; points.len()];
    for t in triangles {
        if t.iter().all(|&v| goes_to[v as usize] == NOWHERE) {
            t.iter().for_each(|&v| goes_to[v as usize] = t[0]);
        }
    }
    let mut number = vec![NOWHERE; points.len()];
    let mut remaining = Vec::with_capacity(points.len() / 2);
    let mut fewer = Vec::with_capacity(triangles.len() / 2);
    for t in triangles {
        let [a, b, c] = t.map(|v| match goes_to[v as usize] {
            NOWHERE => v,
            first => first,
        });
        if a != b && b != c && c != a {
            fewer.push([a, b, c].map(|v| {
                let n = &mut number[v as usize];
                if *n == NOWHERE {
                    *n = remaining.len() as u32;
                    remaining.push(points[v as usize]);
                }
                *n
            }));
        }
    }
    *points = remaining;
    fewer
}

fn bounds(points: &[[f32; 3]], triangles: &[[u32; 3]]) -> ([f32; 3], [f32; 3]) {
    let start = ([f32::MAX; 3], [f32::MIN; 3]);
    triangles.iter().flatten().fold(start, |(low, high), &v| {
        let p = points[v as usize];
        (
            std::array::from_fn(|i| low[i].min(p[i])),
            std::array::from_fn(|i| high[i].max(p[i])),
        )
    })
}

/// One look through a window at the mesh, whose `points` are turned to face +z.
pub(super) fn look(
    network: &LandmarkNetwork,
    frame: &Frame,
    points: &[[f32; 3]],
    window: Window,
) -> Look {
    let buffer = frame.draw(points, window);
    let sight = network.see(&buffer.features());
    Look {
        points: sight.places.map(|place| window.to_view(place)),
        sight,
        buffer,
    }
}

/// Half-size of the window on a face of human size, metres. The networks were trained with windows
/// of about this size.
pub(super) const HALF_SIZE_M: f32 = 0.105;

/// The close front view of a face.
pub(super) fn front(views: &LandmarkNetwork, frame: &Frame, to_canonical: &Similarity) -> Look {
    let points = turned(frame, to_canonical);
    look(views, frame, &points, on_face(HALF_SIZE_M))
}

/// A window around the centre of a face.
pub(super) fn on_face(half_size: f32) -> Window {
    let [x, y, _] = middle();
    Window {
        centre: [x, y],
        half_size,
    }
}

/// Mean of the canonical landmarks: the centre of a face.
pub(super) fn middle() -> [f32; 3] {
    let mean = canonical_landmarks();
    std::array::from_fn(|k| mean.iter().map(|p| p[k]).sum::<f32>() / mean.len() as f32)
}

/// The points in the face's own frame: canonical metres, as far as the pose is known.
pub(super) fn turned(frame: &Frame, to_canonical: &Similarity) -> Vec<[f32; 3]> {
    frame
        .points
        .iter()
        .map(|p| to_canonical.apply(*p))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh() -> Mesh {
        Mesh {
            positions: vec![[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 0.0, 4.0], [99.0; 3]],
            triangles: vec![[0, 1, 2]],
        }
    }

    #[test]
    fn blender_axes_turn_to_the_canonical_ones() {
        let mesh = mesh();
        let frame = stated_frame(&mesh, Axis::NegY, Axis::PosZ).unwrap();
        // Facing −y with +z up, the subject's left is +x.
        assert_eq!(frame.points[0], [-0.25, -0.5, 0.0]);
        assert_eq!(frame.points[1], [0.25, -0.5, 0.0]);
        assert_eq!(frame.points[2], [-0.25, 0.5, 0.0]);
    }

    #[test]
    fn a_dense_mesh_is_drawn_with_fewer_triangles_that_lie_where_it_lies() {
        // A bowl of 700 × 700 cells.
        const SIDE: u32 = 701;
        let at = |n: u32| n as f32 / 700.0 - 0.5;
        let point = |i: u32| {
            let (x, y) = (at(i % SIDE), at(i / SIDE));
            [x, y, 0.5 * (x * x + y * y)]
        };
        let cells = (0..SIDE * (SIDE - 1)).filter(|i| (i + 1) % SIDE != 0);
        let mesh = Mesh {
            positions: (0..SIDE * SIDE).map(point).collect(),
            triangles: cells
                .flat_map(|i| [[i, i + 1, i + SIDE], [i + 1, i + SIDE + 1, i + SIDE]])
                .collect(),
        };
        let frame = stated_frame(&mesh, Axis::PosZ, Axis::PosY).unwrap();
        assert!((200_000..MAX_TRIANGLES).contains(&frame.triangles.len()));
        assert!(frame.points.len() < mesh.positions.len() / 2 + SIDE as usize);
        let window = Window {
            centre: [0.0; 2],
            half_size: 0.5,
        };
        let whole: Vec<_> = mesh
            .positions
            .iter()
            .map(|p| frame.from_mesh.apply(*p))
            .collect();
        let exact = DepthBuffer::draw(&whole, &mesh.triangles, window);
        let thin = frame.draw(&frame.points, window);
        for n in 1..40 {
            let place = [n as f32 / 40.0, (40 - n) as f32 / 40.0];
            let (a, b) = (
                exact.depth_at(place).unwrap(),
                thin.depth_at(place).unwrap(),
            );
            assert!((a - b).abs() < 2e-3, "{place:?}: {a} {b}");
        }
    }

    #[test]
    fn axes_on_one_line_are_refused() {
        let error = stated_frame(&mesh(), Axis::PosZ, Axis::NegZ).err().unwrap();
        assert!(error.to_string().contains("+z and -z up"), "{error}");
    }

    #[test]
    fn a_mesh_in_one_point_is_refused() {
        let mut mesh = mesh();
        mesh.positions = vec![[2.0; 3]; 4];
        let error = stated_frame(&mesh, Axis::PosZ, Axis::PosY).err().unwrap();
        assert!(matches!(error, Error::Mesh(_)));
    }
}
