//! Finds out what is said in a sound, and when.

use std::sync::Arc;

use super::Engine;
use crate::{
    Result,
    annotation::{Annotation, Symbols, Tier},
    audio::Waveform,
    job::{ProgressFn, SILENT},
    speech::SpeechFeatures,
};

impl Engine {
    /// Finds the times at which the lips are together in speech, for p, b, m and similar sounds.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use.
    pub fn listen(&self, waveform: &Waveform) -> Result<Annotation> {
        self.threads(|| Ok(closures_of(&self.hear(waveform, SILENT)?)))
    }

    /// Like [`Engine::listen`], with an added tier of phones and, if there is a `text`, a tier of
    /// its words. Only the tier of closures says when the lips close. With a text they close for its
    /// p, b and m, as in a performance of that text ([`crate::speech::Script::Text`]).
    ///
    /// # Errors
    /// `Audio` for a sound too short to use; those of [`crate::speech::PhoneModel::said`].
    pub fn listen_to_phones(&self, waveform: &Waveform, text: Option<&str>) -> Result<Annotation> {
        self.threads(|| {
            let mut heard = self.hear(waveform, SILENT)?;
            let (said, rows) = self
                .shared
                .phone_model
                .get()?
                .said(heard.phone_input(), text)?;
            heard.set_phone_rows(rows);
            let mut annotation = closures_of(&heard);
            for tier in &mut annotation.tiers {
                tier.symbols = Symbols::Closures;
            }
            let mut add = |symbols, intervals| annotation.tiers.push(Tier { symbols, intervals });
            add(Symbols::Phones, said.phones);
            if text.is_some() {
                add(Symbols::Words, said.words);
            }
            Ok(annotation)
        })
    }

    /// Analyses a sound, and attaches the models that find phones and emotions in it.
    pub(super) fn hear(
        &self,
        waveform: &Waveform,
        progress: ProgressFn<'_>,
    ) -> Result<SpeechFeatures> {
        let mut heard = SpeechFeatures::of(waveform, self.encoder.get()?, progress)?;
        heard.phones = Some(Arc::clone(self.shared.phone_model.get()?));
        heard.ear = self.shared.whisper_ear.get().ok().map(Arc::clone);
        Ok(heard)
    }
}

fn closures_of(heard: &SpeechFeatures) -> Annotation {
    let mut closures = heard.contacts(None).together.intervals();
    for interval in &mut closures {
        interval[1] = interval[1].min(heard.duration_s).max(interval[0]);
    }
    Annotation::of_closures(&closures, heard.duration_s)
}
