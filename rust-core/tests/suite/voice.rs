//! Voices made from formulas.

/// Like `babble`, but with a pitch that rises and falls as a speaker's does. A stream takes the
/// drone of `babble` for music.
pub fn intoned(seconds: f32, rate_hz: u32) -> Vec<f32> {
    let rate = rate_hz as f32;
    let tau = std::f32::consts::TAU;
    let mut phase = 0.0;
    (0..(seconds * rate) as usize)
        .map(|i| {
            let t = i as f32 / rate;
            let pitch = 120.0 * (1.0 + 0.3 * ((5.6 * t).sin() + 0.5 * (18.8 * t).sin()));
            phase += tau * pitch / rate;
            let buzz: f32 = (1..30)
                .map(|k| {
                    let hz = pitch * k as f32;
                    let near = |formant: f32, wide: f32| (-((hz - formant) / wide).powi(2)).exp();
                    let gain =
                        near(700.0, 300.0) + 0.5 * near(1200.0, 300.0) + 0.15 * near(2500.0, 400.0);
                    gain * (k as f32 * phase).sin()
                })
                .sum();
            0.2 * buzz * (0.5 - 0.5 * (tau * 3.0 * t).cos()).powi(2)
        })
        .collect()
}

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
