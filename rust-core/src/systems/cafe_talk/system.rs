//! Cafe-Talk as a [`System`]: speech, emotion and events to ARKit weights.

use std::path::Path;

use ndarray::{Array2, Array3, s};

use super::{
    CafeTalkConfig, Denoiser, Guidance, Request,
    calibration::{calibrate, retime},
    window_cache::WindowCache,
};
use crate::{
    Result,
    conditions::{Control, ControlValues, EDGE_S, EmotionCurve, EventTrack, NOISE, STEPS},
    deform::LEARNED,
    job::{Progress, ProgressFn},
    mesh::ibug::LANDMARKS,
    models::{BuiltIn, Weights},
    motion::{
        Expressions, FaceModes, LandmarkClip, LipGaps, LowerLip, Motion, MotionKind, MotionRequest,
        MouthLengths, PerformanceControls, WeightClip, WeightCues, control_named, style_number,
    },
    speech::SpeechFeatures,
    systems::{Ability, Description, Registration, Sampled, Slider, System},
};

/// Built-in weights of the denoiser.
pub static MODEL: BuiltIn =
    BuiltIn::sized(&anyface_weights_cafe_talk::CAFE_TALK_COMPACT, "cafe_talk");

/// Factor on the onset of emotions. The denoiser reacts to the middle of a change more steeply than in
/// proportion to it.
const EASING: f32 = 1.3;

/// Multiplies the model's own β of eq. 6.
static EVENTS: Control = Control {
    name: "event_strength",
    label: "Event Strength",
    help: "How strongly events move the face; multiplies the strength of each.",
    values: ControlValues::Real,
    high: 2.0,
    default: 1.0,
    neutral: 1.0,
    ..STEPS
};

/// Which form of eq. 6 is used.
static GUIDANCE: Control = Control {
    name: "guidance",
    label: "Guidance",
    help: "The reference for the strength of events. Speech: the same speech without them, so that events rise and \
           fall about their slot. Printed: no speech at all, as in the paper, so that events act in their slot alone \
           and the mouth moves more within it.",
    values: ControlValues::Choice(&["speech", "printed"]),
    high: 1.0,
    ..STEPS
};

/// Whether events are put on the times and the strength that was asked for.
static CALIBRATE: Control = Control {
    name: "calibrate",
    label: "Calibrate Events",
    help: "On: after sampling, an event rises and falls as long as the units take, and its peak is its strength. Off: \
           as the model and eq. 6 make it.",
    values: ControlValues::Choice(&["on", "off"]),
    high: 1.0,
    ..STEPS
};

/// Multiplies the model's own α of eq. 6.
static COARSE_GUIDANCE: Control = Control {
    name: "coarse_guidance",
    label: "Coarse Guidance",
    help: "How much more speech and emotion count than chance; above 1 the mouth opens wider and follows the sound \
           less closely.",
    values: ControlValues::Real,
    low: 1.0,
    high: 3.0,
    default: 1.0,
    neutral: 1.0,
    ..STEPS
};

/// The controls of landmark motion that also act on weights.
static PERFORMANCE: &[Control] = &[
    control_named("articulation"),
    control_named("effort"),
    control_named("jaw"),
    control_named("rounding"),
    control_named("width"),
    control_named("smoothing_s"),
    control_named("upper_face"),
    control_named("blinks_per_minute"),
    control_named("brow_accents"),
    control_named("asymmetry"),
    control_named("head_motion"),
    control_named("gaze"),
    control_named("tongue"),
    control_named("onset"),
    control_named("variety"),
];

static OWN_CONTROLS: &[Control] = &[
    EVENTS,
    GUIDANCE,
    CALIBRATE,
    COARSE_GUIDANCE,
    STEPS,
    NOISE,
    LEARNED,
];

/// Cafe-Talk in the registry.
pub static REGISTRATION: Registration = Registration {
    name: "cafe-talk",
    label: "Cafe-Talk",
    help: "Speech, emotion and events such as a wink or a smile move the 51 shapes of ARKit, which move the \
           mesh.",
    models: &[&MODEL],
    controls: &[PERFORMANCE, OWN_CONTROLS],
    motion: MotionKind::Weights,
    abilities: &[Ability::Events, Ability::Words, Ability::Performer],
    emotion: None,
    sliders: &Slider::ALL,
    second_bytes: 233_000,
    open: |folder| Ok(Box::new(CafeTalk::open(folder)?)),
};

/// The denoiser, and everything that makes a performance from its weights.
pub struct CafeTalk {
    denoiser: Denoiser,
    modes: FaceModes,
    expressions: Expressions,
    gaps: LipGaps,
    lower_lip: LowerLip,
    mouth: MouthLengths,
    window_cache: WindowCache,
}

impl CafeTalk {
    /// Opens the built-in models, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config = CafeTalkConfig::from_json(&files.config)?;
        let denoiser = Denoiser::new(config, &Weights::from_bytes(&files.weights)?)?;
        let modes = FaceModes::open(folder)?;
        let shapes = &denoiser.config().channels;
        let gaps = LipGaps::of_mean_face(&modes, shapes)?;
        let lower_lip = LowerLip::of_mean_face(&modes, shapes)?;
        let mouth = MouthLengths::of_mean_face(&modes, shapes)?;
        Ok(CafeTalk {
            denoiser,
            modes,
            expressions: Expressions::open(folder)?,
            gaps,
            lower_lip,
            mouth,
            window_cache: WindowCache::default(),
        })
    }

    fn config(&self) -> &CafeTalkConfig {
        self.denoiser.config()
    }

    fn style(&self, name: Option<&str>) -> Result<usize> {
        let config = self.config();
        style_number(name, &config.styles, &config.default_style)
    }

    fn guidance(&self, request: &MotionRequest) -> Guidance {
        let sampling = self.config().sampling;
        Guidance {
            alpha: sampling.alpha * COARSE_GUIDANCE.value(&request.controls),
            beta: sampling.beta * EVENTS.value(&request.controls),
            is_printed: GUIDANCE.value(&request.controls) != GUIDANCE.default,
        }
    }

    /// Samples weights `[T, M]` with events and without them. [`retime`] lets the
    /// difference come and go as on a face, and [`calibrate`] scales it to the strength of each event
    /// times `strength`.
    fn calibrated(
        &self,
        request: Request<'_>,
        (plain_events, strength): (&EventTrack, f32),
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let events = request.events;
        let half = |done: f32| {
            move |now: Progress| {
                let fraction = done + 0.5 * now.fraction;
                progress(Progress { fraction, ..now })
            }
        };
        let plain = Request {
            events: plain_events,
            ..request
        };
        let plain = self.denoiser.sample(&plain, &half(0.0))?;
        let mut weights = self.denoiser.sample(&request, &half(0.5))?;
        retime(&mut weights, &plain, events, self.config().fps);
        calibrate(&mut weights, &plain, &(strength * &events.shown));
        Ok(weights)
    }

    /// Speech, emotion and events at the denoiser's own frame rate.
    fn spoken(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<WeightClip> {
        let config = self.config();
        let fps = config.fps;
        let speech = heard.features(fps);
        let affect = request.emotion.sample(speech.nrows(), fps);
        let onset = EASING * request.onset();
        let affect = self.expressions.eased(affect, fps, onset);
        let guidance = self.guidance(request);
        let edge_s = if guidance.is_printed { 0.0 } else { EDGE_S };
        let shapes = &config.channels;
        let (time, onset) = ((speech.nrows(), fps), f64::from(request.onset()));
        let events = EventTrack::of(&request.events, shapes, time, edge_s, onset);
        let plain_events = EventTrack::of(&[], shapes, time, edge_s, onset);
        let steps = STEPS.value(&request.controls) as usize;
        let mixtures = affect.slice(s![.., ..affect.ncols() - 1]);
        let (places, intensity) = (
            self.denoiser.places(mixtures),
            affect.column(affect.ncols() - 1).to_vec(),
        );
        let is_as_sampled =
            guidance.is_printed || CALIBRATE.value(&request.controls) != CALIBRATE.default;
        let has_events = events.mask.iter().any(|strength| *strength != 0.0);
        let to_sample = Request {
            speech: speech.view(),
            style: self.style(request.style.as_deref())?,
            emotion: places.view(),
            intensity: &intensity,
            events: &events,
            seed: request.seed,
            temperature: NOISE.value(&request.controls) * config.sampling.temperature,
            steps: match steps {
                0 => config.sampling.steps,
                steps => steps,
            },
            guidance,
            window_cache: Some(&self.window_cache),
        };
        let mut weights = if is_as_sampled || !has_events {
            self.denoiser.sample(&to_sample, progress)?
        } else {
            let strength = EVENTS.value(&request.controls);
            self.calibrated(to_sample, (&plain_events, strength), progress)?
        };
        // Units that no network has learned set the least weights of their shapes.
        weights.zip_mut_with(&events.put_on, |weight, least| *weight = weight.max(*least));
        let mut clip = WeightClip {
            names: shapes.clone(),
            weights,
            fps,
            together: Vec::new(),
        };
        clip.hush(&events.shut, &(&events.shown + &events.put_on));
        Ok(clip)
    }

    /// Adds the performer, or one that `corrects`, as far as shapes can show it.
    fn add_performer(
        &self,
        clip: &mut WeightClip,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        corrects: bool,
    ) -> Result<()> {
        let mut own = LandmarkClip {
            displacements: Array3::zeros((clip.weights.nrows(), LANDMARKS, 3)),
            fps: clip.fps,
        };
        if request.add_performer(&mut own, (heard, self.config().fps), corrects)? {
            clip.add_landmarks(own.displacements.view(), &self.modes)?;
        }
        Ok(())
    }
}

impl System for CafeTalk {
    fn description(&self) -> Description<'_> {
        let config = self.config();
        Description {
            speech: Some(&config.speech),
            styles: &config.styles,
            windows: Some(config.windows()),
            ..Description::default()
        }
    }

    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled> {
        let mut clip = self.spoken(heard, request, progress)?;
        self.add_performer(&mut clip, heard, request, false)?;
        let frames = heard.frames(request.fps);
        Ok(Motion::Weights(clip.at_rate(request.fps, frames)).into())
    }

    fn own_speaker(
        &self,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let mut request = MotionRequest::default();
        request.controls.set(NOISE.name, 0.0);
        let clip = self.spoken(heard, &request, progress)?;
        clip.of_arkit().landmarks(&self.modes)
    }

    fn apply_controls(
        &self,
        sampled: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let Motion::Weights(clip) = sampled else {
            return Ok(sampled.clone());
        };
        let affect = request.emotion.sample(sampled.frames(), clip.fps);
        let blink_affect = blink_emotion.sample(sampled.frames(), clip.fps);
        let cues = WeightCues {
            affect: affect.view(),
            blink_affect: blink_affect.view(),
            expressions: &self.expressions,
            prosody: &heard.prosody,
            speech_only: request.emotion == EmotionCurve::Off,
            seed: request.seed,
        };
        let controls = PerformanceControls::from(&request.controls);
        let contacts = heard.contacts(request.closures.as_deref());
        let time = (clip.weights.nrows(), clip.fps);
        let onset = f64::from(request.onset());
        let events = EventTrack::of(&request.events, &clip.names, time, EDGE_S, onset);
        let over_speech = &events.over_speech;
        let mut shaped = clip.clone();
        let of_events = EVENTS.value(&request.controls) * &events.shown + &events.put_on;
        self.mouth
            .take_shapes(&mut shaped, &contacts.shapes, over_speech, &of_events);
        self.add_performer(&mut shaped, heard, request, true)?;
        let mut performed = shaped.apply_controls(&self.modes, &cues, &controls)?;
        self.lower_lip
            .reach_teeth(&mut performed, &contacts.at_teeth, over_speech);
        self.gaps
            .close(&mut performed, &contacts.together, over_speech);
        Ok(Motion::Weights(performed))
    }
}
