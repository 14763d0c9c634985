//! Decides which parts make up one eye (a ball, with the cornea and iris on it), and to which eye
//! of the landmarks it belongs.
//!
//! The landmarks mark two eyes. A head may have one eye in its middle, or more than two eyes.
//! Lengths are canonical centimetres.

use glam::Vec2;

use crate::{
    face::{PartList, box3::Box3},
    mesh::{PartRole, parts::NO_PART},
};

/// Seen from the front, the ball of an eye lies less than this beside the middle between the
/// corners of the eye, in widths of the eye.
const BESIDE: f32 = 1.0;
/// A ball belongs to one eye of the landmarks if it is at least this many times nearer to it than
/// to the other. Otherwise it belongs to both.
const NEARER: f32 = 2.0;

/// One eye of the mesh.
pub(super) struct Ball {
    middle: [f32; 3],
    /// Half the largest extent of the ball.
    pub radius: f32,
    pub triangles: Vec<[u32; 3]>,
}

/// The eye of the landmarks to which a ball belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    /// One eye of the landmarks: 0 the right one, 1 the left one.
    Eye(usize),
    /// Both eyes of the landmarks share this ball.
    Both,
    /// Neither eye of the landmarks has this ball.
    Nobody,
}

impl Ball {
    /// The balls of a head, with the largest first.
    pub fn of(positions: &[[f32; 3]], triangles: &[[u32; 3]], parts: &PartList) -> Vec<Ball> {
        let connected = &parts.connected;
        let mut of_part: Vec<Vec<[u32; 3]>> = vec![Vec::new(); connected.count];
        for &t in triangles {
            let part = connected.of_vertex[t[0] as usize];
            if part != NO_PART && parts.is(t[0] as usize, PartRole::Gaze) {
                of_part[part as usize].push(t);
            }
        }
        let ball = |triangles: Vec<[u32; 3]>| {
            let corners = triangles.iter().flatten();
            let bounds = Box3::of(corners.map(|&v| positions[v as usize]));
            Ball {
                middle: bounds.middle(),
                radius: 0.5 * bounds.largest(),
                triangles,
            }
        };
        let of_part = of_part.into_iter().filter(|part| !part.is_empty());
        let mut pieces: Vec<Ball> = of_part.map(ball).collect();
        pieces.sort_by(|a, b| b.radius.total_cmp(&a.radius));
        let mut balls: Vec<Ball> = Vec::new();
        for piece in pieces {
            let holds = |ball: &&mut Ball| ball.beside(piece.middle) < ball.radius;
            match balls.iter_mut().find(holds) {
                Some(ball) => ball.triangles.extend(piece.triangles),
                None => balls.push(piece),
            }
        }
        balls
    }

    /// How far a point lies from the ball's middle, seen from the front.
    fn beside(&self, p: [f32; 3]) -> f32 {
        Vec2::new(p[0] - self.middle[0], p[1] - self.middle[1]).length()
    }

    /// The owner of each ball. `eyes`: for the right and the left eye of the landmarks, the middle
    /// between the corners and the width.
    pub fn owners(balls: &[Ball], eyes: [Option<([f32; 3], f32)>; 2]) -> Vec<Owner> {
        let away = |ball: &Ball, eye: usize| {
            let (middle, width) = eyes[eye]?;
            Some(ball.beside(middle) / width).filter(|away| *away < BESIDE)
        };
        let is_both = |ball: &Ball| {
            let [Some(right), Some(left)] = [0, 1].map(|eye| away(ball, eye)) else {
                return false;
            };
            right.max(left) < NEARER * right.min(left)
        };
        let mut owners: Vec<Owner> = vec![Owner::Nobody; balls.len()];
        for eye in 0..2 {
            let candidates = (0..balls.len()).filter_map(|b| Some((away(&balls[b], eye)?, b)));
            let nearest = candidates.min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((_, b)) if is_both(&balls[b]) => owners[b] = Owner::Both,
                Some((_, b)) => owners[b] = Owner::Eye(eye),
                None => {}
            }
        }
        owners
    }
}
