//! Live weights of ARKit's shapes and of visemes, for characters whose mesh is not at hand.

use std::sync::Arc;

use ndarray::Array2;

use super::{
    FaceModes, MotionStream, PerformanceControls, Performer,
    idle::{Idle, IdleMotion},
    shape_fit::ShapeFit,
};
use crate::{
    Result,
    audio::SAMPLE_RATE_HZ,
    conditions::Emotion,
    mesh::ibug::LANDMARKS,
    rig::{ARKIT, VISEMES, is_of_mouth, mirrored_name},
    speech::{EmotionEar, EmotionEncoder, EmotionListener},
};

/// The angle of the eyes at which a look shape has weight 1, degrees.
const FULL_LOOK_DEG: f64 = 30.0;

/// A face at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightFrame {
    /// Number of the frame, which is at `index / fps` seconds of the sound.
    pub index: usize,
    /// Weights of [`ARKIT`]'s shapes, 0 to 1: speech, emotion, blinks and the eyes' direction.
    pub shapes: [f32; ARKIT.len()],
    /// Weights of [`VISEMES`], 0 to 1, for characters that have only these. They show speech alone.
    /// `sil` gets what the others leave of 1.
    pub visemes: [f32; VISEMES.len()],
    /// The emotion, either set or heard.
    pub emotion: Emotion,
    /// Rotation vector of the head, radians, in canonical axes: x to the subject's left, y up, z to
    /// the front. A nod down turns about +x.
    pub head: [f32; 3],
}

/// A performance in progress: push samples, pull weights. The weights are the same bit for bit,
/// however the samples are split into pushes.
///
/// A least-squares fit on the mean face follows the landmarks of a [`MotionStream`]. It goes frame
/// by frame and starts from the weights of the previous frame.
///
/// ```
/// # use anyface::{Engine, EngineOptions};
/// # let engine = Engine::new(EngineOptions::default())?;
/// let mut stream = engine.weight_stream()?;
/// stream.push(&[0.0; 16_000])?;
/// stream.finish()?;
/// let frames: Vec<_> = std::iter::from_fn(|| stream.pull()).collect();
/// assert_eq!(frames.len(), 25);
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct WeightStream {
    motion: Box<dyn MotionStream>,
    ears: Ears,
    /// The listener, if emotion is to be heard, and how many samples were pushed before it started.
    listener: Option<(EmotionListener, u64)>,
    pushed: u64,
    /// The emotion from the next frame on.
    emotion: Emotion,
    shapes: ShapeFit,
    visemes: ShapeFit,
    idle: IdleMotion,
    controls: PerformanceControls,
    places: Places,
}

/// The models that hear an emotion in a voice.
#[derive(Clone)]
pub(crate) struct Ears {
    /// Turns the last two seconds of the voice into features.
    pub encoder: Arc<EmotionEncoder>,
    /// Finds the emotion in these features.
    pub ear: Arc<EmotionEar>,
}

/// Indices of some of [`ARKIT`]'s shapes, the subject's right side first.
struct Places {
    jaw_open: usize,
    blink: [usize; 2],
    /// Outward, inward, up and down.
    look: [[usize; 4]; 2],
}

impl WeightStream {
    /// `mixtures`: `[15, 52]`, the weight of each shape in each viseme.
    ///
    /// # Errors
    /// `Weights` if the modes of the face lack a shape.
    pub(crate) fn new(
        motion: Box<dyn MotionStream>,
        ears: Ears,
        modes: &FaceModes,
        mixtures: &Array2<f32>,
    ) -> Result<WeightStream> {
        let shapes = modes.of_shapes(&ARKIT.map(str::to_owned))?;
        let flat = shapes
            .to_shape((ARKIT.len(), 3 * LANDMARKS))
            .expect("row-major array");
        let visemes = mixtures
            .dot(&flat)
            .into_shape_with_order((VISEMES.len(), LANDMARKS, 3));
        let visemes = visemes.expect("as many numbers as before");
        let place = |name: &str| ARKIT.iter().position(|known| *known == name);
        let mirror = ARKIT.iter().map(|name| place(&mirrored_name(name)));
        let mirror = mirror
            .enumerate()
            .map(|(s, other)| other.filter(|other| *other != s));
        let known = |name: String| place(&name).expect("ARKit has this shape");
        let sides = ["Right", "Left"];
        Ok(WeightStream {
            shapes: ShapeFit::new(&shapes, mirror.collect()),
            visemes: ShapeFit::new(&visemes, vec![None; VISEMES.len()]),
            idle: IdleMotion::new(0),
            controls: PerformanceControls::default(),
            places: Places {
                jaw_open: known("jawOpen".into()),
                blink: sides.map(|side| known(format!("eyeBlink{side}"))),
                look: sides.map(|side| {
                    ["Out", "In", "Up", "Down"].map(|way| known(format!("eyeLook{way}{side}")))
                }),
            },
            motion,
            ears,
            listener: None,
            pushed: 0,
            emotion: Emotion::default(),
        })
    }

    /// Takes samples: mono, 16 kHz, nominally in [−1, 1].
    ///
    /// # Errors
    /// Those of [`MotionStream::push`].
    pub fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.motion.push(samples)?;
        self.pushed += samples.len() as u64;
        if let Some((listener, _)) = &mut self.listener {
            listener.push(samples);
        }
        Ok(())
    }

    /// The controls that a stream obeys.
    pub const CONTROLS: [&str; 5] = [
        "articulation",
        "blinks_per_minute",
        "head_motion",
        "gaze",
        "onset",
    ];

    /// Shows more or less of the performance from the next frame on. Only [`WeightStream::CONTROLS`] count.
    pub fn control(&mut self, controls: PerformanceControls) {
        let usual = PerformanceControls::default().blinks_per_minute;
        let share = controls.blinks_per_minute / usual;
        self.idle.set_blinks(f64::from(share));
        self.motion.set_onset(controls.onset);
        self.controls = controls;
    }

    /// The next frame, or `None` until more samples have arrived.
    pub fn pull(&mut self) -> Option<WeightFrame> {
        self.follow_voice()?;
        let frame = self.motion.pull()?;
        let landmarks = frame.displacements.as_flattened();
        let mut shapes = [0.0; ARKIT.len()];
        let fitted = self.shapes.next(landmarks);
        shapes
            .iter_mut()
            .zip(fitted)
            .for_each(|(to, w)| *to = *w as f32);
        let mut visemes = [0.0; VISEMES.len()];
        let fitted = self.visemes.next(landmarks);
        visemes
            .iter_mut()
            .zip(fitted)
            .for_each(|(to, w)| *to = *w as f32);
        let PerformanceControls {
            articulation,
            head_motion,
            gaze,
            ..
        } = self.controls;
        for (weight, name) in shapes.iter_mut().zip(ARKIT) {
            if is_of_mouth(name) {
                *weight = (articulation * *weight).min(1.0);
            }
        }
        visemes
            .iter_mut()
            .for_each(|weight| *weight = (articulation * *weight).min(1.0));
        // The first viseme is silence.
        let said: f32 = visemes[1..].iter().sum();
        visemes[0] = (1.0 - said).max(0.0);
        let time_s = frame.index as f64 / self.motion.fps();
        let opening = f64::from(shapes[self.places.jaw_open]);
        let mut idle = self.idle.at(time_s, opening);
        idle.look_deg = idle.look_deg.map(|angle| f64::from(gaze) * angle);
        idle.head = idle.head.map(|angle| head_motion * angle);
        self.places.add(&idle, &mut shapes);
        Some(WeightFrame {
            index: frame.index,
            shapes,
            visemes,
            emotion: self.emotion,
            head: idle.head,
        })
    }

    /// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
    ///
    /// # Errors
    /// `InvalidInput` the second time.
    pub fn finish(&mut self) -> Result<()> {
        self.motion.finish()
    }

    /// Sets the emotion from the next frame on. It replaces the one that is heard.
    ///
    /// # Errors
    /// `InvalidInput` for an emotion that is not finite.
    pub fn set_emotion(&mut self, emotion: &Emotion) -> Result<()> {
        self.motion.set_emotion(emotion)?;
        (self.emotion, self.listener) = (*emotion, None);
        Ok(())
    }

    /// Shows the emotion that is heard in the sound pushed from now on. It is neutral in the first
    /// second. Then it is updated three times a second from the last two seconds, compared with the
    /// last minute and a half. [`WeightStream::set_emotion`] ends this.
    pub fn hear_emotion(&mut self) {
        if self.listener.is_none() {
            let Ears { encoder, ear } = self.ears.clone();
            self.listener = Some((EmotionListener::new(encoder, ear), self.pushed));
        }
    }

    /// Limits the look-ahead to `seconds`. Call it before the first sound; see
    /// [`MotionStream::look_ahead`].
    ///
    /// # Errors
    /// Those of [`MotionStream::look_ahead`].
    pub fn look_ahead(&mut self, seconds: f64) -> Result<()> {
        self.motion.look_ahead(seconds)
    }

    /// As [`MotionStream::set_performer`].
    ///
    /// # Errors
    /// As there.
    pub fn set_performer(
        &mut self,
        performer: Option<Arc<Performer>>,
        strength: f32,
    ) -> Result<()> {
        self.motion.set_performer(performer, strength)
    }

    /// Lets every sound move the face from now on, including singing, music and noise. Without
    /// this, only speech does.
    pub fn hear_all(&mut self) {
        self.motion.hear_all();
    }

    /// Sets the emotion of the next frame to the one heard up to the end of the frame's look-ahead.
    fn follow_voice(&mut self) -> Option<()> {
        let Some((listener, before)) = &mut self.listener else {
            return Some(());
        };
        let until_s = self.motion.next_frame() as f64 / self.motion.fps() + self.motion.latency_s();
        let until = (until_s * f64::from(SAMPLE_RATE_HZ)).round() as u64;
        self.emotion = listener.emotion_after(until.saturating_sub(*before));
        self.motion.set_emotion(&self.emotion).ok()
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        self.motion.fps()
    }

    /// How many seconds of sound after its own time a frame waits for.
    pub fn latency_s(&self) -> f64 {
        self.motion.latency_s()
    }
}

impl Places {
    /// Adds blinks and the direction of the eyes.
    fn add(&self, idle: &Idle, shapes: &mut [f32; ARKIT.len()]) {
        let [left_deg, up_deg] = idle.look_deg;
        for (side, outward_deg) in [(0, -left_deg), (1, left_deg)] {
            let blink = &mut shapes[self.blink[side]];
            *blink = blink.max(idle.closed[side]);
            let ways = [outward_deg, -outward_deg, up_deg, -up_deg];
            for (shape, way_deg) in self.look[side].into_iter().zip(ways) {
                shapes[shape] = (way_deg / FULL_LOOK_DEG).clamp(0.0, 1.0) as f32;
            }
        }
    }
}
