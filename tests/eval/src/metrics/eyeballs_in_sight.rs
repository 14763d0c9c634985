//! How much of the eyeballs is visible from the front.

use anyface::mesh::FrontView;

/// Kinds of cells.
const SKIN: u8 = 1;
const EYEBALL: u8 = 2;

/// Visible areas of all eyeballs together, in the square of the mesh's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeballsInSight {
    /// Visible area of the eyeballs.
    pub area: f64,
    /// The part of `area` that shows through a lid: outside the longest visible run of its column.
    pub through_lids: f64,
}

/// Looks at a posed head along −z through square cells of side `cell`.
///
/// `positions`: `[V]`, +y up and +z out of the face; `skin`, `eyeballs`: triangles. Anything else,
/// such as lashes or a film of tears, hides nothing. A column is vertical and takes in only one
/// eyeball, as the eyeballs lie in different halves of the face.
pub fn eyeballs_in_sight(
    positions: &[[f32; 3]],
    skin: &[[u32; 3]],
    eyeballs: &[[u32; 3]],
    cell: f32,
) -> EyeballsInSight {
    let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
    let points = eyeballs.iter().flat_map(corners);
    let mut bounds = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for p in points {
        (0..2).for_each(|i| bounds.0[i] = bounds.0[i].min(p[i]));
        (0..2).for_each(|i| bounds.1[i] = bounds.1[i].max(p[i]));
    }
    if eyeballs.is_empty() {
        return EyeballsInSight {
            area: 0.0,
            through_lids: 0.0,
        };
    }
    let mut view = FrontView::new(bounds.0, bounds.1, cell);
    skin.iter().for_each(|t| view.draw(corners(t), SKIN));
    eyeballs.iter().for_each(|t| view.draw(corners(t), EYEBALL));
    let (mut visible, mut beside) = (0usize, 0usize);
    for column in 0..view.columns() {
        let (mut run, mut longest, mut all) = (0usize, 0usize, 0usize);
        for row in 0..view.rows() {
            let is_eye = view.kind(column, row) == EYEBALL;
            run = if is_eye { run + 1 } else { 0 };
            longest = longest.max(run);
            all += usize::from(is_eye);
        }
        visible += all;
        beside += all - longest;
    }
    let area = f64::from(cell).powi(2);
    EyeballsInSight {
        area: area * visible as f64,
        through_lids: area * beside as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 2 around (x, y) at a depth.
    fn square(points: &mut Vec<[f32; 3]>, centre: [f32; 3], half: [f32; 2]) -> [[u32; 3]; 2] {
        let first = points.len() as u32;
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            points.push([centre[0] + x * half[0], centre[1] + y * half[1], centre[2]]);
        }
        [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v| v + first))
    }

    #[test]
    fn what_skin_covers_is_not_seen_and_holes_in_it_are_told_from_the_opening() {
        let mut points = Vec::new();
        let eye = square(&mut points, [0.0; 3], [1.0, 1.0]);
        let open = eyeballs_in_sight(&points, &[], &eye, 0.01);
        assert!((open.area - 4.0).abs() < 0.05 && open.through_lids == 0.0);
        // A band across the eyeball leaves 0.3 visible below it and 1.2 above it.
        let lid = square(&mut points, [0.0, -0.45, 1.0], [2.0, 0.25]);
        let visible = eyeballs_in_sight(&points, &lid, &eye, 0.01);
        assert!((visible.area - 3.0).abs() < 0.05, "{visible:?}");
        assert!((visible.through_lids - 0.6).abs() < 0.05, "{visible:?}");
        let behind = square(&mut points, [0.0, 0.0, -1.0], [2.0, 2.0]);
        let visible = eyeballs_in_sight(&points, &behind, &eye, 0.01);
        assert!((visible.area - 4.0).abs() < 0.05);
        assert_eq!(eyeballs_in_sight(&points, &lid, &[], 0.01).area, 0.0);
    }
}
