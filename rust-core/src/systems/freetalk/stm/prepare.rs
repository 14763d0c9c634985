//! Everything of a mesh that does not depend on time.

use std::sync::Arc;

use ndarray::Array2;

use super::{
    PaperFace, StaticWeights, VertexGeometry, paper::PaperDecoder, row_weights::RowWeights,
    static_weights::Correction,
};
use crate::{
    Error, Result,
    deform::{
        Corrected, Corrections, LandmarkWeights, PartList, Plate, PlateWeights, Skin,
        binding::{Follows, bind},
    },
    mesh::{Landmarks, Mesh, Similarity},
    motion::LANDMARKS,
    operators::{Arrays, Cache, CacheKey},
    progress::{ProgressFn, report},
};

/// Raised when the training-free weights change.
const CACHE_VERSION: u32 = 2;
/// A user may strengthen the learned part up to this.
const STRONGEST: f32 = 10.0;

/// Prepares the `static` decoder for one mesh.
///
/// The result takes landmark displacements in the mesh's own units and axes and returns vertex
/// displacements in the same. The solve on the skin is kept in `cache`. `learned`: strength of the
/// learned part, 0 (training-free) to 10, 1 as shipped. `proxy`: skins of more vertices are worked
/// on through so many; see [`crate::deform::proxy`].
///
/// # Errors
/// `InvalidInput` for `learned` out of range, `Mesh` if the landmarks lie on no usable face,
/// `Numerics` if the solve fails, `Cancelled`.
// Four of them are one face: its mesh, landmarks, place and parts, found one after the other.
#[expect(clippy::too_many_arguments)]
pub fn prepare_static(
    weights: &StaticWeights,
    mesh: &Mesh,
    landmarks: &Landmarks,
    to_canonical: &Similarity,
    parts: &PartList,
    cache: &Cache,
    learned: f32,
    proxy: Option<usize>,
    progress: ProgressFn<'_>,
) -> Result<Corrected<LandmarkWeights>> {
    if !(0.0..=STRONGEST).contains(&learned) {
        return Err(Error::InvalidInput(format!(
            "learned: expected 0 to {STRONGEST}, got {learned}"
        )));
    }
    let setting = Setting::new(mesh, landmarks, to_canonical, parts, proxy, cache, progress)?;
    let strength = learned * setting.familiarity(weights);
    let correction = (strength > 0.0).then(|| setting.correction(weights));
    let result = setting.weights(true, correction.as_ref(), strength, to_canonical);
    report(progress, "weights", 1.0)?;
    Ok(setting.corrected(result, to_canonical))
}

/// Prepares the `paper` decoder for one mesh: operators and eigenbasis of the skin (kept in
/// `cache`) and the features of the neutral mesh. Units and axes are the mesh's own.
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face, `Numerics` if a solve fails, `Cancelled`.
pub fn prepare_paper(
    decoder: Arc<PaperDecoder>,
    mesh: &Mesh,
    landmarks: &Landmarks,
    to_canonical: &Similarity,
    parts: &PartList,
    cache: &Cache,
    progress: ProgressFn<'_>,
) -> Result<Corrected<PaperFace>> {
    let setting = Setting::new(mesh, landmarks, to_canonical, parts, None, cache, progress)?;
    let config = decoder.config();
    let base = setting.weights(config.base, None, 0.0, to_canonical);
    let surface = setting
        .skin
        .operators
        .surface(config.eigenpairs, 10.0, cache)?;
    report(progress, "weights", 0.9)?;
    let follows = setting.rows_followed();
    let inputs = setting.vertex_inputs(config.inputs)?;
    let features = decoder.encode(inputs, &surface);
    report(progress, "weights", 1.0)?;
    let face = PaperFace {
        decoder,
        features,
        surface,
        base,
        follows,
        to_canonical: *to_canonical,
    };
    Ok(setting.corrected(face, to_canonical))
}

/// A mesh in canonical centimetres, its skin and what everything else follows.
struct Setting {
    positions: Vec<[f32; 3]>,
    landmarks: [[f32; 3]; LANDMARKS],
    skin: Skin,
    plate: PlateWeights,
    follows: Vec<Follows>,
}

impl Setting {
    fn new(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to_canonical: &Similarity,
        parts: &PartList,
        proxy: Option<usize>,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Setting> {
        report(progress, "operators", 0.0)?;
        let cm = |p: [f32; 3]| to_canonical.apply(p).map(|x| 100.0 * x);
        let mesh = Mesh {
            positions: mesh.positions.iter().map(|&p| cm(p)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let vertices = landmarks.vertices;
        let landmarks = landmarks.positions.map(cm);
        let skin = Skin::find(&mesh, &landmarks, &vertices, parts, proxy)?;
        report(progress, "weights", 0.0)?;
        let plate = cached_plate(&skin, cache)?;
        report(progress, "weights", 0.7)?;
        let follows = bind(&mesh, parts, &skin.is_skin, &landmarks);
        Ok(Setting {
            positions: mesh.positions,
            landmarks,
            skin,
            plate,
            follows,
        })
    }

    /// Rows of the skin in decimetres.
    fn decimetres(&self) -> (Vec<[f32; 3]>, [[f32; 3]; LANDMARKS]) {
        let positions = &self.skin.operators.positions;
        (
            positions
                .iter()
                .map(|p| p.map(|x| 0.1 * x as f32))
                .collect(),
            self.landmarks.map(|p| p.map(|x| 0.1 * x)),
        )
    }

    /// The learned part of the static decoder on the skin.
    fn correction(&self, weights: &StaticWeights) -> Correction {
        let (positions, landmarks) = self.decimetres();
        weights.correction(&VertexGeometry {
            positions: &positions,
            landmarks: &landmarks,
            plate: &self.plate,
        })
    }

    /// How far the learned part is to be relied on.
    fn familiarity(&self, weights: &StaticWeights) -> f32 {
        weights.familiarity(&self.decimetres().1)
    }

    /// Position, normal and, with 278 inputs, offset from and distance to each landmark. `[R, C]`.
    fn vertex_inputs(&self, inputs: usize) -> Result<Array2<f32>> {
        const RELATED: usize = 6 + 4 * LANDMARKS;
        if inputs != 6 && inputs != RELATED {
            return Err(Error::Weights(format!(
                "stm_paper config.json: inputs: expected 6 or {RELATED}, got {inputs}"
            )));
        }
        let (positions, landmarks) = self.decimetres();
        let frames = self.skin.operators.tangent_frames();
        let mut out = Array2::zeros((positions.len(), inputs));
        for (v, mut row) in out.rows_mut().into_iter().enumerate() {
            for axis in 0..3 {
                row[axis] = positions[v][axis];
                row[3 + axis] = frames[v][2][axis] as f32;
            }
            for n in 0..(inputs - 6) / 4 {
                let offset: [f32; 3] = std::array::from_fn(|i| positions[v][i] - landmarks[n][i]);
                for axis in 0..3 {
                    row[6 + 3 * n + axis] = offset[axis];
                }
                row[6 + 3 * LANDMARKS + n] = offset.iter().map(|x| x * x).sum::<f32>().sqrt();
            }
        }
        Ok(out)
    }

    /// `[V]`, the rows of the skin that each vertex follows, and by which shares. For a skin without
    /// a proxy.
    fn rows_followed(&self) -> Vec<[(u32, f32); 3]> {
        let row = |(skin, share): (u32, f32)| match self.skin.spread.row(skin).next() {
            Some((row, _)) => (row, share),
            None => (0, 0.0),
        };
        let follows = self.follows.iter();
        follows
            .map(|follows| match *follows {
                Follows::Skin(corners) => corners.map(row),
                _ => [(0, 0.0); 3],
            })
            .collect()
    }

    /// The decoder with what a frame of this mesh needs beyond it.
    fn corrected<D>(&self, decoder: D, to_canonical: &Similarity) -> Corrected<D> {
        Corrected {
            decoder,
            corrections: Corrections::new(
                &self.positions,
                &self.skin,
                &self.follows,
                &self.landmarks,
                to_canonical,
            ),
        }
    }

    /// Weights of every vertex, the mesh's own axes. `plate`: whether the skin follows the
    /// training-free weights.
    fn weights(
        &self,
        plate: bool,
        correction: Option<&Correction>,
        strength: f32,
        to_canonical: &Similarity,
    ) -> LandmarkWeights {
        let mut rows = RowWeights::new(
            self.skin.operators.rows(),
            plate.then_some(&self.plate),
            correction,
            strength,
        );
        rows.turn(to_canonical);
        rows.spread(self.follows.len(), |rows, v, mut mix, mut cross| {
            let Follows::Skin(corners) = self.follows[v] else {
                return;
            };
            for (skin, share) in corners.into_iter().filter(|(_, share)| *share != 0.0) {
                for (row, weight) in self.skin.spread.row(skin) {
                    rows.add(row as usize, share * weight, &mut mix, &mut cross);
                }
            }
        })
    }
}

/// The plate's weights, from the cache where they are in it.
fn cached_plate(skin: &Skin, cache: &Cache) -> Result<PlateWeights> {
    let operators = &skin.operators;
    let plate = Plate::default();
    let key = CacheKey::new("plate weights", CACHE_VERSION)
        .f64s(operators.positions.iter().flatten())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        CachePolicy, deform::Deformer, mesh::PartChoices, nn::golden::Golden, progress::SILENT,
        weights::ModelFiles,
    };
    use ndarray::Array3;

    /// The weights that the library carries.
    fn built_in() -> StaticWeights {
        let files = ModelFiles::open("stm_static", None).unwrap();
        StaticWeights::load(&files.weights, &files.config).unwrap()
    }

    /// The golden's procedural face, canonical metres.
    fn face() -> (Mesh, Landmarks) {
        let golden = Golden::open("stm_static_debug");
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

    fn parts(mesh: &Mesh, landmarks: &Landmarks, to: &Similarity) -> PartList {
        PartList::find(mesh, landmarks, to, &PartChoices::default()).unwrap()
    }

    fn prepare(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to: &Similarity,
        learned: f32,
    ) -> Corrected<LandmarkWeights> {
        let weights = built_in();
        let cache = Cache::new(&CachePolicy::Off);
        let parts = parts(mesh, landmarks, to);
        prepare_static(
            &weights, mesh, landmarks, to, &parts, &cache, learned, None, SILENT,
        )
        .unwrap()
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
        let canonical = prepare(&mesh, &landmarks, &Similarity::IDENTITY, 1.0);
        let expected = canonical.deform(motion.view(), SILENT).unwrap();
        let expected = to.displacements_to_mesh(
            expected
                .to_shape((3 * mesh.positions.len(), 1, 3))
                .unwrap()
                .view(),
        );
        let own = prepare(&posed, &posed_landmarks, &to, 1.0);
        let got = own
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
        let weights = prepare(&mesh, &landmarks, &Similarity::IDENTITY, 1.0);
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
    fn learned_zero_is_training_free_and_out_of_range_is_an_error() {
        let (mesh, landmarks) = face();
        let free = prepare(&mesh, &landmarks, &Similarity::IDENTITY, 0.0);
        assert_eq!(free.decoder.motion.nrows(), 0);
        let weights = built_in();
        let cache = Cache::new(&CachePolicy::Off);
        for wrong in [-0.1, f32::NAN, 11.0] {
            let result = prepare_static(
                &weights,
                &mesh,
                &landmarks,
                &Similarity::IDENTITY,
                &parts(&mesh, &landmarks, &Similarity::IDENTITY),
                &cache,
                wrong,
                None,
                SILENT,
            );
            assert!(matches!(result, Err(Error::InvalidInput(_))));
        }
    }

    #[test]
    fn cached_weights_are_the_computed_ones() {
        let (mesh, landmarks) = face();
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&CachePolicy::Folder(folder.path().into()));
        let weights = built_in();
        let run = || {
            prepare_static(
                &weights,
                &mesh,
                &landmarks,
                &Similarity::IDENTITY,
                &parts(&mesh, &landmarks, &Similarity::IDENTITY),
                &cache,
                1.0,
                None,
                SILENT,
            )
            .unwrap()
        };
        assert_eq!(run(), run());
        assert_eq!(
            run(),
            prepare(&mesh, &landmarks, &Similarity::IDENTITY, 1.0)
        );
    }
}
