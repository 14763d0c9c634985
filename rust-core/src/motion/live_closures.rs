//! Lips that close while somebody is speaking.

use std::{path::Path, sync::Arc};

use ndarray::ArrayViewMut2;

use super::{LandmarkFrame, Parting, narrow, opening};
use crate::{
    Result,
    models::BuiltIn,
    nn::elementwise::sigmoid,
    speech::{CausalModel, CausalSpeech, closure_share},
};

/// Built-in weights of the detector of closed lips.
pub static CLOSURES_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::LIVE_CLOSURES);
/// How many numbers a frame of the detector holds: the logit that the lips are together.
const DIMS: usize = 1;

/// Detects while somebody is speaking when the lips touch. A network that is trained by a squared
/// error on motion blurs p, b and m; this small one does not.
pub struct LiveClosures {
    speech: CausalSpeech,
    /// How far the lips close in the next frame, 0 to 1. `None` until that frame has been heard.
    share: Option<f32>,
    parting: Parting,
}

impl LiveClosures {
    /// The built-in detector, or that of `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`] and [`CausalModel::load`].
    pub fn open(folder: Option<&Path>) -> Result<CausalModel> {
        let files = CLOSURES_MODEL.open(folder)?;
        CausalModel::load(&files.weights, &files.config, DIMS)
    }

    /// Listens through the given further head of the model, or through its main one for `None`.
    pub fn new(model: Arc<CausalModel>, head: Option<usize>) -> LiveClosures {
        LiveClosures {
            parting: Parting::new(model.config().fps),
            speech: CausalSpeech::by(model, head),
            share: None,
        }
    }

    /// The sound that it hears.
    pub fn speech(&self) -> &CausalSpeech {
        &self.speech
    }

    /// More sound, 16 kHz.
    ///
    /// # Errors
    /// Those of [`CausalSpeech::push`].
    pub fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.speech.push(samples)
    }

    /// No more sound comes.
    ///
    /// # Errors
    /// Those of [`CausalSpeech::finish`].
    pub fn finish(&mut self) -> Result<()> {
        self.speech.finish()
    }

    /// Whether the next frame has been heard.
    pub fn is_ready(&mut self) -> bool {
        if self.share.is_none() {
            let row = self.speech.pull(|_| {});
            self.share = row.map(|row| closure_share(sigmoid(row[0])));
        }
        self.share.is_some()
    }

    /// Closes the lips in `frame`, the next one, as far as the detector asks, times `spoken`, 0 to 1.
    pub fn close(&mut self, frame: &mut LandmarkFrame, spoken: f32) {
        let share = spoken * self.share.take().unwrap_or(0.0);
        let mut face = ArrayViewMut2::from(&mut frame.displacements);
        let share = self.parting.next(opening(face.view()), share);
        narrow(&mut face, share);
    }
}
