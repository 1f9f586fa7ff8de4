//! What a picture may leave undrawn: settings of any picture of sums and of no mode, and what they come to for one picture.
//!
//! - Culling: particles that no pixel sees cost nothing.
//! - Presence acceleration (F12 4.7.3, 4.9.2): a particle whose brightest pixel stays below `P_min / n` is dropped. Light is
//!   lost.
//! - Thinning: of the particles of a node a stratified sample is drawn ([`crate::mode::sample`]), what is kept counting
//!   for what is not, so that no light is lost on average. A particle is kept with probability
//!   `min(1, c (m / m_mean) (h in pixels)^(3/4))`: small splats disturb few pixels, and one that stands for many source
//!   particles is worth as much as they. `c` follows from a budget for the colour error; see
//!   [`crate::picture::subject::Subject::plan`].

use super::blend::{BLEND, FOOTPRINT, ORDER};
use super::levels::{ERROR_PICTURE, FRAME_MS, LEVELS, REPRESENTATIVE, SPLATS};
use super::{Conserved, Depiction, Footprint, Output, Setting, SettingError, SettingKind, SettingValue, Settings};
use crate::mode::sample::Sample;
use crate::model::Bounds;
use crate::store::{FamilyMetadata, Node};
use crate::view::{Projection, View};

/// Whether particles outside the view are dropped one by one.
pub static CULLING: Setting = Setting {
    name: "culling",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "particles outside the view are dropped one by one; off only to measure what that saves",
};

/// The `n` of presence acceleration.
pub static PRESENCE: Setting = Setting {
    name: "presence",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e9, default: 0.0 },
    help: "n: particles fainter than 1/n of the darkest colour's P are dropped, with their light; 0: none",
};

/// The budget of thinning.
pub static THINNING: Setting = Setting {
    name: "thinning",
    unit: "of 255",
    kind: SettingKind::Number { min: 0.0, max: 32.0, default: 1.0 },
    help: "mean colour error that drawing a weighted sample of the particles may cause; 0: all are drawn (as in files unless set)",
};

/// What any picture of sums may leave undrawn.
pub static COMMON: [&Setting; 11] = [
    &CULLING,
    &PRESENCE,
    &THINNING,
    &LEVELS,
    &SPLATS,
    &ERROR_PICTURE,
    &FRAME_MS,
    &REPRESENTATIVE,
    &FOOTPRINT,
    &BLEND,
    &ORDER,
];

/// Whether a setting is one of [`COMMON`].
pub fn is_common(name: &str) -> bool {
    COMMON.iter().any(|setting| setting.name == name)
}

/// What a picture may leave undrawn, as the user has set it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodBudget {
    /// See [`CULLING`].
    pub culling: bool,
    /// See [`PRESENCE`].
    pub presence: f64,
    /// See [`THINNING`].
    pub thinning: f64,
}

impl LodBudget {
    /// Nothing that is seen is left out.
    pub const NONE: LodBudget = LodBudget { culling: true, presence: 0.0, thinning: 0.0 };

    /// Whether it needs to know the picture's range of `P`.
    pub fn needs_levels(&self) -> bool {
        self.presence > 0.0 || self.thinning > 0.0
    }
}

impl Settings {
    /// What the window's picture may leave undrawn.
    pub fn lod_budget(&self) -> LodBudget {
        LodBudget {
            culling: self.number(&CULLING) != 0.0,
            presence: self.number(&PRESENCE),
            thinning: self.number(&THINNING),
        }
    }

    /// What a picture that goes into a file may leave undrawn: nothing that is seen, unless it was set.
    pub fn file_budget(&self) -> LodBudget {
        let set = |setting: &Setting| self.0.contains_key(setting.name);
        let lod_budget = self.lod_budget();
        LodBudget {
            presence: if set(&PRESENCE) { lod_budget.presence } else { 0.0 },
            thinning: if set(&THINNING) { lod_budget.thinning } else { 0.0 },
            ..lod_budget
        }
    }

    /// Whether these are all of [`COMMON`], with values that they take.
    ///
    /// # Errors
    /// [`SettingError`] for the first that is not.
    pub fn check_common(&self) -> Result<(), SettingError> {
        self.check_against("what may be left undrawn", COMMON.into_iter())
    }

    /// Sets one.
    pub fn set(&mut self, setting: &Setting, value: SettingValue) {
        self.0.insert(setting.name.to_owned(), value);
    }

    /// Those of [`COMMON`], as files have had them among the settings of a mode.
    pub fn common(&self) -> Settings {
        self.filtered(is_common)
    }
}

/// What one picture leaves undrawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Whether particles outside the view are dropped one by one.
    pub culling: bool,
    /// Particles that add less than this to every pixel are dropped; 0: none.
    pub faintest: f32,
    /// The `c` of thinning; infinite: all particles are drawn.
    pub keep: f32,
    /// Below 1: this share of the particles of every node is drawn instead, each as likely as any other; see
    /// [`crate::picture::drawing_cost`].
    pub share: f32,
}

impl Default for Plan {
    fn default() -> Plan {
        Plan { culling: true, faintest: 0.0, keep: f32::INFINITY, share: 1.0 }
    }
}

impl Plan {
    /// Whether every particle in view is drawn.
    pub fn is_complete(&self) -> bool {
        self.faintest <= 0.0 && !self.samples()
    }

    /// Whether of some nodes a sample is drawn.
    pub fn samples(&self) -> bool {
        self.keep < f32::INFINITY || self.share < 1.0
    }

    /// The particles of `node` that are drawn in `view`; `most_important` is that of its codebook's table.
    pub fn sample(
        &self,
        view: &View,
        depiction: &Depiction,
        family: &FamilyMetadata,
        node: &Node,
        most_important: f32,
    ) -> Sample {
        if self.share < 1.0 {
            return Sample::even(node.seed, self.share);
        }
        match (self.keep < f32::INFINITY).then(|| sampling_scale(view, depiction, family, node)).flatten() {
            Some(scale) => Sample::new(node.seed, (f64::from(self.keep) * scale) as f32, most_important),
            None => Sample::ALL,
        }
    }
}

/// The factor on `c` and a particle's importance that gives its probability, `(h in pixels)^(3/4) / h^(3/4) / m_mean`; none
/// where all particles of `node` are drawn whatever `c` is.
fn sampling_scale(view: &View, depiction: &Depiction, family: &FamilyMetadata, node: &Node) -> Option<f64> {
    let mean = family.mass / family.count.max(1) as f64;
    if !(can_thin(depiction) && mean > 0.0 && mean.is_finite()) {
        return None;
    }
    Some(magnification(view, node.frame.bounds()).powf(0.75) / mean)
}

/// Pixels that a world unit takes in the middle of a cell; in a cell that the eye is in or beside, at its usual distance.
pub fn magnification(view: &View, cell: Bounds) -> f64 {
    match view.projection {
        Projection::Orthographic { .. } => view.focal_pixels(),
        Projection::Perspective { .. } => {
            let [middle, half] = [view.to_camera(cell.center()).z, 0.5 * cell.size().length()];
            view.focal_pixels() / middle.max(half).max(1e-30)
        }
    }
}

/// Whether a mode's pictures can be thinned: discs of fixed size all count the same, whatever their distance.
pub fn can_thin(depiction: &Depiction) -> bool {
    depiction.mode.technique.output() == Output::Sums
        && depiction.footprint() == Footprint::Kernel
        && depiction.mode.conserves != Conserved::Neither
}

/// `m h^(3/4)`: how much a particle's absence would show, up to the view's factor.
pub fn importance(mass: f32, smoothing_length: f32) -> f32 {
    mass * smoothing_length.sqrt() * smoothing_length.sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_leave_nothing_out_unless_asked() {
        let mut settings = Settings::default();
        assert_eq!(settings.file_budget(), LodBudget::NONE);
        settings.set(&THINNING, SettingValue::Number(2.0));
        assert_eq!(settings.file_budget().thinning, 2.0);
        assert_eq!(settings.common(), settings);
        settings.check_common().unwrap();
        settings.0.insert("radius".into(), SettingValue::Number(1.0));
        assert!(settings.check_common().is_err());
        assert_eq!(settings.common().0.len(), 1);
    }
}
