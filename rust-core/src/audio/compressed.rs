//! Decodes all but plain WAV with symphonia: MP3, FLAC, Ogg, WebM, M4A, CAF, AIFF and odd WAVs.

use std::{borrow::Cow, io::Read, path::Path, sync::LazyLock};

use symphonia::{
    core::{
        audio::GenericAudioBufferRef,
        codecs::{
            audio::{
                AudioCodecParameters, AudioDecoder, AudioDecoderOptions,
                well_known::{
                    CODEC_ID_AAC, CODEC_ID_MP3, CODEC_ID_OPUS, CODEC_ID_PCM_ALAW,
                    CODEC_ID_PCM_MULAW,
                },
            },
            registry::CodecRegistry,
        },
        errors::Error as StreamError,
        formats::{FormatOptions, FormatReader, Track, TrackType, probe::Hint},
        io::MediaSourceStream,
        meta::MetadataOptions,
        packet::Packet,
        units::{Duration, TimeBase},
    },
    default::{get_probe, register_enabled_codecs},
};

use super::{
    damage::SoundDamage,
    edit_list::{self, Edit},
    intake::Intake,
    opus::{self, OpusDecoder},
    resample::Take,
    source::Source,
    track::{AudioTrack, missing_track},
    wav::LENGTH_UNKNOWN,
};
use crate::{Error, Result};

/// The most damaged packets in a row before decoding gives up on a file.
const DAMAGE_LIMIT: u32 = 100;

const FORMATS: &str =
    "WAV, MP3, FLAC, Ogg or WebM (Vorbis or Opus), M4A (AAC or ALAC), AAC, CAF or AIFF";

/// Frames before the sound in an MP3 without a LAME header. The coder adds 576, as LAME does, and
/// every decoder adds 529.
const MP3_DELAY: usize = 1_105;
/// The fewest frames before the sound in AAC: one block. Coders that add more say so in an edit
/// list.
const AAC_DELAY: usize = 1_024;

/// Frames before the sound in Opus without a header, as in CAF: as many as libopus adds.
const OPUS_DELAY: usize = 312;

static CODECS: LazyLock<CodecRegistry> = LazyLock::new(|| {
    let mut codecs = CodecRegistry::new();
    register_enabled_codecs(&mut codecs);
    codecs.register_audio_decoder::<OpusDecoder>();
    codecs
});

/// Decodes an audio track of the file into `out`. Returns how much of it is lost, and which track it is. `wanted`:
/// number of the track, from 1; `None` is the one that the file names.
pub(super) fn decode(
    (path, source): (&Path, &Source),
    wanted: Option<usize>,
    out: Take<'_>,
) -> Result<(Option<SoundDamage>, AudioTrack)> {
    let mut format = open(path, source)?;
    let (track, which) = find_track(path, format.as_ref(), wanted)?;
    let (track_id, mut decoder) = (track.id, open_track(path, track)?);
    let mut loss = Loss::of(track, decoder.codec_params(), trusts_length(source)?);
    let refuse = |e: StreamError| describe(path, e);
    let mut sound = Sound {
        edit: edit_list::read(source.read()?, which.number - 1),
        before: before(track, decoder.codec_params()),
        ..Sound::into(out)
    };
    let mut damaged = 0;
    loop {
        let packet = match format.next_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            Err(e) if ended_early(&e) => {
                tracing::warn!(path = %path.display(), "the file ends in the middle of a packet");
                break;
            }
            Err(e) => return Err(refuse(e)),
        };
        if packet.track_id != track_id {
            continue;
        }
        loss.meet(&packet);
        match decoder.decode(&packet) {
            Ok(decoded) => {
                damaged = 0;
                sound.take(path, &decoded)?;
            }
            // A decoder reads no file, so its I/O error means that a packet ends too early.
            Err(StreamError::DecodeError(_) | StreamError::IoError(_))
                if damaged < DAMAGE_LIMIT =>
            {
                damaged += 1;
                loss.lose(packet.dur);
            }
            Err(StreamError::IoError(e)) => {
                let path = path.display();
                return Err(Error::Audio(format!("{path}: {e}")));
            }
            Err(e) => return Err(refuse(e)),
        }
    }
    let damage = loss.damage(sound.seconds());
    match sound.intake {
        Some(intake) => {
            intake.finish()?;
            Ok((damage, which))
        }
        None => Err(Error::Audio(format!(
            "{}: expected sound, got no samples",
            path.display()
        ))),
    }
}

/// How many frames the decoder leaves before the sound, for a file without an edit list.
fn before(track: &Track, parameters: &AudioCodecParameters) -> usize {
    let stated = track.delay.filter(|frames| *frames > 0);
    let stated = stated.map(|frames| frames as usize);
    match parameters.codec {
        CODEC_ID_AAC => stated.unwrap_or(AAC_DELAY),
        CODEC_ID_MP3 if stated.is_none() => MP3_DELAY,
        CODEC_ID_OPUS => match opus::pre_skip(parameters) {
            Some(frames) => frames.into(),
            None => stated.unwrap_or(OPUS_DELAY),
        },
        _ => 0,
    }
}

/// Counts how much of a track is lost in decoding.
struct Loss {
    time_base: Option<TimeBase>,
    /// Length of the track less one packet, if the file states the length.
    expected: Option<Duration>,
    /// Length of the packets that do not decode and of the gaps between packets, in ticks.
    lost: u64,
    /// Where the next packet starts.
    next: Option<i64>,
}

impl Loss {
    fn of(track: &Track, parameters: &AudioCodecParameters, trusts_length: bool) -> Loss {
        let stated = track.duration.filter(|d| d.get() > 0 && trusts_length);
        // Some files count whole packets even if the last one is not full.
        let packet = Duration::from(parameters.max_frames_per_packet.unwrap_or(0));
        Loss {
            time_base: track.time_base,
            expected: stated.map(|length| length.saturating_sub(packet)),
            lost: 0,
            next: None,
        }
    }

    fn meet(&mut self, packet: &Packet) {
        let start = packet.pts.get();
        let gap = self.next.map_or(0, |next| start.saturating_sub(next));
        self.lost = self.lost.saturating_add(u64::try_from(gap).unwrap_or(0));
        // A packet of WebM need not state its length. Then a gap after it goes unnoticed.
        let length = i64::try_from(packet.dur.get()).unwrap_or(i64::MAX);
        self.next = (length > 0).then(|| start.saturating_add(length));
    }

    fn lose(&mut self, length: Duration) {
        self.lost = self.lost.saturating_add(length.get());
    }

    /// `got_s`: length of the decoded sound.
    fn damage(&self, got_s: f64) -> Option<SoundDamage> {
        let seconds = |ticks: Duration| {
            let time = self.time_base?.calc_duration(ticks)?;
            Some(time.as_secs_f64())
        };
        let lost_s = seconds(Duration::from(self.lost))?;
        let whole_s = self.expected.and_then(seconds).unwrap_or(0.0);
        let expected_s = whole_s.max(got_s);
        SoundDamage::of(
            lost_s.max(expected_s - got_s),
            expected_s.max(got_s + lost_s),
        )
    }
}

/// Whether the length that the format reader gives is stated in the file. For an MP3 without a
/// Xing, LAME or Fraunhofer header, the reader guesses the length from the first frames.
fn trusts_length(source: &Source) -> Result<bool> {
    let mut start = Vec::new();
    // Tags may hold pictures. A header behind more than 64 KiB of them is not found.
    if source
        .read()?
        .take(1 << 16)
        .read_to_end(&mut start)
        .is_err()
    {
        return Ok(false);
    }
    let has = |word: &[u8]| start.windows(word.len()).any(|window| window == word);
    if start.starts_with(b"RIFF") {
        // A WAV written to a pipe does not know its length.
        let at = start.windows(4).position(|word| word == b"data");
        let length = at.and_then(|at| start.get(at + 4..at + 8)?.try_into().ok());
        return Ok(length.is_some_and(|four| u64::from(u32::from_le_bytes(four)) < LENGTH_UNKNOWN));
    }
    let other = [&b"OggS"[..], b"fLaC", b"FORM", b"caff"];
    let is_mp4 = start.get(4..8) == Some(b"ftyp");
    let has_header = || {
        [&b"Xing"[..], b"Info", b"VBRI"]
            .iter()
            .any(|word| has(word))
    };
    Ok(is_mp4 || other.iter().any(|magic| start.starts_with(magic)) || has_header())
}

fn open(path: &Path, source: &Source) -> Result<Box<dyn FormatReader>> {
    let stream = MediaSourceStream::new(Box::new(source.read()?), Default::default());
    let mut hint = Hint::new();
    if let Some(extension) = path.extension().and_then(|e| e.to_str()) {
        hint.with_extension(extension);
    }
    get_probe()
        .probe(
            &hint,
            stream,
            FormatOptions::default(),
            MetadataOptions::default(),
        )
        .map_err(|e| {
            Error::Audio(format!(
                "{}: expected {FORMATS}, got something else ({e})",
                path.display()
            ))
        })
}

/// The audio track with a number, or the one that the file names, and its place among those of audio.
fn find_track<'a>(
    path: &Path,
    format: &'a dyn FormatReader,
    wanted: Option<usize>,
) -> Result<(&'a Track, AudioTrack)> {
    let is_audio = |track: &&Track| {
        track
            .codec_params
            .as_ref()
            .is_some_and(|p| p.audio().is_some())
    };
    let tracks: Vec<&Track> = format.tracks().iter().filter(is_audio).collect();
    let named = format.default_track(TrackType::Audio);
    let named = named.and_then(|named| tracks.iter().position(|track| track.id == named.id));
    let number = match wanted {
        Some(number) => number,
        None => named.unwrap_or(0) + 1,
    };
    match number.checked_sub(1).and_then(|place| tracks.get(place)) {
        Some(track) => Ok((
            track,
            AudioTrack {
                number,
                count: tracks.len(),
                language: track.language.clone(),
            },
        )),
        None if tracks.is_empty() => Err(Error::Audio(format!(
            "{}: the file has no audio track",
            path.display()
        ))),
        None => Err(missing_track(number, tracks.len())),
    }
}

fn open_track(path: &Path, track: &Track) -> Result<Box<dyn AudioDecoder>> {
    let lacks = |what: &str| Error::Audio(format!("{}: {what}", path.display()));
    let parameters = track
        .codec_params
        .as_ref()
        .and_then(|p| p.audio())
        .ok_or_else(|| lacks("the audio track does not say how it is coded"))?;
    let parameters = expanded(parameters);
    let decoder = CODECS
        .make_audio_decoder(&parameters, &AudioDecoderOptions::default())
        .map_err(|e| {
            lacks(&format!(
                "the codec is not supported ({e}); expected {FORMATS}"
            ))
        })?;
    Ok(decoder)
}

/// The parameters that a decoder of A-law or µ-law accepts. CAF states 8 bits a sample, the coded
/// size, but the decoder expects the decoded size, 16. So both sizes are left out.
fn expanded(parameters: &AudioCodecParameters) -> Cow<'_, AudioCodecParameters> {
    match parameters.codec {
        CODEC_ID_PCM_ALAW | CODEC_ID_PCM_MULAW => Cow::Owned(AudioCodecParameters {
            bits_per_sample: None,
            bits_per_coded_sample: None,
            ..parameters.clone()
        }),
        _ => Cow::Borrowed(parameters),
    }
}

/// Passes decoded samples to the intake, which the first packet opens with its layout.
struct Sound<'a> {
    /// Where the intake will deliver.
    out: Option<Take<'a>>,
    edit: Option<Edit>,
    /// Frames before the sound if there is no edit.
    before: usize,
    intake: Option<Intake<'a>>,
    layout: (usize, u32),
    interleaved: Vec<f32>,
    /// Frames decoded so far.
    frames: u64,
}

impl<'a> Sound<'a> {
    fn into(out: Take<'a>) -> Self {
        Sound {
            out: Some(out),
            edit: None,
            before: 0,
            intake: None,
            layout: (0, 0),
            interleaved: Vec::new(),
            frames: 0,
        }
    }

    /// Length of everything decoded so far.
    fn seconds(&self) -> f64 {
        self.frames as f64 / f64::from(self.layout.1.max(1))
    }

    fn take(&mut self, path: &Path, decoded: &GenericAudioBufferRef<'_>) -> Result<()> {
        if decoded.frames() == 0 {
            return Ok(());
        }
        self.frames += decoded.frames() as u64;
        let layout = (decoded.num_planes(), decoded.spec().rate());
        if let Some(out) = self.out.take() {
            let mut intake = Intake::new(layout.0, layout.1, out)?;
            let frames = |seconds: f64| (seconds * f64::from(layout.1)).round() as usize;
            match self.edit {
                Some(edit) => intake.keep(
                    frames(edit.start_s),
                    edit.length_s.map_or(usize::MAX, frames),
                ),
                None => intake.keep(self.before, usize::MAX),
            }
            self.intake = Some(intake);
            self.layout = layout;
        }
        if layout != self.layout {
            return Err(Error::Audio(format!(
                "{}: expected {} channels at {} Hz throughout, got {} at {} Hz in the middle",
                path.display(),
                self.layout.0,
                self.layout.1,
                layout.0,
                layout.1
            )));
        }
        decoded.copy_to_vec_interleaved(&mut self.interleaved);
        match &mut self.intake {
            Some(intake) => intake.push(&self.interleaved),
            None => Ok(()),
        }
    }
}

fn ended_early(e: &StreamError) -> bool {
    matches!(e, StreamError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof)
}

fn describe(path: &Path, e: StreamError) -> Error {
    match e {
        StreamError::IoError(e) => Error::io(path)(e),
        StreamError::ResetRequired => Error::Audio(format!(
            "{}: expected one stream, got several chained together",
            path.display()
        )),
        e => Error::Audio(format!("{}: {e}", path.display())),
    }
}
