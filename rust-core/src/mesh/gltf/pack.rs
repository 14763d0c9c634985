//! Packs a .gltf and the files beside it into the bytes of a .glb, which everything else reads.

use std::path::{Component, Path};

use serde_json::{Value, json};

use super::{LARGEST_JSON, accessor::embedded, document::refusal};
use crate::{
    Result,
    job::{InputKind, check_json, read_file},
};

/// Whether a file is a glTF description as text.
pub(in super::super) fn is_gltf_text(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    bytes.trim_ascii_start().starts_with(b"{")
}

/// The bytes of a .glb with all that a .gltf has. `folder`: where its files lie, or `None` if there
/// are none. Pictures that are missing stay named.
///
/// # Errors
/// `Mesh` if the description is damaged or names a buffer that is not beside it; `Io` if a buffer
/// cannot be read.
pub(in super::super) fn pack(text: &[u8], folder: Option<&Path>) -> Result<Vec<u8>> {
    let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
    if text.len() > LARGEST_JSON {
        return Err(refusal(format!(
            "expected a description of up to {LARGEST_JSON} bytes, got {}",
            text.len()
        )));
    }
    check_json(text).map_err(|e| refusal(format!("its description: {e}")))?;
    let mut document: Value =
        serde_json::from_slice(text).map_err(|e| refusal(format!("its description: {e}")))?;
    if !document["asset"].is_object() {
        return Err(refusal(
            "expected a description of a scene with \"asset\", got other JSON; give the mesh itself".into(),
        ));
    }
    let mut binary = Vec::new();
    pack_buffers(&mut document, &mut binary, folder)?;
    pack_pictures(&mut document, &mut binary, folder);
    if !binary.is_empty() {
        document["buffers"][0]["byteLength"] = json!(binary.len());
    }
    glb(&document, binary)
}

/// Moves the data of all buffers into one. Buffers without data of their own follow it.
fn pack_buffers(document: &mut Value, binary: &mut Vec<u8>, folder: Option<&Path>) -> Result<()> {
    let Some(old) = document.get_mut("buffers").map(Value::take) else {
        return Ok(());
    };
    let mut new = vec![json!({"byteLength": 0})];
    // The new number of each buffer, and where it begins.
    let mut places = Vec::new();
    for buffer in old.as_array().into_iter().flatten() {
        let Some(uri) = buffer["uri"].as_str() else {
            places.push((new.len(), 0));
            new.push(buffer.clone());
            continue;
        };
        let bytes = match embedded(uri)? {
            Some(bytes) => bytes,
            None => beside(uri, folder)?,
        };
        binary.resize(binary.len().next_multiple_of(4), 0);
        places.push((0, binary.len()));
        binary.extend(bytes);
    }
    document["buffers"] = Value::Array(new);
    let views = document
        .get_mut("bufferViews")
        .and_then(Value::as_array_mut);
    for view in views.into_iter().flatten() {
        move_range(view, &places);
        let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
        for range in extensions.into_iter().flat_map(|all| all.values_mut()) {
            move_range(range, &places);
        }
    }
    Ok(())
}

/// Lets a range of an old buffer refer to the new one.
fn move_range(range: &mut Value, places: &[(usize, usize)]) {
    let number = range["buffer"]
        .as_u64()
        .and_then(|n| usize::try_from(n).ok());
    if let Some((number, begin)) = number.and_then(|number| places.get(number)) {
        let offset = range["byteOffset"].as_u64().unwrap_or(0);
        range["buffer"] = json!(number);
        range["byteOffset"] = json!(offset.saturating_add(*begin as u64));
    }
}

/// Takes in the pictures beside the file, so that a scene elsewhere still has them.
fn pack_pictures(document: &mut Value, binary: &mut Vec<u8>, folder: Option<&Path>) {
    if document["buffers"][0].is_null() {
        return;
    }
    let mut views = document["bufferViews"]
        .as_array()
        .cloned()
        .unwrap_or_default();
    let pictures = document.get_mut("images").and_then(Value::as_array_mut);
    for picture in pictures.into_iter().flatten() {
        let uri = picture["uri"]
            .as_str()
            .filter(|uri| !uri.starts_with("data:"));
        let Some((uri, kind)) = uri.and_then(|uri| Some((uri, kind_of_picture(uri)?))) else {
            continue;
        };
        let Ok(bytes) = beside(uri, folder) else {
            continue;
        };
        binary.resize(binary.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()});
        binary.extend(bytes);
        if let Some(picture) = picture.as_object_mut() {
            picture.remove("uri");
        }
        picture["bufferView"] = json!(views.len());
        picture["mimeType"] = json!(kind);
        views.push(view);
    }
    if !views.is_empty() {
        document["bufferViews"] = Value::Array(views);
    }
}

fn kind_of_picture(uri: &str) -> Option<&'static str> {
    let ending = uri.rsplit_once('.')?.1.to_ascii_lowercase();
    Some(match ending.as_str() {
        "png" => "image/png",
        "jpg" | "jpeg" => "image/jpeg",
        "webp" => "image/webp",
        "avif" => "image/avif",
        "ktx2" => "image/ktx2",
        "dds" => "image/vnd-ms.dds",
        _ => return None,
    })
}

/// Reads a file in the folder of the .gltf or below it. A description from a stranger must not
/// reach files elsewhere.
fn beside(uri: &str, folder: Option<&Path>) -> Result<Vec<u8>> {
    let name = decoded(uri);
    let shown: String = name.chars().take(60).collect();
    let within = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    let path = Path::new(&name);
    match folder {
        Some(folder) if !name.contains(':') && path.components().all(within) => {
            read_file(&folder.join(path), InputKind::Mesh)
        }
        Some(_) => Err(refusal(format!(
            "expected data in files beside the .gltf, got some in {shown}; move it there, or pack all into one .glb"
        ))),
        None => Err(refusal(format!(
            "expected all data in the file itself, got some in {shown}; pack it into one .glb"
        ))),
    }
}

/// Replaces `%20` and the like.
fn decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digits = after.get(..2).filter(|_| byte == b'%');
        let digits = digits.and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(byte);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn glb(document: &Value, mut binary: Vec<u8>) -> Result<Vec<u8>> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut file = b"glTF".to_vec();
    let numbers = [2, 28 + json.len() + binary.len(), json.len()];
    for number in numbers {
        let number = u32::try_from(number);
        let number =
            number.map_err(|_| refusal("expected less than 4 GB of data, got more".into()))?;
        file.extend(number.to_le_bytes());
    }
    file.extend(super::JSON);
    file.extend(json);
    file.extend((binary.len() as u32).to_le_bytes());
    file.extend(super::BINARY);
    file.extend(binary);
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, read_mesh_file};

    /// A triangle whose positions and corners are in two files, and a picture.
    const SCENE: &str = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "images":[{"uri":"skin.png"},{"uri":"lost.png"}],
        "buffers":[{"byteLength":36,"uri":"the%20places.bin"},{"byteLength":3,"uri":"below/corners.bin"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":1,"byteLength":3}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
                     {"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}]}"#;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
        std::fs::create_dir(folder.path().join("below")).unwrap();
        let places = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let places: Vec<u8> = places.iter().flat_map(|x| x.to_le_bytes()).collect();
        write("the places.bin", &places);
        write("below/corners.bin", &[2, 0, 1]);
        write("skin.png", b"pixels");
        write("head.gltf", SCENE.as_bytes());
        folder
    }

    #[test]
    fn files_beside_a_gltf_are_taken_in() {
        let folder = folder();
        let bytes = read_mesh_file(&folder.path().join("head.gltf")).unwrap();
        let (json, binary) = super::super::glb_chunks(&bytes).unwrap();
        let document: Value = serde_json::from_slice(json).unwrap();
        assert_eq!(document["buffers"], json!([{"byteLength": 46}]));
        assert_eq!(
            document["images"][0],
            json!({"bufferView": 2, "mimeType": "image/png"})
        );
        assert_eq!(document["images"][1]["uri"], "lost.png");
        assert_eq!(&binary[40..46], b"pixels");
        let (mesh, _) = super::super::parse_glb(&bytes).unwrap();
        assert_eq!(
            (mesh.positions[1], &mesh.triangles[..]),
            ([1.0, 0.0, 0.0], &[[2, 0, 1]][..])
        );
    }

    #[test]
    fn files_elsewhere_are_refused() {
        let folder = folder();
        for uri in [
            "../x.bin",
            "/etc/hosts",
            "https://a/x.bin",
            "below/../../x.bin",
            "%2E%2E/x.bin",
        ] {
            let text = SCENE.replace("below/corners.bin", uri);
            let message = pack(text.as_bytes(), Some(folder.path()))
                .unwrap_err()
                .to_string();
            assert!(message.contains("beside the .gltf"), "{uri}: {message}");
        }
        let message = Mesh::parse(SCENE.as_bytes()).unwrap_err().to_string();
        assert!(
            message.contains("the places.bin; pack it into one .glb"),
            "{message}"
        );
        let missing = pack(
            SCENE.replace("below/", "above/").as_bytes(),
            Some(folder.path()),
        );
        assert!(missing.unwrap_err().to_string().contains("corners.bin"));
        let message = Mesh::parse(br#"{"version":1}"#).unwrap_err().to_string();
        assert!(message.contains("give the mesh itself"), "{message}");
    }
}
