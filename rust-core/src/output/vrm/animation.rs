//! Writes a take as a VRM animation: expressions over time, turns of the head, and the gaze.

use std::{io::Write, path::Path};

use glam::{EulerRot, Quat, Vec3};
use ndarray::{Array2, ArrayView1, ArrayView3};
use serde_json::{Map, Value, json};

use super::{
    expressions::perfect_sync,
    skeleton::{eyes_from_head, skeleton},
};
use crate::{
    Result,
    job::ProgressFn,
    motion::Life,
    output::{
        glb::{Buffer, Document, Track, animation, times, write_document},
        moved::Moved,
        scene::Scene,
        take_shapes::{TakeShapes, VOWELS},
    },
    rig::ARKIT,
};

/// Which expressions a VRM animation contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VrmNames {
    /// Both sets.
    #[default]
    All,
    /// Only those of Perfect Sync, which are ARKit's shapes. For an avatar that also has VRM's
    /// expressions, since both sets together would move it twice.
    PerfectSync,
    /// Only those of VRM.
    Vrm,
}

/// The weights of a take for an avatar.
pub struct VrmWeights {
    /// `[T, 52]` of [`ARKIT`].
    pub arkit: Array2<f32>,
    /// `[T, 5]` of [`VOWELS`]; `None` if the animation has only the expressions of Perfect Sync.
    pub vowels: Option<Array2<f32>>,
    pub fps: f64,
}

impl VrmWeights {
    /// Solves a take for the weights of the expressions with these names.
    ///
    /// # Errors
    /// Those of the solve.
    pub fn solve(
        moved: &mut Moved,
        life: Option<&Life>,
        shapes: &TakeShapes,
        names: VrmNames,
        progress: ProgressFn<'_>,
    ) -> Result<VrmWeights> {
        let arkit = shapes.arkit_of(moved, life, progress)?;
        let vowels = if names == VrmNames::PerfectSync {
            None
        } else {
            let solve = |_, part: ArrayView3<'_, f32>| shapes.vowels(part, progress);
            Some(moved.solve(VOWELS.len(), solve)?)
        };
        let fps = moved.fps();
        Ok(VrmWeights { arkit, vowels, fps })
    }
}

/// Writes a take at `path`.
///
/// # Errors
/// Those of the writer, and `InvalidInput` for a clip without frames.
pub fn write_vrm_animation(
    file: (&mut impl Write, &Path),
    scene: &Scene<'_>,
    weights: &VrmWeights,
    names: VrmNames,
) -> Result<()> {
    let VrmWeights { arkit, vowels, fps } = weights;
    let mut take = Take::new(arkit.nrows(), *fps)?;
    if let Some(vowels) = vowels {
        for (name, weights) in VOWELS.iter().zip(vowels.columns()) {
            take.expression("preset", name, weights)?;
        }
        let column = |name: &str| {
            let place = ARKIT.iter().position(|known| *known == name);
            arkit.column(place.expect("a name of ARKit"))
        };
        let [left, right] = ["eyeBlinkLeft", "eyeBlinkRight"].map(column);
        // Avatars add expressions up. So `blink` holds what both eyes close together, and
        // `blinkLeft` and `blinkRight` hold only what an eye closes beyond that.
        let both = ndarray::Zip::from(left)
            .and(right)
            .map_collect(|l, r| l.min(*r));
        take.expression("preset", "blink", both.view())?;
        take.expression("preset", "blinkLeft", (&left - &both).view())?;
        take.expression("preset", "blinkRight", (&right - &both).view())?;
    }
    if names != VrmNames::Vrm {
        // The gaze has a track of its own.
        let faces = ARKIT.iter().zip(arkit.columns());
        for (name, weights) in faces.filter(|(name, _)| !name.starts_with("eyeLook")) {
            if weights.iter().any(|w| *w > 0.0) {
                take.expression("custom", &perfect_sync(name), weights)?;
            }
        }
    }
    let document = take.document(scene)?;
    write_document(file, document)
}

/// A file under construction.
struct Take {
    frames: usize,
    buffer: Buffer,
    times: usize,
    nodes: Vec<Value>,
    tracks: Vec<Track>,
    /// `preset` and `custom`.
    expressions: Map<String, Value>,
}

impl Take {
    fn new(frames: usize, fps: f64) -> Result<Take> {
        let mut buffer = Buffer::after(0, Vec::new(), 0, 0);
        let times = times(&mut buffer, frames, fps)?;
        Ok(Take {
            frames,
            buffer,
            times,
            nodes: Vec::new(),
            tracks: Vec::new(),
            expressions: Map::new(),
        })
    }

    /// Adds a node and the track that moves it. Returns the node's number.
    fn track(
        &mut self,
        name: &str,
        path: &'static str,
        values: impl Iterator<Item = f32> + 'static,
    ) -> Result<usize> {
        let (kind, width) = if path == "rotation" {
            ("VEC4", 4)
        } else {
            ("VEC3", 3)
        };
        let output = self.buffer.later(width * self.frames, kind, values)?;
        self.nodes.push(json!({"name": name}));
        self.tracks.push(Track {
            sampler: json!({"input": self.times, "output": output, "interpolation": "LINEAR"}),
            node: self.nodes.len() - 1,
            path,
        });
        Ok(self.nodes.len() - 1)
    }

    /// Adds an expression. The x of its node's translation holds its weights over time.
    fn expression(&mut self, kind: &str, name: &str, weights: ArrayView1<'_, f32>) -> Result<()> {
        let values = weights.to_vec().into_iter().flat_map(|w| [w, 0.0, 0.0]);
        let node = self.track(name, "translation", values)?;
        let group = self.expressions.entry(kind).or_insert_with(|| json!({}));
        group[name] = json!({"node": node});
        Ok(())
    }

    /// Completes the file with the head and the eyes.
    fn document(mut self, scene: &Scene<'_>) -> Result<Document> {
        let mut extension = json!({"specVersion": "1.0"});
        let life = scene.life.filter(|life| life.head.nrows() == self.frames);
        if let Some(gaze) = life.and_then(looks) {
            let node = self.track("Eyes", "rotation", gaze.into_iter())?;
            extension["lookAt"] = json!({"node": node, "offsetFromHeadBone": eyes_from_head()});
        }
        let first = self.nodes.len();
        let mut bones = skeleton(first, &[]);
        self.nodes.append(&mut bones.nodes);
        if let Some(life) = life.filter(|life| life.head.iter().any(|x| *x != 0.0)) {
            let turns = life.head.outer_iter().flat_map(|turn| {
                let turn = Vec3::new(turn[0], turn[1], turn[2]);
                Quat::from_scaled_axis(turn).to_array()
            });
            let turns: Vec<f32> = turns.collect();
            let output = self.buffer.floats(&turns, "VEC4", None)?;
            self.tracks.push(Track {
                sampler: json!({"input": self.times, "output": output, "interpolation": "LINEAR"}),
                node: bones.head,
                path: "rotation",
            });
        }
        extension["humanoid"] = json!({"humanBones": bones.human_bones});
        if !self.expressions.is_empty() {
            extension["expressions"] = Value::Object(self.expressions);
        }
        let shown: Vec<usize> = (0..=first).collect();
        let (binary, views, accessors) = self.buffer.finish();
        let mut json = json!({
            "asset": {"version": "2.0", "generator": concat!("Anyface ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": shown}],
            "nodes": self.nodes,
            "buffers": [{"byteLength": binary.len().next_multiple_of(4)}],
            "bufferViews": views,
            "accessors": accessors,
            "extensionsUsed": ["VRMC_vrm_animation"],
            "extensions": {"VRMC_vrm_animation": extension},
        });
        if !self.tracks.is_empty() {
            json["animations"] = json!([animation(self.tracks, scene.sound)]);
        }
        Ok(Document {
            json,
            binary,
            bound: Vec::new(),
        })
    }
}

/// Turns of the eyes relative to the head: one quaternion per frame, from the mean angles of both
/// eyes. `None` if the eyes rest throughout.
fn looks(life: &Life) -> Option<Vec<f32>> {
    if life.gaze.iter().all(|angle| *angle == 0.0) {
        return None;
    }
    let turns = life.gaze.outer_iter().flat_map(|eyes| {
        let of = |axis: usize| 0.5 * (eyes[[0, axis]] + eyes[[1, axis]]);
        // Yaw to the left turns about +y, pitch up about -x.
        Quat::from_euler(EulerRot::YXZ, of(0), -of(1), 0.0).to_array()
    });
    Some(turns.collect())
}
