//! Heights that a user names, opened: a source in any format, or a page file.

use crate::build::{HeightBuildError, HeightBuildOptions, HeightOrigin, build_heights};
use crate::import::summary::{HeightSummary, PlaneSummary};
use crate::import::{
    HeightOptions, HeightSource, NO_SPACING, height_format, open_heights, proportions, summarize_heights,
};
use crate::model::{HeightError, HeightGrid, Heights, Window, facts_of};
use crate::store::{HeightAbout, HeightFile};
use deepfield_data::import::ImportError;
use deepfield_data::model::progress::Progress;
use deepfield_data::model::{Unit, is_url};
use deepfield_data::store::first_bytes;
use std::path::Path;

/// Heights that are open. Several threads may read at once.
#[derive(Debug)]
pub enum OpenHeights {
    /// A source.
    Source(Box<HeightSource>),
    /// A page file.
    Pages(Box<HeightFile>),
}

/// Whether the file at `path` begins as a page file of heights does.
fn is_page_file(path: &Path) -> bool {
    // Reading a pipe would take from it.
    (is_url(path) || path.is_file()) && first_bytes(path, 8).is_ok_and(|head| HeightFile::recognises(&head))
}

/// Whether a file is of heights, built or not, and of nothing else. What cannot be read is left to whoever opens it.
pub fn is_heights(path: &Path) -> bool {
    is_page_file(path) || matches!(height_format(path), Ok(Some(told)) if told.is_sure)
}

impl OpenHeights {
    /// Opens a source or a page file; what options say of a source is in a page file already.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or is of no known format.
    pub fn open(path: &Path, options: &HeightOptions) -> Result<OpenHeights, HeightError> {
        // Nothing behind a URL is a source: what cannot be read there is told as it is.
        if !is_url(path) && !is_page_file(path) {
            return Ok(OpenHeights::Source(Box::new(open_heights(path, options)?)));
        }
        let said = [
            ("--nodata", options.no_data.is_some()),
            ("--spacing", options.spacing.is_some()),
            ("--xy-unit", options.xy_unit.is_some()),
            ("--height-unit", options.height_unit.is_some()),
            ("--texture", options.texture.is_some()),
        ];
        if let Some((option, _)) = said.iter().find(|(_, is_said)| *is_said) {
            let expected = "a source: what is said of it is kept when it is built";
            return Err(ImportError::malformed(path, *option, "a page file", expected).into());
        }
        Ok(OpenHeights::Pages(Box::new(HeightFile::open(path, options.read)?)))
    }

    /// Opens a source or a page file to draw it. x and y that have no unit are taken for degrees where they may be, and would make a needle of
    /// the surface which pictures do not show: that is told, and is among its notes. To know it, all samples of a source that may be such a one are read.
    ///
    /// # Errors
    /// As [`OpenHeights::open`], and where samples cannot be read.
    pub fn for_pictures(path: &Path, options: &HeightOptions) -> Result<(OpenHeights, Option<String>), HeightError> {
        let open = OpenHeights::open(path, options)?;
        if !proportions::may_be_taken(open.grid()) {
            return Ok((open, None));
        }
        if let OpenHeights::Pages(file) = open {
            let range = [file.about().facts.min, file.about().facts.max];
            let Some(note) = proportions::taken(file.grid(), range) else {
                return Ok((OpenHeights::Pages(file), None));
            };
            let (asked, note) = (proportions::note(file.grid(), range), format!("{note}, when it is built"));
            let file = file.in_degrees(asked.as_deref(), note.clone());
            return Ok((OpenHeights::Pages(Box::new(file)), Some(note)));
        }
        let facts = facts_of(&open)?;
        let Some(note) = proportions::taken(open.grid(), [facts.min, facts.max]) else { return Ok((open, None)) };
        let options = HeightOptions { xy_unit: Some(Unit::new("deg")), ..options.clone() };
        let source = open_heights(path, &options)?.noting(note.clone());
        Ok((OpenHeights::Source(Box::new(source)), Some(note)))
    }

    /// Whether all samples were measured, where that is known without reading them.
    pub fn all_valid(&self) -> Option<bool> {
        match self {
            OpenHeights::Source(_) => None,
            OpenHeights::Pages(file) => Some(file.about().facts.valid == file.about().grid.samples()),
        }
    }

    /// How far heights are from the source's at most, in their unit, where a page file's were rounded.
    pub fn height_error(&self) -> Option<f64> {
        match self {
            OpenHeights::Source(_) => None,
            OpenHeights::Pages(file) => file.about().rounded.map(|rounded| rounded.error),
        }
    }

    /// Why lengths and slopes on it may be other than they seem, where heights are between these: it does not say how far samples are apart, or in
    /// which unit.
    pub fn doubts(&self, range: [f64; 2]) -> Vec<String> {
        let has_spacing = match self {
            OpenHeights::Source(source) => source.description().has_spacing,
            OpenHeights::Pages(file) => file.about().has_spacing,
        };
        let apart = (!has_spacing).then(|| NO_SPACING.to_owned());
        apart.into_iter().chain(proportions::note(self.grid(), range)).collect()
    }

    /// What it holds. Of a source all samples are read.
    ///
    /// # Errors
    /// When it cannot be read, or nothing was measured.
    pub fn summary(&self) -> Result<HeightSummary, HeightError> {
        match self {
            OpenHeights::Source(source) => Ok(summarize_heights(source)?),
            OpenHeights::Pages(file) => Ok(summary_of(file)),
        }
    }

    /// Builds the page file of a source; of a page file another one.
    ///
    /// # Errors
    /// [`HeightBuildError`]; nothing is left behind then.
    pub fn build(
        &self,
        options: &HeightBuildOptions,
        output: &Path,
        progress: &dyn Progress,
    ) -> Result<HeightAbout, HeightBuildError> {
        match self {
            OpenHeights::Source(source) => {
                build_heights(&**source, &HeightOrigin::of(source), options, output, progress)
            }
            OpenHeights::Pages(file) => {
                let about = file.about();
                let origin = HeightOrigin {
                    path: about.source.clone(),
                    format: about.format.clone(),
                    bytes: about.source_bytes,
                    has_spacing: about.has_spacing,
                    notes: about.notes.clone(),
                    rounded: about.rounded,
                };
                build_heights(&**file, &origin, options, output, progress)
            }
        }
    }

    fn heights_in(&self) -> &dyn Heights {
        match self {
            OpenHeights::Source(source) => &**source,
            OpenHeights::Pages(file) => &**file,
        }
    }
}

impl Heights for OpenHeights {
    fn grid(&self) -> &HeightGrid {
        self.heights_in().grid()
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.heights_in().stored(window, out)
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.heights_in().plane(plane, window, out)
    }

    fn rows_together(&self) -> u64 {
        self.heights_in().rows_together()
    }
}

/// What a page file's footer says of its field.
fn summary_of(file: &HeightFile) -> HeightSummary {
    let HeightAbout { grid, facts, invalid, notes, format, photo, .. } = file.about();
    let mut summary = HeightSummary::of((file.path(), format, file.bytes()), grid, facts, *invalid, notes.clone());
    summary.planes.extend(photo.iter().map(|photo| PlaneSummary::of_photo(&photo.about, grid)));
    summary
}
