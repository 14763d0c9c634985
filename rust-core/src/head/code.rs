//! The coefficients that choose a head: random ones, directions, and checks.

use super::{COEFFICIENTS, Head, check};
use crate::{Error, Result, diffusion::frame_noise};

/// A coefficient beyond this, or a root mean square beyond [`FAR_ON_AVERAGE`], is far outside the
/// heads that were learned.
const FAR: f32 = 5.0;
const FAR_ON_AVERAGE: f32 = 2.0;
/// The largest value of a slider, to either side.
pub(super) const SLIDER: f32 = 4.0;

impl Head {
    /// Draws the coefficients of a head, `[100]`, from N(0, 1). A seed always gives the same head.
    pub fn random(seed: u64) -> Vec<f32> {
        frame_noise(seed, 0, 1, COEFFICIENTS)
            .into_raw_vec_and_offset()
            .0
    }

    /// How far `coefficients` lie along each direction, `[D]`.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong number of coefficients or one that is not finite.
    pub fn along(&self, coefficients: &[f32]) -> Result<Vec<f32>> {
        check("coefficients", coefficients, COEFFICIENTS)?;
        Ok(self.directions.dot(&ndarray::aview1(coefficients)).to_vec())
    }

    /// Sets the value of `coefficients` along a direction. Their values along other directions
    /// stay.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong number of coefficients, an unknown direction or a value outside
    /// −4 to 4.
    pub fn set_along(&self, coefficients: &mut [f32], direction: usize, value: f32) -> Result<()> {
        if !(-SLIDER..=SLIDER).contains(&value) {
            let message = format!("direction: expected -{SLIDER} to {SLIDER}, got {value}");
            return Err(Error::InvalidInput(message));
        }
        let there = self.along(coefficients)?;
        let known = there.len();
        let there = there.get(direction).ok_or_else(|| {
            let message = format!("direction: expected a number below {known}, got {direction}");
            Error::InvalidInput(message)
        })?;
        let row = self.directions.row(direction);
        coefficients
            .iter_mut()
            .zip(row)
            .for_each(|(c, d)| *c += (value - there) * d);
        Ok(())
    }

    /// Checks that coefficients are not far outside the heads that were learned. With `pull_back`
    /// it brings them back inside instead of failing.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong number of coefficients, one that is not finite, or, without
    /// `pull_back`, coefficients far outside.
    pub fn checked(mut coefficients: Vec<f32>, pull_back: bool) -> Result<Vec<f32>> {
        check("coefficients", &coefficients, COEFFICIENTS)?;
        let largest = coefficients
            .iter()
            .fold(0.0f32, |most, c| most.max(c.abs()));
        let average = rms(&coefficients);
        if largest <= FAR && average <= FAR_ON_AVERAGE {
            return Ok(coefficients);
        }
        if !pull_back {
            return Err(Error::InvalidInput(format!(
                "coefficients: expected numbers of N(0, 1), none beyond {FAR} and {FAR_ON_AVERAGE} on average, got \
                 {largest:.1} and {average:.1}; no such head was learned. They can be pulled back"
            )));
        }
        coefficients
            .iter_mut()
            .for_each(|c| *c = c.clamp(-FAR, FAR));
        let scale = (FAR_ON_AVERAGE / rms(&coefficients)).min(1.0);
        coefficients.iter_mut().for_each(|c| *c *= scale);
        Ok(coefficients)
    }

    /// z_id `[Z]` of coefficients `[100]`.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong number of coefficients or one that is not finite.
    pub fn identity_code(&self, coefficients: &[f32]) -> Result<Vec<f32>> {
        check("coefficients", coefficients, COEFFICIENTS)?;
        let mut z = vec![0.0; self.config.identity_code()];
        self.identity_code.forward_row(coefficients, &mut z);
        Ok(z)
    }
}

fn rms(values: &[f32]) -> f32 {
    (values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32).sqrt()
}
