//! Measures how steady partials are. Those of music keep their pitch for the length of a note,
//! those of a voice glide.
//!
//! Follows the continuous activation of Seyerlehner et al., "Automatic music detection in
//! television productions" (DAFx 2007), but uses past sound alone.

use std::{collections::VecDeque, f32::consts::TAU, sync::Arc};

use realfft::{RealFftPlanner, RealToComplex, num_complex::Complex};

/// Samples of a window, 16 ms.
pub(super) const WINDOW: usize = 256;
/// Samples of a spectrum, 64 ms: bins of 15.6 Hz.
const SPECTRUM: usize = 4 * WINDOW;
/// Bins from 500 Hz to 4 kHz. Below 500 Hz the partials of a voice hardly leave their bins.
const FIRST: usize = 32;
const BINS: usize = 228;
/// This many bins on either side of a bin are its surroundings.
const AROUND: usize = 10;
/// A partial exceeds the mean level of its surroundings by more than this, nepers of power.
const PROMINENCE: f32 = 2.0;
/// Power that is added to every bin, so that silence has no partials.
const FLOOR: f32 = 1e-9;
/// Number of windows that are remembered, 0.77 s.
const MEMORY: usize = 48;
/// If fewer windows have a voice, the steadiness is computed as if this many had, so that a few
/// windows do not look steady.
const FEWEST: usize = 12;
/// How many partials count: the steadiest ones.
const PARTIALS: usize = 6;

/// The partials of the last windows.
pub(super) struct Tones {
    transform: Arc<dyn RealToComplex<f32>>,
    shape: Vec<f32>,
    past: Vec<f32>,
    framed: Vec<f32>,
    spectrum: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
    levels: Vec<f32>,
    /// The bins with partials in each window; `None` for a window without a voice.
    windows: VecDeque<Option<[bool; BINS]>>,
    counts: [u16; BINS],
    voiced: usize,
}

impl Tones {
    pub fn new() -> Tones {
        let transform = RealFftPlanner::<f32>::new().plan_fft_forward(SPECTRUM);
        let hann = |k: usize| 0.5 - 0.5 * (TAU * k as f32 / SPECTRUM as f32).cos();
        Tones {
            shape: (0..SPECTRUM).map(hann).collect(),
            past: vec![0.0; SPECTRUM],
            framed: transform.make_input_vec(),
            spectrum: transform.make_output_vec(),
            scratch: transform.make_scratch_vec(),
            levels: Vec::with_capacity(SPECTRUM / 2 + 1),
            windows: VecDeque::with_capacity(MEMORY + 1),
            counts: [0; BINS],
            voiced: 0,
            transform,
        }
    }

    /// Hears a window. `is_voiced`: somebody may be speaking in it. Returns the steadiness, 0 to 1:
    /// the share of the voiced windows in which the steadiest bins had a partial.
    pub fn hear(&mut self, window: &[f32; WINDOW], is_voiced: bool) -> f32 {
        self.past.copy_within(WINDOW.., 0);
        self.past[SPECTRUM - WINDOW..].copy_from_slice(window);
        let partials = is_voiced.then(|| self.partials());
        if let Some(partials) = &partials {
            let counted = self.counts.iter_mut().zip(partials);
            counted.for_each(|(count, is_one)| *count += u16::from(*is_one));
            self.voiced += 1;
        }
        self.windows.push_back(partials);
        if self.windows.len() > MEMORY
            && let Some(Some(partials)) = self.windows.pop_front()
        {
            let counted = self.counts.iter_mut().zip(partials);
            counted.for_each(|(count, is_one)| *count -= u16::from(is_one));
            self.voiced -= 1;
        }
        let mut counts = self.counts;
        counts.select_nth_unstable_by(PARTIALS - 1, |a, b| b.cmp(a));
        let steadiest: u16 = counts[..PARTIALS].iter().sum();
        f32::from(steadiest) / (PARTIALS * self.voiced.max(FEWEST)) as f32
    }

    /// Which bins have a partial in the last [`SPECTRUM`] samples.
    fn partials(&mut self) -> [bool; BINS] {
        let shaped = self.past.iter().zip(&self.shape).map(|(x, w)| x * w);
        self.framed
            .iter_mut()
            .zip(shaped)
            .for_each(|(to, x)| *to = x);
        self.transform
            .process_with_scratch(&mut self.framed, &mut self.spectrum, &mut self.scratch)
            .expect("buffers come from the transform itself");
        self.levels.clear();
        let powers = self.spectrum.iter().map(|x| (x.norm_sqr() + FLOOR).ln());
        self.levels.extend(powers);
        std::array::from_fn(|n| {
            let bin = FIRST + n;
            let around = &self.levels[bin - AROUND..=bin + AROUND];
            let mean = around.iter().sum::<f32>() / around.len() as f32;
            self.levels[bin] - mean > PROMINENCE
        })
    }
}
