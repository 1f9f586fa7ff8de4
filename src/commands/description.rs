//! The whole command line as a value: what parsing, help, shell completions and manual pages are made of.

use super::Command;
use super::overwriting::named_to_read;
use crate::heights::import::height_names;
use crate::import;
use crate::look::is_file_of;
use crate::model::url::shown_argument;
use crate::modes;
use crate::store::temporary::folder_of;
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Explore huge point data, sampled grids and measured heights: snapshots, star catalogues, images, volumes, surfaces, and their
/// hierarchies on disk.
///
/// Without a command, deepfield opens its demo dataset in a window, or renders it to a file where there is no display.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  deepfield                                        the demo dataset
  deepfield view snapshot_099.hdf5                 look around in a snapshot
  deepfield render snapshot_099.hdf5 -o halo.png   the same picture without a window
  deepfield info snapshot_099.hdf5                 what the file holds
  deepfield build head.nrrd -o head.df             an image or a volume, as oriented points over its samples
  deepfield view surface.sur                       measured heights: turn them, read samples, draw profiles"
)]
struct CommandLine {
    #[command(subcommand)]
    command: Option<Command>,
}

/// The command line, with the modes and formats that are registered in its help.
pub fn command_line() -> clap::Command {
    let command = CommandLine::command();
    let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let [modes, particles] = [modes::names(), import::names()];
    let [grids, heights] = [import::grid::grid_names(), height_names()];
    command.after_help(format!(
        "{examples}\n\nModes: {modes}\nFormats of particles: {particles}\nFormats of images and volumes: {grids}\n\
         Formats of heights: {heights}"
    ))
}

/// Names, in all commands, of the arguments that are files to write, often at the end of long work.
const WRITTEN: [&str; 9] = ["output", "out", "raw", "overdraw", "json", "csv", "video", "picture", "state"];

/// Looks where a command is to write before it does anything.
///
/// # Errors
/// One line with the file for which there is no place, or whose place is that of a file that is read.
fn check_written(matches: &ArgMatches) -> Result<(), String> {
    let paths = WRITTEN.iter().filter_map(|name| matches.try_get_many::<PathBuf>(name).ok().flatten()).flatten();
    // Of a tour: the frame's number, then its file.
    let frame = matches.try_get_many::<String>("frame").ok().flatten().into_iter().flatten().nth(1);
    let read = named_to_read(matches, &WRITTEN);
    paths.map(PathBuf::as_path).chain(frame.map(Path::new)).try_for_each(|path| {
        let told = |why: String| Err(format!("{}: cannot be written: {why}", path.display()));
        let folder = folder_of(path);
        if path.is_dir() {
            return told("found a folder, expected the name of a file".into());
        }
        if !folder.is_dir() {
            return told(format!("found no folder {}, expected one", folder.display()));
        }
        if is_file_of(path, &read) {
            return told("found a file that is read, expected another name".into());
        }
        Ok(())
    })
}

/// The command that is asked for; leaves the program where there is a mistake, or help was asked for.
///
/// # Errors
/// One line where what it is to write has no place.
pub fn parse() -> Result<Option<Command>, String> {
    // Only what is shown of a URL goes further.
    let shown =
        |argument: OsString| argument.into_string().map_or_else(|other| other, |text| shown_argument(&text).into());
    let matches = command_line().get_matches_from(std::env::args_os().map(shown));
    let command = CommandLine::from_arg_matches(&matches).unwrap_or_else(|error| error.exit()).command;
    matches.subcommand().map_or(Ok(()), |(_, of_command)| check_written(of_command))?;
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build};
    use crate::import::{LoadOptions, load};

    /// What is said of the places of the files that a command is to write.
    fn said(arguments: &[&str]) -> Result<(), String> {
        let matches = command_line().try_get_matches_from([&["deepfield"][..], arguments].concat()).unwrap();
        check_written(matches.subcommand().unwrap().1)
    }

    #[test]
    fn places_of_files_are_looked_at_first() {
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path().to_string_lossy();
        let [there, missing] = ["x.png", "missing/x.npy"].map(|name| format!("{here}/{name}"));
        let [there, missing] = [there.as_str(), missing.as_str()];
        let plain = ["render", "in.df", "-o", there];
        assert_eq!(said(&plain), Ok(()));
        assert_eq!(said(&[&plain[..], &["--json", "-"]].concat()), Ok(()));
        let why = format!("{missing}: cannot be written: found no folder {here}/missing, expected one");
        for arguments in [
            [&plain[..], &["--raw", missing]].concat(),
            [&plain[..], &["--json", missing]].concat(),
            vec!["build", "in.npy", "-o", missing],
            vec!["tour", "in.tour.ron", "--frame", "3", missing],
            vec!["tour", "in.tour.ron", "--video", missing],
            vec!["plot", "in.df", "--histogram", "mass", "-o", there, "-o", missing],
            vec!["synth", "cosmology", "-n", "10", "-o", missing],
        ] {
            assert_eq!(said(&arguments), Err(why.clone()), "{arguments:?}");
        }
        let of_folder = Err(format!("{here}: cannot be written: found a folder, expected the name of a file"));
        assert_eq!(said(&["surface", "in.df", "--isovalue", "1", "-o", &here]), of_folder);
    }

    /// A heading of help goes on until the next one, over all that is declared behind it.
    #[test]
    fn options_of_all_data_are_not_below_the_headings_of_some() {
        let of_some = ["Height fields", "Images and volumes", "Samples without a header", "Velocity fields"];
        let of_all =
            ["out", "output", "json", "derive", "background", "exposure", "bloom", "preset", "picture", "as_what"];
        for command in command_line().get_subcommands() {
            for argument in command.get_arguments().filter(|argument| of_all.contains(&argument.get_id().as_str())) {
                let below = argument.get_help_heading().filter(|heading| of_some.contains(heading));
                assert_eq!(below, None, "{} {}", command.get_name(), argument.get_id());
            }
        }
    }

    #[test]
    fn what_is_read_is_not_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "x,y,z\n0,0,0\n1,0,0\n").unwrap();
            path.to_str().unwrap().to_owned()
        };
        let [a, b, ids, run_1, run_2] = ["a.csv", "b.csv", "who.ids", "run/p_1.csv", "run/p_2.csv"].map(put);
        std::fs::write(folder.path().join("list.txt"), "a.csv\nb.csv\n").unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let [run, pattern, list] = [at("run"), at("run/p_*.csv"), format!("@{}", at("list.txt"))];
        let (other_name, of_b) = (at("run/../a.csv"), format!("{b}#0"));
        let built = at("a.df");
        let dataset = load(Path::new(&a), &LoadOptions::default(), &()).unwrap();
        build(dataset, &BuildOptions::default(), Path::new(&built), &()).unwrap();
        let [scene, tour] = [
            ("s.scene.ron", "(version: 1, datasets: [(path: \"a.csv\", texture: \"b.csv\")], labels: \"who.ids\")"),
            (
                "t.ron",
                "(version: 1, dataset: (path: \"a.csv\"),
                  keyframes: [(around: (what: object(\"b.csv#0\")), images: [(path: \"who.ids\")])])",
            ),
        ]
        .map(|(name, text)| {
            std::fs::write(folder.path().join(name), text).unwrap();
            at(name)
        });
        let parts = [0, 1].map(|k| format!("{}/tests/data/arepo.{k}.hdf5", env!("CARGO_MANIFEST_DIR")));
        for (arguments, over) in [
            (vec!["build", &a, "-o", &a], &a),
            (vec!["build", &a, "-o", &other_name], &other_name),
            (vec!["build", &a, &b, "-o", &b], &b),
            (vec!["build", &run, "-o", &run_2], &run_2),
            (vec!["build", &pattern, "-o", &run_1], &run_1),
            (vec!["build", &list, "-o", &b], &b),
            (vec!["build", &parts[0], "-o", &parts[1]], &parts[1]),
            (vec!["select", &a, "-o", &a], &a),
            (vec!["select", &built, "-o", &a], &a),
            (vec!["select", &a, "--ids", &ids, "-o", &ids], &ids),
            (vec!["select", &a, "--at", &of_b, "-o", &b], &b),
            (vec!["plot", &a, "--histogram", "mass", "-o", "plot.png", "-o", &a], &a),
            (vec!["probe", &a, "--json", &a], &a),
            (vec!["render", &a, "--with", &b, "-o", "picture.png", "--raw", &b], &b),
            (vec!["view", &a, "--picture", &a], &a),
            (vec!["view", &run, "--status", &run_1], &run_1),
            (vec!["tour", "--around", &a, "--frame", "0", &a], &a),
            (vec!["render", &scene, "-o", &a], &a),
            (vec!["render", &scene, "-o", "picture.png", "--raw", &b], &b),
            (vec!["render", &run, "--scene", &scene, "-o", &ids], &ids),
            (vec!["tour", &tour, "--frame", "0", &a], &a),
            (vec!["tour", &tour, "--video", &b], &b),
            (vec!["tour", &tour, "--frame", "0", &ids], &ids),
        ] {
            let why = format!("{over}: cannot be written: found a file that is read, expected another name");
            assert_eq!(said(&arguments), Err(why), "{arguments:?}");
        }
        let fresh = at("run/p.df");
        for arguments in [
            vec!["build", &a, "-o", &b],
            vec!["select", &built, "-o", &b],
            vec!["build", &a, "-o", &built],
            vec!["build", &run, "-o", &a],
            vec!["build", &run, "-o", &fresh],
            vec!["probe", &a, "--json", "-"],
            vec!["view", &run, "--status", &a],
            vec!["build", "--status", &run],
        ] {
            assert_eq!(said(&arguments), Ok(()), "{arguments:?}");
        }
    }
}
