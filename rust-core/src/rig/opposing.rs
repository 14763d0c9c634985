//! Shapes that undo each other: left and right, up and down, smile and frown. Only one of a pair
//! should move a face at a time, since an artist cannot edit a curve whose effect depends on
//! another curve.

use ndarray::Array2;

/// Endings that may follow the stem of a shape's name.
const SIDES: [&str; 3] = ["", "Left", "Right"];
/// Stems of shapes that are opposites by their names.
const BY_NAME: [(&str, &str); 9] = [
    ("mouthLeft", "mouthRight"),
    ("jawLeft", "jawRight"),
    ("mouthSmile", "mouthFrown"),
    ("mouthPucker", "mouthStretch"),
    ("eyeBlink", "eyeWide"),
    ("eyeLookUp", "eyeLookDown"),
    ("eyeLookIn", "eyeLookOut"),
    ("browDown", "browOuterUp"),
    ("browDown", "browInnerUp"),
];
/// Shapes that work together although they move some vertices in opposite directions.
const TOGETHER: [(&str, &str); 1] = [("jawOpen", "mouthClose")];
/// Shapes are opposites if the cosine of their displacements is below this.
const AGAINST: f64 = -0.7;
/// Frames on either side that count when choosing which of the two shapes moves.
const BESIDE: usize = 2;

/// Pairs of shapes that undo each other, by their numbers. `gram` `[S, S]`: the products of their
/// displacements.
pub(super) fn pairs(names: &[String], gram: &Array2<f64>) -> Vec<(usize, usize)> {
    let mut opposing = Vec::new();
    for a in 0..names.len() {
        for b in a + 1..names.len() {
            let size = (gram[[a, a]] * gram[[b, b]]).sqrt();
            let cosine = gram[[a, b]] / size.max(f64::MIN_POSITIVE);
            let (one, other) = (&names[a], &names[b]);
            let apart = !is_among(&TOGETHER, one, other);
            if size > 0.0 && apart && (cosine < AGAINST || is_among(&BY_NAME, one, other)) {
                opposing.push((a, b));
            }
        }
    }
    opposing
}

fn is_among(known: &[(&str, &str)], one: &str, other: &str) -> bool {
    let named = |stem: &str, name: &str| {
        let end = name.strip_prefix(stem);
        end.filter(|end| SIDES.contains(end)).map(str::to_owned)
    };
    known.iter().any(|(a, b)| {
        [(one, other), (other, one)].iter().any(|(first, second)| {
            match (named(a, first), named(b, second)) {
                (Some(x), Some(y)) => x == y || x.is_empty() || y.is_empty(),
                _ => false,
            }
        })
    })
}

/// Which weights `[T, S]` stay at 0. In each pair it is the shape that moves the face less around a
/// frame.
pub(super) fn resting(
    pairs: &[(usize, usize)],
    weights: &Array2<f64>,
    gram: &Array2<f64>,
) -> Array2<bool> {
    let (frames, shapes) = weights.dim();
    let mut rests = Array2::from_elem((frames, shapes), false);
    let size: Vec<f64> = gram.diag().iter().map(|g| g.sqrt()).collect();
    for &(a, b) in pairs {
        let more = |t: usize| weights[[t, a]] * size[a] - weights[[t, b]] * size[b];
        for t in 0..frames {
            let about = t.saturating_sub(BESIDE)..=(t + BESIDE).min(frames - 1);
            let first_moves = about.map(more).sum::<f64>() >= 0.0;
            rests[[t, if first_moves { b } else { a }]] = true;
        }
    }
    rests
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs_of(names: &[&str], gram: &[f64]) -> Vec<(usize, usize)> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let gram = Array2::from_shape_vec((names.len(), names.len()), gram.to_vec());
        pairs(&names, &gram.unwrap())
    }

    #[test]
    fn opposites_are_known_by_name_and_by_what_they_move() {
        let apart = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let names = ["mouthSmileLeft", "mouthFrownRight", "mouthFrownLeft"];
        assert_eq!(pairs_of(&names, &apart), [(0, 2)]);
        assert_eq!(
            pairs_of(&["browDownLeft", "browInnerUp"], &[1.0, 0.0, 0.0, 1.0]),
            [(0, 1)]
        );
        let against = [1.0, -0.8, -0.8, 1.0];
        assert_eq!(pairs_of(&["tongueOut", "cheekPuff"], &against), [(0, 1)]);
        assert_eq!(pairs_of(&["jawOpen", "mouthClose"], &against), []);
        assert_eq!(
            pairs_of(&["tongueOut", "cheekPuff"], &[1.0, -0.3, -0.3, 1.0]),
            []
        );
        assert_eq!(pairs_of(&["mouthLeft", "mouthRight"], &[0.0; 4]), []);
    }

    #[test]
    fn the_one_that_moves_more_about_a_frame_stays() {
        let gram = Array2::from_diag(&ndarray::arr1(&[1.0, 4.0]));
        let mut weights = Array2::from_elem((12, 2), 0.1);
        weights.slice_mut(ndarray::s![..6, 0]).fill(0.8);
        let rests = resting(&[(0, 1)], &weights, &gram);
        assert!(rests.rows().into_iter().all(|row| row[0] != row[1]));
        assert!(rests[[0, 1]] && rests[[11, 0]]);
    }
}
