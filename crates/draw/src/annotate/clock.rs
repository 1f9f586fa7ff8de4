//! The time of a run, in the upper left corner.

use super::TEXT;
use super::display_list::{Anchor, DisplayList};

/// Adds the time in the data's words, below what stands there; nothing for data without times.
pub fn layout(list: &mut DisplayList, time: &str) {
    if !time.is_empty() {
        let _ = [16.0, 40.0].iter().any(|y| list.text_if_free([20.0, *y], Anchor::LEFT_TOP, time, 15.0, TEXT));
    }
}
