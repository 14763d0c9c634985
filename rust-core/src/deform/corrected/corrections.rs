//! The corrections of a mesh, and a decoder together with them.

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
    /// Vertex, share and offset from the jaw's hinge (canonical centimetres) of what the jaw carries.
    pub(super) carried: Vec<(u32, f32, [f32; 3])>,
    /// By which share each landmark moves, where the face lacks a feature.
    moving: Option<Vec<f32>>,
    /// The mouth, where its rims were found.
    mouth: Option<Slit>,
    /// Where the lips are one surface.
    joined: Option<JoinedLips>,
    /// The eyes, where their lids were found.
    lids: Vec<Eyelids>,
    /// The skin about them.
    about_eyes: Untangle,
}

impl Corrections {
    /// Of a face with its surface.
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

    /// What the landmarks ask of a face that lacks what this one lacks, of lips that are as these are.
    /// `landmarks`: `[T, 68, 3]`.
    pub(super) fn asked<'a>(&self, landmarks: ArrayView3<'a, f32>) -> CowArray<'a, f32, Ix3> {
        if landmarks.dim().1 != LANDMARKS {
            return landmarks.into();
        }
        let mut asked = CowArray::from(landmarks);
        if let Some(moving) = &self.moving {
            let shares = ArrayView1::from(moving).insert_axis(Axis(1));
            asked = (&asked * &shares).into();
        }
        match &self.joined {
            Some(joined) => joined.apply(asked.view()).into(),
            None => asked,
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

    /// Closes lids, and keeps the skin about them from turning over.
    pub(super) fn shut(&self, landmarks: &[f32], frame: &mut [f32]) {
        for lids in &self.lids {
            lids.apply(landmarks, frame);
        }
        self.about_eyes.apply(frame);
    }

    /// Landmarks `[T, 68, 3]` for the decoder: lids that cannot close rest.
    pub(super) fn own_landmarks(&self, landmarks: &Array3<f32>) -> Array3<f32> {
        let mut own = landmarks.clone();
        for mut frame in own.outer_iter_mut() {
            let frame = frame.as_slice_mut().expect("standard layout");
            self.lids.iter().for_each(|lids| lids.own_landmarks(frame));
        }
        own
    }

    /// Vertices by which the openings of mouth and eyes are known, and the skin about these.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let mouth = self.mouth.iter().flat_map(Slit::rims);
        let lids = self.lids.iter().flat_map(Eyelids::rims);
        mouth.chain(lids).chain(self.about_eyes.vertices())
    }

    /// Vertices that are moved by more than the decoder and the jaw.
    pub(super) fn touched_vertices(&self) -> impl Iterator<Item = u32> {
        let mouth = self.mouth.iter().flat_map(Slit::touched_vertices);
        let lids = self.lids.iter().flat_map(Eyelids::touched_vertices);
        mouth.chain(lids).chain(self.about_eyes.vertices())
    }

    /// Moves what follows the jaw.
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
    /// What the decoder makes of landmarks `[T, 68, 3]`, with displacements `[T, V, 3]` beside it, corrected.
    pub(super) fn corrected(
        &self,
        landmarks: ArrayView3<'_, f32>,
        beside: Option<&Array3<f32>>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let asked = self.corrections.asked(landmarks);
        let landmarks = asked.as_standard_layout().into_owned();
        let own = self.corrections.own_landmarks(&landmarks);
        let mut out = self.decoder.deform(own.view(), progress)?;
        if let Some(beside) = beside {
            out += beside;
        }
        self.each_frame(landmarks.view(), &mut out, |landmarks, frame| {
            self.corrections.apply(landmarks, frame);
        });
        Ok(out)
    }

    /// Hands every frame of `moved` `[T, V, 3]` with its landmarks to `correct`.
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
