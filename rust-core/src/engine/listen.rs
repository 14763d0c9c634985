//! What is said when, as the engine hears it.

use super::Engine;
use crate::{
    Result,
    annotation::{Annotation, Symbols, Tier},
    audio::Waveform,
    speech::{Heard, PhoneModel},
};

impl Engine {
    /// What is heard in speech: where the lips are together for p, b, m and their kin.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use.
    pub fn listen(&self, waveform: &Waveform) -> Result<Annotation> {
        self.threads(|| Ok(self.closures_of(&Heard::of(waveform, &self.encoder)?)))
    }

    /// The same, with tiers of phones and, where a text is given, of its words. The tier of closures is
    /// the one of [`Engine::listen`], and alone says when lips close.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use; those of [`PhoneModel::open`] and [`PhoneModel::said`].
    pub fn listen_to_phones(&self, waveform: &Waveform, text: Option<&str>) -> Result<Annotation> {
        self.threads(|| {
            let heard = Heard::of(waveform, &self.encoder)?;
            let said = self.phone_model()?.said(&heard, text)?;
            let mut found = self.closures_of(&heard);
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

    fn phone_model(&self) -> Result<&PhoneModel> {
        if let Some(model) = self.phone_model.get() {
            return Ok(model);
        }
        let model = PhoneModel::open(self.model_folder.as_deref())?;
        Ok(self.phone_model.get_or_init(|| model))
    }

    /// As the system hears them.
    fn closures_of(&self, heard: &Heard) -> Annotation {
        let closures = match self.system.description().phones {
            Some(phones) => heard.contacts_with(phones, None).0,
            None => heard.closures(None),
        };
        let mut closures = closures.intervals();
        for interval in &mut closures {
            interval[1] = interval[1].min(heard.duration_s).max(interval[0]);
        }
        Annotation::of_closures(&closures, heard.duration_s)
    }
}
