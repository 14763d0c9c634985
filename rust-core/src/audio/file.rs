//! Reads a sound from a file, whole or stretch by stretch.

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::mpsc::sync_channel,
    thread,
};

use super::{
    SoundDamage, Waveform, compressed, long_wav,
    pitch::HOP,
    resample::Take,
    source::Source,
    track::{AudioTrack, missing_track},
    wav,
    waveform::{Levels, SAMPLE_RATE_HZ},
};
use crate::{
    Error, Result,
    job::{ProgressFn, SILENT, outside::guarded, report},
};

/// A file that lost more than this share of its sound is refused, unless the caller allows it.
pub const LARGEST_LOSS: f64 = 0.2;
/// Sounds up to this length are kept in memory whole, seconds.
pub const WHOLE_S: f64 = 600.0;
/// The most decoded pieces that may wait for the receiver.
const AHEAD: usize = 8;

/// A sound in a file that was decoded once from beginning to end.
///
/// ```
/// use anyface::{audio::SoundFile, job::SILENT};
///
/// let tone = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/tone.ogg");
/// let file = SoundFile::read(&tone, false, SILENT)?;
/// let (duration_s, damage) = (file.levels.duration_s(), file.damage);
/// assert_eq!((file.whole(SILENT)?.duration_s(), damage), (duration_s, None));
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct SoundFile {
    path: PathBuf,
    source: Source,
    /// How long and how loud it is.
    pub levels: Levels,
    /// The part that could not be read.
    pub damage: Option<SoundDamage>,
    /// Which of the file's audio tracks it is.
    pub track: AudioTrack,
    /// Number of the track that the caller wants.
    wanted_track: Option<usize>,
    /// Sum of squares of each hop of 10 ms.
    energies: Vec<f32>,
    /// The whole sound, if it lasts [`WHOLE_S`] or less.
    waveform: Option<Waveform>,
}

impl SoundFile {
    /// Decodes a file as [`Waveform::from_file`] does, and reports what is missing: samples that a
    /// header promises, packets that do not decode, gaps between pages.
    ///
    /// `any_damage`: whether to accept a file that lacks more than a fifth of its sound.
    ///
    /// # Errors
    /// Those of [`Waveform::from_file`]; `Cancelled`.
    pub fn read(path: &Path, any_damage: bool, progress: ProgressFn<'_>) -> Result<SoundFile> {
        SoundFile::read_track(path, None, any_damage, progress)
    }

    /// Like [`SoundFile::read`], but takes the audio track with a number, from 1. `None` is the track that the file
    /// names as its own choice.
    ///
    /// # Errors
    /// As [`SoundFile::read`]; `InvalidInput` for a track that the file lacks.
    pub fn read_track(
        path: &Path,
        track: Option<usize>,
        any_damage: bool,
        progress: ProgressFn<'_>,
    ) -> Result<SoundFile> {
        let source = guarded(Error::Audio, || long_wav::as_wav(Source::open(path)?));
        let mut file = SoundFile {
            path: path.to_owned(),
            source: source.map_err(|error| named(path, error))?,
            levels: Levels::default(),
            damage: None,
            track: AudioTrack::default(),
            wanted_track: track,
            energies: Vec::new(),
            waveform: None,
        };
        let most = (WHOLE_S * f64::from(SAMPLE_RATE_HZ)) as usize;
        let (mut levels, mut energies) = (Levels::default(), Energies::default());
        let mut short_sound = Some(Vec::new());
        let decoded = file.decode(&mut |piece| {
            report(progress, "speech", 0.0)?;
            levels.add(piece);
            energies.add(piece);
            short_sound = short_sound.take().filter(|_| levels.samples <= most);
            if let Some(samples) = &mut short_sound {
                samples.extend_from_slice(piece);
            }
            Ok(())
        })?;
        (file.damage, file.track) = decoded;
        match file.damage {
            Some(damage) if damage.share() > LARGEST_LOSS && !any_damage => {
                return Err(Error::DamagedSound(format!(
                    "{}: expected at least {:.0} % of the sound, got a file of which {:.2} s of {:.2} s are \
                     missing",
                    path.display(),
                    100.0 * (1.0 - LARGEST_LOSS),
                    damage.missing_s,
                    damage.expected_s
                )));
            }
            _ => {}
        }
        file.levels = levels;
        file.energies = energies.of_hops;
        file.waveform = short_sound.map(|samples| Waveform { samples });
        Ok(file)
    }

    /// Sum of squares of each hop of 10 ms, `[S / 160]`. The last hop may be shorter.
    pub(crate) fn energies(&self) -> &[f32] {
        &self.energies
    }

    /// The whole sound, however long.
    ///
    /// # Errors
    /// Those of [`SoundFile::read`], if the file has changed since.
    pub fn whole(self, progress: ProgressFn<'_>) -> Result<Waveform> {
        if let Some(waveform) = self.waveform {
            return Ok(waveform);
        }
        let mut samples = Vec::with_capacity(self.levels.samples);
        self.decode(&mut |piece| {
            report(progress, "speech", 0.0)?;
            samples.extend_from_slice(piece);
            Ok(())
        })?;
        Ok(Waveform { samples })
    }

    /// Passes stretches of its samples to `take`, in rising order of their starts. Stretches may
    /// overlap. Only one is in memory at a time.
    ///
    /// # Errors
    /// Those of [`SoundFile::read`], if the file has changed since, and those of `take`.
    pub(crate) fn stretches(
        self,
        stretches: &[Range<usize>],
        take: &mut dyn FnMut(Waveform) -> Result<()>,
    ) -> Result<()> {
        let mut cut = Cut {
            stretches,
            samples: Vec::new(),
            first: 0,
        };
        if let Some(waveform) = self.waveform {
            return match stretches {
                [whole] if *whole == (0..waveform.samples.len()) => take(waveform),
                _ => cut.add(&waveform.samples, take),
            };
        }
        // The decoder runs on a thread of its own, so that an error of `take` is not reported as an
        // error of the file.
        thread::scope(|scope| {
            let (give, pieces) = sync_channel::<Vec<f32>>(AHEAD);
            let file = &self;
            let decoder = scope.spawn(move || {
                file.decode(&mut |piece| give.send(piece.to_vec()).map_err(|_| Error::Cancelled))
            });
            // An early return drops `pieces`, which ends the decoder.
            let outcome = pieces
                .into_iter()
                .try_for_each(|piece| cut.add(&piece, take));
            let decoded = decoder.join().unwrap_or(Err(Error::Cancelled));
            outcome.and(decoded.map(drop))
        })?;
        if cut.stretches.is_empty() {
            Ok(())
        } else {
            Err(Error::Audio(format!(
                "{}: expected {} samples as before, got fewer: the file has changed",
                self.path.display(),
                self.levels.samples
            )))
        }
    }

    fn decode(&self, out: Take<'_>) -> Result<(Option<SoundDamage>, AudioTrack)> {
        let (path, source) = (&self.path, &self.source);
        let decoded = guarded(Error::Audio, || match wav::decode(path, source, out)? {
            wav::Decoded::Sound(damage) => match self.wanted_track {
                None | Some(1) => Ok((damage, AudioTrack::default())),
                Some(number) => Err(missing_track(number, 1)),
            },
            wav::Decoded::NotForUs => compressed::decode((path, source), self.wanted_track, out),
        });
        decoded.map_err(|error| named(path, error))
    }
}

/// Sums of squares, hop by hop.
#[derive(Default)]
struct Energies {
    of_hops: Vec<f32>,
    /// How many samples the last hop has so far.
    samples: usize,
}

impl Energies {
    fn add(&mut self, piece: &[f32]) {
        for x in piece {
            if self.samples.is_multiple_of(HOP) {
                self.of_hops.push(0.0);
                self.samples = 0;
            }
            self.samples += 1;
            if let Some(sum) = self.of_hops.last_mut() {
                *sum += x * x;
            }
        }
    }
}

/// Cuts stretches out of pieces that follow each other.
struct Cut<'a> {
    /// The stretches that are still to come.
    stretches: &'a [Range<usize>],
    samples: Vec<f32>,
    /// Index in the sound of the first sample in `samples`.
    first: usize,
}

impl Cut<'_> {
    fn add(&mut self, piece: &[f32], take: &mut dyn FnMut(Waveform) -> Result<()>) -> Result<()> {
        self.samples.extend_from_slice(piece);
        while let [next, rest @ ..] = self.stretches {
            if self.first + self.samples.len() < next.end {
                break;
            }
            let samples = &self.samples[next.start - self.first..next.end - self.first];
            take(Waveform {
                samples: samples.to_vec(),
            })?;
            self.stretches = rest;
            let start = rest.first().map_or(usize::MAX, |next| next.start);
            let past = (start - self.first).min(self.samples.len());
            self.samples.drain(..past);
            self.first += past;
        }
        Ok(())
    }
}

/// Adds the file's name to audio errors that lack it.
fn named(path: &Path, error: Error) -> Error {
    let shown = path.display().to_string();
    match error {
        Error::Audio(message) if !message.contains(&shown) => {
            Error::Audio(format!("{shown}: {message}"))
        }
        other => other,
    }
}

impl Waveform {
    /// Decodes a file: WAV (RF64 and Wave64 too), MP3, FLAC, Ogg or WebM (Vorbis or Opus), M4A (AAC or ALAC), AAC,
    /// CAF or AIFF.
    ///
    /// Channels are averaged, never summed, so nothing clips; samples outside [−1, 1] are kept.
    ///
    /// # Errors
    /// `Io` if the file cannot be read; `Audio` if it cannot be decoded, holds no sample, holds samples
    /// that are not finite or beyond ±[`LOUDEST`](super::LOUDEST), or is so damaged that more than
    /// a fifth is missing ([`SoundFile::read`] tells how much).
    pub fn from_file(path: &Path) -> Result<Self> {
        SoundFile::read(path, false, SILENT)?.whole(SILENT)
    }
}
