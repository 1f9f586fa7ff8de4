//! Splats over each other, by an adapter's passes and by the processor: the same data, the same colours, the same picture.

use crate::support::{built, demo, write_box};
use deepfield::codec::VqBits;
use deepfield::color::Colors;
use deepfield::color::transfer::Levels;
use deepfield::gpu::Offscreen;
use deepfield::look::{Attribute, Backend, CameraConfig, LookPatch, Member, Shot};
use deepfield::mode::{Raw, SettingValue};
use deepfield::modes;
use deepfield::picture::{Picture, PictureError, Session, SessionOptions};
use deepfield::view::Surround;
use std::path::Path;
use std::sync::Arc;

/// A session that draws a page file by this backend.
fn session(file: &Path, backend: Backend) -> Session {
    let options = SessionOptions { backend: Some(backend), ..SessionOptions::default() };
    let opened = Session::open(&[Member::new(file)], options, [], |path| Ok(path.to_owned()), Arc::new(())).unwrap();
    opened.with_adapter(Some(Box::new(Offscreen::default())))
}

fn look(mode: &str, order: &str) -> LookPatch {
    let mut look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
    for (name, value) in [("blend", "over"), ("order", order)] {
        look.budget.0.insert(name.into(), SettingValue::Name(value.into()));
    }
    look
}

fn colors(picture: &Picture) -> &Colors {
    match &picture.values {
        Raw::Light(painted) => &painted.colors,
        Raw::Sums(..) => unreachable!("splats that lie over each other are light"),
    }
}

fn levels(picture: &Picture) -> Levels {
    match &picture.values {
        Raw::Light(painted) => Levels { p: painted.levels.density, s: painted.levels.attribute },
        Raw::Sums(..) => unreachable!("splats that lie over each other are light"),
    }
}

/// Relative L2 distance of all channels.
fn apart(found: &Colors, expected: &Colors) -> f64 {
    let pairs = || found.rgba.as_flattened().iter().zip(expected.rgba.as_flattened());
    let differ: f64 = pairs().map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (differ / pairs().map(|(_, b)| f64::from(*b).powi(2)).sum::<f64>()).sqrt()
}

#[test]
fn splats_lie_over_each_other_as_on_the_processor() {
    let folder = tempfile::tempdir().unwrap();
    let file = write_box(folder.path());
    let camera =
        |eye: [f64; 3], ortho| CameraConfig { eye: Some(eye), target: Some([5e4; 3]), ortho, ..Default::default() };
    let [mut by_processor, mut by_adapter] = [Backend::Cpu, Backend::Compute].map(|backend| session(&file, backend));
    for (name, mode, camera) in [
        ("from outside", "column-density", camera([1.4e5, 8e4, 1.8e5], None)),
        ("among them", "column-density", camera([4.4e4, 5.4e4, 6.2e4], None)),
        ("parallel", "column-density", camera([8e4, 1.2e5, 2.4e5], Some(1.2e5))),
        ("squared", "density-squared", camera([1.4e5, 8e4, 1.8e5], None)),
    ] {
        // Colours by an attribute are found in the same way from everywhere.
        let attributes: &[Option<&str>] = if name == "from outside" { &[None, Some("density")] } else { &[None] };
        for attribute in attributes.iter().copied() {
            let mut look = look(mode, "exact");
            look.attribute = attribute.map(|name| Attribute::Named(name.into()));
            let shot = Shot { look, camera, size: Some((120, 90)), ..Shot::default() };
            // Each finds the ranges of its own sums.
            let [first, own] = [by_processor.draw(&shot).unwrap(), by_adapter.draw(&shot).unwrap()];
            let [low, high] = [0, 1].map(|end| levels(&own).p[end] / levels(&first).p[end] - 1.0);
            assert!(low.abs().max(high.abs()) < 0.01, "{name}: {low} {high}");
            let mut shot = shot;
            shot.look.transfer = Some(first.transfer.clone().with_levels(&levels(&first)));
            let found = by_adapter.draw(&shot).unwrap();
            assert_eq!((&*found.drawn_by[0], found.level_report.order), ("compute", Some("exact")), "{name}");
            let lit = colors(&first).rgba.iter().filter(|pixel| pixel[3] > 0.1).count();
            let apart = apart(colors(&found), colors(&first));
            println!("{name}, {attribute:?}: {apart:.2e}, {lit} pixels");
            assert!(lit > 130 && apart < 1e-3, "{name}, {attribute:?}: {apart}, {lit} pixels");
        }
    }
}

#[test]
fn what_an_adapter_does_not_lay_over_each_other_it_says() {
    let built = built(&demo(), VqBits::Eight);
    let mut session = session(built.file.path(), Backend::Compute);
    let shot = |look, surround| Shot { look, surround, size: Some((64, 48)), ..Shot::default() };
    let told = session.draw(&shot(look("column-density", "buckets"), Surround::Flat)).unwrap();
    assert_eq!((&*told.drawn_by[0], told.level_report.order), ("compute", Some("exact")));
    for (look, surround, why) in [
        (look("points", "exact"), Surround::Flat, "blend over: only --backend cpu draws it"),
        (
            look("column-density", "exact"),
            Surround::Equirectangular,
            "--backend: only cpu draws panoramas of splats over each other",
        ),
    ] {
        let refused = session.draw(&shot(look, surround));
        assert_eq!(refused.err().map(|error: PictureError| error.to_string()).as_deref(), Some(why));
    }
}
