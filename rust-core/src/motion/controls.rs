//! Controls with which an artist changes landmark motion after it was sampled.

use crate::conditions::{Control, ControlStage, ControlValues, Controls};

/// Controls of what moves beside the face: the engine obeys them, for every system.
pub(crate) const HEAD: &str = "head_motion";
pub(crate) const GAZE: &str = "gaze";
pub(crate) const TONGUE: &str = "tongue";
/// Obeyed both by the face and by the head.
pub(crate) const BREATH: &str = "breath";
pub(crate) const ARTICULATION: &str = "articulation";
pub(crate) const ONSET: &str = "onset";
/// The controls that move nothing of the face itself.
pub(crate) const BESIDE_THE_FACE: [&str; 3] = [HEAD, GAZE, TONGUE];

/// One entry for each control. The struct, its defaults and the entries that interfaces show all
/// come from it.
macro_rules! performance_controls {
    ($($name:ident: $label:literal, $unit:literal, $range:expr, default $default:literal,
        neutral $neutral:literal, $animatable:ident, $help:literal;)*) => {
        /// Controls over sampled landmark motion. Changing one needs no new sampling.
        ///
        /// The default opens the mouth as far as the voice's effort says. It adds the motion around speech:
        /// blinks, brow raises, head, gaze, tongue, breath, and slow changes that make one take differ from
        /// another.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct PerformanceControls {
            $(#[doc = $help] pub $name: f32,)*
        }

        /// The controls as interfaces show them.
        pub static PERFORMANCE_CONTROLS: &[Control] = &[$(Control {
            name: stringify!($name),
            label: $label,
            help: $help,
            unit: $unit,
            values: ControlValues::Real,
            low: $range[0],
            high: $range[1],
            default: $default,
            neutral: $neutral,
            stage: ControlStage::Motion,
            is_animatable: $animatable,
        },)*];

        impl Default for PerformanceControls {
            fn default() -> Self {
                PerformanceControls { $($name: $default,)* }
            }
        }

        impl PerformanceControls {
            /// Leaves the sampled motion unchanged. For evaluation.
            pub fn as_sampled() -> Self {
                PerformanceControls { $($name: $neutral,)* }
            }
        }

        impl From<&Controls> for PerformanceControls {
            /// Controls that are not set get their defaults.
            fn from(controls: &Controls) -> Self {
                PerformanceControls {
                    $($name: controls.get(stringify!($name)).unwrap_or($default),)*
                }
            }
        }

        impl From<PerformanceControls> for Controls {
            fn from(controls: PerformanceControls) -> Self {
                let mut out = Controls::default();
                $(out.set(stringify!($name), controls.$name);)*
                out
            }
        }
    };
}

performance_controls! {
    articulation: "Articulation", "", [0.0, 2.0], default 1.0, neutral 1.0, true,
        "Strength of what speech does to mouth and jaw, around the emotion's own expression; closed \
         lips stay closed.";
    effort: "Effort", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "How much a voice that shouts opens the mouth further, and one that whispers less; closed lips stay \
         closed.";
    jaw: "Jaw", "", [0.0, 2.0], default 1.0, neutral 1.0, true,
        "How far speech moves the jaw; closed lips stay closed.";
    rounding: "Rounding", "", [0.0, 2.0], default 1.0, neutral 1.0, true,
        "How far lips come forward and together at the sides in words such as who and blue.";
    width: "Width", "", [0.0, 2.0], default 1.0, neutral 1.0, true,
        "How much speech widens and narrows the mouth, beside rounding.";
    smoothing_s: "Smoothing", "s", [0.0, 0.1], default 0.0, neutral 0.0, false,
        "Smoothing over time in seconds; closed lips stay closed.";
    upper_face: "Upper Face", "", [0.0, 2.0], default 1.0, neutral 1.0, true,
        "Strength of brows, lids and the bridge of the nose; blinks stay.";
    blinks_per_minute: "Blinks per Minute", "per_minute", [0.0, 60.0], default 15.0, neutral 0.0, false,
        "How often both eyes blink in a minute.";
    brow_accents: "Brow Accents", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "Strength of the raises of the brows on stressed syllables.";
    asymmetry: "Asymmetry", "", [-1.0, 1.0], default 0.0, neutral 0.0, true,
        "More motion of brows and mouth corners on the subject's right (-1) or left (1) side.";
    head_motion: "Head Motion", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "Strength of the head's nods on stressed syllables, of its drift and posture; a track beside the \
         face.";
    gaze: "Gaze", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "Strength of the eyes' leaps, rests and looks away; a track beside the face, which the lids follow.";
    tongue: "Tongue", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "How far the tongue rises and comes forward for l, th, t d n s z, k g and the vowels; a track beside the \
         face, which moves a tongue that is a part of its own.";
    breath: "Breath", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "How far lips part and the head rises before phrases; lips that close stay closed.";
    onset: "Onset", "", [0.0, 2.0], default 1.0, neutral 1.0, false,
        "How long feelings and events take to come and go: 1 as on a face (0.3 to 0.6 s to come, longer to go; \
         blinks and eyes are faster), 0 at once.";
    variety: "Variety", "", [0.0, 2.0], default 1.0, neutral 0.0, true,
        "How much takes of different seeds differ in opening, width, sides and brows, and how much an emotion \
         gestures; closed lips stay closed.";
}

/// Finds one of [`PERFORMANCE_CONTROLS`] by its name, for systems that have only some of them.
#[cfg(feature = "cafe-talk")]
pub(crate) const fn control_named(name: &str) -> Control {
    let mut n = 0;
    while !is_same(PERFORMANCE_CONTROLS[n].name.as_bytes(), name.as_bytes()) {
        n += 1;
    }
    PERFORMANCE_CONTROLS[n]
}

#[cfg(feature = "cafe-talk")]
const fn is_same(a: &[u8], b: &[u8]) -> bool {
    let mut n = 0;
    while n < a.len() && n < b.len() && a[n] == b[n] {
        n += 1;
    }
    n == a.len() && n == b.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_presets_are_in_range_and_survive_the_way_through_their_names() {
        for preset in [
            PerformanceControls::default(),
            PerformanceControls::as_sampled(),
        ] {
            let named = Controls::from(preset);
            named
                .check(PERFORMANCE_CONTROLS, ControlStage::Motion)
                .unwrap();
            assert_eq!(PerformanceControls::from(&named), preset);
            assert!(named.ask_nothing(PERFORMANCE_CONTROLS));
        }
        let controls = Controls::default().with("asymmetry", 0.5);
        assert_eq!(PerformanceControls::from(&controls).asymmetry, 0.5);
        assert!(!controls.ask_nothing(PERFORMANCE_CONTROLS));
    }
}
