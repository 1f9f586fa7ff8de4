//! Data that leader and followers read from the same server.

use super::*;
use crate::build::build;
use crate::look::Shot;
use crate::picture::Session;
use crate::store::PageFile;
use crate::synth::{self, clusters::Clusters};
use crate::window::state::notices::Severity;
use fault_server::FaultServer;

#[allow(dead_code, reason = "other tests need its faults")]
#[path = "../../../../../tests/support/fault_server.rs"]
mod fault_server;

#[test]
fn a_follower_draws_what_it_reads_from_the_leaders_url() {
    let folder = tempfile::tempdir().unwrap();
    let (path, key) = (folder.path().join("clusters.df"), ShowKey::random());
    // Of more pages than opening reads.
    let options = BuildOptions { page_bytes: 32 << 10, ..BuildOptions::default() };
    build(synth::dataset(&Clusters::new(3, 80_000)), &options, &path, &()).unwrap();
    let server = FaultServer::new(std::fs::read(&path).unwrap());
    let url = PathBuf::from(server.url("clusters.df"));
    let (mut leader, address) = leader(&url, &key);
    let mut follower = follower(address, &key, "left", Vec::new());
    let start = Instant::now();
    while shown(&follower) == 0 {
        leader.update();
        follower.update();
        std::thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < PATIENCE, "{:?} {:?}", notices(&leader), notices(&follower));
    }
    let scene = follower.world().resource::<Scene>();
    assert_eq!((&scene.path, scene.file.path()), (&url, &*url));
    let draw = |mut session: Session| {
        let mode = modes::find("column-density");
        let look = LookPatch { mode, error_px: Some(0.01), ..LookPatch::default() };
        let shot = Shot { look, size: Some((48, 32)), ..Shot::default() };
        let picture = session.draw(&shot).unwrap();
        assert!(picture.converged);
        session.finished(&shot, &picture).unwrap()
    };
    let before = server.asked().len();
    let afar = draw(scene.opener(u64::MAX)().unwrap());
    assert!(server.asked().len() > before, "no page came from the server");
    let here = draw(Session::of(Arc::new(PageFile::open(&path).unwrap()), u64::MAX));
    assert!(afar == here && afar.rgba.iter().any(|[r, g, b, _]| r.max(g).max(b) > &40));
    // It is the leader's data, and nothing of it is lacking.
    for window in [&leader, &follower] {
        let mut told = window.world().resource::<Notices>().all();
        assert!(told.all(|notice| notice.severity == Severity::Info), "{:?}", notices(window));
    }
}
