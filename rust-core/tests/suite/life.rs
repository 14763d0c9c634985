//! Tests how head, eyes and tongue move in a performance, and how takes differ.

use anyface::{
    Engine, MotionRequest, Performance,
    audio::Waveform,
    conditions::{ControlCurve, EmotionCurve},
    job::SILENT,
    motion::{Life, PerformanceControls},
};
use ndarray::{Axis, s};

use crate::{head::engine, voice::babble};

/// 5th and 95th percentiles of the deviation of pitch over the clips of grid_s1, degrees.
const TRACKED_PITCH_DEG: (f32, f32) = (0.40, 1.13);
/// How far a nod on a strong stress may go, degrees.
const MAX_DEG: f32 = 8.0;

fn spoken(engine: &Engine, controls: &PerformanceControls, seed: u64) -> Performance {
    let waveform = Waveform {
        samples: babble(2.0, 16_000),
    };
    let request = MotionRequest {
        seed,
        controls: (*controls).into(),
        ..MotionRequest::default()
    };
    engine.perform(&waveform, &request, SILENT).unwrap()
}

#[test]
fn no_strength_is_stillness_and_leaves_every_landmark() {
    let engine = engine();
    let still = PerformanceControls::as_sampled();
    let plain = spoken(&engine, &still, 1);
    assert_eq!(plain.life, Life::still(60));
    let head = PerformanceControls {
        head_motion: 1.0,
        ..still
    };
    let nodding = spoken(&engine, &head, 1);
    assert_eq!(nodding.motion, plain.motion);
    assert!(nodding.life.head.iter().any(|x| *x != 0.0));
    assert!(nodding.life.gaze.iter().all(|x| *x == 0.0));
    let tongue = PerformanceControls {
        tongue: 1.0,
        ..still
    };
    let speaking = spoken(&engine, &tongue, 1);
    assert_eq!(speaking.motion, plain.motion);
    assert_eq!(
        (&speaking.life.head, &speaking.life.gaze),
        (&plain.life.head, &plain.life.gaze)
    );
    let tongue = &speaking.life.tongue;
    assert!(tongue.iter().all(|x| (0.0..=1.0).contains(x)) && tongue.iter().any(|x| *x > 0.0));
    let gaze = PerformanceControls { gaze: 1.0, ..still };
    let looking = spoken(&engine, &gaze, 1);
    let moved = &looking.motion.values() - &plain.motion.values();
    for (n, track) in moved.axis_iter(Axis(1)).enumerate() {
        let is_lid = (36..48).contains(&n);
        assert!(is_lid || track.iter().all(|x| *x == 0.0), "landmark {n}");
    }
    let up = looking.life.gaze.slice(s![.., 0, 1]);
    let lids = moved.slice(s![.., 37, 1]);
    for (pitch, lid) in up.iter().zip(lids) {
        assert!(pitch * lid >= 0.0, "lids go with the eyes: {pitch} {lid}");
    }
    let still = Life::still(60);
    let off = MotionRequest {
        emotion: EmotionCurve::Off,
        ..MotionRequest::default()
    };
    let speech_alone = looking.again(&engine, &off).unwrap();
    assert_eq!(
        (speech_alone.life.head, speech_alone.life.gaze),
        (still.head, still.gaze)
    );
}

#[test]
fn the_tongue_obeys_articulation_and_its_own_strength() {
    let engine = engine();
    let at = |articulation: f32, tongue: f32| {
        let controls = PerformanceControls {
            articulation,
            tongue,
            ..PerformanceControls::default()
        };
        spoken(&engine, &controls, 1).life.tongue
    };
    let whole = at(1.0, 1.0);
    assert!(whole.iter().any(|x| *x > 0.2));
    for still in [at(0.0, 1.0), at(1.0, 0.0), at(0.0, 2.0)] {
        assert!(still.iter().all(|x| *x == 0.0));
    }
    assert_eq!(at(0.5, 1.0), 0.5 * &whole);
    assert_eq!(at(0.5, 1.0), at(1.0, 0.5));
    // Beyond 1 the tongue comes nearer to contact and never goes farther away.
    for (more, heard) in at(2.0, 1.0).iter().zip(&whole) {
        let range = heard - 1e-6..=(2.0 * heard).min(1.0) + 1e-6;
        assert!(range.contains(more), "{more} for {heard}");
    }
    let mut request = MotionRequest {
        seed: 1,
        controls: PerformanceControls::default().into(),
        ..MotionRequest::default()
    };
    let keys = vec![(0.0, 0.0), (1.0, 0.0), (1.001, 1.0)];
    let curve = ControlCurve { value: 1.0, keys };
    request.controls.set_curve("articulation", curve);
    let later = spoken(&engine, &PerformanceControls::default(), 1)
        .again(&engine, &request)
        .unwrap()
        .life
        .tongue;
    assert!(later.slice(s![..=30, ..]).iter().all(|x| *x == 0.0));
    assert_eq!(later.slice(s![31.., ..]), whole.slice(s![31.., ..]));
}

#[test]
fn strengths_that_change_scale_the_tracks_where_they_stand() {
    let engine = engine();
    let whole = spoken(&engine, &PerformanceControls::default(), 3);
    let mut request = MotionRequest {
        seed: 3,
        ..MotionRequest::default()
    };
    let keys = vec![(0.5, 0.0), (1.5, 2.0)];
    let curve = ControlCurve { value: 1.0, keys };
    request.controls.set_curve("head_motion", curve);
    let keyed = whole.again(&engine, &request).unwrap();
    for (t, factor) in [(0, 0.0), (15, 0.0), (30, 1.0), (45, 2.0), (59, 2.0)] {
        let expected = whole.life.head.row(t).mapv(|x| factor * x);
        assert_eq!(keyed.life.head.row(t), expected, "frame {t}");
    }
    let other = spoken(&engine, &PerformanceControls::default(), 4);
    assert_ne!(other.life, whole.life);
}

/// Recordings of whole sentences in `../shared`, at most six of each voice.
fn recordings() -> Vec<Waveform> {
    let shared = std::env::var("ANYFACE_SHARED").unwrap_or_else(|_| "../../shared".into());
    let folder = std::path::Path::new(&shared).join("data/speech");
    let mut out = Vec::new();
    for voice in ["kathleen_en", "nathalie_nl", "kerstin_de", "picovoice_en"] {
        let mut files = Vec::new();
        sounds(&folder.join(voice), &mut files);
        files.sort();
        let step = (files.len() / 6).max(1);
        let some = files.iter().step_by(step).take(6);
        out.extend(some.map(|path| Waveform::from_file(path).unwrap()));
    }
    out
}

fn sounds(folder: &std::path::Path, out: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("../shared/data/speech") {
        let path = entry.unwrap().path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("ogg" | "wav" | "flac") => out.push(path),
            None if path.is_dir() => sounds(&path, out),
            _ => {}
        }
    }
}

#[test]
#[ignore = "needs ../shared"]
fn heads_of_real_speech_move_as_the_tracked_one_and_never_farther() {
    let engine = engine();
    let mut deviations = Vec::new();
    for waveform in recordings() {
        let request = MotionRequest::default();
        let life = engine.perform(&waveform, &request, SILENT).unwrap().life;
        let pitch = life.head.column(0).mapv(f32::to_degrees);
        deviations.push(pitch.std(0.0));
        assert!(life.head.iter().all(|x| x.to_degrees().abs() < MAX_DEG));
        assert!(life.gaze.iter().all(|x| x.to_degrees().abs() < 25.0));
    }
    deviations.sort_by(f32::total_cmp);
    let (low, high) = TRACKED_PITCH_DEG;
    let inside = deviations.iter().filter(|sd| (low..high).contains(sd));
    let (count, all) = (inside.count(), deviations.len());
    assert!(all >= 20 && 10 * count >= 9 * all, "{deviations:?}");
}
