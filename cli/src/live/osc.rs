//! OSC bundles: plain paths, and messages of the VMC protocol for avatars.

use anyface::rig::{ARKIT, VISEMES};
use clap::ValueEnum;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

use super::frame::{Frame, capital};

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

/// `/anyface/time f`, `/anyface/jawOpen f` and so on for shapes and visemes, `/anyface/head fff`.
pub fn plain(frame: &Frame) -> Vec<u8> {
    let names = ARKIT.into_iter().chain(VISEMES);
    let weights = names.zip(frame.shapes.iter().chain(&frame.visemes));
    let mut messages = vec![message("/anyface/time", floats(&[frame.time_s as f32]))];
    messages.extend(
        weights.map(|(name, weight)| message(format!("/anyface/{name}"), floats(&[*weight]))),
    );
    messages.push(message("/anyface/head", floats(&frame.head)));
    bundle(messages)
}

/// A frame in the VMC protocol: status (a face is there), time, expressions by name, and the head bone.
///
/// The protocol uses Unity's axes: x to the face's right, y up, z out of the face, left-handed. Only the
/// receiver knows the rest position of the bone, so the position is sent as zero.
pub fn vmc(frame: &Frame, names: VmcNames) -> Vec<u8> {
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
            blend(&capital(name), weight);
        }
    }
    if names != VmcNames::PerfectSync {
        for (old, new, weight) in expressions(frame) {
            blend(old, weight);
            blend(new, weight);
        }
    }
    messages.push(message("/VMC/Ext/Blend/Apply", Vec::new()));
    let [x, y, z, w] = frame.head_quaternion();
    let mut bone = vec![OscType::String("Head".into())];
    bone.extend(floats(&[0.0, 0.0, 0.0, x, -y, -z, w]));
    messages.push(message("/VMC/Ext/Bone/Pos", bone));
    bundle(messages)
}

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
        let sent = messages(&vmc(&frame, VmcNames::All));
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
        let sent = messages(&vmc(&frame, VmcNames::PerfectSync));
        assert!(weight(&sent, "EyeBlinkLeft").is_some() && weight(&sent, "Blink").is_none());
        let sent = messages(&vmc(&frame, VmcNames::Vrm));
        assert!(weight(&sent, "EyeBlinkLeft").is_none() && weight(&sent, "Blink").is_some());
    }

    #[test]
    fn a_blink_of_both_eyes_is_not_sent_twice() {
        let frame = Frame::at_rest().with(&[("eyeBlinkLeft", 1.0), ("eyeBlinkRight", 0.25)]);
        let sent = messages(&vmc(&frame, VmcNames::Vrm));
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
            let sent = messages(&vmc(&frame, VmcNames::Vrm));
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

    #[test]
    fn plain_paths_have_every_weight_and_the_head() {
        let frame = Frame {
            head: [0.1, 0.2, 0.3],
            ..Frame::at_rest().with(&[("jawOpen", 0.5), ("viseme_PP", 1.0)])
        };
        let sent = messages(&plain(&frame));
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
