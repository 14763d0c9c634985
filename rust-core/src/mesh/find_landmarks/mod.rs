//! Finds the 68 landmarks of a head that is given upright and facing a stated axis.
//!
//! 1. *Search*: depth pictures of the whole mesh and of ever smaller windows under its top; the
//!    network says which shows a face, and where.
//! 2. *Lift*: landmarks of a close front view are put on the visible surface, which gives the
//!    head's pose and size.
//! 3. *Consensus*: in the head's own frame, three views at −40°, 0° and 40° see the landmarks, also
//!    those that face away; rays of the three meet in space (after Paulsen et al. 2018,
//!    "Multi-view Consensus CNN for 3D Facial Landmark Placement", with three fixed views and
//!    depth in place of many views and colour). Twice, the second time in the better frame.
//! 4. *Snap*: to the nearest skin, inner-lip landmarks to their own lip.

mod consensus;
mod depth_view;
mod network;
mod search;
mod view;

use std::{path::Path, sync::OnceLock};

use self::{
    consensus::{agree, lift},
    network::{Config, LandmarkNetwork},
    search::search,
    view::{Frame, stated_frame},
};
use super::{Axis, Landmarks, Mesh, Similarity, canonical, snap::snap_to_surface};
use crate::{Error, Result, motion::LANDMARKS, nn::Weights, weights::ModelFiles};

const MODEL: &str = "landmarks";

/// Mean confidence below which the views saw no face; found human heads lie above 0.7.
const LEAST_CONFIDENCE: f32 = 0.35;

/// Finds landmarks; holds the network's weights. Cheap to share, any number of threads may use it.
pub struct LandmarkFinder {
    network: LandmarkNetwork,
}

impl LandmarkFinder {
    /// The finder with the embedded weights, loaded once.
    ///
    /// # Errors
    /// `Weights` if the embedded files are damaged.
    pub fn embedded() -> Result<&'static LandmarkFinder> {
        static FINDER: OnceLock<LandmarkFinder> = OnceLock::new();
        if let Some(finder) = FINDER.get() {
            return Ok(finder);
        }
        let finder = Self::load(None)?;
        Ok(FINDER.get_or_init(|| finder))
    }

    /// A finder with the model in `folder/landmarks` if that exists, else the built-in one.
    ///
    /// # Errors
    /// `Io` if one of the model's two files is missing, `Weights` if one is damaged or does not
    /// fit the other, or `folder` does not exist.
    pub fn load(folder: Option<&Path>) -> Result<LandmarkFinder> {
        let files = ModelFiles::open(MODEL, folder)?;
        let weights = Weights::from_bytes(&files.weights)?;
        let network = LandmarkNetwork::load(&weights, &Config::parse(&files.config)?)?;
        Ok(LandmarkFinder { network })
    }

    /// The landmarks of a head that looks along `forward` with its top towards `up`, in any units
    /// and any place; 20° off is fine. Neck, shoulders, a body, hair, eyes and teeth may be there.
    ///
    /// # Errors
    /// `FaceNotFound` with what was seen and what would help; `InvalidInput` if the axes are the
    /// same line; `Mesh` for a mesh that cannot be used.
    pub fn find(&self, mesh: &Mesh, forward: Axis, up: Axis) -> Result<Landmarks> {
        mesh.check()?;
        let frame = stated_frame(mesh, forward, up)?;
        self.find_in(mesh, &frame)
            .map_err(|why| Error::FaceNotFound(self.advice(mesh, forward, up, &why)))
    }

    /// The way described above; the error says why it stopped.
    fn find_in(&self, mesh: &Mesh, frame: &Frame) -> std::result::Result<Landmarks, String> {
        let seen = search(&self.network, frame).ok_or("no view shows a face")?;
        let mut to_canonical = lift(&self.network, frame, &seen)
            .ok_or("the surface behind the landmarks does not have the shape of a face")?;
        let mut agreed = agree(&self.network, frame, &to_canonical);
        for _ in 0..2 {
            to_canonical = agreed.fit(&to_canonical).ok_or("the views disagree")?;
            agreed = agree(&self.network, frame, &to_canonical);
        }
        let mean = agreed.confidence.iter().sum::<f32>() / LANDMARKS as f32;
        if mean < LEAST_CONFIDENCE {
            return Err(format!(
                "the best place has confidence {mean:.2}, expected {LEAST_CONFIDENCE} or more"
            ));
        }
        let to_mesh = to_canonical.compose(&frame.from_mesh).inverse();
        let mut landmarks = snap_to_surface(mesh, &agreed.positions.map(|p| to_mesh.apply(p)));
        landmarks.confidence = agreed.confidence;
        let fit = canonical::fit_to_canonical(&landmarks.positions, Some(&landmarks.confidence))
            .map_err(|error| error.to_string())?;
        canonical::check(&fit).map_err(|_| "what was found does not have the shape of a face")?;
        Ok(landmarks)
    }

    /// Why there is no face, and what would help: other axes are tried so as to name them.
    fn advice(&self, mesh: &Mesh, forward: Axis, up: Axis, why: &str) -> String {
        let stated = format!("looked along {forward} with {up} up: {why}");
        let better = Axis::ALL
            .iter()
            .flat_map(|f| Axis::ALL.iter().map(move |u| (*f, *u)))
            .filter(|(f, u)| (*f, *u) != (forward, up))
            .find(|(f, u)| {
                stated_frame(mesh, *f, *u).is_ok_and(|frame| self.find_in(mesh, &frame).is_ok())
            });
        match better {
            Some((f, u)) => {
                format!("{stated}; a face looks along {f} with {u} up: state these axes")
            }
            None => format!(
                "{stated}; no other axis shows one either. Give a mesh with a head of its own, \
                 upright, or the 68 landmarks"
            ),
        }
    }
}

/// The face's own frame for views: canonical metres as far as they are known.
fn turned(frame: &Frame, to_canonical: &Similarity) -> Vec<[f32; 3]> {
    frame
        .points
        .iter()
        .map(|p| to_canonical.apply(*p))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truncated_model_in_a_folder_is_a_weights_error() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join(MODEL);
        std::fs::create_dir(&model).unwrap();
        let files = ModelFiles::open(MODEL, None).unwrap();
        std::fs::write(model.join("config.json"), files.config.as_bytes()).unwrap();
        let missing = LandmarkFinder::load(Some(folder.path()));
        assert!(matches!(missing, Err(Error::Io { .. })));
        let half = &files.weights[..files.weights.len() / 2];
        std::fs::write(model.join("model.safetensors"), half).unwrap();
        let truncated = LandmarkFinder::load(Some(folder.path()));
        assert!(matches!(truncated, Err(Error::Weights(_))));
    }
}
