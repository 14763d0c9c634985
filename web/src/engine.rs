//! Loaded models.

use std::{cell::RefCell, sync::Arc};

use anyface::{
    CachePolicy, EngineOptions,
    face::FaceOptions,
    job::Progress,
    mesh::{LandmarkSource, Mouth},
    motion::{LandmarkClip, Motion},
    speech::{EmotionEar, EmotionEncoder},
    spread::Collector,
};
use ndarray::Array3;
use wasm_bindgen::prelude::*;

use crate::{
    clip::Clip,
    face::Face,
    live::Live,
    shapes::{LANDMARK_NUMBERS, Landmarks, Shapes},
    speaker::Speaker,
};

/// Loaded models, which make faces and move them.
#[wasm_bindgen]
pub struct Engine {
    engine: anyface::Engine,
    ears: (Arc<EmotionEncoder>, Arc<EmotionEar>),
    shapes: Arc<Shapes>,
}

#[wasm_bindgen]
impl Engine {
    /// Loads the models that were added.
    ///
    /// # Errors
    /// If a model is missing.
    #[wasm_bindgen(constructor)]
    pub fn new() -> Result<Engine, JsError> {
        let engine = anyface::Engine::new(EngineOptions {
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        })?;
        let ears = (EmotionEncoder::open(None)?, EmotionEar::open(None)?);
        Ok(Engine {
            engine,
            ears: (Arc::new(ears.0), Arc::new(ears.1)),
            shapes: Arc::new(Shapes::open()?),
        })
    }

    /// Finds the face of a head and prepares it to be moved. `file`: an OBJ, PLY, GLB or VRM,
    /// recognised by its content. `landmarks`: a landmark file with the 68 points, JSON, if they
    /// are known. `progress`: a function that is called with the name of a step and the share of it
    /// that is done, 0 to 1.
    ///
    /// # Errors
    /// If the file is none of these or damaged, or the mesh has no face.
    pub fn face(
        &self,
        file: Vec<u8>,
        landmarks: Option<String>,
        progress: Option<js_sys::Function>,
    ) -> Result<Face, JsError> {
        let mesh = anyface::mesh::Mesh::parse(&file)?;
        let landmarks = landmarks.map(|text| LandmarkSource::from_json(&text));
        let options = FaceOptions {
            landmarks: landmarks.transpose()?,
            ..FaceOptions::default()
        };
        LISTENER.set(progress);
        let face = self.engine.find(&mesh, &options, &tell);
        let face = face.and_then(|face| self.prepared(face, file));
        LISTENER.set(None);
        Ok(face?)
    }

    /// Makes the motion for a whole sound: `samples`, mono, 16 kHz, within ±1. `emotion`: such as
    /// `happy:0.7`, or `auto` for the emotion heard in the voice. `alive`: whether the face blinks
    /// and the head drifts.
    ///
    /// # Errors
    /// If samples are not finite or the emotion is unknown.
    pub fn speak(&self, samples: &[f32], emotion: &str, alive: bool) -> Result<Clip, JsError> {
        let mut speaker = self.speaker(emotion, alive)?;
        speaker.hear_all();
        speaker.push(samples)?;
        speaker.finish()?;
        Ok(Clip::of(speaker)?)
    }

    /// Starts motion for a sound that is still going on.
    ///
    /// # Errors
    /// If the emotion is unknown.
    pub fn live(&self, emotion: &str) -> Result<Live, JsError> {
        Ok(Live::new(self.speaker(emotion, true)?))
    }

    /// Displacements of all vertices in a frame of a clip, `[V * 3]`, units and axes of the mesh.
    ///
    /// # Errors
    /// If the clip does not have this frame.
    #[wasm_bindgen(js_name = clipFrame)]
    pub fn clip_frame(&self, face: &Face, clip: &Clip, frame: usize) -> Result<Vec<f32>, JsError> {
        Ok(self.pose(face, &clip.landmarks(frame)?)?)
    }

    /// Displacements of all vertices in the next frame of a stream, `[V * 3]`; nothing until more
    /// samples arrive.
    ///
    /// # Errors
    /// If numbers are not finite.
    #[wasm_bindgen(js_name = liveFrame)]
    pub fn live_frame(&self, face: &Face, live: &mut Live) -> Result<Option<Vec<f32>>, JsError> {
        let landmarks = live.next()?;
        let moved = landmarks.map(|landmarks| self.pose(face, &landmarks));
        Ok(moved.transpose()?)
    }

    /// A clip on a face as a binary glTF: morph targets and their weights over time. A GLB keeps
    /// its materials and bones.
    ///
    /// # Errors
    /// If a GLB shows its mesh twice, or the clip is too long for memory.
    #[wasm_bindgen(js_name = exportGlb)]
    pub fn export_glb(&self, face: &Face, clip: &Clip) -> Result<Vec<u8>, JsError> {
        let mut displacements = Vec::with_capacity(clip.frame_count() * LANDMARK_NUMBERS);
        for frame in 0..clip.frame_count() {
            displacements.extend(clip.landmarks(frame)?);
        }
        let motion = landmark_motion(displacements, clip.fps());
        let animation = Collector::collect(|sink| {
            self.engine
                .spread(&face.face, &motion, sink, anyface::job::SILENT)
        })?;
        let (mesh, life) = (&face.face.mesh, clip.life());
        Ok(anyface::output::glb_of(
            &animation,
            Some(&life),
            mesh,
            &face.file,
        )?)
    }
}

impl Engine {
    /// Prepares the face to be moved, and parts its lips if they are one surface. The mesh of a GLB
    /// stays as it is, because an export keeps its materials and bones.
    fn prepared(&self, mut face: anyface::Face, file: Vec<u8>) -> anyface::Result<Face> {
        if face.mouth() == Mouth::Welded && !file.starts_with(b"glTF") {
            let opened = self.engine.open_mouth(&face, &tell).and_then(|opened| {
                let options = opened.face_options(&face);
                self.engine.find(&opened.mesh, &options, &tell)
            });
            // If this fails, the lips stay one surface, and the face's notes say so.
            face = opened.unwrap_or(face);
        }
        let face = Face::new(face, file)?;
        self.pose(&face, &[0.0; _])?;
        Ok(face)
    }

    fn speaker(&self, emotion: &str, alive: bool) -> anyface::Result<Speaker> {
        let (ears, shapes) = (self.ears.clone(), Arc::clone(&self.shapes));
        Speaker::new(self.engine.stream()?, ears, shapes, (emotion, alive))
    }

    /// Displacements of all vertices, for these displacements of the mean face's landmarks.
    fn pose(&self, face: &Face, landmarks: &Landmarks) -> anyface::Result<Vec<f32>> {
        let motion = landmark_motion(landmarks.to_vec(), 1.0);
        let animation = Collector::collect(|sink| {
            self.engine
                .spread(&face.face, &motion, sink, anyface::job::SILENT)
        })?;
        Ok(animation.vertices.displacements.into_raw_vec_and_offset().0)
    }
}

/// Displacements `[T * 68 * 3]` as motion.
fn landmark_motion(values: Vec<f32>, fps: f64) -> Motion {
    let shape = (values.len() / LANDMARK_NUMBERS, LANDMARK_NUMBERS / 3, 3);
    let displacements = Array3::from_shape_vec(shape, values).expect("whole frames");
    Motion::Landmarks(LandmarkClip { displacements, fps })
}

thread_local! {
    /// The page's function that is told the progress while a face is being found. The library may
    /// call back from any thread, so its callback cannot hold the function; here there is only one.
    static LISTENER: RefCell<Option<js_sys::Function>> = const { RefCell::new(None) };
}

fn tell(progress: Progress) -> bool {
    let listener = LISTENER.with_borrow(Clone::clone);
    if let Some(listener) = listener {
        let (stage, share) = (progress.stage.into(), progress.fraction.into());
        // An error in the page's function is the page's own concern.
        let _ = listener.call2(&JsValue::NULL, &stage, &share);
    }
    true
}
