//! The panels in two docks: what the data is and how it is drawn at the left, what one learns of it at the right.

pub mod histogram;
pub mod section;
pub mod transfer;

mod annotations;
mod bookmarks;
mod closer;
mod comparison;
mod dataset;
mod display;
mod heights;
mod light;
mod messages;
mod mode;
mod objects;
mod over_time;
mod paths;
mod plots;
mod probe;
mod projection;
mod reach;
mod selections;
mod statistics;
mod tour;
mod view;

pub use section::{Section, SectionData, Sections};

use super::camera::Viewpoint;
use super::comparison::Comparison;
use super::exposure::Exposure;
use super::files::{Ask, Files, menu};
use super::history::{History, Step};
use super::look::Look;
use super::looking::LookingState;
use super::open::Openings;
use super::paths::Paths;
use super::picture::DataCamera;
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::state::choices::Choices;
use super::state::notices::Notices;
use super::state::panels::{Closed, Dock, Shown};
use super::state::progress::SharedProgress;
use super::statistics::{Converged, FrameClock, Statistics};
use super::theme;
use super::touring::Player;
use super::transfer_presets::TransferPresets;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use bevy_egui::egui::{self, RichText, Ui};

/// The window's own sections, from the top of each dock.
static SECTIONS: [&Section; 16] = [
    &dataset::SECTION,
    &mode::SECTION,
    &display::SECTION,
    &paths::SECTION,
    &view::SECTION,
    &comparison::SECTION,
    &annotations::SECTION,
    &closer::SECTION,
    &probe::SECTION,
    &objects::SECTION,
    // What is brushed becomes a selection: the list of those is below, so that the plot stays where it is when it grows.
    &plots::SECTION,
    &selections::SECTION,
    &bookmarks::SECTION,
    &tour::SECTION,
    &statistics::SECTION,
    &messages::SECTION,
];

/// The panels: their sections, and what those show that come from outside.
pub struct PanelPlugin;

impl Plugin for PanelPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(Sections::new(&SECTIONS))
            .init_resource::<SectionData>()
            .add_systems(Update, refuse_unknown_sections.run_if(resource_changed::<Preset>));
    }
}

/// Tells of names in the preset's list of closed sections that no section has.
fn refuse_unknown_sections(preset: Res<Preset>, sections: Res<Sections>, mut notices: ResMut<Notices>) {
    for name in preset.panel.closed.iter().filter(|name| !sections.names().any(|known| known == name.as_str())) {
        let names: Vec<&str> = sections.names().collect();
        notices.error(format!("panel.closed: found {name}, expected some of {}", names.join(", ")));
    }
}

/// All that the panels show and edit.
#[derive(SystemParam)]
pub struct PanelState<'w, 's> {
    /// The open dataset.
    pub scene: Option<Res<'w, Scene>>,
    /// What is shown of the settings in the picture.
    pub look: Option<Res<'w, Look>>,
    /// The latest notices.
    pub notices: ResMut<'w, Notices>,
    /// What the user has chosen.
    pub settings: ResMut<'w, Settings>,
    /// Which sections are closed.
    pub closed: ResMut<'w, Closed>,
    /// Which panels are shown, and whether the help page is.
    pub shown: ResMut<'w, Shown>,
    /// The tour.
    pub player: ResMut<'w, Player>,
    /// What looks closer.
    pub looking: LookingState<'w>,
    /// What sections from outside of the window show.
    pub data: ResMut<'w, SectionData>,
    /// The clock.
    pub time: Res<'w, Time<Real>>,
    sections: Res<'w, Sections>,
    history: ResMut<'w, History>,
    /// Files, and what is asked for.
    pub files: ResMut<'w, Files>,
    /// Paths over the picture.
    pub paths: ResMut<'w, Paths>,
    /// Two hierarchies side by side.
    pub comparison: ResMut<'w, Comparison>,
    preset: Res<'w, Preset>,
    exposure: Res<'w, Exposure>,
    choices: Res<'w, Choices>,
    presets: ResMut<'w, TransferPresets>,
    statistics: Res<'w, Statistics>,
    converged: Res<'w, Converged>,
    clock: Res<'w, FrameClock>,
    openings: ResMut<'w, Openings>,
    camera: Query<'w, 's, &'static Viewpoint, With<DataCamera>>,
}

impl PanelState<'_, '_> {
    /// Draws a dock's contents.
    pub fn show(&mut self, ui: &mut Ui, dock: Dock) {
        if dock == Dock::Left {
            ui.scope(|ui| {
                ui.set_max_width(ui.available_width() - theme::SCROLL_ROOM);
                self.header(ui);
                self.opening(ui);
            });
        }
        section::show_dock(ui, dock, self);
    }

    /// Whether nothing is shown, opened or waited for.
    pub fn is_idle(&self) -> bool {
        self.scene.is_none() && self.openings.progress().is_none() && self.files.has_page()
    }

    /// The program's name, and what one can do at any time.
    fn header(&mut self, ui: &mut Ui) {
        let [past, future] = self.history.steps();
        ui.horizontal(|ui| {
            ui.label(RichText::new("deepfield").size(17.0).color(theme::TEXT).strong());
            menu::show(ui, &mut self.files, self.scene.is_some());
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                let mut button =
                    |text: &str, name: &str, enabled: bool, help: &str| theme::button(ui, name, text, enabled, help);
                if button("F1", "help", true, "Keys and gestures (F1)") {
                    self.shown.help = !self.shown.help;
                }
                if button("Save", "save", self.scene.is_some(), "Save the scene (Ctrl+S)") {
                    self.files.asked = Some(Ask::Save);
                }
                if button("Redo", "redo", future > 0, "Redo what was undone (Ctrl+Shift+Z, Ctrl+Y)") {
                    self.history.asked = Some(Step::Redo);
                }
                if button("Undo", "undo", past > 0, "Undo the last change of a setting (Ctrl+Z)") {
                    self.history.asked = Some(Step::Undo);
                }
            });
        });
        ui.add_space(6.0);
    }

    /// What is being opened, with a bar.
    fn opening(&self, ui: &mut Ui) {
        let Some((path, stage, share)) = self.openings.progress() else { return };
        theme::section(ui, "Opening");
        let name = path.file_name().map_or_else(|| path.to_string_lossy(), |name| name.to_string_lossy());
        ui.add(egui::Label::new(RichText::new(name).color(theme::TEXT)).truncate());
        match share {
            Some(share) => {
                theme::fact(ui, &stage, format!("{:.0} %", 100.0 * share));
                theme::bar(ui, share, theme::ACCENT);
            }
            None => {
                theme::fact(ui, &stage, "");
                theme::busy_bar(ui, self.time.elapsed_secs_f64());
            }
        }
        ui.add_space(4.0);
        ui.ctx().request_repaint();
    }
}

/// How far something is that is being worked out; frames follow one another until it is here.
fn progress(ui: &mut Ui, progress: &SharedProgress) {
    theme::bar(ui, progress.state().1.unwrap_or(0.0), theme::ACCENT);
    ui.ctx().request_repaint();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::{Region, SelectionSet};
    use crate::look::{Bookmark, Camera};
    use crate::modes;
    use crate::window::look::follow_settings;
    use crate::window::looking::LookingPlugin;
    use crate::window::looking::prober::Prober;
    use crate::window::objects::Objects;
    use crate::window::scene_io::Bookmarks;
    use crate::window::state::plots::PlotChoice;
    use crate::window::touring::player::tests::Window;
    use bevy::ecs::system::RunSystemOnce;
    use bevy_egui::egui::accesskit::Action;
    use std::sync::Arc;

    #[test]
    fn the_desktop_preset_names_every_section_and_none_sends_users_to_the_source() {
        for (name, text) in crate::window::preset::EMBEDDED {
            for closed in &crate::window::preset::Preset::embedded(name).unwrap().panel.closed {
                assert!(SECTIONS.iter().any(|section| section.name == closed), "{name}: {closed}");
            }
            assert!(!text.contains("src/"), "{name}: a user has no source");
        }
        let desktop = crate::window::preset::EMBEDDED[0].1;
        for section in SECTIONS {
            assert!(desktop.contains(section.name), "desktop.ron does not name the section {}", section.name);
        }
    }

    static OWN: Section = Section { name: "own", title: "Own", dock: Dock::Right, applies: |_| true, show: |_, _| {} };

    #[test]
    fn sections_are_registered_and_presets_name_only_those() {
        let mut sections = Sections::new(&SECTIONS);
        sections.add_above("statistics", &OWN);
        let names: Vec<&str> = sections.names().collect();
        let at = |name: &str| names.iter().position(|known| *known == name);
        assert_eq!(at("own").map(|at| at + 1), at("statistics"));
        let mut preset = Preset::default();
        preset.panel.closed = ["own", "data", "attic"].map(String::from).to_vec();
        let mut app = App::new();
        app.insert_resource(sections).insert_resource(preset).init_resource::<Notices>();
        app.add_systems(Update, refuse_unknown_sections.run_if(resource_changed::<Preset>));
        (0..3).for_each(|_| app.update());
        let said: Vec<&str> = app.world().resource::<Notices>().all().map(|notice| notice.text.as_str()).collect();
        assert!(
            said.len() == 1 && said[0].starts_with("panel.closed: found attic, expected some of data, "),
            "{said:?}"
        );
    }

    /// Those who hear the window instead of seeing it are told of every control that the keyboard reaches, whatever the mode.
    #[test]
    fn what_the_keyboard_reaches_in_the_panels_has_a_name() {
        let mut window = Window::new();
        window
            .app
            .add_plugins((PanelPlugin, LookingPlugin))
            .insert_resource(Openings::new(Arc::new(|_, _, _| Err("no data".to_owned()))))
            .init_resource::<Closed>()
            .init_resource::<Shown>()
            .init_resource::<Objects>()
            .init_resource::<PlotChoice>()
            .init_resource::<History>()
            .init_resource::<Files>()
            .init_resource::<Paths>()
            .init_resource::<Comparison>()
            .init_resource::<Exposure>()
            .init_resource::<TransferPresets>()
            .init_resource::<Statistics>()
            .init_resource::<Converged>()
            .init_resource::<FrameClock>();
        let camera = Camera { eye: [0.0; 3], target: [1.0; 3], up: [0.0, 1.0, 0.0], fov: 45.0, ortho: None };
        let bookmark = Bookmark { key: 1, name: "near".to_owned(), camera };
        window.app.insert_resource(Bookmarks(vec![bookmark]));
        let ctx = egui::Context::default();
        ctx.enable_accesskit();
        theme::apply(&ctx);
        let world = window.app.world_mut();
        world.resource_mut::<Notices>().error("a message");
        let set = SelectionSet::new("cluster", Region::whole(), 0);
        world.resource_mut::<Prober>().members = Some(set.members.clone());
        world.resource_mut::<Settings>().selections.push(set);
        for mode in modes::all() {
            world.resource_mut::<Settings>().choose_mode(mode);
            world.remove_resource::<Look>();
            world.run_system_once(follow_settings).unwrap();
            let own = ctx.clone();
            let draw = move |mut panel: PanelState| {
                let screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(800.0, 6000.0)));
                let mut output = own.run_ui(egui::RawInput { screen_rect, ..egui::RawInput::default() }, |ui| {
                    ui.columns(2, |docks| {
                        panel.show(&mut docks[0], Dock::Left);
                        panel.show(&mut docks[1], Dock::Right);
                    });
                });
                // Nobody draws them.
                output.textures_delta.clear();
                output.platform_output.accesskit_update.unwrap().nodes
            };
            let nodes = world.run_system_once(draw).unwrap();
            let reached = nodes.iter().map(|(_, node)| node).filter(|node| node.supports_action(Action::Focus));
            let (named, nameless): (Vec<_>, Vec<_>) = reached.partition(|node| {
                node.label().is_some_and(|name| !name.trim().is_empty()) || !node.labelled_by().is_empty()
            });
            assert!(nameless.is_empty(), "{}: {nameless:#?} among {:?}", mode.name, theme::take_controls(&ctx));
            assert!(named.len() > 20, "{}: {} controls", mode.name, named.len());
        }
    }

    #[test]
    fn sections_from_outside_have_one_value_of_a_type() {
        let mut data = SectionData::default();
        assert!(data.get::<u8>().is_none() && data.put(3_u8).is_none() && data.put("words").is_none());
        *data.get_mut::<u8>().unwrap() += 1;
        assert_eq!((data.put(9_u8), data.get::<u8>(), data.get::<&str>()), (Some(4), Some(&9), Some(&"words")));
    }
}
