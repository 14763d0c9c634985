//! Numbers and rows of the values that a request gets.

use anyface::{
    Result,
    systems::{FieldValue, NamedValue},
};
use ndarray::ArrayView2;

/// Rows of so many numbers, without times.
pub(crate) fn rows<'a>(value: &NamedValue<'a>, columns: usize) -> Result<ArrayView2<'a, f64>> {
    match &value.value {
        FieldValue::Rows(None, rows) if rows.ncols() == columns => Ok(*rows),
        _ => value.refuse(format_args!("rows of {columns} without times")),
    }
}

/// A whole number of at least 0.
pub(crate) fn whole(value: &NamedValue<'_>, number: f64) -> Result<u32> {
    if number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number) {
        Ok(number as u32)
    } else {
        refuse(value, "a whole number of at least 0", number)
    }
}

/// The error of one number among those of a value.
pub(crate) fn refuse<T>(value: &NamedValue<'_>, expected: &str, number: f64) -> Result<T> {
    let value = NamedValue {
        name: value.name,
        value: FieldValue::Number(number),
    };
    value.refuse(expected)
}
