//! Facts about the streaming network and its streams.

use ndarray::{Array1, Array2};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    audio::Waveform,
    conditions::EmotionCurve,
    motion::{Expressions, FaceModes, stream_whole},
    nn::golden::{Golden, distance},
    speech::log_mel,
    systems::freetalk::STREAM_MODEL,
};

const TOLERANCE: f32 = 1e-4;

fn golden() -> (Golden, Arc<StreamModel>) {
    let golden = Golden::open("stream_debug");
    let config = StreamConfig::from_json(&golden.metadata("config")).unwrap();
    let model = StreamModel::new(config, &golden.weights()).unwrap();
    (golden, Arc::new(model))
}

fn built_in() -> Arc<StreamModel> {
    let files = STREAM_MODEL.open(None).unwrap();
    Arc::new(StreamModel::load(&files.weights, &files.config).unwrap())
}

fn of(model: &Arc<StreamModel>) -> CausalStream {
    let (expressions, modes) = (Expressions::open(None), FaceModes::open(None));
    let (expressions, modes) = (Arc::new(expressions.unwrap()), Arc::new(modes.unwrap()));
    let expression = CausalExpression::new(expressions, modes, model.config.fps);
    CausalStream::new(Arc::clone(model), expression)
}

fn stream() -> CausalStream {
    of(&golden().1)
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

fn felt_at_once(
    model: &Arc<StreamModel>,
    samples: &[f32],
    emotion: &Emotion,
) -> Vec<LandmarkFrame> {
    let mut stream = of(model);
    stream.set_emotion(emotion).unwrap();
    stream.push(samples).unwrap();
    stream.finish().unwrap();
    stream.drain()
}

fn all_at_once(model: &Arc<StreamModel>, samples: &[f32]) -> Vec<LandmarkFrame> {
    felt_at_once(model, samples, &Emotion::default())
}

#[test]
fn motion_equals_the_golden_of_python() {
    let (golden, model) = golden();
    let mut stream = of(&model);
    stream.push(&golden.values("input")).unwrap();
    stream.finish().unwrap();
    let frames = stream.drain();
    let got = frames
        .iter()
        .flat_map(|frame| frame.displacements.as_flattened());
    let difference = distance(got, &golden.values("output"));
    assert!(difference < TOLERANCE, "{difference}");
}

#[test]
fn running_normalisation_equals_the_golden_of_python() {
    let (golden, model) = golden();
    let expected = golden.matrix("normalised");
    let mut samples = golden.values("input");
    samples.resize(HOP * expected.nrows(), 0.0);
    let mut normaliser = RunningNormaliser::new(&model.config.normaliser);
    let mut worst = 0.0f32;
    for (mel, expected) in log_mel(&samples).outer_iter().zip(expected.outer_iter()) {
        let mut row = std::array::from_fn(|band| mel[band]);
        normaliser.hear(&mut row);
        worst = worst.max(distance(&row, expected));
    }
    assert!(worst < 1e-3, "{worst}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn any_cut_gives_the_same_bits(
        length in 0usize..20_000,
        sizes in prop::collection::vec(prop_oneof![Just(1usize), 2..400usize, Just(160), 400..9000usize], 1..8),
        pull_every in 1usize..4,
    ) {
        let (_, model) = golden();
        let samples = hum(length);
        let whole = all_at_once(&model, &samples);
        prop_assert_eq!(whole.len(), length.div_ceil(640));
        let mut stream = of(&model);
        let (mut frames, mut rest) = (Vec::new(), &samples[..]);
        for (turn, size) in sizes.iter().cycle().enumerate() {
            let (now, later) = rest.split_at((*size).min(rest.len()));
            stream.push(now).unwrap();
            if turn % pull_every == 0 {
                frames.extend(stream.drain());
            }
            rest = later;
            if rest.is_empty() {
                break;
            }
        }
        stream.finish().unwrap();
        frames.extend(stream.drain());
        prop_assert_eq!(frames, whole);
    }
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
    assert_eq!(frames, felt_at_once(&model, &samples, &angry));
}

#[test]
fn sound_after_the_look_ahead_changes_nothing_and_the_last_sample_before_it_does() {
    let model = built_in();
    let ahead = model.config.look_ahead_samples();
    assert!(ahead <= 3200, "{ahead}");
    let samples = hum(24_000);
    let before = all_at_once(&model, &samples);
    for frame in [0, 7, 20] {
        let edge = 640 * frame + ahead;
        let change = |from: usize, by: f32| {
            let mut other = samples.clone();
            other[from..].iter_mut().for_each(|x| *x += by);
            all_at_once(&model, &other)
        };
        let after = change(edge, 0.7);
        assert_eq!(after[..=frame], before[..=frame]);
        assert_ne!(after[frame + 1], before[frame + 1]);
        // The window's very last samples weigh next to nothing; a millisecond tells.
        assert_ne!(change(edge - 16, 0.7)[frame], before[frame]);
    }
}

#[test]
fn a_frame_is_ready_with_the_last_sample_of_its_look_ahead() {
    let mut stream = stream();
    let ahead = (stream.latency_s() * 16_000.0).round() as usize;
    for frame in 0..5 {
        stream
            .push(&vec![0.1; if frame == 0 { ahead - 1 } else { 639 }])
            .unwrap();
        assert_eq!(stream.pull(), None);
        stream.push(&[0.1]).unwrap();
        assert_eq!(stream.pull().unwrap().index, frame);
    }
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
fn memory_does_not_grow_over_a_long_stream() {
    let mut stream = stream();
    let chunk = hum(160);
    let mut frames = 0;
    for _ in 0..12_000 {
        stream.push(&chunk).unwrap();
        frames += stream.drain().len();
        assert!(
            stream.samples.capacity() <= 1024,
            "{}",
            stream.samples.capacity()
        );
    }
    assert!(frames > 2_990);
}

#[test]
fn a_finished_stream_refuses_more() {
    let mut stream = stream();
    stream.push(&[0.1; 641]).unwrap();
    stream.finish().unwrap();
    assert_eq!(stream.drain().len(), 2);
    let message = stream.push(&[0.0]).unwrap_err().to_string();
    assert!(
        message.contains("push: expected an open stream"),
        "{message}"
    );
    let message = stream.finish().unwrap_err().to_string();
    assert!(
        message.contains("finish: expected an open stream"),
        "{message}"
    );
    assert_eq!(stream.pull(), None);
}

#[test]
fn a_stream_without_sound_has_no_frames() {
    let mut stream = stream();
    stream.finish().unwrap();
    assert_eq!(stream.pull(), None);
}

#[test]
fn samples_that_are_not_finite_are_refused_and_leave_no_trace() {
    let (_, model) = golden();
    let samples = hum(5_000);
    let mut stream = of(&model);
    stream.push(&samples).unwrap();
    for bad in [f32::NAN, f32::INFINITY] {
        let message = stream.push(&[0.0, bad]).unwrap_err().to_string();
        assert!(
            message.contains("1 of 2 that are NaN or infinite, the first at 1"),
            "{message}"
        );
    }
    stream.finish().unwrap();
    assert_eq!(stream.drain(), all_at_once(&model, &samples));
}

#[test]
fn the_loudest_finite_samples_give_finite_motion() {
    let mut samples = hum(20_000);
    samples[3_000..6_000].fill(f32::MAX);
    for frame in all_at_once(&built_in(), &samples) {
        assert!(
            frame
                .displacements
                .as_flattened()
                .iter()
                .all(|x| x.is_finite())
        );
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
    let (_, model) = golden();
    let waveform = Waveform {
        samples: hum(10_000),
    };
    let angry = Emotion::parse("angry:1").unwrap();
    let curve = EmotionCurve::Keys(vec![(0.1, Emotion::default()), (0.4, angry)]);
    let mut whole = of(&model);
    let clip = stream_whole(&mut whole, &waveform.samples, &curve).unwrap();
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

#[test]
fn a_look_ahead_of_more_than_200_ms_is_refused() {
    let files = STREAM_MODEL.open(None).unwrap();
    let mut config: serde_json::Value = serde_json::from_str(&files.config).unwrap();
    config["listen"][0]["dilation"] = 2.into();
    let message = StreamConfig::from_json(&config.to_string())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("look-ahead: expected 0.2 s at most, got 0.2325 s"),
        "{message}"
    );
}

mod twin {
    //! The network as whole-clip convolutions, written as the sums they are.

    use super::*;

    type Rows = Array2<f32>;

    fn conv(weights: &Weights, x: &Rows, shape: [usize; 3], block: (usize, usize, usize)) -> Rows {
        let ([outputs, inputs, taps], (dilation, ahead, stride)) = (shape, block);
        let weight = weights.values("weight", &shape).unwrap();
        let bias = weights.vector("bias", outputs).unwrap();
        let rows = (x.nrows() - ahead * dilation).div_ceil(stride);
        Array2::from_shape_fn((rows, outputs), |(t, o)| {
            let mut sum = bias[o];
            for k in 0..taps {
                let at =
                    (t * stride + k * dilation) as isize - ((taps - 1 - ahead) * dilation) as isize;
                if at >= 0 {
                    for i in 0..inputs {
                        sum += x[[at as usize, i]] * weight[(o * inputs + i) * taps + k];
                    }
                }
            }
            sum
        })
    }

    fn linear(weights: &Weights, x: &Rows, outputs: usize) -> Rows {
        let weight = weights.matrix("weight", outputs, x.ncols()).unwrap();
        x.dot(&weight.t()) + weights.vector("bias", outputs).unwrap()
    }

    fn gelu(x: Rows) -> Rows {
        x.mapv(crate::nn::elementwise::gelu)
    }

    fn norm(weights: &Weights, x: &Rows) -> Rows {
        LayerNorm::load(weights, x.ncols(), EPSILON)
            .unwrap()
            .forward(x)
    }

    fn blocks(weights: &Weights, mut x: Rows, blocks: &[Block]) -> Rows {
        for (i, block) in blocks.iter().enumerate() {
            let (weights, channels) = (weights.pp(i), x.ncols());
            let shape = [channels, channels, TAPS];
            let y = norm(&weights.pp("norm"), &x);
            let y = conv(
                &weights.pp("conv"),
                &y,
                shape,
                (block.dilation, block.ahead, 1),
            );
            let y = linear(&weights.pp("mix"), &gelu(y), channels);
            x = x.slice(ndarray::s![..y.nrows(), ..]).to_owned() + y;
        }
        x
    }

    fn mel(config: &StreamConfig, samples: &[f32], frames: usize) -> Rows {
        let mut padded = samples.to_vec();
        padded.resize(640 * (frames - 1) + config.look_ahead_samples() + 1, 0.0);
        let mut mel = log_mel(&padded);
        let mut normaliser = RunningNormaliser::new(&config.normaliser);
        for mut row in mel.outer_iter_mut() {
            let row = row.as_slice_mut().unwrap();
            let mut copy = *row.first_chunk::<BANDS>().unwrap();
            normaliser.hear(&mut copy);
            row.copy_from_slice(&copy);
        }
        mel
    }

    pub fn motion(
        config: &StreamConfig,
        weights: &Weights,
        samples: &[f32],
        frames: usize,
    ) -> Rows {
        let channels = config.channels;
        let x = mel(config, samples, frames);
        let shape = [channels, BANDS, STEM_TAPS];
        let x = gelu(conv(&weights.pp("stem"), &x, shape, (1, STEM_AHEAD, 2)));
        let x = blocks(&weights.pp("fine"), x, &config.fine);
        let shape = [channels, channels, TAPS];
        let x = gelu(conv(&weights.pp("down"), &x, shape, (1, DOWN_AHEAD, 2)));
        let x = blocks(&weights.pp("listen"), x, &config.listen);
        let x = x.slice(ndarray::s![..frames, ..]).to_owned();
        let x = norm(
            &weights.pp("norm"),
            &blocks(&weights.pp("perform"), x, &config.perform),
        );
        let scale: Array1<f32> = weights.vector("std", DIMS).unwrap();
        linear(&weights.pp("head"), &x, DIMS) * scale + weights.vector("mean", DIMS).unwrap()
    }
}

#[test]
fn the_stream_equals_whole_clip_convolutions() {
    let (golden, model) = golden();
    for length in [1, 640, 641, 9_999] {
        let samples = hum(length);
        let frames = all_at_once(&model, &samples);
        let slow = twin::motion(&model.config, &golden.weights(), &samples, frames.len());
        assert_eq!(slow.nrows(), frames.len());
        let fast = frames
            .iter()
            .flat_map(|frame| frame.displacements.as_flattened());
        let difference = distance(fast, &slow);
        assert!(difference < TOLERANCE, "{length} samples: {difference}");
    }
}
