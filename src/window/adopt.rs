//! What happens when a file has been opened: it becomes the open one, with the settings that suit it and those of its scene.

use super::camera::{Anchor, Flight, Upright, Viewpoint};
use super::facts::Facts;
use super::open::Opened;
use super::picture::{DataCamera, Picture};
use super::playhead::{Playhead, families_of};
use super::sampled::Sampled;
use super::scene::{Scene, Settings, TransferKept, home, home_of};
use super::scene_io::{self, SceneParts};
use super::state::choices::Choices;
use super::state::notices::Notices;
use crate::color::transfer::Range;
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{Attribute, shown_families};
use crate::mode::{Mode, SettingValue};
use crate::model::FamilyName;
use crate::modes;
use crate::view::CutSettings;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
use std::sync::Arc;

/// Makes a file that has arrived the open one, with the camera around all of it.
pub(crate) fn adopt_opened(
    mut commands: Commands,
    mut opened: MessageReader<Opened>,
    scene: Option<Res<Scene>>,
    before: Option<Res<Playhead>>,
    picture: Res<Picture>,
    mut settings: ResMut<Settings>,
    mut choices: ResMut<Choices>,
    mut notices: ResMut<Notices>,
    mut parts: SceneParts,
    mut transfer_kept: MessageWriter<TransferKept>,
    camera: Single<(Entity, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera), With<DataCamera>>,
) {
    let Some(Opened { path, members, notes, run, tracks, field, file, frame, scene: opened, map, keeps, .. }) =
        opened.read().last().cloned()
    else {
        return;
    };
    let metadata = file.metadata();
    let bounds = metadata.bounds();
    let (entity, mut viewpoint, mut anchor, mut orbit) = camera.into_inner();
    // More of what is open changes nothing of how it is seen.
    let kept =
        scene.as_ref().filter(|_| keeps).map(|scene| families_of(scene.metadata(), &settings.families, metadata));
    choices.attributes = field.as_ref().map_or_else(Vec::new, |field| field.opened.attributes(None));
    for name in Choices::attributes_of(metadata) {
        if !choices.attributes.contains(&name) {
            choices.attributes.push(name);
        }
    }
    let heights = field.as_ref().map(|field| field.opened.clone()).filter(Sampled::has_z_up);
    let is_image = field.as_ref().is_some_and(|field| match &field.opened {
        Sampled::Field(opened) => opened.grid().dimensions == 2,
        Sampled::Heights(_) | Sampled::Mixed(_) => false,
    });
    let of_particles = field.as_ref().map_or_else(|| members.clone(), |field| field.opened.of_particles(&members));
    let (shown, missing) = shown_families(&file, &of_particles);
    if let Some(families) = kept {
        if settings.families != families {
            settings.families = families;
        }
    } else {
        // A selection that is followed is followed on, to where it is now.
        let follows = scene.is_some() && settings.selections.iter().any(|set| set.follow);
        anchor.upright = if heights.is_some() { Upright::Z } else { Upright::Y };
        let around = match &heights {
            // Its settings begin with their defaults.
            Some(opened) => home_of(opened, &crate::mode::Settings::default(), viewpoint.fov_y, &picture),
            None => home(frame, viewpoint.fov_y, &picture).map_err(|error| error.to_string()),
        };
        match around {
            Ok(_) if follows => {}
            Ok(home) => {
                // One looks at an image straight from in front.
                let home = match is_image {
                    true => {
                        let (eye, target) = (DVec3::Z * home.distance(), frame.center());
                        Viewpoint { eye: target + eye, target, up: DVec3::Y, ..home }
                    }
                    false => home,
                };
                *viewpoint = home;
                *anchor = anchor.adopt(&home, &mut orbit);
                commands.entity(entity).remove::<Flight>();
            }
            Err(error) => notices.error(format!("{}: {error}", path.display())),
        }
        if let Attribute::Named(name) = &settings.attribute
            && !choices.attributes.contains(name)
        {
            settings.attribute = Attribute::Automatic;
        }
        let is_mixed = field.as_ref().is_some_and(|field| field.opened.mixed().is_some());
        let is_drawn = |mode: &Mode| {
            mode.takes_particles() && !is_mixed || field.as_ref().is_some_and(|field| field.opened.is_drawn_by(mode))
        };
        if !settings.mode_chosen || !is_drawn(settings.mode) {
            if settings.mode_chosen {
                notices.error(format!("mode {} does not draw {}", settings.mode.name, path.display()));
            }
            settings.change_mode(match &field {
                Some(field) => field.opened.usual_mode(),
                None => modes::usual(choices.attributes.iter().map(String::as_str)),
            });
        }
        settings.families = shown;
        settings.transfer.range = Range::Auto;
        if let Some(hue) = &mut settings.transfer.hue {
            hue.range = Range::Auto;
        }
        settings.cut = CutSettings::default();
        let camera = (entity, &mut *viewpoint, &mut *anchor, &mut *orbit);
        let attributes = &choices.attributes;
        let opened = opened.as_deref();
        let own_camera = opened.is_some_and(|opened| opened.scene.camera.is_some());
        scene_io::apply(opened, attributes, &mut settings, camera, &mut parts, &mut commands, &mut notices);
        if let Some(map) = map.filter(|_| settings.mode.takes_surfaces()) {
            settings.look.settings.0.insert("map".into(), SettingValue::Name(map));
            // A globe is seen from elsewhere than a plane.
            if let Some(opened) = heights.as_ref().filter(|_| !own_camera && !follows)
                && let Ok(home) = home_of(opened, &settings.look.settings, viewpoint.fov_y, &picture)
            {
                *viewpoint = home;
                *anchor = anchor.adopt(&home, &mut orbit);
            }
        }
        if opened.is_some_and(|opened| opened.scene.look.transfer.is_some()) {
            transfer_kept.write(TransferKept);
        }
    }
    let facts = Facts::of(&file, &of_particles);
    let facts = match &field {
        Some(field) => facts.with_samples(&field.opened),
        None => facts,
    };
    let told = |family: FamilyName| format!("{}: the data has no particles of family {family}", path.display());
    notes.into_iter().chain(missing.into_iter().map(told)).for_each(|note| notices.error(note));
    notices.info(match members.len() {
        1 if keeps && heights.is_some() => "all of its samples are there".to_owned(),
        1 if keeps && field.is_some() => "its voxels are there as particles, too".to_owned(),
        1 if keeps => {
            let steps = run.as_ref().and_then(|(data, _)| Some(data.run()?.times().times.len())).unwrap_or_default();
            let moves = if tracks.is_some() { ", and what moves between them" } else { "" };
            format!("{steps} steps of the run are there{moves}")
        }
        1 => format!("opened {}", path.display()),
        more => format!("opened {} with {} more", path.display(), more - 1),
    });
    let (dataset, subject, generation) =
        scene.map_or((1, 1, 1), |scene| (scene.dataset + 1, scene.subject + u32::from(!keeps), scene.generation + 1));
    let length_unit = metadata.length_unit.to_string();
    let (file, periodic) = (Arc::clone(&file), metadata.periodic_box());
    let mut playhead = run.and_then(|(data, moment)| Playhead::new(data, moment, tracks));
    if let Some(playhead) = &mut playhead {
        let said = opened.as_ref().and_then(|opened| opened.scene.look.interpolation);
        playhead.hold(said == Some(Interpolation::Hold));
        if let Some(before) = before.filter(|_| keeps) {
            playhead.go_on_from(&before);
        }
    }
    let times = playhead.as_ref().map(|playhead| playhead.times().clone());
    let time = playhead.as_ref().map(Playhead::time);
    let opened = playhead.as_ref().map(|playhead| playhead.data().clone());
    let following = opened.as_ref().and_then(|data| data.following().cloned());
    match playhead {
        Some(playhead) => commands.insert_resource(playhead),
        None => commands.remove_resource::<Playhead>(),
    }
    commands.insert_resource(Scene {
        path,
        members,
        file,
        bounds,
        frame,
        periodic,
        length_unit,
        facts,
        moving: None,
        field,
        times,
        following,
        opened,
        time,
        dataset,
        subject,
        generation,
    });
}
