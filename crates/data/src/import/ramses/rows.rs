//! Rows of numbers on their way to a family: what RAMSES stores process by process and in no order of families is put in order once.

use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::import::grid::scratch::{Scratch, Storage};
use crate::import::typed_columns::{Column, Component, Meaning};
use crate::model::SampleType;
use std::path::Path;

/// Bytes that are put away together.
const BATCH: usize = 1 << 18;

/// Rows of as many numbers of eight bytes.
pub(super) struct Rows {
    scratch: Scratch,
    batch: Vec<u8>,
    /// How many there are.
    pub count: u64,
}

impl Rows {
    /// None yet, of the output `path`.
    pub(super) fn new(path: &Path) -> Rows {
        Rows { scratch: Scratch::new(path), batch: Vec::new(), count: 0 }
    }

    /// Adds one.
    ///
    /// # Errors
    /// When it cannot be put away.
    pub(super) fn push(&mut self, words: impl IntoIterator<Item = [u8; 8]>) -> Result<(), ImportError> {
        words.into_iter().for_each(|word| self.batch.extend_from_slice(&word));
        self.count += 1;
        if self.batch.len() >= BATCH {
            self.scratch.write(&self.batch)?;
            self.batch.clear();
        }
        Ok(())
    }

    /// What was added, to be read.
    ///
    /// # Errors
    /// When it cannot be put away.
    pub(super) fn into_storage(mut self) -> Result<Storage, ImportError> {
        self.scratch.write(&self.batch)?;
        self.scratch.into_storage()
    }
}

/// Number `slot` of each of the rows of a storage, which have `width` of them, times `factor`.
pub(super) fn component(storage: usize, slot: usize, width: usize, whole: bool, factor: f64) -> Component {
    let column = Column {
        storage,
        offset: 8 * slot as u64,
        stride: 8 * width as u64,
        number: if whole { SampleType::I64 } else { SampleType::F64 },
        order: Order::NATIVE,
    };
    match factor {
        1.0 => Component::plain(column),
        factor => Component::Stored(column, Meaning::Linear { factor, first: 0.0 }),
    }
}
