//! Animations of a file that move the weights of targets. Such an animation holds one weight a key for
//! every target of a mesh, so it needs more of them where a mesh has got more targets.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::buffer::Buffer;
use crate::{Result, mesh::glb_scalars};

/// A mesh that has got more targets.
pub(super) struct Grown {
    /// The node that shows it.
    pub node: usize,
    pub mesh: usize,
    /// How many targets it had.
    pub before: usize,
    /// How many targets came behind them.
    pub added: usize,
}

/// A channel of an animation that moves all weights of a grown mesh.
struct Channel {
    animation: usize,
    number: usize,
    sampler: usize,
    /// Accessor of the weights.
    output: usize,
    before: usize,
    added: usize,
}

/// Adds a weight of 0 for each new target to every key of the file's animations. `source`: the bytes of
/// the file.
///
/// # Errors
/// `Mesh` if the weights of an animation cannot be read, `InvalidInput` if it has no keys.
pub(super) fn widen(
    document: &mut Value,
    (buffer, source): (&mut Buffer, &[u8]),
    grown: &[Grown],
) -> Result<()> {
    let channels = channels(document, grown);
    if channels.is_empty() {
        return Ok(());
    }
    let weights = glb_scalars(source, channels.iter().map(|channel| channel.output))?;
    let mut outputs: BTreeMap<(usize, usize, usize), usize> = BTreeMap::new();
    let mut samplers: BTreeMap<(usize, usize, usize), usize> = BTreeMap::new();
    for channel in channels {
        let Channel {
            animation,
            sampler,
            output,
            before,
            added,
            ..
        } = channel;
        let old = &weights[&output];
        // A file whose weights do not fit its targets was damaged before.
        if old.len() % before != 0 {
            continue;
        }
        let output = match outputs.get(&(output, before, added)) {
            Some(known) => *known,
            None => {
                let keys = old.chunks(before);
                let wide = keys.flat_map(|key| {
                    let new = std::iter::repeat_n(0.0, added);
                    key.iter().copied().chain(new)
                });
                let wide: Vec<f32> = wide.collect();
                let new = buffer.floats(&wide, "SCALAR", None)?;
                outputs.insert((output, before, added), new);
                new
            }
        };
        let animation_value = &mut document["animations"][animation];
        let place = match samplers.get(&(animation, sampler, output)) {
            Some(known) => *known,
            None => {
                let new = sampler_with(animation_value, (sampler, channel.number), output);
                samplers.insert((animation, sampler, output), new);
                new
            }
        };
        animation_value["channels"][channel.number]["sampler"] = json!(place);
    }
    Ok(())
}

/// The channels that move all weights of grown meshes.
fn channels(document: &Value, grown: &[Grown]) -> Vec<Channel> {
    let number = |value: &Value| value.as_u64().map(|n| n as usize);
    let mut channels = Vec::new();
    let animations = document["animations"].as_array().into_iter().flatten();
    for (animation, value) in animations.enumerate() {
        let all = value["channels"].as_array().into_iter().flatten();
        channels.extend(all.enumerate().filter_map(|(k, channel)| {
            let moved = grown
                .iter()
                .find(|grown| grown.before > 0 && moves(&channel["target"], grown))?;
            let sampler = number(&channel["sampler"])?;
            Some(Channel {
                animation,
                number: k,
                sampler,
                output: number(&value["samplers"][sampler]["output"])?,
                before: moved.before,
                added: moved.added,
            })
        }));
    }
    channels
}

/// Whether a channel with this target moves all weights of a mesh.
fn moves(target: &Value, grown: &Grown) -> bool {
    match target["path"].as_str() {
        Some("weights") => target["node"].as_u64() == Some(grown.node as u64),
        Some("pointer") => {
            let pointer = target["extensions"]["KHR_animation_pointer"]["pointer"].as_str();
            let of_node = format!("/nodes/{}/weights", grown.node);
            let of_mesh = format!("/meshes/{}/weights", grown.mesh);
            pointer.is_some_and(|pointer| pointer == of_node || pointer == of_mesh)
        }
        _ => false,
    }
}

/// The number of a sampler with another output: the old one, or a copy of it if other channels use the
/// old one.
fn sampler_with(animation: &mut Value, (sampler, channel): (usize, usize), output: usize) -> usize {
    let all = animation["channels"].as_array().into_iter().flatten();
    let uses = |(k, other): (usize, &Value)| {
        k != channel && other["sampler"].as_u64() == Some(sampler as u64)
    };
    let is_shared = all.enumerate().any(uses);
    let mut new = animation["samplers"][sampler].clone();
    new["output"] = json!(output);
    match animation["samplers"].as_array_mut() {
        Some(samplers) if is_shared => {
            samplers.push(new);
            samplers.len() - 1
        }
        _ => {
            animation["samplers"][sampler] = new;
            sampler
        }
    }
}
