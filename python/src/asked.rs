//! What is asked, of the JSON that comes from Python.

use crate::error::Failure;
use deepfield_draw::look::of_json;
use serde::de::DeserializeOwned;
use serde_json::from_str;

/// What a text says.
///
/// # Errors
/// With the names that lead to what cannot be read: the place in a text that nobody wrote would tell nothing.
pub fn read_asked<T: DeserializeOwned>(text: &str) -> Result<T, Failure> {
    Ok(of_json(&from_str(text)?)?)
}
