//! Annotations of speech: phones, words or mouth shapes with their times, and their file formats.
//!
//! The terms are those of Praat: an annotation has tiers, a tier has intervals, an interval a label.

mod papagayo;
mod plain;
mod rhubarb;
mod symbols;
mod text_grid;
mod tiers;
mod told;

use std::path::Path;

use crate::{
    Error, Result,
    job::{InputKind, read_file, write_atomically},
};

pub use symbols::{Symbols, ipa};
pub use tiers::{Annotation, CLOSED, Interval, Tier};

/// File formats of annotations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnnotationFormat {
    /// Praat's text file, long or short.
    TextGrid,
    /// Rhubarb's tab-separated cues. When read, also a table with a header of phones or words.
    RhubarbTsv,
    /// Rhubarb's JSON. When read, also times of words, phones or visemes by text-to-speech.
    RhubarbJson,
    /// Papagayo's project.
    Papagayo,
    /// Moho's switch data, which Papagayo and Rhubarb export; counts frames from 1.
    MohoSwitch,
    /// Lines of start, end and label, as in Audacity's label files.
    Plain,
    /// SubRip's and WebVTT's subtitles, which are only read.
    Subtitles,
}

impl AnnotationFormat {
    /// Picks the format by the extension of a file name.
    ///
    /// # Errors
    /// `InvalidInput` for any other extension.
    pub fn from_path(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        match extension.to_ascii_lowercase().as_str() {
            "textgrid" => Ok(Self::TextGrid),
            "tsv" => Ok(Self::RhubarbTsv),
            "json" => Ok(Self::RhubarbJson),
            "pgo" => Ok(Self::Papagayo),
            "dat" => Ok(Self::MohoSwitch),
            "txt" => Ok(Self::Plain),
            "srt" | "vtt" => Ok(Self::Subtitles),
            _ => Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .TextGrid, .tsv, .json, .pgo, .dat, .txt, .srt or .vtt, got \
                 {extension:?}",
                path.display()
            ))),
        }
    }
}

impl AnnotationFormat {
    /// Like [`AnnotationFormat::from_path`], for a file to write.
    ///
    /// # Errors
    /// `InvalidInput` for a format that is only read, too.
    pub fn writable(path: &Path) -> Result<Self> {
        match Self::from_path(path)? {
            Self::Subtitles => Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .TextGrid, .tsv, .json, .pgo, .dat or .txt, got subtitles, which \
                 are only read",
                path.display()
            ))),
            format => Ok(format),
        }
    }
}

impl Annotation {
    /// Reads a file in the format that its extension names. `fps` is the frame rate of a .dat file,
    /// which does not state it.
    ///
    /// # Errors
    /// `Io`; `InvalidInput` for another extension, or with file and line for text that it cannot
    /// read.
    pub fn read(path: &Path, fps: f64) -> Result<Annotation> {
        let format = AnnotationFormat::from_path(path)?;
        let bytes = read_file(path, InputKind::Text)?;
        let named = |message: String| Error::InvalidInput(format!("{}:{message}", path.display()));
        let text = decode(&bytes).map_err(&named)?;
        parse(&text, format, fps).map_err(named)
    }

    /// Reads a text in the given format. Errors begin with the line number.
    ///
    /// # Errors
    /// `InvalidInput` with the line that cannot be read.
    pub fn from_text(text: &str, format: AnnotationFormat, fps: f64) -> Result<Annotation> {
        parse(text, format, fps).map_err(Error::InvalidInput)
    }

    /// Writes a file in the format that its extension names; see [`Annotation::to_text`].
    ///
    /// # Errors
    /// `InvalidInput` for another extension, `Io`.
    pub fn write(&self, path: &Path, fps: f64) -> Result<()> {
        let format = AnnotationFormat::writable(path)?;
        let text = self.to_text(format, fps);
        write_atomically(path, |file| {
            std::io::Write::write_all(file, text.as_bytes())
        })
    }

    /// Writes the annotation as text. Formats that count frames round each time to a whole frame at
    /// `fps`. A Papagayo project rounds `fps` itself, too.
    ///
    /// Formats of mouth shapes get each phone as its shape. Gaps between intervals get the shape of
    /// a mouth that is neither closed nor wide: `B` of Rhubarb, `etc` of Papagayo.
    pub fn to_text(&self, format: AnnotationFormat, fps: f64) -> String {
        match format {
            AnnotationFormat::TextGrid => text_grid::write(self),
            AnnotationFormat::RhubarbTsv => rhubarb::write_tsv(self),
            AnnotationFormat::RhubarbJson => rhubarb::write_json(self),
            AnnotationFormat::Papagayo => papagayo::write_project(self, fps),
            AnnotationFormat::MohoSwitch => papagayo::write_switch(self, fps),
            AnnotationFormat::Plain | AnnotationFormat::Subtitles => plain::write(self),
        }
    }
}

fn parse(text: &str, format: AnnotationFormat, fps: f64) -> Result<Annotation, String> {
    match format {
        AnnotationFormat::TextGrid => text_grid::read(text),
        AnnotationFormat::RhubarbTsv if told::is_table(text) => told::read_table(text),
        AnnotationFormat::RhubarbTsv => rhubarb::read_tsv(text),
        AnnotationFormat::RhubarbJson if text.contains("\"mouthCues\"") => rhubarb::read_json(text),
        AnnotationFormat::RhubarbJson => told::read_json(text),
        AnnotationFormat::Papagayo => papagayo::read_project(text),
        AnnotationFormat::MohoSwitch => papagayo::read_switch(text, fps),
        AnnotationFormat::Plain => plain::read(text),
        AnnotationFormat::Subtitles => told::read_subtitles(text),
    }
}

/// Decodes UTF-8, or UTF-16 with a byte-order mark, which Praat writes if a label needs it.
fn decode(bytes: &[u8]) -> Result<String, String> {
    let wide = |order: fn([u8; 2]) -> u16| {
        let (pairs, _) = bytes[2..].as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().map(|pair| order(*pair)).collect();
        String::from_utf16(&units).map_err(|_| "1: expected text, got damaged UTF-16".to_owned())
    };
    match bytes {
        [0xFF, 0xFE, ..] => wide(u16::from_le_bytes),
        [0xFE, 0xFF, ..] => wide(u16::from_be_bytes),
        _ => {
            let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
            std::str::from_utf8(bytes)
                .map(str::to_owned)
                .map_err(|error| {
                    let before = &bytes[..error.valid_up_to()];
                    let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
                    format!("{line}: expected text in UTF-8, got another encoding")
                })
        }
    }
}

#[cfg(test)]
mod tests;
