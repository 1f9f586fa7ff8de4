//! A field that lies somewhere else than its own world: it is looked at from where the eye is in that world.

use crate::cpu::surface::sight::Sight;
use crate::model::Bounds;
use crate::view::{Cut, Projection, View};
use glam::DVec3;

/// Where a field's world lies in a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPlacement {
    /// Where its origin is, lengths of the scene.
    pub offset: DVec3,
    /// Lengths of the scene for one of its own.
    pub scale: f64,
}

impl FieldPlacement {
    /// Of a field in its own world.
    pub const NONE: FieldPlacement = FieldPlacement { offset: DVec3::ZERO, scale: 1.0 };

    /// A view in the field's own lengths.
    pub fn view(&self, view: &View) -> View {
        if *self == FieldPlacement::NONE {
            return *view;
        }
        let projection = match view.projection {
            Projection::Orthographic { height } => Projection::Orthographic { height: height / self.scale },
            perspective => perspective,
        };
        View { eye: self.inside(view.eye), projection, cut: self.cut(&view.cut), ..*view }
    }

    /// A view of the field's own world in the scene.
    pub fn view_outside(&self, own: &View) -> View {
        let scale = self.scale.recip();
        FieldPlacement { offset: -self.offset * scale, scale }.view(own)
    }

    /// A line of sight in the field's own lengths.
    pub fn sight(&self, sight: &Sight) -> Sight {
        match *sight {
            Sight::Flat(view) => Sight::Flat(self.view(&view)),
            Sight::Around { panorama, eye, cut } => {
                Sight::Around { panorama, eye: self.inside(eye), cut: self.cut(&cut) }
            }
        }
    }

    /// A box of the field's world in the scene.
    pub fn bounds(&self, own: Bounds) -> Bounds {
        Bounds { min: self.outside(own.min), max: self.outside(own.max) }
    }

    /// A place of the field's world in the scene.
    pub fn outside(&self, place: DVec3) -> DVec3 {
        self.offset + self.scale * place
    }

    /// A place of the scene in the field's own world.
    pub fn inside(&self, place: DVec3) -> DVec3 {
        (place - self.offset) / self.scale
    }

    fn cut(&self, cut: &Cut) -> Cut {
        Cut {
            bounds: Bounds { min: self.inside(cut.bounds.min), max: self.inside(cut.bounds.max) },
            fade_start: cut.fade_start / self.scale,
            fade_rate: cut.fade_rate * self.scale,
            ..*cut
        }
    }
}
