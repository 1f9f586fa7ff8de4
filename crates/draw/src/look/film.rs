//! What a picture of a recorded tour has beyond a scene: words and pictures over it, and the picture that it is blended with.

use super::SceneFile;
use crate::annotate::overlay::Overlay;
use serde::{Deserialize, Serialize};

/// What is done to the finished picture of a scene, in this order: blended, then laid over. The window leaves it out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Film {
    /// A scene of the same data whose picture is mixed with this one's, in display space.
    pub from: Option<Box<SceneFile>>,
    /// How much of this scene's picture is seen, from 0 to 1.
    pub share: f32,
    /// Words and pictures over it; relative paths are from the scene file's folder.
    pub overlay: Overlay,
}
