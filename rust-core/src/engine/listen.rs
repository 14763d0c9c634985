//! What is said when, as the engine hears it.

use std::sync::Arc;

use super::Engine;
use crate::{
    Result,
    annotation::{Annotation, Symbols, Tier},
    audio::Waveform,
    job::{ProgressFn, SILENT},
    speech::Heard,
};

impl Engine {
    /// What is heard in speech: where the lips are together for p, b, m and their kin.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use.
    pub fn listen(&self, waveform: &Waveform) -> Result<Annotation> {
        self.threads(|| Ok(closures_of(&self.hear(waveform, SILENT)?)))
    }

    /// The same, with tiers of phones and, where a text is given, of its words. The tier of closures is
    /// the one of [`Engine::listen`], and alone says when lips close.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use; those of [`crate::speech::PhoneModel::said`].
    pub fn listen_to_phones(&self, waveform: &Waveform, text: Option<&str>) -> Result<Annotation> {
        self.threads(|| {
            let heard = self.hear(waveform, SILENT)?;
            let said = self.phone_model.get()?.said(heard.sound(), text)?;
            let mut found = closures_of(&heard);
            for tier in &mut found.tiers {
                tier.symbols = Symbols::Closures;
            }
            let mut add = |symbols, intervals| found.tiers.push(Tier { symbols, intervals });
            add(Symbols::Phones, said.phones);
            if text.is_some() {
                add(Symbols::Words, said.words);
            }
            Ok(found)
        })
    }

    /// Listens to a sound, with what hears phones in it.
    pub(super) fn hear(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<Heard> {
        let mut heard = Heard::of(waveform, self.encoder.get()?, progress)?;
        heard.phones = Some(Arc::clone(self.phone_model.get()?));
        heard.ear = Some(Arc::clone(self.ear.get()?));
        Ok(heard)
    }
}

fn closures_of(heard: &Heard) -> Annotation {
    let mut closures = heard.contacts(None).together.intervals();
    for interval in &mut closures {
        interval[1] = interval[1].min(heard.duration_s).max(interval[0]);
    }
    Annotation::of_closures(&closures, heard.duration_s)
}
