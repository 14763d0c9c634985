//! `anyface info`: what this build is and what it carries.

use clap::Args;

use super::{arguments::SharedArgs, console::Console};
use crate::{Result, weights::BUILT_IN};

/// Show the version, the built-in weights and their cards
#[derive(Args)]
pub(super) struct Info {
    /// Print the whole card of this model
    #[arg(long, value_name = "MODEL")]
    card: Option<String>,
}

impl Info {
    pub(super) fn run(&self, _shared: &SharedArgs, console: &Console) -> Result<()> {
        if let Some(name) = &self.card {
            let card = card(name)?;
            console.value(&serde_json::json!({"model": name, "card": card}), card);
            return Ok(());
        }
        let version = env!("CARGO_PKG_VERSION");
        let threads = rayon::current_num_threads();
        let models: Vec<_> = BUILT_IN
            .iter()
            .map(|model| serde_json::json!({"name": model.name, "card": model.card}))
            .collect();
        let value = serde_json::json!({
            "version": version,
            "threads": threads,
            "models": models,
            "meshes": ["obj", "ply"],
            "sounds": ["wav", "mp3", "flac", "ogg", "m4a", "aiff"],
            "results": ["npz", "pc2", "mdd"],
        });
        let mut text = format!("anyface {version}, {threads} threads\nbuilt-in weights:\n");
        for model in &BUILT_IN {
            text += &format!("  {:<16} {}\n", model.name, title(model.card));
        }
        text += "`anyface info --card MODEL` prints a model's card";
        console.value(&value, &text);
        Ok(())
    }
}

/// The heading of a card, without its mark and the model's own name.
fn title(card: &str) -> &str {
    let heading = card.lines().next().unwrap_or("").trim_start_matches('#');
    heading
        .split_once(": ")
        .map_or(heading, |(_, rest)| rest)
        .trim()
}

fn card(name: &str) -> Result<&'static str> {
    BUILT_IN
        .iter()
        .find(|model| model.name == name)
        .map(|model| model.card)
        .ok_or_else(|| {
            let known: Vec<&str> = BUILT_IN.iter().map(|model| model.name).collect();
            crate::Error::InvalidInput(format!(
                "model: expected one of {}, got {name:?}",
                known.join(", ")
            ))
        })
}
