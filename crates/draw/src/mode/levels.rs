//! Which levels of a hierarchy a picture is drawn from, and within how many splats: settings of any picture of sums and of no mode. All but
//! those of an error that is known of sums alone are settings of other pictures that clusters are drawn in, too.

use super::blend::FOOTPRINT;
use super::{Setting, SettingKind, Settings};
use crate::cpu::Sprite;
use crate::cpu::over::Order;
use crate::store::Representative;

/// The kinds of levels.
pub static LEVELS: Setting = Setting {
    name: "levels",
    unit: "",
    kind: SettingKind::Choice { options: &["auto", "splats", "clusters"] },
    help: "merged particles within the error on the screen (splats), or clusters with a shape; auto: clusters where a budget binds",
};

/// The largest number of splats.
pub static SPLATS: Setting = Setting {
    name: "splats",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e12, default: 0.0 },
    help: "splats that are drawn at most, those that show most; 0: as many as the error on the screen asks for",
};

/// The estimated error of the picture.
pub static ERROR_PICTURE: Setting = Setting {
    name: "error-picture",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 2.0, default: 0.0 },
    help: "relative L1 error of the sums up to which clusters are refined, as it is estimated; 0: as the error on the screen asks for",
};

/// The time that drawing may take.
pub static FRAME_MS: Setting = Setting {
    name: "frame-ms",
    unit: "ms",
    kind: SettingKind::Number { min: 0.0, max: 1e7, default: 0.0 },
    help: "milliseconds that drawing may take on this machine: as many clusters as that leaves time for; 0: no limit",
};

/// What a cluster is drawn as.
pub static REPRESENTATIVE: Setting = Setting {
    name: "representative",
    unit: "",
    kind: SettingKind::Choice { options: &["ellipsoid", "round", "published"] },
    help: "what a cluster is drawn as: an ellipsoid with its second moments, a ball of equal spread, or one as in HE03 (--split distortion)",
};

/// Those of pictures that are no sums.
pub static OF_ANY: [&Setting; 4] = [&LEVELS, &SPLATS, &FRAME_MS, &REPRESENTATIVE];

/// Those of pictures of images and volumes alone.
pub static OF_FIELDS: [&Setting; 2] = [&SPLATS, &FRAME_MS];

/// Whether a setting says which levels are drawn, and how many splats.
pub fn is_of_levels(name: &str) -> bool {
    [&LEVELS, &SPLATS, &REPRESENTATIVE].iter().any(|setting| setting.name == name)
}

/// Whether a setting is of pictures that are written to files alone: the window keeps to its own time, and draws kernels.
pub fn is_of_pictures(name: &str) -> bool {
    [&ERROR_PICTURE, &FRAME_MS, &FOOTPRINT].iter().any(|setting| setting.name == name)
}

/// Whether a setting is a limit, which there is none of where it is 0.
pub fn is_limit(name: &str) -> bool {
    [&SPLATS, &ERROR_PICTURE, &FRAME_MS].iter().any(|setting| setting.name == name)
}

/// Which levels a picture is drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Levels {
    /// Clusters where the file has them and a budget is set, else merged particles.
    #[default]
    Auto,
    /// Merged particles.
    Splats,
    /// Clusters.
    Clusters,
}

/// What the settings come to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelChoice {
    /// See [`LEVELS`].
    pub levels: Levels,
    /// See [`SPLATS`].
    pub splats: Option<u64>,
    /// See [`ERROR_PICTURE`].
    pub error_picture: Option<f64>,
    /// See [`FRAME_MS`].
    pub frame_ms: Option<f64>,
    /// See [`REPRESENTATIVE`].
    pub representative: Representative,
    /// What a splat looks like ([`FOOTPRINT`]).
    pub sprite: Sprite,
    /// The order in which splats lie over each other; `None` where they are added ([`super::blend`]).
    pub order: Option<Order>,
}

impl LevelChoice {
    /// The same for a window, which keeps to its own time and draws kernels, whatever files are drawn with.
    pub fn of_window(self) -> LevelChoice {
        LevelChoice { error_picture: None, frame_ms: None, sprite: Sprite::Kernel, ..self }
    }

    /// Whether it is within a budget of splats or of time, or up to an error of the picture.
    pub fn is_bounded(&self) -> bool {
        self.splats.is_some() || self.error_picture.is_some() || self.frame_ms.is_some()
    }
}

impl Settings {
    /// Which levels a picture is drawn from.
    pub fn level_choice(&self) -> LevelChoice {
        let set = |setting| Some(self.number(setting)).filter(|number| *number > 0.0);
        LevelChoice {
            levels: match &*self.name(&LEVELS) {
                "splats" => Levels::Splats,
                "clusters" => Levels::Clusters,
                _ => Levels::Auto,
            },
            // At most 1e12.
            splats: set(&SPLATS).map(|splats| splats.max(1.0) as u64),
            error_picture: set(&ERROR_PICTURE),
            frame_ms: set(&FRAME_MS),
            representative: match &*self.name(&REPRESENTATIVE) {
                "round" => Representative::Round,
                "published" => Representative::Published,
                _ => Representative::Ellipsoid,
            },
            sprite: self.sprite(),
            order: self.blend_order(),
        }
    }
}
