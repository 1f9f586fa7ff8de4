//! A flight in modes that draw light, by the processor or by an adapter's passes: both draw the pages that streaming has brought
//! from main memory, and the adapter keeps the nodes that it has drawn.

use super::super::splat::Failure;
use super::canvas::Canvas;
use crate::color::Colors;
use crate::color::transfer::{Range, TransferFunction};
use crate::cpu::volume::{VolumeError, VolumeReport};
use crate::mode::{Depiction, LightPicture, Plan, Raw};
use crate::picture::Subject;
use crate::picture::adapter::{Adapter, AdapterJob, Passes, draw_on};
use crate::store::Tree;
use crate::stream::{CopyOptions, SceneNode};
use crate::view::View;
use crate::view::perspective_grid::GridError;
use std::sync::Arc;

/// Draws colours straight from particles.
pub struct LightCanvas {
    tree: Arc<dyn Tree>,
    depiction: Depiction,
    transfer: TransferFunction,
    /// What draws; the processor where there is none.
    adapter: Option<Box<dyn Adapter>>,
    name: (String, String),
    picture: Option<LightPicture>,
}

impl LightCanvas {
    /// Draws `tree` as `depiction` says. Ranges of colours are those of the first picture, as in a tour.
    pub fn new(tree: Arc<dyn Tree>, depiction: Depiction, adapter: Option<Box<dyn Adapter>>) -> LightCanvas {
        let preset = depiction.mode.transfer[usize::from(depiction.attribute.is_some())];
        let transfer = TransferFunction::preset(preset).unwrap_or_default().for_volume();
        let name = ("cpu".into(), format!("{} threads", rayon::current_num_threads()));
        LightCanvas { tree, depiction, transfer, adapter, name, picture: None }
    }

    fn paint(&mut self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<LightPicture, VolumeError> {
        let LightCanvas { tree, depiction, transfer, adapter, name, .. } = self;
        let metadata = tree.metadata();
        let subject = Subject::new(metadata, depiction, transfer, metadata.bounds().size().length());
        let raw = match adapter {
            Some(adapter) => {
                let passes = Passes::Compute;
                let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
                let (raw, frame) = draw_on(&mut **adapter, &subject, job)?;
                *name = (frame.backend.to_owned(), frame.adapter);
                raw
            }
            None => subject.draw_nodes(view, nodes, plan)?,
        };
        raw.light(depiction.mode)
    }
}

/// A picture of nothing.
fn blank(view: &View) -> LightPicture {
    let rgba = vec![[0.0; 4]; view.width as usize * view.height as usize];
    let colors = Colors { width: view.width, height: view.height, rgba };
    LightPicture {
        colors,
        report: VolumeReport::default(),
        levels: crate::cpu::volume::VolumeLevels { density: [1.0, 2.0], attribute: [0.0, 1.0], unit_length: 1.0 },
        isovalues: Vec::new(),
    }
}

impl Canvas for LightCanvas {
    fn name(&self) -> (String, String) {
        self.name.clone()
    }

    fn copies(&self) -> Option<CopyOptions> {
        None
    }

    fn draw(&mut self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<(), Failure> {
        let painted = match self.paint(view, nodes, plan) {
            // Nothing of what has been read is in view, or nothing is dense enough.
            Err(VolumeError::Grid(GridError::NothingInView) | VolumeError::Setting { field: "threshold", .. }) => {
                self.picture = Some(blank(view));
                return Ok(());
            }
            painted => painted?,
        };
        if self.transfer.range == Range::Auto {
            let [low, high] = painted.levels.density;
            self.transfer.range = Range::Fixed(low, high);
        }
        let [low, high] = painted.levels.attribute;
        if let Some(hue) = self.transfer.hue.as_mut().filter(|hue| hue.range == Range::Auto) {
            hue.range = Range::Fixed(low, high);
        }
        self.picture = Some(painted);
        Ok(())
    }

    fn picture(&mut self) -> Result<Raw, Failure> {
        Ok(Raw::Light(self.picture.clone().ok_or("nothing has been drawn")?))
    }
}
