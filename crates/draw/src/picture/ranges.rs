//! The ranges of a look's colours, found without the picture itself: a tour finds them in advance, and so they are the same for a
//! window and for a recording of any size.

use super::account::Task;
use super::error::PictureError;
use super::projected::Projector;
use super::session::Session;
use super::subject::Subject;
use crate::color::transfer::{Levels, TransferFunction};
use crate::look::{Camera, LookPatch};
use crate::mode::{Footprint, Mode};
use crate::view::Surround;

/// Pixels along the shorter side of a picture that ranges are found from, at most: they hardly depend on it.
const SIDE: u32 = 540;

/// How large pictures are, and which directions they show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// How directions become a picture.
    pub surround: Surround,
}

/// What was found from a picture.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The mode that drew it.
    pub mode: &'static Mode,
    /// The attribute that coloured it.
    pub attribute: Option<String>,
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// Its ranges.
    pub levels: Levels,
}

impl Format {
    /// The size of pictures that ranges are found from. Discs of a fixed number of pixels cover another share of a smaller
    /// picture, and are brighter in it, so that these need pictures as large as those that are shown.
    pub(super) fn measured_size(self, footprint: Footprint) -> (u32, u32) {
        let (width, height) = self.size;
        let shrink = match footprint {
            Footprint::Pixels(_) => 1.0,
            Footprint::Kernel => (f64::from(SIDE) / f64::from(width.min(height).max(1))).min(1.0),
        };
        let side = |pixels: u32| ((f64::from(pixels) * shrink).round() as u32).max(1);
        (side(width), side(height))
    }
}

impl Session {
    /// What is known of a look's picture from a camera: its ranges. Pages that cannot be read are told and left out.
    ///
    /// # Errors
    /// As [`Session::draw`].
    pub fn ranges(&mut self, look: &LookPatch, camera: &Camera, format: Format) -> Result<Measured, PictureError> {
        let (tree, depiction, transfer) = self.show(look)?;
        self.share_memory(Task::of(&depiction.blended(), format.size, !format.surround.is_flat()));
        let metadata = tree.metadata();
        let (width, height) = format.measured_size(depiction.footprint());
        let middle = if format.surround.is_flat() { camera.target } else { camera.eye };
        let cut = look.cut.unwrap_or_default();
        let view = cut.applied(&camera.view(width, height)?, middle.into(), metadata.periodic_box());
        let tau = look.error_px();
        // Ranges have nothing to do with diameters.
        let subject = Subject::new(metadata, &depiction, &transfer, 1.0);
        let levels = match format.surround.is_flat() {
            true => {
                let lod_budget = look.budget.file_budget();
                match self.listing(&subject, &view, tau, false)? {
                    Some(listing) => {
                        let plan = self.plan_listed(&subject, &view, &lod_budget, &listing)?;
                        transfer.levels(&self.sums_of_listed(&subject, &view, &listing, &plan)?)
                    }
                    None => match self.levels_in_slabs(&subject, &view, tau)? {
                        Some(levels) => levels,
                        None => {
                            let selection = self.select(&depiction, &view, tau)?;
                            let plan = subject.plan(&view, &selection.nodes, &lod_budget, None)?;
                            subject.levels_of_nodes(&view, &selection.nodes, &plan)?
                        }
                    },
                }
            }
            false => {
                let projector = Projector::new(view, format.surround, None)?;
                projector.levels(&mut self.means(), &subject, tau)?
            }
        };
        self.note_memory(true);
        self.tell_of_memory();
        let attribute = depiction.attribute.map(|coloring| coloring.name);
        Ok(Measured { mode: depiction.mode, attribute, transfer, levels })
    }
}
