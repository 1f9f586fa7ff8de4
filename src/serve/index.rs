//! The page of a folder: its built files, with what opens them, and its folders.

use super::files::is_shown;
use super::percent::encoded;
use crate::explore::xml_escaped;
use crate::look::DataKind;
use std::ffi::OsStr;
use std::fmt::Write;
use std::io;
use std::path::Path;

/// The most entries of a page.
const MOST: usize = 2000;

/// The page of a folder at the path `path` of the server `here`, or of the one file of it that is served.
///
/// # Errors
/// Where the folder cannot be read.
pub(super) fn page(folder: &Path, path: &str, here: &str, only: Option<&OsStr>) -> io::Result<String> {
    let mut entries: Vec<(bool, bool, String)> = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let (Ok(name), Ok(kind)) = (entry.file_name().into_string(), entry.file_type()) else { continue };
        // A link may lead out of what is served, a pipe would be waited for.
        let is_served = (kind.is_dir() || kind.is_file()) && is_shown(&name);
        if is_served && only.is_none_or(|only| *only == *name) {
            entries.push((kind.is_file(), !name.ends_with(".df"), name));
        }
    }
    // What is named as built files are comes first: no more than so many are looked into.
    entries.sort();
    let left_out = entries.len().saturating_sub(MOST);
    entries.truncate(MOST);
    let row = |(is_file, _, name): &(bool, bool, String)| match is_file {
        true => file(folder, path, here, name),
        false => Some(inner(name)),
    };
    let rows: String = entries.iter().filter_map(row).collect();
    let rows = if rows.is_empty() { "<tr><td>no built files: deepfield build makes them\n".to_owned() } else { rows };
    let more = if left_out > 0 { format!("<p>and {left_out} more\n") } else { String::new() };
    let title = xml_escaped(path);
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>{title} - deepfield</title>\n\
         <style>body {{ font: 15px system-ui, sans-serif; margin: 2em }} td {{ padding: 2px 2em 2px 0 }}</style>\n\
         <h1>{title}</h1>\n<table>\n{rows}</table>\n{more}</html>\n"
    ))
}

fn inner(name: &str) -> String {
    format!("<tr><td><a href=\"./{}/\">{}/</a>\n", encoded(name), xml_escaped(name))
}

/// The row of a built file; none of others.
fn file(folder: &Path, path: &str, here: &str, name: &str) -> Option<String> {
    let file = folder.join(name);
    let about = std::fs::symlink_metadata(&file).ok().filter(std::fs::Metadata::is_file)?;
    let kind = DataKind::of(&file).ok().filter(|kind| *kind != DataKind::Source)?;
    let (link, kind) = (encoded(name), kind.described());
    let mut row = format!("<tr><td><a href=\"./{link}\">{}</a><td>{}<td>{kind}", xml_escaped(name), size(about.len()));
    // Writing to a string cannot fail.
    let _ = writeln!(row, "<td><code>deepfield view {}{link}</code>", xml_escaped(&format!("{here}{path}")));
    Some(row)
}

/// A number of bytes for people.
fn size(bytes: u64) -> String {
    const UNITS: [&str; 7] = ["B", "kB", "MB", "GB", "TB", "PB", "EB"];
    let power = bytes.max(1).ilog10() / 3;
    match power {
        0 => format!("{bytes} B"),
        _ => format!("{:.1} {}", bytes as f64 / 1000_f64.powi(power as i32), UNITS[power as usize]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_files_are_listed_among_many_others_and_links_are_not() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..MOST {
            std::fs::write(folder.path().join(format!("a{number}.txt")), "").unwrap();
        }
        std::fs::write(folder.path().join("z.df"), b"\x89DFP\r\n\x1a\n").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink("/", folder.path().join("out")).unwrap();
        let page = page(folder.path(), "/", "http://localhost:8080", None).unwrap();
        assert!(page.contains("./z.df") && page.contains("and 1 more") && !page.contains("./out"), "{page}");
    }
}
