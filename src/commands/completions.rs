//! `deepfield completions`: how a shell completes deepfield's commands and options.

use super::{CommandResult, description};
use clap_complete::aot::{Shell, generate};
use std::io::Write;

/// Prints a script by which a shell completes commands, options and their values.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield completions bash > ~/.local/share/bash-completion/completions/deepfield
  deepfield completions zsh > ~/.zfunc/_deepfield        with ~/.zfunc in fpath before compinit is called
  deepfield completions fish > ~/.config/fish/completions/deepfield.fish
  deepfield completions powershell >> $PROFILE
  deepfield completions elvish >> ~/.config/elvish/rc.elv")]
pub struct Arguments {
    /// The shell.
    #[arg(value_name = "SHELL", value_enum)]
    pub shell: Shell,
}

/// Prints the script.
///
/// # Errors
/// When standard output cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    std::io::stdout().lock().write_all(&script(arguments.shell))?;
    Ok(())
}

/// The script of a shell.
fn script(shell: Shell) -> Vec<u8> {
    let mut command = description::command_line();
    let name = command.get_name().to_owned();
    // In memory first: writing it is no place to panic.
    let mut script = Vec::new();
    generate(shell, &mut command, name, &mut script);
    script
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;

    #[test]
    fn every_shell_knows_every_command_and_every_option() {
        let whole = description::command_line();
        for shell in Shell::value_variants() {
            let script = String::from_utf8(script(*shell)).unwrap();
            for command in whole.get_subcommands().filter(|command| !command.is_hide_set()) {
                let shown = command.get_arguments().filter(|argument| !argument.is_hide_set());
                let options = shown.filter_map(|argument| argument.get_long());
                for name in options.chain([command.get_name()]) {
                    assert!(script.contains(name), "{shell}: {}: {name}", command.get_name());
                }
            }
        }
    }

    /// The script is run as bash runs it when the last of some words is to be completed.
    #[cfg(unix)]
    #[test]
    fn bash_completes_commands_options_and_values() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deepfield");
        std::fs::write(&path, script(Shell::Bash)).unwrap();
        let call = r#"source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
            _deepfield deepfield "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"; echo "${COMPREPLY[@]}""#;
        for (words, expected) in [
            ("deepfield reconst", "reconstruct"),
            ("deepfield render --backe", "--backend"),
            ("deepfield render halo.df --backend ra", "raster"),
            ("deepfield completions po", "powershell"),
        ] {
            let mut bash = std::process::Command::new("bash");
            bash.args(["--norc", "-c", call]).arg(&path).args(words.split(' '));
            // There is none on some machines.
            let Ok(said) = bash.output() else { return };
            let reply = String::from_utf8_lossy(&said.stdout);
            assert_eq!(reply.trim(), expected, "{words}: {}", String::from_utf8_lossy(&said.stderr));
        }
    }
}
