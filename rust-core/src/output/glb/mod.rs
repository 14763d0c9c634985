//! Binary glTF 2.0 of a mesh that speaks: morph targets, their weights over time, and the turns of the head.
//!
//! A mesh that came from a GLB keeps its file: materials, bones and all else stay, targets and an animation are added
//! (`onto`). Any other mesh gets a file of its own (`alone`). Both write into a [`Buffer`].

mod alone;
mod buffer;
mod onto;

use std::{io::Write, path::Path};

use serde_json::{Value, json};

use self::buffer::Buffer;
use super::targets::Targets;
use crate::{
    Error, Result,
    mesh::{Mesh, Similarity, canonical_landmarks, ibug::LANDMARKS},
    motion::Life,
};

/// What a file shows beside the moving vertices.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    /// At rest, mesh units.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    pub life: Option<&'a Life>,
    /// The bytes of the GLB that the mesh was read from, unchanged.
    pub source: Option<&'a [u8]>,
    /// The name of the sound's file beside this one.
    pub sound: Option<&'a str>,
}

/// How the animation is called.
const NAME: &str = "Anyface";
/// Kinds of numbers in accessors.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// Writes the file at `path`.
///
/// # Errors
/// `InvalidInput` if the source is not that of the mesh or shows one of its meshes twice; those of the writer.
pub(super) fn write_glb(
    (file, path): (&mut impl Write, &Path),
    scene: &Scene<'_>,
    targets: &Targets,
) -> Result<()> {
    let (document, binary) = match scene.source {
        Some(source) => onto::add(source, scene, targets)?,
        None => alone::document(scene, targets)?,
    };
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary;
    binary.resize(binary.len().next_multiple_of(4), 0);
    let chunks = [(b"JSON", &json), (b"BIN\0", &binary)];
    let chunks = chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
    let length = 12
        + chunks
            .clone()
            .map(|(_, bytes)| 8 + bytes.len())
            .sum::<usize>();
    let length = number(length)?;
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(Error::io(path));
    write(b"glTF")?;
    write(&2u32.to_le_bytes())?;
    write(&length.to_le_bytes())?;
    for (kind, bytes) in chunks {
        write(&number(bytes.len())?.to_le_bytes())?;
        write(*kind)?;
        write(bytes)?;
    }
    Ok(())
}

/// The format counts its bytes in 32 bits.
fn number(bytes: usize) -> Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        Error::InvalidInput(format!(
            "expected a GLB of less than 4 GB, got {bytes} bytes; write a shorter sound, or an .npz"
        ))
    })
}

/// One sampler of an animation, and the channels that it drives.
struct Track {
    sampler: Value,
    node: usize,
    path: &'static str,
}

/// An animation of tracks over the frames of the targets.
fn animation(tracks: Vec<Track>, sound: Option<&str>) -> Value {
    let channels = tracks.iter().enumerate().map(|(sampler, track)| {
        json!({"sampler": sampler, "target": {"node": track.node, "path": track.path}})
    });
    let channels: Vec<Value> = channels.collect();
    let samplers: Vec<&Value> = tracks.iter().map(|track| &track.sampler).collect();
    let mut animation = json!({"name": NAME, "channels": channels, "samplers": samplers});
    if let Some(sound) = sound {
        animation["extras"] = json!({"sound": sound});
    }
    animation
}

/// Times of the frames, seconds.
fn times(buffer: &mut Buffer, targets: &Targets) -> Result<usize> {
    let frames = targets.weights.nrows();
    let times: Vec<f32> = (0..frames)
        .map(|t| (t as f64 / targets.fps) as f32)
        .collect();
    let bounds = (vec![times[0]], vec![times[frames - 1]]);
    buffer.floats(&times, "SCALAR", Some(bounds))
}

/// The sampler of the weights of some targets; `before`: weights of targets that the mesh had.
fn weights(
    buffer: &mut Buffer,
    times: usize,
    targets: &Targets,
    (before, own): (&[f32], &[usize]),
) -> Result<Value> {
    let frames = targets.weights.outer_iter();
    let values = frames.flat_map(|row| {
        let own = own.iter().map(move |&k| row[k]);
        before.iter().copied().chain(own)
    });
    let values: Vec<f32> = values.collect();
    let output = buffer.floats(&values, "SCALAR", None)?;
    Ok(json!({"input": times, "output": output, "interpolation": "LINEAR"}))
}

/// A node that turns what is below it about the place between the jaw's hinges: the node, the one below it that takes the
/// place back, and the sampler of the turns. Nothing where the head is still.
fn head(buffer: &mut Buffer, times: usize, scene: &Scene<'_>) -> Result<Option<[Value; 3]>> {
    let Some(life) = scene
        .life
        .filter(|life| life.head.iter().any(|x| *x != 0.0))
    else {
        return Ok(None);
    };
    let to_mesh = Similarity::fit(canonical_landmarks(), scene.landmarks, None)?.similarity;
    let place = to_mesh.apply([0.0; 3]);
    let turns = life.head.outer_iter().flat_map(|turn| {
        let turn = to_mesh.rotate([turn[0], turn[1], turn[2]]);
        glam::Quat::from_scaled_axis(turn.into()).to_array()
    });
    let turns: Vec<f32> = turns.collect();
    let output = buffer.floats(&turns, "VEC4", None)?;
    let back = place.map(|x| -x);
    Ok(Some([
        json!({"name": "Head", "translation": place}),
        json!({"name": "Head at rest", "translation": back}),
        json!({"input": times, "output": output, "interpolation": "LINEAR"}),
    ]))
}

#[cfg(test)]
mod tests;
