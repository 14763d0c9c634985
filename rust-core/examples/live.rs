//! Landmark motion from a stream of sound: `cargo run --release --example live -- VOICE.wav`.

use std::path::Path;

use anyface::{Engine, EngineOptions, Result, audio::Waveform, conditions::Emotion};

/// Samples that a sound card hands over at a time, 10 ms.
const BLOCK: usize = 160;
const CHIN: usize = 8;

fn main() -> Result<()> {
    let Some(voice) = std::env::args().nth(1) else {
        eprintln!("usage: live VOICE.wav");
        std::process::exit(2);
    };
    let sound = Waveform::from_file(Path::new(&voice))?;
    let mut stream = Engine::new(EngineOptions::default())?.stream()?;
    stream.set_emotion(&Emotion::parse("happy:0.5")?)?;
    let mut frames = Vec::new();
    for block in sound.samples.chunks(BLOCK) {
        stream.push(block)?;
        frames.extend(stream.drain());
    }
    stream.finish()?;
    frames.extend(stream.drain());
    for frame in frames {
        let down_mm = -1000.0 * frame.displacements[CHIN][1];
        let bar = "#".repeat((2.0 * down_mm.max(0.0)) as usize);
        println!(
            "{:7.2} s {down_mm:5.1} mm {bar}",
            frame.index as f64 / stream.fps()
        );
    }
    Ok(())
}
