//! The stages that code quantities in parts, more of them than there are codebooks: these are trained, drafted, refined and settled.

use super::tables::BATCH;
use super::*;

impl Task<'_> {
    /// The units of each task, in order: the same ones in all stages that code.
    fn units_by_task(&self, books: &[(usize, Book)]) -> Vec<Vec<usize>> {
        let particles = |(book, part): (usize, usize)| books[book].1.parts[part].particles;
        let particles: Vec<u64> = units(books).into_iter().map(particles).collect();
        balanced(&particles, self.settings.code)
    }

    /// The units of a task.
    fn own_units(&self, books: &[(usize, Book)], task: u32) -> Vec<usize> {
        self.units_by_task(books).swap_remove(task as usize)
    }

    pub(super) fn train(self, task: u32) -> Result<(), BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let spill = self.spill();
        let bits = self.options.octree.code_bits();
        let own = books_by_task(&books, self.settings.train).swap_remove(task as usize);
        let largest = largest_book(&own, &books);
        self.left_beside(largest.saturating_mul(BATCH), "a task that trains what shares a codebook")?;
        self.progress.begin("training", own.len() as u64);
        let train = |number: usize| {
            let (family, book) = &books[number];
            let scaled = self.scaled_family(&scaled, *family)?;
            let shared = self.shared(&spill, scaled, book)?;
            let group = shared.group(&spill, bits, self.progress);
            let trained = shared.train(&scaled.scaling, &group, bits);
            self.progress.advance(1);
            let put = |trained: Trained| spill.put(&[&trained.bytes()]);
            Ok((number, trained.and_then(put).map_err(|error| BuildError::temporary(&spill, error))?))
        };
        let trained = own.into_iter().map(train).collect::<Result<Vec<(usize, Blob)>, BuildError>>()?;
        drop(spill);
        self.hand_on(&trained, 0, 0)
    }

    /// Where trained quantisers are, by codebook.
    fn trained(&self, books: &[(usize, Book)]) -> Result<Vec<Blob>, BuildError> {
        self.of_all("train", &books_by_task(books, self.settings.train), |_, _| Ok(()))
    }

    /// Does something to each of a task's units, as many at a time as there are threads and as memory has room for.
    pub(super) fn with_units<R: Send>(
        &self,
        task: u32,
        spill: &Spill,
        work: impl Fn(Unit<'_>) -> Result<R, BuildError> + Sync,
    ) -> Result<Vec<(usize, R)>, BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let units = units(&books);
        let own: Vec<(usize, usize)> = self.own_units(&books, task).into_iter().enumerate().collect();
        let at_once = self.units_at_once(own.iter().map(|(_, unit)| units[*unit]), &books)?;
        self.progress.begin("coding", own.len() as u64);
        let bits = self.options.octree.code_bits();
        let one = |&(place, unit): &(usize, usize)| {
            let (number, part) = units[unit];
            let (family, book) = &books[number];
            let scaled = self.scaled_family(&scaled, *family)?;
            let shared = self.shared_around(spill, scaled, book, part)?;
            let lane = spill.lane(unit);
            let group = shared.group(&lane, bits, self.progress);
            let (part, scaling) = (book.parts[part].batches.clone(), &scaled.scaling);
            let worked = work(Unit { place, book: number, group: &group, part, scaling, spill: &lane })?;
            lane.close().map_err(|error| BuildError::temporary(spill, error))?;
            self.progress.advance(1);
            Ok((unit, worked))
        };
        let mut all = Vec::with_capacity(own.len());
        for some in own.chunks(at_once.unwrap_or(own.len()).max(1)) {
            all.extend(some.par_iter().with_max_len(1).map(&one).collect::<Result<Vec<_>, BuildError>>()?);
        }
        Ok(all)
    }

    /// How many of some units, each of which is read with its run, may be worked at at a time; `None`: as many as there are threads.
    fn units_at_once(
        &self,
        units: impl Iterator<Item = (usize, usize)>,
        books: &[(usize, Book)],
    ) -> Result<Option<usize>, BuildError> {
        let run = |(book, part): (usize, usize)| books[book].1.run_around(part).map_or(0, |(_, run)| run.len() as u64);
        let largest = units.map(run).max().unwrap_or(0).saturating_mul(BATCH);
        let left = self.left_beside(largest, "a task that codes parts of what shares a codebook")?;
        let at_once = 1 + (left / largest.max(1)) as usize;
        Ok((at_once < rayon::current_num_threads()).then_some(at_once))
    }

    pub(super) fn code(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let books = self.books()?;
        let bits = self.options.octree.code_bits();
        let check = |trained: &Trained, _| trained.check(bits);
        let trained = self.of_own_books(task, &spill, &books, &self.trained(&books)?, check)?;
        let temporary = |error| BuildError::temporary(&spill, error);
        let coded: CodedUnits =
            self.with_units(task, &spill, |Unit { book, group, part, scaling, spill, .. }| {
                let trained = trained.get(&book).ok_or_else(|| self.unsound("fewer quantisers than codebooks"))?;
                let (kept, sums) = trained.code(group, part, scaling).map_err(temporary)?;
                let put = |bytes: Vec<u8>| spill.put(&[&bytes]).map_err(temporary);
                Ok((put(kept.bytes())?, put(sums.bytes())?))
            })?;
        drop(spill);
        self.hand_on(&coded, 0, 0)
    }

    /// What the tasks of a stage hand on of each unit, in the order of units, which passes a check by codebook and part.
    fn of_units<R: Portable>(
        &self,
        stage: &str,
        books: &[(usize, Book)],
        check: impl Fn(usize, &Part, &R) -> Result<(), String>,
    ) -> Result<Vec<R>, BuildError> {
        let units = units(books);
        self.of_all(stage, &self.units_by_task(books), |unit, found| {
            let (book, part) = units[unit];
            check(book, &books[book].1.parts[part], found)
        })
    }

    pub(super) fn draft(self) -> Result<(), BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let trained = self.trained(&books)?;
        let bits = self.options.octree.code_bits();
        let mut sums = self.of_units::<(Blob, Blob)>("code", &books, |_, _, _| Ok(()))?.into_iter();
        let mut drafts = Vec::with_capacity(books.len());
        let spill = self.spill();
        for ((family, book), trained) in books.iter().zip(&trained) {
            let scaling = &self.scaled_family(&scaled, *family)?.scaling;
            let trained = self.checked_value(&spill, trained, |trained: &Trained| trained.check(bits))?;
            let mut totals = trained.totals(scaling);
            for (part, (_, sums)) in book.parts.iter().zip(sums.by_ref()) {
                let check = |sums: &Sums| totals.check(sums, part.particles);
                let sums = self.checked_value(&spill, &sums, check)?;
                totals.add(part.group, sums);
            }
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

    /// What there is of the codebooks that a task has units of, of which `blobs` has all; it passes a check by the number of attributes.
    fn of_own_books<T: Portable>(
        &self,
        task: u32,
        spill: &Spill,
        books: &[(usize, Book)],
        blobs: &[Blob],
        check: impl Fn(&T, usize) -> Result<(), String>,
    ) -> Result<BTreeMap<usize, T>, BuildError> {
        let (scaled, units) = (self.scaled()?, units(books));
        let mut numbers: Vec<usize> = self.own_units(books, task).into_iter().map(|unit| units[unit].0).collect();
        numbers.dedup();
        let read = |number: usize| {
            let blob = blobs.get(number).ok_or_else(|| self.unsound("fewer codebooks than were planned"))?;
            let attributes = self.scaled_family(&scaled, books[number].0)?.scaling.attributes.len();
            Ok((number, self.checked_value(spill, blob, |found| check(found, attributes))?))
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
        let kept = kept.get(unit.place).ok_or_else(|| self.unsound("codes of other parts"))?;
        self.checked_value(spill, kept, |codes: &Vec<Codes>| expect("codes of batches", codes.len(), unit.part.len()))
    }

    /// The codebooks of a stage of which a task has units.
    fn own_drafts(
        &self,
        stage: &str,
        task: u32,
        spill: &Spill,
        books: &[(usize, Book)],
    ) -> Result<BTreeMap<usize, DraftBook>, BuildError> {
        let bits = self.options.octree.code_bits();
        let check = |draft: &DraftBook, attributes| draft.check(attributes, bits);
        self.of_own_books(task, spill, books, &self.draft_blobs(stage, books)?, check)
    }

    /// Where the codebooks of a stage are, all of them.
    fn draft_blobs(&self, stage: &str, books: &[(usize, Book)]) -> Result<Vec<Blob>, BuildError> {
        self.checked(stage, 0, |blobs: &Vec<Blob>| expect("codebooks", blobs.len(), books.len()))
    }

    /// Where a stage has put the codes of a task's units.
    fn kept(&self, stage: &str, task: u32, books: &[(usize, Book)]) -> Result<Vec<Blob>, BuildError> {
        let own = self.own_units(books, task);
        let units = self.of_task::<(Blob, Blob)>(stage, task, &own, |_, _| Ok(()))?;
        Ok(units.into_iter().map(|(_, (kept, _))| kept).collect())
    }

    pub(super) fn refine(self, task: u32) -> Result<(), BuildError> {
        let spill = self.spill();
        let temporary = |error| BuildError::temporary(&spill, error);
        let books = self.books()?;
        let drafts = self.own_drafts("draft", task, &spill, &books)?;
        let kept = self.kept("code", task, &books)?;
        let refined: CodedUnits = self.with_units(task, &spill, |unit| {
            let (draft, mut codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            let mut counts = Vec::new();
            if draft.is_of_lines() {
                (codes, counts) = draft.refine(unit.group, unit.part, codes).map_err(temporary)?;
            }
            let put = |bytes: Vec<u8>| unit.spill.put(&[&bytes]).map_err(temporary);
            Ok((put(codes.bytes())?, put(counts.bytes())?))
        })?;
        drop(spill);
        self.hand_on(&refined, 0, 0)
    }

    pub(super) fn lines(self) -> Result<(), BuildError> {
        let books = self.books()?;
        let mut drafts = self.drafts("draft", &self.scaled()?, &books)?;
        let mut counts = self.of_units::<(Blob, Blob)>("refine", &books, |_, _, _| Ok(()))?.into_iter();
        let spill = self.spill();
        for ((_, book), draft) in books.iter().zip(&mut drafts) {
            let read = |(part, (_, counts)): (&Part, (Blob, Blob))| {
                self.checked_value(&spill, &counts, |counts: &Vec<u64>| {
                    expect_within("refined codes", total(counts.iter().copied()), 0..=part.particles)
                })
            };
            let own =
                book.parts.iter().zip(counts.by_ref()).map(read).collect::<Result<Vec<Vec<u64>>, BuildError>>()?;
            if draft.is_of_lines() {
                draft.conserve(&own);
            }
        }
        drop(spill);
        self.hand_on_drafts(&drafts)
    }

    /// The codebooks of a stage, all of them.
    fn drafts(
        &self,
        stage: &str,
        scaled: &[Option<Scaled>],
        books: &[(usize, Book)],
    ) -> Result<Vec<DraftBook>, BuildError> {
        let (spill, bits) = (self.spill(), self.options.octree.code_bits());
        let read = |((family, _), blob): (&(usize, Book), &Blob)| {
            let attributes = self.scaled_family(scaled, *family)?.scaling.attributes.len();
            self.checked_value(&spill, blob, |draft: &DraftBook| draft.check(attributes, bits))
        };
        books.iter().zip(&self.draft_blobs(stage, books)?).map(read).collect()
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
        let books = self.books()?;
        let drafts = self.own_drafts(self.last_drafts(), task, &spill, &books)?;
        let kept = self.kept(if self.is_refined() { "refine" } else { "code" }, task, &books)?;
        let settled: SettledUnits = self.with_units(task, &spill, |unit| {
            let (draft, codes) = (self.draft_of(&drafts, &unit)?, self.codes_of(&spill, &kept, &unit)?);
            let (spill, scaling) = (unit.spill, unit.scaling);
            let (batches, errors) = draft.settle(unit.group, unit.part, codes, scaling).map_err(temporary)?;
            Ok((spill.put(&[&batches.bytes()]).map_err(temporary)?, errors))
        })?;
        drop(spill);
        self.hand_on(&settled, 0, 0)
    }

    /// All that is coded in parts, by codebook.
    pub(super) fn quantized(&self) -> Result<Vec<CodedBook>, BuildError> {
        let (scaled, books) = (self.scaled()?, self.books()?);
        let drafts = self.drafts(self.last_drafts(), &scaled, &books)?;
        let settled = self.of_units("settle", &books, |book, _, (_, errors): &SettledUnit| {
            let scaled = scaled.get(books[book].0).and_then(Option::as_ref);
            let attributes = scaled.map_or(0, |scaled| scaled.scaling.attributes.len());
            expect("errors of a part", errors.len(), 3 + attributes)
        })?;
        let mut settled = settled.into_iter();
        let of_book = |(book, draft): (&(usize, Book), DraftBook)| {
            let groups = book.1.parts.iter().map(|part| part.group);
            let of_part = |(group, (batches, errors)): (u32, SettledUnit)| (batches, (group, errors));
            let (parts, errors): (Vec<Blob>, Vec<(u32, Vec<QuantityError>)>) =
                groups.zip(settled.by_ref()).map(of_part).unzip();
            let coded = CodedBook { book: draft.finished(&errors, Vec::new()), parts };
            let checked = self.check_coded(&scaled, book, &coded);
            checked.map(|()| coded).map_err(|what| self.damaged(self.last_drafts(), 0, &what))
        };
        books.iter().zip(drafts).map(of_book).collect()
    }
}
