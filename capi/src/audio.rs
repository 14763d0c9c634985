//! Sound from a file or from the caller's samples.

use std::ffi::CString;

use anyface::{
    audio::{SAMPLE_RATE_HZ, SoundFile, Waveform},
    job::SILENT,
};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
};

/// A sound, stored as mono at 16 kHz. It never changes once it is made: any number of threads may
/// use it at the same time.
pub struct AnyfaceAudio(pub(crate) Waveform, Option<CString>);

impl From<Waveform> for AnyfaceAudio {
    fn from(waveform: Waveform) -> AnyfaceAudio {
        AnyfaceAudio(waveform, None)
    }
}

/// Makes a sound from samples in memory, which are copied.
///
/// `samples`: `[frame_count, channels]`, interleaved, nominally -1 to 1; the channels are
/// averaged.
/// `sample_rate_hz`: 4000 to 384000. Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` if there are no samples or no channels, a sample is not finite
/// or the rate is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_new(
    samples: *const f32,
    frame_count: usize,
    channels: u32,
    sample_rate_hz: u32,
    out: *mut *mut AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let channels = channels as usize;
        let samples = unsafe { pointer::slice("samples", samples, frame_count, channels) }?;
        let waveform = Waveform::from_interleaved(samples, channels, sample_rate_hz)?;
        Ok(AnyfaceAudio::from(waveform))
    };
    unsafe { guard::give(out, error, make) }
}

/// Reads a sound from a file: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF.
///
/// `path`: UTF-8. Free with `anyface_audio_free()`. If the file is damaged,
/// `anyface_audio_warning()` says how much of the sound is missing.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with `ANYFACE_STATUS_AUDIO` if it
/// cannot be decoded, holds no sound, or is so damaged that more than a fifth of the sound is
/// missing. `anyface_audio_read_damaged()` reads such a file anyway.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_read(
    path: *const c_char,
    out: *mut *mut AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { read(path, false, out, error) }
}

/// Like `anyface_audio_read()`, but accepts a damaged file however much of its sound is missing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_read_damaged(
    path: *const c_char,
    out: *mut *mut AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { read(path, true, out, error) }
}

unsafe fn read(
    path: *const c_char,
    any_damage: bool,
    out: *mut *mut AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let path = unsafe { pointer::path("path", path) }?;
        let file = SoundFile::read(path, any_damage, SILENT)?;
        let damage = file.damage.map(|damage| damage.sentence());
        let warnings: Vec<String> = damage.into_iter().chain(file.track.sentence()).collect();
        let warning = (!warnings.is_empty()).then(|| pointer::c_text(&warnings.join("; ")));
        Ok(AnyfaceAudio(file.whole(SILENT)?, warning))
    };
    unsafe { guard::give(out, error, make) }
}

/// A sentence in English that says how much of a sound is missing because its file is damaged, and which
/// audio track of a file with several it is. NULL if there is nothing to say, and for NULL.
///
/// The text lives as long as the sound. A sound from `anyface_audio_trim()` has no warning.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_warning(audio: *const AnyfaceAudio) -> *const c_char {
    pointer::lend(unsafe { audio.as_ref() }.and_then(|audio| audio.1.as_ref()))
}

/// Copies a part of a sound into a new one.
///
/// `start_s`, `duration_s`: seconds, not negative. The part ends at the end of the sound at the
/// latest.
/// Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that are negative or not finite, and with
/// `ANYFACE_STATUS_AUDIO` if the part has no samples.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_trim(
    audio: *const AnyfaceAudio,
    start_s: f64,
    duration_s: f64,
    out: *mut *mut AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let audio = unsafe { pointer::handle("audio", audio) }?;
        let part = trim(&audio.0, start_s, duration_s)?;
        Ok(AnyfaceAudio(part, None))
    };
    unsafe { guard::give(out, error, make) }
}

fn trim(waveform: &Waveform, start_s: f64, duration_s: f64) -> Result<Waveform, Failure> {
    for (name, time_s) in [("start_s", start_s), ("duration_s", duration_s)] {
        if !time_s.is_finite() || time_s < 0.0 {
            return Err(Failure::invalid(format!(
                "{name}: expected 0 or more, got {time_s}"
            )));
        }
    }
    let length = waveform.samples.len();
    let sample = |time_s: f64| ((time_s * f64::from(SAMPLE_RATE_HZ)).round() as usize).min(length);
    let samples = waveform.samples[sample(start_s)..sample(start_s + duration_s)].to_vec();
    if samples.is_empty() {
        let total_s = waveform.duration_s();
        let message = format!("nothing is left from {start_s} s for {duration_s} s of {total_s} s");
        return Err(anyface::Error::Audio(message).into());
    }
    Ok(Waveform { samples })
}

/// Number of samples, at 16 kHz; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_sample_count(audio: *const AnyfaceAudio) -> usize {
    unsafe { audio.as_ref() }.map_or(0, |audio| audio.0.samples.len())
}

/// Copies the samples, mono at 16 kHz, into the caller's buffer.
///
/// `buffer`: `[S]`, nominally -1 to 1; `float_count` must be `anyface_audio_sample_count()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_copy_samples(
    audio: *const AnyfaceAudio,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        Ok(unsafe { pointer::handle("audio", audio) }?
            .0
            .samples
            .as_slice())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Length in seconds; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_duration_s(audio: *const AnyfaceAudio) -> f64 {
    unsafe { audio.as_ref() }.map_or(0.0, |audio| audio.0.duration_s())
}

/// Largest magnitude of any sample; 0 for NULL. A sound whose peak is below 0.001 counts as
/// silence.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_peak(audio: *const AnyfaceAudio) -> f32 {
    guard::guard_or(0.0, || {
        unsafe { audio.as_ref() }.map_or(0.0, |audio| audio.0.levels().peak)
    })
}

/// Frees a sound that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_audio_free(audio: *mut AnyfaceAudio) {
    unsafe { guard::free(audio) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_starts_and_ends_at_its_samples() {
        let waveform = Waveform {
            samples: (0..32_000).map(|i| i as f32).collect(),
        };
        let part = trim(&waveform, 0.5, 0.25).unwrap();
        assert_eq!((part.samples[0], part.samples.len()), (8_000.0, 4_000));
        assert_eq!(trim(&waveform, 1.5, 9.0).unwrap().samples.len(), 8_000);
        assert!(trim(&waveform, 2.0, 1.0).is_err());
        for wrong in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(trim(&waveform, wrong, 1.0).is_err() && trim(&waveform, 0.0, wrong).is_err());
        }
    }

    #[test]
    fn a_damaged_file_warns_and_one_of_which_little_is_left_fails() {
        use std::{ffi::CStr, ptr::null_mut};
        let name = format!("anyface-damaged-{}.wav", std::process::id());
        let path = std::env::temp_dir().join(name);
        let text = CString::new(path.to_str().unwrap()).unwrap();
        let mut wav = b"RIFF\x24\x7d\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0".to_vec();
        wav.extend(16_000u32.to_le_bytes());
        wav.extend(32_000u32.to_le_bytes());
        wav.extend(b"\x02\0\x10\0data");
        wav.extend(32_000u32.to_le_bytes());
        let header = wav.len();
        wav.resize(header + 32_000, 7);
        for (length, warns, fails) in [
            (32_000, false, false),
            (28_000, true, false),
            (9_000, true, true),
        ] {
            std::fs::write(&path, &wav[..header + length]).unwrap();
            let mut audio = null_mut();
            let status = unsafe { anyface_audio_read(text.as_ptr(), &mut audio, null_mut()) };
            if fails {
                assert_eq!(status, AnyfaceStatus::Audio);
                let status =
                    unsafe { anyface_audio_read_damaged(text.as_ptr(), &mut audio, null_mut()) };
                assert_eq!(status, AnyfaceStatus::Ok);
            }
            let warning = unsafe { anyface_audio_warning(audio) };
            assert_eq!(!warning.is_null(), warns, "{length}");
            if warns {
                let warning = unsafe { CStr::from_ptr(warning) }.to_str().unwrap();
                assert!(warning.contains("of 1.00 s are missing"), "{warning}");
            }
            unsafe { anyface_audio_free(audio) };
        }
        std::fs::remove_file(&path).unwrap();
        assert!(unsafe { anyface_audio_warning(std::ptr::null()) }.is_null());
    }

    #[test]
    fn the_copied_samples_are_those_of_the_sound() {
        let samples = [0.25, -0.5, 1.0];
        let waveform = Waveform {
            samples: samples.to_vec(),
        };
        let audio = AnyfaceAudio(waveform, None);
        assert_eq!(unsafe { anyface_audio_sample_count(&audio) }, 3);
        let mut buffer = [0.0; 3];
        let error = std::ptr::null_mut();
        let pointer = buffer.as_mut_ptr();
        let status = unsafe { anyface_audio_copy_samples(&audio, pointer, 3, error) };
        assert_eq!((status, buffer), (AnyfaceStatus::Ok, samples));
        let status = unsafe { anyface_audio_copy_samples(&audio, pointer, 2, error) };
        assert_eq!(status, AnyfaceStatus::InvalidInput);
    }
}
