//! Which audio track of a file is heard.

use crate::Error;

/// One of the audio tracks of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AudioTrack {
    /// From 1.
    pub number: usize,
    /// How many audio tracks the file has.
    pub count: usize,
    /// Its language, as the file writes it.
    pub language: Option<String>,
}

impl Default for AudioTrack {
    /// The only one.
    fn default() -> AudioTrack {
        AudioTrack {
            number: 1,
            count: 1,
            language: None,
        }
    }
}

impl AudioTrack {
    /// A sentence that says which track was taken; `None` if there is no other.
    pub fn sentence(&self) -> Option<String> {
        let language = self.language.as_deref().filter(|name| *name != "und");
        let language = language.map_or(String::new(), |name| format!(" ({name})"));
        let (number, count) = (self.number, self.count);
        (count > 1).then(|| {
            format!(
                "the file has {count} audio tracks, of which number {number}{language} was taken"
            )
        })
    }
}

/// The error about a track that a file lacks.
pub(super) fn missing_track(number: usize, count: usize) -> Error {
    let expected = match count {
        1 => "1, the only one of the file".to_owned(),
        count => format!("1 to {count}"),
    };
    Error::InvalidInput(format!("audio track: expected {expected}, got {number}"))
}
