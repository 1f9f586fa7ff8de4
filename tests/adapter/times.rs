//! Times of passes: each picture's are its own, though one adapter draws them one after the other.

use crate::support::{built, demo};
use deepfield::codec::VqBits;
use deepfield::gpu::Offscreen;
use deepfield::look::{Backend, CameraConfig, LookPatch, Member, Shot};
use deepfield::modes;
use deepfield::picture::{Session, SessionOptions};
use std::sync::Arc;

#[test]
fn a_picture_has_no_times_of_the_mode_before() {
    let built = built(&demo(), VqBits::Eight);
    let options = SessionOptions { backend: Some(Backend::Compute), repeat: 2, ..SessionOptions::default() };
    let opened =
        Session::open(&[Member::new(built.file.path())], options, [], |path| Ok(path.to_owned()), Arc::new(()));
    let mut session = opened.unwrap().with_adapter(Some(Box::new(Offscreen::default())));
    let camera =
        CameraConfig { eye: Some([25.0, 25.0, 90.0]), target: Some([25.0, 26.0, 0.0]), ..CameraConfig::default() };
    let splats = &["project", "accumulate", "reconstruct"][..];
    // Passes that each mode has, of all that have a name of their own.
    let own = [
        ("column-density", splats),
        ("spheres", &["nearest", "surface"]),
        ("volume", &["resample", "cast"]),
        ("sorted-splats", &["blend"]),
        ("density-squared", splats),
        ("volume", &["resample", "cast"]),
    ];
    for (mode, passes) in own {
        let look = LookPatch { mode: modes::find(mode), ..LookPatch::default() };
        let shot = Shot { look, camera, size: Some((48, 32)), ..Shot::default() };
        let times = session.draw(&shot).unwrap().milliseconds;
        println!("{mode}: {times:?}");
        for pass in passes {
            assert!(times.get(*pass).is_some_and(|time| *time > 0.0), "{mode} without {pass}: {times:?}");
        }
        for (other, foreign) in own {
            for pass in foreign.iter().filter(|pass| !passes.contains(pass)) {
                assert!(!times.contains_key(*pass), "{mode} with {pass} of {other}: {times:?}");
            }
        }
    }
}
