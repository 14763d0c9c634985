use super::{super::*, *};
use crate::{
    conditions::EventTrack,
    job::SILENT,
    nn::golden::{Golden, distance},
};

fn golden() -> (Golden, Denoiser) {
    let golden = Golden::open("cafe_talk_debug");
    let config = CafeTalkConfig::from_json(&golden.metadata("config")).unwrap();
    let denoiser = Denoiser::new(config, &golden.weights()).unwrap();
    (golden, denoiser)
}

#[test]
fn single_passes_match_pytorch_under_every_condition() {
    let (golden, denoiser) = golden();
    let [noisy, speech, emotion, events] =
        ["noisy", "speech", "emotion", "events"].map(|name| golden.matrix(name));
    let intensity = golden.values("intensity");
    let coarse = Coarse {
        style: golden.integers("style")[0],
        emotion: emotion.view(),
        intensity: &intensity,
    };
    let timestep = golden.integers("timestep")[0];
    let frames = noisy.nrows();
    let conditioned = denoiser.conditions(frames, Some(speech.view()), Some(coarse));
    let nothing = denoiser.conditions(frames, None, None);
    let heard = denoiser.events(events.view());
    for (name, conditions, events) in [
        ("clean", &conditioned, Some(&heard)),
        ("clean_base", &conditioned, None),
        ("clean_null", &nothing, None),
    ] {
        let got = denoiser.denoise(&noisy, timestep, conditions, events);
        let error = distance(&got, &golden.matrix(name));
        assert!(error < 1e-4, "{name} {error}");
    }
}

#[test]
fn guided_runs_over_two_windows_match_pytorch() {
    let (golden, denoiser) = golden();
    let of = |name: &str| golden.matrix(&format!("long.{name}"));
    let [noise, speech, emotion, active] = ["noise", "speech", "emotion", "events"].map(of);
    let intensity = golden.values("long.intensity");
    let strengths = golden.matrix("long.strength");
    let still = ndarray::Array2::zeros(strengths.dim());
    for (name, strength, is_printed) in [
        ("weights", &still, false),
        ("controlled", &strengths, false),
        ("over_speech", &strengths, false),
        ("printed", &strengths, true),
    ] {
        let events = EventTrack {
            active: active.clone(),
            mask: strength.clone(),
            shown: strength.clone(),
            put_on: strength.clone(),
            shut: vec![0.0; strength.nrows()],
            over_speech: vec![name == "over_speech"; strength.nrows()],
        };
        let sampling = denoiser.config().sampling;
        let request = Request {
            speech: speech.view(),
            style: 2,
            emotion: emotion.view(),
            intensity: &intensity,
            events: &events,
            seed: 0,
            temperature: sampling.temperature,
            steps: sampling.steps,
            guidance: Guidance {
                alpha: sampling.alpha,
                beta: sampling.beta,
                is_printed,
            },
            window_cache: None,
        };
        let take = |rows: std::ops::Range<usize>| noise.slice(s![rows, ..]).to_owned();
        let got = denoiser.sample_from(&request, take, SILENT).unwrap();
        let error = distance(&got, &of(name));
        assert!(error < 1e-4, "{name} {error}");
    }
}

#[test]
fn what_is_far_from_every_event_hears_nothing_of_it() {
    let (golden, denoiser) = golden();
    let events = golden.matrix("events");
    let heard = denoiser.events(events.view());
    for t in [0, 1, 2, 3, 11, 12, 17, 20] {
        assert!(heard.row(t).iter().all(|x| *x == 0.0), "{t}");
    }
    assert!(heard.row(4).iter().any(|x| *x != 0.0));
}
