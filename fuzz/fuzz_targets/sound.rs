//! WAV, MP3, Ogg, FLAC, M4A and AIFF: what is read is finite, and a loss is less than the whole.
#![no_main]

use std::io::Write;

use anyface::audio::{LOUDEST, SoundFile};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    if let Ok(sound) = SoundFile::read(file.path(), true) {
        // Resampling may ring a little beyond the largest sample.
        let is_sound = |x: &f32| x.is_finite() && x.abs() <= 4.0 * LOUDEST;
        assert!(sound.waveform.samples.iter().all(is_sound));
        if let Some(damage) = sound.damage {
            assert!(damage.share() > 0.0 && damage.share() <= 1.0);
        }
    }
});
