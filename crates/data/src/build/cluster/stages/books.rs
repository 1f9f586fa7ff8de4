//! What shares a codebook, and the stage that codes it as a whole: what takes six stages in parts takes one where each task has codebooks of
//! its own, and quantities are read once instead of four times.

use super::drawn::DrawnLeaf;
use super::tables::BATCH;
use super::*;

/// Bytes that a batch takes once it is coded, for each byte that tells of it.
const CODED: u64 = 2;

/// What came of drawing leaves, by family and number among its leaves that are drawn.
pub(super) type Squares = BTreeMap<(usize, usize), [f64; 2]>;

/// What shares a codebook, coded: the codebook without its batches, and where these are, by part.
pub(super) struct CodedBook {
    pub book: CodedBatches,
    pub parts: Vec<Blob>,
}

portable!(CodedBook { book, parts });

/// The index of a task that codes what shares some codebooks, by number of the codebook.
pub(super) type CodedBooks = (Vec<(usize, CodedBook)>, Vec<((usize, usize), [f64; 2])>);

impl Task<'_> {
    /// What shares a codebook, of all families, with the number of its family; codebooks are numbered in this order.
    pub(super) fn books(&self) -> Result<Vec<(usize, Book)>, BuildError> {
        let families = self.joined()?.into_iter().enumerate();
        let books = families.flat_map(|(family, joined)| {
            joined.trees.into_iter().flat_map(|tree| tree.books).map(move |book| (family, book))
        });
        Ok(books.collect())
    }

    /// What is known of a family that has codebooks.
    pub(super) fn scaled_family<'s>(
        &self,
        scaled: &'s [Option<Scaled>],
        family: usize,
    ) -> Result<&'s Scaled, BuildError> {
        let scaled = scaled.get(family).and_then(Option::as_ref);
        scaled.ok_or_else(|| self.unsound("codebooks of a family without particles"))
    }

    pub(super) fn quantize(self, task: u32) -> Result<(), BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        self.check_drawing()?;
        let own = books_by_task(&books, self.settings.code).swap_remove(task as usize);
        let held = largest_book(&own, &books).saturating_mul(BATCH + CODED);
        let room = self.left_beside(held, "a task that codes what shares a codebook")?;
        self.progress.begin("coding", own.len() as u64);
        let spill = self.spill();
        let mut coded: Vec<(usize, CodedBook)> = Vec::with_capacity(own.len());
        for number in own {
            let (family, book) = &books[number];
            let scaled = self.scaled_family(&scaled, *family)?;
            coded.push((number, self.quantized_book(self.near(task, room), scaled, book, &spill)?));
            self.progress.advance(1);
        }
        let squares = self.squares(&scaled, &coded, &spill)?;
        drop(spill);
        let coded: CodedBooks = (coded, squares);
        self.hand_on(&coded, 0, 0)
    }

    /// Codes what shares a codebook.
    fn quantized_book(
        &self,
        near: Spill,
        scaled: &Scaled,
        book: &Book,
        spill: &Spill,
    ) -> Result<CodedBook, BuildError> {
        let temporary = |error| BuildError::temporary(spill, error);
        let mut shared = self.shared(spill, scaled, book)?;
        shared.copy(spill, &near).map_err(temporary)?;
        let bits = self.options.octree.code_bits();
        let mut coded = shared.code(&scaled.scaling, &near, bits, self.progress).map_err(temporary)?;
        // Handed on in their order: it does not depend on threads where they are.
        for batch in &mut coded.batches {
            let codes = near.get(&batch.codes.0).map_err(temporary)?;
            let handed_on = spill.put(&[&codes]).map_err(temporary)?;
            drop(codes);
            batch.codes.0 = handed_on;
        }
        let mut batches = std::mem::take(&mut coded.batches).into_iter();
        let put = |part: &Part| {
            let own: Vec<Coded<Codes>> = batches.by_ref().take(part.batches.len()).collect();
            spill.put(&[&own.bytes()])
        };
        let parts = book.parts.iter().map(put).collect::<io::Result<_>>().map_err(temporary)?;
        Ok(CodedBook { book: coded, parts })
    }

    /// Whether the task may hold what it knows of all leaves while it chooses those that are drawn.
    fn check_drawing(&self) -> Result<(), BuildError> {
        // Plain codes are drawn by nobody.
        let families = if self.is_refined() { self.joined()? } else { Vec::new() };
        let held = families.iter().filter_map(|family| family.trees.first()).map(Joined::held_by_drawing).max();
        self.left_beside(held.unwrap_or(0), "a task that draws leaves, of all of which it knows the masses,")?;
        Ok(())
    }

    /// Draws those of the leaves that are drawn which the task has coded.
    fn squares(
        &self,
        scaled: &[Option<Scaled>],
        coded: &[(usize, CodedBook)],
        spill: &Spill,
    ) -> Result<Vec<((usize, usize), [f64; 2])>, BuildError> {
        let bits = self.options.octree.code_bits();
        let mut all = Vec::new();
        if !bits.is_refined() {
            return Ok(all);
        }
        let source = self.source()?;
        let kernel = self.streams(source.as_ref())?.about.kernel;
        let mut first = 0;
        for (family, (joined, scaled)) in self.joined()?.into_iter().zip(scaled).enumerate() {
            let picture = scaled.as_ref().and_then(|scaled| scaled.outline.picture(kernel, bits));
            if let Some(((tree, picture), scaled)) = joined.trees.first().zip(picture).zip(scaled.as_ref()) {
                let leaves = self.drawn_leaves(spill, tree, scaled, &picture)?;
                let draw = |(number, leaf): (usize, &DrawnLeaf)| {
                    let book = leaf.book();
                    let (_, coded) = coded.iter().find(|(own, _)| *own == first + book)?;
                    let squares = self.leaf_squares(spill, &picture, leaf, &tree.books[book], coded);
                    Some(squares.map(|squares| ((family, number), squares)))
                };
                let squares = leaves.par_iter().enumerate().filter_map(draw).collect::<Result<Vec<_>, BuildError>>();
                all.extend(squares?);
            }
            first += joined.trees.iter().map(|tree| tree.books.len()).sum::<usize>();
        }
        Ok(all)
    }

    /// All that is coded, by codebook, and what came of drawing leaves, where those who coded have drawn them.
    pub(super) fn coded_books(&self) -> Result<(Vec<CodedBook>, Option<Squares>), BuildError> {
        if !self.settings.has_whole_books() {
            return Ok((self.quantized()?, None));
        }
        let (scaled, books) = (self.scaled()?, self.books()?);
        let (mut all, mut squares) = (Vec::new(), Squares::new());
        for (task, numbers) in (0..).zip(books_by_task(&books, self.settings.code)) {
            let (coded, own) = self.checked("quantize", task, |(coded, _): &CodedBooks| {
                let own = coded.iter().map(|(number, _)| number);
                expect_that(own.eq(&numbers), "numbers", "those of the task's codebooks")?;
                coded.iter().try_for_each(|(number, coded)| self.check_coded(&scaled, &books[*number], coded))
            })?;
            all.extend(coded);
            squares.extend(own);
        }
        // Each is one task's.
        all.sort_by_key(|(number, _)| *number);
        Ok((all.into_iter().map(|(_, coded)| coded).collect(), Some(squares)))
    }

    /// Whether what is coded is what shares a codebook of a family; else what was found and expected.
    pub(super) fn check_coded(
        &self,
        scaled: &[Option<Scaled>],
        (family, book): &(usize, Book),
        coded: &CodedBook,
    ) -> Result<(), String> {
        let scaled = scaled.get(*family).and_then(Option::as_ref);
        let attributes = scaled.map_or(0, |scaled| scaled.scaling.attributes.len());
        coded.book.check(0, attributes, self.options.octree.code_bits())?;
        expect("parts of a codebook", coded.parts.len(), book.parts.len())
    }
}

/// Bytes by which the batches of the largest of some codebooks are told of.
pub(super) fn largest_book(own: &[usize], books: &[(usize, Book)]) -> u64 {
    own.iter().map(|number| books[*number].1.bytes()).max().unwrap_or(0)
}

/// The codebooks that each of so many tasks has, in order.
pub(super) fn books_by_task(books: &[(usize, Book)], tasks: u32) -> Vec<Vec<usize>> {
    let particles = |(_, book): &(usize, Book)| book.parts.iter().map(|part| part.particles).sum();
    let particles: Vec<u64> = books.iter().map(particles).collect();
    balanced(&particles, tasks)
}
