//! Between what a tour shows and the window's settings.

use crate::look::LookPatch;
use crate::model::FamilyName;
use crate::window::scene::Settings;

/// Makes the settings show a look: what has changed since `before`, the look that was shown last, so that whatever the user does
/// meanwhile stays until the tour says otherwise. `attributes`: those of the data; `families`: its families in their order.
pub fn show(
    before: Option<&LookPatch>,
    look: &LookPatch,
    attributes: &[String],
    families: &[FamilyName],
    settings: &mut Settings,
) {
    let mut said = before.map_or_else(|| look.clone(), |before| before.patch_to(look));
    let same_settings = before.is_some_and(|before| before.settings == look.settings && before.mode == look.mode);
    said.settings = if same_settings { settings.look.settings.clone() } else { look.settings.clone() };
    settings.show(&said, attributes);
    if before.is_none_or(|before| before.families != look.families) {
        let shown = |name: &FamilyName| look.families.as_ref().is_none_or(|names| names.contains(name));
        settings.families = families.iter().map(shown).collect();
    }
}

/// The look that the settings show.
pub fn of(settings: &Settings, families: &[FamilyName]) -> LookPatch {
    let shown: Vec<FamilyName> =
        families.iter().zip(&settings.families).filter(|(_, shown)| **shown).map(|(name, _)| *name).collect();
    LookPatch { families: (shown.len() < families.len()).then_some(shown), ..settings.look.patch() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::Range;
    use crate::look::Attribute;
    use crate::modes;
    use crate::explore::{Region, SelectionSet};
    use crate::view::cut::{Axis, Slab};
    use crate::window::preset::Preset;
    use bevy::math::DVec3;

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
