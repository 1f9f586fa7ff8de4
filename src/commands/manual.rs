//! `deepfield manual`: the manual pages.

use super::{CommandResult, description, print_line};
use crate::color::output::write_atomically;
use clap_mangen::Man;
use std::path::PathBuf;

/// Writes manual pages: one of the program and one of each command.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  deepfield manual ~/.local/share/man/man1        then: man deepfield, man deepfield-render")]
pub struct Arguments {
    /// The folder, which is made where there is none; its pages of the same names are replaced.
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
}

/// Writes the pages.
///
/// # Errors
/// Where the folder cannot be made, or a page cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let folder = &arguments.folder;
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let pages = pages()?;
    for (name, page) in &pages {
        write_atomically(&folder.join(name), page)?;
    }
    print_line(format_args!("{} manual pages are in {}", pages.len(), folder.display()))?;
    Ok(())
}

/// File names and contents of the pages of all commands that help lists.
fn pages() -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let mut whole = description::command_line().disable_help_subcommand(true);
    whole.build();
    let source = format!("{} {}", whole.get_name(), whole.get_version().unwrap_or_default());
    let mut waiting = vec![&whole];
    let mut pages = Vec::new();
    while let Some(command) = waiting.pop() {
        waiting.extend(command.get_subcommands().filter(|below| !below.is_hide_set()));
        let man = Man::new(command.clone()).source(&source).manual("deepfield");
        let mut page = Vec::new();
        man.render(&mut page)?;
        pages.push((man.get_filename(), page));
    }
    Ok(pages)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_that_explains_every_option() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("man/man1");
        // The second time they are there.
        for _ in 0..2 {
            run(&Arguments { folder: folder.clone() }).unwrap();
        }
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), pages().unwrap().len(), "nothing stays beside them");
        let page = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
        let whole = description::command_line();
        let first = page("deepfield.1");
        for command in whole.get_subcommands().filter(|command| !command.is_hide_set()) {
            let name = command.get_name();
            assert!(first.contains(&format!("deepfield\\-{name}(1)")), "{name} is in the program's page");
            let page = page(&format!("deepfield-{name}.1"));
            assert!(page.contains(&format!("\n.SH NAME\ndeepfield\\-{name} \\- ")), "{name}: {page:.300}");
            let shown = command.get_arguments().filter(|argument| !argument.is_hide_set());
            for option in shown.filter_map(|argument| argument.get_long()) {
                let written = format!("\\-\\-{}", option.replace('-', "\\-"));
                assert!(page.contains(&written), "{name}: --{option}");
            }
        }
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("taken");
        std::fs::write(&file, "").unwrap();
        let error = run(&Arguments { folder: file.join("man1") }).unwrap_err().to_string();
        assert!(error.contains("taken") && error.lines().count() == 1, "{error}");
    }
}
