//! Decodes buffer views that are compressed by EXT_meshopt_compression or KHR_meshopt_compression.
//!
//! The streams are those of the extensions' own text, its appendix A: attributes (versions 0 and
//! 1), triangles and index sequences. Of the filters only EXPONENTIAL is here: the others are for
//! normals, rotations and colours, which do not say where triangles lie. Every range is checked,
//! and no more is reserved than the caller has agreed to.

use serde::Deserialize;

/// Largest number of vertices in a block of attributes, and its largest number of bytes.
const BLOCK: (usize, usize) = (256, 8192);
/// Deltas come in groups of this many.
const GROUP: usize = 16;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compression {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: usize,
    pub count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Deserialize, Clone, Copy, Default, PartialEq)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Exponential,
    #[serde(other)]
    Other,
}

impl Compression {
    /// Number of bytes that it stands for.
    pub(super) fn size(&self) -> usize {
        self.count.saturating_mul(self.byte_stride)
    }

    /// The bytes of the view, `count` elements of `byte_stride`. `None` if the stream is damaged or
    /// its filter is none for places.
    pub(super) fn decode(&self, stream: &[u8]) -> Option<Vec<u8>> {
        let numbers = match self.mode {
            Mode::Attributes => {
                let mut bytes = attributes(stream, self.count, self.byte_stride)?;
                match self.filter {
                    Filter::None => {}
                    Filter::Exponential => exponential(&mut bytes),
                    Filter::Other => return None,
                }
                return Some(bytes);
            }
            Mode::Triangles => triangles(stream, self.count)?,
            Mode::Indices => sequence(stream, self.count)?,
        };
        match self.byte_stride {
            2 => Some(
                numbers
                    .iter()
                    .flat_map(|n| (*n as u16).to_le_bytes())
                    .collect(),
            ),
            4 => Some(numbers.iter().flat_map(|n| n.to_le_bytes()).collect()),
            _ => None,
        }
    }
}

/// The unread rest of a stream.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|taken| taken[0])
    }

    /// A number in groups of seven bits, the lowest first.
    fn number(&mut self) -> Option<u32> {
        let mut number = 0;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            number |= u32::from(byte & 127) << shift;
            if byte < 128 {
                return Some(number);
            }
        }
        None
    }
}

/// Numbers without a sign stand for 0, −1, 1, −2 and so on.
fn signed(number: u32) -> u32 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

fn attributes(stream: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let version = match stream.first()? {
        0xA0 => 0,
        0xA1 => 1,
        _ => return None,
    };
    if stride == 0 || stride > BLOCK.0 || !stride.is_multiple_of(4) {
        return None;
    }
    // The first vertex stands at the end, and how each four bytes of a vertex change.
    let (tail, least) = [(stride, 32), (stride + stride / 4, 24)][version];
    let end = stream.len().checked_sub(tail.max(least))?;
    let (vertex, channels) = stream[stream.len() - tail..].split_at(stride);
    let mut vertex = vertex.to_vec();
    let mut rest = Rest(stream.get(1..end)?);
    let most = (BLOCK.1 / stride / GROUP * GROUP).min(BLOCK.0);
    let mut deltas = vec![0; most * stride];
    let mut out = Vec::with_capacity(count.checked_mul(stride)?);
    for first in (0..count).step_by(most) {
        let length = most.min(count - first);
        let controls = rest.take(version * stride / 4)?;
        for (byte, deltas) in deltas.chunks_mut(most).enumerate() {
            let control = controls.get(byte / 4);
            let control = control.map(|control| control >> (2 * (byte % 4)) & 3);
            byte_deltas(
                control,
                &mut deltas[..length.next_multiple_of(GROUP)],
                length,
                &mut rest,
            )?;
        }
        for v in 0..length {
            let delta = |byte: usize| deltas[byte * most + v];
            for (four, bytes) in vertex.chunks_mut(4).enumerate() {
                let channel = channels.get(four).copied().unwrap_or(0);
                change(bytes, [0, 1, 2, 3].map(|b| delta(4 * four + b)), channel)?;
            }
            out.extend_from_slice(&vertex);
        }
    }
    Some(out)
}

/// Reads the deltas of one byte of a block's vertices. `control` is there from version 1 on.
fn byte_deltas(
    control: Option<u8>,
    deltas: &mut [u8],
    length: usize,
    rest: &mut Rest<'_>,
) -> Option<()> {
    let bits: [usize; 4] = match control {
        None => [0, 2, 4, 8],
        Some(0) => [0, 1, 2, 4],
        Some(1) => [1, 2, 4, 8],
        Some(2) => {
            deltas.fill(0);
            return Some(());
        }
        Some(_) => {
            deltas[..length].copy_from_slice(rest.take(length)?);
            return Some(());
        }
    };
    let (groups, _) = deltas.as_chunks_mut::<GROUP>();
    let headers = rest.take(groups.len().div_ceil(4))?;
    for (g, group) in groups.iter_mut().enumerate() {
        let kind = headers[g / 4] >> (2 * (g % 4)) & 3;
        group_deltas(bits[usize::from(kind)], group, rest)?;
    }
    Some(())
}

/// Reads a group of deltas of some bits each. The largest number of these bits says that the delta
/// is a whole byte, which follows the group.
fn group_deltas(bits: usize, group: &mut [u8; GROUP], rest: &mut Rest<'_>) -> Option<()> {
    if bits == 0 {
        group.fill(0);
        return Some(());
    }
    let packed = rest.take(bits * GROUP / 8)?;
    if bits == 8 {
        group.copy_from_slice(packed);
        return Some(());
    }
    let (in_byte, largest) = (8 / bits, (1 << bits) - 1);
    for (m, delta) in group.iter_mut().enumerate() {
        let place = m % in_byte;
        // Single bits begin with the lowest, all others with the highest.
        let shift = if bits == 1 {
            place
        } else {
            8 - bits - bits * place
        };
        *delta = packed[m / in_byte] >> shift & largest;
        if *delta == largest {
            *delta = rest.byte()?;
        }
    }
    Some(())
}

/// Changes four bytes of a vertex by their deltas: as bytes, as numbers of 16 bits, or bit by bit.
fn change(bytes: &mut [u8], deltas: [u8; 4], channel: u8) -> Option<()> {
    match channel & 3 {
        0 => {
            for (byte, delta) in bytes.iter_mut().zip(deltas) {
                *byte = byte.wrapping_add(signed(delta.into()) as u8);
            }
        }
        1 => {
            for (pair, delta) in bytes.chunks_exact_mut(2).zip(deltas.chunks_exact(2)) {
                let delta = signed(u16::from_le_bytes([delta[0], delta[1]]).into()) as u16;
                let number = u16::from_le_bytes([pair[0], pair[1]]).wrapping_add(delta);
                pair.copy_from_slice(&number.to_le_bytes());
            }
        }
        2 => {
            let turned = u32::from_le_bytes(deltas).rotate_right(u32::from(channel >> 4));
            for (byte, turned) in bytes.iter_mut().zip(turned.to_le_bytes()) {
                *byte ^= turned;
            }
        }
        _ => return None,
    }
    Some(())
}

/// Turns numbers of an exponent of 8 bits and a mantissa of 24 bits into floats.
fn exponential(bytes: &mut [u8]) {
    let (numbers, _) = bytes.as_chunks_mut::<4>();
    for number in numbers {
        let whole = i32::from_le_bytes(*number);
        let power = f32::from_bits(((whole >> 24).wrapping_add(127) as u32) << 23);
        *number = (power * (whole << 8 >> 8) as f32).to_le_bytes();
    }
}

/// The latest `N` items that were put into it.
struct Latest<T, const N: usize> {
    items: [T; N],
    next: usize,
}

impl<T: Copy + Default, const N: usize> Latest<T, N> {
    fn new() -> Self {
        Latest {
            items: [T::default(); N],
            next: 0,
        }
    }

    /// The item that was put in `back` items before the latest.
    fn get(&self, back: u8) -> T {
        self.items[(self.next + 2 * N - 1 - usize::from(back)) % N]
    }

    fn push(&mut self, item: T) {
        self.items[self.next] = item;
        self.next = (self.next + 1) % N;
    }
}

/// Where the decoder of triangles stands.
struct Corners<'a> {
    edges: Latest<(u32, u32), 16>,
    vertices: Latest<u32, 16>,
    /// The lowest vertex that no triangle has used.
    next: u32,
    /// The vertex from which the next written number is counted.
    last: u32,
    rest: Rest<'a>,
}

fn triangles(stream: &[u8], count: usize) -> Option<Vec<u32>> {
    let (&header, rest) = stream.split_first()?;
    // The last 16 bytes are a table of frequent pairs.
    let (rest, table) = rest.split_at_checked(rest.len().checked_sub(16)?)?;
    if header != 0xE1 || !count.is_multiple_of(3) {
        return None;
    }
    let (codes, rest) = rest.split_at_checked(count / 3)?;
    let mut corners = Corners {
        edges: Latest::new(),
        vertices: Latest::new(),
        next: 0,
        last: 0,
        rest: Rest(rest),
    };
    let mut out = Vec::with_capacity(count);
    for code in codes {
        let (high, low) = (code >> 4, code & 15);
        out.extend(if high < 15 {
            corners.at_edge(high, low)?
        } else {
            corners.alone(low, table)?
        });
    }
    Some(out)
}

impl Corners<'_> {
    /// A triangle at an edge of an earlier one.
    fn at_edge(&mut self, edge: u8, code: u8) -> Option<[u32; 3]> {
        let (a, b) = self.edges.get(edge);
        let c = match code {
            0 => self.unused(),
            1..=12 => self.vertices.get(code),
            13 => self.beside(u32::MAX),
            14 => self.beside(1),
            _ => self.written()?,
        };
        if !(1..=12).contains(&code) {
            self.vertices.push(c);
        }
        self.edges.push((c, b));
        self.edges.push((a, c));
        Some([a, b, c])
    }

    /// A triangle at no edge of those that are remembered.
    fn alone(&mut self, code: u8, table: &[u8]) -> Option<[u32; 3]> {
        let pair = match table.get(usize::from(code)).filter(|_| code < 14) {
            Some(pair) => *pair,
            None => self.rest.byte()?,
        };
        if code >= 14 && pair == 0 {
            self.next = 0;
        }
        let a = if code < 15 {
            self.unused()
        } else {
            self.written()?
        };
        // In the table's pairs 15 stands for a remembered vertex, otherwise for a written number.
        let is_written = |code_of_corner: u8| code >= 14 && code_of_corner == 15;
        let (second, third) = (pair >> 4, pair & 15);
        let b = self.corner(second, is_written(second))?;
        let c = self.corner(third, is_written(third))?;
        self.vertices.push(a);
        for (vertex, corner) in [(b, second), (c, third)] {
            if corner == 0 || is_written(corner) {
                self.vertices.push(vertex);
            }
        }
        self.edges.push((b, a));
        self.edges.push((c, b));
        self.edges.push((a, c));
        Some([a, b, c])
    }

    fn corner(&mut self, code: u8, is_written: bool) -> Option<u32> {
        match code {
            0 => Some(self.unused()),
            _ if is_written => self.written(),
            _ => Some(self.vertices.get(code - 1)),
        }
    }

    fn unused(&mut self) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.next.wrapping_sub(1)
    }

    fn beside(&mut self, step: u32) -> u32 {
        self.last = self.last.wrapping_add(step);
        self.last
    }

    fn written(&mut self) -> Option<u32> {
        let step = signed(self.rest.number()?);
        Some(self.beside(step))
    }
}

fn sequence(stream: &[u8], count: usize) -> Option<Vec<u32>> {
    let (&header, rest) = stream.split_first()?;
    // Each number takes a byte or more.
    if header != 0xD1 || rest.len() < count {
        return None;
    }
    let (mut rest, mut last) = (Rest(rest), [0u32; 2]);
    let number = |_| {
        let number = rest.number()?;
        let last = &mut last[(number & 1) as usize];
        *last = last.wrapping_add(signed(number >> 1));
        Some(*last)
    };
    (0..count).map(number).collect()
}

#[cfg(test)]
mod tests {
    use base64::{Engine, engine::general_purpose::STANDARD};
    use proptest::prelude::*;

    use super::*;

    // The streams are what meshoptimizer's own encoder (1.3) makes of the numbers beside them.
    const SHORTS: [&str; 2] = [
        "oAcAyMjIyMjIyMjIyMjIyMjI/wAAAMjIyMgFCIIggiAAAAAHAA4qRmJ+mrbS7vXZvaGFaf8AAABNMRUGBQACIiqKAAAABwBKGRlKGRkZ\
         ShkZGUoZGRn/AAAAShkZGQUkhISEhAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAfPwAAOf/AAA=",
        "oXurAMjIyMjIyMjIyMjIyMjIyMjIyMgADipGYn6attLuCiZCXnqWss7qBgUAAAVVVgAAAABKGRlKGRkZShkZGUoZGRlKGRkZAAAAAAAA\
         AAAAAAAAAAB8/AAA5/8AAAEB",
    ];
    const FLOATS: &str = "oXh4+AEAMAcDAPcrc99vZ/YOzr4I+IgYQtIpTdUCAQAAcTHU/0719w8ABQEDAQEAOAMEAwAPP1PLVy4WJt48\
         PFCQcvrp8UHDAgAAAHE+Py/S+/gPAAYBAx4BABgHDwA2To52BLx8zMi4wIDIyMQMenIZAAAAAAEPAgYCHAX99w4eBA8CBT4AAAAAAAAA\
         AAAAAKDBAOCfwQCAn8EyMkI=";
    const EXPONENTIAL: &str = "oAABDwAAAGAwAQgAAAABPAAAAAMEAAE/AAAAMDAwASAAAAABPAAAAAMEAAEzAAAAYDABIAAAAAE8AAAA\
         AwQAAAAAAAAAAAAAAAAAAAAAAAAAAADg//MA6P/zAPD/8w==";
    const TRIANGLES: &str = "4f7//39vX1BG/1tvX1BLX0n/X2BZX0hfT/5Zb1hfT1BIDwr/DAcK/wICCBcEFv8HAggVGAf3DQIWBwsWBwcL\
         FgB2h1ZneKmGZYlomAFpAAA=";
    const SEQUENCE: &str = "0QAEEBgOFAQEEDIOFAQEEBgOFEYEEBgOFAgEEDYOFAQEEBwOFEoEEBgOFAgEEDYOFAgEEBgOFEoEEBwOFAQE\
         EDYOFAgEEBgOFEYEEBgOFAQEEDIOFAQEEBgOFEYEEBgOFAAAAAA=";

    fn compression(
        mode: Mode,
        filter: Filter,
        (count, byte_stride): (usize, usize),
    ) -> Compression {
        Compression {
            buffer: 0,
            byte_offset: 0,
            byte_length: 0,
            byte_stride,
            count,
            mode,
            filter,
        }
    }

    fn stream(text: &str) -> Vec<u8> {
        STANDARD.decode(text).unwrap()
    }

    #[test]
    fn attributes_of_both_versions_are_read() {
        let expected: Vec<u8> = (0..20i16)
            .flat_map(|i| [100 * i - 900, 7 * i * i, (37 * i) % 50 - 25, 0])
            .flat_map(i16::to_le_bytes)
            .collect();
        let shorts = compression(Mode::Attributes, Filter::None, (20, 8));
        for text in SHORTS {
            assert_eq!(shorts.decode(&stream(text)).unwrap(), expected);
        }
        let expected: Vec<u8> = (0..60)
            .flat_map(|i| ((i * i) as f32 / 64.0 - 20.0).to_le_bytes())
            .collect();
        let floats = compression(Mode::Attributes, Filter::None, (20, 12));
        assert_eq!(floats.decode(&stream(FLOATS)).unwrap(), expected);
    }

    #[test]
    fn exponents_and_mantissas_become_floats() {
        let floats = compression(Mode::Attributes, Filter::Exponential, (4, 12));
        let expected: Vec<u8> = (0..12)
            .flat_map(|i| (0.25 * i as f32 - 1.0).to_le_bytes())
            .collect();
        assert_eq!(floats.decode(&stream(EXPONENTIAL)).unwrap(), expected);
        let normals = compression(Mode::Attributes, Filter::Other, (4, 12));
        assert_eq!(normals.decode(&stream(EXPONENTIAL)), None);
    }

    #[test]
    fn triangles_and_sequences_are_read_in_their_order() {
        // The squares of a grid of 5 by 5 vertices, in another order.
        let grid = (0..16).flat_map(|square| {
            let i = square / 4 * 5 + square % 4;
            [[i, i + 1, i + 5], [i + 5, i + 1, i + 6]]
        });
        let grid: Vec<[u32; 3]> = grid.collect();
        let expected: Vec<[u32; 3]> = (0..32).map(|i| grid[i * 11 % 32]).collect();
        let flat: Vec<u32> = expected.as_flattened().to_vec();
        assert_eq!(sequence(&stream(SEQUENCE), 96).unwrap(), flat);
        // The encoder may turn each triangle.
        let turned = |[a, b, c]: [u32; 3]| {
            let turns = [[a, b, c], [b, c, a], [c, a, b]];
            turns.into_iter().min().unwrap()
        };
        let read = triangles(&stream(TRIANGLES), 96).unwrap();
        let read = read.as_chunks::<3>().0.iter().map(|t| turned(*t));
        assert!(read.eq(expected.into_iter().map(turned)));
        let of_16_bits = compression(Mode::Triangles, Filter::None, (96, 2));
        assert_eq!(of_16_bits.decode(&stream(TRIANGLES)).unwrap().len(), 192);
    }

    proptest! {
        #[test]
        fn damaged_streams_are_refused_or_have_their_size(
            which in 0..6usize, at in 0..400usize, byte in 0..=255u8, cut in 0..400usize, count in 0..600usize,
        ) {
            let texts = [SHORTS[0], SHORTS[1], FLOATS, EXPONENTIAL, TRIANGLES, SEQUENCE];
            let mut bytes = stream(texts[which]);
            let length = bytes.len();
            bytes[at % length] ^= byte;
            bytes.truncate(length - cut % length);
            for (mode, stride) in [(Mode::Attributes, 8), (Mode::Attributes, 12), (Mode::Triangles, 4), (Mode::Indices, 2)] {
                let view = compression(mode, Filter::None, (count, stride));
                if let Some(bytes) = view.decode(&bytes) {
                    prop_assert_eq!(bytes.len(), view.size());
                }
            }
        }
    }
}
