//! Accessors: typed views of buffers, checked before anything is allocated.

use std::borrow::Cow;
use std::cell::Cell;

use super::check::{clip, invalid, within};
use super::document::{Document, item};
use super::source::range;
use crate::{SceneError, SceneLimits};

/// Reads accessors of one file within a budget of decoded elements, so that a small file cannot make the loader decode
/// the same data for ever.
pub(crate) struct Reader<'a> {
    pub(crate) document: &'a Document,
    buffers: &'a [Cow<'a, [u8]>],
    elements_left: Cell<u64>,
    element_limit: u64,
    count_limit: u64,
}

/// Component types by their GL numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_gl(code: u32, field: &str) -> Result<Self, SceneError> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(invalid(field, format!("{code} is not a component type"))),
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The component at the start of `bytes`, which holds at least [`Component::bytes`] bytes.
    fn read(self, bytes: &[u8], is_normalized: bool) -> f32 {
        let two = || [bytes[0], bytes[1]];
        let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        let (value, scale) = match self {
            Self::I8 => (f32::from(bytes[0] as i8), 127.0),
            Self::U8 => (f32::from(bytes[0]), 255.0),
            Self::I16 => (f32::from(i16::from_le_bytes(two())), 32767.0),
            Self::U16 => (f32::from(u16::from_le_bytes(two())), 65535.0),
            Self::U32 => (u32::from_le_bytes(four()) as f32, 4_294_967_295.0),
            Self::F32 => return f32::from_le_bytes(four()),
        };
        if is_normalized { (value / scale).max(-1.0) } else { value }
    }

    /// The component as an unsigned integer; `None` for signed and float types.
    fn read_unsigned(self, bytes: &[u8]) -> Option<u32> {
        match self {
            Self::U8 => Some(u32::from(bytes[0])),
            Self::U16 => Some(u32::from(u16::from_le_bytes([bytes[0], bytes[1]]))),
            Self::U32 => Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Self::I8 | Self::I16 | Self::F32 => None,
        }
    }
}

/// Elements in a buffer with their stride: `count` elements of `element_bytes`, proven to lie inside `bytes`.
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    element_bytes: usize,
}

impl<'a> Strided<'a> {
    fn element(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..][..self.element_bytes]
    }
}

/// Offset of component `k` inside an element: matrices of 1- and 2-byte components pad each column to 4 bytes.
fn component_offset(shape: &str, component: Component, k: usize) -> usize {
    let rows = match shape {
        "MAT2" => 2,
        "MAT3" => 3,
        "MAT4" => 4,
        _ => return k * component.bytes(),
    };
    let column_bytes = (rows * component.bytes()).div_ceil(4) * 4;
    (k / rows) * column_bytes + (k % rows) * component.bytes()
}

fn component_count(shape: &str) -> Option<usize> {
    Some(match shape {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return None,
    })
}

impl<'a> Reader<'a> {
    /// A reader over loaded buffers.
    pub(crate) fn new(document: &'a Document, buffers: &'a [Cow<'a, [u8]>], limits: &SceneLimits) -> Self {
        let count_limit = u64::from(limits.max_vertices).max(3 * u64::from(limits.max_triangles));
        let element_limit = 32 * count_limit + 65_536;
        Self { document, buffers, elements_left: Cell::new(element_limit), element_limit, count_limit }
    }

    /// Number of elements, before reading any.
    pub(crate) fn count(&self, index: usize, asked_by: &str) -> Result<u64, SceneError> {
        Ok(item(&self.document.accessors, index, "accessors", asked_by)?.count)
    }

    /// The bytes of a buffer view.
    pub(crate) fn view(&self, index: usize, asked_by: &str) -> Result<&'a [u8], SceneError> {
        let view = item(&self.document.buffer_views, index, "bufferViews", asked_by)?;
        let field = format!("bufferViews[{index}]");
        let buffer = item(self.buffers, view.buffer, "buffers", &field)?;
        range(buffer, view.byte_offset, view.byte_length).ok_or_else(|| {
            let (offset, length) = (view.byte_offset, view.byte_length);
            invalid(field, format!("bytes {offset} + {length} run past the buffer of {} bytes", buffer.len()))
        })
    }

    /// Vectors of `N` floats; integers are converted (normalised where the accessor says so). Every value is finite.
    pub(crate) fn floats<const N: usize>(&self, index: usize, asked_by: &str) -> Result<Vec<[f32; N]>, SceneError> {
        let (component, is_normalized) = self.component(index, N, asked_by)?;
        let shape = self.document.accessors[index].shape.as_str();
        let read = |bytes: &[u8]| {
            std::array::from_fn(|k| component.read(&bytes[component_offset(shape, component, k)..], is_normalized))
        };
        let values = self.read_all(index, component, [0.0; N], read)?;
        match values.iter().position(|value| value.iter().any(|x| !x.is_finite())) {
            Some(at) => Err(invalid(format!("accessors[{index}]"), format!("element {at} is not a finite number"))),
            None => Ok(values),
        }
    }

    /// Colours: three or four components; alpha is 1 where there is none.
    pub(crate) fn colors(&self, index: usize, asked_by: &str) -> Result<Vec<[f32; 4]>, SceneError> {
        if item(&self.document.accessors, index, "accessors", asked_by)?.shape == "VEC3" {
            let rgb = self.floats::<3>(index, asked_by)?;
            return Ok(rgb.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect());
        }
        self.floats::<4>(index, asked_by)
    }

    /// Vectors of `N` unsigned integers (indices, joints).
    pub(crate) fn unsigned<const N: usize>(&self, index: usize, asked_by: &str) -> Result<Vec<[u32; N]>, SceneError> {
        let (component, _) = self.component(index, N, asked_by)?;
        if component.read_unsigned(&[0; 4]).is_none() {
            return Err(invalid(format!("accessors[{index}].componentType"), "must be an unsigned integer type"));
        }
        let read = |bytes: &[u8]| {
            std::array::from_fn(|k| component.read_unsigned(&bytes[k * component.bytes()..]).unwrap_or_default())
        };
        self.read_all(index, component, [0; N], read)
    }

    fn component(&self, index: usize, components: usize, asked_by: &str) -> Result<(Component, bool), SceneError> {
        let accessor = item(&self.document.accessors, index, "accessors", asked_by)?;
        let field = format!("accessors[{index}]");
        match component_count(&accessor.shape) {
            Some(count) if count == components => {}
            _ => {
                let shape = clip(&accessor.shape);
                return Err(invalid(
                    format!("{field}.type"),
                    format!("is {shape:?}, but {asked_by} needs {components} components"),
                ));
            }
        }
        let component = Component::from_gl(accessor.component_type, &format!("{field}.componentType"))?;
        Ok((component, accessor.normalized && component != Component::F32))
    }

    fn read_all<T: Copy>(
        &self,
        index: usize,
        component: Component,
        zero: T,
        read: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, SceneError> {
        let field = format!("accessors[{index}]");
        let accessor = &self.document.accessors[index];
        let count = self.spend(accessor.count, &field)?;
        let components = component_count(&accessor.shape).unwrap_or(1);
        let element_bytes = component_offset(&accessor.shape, component, components - 1) + component.bytes();
        let strided = |view: Option<usize>, offset, count, element_bytes, field: &str| {
            view.map(|view| self.strided(view, offset, count, element_bytes, field)).transpose()
        };
        let base = strided(accessor.buffer_view, accessor.byte_offset, count, element_bytes, &field)?;
        let mut values: Vec<T> = match &base {
            Some(base) => (0..count).map(|i| read(base.element(i))).collect(),
            None => vec![zero; count],
        };
        if let Some(sparse) = &accessor.sparse {
            let field = format!("{field}.sparse");
            let sparse_count = self.spend(sparse.count, &field)?;
            let kind = Component::from_gl(sparse.indices.component_type, &format!("{field}.indices.componentType"))?;
            let (view, offset) = (sparse.indices.buffer_view, sparse.indices.byte_offset);
            let indices = self.strided(view, offset, sparse_count, kind.bytes(), &format!("{field}.indices"))?;
            let (view, offset) = (sparse.values.buffer_view, sparse.values.byte_offset);
            let replaced = self.strided(view, offset, sparse_count, element_bytes, &format!("{field}.values"))?;
            for i in 0..sparse_count {
                let target = kind.read_unsigned(indices.element(i)).ok_or_else(|| {
                    invalid(format!("{field}.indices.componentType"), "must be an unsigned integer type")
                })?;
                let slot = values.get_mut(target as usize).ok_or_else(|| {
                    invalid(format!("{field}.indices"), format!("element {i} is {target}, but there are {count}"))
                })?;
                *slot = read(replaced.element(i));
            }
        }
        Ok(values)
    }

    /// Takes `count` elements off the budget.
    fn spend(&self, count: u64, field: &str) -> Result<usize, SceneError> {
        within(&format!("{field}.count"), count, self.count_limit)?;
        let left = self.elements_left.get();
        if count > left {
            let used = self.element_limit - left;
            return Err(SceneError::TooLarge {
                field: format!("elements decoded from accessors (at {field}.count)"),
                value: used.saturating_add(count),
                limit: self.element_limit,
            });
        }
        self.elements_left.set(left - count);
        usize::try_from(count).map_err(|_| invalid(field, "count is too large"))
    }

    fn strided(
        &self,
        view: usize,
        offset: u64,
        count: usize,
        element_bytes: usize,
        field: &str,
    ) -> Result<Strided<'a>, SceneError> {
        let bytes = self.view(view, field)?;
        let stride = match self.document.buffer_views[view].byte_stride {
            Some(stride) if stride < element_bytes as u64 || stride > 252 => {
                let problem = format!("is {stride}; elements have {element_bytes} bytes and 252 is the most");
                return Err(invalid(format!("bufferViews[{view}].byteStride"), problem));
            }
            Some(stride) => stride as usize,
            None => element_bytes,
        };
        let needed = match count {
            0 => Some(0),
            _ => stride.checked_mul(count - 1).and_then(|bytes| bytes.checked_add(element_bytes)),
        };
        let slice = needed.and_then(|needed| range(bytes, offset, needed as u64));
        let bytes = slice.ok_or_else(|| {
            let problem = format!("{count} elements of {stride} bytes from byte {offset} run past bufferViews[{view}]");
            invalid(field, format!("{problem} of {} bytes", bytes.len()))
        })?;
        Ok(Strided { bytes, stride, element_bytes })
    }
}
