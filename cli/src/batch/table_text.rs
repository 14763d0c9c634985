//! The text of a table, in whatever form a spreadsheet saves it.

/// Characters of Windows-1252 for the bytes from 0x80 to 0x9F. All others are those of Latin-1.
const WINDOWS: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8D}', 'Ž', '\u{8F}',
    '\u{90}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9D}', 'ž', 'Ÿ',
];
/// What may stand between two cells.
const DELIMITERS: [u8; 3] = *b",;\t";

/// The text of a table in UTF-8, in UTF-16 with a byte-order mark, or else in Windows-1252, as
/// Excel's "CSV" and "Unicode text" have it.
pub fn table_text(bytes: &[u8]) -> String {
    let sixteen = |bytes: &[u8], number: fn([u8; 2]) -> u16| {
        let (pairs, _) = bytes.as_chunks::<2>();
        let numbers: Vec<u16> = pairs.iter().map(|pair| number(*pair)).collect();
        String::from_utf16_lossy(&numbers)
    };
    match bytes {
        [0xFF, 0xFE, rest @ ..] => sixteen(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => sixteen(rest, u16::from_be_bytes),
        [0xEF, 0xBB, 0xBF, rest @ ..] => String::from_utf8_lossy(rest).into_owned(),
        _ => match str::from_utf8(bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes.iter().map(|byte| windows(*byte)).collect(),
        },
    }
}

fn windows(byte: u8) -> char {
    let place = usize::from(byte).checked_sub(0x80);
    let known = place.and_then(|place| WINDOWS.get(place)).copied();
    known.unwrap_or(char::from(byte))
}

/// What stands most often between the names of the header: a comma, a semicolon or a tab.
pub fn delimiter(text: &str) -> u8 {
    let header = text.lines().find(|line| !line.trim().is_empty());
    let header = header.unwrap_or_default().as_bytes();
    let count = |delimiter: u8| header.iter().filter(|byte| **byte == delimiter).count();
    // Of several with the same count this takes the first.
    let best = DELIMITERS
        .into_iter()
        .rev()
        .max_by_key(|delimiter| count(*delimiter));
    best.unwrap_or(DELIMITERS[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_spreadsheets_have_the_same_text() {
        let text = "audio;out\ncafé.wav;a.npz\n";
        let little: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        for bytes in [
            text.as_bytes(),
            &[b"\xEF\xBB\xBF", text.as_bytes()].concat(),
            &[&[0xFF, 0xFE][..], &little].concat(),
            &[&[0xFE, 0xFF][..], &big].concat(),
            &latin,
        ] {
            assert_eq!(table_text(bytes), text);
        }
        assert_eq!(table_text(b"\x80 \x93a\x94 \xE4"), "€ “a” ä");
    }

    #[test]
    fn the_header_says_what_stands_between_cells() {
        for (text, expected) in [
            ("audio,out\n1;2;3,4", b','),
            ("\n audio;out;text", b';'),
            ("audio\tout", b'\t'),
            ("audio", b','),
            ("", b','),
        ] {
            assert_eq!(delimiter(text), expected, "{text:?}");
        }
    }
}
