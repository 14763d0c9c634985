//! Tests the stream that makes weights while somebody is speaking.

use anyface::{
    conditions::Emotion,
    motion::{WeightFrame, WeightStream},
    rig::{ARKIT, VISEMES},
};

use crate::{
    head::engine,
    voice::{babble, intoned},
};

/// A stream that every sound moves.
fn stream() -> WeightStream {
    let mut stream = engine().weight_stream().unwrap();
    stream.hear_all();
    stream
}

fn frames(cuts: usize, emotion: Option<&Emotion>) -> Vec<WeightFrame> {
    frames_of(&babble(4.0, 16_000), cuts, emotion)
}

fn frames_of(sound: &[f32], cuts: usize, emotion: Option<&Emotion>) -> Vec<WeightFrame> {
    let mut stream = stream();
    if let Some(emotion) = emotion {
        stream.set_emotion(emotion).unwrap();
    }
    let mut frames = Vec::new();
    for chunk in sound.chunks(cuts) {
        stream.push(chunk).unwrap();
        frames.extend(ready(&mut stream));
    }
    stream.finish().unwrap();
    frames.extend(ready(&mut stream));
    frames
}

fn ready(stream: &mut WeightStream) -> impl Iterator<Item = WeightFrame> {
    std::iter::from_fn(|| stream.pull())
}

fn shape(frame: &WeightFrame, name: &str) -> f32 {
    frame.shapes[ARKIT.iter().position(|known| *known == name).unwrap()]
}

#[test]
fn weights_do_not_depend_on_how_the_sound_was_cut() {
    let whole = frames(usize::MAX, None);
    assert_eq!(whole.len(), 100);
    for cuts in [160, 1001] {
        assert_eq!(frames(cuts, None), whole, "{cuts} samples a push");
    }
}

#[test]
fn an_emotion_is_heard_alike_however_the_sound_was_cut_until_one_is_set() {
    let heard = |cuts: usize| {
        let mut stream = stream();
        stream.hear_emotion();
        let mut frames = Vec::new();
        for chunk in babble(4.0, 16_000).chunks(cuts) {
            stream.push(chunk).unwrap();
            frames.extend(ready(&mut stream));
        }
        frames
    };
    let whole = heard(usize::MAX);
    assert!(
        whole[..15]
            .iter()
            .all(|frame| frame.emotion.intensity == 0.0)
    );
    for cuts in [160, 1001] {
        assert_eq!(heard(cuts), whole, "{cuts} samples a push");
    }
    let mut stream = stream();
    stream.hear_emotion();
    let happy = Emotion::parse("happy:1").unwrap();
    stream.set_emotion(&happy).unwrap();
    stream.push(&babble(1.0, 16_000)).unwrap();
    assert_eq!(stream.pull().unwrap().emotion, happy);
}

#[test]
fn a_voice_opens_the_jaw_and_silence_is_silence() {
    let frames = frames(4000, None);
    let jaw = |frame: &WeightFrame| shape(frame, "jawOpen");
    let widest = frames.iter().map(jaw).fold(0.0, f32::max);
    assert!(widest > 0.1, "{widest}");
    let silence = VISEMES
        .iter()
        .position(|name| *name == "viseme_sil")
        .unwrap();
    for frame in &frames {
        let weights = frame.shapes.iter().chain(&frame.visemes);
        assert!(
            weights.clone().all(|w| (0.0..=1.0).contains(w)),
            "{frame:?}"
        );
        let said: f32 = frame.visemes.iter().sum();
        assert!(said >= 0.999, "{frame:?}");
    }
    let silent = frames_of(&[0.0; 8 * 16_000], 4000, None);
    for frame in &silent {
        assert!(frame.visemes[silence] > 0.7, "{:?}", frame.visemes);
    }
    // The eyes stay open for 6.1 s at most.
    let shut = |frame: &&WeightFrame| shape(frame, "eyeBlinkLeft") > 0.6;
    assert!(
        silent.iter().filter(shut).count() > 0,
        "nobody stares for eight seconds"
    );
}

/// Three chords, each of three notes that fade.
fn music() -> Vec<f32> {
    let chords = [
        [220.0, 277.2, 329.6],
        [196.0, 246.9, 293.7],
        [174.6, 220.0, 261.6],
    ];
    let sample = |i: usize| {
        let (t, since) = (i as f32 / 16_000.0, (i % 16_000) as f32 / 16_000.0);
        let note = |hz: &f32| -> f32 {
            let partial =
                |k: u8| (std::f32::consts::TAU * f32::from(k) * hz * t).sin() / f32::from(k);
            (1..9).map(partial).sum()
        };
        let notes: f32 = chords[i / 16_000].iter().map(note).sum();
        0.1 * notes * (since / 0.01).min(1.0) * (-since / 0.8).exp()
    };
    (0..48_000).map(sample).collect()
}

#[test]
fn speech_moves_the_mouth_and_music_and_noise_do_not() {
    let noise: Vec<f32> = (0..48_000u32)
        .map(|i| 0.1 * ((f64::from(i) * 12.9898).sin() * 43_758.55).fract() as f32)
        .collect();
    let widest = |sound: &[f32]| {
        let mut stream = engine().weight_stream().unwrap();
        stream.push(sound).unwrap();
        let frames: Vec<_> = ready(&mut stream).collect();
        let jaws = frames.iter().map(|frame| shape(frame, "jawOpen"));
        jaws.fold(0.0, f32::max)
    };
    let (speech, music, noise) = (
        widest(&intoned(3.0, 16_000)),
        widest(&music()),
        widest(&noise),
    );
    assert!(speech > 0.1, "{speech}");
    assert!(music < 0.01 && noise < 0.01, "{music} {noise}");
}

/// Weights move the mean face like the landmarks from which they come.
#[test]
fn weights_follow_the_landmarks() {
    let engine = engine();
    let mut landmarks = engine.stream().unwrap();
    let sound = babble(4.0, 16_000);
    landmarks.hear_all();
    landmarks.push(&sound).unwrap();
    landmarks.finish().unwrap();
    let truth = landmarks.drain();
    let modes = anyface::motion::FaceModes::open(None).unwrap();
    let shapes = modes.of_shapes(&ARKIT.map(str::to_owned)).unwrap();
    let gap = |of: &dyn Fn(usize) -> f32| 1e3 * (of(62) - of(66));
    let mut off: Vec<f32> = Vec::new();
    for (frame, truth) in frames(usize::MAX, None).iter().zip(&truth) {
        let height = |n: usize| -> f32 {
            let weights = frame.shapes.iter().enumerate();
            weights.map(|(s, w)| w * shapes[[s, n, 1]]).sum()
        };
        off.push((gap(&height) - gap(&|n| truth.displacements[n][1])).abs());
    }
    off.sort_by(f32::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() * 95 / 100]);
    assert!(
        median < 0.5 && most < 1.5,
        "the gap of the lips is {median} and {most} mm off"
    );
}

#[test]
fn an_emotion_by_hand_is_seen_in_the_next_frame() {
    let happy = Emotion::parse("happy:1").unwrap();
    let (plain, smiling) = (frames(4000, None), frames(4000, Some(&happy)));
    let smile = |frames: &[WeightFrame]| -> f32 {
        let smiles = frames.iter().map(|frame| shape(frame, "mouthSmileLeft"));
        smiles.sum::<f32>() / frames.len() as f32
    };
    assert!(
        smile(&smiling) > smile(&plain) + 0.1,
        "{} {}",
        smile(&plain),
        smile(&smiling)
    );
}
