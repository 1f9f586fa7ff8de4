//! What is asked, of the JSON that comes from Python.

use crate::error::Failure;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, from_str, from_value};

/// What a text says.
///
/// # Errors
/// With the name of what cannot be read: the place in a text that nobody wrote would tell nothing.
pub fn read_asked<T: DeserializeOwned>(text: &str) -> Result<T, Failure> {
    let error = match from_str::<T>(text) {
        Ok(asked) => return Ok(asked),
        Err(error) => error,
    };
    let said: Map<String, Value> = from_str(text)?;
    let error = from_value::<T>(Value::Object(said.clone())).err().unwrap_or(error);
    // It is the one without which all else is read.
    let wrong = said.keys().find(|name| {
        let mut rest = said.clone();
        rest.remove(name.as_str());
        from_value::<T>(Value::Object(rest)).is_ok()
    });
    Err(wrong.map_or_else(|| error.to_string(), |name| format!("{name}: {error}")).into())
}
