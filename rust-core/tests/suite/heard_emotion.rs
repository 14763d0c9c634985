//! The ear hears emotion and invents none: neutral strangers stay still, and acted emotion shows.

use std::{path::PathBuf, sync::Arc};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest,
    audio::Waveform,
    conditions::{Controls, EMOTIONS, EmotionCurve},
    job::SILENT,
    motion::Motion,
    speech::{NeutralVoice, VoiceTrack, WhisperEar},
};
use ndarray::{Array2, Axis};

/// People see an emotion from this intensity on.
const SEEN: f32 = 0.2;
/// The emotions that the letters in the names of emodb_de's recordings stand for.
const LETTERS: [(char, &str); 6] = [
    ('W', "angry"),
    ('F', "happy"),
    ('A', "afraid"),
    ('T', "sad"),
    ('E', "disgusted"),
    ('L', "calm"),
];

/// Recordings of the data folder whose names `accepts` lets through, every `step`-th of them.
fn recordings(folder: &str, step: usize, accepts: impl Fn(&str) -> bool) -> Vec<Waveform> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, Into::into);
    let files = std::fs::read_dir(shared.join("data").join(folder)).unwrap();
    let mut files: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    let is_sound = |path: &PathBuf| {
        path.extension()
            .is_some_and(|kind| kind == "ogg" || kind == "wav")
    };
    files.retain(|path| is_sound(path) && accepts(path.file_stem().unwrap().to_str().unwrap()));
    files.sort();
    let chosen = files.iter().step_by(step);
    chosen
        .map(|path| Waveform::from_file(path).unwrap())
        .collect()
}

/// The largest intensity of any moment, and the strongest emotion overall.
fn heard(ear: &WhisperEar, sound: &Waveform) -> (f32, &'static str) {
    heard_beside(ear, sound, None)
}

fn heard_beside(
    ear: &WhisperEar,
    sound: &Waveform,
    neutral: Option<&NeutralVoice>,
) -> (f32, &'static str) {
    let frames = (sound.duration_s() * 10.0) as usize;
    let track = ear
        .heard(&VoiceTrack::of(sound), neutral, SILENT)
        .unwrap()
        .curve()
        .sample(frames, 10.0);
    let strongest = track.column(15).fold(0.0f32, |most, x| most.max(*x));
    let total = |e: usize| -> f32 {
        let frames = track.outer_iter();
        frames.map(|frame| frame[e] * frame[15]).sum()
    };
    let most = (1..EMOTIONS.len()).max_by(|a, b| total(*a).total_cmp(&total(*b)));
    (strongest, EMOTIONS[most.unwrap()])
}

#[test]
#[ignore = "needs ../shared"]
fn neutral_strangers_are_given_no_emotion() {
    let ear = WhisperEar::open(None).unwrap();
    // None of these was in the training data: separate clips, a separate language, separate
    // readers.
    for (folder, step) in [
        ("motion/grid_s1/audio", 30),
        ("speech/nathalie_nl", 40),
        ("clips/librivox", 1),
    ] {
        let sounds = recordings(folder, step, |_| true);
        let shown = sounds
            .iter()
            .filter(|sound| heard(&ear, sound).0 > SEEN)
            .count();
        assert!(sounds.len() >= 5);
        assert!(
            shown * 20 <= sounds.len(),
            "{folder}: {shown} of {}",
            sounds.len()
        );
    }
}

#[test]
#[ignore = "needs ../shared"]
fn actors_who_were_never_heard_are_shown_as_they_feel() {
    let ear = WhisperEar::open(None).unwrap();
    let of = |(letter, name): &(char, &str)| {
        let is_his = |file: &str| {
            let is_kept = file.starts_with("09") || file.starts_with("12");
            is_kept && file[5..].starts_with(*letter)
        };
        let sounds = recordings("speech/emodb_de", 1, is_his);
        let right = sounds.iter().filter(|sound| {
            let (strongest, most) = heard(&ear, sound);
            strongest > SEEN && most == *name
        });
        (right.count(), sounds.len())
    };
    let counts: Vec<_> = LETTERS.iter().map(of).collect();
    let (right, all) = counts
        .iter()
        .fold((0, 0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
    assert!(all >= 50 && 20 * right >= 9 * all, "{counts:?}");
}

#[test]
#[ignore = "needs ../shared"]
fn a_low_voice_is_no_emotion() {
    let ear = WhisperEar::open(None).unwrap();
    let lower = |sound: &Waveform| {
        let count = sound.samples.len() * 5 / 4;
        let at = |i: usize| {
            let place = i as f32 * 0.8;
            let (k, share) = (place as usize, place.fract());
            let next = sound.samples.get(k + 1).unwrap_or(&sound.samples[k]);
            sound.samples[k] * (1.0 - share) + next * share
        };
        Waveform {
            samples: (0..count - 1).map(at).collect(),
        }
    };
    let readings = recordings("motion/grid_s1/audio", 60, |_| true);
    for (readings, is_low) in [
        (readings.iter().map(lower).collect::<Vec<_>>(), true),
        (readings, false),
    ] {
        let (judged, others) = readings.split_at(readings.len() / 2);
        let samples = others
            .iter()
            .flat_map(|sound| sound.samples.iter().copied());
        let speech = Waveform {
            samples: samples.collect(),
        };
        let neutral = ear
            .neutral_voice(&VoiceTrack::neutral(&speech).unwrap(), SILENT)
            .unwrap();
        let shown = |neutral: Option<&NeutralVoice>| {
            let shown = |sound: &&Waveform| heard_beside(&ear, sound, neutral).0 > SEEN;
            judged.iter().filter(shown).count()
        };
        assert!(judged.len() >= 5);
        let alone = shown(None);
        assert!(alone <= judged.len() / 5, "low: {is_low}, {alone}");
        assert!(shown(Some(&neutral)) <= judged.len() / 5);
    }
}

#[test]
#[ignore = "needs ../shared"]
fn emoface_feels_nothing_with_a_neutral_stranger() {
    let engine = Engine::new(EngineOptions {
        system: Some("emoface".into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap();
    let performed = |sound: &Waveform, emotion_from: f32| {
        let still = ["blinks_per_minute", "brow_accents", "gaze", "head_motion"];
        let controls = still
            .iter()
            .fold(Controls::default(), |all, name| all.with(name, 0.0));
        let request = MotionRequest {
            controls: controls.with("emotion_from", emotion_from),
            emotion: EmotionCurve::default(),
            ..MotionRequest::default()
        };
        match engine.perform(sound, &request, SILENT).unwrap().motion {
            Motion::Codes(clip) => clip.landmarks.displacements,
            other => panic!("expected codes, got {}", other.kind()),
        }
    };
    let sounds = recordings("motion/grid_s1/audio", 200, |_| true);
    let shifts = sounds.iter().map(|sound| {
        let apart = performed(sound, 0.0) - performed(sound, 2.0);
        1e3 * apart.fold(0.0f32, |most, x| most.max(x.abs()))
    });
    let shifts: Vec<f32> = shifts.collect();
    let moved = shifts.iter().filter(|mm| **mm > 1.5).count();
    assert!(
        shifts.len() >= 5 && moved <= shifts.len() / 5,
        "{shifts:?} mm"
    );
}

#[test]
#[ignore = "needs ../shared"]
fn a_borrowed_emotion_shows_as_strongly_as_the_same_one_by_name() {
    let engine = crate::engine("emoface");
    let line = &recordings("motion/grid_s1/audio", 1000, |_| true)[0];
    let still = ["blinks_per_minute", "brow_accents", "variety"];
    let controls = still
        .iter()
        .fold(Controls::default(), |all, name| all.with(name, 0.0));
    let calm = MotionRequest {
        controls,
        ..MotionRequest::default()
    };
    // The mean face over the line, and the performance.
    let performed = |request: &MotionRequest| {
        let performance = engine.perform(line, request, SILENT).unwrap();
        let Motion::Codes(clip) = &performance.motion else {
            panic!("expected codes")
        };
        let face = clip.landmarks.displacements.mean_axis(Axis(0)).unwrap();
        (face, performance)
    };
    let off = MotionRequest {
        controls: calm.controls.with("emotion_from", 2.0),
        ..calm.clone()
    };
    let (rest, _) = performed(&off);
    let size = |face: &Array2<f32>| {
        let moved = face - &rest;
        1e3 * (&moved * &moved).sum().sqrt()
    };
    let borrowed = |sound: &Waveform| {
        performed(&MotionRequest {
            emotion_of: Some(Arc::new(VoiceTrack::checked(sound).unwrap())),
            ..calm.clone()
        })
    };
    let mut shares = Vec::new();
    for letter in ['W', 'F', 'T'] {
        let is_his = |file: &str| file.starts_with("09") && file[5..].starts_with(letter);
        for sound in recordings("speech/emodb_de", 3, is_his) {
            let (face, performance) = borrowed(&sound);
            let heard = performance.heard_emotion().unwrap();
            let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
            let emotions = heard
                .probability
                .iter()
                .filter(|(name, _)| *name != "neutral");
            let likeliest = emotions.max_by(|a, b| mean(a.1).total_cmp(&mean(b.1)));
            let (name, intensity) = (likeliest.unwrap().0, mean(&heard.intensity));
            let by_name = MotionRequest {
                emotion: EmotionCurve::parse(&format!("{name}:{intensity}")).unwrap(),
                ..calm.clone()
            };
            shares.push(size(&face) / size(&performed(&by_name).0));
        }
    }
    shares.sort_by(f32::total_cmp);
    assert!(shares.len() >= 6, "{shares:?}");
    assert!(shares[shares.len() / 2] > 0.9, "{shares:?}");
    let neutral = recordings("speech/emodb_de", 2, |file| {
        file.starts_with("09") && file[5..].starts_with('N')
    });
    let mut moved: Vec<f32> = neutral
        .iter()
        .map(|sound| size(&borrowed(sound).0))
        .collect();
    moved.sort_by(f32::total_cmp);
    assert!(moved[moved.len() / 2] < 1.0, "{moved:?} mm");
}
