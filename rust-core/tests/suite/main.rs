//! Tests of the whole library, in one binary so that it is linked once.

mod cafe_talk;
mod clean_heads;
mod corpus;
mod damaged;
mod emoface;
mod events;
mod expressions;
#[path = "../../../tests/eval/src/metrics/eyeballs_in_sight.rs"]
mod eyeballs_in_sight;
mod facetalk;
mod features;
mod head;
mod heard_emotion;
mod imports;
mod kept_faces;
mod landmarks;
mod lids;
mod life;
mod mouth_reach;
mod one_eye;
mod open_eyes;
mod parts;
mod performance;
mod performers;
mod rim_crossing;
mod sliders;
mod spread;
mod voice;
mod weight_stream;
mod weights;

use anyface::{CachePolicy, Engine, EngineOptions};

/// The engine of a system, without a cache.
fn engine(system: &str) -> Engine {
    Engine::new(EngineOptions {
        system: Some(system.into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
}
