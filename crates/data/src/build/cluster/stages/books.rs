//! What shares a codebook, and the stage that codes it as a whole: what takes six stages in parts takes one where each task has codebooks of
//! its own, and quantities are read once instead of four times.

use super::*;

/// What came of drawing leaves, by family and number among its leaves that are drawn: [`Measured::squares`].
pub(super) type Squares = BTreeMap<(usize, usize), [f64; 2]>;

/// The index of a task that codes what shares some codebooks, by number of the codebook.
pub(super) type CodedBooks = (Vec<(usize, CodedBatches)>, Vec<((usize, usize), [f64; 2])>);

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
        let own = own_books(&books, self.settings.code, task);
        self.progress.begin("coding", own.len() as u64);
        let spill = self.spill();
        let mut coded: Vec<(usize, CodedBatches)> = Vec::with_capacity(own.len());
        for number in own {
            let (family, book) = &books[number];
            let scaled = self.scaled_family(&scaled, *family)?;
            coded.push((number, self.quantized_book(task, scaled, book, &spill)?));
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
        task: u32,
        scaled: &Scaled,
        book: &Book,
        spill: &Spill,
    ) -> Result<CodedBatches, BuildError> {
        let temporary = |error| BuildError::temporary(spill, error);
        let (folder, room) = (self.parts.folder(), self.memory(&scaled.outline, 0).particles);
        let near = Spill::new(&folder.join(format!("{SPILL}.{task}")), folder, room, self.options.read);
        let mut shared: Shared = self.portable(spill, &book.shared)?;
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
        Ok(coded)
    }

    /// Draws those of the leaves that are drawn which the task has coded.
    fn squares(
        &self,
        scaled: &[Option<Scaled>],
        coded: &[(usize, CodedBatches)],
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
            if let Some((tree, picture)) = joined.trees.first().zip(picture) {
                let draft: Draft = self.portable(spill, &tree.draft)?;
                let leaves = self.leaves(tree, spill)?;
                let positions = |depth: usize, index: usize| draft.positions(depth, index);
                let measured = Measured { picture: &picture, positions: &positions };
                let draw = |(number, drawn): (usize, &Drawn)| {
                    let (_, coded) = coded.iter().find(|(book, _)| *book == first + drawn.book)?;
                    let squares = measured.squares(&draft.nodes, &leaves[drawn.book], coded, drawn, spill, bits);
                    Some(squares.map(|squares| ((family, number), squares)))
                };
                let drawn = measured.drawn(&draft.nodes, &leaves);
                let squares = drawn.par_iter().enumerate().filter_map(draw).collect::<io::Result<Vec<_>>>();
                all.extend(squares.map_err(|error| BuildError::temporary(spill, error))?);
            }
            first += joined.trees.iter().map(|tree| tree.books.len()).sum::<usize>();
        }
        Ok(all)
    }

    /// What shares the codebooks of a tree's leaves.
    fn leaves(&self, tree: &Joined, spill: &Spill) -> Result<Vec<Shared>, BuildError> {
        let mut leaves = Vec::new();
        for book in &tree.books {
            let shared: Shared = self.portable(spill, &book.shared)?;
            if !shared.is_of_leaves() {
                break;
            }
            leaves.push(shared);
        }
        Ok(leaves)
    }

    /// All that is coded, by codebook, and what came of drawing leaves, where those who coded have drawn them.
    pub(super) fn coded_books(&self) -> Result<(Vec<CodedBatches>, Option<Squares>), BuildError> {
        if !self.settings.has_whole_books() {
            return Ok((self.quantized()?, None));
        }
        let (mut all, mut squares) = (Vec::new(), Squares::new());
        for task in 0..self.settings.code {
            let (coded, own): CodedBooks = self.index("quantize", task)?;
            all.extend(coded);
            squares.extend(own);
        }
        Ok((self.in_order(all)?, Some(squares)))
    }
}

/// The codebooks that a task of so many has, in order.
pub(super) fn own_books(books: &[(usize, Book)], tasks: u32, task: u32) -> Vec<usize> {
    let particles = |(_, book): &(usize, Book)| book.parts.iter().map(|part| part.particles).sum();
    let particles: Vec<u64> = books.iter().map(particles).collect();
    balanced(&particles, tasks).swap_remove(task as usize)
}
