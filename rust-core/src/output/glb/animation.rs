//! Motion in a glTF: animation tracks over the frames of the targets.

use std::sync::Arc;

use serde_json::{Value, json};

use super::buffer::Buffer;
use crate::{
    Result,
    motion::Life,
    output::{
        scene::{Scene, hinges},
        targets::Targets,
    },
};

/// Name of the nodes, meshes, materials and animations that Anyface adds.
pub const NAME: &str = "Anyface";

/// One sampler of an animation, and the node and property that it drives.
pub struct Track {
    pub sampler: Value,
    pub node: usize,
    pub path: &'static str,
}

/// An animation of these tracks. `sound`: name of the sound file, stored in the extras.
pub fn animation(tracks: Vec<Track>, sound: Option<&str>) -> Value {
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

/// What the weight of a target of a mesh is over time.
#[derive(Debug, Clone, Copy)]
pub(super) enum WeightSource {
    /// It keeps the weight of the file.
    Still(f32),
    /// It has the weights of a column of the [`Targets`].
    Column(usize),
}

/// Adds an accessor of the times of the frames in seconds, and returns its number.
///
/// # Errors
/// `InvalidInput` for no frames.
pub fn times(buffer: &mut Buffer, frames: usize, fps: f64) -> Result<usize> {
    let times: Vec<f32> = (0..frames).map(|t| (t as f64 / fps) as f32).collect();
    let ends = times.first().zip(times.last());
    let bounds = ends.map(|(first, last)| (vec![*first], vec![*last]));
    buffer.floats(&times, "SCALAR", bounds)
}

/// The sampler of the weights of a mesh.
pub(super) fn weights(
    buffer: &mut Buffer,
    times: usize,
    targets: &Targets,
    sources: &[WeightSource],
) -> Result<Value> {
    let (frames, all) = (targets.weights.nrows(), Arc::clone(&targets.weights));
    let (count, sources) = (frames * sources.len(), sources.to_vec());
    let values = (0..frames).flat_map(move |t| {
        let row = sources.iter().map(|source| match *source {
            WeightSource::Still(weight) => weight,
            WeightSource::Column(k) => all[[t, k]],
        });
        row.collect::<Vec<f32>>()
    });
    let output = buffer.later(count, "SCALAR", values)?;
    Ok(json!({"input": times, "output": output, "interpolation": "LINEAR"}))
}

/// Whether the head moves at all.
pub(super) fn is_turning(life: &Life) -> bool {
    life.head.iter().any(|x| *x != 0.0)
}

/// Nodes that rotate everything below them around the point between the jaw's hinges.
///
/// Returns the rotating node, the node below it that undoes the offset, and the sampler of the
/// rotations. Returns `None` if the head is still.
pub(super) fn head(
    buffer: &mut Buffer,
    times: usize,
    scene: &Scene<'_>,
) -> Result<Option<[Value; 3]>> {
    let Some(life) = scene.life.filter(|life| is_turning(life)) else {
        return Ok(None);
    };
    let to_mesh = hinges(scene)?;
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
