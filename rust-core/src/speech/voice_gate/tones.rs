//! How steadily partials stand: those of music keep their pitch for the length of a note, those of a voice glide.
//!
//! After the continuous activation of Seyerlehner et al., "Automatic music detection in television productions"
//! (DAFx 2007), of the past alone.

use std::{collections::VecDeque, f32::consts::TAU, sync::Arc};

use realfft::{RealFftPlanner, RealToComplex, num_complex::Complex};

/// Samples of a window, 16 ms.
pub(super) const WINDOW: usize = 256;
/// Samples of a spectrum, 64 ms: bins of 15.6 Hz.
const SPECTRUM: usize = 4 * WINDOW;
/// Bins from 500 Hz, below which a voice's partials hardly leave theirs, to 4 kHz.
const FIRST: usize = 32;
const BINS: usize = 228;
/// So many bins to either side of one are its surroundings, over whose mean level a partial stands by so many nepers of
/// power.
const AROUND: usize = 10;
const PROMINENCE: f32 = 2.0;
/// Below this is no sound.
const FLOOR: f32 = 1e-9;
/// Windows that are remembered, 0.77 s, and the fewest of a voice that say anything.
const MEMORY: usize = 48;
const FEWEST: usize = 12;
/// The partials that count: the steadiest.
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
    /// Where partials stood in each window, and nothing where no voice was heard.
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

    /// Hears a window, in which `is_voiced` somebody may speak. Returns in what share of the windows that may be a voice the
    /// steadiest partials stood where they were, 0 to 1.
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

    /// Which bins stand out of the last [`SPECTRUM`] samples.
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
