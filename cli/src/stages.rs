//! The stages that subcommands consist of. The report gets the time of each.

use std::{
    path::Path,
    time::{Duration, Instant},
};

use anyface::{
    Engine, Face, MotionRequest, Part, Result,
    audio::SoundFile,
    face::Lids,
    job::ProgressFn,
    mesh::{Mouth, ibug::REGIONS},
    motion::{Extent, Life},
    output::{ClipFile, MeshTargets, Report, warnings_of_sound},
    speech::{HeardEmotion, frames_of},
    spread::{ClipStart, FrameBlock, FrameSink, SpreadReport},
};

use crate::arguments::SoundArgs;

/// Mean confidence of a region's landmarks below which the user should look at them.
const DOUBTFUL: f32 = 0.4;

/// An empty report of this version.
pub fn new_report() -> Report {
    Report {
        version: env!("CARGO_PKG_VERSION").into(),
        ..Report::default()
    }
}

/// Runs one stage and adds its time to the report.
pub fn timed<T>(report: &mut Report, stage: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let start = Instant::now();
    let result = work();
    note(report, stage, start.elapsed());
    result
}

fn note(report: &mut Report, stage: &str, spent: Duration) {
    *report.seconds.entry(stage.into()).or_default() += spent.as_secs_f64();
}

/// Decodes the sound. Notes its length and warns about its faults.
pub fn read_sound(
    report: &mut Report,
    path: &Path,
    how: &SoundArgs,
    progress: ProgressFn<'_>,
) -> Result<SoundFile> {
    let file = timed(report, "read", || how.read(path, progress))?;
    report.audio_s = Some(file.levels.duration_s());
    report.missing_audio_s = file.damage.map(|damage| damage.missing_s);
    let damage = file.damage.map(|damage| damage.sentence());
    report.warnings.extend(damage);
    report.warnings.extend(how.track_note(&file));
    report.warnings.extend(warnings_of_sound(&file.levels));
    Ok(file)
}

/// Appends the emotion heard in a part to that of the earlier parts.
pub fn add_heard(all: &mut Option<HeardEmotion>, part: Option<HeardEmotion>) {
    if let Some(part) = part {
        all.get_or_insert_default().extend(part);
    }
}

/// Notes how much memory a job will need, before it starts. The mesh has `vertices` vertices, `frames` frames of it are in
/// memory at once, and `sound_s` seconds of sound are performed at once.
///
/// # Errors
/// `OutOfMemory` if it does not fit.
pub fn note_memory(
    report: &mut Report,
    engine: &Engine,
    vertices: usize,
    frames: usize,
    sound_s: f64,
) -> Result<()> {
    let need = engine.memory_need(vertices, frames, sound_s);
    report.memory_mb = Some(need.bytes() >> 20);
    report.warnings.extend(need.check()?);
    Ok(())
}

/// Notes the confidence of the landmarks, and warns about regions where it is low.
fn note_landmarks(report: &mut Report, confidence: &[f32; 68]) {
    let least = confidence.iter().copied().fold(f32::INFINITY, f32::min);
    let mean = confidence.iter().sum::<f32>() / confidence.len() as f32;
    report.landmark_confidence = Some([least, mean]);
    let doubtful: Vec<String> = REGIONS
        .into_iter()
        .map(|(name, indices)| {
            let sum: f32 = confidence[indices.clone()].iter().sum();
            (name, sum / indices.len() as f32)
        })
        .filter(|(_, mean)| *mean < DOUBTFUL)
        .map(|(name, mean)| format!("{name} {mean:.2}"))
        .collect();
    if !doubtful.is_empty() {
        report.warnings.push(format!(
            "landmarks are uncertain (confidence of {}); check them with `anyface landmarks`, or \
             give them with --landmarks",
            doubtful.join(", ")
        ));
    }
}

/// Notes how the lips meet, and warns if they are welded.
fn note_mouth(report: &mut Report, mouth: Mouth) {
    report.mouth = Some(mouth.name().into());
    if mouth == Mouth::Welded {
        report.warnings.push(mouth.sentence().into());
    }
}

/// A sink that measures the time that another sink takes.
struct TimedSink<S> {
    inner: S,
    spent: Duration,
}

impl<S: FrameSink> TimedSink<S> {
    fn new(inner: S) -> Self {
        TimedSink {
            inner,
            spent: Duration::ZERO,
        }
    }

    fn timed<T>(&mut self, work: impl FnOnce(&mut S) -> T) -> T {
        let start = Instant::now();
        let result = work(&mut self.inner);
        self.spent += start.elapsed();
        result
    }
}

impl<S: FrameSink> FrameSink for TimedSink<S> {
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()> {
        self.timed(|sink| sink.begin(start))
    }

    fn frames_at_once(&self, start: &ClipStart<'_>) -> usize {
        self.inner.frames_at_once(start)
    }

    fn take(&mut self, block: FrameBlock) -> Result<()> {
        self.timed(|sink| sink.take(block))
    }

    fn finish(&mut self, progress: ProgressFn<'_>) -> Result<()> {
        self.timed(|sink| sink.finish(progress))
    }
}

/// Runs `spread` into a file. Notes in the report what it did and how long it took. `articulation` is the requested
/// articulation of the lips, and `life` is written beside the frames.
pub fn spread_into(
    file: ClipFile,
    face: &Face,
    fps: f64,
    articulation: f32,
    life: Option<&Life>,
    report: &mut Report,
    spread: impl FnOnce(&mut dyn FrameSink) -> Result<SpreadReport>,
) -> Result<()> {
    let started = Instant::now();
    let (path, targets) = (file.path().to_owned(), file.mesh_targets());
    let mut sink = TimedSink::new(file);
    life.into_iter().for_each(|life| sink.inner.add_life(life));
    let spread_report = spread(&mut sink)?;
    note(report, "write", sink.spent);
    note(
        report,
        "deform",
        started.elapsed().saturating_sub(sink.spent),
    );
    let mut result = Frames::default();
    result.add(spread_report);
    note_result(report, &path, face, fps, articulation, result);
    note_targets(report, targets.as_deref());
    Ok(())
}

/// Writes the speech of a face to a file. A long sound is performed one stretch after the other.
pub fn speak_into(
    file: ClipFile,
    (engine, face): (&Engine, &Face),
    sound: SoundFile,
    request: &MotionRequest,
    report: &mut Report,
    progress: ProgressFn<'_>,
) -> Result<()> {
    let started = Instant::now();
    let (path, targets) = (file.path().to_owned(), file.mesh_targets());
    let mut sink = TimedSink::new(file);
    let (mut result, mut on_face) = (Frames::default(), Duration::ZERO);
    sink.begin(&ClipStart {
        mesh: &face.mesh,
        landmarks: &face.landmarks.positions,
        frames: frames_of(sound.levels.duration_s(), request.fps),
        fps: request.fps,
    })?;
    let mut spread = |part: Part, progress: ProgressFn<'_>| {
        let started = Instant::now();
        result.add(engine.spread_part(face, &part, &mut sink, progress)?);
        sink.inner.add_life(&part.life);
        add_heard(&mut report.heard_emotion, part.heard_emotion);
        on_face += started.elapsed();
        Ok(())
    };
    engine.perform_in_parts(sound, request, &mut spread, progress)?;
    let motion = started.elapsed().saturating_sub(on_face);
    note(report, "motion", motion);
    note(report, "deform", on_face.saturating_sub(sink.spent));
    sink.finish(progress)?;
    note(report, "write", sink.spent);
    let articulation = request.articulation();
    note_result(report, &path, face, request.fps, articulation, result);
    note_targets(report, targets.as_deref());
    Ok(())
}

/// The targets of a file show too little of the mouth's motion below this share.
const LEAST_SHARE: f32 = 0.5;

/// Notes which targets of the file a take drives, and warns about what they cannot show.
pub fn note_targets(report: &mut Report, targets: Option<&MeshTargets>) {
    let Some((targets, target_report)) = targets.and_then(|t| Some((t, t.report()?))) else {
        return;
    };
    report.warnings.extend(targets.notes().iter().cloned());
    if !target_report.empty.is_empty() {
        report.warnings.push(format!(
            "targets that move nothing count as none: {}",
            target_report.empty.join(", ")
        ));
    }
    if target_report.share_of_mouth < LEAST_SHARE {
        report.warnings.push(format!(
            "the targets of the file show {:.0} % of the mouth's motion; --targets arkit adds the ARKit shapes that it \
             lacks",
            100.0 * target_report.share_of_mouth
        ));
    }
    report.targets = Some(target_report);
}

/// Count, extent and notes of the frames that were written.
#[derive(Default)]
pub struct Frames {
    count: usize,
    extent: Extent,
    notes: Vec<String>,
}

impl Frames {
    /// Adds the frames of the next part.
    pub fn add(&mut self, part: SpreadReport) {
        let landmarks = part.landmarks.view();
        self.count += part.landmarks.dim().0;
        self.extent = self.extent.with(Extent::of(Some(part.largest), landmarks));
        self.notes = part.notes;
    }
}

/// Notes what was written to `path`.
pub fn note_result(
    report: &mut Report,
    path: &Path,
    face: &Face,
    fps: f64,
    articulation: f32,
    frames: Frames,
) {
    report.note_motion(&frames.extent, face.metres_per_unit(), articulation);
    report.warnings.extend(frames.notes);
    report.out = Some(path.display().to_string());
    report.frames = frames.count;
    report.fps = fps;
    report.vertices = Some(face.mesh.positions.len());
}

/// Notes facts and warnings about a face: landmark confidence, mouth, rest pose and eyes.
pub fn note_face(report: &mut Report, face: &Face) {
    note_landmarks(report, &face.landmarks.confidence);
    note_mouth(report, face.mouth());
    report.warnings.extend(face.at_rest());
    note_head(report, face);
    report.warnings.extend(lids_sentence(face));
}

/// Notes which head was taken, and names others of the file.
fn note_head(report: &mut Report, face: &Face) {
    let (chosen, others) = (face.options.head.is_some(), face.other_heads());
    let Some(head) = face.head().filter(|_| chosen || !others.is_empty()) else {
        return;
    };
    report.head = Some(head.to_owned());
    if let (false, [first, ..]) = (chosen, &others[..]) {
        report.warnings.push(format!(
            "the face of {head} was taken; the file may have other heads ({}): --head {first} takes another",
            others.join(", ")
        ));
    }
}

/// Says which eyes do not blink and why. `None` if both blink.
pub fn lids_sentence(face: &Face) -> Option<String> {
    let [right, left] = face.lids();
    let cut = if [right, left].contains(&Lids::Joined) {
        "; anyface open-eyes cuts lids and eyes apart"
    } else {
        ""
    };
    let why = |lids: Lids, many: bool| match (lids, many) {
        (Lids::Close, _) => None,
        (Lids::Shut, true) => Some("are sculpted shut"),
        (Lids::Shut, false) => Some("is sculpted shut"),
        (Lids::Joined, true) => Some("have no slit between their lids"),
        (Lids::Joined, false) => Some("has no slit between its lids"),
    };
    let of = |which: &str, lids: Lids, many: bool| {
        let why = why(lids, many)?;
        Some(format!(
            "{which} {why}: brows squint where lids would blink{cut}"
        ))
    };
    if right == left {
        of("both eyes", right, true)
    } else {
        let each = [
            of("the right eye", right, false),
            of("the left eye", left, false),
        ];
        let each: Vec<String> = each.into_iter().flatten().collect();
        Some(each.join("; ")).filter(|text| !text.is_empty())
    }
}

/// Least probability of an emotion that gets a line in the summary.
const LIKELY: f64 = 0.25;
/// A face that shows less than this share shows nothing that anybody sees.
const LITTLE: f64 = 0.05;
/// Characters that draw a line of the summary, from low to high.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// The most characters in such a line.
const LINE: usize = 40;

/// One line for each likely emotion: its probability over time, and the time of its peak.
fn heard_lines(heard: &HeardEmotion) -> Vec<String> {
    let mut lines: Vec<(f64, String)> = Vec::new();
    for (name, of) in &heard.probability {
        let most = of.iter().copied().fold(0.0, f64::max);
        if most < LIKELY {
            continue;
        }
        let letters = LINE.min(of.len());
        let bar = |k: usize| {
            let part = &of[k * of.len() / letters..(k + 1) * of.len() / letters];
            let mean = part.iter().sum::<f64>() / part.len() as f64;
            BARS[((mean * BARS.len() as f64) as usize).min(BARS.len() - 1)]
        };
        let at = of.iter().position(|x| *x == most).unwrap_or(0);
        let line: String = (0..letters).map(bar).collect();
        let time_s = heard.time_s[at];
        lines.push((
            most,
            format!("  heard {name:<10} {line}  at most {most:.2}, at {time_s:.1} s"),
        ));
    }
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut lines: Vec<String> = lines.into_iter().map(|(_, line)| line).collect();
    let shown = heard.intensity.iter().copied().fold(0.0, f64::max);
    lines.push(if shown < LITTLE {
        "  nothing of it is sure enough to show: the voice is heard as neutral".into()
    } else {
        format!(
            "  the face shows up to {:.0} % of what is heard",
            100.0 * shown
        )
    });
    lines
}

/// A few lines for people: what was written, and the emotion that was heard.
pub fn summary(report: &Report) -> String {
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
    text += &format!(", in {total:.2} s");
    if let Some(targets) = &report.targets {
        text += &format!(
            "\n  drives {} targets ({}): {}; they show {:.0} % of the mouth's motion",
            targets.names.len(),
            targets.tool,
            targets.names.join(", "),
            100.0 * targets.share_of_mouth
        );
    }
    let heard = report
        .heard_emotion
        .as_ref()
        .filter(|heard| !heard.time_s.is_empty());
    for line in heard.map(heard_lines).unwrap_or_default() {
        text += "\n";
        text += &line;
    }
    text
}
