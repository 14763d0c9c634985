use std::{
    fs,
    io::{Cursor, Write},
};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{Error, job::outside::guarded, nn::golden::path_of};

const PROTOCOL: &[u8] = b"\x80\x02";

fn text(words: &str) -> Vec<u8> {
    let length = u32::try_from(words.len()).unwrap().to_le_bytes();
    [&b"X"[..], &length, words.as_bytes()].concat()
}

/// A checkpoint with a pickle and one storage of sixteen numbers.
fn checkpoint(pickle: &[u8]) -> Input {
    let mut file = Cursor::new(Vec::new());
    let mut zip = zip::ZipWriter::new(&mut file);
    let plain =
        zip::write::SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    zip.start_file("archive/data.pkl", plain).unwrap();
    zip.write_all(pickle).unwrap();
    zip.start_file("archive/data/0", plain).unwrap();
    let numbers: Vec<u8> = (0..16).flat_map(|n| (n as f32).to_le_bytes()).collect();
    zip.write_all(&numbers).unwrap();
    zip.finish().unwrap();
    Input::Bytes(file)
}

/// A dictionary of one tensor, as `torch.save` writes it.
fn saved(kind: &str, numel: u8, shape: [u8; 2], strides: [u8; 2]) -> Vec<u8> {
    let [rows, columns] = shape;
    let [down, right] = strides;
    [
        PROTOCOL,
        b"}q\x00",
        &text("w"),
        b"ctorch._utils\n_rebuild_tensor_v2\n((",
        &text("storage"),
        format!("ctorch\n{kind}\n").as_bytes(),
        &text("0"),
        &text("cpu"),
        &[b'K', numel],
        b"tQK\x00",
        &[b'K', rows, b'K', columns, 0x86],
        &[b'K', down, b'K', right, 0x86],
        b"\x89ccollections\nOrderedDict\n)RtRs.",
    ]
    .concat()
}

fn refusal(pickle: &[u8]) -> String {
    read_tensors(checkpoint(pickle)).unwrap_err()
}

#[test]
fn tensors_are_read_by_their_strides() {
    let across = read_tensors(checkpoint(&saved("FloatStorage", 16, [2, 3], [1, 4])));
    let (name, (shape, values)) = across.unwrap().pop().unwrap();
    assert_eq!((name.as_str(), shape), ("w", vec![2, 3]));
    assert_eq!(values, [0.0, 4.0, 8.0, 1.0, 5.0, 9.0]);
}

#[test]
fn a_tensor_beyond_its_storage_and_a_storage_beyond_its_file_are_refused() {
    let beyond = refusal(&saved("FloatStorage", 16, [4, 5], [4, 1]));
    assert!(beyond.contains("within its 16 numbers"), "{beyond}");
    let short = refusal(&saved("FloatStorage", 17, [1, 1], [1, 1]));
    assert!(short.contains("expected 68 bytes, got 64"), "{short}");
    let same = refusal(&saved("FloatStorage", 1, [255, 255], [0, 0]));
    assert!(
        same.contains("no more numbers than the file has bytes"),
        "{same}"
    );
}

#[test]
fn what_is_no_tensor_is_refused_by_name() {
    let run = refusal(&[PROTOCOL, b"cos\nsystem\n", &text("true"), b"\x85R."].concat());
    assert!(run.contains("got os.system"), "{run}");
    let kind = refusal(&saved("ComplexFloatStorage", 8, [1, 1], [1, 1]));
    assert!(kind.contains("torch.ComplexFloatStorage"), "{kind}");
    let whole = refusal(&saved("BoolStorage", 1, [1, 1], [1, 1]));
    assert!(
        whole.contains("expected a dictionary of tensors, got none"),
        "{whole}"
    );
}

#[test]
fn pickles_that_grow_take_no_memory() {
    // A list becomes a pair of itself, that pair again a pair of itself, and so on forty times.
    // These would be 2^40 values if each were a copy.
    let mut laughs = [PROTOCOL, b"]", &text("lol"), b"aq\x00"].concat();
    for n in 0..40 {
        laughs.extend([b'(', b'h', n, b'h', n, b't', b'q', n + 1]);
    }
    laughs.push(b'.');
    assert!(refusal(&laughs).contains("values that are used again"));
    // A text of a megabyte is remembered a thousand times.
    let long = [&text(&"a".repeat(1 << 20))[..], &b"q\x00".repeat(1000)].concat();
    let puts = [PROTOCOL, &long, b"."].concat();
    assert!(refusal(&puts).contains("values that are used again"));
    let nest = [PROTOCOL, b"N", &vec![0x85; 1_500_000], b"."].concat();
    assert!(refusal(&nest).contains("in at most 32 others"));
    let endless = [PROTOCOL, &vec![b'N'; 3_000_000], b"."].concat();
    assert!(refusal(&endless).contains("instructions"));
    let length = [PROTOCOL, b"X\xff\xff\xff\xffa"].concat();
    assert!(refusal(&length).contains("expected 4294967295 bytes more, got 1"));
    let axes = [PROTOCOL, b"(", &b"K\x01".repeat(1000), b"tq\x00."].concat();
    assert!(refusal(&axes).contains("expected a dictionary"));
}

#[test]
fn mutated_pickles_are_read_or_refused() {
    let bytes = fs::read(path_of("hubert_tiny.bin")).unwrap();
    let mut zip = ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let name = zip.file_names().find(|name| name.ends_with("data.pkl"));
    let name = name.unwrap().to_owned();
    let mut pickle = Vec::new();
    zip.by_name(&name)
        .unwrap()
        .read_to_end(&mut pickle)
        .unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut refused = 0;
    for _ in 0..5_000 {
        let mut mutated = pickle.clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..mutated.len());
            match random.random_range(0..3) {
                0 => mutated[at] = random.random(),
                1 => mutated.truncate(at + 1),
                _ => {
                    let from = random.random_range(0..mutated.len());
                    let piece = mutated[from..(from + 16).min(mutated.len())].to_vec();
                    mutated.splice(at..at, piece);
                }
            }
        }
        let read = guarded(Error::Weights, || {
            tensors(&mutated, "archive/data").map_err(Error::Weights)
        });
        refused += usize::from(read.is_err());
    }
    assert!((1_000..5_000).contains(&refused), "{refused}");
}
