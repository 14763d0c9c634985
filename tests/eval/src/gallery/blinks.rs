//! Close-ups of the eyes, open, half shut and shut, under every emotion.

use ndarray::{Array3, ArrayView2, Axis};

use super::{
    cells::{Cells, View, beside, under},
    subjects::Subject,
};
use crate::{
    metrics::eyeballs_in_sight,
    pictures::raster::Picture,
    vertex_motion::{pose, vertex_motion},
};
use anyface::{
    Engine, Face, Result,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    job::SILENT,
    mesh::PartRole,
    motion::{
        Cues, EmotionOrigin, Expressions, FaceModes, LandmarkClip, Motion, PerformanceControls,
    },
};

pub(crate) const EMOTIONS: [&str; 7] = [
    "neutral",
    "happy",
    "sad",
    "angry",
    "afraid",
    "surprised",
    "disgusted",
];
const FPS: f64 = 30.0;
const FRAMES: usize = 90;
const SAMPLES_PER_S: f64 = 16_000.0;
const BLINKS_PER_MINUTE: f32 = 60.0;
/// Side of a cell in which eyeballs are counted, metres.
const CELL_M: f64 = 2e-4;
const SIZE: (usize, usize) = (220, 90);
const HALF_HEIGHT_M: f32 = 0.023;

/// Blinks of one head.
pub(super) struct Blinks {
    pub picture: Picture,
    /// Visible area of the eyeballs with shut lids, as a share of that at rest, for each emotion.
    /// `None` for a head without eyeballs.
    pub in_sight: Option<Vec<f64>>,
}

/// The names of the emotions as text.
pub(super) fn titles() -> String {
    EMOTIONS.join(", ")
}

pub(super) fn blinks(engine: &Engine, subject: &Subject) -> Result<Blinks> {
    let face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
    let cells = Cells::new(&subject.mesh, &face);
    let view = View::about(&face, 36..48, SIZE, HALF_HEIGHT_M);
    let mut rows: [Vec<Picture>; 3] = Default::default();
    let mut in_sight = Vec::new();
    for emotion in EMOTIONS {
        let motion = extremes(&format!("{emotion}:1"))?;
        let frames = vertex_motion(engine, &face, &motion)?;
        for (row, frame) in rows.iter_mut().zip(frames.outer_iter()) {
            row.push(cells.close_up(Some(frame), &view));
        }
        in_sight.extend(eyeball_share(&face, frames.index_axis(Axis(0), 2)));
    }
    let rows: Vec<Picture> = rows.iter().map(|row| beside(row)).collect();
    Ok(Blinks {
        picture: under(&rows),
        in_sight: (in_sight.len() == EMOTIONS.len()).then_some(in_sight),
    })
}

/// Three frames of a silent face with an emotion: those with its eyes widest open, half shut and
/// shut.
pub(crate) fn extremes(emotion: &str) -> Result<Motion> {
    let clip = blinking(emotion)?;
    let openings = openings(&clip);
    let most = (0..FRAMES).max_by(|a, b| openings[*a].total_cmp(&openings[*b]));
    let open = most.unwrap_or(0);
    let shut = (0..FRAMES).min_by(|a, b| openings[*a].total_cmp(&openings[*b]));
    let shut = shut.unwrap_or(0);
    let middle = 0.5 * (openings[open] + openings[shut]);
    let away = |t: &usize| (openings[*t] - middle).abs();
    let half = (0..FRAMES).min_by(|a, b| away(a).total_cmp(&away(b)));
    let frames = [open, half.unwrap_or(0), shut];
    Ok(Motion::Landmarks(LandmarkClip {
        displacements: clip.displacements.select(Axis(0), &frames),
        fps: FPS,
    }))
}

/// The motion of a silent face with an emotion that blinks often.
fn blinking(emotion: &str) -> Result<LandmarkClip> {
    let affect = EmotionCurve::parse(emotion)?.sample(FRAMES, FPS);
    let expressions = Expressions::open(None)?;
    let silence = vec![0.0; (FRAMES as f64 / FPS * SAMPLES_PER_S) as usize];
    let prosody = Prosody::of(&Waveform { samples: silence });
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions,
        emotion_origin: EmotionOrigin::Added,
        speech_only: false,
        prosody: &prosody,
        seed: 3,
    };
    let still = LandmarkClip {
        displacements: Array3::zeros((FRAMES, 68, 3)),
        fps: FPS,
    };
    let controls = PerformanceControls {
        blinks_per_minute: BLINKS_PER_MINUTE,
        ..PerformanceControls::default()
    };
    FaceModes::open(None)?.apply_controls(&still, &cues, &controls)
}

/// How far the lids move apart in each frame, summed over four pairs of landmarks, metres.
fn openings(clip: &LandmarkClip) -> Vec<f32> {
    let pairs = [(37, 41), (38, 40), (43, 47), (44, 46)];
    let frames = clip.displacements.outer_iter();
    let of = |frame: ArrayView2<'_, f32>| {
        pairs
            .iter()
            .map(|&(u, l)| frame[[u, 1]] - frame[[l, 1]])
            .sum()
    };
    frames.map(of).collect()
}

/// Visible area of the eyeballs in a frame, as a share of that at rest. `None` for a face without
/// eyeballs. The mesh must be upright and face +z, as the heads of a gallery do.
pub(crate) fn eyeball_share(face: &Face, frame: ArrayView2<'_, f32>) -> Option<f64> {
    let of = |role| -> Vec<[u32; 3]> {
        let all = face.mesh.triangles.iter().copied();
        all.filter(|t| face.parts.is(t[0] as usize, role)).collect()
    };
    let (skin, eyeballs) = (of(PartRole::Skin), of(PartRole::Gaze));
    if eyeballs.is_empty() {
        return None;
    }
    let cell = (CELL_M / face.metres_per_unit()) as f32;
    let area = |positions: &[[f32; 3]]| eyeballs_in_sight(positions, &skin, &eyeballs, cell).area;
    Some(area(&pose(&face.mesh, frame).positions) / area(&face.mesh.positions))
}
