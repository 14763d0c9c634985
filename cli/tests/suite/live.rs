//! `anyface live` as the programs that listen to it see it.

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::UdpSocket,
    path::Path,
    process::{Child, ChildStderr, Command, Stdio},
    time::Duration,
};

use anyface::rig::ARKIT;
use rosc::{OscMessage, OscPacket, OscType};
use serde_json::{Value, json};

use crate::{folder_with_sound, voice};

const SECONDS: usize = 2;
/// Frames per second of the stream.
const FPS: usize = 25;

fn spoken() -> Vec<f32> {
    voice::intoned(SECONDS as f32, 16_000)
}

fn start(folder: &Path, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_anyface"))
        .current_dir(folder)
        .arg("live")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Exit code, standard output and standard error.
fn ended(child: Child) -> (Option<i32>, String, String) {
    let output = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

fn lines(text: &str) -> Vec<Value> {
    let values = text.lines().map(serde_json::from_str);
    values.collect::<Result<_, _>>().unwrap()
}

/// A receiver of datagrams and its address.
fn receiver() -> (UdpSocket, String) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let patience = Duration::from_secs(60);
    socket.set_read_timeout(Some(patience)).unwrap();
    let address = socket.local_addr().unwrap().to_string();
    (socket, address)
}

fn datagram(socket: &UdpSocket) -> Vec<u8> {
    let mut bytes = vec![0; 65_536];
    let count = socket.recv(&mut bytes).unwrap();
    bytes.truncate(count);
    bytes
}

fn messages(bytes: &[u8]) -> Vec<OscMessage> {
    let (_, packet) = rosc::decoder::decode_udp(bytes).unwrap();
    let OscPacket::Bundle(bundle) = packet else {
        panic!("{packet:?}");
    };
    let messages = bundle.content.into_iter().map(|packet| match packet {
        OscPacket::Message(message) => message,
        OscPacket::Bundle(_) => panic!("a bundle in a bundle"),
    });
    messages.collect()
}

/// Subject, frame number and values of a Live Link packet, the values in the order of Unreal's list.
fn live_link(bytes: &[u8]) -> (String, u32, Vec<f32>) {
    assert_eq!(bytes[0], 6);
    let (mut rest, mut texts) = (&bytes[1..], Vec::new());
    let mut take = |count: usize| {
        let (head, tail) = rest.split_at(count);
        rest = tail;
        head.to_vec()
    };
    let number = |bytes: Vec<u8>| u32::from_be_bytes(bytes.try_into().unwrap());
    for _ in 0..2 {
        let length = number(take(4)) as usize;
        texts.push(String::from_utf8(take(length)).unwrap());
    }
    let frame = number(take(4));
    let (_sub_frame, numerator, denominator) = (take(4), number(take(4)), number(take(4)));
    assert_eq!((numerator, denominator), (FPS as u32, 1));
    assert_eq!(take(1), [61]);
    let values = (0..61).map(|_| f32::from_bits(number(take(4)))).collect();
    assert!(rest.is_empty());
    (texts.remove(1), frame, values)
}

#[test]
fn every_target_receives_the_same_face() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let (vmc, vmc_at) = receiver();
    let (link, link_at) = receiver();
    let (plain, plain_at) = receiver();
    // Play at the speed of a clock, so that no datagram is lost before it is read.
    let child = start(
        folder.path(),
        &[
            "--input",
            "a.wav",
            "--vmc",
            &vmc_at,
            "--live-link",
            &link_at,
            "--subject",
            "Ada",
            "--osc",
            &plain_at,
            "--json",
            "--emotion",
            "happy:0.5",
        ],
    );
    let output = std::thread::spawn(move || ended(child));
    let received: Vec<_> = (0..SECONDS * FPS)
        .map(|_| (datagram(&vmc), datagram(&link), datagram(&plain)))
        .collect();
    let (code, text, notes) = output.join().unwrap();
    assert_eq!(code, Some(0), "{notes}");
    for address in [vmc_at, link_at, plain_at] {
        assert!(notes.contains(&format!("to {address} (UDP)")), "{notes}");
    }
    let frames = lines(&text);
    assert_eq!(frames.len(), SECONDS * FPS);
    let mut opened = 0f32;
    for (n, (frame, (vmc, link, plain))) in frames.iter().zip(&received).enumerate() {
        assert_eq!(frame["frame"], n);
        let weight = |name: &str| frame["shapes"][name].as_f64().unwrap() as f32;
        opened = opened.max(weight("jawOpen"));
        let (subject, number, values) = live_link(link);
        assert_eq!((subject.as_str(), number as usize), ("Ada", n));
        for (place, name) in [
            (0, "eyeBlinkLeft"),
            (15, "jawLeft"),
            (17, "jawOpen"),
            (51, "tongueOut"),
        ] {
            assert_eq!(values[place], weight(name), "{name}");
        }
        let plain = messages(plain);
        for name in ARKIT {
            let address = format!("/anyface/{name}");
            let message = plain
                .iter()
                .find(|message| message.addr == address)
                .unwrap();
            assert_eq!(message.args, [OscType::Float(weight(name))]);
        }
        let vmc = messages(vmc);
        let blend = |name: &str| {
            let name = OscType::String(name.into());
            let message = vmc
                .iter()
                .find(|message| message.args.first() == Some(&name));
            message.unwrap().args[1].clone().float().unwrap()
        };
        assert_eq!(blend("JawOpen"), weight("jawOpen"));
        assert_eq!(blend("Joy"), 0.5);
        let viseme = frame["visemes"]["viseme_aa"].as_f64().unwrap() as f32;
        assert_eq!((blend("A"), blend("aa")), (viseme, viseme));
    }
    assert!(opened > 0.1, "{opened}");
}

#[test]
fn a_reader_who_does_not_read_holds_no_other_target() {
    const LONG_S: usize = 16;
    let folder = folder_with_sound(&voice::intoned(LONG_S as f32, 16_000), 16_000);
    let (plain, plain_at) = receiver();
    let arguments = ["--input", "a.wav", "--fast", "--json", "--osc", &plain_at];
    let mut child = start(folder.path(), &arguments);
    let notes = child.stderr.take().unwrap();
    let notes = std::thread::spawn(move || std::io::read_to_string(notes).unwrap());
    let receiver = std::thread::spawn(move || {
        plain
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        let mut bytes = vec![0; 65_536];
        let arrivals = std::iter::from_fn(|| plain.recv(&mut bytes).ok());
        arrivals.take(LONG_S * FPS / 2).count()
    });
    // Nobody reads standard output: 400 lines are more than a pipe and the queue before it hold.
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(receiver.join().unwrap(), LONG_S * FPS / 2);
    let notes = notes.join().unwrap();
    assert!(notes.contains("nobody reads it"), "{notes}");
}

#[cfg(unix)]
#[test]
fn the_first_signal_ends_a_command_whose_lines_nobody_reads() {
    let folder = folder_with_sound(&voice::intoned(16.0, 16_000), 16_000);
    let mut child = start(folder.path(), &["--input", "a.wav", "--fast", "--json"]);
    // Until the pipe and the queue before it are full.
    std::thread::sleep(Duration::from_secs(3));
    assert!(child.try_wait().unwrap().is_none());
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(child.wait().unwrap().code(), Some(9));
}

#[test]
fn raw_samples_on_standard_input_are_the_same_face_as_a_file() {
    let samples: Vec<i16> = spoken().iter().map(|x| (x * 32_768.0) as i16).collect();
    let same: Vec<f32> = samples.iter().map(|x| f32::from(*x) / 32_768.0).collect();
    let folder = folder_with_sound(&same, 16_000);
    let of_file = ended(start(
        folder.path(),
        &["--input", "a.wav", "--fast", "--json"],
    ));
    let mut child = start(folder.path(), &["--input", "-", "--json"]);
    let bytes: Vec<u8> = samples.iter().flat_map(|x| x.to_le_bytes()).collect();
    let mut pipe = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || pipe.write_all(&bytes).unwrap());
    let of_pipe = ended(child);
    writer.join().unwrap();
    assert_eq!((of_file.0, of_pipe.0), (Some(0), Some(0)), "{}", of_pipe.2);
    assert_eq!(lines(&of_file.1).len(), SECONDS * FPS);
    assert_eq!(of_file.1, of_pipe.1);
}

#[test]
fn raw_samples_of_another_rate_are_the_same_face_within_a_little() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let heard = |samples: &[f32], rate: &str| {
        let mut child = start(
            folder.path(),
            &["--input", "-", "--rate", rate, "--json", "--any-sound"],
        );
        let mut pipe = child.stdin.take().unwrap();
        let samples = samples.iter().map(|x| (x * 32_767.0) as i16);
        pipe.write_all(&samples.flat_map(i16::to_le_bytes).collect::<Vec<u8>>())
            .unwrap();
        drop(pipe);
        let (status, text, message) = ended(child);
        assert_eq!(status, Some(0), "{message}");
        let jaws = lines(&text);
        jaws.iter()
            .map(|line| line["shapes"]["jawOpen"].as_f64().unwrap())
            .collect::<Vec<f64>>()
    };
    let usual = heard(&spoken(), "16000");
    for rate in ["22050", "48000"] {
        let other = heard(&voice::intoned(SECONDS as f32, rate.parse().unwrap()), rate);
        assert_eq!(other.len(), usual.len(), "{rate}");
        let apart = usual.iter().zip(&other).map(|(a, b)| (a - b).abs());
        let apart = apart.fold(0.0, f64::max);
        assert!(
            apart < 0.1 && usual.iter().any(|jaw| *jaw > 0.2),
            "{rate}: {apart}"
        );
    }
}

#[test]
fn music_moves_the_face_where_any_sound_is_to() {
    let folder = folder_with_sound(&voice::babble(SECONDS as f32, 16_000), 16_000);
    let widest = |more: &[&str]| {
        let arguments = [&["--input", "a.wav", "--fast", "--json"], more].concat();
        let (code, text, notes) = ended(start(folder.path(), &arguments));
        assert_eq!(code, Some(0), "{notes}");
        let frames = lines(&text);
        let jaws = frames
            .iter()
            .map(|frame| frame["shapes"]["jawOpen"].as_f64().unwrap());
        jaws.fold(0.0, f64::max)
    };
    let (drone, any) = (widest(&[]), widest(&["--any-sound"]));
    assert!(drone < 0.01 && any > 0.1, "{drone} {any}");
}

#[test]
fn another_rate_is_interpolated() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let at = |fps: &str| {
        let (code, text, notes) = ended(start(
            folder.path(),
            &["--input", "a.wav", "--fast", "--json", "--fps", fps],
        ));
        assert_eq!(code, Some(0), "{notes}");
        lines(&text)
    };
    let (usual, twice) = (at("25"), at("50"));
    assert_eq!(
        (usual.len(), twice.len()),
        (SECONDS * FPS, 2 * SECONDS * FPS - 1)
    );
    let jaw = |frame: &Value| frame["shapes"]["jawOpen"].as_f64().unwrap();
    for n in 0..usual.len() - 1 {
        assert_eq!(usual[n]["shapes"], twice[2 * n]["shapes"]);
        let middle = 0.5 * (jaw(&usual[n]) + jaw(&usual[n + 1]));
        assert!((jaw(&twice[2 * n + 1]) - middle).abs() < 1e-6);
    }
}

/// Reads the address at which the command says it listens.
fn place(notes: &mut BufReader<ChildStderr>) -> String {
    let mut line = String::new();
    notes.read_line(&mut line).unwrap();
    let start = line.find("ws://").unwrap_or_else(|| panic!("{line}"));
    line[start..].trim().to_owned()
}

#[test]
fn a_reader_of_the_websocket_receives_lines_while_it_goes_on() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let mut child = start(
        folder.path(),
        &["--input", "-", "--websocket", "127.0.0.1:0"],
    );
    let place = place(&mut BufReader::new(child.stderr.take().unwrap()));
    let (mut reader, _) = tungstenite::connect(place).unwrap();
    reader.send(tungstenite::Message::text("ignored")).unwrap();
    // The reader is connected. Now send sound until a line has arrived.
    let mut pipe = child.stdin.take().unwrap();
    let speaker = std::thread::spawn(move || while pipe.write_all(&[1; 640]).is_ok() {});
    let line = reader.read().unwrap().into_text().unwrap();
    let frame: Value = serde_json::from_str(&line).unwrap();
    assert!(frame["shapes"]["jawOpen"].is_number(), "{frame}");
    child.kill().unwrap();
    child.wait().unwrap();
    speaker.join().unwrap();
}

#[cfg(unix)]
#[test]
fn a_signal_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = start(
        folder.path(),
        &["--input", "-", "--websocket", "127.0.0.1:0"],
    );
    let mut notes = BufReader::new(child.stderr.take().unwrap());
    place(&mut notes);
    // Keep standard input open, because `wait` would close it. Only the signal may end the command.
    let input = child.stdin.take();
    let kill = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(kill.unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(9));
    drop(input);
    let mut rest = String::new();
    notes.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("cancelled"), "{rest}");
}

#[test]
fn the_targets_of_a_file_stand_in_each_line_by_their_own_names() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let names = ["MTH_A", "MTH_O", "blink_L", "hat"];
    // Each target lifts all three vertices by 10.
    let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        .into_iter()
        .chain([10.0; 9]);
    let binary: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
    let accessor = |view: usize| json!({"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"});
    let document = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "buffers": [{"byteLength": 72}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 36}],
        "accessors": [accessor(0), accessor(1)],
        "meshes": [{
            "primitives": [{"attributes": {"POSITION": 0}, "targets": names.map(|_| json!({"POSITION": 1}))}],
            "extras": {"targetNames": names},
        }],
    });
    std::fs::write(folder.path().join("toon.glb"), glb(&document, &binary)).unwrap();
    let arguments = [
        "--input",
        "a.wav",
        "--fast",
        "--json",
        "--targets-of",
        "toon.glb",
    ];
    let (status, text, notes) = ended(start(folder.path(), &arguments));
    assert_eq!(status, Some(0), "{notes}");
    assert!(notes.contains("driving 3 targets"), "{notes}");
    let lines = lines(&text);
    assert_eq!(lines.len(), SECONDS * FPS);
    for line in &lines {
        let targets = line["targets"].as_object().unwrap();
        assert_eq!(targets.len(), 3, "{line}");
        assert_eq!(targets["MTH_A"], line["visemes"]["viseme_aa"]);
        assert_eq!(targets["blink_L"], line["shapes"]["eyeBlinkLeft"]);
    }
    assert!(
        lines
            .iter()
            .any(|line| line["targets"]["MTH_A"].as_f64() > Some(0.1))
    );
}

/// A GLB of its two chunks.
fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let number = |n: usize| (n as u32).to_le_bytes();
    let chunk = |kind: &[u8; 4], data: &[u8]| [&number(data.len()), &kind[..], data].concat();
    let head = [&b"glTF"[..], &number(2), &number(length)].concat();
    [head, chunk(b"JSON", &text), chunk(b"BIN\0", binary)].concat()
}

#[test]
fn controls_of_the_performance_show_more_or_less_of_it() {
    let folder = folder_with_sound(&spoken(), 16_000);
    let run = |more: &[&str]| {
        let arguments = [&["--input", "a.wav", "--fast", "--json"], more].concat();
        let (status, text, message) = ended(start(folder.path(), &arguments));
        assert_eq!(status, Some(0), "{message}");
        lines(&text)
    };
    let of = |lines: &[Value], shape: &str| -> Vec<f64> {
        let weights = lines
            .iter()
            .map(|line| line["shapes"][shape].as_f64().unwrap());
        weights.collect()
    };
    let usual = run(&[]);
    let calm = [
        "--articulation",
        "0.5",
        "--head-motion",
        "0",
        "--gaze",
        "0",
        "--blinks",
        "0",
    ];
    let calm = run(&calm);
    for (all, half) in of(&usual, "jawOpen").iter().zip(of(&calm, "jawOpen")) {
        assert!((0.5 * all - half).abs() < 1e-6, "{all} {half}");
    }
    for line in &calm {
        assert_eq!(line["head"], json!([0.0, 0.0, 0.0]));
    }
    for shape in ["eyeLookInLeft", "eyeLookUpRight"] {
        assert!(of(&calm, shape).iter().all(|w| w.abs() < 1e-6), "{shape}");
    }
    let mouth = run(&["--only", "mouth"]);
    assert!(mouth[0].get("head").is_none());
    assert_eq!(of(&mouth, "jawOpen"), of(&usual, "jawOpen"));
    assert!(mouth[0]["shapes"].get("eyeBlinkLeft").is_none());
}

#[test]
fn what_cannot_be_sent_or_heard_is_refused_with_what_helps() {
    let folder = folder_with_sound(&spoken(), 16_000);
    std::fs::write(folder.path().join("no.wav"), b"no sound at all").unwrap();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port_in_use = listener.local_addr().unwrap().to_string();
    for (arguments, code, words) in [
        (vec!["--input", "a.wav"], 3, "name one or more of --vmc"),
        (
            vec!["--input", "a.wav", "--vmc", "nowhere"],
            2,
            "expected HOST:PORT, as in",
        ),
        (
            vec!["--input", "a.wav", "--osc", "no.invalid:9"],
            3,
            "expected a machine that can be found",
        ),
        (
            vec!["--input", "a.wav", "--websocket", &port_in_use],
            3,
            "got one that is in use",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--fps", "0"],
            3,
            "fps: expected 1 to 240",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--emotion", "auto-arousal"],
            3,
            "expected an emotion that is named",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--targets-of", "a.wav"],
            3,
            "expected --websocket or --json",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--rate", "48000"],
            3,
            "--rate: expected raw samples",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--gain", "99"],
            2,
            "expected -60 to 60 dB",
        ),
        (
            vec!["--input", "a.wav", "--vmc", "--articulation", "9"],
            3,
            "articulation",
        ),
        (
            vec![
                "--input",
                "a.wav",
                "--osc",
                "127.0.0.1:9",
                "--osc-address",
                "/face",
            ],
            2,
            "{Unified}",
        ),
        (vec!["--input", "no.wav", "--vmc"], 4, "no.wav"),
        (vec!["--input", "gone.wav", "--vmc"], 8, "gone.wav"),
    ] {
        let (status, _, message) = ended(start(folder.path(), &arguments));
        assert_eq!(status, Some(code), "{arguments:?}: {message}");
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
    let mut child = start(folder.path(), &["--input", "-", "--vmc"]);
    let mut pipe = child.stdin.take().unwrap();
    let wav = std::fs::read(folder.path().join("a.wav")).unwrap();
    // The command may exit before everything is written.
    let _ = pipe.write_all(&wav);
    drop(pipe);
    let (status, _, message) = ended(child);
    assert_eq!(status, Some(4), "{message}");
    assert!(message.contains("name it with --input FILE"), "{message}");
}

/// TCP ports at which a process listens, and how many of its UDP sockets take packets from anybody.
#[cfg(target_os = "linux")]
fn open_ports(process: u32) -> (Vec<u16>, usize) {
    let proc = Path::new("/proc").join(process.to_string());
    let links = std::fs::read_dir(proc.join("fd")).unwrap().flatten();
    let names = links.filter_map(|entry| std::fs::read_link(entry.path()).ok());
    let sockets: Vec<String> = names
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    let rows = |kind: &str| -> Vec<Vec<String>> {
        let table = std::fs::read_to_string(proc.join("net").join(kind)).unwrap_or_default();
        let rows = table.lines().skip(1);
        let rows = rows.map(|row| row.split_whitespace().map(str::to_owned).collect());
        let is_own = |row: &Vec<String>| sockets.contains(&format!("socket:[{}]", row[9]));
        rows.filter(is_own).collect()
    };
    let both = |kind: &str| [rows(kind), rows(&format!("{kind}6"))].concat();
    // 0A is "listening", 01 "connected".
    let listening = both("tcp").into_iter().filter(|row| row[3] == "0A");
    let port = |row: Vec<String>| u16::from_str_radix(row[1].rsplit(':').next().unwrap(), 16);
    let ports = listening.map(|row| port(row).unwrap()).collect();
    (
        ports,
        both("udp").iter().filter(|row| row[3] != "01").count(),
    )
}

#[cfg(target_os = "linux")]
#[test]
fn it_listens_at_no_port_but_that_of_the_websocket() {
    let folder = tempfile::tempdir().unwrap();
    let (_vmc, vmc_at) = receiver();
    let sends = ["--input", "-", "--vmc", &vmc_at];
    let mut child = start(folder.path(), &sends);
    let mut line = String::new();
    BufReader::new(child.stderr.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert_eq!(open_ports(child.id()), (vec![], 0));
    child.kill().unwrap();
    child.wait().unwrap();

    let mut child = start(
        folder.path(),
        &["--input", "-", "--websocket", "127.0.0.1:0"],
    );
    let place = place(&mut BufReader::new(child.stderr.take().unwrap()));
    let port = place.rsplit(':').next().unwrap().parse().unwrap();
    assert_eq!(open_ports(child.id()), (vec![port], 0));
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn hostile_bytes_do_not_stop_the_websocket() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = start(
        folder.path(),
        &["--input", "-", "--websocket", "127.0.0.1:0"],
    );
    let place = place(&mut BufReader::new(child.stderr.take().unwrap()));
    let address = place.trim_start_matches("ws://").to_owned();
    let greeting = format!(
        "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    );
    let endless = |of: &str| format!("{greeting}X: {}", of.repeat(1 << 20));
    // Frames that claim an impossible length, have no mask, are of an unknown kind, or are cut off.
    let frames: [&[u8]; 4] = [
        &[
            0x82, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4,
        ],
        &[0x81, 0x05, b'h', b'e', b'l', b'l', b'o'],
        &[0xf7, 0x80, 0, 0, 0, 0],
        &[0x89, 0xfe],
    ];
    let mut hostile: Vec<Vec<u8>> = frames
        .iter()
        .map(|frame| [greeting.as_bytes(), b"\r\n", frame].concat())
        .collect();
    hostile.extend([
        vec![0; 4096],
        vec![0xff; 1 << 20],
        endless("a").into_bytes(),
        endless("\r\nX: ").into_bytes(),
        b"GET / HTTP/1.1\r\nOrigin: http://elsewhere.example\r\n\r\n".to_vec(),
    ]);
    for bytes in hostile {
        let mut stream = std::net::TcpStream::connect(&address).unwrap();
        // A client that is dropped cannot write everything.
        let _ = stream.write_all(&bytes);
    }
    let (mut reader, _) = tungstenite::connect(place).unwrap();
    let mut pipe = child.stdin.take().unwrap();
    let speaker = std::thread::spawn(move || while pipe.write_all(&[1; 640]).is_ok() {});
    let line = reader.read().unwrap().into_text().unwrap();
    assert!(serde_json::from_str::<Value>(&line).unwrap()["head"].is_array());
    child.kill().unwrap();
    child.wait().unwrap();
    speaker.join().unwrap();
}
