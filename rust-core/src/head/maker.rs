//! Heads from numbers: the coefficients of the field's identities, and traits that only the mesh of quads has.

use std::path::Path;

use super::{COEFFICIENTS, Head, MadeHead, Topology, check, code::SLIDER};
use crate::{Error, Result, diffusion::frame_noise, job::ProgressFn};

/// Makes heads from numbers `[N]`: 100 coefficients drawn from N(0, 1), then the traits, −4 to 4
/// each. All 0 is the mean head.
pub struct HeadMaker {
    head: Head,
    topology: Topology,
}

impl HeadMaker {
    /// With the built-in models, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        Ok(HeadMaker {
            head: Head::open(folder)?,
            topology: Topology::open(folder)?,
        })
    }

    /// The field.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// The quads.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// How many numbers a head is, `N`.
    pub fn count(&self) -> usize {
        COEFFICIENTS + self.topology.traits().len()
    }

    /// The numbers of the head of a seed; the coefficients are those of [`Head::random`].
    pub fn random(&self, seed: u64) -> Vec<f32> {
        let traits = frame_noise(seed, 1, 1, self.topology.traits().len());
        let mut numbers = Head::random(seed);
        numbers.extend(traits.iter().map(|x| x.clamp(-SLIDER, SLIDER)));
        numbers
    }

    /// Checks the numbers of a head. Coefficients alone get traits of 0. `pull_back` brings numbers
    /// outside of the learned range back into it.
    ///
    /// # Errors
    /// `InvalidInput` for another number of them, one that is not finite, and without `pull_back` for one that is
    /// far outside.
    pub fn checked(&self, mut numbers: Vec<f32>, pull_back: bool) -> Result<Vec<f32>> {
        if numbers.len() != COEFFICIENTS {
            check("numbers of a head", &numbers, self.count())?;
        }
        let mut traits = numbers.split_off(COEFFICIENTS);
        traits.resize(self.topology.traits().len(), 0.0);
        for (value, name) in traits.iter_mut().zip(self.topology.traits()) {
            if value.abs() > SLIDER && !pull_back {
                return Err(Error::InvalidInput(format!(
                    "{name}: expected -{SLIDER} to {SLIDER}, got {value}; it can be pulled back"
                )));
            }
            *value = value.clamp(-SLIDER, SLIDER);
        }
        let mut checked = Head::checked(numbers, pull_back)?;
        checked.extend(traits);
        Ok(checked)
    }

    /// The numbers between `a` and `b`: share 0 is `a`, share 1 is `b`.
    ///
    /// # Errors
    /// `InvalidInput` for another number of them, ones that are not finite and a share outside 0 to 1.
    pub fn mixture(&self, a: &[f32], b: &[f32], share: f32) -> Result<Vec<f32>> {
        check("numbers of a head", a, self.count())?;
        check("numbers of a head", b, self.count())?;
        if !(0.0..=1.0).contains(&share) {
            let message = format!("mix: expected a share from 0 to 1, got {share}");
            return Err(Error::InvalidInput(message));
        }
        Ok(a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect())
    }

    /// Names of the sliders `[D]`: traits, then the directions in which the coefficients differ, the one that moves the
    /// surface furthest first.
    pub fn directions(&self) -> impl Iterator<Item = &str> {
        let of_field = self.head.config.directions.iter();
        let traits = self.topology.traits().iter().map(String::as_str);
        traits.chain(of_field.map(|direction| direction.name.as_str()))
    }

    /// The number of a slider, by its name.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown name, with the known ones.
    pub fn direction(&self, name: &str) -> Result<usize> {
        let plain_name = name.replace(['_', '-'], " ");
        let named = self.directions().position(|known| known == plain_name);
        named.ok_or_else(|| {
            let names: Vec<&str> = self.directions().collect();
            let message = format!(
                "direction: expected one of {}, got {name:?}",
                names.join(", ")
            );
            Error::InvalidInput(message)
        })
    }

    /// Where each slider stands, `[D]`.
    ///
    /// # Errors
    /// `InvalidInput` for another number of them or one that is not finite.
    pub fn along(&self, numbers: &[f32]) -> Result<Vec<f32>> {
        check("numbers of a head", numbers, self.count())?;
        let (coefficients, traits) = numbers.split_at(COEFFICIENTS);
        let mut along = traits.to_vec();
        along.extend(self.head.along(coefficients)?);
        Ok(along)
    }

    /// Sets a slider; the others stay.
    ///
    /// # Errors
    /// `InvalidInput` for another number of numbers, an unknown slider and a value outside −4 to 4.
    pub fn set_along(&self, numbers: &mut [f32], direction: usize, value: f32) -> Result<()> {
        check("numbers of a head", numbers, self.count())?;
        let traits = self.topology.traits().len();
        let (coefficients, of_traits) = numbers.split_at_mut(COEFFICIENTS);
        let Some(place) = of_traits.get_mut(direction) else {
            return self.head.set_along(coefficients, direction - traits, value);
        };
        if !(-SLIDER..=SLIDER).contains(&value) {
            let message = format!("direction: expected -{SLIDER} to {SLIDER}, got {value}");
            return Err(Error::InvalidInput(message));
        }
        *place = value;
        Ok(())
    }

    /// The head at rest as clean quads; `parts` are eyes, teeth, tongue, lashes and brows.
    ///
    /// # Errors
    /// `InvalidInput` for another number of numbers or one that is not finite.
    pub fn mesh(&self, numbers: &[f32], parts: bool) -> Result<MadeHead> {
        self.topology.mesh(numbers, parts)
    }

    /// The surface of the field at rest, with `resolution` cells along the longest side of the grid. It knows the
    /// coefficients alone: traits leave it as it is.
    ///
    /// # Errors
    /// `InvalidInput` for another number of numbers, and as [`super::OneHead::mesh`]; `Cancelled`.
    pub fn surface(
        &self,
        numbers: &[f32],
        resolution: usize,
        progress: ProgressFn<'_>,
    ) -> Result<MadeHead> {
        check("numbers of a head", numbers, self.count())?;
        let code = self.head.identity_code(&numbers[..COEFFICIENTS])?;
        self.head.one(code)?.mesh(resolution, progress)
    }
}
