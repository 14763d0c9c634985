//! A small renderer with shading and a z-buffer, good enough to look at faces.

/// Samples along each side of a pixel.
const FINE: usize = 2;
/// Directions towards the lights, and their strengths. `AMBIENT` light comes from all directions.
const LIGHTS: [([f32; 3], f32); 2] = [([-0.42, 0.46, 0.78], 0.62), ([0.74, 0.05, 0.67], 0.16)];
const AMBIENT: f32 = 0.26;

/// Colours from 0 to 1, row by row.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub width: usize,
    pub height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Picture {
    pub(crate) fn white(width: usize, height: usize) -> Self {
        Picture {
            width,
            height,
            pixels: vec![[1.0; 3]; width * height],
        }
    }

    /// Blends a pixel towards dark grey by `share`. Does nothing outside the picture.
    pub(crate) fn darken(&mut self, x: usize, y: usize, share: f32) {
        if x < self.width && y < self.height {
            let pixel = &mut self.pixels[y * self.width + x];
            *pixel = pixel.map(|c| c + (0.1 - c) * share);
        }
    }

    /// Copies `other` into the picture with its upper left corner at (`left`, `top`).
    pub(crate) fn place(&mut self, other: &Picture, left: usize, top: usize) {
        for y in 0..other.height.min(self.height.saturating_sub(top)) {
            for x in 0..other.width.min(self.width.saturating_sub(left)) {
                self.pixels[(top + y) * self.width + left + x] = other.pixels[y * other.width + x];
            }
        }
    }

    /// Red, green and blue of each pixel.
    pub(crate) fn bytes(&self) -> Vec<[u8; 3]> {
        let byte = |c: f32| (255.0 * c.clamp(0.0, 1.0) + 0.5) as u8;
        self.pixels.iter().map(|pixel| pixel.map(byte)).collect()
    }
}

/// What to draw.
pub(crate) struct Scene<'a> {
    /// `[V]`, view space: +x to the picture's right, +y up, +z to the viewer.
    pub points: &'a [[f32; 3]],
    /// `[V]`, unit normals in view space.
    pub normals: &'a [[f32; 3]],
    pub triangles: &'a [[u32; 3]],
    /// `[F]`, linear red, green and blue.
    pub colours: &'a [[f32; 3]],
    /// View x and y of the picture's middle.
    pub centre: [f32; 2],
    /// Half of the picture's height in the scene's unit.
    pub half_height: f32,
}

impl Scene<'_> {
    /// Draws the scene on white, without perspective.
    pub(crate) fn draw(&self, width: usize, height: usize) -> Picture {
        let mut fine = Canvas {
            picture: Picture::white(FINE * width, FINE * height),
            depth: vec![f32::NEG_INFINITY; FINE * width * FINE * height],
        };
        let scale = 0.5 * (FINE * height) as f32 / self.half_height;
        let middle = [0.5 * (FINE * width) as f32, 0.5 * (FINE * height) as f32];
        let screen = |p: [f32; 3]| {
            [
                middle[0] + (p[0] - self.centre[0]) * scale,
                middle[1] - (p[1] - self.centre[1]) * scale,
                p[2],
            ]
        };
        for (corners, colour) in self.triangles.iter().zip(self.colours) {
            let at = corners.map(|v| screen(self.points[v as usize]));
            let light = corners.map(|v| brightness(self.normals[v as usize]));
            fine.triangle(at, light, *colour);
        }
        shrunk(&fine.picture)
    }
}

/// Brightness of a surface, the same for both of its sides.
fn brightness(normal: [f32; 3]) -> f32 {
    let side = if normal[2] < 0.0 { -1.0 } else { 1.0 };
    let lit = LIGHTS.iter().map(|(towards, strength)| {
        let cosine: f32 = (0..3).map(|i| side * normal[i] * towards[i]).sum();
        strength * cosine.max(0.0)
    });
    AMBIENT + lit.sum::<f32>()
}

struct Canvas {
    picture: Picture,
    depth: Vec<f32>,
}

impl Canvas {
    /// `at`: column, row and z of the corners; `light`: brightness at the corners.
    fn triangle(&mut self, [a, b, c]: [[f32; 3]; 3], light: [f32; 3], colour: [f32; 3]) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-9 {
            return;
        }
        let low = |i: usize| a[i].min(b[i]).min(c[i]).floor().max(0.0) as usize;
        let high =
            |i: usize, most: usize| (a[i].max(b[i]).max(c[i]).max(0.0) as usize + 1).min(most);
        for row in low(1)..high(1, self.picture.height) {
            let y = row as f32 + 0.5;
            for column in low(0)..high(0, self.picture.width) {
                let x = column as f32 + 0.5;
                let wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
                let wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
                let wc = 1.0 - wa - wb;
                let z = wa * a[2] + wb * b[2] + wc * c[2];
                let here = row * self.picture.width + column;
                if wa >= -1e-4 && wb >= -1e-4 && wc >= -1e-4 && z > self.depth[here] {
                    self.depth[here] = z;
                    let shade = wa * light[0] + wb * light[1] + wc * light[2];
                    self.picture.pixels[here] = colour.map(|c| (c * shade).powf(1.0 / 2.2));
                }
            }
        }
    }
}

/// Averages the samples of every pixel.
fn shrunk(fine: &Picture) -> Picture {
    let mut out = Picture::white(fine.width / FINE, fine.height / FINE);
    for y in 0..out.height {
        for x in 0..out.width {
            let block = (0..FINE * FINE).map(|k| (FINE * y + k / FINE, FINE * x + k % FINE));
            let mut sum = [0.0; 3];
            for (row, column) in block {
                let pixel = fine.pixels[row * fine.width + column];
                (0..3).for_each(|i| sum[i] += pixel[i] / (FINE * FINE) as f32);
            }
            out.pixels[y * out.width + x] = sum;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_triangle_hides_the_other_and_white_stays() {
        let points = [
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [1.0, 1.0, 0.0],
            [-1.0, -1.0, 0.5],
            [0.0, -1.0, 0.5],
            [0.0, 0.0, 0.5],
        ];
        let scene = Scene {
            points: &points,
            normals: &[[0.0, 0.0, 1.0]; 6],
            triangles: &[[3, 4, 5], [0, 1, 2]],
            colours: &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            centre: [0.0, 0.0],
            half_height: 1.0,
        };
        let pixels = scene.draw(20, 20).bytes();
        let at = |x: usize, y: usize| pixels[y * 20 + x];
        assert_eq!(at(2, 2), [255, 255, 255]);
        assert!(at(8, 18)[0] > 200 && at(8, 18)[1] == 0);
        assert!(at(18, 10)[1] > 200 && at(18, 10)[0] == 0);
    }

    #[test]
    fn both_sides_of_a_surface_are_lit() {
        assert_eq!(brightness([0.0, 0.0, 1.0]), brightness([0.0, 0.0, -1.0]));
        assert!(brightness([0.0, 0.0, 1.0]) > brightness([0.0, -1.0, 0.0]));
    }
}
