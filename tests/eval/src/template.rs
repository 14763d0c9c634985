//! How EmoFace's template moves the vertices of heads that it is not, beside the decoder of its landmarks.
//!
//! Heads are ICT's identities of random coefficients, poses ARKit's shapes at full strength, both sides at once, and frames
//! of grid_s1's clips that are held out. What goes in is the true motion of the template, whose vertices are some of
//! ICT's, in the measure of each head; the truth is ICT's own modes.

use std::path::Path;

use clap::Args;
use ndarray::{Array2, Array3, Axis};

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    face_model::FaceModel,
    field::{FACE_VERTICES, UNSEEN_SEED, face_of, lips, spoken, spread},
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

const M_PER_CM: f32 = 0.01;
/// A vertex moves that goes as far as that, millimetres.
const MOVING_MM: f32 = 0.5;
/// A vertex of ICT's is one of the template's that lies as near, metres.
const SAME_M: f32 = 1e-4;
/// Frames of speech.
const SPOKEN: &str = "grid_s1, held out";
/// Shapes of which landmarks say nothing.
const CHEEKS: [&str; 2] = ["cheekPuff", "cheekSquint"];

/// Measure the way of EmoFace's template to heads that it is not, beside that of its landmarks
#[derive(Args)]
pub(super) struct Template {
    #[command(flatten)]
    data: DataArgs,
    /// Identities
    #[arg(long, value_name = "N", default_value_t = 3)]
    heads: u64,
}

/// Mean distances from the truth, mm: of the face, of the lips, of what moves.
#[derive(Default, Clone, Copy)]
struct Errors([f64; 3], [f64; 3]);

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
        let mut sums = vec![[Errors::default(); 3]; sets.len()];
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
                let landmarked = spread(&engine, &face, face.own_motion(marks.view()))?;
                let own = &landmarked + &on_face.beyond(motion.view(), &landmarked);
                let still = Array3::zeros(truth.dim());
                for (sum, made) in sums.iter_mut().zip([&still, &landmarked, &own]) {
                    sum.add(made, &truth, &lips);
                }
            }
        }
        println!(
            "{:>18} {}",
            "",
            ways.map(|way| format!("{way:>24}")).join("")
        );
        let row = |name: &str, errors: &[Errors; 3]| {
            let columns = errors.map(|e| {
                let [all, lips, moving] = e.means();
                format!("{all:8.3}{lips:8.3}{moving:8.3}")
            });
            println!("{name:>18} {}", columns.join(""));
        };
        let mut others = [Errors::default(); 3];
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
    let mut sets = Vec::new();
    for shape in shapes(ict) {
        let channels = vec![
            shape.clone(),
            format!("{shape}Left"),
            format!("{shape}Right"),
        ];
        sets.push((shape, channels, Array2::ones((1, 3))));
    }
    let channels: Vec<String> = ARKIT.iter().map(|name| (*name).to_owned()).collect();
    let weights = spoken(data, &channels)?;
    sets.push((SPOKEN.into(), channels, weights));
    Ok(sets)
}

/// ARKit's shapes without their sides, each once.
fn shapes(ict: &FaceModel) -> Vec<String> {
    let plain = |name: &String| {
        let name = name.trim_end_matches("_L").trim_end_matches("_R");
        name.to_owned()
    };
    let mut shapes: Vec<String> = ict.names.iter().map(plain).collect();
    shapes.sort_unstable();
    shapes.dedup();
    shapes
}

/// Which of ICT's vertices those of the template are.
fn vertices_of(template: &TemplateMesh, mean: &Face) -> Result<Vec<usize>> {
    let places: Vec<[f32; 3]> = mean
        .mesh
        .positions
        .iter()
        .map(|p| mean.to_canonical.apply(*p))
        .collect();
    let distance =
        |p: &[f32; 3], q: &[f32; 3]| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f32>().sqrt();
    let nearest = |p: &[f32; 3]| {
        let far = places.iter().enumerate().map(|(v, q)| (v, distance(p, q)));
        let (v, far) = far
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, f32::INFINITY));
        match far < SAME_M {
            true => Ok(v),
            false => Err(Error::InvalidInput(format!(
                "template: expected ICT's vertices, got one {far} m from all"
            ))),
        }
    };
    template.mesh.positions.iter().map(nearest).collect()
}

impl Errors {
    /// Both in centimetres.
    fn add(&mut self, made: &Array3<f32>, truth: &Array3<f32>, lips: &[bool]) {
        let size = |d: [f32; 3]| 1e3 * M_PER_CM * d.iter().map(|x| x * x).sum::<f32>().sqrt();
        for (t, v) in
            (0..truth.len_of(Axis(0))).flat_map(|t| (0..FACE_VERTICES).map(move |v| (t, v)))
        {
            let to: [f32; 3] = std::array::from_fn(|i| truth[[t, v, i]]);
            let off = std::array::from_fn(|i| made[[t, v, i]] - to[i]);
            for (n, counts) in [true, lips[v], size(to) > MOVING_MM]
                .into_iter()
                .enumerate()
            {
                if counts {
                    self.0[n] += f64::from(size(off));
                    self.1[n] += 1.0;
                }
            }
        }
    }

    fn join(&mut self, other: &Errors) {
        for n in 0..3 {
            self.0[n] += other.0[n];
            self.1[n] += other.1[n];
        }
    }

    fn means(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.0[n] / self.1[n].max(1.0))
    }
}
