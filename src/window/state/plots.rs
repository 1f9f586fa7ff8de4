//! What the panel of plots is to show.

use crate::explore::PlotSettings;
use bevy::prelude::*;

/// The plot that is chosen, as scenes keep it.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct PlotChoice(pub PlotSettings);
