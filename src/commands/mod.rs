//! One file per subcommand: its arguments and what it does with the rooms below.

pub mod annotate;
pub mod build;
pub mod catalogue;
pub mod completions;
pub mod contours;
pub mod demo;
pub mod derive_options;
pub mod description;
pub mod difference;
pub mod export;
pub mod extract;
mod field_probe;
pub mod frame_option;
mod grid_info;
mod heights;
pub mod hierarchy_options;
pub mod info;
pub mod job_options;
pub mod key;
pub mod light_options;
pub mod manual;
pub mod members_options;
pub mod modes;
mod overwriting;
pub mod page_file_info;
pub mod paths;
pub mod plot;
pub mod probe;
pub mod projection_options;
pub mod raw_options;
pub mod reconstruct;
pub mod region_options;
pub mod render;
pub mod render_arguments;
pub mod request;
mod run_info;
pub mod select;
#[cfg(feature = "remote")]
pub mod serve;
mod slurm;
pub mod statistics;
#[cfg(feature = "viewer")]
mod supervise;
pub mod surface;
pub mod synth;
pub mod tour;
pub mod trace_options;
pub mod verify;
pub mod view;
pub mod wavelet_options;

pub use crate::command_line::{CommandResult, arguments, cache, cached_run, print_line, progress_bar, text_of, usage};

/// The subcommands.
#[derive(clap::Subcommand, Debug)]
#[allow(missing_docs, reason = "the help text of a command is the documentation of its arguments")]
pub enum Command {
    View(Box<view::Arguments>),
    Render(Box<render::Arguments>),
    Build(Box<build::Arguments>),
    Stage(job_options::StageArguments),
    Info(info::Arguments),
    Reconstruct(Box<reconstruct::Arguments>),
    Extract(extract::Arguments),
    Verify(verify::Arguments),
    Probe(Box<probe::Arguments>),
    Plot(Box<plot::Arguments>),
    Select(Box<select::Arguments>),
    Paths(Box<paths::Arguments>),
    Contours(Box<contours::Arguments>),
    Difference(Box<difference::Arguments>),
    Export(Box<export::Arguments>),
    Surface(Box<surface::Arguments>),
    Catalogue(catalogue::Arguments),
    #[cfg(feature = "remote")]
    Serve(Box<serve::Arguments>),
    Tour(Box<tour::Arguments>),
    Key(key::Arguments),
    Synth(synth::Arguments),
    Bench(Box<crate::bench::Arguments>),
    Modes(modes::Arguments),
    Completions(completions::Arguments),
    Manual(manual::Arguments),
}

impl Command {
    /// Does what the command says.
    ///
    /// # Errors
    /// One line that names the file and the cause.
    pub fn run(&self) -> CommandResult {
        match self {
            Command::View(arguments) => view::run(arguments),
            Command::Render(arguments) => render::run(arguments),
            Command::Build(arguments) => build::run(arguments),
            Command::Stage(arguments) => job_options::run_stage(arguments),
            Command::Info(arguments) => info::run(arguments),
            Command::Reconstruct(arguments) => reconstruct::run(arguments),
            Command::Extract(arguments) => extract::run(arguments),
            Command::Verify(arguments) => verify::run(arguments),
            Command::Probe(arguments) => probe::run(arguments),
            Command::Plot(arguments) => plot::run(arguments),
            Command::Select(arguments) => select::run(arguments),
            Command::Paths(arguments) => paths::run(arguments),
            Command::Contours(arguments) => contours::run(arguments),
            Command::Difference(arguments) => difference::run(arguments),
            Command::Export(arguments) => export::run(arguments),
            Command::Surface(arguments) => surface::run(arguments),
            Command::Catalogue(arguments) => catalogue::run(arguments),
            #[cfg(feature = "remote")]
            Command::Serve(arguments) => serve::run(arguments),
            Command::Tour(arguments) => tour::run(arguments),
            Command::Key(arguments) => key::run(arguments),
            Command::Synth(arguments) => synth::run(arguments),
            Command::Bench(arguments) => crate::bench::run(arguments),
            Command::Modes(arguments) => modes::run(arguments),
            Command::Completions(arguments) => completions::run(arguments),
            Command::Manual(arguments) => manual::run(arguments),
        }
    }
}
