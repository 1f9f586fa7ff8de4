//! Whether what a task has left for others can be read.

use super::super::run;
use super::super::settings::Plan;
use super::books::CodedBooks;
use super::*;

impl Job {
    /// Reads what a task has left for others, as they will: its index, and the values that this names. Particles, their codes and pages of the
    /// output are read where they are used, each with its checksum; the page file of a step as a whole.
    ///
    /// # Errors
    /// Where there is no such task, or its result is missing or damaged. A damaged one is removed: the task is to be run again.
    pub fn verify(&self, stage: &str, task: u32) -> Result<(), BuildError> {
        let number = self.number(stage, task)?;
        let parts = Parts::reader(self.names());
        match &self.plan {
            Plan::Run(_) if stage == run::RUN => parts.index(number),
            Plan::Run(_) => run::known_still(self, &parts, task, &()).map(drop),
            Plan::Snapshot(settings) => {
                let options = &settings.options;
                Task { job: self, settings, options, parts: Arc::new(parts), progress: &() }.verify(stage, task)
            }
        }
    }
}

impl Task<'_> {
    fn verify(&self, stage: &str, task: u32) -> Result<(), BuildError> {
        match stage {
            "survey" => self.has_index::<Surveyed>(stage, task),
            "plan" => {
                let (outlines, _): Planned = self.index(stage, task)?;
                self.has_values::<Columns>(outlines.into_iter().flatten().map(|(_, samples)| samples))
            }
            "partition" => {
                let mut sorted = self.index::<Sorted>(stage, task)?.into_iter();
                self.has_values::<Vec<Vec<u64>>>(sorted.next())?;
                self.has_values::<Shares>(sorted)
            }
            "neighbours" | "motion" => self.has_index::<Found>(stage, task),
            "scale" => self.has_index::<Vec<Option<Scaled>>>(stage, task),
            "grow" => self.has_index::<Grown>(stage, task),
            "join" => {
                let families: Vec<JoinedFamily> = self.index(stage, task)?;
                for Joined { drafts, books, .. } in families.into_iter().flat_map(|family| family.trees) {
                    self.has_values::<Draft>(drafts)?;
                    self.has_values::<Vec<Entry>>(books.into_iter().flat_map(Book::blobs))?;
                }
                Ok(())
            }
            "quantize" => {
                let (coded, _): CodedBooks = self.index(stage, task)?;
                self.has_values::<Vec<Coded<Codes>>>(coded.into_iter().flat_map(|(_, coded)| coded.parts))
            }
            "train" => {
                let trained: Vec<(usize, Blob)> = self.index(stage, task)?;
                self.has_values::<Trained>(trained.into_iter().map(|(_, trained)| trained))
            }
            "code" | "refine" => {
                let units: CodedUnits = self.index(stage, task)?;
                let (codes, counted): (Vec<Blob>, Vec<Blob>) = units.into_iter().map(|(_, unit)| unit).unzip();
                self.has_values::<Vec<Codes>>(codes)?;
                match stage {
                    "code" => self.has_values::<Sums>(counted),
                    _ => self.has_values::<Vec<u64>>(counted),
                }
            }
            "draft" | "lines" => {
                let drafts: Vec<Blob> = self.index(stage, task)?;
                self.has_values::<DraftBook>(drafts)
            }
            "settle" => {
                let units: SettledUnits = self.index(stage, task)?;
                self.has_values::<Vec<Coded<Codes>>>(units.into_iter().map(|(_, (batches, _))| batches))
            }
            "pages" => {
                let Pages { tasks, numbers, .. } = self.index(stage, task)?;
                self.has_values::<Vec<Vec<Vec<u16>>>>([numbers])?;
                let spill = self.spill();
                tasks.iter().try_for_each(|(pages, _)| {
                    let own: OwnPages = self.portable(&spill, pages)?;
                    self.has_values::<Vec<PlacedNode>>(own.nodes)
                })
            }
            "write" => self.has_index::<Vec<PageEntry>>(stage, task),
            _ => self.has_index::<()>(stage, task),
        }
    }

    /// Reads the index of a task.
    fn has_index<T: Portable>(&self, stage: &str, task: u32) -> Result<(), BuildError> {
        self.index::<T>(stage, task).map(drop)
    }

    /// Reads the values that are in blobs.
    fn has_values<T: Portable>(&self, blobs: impl IntoIterator<Item = Blob>) -> Result<(), BuildError> {
        let spill = self.spill();
        blobs.into_iter().try_for_each(|blob| self.portable::<T>(&spill, &blob).map(drop))
    }
}
