//! What splats look like in a picture and how they come together: settings of any picture of sums and of no mode.

use super::{Setting, SettingKind, Settings};
use crate::cpu::Sprite;
use crate::cpu::over::Order;

/// What a splat looks like.
pub static FOOTPRINT: Setting = Setting {
    name: "footprint",
    unit: "",
    kind: SettingKind::Choice { options: &["kernel", "gaussian", "disc", "pixel"] },
    help: "what a splat looks like: its kernel, or as wide a Gaussian, disc or a single pixel as in HE03 (these: by the processor, in files)",
};

/// Whether splats are added or lie over each other.
pub static BLEND: Setting = Setting {
    name: "blend",
    unit: "",
    kind: SettingKind::Choice { options: &["add", "over"] },
    help: "splats are added up, or lie over each other, each with its own colour and opacity",
};

/// In which order they lie over each other.
pub static ORDER: Setting = Setting {
    name: "order",
    unit: "",
    kind: SettingKind::Choice { options: &["exact", "buckets", "coarse-buckets", "none"] },
    help: "order of splats that lie over each other: by distance, in fine or coarse buckets of distance as in HE03, or as they are stored",
};

/// Whether a setting says how splats come together.
fn is_of_blending(name: &str) -> bool {
    [&BLEND, &ORDER].iter().any(|setting| setting.name == name)
}

impl Settings {
    /// What a splat looks like.
    pub fn sprite(&self) -> Sprite {
        let name = self.name(&FOOTPRINT);
        Sprite::ALL.into_iter().find(|sprite| sprite.name() == name).unwrap_or_default()
    }

    /// The order in which splats lie over each other; `None` where they are added.
    pub fn blend_order(&self) -> Option<Order> {
        let name = self.name(&ORDER);
        let order = Order::ALL.into_iter().find(|order| order.name() == name).unwrap_or_default();
        (self.name(&BLEND) == "over").then_some(order)
    }

    /// Those alone that say how splats come together.
    pub fn blending(&self) -> Settings {
        self.filtered(is_of_blending)
    }

    /// All others.
    pub fn without_blending(&self) -> Settings {
        self.filtered(|name| !is_of_blending(name))
    }
}
