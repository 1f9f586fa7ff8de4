//! A folder in the place of a file: the one source in it is opened, else the message lists what is there.

use super::writers::file;
use super::{data, message};
use deepfield::import::{LoadOptions, OtherKind, file_in, grid_format, load, open, summarize};
use std::path::{Path, PathBuf};

/// Copies of files of `tests/data` under the given names.
fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (from, to) in files {
        std::fs::copy(data(from), folder.path().join(to)).unwrap();
    }
    folder
}

/// The message about a folder, which is one line and names the folder.
fn refused(folder: &Path) -> String {
    message(&open(folder).err().unwrap(), folder)
}

#[test]
fn one_snapshot_in_one_or_several_files_is_opened_among_other_files() {
    for (files, count) in [
        (&[("gizmo.hdf5", "gizmo.hdf5")][..], 1),
        (&[("arepo.0.hdf5", "snap_099.0.hdf5"), ("arepo.1.hdf5", "snap_099.1.hdf5")], 2),
        (&[("groups.0.hdf5", "g.0.hdf5"), ("groups.1.hdf5", "g.1.hdf5"), ("groups.2.hdf5", "g.2.hdf5")], 3),
    ] {
        let folder = folder_of(files);
        let alone = summarize(&folder.path().join(files[0].1)).unwrap();
        assert_eq!(alone.about.files, count);
        // Text whose first line could be that of a table, text in no format, hidden files and folders.
        file(folder.path(), "parameters.txt", b"name,value,unit\nBoxSize,100,kpc\n");
        file(folder.path(), "README", b"A run.\n");
        file(folder.path(), ".hidden.hdf5", &std::fs::read(data("eagle.hdf5")).unwrap());
        std::fs::create_dir(folder.path().join("restart")).unwrap();
        std::fs::copy(data("eagle.hdf5"), folder.path().join("restart/eagle.hdf5")).unwrap();
        assert_eq!(summarize(folder.path()).unwrap(), alone);
        let loaded = load(folder.path(), &LoadOptions::default(), &()).unwrap();
        assert_eq!(loaded.provenance.path, folder.path().join(files[0].1));
        let with_slash = PathBuf::from(format!("{}/", folder.path().display()));
        assert_eq!(summarize(&with_slash).unwrap().particles, alone.particles);
    }
}

#[test]
fn several_snapshots_are_listed() {
    let folder = folder_of(&[
        ("arepo.0.hdf5", "b.0.hdf5"),
        ("arepo.1.hdf5", "b.1.hdf5"),
        ("gas_sphere_collapse_025.hdf5", "a_025.hdf5"),
    ]);
    let text = refused(folder.path());
    let (first, second) = (text.find("a_025.hdf5 (").unwrap(), text.find("b.0.hdf5 in 2 files (").unwrap());
    assert!(first < second && text.contains("particles, time ") && text.contains("name one of these"), "{text}");
    assert!(!text.contains("b.1.hdf5") && !text.contains("more"), "{text}");
    // Of a long series only the first are opened and named.
    let folder = tempfile::tempdir().unwrap();
    for number in 0..20 {
        std::fs::copy(data("units.hdf5"), folder.path().join(format!("snapshot_{number:03}.hdf5"))).unwrap();
    }
    let text = refused(folder.path());
    assert!(text.contains("snapshot_011.hdf5 (") && !text.contains("snapshot_012"), "{text}");
    assert!(text.contains(" and 8 more"), "{text}");
}

#[test]
fn folders_without_a_source_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    assert!(refused(folder.path()).contains("found nothing"));
    std::fs::create_dir(folder.path().join("snapdir_000")).unwrap();
    file(folder.path(), "notes.md", b"# Notes\n");
    file(folder.path(), "two\nlines", b"");
    let text = refused(folder.path());
    assert!(text.contains("found notes.md, snapdir_000/, two?lines, expected one source"), "{text}");
    for number in 0..30 {
        file(folder.path(), &format!("a{number:02}"), b"");
    }
    let text = refused(folder.path());
    assert!(text.contains("a11 and 21 more") && !text.contains("a12"), "{text}");
}

#[test]
fn a_damaged_snapshot_alone_says_what_is_wrong_with_it() {
    let folder = folder_of(&[("arepo.0.hdf5", "snap.0.hdf5")]);
    let text = open(folder.path()).err().unwrap().to_string();
    assert!(text.contains("snap.1.hdf5") && text.contains("missing"), "{text}");
    std::fs::copy(data("arepo.0.hdf5"), folder.path().join("snap.2.hdf5")).unwrap();
    let text = open(folder.path()).err().unwrap().to_string();
    assert!(text.contains("snap.1.hdf5") && text.contains("missing"), "{text}");
    // A whole one beside it is meant.
    std::fs::copy(data("gizmo.hdf5"), folder.path().join("whole.hdf5")).unwrap();
    assert_eq!(file_in(folder.path(), &[]).unwrap(), folder.path().join("whole.hdf5"));
}

#[test]
fn other_kinds_of_files_count_where_they_are_asked_for() {
    let kinds: [OtherKind; 1] = [("page file", deepfield::store::PageFile::recognises)];
    let folder = folder_of(&[("version2.df", "galaxy.df")]);
    assert_eq!(file_in(folder.path(), &kinds).unwrap(), folder.path().join("galaxy.df"));
    assert!(refused(folder.path()).contains("found galaxy.df"));
    std::fs::copy(data("gizmo.hdf5"), folder.path().join("galaxy.hdf5")).unwrap();
    assert_eq!(file_in(folder.path(), &[]).unwrap(), folder.path().join("galaxy.hdf5"));
    let text = message(&file_in(folder.path(), &kinds).unwrap_err(), folder.path());
    assert!(text.contains("galaxy.df (page file), galaxy.hdf5 ("), "{text}");
    let absent = folder.path().join("absent");
    assert_eq!(file_in(&absent, &kinds).unwrap(), absent, "left to whoever opens it");
}

/// A grey picture of 2 x 2 pixels.
fn slice(folder: &Path, name: &str, values: [u8; 4]) {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&values).unwrap();
    file(folder, name, &bytes);
}

#[test]
fn a_folder_of_slices_is_a_volume_unless_data_lies_beside_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    slice(path, "s0.png", [0, 1, 2, 3]);
    slice(path, "s1.png", [4, 5, 6, 7]);
    assert_eq!(file_in(path, &[]).unwrap(), path);
    assert_eq!(grid_format(path).unwrap(), Some("slices"));
    // Its voxels are particles where these are asked for; one is air.
    assert_eq!(summarize(path).unwrap().particles, 7);
    // Text that a table could begin with is no data.
    file(path, "notes.csv", b"name,value\nscanner,3\n");
    assert_eq!(file_in(path, &[]).unwrap(), path);
    // Pictures of a snapshot are no slices.
    std::fs::remove_file(path.join("notes.csv")).unwrap();
    std::fs::copy(data("gizmo.hdf5"), path.join("galaxy.hdf5")).unwrap();
    assert_eq!(file_in(path, &[]).unwrap(), path.join("galaxy.hdf5"));
    assert_eq!(grid_format(path).unwrap(), None);
    std::fs::remove_file(path.join("galaxy.hdf5")).unwrap();
    std::fs::copy(data("version2.df"), path.join("galaxy.df")).unwrap();
    let kinds: [OtherKind; 1] = [("page file", deepfield::store::PageFile::recognises)];
    assert_eq!(file_in(path, &kinds).unwrap(), path.join("galaxy.df"));
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_lead_nowhere_without_harm() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink(at("loop_b"), at("loop_a")).unwrap();
    symlink(at("loop_a"), at("loop_b")).unwrap();
    symlink(folder.path(), at("itself")).unwrap();
    symlink(at("gone.hdf5"), at("dangling.hdf5")).unwrap();
    let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
    let text = refused(folder.path());
    assert!(text.contains("dangling.hdf5, itself/, loop_a, loop_b, socket"), "{text}");
    symlink(data("gizmo.hdf5"), at("snapshot.hdf5")).unwrap();
    assert_eq!(open(folder.path()).unwrap().description().path, at("snapshot.hdf5"));
    // A file that cannot be read does not stand in the way of one that can.
    use std::os::unix::fs::PermissionsExt;
    let secret = file(folder.path(), "secret.hdf5", b"\x89HDF\r\n\x1a\n");
    std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(0o000)).unwrap();
    assert_eq!(open(folder.path()).unwrap().description().path, at("snapshot.hdf5"));
}
