//! How tracks are built.

use super::FlowOptions;
use crate::store::run::Tangents;
use serde::{Deserialize, Serialize};

/// How particles of one step are found again at the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Matching {
    /// By ids; without ids by their order, where velocities bear that out.
    #[default]
    Auto,
    /// By ids.
    Ids,
    /// By their order in the sources.
    Order,
    /// Not at all: each step's particles fade away while those of the next come.
    None,
}

impl std::str::FromStr for Matching {
    type Err = String;

    fn from_str(text: &str) -> Result<Matching, String> {
        match text {
            "auto" => Ok(Matching::Auto),
            "ids" => Ok(Matching::Ids),
            "order" => Ok(Matching::Order),
            "none" => Ok(Matching::None),
            _ => Err("expected auto, ids, order or none".into()),
        }
    }
}

/// How the tracks of a run are built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackOptions {
    /// How particles are found again.
    pub matching: Matching,
    /// Where tangents come from; `None`: velocities where there are some that displacements bear out.
    pub tangents: Option<Tangents>,
    /// Which flow levels there are.
    pub flow: FlowOptions,
    /// Whether the steps' stills are left out, so that pictures of steps are drawn from tracks, too.
    pub no_stills: bool,
}
