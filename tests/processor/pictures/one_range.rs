//! Ranges that are looked for in what is in view are the same for both eyes and for all faces of a panorama.

use crate::support::{built_from_dataset, view_from};
use deepfield::codec::VqBits;
use deepfield::color::accumulation::relative_error;
use deepfield::color::transfer::{Levels, TransferFunction};
use deepfield::look::{CameraConfig, LookPatch, Shot};
use deepfield::mode::{LightPicture, SettingValue, Settings};
use deepfield::modes;
use deepfield::picture::Session;
use deepfield::synth::merger::Merger;
use deepfield::view::{Eyes, Stereo, StereoKind, Surround};
use glam::DVec3;
use std::sync::Arc;

const SIDE: usize = 40;

/// A picture, and the colours that it was asked for with.
fn light(session: &mut Session, shot: &Shot) -> (LightPicture, TransferFunction) {
    let picture = session.draw(shot).unwrap();
    let mode = shot.look.mode.unwrap();
    (picture.values.light(mode).unwrap(), picture.transfer)
}

#[test]
fn both_eyes_and_all_faces_have_one_range() {
    let dataset = deepfield::synth::dataset(&Merger::new(3, 800));
    let view = view_from(&dataset, DVec3::new(0.35, 0.3, 1.0), 1.0, 8, 8);
    let middle = dataset.bounds().center();
    let distance = view.eye.distance(middle);
    let built = built_from_dataset(dataset, VqBits::Eight);
    let mut session = Session::of(Arc::clone(&built.file), u64::MAX);
    let size = Some((SIDE as u32, SIDE as u32));
    let by_values = ("field-opacity", "field");
    let heat = ("field", "internal-energy");
    // Whether the transfer function has all ranges that there are.
    for (mode, set, is_all) in [
        ("cross-section", &[][..], true),
        ("cross-section", &[heat][..], true),
        ("volume", &[heat, by_values][..], true),
        ("volume", &[heat][..], false),
        ("volume-isosurface", &[heat, ("surface-field", "smoothing-length")][..], false),
    ] {
        let named = |(setting, name): &(&str, &str)| ((*setting).to_owned(), SettingValue::Name((*name).to_owned()));
        let settings = Settings(set.iter().map(named).collect());
        let look = LookPatch { mode: modes::find(mode), settings, ..LookPatch::default() };
        let from = |eye: DVec3, target: DVec3| Shot {
            look: look.clone(),
            camera: CameraConfig {
                eye: Some(eye.to_array()),
                target: Some(target.to_array()),
                ..CameraConfig::default()
            },
            size,
            ..Shot::default()
        };
        let pair = |eyes| Shot {
            stereo: Some(Stereo {
                kind: StereoKind::OffAxis,
                separation: 0.2 * distance,
                zero_parallax: 0.5 * distance,
                eyes,
            }),
            ..from(view.eye, middle)
        };
        let what = format!("{mode} {set:?}");
        let [(left, _), (right, _), (both, transfer)] =
            [Eyes::Left, Eyes::Right, Eyes::SideBySide].map(|eyes| light(&mut session, &pair(eyes)));
        for one in [&left, &right] {
            assert_eq!((one.levels, &one.isovalues), (both.levels, &both.isovalues), "{what}");
        }
        let half = |right: usize| -> Vec<f32> {
            both.colors.rgba.chunks(SIDE).skip(right).step_by(2).flatten().flatten().copied().collect()
        };
        for (number, one) in [&left, &right].into_iter().enumerate() {
            let (_, off) = relative_error(one.colors.rgba.as_flattened(), &half(number));
            assert!(off < 1e-5, "{what}: {off}");
        }
        if mode == "cross-section" {
            // Each by itself finds its own.
            let alone = [-1.0, 1.0].map(|side| {
                let aside = 0.1 * side * distance * view.right;
                light(&mut session, &from(view.eye + aside, middle + 3.0 * aside)).0.levels
            });
            assert!(alone[0] != alone[1], "{what}: {alone:?}");
        }
        // Numbers in place of what was found give the same picture, seam by seam.
        let dome = Shot { surround: Surround::Dome { aperture: 200.0, tilt: 90.0 }, ..from(view.eye, middle) };
        let (around, of_dome) = light(&mut session, &dome);
        for (shot, found, transfer) in [(pair(Eyes::SideBySide), both, transfer), (dome, around, of_dome)] {
            let levels = Levels { p: found.levels.density, s: found.levels.attribute };
            let look = LookPatch { transfer: Some(transfer.with_levels(&levels)), ..shot.look.clone() };
            let (fixed, _) = light(&mut session, &Shot { look, ..shot });
            let (_, off) = relative_error(fixed.colors.rgba.as_flattened(), found.colors.rgba.as_flattened());
            let lit = found.colors.rgba.iter().filter(|pixel| pixel[3] > 0.0).count();
            assert!(lit > 10 && (!is_all || off < 1e-4), "{what}: {lit} pixels, {off}");
            assert_eq!(fixed.levels.density, found.levels.density, "{what}");
        }
    }
}
