//! EmoFace as a [`System`]: turns speech and its emotion into motion of a template and landmarks.

use std::{
    path::Path,
    sync::{Arc, OnceLock},
};

use ndarray::{Array1, Array2, Array3, ArrayView1, ArrayView2};

use super::{
    EmoFaceConfig, HeardFrame, Layer, Model,
    emotion_source::EmotionSource,
    read_template,
    stream::{EASING, EmoFaceStream, LiveParts, faded_features, known, landmarks, said_width},
};
use crate::{
    Error, Result,
    cache::Cache,
    conditions::{Control, ControlStage, ControlValues, Controls, EMOTIONS, Emotion, EmotionCurve},
    deform::{CodeSpace, LEARNED},
    face::{CodeField, Face, Field},
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
    models::{BuiltIn, Weights},
    motion::{
        self, CLOSURES_MODEL, CodeClip, EmotionOrigin, Expressions, FaceModes, LandmarkClip,
        LandmarkController, LiveClosures, Motion, MotionKind, MotionRequest, MotionStream,
        PERFORMANCE_CONTROLS, Template, TemplateMask, WidthGain, style_number,
    },
    speech::{CausalModel, EAR_MODEL, EmotionEar, HeardEmotion, SpeechFeatures},
    spread::TemplateOnFace,
    systems::{
        Ability, Description, EmotionControls, EmotionMask, Registration, Sampled, Slider, System,
    },
};

/// Built-in weights.
pub static MODEL: BuiltIn = BuiltIn::sized(&anyface_weights_emoface::EMOFACE_COMPACT, "emoface");
/// The causal twin of the content encoder, for streams.
static CAUSAL_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_emoface::CAUSAL_SPEECH);

const VOICE: usize = 0;
const EMOTION: usize = 1;
/// The value of [`LAYER`] for speech alone.
const CONTENT: f32 = 1.0;

/// The source of the emotion features.
static EMOTION_FROM: Control = Control {
    name: "emotion_from",
    label: "Emotion From",
    help: "The source of the emotion: the chosen emotion, else this voice or the other recording (voice); always \
           the chosen emotion, even if it is none (emotion); or no emotion (off).",
    values: ControlValues::Choice(&["voice", "emotion", "off"]),
    high: 2.0,
    default: 0.0,
    neutral: 0.0,
    stage: ControlStage::Motion,
    ..LEARNED
};

/// The level `l` of emotion.
static LEVEL: Control = Control {
    name: "emotion_level",
    label: "Emotion Level",
    help: "How strongly the emotion shows; 1 as listeners agreed on it, 0 not at all.",
    values: ControlValues::Real,
    high: 1.5,
    default: 1.0,
    neutral: 1.0,
    ..EMOTION_FROM
};

/// The layer that is shown.
static LAYER: Control = Control {
    name: "layer",
    label: "Layer",
    help: "Shows speech and emotion together (both), only the speech (content), or only the emotion (emotion).",
    values: ControlValues::Choice(&["both", "content", "emotion"]),
    ..EMOTION_FROM
};

/// How far vertices follow the template.
static TEMPLATE: Control = Control {
    name: "template",
    label: "Template",
    help: "How far vertices follow the template's own, which also move what landmarks cannot say, such as the \
           cheeks; 0 moves them by landmarks alone.",
    values: ControlValues::Real,
    high: 1.0,
    default: 1.0,
    stage: ControlStage::Face,
    ..EMOTION_FROM
};

static OWN_CONTROLS: &[Control] = &[EMOTION_FROM, LEVEL, LAYER, LEARNED, TEMPLATE];

/// The space of the branches' codes.
struct TemplateSpace {
    model: Arc<Model>,
    template: Option<Arc<Template>>,
}

impl CodeSpace for TemplateSpace {
    fn name(&self) -> &'static str {
        REGISTRATION.name
    }

    fn field(&self, face: &Face, _: &Cache, _: ProgressFn<'_>) -> Result<Option<Field>> {
        let share = TEMPLATE.value(&face.options.controls);
        let Some(template) = self.template.as_ref().filter(|_| share > 0.0) else {
            return Ok(None);
        };
        let make = || {
            let on_face = TemplateOnFace::new(face, template, share)?;
            let model = Arc::clone(&self.model);
            let field: Arc<dyn CodeField> = Arc::new(TemplateField { model, on_face });
            Ok(Ok(field))
        };
        face.field(self.name(), make).map(Some)
    }
}

/// The motion of a face's vertices under codes of the branches.
struct TemplateField {
    model: Arc<Model>,
    on_face: TemplateOnFace,
}

impl CodeField for TemplateField {
    fn landmarks(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>> {
        let motion = self.model.motion_of(codes)?;
        Ok(self.on_face.landmarks(motion.view()))
    }

    fn beyond(&self, codes: ArrayView2<'_, f32>, base: &Array3<f32>) -> Result<Array3<f32>> {
        let motion = self.model.motion_of(codes)?;
        Ok(self.on_face.beyond(motion.view(), base))
    }
}

/// The features that the branches got in one performance. The emotion mask is computed from them.
struct Branches {
    space: Arc<TemplateSpace>,
    content: Array2<f32>,
    emotion: Array2<f32>,
    fps: f64,
}

impl EmotionMask for Branches {
    fn shares(&self) -> Result<TemplateMask> {
        let template = self.space.template.as_ref().ok_or_else(|| {
            Error::Weights(
                "emoface: mask: expected a model with the triangles of its template, got none"
                    .into(),
            )
        })?;
        let (content, emotion) = (self.content.view(), self.emotion.view());
        Ok(TemplateMask {
            template: Arc::clone(template),
            shares: self.space.model.masks(content, emotion),
            fps: self.fps,
        })
    }
}

impl Layer {
    /// The layer that the controls set.
    fn of(controls: &Controls) -> Layer {
        match LAYER.value(controls) as usize {
            0 => Layer::Both,
            1 => Layer::Content,
            _ => Layer::Emotion,
        }
    }
}

/// EmoFace in the registry.
pub static REGISTRATION: Registration = Registration {
    name: "emoface",
    label: "EmoFace",
    help: "Speech and emotion come from one voice or from two, are analysed separately, and move the face \
           together.",
    models: &[&MODEL, &CAUSAL_MODEL, &CLOSURES_MODEL],
    controls: &[PERFORMANCE_CONTROLS, OWN_CONTROLS],
    motion: MotionKind::Codes,
    abilities: &[Ability::Emotion, Ability::FirstPose, Ability::Performer],
    emotion: Some(EmotionControls {
        source: &EMOTION_FROM,
        voice: VOICE as f32,
        named: EMOTION as f32,
        layer: &LAYER,
        content: CONTENT,
    }),
    sliders: &Slider::ALL,
    second_bytes: 373_000,
    open: |folder| Ok(Box::new(EmoFace::open(folder)?)),
};

/// Both branches, and everything that makes a performance from their motion.
pub struct EmoFace {
    space: Arc<TemplateSpace>,
    source: EmotionSource,
    /// `None` if the model uses other encoders of content or emotion than the built-in ones, since
    /// those have no causal twin, or if its frame rate differs from the causal encoder's.
    live: Option<Arc<LiveParts>>,
    modes: Arc<FaceModes>,
    expressions: Arc<Expressions>,
}

/// What the model makes of a sound, `T` frames at its own rate.
struct Spoken {
    /// `[T, C]` and `[T, E]`, what the branches hear.
    content: Array2<f32>,
    emotion: Array2<f32>,
    /// `[T]`, how strong the emotion is.
    levels: Vec<f32>,
    clip: LandmarkClip,
    /// `[T, X]`.
    codes: Array2<f32>,
    /// `[T]`, the width of the mouth by speech alone, metres.
    said: Array1<f32>,
}

impl EmoFace {
    /// Opens the built-in models, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config = EmoFaceConfig::from_json(&files.config)?;
        let source = EmotionSource::open(folder, &config)?;
        let weights = Weights::from_bytes(&files.weights)?;
        let template = read_template(&weights, &config)?.map(Arc::new);
        let model = Arc::new(Model::new(config, &weights)?);
        let ear = Arc::new(EmotionEar::open(folder)?);
        let modes = Arc::new(FaceModes::open(folder)?);
        let expressions = Arc::new(Expressions::open(folder)?);
        let live = live_parts(folder, &model, &source, (&ear, &expressions), &modes)?;
        let live = live.map(Arc::new);
        Ok(EmoFace {
            space: Arc::new(TemplateSpace { model, template }),
            source,
            live,
            modes,
            expressions,
        })
    }

    fn model(&self) -> &Model {
        &self.space.model
    }

    fn config(&self) -> &EmoFaceConfig {
        self.model().config()
    }

    /// Whether the emotion branch knows all emotions of a curve.
    fn branch_knows(&self, curve: &EmotionCurve) -> bool {
        let is_known =
            |emotion: &Emotion| known(self.config(), &emotion.mixture) == emotion.mixture;
        curve.named().into_iter().all(is_known)
    }

    /// Whether the emotion branch shows the emotion. If the branch does not know all of a chosen
    /// emotion, the emotion is added to the speech instead, as in FreeTalk.
    fn emotion_origin(&self, request: &MotionRequest) -> EmotionOrigin {
        let shows_request = EMOTION_FROM.value(&request.controls) as usize == EMOTION;
        if shows_request && !self.branch_knows(&request.emotion) {
            EmotionOrigin::Added
        } else {
            EmotionOrigin::Learned
        }
    }

    /// The features of the emotion branch, `[T, E]`, and the level, `[T]`, in each frame.
    fn emotion(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        frames: usize,
        progress: ProgressFn<'_>,
    ) -> Result<(Array2<f32>, Vec<f32>)> {
        let fps = self.config().fps;
        let level = LEVEL.value(&request.controls);
        let onset = EASING * request.onset();
        let from = EMOTION_FROM.value(&request.controls) as usize;
        let curve = match from {
            VOICE if self.config().emotion_ear => match &request.emotion_of {
                Some(other) => heard
                    .other_emotion()
                    .map(HeardEmotion::curve_on_purpose)
                    .unwrap_or_default()
                    .over(other.duration_s(), frames as f64 / fps),
                None => heard.emotion_curve(progress)?,
            },
            VOICE => {
                // A recording that was chosen for its emotion shows it fully. Without one, the
                // voice's emotion shows only as far as the ear is sure of it.
                let (rows, sure) = match &request.emotion_of {
                    Some(other) => (
                        self.source.over(other, frames, progress)?,
                        vec![1.0; frames],
                    ),
                    None => {
                        let affect = heard.emotion_curve(progress)?.sample(frames, fps);
                        let affect = self.expressions.eased(affect, fps, onset);
                        (
                            self.source.at_frames(&heard.voice, frames, fps, progress)?,
                            affect.column(EMOTIONS.len()).to_vec(),
                        )
                    }
                };
                return Ok((rows, sure.into_iter().map(|sure| level * sure).collect()));
            }
            EMOTION if self.branch_knows(&request.emotion) => request.emotion.clone(),
            _ => EmotionCurve::Off,
        };
        let affect = self
            .expressions
            .eased(curve.sample(frames, fps), fps, onset);
        let mut rows = Array2::zeros((frames, self.config().emotion_channels));
        let mut levels = vec![0.0; frames];
        for (t, row) in affect.outer_iter().enumerate() {
            levels[t] = level * row[EMOTIONS.len()];
            let features = faded_features(self.model(), &row.to_vec(), levels[t])?;
            rows.row_mut(t).assign(&ArrayView1::from(&features));
        }
        Ok((rows, levels))
    }

    /// Speech and emotion at the model's own frame rate, without contacts.
    fn spoken(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        layer: Layer,
        progress: ProgressFn<'_>,
    ) -> Result<Spoken> {
        let fps = self.config().fps;
        let content = heard.features(fps);
        let frames = content.nrows();
        let (emotion, levels) = self.emotion(heard, request, frames, progress)?;
        let config = self.config();
        let name = request.style.as_deref();
        let style = style_number(name, &config.styles, &config.default_style)?;
        let first = request.starts_from.as_ref();
        let first = first.map(|pose| self.model().pose_of(&pose.landmarks));
        let mut state = self.model().start(first.as_ref().map(|pose| pose.view()))?;
        let mut displacements = Array3::zeros((frames, LANDMARKS, 3));
        let mut codes = Array2::zeros((frames, self.model().code_size()));
        let mut said = Array1::zeros(frames);
        for (t, mut frame) in displacements.outer_iter_mut().enumerate() {
            report(progress, "sample", t as f32 / frames as f32)?;
            let now = HeardFrame {
                content: content.row(t),
                emotion: emotion.row(t),
                style,
                level: levels[t],
            };
            let next = self.model().step(now, layer, &mut state);
            let moved = landmarks(self.config(), next.layer(layer));
            frame.assign(&ArrayView2::from(&moved));
            if layer != Layer::Emotion {
                said[t] = said_width(self.config(), &next);
            }
            codes.row_mut(t).assign(&ArrayView1::from(&next.code));
        }
        report(progress, "sample", 1.0)?;
        let clip = LandmarkClip { displacements, fps };
        Ok(Spoken {
            content,
            emotion,
            levels,
            clip,
            codes,
            said,
        })
    }
}

impl System for EmoFace {
    fn description(&self) -> Description<'_> {
        let config = self.config();
        Description {
            speech: Some(&config.speech),
            styles: &config.styles,
            ..Description::default()
        }
    }

    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled> {
        let (fps, layer) = (self.config().fps, Layer::of(&request.controls));
        let Spoken {
            content,
            emotion,
            levels,
            clip,
            codes,
            said,
        } = self.spoken(heard, request, layer, progress)?;
        let out_frames = heard.frames(request.fps);
        let mut clip = clip.at_rate(request.fps, out_frames);
        let said = motion::at_rate(said.view(), fps / request.fps, out_frames);
        request.add_performer(&mut clip, (heard, fps), false)?;
        clip.widen(&said.to_vec(), &self.modes)?;
        let contacts = heard.contacts(request.closures.as_deref());
        clip.take_shapes(&contacts, &self.modes)?;
        request.add_performer(&mut clip, (heard, fps), true)?;
        clip.touch(&contacts, &self.modes)?;
        let strength = |t: usize| {
            let frame = (t as f64 * fps / request.fps).round() as usize;
            levels[frame.min(levels.len() - 1)]
        };
        let strengths: Vec<f32> = (0..out_frames).map(strength).collect();
        clip.rest_in_silence(&heard.prosody, &strengths);
        let space = Arc::clone(&self.space);
        Ok(Sampled {
            motion: Motion::Codes(CodeClip {
                space: space.clone(),
                codes: motion::at_rate(codes.view(), fps / request.fps, out_frames),
                landmarks: clip,
            }),
            mask: Some(Arc::new(Branches {
                space,
                content,
                emotion,
                fps,
            })),
        })
    }

    fn apply_controls(
        &self,
        sampled: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        // The content layer shows no emotion at all.
        let emotion = match Layer::of(&request.controls) {
            Layer::Content => &EmotionCurve::default(),
            Layer::Both | Layer::Emotion => &request.emotion,
        };
        let controller = LandmarkController {
            modes: &self.modes,
            expressions: &self.expressions,
            emotion_origin: self.emotion_origin(request),
            prosody: &heard.prosody,
        };
        controller.apply(sampled, request, emotion, blink_emotion)
    }

    fn own_speaker(
        &self,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let request = MotionRequest {
            emotion: EmotionCurve::Off,
            ..MotionRequest::default()
        };
        Ok(self.spoken(heard, &request, Layer::Content, progress)?.clip)
    }

    fn stream(&self) -> Option<Box<dyn MotionStream>> {
        let parts = Arc::clone(self.live.as_ref()?);
        Some(Box::new(EmoFaceStream::new(parts).ok()?))
    }
}

/// The parts for streams of this model; `None` if it cannot have streams.
fn live_parts(
    folder: Option<&Path>,
    model: &Arc<Model>,
    source: &EmotionSource,
    (ear, expressions): (&Arc<EmotionEar>, &Arc<Expressions>),
    modes: &FaceModes,
) -> Result<Option<LiveParts>> {
    let input = &model.config().speech;
    let EmotionSource::BuiltIn(emotion) = source else {
        return Ok(None);
    };
    if input.encoder != EAR_MODEL.name {
        return Ok(None);
    }
    let files = CAUSAL_MODEL.open(folder)?;
    let content = CausalModel::load(&files.weights, &files.config, input.channels)?;
    if content.config().fps != model.config().fps {
        return Ok(None);
    }
    Ok(Some(LiveParts {
        content: Arc::new(content),
        closures: Arc::new(LiveClosures::open(folder)?),
        emotion: Arc::clone(emotion),
        ear: Arc::clone(ear),
        expressions: Arc::clone(expressions),
        model: Arc::clone(model),
        width: WidthGain::new(modes)?,
        silence: OnceLock::new(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_of_another_rate_than_the_live_encoder_has_no_stream() {
        let files = MODEL.open(None).unwrap();
        let weights = Weights::from_bytes(&files.weights).unwrap();
        let ear = Arc::new(EmotionEar::open(None).unwrap());
        let expressions = Arc::new(Expressions::open(None).unwrap());
        let has_stream = |fps: f64| {
            let config = EmoFaceConfig::from_json(&files.config).unwrap();
            let config = EmoFaceConfig { fps, ..config };
            let source = EmotionSource::open(None, &config).unwrap();
            let model = Arc::new(Model::new(config, &weights).unwrap());
            let modes = FaceModes::open(None).unwrap();
            live_parts(None, &model, &source, (&ear, &expressions), &modes)
                .unwrap()
                .is_some()
        };
        assert!(has_stream(25.0) && !has_stream(30.0));
    }
}
