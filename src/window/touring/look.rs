//! Between what a tour shows and the window's settings.

use crate::look::LookPatch;
use crate::model::FamilyName;
use crate::window::scene::Settings;

/// Makes the settings show a look: what has changed since `before`, the look that was shown last, so that whatever the user does
/// meanwhile stays until the tour says otherwise; whether the transfer function is among that. `attributes`: those of the data;
/// `families`: its families in their order.
pub fn show(
    before: Option<&LookPatch>,
    look: &LookPatch,
    attributes: &[String],
    families: &[FamilyName],
    settings: &mut Settings,
) -> bool {
    let mut said = before.map_or_else(|| look.clone(), |before| before.patch_to(look));
    let same_settings = before.is_some_and(|before| before.settings == look.settings && before.mode == look.mode);
    said.settings = if same_settings { settings.look.settings.clone() } else { look.settings.clone() };
    settings.show(&said, attributes);
    if before.is_none_or(|before| before.families != look.families) {
        let shown = |name: &FamilyName| look.families.as_ref().is_none_or(|names| names.contains(name));
        settings.families = families.iter().map(shown).collect();
    }
    said.transfer.is_some()
}

/// The look that the settings show.
pub fn of(settings: &Settings, families: &[FamilyName]) -> LookPatch {
    let shown: Vec<FamilyName> =
        families.iter().zip(&settings.families).filter(|(_, shown)| **shown).map(|(name, _)| *name).collect();
    LookPatch { families: (shown.len() < families.len()).then_some(shown), ..settings.look.patch() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::color::transfer::Range;
    use crate::explore::{Region, SelectionSet};
    use crate::look::Attribute;
    use crate::look::{DatasetRef, SceneFile};
    use crate::mode::{LodBudget, Mode, Setting, SettingKind, SettingValue, lod_budget};
    use crate::modes;
    use crate::show::window::network::leading::Leading;
    use crate::tour::TourFile;
    use crate::view::cut::{Axis, Slab};
    use crate::window::camera::Viewpoint;
    use crate::window::objects::Objects;
    use crate::window::picture::Picture;
    use crate::window::preset::Preset;
    use crate::window::scene_io::{Bookmarks, SceneFiles, SceneParts, camera_of, scene_file};
    use crate::window::state::panels::{Closed, Shown};
    use bevy::ecs::system::SystemState;
    use bevy::math::DVec3;
    use bevy::prelude::{Rect, World};

    const FAMILIES: [FamilyName; 2] = [FamilyName::Gas, FamilyName::Stars];

    /// Settings that differ from one another in one thing after the other.
    fn settings() -> Vec<Settings> {
        let mut now = Settings::new(&Preset::embedded("desktop").unwrap(), None);
        now.families = vec![true, true];
        let mut all = vec![now.clone()];
        let edits: [fn(&mut Settings); 8] = [
            |settings| settings.choose_mode(modes::find("volume").unwrap()),
            |settings| settings.transfer.range = Range::Fixed(0.5, 7.0),
            |settings| settings.attribute = Attribute::Named("temperature".into()),
            |settings| settings.families = vec![true, false],
            |settings| settings.error_px = 2.5,
            |settings| settings.cut.slab = Some(Slab { axis: Axis::Y, middle: 1.0, thickness: 2.0 }),
            |settings| settings.selections = vec![SelectionSet::new("a", Region::sphere(DVec3::ONE, 2.0), 0)],
            |settings| settings.annotations.caption = "words".into(),
        ];
        for edit in edits {
            edit(&mut now);
            all.push(now.clone());
        }
        all.push(all[0].clone());
        all
    }

    #[test]
    fn keyframes_of_settings_bring_the_settings_back() {
        let attributes = ["temperature".to_owned()];
        let all = settings();
        let mut look = LookPatch::default();
        let mut shown: Option<LookPatch> = None;
        let mut window = Settings::new(&Preset::embedded("desktop").unwrap(), None);
        window.families = vec![true, true];
        for (i, wanted) in all.iter().enumerate() {
            let now = of(wanted, &FAMILIES);
            look = look.then(&look.patch_to(&now));
            let same_families = |a: &LookPatch| a.families.clone().filter(|names| names.len() < 3);
            assert_eq!(LookPatch { families: same_families(&look), ..look.clone() }, now, "{i}");
            show(shown.as_ref(), &look, &attributes, &FAMILIES, &mut window);
            assert!(window == *wanted, "{i}");
            shown = Some(look.clone());
        }
    }

    /// A value that a setting does not have unless it is set.
    fn unusual(setting: &Setting) -> SettingValue {
        let middle = |min: f64, max: f64| 0.5 * (min + max.min(1e6));
        match setting.kind {
            SettingKind::Number { min, max, default } if middle(min, max) == default => SettingValue::Number(min),
            SettingKind::Number { min, max, .. } => SettingValue::Number(middle(min, max)),
            SettingKind::Flag { default } => SettingValue::Flag(!default),
            SettingKind::Choice { options } => SettingValue::Name(options.last().copied().unwrap_or_default().into()),
            SettingKind::Column { .. } | SettingKind::Vector { .. } => SettingValue::Name("temperature".into()),
            SettingKind::Numbers { min, max, .. } => SettingValue::Numbers(vec![middle(min, max), max.min(1e6)]),
            SettingKind::Colors { .. } => SettingValue::Names(vec!["#ff8000".into()]),
        }
    }

    /// Settings of a mode with each off its default.
    pub(crate) fn unusual_settings(mode: &'static Mode) -> Settings {
        let mut settings = Settings::new(&Preset::embedded("desktop").unwrap(), None);
        settings.choose_mode(mode);
        settings.families = vec![false, true];
        for setting in lod_budget::COMMON.into_iter().chain(mode.own_settings()) {
            let value = unusual(setting);
            assert!(setting.check(&value).is_ok() && value != setting.default(), "{}", setting.name);
            settings.set(setting, value);
        }
        settings.attribute = Attribute::Named("temperature".into());
        settings.transfer.range = Range::Fixed(0.5, 7.0);
        settings.error_px = 2.5;
        settings.background = crate::color::composite::Background::Transparent;
        settings.exposure = crate::color::ExposureMode::Adaptive { bright: 0.2, dark: 3.0 };
        settings.bloom = crate::color::Bloom { strength: 0.4, threshold: 0.8, radius: 0.05 };
        settings
    }

    #[test]
    fn whatever_is_shown_is_written_and_read_again() {
        let attributes = ["temperature".to_owned()];
        let dataset = || vec![DatasetRef::of(std::path::Path::new("a.df"), std::path::Path::new("a.scene.ron"))];
        let mut world = World::new();
        world.init_resource::<SceneFiles>();
        world.init_resource::<Bookmarks>();
        world.init_resource::<Closed>();
        world.init_resource::<Shown>();
        world.init_resource::<crate::window::state::plots::PlotChoice>();
        world.init_resource::<Objects>();
        let mut parts = SystemState::<SceneParts>::new(&mut world);
        let parts = parts.get_mut(&mut world).unwrap();
        let rect = Rect::new(0.0, 0.0, 640.0, 480.0);
        let picture = Picture::at(rect);
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let viewpoint = Viewpoint { eye, target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.7 };
        for mode in modes::all() {
            let wanted = unusual_settings(mode);
            let shows = |said: &LookPatch, what: &str| {
                let mut window = Settings::new(&Preset::embedded("desktop").unwrap(), None);
                assert_eq!(window.show(&LookPatch::beginning().then(said), &attributes), None);
                assert_eq!(window.look, wanted.look, "{what} of {}", mode.name);
            };
            // A saved scene.
            let path = std::path::Path::new("a.scene.ron");
            let scene = scene_file(dataset(), &wanted, &viewpoint, &picture, &parts, path);
            shows(&SceneFile::parse("a scene", &scene.text(path).unwrap()).unwrap().look, "a scene");
            // What followers are told.
            let told = Leading::text(dataset(), wanted.look.patch(), None).unwrap();
            shows(&SceneFile::parse("the leader's scene", &told).unwrap().look, "a leader's scene");
            // A keyframe that is kept.
            let mut tour = TourFile::new(Vec::new());
            let camera = camera_of(&viewpoint, &wanted.lens);
            super::super::draft::keep(&mut tour, None, None, camera, &of(&wanted, &FAMILIES));
            let read = TourFile::parse("a tour", &tour.to_ron()).unwrap();
            assert_eq!(read, tour);
            shows(&read.keyframes[0].look, "a keyframe");
            assert_eq!(read.keyframes[0].look.families, Some(vec![FamilyName::Stars]));
        }
    }

    #[test]
    fn files_that_have_the_budget_among_the_settings_of_a_mode_are_read() {
        for mode in modes::all() {
            let looks = |settings: &str| {
                let said = format!("mode: \"{}\", settings: {settings}", mode.name);
                let scene = format!("(version: 1, datasets: [(path: \"a\")], {said})");
                let tour = format!("(version: 1, keyframes: [({said})])");
                Ok([
                    SceneFile::parse("a scene", &scene).map_err(|error| error.to_string())?.look,
                    TourFile::parse("a tour", &tour).map_err(|error| error.to_string())?.keyframes[0].look.clone(),
                ])
            };
            for look in looks("{\"presence\": 5.0, \"thinning\": 2.0}").unwrap() {
                assert_eq!(look.budget.lod_budget(), LodBudget { culling: true, presence: 5.0, thinning: 2.0 });
                assert!(look.settings.0.is_empty(), "{}", mode.name);
            }
            let wrong: Result<_, String> = looks("{\"thinning\": 99.0}");
            assert!(wrong.unwrap_err().contains("thinning: found 99, expected a number from 0 to 32"));
        }
    }

    #[test]
    fn what_the_user_changes_stays_until_the_tour_says_otherwise() {
        let mut window = settings().remove(0);
        let look = of(&window, &FAMILIES);
        window.error_px = 9.0;
        show(Some(&look), &LookPatch { cut: Some(Default::default()), ..look.clone() }, &[], &FAMILIES, &mut window);
        assert_eq!(window.error_px, 9.0);
        show(Some(&look), &LookPatch { error_px: Some(1.5), ..look.clone() }, &[], &FAMILIES, &mut window);
        assert_eq!(window.error_px, 1.5);
    }
}
