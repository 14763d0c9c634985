//! FreeTalk's own Sparse-To-Mesh decoder (Nocentini et al. 2026, section 3.2).
//!
//! Twin of `training/systems/freetalk/stm/paper.py`, whose attributes have the names of the layers.
//!
//! A DiffusionNet reads the neutral mesh once. In each frame, a graph network reads the 68 landmark
//! displacements and every vertex attends to the landmarks. A second DiffusionNet then turns vertex
//! feature, global displacement vector and attended feature into a displacement.
//!
//! The paper leaves these points open, and this file settles them:
//! - landmark graph: iBUG chains plus bridges (`landmark_edges`);
//! - index encoding: the sinusoidal one of Vaswani et al. 2017;
//! - `phi` (eq. 12) is one linear layer; the attention has no output projection (eq. 14 has none);
//! - units: positions and displacements are in decimetres, so that both are of order one.
//!
//! The first layer of the decoder is linear in its three inputs. The contribution of the vertex
//! features is thus computed once per mesh, and that of the displacement vector once per frame.

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayRef2, ArrayView2, ArrayView3, Axis, s};
use serde::{Deserialize, Serialize};

use super::{
    landmark_graph::{index_encoding, landmark_edges},
    shares::attention_shares,
};
use crate::{
    Error, Result,
    job::Watch,
    mesh::ibug::LANDMARKS,
    models::Weights,
    nn::{
        diffusion_net::{DiffusionNet, DiffusionNetShape},
        elementwise::{add_to_rows, relu_all},
        graph_conv::{GraphConv, normalised_adjacency},
        linear::Linear,
        matrix::{self, rows_of, view, view_mut},
        panels::{Finish, Panels, Start},
        surface::Surface,
    },
};

/// The most bytes that the features of frames decoded at once may take.
const BATCH_BYTES: usize = 64 << 20;
/// The most frames that are decoded at once.
const MAX_FRAMES: usize = 8;
/// Size of a displacement vector of all landmarks.
const MOTION: usize = 3 * LANDMARKS;
/// Input channels of a vertex: position and normal.
pub(super) const INPUTS: usize = 6;

/// Sizes of the decoder; `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperConfig {
    /// Channels inside the DiffusionNets.
    pub width: usize,
    /// Channels of vertex and landmark features.
    pub latent: usize,
    /// Blocks of the mesh encoder.
    pub encoder_blocks: usize,
    /// Blocks of the decoder.
    pub decoder_blocks: usize,
    /// Layers of the landmark graph network.
    pub graph_layers: usize,
    /// Attention heads; divides `latent`.
    pub heads: usize,
    /// Channels of the index encoding, even.
    pub index_encoding: usize,
    /// Eigenpairs `K` of the mesh.
    pub eigenpairs: usize,
}

impl PaperConfig {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is not such a file or its numbers contradict each other.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong =
            |complaint: String| Error::Weights(format!("stm_paper config.json: {complaint}"));
        let config: PaperConfig = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
        let PaperConfig { latent, heads, .. } = config;
        if heads == 0 || !latent.is_multiple_of(heads) {
            return Err(wrong(format!(
                "heads: expected a divisor of {latent}, got {heads}"
            )));
        }
        if !config.index_encoding.is_multiple_of(2) {
            let size = config.index_encoding;
            return Err(wrong(format!(
                "index_encoding: expected an even number, got {size}"
            )));
        }
        Ok(config)
    }
}

/// The decoder with its weights.
pub struct PaperDecoder {
    config: PaperConfig,
    mesh_encoder: DiffusionNet,
    landmark_encoder: Vec<GraphConv>,
    adjacency: Array2<f32>,
    /// `[N, index_encoding]`.
    index: Array2<f32>,
    landmark_projection: Linear,
    query: Linear,
    key: Linear,
    value: Linear,
    decoder: DiffusionNet,
    /// The part of the decoder's first weight for the attended features, `[latent, width]`.
    from_attended: Panels,
}

/// The decoder's features of a neutral mesh.
pub struct MeshFeatures {
    /// The decoder's first layer applied to the vertex features, with its bias, `[V, width]`.
    first: Array2<f32>,
    /// `[V, latent]`.
    query: Array2<f32>,
    #[cfg(test)]
    features: Array2<f32>,
}

/// The landmarks of one frame, as keys and values for the vertices.
struct FrameFeatures {
    /// The decoder's first layer applied to the displacement vector, `[width]`.
    motion: Vec<f32>,
    /// `[N, latent]`.
    key: Array2<f32>,
    /// `[N, latent]`.
    value: Array2<f32>,
}

impl PaperDecoder {
    /// Loads the decoder from the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        Self::new(
            PaperConfig::from_json(config)?,
            &Weights::from_bytes(weights)?,
        )
    }

    pub(super) fn new(config: PaperConfig, weights: &Weights) -> Result<Self> {
        let PaperConfig { width, latent, .. } = config;
        let net = |name: &str, inputs, outputs, blocks| {
            let shape = DiffusionNetShape {
                inputs,
                outputs,
                width,
                blocks,
            };
            DiffusionNet::load(&weights.pp(name), shape)
        };
        let graph = weights.pp("landmark_encoder");
        let layer = |i| {
            GraphConv::load(
                &graph.pp(format!("layer_{i}")),
                if i == 0 { 3 } else { latent },
                latent,
            )
        };
        let attention = weights.pp("attention");
        let projection = |name: &str| Linear::load(&attention.pp(name), latent, latent);
        let nodes = latent + config.index_encoding;
        let decoder = net("decoder", 2 * latent + MOTION, 3, config.decoder_blocks)?;
        let first = decoder.first_lin().weight();
        Ok(PaperDecoder {
            mesh_encoder: net("mesh_encoder", INPUTS, latent, config.encoder_blocks)?,
            landmark_encoder: (0..config.graph_layers).map(layer).collect::<Result<_>>()?,
            adjacency: normalised_adjacency(LANDMARKS, &landmark_edges()),
            index: index_encoding(config.index_encoding),
            landmark_projection: Linear::load(&weights.pp("landmark_projection"), nodes, latent)?,
            query: projection("query")?,
            key: projection("key")?,
            value: projection("value")?,
            from_attended: Panels::new(first.subrows(latent + MOTION, latent)),
            decoder,
            config,
        })
    }

    /// The decoder's sizes.
    pub fn config(&self) -> &PaperConfig {
        &self.config
    }

    /// Reads a neutral mesh. `vertex_inputs`: `[V, inputs]`; `surface` in decimetres.
    pub fn encode(&self, vertex_inputs: Array2<f32>, surface: &Surface) -> MeshFeatures {
        let inputs = vertex_inputs.insert_axis(Axis(0));
        let features = self.mesh_encoder.forward(&inputs, surface);
        let features = features.index_axis_move(Axis(0), 0);
        let first = self.decoder.first_lin();
        let weight = first.weight().subrows(0, self.config.latent);
        let constant = matrix::by_row_blocks(features.nrows(), self.config.width, |rows, out| {
            let features = view(&features).subrows(rows.start, rows.len());
            matrix::product(view_mut(out, self.config.width), features, weight);
            add_to_rows(out, first.bias());
        });
        MeshFeatures {
            first: constant,
            query: self.query.forward(&features),
            #[cfg(test)]
            features,
        }
    }

    /// Displacement of each vertex, decimetres, `[T, V, 3]`.
    ///
    /// `landmarks`: `[T, 68, 3]`, displacements in decimetres.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn decode(
        &self,
        mesh: &MeshFeatures,
        landmarks: ArrayView3<'_, f32>,
        surface: &Surface,
        watch: &Watch<'_>,
    ) -> Result<Array3<f32>> {
        let frames = self.read_landmarks(landmarks);
        self.decoder
            .forward_from(frames.len(), surface, watch, |frame, rows, out| {
                self.first_layer(mesh, &frames[frame], rows, out);
            })
    }

    /// The share with which each vertex attends to each landmark (eq. 13), averaged over the heads,
    /// `[T, V, 68]`: the heat maps of figure 7.
    ///
    /// `landmarks`: `[T, 68, 3]`, displacements in decimetres.
    pub fn attention(&self, mesh: &MeshFeatures, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let frames = self.read_landmarks(landmarks);
        let vertices = mesh.query.nrows();
        let mut out = Array3::zeros((frames.len(), vertices, LANDMARKS));
        for (mut shares, frame) in out.outer_iter_mut().zip(&frames) {
            for head in 0..self.config.heads {
                let of_head = self.head_shares(&mesh.query, frame, head, 0..vertices);
                let of_head = ArrayView2::from_shape((LANDMARKS, vertices), &of_head);
                let of_head = of_head.expect("68 a vertex");
                shares.scaled_add(1.0 / self.config.heads as f32, &of_head.t());
            }
        }
        out
    }

    /// How many frames are decoded at once on a mesh of `vertices` vertices: at least one and at
    /// most `MAX_FRAMES`. The features of several frames fill at most `BATCH_BYTES`.
    pub fn frames_at_once(&self, vertices: usize) -> usize {
        let bytes = size_of::<f32>() * self.config.width * vertices.max(1);
        (BATCH_BYTES / bytes).clamp(1, MAX_FRAMES)
    }

    /// Runs the graph network, the index encoding and the attention's projections, eqs. 12 and 13.
    fn read_landmarks(&self, landmarks: ArrayView3<'_, f32>) -> Vec<FrameFeatures> {
        let (count, latent) = (landmarks.len_of(Axis(0)), self.config.latent);
        let nodes = self.graph_features(landmarks);
        let mut joined = Array2::zeros((nodes.nrows(), latent + self.config.index_encoding));
        joined.slice_mut(s![.., ..latent]).assign(&nodes);
        for (node, mut row) in joined.rows_mut().into_iter().enumerate() {
            row.slice_mut(s![latent..])
                .assign(&self.index.row(node % LANDMARKS));
        }
        let projected = self.landmark_projection.forward(&joined);
        let (key, value) = (self.key.forward(&projected), self.value.forward(&projected));
        let motion = self.motion_part(landmarks);
        (0..count)
            .map(|frame| {
                let rows = s![frame * LANDMARKS..(frame + 1) * LANDMARKS, ..];
                FrameFeatures {
                    motion: motion.row(frame).to_vec(),
                    key: key.slice(rows).to_owned(),
                    value: value.slice(rows).to_owned(),
                }
            })
            .collect()
    }

    /// Graph convolutions with ReLU between them. Returns `[T · N, latent]`.
    fn graph_features(&self, landmarks: ArrayView3<'_, f32>) -> Array2<f32> {
        let frames = landmarks.len_of(Axis(0));
        let mut x = landmarks.to_owned();
        let last = self.landmark_encoder.len() - 1;
        for (index, layer) in self.landmark_encoder.iter().enumerate() {
            let mut y = layer.forward(&x, &self.adjacency);
            if index < last {
                relu_all(y.as_slice_mut().expect("new array"));
            }
            let channels = y.ncols();
            let shape = (frames, LANDMARKS, channels);
            x = y.into_shape_with_order(shape).expect("68 rows a frame");
        }
        let channels = x.len_of(Axis(2));
        let shape = (frames * LANDMARKS, channels);
        x.into_shape_with_order(shape).expect("row-major")
    }

    /// Applies the decoder's first layer to the displacement vectors. Returns `[T, width]`.
    fn motion_part(&self, landmarks: ArrayView3<'_, f32>) -> Array2<f32> {
        let (frames, width) = (landmarks.len_of(Axis(0)), self.config.width);
        let landmarks = landmarks.as_standard_layout();
        let vectors = rows_of(landmarks.as_slice().expect("standard layout"), MOTION);
        let weight = self.decoder.first_lin().weight();
        let weight = weight.subrows(self.config.latent, MOTION);
        let mut out = Array2::zeros((frames, width));
        let target = out.as_slice_mut().expect("new array");
        matrix::product(view_mut(target, width), vectors, weight);
        out
    }

    /// Applies the decoder's first layer to some vertices, with the attention (eqs. 13, 14).
    fn first_layer(
        &self,
        mesh: &MeshFeatures,
        frame: &FrameFeatures,
        rows: Range<usize>,
        out: &mut [f32],
    ) {
        let width = self.config.width;
        let constant = &matrix::values(&mesh.first)[rows.start * width..rows.end * width];
        out.copy_from_slice(constant);
        add_to_rows(out, &frame.motion);
        let attended = self.attend(&mesh.query, frame, rows);
        let weight = &self.from_attended;
        weight.multiply(&attended, Start::Output, Finish::Plain, out);
    }

    /// `softmax(q kᵀ / √d) v` for each head. Returns `[rows, latent]`.
    fn attend(
        &self,
        query: &ArrayRef2<f32>,
        frame: &FrameFeatures,
        rows: Range<usize>,
    ) -> Vec<f32> {
        let latent = self.config.latent;
        let per_head = latent / self.config.heads;
        let mut attended = vec![0.0; rows.len() * latent];
        for head in 0..self.config.heads {
            let first = head * per_head;
            let shares = self.head_shares(query, frame, head, rows.clone());
            let shares = rows_of(&shares, rows.len()).transpose();
            let value = view(&frame.value).subcols(first, per_head);
            let target = view_mut(&mut attended, latent).subcols_mut(first, per_head);
            matrix::product(target, shares, value);
        }
        attended
    }

    /// The shares with which these vertices attend to the landmarks in one head, `[68, rows]`.
    fn head_shares(
        &self,
        query: &ArrayRef2<f32>,
        frame: &FrameFeatures,
        head: usize,
        rows: Range<usize>,
    ) -> Vec<f32> {
        let per_head = self.config.latent / self.config.heads;
        let query = view(query).submatrix(rows.start, head * per_head, rows.len(), per_head);
        attention_shares(query, view(&frame.key).subcols(head * per_head, per_head))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::SILENT,
        nn::golden::{Golden, distance},
    };

    fn decode(
        decoder: &PaperDecoder,
        mesh: &MeshFeatures,
        landmarks: ArrayView3<'_, f32>,
        surface: &Surface,
    ) -> Array3<f32> {
        let watch = Watch::new(SILENT, "test", 0.0);
        decoder.decode(mesh, landmarks, surface, &watch).unwrap()
    }

    fn decoder(golden: &Golden) -> PaperDecoder {
        let config = PaperConfig::from_json(&golden.metadata("config")).unwrap();
        PaperDecoder::new(config, &golden.weights()).unwrap()
    }

    #[test]
    fn decoder_matches_pytorch() {
        let golden = Golden::open("stm_paper_debug");
        let (decoder, surface) = (decoder(&golden), golden.surface());
        let mesh = decoder.encode(golden.matrix("vertex_inputs"), &surface);
        let error = distance(&mesh.features, &golden.matrix("features"));
        assert!(error < 1e-4, "features {error}");
        let landmarks = golden.cube("landmarks");
        let got = decode(&decoder, &mesh, landmarks.view(), &surface);
        let error = distance(&got, &golden.cube("output"));
        assert!(error < 1e-4, "output {error}");
    }

    #[test]
    fn attention_shares_sum_to_one_and_differ_between_frames() {
        let golden = Golden::open("stm_paper_debug");
        let (decoder, surface) = (decoder(&golden), golden.surface());
        let mesh = decoder.encode(golden.matrix("vertex_inputs"), &surface);
        let shares = decoder.attention(&mesh, golden.cube("landmarks").view());
        assert_eq!(shares.dim().1, surface.vertices());
        for row in shares.rows() {
            assert!((row.sum() - 1.0).abs() < 1e-5 && row.iter().all(|share| *share >= 0.0));
        }
        assert_ne!(shares.index_axis(Axis(0), 0), shares.index_axis(Axis(0), 1));
    }

    #[test]
    fn a_batch_holds_as_many_frames_as_fit_and_one_at_least() {
        let decoder = decoder(&Golden::open("stm_paper_debug"));
        let frame = 4 * decoder.config().width;
        assert_eq!(decoder.frames_at_once(3 * BATCH_BYTES / frame), 1);
        assert_eq!(decoder.frames_at_once(BATCH_BYTES / frame / 3), 3);
        assert_eq!(decoder.frames_at_once(1), MAX_FRAMES);
    }

    #[test]
    fn frames_are_decoded_alike_in_any_order() {
        let golden = Golden::open("stm_paper_debug");
        let (decoder, surface) = (decoder(&golden), golden.surface());
        let mesh = decoder.encode(golden.matrix("vertex_inputs"), &surface);
        let landmarks = golden.cube("landmarks");
        let forward = decode(&decoder, &mesh, landmarks.view(), &surface);
        let reversed = landmarks.slice(s![..;-1, .., ..]);
        let backward = decode(&decoder, &mesh, reversed, &surface);
        assert_eq!(forward.slice(s![..;-1, .., ..]), backward);
    }

    #[test]
    fn a_frame_is_the_same_alone_and_in_a_batch_on_any_number_of_threads() {
        let golden = Golden::open("stm_paper_debug");
        let (decoder, surface) = (decoder(&golden), golden.surface());
        let mesh = decoder.encode(golden.matrix("vertex_inputs"), &surface);
        let landmarks = golden.cube("landmarks");
        let batch = decode(&decoder, &mesh, landmarks.view(), &surface);
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().unwrap();
            for frame in 0..landmarks.len_of(Axis(0)) {
                let range = s![frame..frame + 1, .., ..];
                let alone =
                    pool.install(|| decode(&decoder, &mesh, landmarks.slice(range), &surface));
                assert_eq!(
                    alone,
                    batch.slice(range),
                    "frame {frame}, {threads} threads"
                );
            }
        }
    }

    #[test]
    fn weights_of_another_size_are_refused() {
        let golden = Golden::open("stm_paper_debug");
        let config = golden
            .metadata("config")
            .replace("\"latent\": 8", "\"latent\": 12");
        let config = PaperConfig::from_json(&config).unwrap();
        let message = PaperDecoder::new(config, &golden.weights()).err().unwrap();
        assert!(message.to_string().contains("expected"), "{message}");
        let config = golden
            .metadata("config")
            .replace("\"heads\": 2", "\"heads\": 3");
        assert!(PaperConfig::from_json(&config).is_err());
    }
}
