//! What `packaging/` holds, by the tools of its formats where they are installed.

use crate::release::said;
use crate::support::in_repository;
use std::io::ErrorKind;
use std::process::Command;

/// Has a tool look, which must find nothing to say; where it is not installed, that is told, and what installs it.
pub fn finds_nothing(tool: &mut Command, install: &str) {
    match tool.output() {
        Ok(output) => {
            let told = [output.stdout, output.stderr].concat();
            assert!(output.status.success() && told.is_empty(), "{tool:?}: {}", String::from_utf8_lossy(&told));
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: {} is not installed, and not asked: {install}", tool.get_program().display());
        }
        Err(error) => panic!("{tool:?}: {error}"),
    }
}

fn text_of(path: &str) -> String {
    std::fs::read_to_string(in_repository("packaging").join(path)).unwrap()
}

/// The kinds of files that a desktop tells by their first bytes are those that there are, and opens them by an entry for their type.
#[test]
fn the_desktop_tells_files_by_the_bytes_that_they_begin_with() {
    let text = text_of("desktop/deepfield.xml");
    for magic in [
        deepfield::store::layout::MAGIC,
        deepfield::store::layout::GRID_MAGIC,
        deepfield::store::run::MAGIC,
        deepfield::heights::store::HEIGHTS_MAGIC,
    ] {
        let written: String = magic
            .iter()
            .map(|&byte| match byte {
                b'\r' => "\\r".to_owned(),
                b'\n' => "\\n".to_owned(),
                b' '..=b'~' => char::from(byte).to_string(),
                _ => format!("\\{byte:03o}"),
            })
            .collect();
        assert!(text.contains(&format!("value=\"{written}\"")), "{written}");
    }
    assert!(text.contains("<mime-type type=\"application/x-deepfield\">"), "{text}");
    let entry = text_of("desktop/deepfield-view.desktop");
    assert!(entry.contains("\nMimeType=application/x-deepfield;\n"), "{entry}");

    let entries = ["desktop/deepfield.desktop", "desktop/deepfield-view.desktop"];
    let entries = entries.map(|path| in_repository("packaging").join(path));
    finds_nothing(Command::new("desktop-file-validate").args(entries), "apt-get install desktop-file-utils");
    // The tool says where nobody would look for what it makes, so that the folder is one where files are looked for.
    let folder = tempfile::tempdir().unwrap();
    let mime = folder.path().join("mime");
    std::fs::create_dir_all(mime.join("packages")).unwrap();
    std::fs::write(mime.join("packages/deepfield.xml"), text).unwrap();
    let mut database = Command::new("update-mime-database");
    finds_nothing(database.arg(&mime).env("XDG_DATA_HOME", folder.path()), "apt-get install shared-mime-info");
}

/// Its script says what it expects of each platform.
#[test]
fn the_recipe_of_conda_forge_is_rendered_for_every_platform() {
    let recipe = text_of("conda-forge/recipe.yaml");
    for line in
        [concat!("version: \"", env!("CARGO_PKG_VERSION"), "\""), concat!("license: ", env!("CARGO_PKG_LICENSE"))]
    {
        assert!(recipe.lines().any(|found| found.trim() == line), "{line}: {recipe}");
    }
    let python = std::env::var_os("DEEPFIELD_TEST_PYTHON").unwrap_or_else(|| "python3".into());
    let asked = Command::new(&python).args(["-c", "import rattler_build"]).output();
    if !asked.is_ok_and(|output| output.status.success()) {
        let python = python.display();
        eprintln!(
            "skipped: py-rattler-build is not installed, and not asked: {python} -m pip install py-rattler-build"
        );
        return;
    }
    said(
        Command::new(&python)
            .arg(in_repository("tests/processor/recipe.py"))
            .arg(in_repository("packaging/conda-forge")),
    );
}

/// The image is made of what its definition copies: all that there are packages of, and a compiler as new as they ask for.
#[test]
fn the_image_for_clusters_has_all_packages_and_a_compiler_for_them() {
    let definition = text_of("apptainer/deepfield.def");
    let image = concat!("From: rust:", env!("CARGO_PKG_RUST_VERSION"), "-");
    assert!(definition.contains(image), "{image}: {definition}");
    let (_, files) = definition.split_once("\n%files\n").unwrap();
    let copied: Vec<(&str, &str)> =
        files.lines().take_while(|line| !line.is_empty()).map(|line| line.trim().split_once(' ').unwrap()).collect();
    for (from, to) in &copied {
        assert!(in_repository(from).exists() && *to == format!("/deepfield/{from}"), "{from} {to}");
    }
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut asked = Command::new(cargo);
    asked.args(["metadata", "--format-version", "1", "--no-deps", "--offline"]).current_dir(in_repository(""));
    let metadata: serde_json::Value = serde_json::from_str(&said(&mut asked)).unwrap();
    let root = format!("{}/", metadata["workspace_root"].as_str().unwrap());
    let packages = metadata["packages"].as_array().unwrap();
    let targets = packages.iter().flat_map(|package| package["targets"].as_array().unwrap());
    let sources: Vec<&str> =
        targets.map(|target| target["src_path"].as_str().unwrap().strip_prefix(&root).unwrap()).collect();
    assert!(sources.contains(&"src/main.rs"), "{sources:?}");
    for path in sources.into_iter().chain(["Cargo.toml", "Cargo.lock"]) {
        assert!(copied.iter().any(|&(from, _)| path.split('/').next() == Some(from)), "{path}: {copied:?}");
    }
}
