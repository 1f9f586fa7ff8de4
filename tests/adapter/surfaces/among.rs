//! Heights among particles: the adapter finds what is seen of them, and what is put together is the processor's picture.

use super::*;
use crate::support::{Told, built as page_file, demo};
use deepfield::codec::VqBits;
use deepfield::look::Member;
use deepfield::modes;
use deepfield::picture::Reporter;
use deepfield::picture::mixed::MixedSession;

#[test]
fn an_adapter_finds_heights_among_particles() {
    let folder = tempfile::tempdir().unwrap();
    let ground = built(folder.path(), &hills([300, 270], Holes::Lakes));
    let particles = page_file(&demo(), VqBits::Eight);
    // Half of them are below the ground.
    let cloud =
        Member { offset: DVec3::new(30.0, 20.0, -125.0), scale: Some(5.0), ..Member::new(particles.file.path()) };
    let members = [Member::new(&ground), cloud];
    let told = Arc::new(Told::default());
    let open = |adapter: Option<Offscreen>| {
        let (options, reporter) = (SessionOptions::default(), Arc::clone(&told) as Arc<dyn Reporter>);
        let opened = MixedSession::open(&members, options, [], |path| Ok(path.to_owned()), reporter);
        let mut session = opened.unwrap();
        session.use_adapter(adapter.map(|adapter| Box::new(adapter) as _));
        session
    };
    let (mut processor, mut adapter) = (open(None), open(Some(Offscreen::preferred())));
    let camera = Wanted { eye: Some([150.0, -140.0, 210.0]), target: Some([150.0, 120.0, 0.0]), ..PLAIN };
    for mode in ["surface", "column-density", "volume"] {
        let shot = camera.shot();
        let shot = Shot { look: LookPatch { mode: modes::find(mode), ..shot.look }, ..shot };
        let [expected, found] = [&mut processor, &mut adapter].map(|session| {
            let picture = session.draw(&shot).unwrap();
            assert!(picture.converged && picture.surface.as_ref().unwrap().report.covered > 5000.0, "{mode}");
            picture.image(&shot).unwrap()
        });
        let (share, mean) = differences(&found, &expected);
        println!("{mode}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
        assert!(share <= 0.01 && mean < 0.5, "{mode}: {share} {mean}");
    }
    let told = told.0.lock().unwrap();
    assert!(!told.iter().any(|message| message.contains("with the CPU")), "{told:?}");
}
