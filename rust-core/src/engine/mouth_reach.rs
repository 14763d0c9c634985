//! Says in words what a mouth cannot show of speech. It measures the moved mesh, so the names of
//! the parts do not matter.

use ndarray::{Array3, ArrayView2, Axis, s};

use crate::{
    Engine, Result,
    face::{Face, MouthTrial},
    job::ProgressFn,
    mesh::{FrontView, Mouth, PartRole},
    motion::{FaceModes, LandmarkClip, Motion},
    speech::{LipClosures, LipContacts, LipShapes},
    spread::Collector,
};

/// Inner-lip landmarks that face each other, upper and lower.
const PAIRS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];
/// Outer landmarks of the upper and of the lower lip, without the corners.
const OUTER: [std::ops::Range<usize>; 2] = [49..54, 55..60];

/// The jaw is open by this share of [`MouthTrial::jaw_drop`] before a contact: 8 mm.
const OPEN_BEFORE: f32 = 0.4;
/// Frames of the trial motion. The contact is in the middle.
const FRAMES: usize = 15;
const FPS: f64 = 25.0;

/// If the lips part by less than this share of what the landmarks do, they show no open vowel.
const LEAST_PARTED: f32 = 0.5;
/// Lips farther apart than this in p, b, m look open, metres on a human head. The lips of the
/// default head meet within 0.5 mm.
const MAX_APART_M: f32 = 2.5e-3;
/// A lower lip farther from the upper teeth than this in f and v does not seem to touch them,
/// metres on a human head.
const MAX_FROM_TEETH_M: f32 = 6e-3;
/// A lip is hidden if something lies in front of most of its landmarks by more than this, metres on
/// a human head.
const BEFORE_M: f32 = 6e-3;
/// Side of a cell of the front view, metres.
const CELL_M: f32 = 5e-4;
/// How far the front view extends beyond the mouth, metres.
const BEYOND_M: f32 = 0.02;

/// How far the lips of a face can move in speech. Lengths are metres on a human head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MouthReach {
    /// How far the lips part when the jaw drops, as a share of what the landmarks do.
    pub parted: f32,
    /// Distance between the lips in p, b, m.
    pub apart_m: f32,
    /// Distance from the lower lip to the upper teeth in f and v, or to the upper lip if there are
    /// no teeth.
    pub from_teeth_m: f32,
    /// Whether the mouth contains something that may be upper teeth.
    pub has_teeth: bool,
    /// Whether something hides the upper lip, and the lower lip, from the front.
    pub hidden: [bool; 2],
}

impl MouthReach {
    /// One sentence for each thing that the mouth cannot show. Empty if it shows everything.
    pub fn sentences(&self) -> Vec<String> {
        let mm = |metres: f32| 1000.0 * metres;
        let mut sentences = Vec::new();
        if self.parted < LEAST_PARTED {
            sentences.push(format!(
                "the lips part by {:.0} % of what the jaw does: open vowels look half shut",
                100.0 * self.parted.max(0.0)
            ));
        }
        if self.apart_m > MAX_APART_M {
            sentences.push(format!(
                "the lips stay {:.0} mm apart where they should meet: p, b and m look like a mouth that is a little open",
                mm(self.apart_m)
            ));
        }
        if self.from_teeth_m > MAX_FROM_TEETH_M {
            let goal = if self.has_teeth {
                "the upper teeth"
            } else {
                "the upper lip, and no upper teeth were found"
            };
            sentences.push(format!(
                "the lower lip does not reach {goal} ({:.0} mm are left): f and v look like a half-open mouth",
                mm(self.from_teeth_m)
            ));
        }
        let lips = match self.hidden {
            [true, true] => Some("the lips"),
            [true, false] => Some("the upper lip"),
            [false, true] => Some("the lower lip"),
            [false, false] => None,
        };
        sentences.extend(lips.map(|lips| {
            format!(
                "something lies before {lips}: what happens behind it is not seen from the front"
            )
        }));
        sentences
    }
}

impl Engine {
    /// Measures how far the lips of a face can move: the jaw drops, the lips close from an open
    /// mouth, and the lower lip goes to the teeth. `None` if the lips are one surface;
    /// [`Mouth::sentence`] describes that case.
    ///
    /// On a face that is not human, lengths are scaled to a human head.
    ///
    /// # Errors
    /// Those of [`Engine::prepare`].
    pub fn mouth_reach(&self, face: &Face, progress: ProgressFn<'_>) -> Result<Option<MouthReach>> {
        if face.mouth() == Mouth::Welded {
            return Ok(None);
        }
        let [drop, closed, at_teeth] = poses(&self.shared.face_modes)?;
        let mut displacements = Array3::zeros((3, drop.nrows(), 3));
        for (mut frame, pose) in displacements
            .outer_iter_mut()
            .zip([&drop, &closed, &at_teeth])
        {
            frame.assign(pose);
        }
        let motion = Motion::Landmarks(LandmarkClip {
            displacements,
            fps: FPS,
        });
        let clip = Collector::collect(|sink| self.spread(face, &motion, sink, progress))?;
        let moved = clip.vertices.displacements;
        let still = Array3::zeros((1, moved.dim().1, 3));
        let at = |k: usize| moved.index_axis(Axis(0), k);
        let height =
            |frame| -> f32 {
                median(PAIRS.map(|(upper, lower)| {
                    mark(face, frame, upper)[1] - mark(face, frame, lower)[1]
                }))
            };
        let dropped_m = drop[[62, 1]] - drop[[66, 1]];
        let (from_teeth_m, has_teeth) = from_teeth(face, at(2));
        Ok(Some(MouthReach {
            parted: (height(at(0)) - height(still.index_axis(Axis(0), 0))) / dropped_m,
            apart_m: median(PAIRS.map(|(upper, lower)| {
                distance(mark(face, at(1), upper), mark(face, at(1), lower))
            })),
            from_teeth_m,
            has_teeth,
            hidden: hidden(face),
        }))
    }
}

/// Three canonical motions of the landmarks `[68, 3]`, metres: the jaw dropped and, from an open
/// mouth, the lips together and the lower lip at the teeth. The contacts are made as in every
/// system.
fn poses(modes: &FaceModes) -> Result<[ndarray::Array2<f32>; 3]> {
    let drop = MouthTrial::jaw_drop().index_axis_move(Axis(0), 0);
    let open = OPEN_BEFORE * &drop;
    let middle = FRAMES / 2;
    let (mut heard, silent) = ([0.0; FRAMES], [0.0; FRAMES]);
    heard[middle - 1..=middle + 1].fill(0.9);
    let contact = |together: &[f32], at_teeth: &[f32]| -> Result<ndarray::Array2<f32>> {
        let contacts = LipContacts {
            together: LipClosures::heard(together, FPS),
            at_teeth: LipClosures::heard(at_teeth, FPS),
            shapes: LipShapes::none(),
        };
        let mut displacements = Array3::zeros((FRAMES, open.nrows(), 3));
        displacements
            .outer_iter_mut()
            .for_each(|mut frame| frame.assign(&open));
        let mut clip = LandmarkClip {
            displacements,
            fps: FPS,
        };
        clip.make_contacts(&contacts, modes)?;
        Ok(clip.displacements.slice(s![middle, .., ..]).to_owned())
    };
    let (closed, at_teeth) = (contact(&heard, &silent)?, contact(&silent, &heard)?);
    Ok([drop, closed, at_teeth])
}

/// The position of a landmark in a frame `[V, 3]`, canonical metres.
fn mark(face: &Face, frame: ArrayView2<'_, f32>, n: usize) -> [f32; 3] {
    let moved = frame.row(face.landmarks.vertices[n] as usize);
    let place = face.landmarks.positions[n];
    face.to_canonical
        .apply(std::array::from_fn(|i| place[i] + moved[i]))
}

/// The distance from the lower lip to the nearest vertex in the mouth that follows the skull, and
/// whether there is such a vertex. If there is none, the distance is to the upper lip.
fn from_teeth(face: &Face, frame: ArrayView2<'_, f32>) -> (f32, bool) {
    let place = |v: usize| {
        let (p, d) = (face.mesh.positions[v], frame.row(v));
        face.to_canonical
            .apply(std::array::from_fn(|i| p[i] + d[i]))
    };
    let [right, left, nose] = [48, 54, 33].map(|n| mark(face, frame, n));
    let in_mouth = |p: &[f32; 3]| p[0] > right[0] && p[0] < left[0] && p[1] < nose[1];
    let skull = (0..face.mesh.positions.len()).filter(|&v| face.parts.is(v, PartRole::Skull));
    let teeth: Vec<[f32; 3]> = skull.map(place).filter(in_mouth).collect();
    let has_teeth = !teeth.is_empty();
    let goal = if has_teeth {
        teeth
    } else {
        PAIRS.map(|(upper, _)| mark(face, frame, upper)).to_vec()
    };
    let nearest = PAIRS.map(|(_, lower)| {
        let lip = mark(face, frame, lower);
        goal.iter()
            .map(|p| distance(lip, *p))
            .fold(f32::INFINITY, f32::min)
    });
    (median(nearest), has_teeth)
}

/// Whether something lies in front of most of the upper lip, and of the lower lip, at rest.
fn hidden(face: &Face) -> [bool; 2] {
    let places: Vec<[f32; 3]> = face
        .mesh
        .positions
        .iter()
        .map(|p| face.to_canonical.apply(*p))
        .collect();
    let marks = face.landmarks.positions.map(|p| face.to_canonical.apply(p));
    let bound = |pick: fn(f32, f32) -> f32, start: f32, beyond: f32| -> [f32; 2] {
        std::array::from_fn(|i| marks[48..60].iter().map(|p| p[i]).fold(start, pick) + beyond)
    };
    let low = bound(f32::min, f32::INFINITY, -BEYOND_M);
    let high = bound(f32::max, f32::NEG_INFINITY, BEYOND_M);
    let mut view = FrontView::new(low, high, CELL_M);
    for t in &face.mesh.triangles {
        view.draw(t.map(|v| places[v as usize]), 1);
    }
    OUTER.map(|lip| {
        let is_hidden = |n: &usize| {
            let [x, y, z] = marks[*n];
            let [column, row] = view.cell_at([x, y]);
            view.depth(column, row) > z + BEFORE_M
        };
        2 * lip.clone().filter(is_hidden).count() > lip.len()
    })
}

fn median(mut values: [f32; 3]) -> f32 {
    values.sort_by(f32::total_cmp);
    values[1]
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: MouthReach = MouthReach {
        parted: 1.0,
        apart_m: 5e-4,
        from_teeth_m: 2e-3,
        has_teeth: true,
        hidden: [false; 2],
    };

    #[test]
    fn a_mouth_that_shows_all_says_nothing() {
        assert_eq!(WHOLE.sentences(), Vec::<String>::new());
    }

    #[test]
    fn each_limit_has_its_sentence() {
        let open = MouthReach {
            apart_m: 7e-3,
            from_teeth_m: 0.011,
            ..WHOLE
        };
        let said = open.sentences();
        assert_eq!(said.len(), 2);
        assert!(said[0].contains("stay 7 mm apart"), "{said:?}");
        assert!(
            said[1].contains("does not reach the upper teeth (11 mm"),
            "{said:?}"
        );
        let toothless = MouthReach {
            has_teeth: false,
            ..open
        };
        assert!(toothless.sentences()[1].contains("no upper teeth were found"));
        let bearded = MouthReach {
            hidden: [false, true],
            parted: 0.1,
            ..WHOLE
        };
        let said = bearded.sentences();
        assert!(said[0].contains("part by 10 %") && said[1].contains("before the lower lip"));
    }
}
