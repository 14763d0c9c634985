//! Anyface in a browser: a head becomes a [`Face`], a sound or a microphone moves it frame by frame.
//!
//! The library contains no weights: a page fetches those of [`model_names`] and passes each to
//! [`add_model`] before it makes an [`Engine`]. Everything runs on the calling thread, so a page
//! should call it from a worker.

mod clip;
mod engine;
mod face;
mod live;
mod shapes;
mod speaker;

use anyface::systems::built_in_models;
use wasm_bindgen::prelude::*;

pub use clip::Clip;
pub use engine::Engine;
pub use face::Face;
pub use live::Live;

/// Names of the models that an engine needs, one a line.
const MODELS: &str = include_str!("../models.txt");

/// Names of the models that an engine needs. The file of each is `NAME/model.planes.gz`.
#[wasm_bindgen(js_name = modelNames)]
pub fn model_names() -> Vec<String> {
    MODELS.lines().map(str::to_owned).collect()
}

/// Adds a model from the bytes of its `model.planes.gz`.
///
/// # Errors
/// If the name is unknown, the bytes are damaged, or the model is there already.
#[wasm_bindgen(js_name = addModel)]
pub fn add_model(name: &str, bytes: Vec<u8>) -> Result<(), JsError> {
    let known = built_in_models().find(|model| model.name == name);
    let Some(model) = known else {
        let known = model_names().join(", ");
        return Err(JsError::new(&format!(
            "model: expected one of {known}, got {name:?}"
        )));
    };
    Ok(model.take_fetched(bytes)?)
}

/// Emotions that a face can show.
#[wasm_bindgen(js_name = emotionNames)]
pub fn emotion_names() -> Vec<String> {
    anyface::conditions::EMOTIONS.map(str::to_owned).to_vec()
}

/// Expressions that a face can show for a while, such as `smile`.
#[wasm_bindgen(js_name = eventNames)]
pub fn event_names() -> Vec<String> {
    let menu = anyface::conditions::MENU.iter();
    menu.map(|(name, _)| (*name).to_owned()).collect()
}
