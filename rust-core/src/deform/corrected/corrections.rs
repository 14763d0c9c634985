//! The corrections of a mesh, and a decoder whose frames they correct.

use ndarray::{Array3, ArrayView1, ArrayView3, Axis, CowArray, Ix3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    Result,
    deform::{
        contact::{Slit, mouth_slit},
        eyelids::{Eyelids, eyelids},
        jaw::{Jaw, JawPose},
        joined_lips::JoinedLips,
        untangle::Untangle,
    },
    face::{Deformer, Face, FaceSurface, binding::Follows},
    job::ProgressFn,
    mesh::{Mouth, Similarity, ibug::LANDMARKS},
};

/// Corrections of one mesh, applied to every frame that a decoder made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Corrections {
    pub(super) to_canonical: Similarity,
    jaw: Jaw,
    /// The vertices that the jaw carries: number, share and offset from its hinge (canonical
    /// centimetres).
    pub(super) carried: Vec<(u32, f32, [f32; 3])>,
    /// The share by which each landmark moves; `None` for a face with all features.
    moving: Option<Vec<f32>>,
    /// The slit of the mouth; `None` if its lips are one surface or it does not have two rims.
    mouth: Option<Slit>,
    /// Lips that are one surface.
    joined: Option<JoinedLips>,
    /// The lids of the eyes that have them.
    lids: Vec<Eyelids>,
    /// The skin around the eyes.
    about_eyes: Untangle,
}

impl Corrections {
    /// The corrections that this face needs.
    pub fn new(face: &Face, surface: &FaceSurface) -> Corrections {
        let to_canonical = &face.to_canonical;
        let FaceSurface {
            positions,
            landmarks,
            skin,
            follows,
        } = surface;
        let jaw = Jaw::of(landmarks);
        let from_hinge = |p: [f32; 3]| std::array::from_fn(|i| p[i] - jaw.hinge[i]);
        let carried = follows.iter().zip(positions).enumerate();
        let carried = carried.filter_map(|(v, (follows, &p))| match *follows {
            Follows::Jaw(share) => Some((v as u32, share, from_hinge(p))),
            _ => None,
        });
        let features = face.features();
        let can_part = face.mouth() != Mouth::Welded;
        let rims = || mouth_slit(skin, landmarks, follows, to_canonical);
        let lids = eyelids(face, surface);
        let edges: Vec<u32> = lids.iter().flat_map(Eyelids::edges).collect();
        Corrections {
            about_eyes: Untangle::new(surface, &face.mesh.positions, &edges),
            mouth: can_part.then(rims).flatten(),
            joined: JoinedLips::of(face.mouth(), landmarks),
            lids,
            to_canonical: *to_canonical,
            carried: carried.collect(),
            moving: (!features.are_all()).then(|| features.of_landmarks().to_vec()),
            jaw,
        }
    }

    /// The corrections of `vertices` alone, in ascending order; the rims must be among them.
    pub(super) fn of_vertices(&self, vertices: &[u32]) -> Corrections {
        let new = |v: u32| vertices.binary_search(&v).ok().map(|at| at as u32);
        let carried = self.carried.iter();
        Corrections {
            carried: carried
                .filter_map(|&(v, share, from)| Some((new(v)?, share, from)))
                .collect(),
            mouth: self.mouth.as_ref().map(|slit| slit.renumbered(new)),
            lids: self.lids.iter().map(|lids| lids.renumbered(new)).collect(),
            about_eyes: self.about_eyes.renumbered(new),
            ..self.clone()
        }
    }

    /// Landmarks `[T, 68, 3]` without the motion that this face cannot show: features that it lacks
    /// stay at rest, and lips that are one surface move as one.
    pub(super) fn adapt_landmarks<'a>(
        &self,
        landmarks: ArrayView3<'a, f32>,
    ) -> CowArray<'a, f32, Ix3> {
        if landmarks.dim().1 != LANDMARKS {
            return landmarks.into();
        }
        let mut adapted = CowArray::from(landmarks);
        if let Some(moving) = &self.moving {
            let shares = ArrayView1::from(moving).insert_axis(Axis(1));
            adapted = (&adapted * &shares).into();
        }
        match &self.joined {
            Some(joined) => joined.apply(adapted.view()).into(),
            None => adapted,
        }
    }

    /// Corrects the displacements of one frame, `[V * 3]`; `landmarks`: `[204]`. Mesh units.
    pub(super) fn apply(&self, landmarks: &[f32], frame: &mut [f32]) {
        self.carry(landmarks, frame);
        if let Some(slit) = &self.mouth {
            slit.apply(landmarks, frame);
        }
        self.shut(landmarks, frame);
    }

    /// Closes the lids, and keeps the skin around them from turning inside out.
    pub(super) fn shut(&self, landmarks: &[f32], frame: &mut [f32]) {
        for lids in &self.lids {
            lids.apply(landmarks, frame);
        }
        self.about_eyes.apply(frame);
    }

    /// The landmarks `[T, 68, 3]` for the decoder: landmarks that move no skin of this face stay at rest.
    pub(super) fn landmarks_for_decoder(&self, landmarks: &Array3<f32>) -> Array3<f32> {
        let mut for_decoder = landmarks.clone();
        for mut frame in for_decoder.outer_iter_mut() {
            let frame = frame.as_slice_mut().expect("standard layout");
            self.lids.iter().for_each(|lids| lids.clear_silent(frame));
        }
        for_decoder
    }

    /// Vertices from which the openings of mouth and eyes are computed, and the skin around the eyes.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let mouth = self.mouth.iter().flat_map(Slit::rims);
        let lids = self.lids.iter().flat_map(Eyelids::rims);
        mouth.chain(lids).chain(self.about_eyes.vertices())
    }

    /// Vertices that the corrections of mouth and eyes move, after the decoder and the jaw.
    pub(super) fn touched_vertices(&self) -> impl Iterator<Item = u32> {
        let mouth = self.mouth.iter().flat_map(Slit::touched_vertices);
        let lids = self.lids.iter().flat_map(Eyelids::touched_vertices);
        mouth.chain(lids).chain(self.about_eyes.vertices())
    }

    /// Moves the vertices that follow the jaw.
    fn carry(&self, landmarks: &[f32], frame: &mut [f32]) {
        if self.carried.is_empty() {
            return;
        }
        let pose = self.pose(landmarks);
        let back = self.to_canonical.inverse();
        let to_mesh = 0.01 * back.scale as f32;
        for &(v, share, from_hinge) in &self.carried {
            let moved = back.rotate(pose.displacement(from_hinge));
            let target = &mut frame[3 * v as usize..3 * v as usize + 3];
            for (to, from) in target.iter_mut().zip(moved) {
                *to = share * to_mesh * from;
            }
        }
    }

    pub(super) fn pose(&self, landmarks: &[f32]) -> JawPose {
        let to_cm = 100.0 * self.to_canonical.scale as f32;
        let canonical = std::array::from_fn(|n| {
            let moved = [0, 1, 2].map(|i| landmarks[3 * n + i]);
            self.to_canonical.rotate(moved).map(|x| to_cm * x)
        });
        self.jaw.pose(&canonical)
    }
}

/// A decoder with the corrections of its mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Corrected<D> {
    /// Makes the frames.
    pub decoder: D,
    /// Corrects them.
    pub corrections: Corrections,
}

impl<D: Deformer> Corrected<D> {
    /// Decodes landmarks `[T, 68, 3]`, adds the displacements `beside` `[T, V, 3]` and corrects the sum.
    pub(super) fn corrected(
        &self,
        landmarks: ArrayView3<'_, f32>,
        beside: Option<&Array3<f32>>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let adapted = self.corrections.adapt_landmarks(landmarks);
        let landmarks = adapted.as_standard_layout().into_owned();
        let for_decoder = self.corrections.landmarks_for_decoder(&landmarks);
        let mut out = self.decoder.deform(for_decoder.view(), progress)?;
        if let Some(beside) = beside {
            out += beside;
        }
        self.each_frame(landmarks.view(), &mut out, |landmarks, frame| {
            self.corrections.apply(landmarks, frame);
        });
        Ok(out)
    }

    /// Calls `correct` with the landmarks and the displacements of every frame of `moved` `[T, V, 3]`.
    pub(super) fn each_frame(
        &self,
        landmarks: ArrayView3<'_, f32>,
        moved: &mut Array3<f32>,
        correct: impl Fn(&[f32], &mut [f32]) + Sync,
    ) {
        let landmarks = landmarks.as_standard_layout();
        let frames = landmarks.axis_iter(Axis(0)).into_par_iter();
        frames
            .zip(moved.axis_iter_mut(Axis(0)).into_par_iter())
            .for_each(|(landmarks, mut frame)| {
                let landmarks = landmarks.as_slice().expect("standard layout");
                let frame = frame
                    .as_slice_mut()
                    .expect("decoders give row-major frames");
                correct(landmarks, frame);
            });
    }
}
