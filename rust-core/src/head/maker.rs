//! Makes heads from numbers: the coefficients of the field's identities, and traits, which only the
//! quad mesh has.

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
    /// Opens the built-in models, or those in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        Ok(HeadMaker {
            head: Head::open(folder)?,
            topology: Topology::open(folder)?,
        })
    }

    /// The head's field.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// The quad mesh.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// How many numbers describe a head, `N`.
    pub fn count(&self) -> usize {
        COEFFICIENTS + self.topology.traits().len()
    }

    /// Random numbers of a head from a seed. The coefficients are those of [`Head::random`].
    pub fn random(&self, seed: u64) -> Vec<f32> {
        let traits = frame_noise(seed, 1, 1, self.topology.traits().len());
        let mut numbers = Head::random(seed);
        numbers.extend(traits.iter().map(|x| x.clamp(-SLIDER, SLIDER)));
        numbers
    }

    /// Checks the numbers of a head. If only coefficients are given, all traits are 0. `pull_back`
    /// brings numbers outside the learned range back into it.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite; without `pull_back` also
    /// for numbers far outside the learned range.
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

    /// Mixes the numbers of two heads linearly: share 0 is `a`, share 1 is `b`.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count, a number that is not finite or a share outside 0 to 1.
    pub fn mixture(&self, a: &[f32], b: &[f32], share: f32) -> Result<Vec<f32>> {
        check("numbers of a head", a, self.count())?;
        check("numbers of a head", b, self.count())?;
        if !(0.0..=1.0).contains(&share) {
            let message = format!("mix: expected a share from 0 to 1, got {share}");
            return Err(Error::InvalidInput(message));
        }
        Ok(a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect())
    }

    /// Names of the sliders `[D]`: the traits, then the directions of the coefficients, starting
    /// with the one that moves the surface furthest.
    pub fn directions(&self) -> impl Iterator<Item = &str> {
        let of_field = self.head.config.directions.iter();
        let traits = self.topology.traits().iter().map(String::as_str);
        traits.chain(of_field.map(|direction| direction.name.as_str()))
    }

    /// Finds the number of a slider by its name.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown name; the message lists the known ones.
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

    /// The value of each slider, `[D]`.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite.
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
    /// `InvalidInput` for a wrong count, an unknown slider or a value outside −4 to 4.
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

    /// The head at rest as clean quads. `parts` adds eyes, teeth, tongue, lashes and brows.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite.
    pub fn mesh(&self, numbers: &[f32], parts: bool) -> Result<MadeHead> {
        self.topology.mesh(numbers, parts)
    }

    /// The surface of the field at rest, with `resolution` cells along the longest side of the
    /// grid. It depends on the coefficients alone; traits do not change it.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite; those of
    /// [`super::OneHead::mesh`].
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
