//! How the picture looks: the mode applied to the open data, and the transfer function with the ranges in use.

use super::exposure::Exposure;
use super::scene::{Scene, Settings, TransferKept};
use super::state::choices::Choices;
use super::state::notices::Notices;
use super::statistics::Converged;
use super::transfer_presets::TransferPresets;
use crate::annotate::Legend;
use crate::color::transfer::{Levels, Lut, Scale, TransferFunction};
use crate::color::{ExposureMode, Image};
use crate::gpu::{Composite, Fading};
use crate::look::Attribute;
use crate::mode::{Depiction, LevelChoice, LodBudget, Mode, over};
use crate::modes::volume_fields::DENSITY;
use crate::picture::ranges::Measured;
use bevy::prelude::*;
use bevy_egui::egui::Color32;
use std::sync::Arc;

/// Ranges from elsewhere in place of the picture's own: a leader's, or those of a tour that was looked through in advance.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct Held(pub Option<Levels>);

/// The look of the picture, derived from [`Settings`] and the data.
#[derive(Resource, Clone)]
pub struct Look {
    /// The mode, applied to the open file; where splats lie over each other, as what draws them so.
    pub depiction: Depiction,
    /// Counts up whenever particles get other weights, attributes or footprints.
    pub depiction_revision: u64,
    /// The baked transfer function.
    pub lut: Arc<Lut>,
    /// Its settings, as the data has them.
    pub transfer: TransferFunction,
    /// Its settings as they are chosen.
    pub chosen: TransferFunction,
    /// What the picture may leave undrawn.
    pub lod_budget: LodBudget,
    /// The ranges in use; automatic ones glide to those of the present view.
    pub levels: Levels,
    /// Whether the ranges have arrived.
    pub settled: bool,
    dataset: u32,
    generation: u32,
    attribute: Attribute,
    seeded: bool,
}

impl Look {
    /// What the picture's colours mean, where an axis tells it. The ranges of a field are those of its values, which tell nothing of outlines.
    pub fn told(&self, scene: &Scene) -> Option<Legend> {
        let mode = self.depiction.mode;
        let is_own = || mode.technique.own_colors(&self.depiction.settings, &self.transfer).is_some();
        if scene.samples_for(mode).is_some() && is_own() {
            return None;
        }
        let units = scene.units(&self.depiction);
        Legend::told(&self.depiction, &self.transfer, Arc::clone(&self.lut), &self.levels, &units)
    }

    /// Whether it shows what was measured: the same mode and attribute, by the same scales.
    pub fn shows(&self, measured: &Measured) -> bool {
        let scales = |transfer: &TransferFunction| (transfer.scale, transfer.hue.as_ref().map(|hue| hue.scale));
        let attribute = self.depiction.attribute.as_ref().map(|coloring| &coloring.name);
        measured.mode == self.depiction.mode
            && measured.attribute.as_ref() == attribute
            && scales(&measured.transfer) == scales(&self.transfer)
    }

    /// What the transfer function's colours mean.
    pub fn legend(&self, scene: &Scene) -> Legend {
        let units = scene.units(&self.depiction);
        Legend::of(&self.depiction, &self.transfer, Arc::clone(&self.lut), &self.levels, &units)
    }

    /// The colour at a brightness and a hue, both within [0, 1].
    pub fn color(&self, brightness: f32, hue: f32) -> Color32 {
        let at = |share: f32, size: u32| (share.clamp(0.0, 1.0) * (size - 1) as f32).round() as usize;
        let index = at(hue, self.lut.height) * self.lut.width as usize + at(brightness, self.lut.width);
        self.lut.rgba.get(index).map_or(Color32::BLACK, |&[r, g, b, _]| Color32::from_rgb(r, g, b))
    }

    /// How sums become colours, between the picture before and the one that they are of.
    pub(super) fn composite(&self, before: Option<(&Arc<Image>, f32)>, last: Option<f32>) -> Composite {
        let hue = self.transfer.hue.clone().unwrap_or_default();
        Composite {
            lut: Arc::clone(&self.lut),
            levels: self.levels,
            p_scale: self.transfer.scale,
            s_scale: hue.scale,
            attribute: self.has_hue(),
            before: before.map(|(image, share)| Fading { image: Arc::clone(image), share }),
            last,
        }
    }

    /// Whether hue follows an attribute.
    pub fn has_hue(&self) -> bool {
        self.transfer.hue.is_some() && self.depiction.attribute.is_some()
    }
}

/// Applies settings that have changed: the depiction, and the baked transfer function.
pub(crate) fn follow_settings(
    mut commands: Commands,
    scene: Option<Res<Scene>>,
    mut settings: ResMut<Settings>,
    look: Option<ResMut<Look>>,
    mut notices: ResMut<Notices>,
    mut presets: ResMut<TransferPresets>,
    mut kept: MessageReader<TransferKept>,
) {
    let kept = kept.read().count() > 0;
    let Some(scene) = scene else { return };
    let Some(mut look) = look else {
        match depict(&scene, &settings) {
            Ok(depiction) => {
                if !kept {
                    settings.transfer = initial_transfer(&scene, &depiction, &mut presets);
                }
                let transfer = shown(&scene, &depiction, &settings.transfer);
                let lut = Arc::new(bake(&depiction, &transfer));
                commands.insert_resource(Look {
                    depiction,
                    depiction_revision: 1,
                    lut,
                    transfer,
                    chosen: settings.transfer.clone(),
                    lod_budget: settings.budget.lod_budget(),
                    levels: Levels { p: [1e-6, 1.0], s: [0.0, 1.0] },
                    settled: false,
                    dataset: scene.dataset,
                    generation: scene.generation,
                    attribute: settings.attribute.clone(),
                    seeded: false,
                });
            }
            Err(error) => notices.error(format!("{}: {error}", scene.path.display())),
        }
        return;
    };
    let stale = look.generation != scene.generation
        || look.attribute != settings.attribute
        || look.depiction.settings != settings.look.settings
        || look.lod_budget != settings.budget.lod_budget()
        || look.depiction.choice != choice_of(&scene, &settings)
        || look.depiction.mode != settings.mode;
    let mut depicted = false;
    if stale {
        match depict(&scene, &settings) {
            Ok(depiction) => {
                let other_kind = look.depiction.mode != depiction.mode
                    || look.depiction.attribute.is_some() != depiction.attribute.is_some();
                let other_attribute = look.depiction.attribute != depiction.attribute;
                // The density that opacity goes by has no part in the ranges.
                let fields = |depiction: &Depiction| -> Vec<String> {
                    let names = depiction.mode.technique.fields(&depiction.settings).into_iter().enumerate();
                    let has_range = |(index, name): &(usize, String)| *index == 0 || name.as_str() != DENSITY;
                    names.filter(has_range).map(|(_, name)| name).collect()
                };
                let other_fields = fields(&look.depiction) != fields(&depiction);
                // What was kept came with the mode and the attribute. Heights and slopes have colours of their own.
                let other_colors = other_attribute && is_of_heights(&scene, depiction.mode);
                if (other_kind || other_colors) && !kept {
                    settings.transfer = initial_transfer(&scene, &depiction, &mut presets);
                } else if other_attribute
                    && !kept
                    && let Some(hue) = &mut settings.transfer.hue
                {
                    hue.range = crate::color::transfer::Range::Auto;
                }
                if other_fields && !kept {
                    settings.transfer.range = crate::color::transfer::Range::Auto;
                }
                // Another file, mode or attribute has other ranges altogether: no gliding there. Fixed ranges are those of all steps of a run.
                let is_same_file = match settings.exposure {
                    ExposureMode::Fixed => look.dataset == scene.dataset,
                    _ => look.generation == scene.generation,
                };
                look.seeded &= !other_kind && !other_attribute && !other_fields && is_same_file;
                look.depiction = depiction;
                look.lod_budget = settings.budget.lod_budget();
                depicted = true;
                look.depiction_revision += 1;
                (look.dataset, look.generation) = (scene.dataset, scene.generation);
                look.attribute = settings.attribute.clone();
            }
            Err(error) => {
                notices.error(error);
                settings.attribute = look.attribute.clone();
                settings.look.settings = look.depiction.settings.clone();
                settings.look.mode = over::own(look.depiction.mode);
            }
        }
    }
    // Opacity darkens splats and not a volume's colours, so that another mode has another table of the same function.
    if depicted || look.chosen != settings.transfer {
        look.chosen = settings.transfer.clone();
        look.transfer = shown(&scene, &look.depiction, &settings.transfer);
        look.lut = Arc::new(bake(&look.depiction, &look.transfer));
        look.settled = false;
    }
}

/// A transfer function as the data has it that a depiction is about.
fn shown(scene: &Scene, depiction: &Depiction, transfer: &TransferFunction) -> TransferFunction {
    match scene.samples_for(depiction.mode) {
        Some(field) => field.opened.shown_transfer(depiction, transfer),
        None => transfer.clone(),
    }
}

/// The colours of the picture; those of a volume whatever their opacity.
fn bake(depiction: &Depiction, transfer: &TransferFunction) -> Lut {
    if depiction.mode.is_light() { transfer.bake_colors() } else { transfer.bake_lut() }
}

/// The chosen mode and attribute on the open file.
fn depict(scene: &Scene, settings: &Settings) -> Result<Depiction, String> {
    let name = match &settings.attribute {
        Attribute::Named(name) => Some(name.as_str()),
        Attribute::Automatic | Attribute::None => None,
    };
    if let Some(field) = scene.samples_for(settings.mode) {
        let opened = &field.opened;
        // Of the voxels there are other attributes.
        let name = name.filter(|name| opened.attributes(Some(settings.mode)).iter().any(|own| own == name));
        return opened.depiction(settings.mode, settings.look.settings.clone(), name, choice_of(scene, settings));
    }
    let metadata = scene.metadata();
    let is_there =
        |name: &&str| scene.field.is_none() || Choices::attributes_of(metadata).iter().any(|own| own == name);
    let name = name.filter(is_there);
    let mut depiction = Depiction::new(settings.mode, settings.look.settings.clone(), name, metadata)?;
    depiction.choice = choice_of(scene, settings);
    if settings.attribute == Attribute::None {
        depiction.attribute = None;
    }
    Ok(depiction.blended())
}

/// Whether a mode's pictures are about heights.
fn is_of_heights(scene: &Scene, mode: &Mode) -> bool {
    scene.surface_for(mode).is_some()
}

/// Which levels of the data the settings choose.
fn choice_of(scene: &Scene, settings: &Settings) -> LevelChoice {
    let choice = settings.budget.level_choice();
    if scene.field_for(settings.mode).is_some() { choice } else { choice.of_window() }
}

/// The transfer function that a depiction begins with.
fn initial_transfer(scene: &Scene, depiction: &Depiction, presets: &mut TransferPresets) -> TransferFunction {
    if let Some(field) = scene.samples_for(depiction.mode) {
        return field.opened.usual_transfer(depiction);
    }
    let [plain, colored] = depiction.mode.transfer;
    let name = if depiction.attribute.is_some() { colored } else { plain };
    let transfer = presets.choose(name).or_else(|| TransferFunction::preset(name)).unwrap_or_default();
    depiction.suited(transfer)
}

/// Time in which the automatic ranges cover 63 % of the way to those of the present view, seconds.
const GLIDE_SECS: f64 = 0.15;
/// Time that a picture stands before its ranges are kept where they are fixed, seconds.
const FIXED_AFTER_SECS: f32 = 0.5;
/// Share of the range within which it has arrived.
const ARRIVED: f64 = 0.004;

/// Moves the ranges in use towards those wanted, so that the picture's brightness does not jump while one flies; ranges from
/// elsewhere are used as they are.
pub(crate) fn glide_levels(
    time: Res<Time<Real>>,
    (exposure, settings, converged): (Res<Exposure>, Res<Settings>, Option<Res<Converged>>),
    held: Res<Held>,
    look: Option<ResMut<Look>>,
    mut stood: Local<Stood>,
) {
    let Some(mut look) = look else { return };
    if let Some(levels) = held.0 {
        if look.levels != levels || !look.settled || !look.seeded {
            (look.levels, look.settled, look.seeded) = (levels, true, true);
        }
        return;
    }
    if !look.seeded {
        // Something else is shown: what is kept begins anew.
        *stood = Stood::default();
    }
    let Some(wanted) = exposure.levels else { return };
    if settings.exposure == ExposureMode::Fixed
        && look.seeded
        && stood.is_kept(&look, converged.is_some_and(|converged| converged.0), time.delta_secs())
    {
        if !look.settled {
            look.settled = true;
        }
        return;
    }
    let constant = match settings.exposure {
        ExposureMode::Steady | ExposureMode::Fixed => GLIDE_SECS,
        ExposureMode::Auto => 0.0,
        ExposureMode::Adaptive { bright, .. } if wanted.p[1] > look.levels.p[1] => bright,
        ExposureMode::Adaptive { dark, .. } => dark,
    };
    let share = if look.seeded && constant > 0.0 { 1.0 - (-time.delta_secs_f64() / constant).exp() } else { 1.0 };
    let hue_scale = look.transfer.hue.as_ref().map_or(Scale::default(), |hue| hue.scale);
    let p = approach(look.levels.p, wanted.p, look.transfer.scale, share);
    let s = approach(look.levels.s, wanted.s, hue_scale, share);
    let settled = p.1 && s.1;
    let levels = Levels { p: p.0, s: s.0 };
    if look.levels != levels || look.settled != settled || !look.seeded {
        look.levels = levels;
        look.settled = settled;
        look.seeded = true;
    }
}

/// How long a picture has stood with the same transfer function.
#[derive(Default)]
pub(crate) struct Stood {
    transfer: Option<TransferFunction>,
    seconds: f32,
}

impl Stood {
    /// Whether its ranges are kept from now on: they are those of a whole picture with this function.
    fn is_kept(&mut self, look: &Look, converged: bool, seconds: f32) -> bool {
        if self.transfer.as_ref() != Some(&look.chosen) {
            (self.transfer, self.seconds) = (Some(look.chosen.clone()), 0.0);
        }
        if self.seconds < FIXED_AFTER_SECS {
            self.seconds = if converged && look.settled { self.seconds + seconds } else { 0.0 };
        }
        self.seconds >= FIXED_AFTER_SECS
    }
}

/// A range that has moved by `share` of the way, and whether it has arrived.
fn approach(from: [f64; 2], to: [f64; 2], scale: Scale, share: f64) -> ([f64; 2], bool) {
    let log = scale == Scale::Log && from.iter().chain(&to).all(|end| *end > 0.0);
    let forth = |x: f64| if log { x.ln() } else { x };
    let back = |x: f64| if log { x.exp() } else { x };
    let [a, b] = to.map(forth);
    let tolerance = ARRIVED * (b - a).abs();
    let far = [(from[0], a), (from[1], b)].map(|(from, to)| (forth(from) + (to - forth(from)) * share, to));
    if share >= 1.0 || far.iter().all(|(x, to)| (x - to).abs() <= tolerance) {
        return (to, true);
    }
    (far.map(|(x, _)| back(x)), false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::Range;
    use crate::modes;
    use crate::window::touring::player::tests::Window;

    #[test]
    fn a_mode_begins_with_its_own_colours_unless_they_came_with_it() {
        let mut window = Window::new();
        window.app.init_resource::<TransferPresets>().add_systems(Last, follow_settings);
        window.frame(0.0);
        let mut first = window.app.world().resource::<Settings>().clone();
        first.transfer.range = Range::Fixed(0.5, 7.0);
        window.app.insert_resource(first.clone());
        window.frame(0.0);
        for kept in [false, true] {
            window.app.world_mut().resource_mut::<Settings>().choose_mode(modes::find("volume").unwrap());
            window.frame(0.0);
            assert!(window.app.world().resource::<Settings>().transfer != first.transfer);
            window.app.insert_resource(first.clone());
            if kept {
                window.app.world_mut().write_message(TransferKept);
            }
            // It stays so in the frames after that.
            for _ in 0..2 {
                window.frame(0.0);
                assert_eq!(window.app.world().resource::<Settings>().transfer == first.transfer, kept);
            }
        }
    }

    /// They are kept once a picture has stood, in other steps of a run too, and begin anew where another file is shown with the same colours.
    #[test]
    fn fixed_ranges_are_those_that_each_file_is_found_with() {
        let mut window = Window::new();
        let app = &mut window.app;
        app.init_resource::<TransferPresets>().init_resource::<Exposure>().init_resource::<Held>();
        app.insert_resource(Converged(true)).add_systems(Last, (follow_settings, glide_levels).chain());
        app.world_mut().resource_mut::<Settings>().exposure = ExposureMode::Fixed;
        let shown = |window: &mut Window, high: f64| {
            let levels = Levels { p: [1.0, high], s: [0.0, 1.0] };
            window.app.world_mut().resource_mut::<Exposure>().levels = Some(levels);
            (0..8).for_each(|_| window.frame(0.25));
            window.app.world().resource::<Look>().levels.p[1]
        };
        assert_eq!([10.0, 1000.0].map(|high| shown(&mut window, high)), [10.0; 2]);
        window.app.world_mut().resource_mut::<Scene>().generation += 1;
        assert_eq!(shown(&mut window, 20.0), 10.0);
        let mut scene = window.app.world_mut().resource_mut::<Scene>();
        (scene.dataset, scene.generation) = (scene.dataset + 1, scene.generation + 1);
        window.app.insert_resource(Converged(false));
        // As long as its pages arrive, ranges follow.
        assert_eq!([50.0, 70.0].map(|high| shown(&mut window, high)), [50.0, 70.0]);
        window.app.insert_resource(Converged(true));
        assert_eq!([70.0, 90.0].map(|high| shown(&mut window, high)), [70.0; 2]);
    }

    /// An eye goes the same way on the scale's logarithm in frames of any length, towards bright and dark with a time of its own; ranges of each
    /// picture are there at once.
    #[test]
    fn an_eye_adapts_in_its_own_time_and_ranges_of_each_picture_in_none() {
        let mut window = Window::new();
        let app = &mut window.app;
        app.init_resource::<TransferPresets>().init_resource::<Exposure>().init_resource::<Held>();
        app.add_systems(Last, (follow_settings, glide_levels).chain());
        // The logarithm of the range's end after so many frames that take half a second together.
        let shown = |window: &mut Window, exposure: ExposureMode, wanted: f64, frames: u32| {
            let mut settings = window.app.world_mut().resource_mut::<Settings>();
            settings.exposure = exposure;
            settings.transfer.scale = Scale::Log;
            let levels = Levels { p: [1.0, wanted], s: [0.0, 1.0] };
            window.app.world_mut().resource_mut::<Exposure>().levels = Some(levels);
            (0..frames).for_each(|_| window.frame(0.5 / f64::from(frames)));
            window.app.world().resource::<Look>().levels.p[1].ln()
        };
        let [dim, bright]: [f64; 2] = [10.0, 1000.0];
        let eye = ExposureMode::Adaptive { bright: 0.5, dark: 2.0 };
        let way = f64::ln(bright / dim);
        // Settings are those of the mode after the first frame.
        shown(&mut window, ExposureMode::Auto, dim, 1);
        for frames in [1, 5] {
            assert_eq!(shown(&mut window, ExposureMode::Auto, dim, 1), dim.ln());
            let brighter = shown(&mut window, eye, bright, frames);
            assert!((brighter - (bright.ln() - way * f64::exp(-1.0))).abs() < 1e-6, "{frames}: {brighter}");
            assert_eq!(shown(&mut window, ExposureMode::Auto, bright, 1), bright.ln());
            let darker = shown(&mut window, eye, dim, frames);
            assert!((darker - (dim.ln() + way * f64::exp(-0.25))).abs() < 1e-6, "{frames}: {darker}");
        }
    }

    #[test]
    fn ranges_glide_and_arrive_exactly() {
        for scale in [Scale::Log, Scale::Linear] {
            let to = [1.0, 100.0];
            let mut range = [1e-3, 5.0];
            let mut steps = 0;
            while range != to {
                range = approach(range, to, scale, 0.2).0;
                steps += 1;
                assert!(steps < 100 && range[0] < range[1], "{range:?}");
            }
            assert!(steps > 5);
        }
        assert_eq!(approach([1.0, 2.0], [5.0, 6.0], Scale::Log, 1.0), ([5.0, 6.0], true));
        assert!(approach([-1.0, 2.0], [5.0, 6.0], Scale::Log, 0.5).0[0] > -1.0, "no logarithm of a negative end");
    }
}
