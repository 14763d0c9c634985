//! Reads checkpoints that `torch.save` has written since PyTorch 1.6: a zip archive that holds a
//! pickle and the bytes of its tensors.
//!
//! A pickle is a program. candle runs it and knows only the few instructions that make tensors and
//! plain containers. But candle copies the values that it remembers, so that a file of 633 bytes
//! could fill all memory, and it drops nested values recursively, which could overflow the stack.
//! Therefore [`check`] counts copies and depth before candle reads, and the bytes of tensors are
//! read here, in proportion to the file's size.

use std::{
    collections::HashMap,
    io::{BufReader, Read},
};

use candle_core::{
    DType, Device, Tensor,
    pickle::{Object, Stack, TensorInfo},
};
use zip::{CompressionMethod, ZipArchive};

use crate::job::Input;

/// The most bytes of a pickle. In the golden `hubert_tiny.bin`, a tensor takes 112 bytes and 31
/// instructions.
const LARGEST_PICKLE: u64 = 16 << 20;
const MAX_INSTRUCTIONS: usize = 2_000_000;
/// The most bytes that candle may copy. A tensor takes three thousand.
const MAX_COPIES: usize = 256 << 20;
/// The deepest nesting of values. A tensor in a dictionary takes six.
const DEEPEST: usize = 32;
/// The most bytes of a name.
const LONGEST_NAME: usize = 256;
/// What a pickle of tensors names, besides kinds of storages.
const NAMES: [&str; 4] = [
    "collections.OrderedDict",
    "torch.Size",
    "torch._utils._rebuild_parameter",
    "torch._utils._rebuild_tensor_v2",
];
/// Kinds of storages. Tensors of whole numbers are left out: no network here has any.
const KINDS: [&str; 10] = [
    "BFloat16", "Bool", "Byte", "Char", "Double", "Float", "Half", "Int", "Long", "Short",
];

/// Name, shape and values of each tensor.
type Arrays = Vec<(String, (Vec<usize>, Vec<f32>))>;

/// Reads all tensors of floating point numbers from the dictionary in a checkpoint. candle panics
/// where a tensor lacks arguments, so this has to run under [`guarded`](crate::job::outside::guarded).
///
/// # Errors
/// A message that says what was expected and what the file holds.
pub(super) fn read_tensors(file: Input) -> Result<Arrays, String> {
    let bytes = file.length().map_err(|error| error.to_string())?;
    let zip = ZipArchive::new(BufReader::new(file)).map_err(|error| error.to_string())?;
    let mut archive = Archive {
        zip,
        budget: bytes,
        storages: HashMap::new(),
    };
    let (folder, pickle) = archive.pickle()?;
    let mut elements = bytes;
    let mut arrays = Vec::new();
    for info in tensors(&pickle, &folder)? {
        let shape = info.layout.dims().to_vec();
        let count = shape
            .iter()
            .fold(1, |n: u64, size| n.saturating_mul(*size as u64));
        elements = elements
            .checked_sub(count)
            .ok_or("expected no more numbers than the file has bytes, got more")?;
        let values = gather(&info, archive.storage(&info)?, count as usize)?;
        arrays.push((info.name, (shape, values)));
    }
    if arrays.is_empty() {
        Err("expected a dictionary of tensors, got none".to_owned())
    } else {
        Ok(arrays)
    }
}

/// The tensors of floating point numbers in a pickle. `folder`: the archive's folder of storages.
fn tensors(pickle: &[u8], folder: &str) -> Result<Vec<TensorInfo>, String> {
    check(pickle)?;
    let mut stack = Stack::empty();
    let run = stack.read_loop(&mut &pickle[..]);
    let result = run.and_then(|()| stack.finalize());
    let Object::Dict(items) = result.map_err(|error| format!("data.pkl: {error}"))? else {
        return Err("expected a dictionary of tensors, got another value".to_owned());
    };
    let infos = items.into_iter().filter_map(|(name, value)| {
        let info = value.into_tensor_info(name, folder.as_ref()).ok().flatten();
        info.filter(|info| info.dtype.is_float())
    });
    Ok(infos.collect())
}

/// The `count` numbers of a tensor in row-major order.
fn gather(info: &TensorInfo, storage: &[f32], count: usize) -> Result<Vec<f32>, String> {
    let (shape, strides) = (info.layout.dims(), info.layout.stride());
    // candle counts the offset in bytes.
    let offset = info.layout.start_offset() / info.dtype.size_in_bytes();
    let mut places = vec![offset; count.min(1)];
    for (size, stride) in shape.iter().zip(strides) {
        let row = |place: &usize| {
            let place = *place;
            (0..*size).map(move |step| place.saturating_add(step.saturating_mul(*stride)))
        };
        places = places.iter().flat_map(row).collect();
    }
    let values: Option<Vec<f32>> = places
        .iter()
        .map(|place| storage.get(*place).copied())
        .collect();
    values.filter(|values| values.len() == count).ok_or_else(|| {
        format!(
            "expected a tensor within its {} numbers, got shape {shape:?}, strides {strides:?}, offset {offset}",
            storage.len()
        )
    })
}

/// The zip archive around a pickle.
struct Archive {
    zip: ZipArchive<BufReader<Input>>,
    /// Bytes of storages that may still be read. At first, this is the size of the file.
    budget: u64,
    storages: HashMap<String, Vec<f32>>,
}

impl Archive {
    /// The archive's folder of storages, and the pickle.
    fn pickle(&mut self) -> Result<(String, Vec<u8>), String> {
        let names = self.zip.file_names();
        let names = names.filter(|name| name.ends_with("data.pkl"));
        let name = names.min_by_key(|name| name.len());
        let name = name.ok_or("expected data.pkl in it, got none")?.to_owned();
        let entry = self.zip.by_name(&name).map_err(|error| error.to_string())?;
        let mut pickle = Vec::new();
        let mut limited = entry.take(LARGEST_PICKLE + 1);
        let read = limited.read_to_end(&mut pickle);
        read.map_err(|error| format!("data.pkl: {error}"))?;
        if pickle.len() as u64 > LARGEST_PICKLE {
            return Err(format!(
                "data.pkl: expected at most {LARGEST_PICKLE} bytes, got more"
            ));
        }
        Ok((name.trim_end_matches(".pkl").to_owned(), pickle))
    }

    /// All numbers of a tensor's storage.
    fn storage(&mut self, info: &TensorInfo) -> Result<&[f32], String> {
        if !self.storages.contains_key(&info.path) {
            let values = self.read_storage(info);
            let values = values.map_err(|error| format!("{}: {error}", info.path))?;
            self.storages.insert(info.path.clone(), values);
        }
        Ok(&self.storages[&info.path])
    }

    fn read_storage(&mut self, info: &TensorInfo) -> Result<Vec<f32>, String> {
        let entry = self.zip.by_name(&info.path);
        let mut entry = entry.map_err(|error| error.to_string())?;
        if entry.compression() != CompressionMethod::Stored {
            return Err(
                "expected plain bytes, as torch.save writes them, got compressed ones".into(),
            );
        }
        let size = info.dtype.size_in_bytes() as u64;
        let needed = (info.storage_size as u64).saturating_mul(size);
        if entry.size() < needed {
            return Err(format!("expected {needed} bytes, got {}", entry.size()));
        }
        let rest = self.budget.checked_sub(needed);
        self.budget = rest.ok_or("expected no more bytes than the file has, got more")?;
        let mut bytes = vec![0; needed as usize];
        let read = entry.read_exact(&mut bytes);
        read.map_err(|error| error.to_string())?;
        let shape = [info.storage_size];
        let tensor = Tensor::from_raw_buffer(&bytes, info.dtype, &shape, &Device::Cpu);
        let values = tensor.and_then(|tensor| tensor.to_dtype(DType::F32)?.to_vec1());
        values.map_err(|error| error.to_string())
    }
}

/// What candle holds for a value: how deep it nests, and how many bytes a copy takes.
#[derive(Clone, Copy, Default)]
struct Size {
    depth: usize,
    bytes: usize,
}

/// Follows a pickle without making its values.
struct Scan<'a> {
    rest: &'a [u8],
    /// `None` is a mark.
    stack: Vec<Option<Size>>,
    memo: HashMap<u32, Size>,
    copies: usize,
}

/// Checks that candle can run a pickle within limits of memory and depth.
///
/// # Errors
/// The place of an instruction, what was expected there and what the pickle has.
fn check(pickle: &[u8]) -> Result<(), String> {
    let mut scan = Scan {
        rest: pickle,
        stack: Vec::new(),
        memo: HashMap::new(),
        copies: 0,
    };
    for _ in 0..MAX_INSTRUCTIONS {
        let at = pickle.len() - scan.rest.len();
        let step = scan.step();
        if step.map_err(|error| format!("data.pkl, byte {at}: {error}"))? {
            return Ok(());
        }
    }
    Err(format!(
        "data.pkl: expected at most {MAX_INSTRUCTIONS} instructions, got more"
    ))
}

impl<'a> Scan<'a> {
    /// Follows one instruction, identified by its byte in Python's `pickletools`. Returns whether it
    /// was the last.
    fn step(&mut self) -> Result<bool, String> {
        match self.take(1)?[0] {
            b'.' => return Ok(true),
            // The protocol.
            0x80 => drop(self.take(1)?),
            b'(' => self.stack.push(None),
            b'N' | 0x88 | 0x89 | b'}' | b']' | b')' => self.leaf(0)?,
            b'K' => self.leaf(1)?,
            b'M' => self.leaf(2)?,
            b'J' => self.leaf(4)?,
            b'G' => self.leaf(8)?,
            0x8a => match self.number(1)? {
                bytes @ 0..=8 => self.leaf(bytes)?,
                bytes => {
                    return Err(format!(
                        "expected an integer of at most 8 bytes, got {bytes}"
                    ));
                }
            },
            b'X' => {
                let bytes = self.number(4)?;
                self.leaf(bytes)?;
            }
            b'c' => self.name()?,
            b'Q' => self.wrap(1)?,
            b'R' | b'b' => self.wrap(2)?,
            code @ 0x85..=0x87 => self.wrap(usize::from(code - 0x84))?,
            b't' => {
                let count = self.above_mark()?;
                self.wrap(count)?;
            }
            b'a' => self.add(1)?,
            b's' => self.add(2)?,
            b'e' | b'u' => {
                let count = self.above_mark()?;
                self.add(count)?;
            }
            code @ (b'q' | b'r') => {
                let place = self.number(if code == b'q' { 1 } else { 4 })?;
                let size = *self.top()?;
                self.copy(size)?;
                self.memo.insert(place as u32, size);
            }
            code @ (b'h' | b'j') => {
                let place = self.number(if code == b'h' { 1 } else { 4 })?;
                let size = self.memo.get(&(place as u32)).copied();
                let size = size
                    .ok_or_else(|| format!("expected a value at {place} of the memo, got none"))?;
                self.copy(size)?;
                self.stack.push(Some(size));
            }
            other => {
                return Err(format!(
                    "expected an instruction that torch.save writes, got {other:#04x}"
                ));
            }
        }
        Ok(false)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (bytes, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| format!("expected {count} bytes more, got {}", self.rest.len()))?;
        self.rest = rest;
        Ok(bytes)
    }

    /// A number of one or four bytes.
    fn number(&mut self, bytes: usize) -> Result<usize, String> {
        let bytes = self.take(bytes)?.iter().rev();
        Ok(bytes.fold(0, |number, byte| number << 8 | usize::from(*byte)))
    }

    /// Pushes a value that holds no others and has this many bytes in the pickle.
    fn leaf(&mut self, bytes: usize) -> Result<(), String> {
        self.take(bytes)?;
        let bytes = size_of::<Object>() + bytes;
        self.stack.push(Some(Size { depth: 0, bytes }));
        Ok(())
    }

    /// Pushes a class or function, if a pickle of tensors may name it.
    fn name(&mut self) -> Result<(), String> {
        let (module, class) = (self.line()?, self.line()?);
        let kind = class.strip_suffix("Storage");
        let name = format!("{module}.{class}");
        if module == "torch" && kind.is_some_and(|kind| KINDS.contains(&kind))
            || NAMES.contains(&&*name)
        {
            self.stack.push(Some(Size {
                depth: 0,
                bytes: size_of::<Object>() + name.len(),
            }));
            Ok(())
        } else {
            Err(format!("expected tensors and plain containers, got {name}"))
        }
    }

    fn line(&mut self) -> Result<&'a str, String> {
        let until = self.rest.len().min(LONGEST_NAME);
        let end = self.rest[..until].iter().position(|byte| *byte == b'\n');
        let end = end.ok_or_else(|| {
            format!("expected a name of at most {LONGEST_NAME} letters, got more")
        })?;
        let line = self.take(end)?;
        self.take(1)?;
        str::from_utf8(line).map_err(|error| error.to_string())
    }

    fn top(&mut self) -> Result<&mut Size, String> {
        let top = self.stack.last_mut().and_then(Option::as_mut);
        top.ok_or_else(|| "expected a value on the stack, got none".to_owned())
    }

    /// Removes the topmost mark and returns how many values stood above it.
    fn above_mark(&mut self) -> Result<usize, String> {
        let mark = self.stack.iter().rposition(Option::is_none);
        let mark = mark.ok_or("expected a mark, got none")?;
        self.stack.remove(mark);
        Ok(self.stack.len() - mark)
    }

    /// Takes values from the stack. Returns the size of a container of them.
    fn pop(&mut self, count: usize) -> Result<Size, String> {
        let mut whole = Size {
            depth: 1,
            bytes: size_of::<Object>(),
        };
        for _ in 0..count {
            let size = *self.top()?;
            self.stack.pop();
            whole.depth = whole.depth.max(size.depth + 1);
            whole.bytes += size.bytes;
        }
        if whole.depth > DEEPEST {
            Err(format!(
                "expected values in at most {DEEPEST} others, got more"
            ))
        } else {
            Ok(whole)
        }
    }

    /// Makes one value of several.
    fn wrap(&mut self, count: usize) -> Result<(), String> {
        let whole = self.pop(count)?;
        self.stack.push(Some(whole));
        Ok(())
    }

    /// Puts values into the container below them.
    fn add(&mut self, count: usize) -> Result<(), String> {
        let items = self.pop(count)?;
        let container = self.top()?;
        container.depth = container.depth.max(items.depth);
        container.bytes += items.bytes;
        Ok(())
    }

    fn copy(&mut self, size: Size) -> Result<(), String> {
        self.copies = self.copies.saturating_add(size.bytes);
        if self.copies > MAX_COPIES {
            Err(format!(
                "expected at most {MAX_COPIES} bytes of values that are used again, got more"
            ))
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests;
