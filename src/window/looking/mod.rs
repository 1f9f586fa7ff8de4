//! Looking closer: what a click says of a particle, distances, regions drawn with the mouse, their sums over the whole data, and
//! selections.
//!
//! The window's layout tells where the pointer is ([`mod@pointer`]); the [tool](Tool) in hand makes of it a particle to inspect
//! ([`Inspector`]), two points to measure between, or a region ([`Stroke`]) that is summed up ([`prober`]) and may be kept as a
//! selection; of heights the samples, a profile, or the roughness of a region ([`mod@heights`]); [`marks`] and [`drawing`] show all that over the picture.
//! [`plotting`] finds what the panel plots beside it.

pub mod approach;
pub mod asking;
pub mod drawing;
pub mod followed;
pub mod following;
pub mod heights;
pub mod ids;
pub mod inspector;
pub mod keeping;
pub mod marks;
pub mod plotting;
pub mod pointer;
pub mod prober;
pub mod report;
pub mod seen;
pub mod state;

pub use inspector::Inspector;
pub use state::{LookingState, RangeDraft, Visit};

use super::camera::CameraSystems;
use super::hidden::Hiding;
use super::input::{PointerOwner, TOOL_KEYS, is_control};
use super::pages::{PageSystems, ViewSelection};
use super::pick::NO_PLACES;
use super::picture::Picture;
use super::playhead::Playhead;
use super::scene::{Scene, Settings};
use super::state::answer::Answer;
use super::state::notices::Notices;
use super::state::tool::{Stroke, Tool};
use super::statistics::ActiveBackend;
use crate::explore::Members;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_egui::EguiPostUpdateSet;
use heights::{Asked, OnHeights, Strokes};
use pointer::PicturePointer;
use prober::Prober;
use seen::{InSight, Seen};

/// The places whose distance is measured, in the order of clicks; two at most.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Measure(pub Vec<DVec3>);

/// Everything that looks closer.
pub struct LookingPlugin;

impl Plugin for LookingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PicturePointer>()
            .init_resource::<approach::DoubleClick>()
            .init_resource::<Tool>()
            .init_resource::<Stroke>()
            .init_resource::<Measure>()
            .init_resource::<Inspector>()
            .init_resource::<Prober>()
            .init_resource::<OnHeights>()
            .init_resource::<Hiding>()
            .init_resource::<Visit>()
            .init_resource::<RangeDraft>()
            .init_resource::<crate::window::bookmarks::AskedBookmark>()
            .init_resource::<keeping::Keeping>()
            .init_resource::<plotting::Plotting>()
            .init_resource::<marks::MarkLayer>()
            .init_resource::<ids::LookedUp>()
            .init_resource::<ids::ByIds>()
            .init_resource::<followed::FollowedSets>()
            .init_resource::<following::FollowedSelection>()
            .add_systems(
                Update,
                (
                    (forget_other_data, inspector::receive_particle).chain(),
                    (take_tool, receive_sums, keeping::receive_tables, plotting::follow_plot),
                    (ids::keep_ids, ids::look_up).chain().after(crate::window::adopt::adopt_opened),
                    (followed::follow, following::find_center)
                        .chain()
                        .after(crate::window::adopt::adopt_opened)
                        .after(crate::window::playhead::show_moment),
                ),
            )
            .add_systems(
                PostUpdate,
                (
                    (use_tool, state::fly_to_visit, approach::approach)
                        .before(CameraSystems::Steer)
                        .after(EguiPostUpdateSet::ProcessOutput),
                    marks::draw_marks.in_set(PageSystems::Serve),
                ),
            );
    }
}

/// Takes the tool whose key is pressed into the hand.
fn take_tool(keys: Res<ButtonInput<KeyCode>>, owner: Res<PointerOwner>, mut tool: ResMut<Tool>) {
    if is_control(&keys) || !owner.keyboard_is_free() {
        return;
    }
    if let Some((_, wanted)) = TOOL_KEYS.iter().find(|(key, _)| keys.just_pressed(*key)) {
        tool.set_if_neq(*wanted);
    }
}

/// Takes what has been found out.
fn receive_sums(
    mut prober: ResMut<Prober>,
    mut heights: ResMut<OnHeights>,
    scene: Option<Res<Scene>>,
    playhead: Option<Res<Playhead>>,
) {
    heights.bypass_change_detection().receive();
    let prober = prober.bypass_change_detection();
    prober.sums.receive();
    if let Some(scene) = scene {
        prober.keep_up(&scene, playhead.is_some_and(|playhead| playhead.is_playing()));
    }
}

/// Forgets what was found out about another file.
fn forget_other_data(
    scene: Option<Res<Scene>>,
    mut known: Local<(u32, u32)>,
    mut measure: ResMut<Measure>,
    mut inspector: ResMut<Inspector>,
    mut prober: ResMut<Prober>,
    mut heights: ResMut<OnHeights>,
    mut keeping: ResMut<keeping::Keeping>,
) {
    let now = scene.map_or((0, 0), |scene| (scene.dataset, scene.generation));
    if *known != now {
        // At another moment of a run a region is what it was; its sums are asked for once more.
        if known.0 != now.0 {
            *prober = Prober::default();
            *heights = OnHeights::default();
            keeping.over_time = Answer::Nothing;
        }
        *known = now;
        measure.0.clear();
        *inspector = Inspector::default();
    }
}

/// Does with the pointer what the tool in hand does.
fn use_tool(
    pointer: Res<PicturePointer>,
    tool: Res<Tool>,
    (scene, settings): (Option<Res<Scene>>, Res<Settings>),
    selection: Res<ViewSelection>,
    (picture, backend): (Res<Picture>, Res<ActiveBackend>),
    mut stroke: ResMut<Stroke>,
    mut measure: ResMut<Measure>,
    mut inspector: ResMut<Inspector>,
    (mut prober, mut heights, in_sight): (ResMut<Prober>, ResMut<OnHeights>, InSight),
    mut notices: ResMut<Notices>,
    camera: Single<&super::camera::Viewpoint, With<super::picture::DataCamera>>,
) {
    let (Some(scene), Some(view), Some(at)) = (scene, selection.view, pointer.at) else { return };
    if !(pointer.pressed || pointer.held || pointer.released || pointer.clicked) {
        return;
    }
    if *backend == ActiveBackend::Surround {
        if pointer.clicked {
            notices.info(NO_PLACES);
        }
        return;
    }
    let at = picture.pixel(at).as_dvec2().to_array();
    let fields = scene.fields(&settings);
    let asked = Asked { fields: &fields, settings: &settings.look.settings, view };
    let mouse = Strokes { at, pressed: pointer.pressed, released: pointer.released, clicked: pointer.clicked };
    let heights = heights.bypass_change_detection();
    let is_about_heights = scene.is_about_heights(settings.mode);
    if !fields.is_empty() && (is_about_heights || *tool == Tool::Profile) {
        if pointer.pressed {
            stroke.begin(camera.target, view, at);
        } else {
            stroke.extend(at);
        }
        heights.is_asked = true;
        heights.use_tool(*tool, &asked, mouse, &mut notices);
        if pointer.released || pointer.clicked {
            *stroke = Stroke::default();
        }
        return;
    }
    let seen = || in_sight.at(at).unwrap_or(Seen::Nothing);
    // Where nothing is, the plane of the target is meant.
    let place = || match seen() {
        Seen::Particle(picked) => picked.position,
        Seen::Surface(place) => place,
        Seen::Nothing => view.at_depth(at, view.to_camera(camera.target).z),
    };
    match *tool {
        Tool::Inspect if pointer.clicked => {
            *inspector = Inspector::default();
            let seen = seen();
            heights.is_asked = matches!(seen, Seen::Surface(_));
            match seen {
                Seen::Particle(picked) => inspector.look(&scene, picked.particle),
                Seen::Surface(_) => heights.use_tool(*tool, &asked, mouse, &mut notices),
                Seen::Nothing => {}
            }
        }
        Tool::Measure if pointer.clicked => {
            if measure.0.len() >= 2 {
                measure.0.clear();
            }
            measure.0.push(place());
        }
        Tool::Inspect | Tool::Measure => {}
        Tool::Profile => {
            if pointer.clicked || pointer.released {
                notices.info("profiles are drawn over heights");
            }
        }
        drawn => {
            if pointer.pressed {
                stroke.begin(place(), view, at);
            } else if pointer.held {
                stroke.extend(at);
            }
            if pointer.released {
                stroke.extend(at);
                let region = std::mem::take(&mut *stroke).region(drawn);
                match region.map(|region| region.check().map(|()| region)) {
                    Some(Ok(region)) => prober.start(&scene, Members::Region(region), false),
                    Some(Err(error)) => notices.error(error.to_string()),
                    None => notices.info(drawn.help()),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::touring::player::tests::Window;

    #[test]
    fn what_was_found_out_about_other_data_is_forgotten() {
        let mut window = Window::new();
        window
            .app
            .init_resource::<Measure>()
            .init_resource::<Inspector>()
            .init_resource::<Prober>()
            .init_resource::<OnHeights>()
            .init_resource::<keeping::Keeping>()
            .add_systems(Update, forget_other_data);
        window.frame(0.0);
        let is_known = |window: &Window| {
            let world = window.app.world();
            let over_time = &world.resource::<keeping::Keeping>().over_time;
            [!matches!(over_time, Answer::Nothing), world.resource::<Prober>().members.is_some()]
        };
        let world = window.app.world_mut();
        world.resource_mut::<keeping::Keeping>().over_time = Answer::Failed("this run is damaged".into());
        world.resource_mut::<Prober>().members = Some(Members::Region(crate::explore::Region::whole()));
        window.frame(0.0);
        assert_eq!(is_known(&window), [true; 2]);
        // Another step of the run.
        window.app.world_mut().resource_mut::<Scene>().generation += 1;
        window.frame(0.0);
        assert_eq!(is_known(&window), [true; 2]);
        window.app.world_mut().resource_mut::<Scene>().dataset += 1;
        window.frame(0.0);
        assert_eq!(is_known(&window), [false; 2]);
    }
}
