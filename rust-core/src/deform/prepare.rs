//! Prepares everything that spreads landmark motion over one face and does not depend on time.

use ndarray::Array2;

use super::{
    Corrected, Corrections, Creases, LandmarkWeights, Plate, PlateWeights, StaticWeights,
    VertexGeometry, correspondence::FollowingFace, row_weights::RowWeights,
    static_weights::Correction,
};
use crate::{
    Result,
    cache::{Arrays, Cache, CacheKey},
    conditions::{Control, ControlStage, ControlValues},
    face::{Face, FaceSurface, Skin, proxy::Prolongation},
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
};

/// Increased whenever the training-free weights change.
const CACHE_VERSION: u32 = 2;
const COORDINATES: usize = 3 * LANDMARKS;

/// Strength of the learned part of [`static_deformer`].
pub static LEARNED: Control = Control {
    name: "learned",
    label: "Learned Detail",
    help: "Strength of the learned part of spreading motion over the mesh; 0 spreads it by geometry \
           alone.",
    unit: "",
    values: ControlValues::Real,
    low: 0.0,
    high: 1.0,
    default: 1.0,
    neutral: 1.0,
    stage: ControlStage::Face,
    is_animatable: false,
};

/// The default deformer of a face: weights over the landmarks, fixed for its mesh, with the
/// corrections of lips, lids and jaw. It takes and returns displacements in the mesh's own units
/// and axes. The result is kept in `cache`.
///
/// `learned`: strength of the learned part, from 0 (training-free) to 1 (as shipped).
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face, `Numerics` if the solve fails, `Cancelled`.
pub fn static_deformer(
    (weights, creases): (&StaticWeights, &Creases),
    face: &Face,
    learned: f32,
    cache: &Cache,
    progress: ProgressFn<'_>,
) -> Result<Corrected<LandmarkWeights>> {
    let solve = || {
        let solved = SolvedSkin::new(face, cache, progress)?;
        let strength = learned * solved.familiarity(weights);
        let correction = (strength > 0.0).then(|| solved.correction(weights, creases));
        let decoder = solved.weights(correction.as_ref(), strength);
        report(progress, "weights", 1.0)?;
        Ok(solved.corrected(decoder))
    };
    let key = face.cache_key().text("weights of rows").f32s(&[learned]);
    let encode = |corrected: &Corrected<LandmarkWeights>| {
        let mut arrays = weights_to_arrays(&corrected.decoder);
        arrays.insert_json("corrections", &corrected.corrections);
        arrays
    };
    let decode = |mut arrays: Arrays| {
        Some(Corrected {
            decoder: weights_from_arrays(&mut arrays, face.mesh.positions.len())?,
            corrections: arrays.take_json("corrections")?,
        })
    };
    cache.get_or_make(&key, decode, encode, solve)
}

/// A face with the training-free weights of its skin. Decoders of landmark motion build on it.
pub struct SolvedSkin<'a> {
    face: &'a Face,
    /// The skin, and what each vertex follows.
    pub surface: &'a FaceSurface,
    plate: PlateWeights,
}

impl<'a> SolvedSkin<'a> {
    /// Solves for the weights on the skin. The result is kept in `cache`.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face, `Numerics` if the solve fails, `Cancelled`.
    pub fn new(face: &'a Face, cache: &Cache, progress: ProgressFn<'_>) -> Result<SolvedSkin<'a>> {
        report(progress, "operators", 0.0)?;
        let surface = face.surface()?;
        report(progress, "weights", 0.0)?;
        let plate = cached_plate(&surface.skin, cache)?;
        report(progress, "weights", 0.7)?;
        Ok(SolvedSkin {
            face,
            surface,
            plate,
        })
    }

    /// The learned part of the weights on the skin, including the creases.
    fn correction(&self, weights: &StaticWeights, creases: &Creases) -> Correction {
        let (positions, landmarks) = self.surface.decimetres();
        let triangles = &self.surface.skin.operators.triangles;
        let creases = creases.of_kind(weights.kind(&landmarks));
        let carried = creases.carried_to(FollowingFace {
            positions: &positions,
            triangles,
            landmarks: &landmarks,
        });
        let learned = weights.correction(&VertexGeometry {
            positions: &positions,
            landmarks: &landmarks,
            plate: &self.plate,
        });
        learned.beside(&carried, creases.motion())
    }

    /// How well the learned part knows faces like this one, from the config's floor to 1.
    fn familiarity(&self, weights: &StaticWeights) -> f32 {
        weights.familiarity(&self.surface.decimetres().1)
    }

    /// Combines `decoder` with the corrections that each frame of this face needs.
    pub fn corrected<D>(&self, decoder: D) -> Corrected<D> {
        Corrected {
            decoder,
            corrections: Corrections::new(self.face, self.surface),
        }
    }

    /// Weights of every vertex, in the mesh's own axes. `strength`: of the learned part.
    pub fn weights(&self, correction: Option<&Correction>, strength: f32) -> LandmarkWeights {
        let surface = self.surface;
        let count = surface.skin.operators.rows();
        let mut rows = RowWeights::new(count, &self.plate, correction, strength);
        rows.turn(&self.face.to_canonical);
        let follows = (0..surface.follows.len()).map(|v| {
            let rows = surface.rows_followed(v);
            rows.map(|(row, share)| (row as u32, share)).collect()
        });
        rows.spread(Prolongation::from_rows(follows))
    }
}

/// Reads the plate's weights from the cache, or solves for them and writes them to the cache.
fn cached_plate(skin: &Skin, cache: &Cache) -> Result<PlateWeights> {
    let operators = &skin.operators;
    let plate = Plate::default();
    let key = CacheKey::new("plate weights", CACHE_VERSION)
        .f64s(
            operators
                .positions
                .iter()
                .flat_map(AsRef::<[f64; 3]>::as_ref),
        )
        .u32s(operators.triangles.iter().flatten())
        .u32s(&skin.landmark_rows)
        .f64s(&[plate.tension, plate.screen, plate.spring]);
    let rows = operators.rows();
    let encode = |solved: &PlateWeights| {
        let mut arrays = Arrays::default();
        arrays.insert_f32("weights", &[rows, LANDMARKS], solved.weights.clone());
        arrays.insert_f64("remoteness", &[rows], solved.remoteness.clone());
        arrays
    };
    let decode = |mut arrays: Arrays| {
        let (shape, weights) = arrays.take_f32("weights")?;
        let (_, remoteness) = arrays.take_f64("remoteness")?;
        let fits = shape == [rows, LANDMARKS] && remoteness.len() == rows;
        fits.then_some(PlateWeights {
            weights,
            remoteness,
        })
    };
    let solve = || PlateWeights::solve(operators, &skin.landmark_rows, plate);
    cache.get_or_make(&key, decode, encode, solve)
}

fn weights_to_arrays(weights: &LandmarkWeights) -> Arrays {
    let mut arrays = Arrays::default();
    for (name, matrix) in [
        ("mix", &weights.mix),
        ("cross", &weights.cross),
        ("motion", &weights.motion),
    ] {
        arrays.insert_f32(name, matrix.shape(), matrix.iter().copied().collect());
    }
    if let Some(follows) = &weights.follows {
        let (start, columns, shares) = follows.parts();
        arrays.insert_u32("start", &[start.len()], start.to_vec());
        arrays.insert_u32("columns", &[columns.len()], columns.to_vec());
        arrays.insert_f32("shares", &[shares.len()], shares.to_vec());
    }
    arrays
}

fn weights_from_arrays(arrays: &mut Arrays, vertices: usize) -> Option<LandmarkWeights> {
    let mut take = |name: &str| {
        let (shape, values) = arrays.take_f32(name)?;
        let shape: [usize; 2] = shape.try_into().ok()?;
        Array2::from_shape_vec(shape, values).ok()
    };
    let (mix, cross, motion) = (take("mix")?, take("cross")?, take("motion")?);
    let follows = match arrays.take_u32("start") {
        Some((_, start)) => {
            let (columns, shares) = (arrays.take_u32("columns")?.1, arrays.take_f32("shares")?.1);
            Some(Prolongation::of_parts(
                (start, columns, shares),
                mix.nrows(),
            )?)
        }
        None => None,
    };
    let fits = mix.ncols() == LANDMARKS
        && cross.dim() == (mix.nrows(), 3 * motion.nrows())
        && motion.ncols() == COORDINATES;
    let weights = LandmarkWeights {
        mix,
        cross,
        motion,
        follows,
    };
    (fits && weights.vertices() == vertices).then_some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        CachePolicy,
        face::{Deformer, FaceOptions, PartList},
        job::SILENT,
        mesh::{Landmarks, Mesh, Similarity},
        nn::golden::Golden,
    };
    use ndarray::Array3;

    /// The weights embedded in the library.
    fn built_in() -> StaticWeights {
        StaticWeights::open(None).unwrap()
    }

    /// The golden's procedural face, canonical metres.
    fn face() -> (Mesh, Landmarks) {
        let golden = Golden::open("static_weights_debug");
        let positions: Vec<[f32; 3]> = golden
            .values("vertices")
            .chunks(3)
            .map(|p| [p[0], p[1], p[2]])
            .collect();
        let triangles = golden.integers("triangles");
        let vertices = golden.integers("landmarks");
        let landmarks = Landmarks {
            positions: std::array::from_fn(|n| positions[vertices[n]]),
            vertices: std::array::from_fn(|n| vertices[n] as u32),
            confidence: [1.0; LANDMARKS],
        };
        let triangles = triangles
            .chunks(3)
            .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
            .collect();
        (
            Mesh {
                positions,
                triangles,
            },
            landmarks,
        )
    }

    fn prepare(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to: &Similarity,
        learned: f32,
        cache: &CachePolicy,
    ) -> Corrected<LandmarkWeights> {
        let options = FaceOptions::default();
        let parts = PartList::find(mesh, landmarks, to, &options.parts).unwrap();
        let key = CacheKey::new("test", 1);
        let face = Face::new(mesh.clone(), (landmarks.clone(), *to, parts), options, key);
        let (weights, creases) = (built_in(), Creases::open(None).unwrap());
        let cache = Cache::new(cache);
        static_deformer((&weights, &creases), &face, learned, &cache, SILENT).unwrap()
    }

    fn motion() -> Array3<f32> {
        Array3::from_shape_fn((3, LANDMARKS, 3), |(t, n, x)| {
            0.004 * ((t + 1) as f32 * (n as f32 * 0.4 + x as f32)).sin()
        })
    }

    #[test]
    fn units_and_pose_of_the_mesh_do_not_matter() {
        let (mesh, landmarks) = face();
        let to = Similarity {
            scale: 0.01,
            rotation: [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            translation: [0.3, -0.2, 0.1],
        };
        let back = to.inverse();
        let posed = Mesh {
            positions: mesh.positions.iter().map(|&p| back.apply(p)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let posed_landmarks = Landmarks {
            positions: landmarks.positions.map(|p| back.apply(p)),
            ..landmarks.clone()
        };
        let motion = motion();
        let canonical = prepare(
            &mesh,
            &landmarks,
            &Similarity::IDENTITY,
            1.0,
            &CachePolicy::Off,
        );
        let expected = canonical.deform(motion.view(), SILENT).unwrap();
        let expected = to.displacements_to_mesh(
            expected
                .to_shape((3 * mesh.positions.len(), 1, 3))
                .unwrap()
                .view(),
        );
        let posed_weights = prepare(&posed, &posed_landmarks, &to, 1.0, &CachePolicy::Off);
        let got = posed_weights
            .deform(to.displacements_to_mesh(motion.view()).view(), SILENT)
            .unwrap();
        for (a, b) in got.iter().zip(&expected) {
            assert!((a - b).abs() < 2e-3, "expected {b}, got {a} (of 1.2)");
        }
    }

    #[test]
    fn teeth_follow_the_jaw_and_eyeballs_rest() {
        let (mut mesh, landmarks) = face();
        let first = mesh.positions.len() as u32;
        // A lower tooth behind and below the lips, an upper one above, and a ball in the right eye.
        for (centre, size) in [
            ([0.0, -0.066, 0.055], 0.004),
            ([0.0, -0.052, 0.055], 0.004),
            ([-0.03, 0.008, 0.04], 0.012),
        ] {
            let start = mesh.positions.len() as u32;
            let corners: [[f32; 3]; 4] = [
                [1.0, 1.0, 1.0],
                [1.0, -1.0, -1.0],
                [-1.0, 1.0, -1.0],
                [-1.0, -1.0, 1.0],
            ];
            mesh.positions
                .extend(corners.map(|c| std::array::from_fn(|i| centre[i] + size * c[i])));
            mesh.triangles.extend(
                [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]].map(|t| t.map(|v: u32| v + start)),
            );
        }
        let weights = prepare(
            &mesh,
            &landmarks,
            &Similarity::IDENTITY,
            1.0,
            &CachePolicy::Off,
        );
        let mut drop = Array3::zeros((1, LANDMARKS, 3));
        for n in 2..=14usize {
            let share = 1.0 - n.abs_diff(8) as f32 / 7.0;
            drop[[0, n, 1]] = -0.01 * share;
            drop[[0, n, 2]] = -0.01 * share;
        }
        let moved = weights.deform(drop.view(), SILENT).unwrap();
        let height = |v: u32| moved[[0, (first + v) as usize, 1]];
        assert!(height(0) < -0.005, "lower tooth: {}", height(0));
        assert_eq!((height(4), height(8)), (0.0, 0.0));
    }

    #[test]
    fn learned_zero_is_training_free() {
        let (mesh, landmarks) = face();
        let free = prepare(
            &mesh,
            &landmarks,
            &Similarity::IDENTITY,
            0.0,
            &CachePolicy::Off,
        );
        assert_eq!(free.decoder.motion.nrows(), 0);
    }

    #[test]
    fn cached_weights_equal_computed_ones() {
        let (mesh, landmarks) = face();
        let folder = tempfile::tempdir().unwrap();
        let folder_cache = CachePolicy::Folder(folder.path().into());
        let run = |cache| prepare(&mesh, &landmarks, &Similarity::IDENTITY, 1.0, cache);
        assert_eq!(run(&folder_cache), run(&folder_cache));
        assert_eq!(run(&folder_cache), run(&CachePolicy::Off));
        let mut arrays = weights_to_arrays(&run(&folder_cache).decoder);
        assert_eq!(weights_from_arrays(&mut arrays, 4), None);
    }
}
