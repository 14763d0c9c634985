//! The network that finds faces in any pose on a depth picture; `training/landmarks/pose_network.py`
//! is the twin, layer by layer.
//!
//! A small U-Net over the 128² pictures of `depth_view`. Each of 16² cells says whether the centre
//! of a face lies in it, where exactly it lies, how large the face is and how it is turned.

use glam::Vec3;

use super::network::Block;
use crate::{
    Result,
    mesh::direction::unit,
    models::Weights,
    nn::{
        conv2d::{Conv2d, Picture},
        elementwise::sigmoid,
    },
};

const OUTPUTS: usize = 10;
/// Faces this close to a more likely one are the same face, as a share of the picture.
const SAME_FACE: f32 = 0.1;

/// A face in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    /// Probability of a face.
    pub presence: f32,
    /// Its centre: (column, row) from 0 to 1 over the picture.
    pub place: [f32; 2],
    /// Half-size of a tight window around it, as a share of the half-size of the picture's window.
    pub size: f32,
    /// The face's axes in the view, row by row.
    pub rotation: [[f64; 3]; 3],
}

/// `PoseNetwork` of the twin, with its normalisations folded into the convolutions.
pub(super) struct PoseNetwork {
    stem: Conv2d,
    down32: Conv2d,
    block32: Block,
    down16: Conv2d,
    block16: Block,
    down8: Conv2d,
    block8: Block,
    down4: Conv2d,
    block4: Block,
    up8: Conv2d,
    join8: Block,
    up16: Conv2d,
    join16: Block,
    out: Conv2d,
}

impl PoseNetwork {
    /// `widths`: channels at 64², 32², 16², 8² and 4².
    ///
    /// # Errors
    /// `Weights` if an array is missing or does not fit the widths.
    pub fn load(weights: &Weights, widths: [usize; 5]) -> Result<Self> {
        let [a, b, c, d, e] = widths;
        let conv =
            |name: &str, shape, stride| Conv2d::load(&weights.pp(name).pp("conv"), shape, stride);
        let block = |name: &str, width| Block::load(&weights.pp(name), width);
        Ok(PoseNetwork {
            stem: conv("stem", [a, 4, 3], 2)?,
            down32: conv("down32", [b, a, 3], 2)?,
            block32: block("block32", b)?,
            down16: conv("down16", [c, b, 3], 2)?,
            block16: block("block16", c)?,
            down8: conv("down8", [d, c, 3], 2)?,
            block8: block("block8", d)?,
            down4: conv("down4", [e, d, 3], 2)?,
            block4: block("block4", e)?,
            up8: conv("up8", [d, e, 1], 1)?,
            join8: block("join8", d)?,
            up16: conv("up16", [c, d, 1], 1)?,
            join16: block("join16", c)?,
            out: Conv2d::load(&weights.pp("out"), [OUTPUTS, c, 1], 1)?,
        })
    }

    /// `[16, 16, 10]`: face logit, place in the cell, log size, x and z axes, all raw.
    fn forward(&self, picture: &Picture) -> Picture {
        let x = self.down32.forward(&self.stem.forward(picture).relu());
        let x = self.block32.forward(&x.relu());
        let x16 = self.block16.forward(&self.down16.forward(&x).relu());
        let x8 = self.block8.forward(&self.down8.forward(&x16).relu());
        let x4 = self.block4.forward(&self.down4.forward(&x8).relu());
        let up = self.up8.forward(&x4).doubled().plus(&x8).relu();
        let up = self.up16.forward(&self.join8.forward(&up));
        self.out
            .forward(&self.join16.forward(&up.doubled().plus(&x16).relu()))
    }

    /// The `most` likeliest faces in a picture `[128, 128, 4]`, best first. There is always one.
    pub fn see(&self, picture: &Picture, most: usize) -> Vec<Sighting> {
        let out = self.forward(picture);
        let mut cells: Vec<Sighting> = out
            .values
            .chunks_exact(OUTPUTS)
            .enumerate()
            .map(|(cell, values)| sighting(values, cell % out.width, cell / out.width, out.width))
            .collect();
        cells.sort_by(|a, b| b.presence.total_cmp(&a.presence));
        let mut best: Vec<Sighting> = Vec::new();
        for cell in cells {
            let apart = |k: &Sighting| {
                let d = [cell.place[0] - k.place[0], cell.place[1] - k.place[1]];
                d[0].hypot(d[1]) > SAME_FACE
            };
            if best.len() < most && best.iter().all(apart) {
                best.push(cell);
            }
        }
        best
    }
}

fn sighting(values: &[f32], column: usize, row: usize, cells: usize) -> Sighting {
    let place = |at: usize, off: f32| (at as f32 + 0.5 + off) / cells as f32;
    let axis = |from: usize| Vec3::from_slice(&values[from..]).as_dvec3();
    let z = unit(axis(7));
    let raw = unit(axis(4));
    let x = unit(raw - raw.dot(z) * z);
    Sighting {
        presence: sigmoid(values[0]),
        place: [place(column, values[1]), place(row, values[2])],
        size: values[3].clamp(-4.0, 2.0).exp(),
        rotation: [x, z.cross(x), z].map(Into::into),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    /// Written by `python -m training.goldens pose`.
    #[test]
    fn network_matches_its_twin() {
        let golden = Golden::open("pose_debug");
        let widths = serde_json::from_str(&golden.metadata("widths")).unwrap();
        let network = PoseNetwork::load(&golden.weights(), widths).unwrap();
        let input = golden.values("input");
        let mut picture = Picture::zeros(128, 128, 4);
        for (i, value) in picture.values.iter_mut().enumerate() {
            *value = input[(i % 4) * 128 * 128 + i / 4];
        }
        let out = network.forward(&picture);
        assert!(distance(&out.values, &golden.values("out")) < 1e-4);
        let best = network.see(&picture, 1)[0];
        let rotation: Vec<f32> = best.rotation.iter().flatten().map(|x| *x as f32).collect();
        assert!(distance(&rotation, &golden.values("rotation")) < 1e-3);
        assert!(distance(&best.place, &golden.values("place")) < 1e-4);
    }

    #[test]
    fn a_sighting_has_a_proper_rotation_whatever_the_network_says() {
        let face = sighting(
            &[0.0, 0.2, -0.3, 9.0, 1.0, 2.0, 3.0, -2.0, 0.5, 4.0],
            3,
            5,
            16,
        );
        let [x, y, z] = face.rotation.map(glam::DVec3::from);
        assert!(x.dot(z).abs() < 1e-12 && x.dot(y).abs() < 1e-12);
        assert!((x.cross(y).dot(z) - 1.0).abs() < 1e-12);
        assert!((face.place[0] - 3.7 / 16.0).abs() < 1e-6);
    }
}
