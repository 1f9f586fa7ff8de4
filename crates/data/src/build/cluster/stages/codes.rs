//! The stages that code quantities in parts, more of them than there are codebooks: these are trained, drafted, refined and settled.

use super::*;

impl Task<'_> {
    /// The units of a task, in order: the same ones in all stages that code.
    pub(super) fn own_units(&self, books: &[(usize, Book)], task: u32) -> Vec<usize> {
        let particles = |(book, part): (usize, usize)| books[book].1.parts[part].particles;
        let particles: Vec<u64> = units(books).into_iter().map(particles).collect();
        balanced(&particles, self.settings.code).swap_remove(task as usize)
    }

    pub(super) fn train(self, task: u32) -> Result<(), BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let spill = self.spill();
        let bits = self.options.octree.code_bits();
        let own = own_books(&books, self.settings.train, task);
        self.progress.begin("training", own.len() as u64);
        let train = |number: usize| {
            let (family, book) = &books[number];
            let shared: Shared = self.portable(&spill, &book.shared)?;
            let group = shared.group(&spill, bits, self.progress);
            let trained = shared.train(&self.scaled_family(&scaled, *family)?.scaling, &group, bits);
            self.progress.advance(1);
            let put = |trained: Trained| spill.put(&[&trained.bytes()]);
            Ok((number, trained.and_then(put).map_err(|error| BuildError::temporary(&spill, error))?))
        };
        let trained = own.into_iter().map(train).collect::<Result<Vec<(usize, Blob)>, BuildError>>()?;
        drop(spill);
        self.hand_on(&trained, 0, 0)
    }

    /// Where trained quantisers are, by codebook.
    pub(super) fn trained(&self) -> Result<Vec<Blob>, BuildError> {
        let mut all: Vec<(usize, Blob)> = Vec::new();
        for task in 0..self.settings.train {
            all.extend(self.index::<Vec<(usize, Blob)>>("train", task)?);
        }
        self.in_order(all)
    }

    /// Does something to each of a task's units, as many at a time as there are threads.
    pub(super) fn with_units<R: Send>(
        &self,
        task: u32,
        spill: &Spill,
        work: impl Fn(Unit<'_>) -> Result<R, BuildError> + Sync,
    ) -> Result<Vec<(usize, R)>, BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let units = units(&books);
        let own = self.own_units(&books, task);
        self.progress.begin("coding", own.len() as u64);
        let bits = self.options.octree.code_bits();
        let mut done = Vec::with_capacity(own.len());
        // Batches of one codebook at a time.
        for own in own.chunk_by(|a, b| units[*a].0 == units[*b].0) {
            let number = units[own[0]].0;
            let (family, book) = &books[number];
            let shared: Shared = self.portable(spill, &book.shared)?;
            let (before, scaling) = (done.len(), &self.scaled_family(&scaled, *family)?.scaling);
            let one = |(i, &unit): (usize, &usize)| {
                let part = book.parts[units[unit].1].batches.clone();
                let lane = spill.lane(unit);
                let group = shared.group(&lane, bits, self.progress);
                let unit_of = Unit { place: before + i, book: number, group: &group, part, scaling, spill: &lane };
                let worked = work(unit_of)?;
                lane.close().map_err(|error| BuildError::temporary(spill, error))?;
                self.progress.advance(1);
                Ok((unit, worked))
            };
            done.extend(own.par_iter().enumerate().with_max_len(1).map(one).collect::<Result<Vec<_>, BuildError>>()?);
        }
        Ok(done)
    }

    pub(super) fn code(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let trained: BTreeMap<usize, Trained> = self.of_own_books(task, &spill, &self.trained()?)?;
        let temporary = |error| BuildError::temporary(&spill, error);
        let coded: CodedUnits =
            self.with_units(task, &spill, |Unit { book, group, part, scaling, spill, .. }| {
                let trained = trained.get(&book).ok_or_else(|| self.unsound("fewer quantisers than codebooks"))?;
                let (kept, sums) = trained.code(group, part, scaling).map_err(temporary)?;
                Ok((spill.put(&[&kept.bytes()]).map_err(temporary)?, sums))
            })?;
        drop(spill);
        self.hand_on(&coded, 0, 0)
    }

    /// What the tasks of a stage hand on of each unit, by number of the unit.
    pub(super) fn of_units<R: Portable>(&self, stage: &str) -> Result<Vec<R>, BuildError> {
        let mut all: Vec<(usize, R)> = Vec::new();
        for task in 0..self.settings.code {
            all.extend(self.index::<Vec<(usize, R)>>(stage, task)?);
        }
        self.in_order(all)
    }

    pub(super) fn draft(self) -> Result<(), BuildError> {
        let (scaled, books, trained) = (self.scaled()?, self.books()?, self.trained()?);
        let mut sums = self.of_units::<(Blob, Sums)>("code")?.into_iter();
        let mut drafts = Vec::with_capacity(books.len());
        let spill = self.spill();
        for ((family, book), trained) in books.iter().zip(&trained) {
            let scaling = &self.scaled_family(&scaled, *family)?.scaling;
            let trained: Trained = self.portable(&spill, trained)?;
            let mut totals = trained.totals(scaling);
            book.parts.iter().zip(sums.by_ref()).for_each(|(part, (_, sums))| totals.add(part.group, sums));
            drafts.push(totals.draft(&trained, scaling));
        }
        drop(spill);
        self.hand_on_drafts(&drafts)
    }

    /// Hands on codebooks, each as a blob.
    pub(super) fn hand_on_drafts(self, drafts: &[DraftBook]) -> Result<(), BuildError> {
        let spill = self.spill();
        let blobs = drafts.iter().map(|draft| spill.put(&[&draft.bytes()])).collect::<io::Result<Vec<Blob>>>();
        let blobs = blobs.map_err(|error| BuildError::temporary(&spill, error))?;
        drop(spill);
        self.hand_on(&blobs, 0, 0)
    }

    /// What there is of the codebooks that a task has units of, of which `blobs` has all.
    pub(super) fn of_own_books<T: Portable>(
        &self,
        task: u32,
        spill: &Spill,
        blobs: &[Blob],
    ) -> Result<BTreeMap<usize, T>, BuildError> {
        let books = self.books()?;
        let units = units(&books);
        let mut numbers: Vec<usize> = self.own_units(&books, task).into_iter().map(|unit| units[unit].0).collect();
        numbers.dedup();
        let read = |number: usize| {
            let blob = blobs.get(number).ok_or_else(|| self.unsound("fewer codebooks than were planned"))?;
            Ok((number, self.portable(spill, blob)?))
        };
        numbers.into_iter().map(read).collect()
    }

    /// The codebook of a unit.
    pub(super) fn draft_of<'d>(
        &self,
        drafts: &'d BTreeMap<usize, DraftBook>,
        unit: &Unit<'_>,
    ) -> Result<&'d DraftBook, BuildError> {
        drafts.get(&unit.book).ok_or_else(|| self.unsound("fewer codebooks than were trained"))
    }

    /// The codes of a unit, of which `kept` has the places of all of the task's.
    pub(super) fn codes_of(&self, spill: &Spill, kept: &[Blob], unit: &Unit<'_>) -> Result<Vec<Codes>, BuildError> {
        self.portable(spill, kept.get(unit.place).ok_or_else(|| self.unsound("codes of other parts"))?)
    }

    pub(super) fn refine(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let drafts = self.of_own_books(task, &spill, &self.index::<Vec<Blob>>("draft", 0)?)?;
        let coded: CodedUnits = self.index("code", task)?;
        let kept: Vec<Blob> = coded.into_iter().map(|(_, (kept, _))| kept).collect();
        let refined: RefinedUnits = self.with_units(task, &spill, |unit| {
            let (draft, mut codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            let mut counts = Vec::new();
            if draft.is_of_lines() {
                (codes, counts) = draft.refine(unit.group, unit.part, codes).map_err(temporary)?;
            }
            Ok((unit.spill.put(&[&codes.bytes()]).map_err(temporary)?, counts))
        })?;
        drop(spill);
        self.hand_on(&refined, 0, 0)
    }

    pub(super) fn lines(self) -> Result<(), BuildError> {
        let (books, mut drafts) = (self.books()?, self.drafts("draft")?);
        let counts = self.of_units::<(Blob, Vec<u64>)>("refine")?;
        let mut counts = counts.iter().map(|(_, counts)| counts);
        for ((_, book), draft) in books.iter().zip(&mut drafts) {
            let own: Vec<&Vec<u64>> = counts.by_ref().take(book.parts.len()).collect();
            if draft.is_of_lines() {
                draft.conserve(own);
            }
        }
        self.hand_on_drafts(&drafts)
    }

    /// The codebooks of a stage, all of them.
    pub(super) fn drafts(&self, stage: &str) -> Result<Vec<DraftBook>, BuildError> {
        let spill = self.spill();
        let blobs: Vec<Blob> = self.index(stage, 0)?;
        blobs.iter().map(|blob| self.portable(&spill, blob)).collect()
    }

    /// The stage that hands on codebooks as they will be stored, but for their errors.
    pub(super) fn last_drafts(&self) -> &'static str {
        if self.is_refined() { "lines" } else { "draft" }
    }

    pub(super) fn is_refined(&self) -> bool {
        self.options.octree.code_bits().is_refined()
    }

    pub(super) fn settle(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let drafts = self.of_own_books(task, &spill, &self.index::<Vec<Blob>>(self.last_drafts(), 0)?)?;
        let kept: Vec<Blob> = match self.is_refined() {
            true => self.index::<RefinedUnits>("refine", task)?.into_iter().map(|(_, (kept, _))| kept).collect(),
            false => self.index::<CodedUnits>("code", task)?.into_iter().map(|(_, (kept, _))| kept).collect(),
        };
        let settled: SettledUnits = self.with_units(task, &spill, |unit| {
            let (draft, codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            draft.settle(unit.group, unit.part, codes, unit.scaling).map_err(temporary)
        })?;
        drop(spill);
        self.hand_on(&settled, 0, 0)
    }

    /// All that is coded in parts, by codebook.
    pub(super) fn quantized(&self) -> Result<Vec<CodedBatches>, BuildError> {
        let (books, drafts) = (self.books()?, self.drafts(self.last_drafts())?);
        let mut settled = self.of_units::<SettledPart<Codes>>("settle")?.into_iter();
        let of_book = |((_, book), draft): (&(usize, Book), DraftBook)| {
            let groups = book.parts.iter().map(|part| part.group);
            draft.finished(groups.zip(settled.by_ref()))
        };
        Ok(books.iter().zip(drafts).map(of_book).collect())
    }
}
