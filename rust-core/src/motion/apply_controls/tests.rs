//! Each control changes what its name says and nothing else.

use ndarray::{Array2, Array3};

use super::*;
use crate::{
    Error,
    audio::Waveform,
    conditions::{Emotion, EmotionCurve},
};

const FPS: f64 = 30.0;
const FRAMES: usize = 120;
const PAIRS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];

fn modes() -> FaceModes {
    FaceModes::open(None).unwrap()
}

fn expressions() -> Expressions {
    Expressions::open(None).unwrap()
}

fn affect(emotion: &str) -> Array2<f32> {
    EmotionCurve::Constant(Emotion::parse(emotion).unwrap()).sample(FRAMES, FPS)
}

/// An emotion while the jaw opens and closes three times a second, the lips round and the brows
/// wander. At every closing the lips press by up to 0.4 mm.
fn talking(modes: &FaceModes, emotion: &str) -> LandmarkClip {
    let mut displacements = expressions().alone(affect(emotion).view(), FPS, 1.0);
    let names = ["jawOpen", "mouthPucker", "browInnerUp_L", "mouthClose"];
    let shapes = names.map(|name| modes.mode(name).unwrap());
    for (t, mut frame) in displacements.outer_iter_mut().enumerate() {
        let s = t as f32 / FPS as f32;
        let open = (std::f32::consts::TAU * 3.0 * s).sin().max(0.0);
        frame.scaled_add(0.25 * open, &shapes[0]);
        frame.scaled_add(0.3 * (4.0 * s).sin().abs(), &shapes[1]);
        frame.scaled_add(0.2 * (2.0 * s).sin(), &shapes[2]);
        if open == 0.0 {
            for (up, low) in PAIRS {
                let gap = frame[[up, 1]] - frame[[low, 1]];
                frame[[up, 1]] -= gap + 4e-4 * (9.0 * s).sin().abs();
            }
        }
    }
    LandmarkClip {
        displacements,
        fps: FPS,
    }
}

fn speech() -> Prosody {
    let samples = (0..4 * 16_000)
        .map(|i| {
            let t = i as f32 / 16_000.0;
            let stress = 1.0 + (0.9 * t).sin();
            let hz = 110.0 + 20.0 * stress;
            let buzz: f32 = (1..9)
                .map(|k| (std::f32::consts::TAU * hz * k as f32 * t).sin() / k as f32)
                .sum();
            let burst = (0.5 - 0.5 * (std::f32::consts::TAU * 4.0 * t).cos()).powi(2);
            0.1 * stress * buzz * burst
        })
        .collect();
    Prosody::of(&Waveform { samples })
}

fn silence() -> Prosody {
    Prosody::of(&Waveform {
        samples: vec![0.0; 64_000],
    })
}

fn performed(clip: &LandmarkClip, emotion: &str, controls: PerformanceControls) -> Array3<f32> {
    let (affect, prosody) = (affect(emotion), speech());
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions(),
        emotion_origin: EmotionOrigin::Learned,
        speech_only: false,
        prosody: &prosody,
        seed: 5,
    };
    modes()
        .apply_controls(clip, &cues, &controls)
        .unwrap()
        .displacements
}

fn plain() -> PerformanceControls {
    PerformanceControls::as_sampled()
}

/// Landmarks that differ by more than 0.1 µm in some frame.
fn changed(a: &Array3<f32>, b: &Array3<f32>) -> Vec<usize> {
    let differ = |n: usize| {
        let (a, b) = (
            a.index_axis(ndarray::Axis(1), n),
            b.index_axis(ndarray::Axis(1), n),
        );
        (&a - &b).iter().any(|x| x.abs() > 1e-7)
    };
    (0..68).filter(|n| differ(*n)).collect()
}

fn gap(displacements: &Array3<f32>, t: usize, (up, low): (usize, usize)) -> f32 {
    displacements[[t, up, 1]] - displacements[[t, low, 1]]
}

#[test]
fn as_sampled_changes_nothing_and_without_variety_the_default_adds_blinks_and_brows_alone() {
    let clip = talking(&modes(), "happy:0.6");
    assert_eq!(performed(&clip, "happy:0.6", plain()), clip.displacements);
    let controls = PerformanceControls {
        variety: 0.0,
        effort: 0.0,
        ..Default::default()
    };
    let displacements = performed(&clip, "happy:0.6", controls);
    let moved = changed(&displacements, &clip.displacements);
    assert!(!moved.is_empty());
    assert!(
        moved
            .iter()
            .all(|n| (17..27).contains(n) || (36..48).contains(n))
    );
}

#[test]
fn each_control_moves_its_own_landmarks() {
    let clip = talking(&modes(), "surprised:0.5");
    let speaking = |n: usize| !(17..48).contains(&n);
    let upper = |n: usize| (17..31).contains(&n) || (36..48).contains(&n);
    let brows = |n: usize| (17..27).contains(&n);
    let sides = |n: usize| brows(n) || [48, 49, 53, 54, 55, 59, 60, 64].contains(&n);
    let cases: [(PerformanceControls, &dyn Fn(usize) -> bool); 8] = [
        (
            PerformanceControls {
                variety: 1.5,
                ..plain()
            },
            &|n| speaking(n) || (17..48).contains(&n),
        ),
        (
            PerformanceControls {
                articulation: 1.7,
                ..plain()
            },
            &speaking,
        ),
        (
            PerformanceControls {
                jaw: 0.3,
                ..plain()
            },
            &speaking,
        ),
        (
            PerformanceControls {
                rounding: 0.3,
                width: 1.5,
                ..plain()
            },
            &speaking,
        ),
        (
            PerformanceControls {
                upper_face: 0.3,
                ..plain()
            },
            &upper,
        ),
        (
            PerformanceControls {
                blinks_per_minute: 60.0,
                ..plain()
            },
            &|n| (36..48).contains(&n),
        ),
        (
            PerformanceControls {
                brow_accents: 2.0,
                ..plain()
            },
            &brows,
        ),
        (
            PerformanceControls {
                asymmetry: 0.7,
                ..plain()
            },
            &sides,
        ),
    ];
    for (controls, may_move) in cases {
        let moved = changed(
            &performed(&clip, "surprised:0.5", controls),
            &clip.displacements,
        );
        assert!(!moved.is_empty(), "{controls:?} moves nothing");
        assert!(
            moved.iter().all(|n| may_move(*n)),
            "{controls:?} moves {moved:?}"
        );
    }
}

#[test]
fn articulation_scales_speech_around_the_emotion() {
    let modes = modes();
    let clip = talking(&modes, "happy:0.8");
    let emotion = expressions().alone(affect("happy:0.8").view(), FPS, 1.0);
    let controls = |articulation| PerformanceControls {
        articulation,
        ..plain()
    };
    let still = performed(&clip, "happy:0.8", controls(0.0));
    let double = performed(&clip, "happy:0.8", controls(2.0));
    for t in 0..FRAMES {
        assert!((still[[t, 8, 1]] - emotion[[t, 8, 1]]).abs() < 1e-6);
        let speech = clip.displacements[[t, 54, 1]] - emotion[[t, 54, 1]];
        assert!((double[[t, 54, 1]] - emotion[[t, 54, 1]] - 2.0 * speech).abs() < 1e-6);
    }
}

#[test]
fn closures_survive_articulation_jaw_width_and_smoothing() {
    for emotion in ["neutral:0", "surprised:1"] {
        let clip = talking(&modes(), emotion);
        let sampled = &clip.displacements;
        for articulation in [0.0, 0.4, 1.0, 1.6, 2.0] {
            for (jaw, width, smoothing_s) in [(1.0, 1.0, 0.0), (0.0, 2.0, 0.03), (2.0, 0.0, 0.1)] {
                let controls = PerformanceControls {
                    articulation,
                    jaw,
                    width,
                    rounding: width,
                    smoothing_s,
                    ..plain()
                };
                let displacements = performed(&clip, emotion, controls);
                for (t, pair) in (0..FRAMES).flat_map(|t| PAIRS.map(|pair| (t, pair))) {
                    let (had, has) = (gap(sampled, t, pair), gap(&displacements, t, pair));
                    assert!(
                        has >= had.min(0.0) - 1e-6,
                        "{controls:?}: lips pass, frame {t}"
                    );
                    assert!(
                        had > 0.0 || (has - had).abs() < 1e-6,
                        "{controls:?}: frame {t} opens"
                    );
                }
            }
        }
    }
}

#[test]
fn jaw_rounding_and_width_each_scale_their_own_part() {
    let modes = modes();
    let mut clip = talking(&modes, "neutral:0");
    let pucker = modes.mode("mouthPucker").unwrap();
    for mut face in clip.displacements.outer_iter_mut() {
        face.scaled_add(0.4, &pucker);
    }
    let measure = |controls| {
        let displacements = performed(&clip, "neutral:0", controls);
        let each = displacements.outer_iter().map(|face| {
            let forward = (48..68).map(|n| face[[n, 2]]).sum::<f32>() / 20.0;
            [-face[[8, 1]], forward, face[[54, 0]] - face[[48, 0]]]
        });
        each.fold([0.0; 3], |sum, one| {
            [0, 1, 2].map(|n| sum[n] + one[n] / FRAMES as f32)
        })
    };
    let [drop, forward, width] = measure(plain());
    let jaw = measure(PerformanceControls {
        jaw: 0.0,
        ..plain()
    });
    assert!(drop > 1e-3 && jaw[0].abs() < 0.1 * drop, "{drop} {jaw:?}");
    let flat = measure(PerformanceControls {
        rounding: 0.0,
        ..plain()
    });
    let round = measure(PerformanceControls {
        rounding: 2.0,
        ..plain()
    });
    assert!(flat[1] < forward - 1e-3 && round[1] > forward + 1e-3);
    assert!(flat[2] > width + 1e-3 && round[2] < width - 1e-3);
    let chin_moved = (flat[0] - drop).abs().max((round[0] - drop).abs());
    assert!(chin_moved < 0.2 * (round[1] - forward), "{chin_moved}");
    let wide = measure(PerformanceControls {
        width: 2.0,
        ..plain()
    });
    assert!((wide[0] - drop).abs() < 0.02 * drop && (wide[2] - width).abs() > 1e-4);
}

#[test]
fn lids_never_pass_through_one_another() {
    let modes = modes();
    let clip = talking(&modes, "drunk:1.5");
    let controls = PerformanceControls {
        upper_face: 2.0,
        blinks_per_minute: 60.0,
        ..plain()
    };
    let displacements = performed(&clip, "drunk:1.5", controls);
    let eyes = upper_face::lids(&modes).unwrap();
    let closures = displacements
        .outer_iter()
        .flat_map(|frame| [eyes[0].closure(&frame), eyes[1].closure(&frame)]);
    let most = closures.fold(0.0, f32::max);
    assert!((0.98..1.0 + 1e-4).contains(&most), "{most}");
}

#[test]
fn off_leaves_speech_alone() {
    let clip = talking(&modes(), "neutral:0");
    let (affect, prosody) = (affect("neutral:0"), speech());
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions(),
        emotion_origin: EmotionOrigin::Learned,
        speech_only: true,
        prosody: &prosody,
        seed: 5,
    };
    let controls = PerformanceControls {
        effort: 0.0,
        ..Default::default()
    };
    let performance = modes().apply_controls(&clip, &cues, &controls).unwrap();
    for (n, motion) in performance
        .displacements
        .axis_iter(ndarray::Axis(1))
        .enumerate()
    {
        let upper = (17..31).contains(&n) || (36..48).contains(&n);
        let speech = clip.displacements.index_axis(ndarray::Axis(1), n);
        assert!(if upper {
            motion.iter().all(|x| *x == 0.0)
        } else {
            motion == speech
        });
    }
}

#[test]
fn silence_has_blinks_and_no_accents() {
    let (modes, affect, prosody) = (modes(), affect("neutral:0"), silence());
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions(),
        emotion_origin: EmotionOrigin::Learned,
        speech_only: false,
        prosody: &prosody,
        seed: 1,
    };
    let still = LandmarkClip {
        displacements: Array3::zeros((FRAMES, 68, 3)),
        fps: FPS,
    };
    let controls = PerformanceControls {
        blinks_per_minute: 40.0,
        ..Default::default()
    };
    let performance = modes.apply_controls(&still, &cues, &controls).unwrap();
    let moved = changed(&performance.displacements, &still.displacements);
    assert!(!moved.is_empty() && moved.iter().all(|n| (36..48).contains(n)));
}

#[test]
fn the_same_seed_gives_the_same_and_another_seed_another_performance() {
    let (modes, affect, prosody) = (modes(), affect("sad:0.5"), speech());
    let clip = talking(&modes, "sad:0.5");
    let with = |seed| {
        let cues = Cues {
            affect: affect.view(),
            blink_affect: affect.view(),
            expressions: &expressions(),
            emotion_origin: EmotionOrigin::Learned,
            speech_only: false,
            prosody: &prosody,
            seed,
        };
        modes
            .apply_controls(&clip, &cues, &PerformanceControls::default())
            .unwrap()
    };
    assert_eq!(with(3), with(3));
    assert!((0..4).any(|seed| with(seed) != with(3)));
}

#[test]
fn controls_out_of_range_are_refused() {
    let clip = talking(&modes(), "neutral:0");
    let (affect, prosody) = (affect("neutral:0"), silence());
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions(),
        emotion_origin: EmotionOrigin::Learned,
        speech_only: false,
        prosody: &prosody,
        seed: 0,
    };
    let controls = PerformanceControls {
        articulation: 2.1,
        ..plain()
    };
    let refused = modes().apply_controls(&clip, &cues, &controls);
    assert!(matches!(refused, Err(Error::InvalidInput(text)) if text.contains("0 to 2, got 2.1")));
}

#[test]
fn odd_lengths_and_rates_are_fine() {
    let (modes, prosody) = (modes(), speech());
    for (frames, fps) in [(1, 1.0), (3, 240.0), (0, 30.0), (7, 5.0)] {
        let displacements = Array3::zeros((frames, 68, 3));
        let affect = EmotionCurve::default().sample(frames, fps);
        let cues = Cues {
            affect: affect.view(),
            blink_affect: affect.view(),
            expressions: &expressions(),
            emotion_origin: EmotionOrigin::Learned,
            speech_only: false,
            prosody: &prosody,
            seed: 0,
        };
        let controls = PerformanceControls {
            smoothing_s: 0.05,
            articulation: 1.5,
            upper_face: 2.0,
            blinks_per_minute: 60.0,
            ..Default::default()
        };
        let performance = modes
            .apply_controls(&LandmarkClip { displacements, fps }, &cues, &controls)
            .unwrap();
        assert_eq!(performance.displacements.dim(), (frames, 68, 3));
        assert!(performance.displacements.iter().all(|x| x.is_finite()));
    }
}
