//! Makes a head talk: `cargo run --release --example speak`, of a file and in files of your own:
//! `… --example speak -- HEAD.obj VOICE.wav OUT.glb happy:0.7`.

use std::{
    env,
    f32::consts::TAU,
    path::{Path, PathBuf},
};

use anyface::{
    Engine, EngineOptions, MotionRequest, Result, audio::Waveform, conditions::EmotionCurve,
    face::FaceOptions, job::SILENT, mesh::Mesh, output::ClipFile,
};

const HEAD: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../weights/shared/default_head/head.obj"
);

fn main() -> Result<()> {
    let words: Vec<String> = env::args().skip(1).collect();
    let word = |place: usize| words.get(place).map(String::as_str);
    let sound = match word(1) {
        Some(voice) => Waveform::from_file(Path::new(voice))?,
        None => syllables(),
    };
    let out = word(2).map_or_else(|| env::temp_dir().join("speak.glb"), PathBuf::from);
    let request = MotionRequest {
        emotion: EmotionCurve::parse(word(3).unwrap_or("happy:0.7"))?,
        ..MotionRequest::default()
    };
    let engine = Engine::new(EngineOptions::default())?;
    let mesh = Mesh::read(word(0).unwrap_or(HEAD))?;
    let face = engine.prepare(&mesh, &FaceOptions::default(), SILENT)?;
    // Frames go into the file as they are made; the clip is never in memory whole.
    let mut file = ClipFile::new(&out)?;
    let report = engine.animate(&face, &sound, &request, &mut file, SILENT)?;
    let largest_mm = 1000.0 * face.metres_per_unit() * f64::from(report.largest);
    println!(
        "{}: {} frames, {largest_mm:.1} mm at most",
        out.display(),
        report.landmarks.dim().0
    );
    Ok(())
}

/// Two seconds of something like "ma ma ma": a buzz at 120 Hz with one formant, three times a second.
fn syllables() -> Waveform {
    let at = |i: usize| i as f32 / 16_000.0;
    let tone = |t: f32, hz: f32| (-((hz - 700.0) / 400.0).powi(2)).exp() * (TAU * hz * t).sin();
    let buzz = |t: f32| (1..20).map(|k| tone(t, 120.0 * k as f32)).sum::<f32>();
    let loudness = |t: f32| 0.1 * (0.5 - 0.5 * (TAU * 3.0 * t).cos()).powi(2);
    let samples = (0..32_000).map(|i| loudness(at(i)) * buzz(at(i)));
    Waveform {
        samples: samples.collect(),
    }
}
