//! An output's window on its monitor: put there at the start, again when something else has moved it, hidden while its monitor is
//! gone and back when that is.
//!
//! What Bevy knows of monitors is where they were when they came; where they are now the system is asked. A monitor that was
//! named by its number is known by its name from then on, because numbers change when others are unplugged.

use super::{OutputWindow, monitor_name};
use crate::show::rig::{Monitor as Wanted, Output};
use crate::window::state::notices::Notices;
use bevy::ecs::system::NonSendMarker;
use bevy::prelude::*;
use bevy::window::{Monitor, MonitorSelection, PrimaryWindow, WindowMode, WindowPosition};
use bevy::winit::WINIT_WINDOWS;
use std::time::Duration;

/// Time between two looks at where the window is; a window manager has done by then what it was asked for.
const PAUSE: Duration = Duration::from_millis(300);
/// Looks at a window in the wrong place, one after the other, before it is put to its place again.
const PATIENCE: u32 = 3;

/// A monitor as it is now.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MonitorPlace {
    pub name: String,
    pub corner: IVec2,
    pub size: UVec2,
}

/// A part of the desktop, physical pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Area {
    corner: IVec2,
    size: UVec2,
}

/// Where the window is to be.
#[derive(Clone, Debug, PartialEq)]
enum Goal {
    /// Wherever it is.
    Anywhere,
    /// There; all of a monitor where it has a name.
    On(Area, Option<String>),
    /// Nowhere: its monitor is not there.
    Missing,
}

/// Where the window was put.
#[derive(Resource, Default)]
pub(crate) struct Placed {
    /// The monitor's name, once it was found.
    known: Option<String>,
    goal: Option<Goal>,
    /// Whether it is still to fill its monitor.
    to_fill: bool,
    /// Looks at it in the wrong place.
    wrong: u32,
    /// When to look again, since the start.
    next: Duration,
    /// Whom to ask for monitors, once it was tried.
    #[cfg(target_os = "linux")]
    server: Option<Option<super::monitors::Server>>,
}

impl Placed {
    /// The monitors that there are: as the window says, or better.
    #[cfg(target_os = "linux")]
    fn places(&mut self, said: Vec<MonitorPlace>, is_x11: bool) -> Vec<MonitorPlace> {
        if !is_x11 {
            return said;
        }
        let server = self.server.get_or_insert_with(super::monitors::Server::connect);
        server.as_ref().and_then(super::monitors::Server::places).unwrap_or(said)
    }

    /// The monitors that there are.
    #[cfg(not(target_os = "linux"))]
    fn places(&mut self, said: Vec<MonitorPlace>, _is_x11: bool) -> Vec<MonitorPlace> {
        said
    }
}

/// Where an output's window is to be, and the name of its monitor.
fn goal(output: &Output, known: Option<&str>, places: &[MonitorPlace]) -> (Goal, Option<String>) {
    let place = match (&output.monitor, known) {
        (None, _) => None,
        (Some(_), Some(name)) => Some(places.iter().find(|place| place.name == name)),
        (Some(Wanted::Number(number)), None) => Some(places.get((*number as usize).wrapping_sub(1))),
        (Some(Wanted::Named(name)), None) => Some(places.iter().find(|place| place.name == *name)),
    };
    let goal = match (place, output.window) {
        (Some(None), _) => Goal::Missing,
        (None, None) => Goal::Anywhere,
        (place, Some((left, top, width, height))) => {
            let corner = place.flatten().map_or(IVec2::ZERO, |place| place.corner) + IVec2::new(left, top);
            Goal::On(Area { corner, size: UVec2::new(width, height) }, None)
        }
        (Some(Some(place)), None) => {
            Goal::On(Area { corner: place.corner, size: place.size }, Some(place.name.clone()))
        }
    };
    (goal, place.flatten().map(|place| place.name.clone()))
}

/// The monitors that there are, and where the window is if the system says so.
fn look(window: Entity) -> Option<(Vec<MonitorPlace>, Option<Area>)> {
    WINIT_WINDOWS.with_borrow(|windows| {
        let window = windows.get_window(window)?;
        let place = |(name, corner, size): (Option<String>, (i32, i32), (u32, u32))| MonitorPlace {
            name: name.unwrap_or_default(),
            corner: corner.into(),
            size: size.into(),
        };
        let monitors = window.available_monitors();
        let places = monitors.map(|monitor| (monitor.name(), monitor.position().into(), monitor.size().into()));
        let corner: Option<(i32, i32)> = window.outer_position().ok().map(Into::into);
        let size: (u32, u32) = window.inner_size().into();
        Some((places.map(place).collect(), corner.map(|corner| Area { corner: corner.into(), size: size.into() })))
    })
}

/// Keeps the window where its output belongs.
pub(crate) fn place_window(
    output: Res<OutputWindow>,
    mut placed: ResMut<Placed>,
    mut notices: ResMut<Notices>,
    time: Res<Time<Real>>,
    monitors: Query<(Entity, &Monitor)>,
    mut windows: Query<(Entity, &mut Window), With<PrimaryWindow>>,
    _on_the_main_thread: NonSendMarker,
) {
    if time.elapsed() < placed.next {
        return;
    }
    placed.next = time.elapsed() + PAUSE;
    let Ok((entity, mut window)) = windows.single_mut() else { return };
    let Some((places, actual)) = look(entity) else { return };
    // Wayland does not say where a window is.
    let places = placed.places(places, actual.is_some());
    let output = &output.output;
    // The system tells of its monitors a moment after the window opens.
    if places.is_empty() && placed.goal.is_none() && output.monitor.is_some() {
        return;
    }
    let (goal, name) = goal(output, placed.known.as_deref(), &places);
    placed.known = name.or(placed.known.take());
    if placed.goal.as_ref() != Some(&goal) {
        let before = placed.goal.replace(goal.clone());
        placed.wrong = 0;
        match (&goal, before) {
            (Goal::Missing, before) => tell(output, before.is_some(), &places, &mut notices),
            (_, Some(Goal::Missing)) => {
                let wanted = output.monitor.as_ref().map(monitor_name).unwrap_or_default();
                notices.error(format!("{wanted} is back, and the window on it"));
            }
            _ => {}
        }
        // Where its monitor never was it can be looked at on the desktop; else it would come over the presenter's window.
        window.visible = goal != Goal::Missing || placed.known.is_none();
        if goal == Goal::Missing {
            window.mode = WindowMode::Windowed;
        }
        if let Goal::On(area, filled) = &goal {
            put(&mut window, *area);
            placed.to_fill = filled.is_some();
        }
        return;
    }
    let Goal::On(area, filled) = &goal else { return };
    if let Some(name) = filled.as_ref().filter(|_| placed.to_fill) {
        // Where there is a window manager, over its panels, too: as soon as all agree where the monitor is.
        let same = |monitor: &Monitor| monitor.name.as_ref() == Some(name) && monitor.physical_position == area.corner;
        if let Some((entity, _)) = monitors.iter().find(|(_, monitor)| same(monitor)) {
            window.mode = WindowMode::BorderlessFullscreen(MonitorSelection::Entity(entity));
            placed.to_fill = false;
            return;
        }
    }
    placed.wrong = if actual.is_none_or(|actual| actual == *area) { 0 } else { placed.wrong + 1 };
    if placed.wrong >= PATIENCE {
        placed.wrong = 0;
        put(&mut window, *area);
        placed.to_fill = filled.is_some();
    }
}

/// Puts the window there, without anything around it.
fn put(window: &mut Window, area: Area) {
    window.mode = WindowMode::Windowed;
    window.decorations = false;
    window.position = WindowPosition::At(area.corner);
    window.resolution.set_physical_resolution(area.size.x, area.size.y);
}

/// Says that the window's monitor is not there.
fn tell(output: &Output, was_there: bool, places: &[MonitorPlace], notices: &mut Notices) {
    let wanted = output.monitor.as_ref().map(monitor_name).unwrap_or_default();
    let there: Vec<String> =
        places.iter().enumerate().map(|(i, place)| format!("{} {}", i + 1, place.name).trim().to_owned()).collect();
    let (gone, stays) = match was_there {
        true => ("is gone", "is hidden"),
        false => ("is not there", "stays on the desktop"),
    };
    notices.error(format!("{wanted} {gone}: the window {stays} until it is there; there are {}", there.join(", ")));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::show::rig::Shows;

    fn output(monitor: Option<Wanted>, window: Option<(i32, i32, u32, u32)>) -> Output {
        let shows = Shows::default();
        Output { name: "a".into(), monitor, window, shows, warp: None, blend: None, blend_gamma: 1.0 }
    }

    fn place(name: &str, left: i32) -> MonitorPlace {
        MonitorPlace { name: name.into(), corner: IVec2::new(left, 0), size: UVec2::new(640, 480) }
    }

    #[test]
    fn a_monitor_is_known_by_its_name_once_it_was_found_by_its_number() {
        let all = [place("A", 0), place("B", 640), place("C", 1280)];
        let second = output(Some(Wanted::Number(2)), None);
        let (first, known) = goal(&second, None, &all);
        let area = |left| Area { corner: IVec2::new(left, 0), size: UVec2::new(640, 480) };
        assert_eq!((first, known.as_deref()), (Goal::On(area(640), Some("B".into())), Some("B")));
        // It is unplugged: the one that is the second now belongs to another window.
        let rest = [place("A", 0), place("C", 640)];
        assert_eq!(goal(&second, known.as_deref(), &rest), (Goal::Missing, None));
        // It comes back as the last one, elsewhere.
        let back = [place("A", 0), place("C", 640), place("B", 1280)];
        assert_eq!(goal(&second, known.as_deref(), &back).0, Goal::On(area(1280), Some("B".into())));
    }

    #[test]
    fn parts_are_counted_from_the_monitors_corner_and_the_desktops() {
        let all = [place("A", 0), place("B", 640)];
        let part = Some((10, 20, 100, 50));
        let on = |left| Goal::On(Area { corner: IVec2::new(left, 20), size: UVec2::new(100, 50) }, None);
        assert_eq!(goal(&output(Some(Wanted::Named("B".into())), part), None, &all).0, on(650));
        assert_eq!(goal(&output(None, part), None, &all).0, on(10));
        assert_eq!(goal(&output(Some(Wanted::Named("D".into())), part), None, &all).0, Goal::Missing);
        assert_eq!(goal(&output(Some(Wanted::Number(3)), None), None, &all).0, Goal::Missing);
        assert_eq!(goal(&output(None, None), None, &all), (Goal::Anywhere, None));
    }
}
