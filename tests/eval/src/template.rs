//! Measures how well EmoFace's template moves the vertices of other heads, compared with its
//! landmarks alone.
//!
//! The heads are ICT's identities with random coefficients. The poses are ARKit's shapes at full
//! strength, both sides at once, and frames of the held-out clips of grid_s1. The truth is the
//! motion of ICT's own modes on each head. The input is the true motion of the template's
//! vertices, which are some of ICT's, in canonical metres.

use std::path::Path;

use clap::Args;
use ndarray::{Array2, Array3, Axis};

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    face_model::FaceModel,
    field::{Distances, UNSEEN_SEED, face_of, lips, spoken},
    vertex_motion::{distance, spread_landmarks},
};
use anyface::{
    Error, Face, Result,
    head::Head,
    models::Weights,
    motion::Template as TemplateMesh,
    rig::ARKIT,
    spread::TemplateOnFace,
    systems::emoface::{EmoFaceConfig, MODEL, read_template},
};

/// A vertex of ICT and one of the template are the same if they lie closer than this, metres.
const SAME_M: f32 = 1e-4;
/// Name of the set that holds frames of speech.
const SPOKEN: &str = "grid_s1, held out";
/// Shapes that do not show in the landmarks. The row of all others leaves them out.
const CHEEKS: [&str; 2] = ["cheekPuff", "cheekSquint"];

/// Measure how well EmoFace's template moves other heads, compared with its landmarks alone
#[derive(Args)]
pub(super) struct Template {
    #[command(flatten)]
    data: DataArgs,
    /// Number of random identities
    #[arg(long, value_name = "N", default_value_t = 3)]
    heads: u64,
}

impl Template {
    pub(super) fn run(&self, shared: &SharedArgs, _: &Console) -> Result<()> {
        let data = self.data.folder()?;
        let ict = FaceModel::ict(&data)?;
        let engine = shared.engine_of(Some("emoface"))?;
        let files = MODEL.open(shared.weights.as_deref())?;
        let config = EmoFaceConfig::from_json(&files.config)?;
        let template = read_template(&Weights::from_bytes(&files.weights)?, &config)?
            .ok_or_else(|| Error::InvalidInput("model: expected a template, got none".into()))?;
        let sets = sets(&ict, &data)?;
        let ways = ["no motion", "landmarks", "template"];
        let mut sums = vec![[Distances::default(); 3]; sets.len()];
        let mean = face_of(&engine, &ict, &[])?;
        let vertices = vertices_of(&template, &mean)?;
        for number in 0..self.heads {
            let face = face_of(&engine, &ict, &Head::random(UNSEEN_SEED + number))?;
            let on_face = TemplateOnFace::new(&face, &template, 1.0)?;
            let lips = lips(&ict, &face.mesh);
            for ((_, channels, weights), sums) in sets.iter().zip(&mut sums) {
                let truth = ict.moved(channels, weights);
                let motion = face
                    .to_canonical
                    .displacements_to_canonical(truth.select(Axis(1), &vertices).view());
                let marks = on_face.landmarks(motion.view());
                let landmarked =
                    spread_landmarks(&engine, &face, face.motion_on_mesh(marks.view()))?;
                let with_template = &landmarked + &on_face.beyond(motion.view(), &landmarked);
                let still = Array3::zeros(truth.dim());
                for (sum, prediction) in sums.iter_mut().zip([&still, &landmarked, &with_template])
                {
                    sum.add(prediction, &truth, &lips);
                }
            }
        }
        println!(
            "{:>18} {}",
            "",
            ways.map(|way| format!("{way:>24}")).join("")
        );
        let row = |name: &str, errors: &[Distances; 3]| {
            let columns = errors.map(|e| {
                let [all, lips, moving] = e.means_mm();
                format!("{all:8.3}{lips:8.3}{moving:8.3}")
            });
            println!("{name:>18} {}", columns.join(""));
        };
        let mut others = [Distances::default(); 3];
        for ((name, ..), sums) in sets.iter().zip(&sums) {
            row(name, sums);
            if name != SPOKEN && !CHEEKS.contains(&name.as_str()) {
                others
                    .iter_mut()
                    .zip(sums)
                    .for_each(|(all, one)| all.join(one));
            }
        }
        row("all others", &others);
        Ok(())
    }
}

/// A name, channels and their weights `[T, M]`.
type Poses = (String, Vec<String>, Array2<f32>);

/// Every shape at full strength, and frames of speech.
fn sets(ict: &FaceModel, data: &Path) -> Result<Vec<Poses>> {
    let mut sets = whole_shapes(&ict.names);
    let channels: Vec<String> = ARKIT.iter().map(|name| (*name).to_owned()).collect();
    let weights = spoken(data, &channels)?;
    sets.push((SPOKEN.into(), channels, weights));
    Ok(sets)
}

/// ARKit's shapes at full strength, both sides of each at once.
fn whole_shapes(names: &[String]) -> Vec<Poses> {
    let plain = |name: &String| {
        let name = name.trim_end_matches("_L").trim_end_matches("_R");
        name.to_owned()
    };
    let mut shapes: Vec<String> = names.iter().map(plain).collect();
    shapes.sort_unstable();
    shapes.dedup();
    // A name without a side moves both sides.
    let whole = |shape: String| (shape.clone(), vec![shape], Array2::ones((1, 1)));
    shapes.into_iter().map(whole).collect()
}

/// Finds the vertex of ICT that each vertex of the template is.
fn vertices_of(template: &TemplateMesh, mean: &Face) -> Result<Vec<usize>> {
    let places = mean.mesh.positions.iter();
    let places: Vec<[f32; 3]> = places.map(|p| mean.to_canonical.apply(*p)).collect();
    let nearest = |p: &[f32; 3]| {
        let far = places.iter().enumerate();
        let far = far.map(|(v, q)| (v, distance(*p, *q)));
        let (v, far) = far
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, f32::INFINITY));
        if far < SAME_M {
            Ok(v)
        } else {
            Err(Error::InvalidInput(format!(
                "template: expected ICT's vertices, got one {far} m from all"
            )))
        }
    };
    template.mesh.positions.iter().map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::{
        Dtype,
        tensor::{TensorView, serialize},
    };

    /// A face of 68 vertices; each mode moves all of them along x by 1.
    fn face(data: &Path, names: &[&str]) -> FaceModel {
        let bytes = |values: Vec<f32>| -> Vec<u8> {
            values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect()
        };
        let along_x = |count: usize| bytes([1.0, 0.0, 0.0].repeat(68 * count));
        let tensors = [
            ("neutral", vec![68, 3], along_x(1)),
            (
                "landmarks68",
                vec![68],
                bytes((0..68u8).map(f32::from).collect()),
            ),
            ("triangles", vec![1, 3], bytes(vec![0.0, 1.0, 2.0])),
            ("expression", vec![names.len(), 68, 3], along_x(names.len())),
            ("identity", vec![1, 68, 3], along_x(1)),
        ];
        let views = tensors.iter().map(|(name, shape, bytes)| {
            (
                *name,
                TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap(),
            )
        });
        let names = serde_json::to_string(names).unwrap();
        let metadata = [("expression_names".to_owned(), names)];
        let file = serialize(views, Some(metadata.into())).unwrap();
        std::fs::create_dir(data.join("faces")).unwrap();
        std::fs::write(data.join("faces/ict_facekit.safetensors"), file).unwrap();
        FaceModel::ict(data).unwrap()
    }

    #[test]
    fn every_side_of_a_shape_moves_once() {
        let folder = tempfile::tempdir().unwrap();
        let ict = face(folder.path(), &["jawOpen", "mouthSmile_L", "mouthSmile_R"]);
        let sets = whole_shapes(&ict.names);
        let names: Vec<&str> = sets.iter().map(|(name, ..)| name.as_str()).collect();
        assert_eq!(names, ["jawOpen", "mouthSmile"]);
        for ((_, channels, weights), modes) in sets.iter().zip([1.0, 2.0]) {
            assert_eq!(ict.moved(channels, weights)[[0, 0, 0]], modes);
        }
    }
}
