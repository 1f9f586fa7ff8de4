//! The images and volumes of a scene of several kinds of data, as the rest is drawn among them: each in its own mode, in parts from front to back.

use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Lighting, Others, nearest};
use crate::picture::field::PreparedField;
use crate::picture::placement::FieldPlacement;
use crate::view::View;
use std::sync::{Mutex, PoisonError};

/// An image or a volume that is drawn.
pub(super) struct Lying {
    pub prepared: PreparedField,
    pub placement: FieldPlacement,
}

/// The images and volumes of a picture.
pub(super) struct FieldsAmong {
    fields: Vec<Lying>,
    error: Mutex<Option<String>>,
}

impl FieldsAmong {
    /// Each as it is prepared and placed.
    pub fn new(fields: Vec<Lying>) -> FieldsAmong {
        FieldsAmong { fields, error: Mutex::default() }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Why one could not be drawn.
    pub fn error(&self) -> Option<String> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether the surfaces of any are darkened.
    pub fn are_darkened(&self) -> bool {
        self.fields.iter().any(|field| field.prepared.is_darkened())
    }

    /// The depths from anywhere of the surfaces in a view's picture, but those of one field; `None` where there are none.
    pub fn opaque(&self, from: &View, view: &View, but: Option<usize>) -> Option<Vec<f32>> {
        let others = self.fields.iter().enumerate().filter(|(number, _)| Some(*number) != but);
        let each = others.map(|(_, Lying { prepared, placement })| {
            let mut depths = prepared.opaque(&placement.view(from), &placement.view(view))?;
            depths.iter_mut().for_each(|depth| *depth = (f64::from(*depth) * placement.scale) as f32);
            Some(depths)
        });
        each.fold(None, nearest)
    }

    /// What each pixel of a view shows of them, from front to back.
    pub fn fragments(&self, view: &View, lighting: &Lighting<'_>) -> PathFragments {
        let mut all = PathFragments::nothing(view);
        for (number, Lying { prepared, placement }) in self.fields.iter().enumerate() {
            // A field is lit in its own lengths.
            let inside = placement.view(view);
            let casters = |from: &View| {
                let from = if *from == inside { *view } else { placement.view_outside(from) };
                let beside = lighting.others.and_then(|others| (others.casters)(&from));
                let mut depths = nearest(self.opaque(&from, view, Some(number)), beside)?;
                depths.iter_mut().for_each(|depth| *depth = (f64::from(*depth) / placement.scale) as f32);
                Some(depths)
            };
            let others = lighting.others.map(|others| Others {
                casters: &casters,
                scene: others.scene / placement.scale,
                sun: others.sun,
            });
            let mut own = match prepared.parts(&inside, &Lighting { others, ..*lighting }) {
                Ok(own) => own,
                Err(error) => {
                    self.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error.to_string());
                    continue;
                }
            };
            own.scale_depths(placement.scale);
            all = if number == 0 { own } else { all.merged(&own) };
        }
        all
    }
}
