//! Rejects NaN and infinity, both in input and in results.

use ndarray::ArrayViewD;

use crate::{Error, Result};

/// Rejects input that is not finite. The first axis of `values` is frames or rows.
///
/// # Errors
/// `InvalidInput` that names the first frame.
pub(crate) fn check_finite(what: &str, values: ArrayViewD<'_, f32>) -> Result<()> {
    match first_bad(values) {
        None => Ok(()),
        Some(row) => Err(Error::InvalidInput(format!(
            "{what}: expected finite numbers, got NaN or infinity in frame {row}"
        ))),
    }
}

/// Rejects a result that is not finite: its input was too large for single precision.
///
/// # Errors
/// `Numerics` that names the first frame.
pub(crate) fn check_result(what: &str, values: ArrayViewD<'_, f32>) -> Result<()> {
    match first_bad(values) {
        None => Ok(()),
        Some(row) => Err(Error::Numerics(format!(
            "{what}: frame {row} is not finite; are the mesh, its motion or the weights of the models out of \
             all measure?"
        ))),
    }
}

/// The first row with a value that is not finite.
fn first_bad(values: ArrayViewD<'_, f32>) -> Option<usize> {
    let rows = values.shape().first().copied().unwrap_or(1).max(1);
    let per_row = (values.len() / rows).max(1);
    let at = values.iter().position(|x| !x.is_finite())?;
    Some(at / per_row)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn the_first_frame_that_is_not_finite_is_named() {
        let mut values = Array3::zeros((4, 68, 3));
        assert!(check_result("motion", values.view().into_dyn()).is_ok());
        (values[[2, 5, 1]], values[[3, 0, 0]]) = (f32::INFINITY, f32::NAN);
        let error = check_result("motion", values.view().into_dyn()).unwrap_err();
        assert!(
            matches!(&error, Error::Numerics(m) if m.contains("frame 2")),
            "{error}"
        );
        let error = check_finite("motion", values.view().into_dyn()).unwrap_err();
        assert!(
            matches!(&error, Error::InvalidInput(m) if m.contains("frame 2")),
            "{error}"
        );
    }
}
