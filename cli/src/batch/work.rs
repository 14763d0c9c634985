//! Does one line of a batch: reads its sound, makes the motion and writes the file.

use std::{fs, path::Path};

use anyface::{
    Error, Performance, Result,
    audio::Waveform,
    job::ProgressFn,
    mesh::ibug::INNER_LIPS,
    motion::{Extent, LandmarkClip, Motion},
    output::{Format, MotionFile, Report, write_blend_weights},
    rig::SolvedWeights,
    speech::frames_of,
    spread::FrameSink,
};

use super::{
    faces::Ready,
    line::Line,
    lips::{Gap, LipMotion, peaks},
};
use crate::{
    arguments::shown,
    paths::link_warning,
    scene::SceneSound,
    stages::{new_report, note_memory, read_sound, spread_into},
};

/// The result of a line.
pub struct Done {
    pub report: Report,
    pub gap: Gap,
    pub lips: LipMotion,
    pub wave: Vec<f32>,
}

/// Does a line.
///
/// # Errors
/// Those of `anyface animate` and `anyface motion`.
pub fn perform(line: &Line, ready: &Ready, progress: ProgressFn<'_>) -> Result<Done> {
    let options = &line.options;
    let request = options.motion.request(&line.shared)?;
    let receipts = line.shared.receipts();
    let scene_sound = SceneSound::of(&line.out, &line.audio, &receipts);
    if let Some(path) = scene_sound.as_ref().and_then(SceneSound::output) {
        receipts.derive(path)?;
    }
    create_folder_of(&line.out)?;
    let mut report = new_report();
    report.warnings.extend(link_warning(&line.out));
    let sound = read_sound(&mut report, &line.audio, &options.sound, progress)?;
    let duration_s = sound.levels.duration_s();
    let engine = &*ready.engine;
    check_memory(line, ready, (duration_s, request.fps), &mut report)?;
    if let Some(face) = &ready.face {
        let unseen = engine.unseen_events(face, &request.events, duration_s, progress)?;
        report.warnings.extend(unseen);
    }
    let waveform = sound.whole(progress)?;
    let performance = engine.perform(&waveform, &request, progress)?;
    let landmarks = engine.landmarks_of(&performance.motion)?;
    let take = Take {
        performance,
        landmarks,
        scene_sound,
    };
    let gap = write(line, ready, &take, &mut report, progress)?;
    report.frames = take.performance.motion.frames();
    report.fps = request.fps;
    report.out = Some(shown(&line.out));
    Ok(done(report, gap, &waveform))
}

/// Makes the folder of a result, because a table names folders that nobody has made yet.
fn create_folder_of(out: &Path) -> Result<()> {
    match out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => fs::create_dir_all(folder).map_err(Error::io(folder)),
        None => Ok(()),
    }
}

/// A performance, its landmarks on the mean face, and the sound beside its scene.
struct Take {
    performance: Performance,
    landmarks: LandmarkClip,
    scene_sound: Option<SceneSound>,
}

/// Refuses a line that does not fit into memory.
fn check_memory(
    line: &Line,
    ready: &Ready,
    (duration_s, fps): (f64, f64),
    report: &mut Report,
) -> Result<()> {
    let frames = frames_of(duration_s, fps);
    let face = ready.face.as_ref();
    let vertices = face.map_or(0, |face| face.mesh.positions.len());
    let frames_in_memory = match (line.is_table(), Format::from_path(&line.out)) {
        (false, Ok(format)) if format.is_scene() => {
            3 * frames + line.options.scene.count_shape_frames(&line.out)
        }
        (false, _) if vertices > 0 => frames,
        _ => 0,
    };
    note_memory(
        report,
        &ready.engine,
        vertices,
        frames_in_memory,
        duration_s,
    )
}

/// Writes the result. Returns the gap between the lips in it.
fn write(
    line: &Line,
    ready: &Ready,
    take: &Take,
    report: &mut Report,
    progress: ProgressFn<'_>,
) -> Result<Gap> {
    let (engine, out) = (&*ready.engine, &line.out);
    let Take {
        performance,
        landmarks,
        scene_sound,
    } = take;
    let mut gap = gap_of(landmarks);
    let fps = performance.motion.fps();
    let (life, articulation) = (Some(&performance.life), performance.articulation());
    match (&ready.face, &ready.weights) {
        (Some(face), Some(weights)) if line.is_table() => {
            let clip = engine.weights_on(face, weights, performance, progress)?;
            gap.values = weights.lip_gap_mm(&clip.weights);
            note_landmarks(report, landmarks, articulation);
            write_blend_weights(out, &SolvedWeights::exact(clip.names, clip.weights), fps)?;
        }
        (Some(face), _) => {
            let sound = scene_sound.as_ref().map(|sound| &*sound.path);
            let beside = (ready.mesh.as_deref(), sound);
            let scene = &line.options.scene;
            let file = scene.file(out, beside, (engine, face), progress)?;
            let spread =
                |sink: &mut dyn FrameSink| engine.spread(face, performance, sink, progress);
            spread_into(file, face, fps, articulation, life, report, spread)?;
            if let Some(sound) = scene_sound {
                sound.copy(&line.audio)?;
                report.warnings.extend(sound.warning.clone());
            }
        }
        (None, _) => {
            let is_weights = matches!(performance.motion, Motion::Weights(_));
            let frames = performance.motion.frames();
            let mut file = MotionFile::new(out, is_weights, frames, fps)?;
            file.add(&performance.motion, landmarks, life)?;
            note_landmarks(report, landmarks, articulation);
            file.finish()?;
        }
    }
    Ok(gap)
}

fn done(report: Report, mut gap: Gap, waveform: &Waveform) -> Done {
    let lips = LipMotion::of(&gap, waveform);
    // The page draws the curve, for which a tenth of a millimetre is enough.
    gap.values
        .iter_mut()
        .for_each(|mm| *mm = (10.0 * *mm).round() / 10.0);
    Done {
        report,
        lips,
        gap,
        wave: peaks(waveform),
    }
}

fn note_landmarks(report: &mut Report, landmarks: &LandmarkClip, articulation: f32) {
    let extent = Extent::of(None, landmarks.displacements.view());
    report.note_motion(&extent, 1.0, articulation);
}

/// The gap between the inner lips on the mean face.
fn gap_of(landmarks: &LandmarkClip) -> Gap {
    let of_frame = |frame: ndarray::ArrayView2<'_, f32>| {
        let gaps = INNER_LIPS.map(|(upper, lower)| frame[[upper, 1]] - frame[[lower, 1]]);
        1e3 * gaps.iter().sum::<f32>() / gaps.len() as f32
    };
    Gap {
        fps: landmarks.fps,
        values: landmarks.displacements.outer_iter().map(of_frame).collect(),
    }
}
