//! The decoded sound, and how long and how loud it is.

/// Sample rate of every [`Waveform`].
pub const SAMPLE_RATE_HZ: u32 = 16_000;

/// Sample rates that are accepted, in Hz.
pub const ACCEPTED_RATES_HZ: std::ops::RangeInclusive<u32> = 4_000..=384_000;

/// Samples of a larger magnitude are refused: 80 dB over full scale.
pub const LOUDEST: f32 = 1e4;

/// Peak below which a sound counts as silence: −60 dB of full scale.
pub const SILENCE_PEAK: f32 = 1e-3;

/// Samples of this magnitude or more are at full scale, where clipped sound is cut off.
const FULL_SCALE: f32 = 0.999;

/// Mono sound at [`SAMPLE_RATE_HZ`].
///
/// ```
/// use anyface::audio::Waveform;
///
/// let stereo = [0.5f32; 2 * 48_000];
/// let sound = Waveform::from_interleaved(&stereo, 2, 48_000)?;
/// assert_eq!((sound.samples.len(), sound.duration_s()), (16_000, 1.0));
/// # Ok::<(), anyface::Error>(())
/// ```
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

    /// How long and how loud it is.
    pub fn levels(&self) -> Levels {
        let mut levels = Levels::default();
        levels.add(&self.samples);
        levels
    }

    /// Whether nothing rises above [`SILENCE_PEAK`].
    pub fn is_silent(&self) -> bool {
        self.levels().is_silent()
    }
}

/// How long and how loud a sound is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Levels {
    /// Number of samples.
    pub samples: usize,
    /// Largest magnitude of any sample.
    pub peak: f32,
    /// Number of samples at full scale.
    pub clipped: usize,
}

impl Levels {
    /// Adds the next samples.
    pub(super) fn add(&mut self, samples: &[f32]) {
        self.samples += samples.len();
        for x in samples {
            self.peak = self.peak.max(x.abs());
            self.clipped += usize::from(x.abs() >= FULL_SCALE);
        }
    }

    /// Length in seconds.
    pub fn duration_s(&self) -> f64 {
        self.samples as f64 / f64::from(SAMPLE_RATE_HZ)
    }

    /// Whether nothing rises above [`SILENCE_PEAK`].
    pub fn is_silent(&self) -> bool {
        self.peak < SILENCE_PEAK
    }
}
