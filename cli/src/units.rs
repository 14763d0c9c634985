//! `anyface units`: the action units of an expression.

use anyface::{
    Result,
    conditions::{ACTION_UNITS, Expression, MENU, Side},
    text::{TextUnits, Understood},
};
use clap::Args;

use crate::{arguments::SharedArgs, console::Console};

/// Show the action units that an expression asks for, such as "a sarcastic laugh" or "left wink"
#[derive(Args)]
pub struct Units {
    /// Units or English words, as `--event` takes them [default: all words with fixed units, and their units]
    text: Option<String>,
}

impl Units {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let Some(text) = &self.text else {
            let rows = MENU.map(|(name, units)| format!("{name:<16} {units}\n"));
            let menu = MENU.map(|(name, units)| serde_json::json!({"name": name, "units": units}));
            return console.value(&serde_json::json!({"menu": menu}), &rows.concat());
        };
        let understood = understood(text, shared)?;
        console.value(&json(text, &understood), &table(&understood))
    }
}

/// The fixed units of an expression, or else those that the text model finds.
fn understood(text: &str, shared: &SharedArgs) -> Result<Understood> {
    let expression = Expression::parse(text)?;
    if expression.units.is_empty() {
        return TextUnits::open(shared.weights())?.understood_or_error(&expression.said);
    }
    let certain = |(unit, side): (usize, Side)| (unit, side, expression.strength, 1.0);
    Ok(Understood {
        units: expression.units.into_iter().map(certain).collect(),
        hint: None,
    })
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
