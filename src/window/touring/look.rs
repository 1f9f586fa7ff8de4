//! Between what a tour shows and the window's settings.

use crate::look::Attribute;
use crate::model::FamilyName;
use crate::modes;
use crate::tour::{Keyframe, Look};
use crate::window::scene::Settings;

/// Makes the settings show a look: what has changed since `before`, the look that was shown last, so that whatever the user does
/// meanwhile stays until the tour says otherwise. `attributes`: those of the data; `families`: its families in their order.
pub fn show(
    before: Option<&Look>,
    look: &Look,
    attributes: &[String],
    families: &[FamilyName],
    settings: &mut Settings,
) {
    let usual = Look::default();
    let changed = |same: bool| before.is_none() || !same;
    let before_look = before.unwrap_or(&usual);
    if changed(look.mode == before_look.mode)
        && let Some(mode) = look.mode.as_deref().and_then(modes::find)
        && !std::ptr::eq(mode, settings.mode)
    {
        settings.choose_mode(mode);
    }
    if changed(look.settings == before_look.settings && look.mode == before_look.mode) {
        let own = settings.mode_settings.common();
        settings.mode_settings = look.settings.clone();
        // What the program's preset sets holds where the tour says nothing.
        for (name, value) in own.0 {
            settings.mode_settings.0.entry(name).or_insert(value);
        }
    }
    if changed(look.attribute == before_look.attribute) {
        settings.attribute = match &look.attribute {
            Attribute::Named(name) if !attributes.contains(name) => Attribute::Automatic,
            known => known.clone(),
        };
    }
    if let Some(transfer) = &look.transfer
        && changed(look.transfer == before_look.transfer)
    {
        settings.transfer.clone_from(transfer);
        settings.keep_transfer = true;
    }
    if changed(look.families == before_look.families) {
        let shown = |name: &FamilyName| look.families.as_ref().is_none_or(|names| names.contains(name));
        settings.families = families.iter().map(shown).collect();
    }
    if let Some(annotations) =
        look.annotations.as_ref().filter(|own| changed(Some(*own) == before_look.annotations.as_ref()))
    {
        settings.annotations.clone_from(annotations);
    }
    if let Some(error_px) = look.error_px.filter(|own| changed(Some(*own) == before_look.error_px)) {
        settings.error_px = error_px;
    }
    if changed(look.cut == before_look.cut) {
        settings.cut = look.cut;
    }
    if changed(look.selections == before_look.selections) {
        settings.selections.clone_from(&look.selections);
    }
}

/// The look that the settings show.
pub fn of(settings: &Settings, families: &[FamilyName]) -> Look {
    let shown: Vec<FamilyName> =
        families.iter().zip(&settings.families).filter(|(_, shown)| **shown).map(|(name, _)| *name).collect();
    Look {
        mode: Some(settings.mode.name.to_owned()),
        settings: settings.mode_settings.clone(),
        attribute: settings.attribute.clone(),
        families: (shown.len() < families.len()).then_some(shown),
        transfer: Some(settings.transfer.clone()),
        annotations: Some(settings.annotations.clone()),
        error_px: Some(settings.error_px),
        cut: settings.cut,
        selections: settings.selections.clone(),
    }
}

/// What a keyframe has to say for a look to follow another.
pub fn difference(before: &Look, now: &Look) -> Keyframe {
    let another_mode = before.mode != now.mode;
    let mut settings = now.settings.clone();
    if !another_mode {
        settings.0.retain(|name, value| before.settings.0.get(name) != Some(value));
    }
    // Where all families come back, they have to be named.
    let families = match (&before.families, &now.families) {
        (Some(_), None) => Some(FamilyName::GADGET.to_vec()),
        (before, now) => now.clone().filter(|_| before != now),
    };
    Keyframe {
        mode: now.mode.clone().filter(|_| another_mode),
        settings,
        attribute: (before.attribute != now.attribute).then(|| now.attribute.clone()),
        families,
        transfer: now.transfer.clone().filter(|_| another_mode || before.transfer != now.transfer),
        annotations: now.annotations.clone().filter(|_| before.annotations != now.annotations),
        error_px: now.error_px.filter(|_| before.error_px != now.error_px),
        cut: (before.cut != now.cut).then_some(now.cut),
        selections: (before.selections != now.selections).then(|| now.selections.clone()),
        ..Keyframe::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::Range;
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
        let mut look = Look::default();
        let mut shown: Option<Look> = None;
        let mut window = Settings::new(&Preset::embedded("desktop").unwrap(), None);
        window.families = vec![true, true];
        for (i, wanted) in all.iter().enumerate() {
            let now = of(wanted, &FAMILIES);
            look = look.changed(&difference(&look, &now));
            let same_families = |a: &Look| a.families.clone().filter(|names| names.len() < 3);
            assert_eq!(Look { families: same_families(&look), ..look.clone() }, now, "{i}");
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
        show(Some(&look), &Look { cut: Default::default(), ..look.clone() }, &[], &FAMILIES, &mut window);
        assert_eq!(window.error_px, 9.0);
        show(Some(&look), &Look { error_px: Some(1.5), ..look.clone() }, &[], &FAMILIES, &mut window);
        assert_eq!(window.error_px, 1.5);
    }
}
