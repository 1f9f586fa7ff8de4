//! Pages that are unpacked here: of gzip and brotli the library unpacks all that there is before it compares the size with the one that was stated.

use flate2::read::MultiGzDecoder;
use parquet::basic::Compression;
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};
use std::collections::VecDeque;
use std::io::Read;

/// Bytes that brotli takes from a page at a time.
const BUFFER: usize = 1 << 14;

/// Bytes of pages when they are unpacked, as their headers say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Sizes {
    /// Of the dictionary; 0 where there is none.
    pub dictionary: u64,
    /// Of the pages of data, in their order.
    pub data: VecDeque<u64>,
}

/// What pages are packed by that are unpacked here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Gzip,
    Brotli,
}

impl Packing {
    /// `None` for what the library unpacks within bounds.
    pub(super) fn of(packing: Compression) -> Option<Packing> {
        match packing {
            Compression::GZIP(_) => Some(Packing::Gzip),
            Compression::BROTLI(_) => Some(Packing::Brotli),
            _ => None,
        }
    }

    fn reader(self, packed: &[u8]) -> Box<dyn Read + '_> {
        match self {
            Packing::Gzip => Box::new(MultiGzDecoder::new(packed)),
            Packing::Brotli => Box::new(brotli::Decompressor::new(packed, BUFFER)),
        }
    }
}

/// The pages of a reader that leaves them packed.
pub(super) struct Unpacked<R> {
    pages: R,
    packing: Packing,
    /// Of those that are still to come.
    sizes: Sizes,
}

impl<R: PageReader> Unpacked<R> {
    pub(super) fn new(pages: R, packing: Packing, sizes: Sizes) -> Unpacked<R> {
        Unpacked { pages, packing, sizes }
    }

    fn next_size(&mut self) -> u64 {
        self.sizes.data.pop_front().unwrap_or_default()
    }
}

/// The bytes of a page that has `size` of them unpacked, of which the first `levels` are not packed.
fn unpack(packing: Packing, packed: &[u8], levels: usize, size: u64) -> Result<Vec<u8>> {
    let wrong =
        |found: &str| ParquetError::General(format!("a page with {found} than the {size} bytes that it states"));
    let Some((plain, packed)) = packed.split_at_checked(levels) else { return Err(wrong("fewer")) };
    let Some(rest) = size.checked_sub(levels as u64) else { return Err(wrong("more")) };
    let mut bytes = Vec::with_capacity(size as usize);
    bytes.extend_from_slice(plain);
    // A page without a value has nothing behind its levels, not even an empty stream.
    if rest > 0 {
        packing.reader(packed).take(rest + 1).read_to_end(&mut bytes)?;
    }
    match (bytes.len() as u64).cmp(&size) {
        std::cmp::Ordering::Equal => Ok(bytes),
        std::cmp::Ordering::Less => Err(wrong("fewer")),
        std::cmp::Ordering::Greater => Err(wrong("more")),
    }
}

impl<R: PageReader> PageReader for Unpacked<R> {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let Some(mut page) = self.pages.get_next_page()? else { return Ok(None) };
        match &mut page {
            Page::DictionaryPage { buf, .. } => *buf = unpack(self.packing, buf, 0, self.sizes.dictionary)?.into(),
            Page::DataPage { buf, .. } => *buf = unpack(self.packing, buf, 0, self.next_size())?.into(),
            Page::DataPageV2 { buf, def_levels_byte_len, rep_levels_byte_len, is_compressed, .. } => {
                let size = self.next_size();
                if *is_compressed {
                    let levels = *def_levels_byte_len as usize + *rep_levels_byte_len as usize;
                    *buf = unpack(self.packing, buf, levels, size)?.into();
                }
            }
        }
        Ok(Some(page))
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    /// Dictionaries come back no more: they are read, as this reader does not keep them.
    fn skip_next_page(&mut self) -> Result<()> {
        if self.pages.peek_next_page()?.is_some_and(|next| !next.is_dict) {
            self.next_size();
        }
        self.pages.skip_next_page()
    }

    fn at_record_boundary(&mut self) -> Result<bool> {
        self.pages.at_record_boundary()
    }
}

impl<R: PageReader> Iterator for Unpacked<R> {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Result<Page>> {
        self.get_next_page().transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression as Level;
    use flate2::write::GzEncoder;
    use std::io::Write;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Level::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn brotli(bytes: &[u8]) -> Vec<u8> {
        let mut packed = Vec::new();
        brotli::CompressorReader::new(bytes, BUFFER, 1, 20).read_to_end(&mut packed).unwrap();
        packed
    }

    #[test]
    fn a_page_is_unpacked_to_the_size_that_it_states_and_no_further() {
        let levels = [7, 7, 7];
        let values = [[1; 500], [2; 500]].concat();
        let members = [gzip(&values[..500]), gzip(&values[500..])].concat();
        for (packing, packed, pack) in [
            (Packing::Gzip, members, gzip as fn(&[u8]) -> Vec<u8>),
            (Packing::Brotli, brotli(&values), brotli as fn(&[u8]) -> Vec<u8>),
        ] {
            let unpack = |packed: &[u8], levels, size| unpack(packing, packed, levels, size);
            let packed = [&levels[..], &packed].concat();
            assert_eq!(unpack(&packed, 3, 1003).unwrap(), [&levels[..], &values].concat());
            assert_eq!(unpack(&levels, 3, 3).unwrap(), levels);
            let told = |packed: &[u8], levels, size| unpack(packed, levels, size).unwrap_err().to_string();
            // Sixteen mebibytes in some kilobytes, which would go on without an end as well.
            let bomb = pack(&vec![0; 16 << 20]);
            assert!(told(&bomb, 0, 800).contains("more than the 800 bytes"));
            assert!(told(&packed, 3, 1004).contains("fewer than the 1004 bytes"));
            assert!(told(&packed, 3, 2).contains("more than the 2 bytes"));
            assert!(told(&levels, 4, 9).contains("fewer than the 9 bytes"));
            assert!(unpack(b"not packed", 0, 9).is_err());
        }
    }
}
