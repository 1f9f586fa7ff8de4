//! The technique of the perspective grid: rays march through its cells.

use super::settings::{DETAIL, NEAR, RESOLUTION, SURFACE_SMOOTHING};
use super::{Layers, Look};
use crate::color::transfer::TransferFunction;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::{Casters, Lighting, Shadowing};
use crate::cpu::volume::{self, Scenery, Supply, VolumeError, VolumeLevels, VolumeOptions};
use crate::hierarchy::Purpose;
use crate::mode::{
    Adapter, FieldJob, FieldPasses, FindRanges, InView, Job, LightPasses, LightPicture, LightPlan, Needs, Output, Raw,
    Settings, Technique, Terms,
};
use crate::model::Bounds;
use crate::modes::volume_fields::{self, VolumeFields};
use crate::modes::{samples, shadowing};
use crate::view::{Detail, PerspectiveGrid, View};
use glam::DVec3;

/// The detail in which the nodes of data within these bounds are drawn. An automatic near plane is not known before nodes
/// are selected: it is taken to be where it is for data of which all is in view.
fn sampling(view: &View, settings: &Settings, bounds: Bounds) -> Detail {
    let corner = |index: usize| {
        let pick = |axis: usize| if index >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        view.to_camera(DVec3::new(pick(0), pick(1), pick(2))).z
    };
    let far = (0..8).map(corner).fold(0.0, f64::max);
    let near = match settings.number(&NEAR) {
        near if near > 0.0 => near,
        _ => PerspectiveGrid::NEAREST * far,
    };
    let sigma = PerspectiveGrid::sigma_of(view, settings.number(&RESOLUTION));
    Detail::Sampling { sigma: settings.number(&DETAIL) * sigma, near }
}

/// Layers of a volume, by marching along rays through the perspective grid.
pub struct Marched(pub Layers);

impl Marched {
    fn field_shadowing(&self, job: &FieldJob<'_>) -> Option<Shadowing> {
        self.shadowing(job.settings, job.view, &job.lighting, job.diameter)
    }
}

/// How what is marched of a job's particles hides light.
fn casters<'j>(job: &'j Job<'j>, scenery: &Scenery, options: VolumeOptions) -> Box<Casters<'j>> {
    shadowing::casters_of(scenery, move |from: &View, casting: &Scenery| {
        volume::draw_in_parts(from, job.batches, casting, &options.seen_from(from == job.view))
    })
}

impl Technique for Marched {
    fn output(&self) -> Output {
        Output::Light
    }

    fn needs(&self, settings: &Settings) -> Needs {
        let steps = settings.number(&SURFACE_SMOOTHING).round() as u32;
        let margin_px = Needs::default().margin_px.max(volume::smoothing::reach(steps));
        let own = Needs { purpose: Purpose::Samples, slices: true, margin_px, hides: true, ..Needs::default() };
        shadowing::needs(own, settings)
    }

    fn is_darkened(&self, settings: &Settings) -> bool {
        !self.0.surfaces.is_empty() && shadowing::is_on(settings)
    }

    fn shadowing(&self, settings: &Settings, view: &View, lighting: &Lighting<'_>, diameter: f64) -> Option<Shadowing> {
        match self.0.surfaces {
            [] => None,
            _ => {
                let own = shadowing::beside_eye(settings, view, lighting, diameter);
                own.map(|shadowing| Shadowing { is_costly: true, ..shadowing })
            }
        }
    }

    fn detail(&self, view: &View, settings: &Settings, bounds: Bounds, _: f64) -> Detail {
        sampling(view, settings, bounds)
    }

    fn takes_clusters(&self) -> bool {
        true
    }

    fn fields(&self, settings: &Settings) -> Vec<String> {
        volume_fields::names(settings, &self.0)
    }

    fn adapter(&self) -> Adapter {
        Adapter::Light
    }

    fn own_levels(&self, job: &Job<'_>) -> Option<VolumeLevels> {
        let names = self.fields(job.settings);
        let fields = || VolumeFields::new(job, &self.0, &names).ok();
        (!names.is_empty()).then(fields).flatten().map(|fields| fields.levels)
    }

    fn looks_in_view(&self, settings: &Settings, transfer: &TransferFunction) -> bool {
        let names = self.fields(settings);
        // The transfer function has a range for the first one alone.
        !names.is_empty() && (names.len() > 1 || transfer.numbers().is_none())
    }

    fn in_view(&self, job: &Job<'_>) -> Result<Option<InView>, VolumeError> {
        let names = self.fields(job.settings);
        (!names.is_empty()).then(|| volume_fields::in_view(job, &names)).transpose()
    }

    fn takes_paths(&self) -> bool {
        true
    }

    fn light(&self, terms: &Terms<'_>, ranges: &mut FindRanges<'_>) -> Result<Option<LightPlan>, VolumeError> {
        if !self.fields(terms.settings).is_empty() {
            return Ok(None);
        }
        let look = Look::of(terms, ranges)?;
        let (scenery, isovalues) = look.scenery(terms, self.0)?;
        Ok(Some(LightPlan { passes: LightPasses::March(scenery, look.options), levels: look.levels, isovalues }))
    }

    fn light_of_fields(&self, job: &Job<'_>) -> Result<Option<LightPlan>, VolumeError> {
        let names = self.fields(job.settings);
        if names.is_empty() {
            return Ok(None);
        }
        Ok(Some(VolumeFields::new(job, &self.0, &names)?.plan()))
    }

    fn field_dimensions(&self) -> &'static [usize] {
        &[3]
    }

    fn has_field_passes(&self) -> bool {
        true
    }

    fn field_passes(&self, job: &FieldJob<'_>) -> Result<Option<FieldPasses>, VolumeError> {
        Ok(Some(FieldPasses::March(Box::new(samples::plan(job, &self.0)?))))
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        Ok(Raw::Light(match self.field_shadowing(job) {
            Some(shadowing) => samples::march_darkened(job, &self.0, &shadowing)?,
            None => samples::march(job, &self.0)?,
        }))
    }

    fn has_field_parts(&self) -> bool {
        true
    }

    fn field_parts(&self, job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
        samples::march_in_parts(job, &self.0, self.field_shadowing(job).as_ref())
    }

    fn field_casters<'j>(&'j self, job: &'j FieldJob<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        Ok((!self.0.surfaces.is_empty()).then(|| samples::casters(job, &self.0)))
    }

    fn casters<'j>(&'j self, job: &'j Job<'j>) -> Result<Option<Box<Casters<'j>>>, VolumeError> {
        if self.0.surfaces.is_empty() {
            return Ok(None);
        }
        let names = self.fields(job.settings);
        if !names.is_empty() {
            return Ok(Some(VolumeFields::new(job, &self.0, &names)?.casters(job)));
        }
        let look = Look::new(job)?;
        let (scenery, _) = look.scenery(&job.terms(), self.0)?;
        Ok(Some(casters(job, &scenery, look.options)))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let names = self.fields(job.settings);
        let shadowing = self.shadowing(job.settings, job.view, &job.lighting, job.diameter);
        if !names.is_empty() {
            let fields = VolumeFields::new(job, &self.0, &names)?;
            return Ok(Raw::Light(match shadowing {
                Some(shadowing) => fields.draw_darkened(job, &shadowing),
                None => fields.draw(job),
            }));
        }
        let look = Look::new(job)?;
        let (scenery, isovalues) = look.scenery(&job.terms(), self.0)?;
        let (colors, report) = match shadowing {
            Some(shadowing) => {
                let (mut parts, report) = volume::draw_in_parts(job.view, job.batches, &scenery, &look.options)?;
                let (casters, others) = (casters(job, &scenery, look.options), job.lighting.others.as_ref());
                shadowing.darken_fragments(job.view, &mut parts, &*casters, others);
                (shadowing::colors_among(&parts, job.paths), report)
            }
            None => volume::draw_with_paths(job.view, job.batches, &scenery, &look.options, job.paths)?,
        };
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues }))
    }

    fn takes_supply(&self, settings: &Settings) -> bool {
        self.0.surfaces.is_empty() || !shadowing::is_on(settings)
    }

    fn draw_supplied(&self, job: &Job<'_>, supply: &mut dyn Supply) -> Result<Raw, VolumeError> {
        let names = self.fields(job.settings);
        if !names.is_empty() {
            let fields = VolumeFields::of_supplied(job, supply, &self.0, &names)?;
            return Ok(Raw::Light(fields.draw_supplied(job.view, supply)));
        }
        let (terms, look) = Look::of_supplied(job, supply)?;
        let (scenery, isovalues) = look.scenery(&terms, self.0)?;
        let (colors, report) = volume::supply::draw(job.view, supply, &scenery, &look.options)?;
        Ok(Raw::Light(LightPicture { colors, report, levels: look.levels, isovalues }))
    }

    fn supplied_levels(&self, job: &Job<'_>, supply: &mut dyn Supply) -> Result<Option<VolumeLevels>, VolumeError> {
        let names = self.fields(job.settings);
        if !names.is_empty() {
            return VolumeFields::of_supplied(job, supply, &self.0, &names).map(|fields| Some(fields.levels));
        }
        Look::of_supplied(job, supply).map(|(_, look)| Some(look.levels))
    }
}
