//! Makes two takes of one actor differ, in weights of ARKit's shapes.
//!
//! All shapes that part the lips are scaled by the same factor, `mouthClose` included. So the gap
//! changes by that factor, and closed lips stay closed.

use ndarray::Axis;

use super::{columns, starts};
use crate::{
    Result,
    mesh::ibug::BROWS,
    motion::{
        FaceModes, WeightClip,
        brow_accents::RAISING,
        variety::{BrowVariety, MouthVariety, Variety},
    },
};

/// Shapes that open the mouth; names start with these.
const OPENING: [&str; 8] = [
    "jawOpen",
    "mouthClose",
    "mouthLowerDown",
    "mouthUpperUp",
    "mouthShrug",
    "mouthRoll",
    "mouthPress",
    "jawForward",
];
/// Shapes that widen the mouth.
const WIDENING: [&str; 1] = ["mouthStretch"];
/// Shapes that bring the lips forward.
const ROUNDING: [&str; 2] = ["mouthFunnel", "mouthPucker"];
/// Shapes that open the left and the right side of the lips separately.
const SIDED: [&str; 2] = ["mouthLowerDown", "mouthUpperUp"];
/// The left corner of the mouth.
const CORNER: usize = 54;
const KNITTING: [&str; 2] = ["browDownLeft", "browDownRight"];

/// Shapes that move a part of the face in two opposite directions.
struct TwoWays {
    /// For the positive and the negative direction: columns, and how far all of them at weight 1
    /// move the part, metres.
    ways: [(Vec<usize>, f32); 2],
}

impl TwoWays {
    /// `way`: how far the shape of a column moves the part at weight 1, metres.
    fn new(positive: Vec<usize>, negative: Vec<usize>, way: impl Fn(usize) -> f32) -> Self {
        let both = [positive, negative];
        TwoWays {
            ways: both.map(|columns| {
                let moved = columns.iter().map(|column| way(*column).abs()).sum();
                (columns, moved)
            }),
        }
    }

    /// Moves the part by `by` metres. Lowers the shapes of the opposite direction first.
    fn add(&self, row: &mut ndarray::ArrayViewMut1<'_, f32>, by: f32) {
        let [mine, other] = if by > 0.0 { [0, 1] } else { [1, 0] };
        let mut left = by.abs();
        let (columns, moved) = &self.ways[other];
        if *moved > 0.0 {
            let lowest = columns
                .iter()
                .map(|column| row[*column])
                .fold(f32::INFINITY, f32::min);
            let fall = (left / moved).min(lowest.max(0.0));
            columns.iter().for_each(|column| row[*column] -= fall);
            left -= fall * moved;
        }
        let (columns, moved) = &self.ways[mine];
        if *moved > 0.0 {
            columns
                .iter()
                .for_each(|column| row[*column] += left / moved);
        }
    }
}

impl WeightClip {
    /// Varies the lower face as [`Variety::vary_mouth`] does for landmarks.
    pub(super) fn vary_mouth(
        &mut self,
        modes: &FaceModes,
        variety: &Variety,
        strength: f32,
    ) -> Result<()> {
        let shapes = modes.of_shapes(&self.names)?;
        let of = |stems: &[&str]| columns(&self.names, |name| starts(name, stems));
        let named = |name: &str| columns(&self.names, |known| known == name);
        let groups = [of(&WIDENING), of(&OPENING), of(&ROUNDING)];
        let sides = ["Left", "Right"].map(|side| {
            columns(&self.names, |name| {
                name.ends_with(side) && starts(name, &SIDED)
            })
        });
        let across = |column: usize| shapes[[column, CORNER, 0]];
        let shift = TwoWays::new(named("mouthLeft"), named("mouthRight"), across);
        let corner = |side: &str, place: usize| {
            let up = |column: usize| shapes[[column, place, 1]];
            let [smile, frown] =
                ["mouthSmile", "mouthFrown"].map(|stem| named(&format!("{stem}{side}")));
            TwoWays::new(smile, frown, up)
        };
        let corners = [corner("Left", CORNER), corner("Right", CORNER - 6)];
        let fps = self.fps;
        for (t, mut row) in self.weights.axis_iter_mut(Axis(0)).enumerate() {
            let MouthVariety {
                scale,
                side,
                shift_m,
                tilt_m,
            } = variety.mouth(t as f64 / fps, strength);
            for (columns, scale) in groups.iter().zip(scale) {
                columns.iter().for_each(|column| row[*column] *= scale);
            }
            for (columns, sign) in sides.iter().zip([1.0, -1.0]) {
                columns
                    .iter()
                    .for_each(|column| row[*column] *= 1.0 + sign * side);
            }
            shift.add(&mut row, shift_m);
            corners[0].add(&mut row, tilt_m);
            corners[1].add(&mut row, -tilt_m);
        }
        Ok(())
    }

    /// Varies the brows as [`Variety::vary_brows`] does for landmarks.
    pub(super) fn vary_brows(
        &mut self,
        modes: &FaceModes,
        variety: &Variety,
        strength: f32,
    ) -> Result<()> {
        let shapes = modes.of_shapes(&self.names)?;
        let named = |name: &str| columns(&self.names, |known| known == name);
        let height =
            |column: usize| BROWS.map(|n| shapes[[column, n, 1]]).sum::<f32>() / BROWS.len() as f32;
        let mut raised = 0.0;
        for name in RAISING {
            let mode = modes.mode(name)?;
            raised += BROWS.map(|n| mode[[n, 1]]).sum::<f32>() / BROWS.len() as f32;
        }
        let up = [
            named("browInnerUp"),
            named("browOuterUpLeft"),
            named("browOuterUpRight"),
        ]
        .concat();
        let down = KNITTING.map(named).concat();
        let lift = TwoWays::new(up, down, height);
        let knit = KNITTING.map(named);
        let fps = self.fps;
        for (t, mut row) in self.weights.axis_iter_mut(Axis(0)).enumerate() {
            let brows: BrowVariety = variety.brows(t as f64 / fps, strength);
            lift.add(&mut row, raised * brows.raised);
            for (columns, sign) in knit.iter().zip([1.0, -1.0]) {
                for column in columns {
                    row[*column] = (row[*column] + (1.0 + sign * brows.side) * brows.knit).max(0.0);
                }
            }
        }
        Ok(())
    }
}
