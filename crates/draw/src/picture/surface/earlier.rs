//! The earlier field that a field is compared with: where its samples are, and how large changes since are.

use super::opened::OpenSurface;
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::since::Since;
use crate::cpu::surface::source::SurfaceNodes;
use crate::heights::hierarchy::chunks::ChunkKey;
use crate::heights::measure::Alignment;
use crate::heights::store::HeightFile;
use crate::picture::PictureError;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;

/// Most samples that the range of changes is taken from: of larger fields those of the finest level that has no more.
const MOST: u64 = 1 << 22;
/// Memory for chunks of either field while that is done, bytes.
const MEMORY: u64 = 32 << 20;
/// Changes are coloured up to so many times the root of their mean square.
const OUTLIERS: f64 = 3.0;

/// An earlier field, open.
pub struct Earlier {
    file: Arc<HeightFile>,
    alignment: Alignment,
    /// The largest change that colours are spread over, in the unit of the later field's heights.
    pub(super) most: f64,
    /// Where its page file lies as long as anybody may read it.
    _folder: Option<TempDir>,
}

impl Earlier {
    /// What changes are counted from, of whose decoded chunks so many bytes are kept.
    pub(super) fn since(&self, budget_bytes: u64) -> Arc<Since> {
        Arc::new(Since::new(Arc::clone(&self.file), self.alignment, budget_bytes))
    }
}

impl OpenSurface {
    /// The same, compared with an earlier field that a user calls `path`, whose page file may lie in a folder that goes with it.
    ///
    /// # Errors
    /// Where units or reference systems of both do not fit, they have nothing in common, or cannot be read.
    pub fn since(
        mut self,
        path: &Path,
        file: HeightFile,
        folder: Option<TempDir>,
    ) -> Result<OpenSurface, PictureError> {
        let names = [self.path(), path].map(|path| path.display().to_string());
        let alignment = Alignment::new([&names[0], &names[1]], &self.file().about().grid, &file.about().grid);
        let alignment = alignment.map_err(|error| PictureError::Asked(error.to_string()))?;
        let mut earlier = Earlier { file: Arc::new(file), alignment, most: 0.0, _folder: folder };
        earlier.most = most(self.file(), &earlier).map_err(PictureError::Asked)?;
        self.earlier = Some(earlier);
        Ok(self)
    }

    /// The field that it is compared with.
    pub fn earlier(&self) -> Option<&Earlier> {
        self.earlier.as_ref()
    }
}

/// The largest change that colours are spread over: a few that are far off do not hide all others.
fn most(later: &Arc<HeightFile>, earlier: &Earlier) -> Result<f64, String> {
    let mut nodes = PagedSurface::new(Arc::clone(later), MEMORY);
    nodes.compare(Some(&earlier.since(MEMORY)));
    let lattice = nodes.lattice();
    let samples = |level: u8| lattice.samples_of(level.into()).iter().product::<u64>();
    let level = (0..lattice.top()).find(|level| samples(*level) <= MOST).unwrap_or(lattice.top());
    let [rows, columns] = lattice.chunks_of(level.into());
    let keys: Vec<ChunkKey> =
        (0..rows).flat_map(|row| (0..columns).map(move |column| ChunkKey { level, row, column })).collect();
    let each = keys.par_iter().map(|key| {
        let samples = nodes.samples(*key);
        let changes = samples.iter().flat_map(|samples| &samples.changes).filter(|change| !change.is_nan());
        changes.fold((0.0_f64, 0.0, 0_u64), |(most, sum, count), change| {
            let change = f64::from(*change);
            (most.max(change.abs()), sum + change * change, count + 1)
        })
    });
    let each: Vec<(f64, f64, u64)> = each.collect();
    if let Some(error) = nodes.error() {
        return Err(error);
    }
    let (most, sum, count) = each.into_iter().fold((0.0_f64, 0.0, 0), |a, b| (a.0.max(b.0), a.1 + b.1, a.2 + b.2));
    Ok(most.min(OUTLIERS * (sum / count.max(1) as f64).sqrt()))
}
