use std::{
    f64::consts::TAU,
    path::{Path, PathBuf},
};

use super::{intake::Intake, *};
use crate::{Error, Result, job::SILENT};

const TONE_HZ: f64 = 440.0;

fn tone(hz: f64, amplitude: f64, rate_hz: u32, seconds: f64) -> Vec<f32> {
    let frames = (seconds * f64::from(rate_hz)).round() as usize;
    let step = TAU * hz / f64::from(rate_hz);
    (0..frames)
        .map(|i| (amplitude * (step * i as f64).sin()) as f32)
        .collect()
}

/// Amplitude and phase of a sine at `hz` in the middle half of 16 kHz samples, and the root mean
/// square of what remains without it.
fn fit(samples: &[f32], hz: f64) -> (f64, f64, f64) {
    let (from, to) = (samples.len() / 4, samples.len() * 3 / 4);
    let step = TAU * hz / f64::from(SAMPLE_RATE_HZ);
    let (mut ss, mut cc, mut sc, mut xs, mut xc) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for i in from..to {
        let (s, c) = (step * i as f64).sin_cos();
        let x = f64::from(samples[i]);
        ss += s * s;
        cc += c * c;
        sc += s * c;
        xs += x * s;
        xc += x * c;
    }
    let det = ss * cc - sc * sc;
    let (a, b) = ((xs * cc - xc * sc) / det, (xc * ss - xs * sc) / det);
    let left: f64 = (from..to)
        .map(|i| {
            let (s, c) = (step * i as f64).sin_cos();
            (f64::from(samples[i]) - a * s - b * c).powi(2)
        })
        .sum();
    let rest = (left / (to - from) as f64).sqrt();
    (a.hypot(b), b.atan2(a), rest)
}

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn message(result: Result<Waveform>) -> String {
    match result {
        Err(Error::Audio(message) | Error::DamagedSound(message)) => message,
        other => panic!("expected an audio error, got {other:?}"),
    }
}

#[test]
fn a_tone_keeps_amplitude_phase_and_length_from_any_rate() {
    for rate in [
        4_000, 8_000, 11_025, 16_000, 22_050, 44_056, 44_100, 48_000, 96_000, 192_000, 384_000,
        15_999,
    ] {
        let samples = tone(TONE_HZ, 0.8, rate, 0.5);
        let waveform = Waveform::from_interleaved(&samples, 1, rate).unwrap();
        let expected = (samples.len() as f64 * 16_000.0 / f64::from(rate)).round() as usize;
        assert_eq!(waveform.samples.len(), expected, "at {rate} Hz");
        let (amplitude, phase, rest) = fit(&waveform.samples, TONE_HZ);
        assert!(
            (amplitude - 0.8).abs() < 1e-3,
            "at {rate} Hz: amplitude {amplitude}"
        );
        assert!(phase.abs() < 1e-3, "at {rate} Hz: phase {phase}");
        assert!(rest < 1e-3, "at {rate} Hz: distortion {rest}");
    }
}

#[test]
fn sound_above_the_new_limit_is_stopped_by_more_than_60_db() {
    for (rate, hz) in [
        (48_000, 8_400.0),
        (48_000, 15_000.0),
        (44_100, 12_000.0),
        (44_100, 20_000.0),
        (192_000, 80_000.0),
    ] {
        let samples = tone(hz, 1.0, rate, 0.5);
        let waveform = Waveform::from_interleaved(&samples, 1, rate).unwrap();
        let middle = &waveform.samples[2000..6000];
        let peak = middle.iter().fold(0.0f32, |p, x| p.max(x.abs()));
        assert!(peak < 1e-3, "{hz} Hz at {rate} Hz leaves {peak}");
    }
}

#[test]
fn speech_up_to_7600_hz_passes() {
    for rate in [16_001, 44_100, 48_000] {
        let samples = tone(7_600.0, 0.5, rate, 0.5);
        let waveform = Waveform::from_interleaved(&samples, 1, rate).unwrap();
        let (amplitude, _, _) = fit(&waveform.samples, 7_600.0);
        assert!((amplitude - 0.5).abs() < 5e-3, "at {rate} Hz: {amplitude}");
    }
}

#[test]
fn pieces_give_the_same_as_the_whole() {
    let samples = tone(TONE_HZ, 0.5, 44_100, 0.3);
    let whole = Waveform::from_interleaved(&samples, 1, 44_100).unwrap();
    let mut mono = Vec::new();
    let mut keep = |piece: &[f32]| {
        mono.extend_from_slice(piece);
        Ok(())
    };
    let mut intake = Intake::new(1, 44_100, &mut keep).unwrap();
    for piece in samples.chunks(777) {
        intake.push(piece).unwrap();
    }
    intake.finish().unwrap();
    assert_eq!(mono, whole.samples);
}

#[test]
fn stretches_of_a_long_file_are_those_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.wav");
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 8_000,
        bits_per_sample: 8,
        sample_format: hound::SampleFormat::Int,
    };
    let mut file = hound::WavWriter::create(&path, spec).unwrap();
    for i in 0..(8_000.0 * (WHOLE_S + 1.0)) as u32 {
        file.write_sample((i.wrapping_mul(2_654_435_761) >> 24) as i8)
            .unwrap();
    }
    file.finalize().unwrap();
    let read = || SoundFile::read(&path, false, SILENT).unwrap();
    let whole = read().whole(SILENT).unwrap();
    assert_eq!(whole.samples.len(), read().levels.samples);
    let stretches = [0..70_000, 60_000..4_000_000, 3_990_000..whole.samples.len()];
    let mut next = stretches.iter();
    let mut take = |part: Waveform| {
        let stretch = next.next().unwrap().clone();
        assert!(part.samples == whole.samples[stretch]);
        Ok(())
    };
    read().stretches(&stretches, &mut take).unwrap();
    assert_eq!(next.len(), 0);
    let refused = read().stretches(&stretches, &mut |_| Err(Error::Cancelled));
    assert!(matches!(refused, Err(Error::Cancelled)));
    let before = read();
    std::fs::write(&path, &std::fs::read(&path).unwrap()[..1_000_000]).unwrap();
    let changed = before.stretches(&stretches[2..], &mut |_| Ok(()));
    assert!(message(changed.map(|()| whole)).contains("the file"));
}

#[test]
fn channels_are_averaged_not_summed() {
    let waveform = Waveform::from_interleaved(&[1.0, 0.5, -1.0, 0.0], 2, 16_000).unwrap();
    assert_eq!(waveform.samples, [0.75, -0.5]);
}

#[test]
fn clipping_passes_as_it_is() {
    let samples: Vec<f32> = tone(TONE_HZ, 4.0, 16_000, 0.1)
        .iter()
        .map(|x| x.clamp(-1.0, 1.0))
        .collect();
    let waveform = Waveform::from_interleaved(&samples, 1, 16_000).unwrap();
    assert_eq!(waveform.levels().peak, 1.0);
}

#[test]
fn samples_that_are_not_finite_are_counted() {
    let mut samples = vec![0.1f32; 1000];
    samples[123] = f32::NAN;
    samples[777] = f32::INFINITY;
    let text = message(Waveform::from_interleaved(&samples, 1, 44_100));
    assert!(
        text.contains("2 of 1000") && text.contains("first at 123"),
        "{text}"
    );
}

#[test]
fn bad_layouts_say_what_was_expected() {
    assert!(message(Waveform::from_interleaved(&[], 1, 16_000)).contains("no samples"));
    assert!(message(Waveform::from_interleaved(&[0.0; 3], 2, 16_000)).contains("2 channels"));
    assert!(message(Waveform::from_interleaved(&[0.0; 3], 0, 16_000)).contains("0 channels"));
    assert!(message(Waveform::from_interleaved(&[0.0; 4], 1, 3_999)).contains("got 3999"));
    assert!(message(Waveform::from_interleaved(&[0.0; 4], 1, 400_000)).contains("got 400000"));
}

#[test]
fn one_sample_and_silence_are_sound() {
    let one = Waveform::from_interleaved(&[0.5], 1, 384_000).unwrap();
    assert_eq!(one.samples.len(), 1);
    let silence = Waveform::from_interleaved(&[0.0; 4410], 1, 44_100).unwrap();
    assert_eq!(silence.samples.len(), 1600);
    assert!(silence.is_silent());
}

fn write_wav(path: &Path, format: hound::SampleFormat, bits: u16, channels: u16) {
    let spec = hound::WavSpec {
        channels,
        sample_rate: 48_000,
        bits_per_sample: bits,
        sample_format: format,
    };
    let mut writer = hound::WavWriter::create(path, spec).unwrap();
    let full = (1u64 << (bits - 1)) as f64 - 1.0;
    for x in tone(TONE_HZ, 0.5, 48_000, 0.2) {
        for _ in 0..channels {
            match format {
                hound::SampleFormat::Float => writer.write_sample(x).unwrap(),
                hound::SampleFormat::Int => writer
                    .write_sample((f64::from(x) * full).round() as i32)
                    .unwrap(),
            }
        }
    }
    writer.finalize().unwrap();
}

#[test]
fn every_common_wav_is_read() {
    use hound::SampleFormat::{Float, Int};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tone.wav");
    // 24 bits and 3 channels make hound write the extensible header.
    for (format, bits, channels, tolerance) in [
        (Int, 8, 1, 5e-3),
        (Int, 16, 1, 1e-3),
        (Int, 16, 2, 1e-3),
        (Int, 16, 3, 1e-3),
        (Int, 24, 2, 1e-3),
        (Int, 32, 1, 1e-3),
        (Float, 32, 2, 1e-3),
    ] {
        write_wav(&path, format, bits, channels);
        let waveform = Waveform::from_file(&path).unwrap();
        assert_eq!(waveform.samples.len(), 3200);
        let (amplitude, phase, rest) = fit(&waveform.samples, TONE_HZ);
        let what = format!("{format:?} {bits} bits, {channels} channels");
        assert!((amplitude - 0.5).abs() < tolerance, "{what}: {amplitude}");
        assert!(phase.abs() < 1e-2, "{what}: phase {phase}");
        assert!(rest < 5e-3, "{what}: distortion {rest}");
    }
}

#[test]
fn every_other_format_keeps_the_tone_in_place() {
    // (file, tolerances: amplitude, phase in radians, length in samples)
    for (name, amplitude_tol, phase_tol, length_tol) in [
        ("tone.flac", 1e-3, 1e-3, 0),
        ("tone.aiff", 1e-3, 1e-3, 0),
        ("tone_alac.m4a", 1e-3, 1e-3, 0),
        ("tone_alaw.wav", 5e-3, 5e-3, 0),
        ("tone_mulaw.wav", 5e-3, 5e-3, 0),
        ("tone_f64.wav", 1e-3, 1e-3, 0),
        ("tone_adpcm.wav", 2e-2, 2e-2, 1000),
        ("tone.ogg", 2e-2, 2e-2, 0),
        // Opus at a low rate shifts the phase by less than a sample.
        ("tone_opus.ogg", 2e-2, 0.2, 0),
        ("tone.mp3", 2e-2, 2e-2, 0),
        // The edit list rounds to milliseconds.
        ("tone_aac.m4a", 2e-2, 2e-2, 16),
    ] {
        let waveform = Waveform::from_file(&fixture(name)).unwrap();
        let (amplitude, phase, rest) = fit(&waveform.samples, TONE_HZ);
        let off = waveform.samples.len().abs_diff(6400);
        assert!(off <= length_tol, "{name}: {off} samples off");
        assert!(
            (amplitude - 0.375).abs() < amplitude_tol,
            "{name}: {amplitude}"
        );
        assert!(phase.abs() < phase_tol, "{name}: phase {phase}");
        assert!(rest < 0.03, "{name}: distortion {rest}");
    }
}

/// The sound of the `sweep` fixtures: 0.6 s from 200 to 3,000 Hz at 16 kHz.
fn sweep() -> Vec<f32> {
    let rate = f64::from(SAMPLE_RATE_HZ);
    let sample = |i: usize| {
        let t = i as f64 / rate;
        let fade = (t.min(0.6 - t) / 0.02).clamp(0.0, 1.0);
        (0.5 * fade * (TAU * (200.0 * t + 2_800.0 * t * t / 1.2)).sin()) as f32
    };
    (0..9_600).map(sample).collect()
}

/// How many samples a sound lags behind `expected` at the best match, and the correlation there,
/// −1 to 1.
fn behind(samples: &[f32], expected: &[f32]) -> (isize, f32) {
    let at = |i: isize| samples.get(usize::try_from(i).ok()?).copied();
    let energy = |x: &[f32]| x.iter().map(|v| v * v).sum::<f32>();
    let norm = (energy(samples) * energy(expected)).sqrt();
    let agrees = |lag: isize| {
        let pairs = expected.iter().enumerate();
        let sum: f32 = pairs
            .filter_map(|(i, w)| Some(w * at(i as isize + lag)?))
            .sum();
        sum / norm
    };
    let all = (-1_000..1_000).map(|lag| (lag, agrees(lag)));
    all.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
}

#[test]
fn no_container_makes_a_sound_late() {
    let expected = sweep();
    // (file, most samples of padding after the sound, least correlation)
    for (name, padding, least) in [
        ("sweep_opus.ogg", 0, 0.98),
        ("sweep_opus.webm", 320, 0.98),
        ("sweep_opus.mp4", 0, 0.98),
        ("sweep_opus_frag.mp4", 320, 0.98),
        ("sweep_opus.caf", 320, 0.98),
        ("sweep_vorbis.webm", 0, 0.998),
        ("sweep.aac", 342, 0.998),
        ("sweep_frag.m4a", 342, 0.998),
        ("sweep_noedit.m4a", 342, 0.998),
        ("sweep_plain.mp3", 1_152, 0.998),
        ("sweep_plain16.mp3", 1_152, 0.998),
        ("sweep_alac.caf", 0, 0.999),
    ] {
        let file = SoundFile::read(&fixture(name), false, SILENT).unwrap();
        let damage = file.damage;
        let samples = file.whole(SILENT).unwrap().samples;
        let (lag, alike) = behind(&samples, &expected);
        assert!(
            lag.abs() <= 1 && alike > least,
            "{name}: {lag} samples late, {alike} alike"
        );
        assert_eq!(damage, None, "{name}");
        let longer = samples.len() as i64 - expected.len() as i64;
        assert!(
            (0..=padding).contains(&longer),
            "{name}: {longer} samples too many"
        );
    }
}

/// Turns a plain WAV with the usual header of 44 bytes into a Wave64 or RF64.
fn with_long_lengths(plain: &[u8], kind: &str) -> Vec<u8> {
    let (format, data) = (&plain[20..36], &plain[44..]);
    let mut bytes = Vec::new();
    if kind == "rf64" {
        bytes.extend(b"RF64\xff\xff\xff\xffWAVEds64\x1c\0\0\0");
        bytes.extend((plain.len() as u64 + 28).to_le_bytes());
        bytes.extend((data.len() as u64).to_le_bytes());
        bytes.extend([0; 12]);
        bytes.extend(b"fmt \x10\0\0\0");
        bytes.extend(format);
        bytes.extend(b"data\xff\xff\xff\xff");
        bytes.extend(data);
        return bytes;
    }
    let tail = b"\xf3\xac\xd3\x11\x8c\xd1\x00\xc0\x4f\x8e\xdb\x8a";
    let mut chunk = |name: &[u8; 4], body: &[u8]| {
        bytes.extend(name);
        bytes.extend(tail);
        bytes.extend((24 + body.len() as u64).to_le_bytes());
        bytes.extend(body);
    };
    chunk(b"junk", &[7; 8]);
    chunk(b"fmt ", format);
    chunk(b"data", data);
    let mut file = b"riff\x2e\x91\xcf\x11\xa5\xd6\x28\xdb\x04\xc1\x00\x00".to_vec();
    file.extend((40 + bytes.len() as u64).to_le_bytes());
    file.extend(b"wave");
    file.extend(tail);
    file.extend(bytes);
    file
}

#[test]
fn wavs_with_long_lengths_are_read_as_plain_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tone.wav");
    write_wav(&path, hound::SampleFormat::Int, 16, 2);
    let plain = std::fs::read(&path).unwrap();
    let expected = Waveform::from_file(&path).unwrap();
    for kind in ["rf64", "w64"] {
        let bytes = with_long_lengths(&plain, kind);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(Waveform::from_file(&path).unwrap(), expected, "{kind}");
        std::fs::write(&path, &bytes[..bytes.len() * 5 / 8]).unwrap();
        let text = message(Waveform::from_file(&path));
        assert!(text.contains("are missing"), "{kind}: {text}");
        std::fs::write(&path, &bytes[..60]).unwrap();
        assert!(message(Waveform::from_file(&path)).contains("ends before its samples"));
    }
    let mut huge = with_long_lengths(&plain, "rf64");
    huge[28..36].copy_from_slice(&(1u64 << 40).to_le_bytes());
    std::fs::write(&path, huge).unwrap();
    assert!(message(Waveform::from_file(&path)).contains("divide the recording"));
}

#[test]
fn a_wav_that_was_cut_off_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.wav");
    write_wav(&path, hound::SampleFormat::Int, 16, 2);
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(SoundFile::read(&path, false, SILENT).unwrap().damage, None);
    std::fs::write(&path, &bytes[..bytes.len() * 5 / 8]).unwrap();
    assert!(message(Waveform::from_file(&path)).contains("s of 0.20 s are missing"));
    let file = SoundFile::read(&path, true, SILENT).unwrap();
    assert!(file.levels.samples.abs_diff(2000) < 20);
    let damage = file.damage.unwrap();
    assert!((damage.share() - 0.375).abs() < 0.01, "{damage:?}");
    std::fs::write(&path, &bytes[..bytes.len() * 17 / 20]).unwrap();
    // A loss of 30 ms is too short to be reported.
    assert_eq!(SoundFile::read(&path, false, SILENT).unwrap().damage, None);
    let sentence = SoundDamage::of(0.06, 0.4).unwrap().sentence();
    assert!(
        sentence.contains("0.06 s of 0.40 s are missing"),
        "{sentence}"
    );
    // A program that writes to a pipe does not know the length.
    let mut endless = bytes.clone();
    endless[4..8].copy_from_slice(&[255; 4]);
    endless[40..44].copy_from_slice(&[255; 4]);
    std::fs::write(&path, endless).unwrap();
    let file = SoundFile::read(&path, false, SILENT).unwrap();
    assert_eq!((file.levels.samples, file.damage), (3200, None));
}

#[test]
fn each_audio_track_of_a_file_is_heard_by_its_number() {
    let path = fixture("two_tracks.m4a");
    let heard = |track: Option<usize>| {
        let file = SoundFile::read_track(&path, track, false, SILENT).unwrap();
        let said = file.track.sentence().unwrap();
        let samples = file.whole(SILENT).unwrap().samples;
        assert!(samples.len().abs_diff(8000) < 40, "{}", samples.len());
        let (low, high) = (fit(&samples, 440.0).0, fit(&samples, 1000.0).0);
        (low > 20.0 * high, high > 20.0 * low, said)
    };
    let said =
        |number: &str| format!("the file has 2 audio tracks, of which number {number} was taken");
    assert_eq!(heard(None), (true, false, said("1")));
    assert_eq!(heard(Some(1)), (true, false, said("1")));
    assert_eq!(heard(Some(2)), (false, true, said("2")));
    let track = AudioTrack {
        number: 3,
        count: 4,
        language: Some("jpn".to_owned()),
    };
    assert!(
        track
            .sentence()
            .unwrap()
            .ends_with("number 3 (jpn) was taken")
    );
    for (name, number, expected) in [
        ("two_tracks.m4a", 3, "expected 1 to 2, got 3"),
        ("two_tracks.m4a", 0, "expected 1 to 2, got 0"),
        ("tone.ogg", 2, "expected 1, the only one of the file, got 2"),
    ] {
        let read = SoundFile::read_track(&fixture(name), Some(number), false, SILENT);
        let error = read.map(|file| file.track).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    assert_eq!(
        SoundFile::read(&fixture("tone.ogg"), false, SILENT)
            .unwrap()
            .track
            .sentence(),
        None
    );
}

/// Bytes of a fixture with a stretch replaced by zeros.
fn with_hole(name: &str, from: f64, to: f64) -> Vec<u8> {
    let mut bytes = std::fs::read(fixture(name)).unwrap();
    let length = bytes.len() as f64;
    bytes[(from * length) as usize..(to * length) as usize].fill(0);
    bytes
}

#[test]
fn half_a_sound_is_not_taken_for_a_whole_one() {
    let folder = tempfile::tempdir().unwrap();
    for (name, from) in [("tone.ogg", 0.85), ("tone.mp3", 0.5), ("tone.flac", 0.5)] {
        let whole = SoundFile::read(&fixture(name), false, SILENT).unwrap();
        assert_eq!(whole.damage, None, "{name}");
        let path = folder.path().join(name);
        std::fs::write(&path, with_hole(name, from, 0.95)).unwrap();
        match SoundFile::read(&path, true, SILENT) {
            Ok(file) => {
                let damage = file
                    .damage
                    .unwrap_or_else(|| panic!("{name}: nothing is said"));
                assert!(damage.share() > 0.05, "{name}: {damage:?}");
            }
            Err(Error::Audio(_)) => {}
            Err(other) => panic!("{name}: {other}"),
        }
    }
    let bytes = std::fs::read(fixture("tone.mp3")).unwrap();
    let path = folder.path().join("half.mp3");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(message(Waveform::from_file(&path)).contains("are missing"));
    let file = SoundFile::read(&path, true, SILENT).unwrap();
    assert!(file.damage.unwrap().share() > 0.2 && file.levels.samples > 1000);
}

#[test]
fn samples_that_are_no_sound_are_refused() {
    for rate in [16_000, 44_100] {
        let mut samples = tone(TONE_HZ, 0.5, rate, 0.2);
        samples[777] = 3e38;
        let text = message(Waveform::from_interleaved(&samples, 1, rate));
        assert!(
            text.contains("±10000") && text.contains("first at 777"),
            "{text}"
        );
        samples[777] = -9_999.0;
        Waveform::from_interleaved(&samples, 1, rate).unwrap();
    }
    // Samples that are too large are refused even if left and right cancel out.
    let text = message(Waveform::from_interleaved(&[3e38, -3e38], 2, 16_000));
    assert!(text.contains("1 of 1"), "{text}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_wav_comes_through_a_pipe() {
    use std::os::fd::AsRawFd;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tone.wav");
    write_wav(&path, hound::SampleFormat::Int, 16, 1);
    let bytes = std::fs::read(&path).unwrap();
    let (reader, mut writer) = std::io::pipe().unwrap();
    let writing = std::thread::spawn(move || std::io::Write::write_all(&mut writer, &bytes));
    let pipe = PathBuf::from(format!("/proc/self/fd/{}", reader.as_raw_fd()));
    let piped = Waveform::from_file(&pipe).unwrap();
    writing.join().unwrap().unwrap();
    assert_eq!(piped, Waveform::from_file(&path).unwrap());
}

#[test]
fn files_that_are_no_sound_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.wav");
    std::fs::write(&path, b"").unwrap();
    assert!(message(Waveform::from_file(&path)).contains("empty"));
    std::fs::write(&path, b"RI").unwrap();
    assert!(message(Waveform::from_file(&path)).contains("expected WAV"));
    std::fs::write(&path, vec![7u8; 5000]).unwrap();
    assert!(message(Waveform::from_file(&path)).contains("expected WAV"));
    std::fs::write(&path, b"RIFF\x24\0\0\0WAVEfmt ").unwrap();
    message(Waveform::from_file(&path));
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 16_000,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    hound::WavWriter::create(&path, spec)
        .unwrap()
        .finalize()
        .unwrap();
    assert!(message(Waveform::from_file(&path)).contains("no samples"));
}

#[test]
fn a_missing_file_is_an_io_error_with_its_path() {
    let error = Waveform::from_file(Path::new("/no/such/sound.wav")).unwrap_err();
    assert!(matches!(error, Error::Io { .. }));
    assert!(error.to_string().contains("/no/such/sound.wav"));
}

#[test]
fn nan_in_a_float_wav_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nan.wav");
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: 44_100,
        bits_per_sample: 32,
        sample_format: hound::SampleFormat::Float,
    };
    let mut writer = hound::WavWriter::create(&path, spec).unwrap();
    for i in 0..20_000 {
        writer
            .write_sample(if i == 15_000 { f32::NAN } else { 0.1 })
            .unwrap();
    }
    writer.finalize().unwrap();
    assert!(message(Waveform::from_file(&path)).contains("first at 15000"));
}

/// The samples of a WAV give the same sound inside a CAF.
#[test]
fn laws_of_telephones_are_decoded_from_caf() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [("tone_alaw.wav", b"alaw"), ("tone_mulaw.wav", b"ulaw")] {
        let wav = fixture(name);
        let bytes = std::fs::read(&wav).unwrap();
        let find = |word: &[u8]| bytes.windows(4).position(|window| window == word).unwrap();
        let four = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let (form, data) = (find(b"fmt "), find(b"data"));
        let channels = u32::from(u16::from_le_bytes(
            bytes[form + 10..form + 12].try_into().unwrap(),
        ));
        let samples = &bytes[data + 8..][..four(data + 4) as usize];
        let mut caf = b"caff\0\x01\0\0desc".to_vec();
        caf.extend(32u64.to_be_bytes());
        caf.extend(f64::from(four(form + 12)).to_be_bytes());
        caf.extend(format);
        for number in [0, channels, 1, channels, 8] {
            caf.extend(number.to_be_bytes());
        }
        caf.extend(b"data");
        caf.extend((samples.len() as u64 + 4).to_be_bytes());
        caf.extend([0; 4]);
        caf.extend(samples);
        let path = folder.path().join("tone.caf");
        std::fs::write(&path, caf).unwrap();
        assert_eq!(
            Waveform::from_file(&path).unwrap(),
            Waveform::from_file(&wav).unwrap()
        );
    }
}
