//! Small pictures of a face, drawn without a graphics card: triangles with a depth buffer, in the
//! way of the extension's `core/picture.py`.

use anyface::{Face, Result, face::Rig, mesh::PartRole};
use base64::{Engine as _, engine::general_purpose::STANDARD};

/// Pixels along a side of the picture, and samples along a side of each pixel.
const SIDE: usize = 80;
const SAMPLES: usize = 2;
const FINE: usize = SIDE * SAMPLES;
const SKIN: [f32; 3] = [0.87, 0.69, 0.60];
const TEETH: [f32; 3] = [0.93, 0.92, 0.88];
/// Where each light comes from (+x to the subject's left, +y up, +z to the viewer), and how bright
/// it is.
const LIGHTS: [([f32; 3], f32); 2] = [([-0.45, 0.55, 0.70], 0.72), ([0.8, -0.1, 0.6], 0.22)];
const AMBIENT: f32 = 0.16;
/// Brightness of surfaces seen from behind, such as the inside of a mouth.
const BACK: f32 = 0.12;
/// Half the side of the picture, as a share of the extent of the landmarks.
const MARGIN: f32 = 0.65;

/// A face that is drawn several times with different weights.
pub struct Portrait<'a> {
    face: &'a Face,
    rig: &'a Rig,
    colours: Vec<[f32; 3]>,
    centre: [f32; 2],
    half: f32,
}

impl<'a> Portrait<'a> {
    pub fn new(face: &'a Face, rig: &'a Rig) -> Portrait<'a> {
        let is_tooth = |v: usize| {
            let white = [PartRole::Jaw, PartRole::Skull, PartRole::Gaze];
            white.into_iter().any(|role| face.parts.is(v, role))
        };
        let colour = |v| if is_tooth(v) { TEETH } else { SKIN };
        let colours = (0..face.mesh.positions.len()).map(colour).collect();
        let marks = face.landmarks.positions.map(|p| face.to_canonical.apply(p));
        let bounds = |axis: usize| {
            let values = marks.iter().map(|p| p[axis]);
            let low = values.clone().fold(f32::INFINITY, f32::min);
            (low, values.fold(f32::NEG_INFINITY, f32::max))
        };
        let (x, y) = (bounds(0), bounds(1));
        Portrait {
            face,
            rig,
            colours,
            centre: [0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1)],
            half: MARGIN * (x.1 - x.0).max(y.1 - y.0),
        }
    }

    /// Draws the face with these weights of its shapes, given by name. Returns a PNG as a data URI.
    ///
    /// # Errors
    /// `InvalidInput` if the picture cannot be encoded.
    pub fn draw(&self, weights: &[(String, f32)]) -> Result<String> {
        let points = self.points(weights);
        let pixels = self.pixels(&points);
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, SIDE as u32, SIDE as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let written = encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&pixels));
        written.map_err(|error| anyface::Error::InvalidInput(format!("picture: {error}")))?;
        Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
    }

    /// Vertices of the moved face: x and y in samples from the upper left corner, z towards the
    /// viewer.
    fn points(&self, weights: &[(String, f32)]) -> Vec<[f32; 3]> {
        let mut points = self.face.mesh.positions.clone();
        for (name, weight) in weights.iter().filter(|(_, weight)| *weight != 0.0) {
            let Some(shape) = self.rig.names.iter().position(|known| known == name) else {
                continue;
            };
            let shape = self.rig.deltas.index_axis(ndarray::Axis(0), shape);
            for (point, moved) in points.iter_mut().zip(shape.rows()) {
                (0..3).for_each(|i| point[i] += weight * moved[i]);
            }
        }
        let scale = 0.5 * FINE as f32 / self.half;
        let flat = |p: [f32; 3]| {
            let p = self.face.to_canonical.apply(p);
            let [x, y] = [p[0] - self.centre[0], p[1] - self.centre[1]];
            let middle = 0.5 * FINE as f32;
            [middle + scale * x, middle - scale * y, scale * p[2]]
        };
        points.into_iter().map(flat).collect()
    }

    fn pixels(&self, points: &[[f32; 3]]) -> Vec<u8> {
        let triangles = &self.face.mesh.triangles;
        let normals = normals(points, triangles);
        let mut depth = vec![f32::NEG_INFINITY; FINE * FINE];
        let mut fine = vec![[0.0f32; 4]; FINE * FINE];
        for corners in triangles {
            let [a, b, c] = corners.map(|v| points[v as usize]);
            // Here y points down.
            let is_front = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0;
            each_sample([a, b, c], |at, shares, z| {
                if z <= depth[at] {
                    return;
                }
                depth[at] = z;
                let mix = |of: &[[f32; 3]]| -> [f32; 3] {
                    std::array::from_fn(|i| {
                        (0..3).map(|k| shares[k] * of[corners[k] as usize][i]).sum()
                    })
                };
                let bright = if is_front { light(mix(&normals)) } else { BACK };
                let [r, g, b] = mix(&self.colours).map(|x| x * bright);
                fine[at] = [r, g, b, 1.0];
            });
        }
        coarse(&fine)
    }
}

/// Averages the samples of each pixel. Pixels at the edge take their colour only from samples that
/// hit the face.
fn coarse(fine: &[[f32; 4]]) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(4 * SIDE * SIDE);
    for at in 0..SIDE * SIDE {
        let (row, column) = (SAMPLES * (at / SIDE), SAMPLES * (at % SIDE));
        let mut sum = [0.0f32; 4];
        for sample in 0..SAMPLES * SAMPLES {
            let at = (row + sample / SAMPLES) * FINE + column + sample % SAMPLES;
            (0..4).for_each(|i| sum[i] += fine[at][i]);
        }
        let covered = sum[3].max(1e-6);
        let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8;
        pixels.extend([0, 1, 2].map(|i| byte(sum[i] / covered)));
        pixels.push(byte(sum[3] / (SAMPLES * SAMPLES) as f32));
    }
    pixels
}

/// Calls `paint` for each sample that a triangle covers, with the sample's index, the weights of
/// the three corners there, and its depth.
fn each_sample([a, b, c]: [[f32; 3]; 3], mut paint: impl FnMut(usize, [f32; 3], f32)) {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if !area.is_normal() {
        return;
    }
    let range = |axis: usize| {
        let low = a[axis].min(b[axis]).min(c[axis]).max(0.0).ceil();
        let high = a[axis].max(b[axis]).max(c[axis]).min(FINE as f32 - 1.0);
        (low as usize, high.floor())
    };
    let ((left, right), (top, bottom)) = (range(0), range(1));
    if right < 0.0 || bottom < 0.0 {
        return;
    }
    for row in top..=bottom as usize {
        for column in left..=right as usize {
            let (x, y) = (column as f32 - a[0], row as f32 - a[1]);
            let second = (x * (c[1] - a[1]) - y * (c[0] - a[0])) / area;
            let third = (y * (b[0] - a[0]) - x * (b[1] - a[1])) / area;
            let shares = [1.0 - second - third, second, third];
            if shares.iter().all(|share| *share >= -1e-5) {
                let z = shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2];
                paint(row * FINE + column, shares, z);
            }
        }
    }
}

/// Normals of the vertices, with y up. They are not of unit length.
fn normals(points: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut normals = vec![[0.0f32; 3]; points.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| {
            let [x, y, z] = points[v as usize];
            [x, -y, z]
        });
        let [u, v] = [b, c].map(|p| std::array::from_fn::<f32, 3, _>(|i| p[i] - a[i]));
        let normal: [f32; 3] = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            u[j] * v[k] - u[k] * v[j]
        });
        for v in corners {
            (0..3).for_each(|i| normals[*v as usize][i] += normal[i]);
        }
    }
    normals
}

fn light(normal: [f32; 3]) -> f32 {
    let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-12);
    let lit = LIGHTS.iter().map(|(from, bright)| {
        let along: f32 = (0..3).map(|i| normal[i] * from[i]).sum();
        bright * (along / length).max(0.0)
    });
    AMBIENT + lit.sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_covers_its_own_half_of_a_square() {
        let side = 10.0;
        let mut covered = 0;
        let corners = [[0.0, 0.0, 0.0], [side, 0.0, 1.0], [0.0, side, 2.0]];
        each_sample(corners, |_, shares, z| {
            covered += 1;
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            assert!((z - shares[1] - 2.0 * shares[2]).abs() < 1e-5);
        });
        assert_eq!(covered, 66);
        each_sample(
            [[-9.0; 3], [-5.0, -9.0, 0.0], [-9.0, -5.0, 0.0]],
            |at, _, _| {
                panic!("{at} lies outside");
            },
        );
    }
}
