//! Samples that lie in a file, or in memory, as they are: windows of them are read in place.

use super::content::Content;
use super::source::Samples;
use crate::model::Window;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{ReadFile, SampleType};
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;

/// Where samples lie: that of row `r` and column `c` at byte `offset + r row_stride + c column_stride`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// The first byte.
    pub offset: u64,
    /// How a sample is stored.
    pub sample_type: SampleType,
    /// The order of its bytes.
    pub order: ByteOrder,
    /// Samples of a row.
    pub columns: u64,
    /// Rows.
    pub rows: u64,
    /// Bytes from a sample to the next of its row.
    pub column_stride: u64,
    /// Bytes from a row to the next.
    pub row_stride: u64,
    /// Whether the last row comes first in the file.
    pub is_reversed: bool,
}

impl Layout {
    /// Rows one behind the other without gaps, the first one first. `columns x rows` samples are fewer than 2^63 bytes, as
    /// [`dimensions`](super::dimensions::dimensions) says.
    pub(super) fn packed([columns, rows]: [u64; 2], offset: u64, sample_type: SampleType, order: ByteOrder) -> Layout {
        let size = sample_type.size() as u64;
        let row_stride = columns.saturating_mul(size);
        Layout { offset, sample_type, order, columns, rows, column_stride: size, row_stride, is_reversed: false }
    }

    /// Columns one behind the other without gaps.
    pub(super) fn by_columns(size: [u64; 2], offset: u64, sample_type: SampleType, order: ByteOrder) -> Layout {
        let packed = Layout::packed(size, offset, sample_type, order);
        let size = packed.column_stride;
        Layout { column_stride: packed.rows.saturating_mul(size), row_stride: size, ..packed }
    }

    /// Bytes from the first to behind the last sample; `None` where that is more than can be.
    fn bytes(&self) -> Option<u64> {
        let along = |count: u64, stride: u64| count.checked_sub(1)?.checked_mul(stride);
        along(self.rows, self.row_stride)?
            .checked_add(along(self.columns, self.column_stride)?)?
            .checked_add(self.sample_type.size() as u64)
            .filter(|bytes| i64::try_from(*bytes).is_ok() && i64::try_from(self.offset).is_ok())
    }

    /// Where a sample lies.
    fn place(&self, row: u64, column: u64) -> u64 {
        let row = if self.is_reversed { self.rows - 1 - row } else { row };
        self.offset + row * self.row_stride + column * self.column_stride
    }
}

/// Where the bytes are.
enum Storage {
    File(Arc<ReadFile>),
    Memory(Vec<u8>),
}

/// The samples of a layout, and the colour planes of others, in the same file.
pub(super) struct RawSamples {
    path: PathBuf,
    storage: Storage,
    length: u64,
    layout: Layout,
    planes: Vec<Layout>,
}

thread_local! {
    /// Bytes on their way from a file, one buffer a thread.
    static BYTES: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Bytes that are read at once, where a window is larger.
const AT_ONCE: u64 = 1 << 20;

impl RawSamples {
    /// Samples in the file itself; `field` names them in messages.
    ///
    /// # Errors
    /// Where the file holds fewer bytes: how many there are, and how many are asked for.
    pub(super) fn new(content: &Content, field: &str, layout: Layout) -> Result<RawSamples, ImportError> {
        check(content, field, &layout, content.length)?;
        let storage = Storage::File(content.file());
        Ok(RawSamples { path: content.path.clone(), storage, length: content.length, layout, planes: Vec::new() })
    }

    /// Samples in a file that what is in `content` was unpacked to.
    ///
    /// # Errors
    /// As [`RawSamples::new`].
    pub(super) fn unpacked(
        content: &Content,
        field: &str,
        layout: Layout,
        file: ReadFile,
    ) -> Result<RawSamples, ImportError> {
        let length = file.file().metadata().map_err(|source| ImportError::io(&content.path, field, source))?.len();
        check(content, field, &layout, length)?;
        let storage = Storage::File(Arc::new(file));
        Ok(RawSamples { path: content.path.clone(), storage, length, layout, planes: Vec::new() })
    }

    /// Samples in memory.
    ///
    /// # Errors
    /// As [`RawSamples::new`].
    pub(super) fn in_memory(
        content: &Content,
        field: &str,
        layout: Layout,
        bytes: Vec<u8>,
    ) -> Result<RawSamples, ImportError> {
        let length = bytes.len() as u64;
        check(content, field, &layout, length)?;
        Ok(RawSamples {
            path: content.path.clone(),
            storage: Storage::Memory(bytes),
            length,
            layout,
            planes: Vec::new(),
        })
    }

    /// The same with one more colour plane, of 8 bits a sample, in the same file.
    ///
    /// # Errors
    /// As [`RawSamples::new`].
    pub(super) fn with_plane(
        mut self,
        content: &Content,
        field: &str,
        layout: Layout,
    ) -> Result<RawSamples, ImportError> {
        check(content, field, &layout, self.length)?;
        self.planes.push(layout);
        Ok(self)
    }

    fn bytes_at(&self, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        match &self.storage {
            Storage::File(file) => {
                file.read_exact_at(out, offset).map_err(|source| ImportError::io(&self.path, "samples", source))
            }
            Storage::Memory(bytes) => {
                let found = bytes.get(offset as usize..).and_then(|rest| rest.get(..out.len()));
                let short = || {
                    ImportError::malformed(&self.path, "samples", bytes.len(), "as many bytes as when they were read")
                };
                out.copy_from_slice(found.ok_or_else(short)?);
                Ok(())
            }
        }
    }

    /// Reads samples that are `stride` bytes apart, from byte `offset` on, one for each of `out`.
    fn line<T>(
        &self,
        layout: &Layout,
        offset: u64,
        stride: u64,
        out: &mut [T],
        of: impl Fn(f64) -> T + Copy,
    ) -> Result<(), ImportError> {
        let size = layout.sample_type.size();
        let step = usize::try_from(stride).unwrap_or(usize::MAX).max(size);
        // Where samples are far apart, one by one.
        let most = (AT_ONCE / stride.max(1)).max(1) as usize;
        BYTES.with_borrow_mut(|bytes| {
            let mut at = offset;
            for part in out.chunks_mut(most) {
                bytes.resize((part.len() - 1) * step + size, 0);
                self.bytes_at(at, bytes)?;
                decode(layout.sample_type, layout.order, bytes, step, part, of);
                at += part.len() as u64 * stride;
            }
            Ok(())
        })
    }

    /// The samples of a window of a layout.
    fn window<T: Copy>(
        &self,
        layout: &Layout,
        window: Window,
        out: &mut [T],
        of: impl Fn(f64) -> T + Copy,
    ) -> Result<(), ImportError> {
        let size = layout.sample_type.size() as u64;
        let width = (window.columns as usize).max(1);
        if layout.column_stride == size && layout.row_stride == size * window.columns && !layout.is_reversed {
            // Whole rows without gaps are one line.
            return self.line(layout, layout.place(window.row, window.column), size, out, of);
        }
        if layout.row_stride == size && layout.column_stride != size {
            let mut column = vec![of(0.0); window.rows as usize];
            let first = if layout.is_reversed { window.row + window.rows - 1 } else { window.row };
            for number in 0..width {
                self.line(layout, layout.place(first, window.column + number as u64), size, &mut column, of)?;
                if layout.is_reversed {
                    column.reverse();
                }
                for (row, value) in out.chunks_mut(width).zip(&column) {
                    if let Some(out) = row.get_mut(number) {
                        *out = *value;
                    }
                }
            }
            return Ok(());
        }
        for (number, row) in out.chunks_mut(width).enumerate() {
            let offset = layout.place(window.row + number as u64, window.column);
            self.line(layout, offset, layout.column_stride, row, of)?;
        }
        Ok(())
    }
}

impl Samples for RawSamples {
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        self.window(&self.layout, window, out, |value| value)
    }

    fn read_plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), ImportError> {
        let Some(layout) = self.planes.get(plane) else { return Ok(()) };
        self.window(layout, window, out, |value| value as u8)
    }
}

/// Whether `length` bytes hold a layout.
fn check(content: &Content, field: &str, layout: &Layout, length: u64) -> Result<(), ImportError> {
    let Layout { columns, rows, sample_type, .. } = layout;
    let asked = layout.bytes();
    let found = length.saturating_sub(layout.offset);
    if asked.is_some_and(|asked| asked <= found) {
        return Ok(());
    }
    let asked = asked.map_or("more than 2^63".to_owned(), |asked| asked.to_string());
    Err(content.malformed(field, format!("{found} bytes"), format!("{asked} ({columns} x {rows} of {sample_type})")))
}

/// Decodes the samples at every `stride` bytes, one for each of `out`.
pub(super) fn decode<T>(
    sample_type: SampleType,
    order: ByteOrder,
    bytes: &[u8],
    stride: usize,
    out: &mut [T],
    put: impl Fn(f64) -> T,
) {
    /// Those of `N` bytes each.
    fn each<const N: usize, T>(
        bytes: &[u8],
        stride: usize,
        is_swapped: bool,
        out: &mut [T],
        of: impl Fn([u8; N]) -> T,
    ) {
        let turned = |mut sample: [u8; N]| {
            sample.reverse();
            of(sample)
        };
        if stride == N && !is_swapped {
            for (out, sample) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
                *out = of(*sample);
            }
        } else {
            for (out, record) in out.iter_mut().zip(bytes.chunks(stride.max(1))) {
                if let Some(sample) = record.first_chunk() {
                    *out = if is_swapped { turned(*sample) } else { of(*sample) };
                }
            }
        }
    }
    let swapped = order != ByteOrder::Little;
    match sample_type {
        SampleType::I8 => each(bytes, stride, swapped, out, |b| put(i8::from_le_bytes(b).into())),
        SampleType::U8 => each(bytes, stride, swapped, out, |b| put(u8::from_le_bytes(b).into())),
        SampleType::I16 => each(bytes, stride, swapped, out, |b| put(i16::from_le_bytes(b).into())),
        SampleType::U16 => each(bytes, stride, swapped, out, |b| put(u16::from_le_bytes(b).into())),
        SampleType::I32 => each(bytes, stride, swapped, out, |b| put(i32::from_le_bytes(b).into())),
        SampleType::U32 => each(bytes, stride, swapped, out, |b| put(u32::from_le_bytes(b).into())),
        SampleType::I64 => each(bytes, stride, swapped, out, |b| put(i64::from_le_bytes(b) as f64)),
        SampleType::U64 => each(bytes, stride, swapped, out, |b| put(u64::from_le_bytes(b) as f64)),
        SampleType::F32 => each(bytes, stride, swapped, out, |b| put(f32::from_le_bytes(b).into())),
        SampleType::F64 => each(bytes, stride, swapped, out, |b| put(f64::from_le_bytes(b))),
    }
}
