//! `anyface head`: makes a head from coefficients and traits.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use anyface::{
    Error, Result,
    head::{COEFFICIENTS, HeadMaker, MadeHead, ScanFit, ScanOptions},
    job::{InputKind, read_text, write_atomically},
    mesh::{LandmarkSource, Mesh},
    output::Report,
};
use clap::Args;
use serde::Serialize;

use crate::{
    arguments::{SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath, landmarks_beside},
    stages::{new_report, timed},
};

/// Make a head: at random, from sliders, a mixture of two, or like a scan
#[derive(Args)]
pub struct MakeHead {
    /// The result: .obj of quads with the objects skin, eyes, teeth, tongue, lashes and brows. Its landmarks are written
    /// beside it, to NAME.landmarks.json
    #[arg(long, value_name = "HEAD.obj")]
    out: OutputPath,
    /// Seed of a random head. The same seed makes the same head
    #[arg(long, value_name = "N", conflicts_with_all = ["mix", "code", "like"])]
    seed: Option<u64>,
    /// A mixture of the heads of two seeds, half of each, as in 7,12, or with a share of the second, as in 7,12,0.3
    #[arg(long, value_name = "A,B[,SHARE]", value_parser = mixture, conflicts_with_all = ["code", "like"])]
    mix: Option<Mixture>,
    /// Numbers of the head as a JSON list, as --code-out writes them: 100 coefficients, then traits if they are not 0
    #[arg(long, value_name = "C.json", conflicts_with = "like")]
    code: Option<InputPath>,
    /// A clean head like this scan or model: OBJ, PLY or GLB
    #[arg(long, value_name = "SCAN")]
    like: Option<InputPath>,
    /// Landmarks of the scan as JSON [default: they are detected]
    #[arg(long, value_name = "L.json", requires = "like")]
    like_landmarks: Option<InputPath>,
    /// A slider such as age or face-width, from -4 to 4. 0 is the average head. Every run of
    /// `anyface head` prints all sliders and their values. May be repeated
    #[arg(long, value_name = "NAME=VALUE", value_parser = direction, allow_hyphen_values = true)]
    direction: Vec<(String, f32)>,
    /// Pull coefficients that lie far outside those of the training heads back to them
    #[arg(long)]
    pull_back: bool,
    /// Write the surface of the head's distance field instead, from a grid with N cells along its
    /// longest side. This surface has no traits and no eyes
    #[arg(long, value_name = "N")]
    surface: Option<usize>,
    /// Write only the skin, without eyes, teeth, tongue, lashes and brows
    #[arg(long)]
    skin_only: bool,
    /// Also write the numbers of the head as JSON
    #[arg(long, value_name = "C.json")]
    code_out: Option<OutputPath>,
}

/// Two seeds and the share of the second.
#[derive(Debug, Clone, Copy)]
struct Mixture {
    seeds: [u64; 2],
    share: f32,
}

/// The report of a run, with the numbers of the head.
#[derive(Serialize)]
struct HeadReport<'a> {
    #[serde(flatten)]
    run: &'a Report,
    landmarks: String,
    coefficients: &'a [f32],
    /// The value of each slider.
    directions: Vec<(String, f32)>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<ScanFit>,
}

impl MakeHead {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        self.check()?;
        let progress = |p| console.progress(p);
        let mut report = new_report();
        let maker = timed(&mut report, "load", || HeadMaker::open(shared.weights()))?;
        let (mut numbers, fit) = self.numbers(&maker, shared, console, &mut report)?;
        for (name, value) in &self.direction {
            let direction = maker.direction(name)?;
            if self.surface.is_some() && direction < maker.topology().traits().len() {
                return Err(Error::InvalidInput(format!(
                    "--direction {name}: expected a direction of the field, as its surface knows no traits; leave \
                     out --surface or this slider"
                )));
            }
            maker.set_along(&mut numbers, direction, *value)?;
        }
        let head = timed(&mut report, "surface", || match self.surface {
            Some(cells) => maker.surface(&numbers, cells, &progress),
            None => maker.mesh(&numbers, !self.skin_only),
        })?;
        if self.surface.is_some() {
            numbers.truncate(COEFFICIENTS);
            numbers.resize(maker.count(), 0.0);
        }
        let landmarks = self.landmarks_path();
        timed(&mut report, "write", || {
            self.write(&head, &landmarks, &numbers)
        })?;
        report.out = Some(shown(&self.out));
        report.vertices = Some(head.mesh.positions.len());
        let names = maker.directions().map(str::to_owned);
        let full = HeadReport {
            run: &report,
            landmarks: shown(&landmarks),
            coefficients: &numbers,
            directions: names.zip(maker.along(&numbers)?).collect(),
            fit,
        };
        console.warn(&report.warnings);
        console.value(&full, &summary(&full, &head))
    }

    /// Results whose names derive from that of the head.
    pub fn outputs_beside(&self) -> Vec<PathBuf> {
        vec![self.landmarks_path()]
    }

    fn landmarks_path(&self) -> PathBuf {
        landmarks_beside(&self.out)
    }

    fn check(&self) -> Result<()> {
        if self.out.extension().is_none_or(|ending| ending != "obj") {
            return Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .obj",
                self.out.display()
            )));
        }
        Ok(())
    }

    fn numbers(
        &self,
        maker: &HeadMaker,
        shared: &SharedArgs,
        console: &Console,
        report: &mut Report,
    ) -> Result<(Vec<f32>, Option<ScanFit>)> {
        if let Some(path) = &self.like {
            let progress = |p| console.progress(p);
            let scan = timed(report, "read", || Mesh::read(path))?;
            let known = self
                .like_landmarks
                .as_deref()
                .map(LandmarkSource::read)
                .transpose()?;
            let landmarks = timed(report, "landmarks", || {
                let options = anyface::face::FaceOptions {
                    landmarks: known,
                    ..Default::default()
                };
                let face = shared.engine()?.find(&scan, &options, &progress)?;
                Ok(face.landmarks)
            })?;
            let fit = timed(report, "fit", || {
                maker.head().fit_scan(
                    &scan.positions,
                    &landmarks,
                    &ScanOptions::default(),
                    &progress,
                )
            })?;
            report.warnings.extend(fit.warnings.iter().cloned());
            return Ok((maker.checked(fit.coefficients.clone(), true)?, Some(fit)));
        }
        let numbers =
            match (&self.mix, &self.code) {
                (Some(Mixture { seeds, share }), _) => {
                    let [a, b] = seeds.map(|seed| maker.random(seed));
                    maker.mixture(&a, &b, *share)?
                }
                (None, Some(path)) => maker.checked(read_code(path)?, self.pull_back).map_err(
                    |error| match error {
                        Error::InvalidInput(message) if message.ends_with("pulled back") => {
                            Error::InvalidInput(format!("{message}: --pull-back"))
                        }
                        other => other,
                    },
                )?,
                (None, None) => match self.seed {
                    Some(seed) => maker.random(seed),
                    None => vec![0.0; maker.count()],
                },
            };
        Ok((numbers, None))
    }

    fn write(&self, head: &MadeHead, landmarks: &Path, numbers: &[f32]) -> Result<()> {
        let write = |path: &Path, text: &str| {
            write_atomically(path, |file| file.write_all(text.as_bytes()))
        };
        let obj = head.to_obj();
        let mesh = Mesh::parse(obj.as_bytes())?;
        write(landmarks, &head.landmarks.to_json_of(&mesh, None))?;
        if let Some(path) = &self.code_out {
            let text = serde_json::to_string(numbers).expect("numbers serialise");
            write(path, &text)?;
        }
        write(&self.out, &obj)
    }
}

fn read_code(path: &Path) -> Result<Vec<f32>> {
    let text = read_text(path, InputKind::Text)?;
    serde_json::from_str(&text).map_err(|error| {
        let place = path.display();
        Error::InvalidInput(format!(
            "{place}: expected a JSON list of numbers, {COEFFICIENTS} or more: {error}"
        ))
    })
}

fn mixture(text: &str) -> std::result::Result<Mixture, String> {
    let wrong = || format!("expected A,B or A,B,SHARE, as in 7,12,0.3, got {text:?}");
    let words: Vec<&str> = text.split(',').map(str::trim).collect();
    let seed = |n: usize| {
        words
            .get(n)
            .and_then(|word| word.parse().ok())
            .ok_or_else(wrong)
    };
    let share = match words.len() {
        2 => 0.5,
        3 => words[2].parse().map_err(|_| wrong())?,
        _ => return Err(wrong()),
    };
    Ok(Mixture {
        seeds: [seed(0)?, seed(1)?],
        share,
    })
}

fn direction(text: &str) -> std::result::Result<(String, f32), String> {
    let wrong = || format!("expected NAME=VALUE, as in face-width=1.5, got {text:?}");
    let (name, value) = text.split_once('=').ok_or_else(wrong)?;
    Ok((
        name.trim().to_owned(),
        value.trim().parse().map_err(|_| wrong())?,
    ))
}

fn summary(report: &HeadReport<'_>, head: &MadeHead) -> String {
    let total: f64 = report.run.seconds.values().sum();
    let mut text = format!(
        "wrote {} and {}: {} vertices, of them {} skin, in {total:.2} s\n",
        report.run.out.as_deref().unwrap_or("nothing"),
        report.landmarks,
        head.mesh.positions.len(),
        head.skin_vertices()
    );
    if let Some(fit) = &report.fit {
        text += &format!(
            "the scan's face lies {:.2} mm from it, {:.2} mm at nine points of ten\n",
            fit.mean_mm, fit.most_mm
        );
    }
    for (name, value) in &report.directions {
        text += &format!("{name:>20} {value:5.2}\n");
    }
    text
}
