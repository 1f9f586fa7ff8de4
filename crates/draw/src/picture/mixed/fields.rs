//! The images and volumes of a scene of several kinds of data, as the rest is drawn among them: each in its own mode, in parts from front to back.

use crate::cpu::paths::PathFragments;
use crate::picture::field::PreparedField;
use crate::picture::ground::Ground;
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
}

impl Ground for FieldsAmong {
    fn fragments(&self, view: &View) -> PathFragments {
        let mut all = PathFragments::nothing(view);
        for (number, Lying { prepared, placement }) in self.fields.iter().enumerate() {
            let mut own = match prepared.parts(&placement.view(view)) {
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
