//! The network that finds 68 landmarks on a depth picture; `training/landmarks/network.py` is the
//! twin, layer by layer.
//!
//! A small U-Net over 128² pictures of depth and normals. It gives 68 heat maps of 64², computed at
//! 32² with four sub-pixels per pixel, and one number that says whether there is a face.

use crate::{
    Result,
    mesh::ibug::LANDMARKS,
    models::Weights,
    nn::{
        conv2d::{Conv2d, Picture},
        elementwise::sigmoid,
    },
};

/// Side of a heat map, pixels.
pub(super) const HEAT: usize = 64;

/// A peak's place is the mean over the pixels up to this far to its sides, heat-map pixels.
const PEAK_RADIUS: usize = 3;

/// The network's result for one picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sight {
    /// `[68]`, (column, row) from 0 to 1 over the picture.
    pub places: [[f32; 2]; LANDMARKS],
    /// `[68]`, probability that the landmark lies within a few pixels of its place.
    pub confidence: [f32; LANDMARKS],
    /// Probability that there is a face.
    pub presence: f32,
}

/// Two convolutions with a shortcut past them.
pub(super) struct Block {
    first: Conv2d,
    second: Conv2d,
}

impl Block {
    pub fn load(weights: &Weights, width: usize) -> Result<Self> {
        let shape = [width, width, 3];
        Ok(Block {
            first: Conv2d::load(&weights.pp("first.conv"), shape, 1)?,
            second: Conv2d::load(&weights.pp("second.conv"), shape, 1)?,
        })
    }

    pub fn forward(&self, x: &Picture) -> Picture {
        let inner = self.first.forward(x).relu();
        self.second.forward(&inner).plus(x).relu()
    }
}

/// `LandmarkNetwork` of the twin, with its normalisations folded into the convolutions.
pub(super) struct LandmarkNetwork {
    stem: Conv2d,
    block64: Block,
    down32: Conv2d,
    block32: Block,
    down16: Conv2d,
    block16: Block,
    down8: Conv2d,
    block8: Block,
    up16: Conv2d,
    join16: Conv2d,
    up32: Conv2d,
    join32: Block,
    heat: Conv2d,
    face_weight: Vec<f32>,
    face_bias: f32,
}

impl LandmarkNetwork {
    /// `widths`: channels at 64², 32², 16² and 8².
    ///
    /// # Errors
    /// `Weights` if an array is missing or does not fit the widths.
    pub fn load(weights: &Weights, widths: [usize; 4]) -> Result<Self> {
        let [a, b, c, d] = widths;
        let conv =
            |name: &str, shape, stride| Conv2d::load(&weights.pp(name).pp("conv"), shape, stride);
        Ok(LandmarkNetwork {
            stem: conv("stem", [a, 4, 3], 2)?,
            block64: Block::load(&weights.pp("block64"), a)?,
            down32: conv("down32", [b, a, 3], 2)?,
            block32: Block::load(&weights.pp("block32"), b)?,
            down16: conv("down16", [c, b, 3], 2)?,
            block16: Block::load(&weights.pp("block16"), c)?,
            down8: conv("down8", [d, c, 3], 2)?,
            block8: Block::load(&weights.pp("block8"), d)?,
            up16: conv("up16", [c, d, 1], 1)?,
            join16: conv("join16", [c, c, 3], 1)?,
            up32: conv("up32", [b, c, 1], 1)?,
            join32: Block::load(&weights.pp("join32"), b)?,
            heat: Conv2d::load(&weights.pp("heat"), [4 * LANDMARKS, b, 1], 1)?,
            face_weight: weights.pp("face").values("weight", &[1, d])?,
            face_bias: weights.pp("face").vector("bias", 1)?[0],
        })
    }

    /// `picture`: `[128, 128, 4]`.
    pub fn see(&self, picture: &Picture) -> Sight {
        let (heat, face) = self.forward(picture);
        let maps: Vec<([f32; 2], f32)> = heat.chunks_exact(HEAT * HEAT).map(peak).collect();
        Sight {
            places: std::array::from_fn(|i| maps[i].0),
            confidence: std::array::from_fn(|i| maps[i].1),
            presence: sigmoid(face),
        }
    }

    /// `Sight::presence` alone, at half the cost. `picture`: `[128, 128, 4]`.
    pub fn presence(&self, picture: &Picture) -> f32 {
        sigmoid(self.face(&self.encode(picture)[2]))
    }

    /// Heat maps `[68, 64, 64]` (logits) and the face logit.
    fn forward(&self, picture: &Picture) -> (Vec<f32>, f32) {
        let [x32, x16, x8] = self.encode(picture);
        let up = self.up16.forward(&x8).doubled().plus(&x16).relu();
        let up = self.join16.forward(&up).relu();
        let up = self.up32.forward(&up).doubled().plus(&x32).relu();
        let heat = self.heat.forward(&self.join32.forward(&up));
        (shuffle(&heat), self.face(&x8))
    }

    /// The features of the encoder at 32², 16² and 8².
    fn encode(&self, picture: &Picture) -> [Picture; 3] {
        let x = self.block64.forward(&self.stem.forward(picture).relu());
        let x32 = self.block32.forward(&self.down32.forward(&x).relu());
        let x16 = self.block16.forward(&self.down16.forward(&x32).relu());
        let x8 = self.block8.forward(&self.down8.forward(&x16).relu());
        [x32, x16, x8]
    }

    /// The face logit.
    fn face(&self, x8: &Picture) -> f32 {
        let pairs = x8.mean().into_iter().zip(&self.face_weight);
        pairs.map(|(m, w)| m * w).sum::<f32>() + self.face_bias
    }
}

/// Turns the four channels of a landmark into 2×2 sub-pixels (PyTorch's `pixel_shuffle`), channels
/// first.
fn shuffle(heat: &Picture) -> Vec<f32> {
    let mut maps = vec![0.0; LANDMARKS * HEAT * HEAT];
    for (pixel, values) in heat.values.chunks_exact(heat.channels).enumerate() {
        let (row, column) = (pixel / heat.width, pixel % heat.width);
        for (channel, value) in values.iter().enumerate() {
            let (landmark, sub) = (channel / 4, channel % 4);
            let (r, c) = (2 * row + sub / 2, 2 * column + sub % 2);
            maps[(landmark * HEAT + r) * HEAT + c] = *value;
        }
    }
    maps
}

/// The mean place of the softmax around its peak, and the total probability there.
fn peak(map: &[f32]) -> ([f32; 2], f32) {
    let top = (0..map.len()).fold(0, |best, i| if map[i] > map[best] { i } else { best });
    let total: f32 = map.iter().map(|v| (v - map[top]).exp()).sum();
    let (row, column) = (top / HEAT, top % HEAT);
    let range = |x: usize| x.saturating_sub(PEAK_RADIUS)..(x + PEAK_RADIUS + 1).min(HEAT);
    let (mut x, mut y, mut near) = (0.0, 0.0, 0.0);
    for r in range(row) {
        for c in range(column) {
            let chance = (map[r * HEAT + c] - map[top]).exp();
            near += chance;
            x += chance * (c as f32 + 0.5);
            y += chance * (r as f32 + 0.5);
        }
    }
    let size = HEAT as f32;
    ([x / near / size, y / near / size], near / total)
}

#[cfg(test)]
mod tests {
    use super::super::depth_view::{DepthBuffer, Window};
    use super::*;
    use crate::nn::golden::{Golden, distance};

    /// Written by `python -m training.goldens landmarks`.
    #[test]
    fn network_matches_its_twin() {
        let golden = Golden::open("landmarks_debug");
        let widths = serde_json::from_str(&golden.metadata("widths")).unwrap();
        let network = LandmarkNetwork::load(&golden.weights(), widths).unwrap();
        let picture = picture(&golden);
        let (heat, face) = network.forward(&picture);
        let sample = heat.chunks_exact(HEAT * HEAT).step_by(17).flatten();
        assert!(distance(sample, &golden.values("heat")) < 1e-4);
        assert!(distance(&[face], &golden.values("face")) < 1e-4);
        let sight = network.see(&picture);
        let places: Vec<f32> = sight.places.iter().flatten().copied().collect();
        assert!(distance(&places, &golden.values("places")) < 1e-4);
        assert!(distance(&sight.confidence, &golden.values("confidence")) < 1e-4);
    }

    #[test]
    fn pictures_match_their_twin() {
        let golden = Golden::open("landmarks_debug");
        let points = golden.matrix("points");
        let points: Vec<[f32; 3]> = points
            .rows()
            .into_iter()
            .map(|p| [p[0], p[1], p[2]])
            .collect();
        let triangles: Vec<[u32; 3]> = golden
            .integers("triangles")
            .chunks_exact(3)
            .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
            .collect();
        let window = golden.values("window");
        let window = Window {
            centre: [window[0], window[1]],
            half_size: window[2],
        };
        let drawn = DepthBuffer::draw(&points, &triangles, window).features();
        let expected = picture(&golden);
        // Rounding of the last bit decides whether a pixel centre on an edge is covered.
        let off = drawn.values.iter().zip(&expected.values);
        let differing = off.filter(|(a, b)| (**a - **b).abs() > 1e-4).count();
        assert!(
            differing * 1000 < drawn.values.len(),
            "{differing} pixels differ"
        );
    }

    /// The golden file's input, converted from channels first to channels last.
    fn picture(golden: &Golden) -> Picture {
        let input = golden.values("input");
        let mut picture = Picture::zeros(128, 128, 4);
        for (i, value) in picture.values.iter_mut().enumerate() {
            *value = input[(i % 4) * 128 * 128 + i / 4];
        }
        picture
    }

    #[test]
    fn a_peak_between_pixels_is_found_between_them() {
        let mut map = vec![-20.0; HEAT * HEAT];
        map[10 * HEAT + 20] = 0.0;
        map[10 * HEAT + 21] = 0.0;
        let ([x, y], confidence) = peak(&map);
        assert!((x * 64.0 - 21.0).abs() < 1e-3 && (y * 64.0 - 10.5).abs() < 1e-3);
        assert!(confidence > 0.999);
    }
}
