//! The order of the rooms: data flows one way, and a room uses only the rooms before it.
//!
//! Every path in the sources of all packages that begins with `crate`, `super` or a package's name is looked at, whether it
//! stands in a `use` or elsewhere. Tests are exempt: they may build what they need with rooms above their own.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The rooms of each package, each before those that may use it; the package of height fields is one of them.
const ROOMS: [&[&str]; 4] = [
    &["lanes", "model", "codec", "columnar", "import", "hierarchy", "store", "build", "synth"],
    &["heights"],
    &["view", "stream", "color", "cpu", "mode", "modes", "annotate", "explore", "look", "picture", "tour"],
    &["gpu", "window", "show", "command_line", "serve", "bench", "commands", "program"],
];

/// The rooms of height fields in the same way. Their names are those of the rooms of other data.
const HEIGHTS: [&[&str]; 1] =
    [&["model", "import", "codec", "hierarchy", "store", "build", "measure", "export", "synth", "opened"]];

/// The rooms of the window in the same way. What is directly in `window` is the list of its plugins: it uses all of them, and
/// none of them uses it.
const WINDOW: [&[&str]; 4] = [
    // What several rooms read and write.
    &[
        "ron_asset",
        "free_name",
        "preset",
        "options",
        "statistics",
        "state",
        "input",
        "theme",
        "panes",
        "camera",
        "picture",
        "sheet",
        "picture_sizes",
        "hidden",
        "written",
        "pass_times",
        "sampled",
        "facts",
        "page_entities",
    ],
    // What is open, and how it is to be seen.
    &[
        "scene",
        "ground",
        "lens",
        "open",
        "playhead",
        "objects",
        "scene_io",
        "growing",
        "adopt",
        "bookmarks",
        "preset_assets",
        "transfer_presets",
        "exposure",
        "look",
    ],
    // What is drawn.
    &[
        "streaming",
        "occlusion",
        "listed",
        "pages",
        "live",
        "pick",
        "pointer_motion",
        "shader_reload",
        "run_ranges",
        "touring",
        "comparison",
        "paths",
        "cpu_backend",
        "field_backend",
        "surround_backend",
        "gpu_backend",
        "light_backend",
        "bloom",
        "pacing",
        "assistive",
    ],
    // What the user does and reads.
    &[
        "looking",
        "time_dock",
        "screenshot",
        "history",
        "shortcuts",
        "dropped",
        "files",
        "overlay",
        "panel",
        "ui",
        "status",
    ],
];

/// A path in a source file: the line where it stands, and its segments from the package's root on.
struct Import {
    line: usize,
    path: Vec<String>,
}

/// The module of a file from its path below `src`.
fn module_of(file: &Path) -> Vec<String> {
    let mut module: Vec<String> =
        file.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib")) {
        module.pop();
    }
    module
}

/// The text without comments, strings and the tests at its end; lines stay where they are.
fn code_of(text: &str) -> String {
    let mut code = String::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let opens_tests =
            |next: &&str| next.trim_start_matches("pub(crate) ").starts_with("mod ") && next.ends_with('{');
        if line == "#[cfg(test)]" && lines.peek().is_some_and(opens_tests) {
            break;
        }
        let mut in_string = false;
        let mut before = ' ';
        let mut characters = line.chars().peekable();
        while let Some(character) = characters.next() {
            match character {
                '\\' if in_string => drop(characters.next()),
                // A quote as a character begins no string.
                '"' if before != '\'' || characters.peek() != Some(&'\'') => in_string = !in_string,
                '/' if !in_string && characters.peek() == Some(&'/') => break,
                _ if !in_string => code.push(character),
                _ => {}
            }
            before = character;
        }
        code.push('\n');
    }
    code
}

/// The paths of a tree of imports that begins at `code`, below `path`, and what follows the tree.
fn paths<'a>(code: &'a str, path: &[String], found: &mut Vec<Vec<String>>) -> &'a str {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut rest = code.trim_start();
    if let Some(inner) = rest.strip_prefix('{') {
        rest = inner.trim_start();
        while !rest.is_empty() && !rest.starts_with('}') {
            let after = paths(rest, path, found).trim_start();
            let after = after.strip_prefix(',').unwrap_or(after).trim_start();
            // Neither a path nor the end: this is no tree of imports.
            if after.len() == rest.len() {
                return after;
            }
            rest = after;
        }
        return rest.strip_prefix('}').unwrap_or(rest);
    }
    let (name, after) = rest.split_at(rest.find(|c| !is_name(c)).unwrap_or(rest.len()));
    if name.is_empty() {
        let all = rest.strip_prefix('*');
        found.extend(all.map(|_| path.to_vec()));
        return all.unwrap_or(rest);
    }
    let path = [path, &[name.to_owned()]].concat();
    match after.strip_prefix("::") {
        Some(next) if next.starts_with(|c| is_name(c) || c == '{' || c == '*') => paths(next, &path, found),
        _ => {
            found.push(path);
            after.trim_start().strip_prefix("as ").map_or(after, |renamed| renamed.trim_start_matches(is_name))
        }
    }
}

/// What a file uses of its own package, in which all modules are below `within`, and of those below.
fn imports(code: &str, module: &[String], within: &[String]) -> Vec<Import> {
    let mut imports = Vec::new();
    for root in ["crate::", "super::", "deepfield_data::", "deepfield_heights::", "deepfield_draw::"] {
        for (at, _) in code.match_indices(root) {
            let before = &code[..at];
            // `pub(in crate::a)` says who may use something.
            if before.ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':') || before.ends_with("(in ") {
                continue;
            }
            let line = before.matches('\n').count() + 1;
            let mut found = Vec::new();
            paths(&code[if root == "super::" { at } else { at + root.len() }..], &[], &mut found);
            for path in found {
                let ups = path.iter().take_while(|name| *name == "super").count();
                let parent = match root {
                    _ if ups > 0 => module[..module.len().saturating_sub(ups)].to_vec(),
                    "crate::" => within.to_vec(),
                    "deepfield_heights::" => vec!["heights".to_owned()],
                    _ => Vec::new(),
                };
                imports.push(Import { line, path: [&parent[..], &path[ups..]].concat() });
            }
        }
    }
    imports
}

/// Why a module may not use a path, if it may not.
fn refusal(module: &[String], path: &[String]) -> Option<String> {
    let place = |order: &[&[&str]], name: &str| order.concat().iter().position(|room| *room == name);
    let (user, used) = (module.first()?, path.first()?);
    let (Some(at), Some(from)) = (place(&ROOMS, user), place(&ROOMS, used)) else {
        let unknown = if place(&ROOMS, user).is_none() { user } else { used };
        // Items at the root of a package are no rooms.
        return unknown.starts_with(char::is_lowercase).then(|| format!("{unknown} is not in the order of rooms"));
    };
    if from > at {
        return Some(format!("{user} comes before {used}"));
    }
    if user != used || !matches!(user.as_str(), "window" | "heights") || module.len() < 2 {
        return None;
    }
    let is_heights = user == "heights";
    let (user, used) = (module[1].as_str(), path.get(1).map_or("*", String::as_str));
    if is_heights {
        return match (place(&HEIGHTS, user), place(&HEIGHTS, used)) {
            (Some(at), Some(from)) => (from > at).then(|| format!("heights::{user} comes before heights::{used}")),
            // Items at the root of the package are no rooms.
            (Some(_), None) if used.starts_with(char::is_uppercase) => None,
            (at, _) => {
                let unknown = if at.is_none() { user } else { used };
                Some(format!("heights::{unknown} is not in the order of the rooms of heights"))
            }
        };
    }
    match (place(&WINDOW, user), place(&WINDOW, used)) {
        (None, _) => Some(format!("window::{user} is not in the order of the window's rooms")),
        (_, None) => Some(format!("window::{used} belongs to the list of plugins, which no room of the window uses")),
        (Some(at), Some(from)) => (from > at).then(|| format!("window::{user} comes before window::{used}")),
    }
}

/// The sources below a folder, without files of tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && name != "tests" {
            sources(&path, found);
        } else if name.ends_with(".rs") && !["tests.rs", "main.rs", "lib.rs"].contains(&name.as_str()) {
            found.push(path);
        }
    }
}

#[test]
fn a_room_uses_only_rooms_before_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap();
    let mut wrong = String::new();
    for (package, within) in
        [("crates/data/src", None), ("crates/heights/src", Some("heights")), ("crates/draw/src", None), ("src", None)]
    {
        let within: Vec<String> = within.into_iter().map(String::from).collect();
        let mut files = Vec::new();
        sources(&root.join(package), &mut files);
        assert!(files.len() > 50, "{package}: only {} files", files.len());
        for source in files {
            let file = source.strip_prefix(&root).unwrap().to_string_lossy().into_owned();
            let module = [&within[..], &module_of(source.strip_prefix(root.join(package)).unwrap())].concat();
            let code = code_of(&std::fs::read_to_string(&source).unwrap());
            for Import { line, path } in imports(&code, &module, &within) {
                let Some(why) = refusal(&module, &path) else { continue };
                writeln!(wrong, "{file}:{line}: {}: {why}", path.join("::")).unwrap();
            }
        }
    }
    assert!(wrong.is_empty(), "imports against the direction of the rooms:\n{wrong}");
}

#[test]
fn imports_are_found_wherever_they_stand() {
    let text = "//! See crate::tour.\nuse crate::view::{\n    View as Seen, camera::{self, Camera},\n};\nuse super::theme;\n\
        fn f() -> super::super::store::Page { let s = \"crate::tour\"; deepfield_data::model::g() }\npub(in crate::gpu) struct S;\n\
        use super::*;\n#[cfg(test)]\nmod tests {\n    use crate::commands::x;\n}\n";
    let module: Vec<String> = ["window", "panel", "mode"].map(String::from).to_vec();
    let found: Vec<(usize, String)> =
        imports(&code_of(text), &module, &[]).into_iter().map(|import| (import.line, import.path.join("::"))).collect();
    let expected = [
        (2, "view::View"),
        (2, "view::camera::self"),
        (2, "view::camera::Camera"),
        (5, "window::panel::theme"),
        (6, "window::store::Page"),
        (8, "window::panel"),
        (6, "model::g"),
    ];
    assert_eq!(found, expected.map(|(line, path)| (line, path.to_owned())));
}

#[test]
fn the_order_is_kept_between_rooms_and_within_the_window() {
    let refused = |module: &str, path: &str| {
        let split = |text: &str| text.split("::").map(String::from).collect::<Vec<_>>();
        refusal(&split(module), &split(path)).is_some()
    };
    assert!(refused("store::page", "view::View") && !refused("view::selection", "store::PageId"));
    assert!(
        refused("window::camera::fly", "window::panel::theme") && !refused("window::panel::mode", "window::camera")
    );
    assert!(refused("window::panel", "window::run_window") && !refused("window", "window::panel::PanelPlugin"));
    assert!(refused("window::options", "show::rig::OutputError") && !refused("show::window::output", "window::ui"));
    assert!(refused("heights::store", "heights::measure::pick") && !refused("heights::measure", "model::Unit"));
    assert!(refused("model", "heights::model") && !refused("cpu::surface", "heights::store"));
    assert!(refused("attic::box", "model::Bounds") && refused("window::attic", "window::state"));
}
