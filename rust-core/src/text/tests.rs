use super::*;
use crate::{
    conditions::{ActionUnit, Event},
    nn::golden::{Golden, distance},
};

fn units(understood: &Understood) -> Vec<String> {
    let named = |unit: &(usize, Side, f32, f32)| unit.1.written(ACTION_UNITS[unit.0].name);
    understood.units.iter().map(named).collect()
}

#[test]
fn clauses_places_and_logits_equal_pytorch() {
    let golden = Golden::open("text_units_debug");
    let words =
        TextUnits::load(&golden.weights(), &golden.metadata("config"), Path::new("")).unwrap();
    let texts: Vec<String> = serde_json::from_str(&golden.metadata("texts")).unwrap();
    for (number, text) in texts.iter().enumerate() {
        let clauses = words.rules.clauses(text);
        let logits = clauses
            .iter()
            .map(|clause| words.tower.forward(clause, &words.space));
        let logits: Vec<f32> = logits.flatten().collect();
        let expected = golden.values(&format!("logits.{number}"));
        assert_eq!(logits.len(), expected.len(), "{text}");
        assert!(distance(&logits, &expected) < 1e-4, "{text}");
        let places = clauses.iter().flat_map(Clause::all_words);
        let places: Vec<f32> = places.flat_map(|word| words.space.of(word)).collect();
        let expected = golden.values(&format!("places.{number}"));
        assert_eq!(places.len(), expected.len(), "{text}");
        assert!(distance(&places, &expected) < 1e-4, "{text}");
    }
}

#[test]
fn the_sentences_of_table_13_are_understood() {
    let words = TextUnits::open(None).unwrap();
    for (text, expected) in [
        ("A person is smiling", &["12"][..]),
        ("A person is crying", &["4", "15"]),
        ("A person is blinking", &["45"]),
        ("A yawning person", &["26"]),
        ("A person closes his eyes", &["45"]),
        ("A not happy person", &["4", "15"]),
    ] {
        assert_eq!(units(&words.understand(text).unwrap()), expected, "{text}");
    }
}

#[test]
fn words_that_no_network_has_learned_are_understood() {
    let words = TextUnits::open(None).unwrap();
    for (text, expected) in [
        ("kiss", &["18", "8"][..]),
        ("looks up", &["63"]),
        ("a woman looks down", &["64"]),
        ("glances to the left", &["61"]),
        ("looks right", &["62"]),
        ("sneezes", &["4", "6", "9", "10", "45"]),
        ("wince", &["4", "6", "7", "10"]),
        ("puckers", &["18"]),
        ("presses her lips", &["23"]),
        ("the lips part", &["25"]),
        ("a haughty look", &["1", "2", "14", "17"]),
        ("smiles and looks up", &["12", "63"]),
    ] {
        assert_eq!(units(&words.understand(text).unwrap()), expected, "{text}");
    }
    let denied = words.understand("does not look up").unwrap();
    assert!(!units(&denied).contains(&"63".to_owned()));
}

#[test]
fn sides_and_amounts_are_those_that_are_said() {
    let words = TextUnits::open(None).unwrap();
    for (text, expected) in [
        ("winks with the right eye", &["45R"][..]),
        ("wink, the right eye", &["45R"]),
        ("closes the left eye", &["45L"]),
        ("wink", &["45L"]),
        ("blink", &["45"]),
        ("smile and wink", &["12", "45L"]),
    ] {
        assert_eq!(units(&words.understand(text).unwrap()), expected, "{text}");
    }
    let strength = |text: &str| words.understand(text).unwrap().units[0].2;
    assert!(strength("slightly smiling") < 0.75 * strength("smiling"));
    assert!(strength("a huge smile") > 1.2 * strength("a smile"));
}

#[test]
fn a_denied_emotion_is_not_shown() {
    let words = TextUnits::open(None).unwrap();
    let smile = ActionUnit::find("12").unwrap();
    for text in ["not happy", "she isn't happy", "never glad", "without joy"] {
        let understood = words.understand(text).unwrap();
        assert!(
            understood.units.iter().all(|unit| unit.0 != smile),
            "{text}"
        );
    }
}

#[test]
fn a_denied_movement_asks_for_no_other() {
    let words = TextUnits::open(None).unwrap();
    for text in [
        "no raised eyebrows",
        "without opening the mouth",
        "never closes her eyes",
    ] {
        assert_eq!(
            words.understand(text).unwrap(),
            Understood::default(),
            "{text}"
        );
    }
    let smile = units(&words.understand("a smile without raised eyebrows").unwrap());
    assert_eq!(smile, units(&words.understand("a smile").unwrap()));
    // A denied emotion is another emotion.
    assert_eq!(units(&words.understand("not happy").unwrap()), ["4", "15"]);
}

#[test]
fn what_says_nothing_to_a_face_has_a_hint_at_most() {
    let words = TextUnits::open(None).unwrap();
    for text in ["the blue car", "ein rotes Fahrrad", "你好"] {
        let understood = words.understand(text).unwrap();
        assert_eq!(units(&understood), [""; 0], "{text}");
    }
    // A colour lies near to sorrow, a car near to nothing.
    assert_eq!(words.understand("the blue car").unwrap().hint, None);
    assert_eq!(
        words.understand("vengeful").unwrap().hint.as_deref(),
        Some("frown")
    );
    for text in ["", "  ", "the", "!?", "12345"] {
        assert_eq!(
            words.understand(text).unwrap(),
            Understood::default(),
            "{text:?}"
        );
    }
}

#[test]
fn places_are_near_for_words_that_mean_alike() {
    let words = TextUnits::open(None).unwrap();
    let place = |word: &str| words.place(word).unwrap();
    let near = |a: &str, b: &str| cosine(&place(a), &place(b));
    assert!(near("astonished", "surprised") > near("astonished", "calm") + 0.5);
    assert!(near("glad", "happy") > near("glad", "unhappy") + 0.5);
    assert_eq!(words.place("the"), None);
    assert_eq!(words.emotions.dim(), (EMOTIONS.len(), 64));
    let happy = words.emotions.row(1).to_owned();
    assert!(cosine(&happy, &place("glad")) > 0.6);
}

#[test]
fn events_are_read_from_words() {
    let reader = Reader::default();
    let event = reader.event("1.2-2.0:winks:0.8").unwrap();
    assert_eq!(event.slot_s, [1.2, 2.0]);
    assert_eq!(event.units, [(15, Side::Left)]);
    assert!(
        0.6 < event.strength && event.strength < 1.0,
        "{}",
        event.strength
    );
    // A word of the menu means what the menu says, in every front end.
    let wink = reader.event("1.2-2.0:left wink:0.8").unwrap();
    assert_eq!(wink.written_units(), ["6L", "45L"]);
    assert_eq!(wink.strength, 0.8);
    let plain = "0.5-0.9:12,AU06L:0.7";
    assert_eq!(reader.event(plain).unwrap(), Event::parse(plain).unwrap());
    let strong = reader.event("0-1:a huge smile:2").unwrap();
    assert!(strong.strength <= crate::conditions::MAX_EVENT_STRENGTH);
}

#[test]
fn events_that_say_nothing_are_refused_with_a_hint() {
    let reader = Reader::default();
    let said = |text| reader.event(text).unwrap_err().to_string();
    let blue = said("1-2:the blue car");
    assert!(
        blue.contains("the blue car") && blue.contains("expected") && !blue.contains("nearest")
    );
    assert!(said("1-2:vengeful").contains("nearest that is understood: \"frown\""));
    for wrong in [
        "2-1:smile",
        "1-2:smile:3",
        "1-2",
        "1-2:",
        "x-2:smile",
        "1-2:99",
        "1-2::1",
        "",
        ":::",
    ] {
        assert!(
            matches!(reader.event(wrong), Err(Error::InvalidInput(_))),
            "{wrong}"
        );
    }
}

#[test]
fn files_hold_the_same_events_as_text() {
    let reader = Reader::default();
    let json =
        r#"{"events": [{"start_s": 1.2, "end_s": 2, "units": ["12", "AU06L"], "strength": 0.8}]}"#;
    assert_eq!(
        reader.events_of_json(json).unwrap(),
        [Event::parse("1.2-2:12,6L:0.8").unwrap()]
    );
    let words = r#"[{"start_s": 1.5, "end_s": 2, "units": "left wink!:0.5", "strength": 0.5}]"#;
    let events = reader.events_of_json(words).unwrap();
    assert_eq!(events, [Event::parse("1.5-2:6L,45L:0.25!").unwrap()]);
    let written = events_to_json(&events);
    assert_eq!(
        reader.events_of_json(&written).unwrap(),
        events,
        "{written}"
    );
    for (wrong, reason) in [
        (
            r#"[{"start_s": 2, "end_s": 1, "units": ["12"]}]"#,
            "event 1",
        ),
        (r#"[{"start_s": 2, "end_s": 3, "units": ["99"]}]"#, "99"),
        (r#"[{"start_s": 2, "units": ["1"]}]"#, "end_s"),
        (r#"{"start": 2}"#, "expected a JSON list"),
        (
            r#"[{"start_s": 0, "end_s": 1, "units": ["1"], "strength": "much"}]"#,
            "much",
        ),
    ] {
        let error = reader.events_of_json(wrong).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn lines_and_json_are_events() {
    let reader = Reader::default();
    let lines = reader.events("1.2-2.0:12,6L:0.8\n\n2.4-2.8:45L\n").unwrap();
    assert_eq!(lines[0], Event::parse("1.2-2.0:12,6L:0.8").unwrap());
    assert_eq!(lines.len(), 2);
    assert_eq!(
        reader
            .events(&format!("\n {}", events_to_json(&lines)))
            .unwrap(),
        lines
    );
    assert_eq!(reader.events("\n").unwrap(), []);
    for wrong in [
        "0-1:12\n2-1:12",
        r#"[{"start_s": 0, "end_s": 1, "units": "12"}, 7]"#,
    ] {
        let error = reader.events(wrong).unwrap_err().to_string();
        assert!(error.contains("event 2"), "{error}");
    }
}

#[test]
fn what_was_read_in_a_text_is_json() {
    let reader = Reader::default();
    assert_eq!(
        reader.expression_to_json("right wink!:0.5").unwrap(),
        r#"{"said":"right wink","units":["6R","45R"],"strength":0.5,"over_speech":true,"hint":""}"#
    );
    let nothing = reader.expression_to_json(" 12345 ").unwrap();
    let start = r#"{"said":"12345","units":[],"strength":0.0,"over_speech":false,"hint":""#;
    assert!(
        nothing.starts_with(start) && nothing.contains("got 12345"),
        "{nothing}"
    );
    assert!(reader.expression_to_json(&"a".repeat(2000)).is_err());
}

#[test]
fn damaged_files_are_refused() {
    let golden = Golden::open("text_units_debug");
    let config = golden.metadata("config");
    let load = |config: &str| TextUnits::load(&golden.weights(), config, Path::new(""));
    assert!(load(&config).is_ok());
    for (right, wrong) in [
        ("\"45\"", "\"46\""),
        ("\"width\": 12", "\"width\": 11"),
        ("wink", "wi nk"),
        ("{", "["),
    ] {
        assert!(config.contains(right), "{right}");
        assert!(
            matches!(load(&config.replace(right, wrong)), Err(Error::Weights(_))),
            "{wrong}"
        );
    }
}

#[test]
fn texts_that_describe_no_face_by_their_length_are_refused() {
    let words = TextUnits::open(None).unwrap();
    let (reader, long) = (Reader::default(), "a".repeat(1 << 20));
    let messages = [
        words.understand(&long).unwrap_err(),
        words.understood_or_error(&long).unwrap_err(),
        words.emotion(&long).unwrap_err(),
        reader.event(&format!("0-1:{long}")).unwrap_err(),
        reader.event(&long).unwrap_err(),
    ];
    for message in messages.map(|error| error.to_string()) {
        assert!(
            message.starts_with("text: expected at most 1000 letters, got 104"),
            "{message:.200}"
        );
    }
    assert!(words.understand(&"a smile ".repeat(125)).is_ok());
}
