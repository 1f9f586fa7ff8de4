//! Attributes that are derived from velocities, as a user names them.

use super::cache::page_file_with;
use super::region_options::At;
use crate::explore::Opened;
use crate::import::step_at;
use crate::look::{DataKind, HeightsSaid, TakenFor, data_file};
use crate::model::{DerivedQuantity, Progress, ReadMethod};
use std::path::Path;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Quantities that are to be derived, each once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DerivedQuantities(pub Vec<DerivedQuantity>);

/// Reads their names, with commas between them, or `all`.
///
/// # Errors
/// A sentence, where one is none.
pub fn derived(text: &str) -> Result<DerivedQuantities, String> {
    DerivedQuantity::list(text).map(DerivedQuantities)
}

/// Attributes of a source that is opened unbuilt.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct DeriveOptions {
    /// Attributes to derive from the velocities of a snapshot: velocity-dispersion, divergence, vorticity, mach-number, or all that can be had. Its
    /// page file in the cache is built with them; one that is built already has what build --derive has given it.
    #[arg(long, value_name = "A,B,...", value_parser = derived)]
    pub derive: Option<DerivedQuantities>,
}

impl DeriveOptions {
    /// The quantities.
    pub fn quantities(&self) -> &[DerivedQuantity] {
        self.derive.as_ref().map_or(&[], |derived| derived.0.as_slice())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.quantities().is_empty()
    }

    /// What is said of data, with the quantities.
    pub fn with(&self, said: HeightsSaid) -> HeightsSaid {
        HeightsSaid { derive: self.quantities().to_vec(), ..said }
    }

    /// Refuses to derive anything where `what` asks for the source itself, which has nothing derived.
    ///
    /// # Errors
    /// Where something is to be derived.
    pub fn refuse(&self, path: &Path, what: &str) -> Result<(), String> {
        if self.is_empty() {
            return Ok(());
        }
        Err(format!("{}: --derive: {what} asks the source itself, expected a page file of it", path.display()))
    }

    /// As [`At::open`]; of a source, where something is to be derived, its page file in the cache, which is built first where there is
    /// none.
    ///
    /// # Errors
    /// As [`At::open`], and where the quantities cannot be derived.
    pub fn open(&self, path: &Path, at: At, method: ReadMethod, progress: &dyn Progress) -> Result<Opened, Failure> {
        if self.is_empty() {
            return at.open(path, method);
        }
        let path = data_file(path)?;
        let said = self.with(HeightsSaid { taken_for: Some(TakenFor::Particles), ..HeightsSaid::default() });
        let step = match (at.time, DataKind::of(&path)?) {
            (Some(when), DataKind::Source) => step_at(&path, when, method)?,
            _ => None,
        };
        match step {
            Some(step) => At { time: None, ..at }.open(&page_file_with(&step, &said, progress)?, method),
            None => at.open(&page_file_with(&path, &said, progress)?, method),
        }
    }
}
