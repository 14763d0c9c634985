//! Sound in any common format becomes mono 16 kHz samples.

/// Sample rate of every [`Waveform`].
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Mono sound at [`SAMPLE_RATE_HZ`].
#[derive(Debug, Clone, PartialEq)]
pub struct Waveform {
    /// `[S]`, nominally in [−1, 1], always finite.
    pub samples: Vec<f32>,
}

impl Waveform {
    /// Length in seconds.
    pub fn duration_s(&self) -> f64 {
        self.samples.len() as f64 / f64::from(SAMPLE_RATE_HZ)
    }
}
