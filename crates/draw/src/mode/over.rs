//! Modes of sums whose splats lie over each other instead: the same mode with another technique, whose pictures are light.

use super::{
    Adapter, Conserved, Depiction, FindRanges, Footprint, Job, LightPasses, LightPicture, LightPlan, Mode, Needs,
    Output, Raw, Settings, Technique, Terms,
};
use crate::color::splat_colors::{OwnColumn, SplatColors};
use crate::color::transfer::TransferFunction;
use crate::cpu::over::{self, Over};
use crate::cpu::volume::{VolumeError, VolumeLevels};
use crate::model::Kernel;
use std::sync::{Arc, PoisonError, RwLock};

/// A technique of sums, whose splats lie over each other.
struct OverSplats {
    sums: &'static dyn Technique,
    conserves: Conserved,
}

impl Technique for OverSplats {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, settings: &Settings) -> Needs {
        let needs = self.sums.needs(settings);
        // Discs of a fixed number of pixels have no depth.
        Needs { densities: needs.footprint == Footprint::Kernel, blur_px: over::LOW_PASS, ..needs }
    }

    fn takes_clusters(&self) -> bool {
        self.sums.takes_clusters()
    }

    fn meets_surfaces(&self) -> bool {
        true
    }

    fn tells_columns(&self) -> bool {
        true
    }

    fn adapter(&self) -> Adapter {
        // Discs of a fixed number of pixels the processor draws.
        match (self.sums.adapter(), self.needs(&Settings::default()).footprint) {
            (Adapter::Splats, Footprint::Kernel) => Adapter::Light,
            _ => Adapter::None,
        }
    }

    fn light(&self, terms: &Terms<'_>, _: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let usual = TransferFunction::default();
        let transfer = terms.transfer.unwrap_or(&usual);
        // Automatic ranges are those of sums, which whoever asks has drawn before.
        let levels = transfer.numbers().ok_or_else(|| VolumeError::Device("no ranges of the sums are known".into()))?;
        let passes = LightPasses::Over {
            colors: Arc::new(SplatColors::new(transfer, levels)),
            column: own_column(self.conserves, terms.kernel, (terms.mean_mass, terms.density_scale)),
            attribute: terms.attribute,
        };
        let levels = VolumeLevels { density: levels.p, attribute: levels.s, unit_length: 0.0 };
        Ok(Some(LightPlan { passes, levels, isovalues: Vec::new() }))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let usual = TransferFunction::default();
        let transfer = job.transfer.unwrap_or(&usual);
        let levels = match transfer.numbers() {
            Some(levels) => levels,
            // Automatic ranges are those of the sums.
            None => match self.sums.draw(job)? {
                Raw::Sums(sums, _) => transfer.levels(&sums),
                light => return Ok(light),
            },
        };
        let colors = &SplatColors::new(transfer, levels);
        let (order, kernel) = (job.order, job.options.kernel);
        let column = own_column(self.conserves, kernel, (job.mean_mass, job.density_scale));
        let around = job.around;
        let over = Over { order, kernel, colors, column, around };
        let (colors, report) = over::draw_among(job.view, job.batches, &over, job.paths);
        let levels = VolumeLevels { density: levels.p, attribute: levels.s, unit_length: 0.0 };
        Ok(Raw::Light(LightPicture { colors, report, levels, isovalues: Vec::new() }))
    }
}

/// How the own columns of splats are found whose weights conserve this, with the mean mass of a particle and the factor on densities.
pub fn own_column(conserves: Conserved, kernel: Kernel, (particle, density_scale): (f64, f32)) -> OwnColumn {
    let power = match conserves {
        Conserved::Mass => Some(1),
        Conserved::MassDensity => Some(2),
        Conserved::Neither => None,
    };
    OwnColumn { power, particle, variance: kernel.variance(), density_scale: f64::from(density_scale) }
}

/// Modes of sums, and the same with splats that lie over each other.
static MODES: RwLock<Vec<[&'static Mode; 2]>> = RwLock::new(Vec::new());

/// A mode of sums with splats that lie over each other.
fn mode(sums: &'static Mode) -> &'static Mode {
    let mut modes = MODES.write().unwrap_or_else(PoisonError::into_inner);
    if let Some([_, over]) = modes.iter().find(|[own, _]| std::ptr::eq(*own, sums)) {
        return over;
    }
    // Modes live as long as the program, and there is one of these for each that was ever drawn so.
    let technique: &'static OverSplats =
        Box::leak(Box::new(OverSplats { sums: sums.technique, conserves: sums.conserves }));
    let over: &'static Mode = Box::leak(Box::new(Mode { technique, ..*sums }));
    modes.push([sums, over]);
    over
}

/// What draws a mode with settings of pictures: itself, or where these let its splats lie over each other, the mode that draws them so.
pub fn drawn(own: &'static Mode, settings: &Settings) -> &'static Mode {
    match settings.blend_order() {
        Some(_) if own.technique.output() == Output::Sums => mode(own),
        _ => own,
    }
}

/// The mode of sums that a mode draws with splats over each other; else itself.
pub fn own(drawn: &'static Mode) -> &'static Mode {
    let modes = MODES.read().unwrap_or_else(PoisonError::into_inner);
    modes.iter().find(|[_, over]| std::ptr::eq(*over, drawn)).map_or(drawn, |[own, _]| own)
}

impl Depiction {
    /// What draws it: itself, or where its splats lie over each other, the mode that draws them so.
    #[must_use]
    pub fn blended(&self) -> Depiction {
        match self.choice.order {
            Some(_) if self.mode.technique.output() == Output::Sums => self.as_over(),
            _ => self.clone(),
        }
    }

    /// The same of a mode of sums, with splats that lie over each other in the usual order.
    #[must_use]
    pub fn as_over(&self) -> Depiction {
        Depiction { mode: mode(self.mode), ..self.clone() }
    }
}
