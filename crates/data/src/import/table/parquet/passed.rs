//! Pages that are passed over before others are read, of columns of which no index says which rows their pages have.

use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::Result;

/// The pages of a reader: its dictionary, and those of data behind the first few.
pub(super) struct Passed<R> {
    pages: R,
    /// How many are still to be passed over.
    count: usize,
}

impl<R: PageReader> Passed<R> {
    pub(super) fn new(pages: R, count: usize) -> Passed<R> {
        Passed { pages, count }
    }

    /// Goes on to the first page that is wanted; the dictionary is before all of them.
    fn pass(&mut self) -> Result<()> {
        while self.count > 0 && self.pages.peek_next_page()?.is_some_and(|next| !next.is_dict) {
            self.pages.skip_next_page()?;
            self.count -= 1;
        }
        Ok(())
    }
}

impl<R: PageReader> PageReader for Passed<R> {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        self.pass()?;
        self.pages.get_next_page()
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pass()?;
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.pass()?;
        self.pages.skip_next_page()
    }

    fn at_record_boundary(&mut self) -> Result<bool> {
        self.pages.at_record_boundary()
    }
}

impl<R: PageReader> Iterator for Passed<R> {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Result<Page>> {
        self.get_next_page().transpose()
    }
}
