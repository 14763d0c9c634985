//! Data that all systems of Anyface share: models of speech, phones, emotion, landmarks,
//! deformation and shapes, and the default head.

/// A model.
pub struct Model {
    /// Its folder's name.
    pub name: &'static str,
    /// `model.planes.gz`: the bytes of a `model.safetensors`, those at even offsets before those at
    /// odd ones, in gzip. Large matrices are 8-bit numbers with a scale for each row; tensors that
    /// need more precision are f16 or f32. Empty if weights are not embedded.
    pub weights: &'static [u8],
    /// `config.json`.
    pub config: &'static str,
    /// Its model card, Markdown.
    pub card: &'static str,
}

/// The weights in a folder of the crate that calls this.
#[doc(hidden)]
#[macro_export]
#[cfg(feature = "embedded")]
macro_rules! weights {
    ($name:literal) => {
        include_bytes!(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/",
            $name,
            "/model.planes.gz"
        ))
    };
}

/// No weights. Without the feature `embedded` the program supplies them itself.
#[doc(hidden)]
#[macro_export]
#[cfg(not(feature = "embedded"))]
macro_rules! weights {
    ($name:literal) => {
        &[]
    };
}

/// The model in a folder of the crate that calls this.
#[macro_export]
macro_rules! model {
    ($name:literal) => {
        $crate::Model {
            name: $name,
            weights: $crate::weights!($name),
            config: include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/",
                $name,
                "/config.json"
            )),
            card: include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/",
                $name,
                "/README.md"
            )),
        }
    };
}

/// Turns what the first layers of Whisper find in speech into features.
pub static EAR: Model = model!("ear");
/// Turns features of the ear into phones.
pub static PHONES: Model = model!("phones");
/// How English words sound.
pub static PRONUNCIATIONS: Model = model!("pronunciations");
/// Hears when the lips are together, while somebody is speaking.
pub static LIVE_CLOSURES: Model = model!("live_closures");
/// Turns a voice into numbers for its emotion.
pub static EMOTION_ENCODER: Model = model!("emotion_encoder");
/// Recognises the emotion of a voice.
pub static EMOTION_EAR: Model = model!("emotion_ear");
/// Recognises the emotion of a voice from the features that Whisper finds in it.
pub static EMOTION_OF_WHISPER: Model = model!("emotion_of_whisper");
/// Finds landmarks on meshes.
pub static LANDMARKS: Model = model!("landmarks");
/// Determines how far each vertex follows the landmarks.
pub static STATIC_WEIGHTS: Model = model!("static_weights");
/// Creases of two reference faces.
pub static CREASES: Model = model!("creases");
/// How ARKit's shapes move the landmarks.
pub static FACE_MODES: Model = model!("face_modes");
/// Motion that emotions add to neutral speech.
pub static EXPRESSIONS: Model = model!("expressions");
/// Makes ARKit's shapes for a mesh.
pub static RIG: Model = model!("rig");

/// The default head, OBJ.
pub const HEAD_OBJ: &str = include_str!("../default_head/head.obj");
/// Its landmarks, JSON.
pub const HEAD_LANDMARKS: &str = include_str!("../default_head/landmarks.json");
