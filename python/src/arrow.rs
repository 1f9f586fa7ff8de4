//! Tables for other programs by the Arrow C stream interface (<https://arrow.apache.org/docs/format/CStreamInterface.html>), whose structures and
//! rules these are. A stream has one batch; its numbers stay where NumPy has them, and each structure that is handed out owns what it points to until
//! its consumer calls `release`.
#![allow(unsafe_code, reason = "the interface is structures of pointers that other programs read and release")]

use crate::error::told;
use numpy::{Element, PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};
use std::sync::Arc;

/// A type of columns, or of a table.
#[repr(C)]
struct ArrowSchema {
    format: *const c_char,
    name: *const c_char,
    metadata: *const c_char,
    flags: i64,
    n_children: i64,
    children: *mut *mut ArrowSchema,
    dictionary: *mut ArrowSchema,
    release: Option<unsafe extern "C" fn(*mut ArrowSchema)>,
    private_data: *mut c_void,
}

/// Values of a column, or the columns of a table.
#[repr(C)]
struct ArrowArray {
    length: i64,
    null_count: i64,
    offset: i64,
    n_buffers: i64,
    n_children: i64,
    buffers: *mut *const c_void,
    children: *mut *mut ArrowArray,
    dictionary: *mut ArrowArray,
    release: Option<unsafe extern "C" fn(*mut ArrowArray)>,
    private_data: *mut c_void,
}

/// Batches, one after the other.
#[repr(C)]
struct ArrowArrayStream {
    get_schema: Option<unsafe extern "C" fn(*mut ArrowArrayStream, *mut ArrowSchema) -> c_int>,
    get_next: Option<unsafe extern "C" fn(*mut ArrowArrayStream, *mut ArrowArray) -> c_int>,
    get_last_error: Option<unsafe extern "C" fn(*mut ArrowArrayStream) -> *const c_char>,
    release: Option<unsafe extern "C" fn(*mut ArrowArrayStream)>,
    private_data: *mut c_void,
}

// SAFETY: a stream owns its `Stream`, which owns columns that nobody writes to: an array of NumPy is kept by a reference that any thread may hold and
// give up, and read by its address alone.
unsafe impl Send for ArrowArrayStream {}

/// Where the values of a column are.
enum Values {
    /// Numbers in an array of NumPy, which is kept.
    Numbers { data: *const c_void, _kept: Py<PyAny> },
    /// Texts one after the other, and where each begins.
    Texts { offsets: Vec<i64>, bytes: Vec<u8> },
}

/// A column of a table.
struct Column {
    name: CString,
    /// Its type in the interface's letters.
    format: &'static CStr,
    unit: String,
    length: usize,
    values: Values,
}

impl Column {
    fn of(name: &str, unit: String, values: &Bound<'_, PyAny>) -> PyResult<Column> {
        let wrong = |what: &str| told(format!("{name}: {what}").into());
        let c_name = CString::new(name).map_err(|_| wrong("found a name with a zero byte, expected none"))?;
        let column = |format, (length, values)| Column { name: c_name, format, unit, length, values };
        if let Some(found) = numbers::<f64>(values) {
            return Ok(column(c"g", found));
        }
        if let Some(found) = numbers::<f32>(values) {
            return Ok(column(c"f", found));
        }
        if let Some(found) = numbers::<i64>(values) {
            return Ok(column(c"l", found));
        }
        if let Some(found) = numbers::<u64>(values) {
            return Ok(column(c"L", found));
        }
        if let Ok(listed) = values.extract::<Vec<String>>()
            && let Some(found) = texts(listed.iter().map(|text| Some(text.as_str())))
        {
            return Ok(column(c"U", found));
        }
        let expected = "expected a contiguous array of float32, float64, int64 or uint64, texts, or uint16 with names";
        let (codes, names) =
            values.extract::<(Bound<'_, PyArray1<u16>>, Vec<String>)>().map_err(|_| wrong(expected))?;
        let codes = codes.try_readonly().map_err(|error| wrong(&error.to_string()))?;
        let found = texts(codes.as_array().iter().map(|code| names.get(usize::from(*code)).map(String::as_str)));
        Ok(column(c"U", found.ok_or_else(|| wrong("found a number without a name"))?))
    }

    /// What its array's buffers are: which values there are (all of them), and the values.
    fn buffers(&self) -> Vec<*const c_void> {
        match &self.values {
            Values::Numbers { data, .. } => vec![null(), *data],
            Values::Texts { offsets, bytes } => vec![null(), offsets.as_ptr().cast(), bytes.as_ptr().cast()],
        }
    }

    fn schema(&self) -> ArrowSchema {
        let metadata = (!self.unit.is_empty()).then(|| metadata(&[("unit", self.unit.as_str())]));
        schema(self.format, self.name.clone(), metadata, Vec::new())
    }
}

/// How many texts there are, and all of them; `None` where one is missing.
fn texts<'a>(texts: impl Iterator<Item = Option<&'a str>>) -> Option<(usize, Values)> {
    let (mut offsets, mut bytes) = (vec![0], Vec::new());
    for text in texts {
        bytes.extend_from_slice(text?.as_bytes());
        offsets.push(bytes.len() as i64);
    }
    Some((offsets.len() - 1, Values::Texts { offsets, bytes }))
}

/// An array's length and values, where it is one of such numbers in the order of memory.
fn numbers<T: Element>(values: &Bound<'_, PyAny>) -> Option<(usize, Values)> {
    let array = values.cast::<PyArray1<T>>().ok()?;
    let found = || Values::Numbers { data: array.data().cast_const().cast(), _kept: values.clone().unbind() };
    array.is_c_contiguous().then(|| (array.len(), found()))
}

/// Names and values as the interface has them: their number, and of each text its length and bytes.
fn metadata(pairs: &[(&str, &str)]) -> Vec<u8> {
    let mut bytes = (pairs.len() as i32).to_ne_bytes().to_vec();
    for text in pairs.iter().flat_map(|(name, value)| [name, value]) {
        bytes.extend_from_slice(&(text.len() as i32).to_ne_bytes());
        bytes.extend_from_slice(text.as_bytes());
    }
    bytes
}

/// What a schema points to.
struct Schema {
    name: CString,
    metadata: Option<Vec<u8>>,
    children: Vec<*mut ArrowSchema>,
}

fn schema(format: &'static CStr, name: CString, metadata: Option<Vec<u8>>, children: Vec<ArrowSchema>) -> ArrowSchema {
    let children = children.into_iter().map(|child| Box::into_raw(Box::new(child))).collect();
    let mut own = Box::new(Schema { name, metadata, children });
    ArrowSchema {
        format: format.as_ptr(),
        name: own.name.as_ptr(),
        metadata: own.metadata.as_ref().map_or(null(), |bytes| bytes.as_ptr().cast()),
        flags: 0,
        n_children: own.children.len() as i64,
        children: own.children.as_mut_ptr(),
        dictionary: null_mut(),
        release: Some(release_schema),
        private_data: Box::into_raw(own).cast(),
    }
}

/// Gives up a schema that [`schema`] made.
unsafe extern "C" fn release_schema(given: *mut ArrowSchema) {
    // SAFETY: by the interface's rules a consumer calls this once with a schema of this `release`, so that its private data are a `Schema` that
    // was made a raw pointer, and each of its children a box. A child that the consumer has moved away has no `release` any more.
    unsafe {
        let own = Box::from_raw((*given).private_data.cast::<Schema>());
        for child in own.children {
            let mut child = Box::from_raw(child);
            if let Some(release) = child.release {
                release(&raw mut *child);
            }
        }
        (*given).release = None;
    }
}

/// What an array points to.
struct Array {
    buffers: Vec<*const c_void>,
    children: Vec<*mut ArrowArray>,
    /// Where the buffers are.
    _columns: Arc<[Column]>,
}

fn array(length: usize, buffers: Vec<*const c_void>, children: Vec<ArrowArray>, columns: &Arc<[Column]>) -> ArrowArray {
    let children = children.into_iter().map(|child| Box::into_raw(Box::new(child))).collect();
    let mut own = Box::new(Array { buffers, children, _columns: Arc::clone(columns) });
    ArrowArray {
        length: length as i64,
        null_count: 0,
        offset: 0,
        n_buffers: own.buffers.len() as i64,
        n_children: own.children.len() as i64,
        buffers: own.buffers.as_mut_ptr(),
        children: own.children.as_mut_ptr(),
        dictionary: null_mut(),
        release: Some(release_array),
        private_data: Box::into_raw(own).cast(),
    }
}

/// Gives up an array that [`array`] made.
unsafe extern "C" fn release_array(given: *mut ArrowArray) {
    // SAFETY: as of `release_schema`, with an `Array`.
    unsafe {
        let own = Box::from_raw((*given).private_data.cast::<Array>());
        for child in own.children {
            let mut child = Box::from_raw(child);
            if let Some(release) = child.release {
                release(&raw mut *child);
            }
        }
        (*given).release = None;
    }
}

/// What a stream points to.
struct Stream {
    columns: Arc<[Column]>,
    rows: usize,
    is_done: bool,
}

unsafe extern "C" fn get_schema(stream: *mut ArrowArrayStream, out: *mut ArrowSchema) -> c_int {
    // SAFETY: a consumer calls this with a stream that is not released, whose private data are a `Stream`.
    let own = unsafe { &*(*stream).private_data.cast::<Stream>() };
    let columns = own.columns.iter().map(Column::schema).collect();
    // SAFETY: it gives room for a schema, in which nothing is yet.
    unsafe { out.write(schema(c"+s", CString::default(), None, columns)) };
    0
}

unsafe extern "C" fn get_next(stream: *mut ArrowArrayStream, out: *mut ArrowArray) -> c_int {
    // SAFETY: a consumer calls this with a stream that is not released, and one call at a time.
    let own = unsafe { &mut *(*stream).private_data.cast::<Stream>() };
    let next = match std::mem::replace(&mut own.is_done, true) {
        false => {
            let of = |column: &Column| array(column.length, column.buffers(), Vec::new(), &own.columns);
            array(own.rows, vec![null()], own.columns.iter().map(of).collect(), &own.columns)
        }
        // An array without `release` says that there are no more.
        true => ArrowArray {
            length: 0,
            null_count: 0,
            offset: 0,
            n_buffers: 0,
            n_children: 0,
            buffers: null_mut(),
            children: null_mut(),
            dictionary: null_mut(),
            release: None,
            private_data: null_mut(),
        },
    };
    // SAFETY: it gives room for an array, in which nothing is yet.
    unsafe { out.write(next) };
    0
}

unsafe extern "C" fn get_last_error(_: *mut ArrowArrayStream) -> *const c_char {
    // Nothing fails.
    null()
}

/// Gives up a stream.
unsafe extern "C" fn release_stream(given: *mut ArrowArrayStream) {
    // SAFETY: by the interface's rules a consumer, or the capsule that nobody consumed, calls this once, and the private data are a `Stream` that was
    // made a raw pointer.
    unsafe {
        drop(Box::from_raw((*given).private_data.cast::<Stream>()));
        (*given).release = None;
    }
}

/// Columns of one length with their names and units as a capsule of `__arrow_c_stream__`: arrays of 32-bit and 64-bit floats and of 64-bit whole
/// numbers, lists of texts, and numbers of 16 bits with the names that they stand for. Arrays are kept and not copied.
///
/// # Errors
/// Where a column is of something else, or of another length.
#[pyfunction]
pub fn arrow_stream<'py>(
    py: Python<'py>,
    columns: Vec<(String, String, Bound<'py, PyAny>)>,
) -> PyResult<Bound<'py, PyCapsule>> {
    let columns = columns.into_iter().map(|(name, unit, values)| Column::of(&name, unit, &values));
    let columns: Arc<[Column]> = columns.collect::<PyResult<Vec<_>>>()?.into();
    let rows = columns.first().map_or(0, |column| column.length);
    if let Some(other) = columns.iter().find(|column| column.length != rows) {
        let (name, found) = (other.name.to_string_lossy(), other.length);
        return Err(told(format!("{name}: found {found} rows, expected {rows} as other columns have").into()));
    }
    let stream = ArrowArrayStream {
        get_schema: Some(get_schema),
        get_next: Some(get_next),
        get_last_error: Some(get_last_error),
        release: Some(release_stream),
        private_data: Box::into_raw(Box::new(Stream { columns, rows, is_done: false })).cast(),
    };
    PyCapsule::new_with_value_and_destructor(py, stream, c"arrow_array_stream", |mut stream, _| {
        if let Some(release) = stream.release {
            // SAFETY: nobody has consumed the stream, as its `release` is still there.
            unsafe { release(&raw mut stream) };
        }
    })
}
