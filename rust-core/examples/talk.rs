//! Makes a head talk: `cargo run --release --example talk -- HEAD.obj VOICE.wav OUT.npz [happy:0.7]`.

use std::path::Path;

use anyface::{
    Engine, EngineOptions, MotionRequest, Result, audio::Waveform, conditions::EmotionCurve,
    face::FaceOptions, job::SILENT, mesh::Mesh, output::ClipFile,
};

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [head, voice, out, emotion @ ..] = words.as_slice() else {
        eprintln!("usage: talk HEAD.obj VOICE.wav OUT.npz [EMOTION]");
        std::process::exit(2);
    };
    let emotion = emotion.first().map_or("neutral:0", String::as_str);
    let request = MotionRequest {
        emotion: EmotionCurve::parse(emotion)?,
        ..MotionRequest::default()
    };
    let engine = Engine::new(EngineOptions::default())?;
    let mesh = Mesh::read(head)?;
    let face = engine.prepare(&mesh, &FaceOptions::default(), SILENT)?;
    let sound = Waveform::from_file(Path::new(voice))?;
    // Frames go into the file as they are made; the clip is never in memory whole.
    let mut file = ClipFile::new(Path::new(out))?;
    let report = engine.animate(&face, &sound, &request, &mut file, SILENT)?;
    let largest_mm = 1000.0 * face.metres_per_unit() * f64::from(report.largest);
    println!(
        "{out}: {} frames, {largest_mm:.1} mm at most",
        report.landmarks.dim().0
    );
    Ok(())
}
