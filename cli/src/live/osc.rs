//! OSC bundles: plain paths, and messages of the VMC protocol for avatars.

use std::str::FromStr;

use anyface::rig::{ARKIT, VISEMES};
use clap::ValueEnum;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

use super::frame::{Frame, Shown, capital};

/// Parameters of VRCFaceTracking with other names than ARKit's shapes. The others only begin with a capital.
const UNIFIED: [(&str, &str); 7] = [
    ("mouthClose", "MouthClosed"),
    ("mouthFunnel", "LipFunnel"),
    ("mouthPucker", "LipPucker"),
    ("mouthRollLower", "LipSuckLower"),
    ("mouthRollUpper", "LipSuckUpper"),
    ("mouthShrugLower", "MouthRaiserLower"),
    ("mouthShrugUpper", "MouthRaiserUpper"),
];
/// The value of VRCFaceTracking's EyeLid at an open eye. It falls to 0 as the eye shuts and rises to 1 as it widens.
const OPEN_LID: f32 = 0.75;

/// The addresses of weights in plain OSC: a text with the name in one of three spellings.
#[derive(Debug, Clone, PartialEq)]
pub struct AddressPattern {
    before: String,
    spelling: Spelling,
    after: String,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Spelling {
    /// `{jawOpen}`
    Plain,
    /// `{JawOpen}`
    Capital,
    /// `{Unified}`
    Unified,
}

impl FromStr for AddressPattern {
    type Err = String;

    fn from_str(text: &str) -> Result<AddressPattern, String> {
        let spellings = [
            ("{jawOpen}", Spelling::Plain),
            ("{JawOpen}", Spelling::Capital),
            ("{Unified}", Spelling::Unified),
        ];
        let found = spellings.into_iter().find_map(|(mark, spelling)| {
            let (before, after) = text.split_once(mark)?;
            Some(AddressPattern {
                before: before.to_owned(),
                spelling,
                after: after.to_owned(),
            })
        });
        let is_address = |pattern: &AddressPattern| {
            let letters = || pattern.before.chars().chain(pattern.after.chars());
            pattern.before.starts_with('/')
                && letters().all(|c| c.is_ascii_graphic() && !"#*,?[]{}".contains(c))
        };
        found.filter(is_address).ok_or_else(|| {
            format!(
                "expected an address that begins with / and holds one of {{jawOpen}}, {{JawOpen}} and {{Unified}} in place of \
                 the name, such as /avatar/parameters/v2/{{Unified}}, got {text:?}"
            )
        })
    }
}

impl AddressPattern {
    fn address(&self, name: &str) -> String {
        format!("{}{name}{}", self.before, self.after)
    }

    /// The weights of a frame with their addresses.
    fn weights(&self, frame: &Frame, shown: Shown) -> Vec<(String, f32)> {
        let shapes = ARKIT.into_iter().zip(frame.shapes);
        let shapes = shapes.filter(|(name, _)| shown.has(name));
        let plain = shapes.chain(VISEMES.into_iter().zip(frame.visemes));
        let named: Vec<(String, f32)> = match self.spelling {
            Spelling::Plain => plain.map(|(name, w)| (name.to_owned(), w)).collect(),
            Spelling::Capital => plain.map(|(name, w)| (capital(name), w)).collect(),
            Spelling::Unified => unified(frame, shown),
        };
        let addresses = named.into_iter();
        addresses
            .map(|(name, w)| (self.address(&name), w))
            .collect()
    }
}

/// The parameters of VRCFaceTracking, version 2, without their folder. Those of both sides run from -1 for the left
/// to 1 for the right.
fn unified(frame: &Frame, shown: Shown) -> Vec<(String, f32)> {
    let of_both = ["jaw", "mouth"].map(|part| {
        let [right, left] = ["Right", "Left"].map(|side| frame.shape(&format!("{part}{side}")));
        (format!("{}X", capital(part)), right - left)
    });
    let mut all: Vec<(String, f32)> = of_both.into();
    all.push(("JawZ".into(), frame.shape("jawForward")));
    for side in ["Left", "Right"] {
        all.push((format!("CheekPuffSuck{side}"), frame.shape("cheekPuff")));
    }
    let is_in_others = |name: &str| {
        let of_jaw = ["jawLeft", "jawRight", "jawForward"].contains(&name);
        let of_mouth = ["mouthLeft", "mouthRight", "cheekPuff"].contains(&name);
        let of_eyes = ["eyeBlink", "eyeWide", "eyeLook"];
        of_jaw || of_mouth || of_eyes.iter().any(|stem| name.starts_with(stem))
    };
    for (name, weight) in ARKIT.iter().zip(frame.shapes) {
        if shown.has(name) && !is_in_others(name) {
            let other = UNIFIED.iter().find(|(known, _)| known == name);
            let spelled = other.map_or_else(|| capital(name), |(_, unified)| (*unified).to_owned());
            all.push((spelled, weight));
        }
    }
    if shown == Shown::Mouth {
        return all;
    }
    for (side, right, left) in [("Left", "In", "Out"), ("Right", "Out", "In")] {
        let of = |stem: &str| frame.shape(&format!("{stem}{side}"));
        let lid = OPEN_LID * (1.0 - of("eyeBlink")) + (1.0 - OPEN_LID) * of("eyeWide");
        let look = |way: &str| of(&format!("eyeLook{way}"));
        all.push((format!("EyeLid{side}"), lid));
        all.push((format!("Eye{side}X"), look(right) - look(left)));
        all.push((format!("Eye{side}Y"), look("Up") - look("Down")));
    }
    all
}

/// Which expressions an avatar receives.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub enum VmcNames {
    /// The 52 expressions of Perfect Sync and those of VRM 0 and 1
    All,
    /// Only the 52 expressions of Perfect Sync. An avatar that has both kinds would otherwise move twice
    PerfectSync,
    /// Only the expressions of VRM 0 and 1
    Vrm,
}

/// A bundle of messages that takes effect as soon as it arrives.
fn bundle(messages: Vec<OscMessage>) -> Vec<u8> {
    let bundle = OscBundle {
        timetag: OscTime {
            seconds: 0,
            fractional: 1,
        },
        content: messages.into_iter().map(OscPacket::Message).collect(),
    };
    encoder::encode(&OscPacket::Bundle(bundle)).expect("numbers and names are always written")
}

fn message(address: impl Into<String>, arguments: Vec<OscType>) -> OscMessage {
    OscMessage {
        addr: address.into(),
        args: arguments,
    }
}

fn floats(values: &[f32]) -> Vec<OscType> {
    values.iter().copied().map(OscType::Float).collect()
}

/// `/anyface/time f`, the weights of shapes and visemes at the addresses of `pattern`, `/anyface/head fff`.
pub fn plain(frame: &Frame, pattern: &AddressPattern, shown: Shown) -> Vec<u8> {
    let mut messages = vec![message("/anyface/time", floats(&[frame.time_s as f32]))];
    let weights = pattern.weights(frame, shown).into_iter();
    messages.extend(weights.map(|(address, weight)| message(address, floats(&[weight]))));
    if shown == Shown::All {
        messages.push(message("/anyface/head", floats(&frame.head)));
    }
    bundle(messages)
}

/// A frame in the VMC protocol: status (a face is there), time, expressions by name, and the head bone.
///
/// The protocol uses Unity's axes: x to the face's right, y up, z out of the face, left-handed. Only the
/// receiver knows the rest position of the bone, so the position is sent as zero.
pub fn vmc(frame: &Frame, names: VmcNames, shown: Shown) -> Vec<u8> {
    let mut messages = vec![
        message("/VMC/Ext/OK", vec![OscType::Int(1)]),
        message("/VMC/Ext/T", floats(&[frame.time_s as f32])),
    ];
    let mut blend = |name: &str, weight: f32| {
        let arguments = vec![OscType::String(name.to_owned()), OscType::Float(weight)];
        messages.push(message("/VMC/Ext/Blend/Val", arguments));
    };
    if names != VmcNames::Vrm {
        for (name, weight) in ARKIT.iter().zip(frame.shapes) {
            if shown.has(name) {
                blend(&capital(name), weight);
            }
        }
    }
    if names != VmcNames::PerfectSync {
        let expressions = expressions(frame);
        let count = match shown {
            Shown::All => expressions.len(),
            Shown::Mouth => VOWELS,
        };
        for (old, new, weight) in &expressions[..count] {
            blend(old, *weight);
            blend(new, *weight);
        }
    }
    messages.push(message("/VMC/Ext/Blend/Apply", Vec::new()));
    if shown == Shown::Mouth {
        return bundle(messages);
    }
    let [x, y, z, w] = frame.head_quaternion();
    let mut bone = vec![OscType::String("Head".into())];
    bone.extend(floats(&[0.0, 0.0, 0.0, x, -y, -z, w]));
    messages.push(message("/VMC/Ext/Bone/Pos", bone));
    bundle(messages)
}

/// How many of the [`expressions`] are vowels, which come first.
const VOWELS: usize = 5;

/// Expressions by their names in VRM 0 and VRM 1.
///
/// An avatar adds up the weights that it receives. So `Blink` is the amount by which both eyes close, and
/// `Blink_L` and `Blink_R` are how much further each eye closes.
fn expressions(frame: &Frame) -> [(&'static str, &'static str, f32); 13] {
    let [left, right] = ["eyeBlinkLeft", "eyeBlinkRight"].map(|name| frame.shape(name));
    let both = left.min(right);
    let feelings = frame.feelings;
    [
        ("A", "aa", frame.viseme("viseme_aa")),
        ("I", "ih", frame.viseme("viseme_I")),
        ("U", "ou", frame.viseme("viseme_U")),
        ("E", "ee", frame.viseme("viseme_E")),
        ("O", "oh", frame.viseme("viseme_O")),
        ("Blink", "blink", both),
        ("Blink_L", "blinkLeft", left - both),
        ("Blink_R", "blinkRight", right - both),
        ("Joy", "happy", feelings.happy),
        ("Angry", "angry", feelings.angry),
        ("Sorrow", "sad", feelings.sad),
        ("Fun", "relaxed", feelings.relaxed),
        ("Surprised", "surprised", feelings.surprised),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(bytes: &[u8]) -> Vec<OscMessage> {
        let (rest, packet) = rosc::decoder::decode_udp(bytes).unwrap();
        assert!(rest.is_empty());
        let OscPacket::Bundle(bundle) = packet else {
            panic!("{packet:?}");
        };
        assert_eq!(bundle.timetag, OscTime::from((0, 1)));
        let message = |packet| match packet {
            OscPacket::Message(message) => message,
            OscPacket::Bundle(_) => panic!("a bundle in a bundle"),
        };
        bundle.content.into_iter().map(message).collect()
    }

    /// The weight of this name, if the messages contain it exactly once.
    fn weight(messages: &[OscMessage], name: &str) -> Option<f32> {
        let name = OscType::String(name.into());
        let mut matches = messages.iter().filter(|m| m.args.first() == Some(&name));
        let weight = matches.next()?.args[1].clone().float();
        weight.filter(|_| matches.next().is_none())
    }

    #[test]
    fn an_avatar_receives_a_frame_in_the_order_of_the_protocol() {
        let frame = Frame::at_rest().with(&[("jawOpen", 0.5), ("viseme_aa", 0.75)]);
        let sent = messages(&vmc(&frame, VmcNames::All, Shown::All));
        let addresses: Vec<&str> = sent.iter().map(|m| m.addr.as_str()).collect();
        assert_eq!(addresses[..2], ["/VMC/Ext/OK", "/VMC/Ext/T"]);
        assert_eq!(sent[0].args, [OscType::Int(1)]);
        assert_eq!(sent[1].args, [OscType::Float(0.12)]);
        assert_eq!(sent.len(), 2 + 52 + 26 + 2);
        assert!(addresses[2..80].iter().all(|a| *a == "/VMC/Ext/Blend/Val"));
        assert_eq!(
            addresses[80..],
            ["/VMC/Ext/Blend/Apply", "/VMC/Ext/Bone/Pos"]
        );
        assert_eq!(weight(&sent, "JawOpen"), Some(0.5));
        assert_eq!(
            (weight(&sent, "A"), weight(&sent, "aa")),
            (Some(0.75), Some(0.75))
        );
    }

    #[test]
    fn an_avatar_with_both_kinds_of_expressions_is_sent_one() {
        let frame = Frame::at_rest();
        let sent = messages(&vmc(&frame, VmcNames::PerfectSync, Shown::All));
        assert!(weight(&sent, "EyeBlinkLeft").is_some() && weight(&sent, "Blink").is_none());
        let sent = messages(&vmc(&frame, VmcNames::Vrm, Shown::All));
        assert!(weight(&sent, "EyeBlinkLeft").is_none() && weight(&sent, "Blink").is_some());
    }

    #[test]
    fn a_blink_of_both_eyes_is_not_sent_twice() {
        let frame = Frame::at_rest().with(&[("eyeBlinkLeft", 1.0), ("eyeBlinkRight", 0.25)]);
        let sent = messages(&vmc(&frame, VmcNames::Vrm, Shown::All));
        let weights = ["Blink", "Blink_L", "Blink_R", "blinkLeft"].map(|n| weight(&sent, n));
        assert_eq!(weights, [Some(0.25), Some(0.75), Some(0.0), Some(0.75)]);
    }

    #[test]
    fn a_turn_to_the_left_is_a_negative_turn_about_unitys_axis() {
        let head = |head| {
            let frame = Frame {
                head,
                ..Frame::at_rest()
            };
            let sent = messages(&vmc(&frame, VmcNames::Vrm, Shown::All));
            let bone = sent.last().unwrap().args.clone();
            assert_eq!(bone[0], OscType::String("Head".into()));
            bone[1..]
                .iter()
                .map(|a| a.clone().float().unwrap())
                .collect::<Vec<f32>>()
        };
        let (sin, cos) = 0.15f32.sin_cos();
        assert_eq!(head([0.0, 0.3, 0.0]), [0.0, 0.0, 0.0, 0.0, -sin, 0.0, cos]);
        assert_eq!(head([0.3, 0.0, 0.0]), [0.0, 0.0, 0.0, sin, 0.0, 0.0, cos]);
    }

    fn pattern(text: &str) -> AddressPattern {
        text.parse().unwrap()
    }

    #[test]
    fn vrcfacetracking_gets_its_own_parameters() {
        let frame = Frame::at_rest().with(&[
            ("mouthFunnel", 0.5),
            ("jawLeft", 0.25),
            ("eyeBlinkLeft", 1.0),
            ("eyeLookOutRight", 0.5),
            ("mouthSmileLeft", 0.75),
        ]);
        let unified = pattern("/avatar/parameters/v2/{Unified}");
        let value = |name: &str, shown| {
            let sent = messages(&plain(&frame, &unified, shown));
            let address = format!("/avatar/parameters/v2/{name}");
            let mut named = sent.iter().filter(|m| m.addr == address);
            let value = named.next()?.args[0].clone().float();
            assert!(named.next().is_none(), "{name} twice");
            value
        };
        let known = [
            ("LipFunnel", 0.5),
            ("JawX", -0.25),
            ("EyeLidLeft", 0.0),
            ("EyeLidRight", 0.75),
            ("EyeRightX", 0.5),
            ("MouthSmileLeft", 0.75),
        ];
        for (name, expected) in known {
            assert_eq!(value(name, Shown::All), Some(expected), "{name}");
        }
        assert_eq!(value("EyeLidLeft", Shown::Mouth), None);
        assert_eq!(value("BrowInnerUp", Shown::Mouth), None);
        assert_eq!(value("MouthFunnel", Shown::All), None);
    }

    #[test]
    fn a_mouth_alone_leaves_eyes_brows_and_head_to_another_tracker() {
        let frame = Frame::at_rest().with(&[("jawOpen", 0.5), ("eyeBlinkLeft", 1.0)]);
        let sent = messages(&vmc(&frame, VmcNames::All, Shown::Mouth));
        assert_eq!(weight(&sent, "JawOpen"), Some(0.5));
        assert!(sent.iter().all(|m| m.addr != "/VMC/Ext/Bone/Pos"));
        for name in ["EyeBlinkLeft", "BrowInnerUp", "Blink", "blink", "Joy"] {
            assert_eq!(weight(&sent, name), None, "{name}");
        }
        assert!(weight(&sent, "A").is_some());
        let sent = messages(&plain(&frame, &pattern("/face/{JawOpen}/x"), Shown::Mouth));
        assert!(sent.iter().any(|m| m.addr == "/face/JawOpen/x"));
        assert!(
            sent.iter()
                .all(|m| !m.addr.contains("Eye") && m.addr != "/anyface/head")
        );
    }

    #[test]
    fn addresses_without_a_name_or_with_letters_of_osc_are_refused() {
        for text in [
            "/face",
            "face/{jawOpen}",
            "/a b/{jawOpen}",
            "/{jawOpen}/*",
            "/{other}",
        ] {
            let error = text.parse::<AddressPattern>().unwrap_err();
            assert!(error.contains("{Unified}"), "{error}");
        }
    }

    #[test]
    fn plain_paths_have_every_weight_and_the_head() {
        let frame = Frame {
            head: [0.1, 0.2, 0.3],
            ..Frame::at_rest().with(&[("jawOpen", 0.5), ("viseme_PP", 1.0)])
        };
        let sent = messages(&plain(&frame, &pattern("/anyface/{jawOpen}"), Shown::All));
        assert_eq!(sent.len(), 1 + 52 + 15 + 1);
        let of = |address: &str| {
            sent.iter()
                .find(|m| m.addr == address)
                .unwrap()
                .args
                .clone()
        };
        assert_eq!(of("/anyface/jawOpen"), [OscType::Float(0.5)]);
        assert_eq!(of("/anyface/viseme_PP"), [OscType::Float(1.0)]);
        assert_eq!(of("/anyface/head"), floats(&[0.1, 0.2, 0.3]));
    }
}
