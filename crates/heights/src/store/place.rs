//! Where a chunk or a tile is in a file.

use deepfield_data::store::PageId;
use deepfield_data::store::error::Damage;
use deepfield_data::store::wire::{Decoder, Encoder};

/// The page of what is in none.
pub const NO_PAGE: u32 = u32::MAX;

/// A place in a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The page.
    pub page: u32,
    /// First byte in the page.
    pub offset: u32,
    /// Number of bytes.
    pub len: u32,
}

impl Default for Place {
    fn default() -> Place {
        Place { page: NO_PAGE, offset: 0, len: 0 }
    }
}

impl Place {
    /// Appends it.
    pub fn encode(&self, out: &mut Encoder) {
        [self.page, self.offset, self.len].into_iter().for_each(|word| out.u32(word));
    }

    /// Reads one, of what messages call `field`.
    ///
    /// # Errors
    /// Where there is no room for it.
    pub fn decode(input: &mut Decoder<'_>, field: &str) -> Result<Place, Damage> {
        Ok(Place { page: input.u32(field)?, offset: input.u32(field)?, len: input.u32(field)? })
    }

    /// Whether it is in a page.
    pub fn is_written(&self) -> bool {
        self.page != NO_PAGE
    }

    /// Its page.
    pub fn id(&self) -> PageId {
        PageId(self.page)
    }

    /// Its bytes, of those of its page.
    pub fn of<'p>(&self, page: &'p [u8]) -> Option<&'p [u8]> {
        page.get(self.offset as usize..)?.get(..self.len as usize)
    }

    /// Whether another place comes after it.
    pub fn is_before(&self, other: &Place) -> bool {
        (self.page, self.offset) < (other.page, other.offset)
    }
}
