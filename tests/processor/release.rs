//! What `.ci/release` makes of a program.

use crate::packaging::finds_nothing;
use crate::support::in_repository;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output};

/// What a command prints that succeeds.
pub fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A script that says to need glibc 2.31 stands in for the program and for the library of the wheel, so that little is packed; pages and
/// completions are the program's.
#[test]
fn a_release_is_whole_and_the_same_again_and_refused_where_it_would_not_run() {
    // Machines without Python 3.11 make no release.
    if !Command::new("python3").args(["-c", "import tomllib"]).output().is_ok_and(|output| output.status.success()) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("stand-in");
    let script = format!("#!/bin/sh\n# GLIBC_2.17 GLIBC_2.31\nexec '{}' \"$@\"\n", env!("CARGO_BIN_EXE_deepfield"));
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let release = |out: &str, arguments: &[&str]| -> Output {
        let mut command = Command::new("python3");
        command.arg(in_repository(".ci/release")).arg("--program").arg(&program).arg("--library").arg(&program);
        command.arg("--out").arg(folder.path().join(out)).args(arguments).output().unwrap()
    };

    let made = release("first", &[]);
    let told = String::from_utf8_lossy(&made.stdout);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert!(told.contains("the program needs glibc 2.31\n"), "{told}");
    let first = folder.path().join("first");
    said(Command::new("sha256sum").args(["--check", "--strict", "SHA256SUMS"]).current_dir(&first));
    let made = |ending: &str| {
        let mut files = std::fs::read_dir(&first).unwrap().map(|file| file.unwrap().path());
        files.find(|file| file.to_string_lossy().ends_with(ending))
    };
    let archive = made(".tar.gz").unwrap();
    let held = said(Command::new("tar").arg("-tzf").arg(&archive));
    for name in [
        "/deepfield",
        "/README.md",
        "/LICENSE-APACHE",
        "/LICENSE-MIT",
        "/LICENSES-THIRD-PARTY",
        "/completions/deepfield.bash",
        "/completions/deepfield.elv",
        "/completions/deepfield.fish",
        "/completions/_deepfield",
        "/completions/_deepfield.ps1",
        "/man/man1/deepfield.1",
        "/man/man1/deepfield-render.1",
    ] {
        assert!(held.lines().any(|line| line.ends_with(name)), "{name}: {held}");
    }
    let page = said(Command::new("tar").arg("-xOzf").arg(&archive).args(["--wildcards", "*/deepfield-render.1"]));
    assert!(page.contains("deepfield\\-render"), "{page:.300}");

    assert!(told.contains("the wheel needs glibc 2.31\n"), "{told}");
    let held = said(Command::new("python3").args(["-m", "zipfile", "--list"]).arg(made(".whl").unwrap()));
    for name in [".data/scripts/deepfield ", ".dist-info/licenses/LICENSES-THIRD-PARTY "] {
        assert!(held.contains(name), "{name}: {held}");
    }

    // Where there is no dpkg-deb, that is said.
    assert!(made(".deb").is_some() != told.contains("left out: debian: dpkg-deb"), "{told}");
    if let Some(package) = made(".deb") {
        let held = said(Command::new("dpkg-deb").arg("--contents").arg(&package));
        for (mode, name) in [
            ("-rwxr-xr-x root/root", "/usr/bin/deepfield"),
            ("-rw-r--r-- root/root", "/usr/share/man/man1/deepfield-render.1.gz"),
            ("-rw-r--r-- root/root", "/usr/share/bash-completion/completions/deepfield"),
            ("-rw-r--r-- root/root", "/usr/share/applications/deepfield.desktop"),
            ("-rw-r--r-- root/root", "/usr/share/mime/packages/deepfield.xml"),
            ("-rw-r--r-- root/root", "/usr/share/icons/hicolor/scalable/apps/deepfield.svg"),
            ("drwxr-xr-x root/root", "/usr/share/doc/deepfield/"),
        ] {
            assert!(held.lines().any(|line| line.starts_with(mode) && line.ends_with(name)), "{name}: {held}");
        }
        let depends = said(Command::new("dpkg-deb").arg("--field").arg(&package).arg("Depends"));
        assert!(depends.contains("libc6 (>= 2.31)"), "{depends}");
        let mut lintian = Command::new("lintian");
        finds_nothing(
            lintian.args(["--allow-root", "--fail-on", "error,warning"]).arg(&package),
            "apt-get install lintian",
        );
    }

    assert!(release("second", &["archive"]).status.success());
    let again = folder.path().join("second").join(archive.file_name().unwrap());
    assert!(std::fs::read(&archive).unwrap() == std::fs::read(&again).unwrap(), "the same bytes");

    let refused = release("third", &["archive", "--glibc", "2.28"]);
    let message = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{message}");
    assert!(message.lines().last().unwrap().contains("found 2.31, expected 2.28 or older"), "{message}");
    assert_eq!(std::fs::read_dir(folder.path().join("third")).unwrap().count(), 0, "nothing is left there");
}
