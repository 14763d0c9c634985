//! A level meter and a face of characters in the terminal.
//!
//! They show whether sound arrives and how the face moves.

use std::io::{self, IsTerminal, Write};

use anyface::rig::ARKIT;

use super::frame::Frame;

/// One in this many frames is drawn.
const EVERY: u32 = 2;
/// Bars of the meter.
const BARS: usize = 20;
/// Level below which the meter is empty, in dB of full scale.
const QUIETEST_DB: f32 = -60.0;
/// Share of the peak that remains after another block of sound.
const FALL: f32 = 0.8;
/// Weight above which an eye is drawn shut.
const SHUT: f32 = 0.5;
/// Weight above which a smile is drawn.
const SMILE: f32 = 0.3;

/// A line on standard error that is redrawn in place.
pub struct Meter {
    is_shown: bool,
    is_drawn: bool,
    /// Peak of the sound, which decays with each block.
    peak: f32,
    places: Places,
}

/// Indices of shapes in `ARKIT`.
struct Places {
    jaw: usize,
    pucker: usize,
    smile: usize,
    blink: [usize; 2],
}

impl Meter {
    /// A meter that is shown only on a terminal, and never with JSON output.
    pub fn new(is_json: bool) -> Meter {
        let place = |name: &str| {
            let place = ARKIT.iter().position(|known| *known == name);
            place.expect("ARKit has this shape")
        };
        Meter {
            is_shown: io::stderr().is_terminal() && !is_json,
            is_drawn: false,
            peak: 0.0,
            places: Places {
                jaw: place("jawOpen"),
                pucker: place("mouthPucker"),
                smile: place("mouthSmileLeft"),
                blink: [place("eyeBlinkRight"), place("eyeBlinkLeft")],
            },
        }
    }

    /// Updates the peak with new samples.
    pub fn hear(&mut self, samples: &[f32]) {
        let peak = samples.iter().fold(0.0f32, |peak, x| peak.max(x.abs()));
        self.peak = peak.max(FALL * self.peak);
    }

    /// Draws the face of a frame.
    pub fn show(&mut self, frame: &Frame) {
        if self.is_shown && frame.number.is_multiple_of(EVERY) {
            self.write(&format!(
                "\r{} {} ",
                bars(self.peak),
                self.face(&frame.shapes)
            ));
            self.is_drawn = true;
        }
    }

    /// Erases the line.
    pub fn clear(&mut self) {
        if std::mem::take(&mut self.is_drawn) {
            self.write("\r\x1b[K");
        }
    }

    fn write(&self, text: &str) {
        let mut err = io::stderr().lock();
        // If this fails, there is nowhere to report it.
        let _ = err.write_all(text.as_bytes()).and_then(|()| err.flush());
    }

    fn face(&self, shapes: &[f32]) -> String {
        let places = &self.places;
        let [right, left] = places
            .blink
            .map(|blink| if shapes[blink] > SHUT { '-' } else { 'o' });
        let mouth = match shapes[places.jaw] {
            jaw if jaw > 0.3 => 'O',
            _ if shapes[places.pucker] > 0.4 => '*',
            jaw if jaw > 0.08 => 'o',
            _ if shapes[places.smile] > SMILE => 'v',
            _ => '_',
        };
        format!("( {right} {mouth} {left} )")
    }
}

/// The meter for a peak of 0 to 1.
fn bars(peak: f32) -> String {
    let level_db = 20.0 * peak.max(1e-6).log10();
    let share = (1.0 - level_db / QUIETEST_DB).clamp(0.0, 1.0);
    let full = (share * BARS as f32).round() as usize;
    format!("[{}{}]", "#".repeat(full), " ".repeat(BARS - full))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_meter_is_empty_in_silence_and_full_at_full_scale() {
        assert_eq!(bars(0.0), format!("[{}]", " ".repeat(BARS)));
        assert_eq!(bars(1.0), format!("[{}]", "#".repeat(BARS)));
        assert_eq!(bars(0.1).matches('#').count(), 13);
    }

    #[test]
    fn the_face_opens_its_mouth_and_shuts_its_eyes() {
        let meter = Meter::new(true);
        let mut shapes = [0.0; ARKIT.len()];
        assert_eq!(meter.face(&shapes), "( o _ o )");
        shapes[meter.places.jaw] = 0.5;
        shapes[meter.places.blink[0]] = 1.0;
        assert_eq!(meter.face(&shapes), "( - O o )");
    }
}
