//! Reads checkpoints that `torch.save` has written since PyTorch 1.6: a zip archive that holds a
//! pickle and the bytes of its tensors.
//!
//! A pickle is a program. This reader knows the few instructions that make tensors and plain
//! containers. It refuses everything else and names it, and its memory stays in proportion to the
//! file's size. candle's own reader copies the values that it remembers, so that a file of 633
//! bytes can fill all memory. It also drops nested values recursively, which overflows the stack.

use std::{
    collections::HashMap,
    io::{BufReader, Read},
};

use candle_core::{DType, Device, Tensor};
use zip::{CompressionMethod, ZipArchive};

use crate::job::Input;

/// The most bytes of a pickle. In the golden `hubert_tiny.bin`, a tensor takes 112 bytes and 31
/// instructions.
const LARGEST_PICKLE: u64 = 16 << 20;
const MOST_INSTRUCTIONS: usize = 2_000_000;
/// The most bytes of a name that is copied.
const LONGEST_NAME: usize = 256;
/// The most axes of a tensor.
const MOST_AXES: usize = 16;

/// Name, shape and values of each tensor.
type Arrays = Vec<(String, (Vec<usize>, Vec<f32>))>;

/// Reads all tensors of floating point numbers from the dictionary in a checkpoint.
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
    let (prefix, pickle) = archive.pickle()?;
    let values = Machine::run(&pickle)?;
    let mut elements = bytes;
    let mut arrays = Vec::new();
    for (name, tensor) in values.tensors()? {
        let Some(dtype) = tensor.storage.dtype else {
            continue;
        };
        let count = tensor.elements()?;
        elements = elements
            .checked_sub(count as u64)
            .ok_or("expected no more numbers than the file has bytes, got more")?;
        let storage = archive.storage(&prefix, &tensor.storage, dtype)?;
        let values = tensor.gather(count, storage)?;
        arrays.push((name.to_owned(), (tensor.shape.clone(), values)));
    }
    if arrays.is_empty() {
        Err("expected a dictionary of tensors, got none".to_owned())
    } else {
        Ok(arrays)
    }
}

/// The zip archive around a pickle.
struct Archive {
    zip: ZipArchive<BufReader<Input>>,
    /// Bytes of storages that may still be read. At first, this is the size of the file.
    budget: u64,
    storages: HashMap<String, Vec<f32>>,
}

impl Archive {
    /// The prefix of the names in the archive, and the pickle.
    fn pickle(&mut self) -> Result<(String, Vec<u8>), String> {
        let names = self.zip.file_names();
        let prefixes = names.filter_map(|name| name.strip_suffix("data.pkl"));
        let prefix = prefixes.min_by_key(|prefix| prefix.len());
        let prefix = prefix
            .ok_or("expected data.pkl in it, got none")?
            .to_owned();
        let entry = self.zip.by_name(&format!("{prefix}data.pkl"));
        let entry = entry.map_err(|error| error.to_string())?;
        let mut pickle = Vec::new();
        let mut limited = entry.take(LARGEST_PICKLE + 1);
        let read = limited.read_to_end(&mut pickle);
        read.map_err(|error| format!("data.pkl: {error}"))?;
        if pickle.len() as u64 > LARGEST_PICKLE {
            Err(format!(
                "data.pkl: expected at most {LARGEST_PICKLE} bytes, got more"
            ))
        } else {
            Ok((prefix, pickle))
        }
    }

    /// All numbers of a storage.
    fn storage(&mut self, prefix: &str, storage: &Storage, dtype: DType) -> Result<&[f32], String> {
        if !self.storages.contains_key(&storage.key) {
            let values = self.read_storage(prefix, storage, dtype)?;
            self.storages.insert(storage.key.clone(), values);
        }
        Ok(&self.storages[&storage.key])
    }

    fn read_storage(
        &mut self,
        prefix: &str,
        storage: &Storage,
        dtype: DType,
    ) -> Result<Vec<f32>, String> {
        let name = format!("{prefix}data/{}", storage.key);
        let in_it = |error: String| format!("{name}: {error}");
        let entry = self.zip.by_name(&name);
        let mut entry = entry.map_err(|error| in_it(error.to_string()))?;
        if entry.compression() != CompressionMethod::Stored {
            return Err(in_it(
                "expected plain bytes, as torch.save writes them, got compressed ones".into(),
            ));
        }
        let needed = (storage.numel as u64).saturating_mul(dtype.size_in_bytes() as u64);
        if entry.size() < needed {
            return Err(in_it(format!(
                "expected {needed} bytes, got {}",
                entry.size()
            )));
        }
        self.budget = self
            .budget
            .checked_sub(needed)
            .ok_or_else(|| in_it("expected no more bytes than the file has, got more".into()))?;
        let mut bytes = vec![0; needed as usize];
        let read = entry.read_exact(&mut bytes);
        read.map_err(|error| in_it(error.to_string()))?;
        let tensor = Tensor::from_raw_buffer(&bytes, dtype, &[storage.numel], &Device::Cpu);
        let values = tensor.and_then(|tensor| tensor.to_dtype(DType::F32)?.to_vec1());
        values.map_err(|error| in_it(error.to_string()))
    }
}

/// A list of numbers, of which tensors are views.
#[derive(Debug, Clone)]
struct Storage {
    /// `None` if the numbers are not floating point numbers.
    dtype: Option<DType>,
    key: String,
    numel: usize,
}

/// A view of a storage.
#[derive(Debug)]
struct View {
    storage: Storage,
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl View {
    /// Number of its elements. Checks that all of them lie in its storage.
    fn elements(&self) -> Result<usize, String> {
        let count = self
            .shape
            .iter()
            .try_fold(1_usize, |n, size| n.checked_mul(*size));
        let wrong = || {
            format!(
                "expected a tensor within its {} numbers, got shape {:?}, strides {:?}, offset {}",
                self.storage.numel, self.shape, self.strides, self.offset
            )
        };
        let count = count.ok_or_else(wrong)?;
        if count == 0 {
            return Ok(0);
        }
        let ways = self.shape.iter().zip(&self.strides);
        let last = ways
            .map(|(size, stride)| (size - 1).checked_mul(*stride))
            .try_fold(self.offset, |at, way| at.checked_add(way?));
        let fits = last.is_some_and(|last| last < self.storage.numel);
        if fits && self.shape.len() == self.strides.len() {
            Ok(count)
        } else {
            Err(wrong())
        }
    }

    /// Its numbers in row-major order.
    fn gather(&self, count: usize, storage: &[f32]) -> Result<Vec<f32>, String> {
        let mut out = Vec::with_capacity(count);
        let mut index = vec![0; self.shape.len()];
        let mut at = self.offset;
        for _ in 0..count {
            out.push(
                *storage
                    .get(at)
                    .ok_or("expected a tensor within its storage")?,
            );
            for axis in (0..index.len()).rev() {
                index[axis] += 1;
                at += self.strides[axis];
                if index[axis] < self.shape[axis] {
                    break;
                }
                at -= index[axis] * self.strides[axis];
                index[axis] = 0;
            }
        }
        Ok(out)
    }
}

/// Index of a value in the list of all values.
type Id = usize;

/// A value that a pickle makes. Values refer to each other by index, so that nothing is copied and
/// nothing nests.
#[derive(Debug)]
enum Value {
    /// None, a Boolean or a floating point number. Tensors need none of these.
    Plain,
    Number(i64),
    Text(String),
    Global(String),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    Storage(Storage),
    Tensor(View),
}

/// All values of a pickle.
struct Values {
    all: Vec<Value>,
    result: Id,
}

impl Values {
    /// The tensors in the dictionary that the pickle results in, with their names.
    fn tensors(&self) -> Result<Vec<(&str, &View)>, String> {
        let Value::Dict(items) = &self.all[self.result] else {
            return Err("expected a dictionary of tensors, got another value".to_owned());
        };
        let named =
            items
                .iter()
                .filter_map(|(key, value)| match (&self.all[*key], &self.all[*value]) {
                    (Value::Text(name), Value::Tensor(view)) => Some((name.as_str(), view)),
                    _ => None,
                });
        Ok(named.collect())
    }
}

/// Runs a pickle.
struct Machine<'a> {
    rest: &'a [u8],
    values: Vec<Value>,
    stack: Vec<Id>,
    /// Height of the stack at each mark.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

impl<'a> Machine<'a> {
    fn run(pickle: &'a [u8]) -> Result<Values, String> {
        let mut machine = Machine {
            rest: pickle,
            values: Vec::new(),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: HashMap::new(),
        };
        for _ in 0..MOST_INSTRUCTIONS {
            let at = pickle.len() - machine.rest.len();
            let in_it = |error: String| format!("data.pkl, byte {at}: {error}");
            if machine.step().map_err(in_it)? {
                let result = machine.pop().map_err(in_it)?;
                return Ok(Values {
                    all: machine.values,
                    result,
                });
            }
        }
        Err(format!(
            "data.pkl: expected at most {MOST_INSTRUCTIONS} instructions, got more"
        ))
    }

    /// Runs one instruction. Returns whether it was the last.
    ///
    /// Each arm runs instructions that `torch.save` writes, identified by their bytes in Python's
    /// `pickletools`. Any other instruction is refused.
    fn step(&mut self) -> Result<bool, String> {
        match self.byte()? {
            b'.' => return Ok(true),
            // Protocol; frame.
            0x80 => drop(self.take(1)?),
            0x95 => drop(self.take(8)?),
            b'N' | 0x88 | 0x89 => self.push(Value::Plain),
            b'G' => {
                self.take(8)?;
                self.push(Value::Plain);
            }
            b'K' => {
                let number = i64::from(self.byte()?);
                self.push(Value::Number(number));
            }
            b'M' => {
                let number = u16::from_le_bytes(self.array()?);
                self.push(Value::Number(number.into()));
            }
            b'J' => {
                let number = i32::from_le_bytes(self.array()?);
                self.push(Value::Number(number.into()));
            }
            0x8a => {
                let number = self.long()?;
                self.push(Value::Number(number));
            }
            b'X' => {
                let length = u32::from_le_bytes(self.array()?);
                self.text(length as usize)?;
            }
            0x8c => {
                let length = self.byte()?;
                self.text(length.into())?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.push(Value::Global(global(module, name)?));
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let name = global(self.text_of(module)?, self.text_of(name)?)?;
                self.push(Value::Global(name));
            }
            b'(' => self.marks.push(self.stack.len()),
            b'}' => self.push(Value::Dict(Vec::new())),
            b']' => self.push(Value::List(Vec::new())),
            b')' => self.push(Value::Tuple(Vec::new())),
            b't' => {
                let items = self.pop_to_mark()?;
                self.push(Value::Tuple(items));
            }
            code @ 0x85..=0x87 => {
                let items = self.pop_many(usize::from(code - 0x84))?;
                self.push(Value::Tuple(items));
            }
            b'a' => {
                let item = self.pop()?;
                self.append(vec![item])?;
            }
            b'e' => {
                let items = self.pop_to_mark()?;
                self.append(items)?;
            }
            b's' => {
                let items = self.pop_many(2)?;
                self.set_items(&items)?;
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set_items(&items)?;
            }
            b'q' => {
                let place = self.byte()?;
                self.remember(place.into())?;
            }
            b'r' => {
                let place = u32::from_le_bytes(self.array()?);
                self.remember(place)?;
            }
            0x94 => {
                let place = self.memo.len();
                self.remember(u32::try_from(place).map_err(|error| error.to_string())?)?;
            }
            b'h' => {
                let place = self.byte()?;
                self.recall(place.into())?;
            }
            b'j' => {
                let place = u32::from_le_bytes(self.array()?);
                self.recall(place)?;
            }
            b'Q' => {
                let id = self.pop()?;
                let storage = self.storage(id)?;
                self.push(Value::Storage(storage));
            }
            b'R' => {
                let (arguments, function) = (self.pop()?, self.pop()?);
                self.call(function, arguments)?;
            }
            // The state of an object. For an ordered dictionary this is metadata, which is dropped.
            b'b' => drop(self.pop()?),
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

    fn byte(&mut self) -> Result<u8, String> {
        Ok(self.take(1)?[0])
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let bytes = self.take(N)?;
        Ok(bytes.try_into().expect("as many bytes as were asked for"))
    }

    /// An integer of up to eight bytes.
    fn long(&mut self) -> Result<i64, String> {
        let length = self.byte()?;
        let bytes = self.take(length.into())?;
        if bytes.len() > 8 {
            return Err(format!(
                "expected an integer of at most 8 bytes, got {length}"
            ));
        }
        let sign = bytes.last().is_some_and(|byte| *byte >= 0x80);
        let mut whole = [if sign { 0xff } else { 0 }; 8];
        whole[..bytes.len()].copy_from_slice(bytes);
        Ok(i64::from_le_bytes(whole))
    }

    fn text(&mut self, length: usize) -> Result<(), String> {
        let bytes = self.take(length)?;
        let text = str::from_utf8(bytes).map_err(|error| error.to_string())?;
        self.push(Value::Text(text.to_owned()));
        Ok(())
    }

    fn line(&mut self) -> Result<&'a str, String> {
        let end = self.rest.iter().position(|byte| *byte == b'\n');
        let line = self.take(end.ok_or("expected the end of a line, got none")?)?;
        self.take(1)?;
        str::from_utf8(line).map_err(|error| error.to_string())
    }

    fn push(&mut self, value: Value) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    fn pop(&mut self) -> Result<Id, String> {
        let above_mark = self.stack.len() > self.marks.last().copied().unwrap_or_default();
        let top = self.stack.pop().filter(|_| above_mark);
        top.ok_or_else(|| "expected a value on the stack, got none".to_owned())
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>, String> {
        let mut items = (0..count)
            .map(|_| self.pop())
            .collect::<Result<Vec<_>, _>>()?;
        items.reverse();
        Ok(items)
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, String> {
        let mark = self.marks.pop().ok_or("expected a mark, got none")?;
        Ok(self.stack.split_off(mark.min(self.stack.len())))
    }

    fn top(&self) -> Result<Id, String> {
        let top = self.stack.last().copied();
        top.ok_or_else(|| "expected a value on the stack, got none".to_owned())
    }

    fn append(&mut self, items: Vec<Id>) -> Result<(), String> {
        let list = self.top()?;
        match &mut self.values[list] {
            Value::List(all) => {
                all.extend(items);
                Ok(())
            }
            _ => Err("expected a list, got another value".to_owned()),
        }
    }

    fn set_items(&mut self, items: &[Id]) -> Result<(), String> {
        let dict = self.top()?;
        match (&mut self.values[dict], items.len() % 2) {
            (Value::Dict(all), 0) => {
                all.extend(items.chunks(2).map(|pair| (pair[0], pair[1])));
                Ok(())
            }
            _ => Err("expected a dictionary and pairs, got other values".to_owned()),
        }
    }

    fn remember(&mut self, place: u32) -> Result<(), String> {
        let top = self.top()?;
        self.memo.insert(place, top);
        Ok(())
    }

    fn recall(&mut self, place: u32) -> Result<(), String> {
        let id = self.memo.get(&place).copied();
        let id = id.ok_or_else(|| format!("expected a value at {place} of the memo, got none"))?;
        self.stack.push(id);
        Ok(())
    }

    fn text_of(&self, id: Id) -> Result<&str, String> {
        match &self.values[id] {
            Value::Text(text) => Ok(text),
            _ => Err("expected a text, got another value".to_owned()),
        }
    }

    fn tuple_of(&self, id: Id) -> Result<&[Id], String> {
        match &self.values[id] {
            Value::Tuple(items) => Ok(items),
            _ => Err("expected a tuple, got another value".to_owned()),
        }
    }

    fn size_of(&self, id: Id) -> Result<usize, String> {
        match self.values[id] {
            Value::Number(number) => usize::try_from(number).ok(),
            _ => None,
        }
        .ok_or_else(|| "expected a size, got another value".to_owned())
    }

    fn sizes_of(&self, id: Id) -> Result<Vec<usize>, String> {
        let items = self.tuple_of(id)?;
        if items.len() > MOST_AXES {
            Err(format!(
                "expected at most {MOST_AXES} axes, got {}",
                items.len()
            ))
        } else {
            items.iter().map(|item| self.size_of(*item)).collect()
        }
    }

    /// Reads the tuple `("storage", torch.FloatStorage, key, device, numel)`.
    fn storage(&self, id: Id) -> Result<Storage, String> {
        let &[_, kind, key, _, numel] = self.tuple_of(id)? else {
            return Err("expected a storage of five values, got another number".to_owned());
        };
        let Value::Global(kind) = &self.values[kind] else {
            return Err("expected a kind of storage, got another value".to_owned());
        };
        Ok(Storage {
            dtype: dtype(kind)?,
            key: short(self.text_of(key)?)?.to_owned(),
            numel: self.size_of(numel)?,
        })
    }

    fn call(&mut self, function: Id, arguments: Id) -> Result<(), String> {
        let Value::Global(name) = &self.values[function] else {
            return Err("expected the name of a function, got another value".to_owned());
        };
        let items = self.tuple_of(arguments)?;
        let value = match (name.as_str(), items) {
            ("collections.OrderedDict", _) => Value::Dict(Vec::new()),
            ("torch._utils._rebuild_tensor_v2", &[storage, offset, shape, strides, ..]) => {
                let Value::Storage(storage) = &self.values[storage] else {
                    return Err("expected a storage, got another value".to_owned());
                };
                Value::Tensor(View {
                    storage: storage.clone(),
                    offset: self.size_of(offset)?,
                    shape: self.sizes_of(shape)?,
                    strides: self.sizes_of(strides)?,
                })
            }
            ("torch.Size", &[same]) | ("torch._utils._rebuild_parameter", &[same, ..]) => {
                self.stack.push(same);
                return Ok(());
            }
            (other, _) => {
                return Err(format!(
                    "expected tensors and plain containers, got {other}"
                ));
            }
        };
        self.push(value);
        Ok(())
    }
}

/// The full name of a class or function.
fn global(module: &str, name: &str) -> Result<String, String> {
    Ok(format!("{}.{}", short(module)?, short(name)?))
}

fn short(name: &str) -> Result<&str, String> {
    if name.len() > LONGEST_NAME {
        Err(format!(
            "expected a name of at most {LONGEST_NAME} letters, got {}",
            name.len()
        ))
    } else {
        Ok(name)
    }
}

/// Type of the numbers in a kind of storage; `None` if they are not floating point numbers.
fn dtype(kind: &str) -> Result<Option<DType>, String> {
    match kind {
        "torch.FloatStorage" => Ok(Some(DType::F32)),
        "torch.DoubleStorage" => Ok(Some(DType::F64)),
        "torch.HalfStorage" => Ok(Some(DType::F16)),
        "torch.BFloat16Storage" => Ok(Some(DType::BF16)),
        "torch.LongStorage" | "torch.IntStorage" | "torch.ShortStorage" | "torch.CharStorage"
        | "torch.ByteStorage" | "torch.BoolStorage" => Ok(None),
        other => Err(format!("expected a storage of numbers, got {other}")),
    }
}

#[cfg(test)]
mod tests;
