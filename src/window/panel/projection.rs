//! The rows of how directions become a picture, and for which eyes.

use super::theme;
use crate::view::{CubeLayout, Eyes, Stereo, StereoKind, Surround};
use crate::window::scene::Settings;
use bevy_egui::egui::Ui;

/// Share of the distance looked at by which eyes are apart to begin with: what is further away is as deep as on a usual screen.
const SEPARATION: f64 = 1.0 / 30.0;
/// Distances for eyes and the screen, of the one looked at.
const DISTANCES: [f64; 2] = [1e-6, 1e2];

/// The rows; `distance`: that of the camera's target.
pub(super) fn show(ui: &mut Ui, distance: f64, settings: &mut Settings) {
    surround(ui, settings);
    if let Surround::Dome { aperture, tilt } = &mut settings.surround {
        let row =
            |label, range, default| theme::NumberRow { label, unit: "°", range, log: false, default: Some(default) };
        row("    Aperture", 1.0..=360.0, 180.0).show(ui, aperture).on_hover_text("Angle from rim to rim.");
        row("    Tilt", -180.0..=180.0, 0.0)
            .show(ui, tilt)
            .on_hover_text("How far the dome leans towards the front: 0 has the zenith in the middle, 90 the front.");
    }
    stereo(ui, distance, settings);
}

fn surround(ui: &mut Ui, settings: &mut Settings) {
    let (aperture, tilt) = match settings.surround {
        Surround::Dome { aperture, tilt } => (aperture, tilt),
        _ => (180.0, 0.0),
    };
    let choices = [
        ("perspective", Surround::Flat, false),
        ("orthographic", Surround::Flat, true),
        ("dome", Surround::Dome { aperture, tilt }, false),
        ("equirectangular", Surround::Equirectangular, false),
        ("cube cross", Surround::Cube { layout: CubeLayout::Cross }, false),
        ("cube strip", Surround::Cube { layout: CubeLayout::Strip }, false),
    ];
    let now = match settings.surround {
        // A window has no files.
        Surround::Cube { layout: CubeLayout::Files } => Surround::Cube { layout: CubeLayout::Strip },
        surround => surround,
    };
    let parallel = settings.lens.parallel && now.is_flat();
    let is_chosen = |surround: Surround, lines: bool| surround == now && lines == parallel;
    let chosen = choices.iter().find(|(_, surround, lines)| is_chosen(*surround, *lines));
    theme::combo(ui, "Projection", chosen.map_or("", |(name, ..)| name), |ui| {
        for (name, surround, lines) in choices {
            let label = ui.selectable_label(is_chosen(surround, lines), name);
            theme::register(ui, &format!("projection:{name}"), label.rect);
            if label.clicked() {
                (settings.surround, settings.lens.parallel) = (surround, lines);
                settings.stereo =
                    settings.stereo.and_then(|pair| kind_for(surround, lines).map(|kind| Stereo { kind, ..pair }));
            }
        }
    })
    .on_hover_text(
        "Domes, maps of all directions and cubes are seen from the camera's eye, with its target as the front.",
    );
}

/// How two eyes stand for a projection, where they can.
fn kind_for(surround: Surround, parallel: bool) -> Option<StereoKind> {
    match surround {
        Surround::Flat => (!parallel).then_some(StereoKind::OffAxis),
        Surround::Dome { .. } | Surround::Equirectangular => Some(StereoKind::Omnidirectional),
        Surround::Cube { .. } => None,
    }
}

fn stereo(ui: &mut Ui, distance: f64, settings: &mut Settings) {
    let Some(kind) = kind_for(settings.surround, settings.lens.parallel) else { return };
    let choices = [
        ("off", None),
        ("side-by-side", Some(Eyes::SideBySide)),
        ("over-under", Some(Eyes::OverUnder)),
        ("left", Some(Eyes::Left)),
        ("right", Some(Eyes::Right)),
    ];
    let now = settings.stereo.map(|pair| pair.eyes);
    let name = choices.iter().find(|(_, eyes)| *eyes == now).map_or("", |(name, _)| name);
    theme::combo(ui, "Stereo", name, |ui| {
        for (name, eyes) in choices {
            let label = ui.selectable_label(eyes == now, name);
            theme::register(ui, &format!("stereo:{name}"), label.rect);
            if label.clicked() {
                let usual =
                    Stereo { kind, separation: SEPARATION * distance, zero_parallax: distance, eyes: Eyes::default() };
                settings.stereo = eyes.map(|eyes| Stereo { eyes, ..settings.stereo.unwrap_or(usual) });
            }
        }
    })
    .on_hover_text("A picture for each eye, beside each other or the left one above, or that of one eye.");
    let Some(pair) = &mut settings.stereo else { return };
    let row = |label| {
        let range = DISTANCES[0] * distance..=DISTANCES[1] * distance;
        theme::NumberRow { label, unit: "", range, log: true, default: None }
    };
    row("    Eye separation")
        .show(ui, &mut pair.separation)
        .on_hover_text("Distance of the eyes, in the data's lengths.");
    row("    Zero parallax").show(ui, &mut pair.zero_parallax).on_hover_text(
        "Distance of the screen: what is there is at the same place for both eyes. In a dome, of the nearest thing that matters.",
    );
}
