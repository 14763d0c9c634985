//! Brings the mouth to the shapes of sounds that a viewer has to tell apart, in landmarks.

use ndarray::{Array2, ArrayView2, ArrayViewMut2};

use super::{narrow, opening};
use crate::{
    Result,
    mesh::ibug::{CHIN, CORNERS, LIP_COLUMNS, MOUTH, speaking},
    motion::{FaceModes, LandmarkClip},
    speech::{LIP_SHAPES, LipShapes},
};

/// The middle pair of inner-lip landmarks, upper and lower.
const MIDDLE: [usize; 2] = [62, 66];

/// Brings the mouth of a clip to the shapes, as far as it is not there yet.
///
/// # Errors
/// `Weights` for modes without the shapes' modes.
pub fn take_shapes(clip: &mut LandmarkClip, shapes: &LipShapes, modes: &FaceModes) -> Result<()> {
    let degrees = shapes.at_frames(clip.displacements.dim().0, clip.fps);
    let jaw = modes.mode("jawOpen")?.to_owned();
    let [pucker, funnel, stretch, lower] = [
        "mouthPucker",
        "mouthFunnel",
        "mouthStretch",
        "mouthLowerDown",
    ]
    .map(|name| modes.of_shape(name));
    let [pucker, funnel, stretch, lower] = [pucker?, funnel?, stretch?, lower?];
    // Lips that come forward and leave the width as it is.
    let ahead = &funnel - &(width(funnel.view()) / width(stretch.view()) * &stretch);
    let forward_m = forward(ahead.view());
    for (shape, degrees) in LIP_SHAPES.iter().zip(degrees.columns()) {
        let frames = clip.displacements.outer_iter_mut().zip(degrees);
        for (mut face, &degree) in frames.filter(|(_, degree)| **degree > 0.0) {
            let by = missing(chin(face.view()), shape.chin_m, degree);
            add(&mut face, speaking(), &jaw, by / chin(jaw.view()));
            let by = missing(width(face.view()), shape.width_m, degree);
            let mode = if by < 0.0 { &pucker } else { &stretch };
            add(&mut face, MOUTH, mode, by / width(mode.view()));
            let by = missing(forward(face.view()), shape.forward_m, degree);
            add_at_gaps(&mut face, &ahead, by.max(0.0) / forward_m);
            let by = missing(gap(face.view()), shape.gap_m, degree);
            let open = opening(face.view());
            if by > 0.0 {
                add(&mut face, MOUTH, &lower, by / gap(lower.view()));
            } else if by < 0.0 && open > 0.0 {
                narrow(&mut face, (-by / open).min(1.0));
            }
        }
    }
    Ok(())
}

/// How far a length is from its bounds, times the degree of the shape; metres, negative for a
/// length that is too large.
pub fn missing(length: f32, [least, most]: [f32; 2], degree: f32) -> f32 {
    degree * ((least - length).max(0.0) - (length - most).max(0.0))
}

/// How far forward the lips of a frame `[68, 3]` are on average, metres.
pub fn forward(face: ArrayView2<'_, f32>) -> f32 {
    let sum: f32 = MOUTH.map(|n| face[[n, 2]]).sum();
    sum / MOUTH.len() as f32
}

/// Distance between the corners of the mouth, metres more than in the neutral face.
pub fn width(face: ArrayView2<'_, f32>) -> f32 {
    let [right, left] = CORNERS;
    face[[left, 0]] - face[[right, 0]]
}

/// Opening of the lips at the middle, metres more than in the neutral face.
pub fn gap(face: ArrayView2<'_, f32>) -> f32 {
    let [upper, lower] = MIDDLE;
    face[[upper, 1]] - face[[lower, 1]]
}

/// How far the chin hangs below its place in the neutral face, metres.
pub fn chin(face: ArrayView2<'_, f32>) -> f32 {
    -face[[CHIN, 1]]
}

/// Adds a mode `[68, 3]` to the mouth of a face, and leaves every gap of the lips as it is.
pub(super) fn add_at_gaps(face: &mut ArrayViewMut2<'_, f32>, mode: &Array2<f32>, weight: f32) {
    let gaps = LIP_COLUMNS.each_ref().map(|column| column.gap(face.view()));
    add(face, MOUTH, mode, weight);
    for (column, gap) in LIP_COLUMNS.iter().zip(gaps) {
        let by = gap - column.gap(face.view());
        column.part(face, by);
    }
}

/// Adds a mode `[68, 3]` to some landmarks of a face.
fn add(
    face: &mut ArrayViewMut2<'_, f32>,
    landmarks: impl Iterator<Item = usize>,
    mode: &Array2<f32>,
    weight: f32,
) {
    for n in landmarks.filter(|_| weight != 0.0) {
        for axis in 0..3 {
            face[[n, axis]] += weight * mode[[n, axis]];
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn talk(name: &str, before: &LandmarkClip) -> LandmarkClip {
        let mut clip = before.clone();
        let modes = FaceModes::open(None).unwrap();
        take_shapes(&mut clip, &LipShapes::at(name, 0.5..0.6), &modes).unwrap();
        clip
    }

    /// A second and a half at 60 frames a second with the jaw open by a share.
    fn open(share: f32) -> LandmarkClip {
        let modes = FaceModes::open(None).unwrap();
        let jaw = modes.mode("jawOpen").unwrap();
        let mut displacements = Array3::zeros((90, 68, 3));
        for mut face in displacements.outer_iter_mut() {
            face.assign(&(share * &jaw));
        }
        LandmarkClip {
            displacements,
            fps: 60.0,
        }
    }

    #[test]
    fn the_mouth_is_in_every_shape_in_time_and_back_afterwards() {
        for (shape, jaw) in LIP_SHAPES.iter().flat_map(|s| [(s, 0.0), (s, 0.4)]) {
            let before = open(jaw);
            let clip = talk(shape.name, &before);
            let face = clip.displacements.index_axis(ndarray::Axis(0), 33);
            let lengths = [
                (forward(face), shape.forward_m),
                (width(face), shape.width_m),
                (gap(face), shape.gap_m),
                (chin(face), shape.chin_m),
            ];
            for (length, [least, most]) in lengths {
                let inside = (least - 1.5e-3..=most + 1.5e-3).contains(&length);
                assert!(
                    inside,
                    "{} {jaw}: {length} of {least} to {most}",
                    shape.name
                );
            }
            for t in (0..20).chain(50..90) {
                let frame = |clip: &LandmarkClip| {
                    clip.displacements
                        .index_axis(ndarray::Axis(0), t)
                        .to_owned()
                };
                assert_eq!(frame(&clip), frame(&before));
            }
        }
    }

    #[test]
    fn no_lip_moves_faster_than_lips_do() {
        for shape in &LIP_SHAPES {
            let clip = talk(shape.name, &open(0.4));
            let steps = &clip.displacements.slice(ndarray::s![1.., .., ..])
                - &clip.displacements.slice(ndarray::s![..-1, .., ..]);
            let fastest = steps
                .iter()
                .fold(0.0, |most: f32, step| most.max(step.abs()));
            assert!(60.0 * fastest < 0.3, "{}: {fastest}", shape.name);
        }
    }

    #[test]
    fn lips_that_have_the_shape_stay() {
        let once = talk("oo", &open(0.0));
        let twice = talk("oo", &once);
        let moved = &twice.displacements - &once.displacements;
        let middle = moved.index_axis(ndarray::Axis(0), 33).to_owned();
        assert!(middle.iter().all(|by| by.abs() < 3e-4), "{middle}");
    }
}
