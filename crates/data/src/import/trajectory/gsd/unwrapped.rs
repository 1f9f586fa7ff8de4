//! Particles that are followed through the faces of a periodic cell.

use super::super::cell::Cell;
use crate::import::typed_columns::TypedColumns;
use crate::import::{Description, FieldKind, ImportError, Source};
use std::ops::Range;

/// A source whose places are those of the image that each particle is in.
pub(super) struct Unwrapped {
    /// The last field of each family is the image, in cells along each edge.
    inner: TypedColumns,
    /// Without these fields.
    description: Description,
    cell: Cell,
}

impl Unwrapped {
    /// Follows particles whose images are the last field of each family.
    pub(super) fn new(inner: TypedColumns, cell: Cell) -> Unwrapped {
        let mut description = inner.description().clone();
        description.families.iter_mut().for_each(|family| drop(family.fields.pop()));
        Unwrapped { inner, description, cell }
    }
}

impl Source for Unwrapped {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let kind = self.description.check_range(family, field, &range, out.len())?.kind;
        self.inner.read(family, field, range.clone(), out)?;
        if kind == FieldKind::Position {
            let mut images = vec![0.0; out.len()];
            self.inner.read(family, self.description.families[family].fields.len(), range, &mut images)?;
            let images = images.as_chunks::<3>().0;
            for (place, image) in out.as_chunks_mut::<3>().0.iter_mut().zip(images) {
                *place = self.cell.image(*place, *image);
            }
        }
        Ok(())
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        self.inner.read_ids(family, field, range, out)
    }
}
