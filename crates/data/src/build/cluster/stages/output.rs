//! The last stages: pages are written to their places, and the file gets its name.

use super::*;

/// Bytes that are held of a page in the end: what its task has told of it, as that is read and in a list that grows, and the table of all pages.
const PAGE: u64 = 5 * size_of::<PageEntry>() as u64;

impl Task<'_> {
    /// How often which values are in the columns of a family.
    pub(super) fn histograms(
        &self,
        family: usize,
        outline: &Outline,
        scaled: &Scaled,
        estimated: Vec<Vec<u64>>,
        derived: Vec<Vec<u64>>,
    ) -> Result<Vec<Histogram>, BuildError> {
        let mut source: Vec<Vec<u64>> = Vec::new();
        let spill = self.spill();
        for task in self.settings.inputs().nth(family).into_iter().flatten() {
            source = added(source, self.counted(&spill, task, outline)?);
        }
        let (counted, count) = (total(source.iter().flatten().copied()), outline.survey.count);
        let expected = count.saturating_mul(source.len() as u64);
        if counted != expected {
            return Err(self.mixed("partition", "counted values", counted, expected));
        }
        let complete = &scaled.outline;
        let columns = [Self::found_columns("neighbours", complete), complete.derived_columns()];
        for (counts, columns) in [estimated.len(), derived.len()].into_iter().zip(columns) {
            expect("counted columns", counts, columns).map_err(|what| self.damaged("join", 0, &what))?;
        }
        let ranges = &complete.survey.ranges;
        let mut all = histograms(&outline.survey.ranges, source);
        if complete.estimating().is_some() {
            all.splice(1..3, histograms(&ranges[1..3], estimated));
        }
        if complete.derived_columns() > 0 {
            all.truncate(3 + complete.own);
            all.splice(3..3, histograms(&ranges[3..3 + complete.derived_columns()], derived));
        }
        // What is complete was made of what was planned.
        expect("histograms", all.len(), ranges.len()).map_err(|what| self.damaged("scale", 0, &what))?;
        Ok(all)
    }

    /// The version of the output, and what follows the table of pages in its footer.
    pub(super) fn footer(
        &self,
        mut source: Dataset,
        families: Vec<FamilyMetadata>,
        notes: Vec<String>,
        pages: usize,
    ) -> Result<(u32, Vec<u8>), BuildError> {
        let settings = self.settings;
        if source.provenance.path == settings.source {
            source.provenance.path.clone_from(&settings.named);
        }
        Ok(about(&metadata(source, families, notes, self.options)?, pages))
    }

    pub(super) fn write(self, task: u32) -> Result<(), BuildError> {
        let names = self.job.names();
        if self.job.done(&names, names.tasks() - 1).is_some() {
            // The file is gone to where it belongs; the task's own result has been taken.
            return self.hand_on(&Vec::<PageEntry>::new(), 0, 0);
        }
        let index = self.page_plan()?;
        let spill = self.spill();
        let numbers: Vec<Vec<Vec<u16>>> = self.portable(&spill, &index.numbers)?;
        let pages = self.own_pages(&spill, &index, task)?;
        self.progress.begin("writing pages", pages.len() as u64);
        let path = self.job.growing();
        let unwritable = |reason: &str| StoreError::Unwritable { path: path.clone(), reason: reason.into() };
        let file = open_growing(&path)?;
        if let Err(removed) = self.job.check_is_there(self.job.number("write", task)?) {
            // Begun just now, after the job was removed with it; what has pages is that of a job which has moved.
            if file.metadata().is_ok_and(|about| about.len() == 0) {
                let _ = std::fs::remove_file(&path);
            }
            return Err(removed);
        }
        let bits = self.options.octree.code_bits();
        let write = |page: &Page| -> Result<PageEntry, BuildError> {
            let PageHead { id, family, offset, .. } = page.head;
            let numbers = numbers.get(family as usize).ok_or_else(|| self.unsound("pages of another family"))?;
            let sections = |(node, places): &(StoredNode, NodeSections)| {
                Ok((node.clone(), places.read(node, numbers, bits, &spill)?))
            };
            let records = page.nodes.iter().map(sections).collect::<io::Result<Vec<_>>>();
            let records = records.map_err(|error| BuildError::temporary(&spill, error))?;
            let page_of = EncodedPage::new(id, family, &records).ok_or_else(|| unwritable(TOO_LONG))?;
            let EncodedPage { nodes, memory, bytes } = page_of;
            let memory =
                u32::try_from(memory).map_err(|_| unwritable("a page would take more than 4 GiB of memory"))?;
            let (len, crc) = (bytes.len() as u32, crc32c::crc32c(&bytes));
            // With the zeros behind it: something else may be there by now.
            let mut bytes = bytes;
            bytes.resize(bytes.len().next_multiple_of(ALIGNMENT as usize), 0);
            if offset.checked_add(bytes.len() as u64).is_none_or(|end| end > index.end) {
                return Err(self.damaged("pages", 0, "page: found one beyond the end of all, expected room for it"));
            }
            write_all_at(&file, &bytes, offset).map_err(|source| io_error(&path, "write", source))?;
            self.progress.advance(1);
            Ok(PageEntry { offset, len, nodes, family, crc, memory })
        };
        let entries = pages.par_iter().with_max_len(1).map(write).collect::<Result<Vec<PageEntry>, _>>()?;
        let written = entries.iter().map(|entry| u64::from(entry.len)).sum();
        drop(spill);
        self.hand_on(&entries, 0, written)
    }

    pub(super) fn finish(self) -> Result<(), BuildError> {
        let index = self.page_plan()?;
        let pages = index.count();
        self.left_beside(pages.saturating_mul(PAGE), "stage finish, which knows all pages,")?;
        let Pages { tasks, end, version, about, .. } = index;
        let mut table: Vec<(u32, PageEntry)> = Vec::new();
        for (task, (_, planned)) in (0..).zip(&tasks) {
            // One that has run again after the end of the job has told of none.
            let check = |entries: &Vec<PageEntry>| expect("pages", entries.len() as u64, *planned);
            table.extend(self.checked("write", task, check)?.into_iter().map(|entry| (task, entry)));
        }
        let mut at = ALIGNMENT;
        for (task, PageEntry { offset, len, .. }) in &table {
            expect("place of a page", *offset, at).map_err(|what| self.damaged("write", *task, &what))?;
            let next = at.saturating_add(u64::from(*len));
            at = align_up(next, ALIGNMENT).unwrap_or(next);
        }
        expect("end of pages", end, at).map_err(|what| self.damaged("pages", 0, &what))?;
        let entries: Vec<PageEntry> = table.iter().map(|(_, entry)| *entry).collect();
        let (header, tail) = ends(MAGIC, version, &entries, end, &about);
        let output = self.job.output();
        let (path, mut head) = (self.job.growing(), vec![0; ALIGNMENT as usize]);
        head.iter_mut().zip(header.encode()).for_each(|(to, byte)| *to = byte);
        let file = match OpenOptions::new().read(true).write(true).open(&path) {
            Ok(file) => file,
            Err(source) if source.kind() != io::ErrorKind::NotFound => return Err(io_error(&path, "open", source)),
            // Another try has come to the end, or is about to.
            Err(_) if begins_with(output, &head, header.file_len) => return self.hand_on(&(), 0, 0),
            Err(_) => return Err(self.write_again(&path, (0..self.settings.write).collect())),
        };
        self.progress.begin("checking pages", pages);
        let len = file.metadata().map_err(|source| io_error(&path, "look at", source))?.len();
        let is_damaged = |(_, entry): &&(u32, PageEntry)| {
            self.progress.advance(1);
            !is_written(&file, len, entry)
        };
        let mut damaged: Vec<u32> = table.par_iter().filter(is_damaged).map(|(task, _)| *task).collect();
        damaged.dedup();
        if !damaged.is_empty() {
            return Err(self.write_again(&path, damaged));
        }
        let written = write_all_at(&file, &tail, end)
            .and_then(|()| file.set_len(header.file_len))
            .and_then(|()| write_all_at(&file, &head, 0))
            .and_then(|()| file.sync_all());
        written.map_err(|source| io_error(&path, "write", source))?;
        drop(file);
        self.job.check_is_there(self.job.number("finish", 0)?)?;
        // Another try may have given this file its name, and a task that runs again have begun the next one.
        let renamed = match begins_with(&path, &head, header.file_len) {
            true => std::fs::rename(&path, output),
            false => Err(io::ErrorKind::NotFound.into()),
        };
        match renamed {
            Err(source) if !begins_with(output, &head, header.file_len) => {
                return Err(io_error(output, "rename the finished file to", source));
            }
            _ => {}
        }
        self.hand_on(&(), 0, tail.len() as u64 + ALIGNMENT)
    }

    /// Forgets tasks that have written pages that are not in the file.
    pub(super) fn write_again(&self, path: &Path, tasks: Vec<u32>) -> BuildError {
        for &task in &tasks {
            match self.job.number("write", task) {
                Ok(number) => self.job.names().forget(number),
                Err(error) => return error,
            }
        }
        let tasks = tasks.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
        job_error(path, &format!("pages: found others than were written, or none; run stage write, task {tasks}"))
    }
}

/// Opens the file that will be the output, or begins it.
fn open_growing(path: &Path) -> Result<File, BuildError> {
    let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
    file.map_err(|source| io_error(path, "open", source))
}

/// Whether a file of this length has a page, and zeros behind it; behind the last one there may be nothing yet.
fn is_written(file: &File, len: u64, entry: &PageEntry) -> bool {
    let end = entry.offset.checked_add(u64::from(entry.len)).filter(|end| *end <= len);
    let Some(end) = end else { return false };
    let next = align_up(end, ALIGNMENT).unwrap_or(end).min(len);
    let mut bytes = vec![0; (next - entry.offset) as usize];
    let read = read_exact_at(file, &mut bytes, entry.offset);
    let (page, zeros) = bytes.split_at(entry.len as usize);
    read.is_ok() && crc32c::crc32c(page) == entry.crc && zeros.iter().all(|&byte| byte == 0)
}

/// Whether a file of this length begins with these bytes.
fn begins_with(path: &Path, head: &[u8], len: u64) -> bool {
    let mut bytes = vec![0; head.len()];
    let read = File::open(path).and_then(|file| {
        read_exact_at(&file, &mut bytes, 0)?;
        Ok(file.metadata()?.len())
    });
    read.is_ok_and(|found| found == len) && bytes == head
}
