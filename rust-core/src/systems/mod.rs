//! One folder per paper, and the registry of them; systems never import each other.
//!
//! A system consists of its folder, its `mod` line and its entry in [`SYSTEMS`], all under the
//! feature of its name. The rest compiles without these three. `CONTRIBUTING.md` says how to add
//! one.

#[cfg(feature = "cafe-talk")]
pub(crate) mod cafe_talk;
#[cfg(feature = "emoface")]
pub mod emoface;
#[cfg(feature = "facetalk")]
pub(crate) mod facetalk;
#[cfg(feature = "freetalk")]
pub(crate) mod freetalk;

mod describe;
mod fields;
mod slider;
mod system;
mod windows;

use crate::{Error, Result, deform, head, mesh, models::BuiltIn, motion, rig, speech, text};

pub use describe::describe;
pub(crate) use fields::check_abilities;
pub use fields::{FIELDS, Field, FieldKind, FieldValue, NamedValue, Need, NumberRange, set_field};
pub use slider::Slider;
pub use system::{
    Ability, Description, EmotionControls, EmotionMask, Registration, Sampled, System,
};
pub use windows::Windows;

/// Every system. The first one is the default.
pub static SYSTEMS: &[&Registration] = &[
    #[cfg(feature = "freetalk")]
    &freetalk::REGISTRATION,
    #[cfg(feature = "cafe-talk")]
    &cafe_talk::REGISTRATION,
    #[cfg(feature = "emoface")]
    &emoface::REGISTRATION,
    #[cfg(feature = "facetalk")]
    &facetalk::REGISTRATION,
];

impl Registration {
    /// Checks that the system has an ability. `task`: the requested task, such as `events`.
    ///
    /// # Errors
    /// `InvalidInput`, with the names of the systems that have the ability, if it has not.
    pub fn require(&self, ability: Ability, task: &str) -> Result<()> {
        if self.can(ability) {
            return Ok(());
        }
        let expected = match ability {
            Ability::Events | Ability::Performer => "that shows them",
            Ability::Words => "that understands words",
            Ability::Emotion => "that hears emotion",
            Ability::FirstPose => "that goes on from one",
            Ability::Head => "whose motion moves a head of its own",
        };
        let able = SYSTEMS.iter().filter(|system| system.can(ability));
        let able: Vec<&str> = able.map(|system| system.name).collect();
        let (able, name) = (able.join(", "), self.name);
        Err(Error::InvalidInput(format!(
            "{task}: expected a system {expected} ({able}), got {name}"
        )))
    }

    /// Finds the system of this name, or the default one for `None`.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown name.
    pub fn find(name: Option<&str>) -> Result<&'static Registration> {
        let mut systems = SYSTEMS.iter().copied();
        let registration = match name {
            Some(name) => systems.find(|system| system.name == name),
            None => systems.next(),
        };
        registration.ok_or_else(|| {
            let known: Vec<&str> = SYSTEMS.iter().map(|system| system.name).collect();
            let (known, name) = (known.join(", "), name.unwrap_or_default());
            Error::InvalidInput(format!("system: expected one of {known}, got {name:?}"))
        })
    }
}

/// Lists every built-in model: first those that all systems share, then those of each system.
pub fn built_in_models() -> impl Iterator<Item = &'static BuiltIn> {
    let shared = [
        &speech::TRUNK_MODEL,
        &speech::EAR_MODEL,
        &speech::PHONE_MODEL,
        &speech::PRONUNCIATIONS,
        &speech::EMOTION_ENCODER,
        &speech::EMOTION_EAR,
        &speech::EMOTION_OF_WHISPER,
        &mesh::LANDMARK_MODEL,
        &head::MODEL,
        &head::TOPOLOGY_MODEL,
        &deform::static_weights::MODEL,
        &deform::creases::MODEL,
        &motion::FACE_MODES_MODEL,
        &motion::EXPRESSIONS_MODEL,
        &rig::MODEL,
        &text::MODEL,
    ];
    let of_systems = SYSTEMS
        .iter()
        .flat_map(|system| system.models.iter().copied());
    shared.into_iter().chain(of_systems)
}
