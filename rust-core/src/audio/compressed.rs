//! Everything but plain WAV, through symphonia: MP3, FLAC, Ogg Vorbis, M4A, AIFF and odd WAVs.

use std::{fs::File, path::Path};

use symphonia::{
    core::{
        audio::GenericAudioBufferRef,
        codecs::audio::{AudioDecoder, AudioDecoderOptions},
        errors::Error as StreamError,
        formats::{FormatOptions, FormatReader, TrackType, probe::Hint},
        io::MediaSourceStream,
        meta::MetadataOptions,
    },
    default::{get_codecs, get_probe},
};

use super::{
    Waveform,
    edit_list::{self, Edit},
    intake::Intake,
};
use crate::{Error, Result};

/// Damaged packets in a row after which a file is given up.
const DAMAGE_LIMIT: u32 = 100;

const FORMATS: &str = "WAV, MP3, FLAC, Ogg Vorbis, M4A (AAC or ALAC) or AIFF";

/// Decodes the first audio track of the file.
pub(super) fn decode(path: &Path) -> Result<Waveform> {
    let mut format = open(path)?;
    let (track_id, mut decoder) = open_track(path, format.as_ref())?;
    let refuse = |e: StreamError| describe(path, e);
    let mut sound = Sound {
        edit: edit_list::read(path),
        ..Sound::default()
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
        match decoder.decode(&packet) {
            Ok(decoded) => {
                damaged = 0;
                sound.take(path, &decoded)?;
            }
            Err(StreamError::DecodeError(_)) if damaged < DAMAGE_LIMIT => damaged += 1,
            Err(e) => return Err(refuse(e)),
        }
    }
    match sound.intake {
        Some(intake) => intake.finish(),
        None => Err(Error::Audio(format!(
            "{}: expected sound, got no samples",
            path.display()
        ))),
    }
}

fn open(path: &Path) -> Result<Box<dyn FormatReader>> {
    let file = File::open(path).map_err(Error::io(path))?;
    let stream = MediaSourceStream::new(Box::new(file), Default::default());
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

fn open_track(path: &Path, format: &dyn FormatReader) -> Result<(u32, Box<dyn AudioDecoder>)> {
    let lacks = |what: &str| Error::Audio(format!("{}: {what}", path.display()));
    let track = format
        .default_track(TrackType::Audio)
        .ok_or_else(|| lacks("the file has no audio track"))?;
    let parameters = track
        .codec_params
        .as_ref()
        .and_then(|p| p.audio())
        .ok_or_else(|| lacks("the audio track does not say how it is coded"))?;
    let decoder = get_codecs()
        .make_audio_decoder(parameters, &AudioDecoderOptions::default())
        .map_err(|e| {
            lacks(&format!(
                "the codec is not supported ({e}); expected {FORMATS}"
            ))
        })?;
    Ok((track.id, decoder))
}

/// Decoded samples on their way to the intake, which opens with the first packet's layout.
#[derive(Default)]
struct Sound {
    edit: Option<Edit>,
    intake: Option<Intake>,
    layout: (usize, u32),
    interleaved: Vec<f32>,
}

impl Sound {
    fn take(&mut self, path: &Path, decoded: &GenericAudioBufferRef<'_>) -> Result<()> {
        if decoded.frames() == 0 {
            return Ok(());
        }
        let layout = (decoded.num_planes(), decoded.spec().rate());
        if self.intake.is_none() {
            let mut intake = Intake::new(layout.0, layout.1)?;
            if let Some(edit) = self.edit {
                let frames = |seconds: f64| (seconds * f64::from(layout.1)).round() as usize;
                intake.keep(
                    frames(edit.start_s),
                    edit.length_s.map_or(usize::MAX, frames),
                );
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
