//! FreeTalk as a [`System`]: turns speech into landmark motion, applies an artist's controls, and
//! streams.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use ndarray::{Array2, Array3};

use super::{
    AtsRequest,
    ats::{Ats, AtsConfig},
    stm::{self, paper::PaperDecoder},
    stream::{CausalStream, DIMS},
};
use crate::{
    Result,
    cache::Cache,
    conditions::{Control, ControlStage, ControlValues, Controls, EmotionCurve, NOISE, STEPS},
    deform::{Decoder, LEARNED},
    face::{Deformer, Face},
    job::ProgressFn,
    mesh::ibug::LANDMARKS,
    models::{BuiltIn, Opened},
    motion::{
        CLOSURES_MODEL, CausalExpression, EmotionOrigin, Expressions, FaceModes, LandmarkClip,
        LandmarkController, LiveClosures, Motion, MotionKind, MotionRequest, MotionStream,
        PERFORMANCE_CONTROLS, WidthGain,
    },
    speech::{CausalModel, CausalSpeech, SpeechFeatures},
    systems::{Ability, Description, Registration, Sampled, Slider, System},
};

/// Built-in weights of the denoiser.
pub static ATS_MODEL: BuiltIn = BuiltIn::sized(&anyface_weights_freetalk::ATS_COMPACT, "ats");
/// Built-in weights of the stream.
pub static STREAM_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_freetalk::STREAM);
static PAPER_MODEL: BuiltIn = BuiltIn::sized(&anyface_weights_freetalk::STM_PAPER, "stm");

/// Chooses the decoder that spreads landmark motion over a mesh.
static DECODER: Control = Control {
    name: "decoder",
    label: "Decoder",
    help: "What spreads motion over the mesh: weights that are computed once for it (static), or the \
           paper's decoder, which runs for every frame (paper).",
    values: ControlValues::Choice(&["static", "paper"]),
    high: 1.0,
    stage: ControlStage::Face,
    ..STEPS
};

static OWN_CONTROLS: &[Control] = &[STEPS, NOISE, LEARNED, DECODER];

/// FreeTalk in the registry.
pub static REGISTRATION: Registration = Registration {
    name: "freetalk",
    label: "FreeTalk",
    help: "Speech, emotion and intensity move 68 landmarks, which move the mesh.",
    models: &[&ATS_MODEL, &STREAM_MODEL, &CLOSURES_MODEL, &PAPER_MODEL],
    controls: &[PERFORMANCE_CONTROLS, OWN_CONTROLS],
    motion: MotionKind::Landmarks,
    abilities: &[Ability::Performer],
    emotion: None,
    sliders: &Slider::ALL,
    second_bytes: 274_000,
    open: |folder| Ok(Box::new(FreeTalk::open(folder)?)),
};

/// The denoiser, and everything that turns its motion into a performance.
pub struct FreeTalk {
    ats: Opened<Ats>,
    config: AtsConfig,
    stream: Arc<CausalModel>,
    closures: Arc<CausalModel>,
    modes: Arc<FaceModes>,
    expressions: Arc<Expressions>,
    /// The paper's decoder, loaded at its first use.
    paper: OnceLock<Arc<PaperDecoder>>,
    folder: Option<PathBuf>,
}

impl FreeTalk {
    /// Loads the built-in models, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let ats = Opened::of(&ATS_MODEL, folder, || {
            let files = ATS_MODEL.open(folder)?;
            Ats::load(&files.weights, &files.config)
        })?;
        let config = match ats.get() {
            Ok(ats) => ats.config().clone(),
            Err(_) => AtsConfig::from_json(ATS_MODEL.config)?,
        };
        let files = STREAM_MODEL.open(folder)?;
        Ok(FreeTalk {
            ats,
            config,
            stream: Arc::new(CausalModel::load(&files.weights, &files.config, DIMS)?),
            closures: Arc::new(LiveClosures::open(folder)?),
            modes: Arc::new(FaceModes::open(folder)?),
            expressions: Arc::new(Expressions::open(folder)?),
            paper: OnceLock::new(),
            folder: folder.map(Path::to_owned),
        })
    }

    /// Speech at the denoiser's own frame rate, without a performer and contacts.
    fn spoken(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let fps = self.config.fps;
        let features = heard.features(fps);
        let emotion = match self.config.emotion {
            EmotionOrigin::Learned => &request.emotion,
            EmotionOrigin::Added => &EmotionCurve::Off,
        };
        let affect = emotion.sample(features.nrows(), fps);
        let affect = self.expressions.eased(affect, fps, request.onset());
        let steps = STEPS.value(&request.controls) as usize;
        let displacements = self.ats.get()?.sample(
            &AtsRequest {
                speech: features.view(),
                affect: affect.view(),
                style: request.style.as_deref(),
                seed: request.seed,
                steps: (steps > 0).then_some(steps),
                temperature: Some(
                    NOISE.value(&request.controls) * self.config.sampling.temperature,
                ),
            },
            progress,
        )?;
        Ok(LandmarkClip { displacements, fps })
    }

    fn paper(&self) -> Result<Arc<PaperDecoder>> {
        if let Some(paper) = self.paper.get() {
            return Ok(Arc::clone(paper));
        }
        let files = PAPER_MODEL.open(self.folder.as_deref())?;
        let paper = PaperDecoder::load(&files.weights, &files.config)?;
        Ok(Arc::clone(self.paper.get_or_init(|| Arc::new(paper))))
    }
}

impl System for FreeTalk {
    fn description(&self) -> Description<'_> {
        let config = &self.config;
        Description {
            speech: Some(&config.speech),
            emotion: config.emotion,
            styles: &config.styles,
            windows: Some(config.windows()),
        }
    }

    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled> {
        let clip = self.spoken(heard, request, progress)?;
        let frames = heard.frames(request.fps);
        let mut clip = clip.at_rate(request.fps, frames);
        // The gain of the width is that of the model's own speaker.
        let said = clip.widths();
        request.add_performer(&mut clip, (heard, self.config.fps), false)?;
        let closes = self.config.closes_lips(request.style.as_deref());
        let touches = closes || request.closures.is_some();
        let contacts = touches.then(|| heard.contacts(request.closures.as_deref()));
        if let Some(contacts) = &contacts {
            if closes && self.config.emotion == EmotionOrigin::Added {
                clip.widen(&said, &self.modes)?;
            }
            clip.take_shapes(contacts, &self.modes)?;
        }
        request.add_performer(&mut clip, (heard, self.config.fps), true)?;
        if let Some(contacts) = &contacts {
            clip.touch(contacts, &self.modes)?;
        }
        Ok(Motion::Landmarks(clip).into())
    }

    fn own_speaker(
        &self,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let mut request = MotionRequest::default();
        request.controls.set(NOISE.name, 0.0);
        self.spoken(heard, &request, progress)
    }

    fn live_speaker(&self, samples: &[f32]) -> Result<Option<(Array2<f32>, LandmarkClip)>> {
        let mut speech = CausalSpeech::new(Arc::clone(&self.stream));
        speech.push(samples)?;
        speech.finish()?;
        let (mut features, mut rows) = (Vec::new(), Vec::new());
        while let Some(row) = speech.pull(|_| {}) {
            rows.extend_from_slice(row);
            features.extend_from_slice(speech.hidden());
        }
        let frames = rows.len() / DIMS;
        let clip = LandmarkClip {
            displacements: Array3::from_shape_vec((frames, LANDMARKS, 3), rows)
                .expect("whole rows"),
            fps: self.stream.config().fps,
        };
        let size = (frames, speech.hidden().len());
        let features = Array2::from_shape_vec(size, features).expect("as many features each");
        Ok(Some((features, clip)))
    }

    fn apply_controls(
        &self,
        sampled: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let controller = LandmarkController {
            modes: &self.modes,
            expressions: &self.expressions,
            emotion_origin: self.config.emotion,
            prosody: &heard.prosody,
        };
        controller.apply(sampled, request, &request.emotion, blink_emotion)
    }

    fn decoder(&self, controls: &Controls) -> Option<&dyn Decoder> {
        (DECODER.value(controls) != DECODER.default).then_some(self)
    }

    fn stream(&self) -> Option<Box<dyn MotionStream>> {
        let (expressions, modes) = (Arc::clone(&self.expressions), Arc::clone(&self.modes));
        let width = WidthGain::new(&modes).ok()?;
        let expression =
            CausalExpression::new(expressions, modes, self.stream.config().fps).ok()?;
        Some(Box::new(CausalStream::new(
            Arc::clone(&self.stream),
            Arc::clone(&self.closures),
            expression,
            width,
        )))
    }
}

impl Decoder for FreeTalk {
    fn prepare(
        &self,
        face: &Face,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Arc<dyn Deformer>> {
        let deformer = stm::prepare_paper(self.paper()?, face, cache, progress)?;
        Ok(Arc::new(deformer))
    }
}
