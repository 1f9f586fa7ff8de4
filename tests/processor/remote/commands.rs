//! What commands say and draw of files behind a URL is what they do of files on a disk, byte for byte.

use super::sound;
use crate::serve::client::serving;
use crate::support::text;
use deepfield::serve::{Files, Offer, ServeOptions};
use std::path::Path;

/// A command, and what it has given.
type Seen = (&'static str, Vec<u8>);

/// Builds particles, a volume and heights in a folder.
fn build(folder: &Path) {
    std::fs::write(folder.join("sound.df"), sound()).unwrap();
    for (kind, size, source, built) in
        [("blob", "40,30,20", "blob.nrrd", "blob.df"), ("surface", "64,48", "surface.npy", "surface.df")]
    {
        text(folder, &["synth", kind, "--size", size, "-o", source]);
        text(folder, &["build", source, "-o", built]);
    }
}

/// What is seen of data whose names begin with `place`, from the folder.
fn seen(folder: &Path, place: &str) -> Vec<Seen> {
    let [particles, volume, heights] = ["sound.df", "blob.df", "surface.df"].map(|name| format!("{place}{name}"));
    let scene = format!("(version: 1, datasets: [(path: {particles:?})], mode: \"column-density\")");
    let tour = format!(
        "(version: 1, dataset: (path: {particles:?}), size: (48, 27), rate: 1.0, \
         keyframes: [(mode: \"column-density\", error_px: 3.0), (after: 1.0, orbit: 40.0)])"
    );
    for (name, content) in [("a.scene.ron", scene), ("a.tour.ron", tour)] {
        std::fs::write(folder.join(name), content).unwrap();
    }
    let probe = text(folder, &["probe", &particles, "--sphere", "50000,50000,50000,20000", "--json", "-"]);
    // The answer names the file.
    let mut seen = vec![("probe", probe.replace(&particles, "sound.df").into_bytes())];
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    for (what, path) in [("a volume", volume.as_str()), ("heights", heights.as_str()), ("a scene", "a.scene.ron")] {
        text(folder, &["render", path, "--size", "64x48", "--backend", "cpu", "-o", "picture.png"]);
        seen.push((what, read("picture.png")));
    }
    text(folder, &["tour", "a.tour.ron", "--record", "frames", "--backend", "cpu"]);
    let frames = ["frames/frame-00000.png", "frames/frame-00001.png"].map(read);
    assert!(frames[0] != frames[1]);
    seen.extend(frames.map(|frame| ("tour", frame)));
    std::fs::remove_dir_all(folder.join("frames")).unwrap();
    seen
}

fn are_same(here: &[Seen], afar: &[Seen]) {
    assert_eq!(here.len(), afar.len());
    for ((what, here), (_, afar)) in here.iter().zip(afar) {
        assert!(here == afar, "{what}: {} bytes here, {} from afar", here.len(), afar.len());
    }
}

#[test]
fn what_is_seen_of_a_url_is_what_is_seen_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    build(folder.path());
    let server = serving(ServeOptions::default(), Offer::Files(Files::of(folder.path()).unwrap()));
    let place = format!("http://{}/", server.address());
    let here = seen(folder.path(), "");
    are_same(&here, &seen(folder.path(), &place));
    // All of it was read once.
    drop(server);
    are_same(&here, &seen(folder.path(), &place));
}
