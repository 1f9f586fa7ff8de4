//! The text of an asset in RON, with the name by which messages call it.

use crate::model::ron_file::RonError;
use bevy::asset::LoadContext;
use bevy::asset::io::Reader;

/// Reads an asset as text: its path, and what it holds.
///
/// # Errors
/// [`RonError::Io`] when it cannot be read.
pub(super) async fn asset_text(
    reader: &mut dyn Reader,
    load_context: &LoadContext<'_>,
) -> Result<(String, String), RonError> {
    let file = load_context.path().to_string();
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).await.map_err(|source| RonError::Io { file: file.clone(), source })?;
    Ok((file, String::from_utf8_lossy(&bytes).into_owned()))
}
