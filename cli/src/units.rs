//! `anyface units`: what a text asks of a face.

use anyface::{
    Result,
    conditions::{ACTION_UNITS, Side},
    text::{TextUnits, Understood},
};
use clap::Args;

use crate::{arguments::SharedArgs, console::Console};

/// Show the action units that a text asks for, such as "a sarcastic laugh"
#[derive(Args)]
pub struct Units {
    /// English words for an expression
    text: String,
}

impl Units {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let understood = TextUnits::open(shared.weights())?.understood_or_error(&self.text)?;
        console.value(&json(&self.text, &understood), &table(&understood))
    }
}

fn json(text: &str, understood: &Understood) -> serde_json::Value {
    let units = understood.units.iter();
    let units: Vec<_> = units
        .map(|(unit, side, strength, confidence)| {
            serde_json::json!({
                "unit": ACTION_UNITS[*unit].name,
                "label": ACTION_UNITS[*unit].label,
                "side": side_name(*side),
                "strength": strength,
                "confidence": confidence,
            })
        })
        .collect();
    serde_json::json!({"text": text, "units": units})
}

fn table(understood: &Understood) -> String {
    let mut text = format!(
        "{:<6} {:<22} {:<6} {:>8} {:>10}\n",
        "unit", "", "side", "strength", "confidence"
    );
    for (unit, side, strength, confidence) in &understood.units {
        let unit = ACTION_UNITS[*unit];
        text += &format!(
            "{:<6} {:<22} {:<6} {strength:>8.2} {confidence:>10.2}\n",
            side.written(unit.name),
            unit.label,
            side_name(*side),
        );
    }
    text
}

fn side_name(side: Side) -> &'static str {
    match side {
        Side::Both => "both",
        Side::Left => "left",
        Side::Right => "right",
    }
}
