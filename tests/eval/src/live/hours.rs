//! Pushes hours of sound through one stream and reports its memory use and whether its frames
//! keep up with the sound.

use std::{fs, time::Instant};

use anyface::{Engine, Error, Result};

/// Samples in one push, 10 ms.
const PUSH: usize = 160;
const PUSHES_PER_HOUR: u64 = 360_000;
/// Memory readings per hour of sound.
const READINGS: u64 = 10;

/// Plays the clips one after another, again and again.
pub(super) fn run(engine: &Engine, clips: &[Vec<f32>], hours: f64) -> Result<()> {
    let mut stream = engine.weight_stream()?;
    let latency = (stream.latency_s() * 16_000.0).round() as u64;
    let (mut pushed, mut frames, mut drift) = (0u64, 0u64, 0u64);
    let begun = Instant::now();
    let mut sound = clips.iter().flatten().copied().cycle();
    println!("| hours | memory, MB | frames late |\n|---|---|---|");
    for push in 1..=(hours * PUSHES_PER_HOUR as f64) as u64 {
        let block: Vec<f32> = sound.by_ref().take(PUSH).collect();
        stream.push(&block)?;
        pushed += PUSH as u64;
        while let Some(frame) = stream.pull() {
            if frame.index as u64 != frames {
                return Err(Error::Numerics(format!(
                    "expected frame {frames}, got {}",
                    frame.index
                )));
            }
            frames += 1;
        }
        // A frame is due once the last sample of its look-ahead has been pushed.
        let due = pushed
            .checked_sub(latency)
            .map_or(0, |heard| heard / 640 + 1);
        drift = drift.max(due.abs_diff(frames));
        if push % (PUSHES_PER_HOUR / READINGS) == 0 {
            println!(
                "| {:.1} | {:.2} | {drift} |",
                push as f64 / PUSHES_PER_HOUR as f64,
                resident_mb()?
            );
        }
    }
    println!(
        "\n{frames} frames in {:.0} s",
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Resident memory of this process, MB.
fn resident_mb() -> Result<f64> {
    let text = fs::read_to_string("/proc/self/statm").map_err(|e| {
        Error::InvalidInput(format!(
            "memory: expected /proc/self/statm, as Linux has it: {e}"
        ))
    })?;
    let pages: f64 = text
        .split(' ')
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(f64::NAN);
    Ok(pages * 4096.0 / 1e6)
}
