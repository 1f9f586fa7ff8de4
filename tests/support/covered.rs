//! A field with a photo over it, in memory, for tests of several packages: who includes this file has the names of the model and of the build.

use super::{HeightError, HeightField, HeightGrid, Heights, Measured, PhotoAbout, PhotoRows, Window};

/// A photo in memory.
#[derive(Clone)]
pub struct Pixels {
    pub about: PhotoAbout,
    pub values: Vec<u8>,
}

impl PhotoRows for Pixels {
    fn about(&self) -> &PhotoAbout {
        &self.about
    }

    fn memory_bytes(&self) -> u64 {
        0
    }

    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError> {
        let len = self.about.size[1] as usize * self.about.planes();
        out.copy_from_slice(&self.values[first as usize * len..][..count as usize * len]);
        Ok(())
    }
}

/// The field with the photo.
pub struct Covered {
    pub field: HeightField,
    pub photo: Pixels,
}

impl Heights for Covered {
    fn grid(&self) -> &HeightGrid {
        &self.field.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.field.stored(window, out)
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.field.plane(plane, window, out)
    }
}

impl Measured for Covered {
    fn photo_rows(&self) -> Option<Box<dyn PhotoRows + '_>> {
        Some(Box::new(&self.photo))
    }
}
