use ndarray::Array3;
use proptest::prelude::*;

use super::*;
use crate::annotation::AnnotationFormat;

/// A mouth 50 wide with lips 1 apart.
fn neutral() -> [[f32; 3]; 68] {
    let mut places = [[0.0; 3]; 68];
    (places[48][0], places[54][0]) = (-25.0, 25.0);
    for (upper, lower) in [(61, 67), (62, 66), (63, 65)] {
        places[lower][1] = -1.0;
        places[upper][1] = 0.0;
    }
    places
}

/// A motion with these openings and widths, both as shares of the width at rest.
fn moving(frames: &[(f32, f32)]) -> Array3<f32> {
    let mut moved = Array3::zeros((frames.len(), 68, 3));
    for (t, &(open, width)) in frames.iter().enumerate() {
        for lower in [65, 66, 67] {
            moved[[t, lower, 1]] = -50.0 * open;
        }
        moved[[t, 48, 0]] = 25.0 * (1.0 - width);
        moved[[t, 54, 0]] = -25.0 * (1.0 - width);
    }
    moved
}

fn labels(chart: &Annotation) -> Vec<&str> {
    chart.tiers[0]
        .intervals
        .iter()
        .map(|i| i.label.as_str())
        .collect()
}

fn ask(frames: &[(f32, f32)], said: Option<&Annotation>, options: ChartOptions) -> Annotation {
    draw(&neutral(), moving(frames).view(), 24.0, said, &options).unwrap()
}

#[test]
fn each_mouth_is_told_by_what_it_looks_like() {
    let hold = |open: f32, width: f32| vec![(open, width); 6];
    let all = [
        hold(0.06, 1.0),
        hold(0.28, 1.0),
        hold(0.09, 0.87),
        hold(0.16, 1.0),
        hold(0.0, 1.0),
    ];
    let options = ChartOptions::default();
    assert_eq!(
        labels(&ask(&all.concat(), None, options)),
        ["B", "D", "F", "C", "X"]
    );
    let blair = ChartOptions {
        mouths: Symbols::Papagayo,
        ..options
    };
    assert_eq!(
        labels(&ask(&all.concat(), None, blair)),
        ["etc", "AI", "U", "E", "rest"]
    );
}

#[test]
fn lips_that_close_for_what_is_said_are_a_for_as_long_as_it_holds() {
    let mut frames = vec![(0.15, 1.0); 24];
    frames[10].0 = 0.0;
    let said = Annotation::of_closures(&[[10.0 / 24.0, 11.0 / 24.0]], 1.0);
    for (hold, on) in [(1, 1), (2, 1), (3, 1), (2, 2), (4, 2)] {
        let options = ChartOptions {
            hold,
            on,
            ..ChartOptions::default()
        };
        let chart = ask(&frames, Some(&said), options);
        let closed: Vec<_> = chart.tiers[0]
            .intervals
            .iter()
            .filter(|i| i.label == "A")
            .collect();
        assert_eq!(closed.len(), 1);
        let (first, last) = (closed[0].start_s * 24.0, closed[0].end_s * 24.0);
        assert!(first <= 10.0 && last >= 11.0, "{first} to {last}");
        assert!((last - first).round() as usize >= hold);
        assert_eq!(first.round() as usize % on, 0);
    }
}

#[test]
fn teeth_and_tongue_are_told_by_what_is_said() {
    let text = "0 0.25 f\n0.25 0.5 l\n0.5 1.0 s\n";
    let said = Annotation::from_text(text, AnnotationFormat::Plain, 24.0).unwrap();
    let frames: Vec<_> = (0..24)
        .map(|t| if t < 6 { (0.03, 1.0) } else { (0.12, 1.0) })
        .collect();
    let chart = ask(&frames, Some(&said), ChartOptions::default());
    assert_eq!(labels(&chart)[..2], ["G", "H"]);
    assert!(!labels(&ask(&frames, None, ChartOptions::default())).contains(&"G"));
}

#[test]
fn th_shows_the_tongue_as_l_does() {
    for phone in ["th", "DH", "θ", "ð"] {
        let text = format!("0 0.5 {phone}\n0.5 1.0 s\n");
        let said = Annotation::from_text(&text, AnnotationFormat::Plain, 24.0).unwrap();
        let chart = ask(&[(0.1, 1.0); 24], Some(&said), ChartOptions::default());
        assert_eq!(labels(&chart)[0], "H", "{phone}");
    }
}

#[test]
fn closures_and_vowels_have_holds_of_their_own() {
    // Open, closed for one frame, open, wide open for one frame, open.
    let mut frames = vec![(0.06, 1.0); 36];
    frames[10].0 = 0.0;
    frames[24] = (0.30, 1.0);
    let said = Annotation::of_closures(&[[10.0 / 24.0, 11.0 / 24.0]], 1.5);
    let longest = |options: ChartOptions, label: &str| {
        let chart = ask(&frames, Some(&said), options);
        let of = chart.tiers[0].intervals.iter().filter(|i| i.label == label);
        of.map(|i| ((i.end_s - i.start_s) * 24.0).round() as usize)
            .collect::<Vec<_>>()
    };
    let plain = ChartOptions {
        hold: 1,
        ..ChartOptions::default()
    };
    assert_eq!(longest(plain, "A"), [1]);
    assert_eq!(longest(plain, "D"), [1]);
    let closures = ChartOptions {
        closure_hold: 4,
        ..plain
    };
    assert_eq!(longest(closures, "A"), [4]);
    assert_eq!(longest(closures, "D"), [1]);
    // A mouth that is wide for one frame is not drawn if it would have to stay for six.
    let vowels = ChartOptions {
        vowel_hold: 6,
        ..plain
    };
    assert_eq!(longest(vowels, "A"), [1]);
    assert!(longest(vowels, "D").iter().all(|&frames| frames >= 6));
    assert!(longest(vowels, "C").iter().all(|&frames| frames >= 6));
}

#[test]
fn a_chart_is_written_as_its_own_letters() {
    let chart = ask(&[(0.06, 1.0); 12], None, ChartOptions::default());
    assert_eq!(
        chart.to_text(AnnotationFormat::RhubarbTsv, 24.0),
        "0.000\tB\n0.500\tX\n"
    );
    let blair = ChartOptions {
        mouths: Symbols::Papagayo,
        ..ChartOptions::default()
    };
    let chart = ask(&[(0.28, 1.0); 12], None, blair);
    assert_eq!(
        chart.to_text(AnnotationFormat::MohoSwitch, 24.0),
        "MohoSwitch1\n1 AI\n13 rest\n"
    );
}

proptest! {
    #[test]
    fn nothing_stands_shorter_than_it_should(
        frames in proptest::collection::vec((0.0f32..0.4, 0.8f32..1.1), 1..80),
        hold in 1usize..7,
        on in 1usize..5,
    ) {
        let options = ChartOptions { hold, on, ..ChartOptions::default() };
        let chart = ask(&frames, None, options);
        let intervals = &chart.tiers[0].intervals;
        prop_assert_eq!(intervals[0].start_s, 0.0);
        let end = frames.len() as f64 / 24.0;
        prop_assert!((intervals[intervals.len() - 1].end_s - end).abs() < 1e-9);
        for (number, interval) in intervals.iter().enumerate() {
            let count = ((interval.end_s - interval.start_s) * 24.0).round() as usize;
            // The end may cut short a pose that spans several frames.
            let is_last = number + 1 == intervals.len();
            let short = if is_last { on - 1 } else { 0 };
            prop_assert!(count + short >= hold.min(frames.len()), "{count} of {hold}");
            prop_assert_eq!((interval.start_s * 24.0).round() as usize % on, 0);
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let moved = moving(&[(0.1, 1.0); 4]);
    let refused = |fps: f64, options: ChartOptions| {
        draw(&neutral(), moved.view(), fps, None, &options).is_err()
    };
    let plain = ChartOptions::default();
    assert!(refused(0.0, plain));
    assert!(refused(24.0, ChartOptions { on: 0, ..plain }));
    assert!(refused(24.0, ChartOptions { hold: 0, ..plain }));
    assert!(refused(
        24.0,
        ChartOptions {
            mouths: Symbols::Words,
            ..plain
        }
    ));
    assert!(draw(&[[0.0; 3]; 68], moved.view(), 24.0, None, &plain).is_err());
}
