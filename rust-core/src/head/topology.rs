//! A head of clean quads: MakeHuman's topology on ICT's mean face. Its shape follows the
//! coefficients of the field's identities, and traits of its own.
//!
//! Twin of `training/head/topology.py`.

use std::{ops::Range, path::Path};

use ndarray::{Array2, ArrayView1, aview1};
use serde::Deserialize;

use super::{COEFFICIENTS, MadeHead, check};
use crate::{
    Error, Result,
    mesh::{Landmarks, Mesh, ibug::LANDMARKS},
    models::{BuiltIn, Weights},
};

/// Built-in weights.
#[cfg(feature = "facetalk")]
pub static TOPOLOGY_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_facetalk::HEAD_TOPOLOGY);
/// Not in this build: a folder may provide the weights.
#[cfg(not(feature = "facetalk"))]
pub static TOPOLOGY_MODEL: BuiltIn = BuiltIn::absent("head_topology", None);

/// The most vertices, faces or numbers that a file may ask for.
const MOST: usize = 1 << 20;

#[derive(Deserialize)]
struct Config {
    step_m: f32,
    skin_vertices: usize,
    skin_faces: usize,
    traits: Vec<String>,
    materials: Vec<String>,
    parts: Vec<PartConfig>,
}

#[derive(Deserialize)]
struct PartConfig {
    name: String,
    vertices: usize,
    faces: usize,
}

impl Config {
    /// Names of the skin and the parts, each with its vertices.
    fn objects(&self) -> Vec<(String, Range<usize>)> {
        let mut end = self.skin_vertices;
        let mut objects = vec![("skin".to_owned(), 0..end)];
        for part in &self.parts {
            let first = end;
            end = first.saturating_add(part.vertices);
            objects.push((part.name.clone(), first..end));
        }
        objects
    }

    /// K: one number for each coefficient, then two for each trait, its amounts to the right and
    /// left.
    fn numbers(&self) -> usize {
        COEFFICIENTS + 2 * self.traits.len()
    }
}

/// What a part follows.
enum Leader {
    /// The skin: for each vertex, the corners of a triangle and their shares.
    Skin(Vec<[u32; 3]>, Vec<[f32; 3]>),
    /// The numbers of the head: a shift, and growth about the part's middle, `[K, 4]`.
    Numbers(Array2<f32>),
}

struct Part {
    vertices: Range<usize>,
    leader: Leader,
}

/// The quad mesh and the data that moves it.
pub struct Topology {
    step_m: f32,
    traits: Vec<String>,
    /// `[V]` metres, the mean head.
    positions: Vec<[f32; 3]>,
    /// `[K, 3 S]` in steps, all x first. K is one number for each coefficient, then two for each
    /// trait (right and left).
    ///
    /// Each value is what a vertex adds to the mean of its `earlier` neighbours. This packs smaller
    /// than its displacement.
    modes: Array2<f32>,
    /// For each vertex of the skin, its neighbours with lower numbers, `[S]`.
    earlier: Vec<Vec<u32>>,
    /// `[F]`; a triangle repeats its last corner.
    faces: Vec<[u32; 4]>,
    /// Texture coordinates at the corners of the skin's faces.
    uv: Vec<[[f32; 2]; 4]>,
    objects: Vec<(String, Range<usize>)>,
    /// Names of materials, each with a range of faces.
    materials: Vec<(String, Range<usize>)>,
    material_names: Vec<String>,
    /// The material of each face, `[F]`.
    face_materials: Vec<u32>,
    skin_faces: usize,
    landmarks: [u32; LANDMARKS],
    parts: Vec<Part>,
}

impl Topology {
    /// Opens the built-in topology, or the one in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = TOPOLOGY_MODEL.open(folder)?;
        let config: Config = serde_json::from_str(&files.config)
            .map_err(|error| Error::Weights(format!("head_topology/config.json: {error}")))?;
        Topology::new(&config, &Weights::from_bytes(&files.weights)?)
    }

    fn new(config: &Config, weights: &Weights) -> Result<Self> {
        let objects = config.objects();
        let vertices = objects[objects.len() - 1].1.end;
        let part_faces = config.parts.iter().map(|part| part.faces);
        let faces = part_faces.fold(config.skin_faces, usize::saturating_add);
        let numbers = config.numbers();
        let largest = vertices.max(faces).max(numbers);
        if largest > MOST || config.skin_vertices == 0 {
            return Err(Error::Weights(format!(
                "head_topology: expected a skin, and at most {MOST} vertices, faces and numbers, got {largest}"
            )));
        }
        let skin = config.skin_vertices;
        let parts = objects[1..].iter();
        let parts = parts.map(|(name, rows)| Part::load(&weights.pp(name), config, rows));
        let parts: Result<Vec<Part>> = parts.collect();
        let marks: Vec<[u32; 1]> = indices(
            &weights.values("landmarks", &[LANDMARKS])?,
            skin,
            "landmarks",
        )?;
        let kinds = weights.values("materials", &[faces])?;
        let kinds: Vec<[u32; 1]> = indices(&kinds, config.materials.len(), "materials")?;
        let face_materials = kinds.into_iter().flatten().collect::<Vec<u32>>();
        let faces = indices(&weights.values("faces", &[faces, 4])?, vertices, "faces")?;
        Ok(Topology {
            step_m: config.step_m,
            traits: config.traits.clone(),
            positions: rows_of(&weights.values("positions", &[vertices, 3])?),
            modes: {
                let values = weights.values("modes", &[numbers, 3, skin])?;
                Array2::from_shape_vec((numbers, 3 * skin), values)
                    .map_err(|error| Error::Weights(format!("modes: {error}")))?
            },
            earlier: earlier_neighbours(&faces[..config.skin_faces], skin)?,
            faces,
            uv: {
                let flat = weights.values("uv", &[config.skin_faces, 4, 2])?;
                let corners: Vec<[f32; 2]> = rows_of(&flat);
                corners.as_chunks::<4>().0.to_vec()
            },
            materials: runs(&face_materials, config),
            material_names: config.materials.clone(),
            face_materials,
            objects,
            skin_faces: config.skin_faces,
            landmarks: std::array::from_fn(|n| marks[n][0]),
            parts: parts?,
        })
    }

    /// Names of the traits, the sliders beside the coefficients, `[T]`: age, sex, weight …
    pub fn traits(&self) -> &[String] {
        &self.traits
    }

    /// All faces `[F]`, the skin's first. A triangle repeats its last corner.
    pub fn faces(&self) -> &[[u32; 4]] {
        &self.faces
    }

    /// Texture coordinates at the corners of each of the skin's faces.
    pub fn uv(&self) -> &[[[f32; 2]; 4]] {
        &self.uv
    }

    /// The material of each face, `[F]`.
    pub fn face_materials(&self) -> &[u32] {
        &self.face_materials
    }

    /// Names of the materials.
    pub fn materials(&self) -> impl Iterator<Item = &str> {
        self.material_names.iter().map(String::as_str)
    }

    /// Displacements of the skin under `numbers` `[K]`: `[S]`, metres.
    fn displacements(&self, numbers: ArrayView1<'_, f32>) -> Vec<[f32; 3]> {
        let added = numbers.dot(&self.modes) * self.step_m;
        let skin = self.earlier.len();
        let mut moved: Vec<[f32; 3]> = Vec::with_capacity(skin);
        for (vertex, earlier) in self.earlier.iter().enumerate() {
            let share = 1.0 / earlier.len().max(1) as f32;
            moved.push(std::array::from_fn(|axis| {
                let sum: f32 = earlier
                    .iter()
                    .map(|&other| moved[other as usize][axis])
                    .sum();
                added[axis * skin + vertex] + share * sum
            }));
        }
        moved
    }

    /// The mesh at rest for `numbers` `[100 + T]`: coefficients, then traits.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite.
    pub fn mesh(&self, numbers: &[f32], parts: bool) -> Result<MadeHead> {
        check(
            "numbers of a head",
            numbers,
            COEFFICIENTS + self.traits.len(),
        )?;
        let (coefficients, traits) = numbers.split_at(COEFFICIENTS);
        let sides = traits.iter().flat_map(|t| [t.max(0.0), (-t).max(0.0)]);
        let numbers: Vec<f32> = coefficients.iter().copied().chain(sides).collect();
        let numbers = aview1(&numbers);
        let moved = self.displacements(numbers);
        let mut positions = self.positions.clone();
        for (place, by) in positions.iter_mut().zip(&moved) {
            *place = std::array::from_fn(|axis| place[axis] + by[axis]);
        }
        for part in &self.parts {
            part.follow(&mut positions[part.vertices.clone()], &moved, numbers);
        }
        let (vertices, faces) = if parts {
            (positions.len(), self.faces.len())
        } else {
            (moved.len(), self.skin_faces)
        };
        positions.truncate(vertices);
        let faces = self.faces[..faces].to_vec();
        Ok(MadeHead {
            landmarks: Landmarks {
                positions: self.landmarks.map(|v| positions[v as usize]),
                vertices: self.landmarks,
                confidence: [1.0; LANDMARKS],
            },
            canonical: Vec::new(),
            objects: within(&self.objects, vertices),
            materials: within(&self.materials, faces.len()),
            uv: self.uv.clone(),
            mesh: Mesh {
                positions,
                triangles: faces.iter().flat_map(triangles_of).collect(),
            },
            faces,
        })
    }
}

impl Part {
    /// Loads the part that has these vertices.
    fn load(weights: &Weights, config: &Config, vertices: &Range<usize>) -> Result<Part> {
        let (count, skin) = (vertices.len(), config.skin_vertices);
        let leader = if weights.contains("moves") {
            Leader::Numbers(weights.matrix("moves", config.numbers(), 4)?)
        } else {
            Leader::Skin(
                indices(&weights.values("corners", &[count, 3])?, skin, "corners")?,
                rows_of(&weights.values("shares", &[count, 3])?),
            )
        };
        Ok(Part {
            vertices: vertices.clone(),
            leader,
        })
    }

    fn follow(&self, positions: &mut [[f32; 3]], skin: &[[f32; 3]], numbers: ArrayView1<'_, f32>) {
        match &self.leader {
            Leader::Skin(corners, shares) => {
                for ((place, corners), shares) in positions.iter_mut().zip(corners).zip(shares) {
                    for (corner, share) in corners.iter().zip(shares) {
                        let by = skin[*corner as usize];
                        *place = std::array::from_fn(|axis| place[axis] + share * by[axis]);
                    }
                }
            }
            Leader::Numbers(moves) => {
                let moves = numbers.dot(moves);
                let count = positions.len().max(1) as f32;
                let middle: [f32; 3] = std::array::from_fn(|axis| {
                    positions.iter().map(|p| p[axis]).sum::<f32>() / count
                });
                for place in positions {
                    *place = std::array::from_fn(|axis| {
                        let away = place[axis] - middle[axis];
                        middle[axis] + (1.0 + moves[3]) * away + moves[axis]
                    });
                }
            }
        }
    }
}

/// For each of `count` vertices, its neighbours with lower numbers along the edges of `faces`.
fn earlier_neighbours(faces: &[[u32; 4]], count: usize) -> Result<Vec<Vec<u32>>> {
    let mut earlier = vec![Vec::new(); count];
    for face in faces {
        for (corner, &a) in face.iter().enumerate() {
            let b = face[(corner + 1) % face.len()];
            let of_larger = earlier.get_mut(a.max(b) as usize).ok_or_else(|| {
                Error::Weights(format!(
                    "head_topology: faces: expected vertices of the skin, below {count}, got {}",
                    a.max(b)
                ))
            })?;
            if a != b && !of_larger.contains(&a.min(b)) {
                of_larger.push(a.min(b));
            }
        }
    }
    earlier.iter_mut().for_each(|others| others.sort_unstable());
    Ok(earlier)
}

/// The one or two triangles of a face.
fn triangles_of(face: &[u32; 4]) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [a, b, c, d] = *face;
    let second = (c != d).then_some([a, c, d]);
    std::iter::once([a, b, c]).chain(second)
}

fn within(ranges: &[(String, Range<usize>)], end: usize) -> Vec<(String, Range<usize>)> {
    let inner = ranges.iter().filter(|(_, range)| range.end <= end);
    inner.cloned().collect()
}

fn rows_of<const N: usize>(values: &[f32]) -> Vec<[f32; N]> {
    values.as_chunks::<N>().0.to_vec()
}

/// Turns values into rows of whole numbers below `count`.
fn indices<const N: usize>(values: &[f32], count: usize, what: &str) -> Result<Vec<[u32; N]>> {
    let wrong = |x: &&f32| !(0.0..count as f32).contains(*x) || x.fract() != 0.0;
    if let Some(value) = values.iter().find(wrong) {
        return Err(Error::Weights(format!(
            "head_topology: {what}: expected whole numbers below {count}, got {value}"
        )));
    }
    let rows: Vec<[f32; N]> = rows_of(values);
    Ok(rows.into_iter().map(|row| row.map(|x| x as u32)).collect())
}

/// Ranges of consecutive faces with the same material and object.
fn runs(kinds: &[u32], config: &Config) -> Vec<(String, Range<usize>)> {
    let mut ends = vec![config.skin_faces];
    for part in &config.parts {
        ends.push(ends[ends.len() - 1] + part.faces);
    }
    let mut ranges: Vec<(String, Range<usize>)> = Vec::new();
    let mut last = None;
    for (face, kind) in kinds.iter().enumerate() {
        let object = ends.partition_point(|end| *end <= face);
        match ranges.last_mut() {
            Some((_, range)) if last == Some((object, *kind)) => range.end = face + 1,
            _ => ranges.push((config.materials[*kind as usize].clone(), face..face + 1)),
        }
        last = Some((object, *kind));
    }
    ranges
}
