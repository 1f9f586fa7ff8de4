//! Export of what is drawn as 3D Gaussian splats: clusters or particles in space, in the colours of the transfer function in force.

use super::Session;
use crate::color::colors::to_encoded;
use crate::color::splat_colors::{OwnColumn, SplatColors};
use crate::cpu::{Extent, Splats};
use crate::explore::ExploreError;
use crate::explore::export::gaussian_splats::{GaussianSplat, GaussianSplats};
use crate::look::Shot;
use crate::mode::over::own_column;
use crate::mode::{Footprint, Output};
use crate::model::{Bounds, Covariance, Kernel};
use crate::picture::decode::{batches, decode};
use crate::picture::{PictureError, Subject};
use crate::store::temporary::{self, Temporary};
use crate::store::{Encoding, NodeRef, Page, PageId, Tree};
use crate::stream::SceneNode;
use crate::view::{Projection, Surround, View};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

/// Pages of a thread that are in memory at once.
const AHEAD: usize = 2;
/// Nodes of a selection that are decoded at once.
const NODES: usize = 256;
/// Pixels along the longest side of the data in the view that a number of splats is chosen for: what is smaller hardly counts.
const PIXELS: u32 = 4096;

/// One row of the file.
type Row = [f32; 17];

impl Session {
    /// Writes the splats of a shot's look to the file `out`: those that show most of a view of all the data where its settings say how
    /// many at most, else the finest clusters, or all particles. Particles that no cluster stands for are splats of their own. How many
    /// there are in the file.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read or has no clusters, the mode draws nothing that has an extent in space, or the file
    /// cannot be written; a file that was there before stays as it was.
    pub fn export_gaussian_splats(&mut self, shot: &Shot, out: &Path) -> Result<u64, PictureError> {
        let (_, depiction, transfer) = self.show(&shot.look)?;
        self.check_levels(&depiction, self.tree().metadata())?;
        let is_kernel = depiction.footprint() == Footprint::Kernel;
        if depiction.mode.technique.output() != Output::Sums || !is_kernel {
            let name = depiction.mode.name;
            let why =
                format!("the mode {name} has no splats with an extent in space, expected one such as column-density");
            return Err(PictureError::Asked(why));
        }
        let levels = match transfer.numbers() {
            Some(levels) => levels,
            None => {
                let flat = Shot { surround: Surround::Flat, stereo: None, film: None, ..shot.clone() };
                self.draw(&flat)?.coloration().levels
            }
        };
        // The picture may have changed what is shown.
        let (tree, depiction, transfer) = self.show(&shot.look)?;
        let depiction = depiction.as_over();
        let metadata = tree.metadata();
        let subject =
            Subject { mean_mass: self.mean_mass(&*tree), ..Subject::new(metadata, &depiction, &transfer, 1.0) };
        let bounds = metadata.bounds();
        let writing = Writing {
            subject,
            colors: SplatColors::new(&transfer, levels),
            origin: if bounds.is_empty() { DVec3::ZERO } else { bounds.center() },
        };
        let failed = |source| ExploreError::io(out, "writing", source);
        temporary::clean(out, temporary::folder_of(out));
        let file = Temporary::create(out, None).map_err(failed)?;
        let to = BufWriter::with_capacity(1 << 20, file.file());
        let mut splats = GaussianSplats::new(to, writing.origin, &metadata.length_unit).map_err(failed)?;
        let mut write = |rows: Vec<Row>| splats.write(&rows).map_err(failed).map_err(PictureError::from);
        match depiction.choice.splats {
            Some(_) => {
                let selection = self.select(&depiction, &whole_view(bounds)?, shot.look.error_px())?;
                self.tell_of_memory();
                let progress = self.reporter.progress();
                progress.begin("writing splats", selection.particles);
                for nodes in selection.nodes.chunks(NODES) {
                    let rows = writing.rows(nodes)?;
                    progress.advance(rows.len() as u64);
                    write(rows)?;
                }
            }
            None => self.finest(&*tree, &writing, &mut write)?,
        }
        let count = splats.finish().map_err(failed)?;
        file.persist(out).map_err(failed)?;
        Ok(count)
    }

    /// Hands over the rows of all that nothing finer stands for, page by page, in the order of the pages.
    fn finest(
        &self,
        tree: &dyn Tree,
        writing: &Writing<'_>,
        write: &mut dyn FnMut(Vec<Row>) -> Result<(), PictureError>,
    ) -> Result<(), PictureError> {
        let time = self.scene.time.unwrap_or(0.0);
        let families = &self.scene.families;
        let shown = families.iter().filter_map(|index| tree.metadata().families.get(*index as usize));
        let progress = self.reporter.progress();
        progress.begin("writing splats", shown.map(|family| family.count).fold(0, u64::saturating_add));
        let mut open: BTreeMap<PageId, Vec<u32>> = BTreeMap::new();
        // Every node of a sound file is reached once; a file that was made to harm may lead to one many times.
        let mut seen: HashSet<NodeRef> = HashSet::new();
        for root in tree.roots(families, self.scene.purpose, time) {
            if seen.insert(root) {
                open.entry(root.page).or_default().push(root.node);
            }
        }
        while !open.is_empty() {
            let count = open.len().min(AHEAD * rayon::current_num_threads());
            let wave: Vec<(PageId, Vec<u32>)> = (0..count).filter_map(|_| open.pop_first()).collect();
            let walked: Vec<Result<_, PictureError>> = wave
                .into_par_iter()
                .map(|(id, entries)| {
                    let page = Arc::new(tree.read_page(id)?);
                    let (finest, elsewhere) = walk(&page, entries);
                    let node = |&node: &u32| SceneNode {
                        page: Arc::clone(&page),
                        node: NodeRef { page: id, node },
                        error_pixels: 0.0,
                        offset: DVec3::ZERO,
                        time,
                        part: None,
                    };
                    let nodes: Vec<SceneNode> = finest.iter().map(node).collect();
                    let done = finest.iter().map(|&node| page.nodes[node as usize].source_particles);
                    progress.advance(done.fold(0, u64::saturating_add));
                    Ok((writing.rows(&nodes)?, elsewhere))
                })
                .collect();
            for walked in walked {
                let (rows, elsewhere) = walked?;
                write(rows)?;
                for child in elsewhere.into_iter().filter(|child| seen.insert(*child)) {
                    open.entry(child.page).or_default().push(child.node);
                }
            }
        }
        Ok(())
    }
}

/// The finest nodes of a page below its entries: clusters of leaves, and leaves that have none; and what leads to other pages.
fn walk(page: &Page, entries: Vec<u32>) -> (Vec<u32>, Vec<NodeRef>) {
    let (mut finest, mut elsewhere) = (Vec::new(), Vec::new());
    let mut reached = vec![false; page.nodes.len()];
    let mut stack = entries;
    while let Some(index) = stack.pop() {
        let Some(node) = page.nodes.get(index as usize) else { continue };
        if std::mem::replace(&mut reached[index as usize], true) {
            continue;
        }
        if node.encoding == Encoding::LeafClusters || node.is_leaf() {
            finest.push(index);
            continue;
        }
        for child in page.children(index as usize) {
            match child.page == page.id {
                true => stack.push(child.node),
                false => elsewhere.push(*child),
            }
        }
    }
    finest.sort_unstable();
    (finest, elsewhere)
}

/// A view of all the data, from nowhere nearer than from elsewhere.
fn whole_view(bounds: Bounds) -> Result<View, PictureError> {
    let (middle, longest) = (bounds.center(), bounds.size().max_element());
    // Of a single particle there is a picture, too.
    let side = longest.max(1e-6 * middle.length()).max(1e-30);
    let projection = Projection::Orthographic { height: 1.05 * side };
    Ok(View::look_at(middle + 2.0 * side * DVec3::Z, middle, DVec3::Y, projection, PIXELS, PIXELS)?)
}

/// What is written, and how.
struct Writing<'a> {
    subject: Subject<'a>,
    colors: SplatColors,
    origin: DVec3,
}

impl Writing<'_> {
    /// The rows of nodes, in their order. What has no extent is left out.
    fn rows(&self, nodes: &[SceneNode]) -> Result<Vec<Row>, PictureError> {
        let Subject { metadata, depiction, .. } = self.subject;
        let decoded = decode(depiction, metadata, nodes);
        let batches = batches(depiction, &decoded)?;
        let scale = self.subject.density_scale(&batches);
        let column = own_column(depiction.mode.conserves, metadata.kernel, (self.subject.mean_mass, scale));
        let rows = |batch: &Splats<'_>| -> Vec<Row> {
            (0..batch.len()).filter_map(|index| self.row(batch, index, &column, metadata.kernel)).collect()
        };
        Ok(batches.par_iter().map(rows).collect::<Vec<_>>().concat())
    }

    fn row(&self, batch: &Splats<'_>, index: usize, column: &OwnColumn, kernel: Kernel) -> Option<Row> {
        let covariance = match batch.extent() {
            Extent::Ellipsoids(covariances) => covariances[index],
            Extent::World(lengths) => Covariance::round((f64::from(lengths[index]).powi(2) * kernel.variance()) as f32),
            Extent::Pixels(_) => return None,
        };
        let weight = f64::from(batch.weight()[index]);
        let density = batch.density().map(|densities| densities[index]);
        let column = column.of(weight, density, covariance.mean_radius());
        let light = self.colors.light(column, batch.attribute().map(|attribute| attribute[index]));
        let place = batch.positions().world(index) - self.origin;
        let splat = GaussianSplat { place, color: light.map(to_encoded), weight, covariance };
        (weight > 0.0).then(|| splat.row(self.colors.depth())).flatten()
    }
}

#[cfg(test)]
mod tests;
