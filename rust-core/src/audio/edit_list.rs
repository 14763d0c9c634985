//! The part of an MP4 audio track that a player plays (ISO/IEC 14496-12, 8.6.6 `elst`).
//!
//! AAC encoders put 1024 to 2112 samples of start-up before the sound and say so in the edit list.
//! symphonia decodes these samples as sound. If they stayed, lips would run 20 to 130 ms late.

use std::io::{Read, Seek, SeekFrom};

/// The most bytes of a movie header that are read. A ten-hour file has under 10 MB.
const LARGEST_HEADER: u64 = 64 << 20;

/// What to keep of a decoded track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edit {
    /// Start of the sound within the track.
    pub start_s: f64,
    /// Length of the sound; `None` keeps all.
    pub length_s: Option<f64>,
}

/// Reads the edit of an audio track; `None` if the file is no MP4 or has no simple edit. `number`: of the track among
/// those of audio, from 0.
pub(super) fn read(mut file: impl Read + Seek, number: usize) -> Option<Edit> {
    let header = movie_header(&mut file)?;
    let movie_scale = timescale(child(&header, b"mvhd")?)?;
    let track = boxes(&header)
        .filter(|(kind, _)| *kind == b"trak")
        .map(|(_, body)| body)
        .filter(|track| is_audio(track).unwrap_or(false))
        .nth(number)?;
    let media_scale = timescale(child(child(track, b"mdia")?, b"mdhd")?)?;
    let (length, start) = first_edit(child(child(track, b"edts")?, b"elst")?)?;
    Some(Edit {
        start_s: start as f64 / media_scale,
        length_s: (length > 0).then(|| length as f64 / movie_scale),
    })
}

/// Body of the top-level `moov` box.
fn movie_header(file: &mut (impl Read + Seek)) -> Option<Vec<u8>> {
    let length = file.seek(SeekFrom::End(0)).ok()?;
    let mut at = 0;
    while at + 8 <= length {
        let mut head = [0; 16];
        file.seek(SeekFrom::Start(at)).ok()?;
        file.read_exact(&mut head[..8]).ok()?;
        if at == 0 && &head[4..8] != b"ftyp" {
            return None;
        }
        let mut skip = 8;
        let size = match u32_at(&head, 0)? {
            0 => length - at,
            1 => {
                file.read_exact(&mut head[8..]).ok()?;
                skip = 16;
                u64_at(&head, 8)?
            }
            size => u64::from(size),
        };
        let body = size.checked_sub(skip)?;
        if &head[4..8] == b"moov" {
            let mut header = Vec::new();
            file.take(body.min(LARGEST_HEADER))
                .read_to_end(&mut header)
                .ok()?;
            return Some(header);
        }
        at = at.checked_add(size)?;
    }
    None
}

/// Walks the boxes that follow each other in `data`. Yields the kind and body of each.
fn boxes(mut data: &[u8]) -> impl Iterator<Item = (&[u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let size = u32_at(data, 0)? as usize;
        let kind = data.get(4..8)?.try_into().ok()?;
        let body = data.get(8..size)?;
        data = &data[size..];
        Some((kind, body))
    })
}

fn child<'a>(data: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(data)
        .find(|(name, _)| *name == kind)
        .map(|(_, body)| body)
}

fn is_audio(track: &[u8]) -> Option<bool> {
    let handler = child(child(track, b"mdia")?, b"hdlr")?;
    Some(handler.get(8..12)? == b"soun")
}

/// Ticks per second in an `mvhd` or `mdhd` box. In version 1, 64-bit dates come before the number.
fn timescale(body: &[u8]) -> Option<f64> {
    let at = if *body.first()? == 1 { 20 } else { 12 };
    u32_at(body, at).filter(|t| *t > 0).map(f64::from)
}

/// Duration in movie ticks and start in media ticks, if the list has just one edit, not empty.
fn first_edit(body: &[u8]) -> Option<(u64, u64)> {
    if u32_at(body, 4)? != 1 {
        return None;
    }
    let (length, start) = match *body.first()? {
        1 => (u64_at(body, 8)?, u64_at(body, 16)? as i64),
        _ => (
            u64::from(u32_at(body, 8)?),
            i64::from(u32_at(body, 12)? as i32),
        ),
    };
    Some((length, u64::try_from(start).ok()?))
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(data.get(at..at + 4)?.try_into().ok()?))
}

fn u64_at(data: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_be_bytes(data.get(at..at + 8)?.try_into().ok()?))
}
