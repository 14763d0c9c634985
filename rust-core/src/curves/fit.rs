//! Fits one curve within limits, and evaluates it in every frame.

use rayon::prelude::*;

use super::{
    search, segment,
    slopes::{self, Curve, Key},
};
use crate::{Error, Result};

/// Fits a curve to `values` that stays within `limits` in every frame. It has a key wherever
/// `fixed` is true, and as few other keys as possible.
///
/// All are `[T]`; limits are positive, in the unit of the values.
///
/// # Errors
/// `InvalidInput` if the lengths differ, a limit is not positive or a value is not finite.
pub fn fit(values: &[f64], limits: &[f64], fixed: &[bool]) -> Result<Curve> {
    check(values, limits, fixed)?;
    Ok(fit_checked(values, limits, fixed))
}

/// Fits several columns in parallel, each with one limit for all its frames.
///
/// # Errors
/// Those of [`fit`]; `InvalidInput` if there is not one limit for each column.
pub fn fit_each(columns: &[Vec<f64>], limits: &[f64], fixed: &[bool]) -> Result<Vec<Curve>> {
    if columns.len() != limits.len() {
        let (columns, limits) = (columns.len(), limits.len());
        let message = format!("curves: expected {columns} limits, got {limits}");
        return Err(Error::InvalidInput(message));
    }
    let one = |(values, &limit): (&Vec<f64>, &f64)| fit(values, &vec![limit; values.len()], fixed);
    columns.par_iter().zip(limits).map(one).collect()
}

/// The value of `curve` in every frame, `[T]`. At its keys it has the values in `values`.
pub fn evaluate(values: &[f64], curve: &[Key]) -> Vec<f64> {
    let mut drawn = values.to_vec();
    for pair in curve.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        let table = segment::Table::of(to.row - from.row);
        for at in 1..table.length {
            let ends = table.ends(at, values[from.row], values[to.row]);
            drawn[from.row + at] = ends + table.slopes(at, from.slope, to.slope);
        }
    }
    drawn
}

/// [`fit`] for inputs that have passed [`check`].
pub(super) fn fit_checked(values: &[f64], limits: &[f64], fixed: &[bool]) -> Curve {
    let rows = search::rows(values, limits, fixed);
    slopes::through(values, limits, &rows)
}

/// The checks of [`fit`].
pub(super) fn check(values: &[f64], limits: &[f64], fixed: &[bool]) -> Result<()> {
    if values.len() != limits.len() || values.len() != fixed.len() {
        return Err(Error::InvalidInput(format!(
            "curves: expected a value, a limit and a mark for each frame, got {}, {} and {}",
            values.len(),
            limits.len(),
            fixed.len()
        )));
    }
    if values.iter().any(|x| !x.is_finite()) {
        let message = "curves: expected finite values, got NaN or infinity";
        return Err(Error::InvalidInput(message.into()));
    }
    match limits.iter().find(|&&x| x.is_nan() || x <= 0.0) {
        Some(limit) => Err(Error::InvalidInput(format!(
            "curves: expected limits above 0, got {limit}"
        ))),
        None => Ok(()),
    }
}
