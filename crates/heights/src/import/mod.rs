//! From a file of heights to its samples: one file a format and a line in [`FORMATS`]. Nothing outside this room knows a format.
//!
//! [`open_heights`] gives a [`HeightSource`], whose samples are read in windows; [`summarize_heights`] what `info` prints.

mod content;
mod options;
mod raw;
mod source;
mod summary;

pub use options::HeightOptions;
pub use source::{HeightDescription, HeightSource, NoData, Samples};
pub use summary::{HeightSummary, summarize_heights};

use content::Content;
use deepfield_data::import::ImportError;
use std::path::Path;

/// A format of height fields.
struct HeightFormat {
    /// Its name in messages.
    name: &'static str,
    /// How its files usually end, without the dot.
    extensions: &'static [&'static str],
    /// Whether nothing but heights is written in it, so that it is told from images and tables by its content alone. What is not is opened as heights
    /// where that is asked for, or where what it holds can be nothing else.
    is_sure: bool,
    /// Whether a file claims to be of this format. Damaged files may be recognised; opening them finds the damage.
    detect: fn(&Content) -> bool,
    /// Opens a file that was recognised.
    open: fn(&Content) -> Result<HeightSource, ImportError>,
}
