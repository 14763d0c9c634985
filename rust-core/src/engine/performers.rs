//! Learns performers: what one person's mouth does differently.

use std::path::Path;

use ndarray::Array1;

use super::Engine;
use crate::{
    Result,
    audio::{PROSODY_FPS, Prosody, Waveform},
    job::{Progress, ProgressFn},
    motion::{
        LandmarkClip, Performer,
        performer::{Lesson, learn},
    },
    output::read_captured_face,
    systems::Ability,
};

/// A sound, and how the face moved that spoke it.
#[derive(Debug, Clone)]
pub struct CapturedTake {
    /// A name for messages and for the performer's card.
    pub name: String,
    /// The sound.
    pub sound: Waveform,
    /// The motion from the start of the sound on, canonical metres, at any frame rate.
    pub motion: LandmarkClip,
    /// What Anyface had generated before somebody corrected it into `motion`: then the corrections alone are
    /// learned. `None` for other faces.
    pub generated: Option<LandmarkClip>,
    /// `[T]`, how much each frame of `motion` counts, above 0. `None` counts all alike.
    pub frame_weights: Option<Array1<f32>>,
}

impl Engine {
    /// Learns how a person's mouth differs from that of the system's own speaker. Fifteen seconds are enough; more is
    /// better.
    ///
    /// # Errors
    /// `InvalidInput` for a system that takes no performers, and those of [`learn`]; `Audio` for a sound too short to
    /// use; `Cancelled`.
    pub fn learn_performer(
        &self,
        takes: &[CapturedTake],
        progress: ProgressFn<'_>,
    ) -> Result<Performer> {
        self.registration
            .require(Ability::Performer, "performers")?;
        self.threads(|| {
            let (mut lessons, mut live_lessons) = (Vec::new(), Vec::new());
            for (number, take) in takes.iter().enumerate() {
                let share = |p: Progress| {
                    let fraction = (number as f32 + p.fraction) / takes.len() as f32;
                    progress(Progress { fraction, ..p })
                };
                let lesson = self.lesson(take, &share)?;
                live_lessons.extend(self.live_lesson(take, &lesson)?);
                lessons.push(lesson);
            }
            let (system, encoder) = (self.registration.name, self.encoder.get()?.name());
            let performer = learn(system, encoder, lessons)?;
            if live_lessons.is_empty() {
                return Ok(performer);
            }
            // A stream hears less. Where nothing is gained it keeps the model's speaker.
            Ok(match learn(system, encoder, live_lessons) {
                Ok(live) => performer.with_live(live),
                Err(why) => performer.without_live(why.to_string()),
            })
        })
    }

    /// Reads a sound, and the motion of the face that spoke it ([`read_captured_face`]). The take is named after
    /// the motion's file, without its folder.
    ///
    /// # Errors
    /// Those of [`Waveform::from_file`] and [`read_captured_face`].
    pub fn captured_take(&self, sound: &Path, motion: &Path) -> Result<CapturedTake> {
        let face = read_captured_face(motion)?;
        // A performer is passed on: folders are nobody's business.
        let name = motion.file_name().unwrap_or(motion.as_os_str());
        Ok(CapturedTake {
            name: name.to_string_lossy().into_owned(),
            sound: Waveform::from_file(sound)?,
            motion: self.landmarks_of(&face.motion)?,
            generated: face.generated,
            frame_weights: face.frame_weights,
        })
    }

    fn lesson(&self, take: &CapturedTake, progress: ProgressFn<'_>) -> Result<Lesson> {
        let heard = self.hear(&take.sound, progress)?;
        let model = self.system.own_speaker(&heard, progress)?;
        let frames = model.displacements.dim().0;
        Ok(Lesson {
            name: take.name.clone(),
            features: heard.features(model.fps),
            speaks: (0..frames)
                .map(|t| speaks(&heard.prosody, t as f64 / model.fps))
                .collect(),
            captured: take.motion.clone(),
            generated: take.generated.clone(),
            frame_weights: take.frame_weights.clone(),
            model,
        })
    }

    /// The lesson of the live stream beside the one of the whole ear.
    fn live_lesson(&self, take: &CapturedTake, lesson: &Lesson) -> Result<Option<Lesson>> {
        let Some((features, model)) = self.system.live_speaker(&take.sound.samples)? else {
            return Ok(None);
        };
        let last = lesson.speaks.len().saturating_sub(1);
        let at = |t: usize| ((t as f64 / model.fps * lesson.model.fps) as usize).min(last);
        Ok(Some(Lesson {
            speaks: (0..features.nrows())
                .map(|t| lesson.speaks[at(t)])
                .collect(),
            features,
            model,
            ..lesson.clone()
        }))
    }
}

fn speaks(prosody: &Prosody, time_s: f64) -> bool {
    let frame = (time_s * PROSODY_FPS) as usize;
    !prosody.pauses.iter().any(|pause| pause.contains(&frame))
}
