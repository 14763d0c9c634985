//! Tests of the gate. `anyface-eval live` measures how much of the speech it lets through.

use std::f32::consts::TAU;

use super::*;

const FPS: f64 = 25.0;
const AHEAD: usize = 3080;

fn shares(samples: &[f32], cut: usize) -> Vec<f32> {
    let mut gate = VoiceGate::new(FPS, AHEAD);
    let mut shares = Vec::new();
    let mut pushed = 0;
    for piece in samples.chunks(cut) {
        gate.push(piece);
        pushed += piece.len();
        while 640 * shares.len() + AHEAD <= pushed {
            shares.push(gate.share(shares.len()));
        }
    }
    while 640 * shares.len() < samples.len() {
        shares.push(gate.share(shares.len()));
    }
    shares
}

/// 3 s of syllables through three formants. `moves`: how far their pitch glides.
fn syllables(moves: f32) -> Vec<f32> {
    let mut phase = 0.0;
    let sample = |i: usize| {
        let t = i as f32 / 16_000.0;
        let hz = 120.0 * (1.0 + moves * ((5.6 * t).sin() + 0.5 * (18.8 * t).sin()));
        phase += TAU * hz / 16_000.0;
        let partial = |k: usize| {
            let near =
                |formant: f32, wide: f32| (-((k as f32 * hz - formant) / wide).powi(2)).exp();
            let gain = near(700.0, 300.0) + 0.5 * near(1200.0, 300.0) + 0.15 * near(2500.0, 400.0);
            gain * (k as f32 * phase).sin()
        };
        let buzz: f32 = (1..30).map(partial).sum();
        0.2 * buzz * (0.5 - 0.5 * (TAU * 3.0 * t).cos()).powi(2)
    };
    (0..48_000).map(sample).collect()
}

#[test]
fn syllables_that_glide_are_a_voice_and_a_tone_that_swells_is_none() {
    let of = |moves| shares(&syllables(moves), 160);
    let open = |shares: &[f32]| shares.iter().filter(|share| **share > 0.9).count();
    assert!(open(&of(0.3)) > 50, "{:?}", of(0.3));
    assert_eq!(open(&of(0.0)), 0, "{:?}", of(0.0));
}

#[test]
fn any_cut_gives_the_same_bits() {
    let samples = syllables(0.3);
    let whole = shares(&samples, samples.len());
    for cut in [1, 255, 257, 7_777] {
        assert_eq!(shares(&samples, cut), whole);
    }
}

#[test]
fn the_face_wakes_and_rests_softly() {
    let mut samples = syllables(0.3);
    samples.resize(80_000, 0.0);
    let shares = shares(&samples, 160);
    let steps: Vec<f32> = shares.windows(2).map(|two| two[1] - two[0]).collect();
    assert!(
        steps.iter().all(|step| (-0.21..=0.51).contains(step)),
        "{steps:?}"
    );
    assert_eq!(shares.last(), Some(&0.0));
}

#[test]
fn an_open_gate_says_so() {
    let mut gate = VoiceGate::new(FPS, AHEAD);
    assert_eq!((gate.share(0), gate.closed_s()), (0.0, f64::INFINITY));
    gate.hear_all();
    gate.push(&[0.0; 640]);
    assert_eq!((gate.share(1), gate.closed_s()), (1.0, 0.0));
    assert!(gate.samples.is_empty());
}
