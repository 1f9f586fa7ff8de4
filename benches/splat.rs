//! Drawing speed of the CPU renderer: `cargo bench --no-default-features --bench splat`. The same as
//! `deepfield bench splat`, with the same options.

use clap::Parser;
use deepfield::bench::{Arguments, splat};

#[derive(Parser)]
struct CommandLine {
    #[command(flatten)]
    arguments: Arguments,
}

fn main() {
    // Cargo adds `--bench` to the command line.
    let words = std::env::args().take(1).chain(["splat".to_owned()]);
    let words = words.chain(std::env::args().skip(1).filter(|word| word != "--bench"));
    if let Err(error) = splat::measure(&CommandLine::parse_from(words).arguments) {
        eprintln!("{error}");
        std::process::exit(1);
    }
}
