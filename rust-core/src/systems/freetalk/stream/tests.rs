//! Tests of FreeTalk's streams. Those of the network are in `speech/causal`.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    audio::Waveform,
    conditions::EmotionCurve,
    job::SILENT,
    motion::{Expressions, FaceModes, stream_whole},
    systems::freetalk::system::STREAM_MODEL,
};

fn built_in() -> Arc<CausalModel> {
    let files = STREAM_MODEL.open(None).unwrap();
    Arc::new(CausalModel::load(&files.weights, &files.config, DIMS).unwrap())
}

fn closures() -> Arc<CausalModel> {
    Arc::new(LiveClosures::open(None).unwrap())
}

/// A stream that every sound moves, because the voice gate would not let the hum pass.
fn of(model: &Arc<CausalModel>) -> CausalStream {
    let (expressions, modes) = (Expressions::open(None), FaceModes::open(None));
    let (expressions, modes) = (Arc::new(expressions.unwrap()), Arc::new(modes.unwrap()));
    let width = WidthGain::new(&modes).unwrap();
    let expression = CausalExpression::new(expressions, modes, model.config().fps).unwrap();
    let mut stream = CausalStream::new(Arc::clone(model), closures(), expression, width);
    stream.hear_all();
    stream
}

/// A voice-like sound that swells and fades.
fn hum(samples: usize) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let sample = |i: usize| {
        let t = i as f32 / 16_000.0;
        let tone = (700.0 * t).sin() + 0.5 * (2900.0 * t).sin() + random.random_range(-0.1..0.1);
        0.3 * tone * (1.0 + (20.0 * t).sin())
    };
    (0..samples).map(sample).collect()
}

fn run_at_once(model: &Arc<CausalModel>, samples: &[f32], emotion: &Emotion) -> Vec<LandmarkFrame> {
    let mut stream = of(model);
    stream.set_emotion(emotion).unwrap();
    stream.push(samples).unwrap();
    stream.finish().unwrap();
    stream.drain()
}

fn all_at_once(model: &Arc<CausalModel>, samples: &[f32]) -> Vec<LandmarkFrame> {
    run_at_once(model, samples, &Emotion::default())
}

#[test]
fn samples_one_by_one_and_all_at_once_give_the_same_bits_with_the_built_in_weights() {
    let model = built_in();
    let samples = hum(16_000);
    let angry = Emotion::parse("angry:1.2").unwrap();
    let mut stream = of(&model);
    stream.set_emotion(&angry).unwrap();
    let mut frames = Vec::new();
    for sample in &samples {
        stream.push(&[*sample]).unwrap();
        frames.extend(stream.pull());
    }
    stream.finish().unwrap();
    frames.extend(stream.drain());
    assert_eq!(frames, run_at_once(&model, &samples, &angry));
}

#[test]
fn a_shorter_look_ahead_is_chosen_before_the_first_sound() {
    let mut stream = of(&built_in());
    let least = stream.look_ahead(-0.01).unwrap_err().to_string();
    assert!(least.contains("0 s or more"), "{least}");
    for (seconds, latency_s) in [(1.0, 0.1925), (0.1, 0.0725), (0.0, 0.0)] {
        stream.look_ahead(seconds).unwrap();
        assert_eq!(stream.latency_s(), latency_s);
    }
    stream.push(&hum(641)).unwrap();
    assert!(stream.pull().is_some());
    let late = stream.look_ahead(0.1).unwrap_err().to_string();
    assert!(late.contains("before the first sound"), "{late}");
}

#[test]
fn silence_stays_at_rest() {
    for frame in all_at_once(&built_in(), &[0.0; 80_000]) {
        let moved = frame.displacements.as_flattened().iter();
        let most = moved.fold(0.0f32, |most, x| most.max(x.abs()));
        let allowed = if frame.index < 25 { 2e-3 } else { 1e-3 };
        assert!(most < allowed, "frame {}: {most} m", frame.index);
    }
}

#[test]
fn emotion_acts_on_the_next_frame_and_on_none_before() {
    let model = built_in();
    let samples = hum(16_000);
    let neutral = all_at_once(&model, &samples);
    let mut stream = of(&model);
    stream.push(&samples).unwrap();
    stream.finish().unwrap();
    let mut frames: Vec<_> = (0..10).filter_map(|_| stream.pull()).collect();
    stream
        .set_emotion(&Emotion::parse("happy:1").unwrap())
        .unwrap();
    frames.extend(stream.drain());
    assert_eq!(frames[..10], neutral[..10]);
    assert_ne!(frames[10], neutral[10]);
    let broken = Emotion {
        intensity: f32::NAN,
        ..Emotion::default()
    };
    assert!(stream.set_emotion(&broken).is_err());
}

#[test]
fn offline_motion_follows_the_emotion_curve_bit_for_bit() {
    let model = built_in();
    let waveform = Waveform {
        samples: hum(10_000),
    };
    let angry = Emotion::parse("angry:1").unwrap();
    let curve = EmotionCurve::Keys(vec![(0.1, Emotion::default()), (0.4, angry)]);
    let mut whole = of(&model);
    let clip = stream_whole(&mut whole, &waveform.samples, &curve, SILENT).unwrap();
    let mut stream = of(&model);
    let mut frames = Vec::new();
    for chunk in waveform.samples.chunks(160) {
        stream.push(chunk).unwrap();
        stream
            .set_emotion(&curve.at(stream.next_frame() as f64 / 25.0))
            .unwrap();
        frames.extend(stream.pull());
    }
    stream.finish().unwrap();
    loop {
        stream
            .set_emotion(&curve.at(stream.next_frame() as f64 / 25.0))
            .unwrap();
        match stream.pull() {
            Some(frame) => frames.push(frame),
            None => break,
        }
    }
    let flat: Vec<f32> = frames
        .iter()
        .flat_map(|f| {
            *f.displacements
                .as_flattened()
                .first_chunk::<DIMS>()
                .unwrap()
        })
        .collect();
    assert_eq!(clip.displacements.as_slice().unwrap(), flat);
}
