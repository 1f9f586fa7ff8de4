//! What draws the views of a picture of a field: the processor, or an adapter that is asked for or faster.

use super::session::PreparedField;
use crate::cpu::Counts;
use crate::cpu::volume::VolumeError;
use crate::look::Backend;
use crate::mode::{FieldMarch, FieldPasses, LightPicture, Raw};
use crate::picture::adapter::{Adapter, AdapterField, AdapterFrame, AdapterValues, draws_fields};
use crate::picture::session::Reporter;
use crate::view::View;
use std::collections::BTreeMap;

/// What may draw beside the processor, and what has been told of it.
#[derive(Default)]
pub(super) struct Painter {
    pub adapter: Option<Box<dyn Adapter>>,
    told: Vec<String>,
}

/// Draws the views of one picture.
pub(super) struct Painting<'a> {
    prepared: &'a PreparedField,
    /// The adapter, as long as it is what draws.
    adapter: Option<&'a mut (dyn Adapter + 'static)>,
    /// Whether nothing but the adapter may draw.
    is_asked: bool,
    told: &'a mut Vec<String>,
    reporter: &'a dyn Reporter,
    /// Backend and adapter that drew.
    pub drawn_by: [String; 2],
    /// Median of each of the adapter's passes in the last view, milliseconds.
    pub milliseconds: BTreeMap<String, f64>,
}

impl<'a> Painting<'a> {
    /// Draws views of a field for somebody who asks for `backend`.
    ///
    /// # Errors
    /// What draws the mode, where the backend that is asked for does not.
    pub fn new(
        painter: &'a mut Painter,
        prepared: &'a PreparedField,
        backend: Option<Backend>,
        reporter: &'a dyn Reporter,
    ) -> Result<Painting<'a>, String> {
        let Painter { adapter, told } = painter;
        let mode = prepared.mode();
        let draws = draws_fields(mode, prepared.settings(), backend, adapter.as_deref_mut())?;
        let mut painting = Painting {
            prepared,
            adapter: adapter.as_deref_mut().filter(|_| draws),
            is_asked: backend.is_some(),
            told,
            reporter,
            drawn_by: ["cpu", "cpu"].map(str::to_owned),
            milliseconds: BTreeMap::new(),
        };
        if !draws && matches!(backend, Some(Backend::Compute | Backend::Raster)) {
            painting.tell(format!("--backend: the processor draws the mode {} of images and volumes", mode.name));
        }
        Ok(painting)
    }

    /// Draws a view.
    ///
    /// # Errors
    /// As [`PreparedField::draw`], and [`VolumeError::Device`] where an adapter that was asked for cannot draw.
    pub fn draw(&mut self, view: &View) -> Result<Raw, VolumeError> {
        match self.draw_on_adapter(view, 1)? {
            Some(drawn) => Ok(drawn),
            None => self.prepared.draw(view),
        }
    }

    /// Draws a view on the adapter, as often as said; `None` where the processor is to draw it.
    ///
    /// # Errors
    /// As [`Painting::draw`].
    pub fn draw_on_adapter(&mut self, view: &View, repeat: u32) -> Result<Option<Raw>, VolumeError> {
        let Some(adapter) = self.adapter.as_deref_mut() else { return Ok(None) };
        match draw_on(adapter, self.prepared, view, repeat) {
            Ok(Some((drawn, frame))) => {
                self.drawn_by = [frame.backend.to_owned(), frame.adapter];
                self.milliseconds = frame.milliseconds;
                frame.note.into_iter().for_each(|note| self.tell(note));
                return Ok(Some(drawn));
            }
            Ok(None) => {}
            Err(VolumeError::Device(error)) if !self.is_asked => {
                self.tell(format!("{error}; drawing with the CPU instead"));
            }
            Err(error) => return Err(error),
        }
        self.adapter = None;
        Ok(None)
    }

    /// Tells something once.
    fn tell(&mut self, message: String) {
        if !self.told.contains(&message) {
            self.reporter.tell(message.clone());
            self.told.push(message);
        }
    }
}

/// Has an adapter draw a view; `None` where its passes do not draw the mode.
fn draw_on(
    adapter: &mut dyn Adapter,
    prepared: &PreparedField,
    view: &View,
    repeat: u32,
) -> Result<Option<(Raw, AdapterFrame)>, VolumeError> {
    let Some(passes) = prepared.passes(view)? else { return Ok(None) };
    let job = AdapterField { view, field: &prepared.field, hue: prepared.hue_channel(), passes: &passes, repeat };
    let mut frame = adapter.field(&job)?;
    let values = std::mem::replace(&mut frame.values, AdapterValues::Sums(Default::default()));
    match (passes, values) {
        (FieldPasses::March(march), AdapterValues::Light(colors, report)) => {
            let FieldMarch { levels, isovalues, .. } = *march;
            Ok(Some((Raw::Light(LightPicture { colors, report, levels, isovalues }), frame)))
        }
        (FieldPasses::Integrals, AdapterValues::Sums(sums)) => Ok(Some((Raw::Sums(sums, Counts::default()), frame))),
        _ => Err(VolumeError::Device(format!("the adapter does not draw {}", prepared.mode().name))),
    }
}
