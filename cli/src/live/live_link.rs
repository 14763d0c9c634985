//! Packets of Epic's app Live Link Face, version 6, as Unreal Engine reads them on UDP port 11111.
//!
//! A packet holds the version (one byte), device and subject (length and UTF-8 each), frame, fraction of a
//! frame, rate as numerator and denominator, number of values (one byte), and values, all big-endian. The
//! layout is that of the package `PyLiveLinkFace`, which was checked against the app. The order of the
//! values is Unreal's `EARFaceBlendShape`.

use super::frame::{Angles, Frame};
use anyface::rig::ARKIT;

const VERSION: u8 = 6;
/// 36 characters like the device ID of a phone. Some readers rely on that length.
const DEVICE: &str = "616E7966-6163-6500-0000-000000000001";
const VALUES: usize = ARKIT.len() + 9;

/// The shapes in the order of the packet. For the jaw and the mouth, the tables that the app writes list
/// left and right the other way round.
fn in_order() -> [&'static str; 52] {
    let swapped = |name| match name {
        "jawRight" => "jawLeft",
        "jawLeft" => "jawRight",
        "mouthRight" => "mouthLeft",
        "mouthLeft" => "mouthRight",
        other => other,
    };
    ARKIT.map(swapped)
}

/// The packet of a frame at `fps` frames per second, for the face named `subject`.
pub fn packet(frame: &Frame, subject: &str, fps: f64) -> Vec<u8> {
    let mut bytes = vec![VERSION];
    for text in [DEVICE, subject] {
        bytes.extend((text.len() as u32).to_be_bytes());
        bytes.extend(text.as_bytes());
    }
    let (numerator, denominator) = rate(fps);
    bytes.extend(frame.number.to_be_bytes());
    bytes.extend(0f32.to_be_bytes());
    bytes.extend(numerator.to_be_bytes());
    bytes.extend(denominator.to_be_bytes());
    bytes.push(VALUES as u8);
    let [left, right] = frame.eye_angles();
    let turns = [frame.head_angles(), left, right];
    let turns = turns.map(|Angles { yaw, pitch, roll }| [yaw, pitch, roll]);
    let shapes = in_order().map(|name| frame.shape(name));
    for value in shapes.iter().chain(turns.as_flattened()) {
        bytes.extend(value.to_be_bytes());
    }
    bytes
}

/// Frames per second as a fraction, rounded to a thousandth.
fn rate(fps: f64) -> (u32, u32) {
    if fps.fract() == 0.0 {
        (fps as u32, 1)
    } else {
        ((1000.0 * fps).round() as u32, 1000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_laid_out_byte_for_byte() {
        let frame = Frame {
            head: [0.25, 0.0, 0.0],
            ..Frame::at_rest().with(&[("eyeBlinkLeft", 0.5), ("tongueOut", 1.0)])
        };
        let packet = packet(&frame, "face", 60.0);
        let mut head = b"\x06\0\0\0\x24616E7966-6163-6500-0000-000000000001\0\0\0\x04face".to_vec();
        head.extend(b"\0\0\0\x03\0\0\0\0\0\0\0\x3c\0\0\0\x01\x3d");
        assert_eq!(packet[..head.len()], head);
        let values: Vec<f32> = packet[head.len()..]
            .chunks(4)
            .map(|bytes| f32::from_be_bytes(bytes.try_into().unwrap()))
            .collect();
        assert_eq!(values.len(), 61);
        assert_eq!((values[0], values[51]), (0.5, 1.0));
        assert!((values[53] + 0.25).abs() < 1e-6, "{}", values[53]);
        assert_eq!(values.iter().filter(|value| value.abs() > 1e-6).count(), 3);
    }

    #[test]
    fn left_stands_before_right_for_jaw_and_mouth() {
        let names = in_order();
        assert_eq!(names[15..17], ["jawLeft", "jawRight"]);
        assert_eq!(names[21..23], ["mouthLeft", "mouthRight"]);
        assert_eq!(
            [names[14], names[17], names[20], names[23], names[43]],
            [
                "jawForward",
                "jawOpen",
                "mouthPucker",
                "mouthSmileLeft",
                "browInnerUp"
            ]
        );
    }

    #[test]
    fn a_rate_that_is_no_whole_number_is_a_fraction() {
        assert_eq!((rate(25.0), rate(59.94)), ((25, 1), (59_940, 1000)));
    }
}
