//! Decodes WAV with hound: 8, 16, 24 and 32-bit integers and 32-bit floats, plain or extensible.
//!
//! symphonia decodes the kinds that hound does not read: A-law, µ-law, ADPCM and 64-bit floats.

use std::{
    io::{BufReader, ErrorKind, Read, Seek, SeekFrom},
    path::Path,
};

use hound::{SampleFormat, WavReader};

use super::{
    damage::SoundDamage,
    intake::Intake,
    resample::Take,
    source::{Reading, Source},
};
use crate::{Error, Result};

/// How many frames are decoded at a time.
const CHUNK_FRAMES: usize = 8192;
/// A header that claims this many bytes or more was written before the length was known.
pub(super) const LENGTH_UNKNOWN: u64 = 0x7fff_0000;

pub(super) enum Decoded {
    /// Decoded, with the part that is missing, if any.
    Sound(Option<SoundDamage>),
    /// Not a WAV, or a kind that hound does not read.
    NotForUs,
}

/// Decodes the file into `out` if it is a WAV of a kind that hound reads.
pub(super) fn decode(path: &Path, source: &Source, out: Take<'_>) -> Result<Decoded> {
    let mut file = source.read()?;
    let mut magic = [0; 4];
    match file.read_exact(&mut magic) {
        Ok(()) if &magic == b"RIFF" => (),
        Ok(()) => return Ok(Decoded::NotForUs),
        Err(e) if e.kind() == ErrorKind::UnexpectedEof => return Ok(Decoded::NotForUs),
        Err(e) => return Err(Error::io(path)(e)),
    }
    file.seek(SeekFrom::Start(0)).map_err(Error::io(path))?;
    let reader = match WavReader::new(BufReader::new(file)) {
        Ok(reader) => reader,
        Err(_) => return Ok(Decoded::NotForUs),
    };
    let spec = reader.spec();
    match (spec.sample_format, spec.bits_per_sample) {
        (SampleFormat::Float, 32) => read_all(path, reader, |x: f32| x, out),
        (SampleFormat::Int, bits @ (8 | 16 | 24 | 32)) => {
            let scale = 1.0 / (1u64 << (bits - 1)) as f32;
            read_all(path, reader, move |x: i32| x as f32 * scale, out)
        }
        _ => Ok(Decoded::NotForUs),
    }
}

fn read_all<S: hound::Sample>(
    path: &Path,
    mut reader: WavReader<BufReader<Reading>>,
    to_float: impl Fn(S) -> f32,
    out: Take<'_>,
) -> Result<Decoded> {
    let spec = reader.spec();
    let channels = usize::from(spec.channels);
    let (promised, mut got) = (u64::from(reader.len()), 0u64);
    let promised_bytes = promised * u64::from(spec.bits_per_sample.div_ceil(8));
    let mut intake = Intake::new(channels, spec.sample_rate, out)?;
    let mut chunk = Vec::with_capacity(CHUNK_FRAMES * channels);
    for sample in reader.samples::<S>() {
        match sample {
            Ok(sample) => chunk.push(to_float(sample)),
            Err(e) if cut_short(&e) => {
                tracing::warn!(path = %path.display(), "the file ends before its header says");
                break;
            }
            Err(hound::Error::Unsupported) => return Ok(Decoded::NotForUs),
            Err(hound::Error::IoError(e)) => return Err(Error::io(path)(e)),
            Err(e) => return Err(Error::Audio(format!("{}: {e}", path.display()))),
        }
        got += 1;
        if chunk.len() == CHUNK_FRAMES * channels {
            intake.push(&chunk)?;
            chunk.clear();
        }
    }
    intake.push(&chunk)?;
    intake.finish()?;
    let seconds = |samples: u64| samples as f64 / f64::from(spec.sample_rate) / channels as f64;
    Ok(Decoded::Sound(if promised_bytes < LENGTH_UNKNOWN {
        SoundDamage::of(seconds(promised.saturating_sub(got)), seconds(promised))
    } else {
        None
    }))
}

/// Whether the file is shorter than its header says. Recorders that were stopped hard and programs
/// that write to a pipe leave a length that is too large, but the samples before the end are good.
fn cut_short(e: &hound::Error) -> bool {
    match e {
        hound::Error::IoError(e) => {
            // hound reports a short read as "Failed to read enough bytes." of kind Other.
            e.kind() == ErrorKind::UnexpectedEof || e.raw_os_error().is_none()
        }
        hound::Error::FormatError(_) => true,
        _ => false,
    }
}
