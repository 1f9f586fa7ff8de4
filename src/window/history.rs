//! Undo and redo: snapshots of all settings, one for each edit that is finished.
//!
//! An edit is finished when no button of the mouse is held and the settings have not changed for a few frames: a drag is one step,
//! and what the program itself adjusts after a choice (the transfer function of another mode) belongs to the choice.

use super::input::{PointerOwner, is_control};
use super::scene::{Scene, Settings, TransferKept};
use super::touring::Player;
use bevy::prelude::*;
use std::collections::VecDeque;

/// Steps that are kept.
const KEPT: usize = 200;
/// Frames without a change after which an edit is finished.
const QUIET_FRAMES: u32 = 3;

/// A step through the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Back to the settings before the last edit.
    Undo,
    /// Forth to the settings that were undone.
    Redo,
}

/// The settings as they were, are, and were before being undone.
#[derive(Resource, Default)]
pub struct History {
    past: VecDeque<Settings>,
    present: Option<Settings>,
    future: Vec<Settings>,
    /// Settings that differ from the present ones, and for how many frames they have not changed.
    edited: Option<(Settings, u32)>,
    /// The [`Scene::subject`] that all of this is of.
    subject: u32,
    /// A step that a button of the panel asks for.
    pub asked: Option<Step>,
}

impl History {
    /// How many edits can be undone and redone.
    pub fn steps(&self) -> [usize; 2] {
        [self.past.len(), self.future.len()]
    }

    /// The settings after the last edit that is finished; `None` until those of what was opened are settled.
    pub fn present(&self) -> Option<&Settings> {
        self.present.as_ref()
    }

    /// Forgets all steps; the next settings that stay are where it begins.
    pub fn restart(&mut self) {
        let subject = self.subject;
        *self = History { subject, ..History::default() };
    }

    /// Looks at the settings of a frame; `busy`: an edit may be under way.
    pub fn observe(&mut self, settings: &Settings, busy: bool) {
        if self.present.as_ref() == Some(settings) {
            self.edited = None;
            return;
        }
        let quiet = match &self.edited {
            Some((edited, frames)) if edited == settings && !busy => frames + 1,
            _ => 0,
        };
        if quiet >= QUIET_FRAMES {
            self.finish(settings);
        } else {
            self.edited = Some((settings.clone(), quiet));
        }
    }

    /// Makes the settings the present ones, and those before them a step.
    fn finish(&mut self, settings: &Settings) {
        self.edited = None;
        if let Some(before) = self.present.replace(settings.clone()) {
            self.past.push_back(before);
            self.future.clear();
            if self.past.len() > KEPT {
                self.past.pop_front();
            }
        }
    }

    /// Takes a step: the settings to show now, if there are any.
    pub fn step(&mut self, step: Step, settings: &Settings) -> Option<Settings> {
        // What is being edited is undone first.
        if self.present.as_ref().is_some_and(|present| present != settings) {
            self.finish(settings);
        }
        let next = match step {
            Step::Undo => self.past.pop_back(),
            Step::Redo => self.future.pop(),
        }?;
        let before = self.present.replace(next.clone());
        match step {
            Step::Undo => self.future.extend(before),
            Step::Redo => self.past.extend(before),
        }
        Some(next)
    }
}

/// Carries out Ctrl+Z, Ctrl+Shift+Z and Ctrl+Y, and what the panel's buttons ask for.
pub(super) fn undo_and_redo(
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    mut history: ResMut<History>,
    mut settings: ResMut<Settings>,
    mut kept: MessageWriter<TransferKept>,
) {
    let held = |pair: [KeyCode; 2]| keys.any_pressed(pair);
    let control = is_control(&keys) && owner.keyboard_is_free();
    let shift = held([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
    let pressed = match () {
        () if control && keys.just_pressed(KeyCode::KeyZ) => Some(if shift { Step::Redo } else { Step::Undo }),
        () if control && keys.just_pressed(KeyCode::KeyY) => Some(Step::Redo),
        () => None,
    };
    let Some(step) = history.asked.take().or(pressed) else { return };
    if let Some(next) = history.step(step, &settings) {
        *settings = next;
        kept.write(TransferKept);
    }
}

/// Notes what has been edited.
pub(super) fn record_settings(
    settings: Res<Settings>,
    scene: Option<Res<Scene>>,
    buttons: Res<ButtonInput<MouseButton>>,
    player: Res<Player>,
    mut history: ResMut<History>,
) {
    let history = history.bypass_change_detection();
    let subject = scene.map_or(0, |scene| scene.subject);
    if history.subject != subject {
        // Settings of one file mean nothing for another.
        history.restart();
        history.subject = subject;
    }
    // A tour that plays is one step.
    let busy = buttons.get_pressed().next().is_some() || player.clock().is_running();
    history.observe(&settings, busy);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::colormap::ColorMap;
    use crate::color::transfer::Range;
    use crate::explore::{Region, SelectionSet};
    use crate::look::Attribute;
    use crate::mode::{SettingKind, SettingValue};
    use crate::modes;
    use crate::view::cut::{Axis, ClipBox, Fade, Slab};
    use crate::view::{CutSettings, Eyes, Periodic, Stereo, StereoKind, Surround};
    use crate::window::preset::Preset;
    use crate::window::touring::player::tests::Window;
    use bevy::math::DVec3;
    use proptest::prelude::*;

    /// One edit, from three random numbers: of any setting of the mode, or of anything else that the panels edit.
    fn edit(settings: &mut Settings, [what, value, more]: [f64; 3]) {
        let own: Vec<_> = settings.mode.all_settings().collect();
        let pick = (what * (own.len() + 11) as f64) as usize;
        if let Some(setting) = own.get(pick) {
            let between = |min: f64, max: f64, at: f64| min + at * (max.min(1e6) - min);
            let new = match setting.kind {
                SettingKind::Number { min, max, .. } => SettingValue::Number(between(min, max, value)),
                SettingKind::Flag { .. } => SettingValue::Flag(value < 0.5),
                SettingKind::Choice { options } => {
                    SettingValue::Name(options[(value * options.len() as f64) as usize].to_owned())
                }
                SettingKind::Column { .. } | SettingKind::Vector { .. } => SettingValue::Name(format!("field {value}")),
                SettingKind::Numbers { min, max, .. } => SettingValue::Numbers(vec![between(min, max, value)]),
                SettingKind::Colors { .. } => SettingValue::Names(vec![format!("#{:06x}", (value * 1e7) as u32)]),
            };
            setting.check(&new).unwrap();
            settings.set(setting, new);
            return;
        }
        match pick - own.len() {
            0 => settings.choose_mode(modes::all()[(value * modes::all().len() as f64) as usize]),
            1 => settings.attribute = Attribute::Named(format!("field {value}")),
            2 => settings.transfer.range = Range::Fixed(value, value + 1.0 + more),
            3 => {
                let maps: Vec<ColorMap> = ColorMap::all().collect();
                settings.transfer.color_map = maps[(value * maps.len() as f64) as usize].clone();
            }
            4 => settings.error_px = 0.1 + value,
            5 => settings.families = vec![value < 0.5, more < 0.5],
            6 => settings.lens.fov_deg = 10.0 + 90.0 * value,
            7 => settings.lens.parallel = value < 0.5,
            8 => {
                let region = Region::sphere(DVec3::splat(value), 0.1 + more);
                let number = settings.selections.len();
                settings.selections.push(SelectionSet::new("s", region, number));
            }
            9 => {
                settings.surround = Surround::Dome { aperture: 180.0 + 180.0 * value, tilt: 90.0 * more };
                let (kind, eyes) = (StereoKind::Omnidirectional, Eyes::OverUnder);
                let pair = Stereo { kind, separation: value, zero_parallax: 1.0, eyes };
                settings.stereo = (more < 0.5).then_some(pair);
            }
            _ => {
                settings.cut = CutSettings {
                    clip: (more < 0.7).then(|| ClipBox { min: DVec3::ZERO, max: DVec3::splat(value) }),
                    slab: (more > 0.3).then_some(Slab { axis: Axis::Y, middle: value, thickness: 1.0 }),
                    fade: (more > 0.5).then_some(Fade { start: value, length: 2.0 }),
                    periodic: if more < 0.4 { Periodic::Wrapped } else { Periodic::Once },
                }
            }
        }
    }

    fn rest(history: &mut History, settings: &Settings) {
        (0..=QUIET_FRAMES).for_each(|_| history.observe(settings, false));
    }

    proptest! {
        #![proptest_config(crate::cases::cases(64))]
        /// Undoing everything gives the start, redoing everything the end, with each state between passed on the way.
        #[test]
        fn all_undone_is_the_start_and_all_redone_is_the_end(
            mode in 0..modes::all().len(),
            edits in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 1..40),
        ) {
            let mut settings = Settings::new(&Preset::default(), Some(modes::all()[mode].name));
            let mut history = History::default();
            rest(&mut history, &settings);
            let mut states = vec![settings.clone()];
            for change in edits {
                edit(&mut settings, change);
                rest(&mut history, &settings);
                if states.last() != Some(&settings) {
                    states.push(settings.clone());
                }
            }
            prop_assert_eq!(history.steps(), [states.len() - 1, 0]);
            for state in states.iter().rev().skip(1) {
                settings = history.step(Step::Undo, &settings).unwrap();
                prop_assert!(settings == *state);
            }
            prop_assert!(history.step(Step::Undo, &settings).is_none());
            rest(&mut history, &settings);
            for state in &states[1..] {
                settings = history.step(Step::Redo, &settings).unwrap();
                prop_assert!(settings == *state);
            }
            prop_assert!(history.step(Step::Redo, &settings).is_none());
        }
    }

    #[test]
    fn more_of_what_is_open_leaves_the_steps_and_other_data_ends_them() {
        let mut window = Window::new();
        window.app.init_resource::<History>().add_systems(Last, record_settings);
        let past = |window: &mut Window| {
            (0..3 * QUIET_FRAMES).for_each(|_| window.frame(0.0));
            window.app.world().resource::<History>().steps()[0]
        };
        assert_eq!(past(&mut window), 0);
        window.app.world_mut().resource_mut::<Settings>().error_px = 7.0;
        assert_eq!(past(&mut window), 1);
        window.app.world_mut().resource_mut::<Scene>().dataset += 1;
        assert_eq!(past(&mut window), 1);
        window.app.world_mut().resource_mut::<Scene>().subject += 1;
        assert_eq!(past(&mut window), 0);
    }

    #[test]
    fn a_drag_is_one_step_and_an_edit_after_an_undo_ends_redoing() {
        let mut settings = Settings::new(&Preset::default(), None);
        let mut history = History::default();
        rest(&mut history, &settings);
        for i in 0..50 {
            settings.error_px = 1.0 + f64::from(i);
            history.observe(&settings, true);
        }
        assert_eq!(history.steps(), [0, 0], "the button is still down");
        rest(&mut history, &settings);
        assert_eq!(history.steps(), [1, 0]);
        // An edit that is not finished is undone as well.
        settings.error_px = 9.0;
        settings = history.step(Step::Undo, &settings).unwrap();
        assert_eq!(settings.error_px, 50.0);
        assert_eq!(history.steps(), [1, 1]);
        settings.error_px = 3.0;
        rest(&mut history, &settings);
        assert_eq!(history.steps(), [2, 0], "what was undone cannot be redone any more");
        for i in 0..2 * KEPT {
            settings.error_px = 0.1 * i as f64;
            rest(&mut history, &settings);
        }
        assert_eq!(history.steps()[0], KEPT, "the oldest steps make room");
    }
}
