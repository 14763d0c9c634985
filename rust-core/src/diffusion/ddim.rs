//! Denoising diffusion implicit models, deterministic (η = 0), for networks that predict `x₀`.

use ndarray::{Array2, ArrayRef2, Zip};
use serde::{Deserialize, Serialize};

use super::Schedule;
use crate::{
    Error, Result,
    job::{ProgressFn, report},
};

/// The training steps that a shorter walk visits, Lin et al. 2024, table 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Spacing {
    /// Multiples of a whole stride, from 0. The walk leaves out the last training step, unless it
    /// visits every step.
    Leading,
    /// Steps down from the last training step.
    Trailing,
}

/// A walk from noise to a sample, Song et al. 2021, eq. 12 with σ = 0.
///
/// Differs from `diffusers`: a step leads to the next step of the walk, not to `t − T/N`. Both are
/// the same when `N` divides `T`. Otherwise the steps of `diffusers` leave gaps in trailing
/// spacing.
#[derive(Debug, Clone, PartialEq)]
pub struct Ddim {
    /// Steps of the walk, largest first, with `ᾱ` of each step and of the step that it leads to.
    walk: Vec<Step>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    timestep: usize,
    alpha: f64,
    alpha_next: f64,
}

impl Ddim {
    /// A walk of `steps` steps through a schedule of `train_steps`.
    ///
    /// # Errors
    /// `InvalidInput` unless `1 ≤ steps ≤ train_steps`.
    pub fn new(
        schedule: Schedule,
        train_steps: usize,
        spacing: Spacing,
        steps: usize,
    ) -> Result<Self> {
        if steps == 0 || steps > train_steps {
            return Err(Error::InvalidInput(format!(
                "steps: expected 1 to {train_steps}, got {steps}"
            )));
        }
        let alphas = schedule.alphas_cumprod(train_steps);
        let timesteps = timesteps(train_steps, spacing, steps);
        let next = timesteps.iter().skip(1).map(|t| alphas[*t]).chain([1.0]);
        let walk = timesteps
            .iter()
            .zip(next)
            .map(|(&timestep, alpha_next)| Step {
                timestep,
                alpha: alphas[timestep],
                alpha_next,
            })
            .collect();
        Ok(Ddim { walk })
    }

    /// Walks from noise `x`, `[T, C]`, to a sample of the same shape.
    ///
    /// `predict` gets the noisy sample and the training step, and returns the clean sample,
    /// `[T, C]`. Progress of the stage "motion" goes from `done.0` to `done.1`.
    ///
    /// # Errors
    /// `Cancelled`; those of `predict`; `ShapeMismatch` if it returns another shape.
    pub fn sample(
        &self,
        mut x: Array2<f32>,
        mut predict: impl FnMut(&ArrayRef2<f32>, usize) -> Result<Array2<f32>>,
        progress: ProgressFn<'_>,
        done: (f32, f32),
    ) -> Result<Array2<f32>> {
        for (index, step) in self.walk.iter().enumerate() {
            let share = index as f32 / self.walk.len() as f32;
            report(progress, "motion", done.0 + (done.1 - done.0) * share)?;
            let clean = predict(&x, step.timestep)?;
            if clean.dim() != x.dim() {
                return Err(Error::ShapeMismatch {
                    what: "predicted sample",
                    expected: format!("{:?}", x.shape()),
                    got: format!("{:?}", clean.shape()),
                });
            }
            step.take(&mut x, &clean);
        }
        report(progress, "motion", done.1)?;
        Ok(x)
    }
}

impl Step {
    /// `x ← √ᾱ' x₀ + √(1−ᾱ') ε` with `ε = (x − √ᾱ x₀) / √(1−ᾱ)`.
    fn take(&self, x: &mut Array2<f32>, clean: &ArrayRef2<f32>) {
        let keep = ((1.0 - self.alpha_next) / (1.0 - self.alpha)).sqrt();
        let pull = self.alpha_next.sqrt() - self.alpha.sqrt() * keep;
        Zip::from(x).and(clean).for_each(|x, clean| {
            *x = (keep * f64::from(*x) + pull * f64::from(*clean)) as f32;
        });
    }
}

/// The steps that a walk visits, largest first, as in `DDIMScheduler.set_timesteps` of `diffusers`.
fn timesteps(train_steps: usize, spacing: Spacing, steps: usize) -> Vec<usize> {
    match spacing {
        Spacing::Leading => (0..steps)
            .rev()
            .map(|i| i * (train_steps / steps))
            .collect(),
        Spacing::Trailing => (0..steps)
            .map(|i| {
                let stride = train_steps as f64 / steps as f64;
                (train_steps as f64 - i as f64 * stride).round_ties_even() as usize - 1
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::{Progress, SILENT},
        nn::golden::{Golden, distance},
    };

    #[test]
    fn a_predictor_that_knows_the_truth_is_reached_in_any_number_of_steps() {
        let truth = Array2::from_shape_fn((5, 4), |(t, c)| (t * 4 + c) as f32 * 0.1 - 1.0);
        for schedule in [Schedule::Linear, Schedule::Cosine] {
            for spacing in [Spacing::Leading, Spacing::Trailing] {
                for steps in [1, 2, 7, 30, 999, 1000] {
                    let ddim = Ddim::new(schedule, 1000, spacing, steps).unwrap();
                    let noise = super::super::frame_noise(3, 0, 5, 4);
                    let done = (0.0, 1.0);
                    let sample = ddim.sample(noise, |_, _| Ok(truth.clone()), SILENT, done);
                    let difference = &sample.unwrap() - &truth;
                    assert!(difference.iter().all(|d| d.abs() < 1e-5));
                }
            }
        }
    }

    #[test]
    fn whole_runs_match_diffusers() {
        let golden = Golden::open("ddim");
        let schedules = [
            ("linear", Schedule::Linear),
            ("squaredcos_cap_v2", Schedule::Cosine),
        ];
        for (schedule_name, schedule) in schedules {
            let alphas: Vec<f32> = schedule
                .alphas_cumprod(1000)
                .iter()
                .map(|a| *a as f32)
                .collect();
            let expected = golden.values(&format!("{schedule_name}.alphas_cumprod"));
            assert!(distance(&alphas, &expected) < 1e-5);
            for (spacing_name, spacing) in [
                ("leading", Spacing::Leading),
                ("trailing", Spacing::Trailing),
            ] {
                for steps in [10, 100] {
                    let name = |part| format!("{schedule_name}.{spacing_name}.{steps}.{part}");
                    let ddim = Ddim::new(schedule, 1000, spacing, steps).unwrap();
                    let timesteps: Vec<usize> =
                        ddim.walk.iter().map(|step| step.timestep).collect();
                    assert_eq!(timesteps, golden.integers(&name("timesteps")));
                    let c = golden.matrix(&name("c"));
                    let predict = |x: &ArrayRef2<f32>, _| Ok((x * 0.3 + &c).mapv(f32::tanh));
                    let start = golden.matrix(&name("x_T"));
                    let sample = ddim.sample(start, predict, SILENT, (0.0, 1.0)).unwrap();
                    let error = distance(&sample, &golden.matrix(&name("x_0")));
                    assert!(error < 1e-5, "{} {error}", name("x_0"));
                }
            }
        }
    }

    #[test]
    fn steps_out_of_range_are_refused() {
        for steps in [0, 1001] {
            let ddim = Ddim::new(Schedule::Linear, 1000, Spacing::Leading, steps);
            assert!(matches!(ddim, Err(Error::InvalidInput(_))));
        }
    }

    #[test]
    fn cancelling_stops_the_walk() {
        let ddim = Ddim::new(Schedule::Linear, 1000, Spacing::Trailing, 50).unwrap();
        let calls = std::cell::Cell::new(0);
        let predict = |x: &ArrayRef2<f32>, _| {
            calls.set(calls.get() + 1);
            Ok(x.to_owned())
        };
        let stop = |p: Progress| p.fraction < 0.1;
        let result = ddim.sample(Array2::zeros((2, 3)), predict, &stop, (0.0, 1.0));
        assert!(matches!(result, Err(Error::Cancelled)));
        assert!((4..=6).contains(&calls.get()), "{}", calls.get());
    }
}
