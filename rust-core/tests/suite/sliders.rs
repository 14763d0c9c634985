//! Compares sliders of a finished take with new runs at the values that they stand for.

use anyface::{
    CachePolicy, Engine, EngineOptions, Face, MotionRequest, Performance, SliderChange,
    audio::Waveform,
    cache::Cache,
    conditions::{Controls, EmotionCurve, Event},
    deform::{
        Creases, StaticWeights, VertexClip,
        compression::{VertexBasis, compress},
        static_deformer,
    },
    face::Deformer,
    job::SILENT,
    mesh::PartChoices,
    motion::{Life, Motion, PerformanceControls},
    spread::{Collector, Movement},
    systems::Slider,
};
use ndarray::{Array2, Array3, Axis};

use crate::{head, voice::babble};

const MAX_ERROR_M: f32 = 1e-4;
/// How many vertices the default head's tongue has. They are the head's last ones.
const TONGUE: isize = 146;

fn voice() -> Waveform {
    Waveform {
        samples: babble(4.0, 16_000),
    }
}

fn request(emotion: &str) -> MotionRequest {
    MotionRequest {
        emotion: EmotionCurve::parse(emotion).unwrap(),
        controls: PerformanceControls {
            blinks_per_minute: 30.0,
            ..PerformanceControls::default()
        }
        .into(),
        ..MotionRequest::default()
    }
}

/// A take of the default head with everything that its sliders need.
struct Take {
    engine: Engine,
    face: Face,
    performance: Performance,
    clip: VertexClip,
    basis: VertexBasis,
}

impl Take {
    fn new(request: &MotionRequest) -> Take {
        Take::of(head::engine(), request)
    }

    fn of(engine: Engine, request: &MotionRequest) -> Take {
        let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
        let performance = engine.perform(&voice(), request, SILENT).unwrap();
        let clip = spread(&engine, &face, &performance);
        let basis = compress(&clip, MAX_ERROR_M, 256, SILENT).unwrap();
        Take {
            engine,
            face,
            performance,
            clip,
            basis,
        }
    }

    fn changes(&self) -> Vec<SliderChange> {
        let take = (&self.face, &self.clip, &self.basis);
        let result = self
            .performance
            .slider_changes(&self.engine, take.0, take.1, take.2, SILENT);
        result.unwrap()
    }

    /// Mean and largest distance, mm, between the take with changed weights and a motion. Leaves
    /// out the tongue, which has its own test.
    fn distance(&self, change: &Array2<f32>, (motion, life): &(Motion, Life)) -> (f32, f32) {
        let movement = Movement::from(motion).with_tongue(life);
        let truth = spread(&self.engine, &self.face, movement);
        let basis = VertexBasis {
            weights: &self.basis.weights + change,
            ..self.basis.clone()
        };
        let face = |moved: &Array3<f32>| moved.slice(ndarray::s![.., ..-TONGUE, ..]).to_owned();
        distance(&face(&basis.displacements()), &face(&truth.displacements))
    }
}

fn spread<'a>(engine: &Engine, face: &Face, movement: impl Into<Movement<'a>>) -> VertexClip {
    let mut collector = Collector::default();
    engine
        .spread(face, movement, &mut collector, SILENT)
        .unwrap();
    collector.into_animation().vertices
}

fn distance(a: &Array3<f32>, b: &Array3<f32>) -> (f32, f32) {
    let lengths = (a - b).map_axis(Axis(2), |d| 1000.0 * d.dot(&d).sqrt());
    (
        lengths.mean().unwrap(),
        lengths.iter().copied().fold(0.0, f32::max),
    )
}

fn of(changes: &[SliderChange], slider: Slider) -> &SliderChange {
    changes
        .iter()
        .find(|change| change.slider == slider)
        .unwrap()
}

#[test]
fn a_variation_is_the_run_that_it_stands_for() {
    let (engine, base) = (head::engine(), request("happy:0.8"));
    let performance = engine.perform(&voice(), &base, SILENT).unwrap();
    let run = |request: &MotionRequest| {
        let performance = engine.perform(&voice(), request, SILENT).unwrap();
        (performance.motion, performance.life.tongue)
    };
    assert_eq!(
        (performance.motion.clone(), performance.life.tongue.clone()),
        run(&base)
    );
    let vary = |of: &Performance, slider, position| {
        let (motion, life) = of.varied(&engine, slider, position, SILENT).unwrap();
        (motion, life.tongue)
    };
    for (slider, position) in [(Slider::Articulation, 1.3), (Slider::Blinks, 0.0)] {
        let mut changed = base.clone();
        match slider {
            Slider::Articulation => changed.controls.set("articulation", position),
            _ => changed.controls.set("blinks_per_minute", position),
        }
        assert_eq!(
            vary(&performance, slider, position),
            run(&changed),
            "{slider:?}"
        );
    }
    // A new emotion changes when the eyes blink and how the head moves, and so how the eyes turn
    // against the head. The slider changes none of these.
    let mut unblinking = base.clone();
    unblinking.controls.set("blinks_per_minute", 0.0);
    unblinking.controls.set("gaze", 0.0);
    let performance = engine.perform(&voice(), &unblinking, SILENT).unwrap();
    let changed = MotionRequest {
        emotion: EmotionCurve::parse("happy:0.4").unwrap(),
        ..unblinking
    };
    assert_eq!(vary(&performance, Slider::Emotion, 0.5), run(&changed));
}

#[test]
fn sliders_come_near_to_new_runs() {
    let take = Take::new(&request("happy:0.8"));
    let changes = take.changes();
    // Mean and largest distance in mm, a little above those measured.
    for (slider, position, mean, largest) in [
        (Slider::Articulation, 1.3, 0.06, 0.9),
        (Slider::Articulation, 0.5, 0.09, 1.0),
        (Slider::Emotion, 0.5, 0.11, 1.05),
        (Slider::Emotion, 0.0, 0.2, 2.2),
        (Slider::Blinks, 0.0, 0.03, 0.5),
    ] {
        let truth = take
            .performance
            .varied(&take.engine, slider, position, SILENT)
            .unwrap();
        let still = take.distance(&Array2::zeros(take.basis.weights.dim()), &truth);
        let apart = take.distance(&of(&changes, slider).at(position), &truth);
        assert!(
            apart.0 < mean && apart.1 < largest,
            "{slider:?} {position}: {apart:?}"
        );
        assert!(
            still.1 > 2.0 * apart.1,
            "{slider:?} {position}: {still:?} {apart:?}"
        );
    }
}

#[test]
fn the_tongue_goes_with_articulation() {
    let take = Take::new(&request("happy:0.8"));
    let changes = take.changes();
    let change = of(&changes, Slider::Articulation);
    assert_eq!(change.knots, [0.0, 0.5, 1.2, 1.5, 2.0]);
    let tongue = |moved: &Array3<f32>| moved.slice(ndarray::s![.., -TONGUE.., ..]).to_owned();
    let still = tongue(&take.basis.displacements());
    // Largest distances in mm, a little above those measured.
    for (position, largest) in [(0.0, 1.8), (0.5, 1.1), (1.3, 1.3), (1.5, 2.0)] {
        let varied = take
            .performance
            .varied(&take.engine, Slider::Articulation, position, SILENT);
        let (motion, life) = varied.unwrap();
        let movement = Movement::from(&motion).with_tongue(&life);
        let truth = spread(&take.engine, &take.face, movement);
        let basis = VertexBasis {
            weights: &take.basis.weights + &change.at(position),
            ..take.basis.clone()
        };
        let truth = tongue(&truth.displacements);
        let (way, left) = (
            distance(&still, &truth).1,
            distance(&tongue(&basis.displacements()), &truth).1,
        );
        assert!(
            left < largest && way > 3.0 * left,
            "{position}: {left} of {way} mm"
        );
    }
}

#[test]
fn sliders_of_weights_come_near_to_new_runs() {
    let engine = Engine::new(EngineOptions {
        system: Some("cafe-talk".into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    });
    let mut with_events = request("happy:0.8");
    with_events.controls = Controls::default().with("blinks_per_minute", 30.0);
    with_events.events = vec![Event::parse("1-2:12,6").unwrap()];
    let take = Take::of(engine.unwrap(), &with_events);
    let changes = take.changes();
    let sliders: Vec<Slider> = changes.iter().map(|change| change.slider).collect();
    assert_eq!(sliders, Slider::ALL);
    // Mean and largest distance in mm, a little above those measured.
    for (slider, position, mean, largest) in [
        (Slider::Articulation, 1.3, 0.04, 0.4),
        (Slider::Articulation, 0.5, 0.06, 0.6),
        (Slider::Emotion, 0.5, 0.03, 0.6),
        (Slider::Emotion, 0.0, 0.06, 0.9),
        (Slider::Blinks, 0.0, 0.02, 0.3),
    ] {
        let truth = take
            .performance
            .varied(&take.engine, slider, position, SILENT)
            .unwrap();
        let still = take.distance(&Array2::zeros(take.basis.weights.dim()), &truth);
        let apart = take.distance(&of(&changes, slider).at(position), &truth);
        assert!(
            apart.0 < mean && apart.1 < largest && still.1 > 2.0 * apart.1,
            "{slider:?} {position}: {still:?} {apart:?}"
        );
    }
}

#[test]
fn emotion_and_blinks_go_together() {
    // Anger narrows the eyes, so the lids have a shorter way to go.
    let take = Take::new(&request("angry:1"));
    let changes = take.changes();
    let both = Slider::EmotionAndBlinks;
    let truth = take
        .performance
        .varied(&take.engine, both, 0.0, SILENT)
        .unwrap();
    let each = of(&changes, Slider::Emotion).at(0.0) + of(&changes, Slider::Blinks).at(0.0);
    let together = of(&changes, both);
    let (each_alone, joint) = (
        take.distance(&each, &truth),
        take.distance(&(&each + &together.at(Slider::both(0.0, 0.0))), &truth),
    );
    // The largest distance is that of speech, which anger changes in more than one step.
    assert!(
        joint.1 < 1.9 && joint.0 < each_alone.0 - 0.002,
        "{each_alone:?} {joint:?}"
    );
    // The joint change has no effect while either slider is at the take's own value.
    for (emotion, blinks) in [(1.0, 0.0), (0.3, 1.0)] {
        let none = together.at(Slider::both(emotion, blinks));
        assert!(none.iter().all(|x| *x == 0.0));
    }
    let blinks = of(&changes, Slider::Blinks).at(0.0);
    for (row, blinks) in together.changes[0].outer_iter().zip(blinks.outer_iter()) {
        assert!(blinks.iter().any(|x| *x != 0.0) || row.iter().all(|x| *x == 0.0));
    }
}

#[test]
fn shapes_at_rest_stay_so_but_for_six() {
    // A slider may move four further shapes in a frame, and two more that serve the tongue.
    let take = Take::new(&request("happy:0.8"));
    let count = |weights: &Array2<f32>| -> Vec<usize> {
        let moving = |row: ndarray::ArrayView1<'_, f32>| row.iter().filter(|w| **w != 0.0).count();
        weights.outer_iter().map(moving).collect()
    };
    let before = count(&take.basis.weights);
    assert!(
        before
            .iter()
            .any(|moving| moving + 6 < take.basis.weights.ncols())
    );
    let is_single = |change: &SliderChange| change.slider != Slider::EmotionAndBlinks;
    for change in take.changes().into_iter().filter(is_single) {
        let after = count(&(&take.basis.weights + &change.changes[0]));
        assert!(
            after
                .iter()
                .zip(&before)
                .all(|(after, before)| *after <= before + 6)
        );
    }
}

#[test]
fn blinks_change_the_frames_in_which_eyes_blink() {
    let take = Take::new(&request("neutral:0"));
    let changes = take.changes();
    let open = take
        .performance
        .varied(&take.engine, Slider::Blinks, 0.0, SILENT)
        .unwrap()
        .0;
    let change = of(&changes, Slider::Blinks).at(0.0);
    let mut blinking = 0;
    for (t, row) in change.outer_iter().enumerate() {
        let frame = |motion: &Motion| motion.values().index_axis(Axis(0), t).to_owned();
        let blinks = frame(&open) != frame(&take.performance.motion);
        assert_eq!(row.iter().any(|x| *x != 0.0), blinks, "frame {t}");
        blinking += usize::from(blinks);
    }
    assert!((5..60).contains(&blinking), "{blinking} frames of 120");
}

#[test]
fn what_has_nothing_to_move_has_no_slider() {
    let sliders = |request: &MotionRequest| -> Vec<Slider> {
        Take::new(request)
            .changes()
            .iter()
            .map(|change| change.slider)
            .collect()
    };
    let neutral = [Slider::Articulation, Slider::Blinks];
    assert_eq!(sliders(&request("neutral:1")), neutral);
    assert_eq!(sliders(&request("off")), [Slider::Articulation]);
    let mut silent = request("sad:1.5");
    silent.controls.set("articulation", 0.0);
    silent.controls.set("blinks_per_minute", 0.0);
    assert_eq!(sliders(&silent), [Slider::Emotion]);
}

#[test]
fn sliders_stop_where_their_controls_do() {
    let mut strong = request("happy:1.2");
    strong.controls.set("articulation", 1.6);
    let engine = head::engine();
    let performance = engine.perform(&voice(), &strong, SILENT).unwrap();
    let knots = |slider| performance.knots(&engine, slider);
    assert_eq!(knots(Slider::Articulation), [0.0, 1.25]);
    assert_eq!(knots(Slider::Emotion), [0.0, 0.5, 1.25]);
}

#[test]
fn some_vertices_move_as_they_do_among_all() {
    let take = Take::new(&request("happy:0.8"));
    let vertices: Vec<u32> = (0..take.clip.displacements.dim().1 as u32)
        .step_by(37)
        .collect();
    let (weights, creases) = (
        StaticWeights::open(None).unwrap(),
        Creases::open(None).unwrap(),
    );
    let (models, cache) = ((&weights, &creases), Cache::new(&CachePolicy::Off));
    let deformer = static_deformer(models, &take.face, 1.0, &cache, SILENT).unwrap();
    let few = deformer.of_vertices(&vertices).unwrap();
    assert!(
        vertices
            .iter()
            .all(|v| few.vertices.binary_search(v).is_ok())
    );
    let clip = take.performance.motion.landmarks().unwrap();
    let landmarks = take.face.motion_on_mesh(clip.displacements.view());
    let moved = few.deformer.deform(landmarks.view(), SILENT).unwrap();
    let rows: Vec<usize> = few.vertices.iter().map(|&v| v as usize).collect();
    // The deformer does not add the tongue's motion, so it is left out here as well.
    let without_tongue = spread(&take.engine, &take.face, &take.performance.motion);
    let all = without_tongue.displacements.select(Axis(1), &rows);
    // They include all of the skin around the eyes, which moves together.
    assert!(few.vertices.len() < 3000, "{} vertices", few.vertices.len());
    assert!(
        distance(&moved, &all).1 < 1e-4,
        "{:?} mm",
        distance(&moved, &all)
    );
}

#[test]
fn a_change_is_linear_between_knots_and_held_beyond() {
    let change = SliderChange {
        slider: Slider::Emotion,
        knots: vec![0.0, 0.5, 1.5],
        changes: [4.0, 1.0, 3.0]
            .map(|x| Array2::from_elem((1, 1), x))
            .to_vec(),
    };
    for (position, expected) in [
        (-1.0, 4.0),
        (0.0, 4.0),
        (0.25, 2.5),
        (0.75, 0.5),
        (1.0, 0.0),
        (1.25, 1.5),
        (2.0, 3.0),
    ] {
        assert!(
            (change.at(position)[[0, 0]] - expected).abs() < 1e-6,
            "{position}"
        );
    }
    let blinks = SliderChange {
        slider: Slider::Blinks,
        knots: vec![0.0],
        changes: vec![Array2::from_elem((1, 1), 2.0)],
    };
    assert_eq!(
        [0.0, 0.5, 1.0, 1.5].map(|s| blinks.at(s)[[0, 0]]),
        [2.0, 1.0, 0.0, 0.0]
    );
}

#[test]
fn a_clip_of_another_length_and_a_cancelled_job_are_errors() {
    let take = Take::new(&request("neutral:0"));
    let shorter = VertexClip {
        displacements: take
            .clip
            .displacements
            .slice(ndarray::s![..60, .., ..])
            .to_owned(),
        fps: take.clip.fps,
    };
    let (engine, face, performance) = (&take.engine, &take.face, &take.performance);
    let wrong = performance.slider_changes(engine, face, &shorter, &take.basis, SILENT);
    let message = wrong.unwrap_err().to_string();
    assert!(
        message.contains("120") && message.contains("60"),
        "{message}"
    );
    let stop = |p: anyface::job::Progress| p.stage != "sliders";
    let stopped = performance.slider_changes(engine, face, &take.clip, &take.basis, &stop);
    assert!(matches!(stopped, Err(anyface::Error::Cancelled)));
}
