//! A folder with one damaged model: an engine of it is refused, or what it performs is finite.
//!
//! The first byte chooses the model, the second whether its config or its weights are damaged; the others
//! are places and bytes.
#![no_main]

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, progress::SILENT,
    systems::built_in_models,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let [choice, part, changes @ ..] = bytes else {
        return;
    };
    let models: Vec<_> = built_in_models().collect();
    let model = models[usize::from(*choice) % models.len()];
    let (mut weights, mut config) = (model.weights.to_vec(), model.config.as_bytes().to_vec());
    let target = if part % 2 == 0 { &mut config } else { &mut weights };
    for change in changes.chunks_exact(4) {
        let at = u32::from_le_bytes([change[0], change[1], change[2], 0]) as usize % target.len();
        target[at] = change[3];
    }
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join(model.name);
    std::fs::create_dir(&own).unwrap();
    std::fs::write(own.join("model.safetensors"), weights).unwrap();
    std::fs::write(own.join("config.json"), config).unwrap();
    let options = EngineOptions {
        models: Some(folder.path().to_owned()),
        cache: CachePolicy::Off,
        threads: Some(1),
        ..Default::default()
    };
    let Ok(engine) = Engine::new(options) else {
        return;
    };
    let samples = (0..4_000).map(|i| (i as f32 * 0.08).sin() * 0.5).collect();
    let request = MotionRequest::default();
    if let Ok(made) = engine.perform(&Waveform { samples }, &request, SILENT) {
        assert!(made.motion.values().iter().all(|x| x.is_finite()));
    }
});
