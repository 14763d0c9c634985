//! A voice made from formulas.

/// Something like syllables: a buzz at 120 Hz through two formants that come and go.
pub fn babble(seconds: f32, rate_hz: u32) -> Vec<f32> {
    let rate = rate_hz as f32;
    (0..(seconds * rate) as usize)
        .map(|i| {
            let t = i as f32 / rate;
            let buzz: f32 = (1..25)
                .map(|k| {
                    let hz = 120.0 * k as f32;
                    let gain = (-((hz - 700.0) / 300.0).powi(2)).exp()
                        + 0.5 * (-((hz - 1200.0) / 300.0).powi(2)).exp();
                    gain * (std::f32::consts::TAU * hz * t).sin()
                })
                .sum();
            0.2 * buzz * (0.5 - 0.5 * (std::f32::consts::TAU * 3.0 * t).cos()).powi(2)
        })
        .collect()
}
