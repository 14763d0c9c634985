//! The bytes of a buffer, most of which exist only while they are written.

use std::io::{self, Write};

/// Bytes in their order. A long take has more weights than fit into memory twice, so they stay
/// numbers until they are written.
#[derive(Default)]
pub struct Bytes {
    pieces: Vec<Piece>,
    length: usize,
}

enum Piece {
    Bytes(Vec<u8>),
    Numbers(Box<dyn Iterator<Item = f32>>),
}

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Bytes {
        Bytes {
            length: bytes.len(),
            pieces: vec![Piece::Bytes(bytes)],
        }
    }
}

impl Bytes {
    /// Number of bytes.
    pub fn len(&self) -> usize {
        self.length
    }

    /// Adds bytes at the end.
    pub(super) fn extend(&mut self, bytes: impl IntoIterator<Item = u8>) {
        if !matches!(self.pieces.last(), Some(Piece::Bytes(_))) {
            self.pieces.push(Piece::Bytes(Vec::new()));
        }
        if let Some(Piece::Bytes(end)) = self.pieces.last_mut() {
            let before = end.len();
            end.extend(bytes);
            self.length += end.len() - before;
        }
    }

    /// Adds zeros until the number of bytes divides by four, as the format wants it.
    pub(super) fn pad(&mut self) {
        let zeros = self.length.next_multiple_of(4) - self.length;
        self.extend(std::iter::repeat_n(0, zeros));
    }

    /// Adds `count` numbers at the end, which `values` has.
    pub(super) fn add_numbers(
        &mut self,
        count: usize,
        values: impl Iterator<Item = f32> + 'static,
    ) {
        self.length += 4 * count;
        self.pieces
            .push(Piece::Numbers(Box::new(values.take(count))));
    }

    /// Writes all bytes.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(self, to: &mut impl Write) -> io::Result<()> {
        for piece in self.pieces {
            match piece {
                Piece::Bytes(bytes) => to.write_all(&bytes)?,
                Piece::Numbers(mut values) => {
                    values.try_for_each(|value| to.write_all(&value.to_le_bytes()))?;
                }
            }
        }
        Ok(())
    }

    /// All bytes in memory.
    pub fn into_vec(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.length);
        self.write(&mut bytes).expect("memory takes all bytes");
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_where_they_were_added() {
        let mut bytes = Bytes::from(vec![1]);
        bytes.pad();
        bytes.add_numbers(2, [1.0, -2.0, 7.0].into_iter());
        bytes.extend([5, 6]);
        bytes.pad();
        assert_eq!(bytes.len(), 16);
        let all = [1, 0, 0, 0, 0, 0, 128, 63, 0, 0, 0, 192, 5, 6, 0, 0];
        assert_eq!(bytes.into_vec(), all);
    }
}
