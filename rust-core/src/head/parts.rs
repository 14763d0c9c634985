//! Eyes, teeth and tongue of the default head, set into another one by its landmarks.

use std::{ops::Range, sync::LazyLock};

use anyface_weights_shared::{HEAD_LANDMARKS, HEAD_OBJ};

use crate::mesh::{LandmarkSource, ibug::LANDMARKS};

/// An object of the default head.
pub(super) struct Part {
    /// As in the file: `eye_left`, `teeth_upper` …
    pub name: String,
    /// Metres, of the default head.
    pub positions: Vec<[f32; 3]>,
    /// Numbers within the part.
    pub triangles: Vec<[u32; 3]>,
    /// Which of the triangles have which material.
    pub materials: Vec<(String, Range<usize>)>,
}

/// All but the skin, and the landmarks of the head that they belong to.
static PARTS: LazyLock<(Vec<Part>, Vec<[f32; 3]>)> = LazyLock::new(|| {
    let landmarks = match LandmarkSource::from_json(HEAD_LANDMARKS) {
        Ok(LandmarkSource::Known(known)) => known.iter().map(|mark| mark.position).collect(),
        _ => panic!("the embedded file is checked by a test"),
    };
    (read(HEAD_OBJ), landmarks)
});

fn read(text: &str) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let (mut first, mut count) = (1, 0);
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let kind = words.next().unwrap_or_default();
        match (kind, parts.last_mut()) {
            ("o", _) => {
                first = count + 1;
                parts.push(Part {
                    name: words.collect(),
                    positions: Vec::new(),
                    triangles: Vec::new(),
                    materials: Vec::new(),
                });
            }
            ("v", Some(part)) => {
                count += 1;
                part.positions.push(three(words, 0.0, |at: f32| at));
            }
            ("usemtl", Some(part)) => {
                let here = part.triangles.len();
                part.materials.push((words.collect(), here..here));
            }
            ("f", Some(part)) => {
                part.triangles.push(three(words, 0, |at: u32| at - first));
                if let Some((_, of_material)) = part.materials.last_mut() {
                    of_material.end += 1;
                }
            }
            _ => {}
        }
    }
    parts.retain(|part| part.name != "skin");
    parts
}

fn three<'a, T: std::str::FromStr + Copy>(
    words: impl Iterator<Item = &'a str>,
    none: T,
    then: impl Fn(T) -> T,
) -> [T; 3] {
    let mut out = [none; 3];
    for (to, word) in out.iter_mut().zip(words) {
        *to = then(
            word.parse()
                .unwrap_or_else(|_| panic!("the embedded file is checked by a test")),
        );
    }
    out
}

/// By which landmarks a part is placed.
fn landmarks_of(name: &str) -> &'static [usize] {
    match name {
        "eye_right" => &[36, 37, 38, 39, 40, 41],
        "eye_left" => &[42, 43, 44, 45, 46, 47],
        "teeth_upper" => &[31, 33, 35, 48, 50, 51, 52, 54],
        _ => &[48, 54, 56, 57, 58, 5, 8, 11],
    }
}

/// Every part, placed in a head whose landmarks at rest are `landmarks` `[68]`, metres.
pub(super) fn placed(
    landmarks: &[[f32; 3]; LANDMARKS],
) -> impl Iterator<Item = (&'static Part, Vec<[f32; 3]>)> {
    let (parts, own) = &*PARTS;
    let landmarks = *landmarks;
    parts.iter().map(move |part| {
        let numbers = landmarks_of(&part.name);
        let (from, from_size) = middle_and_size(own, numbers);
        let (to, to_size) = middle_and_size(&landmarks, numbers);
        let scale = to_size / from_size;
        let place =
            |p: &[f32; 3]| std::array::from_fn(|axis| to[axis] + scale * (p[axis] - from[axis]));
        (part, part.positions.iter().map(place).collect())
    })
}

/// Their mean and how far they lie from it, root mean square.
fn middle_and_size(landmarks: &[[f32; 3]], numbers: &[usize]) -> ([f32; 3], f32) {
    let count = numbers.len() as f32;
    let sum = |axis: usize| numbers.iter().map(|n| landmarks[*n][axis]).sum::<f32>();
    let middle: [f32; 3] = std::array::from_fn(|axis| sum(axis) / count);
    let squares = numbers
        .iter()
        .flat_map(|n| (0..3).map(|axis| (landmarks[*n][axis] - middle[axis]).powi(2)));
    (middle, (squares.sum::<f32>() / count).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_come_back_where_they_were() {
        let (parts, own) = &*PARTS;
        let names: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "eye_left",
                "eye_right",
                "teeth_upper",
                "teeth_lower",
                "tongue"
            ]
        );
        let own: [[f32; 3]; LANDMARKS] = own.as_slice().try_into().unwrap();
        for (part, placed) in placed(&own) {
            let vertices = part.positions.len() as u32;
            assert!(part.triangles.iter().flatten().all(|v| *v < vertices));
            let of_materials: usize = part.materials.iter().map(|(_, range)| range.len()).sum();
            assert_eq!(of_materials, part.triangles.len(), "{}", part.name);
            for (a, b) in part.positions.iter().zip(&placed) {
                assert!((0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-6));
            }
        }
        let grown = own.map(|p| p.map(|x| 2.0 * x + 1.0));
        for (part, placed) in self::placed(&grown) {
            let p = part.positions[5].map(|x| 2.0 * x + 1.0);
            assert!(
                (0..3).all(|axis| (p[axis] - placed[5][axis]).abs() < 1e-5),
                "{}",
                part.name
            );
        }
    }
}
