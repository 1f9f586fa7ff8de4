//! Assets that users write in RON.

use crate::model::ron_file::RonError;
use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetLoadError, AssetLoader, LoadContext};
use bevy::reflect::TypePath;

/// Loads assets of a type from `*.ron` files with a function of the name by which messages call a file, and its text.
#[derive(TypePath)]
pub(super) struct RonAssetLoader<A: Asset>(pub fn(&str, &str) -> Result<A, RonError>);

impl<A: Asset> AssetLoader for RonAssetLoader<A> {
    type Asset = A;
    type Settings = ();
    type Error = RonError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        load_context: &mut LoadContext<'_>,
    ) -> Result<A, RonError> {
        let file = load_context.path().to_string();
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await.map_err(|source| RonError::Io { file: file.clone(), source })?;
        self.0(&file, &String::from_utf8_lossy(&bytes))
    }

    fn extensions(&self) -> &[&str] {
        &["ron"]
    }
}

/// What to say about an asset that cannot be loaded: the loader's own words, which name file, line and column.
pub(super) fn refusal(error: &AssetLoadError) -> String {
    match error {
        AssetLoadError::AssetLoaderError(error) => error.error().to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use bevy::prelude::*;
    use std::time::{Duration, Instant};

    /// Runs frames until a condition holds.
    pub fn wait(app: &mut App, what: &str, condition: impl Fn(&World) -> bool) {
        let start = Instant::now();
        while !condition(app.world()) {
            assert!(start.elapsed() < Duration::from_secs(60), "waited in vain for: {what}");
            app.update();
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
