//! Crude creatures without a human face, made as surfaces of distance fields, with the five points
//! that somebody would click.
//!
//! They are in metres and face +z with +y up. Each body is one closed surface. The creatures differ
//! in where the mouth is and how it opens: a snout that is all mouth, a beak, a slot in a box, a
//! line that is only painted.

use anyface::{
    Result,
    mesh::Mesh,
    sdf::{Grid, surface},
};
use glam::{Vec2, Vec3, Vec3Swizzles};

/// A creature: its title, its distance field, and its five points. These are the outer corners of
/// the right and left eye, the tip of the nose, and the right and left corner of the mouth.
pub(super) struct Creature {
    pub title: &'static str,
    field: fn(Vec3) -> f32,
    /// The fields of further, separate surfaces.
    pieces: &'static [fn(Vec3) -> f32],
    pub five: [[f32; 3]; 5],
}

/// Half the side of the box that every creature fits into, metres.
const HALF_BOX_M: f32 = 0.3;
/// Cells along the side of that box, 3 mm each.
const CELLS: usize = 200;

impl Creature {
    pub(super) fn mesh(&self) -> Result<Mesh> {
        let grid = Grid::of_box([-HALF_BOX_M; 3], [HALF_BOX_M; 3], CELLS)?;
        let mut mesh = Mesh::default();
        for field in std::iter::once(&self.field).chain(self.pieces) {
            let piece = surface(grid, |points| {
                let each = points.outer_iter();
                each.map(|p| field(Vec3::new(p[0], p[1], p[2]))).collect()
            })?;
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(piece.positions);
            let triangles = piece.triangles.iter();
            mesh.triangles
                .extend(triangles.map(|t| t.map(|v| v + first)));
        }
        Ok(mesh)
    }
}

pub(super) const CREATURES: [Creature; 8] = [
    Creature {
        title: "alligator",
        field: alligator,
        pieces: &[],
        five: mirrored([0.062, 0.075, 0.03], [0.0, 0.0, 0.26], [0.045, -0.03, 0.2]),
    },
    Creature {
        title: "ball with a beak",
        field: beaked_ball,
        pieces: &[],
        five: mirrored(
            [0.06, 0.045, 0.078],
            [0.0, 0.0, 0.19],
            [0.028, -0.012, 0.097],
        ),
    },
    Creature {
        title: "fish",
        field: fish,
        pieces: &[],
        five: mirrored(
            [0.052, 0.03, 0.085],
            [0.0, 0.012, 0.148],
            [0.03, -0.012, 0.118],
        ),
    },
    Creature {
        title: "boar with tusks",
        field: boar,
        pieces: &[tusks],
        five: mirrored(
            [0.07, 0.06, 0.075],
            [0.0, 0.01, 0.218],
            [0.04, -0.034, 0.12],
        ),
    },
    Creature {
        title: "robot",
        field: robot,
        pieces: &[],
        five: mirrored(
            [0.055, 0.04, 0.078],
            [0.0, 0.0, 0.092],
            [0.045, -0.045, 0.078],
        ),
    },
    Creature {
        title: "cup with a drawn face",
        field: cup,
        pieces: &[],
        five: mirrored(
            [0.032, 0.025, 0.05],
            [0.0, 0.0, 0.06],
            [0.022, -0.022, 0.055],
        ),
    },
    Creature {
        title: "beard over the lips",
        field: plain_head,
        pieces: &[beard],
        five: mirrored(
            [0.045, 0.03, 0.085],
            [0.0, -0.01, 0.128],
            [0.028, -0.04, 0.088],
        ),
    },
    Creature {
        title: "teeth outside the lips",
        field: plain_head,
        pieces: &[teeth],
        five: mirrored(
            [0.045, 0.03, 0.085],
            [0.0, -0.01, 0.128],
            [0.028, -0.04, 0.088],
        ),
    },
];

/// The five points of a symmetric face, given the outer corner of its left eye, its nose and the
/// left corner of its mouth.
const fn mirrored(eye: [f32; 3], nose: [f32; 3], mouth: [f32; 3]) -> [[f32; 3]; 5] {
    [
        [-eye[0], eye[1], eye[2]],
        eye,
        nose,
        [-mouth[0], mouth[1], mouth[2]],
        mouth,
    ]
}

/// A skull with eyes on top, and a snout that is slit along its whole length.
fn alligator(p: Vec3) -> f32 {
    let q = across(p);
    let skull = ellipsoid(p, [0.0, 0.0, 0.0], [0.085, 0.07, 0.1]);
    let snout = rounded_box(p, [0.0, -0.025, 0.15], [0.045, 0.03, 0.11], 0.015);
    let eye = ball(q, [0.045, 0.065, 0.02], 0.022);
    let nostril = ball(q, [0.018, 0.012, 0.24], 0.014);
    let body = join(join(join(skull, snout, 0.04), eye, 0.01), nostril, 0.01);
    let slit = rounded_box(p, [0.0, -0.03, 0.2], [0.1, 0.003, 0.12], 0.0);
    body.max(-slit)
}

/// A ball whose upper and lower beak are cones.
fn beaked_ball(p: Vec3) -> f32 {
    let q = across(p);
    let ball_ = ball(p, [0.0; 3], 0.1);
    let eye = ball(q, [0.042, 0.045, 0.075], 0.02);
    let upper = cone(p, [0.0, 0.0, 0.08], [0.0, -0.005, 0.19], 0.035, 0.004);
    let lower = cone(p, [0.0, -0.025, 0.08], [0.0, -0.02, 0.165], 0.028, 0.004);
    let slit = rounded_box(p, [0.0, -0.013, 0.18], [0.1, 0.002, 0.085], 0.0);
    join(join(ball_, eye, 0.008), upper.min(lower), 0.008).max(-slit)
}

/// A fish, flattened from side to side, with eyes on its sides and a small mouth in front.
fn fish(p: Vec3) -> f32 {
    let q = across(p);
    let body = ellipsoid(p, [0.0, 0.0, 0.0], [0.055, 0.085, 0.15]);
    let eye = ball(q, [0.04, 0.03, 0.085], 0.016);
    let tail = rounded_box(p, [0.0, 0.0, -0.19], [0.006, 0.07, 0.04], 0.004);
    let fin = rounded_box(p, [0.0, 0.09, -0.02], [0.005, 0.03, 0.06], 0.004);
    let lips = ellipsoid(p, [0.0, -0.012, 0.135], [0.03, 0.022, 0.025]);
    let slit = rounded_box(p, [0.0, -0.012, 0.16], [0.06, 0.003, 0.045], 0.0);
    let all = join(join(join(body, tail, 0.03), fin, 0.01), lips, 0.015);
    join(all, eye, 0.006).max(-slit)
}

/// A boar's head with a round snout and ears.
fn boar(p: Vec3) -> f32 {
    let q = across(p);
    let skull = ellipsoid(p, [0.0, 0.02, 0.0], [0.095, 0.1, 0.11]);
    let snout = cone(p, [0.0, -0.01, 0.08], [0.0, -0.005, 0.185], 0.055, 0.036);
    let jaw = cone(p, [0.0, -0.05, 0.06], [0.0, -0.042, 0.15], 0.045, 0.026);
    let ear = ellipsoid(q, [0.07, 0.12, -0.01], [0.03, 0.05, 0.012]);
    let eye = ball(q, [0.055, 0.06, 0.075], 0.014);
    let slit = rounded_box(p, [0.0, -0.034, 0.19], [0.12, 0.003, 0.07], 0.0);
    let head = join(join(join(skull, snout, 0.03), jaw, 0.02), ear, 0.015);
    join(head, eye, 0.006).max(-slit)
}

/// Tusks that rise from the lower jaw next to the upper lip.
fn tusks(p: Vec3) -> f32 {
    let q = across(p);
    let root = cone(
        q,
        [0.026, -0.05, 0.145],
        [0.05, -0.025, 0.155],
        0.008,
        0.007,
    );
    let tusk = cone(q, [0.05, -0.025, 0.155], [0.055, 0.02, 0.15], 0.007, 0.002);
    root.min(tusk)
}

/// A box with square eyes and a slot.
fn robot(p: Vec3) -> f32 {
    let q = across(p);
    let head = rounded_box(p, [0.0; 3], [0.075, 0.085, 0.07], 0.006);
    let eye = rounded_box(q, [0.035, 0.04, 0.072], [0.018, 0.012, 0.005], 0.002);
    let nose = rounded_box(p, [0.0, 0.0, 0.08], [0.006, 0.012, 0.01], 0.002);
    let aerial = cone(p, [0.0, 0.08, 0.0], [0.0, 0.14, 0.0], 0.005, 0.005);
    let knob = ball(p, [0.0, 0.145, 0.0], 0.012);
    let slot = rounded_box(p, [0.0, -0.045, 0.08], [0.045, 0.003, 0.05], 0.0);
    head.min(eye).min(nose).min(aerial).min(knob).max(-slot)
}

/// A hollow cup with a handle. Its face is only painted and leaves no trace in the surface.
fn cup(p: Vec3) -> f32 {
    let outside = cylinder(p, 0.06, 0.065);
    let inside = cylinder(p - Vec3::new(0.0, 0.012, 0.0), 0.052, 0.065);
    let ring = p - Vec3::new(0.068, 0.0, 0.0);
    let handle = Vec2::new(ring.xy().length() - 0.035, ring.z).length() - 0.008;
    join(outside, handle, 0.006).max(-inside)
}

/// A beard that hangs in front of the lower lip.
fn beard(p: Vec3) -> f32 {
    ellipsoid(p, [0.0, -0.085, 0.09], [0.045, 0.043, 0.025])
}

/// Upper teeth that stand in front of the lower lip.
fn teeth(p: Vec3) -> f32 {
    let q = across(p);
    let tooth = |x: f32| rounded_box(q, [x, -0.042, 0.103], [0.005, 0.012, 0.003], 0.002);
    tooth(0.007).min(tooth(0.021))
}

/// A head with lips and a slit.
fn plain_head(p: Vec3) -> f32 {
    let q = across(p);
    let head = ellipsoid(p, [0.0; 3], [0.08, 0.1, 0.095]);
    let nose = ellipsoid(p, [0.0, 0.0, 0.1], [0.014, 0.022, 0.026]);
    let eye = ball(q, [0.032, 0.03, 0.076], 0.016);
    let lips = ellipsoid(p, [0.0, -0.04, 0.085], [0.034, 0.014, 0.014]);
    let slit = rounded_box(p, [0.0, -0.04, 0.1], [0.028, 0.0016, 0.04], 0.0);
    join(join(join(head, nose, 0.008), eye, 0.005), lips, 0.008).max(-slit)
}

fn across(p: Vec3) -> Vec3 {
    Vec3::new(p.x.abs(), p.y, p.z)
}

fn ball(p: Vec3, centre: [f32; 3], radius: f32) -> f32 {
    p.distance(centre.into()) - radius
}

/// An approximate distance, exact at the surface.
fn ellipsoid(p: Vec3, centre: [f32; 3], radii: [f32; 3]) -> f32 {
    let (p, r) = (p - Vec3::from(centre), Vec3::from(radii));
    let (a, b) = ((p / r).length(), (p / (r * r)).length());
    if b > 1e-6 {
        a * (a - 1.0) / b
    } else {
        -r.min_element()
    }
}

fn rounded_box(p: Vec3, centre: [f32; 3], half: [f32; 3], radius: f32) -> f32 {
    let q = (p - Vec3::from(centre)).abs() - Vec3::from(half) + radius;
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - radius
}

/// A cone with round ends from `a` to `b`, whose radius goes from `at_a` to `at_b`.
fn cone(p: Vec3, a: [f32; 3], b: [f32; 3], at_a: f32, at_b: f32) -> f32 {
    let (a, b) = (Vec3::from(a), Vec3::from(b));
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along)) - (at_a + along * (at_b - at_a))
}

/// A cylinder around the y axis.
fn cylinder(p: Vec3, radius: f32, half_height: f32) -> f32 {
    let d = Vec2::new(p.xz().length() - radius, p.y.abs() - half_height);
    d.max(Vec2::ZERO).length() + d.max_element().min(0.0)
}

/// Joins two shapes, with a fillet of `width` where they meet.
fn join(a: f32, b: f32, width: f32) -> f32 {
    let h = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - 0.25 * h * h * width
}
