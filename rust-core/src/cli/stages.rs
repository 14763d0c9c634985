//! The stages that subcommands put together, each timed into the report.

use std::{
    panic::resume_unwind,
    path::Path,
    time::{Duration, Instant},
};

use ndarray::{ArrayView3, Axis, Slice};

use super::console::Console;
use crate::{
    PreparedFace, Result,
    audio::Waveform,
    mesh::{Mesh, Mouth},
    output::{ClipShape, LandmarkTrack, Report, largest, warnings_of_sound, write_frames},
    progress::Progress,
};

/// Bytes of displacements that are held at a time.
const BLOCK_BYTES: usize = 64 << 20;
/// Motion of the mesh below which nobody sees it move, on a human head.
const VISIBLE_MM: f32 = 0.1;
/// Mean confidence of landmarks below which the user should look at them.
const DOUBTFUL: f32 = 0.4;

/// An empty report of this version.
pub(super) fn new_report() -> Report {
    Report {
        version: env!("CARGO_PKG_VERSION").into(),
        ..Report::default()
    }
}

/// Runs one stage and adds its time to the report.
pub(super) fn timed<T>(
    report: &mut Report,
    stage: &str,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let start = Instant::now();
    let result = work();
    note(report, stage, start.elapsed());
    result
}

fn note(report: &mut Report, stage: &str, spent: Duration) {
    *report.seconds.entry(stage.into()).or_default() += spent.as_secs_f64();
}

/// Decodes the sound and notes what is odd about it.
pub(super) fn read_sound(report: &mut Report, path: &Path) -> Result<Waveform> {
    let waveform = timed(report, "read", || Waveform::from_file(path))?;
    report.audio_s = Some(waveform.duration_s());
    report.warnings.extend(warnings_of_sound(&waveform));
    Ok(waveform)
}

/// Notes how sure the landmarks are.
pub(super) fn note_landmarks(report: &mut Report, confidence: &[f32; 68]) {
    let least = confidence.iter().copied().fold(f32::INFINITY, f32::min);
    let mean = confidence.iter().sum::<f32>() / confidence.len() as f32;
    report.landmark_confidence = Some([least, mean]);
    if mean < DOUBTFUL {
        report.warnings.push(format!(
            "the landmarks are uncertain (mean confidence {mean:.2}); check them with `anyface \
             landmarks`, or give them with --landmarks"
        ));
    }
}

/// Notes how the lips meet; welded ones are worth a warning.
pub(super) fn note_mouth(report: &mut Report, mouth: Mouth) {
    report.mouth = Some(mouth.name().into());
    if mouth == Mouth::Welded {
        report.warnings.push(mouth.sentence().into());
    }
}

/// Puts landmark motion on a prepared mesh and writes it, block by block.
///
/// `landmarks`: `[T, 68, 3]`, mesh units.
pub(super) fn deform_into(
    path: &Path,
    mesh: &Mesh,
    face: &PreparedFace,
    landmarks: ArrayView3<'_, f32>,
    fps: f64,
    report: &mut Report,
    console: &Console,
) -> Result<()> {
    let shape = ClipShape {
        frames: landmarks.dim().0,
        vertices: mesh.positions.len(),
        fps,
    };
    let track = LandmarkTrack {
        neutral: &face.landmarks.positions,
        displacements: landmarks,
    };
    let block = (BLOCK_BYTES / (shape.vertices * 12).max(1)).max(1);
    let started = Instant::now();
    let (mut deforming, mut most) = (Duration::ZERO, 0.0f32);
    let starts: Vec<usize> = (0..shape.frames).step_by(block).collect();
    write_frames(path, &shape, mesh, &track, |sink| {
        // The next block is made while the last one is written.
        std::thread::scope(|scope| {
            let make = |start: usize| {
                let end = (start + block).min(shape.frames);
                let share = move |p: Progress| Progress {
                    fraction: (start as f32 + p.fraction * (end - start) as f32)
                        / shape.frames as f32,
                    ..p
                };
                let watch = Instant::now();
                let frames = landmarks.slice_axis(Axis(0), Slice::from(start..end));
                let moved = face
                    .deformer
                    .deform(frames, &|p| console.progress(share(p)))?;
                let most = largest(moved.view());
                Ok::<_, crate::Error>((moved, most, watch.elapsed()))
            };
            let mut making = starts
                .first()
                .map(|&start| scope.spawn(move || make(start)));
            for index in 1..=starts.len() {
                let Some(made) = making.take() else { break };
                let made = made.join().unwrap_or_else(|panic| resume_unwind(panic));
                let (moved, reach, spent) = made?;
                let next = starts.get(index);
                making = next.map(|&start| scope.spawn(move || make(start)));
                deforming += spent;
                most = most.max(reach);
                sink(moved.view())?;
            }
            Ok(())
        })
    })?;
    note(report, "deform", deforming);
    note(report, "write", started.elapsed().saturating_sub(deforming));
    note_motion(report, face, most, largest(landmarks));
    report.out = Some(path.display().to_string());
    report.frames = shape.frames;
    report.fps = fps;
    report.vertices = Some(shape.vertices);
    Ok(())
}

/// Notes how far the mesh moves, and says so if the landmarks move and it does not.
fn note_motion(report: &mut Report, face: &PreparedFace, vertices: f32, landmarks: f32) {
    let to_mm = 1000.0 * face.to_canonical.scale as f32;
    report.largest_displacement = Some(vertices);
    report.largest_displacement_mm = Some(vertices * to_mm);
    report.largest_landmark_displacement_mm = Some(landmarks * to_mm);
    if vertices * to_mm < VISIBLE_MM && landmarks * to_mm >= VISIBLE_MM {
        report.warnings.push(format!(
            "the landmarks move by up to {:.2} mm but the mesh by {:.3} mm only; are the \
             landmarks on the face?",
            landmarks * to_mm,
            vertices * to_mm
        ));
    }
}

/// One line for people.
pub(super) fn summary(report: &Report) -> String {
    let mut text = format!(
        "wrote {}: {} frames at {} fps",
        report.out.as_deref().unwrap_or("nothing"),
        report.frames,
        report.fps
    );
    if let Some(vertices) = report.vertices {
        text += &format!(", {vertices} vertices");
    }
    if let (Some(most), Some(mm)) = (report.largest_displacement, report.largest_displacement_mm) {
        text += &format!(", moving up to {most:.4} units ({mm:.1} mm on a human head)");
    }
    let total: f64 = report.seconds.values().sum();
    text + &format!(", in {total:.2} s")
}
