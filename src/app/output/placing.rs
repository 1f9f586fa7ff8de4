//! An output's window on its monitor: put there at the start, and again when a monitor that was gone is back.

use super::{OutputWindow, monitor_name};
use crate::app::messages::Messages;
use crate::outputs::Monitor as Wanted;
use bevy::prelude::*;
use bevy::window::{Monitor, MonitorSelection, PrimaryWindow, WindowMode, WindowPosition};

/// Where the window was put.
#[derive(Resource, Default, PartialEq, Eq)]
pub(super) enum Placed {
    /// Nowhere yet.
    #[default]
    Not,
    /// On that monitor, or on the desktop.
    On(Option<Entity>),
    /// Its monitor is not there.
    Missing,
}

/// Puts the window where its output belongs.
pub(super) fn place_window(
    output: Res<OutputWindow>,
    mut placed: ResMut<Placed>,
    mut messages: ResMut<Messages>,
    monitors: Query<(Entity, &Monitor)>,
    mut windows: Query<&mut Window, With<PrimaryWindow>>,
) {
    let Ok(mut window) = windows.single_mut() else { return };
    // The system tells of its monitors a moment after the window opens.
    if monitors.is_empty() && *placed == Placed::Not && output.output.monitor.is_some() {
        return;
    }
    let mut sorted: Vec<(Entity, &Monitor)> = monitors.iter().collect();
    sorted.sort_by_key(|(entity, _)| *entity);
    let wanted = output.output.monitor.as_ref().map(|wanted| {
        (
            wanted,
            match wanted {
                Wanted::Number(number) => sorted.get((*number as usize).wrapping_sub(1)),
                Wanted::Named(name) => sorted.iter().find(|(_, monitor)| monitor.name.as_ref() == Some(name)),
            },
        )
    });
    let now = match wanted {
        None => Placed::On(None),
        Some((_, Some((entity, _)))) => Placed::On(Some(*entity)),
        Some((_, None)) => Placed::Missing,
    };
    if now == *placed {
        return;
    }
    let corner = match wanted {
        Some((wanted, None)) => {
            let names: Vec<String> = sorted
                .iter()
                .enumerate()
                .map(|(i, (_, monitor))| {
                    format!("{} {}", i + 1, monitor.name.as_deref().unwrap_or("")).trim().to_owned()
                })
                .collect();
            let wanted = monitor_name(wanted);
            messages.error(format!(
                "{wanted} is not there: the window stays on the desktop until it is; there are {}",
                names.join(", ")
            ));
            window.mode = WindowMode::Windowed;
            IVec2::ZERO
        }
        Some((_, Some((_, monitor)))) => monitor.physical_position,
        None => IVec2::ZERO,
    };
    match (output.output.window, &now) {
        (None, Placed::On(Some(entity))) => {
            window.mode = WindowMode::BorderlessFullscreen(MonitorSelection::Entity(*entity));
        }
        (Some((left, top, width, height)), _) => {
            window.mode = WindowMode::Windowed;
            window.decorations = false;
            window.position = WindowPosition::At(corner + IVec2::new(left, top));
            window.resolution.set_physical_resolution(width, height);
        }
        (None, _) => {}
    }
    *placed = now;
}
