//! What the panel's sections about looking closer show and edit.

use super::followed::FollowedSets;
use super::following::FollowedSelection;
use super::heights::OnHeights;
use super::ids::{ByIds, LookedUp};
use super::keeping::Keeping;
use super::plotting::Plotting;
use super::prober::Prober;
use super::{Inspector, Measure};
use crate::model::Bounds;
use crate::window::bookmarks::AskedBookmark;
use crate::window::camera::{Flight, Navigation, Viewpoint};
use crate::window::hidden::Hiding;
use crate::window::objects::Objects;
use crate::window::picture::{DataCamera, Picture};
use crate::window::preset::Preset;
use crate::window::scene_io::Bookmarks;
use crate::window::state::notices::Notices;
use crate::window::state::plots::PlotChoice;
use crate::window::state::tool::Tool;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;

/// The resources of these sections.
#[derive(SystemParam)]
pub struct LookingState<'w> {
    /// The tool in hand.
    pub tool: ResMut<'w, Tool>,
    /// What is measured.
    pub measure: Res<'w, Measure>,
    /// What was clicked.
    pub inspector: ResMut<'w, Inspector>,
    /// The region that is looked at.
    pub prober: ResMut<'w, Prober>,
    /// What was found out about heights.
    pub heights: ResMut<'w, OnHeights>,
    /// What lies behind them.
    pub hiding: Res<'w, Hiding>,
    /// Tables, and sums over time.
    pub keeping: ResMut<'w, Keeping>,
    /// What is plotted, and what is brushed in it.
    pub plotting: ResMut<'w, Plotting>,
    /// The plot that is chosen.
    pub plot: ResMut<'w, PlotChoice>,
    /// Where the particles of sets of ids are.
    pub looked_up: Res<'w, LookedUp>,
    /// Selections of a run that are followed.
    pub followed: Res<'w, FollowedSets>,
    /// Regions on their way to becoming sets of ids.
    pub by_ids: ResMut<'w, ByIds>,
    /// The selection that the camera follows.
    pub following: ResMut<'w, FollowedSelection>,
    /// Where to fly to.
    pub visit: ResMut<'w, Visit>,
    /// The range of values that is being typed.
    pub range: ResMut<'w, RangeDraft>,
    /// Named objects.
    pub objects: ResMut<'w, Objects>,
    /// Viewpoints on number keys.
    pub bookmarks: ResMut<'w, Bookmarks>,
    /// What to do with one of them.
    pub asked_bookmark: ResMut<'w, AskedBookmark>,
}

/// A box that a button of the panel asks to fly to.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct Visit(pub Option<Bounds>);

/// A range of values on its way to becoming a selection, as it is typed.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct RangeDraft {
    /// The field.
    pub field: String,
    /// Smallest value; no limit where it is empty.
    pub min: String,
    /// Largest value.
    pub max: String,
}

/// Flies to the box that is asked for, and turns around it from then on.
pub(super) fn fly_to_visit(
    mut commands: Commands,
    mut visit: ResMut<Visit>,
    picture: Res<Picture>,
    preset: Res<Preset>,
    mut notices: ResMut<Notices>,
    camera: Single<(Entity, &Viewpoint, &mut Navigation), With<DataCamera>>,
) {
    let Some(bounds) = visit.bypass_change_detection().0.take() else { return };
    let (entity, viewpoint, mut navigation) = camera.into_inner();
    let size = picture.size();
    match Viewpoint::around(bounds, viewpoint.fov_y, size.x, size.y) {
        Ok(around) => {
            *navigation = Navigation::Orbit;
            let distance = around.distance();
            let flight = Flight::to_place(*viewpoint, bounds.center(), distance, preset.camera.flight_secs);
            commands.entity(entity).insert(flight);
        }
        Err(error) => notices.error(error.to_string()),
    }
}
