//! The whole network, frame by frame: two branches, and the Mesh Attention that mixes them.
//!
//! Lin et al. 2025, section 3; twin of `training/systems/emoface/model.py`. The paper does not
//! print the formula of the fusion. Here it is `M = w ⊙ M^e + (1 − w) ⊙ M^c` with a sigmoid for
//! `w`.

use faer::{Mat, linalg::solvers::Solve};
use ndarray::{Array1, Array2, Array3, ArrayView1, ArrayView2, Axis, s};

use super::{
    EmoFaceConfig, Fusion,
    branch::{Branch, Frame},
};
use crate::{
    Error, Result,
    mesh::ibug::LANDMARKS,
    models::Weights,
    nn::{
        biased_attention::PastRows,
        elementwise::{gelu, gelu_all, sigmoid},
        linear::Linear,
        spiral_conv::{PastFrames, SpiralConv},
    },
};

/// The ridge that keeps a first pose small, as a share of the Gram matrix's mean diagonal entry.
const RIDGE: f64 = 1e-4;

/// The weights.
pub struct Model {
    config: EmoFaceConfig,
    content_in: Linear,
    emotion_in: Linear,
    /// `[styles, d]`.
    style: Array2<f32>,
    /// `[2, d]`: level 0 and level 1.
    level: Array2<f32>,
    content: Branch,
    emotion: Branch,
    attention: MeshAttention,
    /// `[emotions, E]`: mean features of each emotion.
    prototypes: Array2<f32>,
}

/// The share of the emotion branch for every vertex and frame (§3.2).
struct MeshAttention {
    content: Linear,
    emotion: Linear,
    joint: Linear,
    conv: SpiralConv,
    out: Linear,
}

/// One frame in metres: `[3 V]` each, and the mask `[V]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MadeFrame {
    /// Both branches, mixed by the mask.
    pub motion: Vec<f32>,
    /// The content branch alone.
    pub content: Vec<f32>,
    /// The emotion branch alone.
    pub emotion: Vec<f32>,
    /// `w`, 0 to 1.
    pub mask: Vec<f32>,
    /// The frame in few numbers, `[2 d + C/16 + 1]`: see [`Model::motion_of`].
    pub code: Vec<f32>,
}

/// The inputs of one frame.
#[derive(Clone, Copy)]
pub struct HeardFrame<'a> {
    /// Features of the speech encoder.
    pub content: ArrayView1<'a, f32>,
    /// Features of the emotion encoder.
    pub emotion: ArrayView1<'a, f32>,
    /// Number of the speaking style.
    pub style: usize,
    /// Level of emotion, 0 to 1.5.
    pub level: f32,
}

/// A performance in progress.
#[derive(Clone)]
pub struct Progressing {
    frame: usize,
    /// `[3 V]` in units of the model.
    before: Vec<f32>,
    past_rows: [PastRows; 2],
    past_masks: PastFrames,
}

/// The layer that is shown and from which the next frame continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Both branches, mixed by the mask.
    Both,
    /// The content branch alone.
    Content,
    /// The emotion branch alone.
    Emotion,
}

impl Layer {
    /// The offset of the mask that shows this layer: −1 for content alone, 1 for emotion alone.
    fn shift(self) -> f32 {
        match self {
            Layer::Both => 0.0,
            Layer::Content => -1.0,
            Layer::Emotion => 1.0,
        }
    }
}

impl MadeFrame {
    /// `[3 V]`.
    pub fn layer(&self, layer: Layer) -> &[f32] {
        match layer {
            Layer::Both => &self.motion,
            Layer::Content => &self.content,
            Layer::Emotion => &self.emotion,
        }
    }
}

impl Model {
    /// Builds the network from its config and weights.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn new(config: EmoFaceConfig, weights: &Weights) -> Result<Self> {
        let EmoFaceConfig {
            channels, width, ..
        } = config;
        let linear = |name: &str, inputs| Linear::load(&weights.pp(name), inputs, channels);
        let (styles, emotions) = (config.styles.len(), config.emotions.len());
        Ok(Model {
            content_in: linear("content_in", config.speech.channels)?,
            emotion_in: linear("emotion_in", config.emotion_channels)?,
            style: weights.matrix("style.weight", styles, width)?,
            level: weights.matrix("level", 2, width)?,
            content: Branch::load(&weights.pp("content"), &config)?,
            emotion: Branch::load(&weights.pp("emotion"), &config)?,
            attention: MeshAttention::load(weights, &config)?,
            prototypes: weights.matrix("prototypes", emotions, config.emotion_channels)?,
            config,
        })
    }

    /// Sizes, names and rates.
    pub fn config(&self) -> &EmoFaceConfig {
        &self.config
    }

    /// The mean features of a mixture of the known emotions, `[E]`. `shares`: one for each emotion.
    pub fn prototype(&self, shares: &[f32]) -> Array1<f32> {
        ArrayView1::from(shares).dot(&self.prototypes)
    }

    /// The pose of the template, `[V, 3]` metres, for these displacements of its landmarks.
    ///
    /// Of the poses that the last layers of both branches can make, ridge regression finds a small
    /// one that comes near these landmarks. The model has no other knowledge of faces.
    pub fn pose_of(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> Array2<f32> {
        let EmoFaceConfig {
            vertices, scale_m, ..
        } = self.config;
        let last = [self.content.last_layer(), self.emotion.last_layer()];
        let width = last[0].inputs();
        let basis = |vertex: usize, axis: usize, k: usize| {
            f64::from(last[k / width].weight()[(k % width, 3 * vertex + axis)])
        };
        let at = &self.config.landmarks;
        let landmark_basis = Mat::from_fn(3 * LANDMARKS, 2 * width, |row, k| {
            basis(at[row / 3], row % 3, k)
        });
        let mut gram = &landmark_basis * landmark_basis.transpose();
        let ridge =
            RIDGE * (0..3 * LANDMARKS).map(|i| gram[(i, i)]).sum::<f64>() / (3 * LANDMARKS) as f64;
        for i in 0..3 * LANDMARKS {
            gram[(i, i)] += ridge.max(f64::MIN_POSITIVE);
        }
        let targets = Mat::from_fn(3 * LANDMARKS, 1, |row, _| {
            f64::from(landmarks[row / 3][row % 3] / scale_m)
        });
        let shares = landmark_basis.transpose() * gram.partial_piv_lu().solve(&targets);
        Array2::from_shape_fn((vertices, 3), |(vertex, axis)| {
            let moved: f64 = (0..2 * width)
                .map(|k| basis(vertex, axis, k) * shares[(k, 0)])
                .sum();
            moved as f32 * scale_m
        })
    }

    /// The state before the first frame: at rest, or in the pose `first` `[V, 3]` metres.
    ///
    /// # Errors
    /// `InvalidInput` for a pose of another number of vertices or one that is not finite.
    pub fn start(&self, first: Option<ArrayView2<'_, f32>>) -> Result<Progressing> {
        let vertices = self.config.vertices;
        let mut before = vec![0.0; 3 * vertices];
        if let Some(first) = first {
            if first.dim() != (vertices, 3) || first.iter().any(|x| !x.is_finite()) {
                return Err(Error::InvalidInput(format!(
                    "first pose: expected {vertices} finite displacements, got {:?}",
                    first.dim()
                )));
            }
            for (to, from) in before.iter_mut().zip(first) {
                *to = from / self.config.scale_m;
            }
        }
        Ok(Progressing {
            frame: 0,
            before,
            past_rows: Default::default(),
            past_masks: PastFrames::new(),
        })
    }

    /// `w` of each frame, `[T, V]`, from content features `[T, C]` and emotion features `[T, E]`.
    /// Computes no motion.
    pub fn masks(&self, content: ArrayView2<'_, f32>, emotion: ArrayView2<'_, f32>) -> Array2<f32> {
        let mut past = PastFrames::new();
        let mut out = Array2::zeros((content.nrows(), self.config.vertices));
        let heard = content.outer_iter().zip(emotion.outer_iter());
        for ((content, emotion), mut row) in heard.zip(out.outer_iter_mut()) {
            let (content, emotion) = self.entered(content, emotion);
            let mask = self.attention.step(&content, &emotion, &mut past);
            row.assign(&Array1::from_vec(mask));
        }
        out
    }

    /// Size of a code: the inputs of both branches' last layers, the temporal part of the mask, and
    /// one number for the layer.
    pub fn code_size(&self) -> usize {
        2 * self.config.width + self.attention.conv.outputs() + 1
    }

    /// The template's motion, `[t, V, 3]` metres, for codes `[t, K]` of frames or of times between
    /// frames.
    ///
    /// It is exact for every frame except the first δ − 1, whose mask assumes earlier frames.
    ///
    /// # Errors
    /// `ShapeMismatch` for codes of another size.
    pub fn motion_of(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>> {
        let (frames, size) = codes.dim();
        if size != self.code_size() {
            return Err(Error::ShapeMismatch {
                what: "codes of emoface",
                expected: format!("[{frames}, {}]", self.code_size()),
                got: format!("[{frames}, {size}]"),
            });
        }
        let EmoFaceConfig {
            vertices,
            width,
            scale_m,
            fusion,
            ..
        } = self.config;
        let layer_motion = |branch: &Branch, from: usize| {
            let hidden = codes.slice(s![.., from..from + width]).to_owned();
            branch.last_layer().forward(&hidden)
        };
        let (content, emotion) = (
            layer_motion(&self.content, 0),
            layer_motion(&self.emotion, width),
        );
        let mut out = Array3::zeros((frames, vertices, 3));
        for (t, mut frame) in out.axis_iter_mut(Axis(0)).enumerate() {
            let shift = codes[[t, size - 1]];
            let in_time = codes.slice(s![t, 2 * width..size - 1]).to_vec();
            let shares: Vec<[f32; 2]> = match fusion {
                Fusion::MeshAttention => {
                    let mask = self
                        .attention
                        .mask_of(&in_time, self.attention.conv.delta());
                    let emotion_shares = mask.iter().map(|w| (w + shift).clamp(0.0, 1.0));
                    emotion_shares.map(|w| [1.0 - w, w]).collect()
                }
                Fusion::Sum => vec![[1.0 - shift.max(0.0), 1.0 + shift.min(0.0)]; vertices],
            };
            for ((v, axis), x) in frame.indexed_iter_mut() {
                let at = [t, 3 * v + axis];
                *x = scale_m * (shares[v][0] * content[at] + shares[v][1] * emotion[at]);
            }
        }
        Ok(out)
    }

    /// The inputs of both branches, `[channels]` each.
    fn entered(
        &self,
        content: ArrayView1<'_, f32>,
        emotion: ArrayView1<'_, f32>,
    ) -> (Vec<f32>, Vec<f32>) {
        let channels = self.config.channels;
        let (mut heard, mut emotion_features) = (vec![0.0; channels], vec![0.0; channels]);
        self.content_in.forward_row(&content.to_vec(), &mut heard);
        self.emotion_in
            .forward_row(&emotion.to_vec(), &mut emotion_features);
        (heard, emotion_features)
    }

    /// Computes the next frame. The frame after it continues from `layer` of this one.
    pub fn step(&self, heard: HeardFrame<'_>, layer: Layer, state: &mut Progressing) -> MadeFrame {
        let EmoFaceConfig {
            vertices, scale_m, ..
        } = self.config;
        let (content, emotion) = self.entered(heard.content, heard.emotion);
        let plain = self.style.row(heard.style);
        let level = |row: usize| self.level.row(row);
        let levelled = &plain + &(&level(0) * (1.0 - heard.level)) + &(&level(1) * heard.level);
        let in_time = self
            .attention
            .step_in_time(&content, &emotion, &mut state.past_masks);
        let mask = self.attention.mask_of(&in_time, state.past_masks.len());
        let mut code = Vec::with_capacity(self.code_size());
        let mut outputs = [vec![0.0; 3 * vertices], vec![0.0; 3 * vertices]];
        let branches = [
            (&self.content, &content, plain.to_vec()),
            (&self.emotion, &emotion, levelled.to_vec()),
        ];
        for (((branch, heard, condition), out), past) in
            branches.iter().zip(&mut outputs).zip(&mut state.past_rows)
        {
            let frame = Frame {
                number: state.frame,
                before: &state.before,
                heard,
                condition,
            };
            code.extend(branch.step(frame, past, out));
        }
        code.extend(in_time);
        code.push(layer.shift());
        let [content, emotion] = outputs;
        let mixed = |i: usize, w: f32| match self.config.fusion {
            Fusion::MeshAttention => w * emotion[i] + (1.0 - w) * content[i],
            Fusion::Sum => content[i] + emotion[i],
        };
        let motion: Vec<f32> = (0..3 * vertices).map(|i| mixed(i, mask[i / 3])).collect();
        let mut next = MadeFrame {
            motion,
            content,
            emotion,
            mask,
            code,
        };
        state.before.copy_from_slice(next.layer(layer));
        state.frame += 1;
        for values in [&mut next.motion, &mut next.content, &mut next.emotion] {
            values.iter_mut().for_each(|x| *x *= scale_m);
        }
        next
    }
}

impl MeshAttention {
    fn load(weights: &Weights, config: &EmoFaceConfig) -> Result<Self> {
        let EmoFaceConfig {
            channels,
            vertices,
            kernel,
            delta,
            ..
        } = *config;
        let (quarter, few) = (channels / 4, channels / 16);
        let spirals = weights.matrix("spirals", vertices, kernel)?;
        let spirals = spirals.mapv(|vertex| vertex as usize);
        let weights = weights.pp("mesh_attention");
        let places = weights.matrix("places", vertices, few)?;
        let linear = |name: &str, inputs, outputs| Linear::load(&weights.pp(name), inputs, outputs);
        Ok(MeshAttention {
            content: linear("content", channels, quarter)?,
            emotion: linear("emotion", channels, quarter)?,
            joint: linear("joint", 2 * quarter, few)?,
            conv: SpiralConv::load(&weights.pp("conv"), &spirals, places.view(), few, delta)?,
            out: linear("out", few, 1)?,
        })
    }

    /// The mask of the next frame, `[V]`.
    fn step(&self, content: &[f32], emotion: &[f32], past: &mut PastFrames) -> Vec<f32> {
        let in_time = self.step_in_time(content, emotion, past);
        self.mask_of(&in_time, past.len())
    }

    /// The temporal part of the mask of the next frame, `[C/16]`.
    fn step_in_time(&self, content: &[f32], emotion: &[f32], past: &mut PastFrames) -> Vec<f32> {
        let quarter = self.content.outputs();
        let mut parts = vec![0.0; 2 * quarter];
        self.content.forward_row(content, &mut parts[..quarter]);
        self.emotion.forward_row(emotion, &mut parts[quarter..]);
        gelu_all(&mut parts);
        let mut heard = vec![0.0; self.joint.outputs()];
        self.joint.forward_row(&parts, &mut heard);
        gelu_all(&mut heard);
        self.conv.step_in_time(&heard, past)
    }

    /// The mask of a frame, `[V]`. `in_time`: its temporal part. `frames`: number of frames so far,
    /// at most δ.
    fn mask_of(&self, in_time: &[f32], frames: usize) -> Vec<f32> {
        let around = self.conv.over_surface(in_time, frames);
        let weight = self.out.weight();
        let logit = |row: ArrayView1<'_, f32>| {
            let terms = row.iter().enumerate();
            let sum: f32 = terms.map(|(c, x)| gelu(*x) * weight[(c, 0)]).sum();
            sum + self.out.bias()[0]
        };
        around.outer_iter().map(|row| sigmoid(logit(row))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    #[test]
    fn agrees_with_pytorch_frame_after_frame() {
        let golden = Golden::open("emoface_debug");
        let config = EmoFaceConfig::from_json(&golden.metadata("config")).unwrap();
        let model = Model::new(config, &golden.weights()).unwrap();
        let (content, emotion) = (golden.matrix("content"), golden.matrix("emotion"));
        let level = golden.values("level");
        let first = golden.matrix("first");
        let mut state = model.start(Some(first.view())).unwrap();
        let expected = ["motion", "content_motion", "emotion_motion", "mask"];
        let expected = expected.map(|name| golden.matrix(name));
        let mut largest = 0.0f32;
        for t in 0..content.nrows() {
            let heard = HeardFrame {
                content: content.row(t),
                emotion: emotion.row(t),
                style: 1,
                level: level[t],
            };
            let frame = model.step(heard, Layer::Both, &mut state);
            let parts = [frame.motion, frame.content, frame.emotion, frame.mask];
            for (part, expected) in parts.iter().zip(&expected) {
                largest = largest.max(distance(part, expected.row(t)));
            }
        }
        assert!(largest < 1e-4, "{largest}");
        let masks = model.masks(content.view(), emotion.view());
        let apart = (&masks - &expected[3])
            .iter()
            .fold(0.0f32, |most, x| most.max(x.abs()));
        assert!(apart < 1e-4, "{apart}");
        let shares = golden.values("shares");
        let prototype = model.prototype(&shares);
        assert!(distance(&prototype, &golden.values("prototype")) < 1e-5);
    }

    #[test]
    fn codes_give_the_motion_of_every_layer() {
        let golden = Golden::open("emoface_debug");
        let config = EmoFaceConfig::from_json(&golden.metadata("config")).unwrap();
        let (content, emotion) = (golden.matrix("content"), golden.matrix("emotion"));
        for fusion in [Fusion::MeshAttention, Fusion::Sum] {
            let config = EmoFaceConfig {
                fusion,
                ..config.clone()
            };
            let delta = config.delta;
            let model = Model::new(config, &golden.weights()).unwrap();
            for layer in [Layer::Both, Layer::Content, Layer::Emotion] {
                let mut state = model.start(None).unwrap();
                for t in 0..content.nrows() {
                    let heard = HeardFrame {
                        content: content.row(t),
                        emotion: emotion.row(t),
                        style: 0,
                        level: 1.0,
                    };
                    let frame = model.step(heard, layer, &mut state);
                    let code = ArrayView2::from_shape((1, frame.code.len()), &frame.code).unwrap();
                    let motion = model.motion_of(code).unwrap();
                    let apart = distance(motion.as_slice().unwrap(), frame.layer(layer));
                    assert!(
                        t + 1 < delta || apart < 1e-6,
                        "{fusion:?} {layer:?}: {apart}"
                    );
                }
            }
            let few = Array2::zeros((2, 5));
            let refused = model.motion_of(few.view()).unwrap_err().to_string();
            assert!(refused.contains("got [2, 5]"), "{refused}");
        }
    }

    #[test]
    fn a_first_pose_of_another_mesh_is_refused() {
        let golden = Golden::open("emoface_debug");
        let config = EmoFaceConfig::from_json(&golden.metadata("config")).unwrap();
        let model = Model::new(config, &golden.weights()).unwrap();
        let strange = Array2::zeros((7, 3));
        let refused = model.start(Some(strange.view())).err().unwrap();
        assert!(
            refused.to_string().contains("expected 90 finite"),
            "{refused}"
        );
    }
}
