//! What the user says about a source that it does not say, or says wrongly.

use deepfield_data::model::{ReadMethod, Unit};

/// How a source is opened.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightOptions {
    /// Heights are asked for: files that could be images as well are opened as heights.
    pub is_asked: bool,
    /// The stored value that stands for no data, in place of what the source says.
    pub no_data: Option<f64>,
    /// From a column and a row to the next, in place of what the source says.
    pub spacing: Option<[f64; 2]>,
    /// Unit of places, in place of the source's.
    pub xy_unit: Option<Unit>,
    /// Unit of heights, in place of the source's.
    pub height_unit: Option<Unit>,
    /// How files are read.
    pub read: ReadMethod,
}
