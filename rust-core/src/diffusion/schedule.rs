//! Noise schedules.

use serde::{Deserialize, Serialize};

/// How much of the signal is left at each diffusion step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// `β` from 1e-4 to 0.02 in equal steps, Ho et al. 2020, section 4.
    Linear,
    /// `ᾱ(t) = cos²((t + 0.008) / 1.008 · π/2)`, `β ≤ 0.999`, Nichol & Dhariwal 2021, eq. 17;
    /// `squaredcos_cap_v2` of `diffusers`.
    #[serde(alias = "squaredcos_cap_v2")]
    Cosine,
}

impl Schedule {
    /// `ᾱ_t = Π (1 − β)` for `t` from 0 to `train_steps − 1`.
    pub fn alphas_cumprod(self, train_steps: usize) -> Vec<f64> {
        let mut product = 1.0;
        (0..train_steps)
            .map(|t| {
                product *= 1.0 - self.beta(t, train_steps);
                product
            })
            .collect()
    }

    fn beta(self, t: usize, train_steps: usize) -> f64 {
        let share = |t: usize, of: usize| t as f64 / of.max(1) as f64;
        match self {
            Schedule::Linear => 1e-4 + (0.02 - 1e-4) * share(t, train_steps - 1),
            Schedule::Cosine => {
                let alpha_bar = |t: f64| ((t + 0.008) / 1.008 * std::f64::consts::FRAC_PI_2).cos();
                let [now, next] = [t, t + 1].map(|t| alpha_bar(share(t, train_steps)).powi(2));
                (1.0 - next / now).min(0.999)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signal_falls_from_nearly_all_to_nearly_none() {
        for schedule in [Schedule::Linear, Schedule::Cosine] {
            let alphas = schedule.alphas_cumprod(1000);
            assert!(alphas[0] > 0.999 && alphas[999] < 1e-4);
            assert!(alphas.windows(2).all(|pair| pair[1] < pair[0]));
        }
    }

    #[test]
    fn names_are_those_of_the_config_file() {
        for name in ["\"cosine\"", "\"squaredcos_cap_v2\""] {
            assert_eq!(
                serde_json::from_str::<Schedule>(name).unwrap(),
                Schedule::Cosine
            );
        }
    }
}
