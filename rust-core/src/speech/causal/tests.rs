//! Tests of causal networks and their streams.

use ndarray::{Array1, Array2};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    models::BuiltIn,
    nn::golden::{Golden, distance},
    speech::log_mel::log_mel,
};

static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_emoface::CAUSAL_SPEECH);
const ROWS: usize = 192;

const TOLERANCE: f32 = 1e-4;
const DIMS: usize = 204;

fn golden() -> (Golden, Arc<CausalModel>) {
    let golden = Golden::open("stream_debug");
    let config = CausalConfig::from_json(&golden.metadata("config")).unwrap();
    let model = CausalModel::new(config, &golden.weights()).unwrap();
    (golden, Arc::new(model))
}

fn built_in() -> Arc<CausalModel> {
    let files = MODEL.open(None).unwrap();
    Arc::new(CausalModel::load(&files.weights, &files.config, ROWS).unwrap())
}

fn speech() -> CausalSpeech {
    CausalSpeech::new(golden().1)
}

fn drain(speech: &mut CausalSpeech) -> Vec<Vec<f32>> {
    std::iter::from_fn(|| speech.pull(|_| {}).map(<[f32]>::to_vec)).collect()
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

fn all_at_once(model: &Arc<CausalModel>, samples: &[f32]) -> Vec<Vec<f32>> {
    all_by(None, model, samples)
}

fn all_by(head: Option<usize>, model: &Arc<CausalModel>, samples: &[f32]) -> Vec<Vec<f32>> {
    let mut speech = CausalSpeech::by(Arc::clone(model), head);
    speech.push(samples).unwrap();
    speech.finish().unwrap();
    drain(&mut speech)
}

#[test]
fn rows_equal_the_golden_of_python() {
    let (golden, model) = golden();
    let rows = all_at_once(&model, &golden.values("input"));
    let difference = distance(rows.iter().flatten(), &golden.values("output"));
    assert!(difference < TOLERANCE, "{difference}");
}

#[test]
fn rows_of_further_heads_equal_the_golden_of_python() {
    let (golden, model) = golden();
    for head in 0..2 {
        let rows = all_by(Some(head), &model, &golden.values("input"));
        let difference = distance(
            rows.iter().flatten(),
            &golden.values(&format!("sooner_{head}")),
        );
        assert!(difference < TOLERANCE, "{head}: {difference}");
    }
}

#[test]
fn the_head_with_the_longest_look_ahead_that_is_allowed_speaks() {
    let (_, model) = golden();
    let config = model.config();
    let heads = [0.3, 0.1925, 0.19, 0.0725, 0.07, 0.0].map(|seconds| config.head_within(seconds));
    let (all, some, none) = (Some(None), Some(Some(0)), Some(Some(1)));
    assert_eq!(heads, [all, all, all, some, some, none]);
    assert_eq!(config.head_within(-0.01), None);
    assert_eq!(config.head_within(f64::NAN), None);
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
        let mut speech = CausalSpeech::new(model);
        let (mut frames, mut rest) = (Vec::new(), &samples[..]);
        for (turn, size) in sizes.iter().cycle().enumerate() {
            let (now, later) = rest.split_at((*size).min(rest.len()));
            speech.push(now).unwrap();
            if turn % pull_every == 0 {
                frames.extend(drain(&mut speech));
            }
            rest = later;
            if rest.is_empty() {
                break;
            }
        }
        speech.finish().unwrap();
        frames.extend(drain(&mut speech));
        prop_assert_eq!(frames, whole);
    }
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
        // The window's very last samples weigh almost nothing, so change a whole millisecond.
        assert_ne!(change(edge - 16, 0.7)[frame], before[frame]);
    }
}

#[test]
fn a_row_is_ready_with_the_last_sample_of_its_look_ahead() {
    for head in [None, Some(0)] {
        let mut speech = CausalSpeech::by(golden().1, head);
        let ahead = speech.look_ahead_samples();
        for frame in 0..5 {
            speech
                .push(&vec![0.1; if frame == 0 { ahead - 1 } else { 639 }])
                .unwrap();
            assert_eq!(speech.pull(|_| {}), None);
            speech.push(&[0.1]).unwrap();
            assert!(speech.pull(|_| {}).is_some());
            assert_eq!(speech.next_row(), frame + 1);
        }
    }
}

#[test]
fn a_head_without_look_ahead_hears_nothing_after_its_frame() {
    let (_, model) = golden();
    let samples = hum(24_000);
    let before = all_by(Some(1), &model, &samples);
    for frame in [1, 7, 20] {
        let mut other = samples.clone();
        other[640 * frame..].iter_mut().for_each(|x| *x += 0.7);
        let after = all_by(Some(1), &model, &other);
        assert_eq!(after[..=frame], before[..=frame]);
        assert_ne!(after[frame + 1], before[frame + 1]);
    }
}

#[test]
fn memory_does_not_grow_over_a_long_stream() {
    let mut speech = speech();
    let chunk = hum(160);
    let mut frames = 0;
    for _ in 0..12_000 {
        speech.push(&chunk).unwrap();
        frames += drain(&mut speech).len();
        assert!(
            speech.samples.capacity() <= 1024,
            "{}",
            speech.samples.capacity()
        );
    }
    assert!(frames > 2_990);
}

#[test]
fn a_finished_stream_refuses_more() {
    let mut speech = speech();
    speech.push(&[0.1; 641]).unwrap();
    speech.finish().unwrap();
    assert_eq!(drain(&mut speech).len(), 2);
    let message = speech.push(&[0.0]).unwrap_err().to_string();
    assert!(
        message.contains("push: expected an open stream"),
        "{message}"
    );
    let message = speech.finish().unwrap_err().to_string();
    assert!(
        message.contains("finish: expected an open stream"),
        "{message}"
    );
    assert_eq!(speech.pull(|_| {}), None);
}

#[test]
fn a_stream_without_sound_has_no_frames() {
    let mut speech = speech();
    speech.finish().unwrap();
    assert_eq!(speech.pull(|_| {}), None);
}

#[test]
fn samples_that_are_not_finite_are_refused_and_leave_no_trace() {
    let (_, model) = golden();
    let samples = hum(5_000);
    let mut speech = CausalSpeech::new(Arc::clone(&model));
    speech.push(&samples).unwrap();
    for bad in [f32::NAN, f32::INFINITY] {
        let message = speech.push(&[0.0, bad]).unwrap_err().to_string();
        assert!(
            message.contains("1 of 2 that are NaN or infinite, the first at 1"),
            "{message}"
        );
    }
    speech.finish().unwrap();
    assert_eq!(drain(&mut speech), all_at_once(&model, &samples));
}

#[test]
fn the_loudest_finite_samples_give_finite_rows() {
    let mut samples = hum(20_000);
    samples[3_000..6_000].fill(f32::MAX);
    let rows = all_at_once(&built_in(), &samples);
    assert!(rows.iter().flatten().all(|x| x.is_finite()));
}

#[test]
fn a_listener_hears_every_ten_milliseconds_once() {
    let samples = hum(16_000);
    let mut speech = speech();
    speech.push(&samples).unwrap();
    let mut heard = Vec::new();
    while speech
        .pull(|stretch| heard.extend_from_slice(&stretch[FRAME / 2..FRAME / 2 + HOP]))
        .is_some()
    {}
    assert!(heard.len() > 15_000);
    assert_eq!(heard, samples[..heard.len()]);
}

#[test]
fn a_look_ahead_of_more_than_200_ms_is_refused() {
    let files = MODEL.open(None).unwrap();
    let mut config: serde_json::Value = serde_json::from_str(&files.config).unwrap();
    config["listen"][0]["dilation"] = 2.into();
    let message = CausalConfig::from_json(&config.to_string())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("look-ahead: expected 0.2 s at most, got 0.2325 s"),
        "{message}"
    );
}

#[test]
fn a_model_of_other_rows_is_refused() {
    let files = MODEL.open(None).unwrap();
    let refused = CausalModel::load(&files.weights, &files.config, 204).err();
    assert_eq!(
        refused.unwrap().to_string(),
        "weights: causal_speech: outputs: expected 204, got 192"
    );
}

mod twin {
    //! The network as convolutions over the whole clip, written as plain sums.

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

    fn mel(config: &CausalConfig, samples: &[f32], frames: usize) -> Rows {
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
        config: &CausalConfig,
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
        let difference = distance(frames.iter().flatten(), &slow);
        assert!(difference < TOLERANCE, "{length} samples: {difference}");
    }
}
