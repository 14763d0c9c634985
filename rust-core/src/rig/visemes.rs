//! Visemes as mixtures of ARKit shapes.

use std::collections::BTreeMap;

use ndarray::Array2;

use super::{ARKIT, VISEMES};
use crate::{Error, Result};

/// `[15, 52]`, weight of each ARKit shape in each viseme, from `config.json`.
///
/// # Errors
/// `Weights` for a missing viseme or an unknown shape.
pub(super) fn mixtures(table: &BTreeMap<String, BTreeMap<String, f32>>) -> Result<Array2<f32>> {
    let mut out = Array2::zeros((VISEMES.len(), ARKIT.len()));
    for (row, viseme) in VISEMES.iter().enumerate() {
        let mixture = table.get(*viseme).ok_or_else(|| {
            Error::Weights(format!(
                "rig: config.json: expected a viseme {viseme}, got none"
            ))
        })?;
        for (shape, &weight) in mixture {
            let column = ARKIT.iter().position(|name| name == shape).ok_or_else(|| {
                Error::Weights(format!(
                    "rig: config.json: {viseme}: no ARKit shape {shape}"
                ))
            })?;
            out[[row, column]] = weight;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_that_lacks_a_viseme_is_refused() {
        let mut table: BTreeMap<String, BTreeMap<String, f32>> = VISEMES
            .iter()
            .map(|name| ((*name).to_owned(), BTreeMap::new()))
            .collect();
        table.insert(
            "viseme_aa".into(),
            BTreeMap::from([("jawOpen".into(), 0.5)]),
        );
        let mixed = mixtures(&table).unwrap();
        assert_eq!(mixed.sum(), 0.5);
        table.remove("viseme_FF");
        assert!(
            mixtures(&table)
                .unwrap_err()
                .to_string()
                .contains("viseme_FF")
        );
    }
}
