//! Performances of the engine: effects of controls and of users' own models.

use std::{fs, path::Path, sync::Arc};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest, Performance,
    audio::Waveform,
    conditions::{ControlCurve, Controls, EmotionCurve},
    job::SILENT,
    mesh::PartChoices,
    motion::{Motion, PerformanceControls},
    rig::ShapeSource,
    speech::VoiceTrack,
};
use ndarray::Axis;
use safetensors::{Dtype, tensor::TensorView};

use crate::voice::babble;

#[test]
fn controls_need_no_new_sampling() {
    let engine = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap();
    let waveform = Waveform {
        samples: babble(1.0, 16_000),
    };
    let request_with = |controls: PerformanceControls| MotionRequest {
        emotion: EmotionCurve::parse("sad:0.6").unwrap(),
        seed: 9,
        controls: controls.into(),
        ..MotionRequest::default()
    };
    let run = |request: &MotionRequest| engine.perform(&waveform, request, SILENT).unwrap();
    let plain = run(&request_with(PerformanceControls::as_sampled()));
    let strong = request_with(PerformanceControls {
        articulation: 1.4,
        smoothing_s: 0.02,
        blinks_per_minute: 60.0,
        ..PerformanceControls::default()
    });
    let again = plain.again(&engine, &strong).unwrap();
    assert_eq!(run(&strong).motion, again.motion);
    assert_ne!(again.motion, plain.motion);
}

#[test]
fn another_onset_is_sampled_again_where_models_have_learned_emotion() {
    let waveform = Waveform {
        samples: babble(2.0, 16_000),
    };
    let keys = "0:neutral 1:neutral 1.01:happy:1";
    let request_with = |onset: f32, emotion: &str| MotionRequest {
        emotion: EmotionCurve::parse_keys(emotion).unwrap(),
        controls: Controls::default().with("onset", onset),
        ..MotionRequest::default()
    };
    for system in ["cafe-talk", "emoface"] {
        let engine = crate::engine(system);
        let run = |onset: f32| {
            let request = request_with(onset, keys);
            engine.perform(&waveform, &request, SILENT).unwrap()
        };
        let (usual, cut) = (run(1.0), run(0.0));
        let again = |from: &Performance, onset: f32| {
            from.again(&engine, &request_with(onset, keys)).unwrap()
        };
        let cut_again = again(&usual, 0.0);
        assert_ne!(usual.motion, cut.motion, "{system}");
        assert_eq!(cut_again.motion, cut.motion, "{system}");
        assert_eq!(again(&cut_again, 1.0).motion, usual.motion, "{system}");
        // The emotion that was sampled stays, whatever is asked for in between.
        let sad = usual.again(&engine, &request_with(1.0, "0:sad:1")).unwrap();
        assert_eq!(again(&sad, 0.0).motion, cut.motion, "{system}");
    }
}

#[test]
fn a_control_that_changes_over_time_is_the_run_of_its_value_where_it_stands() {
    let engine = crate::head::engine();
    let waveform = Waveform {
        samples: babble(2.0, 16_000),
    };
    let run = |controls: Controls| {
        let request = MotionRequest {
            controls,
            ..MotionRequest::default()
        };
        engine.perform(&waveform, &request, SILENT).unwrap().motion
    };
    let mut animated = Controls::default();
    let keys = vec![(0.5, 0.5), (1.5, 1.5)];
    animated.set_curve("articulation", ControlCurve { value: 1.0, keys });
    let moved = run(animated);
    let frame = |motion: &Motion, t: usize| motion.values().index_axis(Axis(0), t).to_owned();
    for (t, value) in [(0, 0.5), (15, 0.5), (30, 1.0), (45, 1.5), (59, 1.5)] {
        let constant = run(Controls::default().with("articulation", value));
        assert_eq!(frame(&moved, t), frame(&constant, t), "frame {t}");
    }
    let (start, end) = (frame(&moved, 22), frame(&moved, 38));
    assert_ne!(start, end);
}

#[test]
fn an_hour_of_sound_is_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hour.wav");
    let spec = hound::WavSpec {
        channels: 2,
        sample_rate: 8_000,
        bits_per_sample: 8,
        sample_format: hound::SampleFormat::Int,
    };
    let mut wav = hound::WavWriter::create(&path, spec).unwrap();
    for i in 0..3600 * 8_000 * 2 {
        wav.write_sample((i % 100) as i8 - 50).unwrap();
    }
    wav.finalize().unwrap();
    let waveform = anyface::audio::Waveform::from_file(&path).unwrap();
    assert_eq!(waveform.samples.len(), 3600 * 16_000);
}

#[test]
fn a_sound_without_samples_is_refused_in_words() {
    let engine = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap();
    let waveform = Waveform { samples: vec![] };
    for emotion in [EmotionCurve::default(), EmotionCurve::Auto] {
        let request = MotionRequest {
            emotion,
            ..MotionRequest::default()
        };
        let refused = engine.perform(&waveform, &request, SILENT).err().unwrap();
        assert_eq!(refused.to_string(), "audio: expected sound, got no samples");
    }
}

#[test]
fn shapes_come_from_the_models_of_the_engine() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("rig")).unwrap();
    let engine = Engine::new(EngineOptions {
        models: Some(folder.path().to_owned()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap();
    let (mesh, landmarks) = (crate::head::head(), crate::head::landmarks());
    let face = crate::head::prepared(&mesh, &landmarks, PartChoices::default());
    let refused = engine
        .rig(&face, ShapeSource::Network, SILENT)
        .err()
        .unwrap()
        .to_string();
    assert!(refused.contains("rig/model.safetensors"), "{refused}");
}

/// Writes an ear for emotion, to which class `class` of three is certain for any sound.
fn write_ear(folder: &Path, class: usize) {
    /// Three numbers for each of 512 channels, and 118 of the voice.
    const NUMBERS: usize = 3 * 512 + 118;
    let bias = std::array::from_fn::<_, 3, _>(|k| if k == class { 9.0 } else { 0.0 });
    let arrays: [(&str, Vec<usize>, Vec<f32>); 5] = [
        ("mean", vec![NUMBERS], vec![0.0; NUMBERS]),
        ("scale", vec![NUMBERS], vec![1.0; NUMBERS]),
        ("readers", vec![NUMBERS], vec![0.0; NUMBERS]),
        ("weight", vec![NUMBERS, 3], vec![0.0; 3 * NUMBERS]),
        ("bias", vec![3], bias.to_vec()),
    ];
    let arrays = arrays.map(|(name, shape, values)| {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        (name, shape, bytes)
    });
    let views = arrays.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes);
        (*name, view.unwrap())
    });
    fs::create_dir_all(folder).unwrap();
    let config = r#"{"channels": 512, "layers": [3], "emotions": ["neutral", "angry", "sad"]}"#;
    fs::write(folder.join("config.json"), config).unwrap();
    let bytes = safetensors::serialize(views, None).unwrap();
    fs::write(folder.join("model.safetensors"), bytes).unwrap();
}

fn tone() -> Waveform {
    Waveform {
        samples: (0..32_000)
            .map(|i| 0.3 * f32::sin(0.08 * i as f32))
            .collect(),
    }
}

#[test]
fn an_ear_from_a_folder_hears_the_emotion() {
    let models = tempfile::tempdir().unwrap();
    let angry = 1;
    write_ear(&models.path().join("emotion_of_whisper"), angry);
    let engine = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        models: Some(models.path().into()),
        ..Default::default()
    })
    .unwrap();
    let waveform = tone();
    let request = MotionRequest {
        emotion: EmotionCurve::Auto,
        ..Default::default()
    };
    let performance = engine.perform(&waveform, &request, SILENT).unwrap();
    let heard = performance.heard_emotion().unwrap();
    assert!(!heard.time_s.is_empty());
    assert!(heard.probability["angry"].iter().all(|share| *share > 0.9));
    assert!(heard.intensity.iter().all(|intensity| *intensity > 0.5));
    // The face shows what the model hears, and an emotion set by hand does not use it.
    let displacements = |engine: &Engine, emotion: EmotionCurve| {
        let request = MotionRequest {
            emotion,
            ..Default::default()
        };
        match engine.perform(&waveform, &request, SILENT).unwrap().motion {
            Motion::Landmarks(clip) => clip.displacements,
            _ => panic!("expected landmarks"),
        }
    };
    let built_in = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..Default::default()
    })
    .unwrap();
    let apart =
        &displacements(&engine, EmotionCurve::Auto) - &displacements(&built_in, EmotionCurve::Auto);
    assert!(apart.iter().any(|metres| metres.abs() > 2e-3));
    let by_hand = EmotionCurve::default();
    assert_eq!(
        displacements(&engine, by_hand.clone()),
        displacements(&built_in, by_hand)
    );

    let request = MotionRequest {
        neutral_voice: Some(Arc::new(VoiceTrack::neutral(&waveform).unwrap())),
        ..request
    };
    engine.perform(&waveform, &request, SILENT).unwrap();

    fs::remove_file(models.path().join("emotion_of_whisper/model.safetensors")).unwrap();
    let error = Engine::new(EngineOptions {
        models: Some(models.path().into()),
        ..Default::default()
    });
    let error = error.err().unwrap().to_string();
    assert!(error.contains("emotion_of_whisper"), "{error}");
}
