//! What views show of particles, where a picture is put together of several: one automatic range is found by what all of them show together.

use crate::cpu::volume::range::Histogram;

/// What automatic ranges are found by, in one view or in several.
pub enum InView {
    /// How much has which values, of each column that is resampled to a volume.
    Columns(Vec<Histogram>),
    /// Values in pixels, and those that colour them.
    Pixels([Vec<f32>; 2]),
}

impl InView {
    /// Adds what another view shows of the same.
    pub fn add(&mut self, other: InView) {
        match (self, other) {
            (InView::Columns(all), InView::Columns(more)) => {
                all.iter_mut().zip(&more).for_each(|(all, more)| all.add_all(more));
            }
            (InView::Pixels(all), InView::Pixels(more)) => {
                all.iter_mut().zip(more).for_each(|(all, more)| all.extend(more));
            }
            // A technique tells one of them.
            (InView::Columns(_), InView::Pixels(_)) | (InView::Pixels(_), InView::Columns(_)) => {}
        }
    }
}
