//! Sounds of speech and their times: heard in a sound, read from files of other tools, or written
//! for them.

use std::ffi::CString;

use anyface::{
    annotation::{Annotation, AnnotationFormat, Symbols},
    chart::{self, ChartOptions},
    motion::check_fps,
};
use libc::c_char;

use crate::{
    audio::AnyfaceAudio,
    clip::AnyfaceClip,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    guard,
    pointer::{self, handles},
    status::AnyfaceStatus,
};

/// The kinds of intervals that sounds have.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceTier {
    /// Phones.
    Phones = 0,
    /// Words.
    Words = 1,
    /// Mouths of a mouth chart.
    Mouths = 2,
    /// When the lips are together; they have no labels.
    Closures = 3,
}

/// The set of mouths that a chart is drawn with.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceMouths {
    /// Rhubarb's nine, A to H and X.
    Rhubarb = 0,
    /// Preston Blair's ten, as Papagayo names them: AI, E, O, U, L, WQ, MBP, FV, etc, rest.
    PrestonBlair = 1,
}

/// Sounds of speech and their times: heard in a sound, read from a file, or drawn as a mouth chart.
/// It never changes once it is made.
pub struct AnyfaceSounds {
    annotation: Annotation,
    /// `[n][2]`: start and end in seconds of the intervals in which the lips are together.
    closures: Vec<[f64; 2]>,
    /// Labels of phones, of words and of mouths.
    labels: [Vec<CString>; 3],
}

impl AnyfaceSounds {
    fn of(annotation: Annotation) -> Result<AnyfaceSounds, Failure> {
        let closures = annotation.closures()?;
        // In the order of the numbers of `AnyfaceTier`.
        let tiers = [Symbols::Phones, Symbols::Words, mouths_of(&annotation)];
        let labels = tiers.map(|tier| {
            let intervals = annotation.intervals(tier).iter();
            intervals.map(|i| pointer::c_text(&i.label)).collect()
        });
        Ok(AnyfaceSounds {
            annotation,
            closures,
            labels,
        })
    }

    /// `[n][2]`: start and end of the intervals of a tier, seconds.
    fn times(&self, tier: i32) -> Result<Vec<[f64; 2]>, Failure> {
        const PHONES: i32 = AnyfaceTier::Phones as i32;
        const WORDS: i32 = AnyfaceTier::Words as i32;
        const MOUTHS: i32 = AnyfaceTier::Mouths as i32;
        const CLOSURES: i32 = AnyfaceTier::Closures as i32;
        let of = |symbols| {
            let intervals = self.annotation.intervals(symbols).iter();
            intervals.map(|i| [i.start_s, i.end_s]).collect()
        };
        match tier {
            PHONES => Ok(of(Symbols::Phones)),
            WORDS => Ok(of(Symbols::Words)),
            MOUTHS => Ok(of(mouths_of(&self.annotation))),
            CLOSURES => Ok(self.closures.clone()),
            other => Err(Failure::invalid(format!(
                "tier: expected {PHONES} (phones), {WORDS} (words), {MOUTHS} (mouths) or {CLOSURES} (closures), got {other}"
            ))),
        }
    }
}

/// The set of mouths that the annotation has: Rhubarb's, or else Papagayo's.
fn mouths_of(annotation: &Annotation) -> Symbols {
    if annotation.intervals(Symbols::Rhubarb).is_empty() {
        Symbols::Papagayo
    } else {
        Symbols::Rhubarb
    }
}

/// Draws a mouth chart: it selects one of a few drawn mouths for each frame of a clip.
///
/// The choice depends on how far the lips are apart, how wide the mouth is, and what is said.
/// `said`: when the lips close and which phones are said, from `anyface_sounds_new_with_text()` or
/// a file; may be NULL. `mouths`: an `AnyfaceMouths`. `on`: mouths change only at every `on`-th
/// frame, 1 to 240. `hold`: the fewest frames for which a mouth stays, 1 to 240. `closure_hold` and
/// `vowel_hold`: the same for lips that close for p, b and m, and for the mouths of vowels; 0 takes
/// `hold`. The chart is the tier `ANYFACE_TIER_MOUTHS`; `anyface_sounds_write()` writes it. Free
/// with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for numbers out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_new_chart(
    clip: *const AnyfaceClip,
    said: *const AnyfaceSounds,
    mouths: i32,
    on: usize,
    hold: usize,
    closure_hold: usize,
    vowel_hold: usize,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    const RHUBARB: i32 = AnyfaceMouths::Rhubarb as i32;
    const PRESTON_BLAIR: i32 = AnyfaceMouths::PrestonBlair as i32;
    let make = || {
        let clip = &unsafe { pointer::handle("clip", clip) }?.animation;
        let mouths = match mouths {
            RHUBARB => Symbols::Rhubarb,
            PRESTON_BLAIR => Symbols::Papagayo,
            other => {
                return Err(Failure::invalid(format!(
                    "mouths: expected {RHUBARB} (Rhubarb) or {PRESTON_BLAIR} (Preston Blair), got {other}"
                )));
            }
        };
        let said = unsafe { said.as_ref() }.map(|said| &said.annotation);
        let moved = clip.landmark_displacements.view();
        let options = ChartOptions {
            mouths,
            on,
            hold,
            closure_hold,
            vowel_hold,
        };
        let fps = clip.vertices.fps;
        AnyfaceSounds::of(chart::draw(
            &clip.landmarks_neutral,
            moved,
            fps,
            said,
            &options,
        )?)
    };
    unsafe { guard::give(out, error, make) }
}

/// Listens to a sound and finds the times at which the lips are together, for p, b, m and similar
/// sounds.
///
/// Free with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_new(
    engine: *const AnyfaceEngine,
    audio: *const AnyfaceAudio,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, audio) = handles!(engine, audio);
        let sounds = AnyfaceSounds::of(engine.0.listen(&audio.0)?)?;
        Ok(sounds)
    };
    unsafe { guard::give(out, error, make) }
}

/// Listens to a sound and finds its closures, its phones and, if `text` is given, the times of its
/// words. Without a text the closures are those of `anyface_sounds_new()`, with one those of its p, b
/// and m. They alone decide when the lips close.
///
/// `text`: UTF-8, the words that are said in the sound; NULL if they are not known. Free with
/// `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, with
/// `ANYFACE_STATUS_INVALID_INPUT` for a text without a letter or too long for the sound, and with
/// `ANYFACE_STATUS_WEIGHTS` for an engine with the user's own speech encoder.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_new_with_text(
    engine: *const AnyfaceEngine,
    audio: *const AnyfaceAudio,
    text: *const c_char,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, audio) = handles!(engine, audio);
        let text = unsafe { pointer::optional_text("text", text) }?;
        let phones = engine.0.listen_to_phones(&audio.0, text)?;
        AnyfaceSounds::of(phones)
    };
    unsafe { guard::give(out, error, make) }
}

/// Reads sounds from a file that another tool or an artist has made: .TextGrid (Praat), .tsv or
/// .json (Rhubarb), .pgo (Papagayo), .dat (Moho), .txt (lines of start, end and label).
///
/// `path`: UTF-8. `fps`: the frames per second of the frame numbers in .dat, 1 to 240. Free with
/// `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with
/// `ANYFACE_STATUS_INVALID_INPUT` for another ending, a line that cannot be read, or a file that
/// has only words.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_read(
    path: *const c_char,
    fps: f64,
    out: *mut *mut AnyfaceSounds,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        check_fps(fps)?;
        let path = unsafe { pointer::path("path", path) }?;
        let sounds = AnyfaceSounds::of(Annotation::read(path, fps)?)?;
        Ok(sounds)
    };
    unsafe { guard::give(out, error, make) }
}

/// Writes sounds as a file. Its ending sets the kind; `anyface_sounds_read()` lists the kinds.
///
/// `path`: UTF-8. `fps`: the frames per second of the frame numbers in .pgo and .dat, 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending, or with `ANYFACE_STATUS_IO` if the
/// file cannot be written; in that case no file is left behind.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_write(
    sounds: *const AnyfaceSounds,
    path: *const c_char,
    fps: f64,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let sounds = unsafe { pointer::handle("sounds", sounds) }?;
        let path = unsafe { pointer::path("path", path) }?;
        AnnotationFormat::from_path(path)?;
        check_fps(fps)?;
        sounds.annotation.write(path, fps)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Number `n` of intervals of an `AnyfaceTier`. 0 if the sounds have no such intervals, for an
/// unknown tier, or for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_interval_count(
    sounds: *const AnyfaceSounds,
    tier: i32,
) -> usize {
    let times = unsafe { sounds.as_ref() }.and_then(|sounds| sounds.times(tier).ok());
    times.map_or(0, |times| times.len())
}

/// Label of an interval of an `AnyfaceTier` but closures: a phone (IPA, or as a file spells it), a word or a
/// mouth. It lives until the sounds are freed. NULL for NULL, an unknown tier, or a number that is
/// not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_label(
    sounds: *const AnyfaceSounds,
    tier: i32,
    interval: usize,
) -> *const c_char {
    let tier = usize::try_from(tier).unwrap_or(usize::MAX);
    pointer::lend(unsafe { sounds.as_ref() }.and_then(|s| s.labels.get(tier)?.get(interval)))
}

/// Copies the times of the intervals of an `AnyfaceTier` into the caller's buffer, in the form that
/// `anyface_request_set_rows()` takes for "closures".
///
/// `buffer`: `[n, 2]`, start and end in seconds, in rising order; `double_count` must be `n * 2`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `double_count` or tier.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_copy_intervals(
    sounds: *const AnyfaceSounds,
    tier: i32,
    buffer: *mut f64,
    double_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let sounds = unsafe { pointer::handle("sounds", sounds) }?;
        Ok(sounds.times(tier)?.into_flattened())
    };
    unsafe { guard::copy(buffer, double_count, error, values) }
}

/// 1 if a phone (IPA, ARPABET, `MBP`) closes the lips as p, b and m do, else 0. 0 for NULL.
///
/// `label`: UTF-8.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_label_closes_lips(label: *const c_char) -> i32 {
    let label = unsafe { pointer::optional_text("label", label) };
    let closes = |label| Symbols::Phones.closes_lips(label);
    label.ok().flatten().is_some_and(closes).into()
}

/// Frees sounds that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sounds_free(sounds: *mut AnyfaceSounds) {
    unsafe { guard::free(sounds) }
}
