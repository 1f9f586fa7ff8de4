//! What lets a file be read is shown to its server and to nobody else: it is in no message, no log and no file that is written.

use super::{served, without_keys};
use crate::support::fault_server::Fault;
use crate::support::program;
use std::path::{Path, PathBuf};

/// What all secrets of this test begin with.
const SECRET: &str = "s3cr3t";

fn is_secret_in(bytes: &[u8]) -> bool {
    bytes.windows(SECRET.len()).any(|part| part == SECRET.as_bytes())
}

/// All files below a folder have names and bytes without secrets. How many there are.
fn searched(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let of_entry = |path: PathBuf| {
        assert!(!path.to_string_lossy().contains(SECRET), "{}", path.display());
        if path.is_dir() {
            return searched(&path);
        }
        assert!(!is_secret_in(&std::fs::read(&path).unwrap()), "{}", path.display());
        1
    };
    entries.map(of_entry).sum()
}

#[test]
fn secrets_are_in_nothing_that_is_said_or_written() {
    let (folder, server) = (tempfile::tempdir().unwrap(), served());
    let endpoint = server.url("").trim_end_matches('/').to_owned();
    let run = |arguments: &[&str], is_let: bool| {
        let mut command = program();
        without_keys(&mut command).args(arguments).current_dir(folder.path());
        command.env("XDG_CACHE_HOME", folder.path()).env("RUST_LOG", "trace").env("RUST_BACKTRACE", "1");
        command.env("DEEPFIELD_TOKEN", "s3cr3t-token").env("AWS_ENDPOINT_URL", &endpoint);
        command.env("AWS_ACCESS_KEY_ID", "me").env("AWS_SECRET_ACCESS_KEY", "s3cr3t-key");
        let output = command.env("AWS_SESSION_TOKEN", "s3cr3t-session").output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        let text = String::from_utf8_lossy(&said);
        assert_eq!(output.status.success(), is_let, "{arguments:?}: {text}");
        assert!(!is_secret_in(&said), "{arguments:?}: {text}");
    };
    let look = ["--size", "48x27", "--mode", "column-density", "--error-px", "3", "--backend", "cpu"];
    let url = server.url("a.df?sig=s3cr3t-query");
    let files = [url.as_str(), "s3://bucket/b.df"];
    for file in files {
        run(&["info", file, "--json"], true);
        run(&[&["render", file, "-o", "picture.png", "--json", "-"][..], &look[..]].concat(), true);
    }
    let tour = ["tour", "--around", files[0], "--seconds", "2", "--fps", "1", "--end", "1", "--record", "frames"];
    run(&[&tour[..], &look[..]].concat(), true);
    // A picture, those of a tour and their scenes, and of each file its pages and its ends.
    let count = searched(folder.path());
    assert!(folder.path().join("frames/scenes/frame-00000.scene.ron").exists() && count > 20, "{count}");
    // All of them were of use.
    let asked = server.asked();
    let shown = asked.iter().map(|asked| {
        let of_bucket = asked.session_token.as_deref() == Some("s3cr3t-session");
        let of_web = asked.authorization.as_deref() == Some("Bearer s3cr3t-token");
        assert_eq!((of_web, of_bucket), (asked.target == "/a.df?sig=s3cr3t-query", asked.target == "/bucket/b.df"));
        of_bucket
    });
    assert!((1..asked.len()).contains(&shown.filter(|of_bucket| *of_bucket).count()));
    for refusal in [401, 403, 404, 500] {
        server.answer(move |_| Fault::Status(refusal, None));
        files.iter().for_each(|file| run(&["info", *file], refusal == 500));
    }
    searched(folder.path());
}
