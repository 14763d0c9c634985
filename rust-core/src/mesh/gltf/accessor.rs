//! Reads numbers from a file's buffers. Checks each range against the available bytes.

use std::{
    borrow::Cow,
    cell::{Cell, OnceCell},
};

use base64::{
    Engine,
    alphabet::STANDARD,
    engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig},
};

use super::{
    document::{Accessor, Document, SparsePart, missing, refusal},
    meshopt::Compression,
};
use crate::{Error, Result};

/// Views that are decompressed may have this many bytes in addition to sixteen for each byte of
/// the file.
const DECOMPRESSED: usize = 256 << 20;
/// The component type of floats.
const FLOATS: u32 = 5126;

/// How one number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Result<Component> {
        Ok(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            FLOATS => Component::F32,
            _ => return Err(refusal(format!("expected a component type, got {code}"))),
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// The number that stands for 1 where numbers are normalised.
    fn most(self) -> f32 {
        match self {
            Component::I8 => 127.0,
            Component::U8 => 255.0,
            Component::I16 => 32767.0,
            Component::U16 => 65535.0,
            Component::U32 => u32::MAX as f32,
            Component::F32 => 1.0,
        }
    }

    /// The first number in `bytes`, as stored or, if `normalized`, scaled to −1 … 1 or 0 … 1.
    fn number(self, bytes: &[u8], normalized: bool) -> f32 {
        let value = match self {
            Component::I8 => f32::from(bytes[0] as i8),
            Component::U8 => f32::from(bytes[0]),
            Component::I16 => f32::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U16 => f32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U32 => self.index(bytes) as f32,
            Component::F32 => f32::from_bits(self.index(bytes)),
        };
        if normalized && self != Component::F32 {
            (value / self.most()).max(-1.0)
        } else {
            value
        }
    }

    /// The first number in `bytes` as a whole number.
    fn index(self, bytes: &[u8]) -> u32 {
        match self.size() {
            1 => u32::from(bytes[0]),
            2 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }
}

/// Elements at equal distances in a buffer.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn at(&self, i: usize) -> &'a [u8] {
        &self.bytes[i * self.stride..][..self.size]
    }
}

/// A glTF description and the bytes to which it refers.
pub(super) struct Data<'a> {
    pub document: &'a Document,
    buffers: Vec<Option<Cow<'a, [u8]>>>,
    /// Bytes of each compressed view that was read, as they were before they were compressed.
    decompressed: Vec<OnceCell<Vec<u8>>>,
    /// Bytes that may still be decompressed.
    budget: Cell<usize>,
    /// Number of bytes in all buffers, and in all compressed views before they were compressed.
    total: usize,
}

impl<'a> Data<'a> {
    /// `binary`: the file's own data. It is the first buffer unless that buffer has a URI.
    pub(super) fn new(document: &'a Document, binary: &'a [u8]) -> Result<Data<'a>> {
        let mut buffers = Vec::new();
        for (number, buffer) in document.buffers.iter().enumerate() {
            buffers.push(match &buffer.uri {
                None if number == 0 => Some(Cow::Borrowed(binary)),
                None => None,
                Some(uri) => embedded(uri)?.map(Cow::Owned),
            });
        }
        let stored: usize = buffers.iter().flatten().map(|bytes| bytes.len()).sum();
        let budget = stored.saturating_mul(16).saturating_add(DECOMPRESSED);
        let views = document.buffer_views.iter();
        let compressed = views.filter_map(|view| view.extensions.meshopt.as_ref());
        let compressed = compressed.fold(0, |sum: usize, view| sum.saturating_add(view.size()));
        Ok(Data {
            document,
            decompressed: document
                .buffer_views
                .iter()
                .map(|_| OnceCell::new())
                .collect(),
            budget: Cell::new(budget),
            total: stored.saturating_add(compressed.min(budget)),
            buffers,
        })
    }

    fn accessor(&self, number: usize) -> Result<&'a Accessor> {
        let accessors = &self.document.accessors;
        let accessor = accessors.get(number);
        accessor.ok_or_else(|| missing("accessor", number, accessors.len()))
    }

    /// Number of elements that an accessor declares. It may be anything.
    pub(super) fn declared_count(&self, number: usize) -> Result<usize> {
        Ok(self.accessor(number)?.count)
    }

    /// What a stored number of an accessor is multiplied by.
    pub(super) fn scale(&self, number: usize) -> Result<f32> {
        let accessor = self.accessor(number)?;
        let component = Component::of(accessor.component_type)?;
        Ok(if accessor.normalized {
            1.0 / component.most()
        } else {
            1.0
        })
    }

    /// Number of elements of an accessor. Refuses more elements than the buffers have bytes.
    pub(super) fn count(&self, number: usize) -> Result<usize> {
        let count = self.accessor(number)?.count;
        if count <= self.total {
            Ok(count)
        } else {
            Err(refusal(format!(
                "expected data of {count} elements, got {} bytes",
                self.total
            )))
        }
    }

    /// Reads positions of floats, or of integers where the file declares quantised positions.
    pub(super) fn positions(&self, number: usize) -> Result<Vec<[f32; 3]>> {
        let accessor = self.accessor(number)?;
        let component = Component::of(accessor.component_type)?;
        let quantised = self
            .document
            .extensions_used
            .iter()
            .chain(&self.document.extensions_required)
            .any(|name| name == "KHR_mesh_quantization");
        let is_read = match component {
            Component::F32 => true,
            Component::U32 => false,
            _ => quantised,
        };
        if accessor.kind != "VEC3" || !is_read {
            return Err(refusal(format!(
                "expected positions of VEC3 and floats, or 8 or 16 bits under KHR_mesh_quantization, got {} \
                 and {component:?}",
                accessor.kind
            )));
        }
        let size = component.size();
        let element = |bytes: &[u8]| -> [f32; 3] {
            std::array::from_fn(|i| component.number(&bytes[i * size..], accessor.normalized))
        };
        self.elements(number, 3 * size, [0.0; 3], element)
    }

    /// Reads single numbers of any kind, such as the weights of targets over time.
    pub(super) fn scalars(&self, number: usize) -> Result<Vec<f32>> {
        let accessor = self.accessor(number)?;
        let component = Component::of(accessor.component_type)?;
        if accessor.kind != "SCALAR" {
            return Err(refusal(format!(
                "expected numbers of SCALAR, got {}",
                accessor.kind
            )));
        }
        let element = |bytes: &[u8]| component.number(bytes, accessor.normalized);
        self.elements(number, component.size(), 0.0, element)
    }

    /// Reads matrices of four columns.
    pub(super) fn matrices(&self, number: usize) -> Result<Vec<[[f32; 4]; 4]>> {
        let accessor = self.accessor(number)?;
        if (accessor.kind.as_str(), accessor.component_type) != ("MAT4", FLOATS) {
            return Err(refusal(format!(
                "expected inverse bind matrices of MAT4 and floats, got {} and component type {}",
                accessor.kind, accessor.component_type
            )));
        }
        let number_at = |bytes: &[u8], i: usize| Component::F32.number(&bytes[4 * i..], false);
        let element = |bytes: &[u8]| -> [[f32; 4]; 4] {
            std::array::from_fn(|c| std::array::from_fn(|r| number_at(bytes, 4 * c + r)))
        };
        self.elements(number, 64, [[0.0; 4]; 4], element)
    }

    /// Reads four numbers for each vertex: joints, or weights of joints.
    pub(super) fn fours(&self, number: usize) -> Result<Vec<[f32; 4]>> {
        let accessor = self.accessor(number)?;
        let component = Component::of(accessor.component_type)?;
        if accessor.kind != "VEC4" {
            return Err(refusal(format!(
                "expected joints and weights of VEC4, got {}",
                accessor.kind
            )));
        }
        let size = component.size();
        let element = |bytes: &[u8]| -> [f32; 4] {
            std::array::from_fn(|i| component.number(&bytes[i * size..], accessor.normalized))
        };
        self.elements(number, 4 * size, [0.0; 4], element)
    }

    /// Reads vertex numbers of 8, 16 or 32 bits.
    pub(super) fn indices(&self, number: usize) -> Result<Vec<u32>> {
        let accessor = self.accessor(number)?;
        let component = Component::of(accessor.component_type)?;
        let is_read = matches!(component, Component::U8 | Component::U16 | Component::U32);
        if accessor.kind != "SCALAR" || !is_read {
            return Err(refusal(format!(
                "expected vertex numbers of SCALAR and U8, U16 or U32, got {} and {component:?}",
                accessor.kind
            )));
        }
        self.elements(number, component.size(), 0, |bytes| component.index(bytes))
    }

    /// Reads all elements of an accessor, each of `size` bytes. A sparse accessor without a view
    /// has `zero` wherever it stores nothing.
    fn elements<T: Copy>(
        &self,
        number: usize,
        size: usize,
        zero: T,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>> {
        let accessor = self.accessor(number)?;
        let count = self.count(number)?;
        let mut out: Vec<T> = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), _) => {
                let stored = self.range(view, accessor.byte_offset, count, size)?;
                (0..count).map(|i| decode(stored.at(i))).collect()
            }
            (None, Some(_)) => vec![zero; count],
            (None, None) => {
                return Err(refusal("expected data in the file itself, got none".into()));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let of = |part: &SparsePart, size: usize| {
                self.range(part.buffer_view, part.byte_offset, sparse.count, size)
            };
            let component = Component::of(sparse.indices.component_type.unwrap_or_default())?;
            let places = of(&sparse.indices, component.size())?;
            let values = of(&sparse.values, size)?;
            for i in 0..sparse.count {
                let place = component.index(places.at(i)) as usize;
                let Some(slot) = out.get_mut(place) else {
                    return Err(refusal(format!(
                        "expected sparse places below {count}, got {place}"
                    )));
                };
                *slot = decode(values.at(i));
            }
        }
        Ok(out)
    }

    /// The range of `count` elements of `size` bytes in a view, if the view has all of them.
    fn range(&self, view: usize, offset: usize, count: usize, size: usize) -> Result<Elements<'_>> {
        let (bytes, stride) = self.view(view)?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(refusal(format!(
                "expected elements of {size} bytes or more, got {stride}"
            )));
        }
        let last = count.saturating_sub(1).saturating_mul(stride);
        let length = if count == 0 {
            0
        } else {
            last.saturating_add(size)
        };
        let range = offset
            .checked_add(length)
            .and_then(|end| bytes.get(offset..end));
        match range {
            Some(bytes) => Ok(Elements {
                bytes,
                stride,
                size,
            }),
            None => Err(refusal(format!(
                "expected {count} elements of {size} bytes within a view, got {} bytes of data",
                bytes.len()
            ))),
        }
    }

    /// The bytes of a view, decompressed if need be, and their stride.
    pub(super) fn view(&self, number: usize) -> Result<(&[u8], Option<usize>)> {
        let views = &self.document.buffer_views;
        let view = views.get(number);
        let view = view.ok_or_else(|| missing("buffer view", number, views.len()))?;
        let Some(compression) = &view.extensions.meshopt else {
            let bytes = self.bytes(view.buffer, view.byte_offset, view.byte_length)?;
            return Ok((bytes, view.byte_stride));
        };
        let place = &self.decompressed[number];
        if place.get().is_none() {
            let left = self.budget.get().checked_sub(compression.size());
            let left = left.ok_or_else(|| {
                refusal(
                    "expected a few hundred MB of data at most, got more in compressed views"
                        .into(),
                )
            })?;
            self.budget.set(left);
            let Compression {
                buffer,
                byte_offset,
                byte_length,
                ..
            } = *compression;
            let stream = self.bytes(buffer, byte_offset, byte_length)?;
            let bytes = compression.decode(stream).ok_or_else(|| {
                refusal(format!(
                    "the compressed data of view {number} is damaged, or of a kind that is not for places \
                     (EXT_meshopt_compression); write the file anew, or without compression by `npx \
                     @gltf-transform/cli copy in.glb out.glb`"
                ))
            })?;
            let _ = place.set(bytes);
        }
        let bytes = place.get().map_or(&[][..], Vec::as_slice);
        Ok((bytes, Some(compression.byte_stride)))
    }

    /// A range of a buffer.
    fn bytes(&self, buffer: usize, offset: usize, length: usize) -> Result<&[u8]> {
        let bytes = match self.buffers.get(buffer) {
            Some(Some(bytes)) => bytes,
            Some(None) => return Err(elsewhere(self.document, buffer)),
            None => return Err(missing("buffer", buffer, self.buffers.len())),
        };
        let range = offset
            .checked_add(length)
            .and_then(|end| bytes.get(offset..end));
        range.ok_or_else(|| {
            refusal(format!(
                "expected a view of {length} bytes from {offset} on, got {} bytes of data",
                bytes.len()
            ))
        })
    }
}

fn elsewhere(document: &Document, buffer: usize) -> Error {
    match document.buffers[buffer].uri.as_deref() {
        Some(uri) => {
            let name: String = uri.chars().take(60).collect();
            refusal(format!(
                "expected all data in the file itself, got some in {name}; pack it into one .glb"
            ))
        }
        None => refusal("expected data in the file itself, got none".into()),
    }
}

/// Decodes a `data:` URI in base64, in either alphabet. `None` if the URI names another file.
pub(super) fn embedded(uri: &str) -> Result<Option<Vec<u8>>> {
    let Some(rest) = uri.strip_prefix("data:") else {
        return Ok(None);
    };
    let text = rest.split_once(";base64,").map(|(_, text)| text);
    let bytes = text.and_then(|text| BASE64.decode(text.replace('-', "+").replace('_', "/")).ok());
    match bytes {
        Some(bytes) => Ok(Some(bytes)),
        None => Err(refusal("expected a data URI in base64, got another".into())),
    }
}

/// Accepts base64 with or without padding, because files have both.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);
