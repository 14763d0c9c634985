//! Landmarks as JSON: writes one stable format of our own and reads three formats.
//!
//! The format that is written: `{"version": 1, "confidence": c, "mesh": "digest", "mouth": "open" | "slit" |
//! "welded", "landmarks": [{"index": 0, "position": [x, y, z], "vertex": n, "confidence": c}, …]}`.
//! Positions are in the mesh's own units and axes. `mesh` ([`Mesh::digest`]) is there only if the mesh is that of a
//! file, `mouth` only if the mesh was examined.
//!
//! The formats that are read: this one, a plain list of 68 points `[[x, y, z], …]`, or a plain list
//! of 68 vertex numbers. In the first, `vertex` and both `confidence` are optional, `position` is
//! optional if `vertex` is given, and `mouth` is ignored. `mesh` counts only for landmarks that lie beside a mesh
//! ([`LandmarkSource::read_beside`]). A landmark without `confidence` gets 1:
//! its writer is certain.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{
    FixedLandmark, KnownLandmark, LandmarkPlace, LandmarkSource, Landmarks, Mesh, Mouth,
    ibug::LANDMARKS,
};
use crate::{
    Error, Result,
    job::{InputKind, check_json, read_text},
};

/// The format's version. Raise it when a reader of the old version would misread the new one.
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Document {
    version: u32,
    landmarks: Vec<Entry>,
}

#[derive(Serialize, Deserialize)]
struct Entry {
    index: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vertex: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    confidence: Option<f32>,
}

impl Landmarks {
    /// Confidence of the whole face, 0 to 1: the mean over its landmarks.
    pub fn overall_confidence(&self) -> f32 {
        self.confidence.iter().sum::<f32>() / LANDMARKS as f32
    }

    /// The JSON document, with one landmark per line.
    pub fn to_json(&self) -> String {
        self.document(&[])
    }

    /// The JSON document beside the file of a mesh. It names the mesh, and says how the lips meet if
    /// that is known. `mesh`: as it is read from the file.
    pub fn to_json_of(&self, mesh: &Mesh, mouth: Option<Mouth>) -> String {
        let mesh = [("mesh", mesh.digest())];
        let mouth = mouth.map(|mouth| ("mouth", mouth.name().to_owned()));
        let texts: Vec<_> = mesh.into_iter().chain(mouth).collect();
        self.document(&texts)
    }

    /// `texts`: names and texts of further fields.
    fn document(&self, texts: &[(&str, String)]) -> String {
        let lines: Vec<String> = (0..LANDMARKS)
            .map(|index| {
                let entry = Entry {
                    index,
                    position: Some(self.positions[index]),
                    vertex: Some(self.vertices[index]),
                    confidence: Some(self.confidence[index]),
                };
                serde_json::to_string(&entry).expect("numbers and strings serialise")
            })
            .collect();
        let body = lines.join(",\n  ");
        let confidence = self.overall_confidence();
        let fields = texts.iter();
        let fields = fields.map(|(name, text)| format!(" \"{name}\": \"{text}\",\n"));
        let fields: String = fields.collect();
        format!(
            "{{\n \"version\": {VERSION},\n \"confidence\": {confidence},\n{fields} \"landmarks\": \
             [\n  {body}\n ]\n}}\n"
        )
    }
}

impl LandmarkSource {
    /// Reads any of the three formats from a file.
    ///
    /// # Errors
    /// `Io` if it cannot be read, otherwise as [`LandmarkSource::from_json`].
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text(path, InputKind::Text)?;
        Self::from_json(&text).map_err(|error| match error {
            Error::InvalidInput(message) => {
                Error::InvalidInput(format!("{}: {message}", path.display()))
            }
            other => other,
        })
    }

    /// Reads the landmarks that lie beside a mesh, in any of the three formats.
    ///
    /// # Errors
    /// As [`LandmarkSource::read`]; `InvalidInput` if the file names another mesh.
    pub fn read_beside(path: &Path, mesh: &Mesh) -> Result<Self> {
        #[derive(Deserialize)]
        struct Named {
            mesh: String,
        }
        let landmarks = Self::read(path)?;
        let text = read_text(path, InputKind::Text)?;
        match serde_json::from_str(&text) {
            Ok(Named { mesh: other }) if other != mesh.digest() => {
                Err(Error::InvalidInput(format!(
                    "expected the landmarks of this mesh, got those of another one, whose digest is {other}"
                )))
            }
            _ => Ok(landmarks),
        }
    }

    /// Reads any of the three formats.
    ///
    /// # Errors
    /// `InvalidInput` if the text has none of these formats, has another version, or lacks a
    /// landmark; `ShapeMismatch` if a plain list does not have 68 items.
    pub fn from_json(text: &str) -> Result<Self> {
        let invalid = |e: serde_json::Error| Error::InvalidInput(format!("landmarks: {e}"));
        check_json(text.as_bytes()).map_err(|e| Error::InvalidInput(format!("landmarks: {e}")))?;
        let value: serde_json::Value = serde_json::from_str(text).map_err(invalid)?;
        if value.is_object() {
            let document: Document = serde_json::from_value(value).map_err(invalid)?;
            return from_document(document);
        }
        let numbers = value
            .as_array()
            .and_then(|a| a.first())
            .is_some_and(serde_json::Value::is_number);
        if numbers {
            let vertices: Vec<u32> = serde_json::from_value(value).map_err(invalid)?;
            expect_all(vertices.len(), "[68]")?;
            return Ok(LandmarkSource::Vertices(vertices));
        }
        let positions: Vec<[f32; 3]> = serde_json::from_value(value).map_err(invalid)?;
        expect_all(positions.len(), "[68, 3]")?;
        Ok(LandmarkSource::Positions(positions))
    }
}

fn expect_all(count: usize, expected: &str) -> Result<()> {
    if count == LANDMARKS {
        return Ok(());
    }
    Err(Error::ShapeMismatch {
        what: "landmarks",
        expected: expected.into(),
        got: expected.replace("68", &count.to_string()),
    })
}

/// Reads any number of landmarks in the format that this module writes.
///
/// # Errors
/// As [`FixedLandmark::from_json`].
fn fixed_from_json(text: &str) -> Result<Vec<FixedLandmark>> {
    let document = serde_json::from_str(text)
        .map_err(|e: serde_json::Error| Error::InvalidInput(format!("landmarks: {e}")))?;
    let fixed = |entry: Entry| {
        let index = entry.index;
        let place = entry.position.map(LandmarkPlace::Position);
        let place = place.or(entry.vertex.map(LandmarkPlace::Vertex));
        let message = format!("landmarks: expected a position or a vertex; {index} has neither");
        place
            .map(|place| FixedLandmark { index, place })
            .ok_or(Error::InvalidInput(message))
    };
    slots(document)?.into_iter().flatten().map(fixed).collect()
}

fn from_document(document: Document) -> Result<LandmarkSource> {
    let entries = slots(document)?;
    let known = |e: &Entry| {
        Some(KnownLandmark {
            position: e.position?,
            vertex: e.vertex?,
            confidence: e.confidence.unwrap_or(1.0),
        })
    };
    if let Ok(known) = collect(&entries, known) {
        return Ok(LandmarkSource::Known(known));
    }
    collect(&entries, |e| e.position)
        .map(LandmarkSource::Positions)
        .or_else(|_| collect(&entries, |e| e.vertex).map(LandmarkSource::Vertices))
}

/// Puts each entry at its index, `[68]`; `None` for landmarks that are left out.
fn slots(document: Document) -> Result<Vec<Option<Entry>>> {
    if document.version != VERSION {
        return Err(Error::InvalidInput(format!(
            "landmarks: expected version {VERSION}, got {}",
            document.version
        )));
    }
    let mut entries: Vec<Option<Entry>> = (0..LANDMARKS).map(|_| None).collect();
    for entry in document.landmarks {
        let index = entry.index;
        let slot = entries.get_mut(index).ok_or_else(|| {
            Error::InvalidInput(format!("landmarks: expected index below 68, got {index}"))
        })?;
        if slot.replace(entry).is_some() {
            let message = format!("landmarks: index {index} appears twice");
            return Err(Error::InvalidInput(message));
        }
    }
    Ok(entries)
}

fn collect<T>(entries: &[Option<Entry>], field: impl Fn(&Entry) -> Option<T>) -> Result<Vec<T>> {
    let value = |(index, entry): (usize, &Option<Entry>)| {
        entry.as_ref().and_then(&field).ok_or_else(|| {
            Error::InvalidInput(format!(
                "landmarks: expected all 68 with a position, or all 68 with a vertex; {index} has \
                 neither or is missing"
            ))
        })
    };
    entries.iter().enumerate().map(value).collect()
}

impl FixedLandmark {
    /// Reads any number of fixed landmarks from a JSON file.
    ///
    /// # Errors
    /// `Io` if it cannot be read, else as [`FixedLandmark::from_json`].
    pub fn read(path: &Path) -> Result<Vec<Self>> {
        let text = read_text(path, InputKind::Text)?;
        Self::from_json(&text).map_err(|error| match error {
            Error::InvalidInput(message) => {
                Error::InvalidInput(format!("{}: {message}", path.display()))
            }
            other => other,
        })
    }

    /// Reads any number of fixed landmarks, the lowest index first.
    ///
    /// # Errors
    /// `InvalidInput` if the text is not in the format or has another version, if an index is above
    /// 67 or appears twice, or if an entry has neither a position nor a vertex.
    pub fn from_json(text: &str) -> Result<Vec<Self>> {
        fixed_from_json(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmarks() -> Landmarks {
        Landmarks {
            positions: std::array::from_fn(|i| [i as f32 * 0.1, -1.5, 1e-7]),
            vertices: std::array::from_fn(|i| 3 * i as u32),
            confidence: std::array::from_fn(|i| 1.0 / (1.0 + i as f32)),
        }
    }

    #[test]
    fn a_written_file_reads_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.json");
        std::fs::write(&path, landmarks().to_json()).unwrap();
        let expected = LandmarkSource::from(&landmarks());
        assert_eq!(LandmarkSource::read(&path).unwrap(), expected);
    }

    #[test]
    fn the_document_says_how_sure_the_face_is_and_how_its_lips_meet() {
        let text = landmarks().to_json_of(&triangle(), Some(Mouth::Welded));
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["mouth"], "welded");
        let confidence = value["confidence"].as_f64().unwrap() as f32;
        assert!((confidence - landmarks().overall_confidence()).abs() < 1e-6);
        let expected = LandmarkSource::from(&landmarks());
        assert_eq!(LandmarkSource::from_json(&text).unwrap(), expected);
    }

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
        }
    }

    #[test]
    fn landmarks_beside_another_mesh_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("l.json");
        let (mesh, expected) = (triangle(), LandmarkSource::from(&landmarks()));
        std::fs::write(&path, landmarks().to_json_of(&mesh, None)).unwrap();
        assert_eq!(LandmarkSource::read_beside(&path, &mesh).unwrap(), expected);
        let (mut moved, mut turned) = (mesh.clone(), mesh.clone());
        moved.positions[1][0] += 1e-6;
        turned.triangles[0] = [0, 2, 1];
        for other in [&moved, &turned] {
            let error = LandmarkSource::read_beside(&path, other)
                .unwrap_err()
                .to_string();
            assert!(error.contains(&mesh.digest()), "{error}");
        }
        assert_eq!(LandmarkSource::read(&path).unwrap(), expected);
        // A file of another program names no mesh.
        std::fs::write(&path, landmarks().to_json()).unwrap();
        assert_eq!(
            LandmarkSource::read_beside(&path, &moved).unwrap(),
            expected
        );
    }

    #[test]
    fn plain_lists_are_read() {
        let points: Vec<[f32; 3]> = landmarks().positions.into();
        let text = serde_json::to_string(&points).unwrap();
        let source = LandmarkSource::from_json(&text).unwrap();
        assert_eq!(source, LandmarkSource::Positions(points));
        let numbers: Vec<u32> = landmarks().vertices.into();
        let text = serde_json::to_string(&numbers).unwrap();
        let source = LandmarkSource::from_json(&text).unwrap();
        assert_eq!(source, LandmarkSource::Vertices(numbers));
    }

    #[test]
    fn vertices_alone_are_enough() {
        let entries: Vec<String> = (0..68)
            .map(|i| format!("{{\"index\":{i},\"vertex\":{}}}", 67 - i))
            .collect();
        let text = format!("{{\"version\":1,\"landmarks\":[{}]}}", entries.join(","));
        let source = LandmarkSource::from_json(&text).unwrap();
        assert_eq!(source, LandmarkSource::Vertices((0..68).rev().collect()));
    }

    #[test]
    fn defects_are_named() {
        let full = landmarks().to_json();
        for (text, expected) in [
            (
                full.replace("\"version\": 1", "\"version\": 2"),
                "version 1, got 2",
            ),
            (
                full.replace("\"index\":5,", "\"index\":6,"),
                "index 6 appears twice",
            ),
            (
                full.replace("\"index\":5,", "\"index\":68,"),
                "below 68, got 68",
            ),
            ("[[0,0,0]]".into(), "expected [68, 3], got [1, 3]"),
            ("[1,2,3]".into(), "expected [68], got [3]"),
            ("[1,-2,3]".into(), "invalid value"),
            ("{\"version\":1,\"landmarks\":[]}".into(), "0 has neither"),
            ("not json".into(), "landmarks: "),
        ] {
            let error = LandmarkSource::from_json(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error} does not say {expected}");
        }
    }
}
