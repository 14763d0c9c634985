//! Turns takes of one face into weights of its ARKit shapes.

use super::{Engine, Performance};
use crate::{
    Result,
    face::Face,
    job::ProgressFn,
    motion::{Motion, WeightClip},
    output::TakeWeights,
    rig::{ARKIT, ShapeSource},
    spread::Collector,
};

impl Engine {
    /// Prepares what turns takes of a face into weights of its ARKit shapes. It is made once for
    /// any number of takes.
    ///
    /// # Errors
    /// Those of [`Engine::rig`].
    pub fn take_weights(&self, face: &Face, progress: ProgressFn<'_>) -> Result<TakeWeights> {
        let rig = self.rig(face, ShapeSource::Network, progress)?;
        self.threads(|| {
            let deformer = self.deformer(face, progress)?;
            Ok(TakeWeights::new(face, rig, deformer.as_ref()))
        })
    }

    /// Turns a performance into weights `[T, 52]` of [`ARKIT`]'s shapes on a face, 0 to 1. The
    /// weights are those of a solve over all vertices, in which lips that meet take precedence, and
    /// the eyes look where the performance has them look. A motion that already consists of such
    /// weights stays as it is, except that its lips are made to meet on this face. `ready`: made
    /// for the same face.
    ///
    /// # Errors
    /// Those of [`Engine::spread`] and of [`crate::rig::solve`].
    pub fn weights_on(
        &self,
        face: &Face,
        ready: &TakeWeights,
        performance: &Performance,
        progress: ProgressFn<'_>,
    ) -> Result<WeightClip> {
        let life = &performance.life;
        let quick = |clip| ready.of_landmarks(face, clip, life, progress);
        let weights = self.threads(|| match &performance.motion {
            Motion::Landmarks(clip) => quick(clip),
            Motion::Weights(clip) => Ok(Some(ready.of_weights(face, clip, life))),
            Motion::Codes(_) => Ok(None),
        })?;
        let weights = match weights {
            Some(weights) => weights,
            None => {
                let clip =
                    Collector::collect(|sink| self.spread(face, performance, sink, progress))?;
                self.threads(|| ready.of_frames(&clip.vertices.displacements, life, progress))?
            }
        };
        Ok(WeightClip {
            names: ARKIT.map(str::to_owned).to_vec(),
            weights,
            fps: performance.motion.fps(),
            together: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        CachePolicy, EngineOptions, MotionRequest,
        audio::Waveform,
        conditions::EmotionCurve,
        face::FaceOptions,
        job::SILENT,
        mesh::{LandmarkSource, Mesh},
    };

    /// One second of a buzz that comes and goes.
    fn sound() -> Waveform {
        let at = |i: usize| {
            let t = i as f32 / 16_000.0;
            let buzz: f32 = (1..20).map(|k| (754.0 * k as f32 * t).sin()).sum();
            0.05 * buzz * (12.0 * t).sin().powi(2)
        };
        Waveform {
            samples: (0..16_000).map(at).collect(),
        }
    }

    #[test]
    fn weights_without_frames_are_those_of_all_frames() {
        let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let head = head.join("../weights/shared/default_head");
        let mesh = Mesh::read(head.join("head.obj")).unwrap();
        let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json")).unwrap());
        let options = EngineOptions {
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        };
        let engine = Engine::new(options).unwrap();
        let options = FaceOptions {
            landmarks,
            ..FaceOptions::default()
        };
        let face = engine.prepare(&mesh, &options, SILENT).unwrap();
        let ready = engine.take_weights(&face, SILENT).unwrap();
        assert!(ready.is_quick());
        for emotion in ["off", "happy:0.8"] {
            let request = MotionRequest {
                emotion: EmotionCurve::parse(emotion).unwrap(),
                ..MotionRequest::default()
            };
            let performance = engine.perform(&sound(), &request, SILENT).unwrap();
            let quick = engine
                .weights_on(&face, &ready, &performance, SILENT)
                .unwrap();
            let clip = Collector::collect(|sink| engine.spread(&face, &performance, sink, SILENT));
            let frames = clip.unwrap().vertices.displacements;
            let slow = ready.of_frames(&frames, &performance.life, SILENT).unwrap();
            assert_eq!(quick.weights.dim(), slow.dim());
            assert!(slow.iter().any(|w| *w > 0.2));
            for ((at, a), b) in quick.weights.indexed_iter().zip(&slow) {
                assert!((a - b).abs() < 1e-3, "{emotion} {at:?}: {a} and {b}");
            }
        }
    }
}
