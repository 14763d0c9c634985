//! What events move on a face, what they leave alone, and how fast.

use anyface::{
    Engine, MotionRequest, Performance,
    audio::Waveform,
    conditions::{ACTION_UNITS, EmotionCurve, MENU},
    job::SILENT,
    motion::Motion,
    text::Reader,
};
use ndarray::{Array3, ArrayView2, Axis, s};

use crate::{cafe_talk::request_with, engine, voice::babble};

/// What each event must and must not move.
const TABLE: &str = include_str!("event_table.txt");
const FPS: f64 = 60.0;
/// Seconds from one event to the next, and the slot of each event within them.
const EVERY_S: f64 = 3.0;
const SLOT_S: [f64; 2] = [0.8, 1.6];
/// The largest step of the corners of the mouth from frame to frame, metres.
const MOST_M: f32 = 1e-3;

/// The rows of the table: what stands before the semicolon, and the cells behind it.
fn rows() -> Vec<(&'static str, Vec<&'static str>)> {
    let lines = TABLE.lines().filter(|line| !line.starts_with('#'));
    let row = |line: &'static str| {
        let (name, cells) = line.split_once(';').expect("a semicolon after the event");
        (name.trim(), cells.split_whitespace().collect())
    };
    lines.map(row).collect()
}

fn silence(seconds: f64) -> Waveform {
    let samples = vec![0.0; (16_000.0 * seconds) as usize];
    Waveform { samples }
}

/// A request with nothing that chance adds.
fn calm() -> MotionRequest {
    MotionRequest {
        fps: FPS,
        ..request_with(&[])
    }
}

/// All events of the table, one after the other in silence.
fn all_events(names: &[&str]) -> Performance {
    let reader = Reader::default();
    let event = |(n, name): (usize, &&str)| {
        let [from_s, to_s] = SLOT_S.map(|second| second + n as f64 * EVERY_S);
        reader.event(&format!("{from_s}-{to_s}:{name}")).unwrap()
    };
    let request = MotionRequest {
        events: names.iter().enumerate().map(event).collect(),
        ..calm()
    };
    let sound = silence(EVERY_S * names.len() as f64);
    engine("cafe-talk")
        .perform(&sound, &request, SILENT)
        .unwrap()
}

/// The landmarks of the mean face, `[T, 68, 3]`, metres.
fn landmarks(engine: &Engine, motion: &Motion) -> Array3<f32> {
    let clip = engine.landmarks_of(motion).unwrap();
    clip.displacements
}

/// How far the quantities of the table are from rest in a frame, millimetres and degrees.
fn quantities(face: ArrayView2<'_, f32>, gaze: ArrayView2<'_, f32>) -> Vec<f32> {
    let mm = |n: usize, axis: usize| 1e3 * face[[n, axis]];
    let mean =
        |of: &[usize], axis: usize| of.iter().map(|&n| mm(n, axis)).sum::<f32>() / of.len() as f32;
    let apart = |pairs: &[(usize, usize)]| {
        let gaps = pairs.iter().map(|&(up, low)| mm(up, 1) - mm(low, 1));
        gaps.sum::<f32>() / pairs.len() as f32
    };
    let turn = |axis: usize| gaze.column(axis).mean().unwrap().to_degrees();
    vec![
        mean(&[20, 21], 1),
        mean(&[22, 23], 1),
        mean(&[17, 18], 1),
        mean(&[25, 26], 1),
        apart(&[(37, 41), (38, 40)]),
        apart(&[(43, 47), (44, 46)]),
        mm(48, 1),
        mm(54, 1),
        mm(54, 0) - mm(48, 0),
        apart(&[(61, 67), (62, 66), (63, 65)]),
        mean(&[50, 51, 52, 56, 57, 58], 2),
        mm(8, 1),
        mm(33, 1),
        turn(0),
        turn(1),
    ]
}

/// The largest step of the corners of the mouth in some frames, metres.
fn largest_step(face: &Array3<f32>, frames: std::ops::Range<usize>) -> f32 {
    let corners = face.slice(s![frames, 48..55; 6, ..]);
    let before = corners.axis_iter(Axis(0));
    let steps = before.clone().zip(before.skip(1)).flat_map(|(a, b)| {
        let step = &b - &a;
        let lengths = step.outer_iter().map(|way| way.dot(&way).sqrt());
        lengths.collect::<Vec<f32>>()
    });
    steps.fold(0.0, f32::max)
}

#[test]
fn each_event_moves_what_it_must_and_nothing_else_and_no_faster_than_a_face() {
    let table = rows();
    let [names, moves, stays, ..] = &table[..] else {
        panic!("expected rows with names and limits");
    };
    let limits = |row: &[&str]| -> Vec<f32> { row.iter().map(|x| x.parse().unwrap()).collect() };
    let (moves, stays) = (limits(&moves.1), limits(&stays.1));
    let events: Vec<&str> = table[3..].iter().map(|(event, _)| *event).collect();
    for (word, _) in MENU {
        assert!(events.contains(&word), "{word} is not in the table");
    }
    for unit in ACTION_UNITS {
        for side in ["", "L", "R"]
            .iter()
            .take(if unit.has_sides() { 3 } else { 1 })
        {
            let unit = format!("{}{side}", unit.name);
            assert!(
                events.contains(&unit.as_str()),
                "{unit} is not in the table"
            );
        }
    }
    let performed = all_events(&events);
    let face = landmarks(&engine("cafe-talk"), &performed.motion);
    let mut wrong = Vec::new();
    for (n, (event, signs)) in table[3..].iter().enumerate() {
        let at = |second: f64| ((second + n as f64 * EVERY_S) * FPS) as usize;
        let in_frame = |t: usize| {
            let gaze = performed.life.gaze.index_axis(Axis(0), t);
            quantities(face.index_axis(Axis(0), t), gaze)
        };
        let (rest, shown) = (in_frame(at(0.02)), in_frame(at(1.2)));
        for (k, sign) in signs.iter().enumerate() {
            let change = shown[k] - rest[k];
            let is_right = match *sign {
                "+" => change >= moves[k],
                "-" => change <= -moves[k],
                "0" => change.abs() <= stays[k],
                "<" => change <= stays[k],
                "." => true,
                other => panic!("{event}: expected + - 0 < or ., got {other}"),
            };
            if !is_right {
                wrong.push(format!("{event}: {} {sign} {change:.1}", names.1[k]));
            }
        }
        let step = largest_step(&face, at(0.0)..at(EVERY_S).min(face.dim().0));
        if step > MOST_M {
            wrong.push(format!(
                "{event}: corners go {:.2} mm in a frame",
                1e3 * step
            ));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn eyes_that_roll_go_up_from_one_side_to_the_other() {
    let gaze = all_events(&["roll eyes"]).life.gaze;
    let at = |second: f64| {
        let frame = gaze.index_axis(Axis(0), (second * FPS) as usize);
        [0, 1].map(|axis| frame[[0, axis]].to_degrees())
    };
    let ([first, _], [middle, up], [last, _]) = (at(0.9), at(1.2), at(1.5));
    assert!(
        first < -15.0 && last > 15.0 && middle.abs() < 3.0,
        "{first} {middle} {last}"
    );
    assert!(up > 15.0, "{up}");
}

#[test]
fn a_kiss_in_speech_shuts_the_lips_and_speech_goes_on_after_it() {
    let engine = engine("cafe-talk");
    let voice = Waveform {
        samples: babble(6.0, 16_000),
    };
    let gap = |event: &str| -> Vec<f32> {
        let request = MotionRequest {
            events: vec![Reader::default().event(event).unwrap()],
            ..calm()
        };
        let performed = engine.perform(&voice, &request, SILENT).unwrap();
        let face = landmarks(&engine, &performed.motion);
        let apart = |frame: ArrayView2<'_, f32>| 1e3 * (frame[[62, 1]] - frame[[66, 1]]);
        face.outer_iter().map(apart).collect()
    };
    let (kiss, none) = (gap("2-3:kiss"), gap("2-3:kiss:0"));
    let largest = |gap: &[f32]| gap.iter().copied().fold(f32::MIN, f32::max);
    assert!(
        largest(&none[125..175]) > 4.0,
        "{}",
        largest(&none[125..175])
    );
    assert!(
        largest(&kiss[125..175]) < 0.5,
        "{}",
        largest(&kiss[125..175])
    );
    assert!(largest(&kiss[270..]) > 4.0);
}

#[test]
fn feelings_that_change_at_once_change_as_on_a_face_and_cuts_come_on_request() {
    let keys = "0:neutral 1:neutral 1.01:happy:1 3:happy:1 3.05:angry:1 5:angry:1 5.01:happy:1 7:happy 7.01:neutral";
    let mut request = calm();
    request.emotion = EmotionCurve::parse_keys(keys).unwrap();
    for system in ["freetalk", "cafe-talk", "emoface", "facetalk"] {
        let engine = engine(system);
        let step = |onset: f32| {
            let controls = request.controls.with("onset", onset);
            let request = MotionRequest {
                controls,
                ..request.clone()
            };
            let performed = engine.perform(&silence(9.0), &request, SILENT).unwrap();
            largest_step(&landmarks(&engine, &performed.motion), 0..540)
        };
        let (usual, cut) = (step(1.0), step(0.0));
        assert!(usual <= MOST_M, "{system}: {usual} m");
        assert!(cut > 2.0 * MOST_M, "{system}: {cut} m");
    }
}
