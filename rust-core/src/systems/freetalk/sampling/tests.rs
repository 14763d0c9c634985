//! The denoiser and its sampler against their PyTorch twins.

use super::*;
use crate::{
    job::SILENT,
    models::Weights,
    nn::golden::{Golden, distance},
    systems::freetalk::ats::AtsConfig,
};

fn model(golden: &Golden) -> Ats {
    let config = AtsConfig::from_json(&golden.metadata("config")).unwrap();
    Ats::new(config, &golden.weights()).unwrap()
}

fn golden() -> Golden {
    Golden::open("ats_compact_debug")
}

#[test]
fn one_pass_matches_pytorch() {
    let golden = golden();
    let model = model(&golden);
    let [noisy, speech, affect, clean] =
        ["noisy", "speech", "affect", "clean"].map(|n| golden.cube(n));
    let (timesteps, styles) = (golden.integers("timestep"), golden.integers("style"));
    for sample in 0..2 {
        let of = |cube: &Array3<f32>| cube.index_axis(Axis(0), sample).to_owned();
        let window = model.window(of(&speech).view(), of(&affect).view(), styles[sample]);
        let got = model.denoise(&of(&noisy), timesteps[sample], &window);
        let error = distance(&got, &of(&clean));
        assert!(error < 1e-4, "{error}");
    }
}

struct Clip {
    noise: Array2<f32>,
    speech: Array2<f32>,
    affect: Array2<f32>,
}

impl Clip {
    fn read(golden: &Golden) -> Self {
        let [noise, speech, affect] =
            ["noise", "speech", "affect"].map(|name| golden.matrix(&format!("long.{name}")));
        Clip {
            noise,
            speech,
            affect,
        }
    }

    fn request(&self) -> AtsRequest<'_> {
        AtsRequest {
            speech: self.speech.view(),
            affect: self.affect.view(),
            style: Some("facegood_zh"),
            seed: 0,
            steps: None,
            temperature: None,
        }
    }
}

/// Compares the motion in units of the model's deviation, so that 1e-4 means the same everywhere.
fn check_motion(golden: &Golden, model: &Ats, name: &str) {
    let clip = Clip::read(golden);
    let noise = |rows: Range<usize>| clip.noise.slice_axis(Axis(0), slice(&rows)).to_owned();
    let got = model.sample_from(&clip.request(), noise, SILENT).unwrap();
    let deviation = golden.weights().vector("std", 204).unwrap();
    let scaled = |motion: &Array2<f32>| motion / &deviation;
    let error = distance(&scaled(&got), &scaled(&golden.matrix(name)));
    assert!(error < 1e-4, "{error}");
}

#[test]
fn clip_of_several_windows_matches_pytorch() {
    let golden = golden();
    check_motion(&golden, &model(&golden), "long.motion");
}

#[test]
fn warm_clip_with_leading_steps_matches_pytorch() {
    let golden = golden();
    let mut config = AtsConfig::from_json(&golden.metadata("config")).unwrap();
    config.sampling = Sampling {
        steps: 5,
        spacing: crate::diffusion::Spacing::Leading,
        temperature: 0.7,
        noise_s: 0.0,
    };
    let model = Ats::new(config, &golden.weights()).unwrap();
    check_motion(&golden, &model, "long.motion_warm");
}

#[test]
fn seed_decides_where_there_is_temperature_and_threads_never_do() {
    let golden = golden();
    let (model, clip) = (model(&golden), Clip::read(&golden));
    let run = |seed, temperature, threads: usize| {
        let request = AtsRequest {
            seed,
            temperature: Some(temperature),
            ..clip.request()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| model.sample(&request, SILENT).unwrap())
    };
    let motion = run(1, 1.0, 1);
    assert_eq!(motion.dim(), (71, 68, 3));
    assert_eq!(motion, run(1, 1.0, 2));
    assert_eq!(motion, run(1, 1.0, 5));
    assert_ne!(motion, run(2, 1.0, 2));
    assert_eq!(run(1, 0.0, 1), run(2, 0.0, 2));
}

#[test]
fn bad_requests_say_expected_and_got() {
    let golden = golden();
    let (model, clip) = (model(&golden), Clip::read(&golden));
    let fails = |request: AtsRequest<'_>| model.sample(&request, SILENT).unwrap_err().to_string();
    let narrow = Array2::zeros((71, 5));
    let message = fails(AtsRequest {
        speech: narrow.view(),
        ..clip.request()
    });
    assert_eq!(message, "speech features: expected [71, 16], got [71, 5]");
    let message = fails(AtsRequest {
        style: Some("opera"),
        ..clip.request()
    });
    assert!(
        message.contains("grid_s1") && message.contains("opera"),
        "{message}"
    );
    assert!(
        fails(AtsRequest {
            steps: Some(0),
            ..clip.request()
        })
        .contains("got 0")
    );
    let message = fails(AtsRequest {
        temperature: Some(f32::NAN),
        ..clip.request()
    });
    assert!(message.contains("NaN"), "{message}");
}

#[test]
fn empty_clip_is_empty_motion() {
    let model = model(&golden());
    let (speech, affect) = (Array2::zeros((0, 16)), Array2::zeros((0, 16)));
    let request = AtsRequest {
        speech: speech.view(),
        affect: affect.view(),
        style: None,
        seed: 0,
        steps: None,
        temperature: None,
    };
    assert_eq!(model.sample(&request, SILENT).unwrap().dim(), (0, 68, 3));
}

#[test]
fn cancelling_stops_sampling() {
    let golden = golden();
    let (model, clip) = (model(&golden), Clip::read(&golden));
    let stop = |p: job::Progress| p.fraction < 0.5;
    let result = model.sample(&clip.request(), &stop);
    assert!(matches!(result, Err(Error::Cancelled)));
}

#[test]
fn recorded_styles_leave_the_lips_as_they_were() {
    let config = AtsConfig::from_json(&golden().metadata("config")).unwrap();
    assert!(config.closes_lips(None) && config.closes_lips(Some("taught")));
    assert!(!config.closes_lips(Some("grid_s1")));
}

#[test]
fn damaged_files_are_weights_errors() {
    let golden = golden();
    let config = golden.metadata("config");
    let refused = |config: &str, weights: &Weights| {
        let result = AtsConfig::from_json(config).and_then(|config| Ats::new(config, weights));
        match result.err() {
            Some(Error::Weights(message)) => message,
            other => panic!("{other:?}"),
        }
    };
    assert!(refused("{", &golden.weights()).contains("config.json"));
    let other_width = config.replace("\"width\": 32", "\"width\": 64");
    let message = refused(&other_width, &golden.weights());
    assert!(
        message.contains("norm.weight: expected [64], got [32]"),
        "{message}"
    );
    let other_style = config.replace("\"default_style\": \"any\"", "\"default_style\": \"x\"");
    assert!(refused(&other_style, &golden.weights()).contains("default_style"));
    assert!(matches!(
        Ats::load(b"not a file", &config),
        Err(Error::Weights(_))
    ));
}
