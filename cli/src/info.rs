//! `anyface info`: shows the version, the systems and the models.

use anyface::{
    Result,
    models::BuiltIn,
    systems::{SYSTEMS, built_in_models},
};
use clap::Args;

use crate::{arguments::SharedArgs, console::Console};

/// Show the version and the model weights: the built-in ones with their cards, or yours with
/// --weights
#[derive(Args)]
pub struct Info {
    /// Print the whole card of this model
    #[arg(long, value_name = "MODEL")]
    card: Option<String>,
}

impl Info {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        if let Some(name) = &self.card {
            let card = card(name)?;
            return console.value(&serde_json::json!({"model": name, "card": card}), card);
        }
        let version = env!("CARGO_PKG_VERSION");
        let threads = rayon::current_num_threads();
        // Loads the weights, so that broken ones are refused here and not in the middle of later
        // work.
        let requested_weights = shared.weights();
        if requested_weights.is_some() {
            shared.engine()?;
        }
        let mut models = Vec::new();
        let mut lines = String::new();
        for model in built_in_models() {
            let place = model.place(requested_weights)?;
            let source = match &place {
                Some(place) => format!("from {}", place.display()),
                None => title(model.card).to_owned(),
            };
            lines += &format!("  {:<16} {source}\n", model.name);
            models.push(serde_json::json!({"name": model.name, "card": model.card, "from": place}));
        }
        let value = serde_json::json!({
            "version": version,
            "threads": threads,
            "systems": SYSTEMS.iter().map(|system| system.name).collect::<Vec<_>>(),
            "models": models,
            "meshes": ["obj", "ply", "glb", "vrm", "gltf"],
            "sounds": ["wav", "mp3", "flac", "ogg", "m4a", "aiff"],
            "results": ["npz", "pc2", "mdd"],
        });
        let mut text = format!("anyface {version}, {threads} threads\nsystems:\n");
        for system in SYSTEMS {
            text += &format!("  {:<16} {}\n", system.name, system.help);
        }
        text += &format!("weights, built in where nothing else is said:\n{lines}");
        text += "`anyface info --card MODEL` prints a model's card";
        console.value(&value, &text)
    }
}

/// The heading of a card, without the `#` and the model's own name.
fn title(card: &str) -> &str {
    let heading = card.lines().next().unwrap_or("").trim_start_matches('#');
    heading
        .split_once(": ")
        .map_or(heading, |(_, rest)| rest)
        .trim()
}

fn card(name: &str) -> Result<&'static str> {
    let known: Vec<&BuiltIn> = built_in_models().collect();
    let model = known.iter().find(|model| model.name == name);
    model.map(|model| model.card).ok_or_else(|| {
        let known: Vec<&str> = known.iter().map(|model| model.name).collect();
        anyface::Error::InvalidInput(format!(
            "model: expected one of {}, got {name:?}",
            known.join(", ")
        ))
    })
}
