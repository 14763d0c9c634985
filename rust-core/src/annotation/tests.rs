use super::*;

const FORMATS: [AnnotationFormat; 6] = [
    AnnotationFormat::TextGrid,
    AnnotationFormat::RhubarbTsv,
    AnnotationFormat::RhubarbJson,
    AnnotationFormat::Papagayo,
    AnnotationFormat::MohoSwitch,
    AnnotationFormat::Plain,
];

#[test]
fn closures_come_back_from_every_format() {
    let closures = [[0.25, 0.5], [0.75, 1.0], [1.0, 1.25]];
    let heard = Annotation::of_closures(&closures, 2.0);
    for format in FORMATS {
        let text = heard.to_text(format, 24.0);
        let back = Annotation::from_text(&text, format, 24.0).unwrap();
        assert_eq!(back.closures().unwrap(), closures, "{format:?}:\n{text}");
        assert_eq!(back.to_text(format, 24.0), text, "{format:?}");
    }
}

#[test]
fn times_of_files_in_seconds_are_exact_to_a_millisecond() {
    let closures = [[0.1234, 0.2], [0.5078, 0.6]];
    let heard = Annotation::of_closures(&closures, 1.0);
    for format in &FORMATS[..3] {
        let back = Annotation::from_text(&heard.to_text(*format, 24.0), *format, 24.0).unwrap();
        for (got, want) in back.closures().unwrap().iter().zip(closures) {
            assert!((got[0] - want[0]).abs() < 6e-4, "{format:?}: {got:?}");
        }
    }
}

/// A short TextGrid as the Montreal Forced Aligner and Praat write it.
const SHORT: &str = "File type = \"ooTextFile\"\nObject class = \"TextGrid\"\n\n0\n1.5\n<exists>\n2\n\
    \"IntervalTier\"\n\"words\"\n0\n1.5\n2\n0\n0.9\n\"\"\n0.9\n1.5\n\"say \"\"hm\"\"\"\n\
    \"IntervalTier\"\n\"Anna - phones\"\n0\n1.5\n3\n0\n0.5\n\"AH0\"\n0.5\n0.9\n\"pʰ\"\n0.9\n1.5\n\"s\"\n";

#[test]
fn short_text_grids_and_tiers_by_name_are_read() {
    let read = Annotation::from_text(SHORT, AnnotationFormat::TextGrid, 24.0).unwrap();
    assert_eq!(read.closures().unwrap(), [[0.5, 0.9]]);
    let words = read.intervals(Symbols::Words);
    assert_eq!(words.len(), 1);
    assert_eq!(words[0].label, "say \"hm\"");
    assert_eq!(read.duration_s, 1.5);
}

#[test]
fn points_of_a_text_tier_are_intervals_without_length() {
    let text = "\"ooTextFile\" \"TextGrid\" 0 1 <exists> 1 \"TextTier\" \"phones\" 0 1 1 0.5 \"b\"";
    let read = Annotation::from_text(text, AnnotationFormat::TextGrid, 24.0).unwrap();
    assert_eq!(read.closures().unwrap(), [[0.5, 0.5]]);
}

#[test]
fn praats_wide_text_is_read() {
    for order in [u16::to_le_bytes, u16::to_be_bytes] {
        let units = "\u{feff}".encode_utf16().chain(SHORT.encode_utf16());
        let bytes: Vec<u8> = units.flat_map(order).collect();
        assert_eq!(decode(&bytes).unwrap(), SHORT);
    }
}

#[test]
fn a_papagayo_project_with_words_is_read_and_written() {
    let text = "lipsync version 1\n/tmp/a.wav\n24\n48\n1\n\tAnna\n\tmy home\n\t1\n\t\tmy home\n\t\t0\n\
        \t\t40\n\t\t2\n\t\t\tmy 12 17 2\n\t\t\t\t12 MBP\n\t\t\t\t15 AI\n\t\t\thome 24 35 3\n\t\t\t\t24 etc\n\
        \t\t\t\t28 O\n\t\t\t\t33 MBP\n";
    let read = Annotation::from_text(text, AnnotationFormat::Papagayo, 30.0).unwrap();
    assert_eq!(read.closures().unwrap(), [[0.5, 0.625], [1.375, 1.5]]);
    assert_eq!(read.intervals(Symbols::Words)[1].label, "home");
    assert_eq!(read.duration_s, 2.0);
    let again = read.to_text(AnnotationFormat::Papagayo, 24.0);
    let back = Annotation::from_text(&again, AnnotationFormat::Papagayo, 24.0).unwrap();
    assert_eq!(back.closures().unwrap(), read.closures().unwrap());
    assert!(again.contains("\t\t\tmy 12 17 2\n"), "{again}");
}

#[test]
fn rhubarbs_letters_in_switch_data_are_known() {
    let text = "MohoSwitch1\n1 X\n13 A\n19 C\n";
    let read = Annotation::from_text(text, AnnotationFormat::MohoSwitch, 24.0).unwrap();
    assert_eq!(read.closures().unwrap(), [[0.5, 0.75]]);
}

#[test]
fn phones_of_any_alphabet_that_close_the_lips_are_known() {
    for label in [
        "p", "P", "b", "m", "M", "EM0", "MBP", "pʰ", "mʲ", "m̩", "pf", "p_h",
    ] {
        assert!(Symbols::Phones.closes_lips(label), "{label}");
    }
    for label in ["f", "AH0", "W", "me", "pat", "", "sp", "ɱ"] {
        assert!(!Symbols::Phones.closes_lips(label), "{label}");
    }
    assert!(Symbols::Rhubarb.closes_lips("A") && !Symbols::Rhubarb.closes_lips("X"));
}

#[test]
fn words_alone_do_not_tell_when_lips_close() {
    let text = "0.1 0.4 map\n0.5 0.9 a\n";
    let read = Annotation::from_text(text, AnnotationFormat::Plain, 24.0).unwrap();
    assert_eq!(read.intervals(Symbols::Words).len(), 2);
    let message = read.closures().unwrap_err().to_string();
    assert!(message.contains("words alone"), "{message}");
    let phones = Annotation::from_text("0.1 0.2 m\n", AnnotationFormat::Plain, 24.0).unwrap();
    assert_eq!(phones.closures().unwrap(), [[0.1, 0.2]]);
}

#[test]
fn what_cannot_be_read_is_named_with_its_line() {
    let cases = [
        (AnnotationFormat::Plain, "0.1 0.2 p\n0.3 soon m\n", 2),
        (AnnotationFormat::Plain, "# phones\n0.1 0.2\n", 2),
        (AnnotationFormat::Plain, "0.1 0.3 p\n0.2 0.4 m\n", 2),
        (AnnotationFormat::RhubarbTsv, "0.00\tX\n0.10\tQ\n", 2),
        (AnnotationFormat::RhubarbTsv, "0.20\tX\n\n0.10\tA\n", 3),
        (AnnotationFormat::RhubarbJson, "{\n \"mouthCues\": 3\n}", 2),
        (AnnotationFormat::MohoSwitch, "MohoSwitch1\n0 rest\n", 2),
        (AnnotationFormat::MohoSwitch, "\nLipSync\n", 2),
        (
            AnnotationFormat::Papagayo,
            "lipsync version 1\na\nfast\n",
            3,
        ),
        (
            AnnotationFormat::TextGrid,
            "File type = \"ooTextFile\"\n\"Pitch\"",
            2,
        ),
        (
            AnnotationFormat::TextGrid,
            &SHORT.replace("0.5\n0.9\n\"p", "0.5\n0.4\n\"p"),
            27,
        ),
        (AnnotationFormat::TextGrid, &SHORT[..SHORT.len() - 3], 32),
    ];
    for (format, text, line) in cases {
        let message = Annotation::from_text(text, format, 24.0)
            .unwrap_err()
            .to_string();
        assert!(
            message.starts_with(&format!("{line}: ")) && message.contains("expected"),
            "{format:?}: line {line} in {message:?}"
        );
    }
}

#[test]
fn files_are_named_in_errors_and_told_by_their_extension() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.TextGrid");
    let heard = Annotation::of_closures(&[[0.25, 0.5]], 1.0);
    heard.write(&path, 24.0).unwrap();
    assert_eq!(Annotation::read(&path, 24.0).unwrap(), heard);
    std::fs::write(&path, "nothing").unwrap();
    let message = Annotation::read(&path, 24.0).unwrap_err().to_string();
    assert!(message.contains("a.TextGrid:1: expected"), "{message}");
    let other = folder.path().join("a.srt");
    let message = heard.write(&other, 24.0).unwrap_err().to_string();
    assert!(message.contains(".TextGrid"), "{message}");
}

/// What a recogniser hears: the word `pap`. The closures leave out its last p.
fn said() -> Annotation {
    let row = |start_s, end_s, label: &str| Interval {
        start_s,
        end_s,
        label: label.into(),
    };
    let tier = |symbols, intervals| Tier { symbols, intervals };
    let closures = vec![row(0.25, 0.5, CLOSED)];
    let phones = vec![
        row(0.25, 0.375, "p"),
        row(0.375, 1.0, "a"),
        row(1.0, 1.25, "p"),
    ];
    Annotation {
        tiers: vec![
            tier(Symbols::Closures, closures),
            tier(Symbols::Phones, phones),
            tier(Symbols::Words, vec![row(0.25, 1.25, "pap")]),
        ],
        duration_s: 1.5,
    }
}

#[test]
fn closures_beside_phones_stay_those_that_close_lips_in_every_format() {
    let formats = [
        AnnotationFormat::TextGrid,
        AnnotationFormat::RhubarbTsv,
        AnnotationFormat::RhubarbJson,
        AnnotationFormat::Papagayo,
        AnnotationFormat::MohoSwitch,
        AnnotationFormat::Plain,
    ];
    for format in formats {
        let text = said().to_text(format, 24.0);
        let back = Annotation::from_text(&text, format, 24.0).unwrap();
        assert_eq!(
            back.closures().unwrap(),
            [[0.25, 0.5]],
            "{format:?}: {text}"
        );
    }
    let grid = said().to_text(AnnotationFormat::TextGrid, 24.0);
    let back = Annotation::from_text(&grid, AnnotationFormat::TextGrid, 24.0).unwrap();
    assert_eq!(back, said());
}

#[test]
fn phones_are_mouth_shapes_between_closures() {
    let rhubarb = said().to_text(AnnotationFormat::RhubarbTsv, 24.0);
    assert_eq!(
        rhubarb,
        "0.000\tB\n0.250\tA\n0.500\tD\n1.000\tB\n1.500\tX\n"
    );
    let lines = said().to_text(AnnotationFormat::Plain, 24.0);
    assert_eq!(lines, "0.250000\t0.500000\tMBP\n0.500000\t1.000000\ta\n");
    let project = said().to_text(AnnotationFormat::Papagayo, 24.0);
    assert!(project.contains("pap 6 29 "), "{project}");
}

#[test]
fn labels_that_are_vowels_alone_are_words() {
    let symbols = |text| {
        let read = Annotation::from_text(text, AnnotationFormat::Plain, 24.0).unwrap();
        read.tiers[0].symbols
    };
    assert_eq!(symbols("0.1 0.2 a\n0.2 0.3 ŋ\n"), Symbols::Phones);
    assert_eq!(symbols("0.1 0.2 a\n0.2 0.3 i\n"), Symbols::Words);
}

/// A label with its start and end.
type Row = (String, f64, f64);

/// What a text gives: the kind, and each label with its times.
fn told(text: &str, format: AnnotationFormat) -> Vec<(Symbols, Vec<Row>)> {
    let annotation = Annotation::from_text(text, format, 24.0).unwrap();
    let rows = |tier: &Tier| {
        let row = |i: &Interval| (i.label.clone(), i.start_s, i.end_s);
        (tier.symbols, tier.intervals.iter().map(row).collect())
    };
    annotation.tiers.iter().map(rows).collect()
}

fn row(label: &str, start_s: f64, end_s: f64) -> Row {
    (label.into(), start_s, end_s)
}

#[test]
fn tables_of_words_and_phones_are_read() {
    let phones = "start_s\tduration_s\tphone\n0.000\t0.300\t_\n0.300\t0.080\tm\n0.380\t0.120\tæ\n";
    let rows = vec![row("_", 0.0, 0.3), row("m", 0.3, 0.38), row("æ", 0.38, 0.5)];
    assert_eq!(
        told(phones, AnnotationFormat::RhubarbTsv),
        [(Symbols::Phones, rows)]
    );
    let words = "word\tstart\tend\nmap\t0.3\t0.5\n";
    let expected = [(Symbols::Words, vec![row("map", 0.3, 0.5)])];
    assert_eq!(told(words, AnnotationFormat::RhubarbTsv), expected);
    let refused = Annotation::from_text(
        "start\tend\tword\n1\tx\tmap\n",
        AnnotationFormat::RhubarbTsv,
        24.0,
    );
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("2: expected a time")
    );
}

#[test]
fn what_text_to_speech_says_of_times_is_read() {
    let eleven = r#"{"alignment": {"characters": ["B","o","b"," ","i","s"],
        "character_start_times_seconds": [0.1,0.2,0.3,0.4,0.5,0.6],
        "character_end_times_seconds": [0.2,0.3,0.4,0.5,0.6,0.7]}}"#;
    let words = vec![row("Bob", 0.1, 0.4), row("is", 0.5, 0.7)];
    assert_eq!(
        told(eleven, AnnotationFormat::RhubarbJson),
        [(Symbols::Words, words)]
    );
    let azure = r#"[{"audio_offset": 500000, "viseme_id": 21}, {"audio_offset": 1500000, "viseme_id": 2},
        {"audio_offset": 3000000, "viseme_id": 0}]"#;
    let phones = vec![
        row("p", 0.05, 0.15),
        row("ɑ", 0.15, 0.3),
        row("_", 0.3, 0.5),
    ];
    assert_eq!(
        told(azure, AnnotationFormat::RhubarbJson),
        [(Symbols::Phones, phones)]
    );
    let polly = "{\"time\":0,\"type\":\"viseme\",\"value\":\"p\"}\n{\"time\":100,\"type\":\"viseme\",\"value\":\"a\"}\n";
    let phones = vec![row("p", 0.0, 0.1), row("ɑ", 0.1, 0.1 + 0.2)];
    assert_eq!(
        told(polly, AnnotationFormat::RhubarbJson),
        [(Symbols::Phones, phones)]
    );
    let whisper = r#"{"segments": [{"words": [{"word": " Bob", "start": 0.1, "end": 0.4}]}]}"#;
    let expected = [(Symbols::Words, vec![row("Bob", 0.1, 0.4)])];
    assert_eq!(told(whisper, AnnotationFormat::RhubarbJson), expected);
    let nothing = Annotation::from_text("{\"a\": 1}", AnnotationFormat::RhubarbJson, 24.0);
    assert!(
        nothing
            .unwrap_err()
            .to_string()
            .contains("expected times of words or phones")
    );
}

#[test]
fn subtitles_are_lines_of_words() {
    let srt = "1\n00:00:01,200 --> 00:00:02,000\n<i>Bob made</i>\na map.\n\n2\n00:00:02,500 --> 00:00:03,000\nWhy?\n";
    let lines = vec![row("Bob made a map.", 1.2, 2.0), row("Why?", 2.5, 3.0)];
    assert_eq!(
        told(srt, AnnotationFormat::Subtitles),
        [(Symbols::Words, lines.clone())]
    );
    let vtt = "WEBVTT\n\n00:01.200 --> 00:02.000 align:left\nBob made a map.\n\n00:02.500 --> 00:03.000\nWhy?\n";
    assert_eq!(
        told(vtt, AnnotationFormat::Subtitles),
        [(Symbols::Words, lines)]
    );
    let refused = Annotation::from_text("hello", AnnotationFormat::Subtitles, 24.0);
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("expected subtitles")
    );
    let path = Path::new("/nowhere/a.srt");
    let written = Annotation::of_closures(&[], 1.0).write(path, 24.0);
    assert!(written.unwrap_err().to_string().contains("only read"));
}
