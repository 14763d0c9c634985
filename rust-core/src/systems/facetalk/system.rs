//! FaceTalk as a [`System`]: turns speech into expression codes, and these into motion by the
//! head's field.

use std::{path::Path, sync::Arc};

use ndarray::{Array2, Array3, ArrayView2, Axis};

use super::{Denoiser, MotionConfig, MotionConfigs, Sampling, opening::bound_opening};
use crate::{
    Error, Result,
    cache::Cache,
    conditions::{Control, ControlStage, ControlValues, Controls, EmotionCurve, STEPS},
    deform::{CodeSpace, LEARNED},
    diffusion::frame_noise,
    face::{CodeField, Face, Field},
    head::{self, Head, HeadConfig, HeadOnMesh, Reach},
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
    models::Weights,
    motion::{
        self, CodeClip, EmotionOrigin, Expressions, FaceModes, LandmarkClip, LandmarkController,
        Motion, MotionKind, MotionRequest, PERFORMANCE_CONTROLS,
    },
    speech::{SpeechFeatures, frames_of},
    systems::{Ability, Description, Registration, Sampled, Slider, System},
};

/// Frames between two checks for cancellation.
const FRAMES_AT_A_TIME: usize = 256;

/// r of eq. 8.
static VIVIDNESS: Control = Control {
    name: "vividness",
    label: "Vividness",
    help: "How far the face goes from rest, as the model learned it: 1 as recorded.",
    values: ControlValues::Real,
    low: 0.7,
    high: 1.3,
    default: 1.0,
    neutral: 1.0,
    ..STEPS
};

/// w of eq. 10.
static GUIDANCE: Control = Control {
    name: "speech_guidance",
    label: "Speech Guidance",
    help: "How much more the speech counts than chance; the mouth opens wider the higher it is.",
    values: ControlValues::Real,
    low: 1.0,
    high: 3.0,
    default: 1.5,
    neutral: 1.5,
    ..STEPS
};

/// How far vertices follow the field.
static FIELD: Control = Control {
    name: "field",
    label: "Field",
    help: "How far vertices follow the head's own field, which also moves what landmarks cannot say; 0 moves them by \
           landmarks alone.",
    values: ControlValues::Real,
    high: 1.0,
    default: 1.0,
    neutral: 0.0,
    stage: ControlStage::Face,
    ..STEPS
};

/// σ of eq. 12.
static SIGMA: Control = Control {
    name: "field_reach",
    label: "Field Reach",
    help: "How far about mouth and eyes the field moves the mesh, centimetres (standard deviation); 0 moves all that it \
           reaches.",
    unit: "cm",
    values: ControlValues::Real,
    high: 20.0,
    stage: ControlStage::Face,
    ..STEPS
};

static OWN_CONTROLS: &[Control] = &[VIVIDNESS, GUIDANCE, STEPS, LEARNED, FIELD, SIGMA];

/// FaceTalk in the registry.
pub static REGISTRATION: Registration = Registration {
    name: "facetalk",
    label: "FaceTalk",
    help: "Speech moves a head that is a field; its landmarks move the mesh.",
    models: &[],
    controls: &[PERFORMANCE_CONTROLS, OWN_CONTROLS],
    motion: MotionKind::Codes,
    abilities: &[Ability::Head, Ability::Performer],
    emotion: None,
    sliders: &Slider::ALL,
    second_bytes: 615_000,
    open: |folder| Ok(Box::new(FaceTalk::open(folder)?)),
};

/// Centimetres in a metre: the model that follows landmarks takes centimetres.
const CM: f32 = 100.0;

/// The speech model and the head that its codes move.
pub struct FaceTalk {
    denoiser: Denoiser,
    /// The model that follows landmarks instead of speech, an idea from the paper's conclusion. A
    /// model that the user provides may lack it.
    by_landmarks: Option<Denoiser>,
    space: Arc<HeadSpace>,
    modes: Arc<FaceModes>,
    expressions: Arc<Expressions>,
}

/// The head that the codes move.
struct HeadSpace {
    head: Arc<Head>,
}

impl CodeSpace for HeadSpace {
    fn name(&self) -> &'static str {
        REGISTRATION.name
    }

    fn field(&self, face: &Face, cache: &Cache, progress: ProgressFn<'_>) -> Result<Option<Field>> {
        let controls = &face.options.controls;
        let reach = Reach {
            share: FIELD.value(controls),
            sigma_m: 0.01 * SIGMA.value(controls),
        };
        if reach.share == 0.0 {
            return Ok(None);
        }
        let head = Arc::clone(&self.head);
        // A face that is unlike every head of the model has no field and moves by its landmarks.
        let make = || {
            let field = HeadOnMesh::new(head, face, reach, cache, progress)?;
            Ok(field.map(|field| Arc::new(field) as Arc<dyn CodeField>))
        };
        face.field(self.name(), make).map(Some)
    }
}

impl FaceTalk {
    /// Opens the built-in models, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = head::MODEL.open(folder)?;
        let weights = Weights::from_bytes(&files.weights)?;
        let MotionConfigs {
            motion: config,
            landmark_motion,
        } = MotionConfigs::from_json(&files.config)?;
        let head = Head::new(HeadConfig::from_json(&files.config)?, &weights)?;
        let code_size = head.config().expression_code;
        let denoiser = |config: MotionConfig, name: &str| {
            if config.codes != code_size {
                return Err(Error::Weights(format!(
                    "facetalk config.json: {name}: expected {code_size} codes, as the head has, got {}",
                    config.codes
                )));
            }
            Denoiser::new(config, &weights.pp(name))
        };
        let by_landmarks = landmark_motion.map(|config| denoiser(config, "landmark_motion"));
        Ok(FaceTalk {
            denoiser: denoiser(config, "motion")?,
            by_landmarks: by_landmarks.transpose()?,
            space: Arc::new(HeadSpace {
                head: Arc::new(head),
            }),
            modes: Arc::new(FaceModes::open(folder)?),
            expressions: Arc::new(Expressions::open(folder)?),
        })
    }

    fn config(&self) -> &MotionConfig {
        self.denoiser.config()
    }

    fn sampling(&self, controls: &Controls) -> Sampling {
        let defaults = self.config().sampling;
        let steps = STEPS.value(controls) as usize;
        Sampling {
            steps: if steps > 0 { steps } else { defaults.steps },
            guidance: GUIDANCE.value(controls),
            vividness: VIVIDNESS.value(controls),
            ..defaults
        }
    }

    /// How the codes `[T, X]` move the mean head's landmarks from rest, `[T, 68, 3]` metres.
    fn landmarks(
        &self,
        codes: ArrayView2<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let (places, rest) = self.space.head.mean_landmarks()?;
        let mut out = Array3::zeros((codes.nrows(), LANDMARKS, 3));
        for (t, (code, mut frame)) in codes
            .rows()
            .into_iter()
            .zip(out.outer_iter_mut())
            .enumerate()
        {
            if t % FRAMES_AT_A_TIME == 0 {
                report(progress, "motion", 1.0)?;
            }
            let moved = places.at(&code.to_vec())?;
            for (mut row, (to, from)) in frame.rows_mut().into_iter().zip(moved.iter().zip(&rest)) {
                for axis in 0..3 {
                    row[axis] = to[axis] - from[axis];
                }
            }
        }
        Ok(out)
    }

    /// Codes `[T, X]` and landmarks `[T, 68, 3]` at the denoiser's own frame rate, from `noise` `[T, X]`.
    fn spoken(
        &self,
        heard: &SpeechFeatures,
        noise: Array2<f32>,
        controls: &Controls,
        progress: ProgressFn<'_>,
    ) -> Result<(Array2<f32>, Array3<f32>)> {
        let (speech, sampling) = (heard.features(self.config().fps), self.sampling(controls));
        let mut codes = self
            .denoiser
            .sample(noise, speech.view(), &sampling, progress)?;
        let mut displacements = self.landmarks(codes.view(), progress)?;
        let rest = self.space.head.rest_code();
        let moved = bound_opening(&mut codes, &rest, displacements.view());
        let again = self.landmarks(codes.select(Axis(0), &moved).view(), progress)?;
        for (t, frame) in moved.into_iter().zip(again.outer_iter()) {
            displacements.index_axis_mut(Axis(0), t).assign(&frame);
        }
        Ok((codes, displacements))
    }

    fn motion(&self, codes: Array2<f32>, landmarks: LandmarkClip) -> Motion {
        let space = Arc::clone(&self.space) as Arc<dyn CodeSpace>;
        Motion::Codes(CodeClip {
            space,
            codes,
            landmarks,
        })
    }
}

impl System for FaceTalk {
    fn description(&self) -> Description<'_> {
        Description {
            speech: Some(&self.config().speech),
            emotion: EmotionOrigin::Added,
            ..Description::default()
        }
    }

    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled> {
        if let Some(style) = &request.style {
            return Err(Error::InvalidInput(format!(
                "style: expected none, since facetalk has no styles, got {style:?}"
            )));
        }
        let fps = self.config().fps;
        let noise = frame_noise(
            request.seed,
            0,
            heard.features(fps).nrows(),
            self.config().codes,
        );
        let (codes, displacements) = self.spoken(heard, noise, &request.controls, progress)?;
        let frames = heard.frames(request.fps);
        let codes = motion::at_rate(codes.view(), fps / request.fps, frames);
        let mut landmarks = LandmarkClip { displacements, fps }.at_rate(request.fps, frames);
        let contacts = heard.contacts(request.closures.as_deref());
        // The gain of the width is that of the model's own speaker.
        let said = landmarks.widths();
        request.add_performer(&mut landmarks, (heard, fps), false)?;
        landmarks.widen(&said, &self.modes)?;
        landmarks.take_shapes(&contacts, &self.modes)?;
        request.add_performer(&mut landmarks, (heard, fps), true)?;
        landmarks.touch(&contacts, &self.modes)?;
        Ok(self.motion(codes, landmarks).into())
    }

    fn own_speaker(
        &self,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let fps = self.config().fps;
        let noise = Array2::zeros((heard.features(fps).nrows(), self.config().codes));
        let (_, displacements) = self.spoken(heard, noise, &Controls::default(), progress)?;
        Ok(LandmarkClip { displacements, fps })
    }

    fn follow(
        &self,
        clip: &LandmarkClip,
        controls: &Controls,
        progress: ProgressFn<'_>,
    ) -> Result<Motion> {
        let Some(denoiser) = self
            .by_landmarks
            .as_ref()
            .filter(|_| FIELD.value(controls) > 0.0)
        else {
            return Ok(Motion::Landmarks(clip.clone()));
        };
        let (config, frames) = (denoiser.config(), clip.displacements.dim().0);
        let duration_s = frames as f64 / clip.fps;
        let targets = clip.at_rate(config.fps, frames_of(duration_s, config.fps));
        let rows = targets.displacements.dim().0;
        let targets = targets.displacements.mapv(|x| CM * x);
        let targets = targets.into_shape_with_order((rows, 3 * LANDMARKS));
        let noise = frame_noise(0, 0, rows, config.codes);
        let targets = targets.expect("three numbers to a landmark");
        let codes = denoiser.sample(noise, targets.view(), &config.sampling, progress)?;
        let codes = motion::at_rate(codes.view(), config.fps / clip.fps, frames);
        Ok(self.motion(codes, clip.clone()))
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
            emotion_origin: EmotionOrigin::Added,
            prosody: &heard.prosody,
        };
        controller.apply(sampled, request, &request.emotion, blink_emotion)
    }
}
