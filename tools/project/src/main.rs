//! The project's own commands, reached by the aliases in `.cargo/config.toml`:
//!
//! - `cargo demo [ARGUMENTS]` starts deepfield (with no arguments: the demo dataset), without a display as a program that
//!   has no windows and compiles no Bevy;
//! - `cargo test-all [--long] [ARGUMENTS]` runs what each change has to pass, those of the Python package too; with arguments, the tests that
//!   they choose. With `--long` the tests that take longest run as well (`.config/nextest.toml`), and property tests try new cases, and many.
//!
//! Both first see to what cargo cannot install: on a Debian-like Linux, the packages that a [`Requirement`] names. Nothing is
//! installed without saying so; on a terminal, not without asking.

use std::ffi::OsStr;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Something the machine must offer, and the Debian package that brings it.
struct Requirement {
    package: &'static str,
    why: &'static str,
    is_met: fn() -> bool,
}

/// What drawing needs: a Vulkan loader and at least one driver.
const DRAWING: [Requirement; 2] = [
    Requirement { package: "libvulkan1", why: "the Vulkan loader", is_met: || has_library("libvulkan.so.1") },
    Requirement {
        package: "mesa-vulkan-drivers",
        why: "a Vulkan driver; its software device works without a GPU",
        is_met: has_vulkan_driver,
    },
];

/// What a window on X11 loads at run time.
const WINDOW: [Requirement; 5] = [
    Requirement { package: "libx11-xcb1", why: "windows on X11", is_met: || has_library("libX11-xcb.so.1") },
    Requirement { package: "libxcursor1", why: "windows on X11", is_met: || has_library("libXcursor.so.1") },
    Requirement { package: "libxi6", why: "windows on X11", is_met: || has_library("libXi.so.6") },
    Requirement { package: "libxrandr2", why: "windows on X11", is_met: || has_library("libXrandr.so.2") },
    Requirement {
        package: "libxkbcommon-x11-0",
        why: "the keyboard on X11",
        is_met: || has_library("libxkbcommon-x11.so.0"),
    },
];

/// What the window tests start.
const VIRTUAL_DISPLAY: [Requirement; 1] =
    [Requirement { package: "xvfb", why: "a virtual display for the window tests", is_met: || has_program("Xvfb") }];

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let task = arguments.next();
    let rest: Vec<String> = arguments.collect();
    let outcome = match task.as_deref() {
        Some("demo") => demo(&rest),
        Some("test") => test(&rest),
        _ => Err("usage: cargo demo [ARGUMENTS] | cargo test-all [--long] [ARGUMENTS]".into()),
    };
    match outcome {
        Ok(code) => ExitCode::from(code),
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn demo(arguments: &[String]) -> Result<u8, String> {
    let mut command = cargo();
    command.args(["run", "--locked"]);
    if has_display() {
        let windows = if is_named("DISPLAY") { &WINDOW[..] } else { &[] };
        see_to(&DRAWING.iter().chain(windows).collect::<Vec<_>>())?;
    } else {
        eprintln!(
            "No display: deepfield is built without windows and graphics adapters, in a fraction of the time; `cargo run` builds it with them."
        );
        command.arg("--no-default-features");
    }
    run(command.arg("--").args(arguments))
}

/// Whether the program will find a display: on Linux an X server or a Wayland compositor is named.
fn has_display() -> bool {
    !cfg!(target_os = "linux") || is_named("DISPLAY") || is_named("WAYLAND_DISPLAY")
}

/// Whether an environment variable has a value.
fn is_named(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}

fn test(arguments: &[String]) -> Result<u8, String> {
    let (arguments, cases) = property_tests(arguments);
    let is_long = !cases.is_empty();
    see_to(&DRAWING.iter().chain(&WINDOW).chain(&VIRTUAL_DISPLAY).collect::<Vec<_>>())?;
    // Tests over the reference data are marked as ignored; they run where the data is.
    let data = std::env::var_os("DEEPFIELD_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let has_data = data.is_dir();
    if !has_data {
        println!("No reference data at {} (DEEPFIELD_DATA): its tests are listed as skipped.", data.display());
    }
    let has_nextest = cargo().args(["nextest", "--version"]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    let mut command = cargo();
    command.env("DEEPFIELD_DATA", &data).envs(cases);
    if has_nextest.is_ok_and(|status| status.success()) {
        command.args(["nextest", "run", "--locked", "--workspace", "--no-fail-fast"]).args(&arguments);
        if arguments.is_empty() && !is_long {
            println!("The tests that take longest run with --long only.");
            command.args(["--profile", "each-change"]);
        }
        if has_data {
            command.args(["--run-ignored", "all"]);
        }
        let tested = run(&mut command)?;
        if !arguments.is_empty() {
            return Ok(tested);
        }
        // Nextest leaves the documentation's examples out.
        let documented = run(cargo().args(["test", "--locked", "--workspace", "--doc"]))?;
        return Ok(tested.max(documented).max(test_python()?));
    }
    command.args(["test", "--locked", "--workspace", "--no-fail-fast"]).args(&arguments);
    if has_data {
        command.args(["--", "--include-ignored"]);
    }
    let tested = run(&mut command)?;
    Ok(if arguments.is_empty() { tested.max(test_python()?) } else { tested })
}

/// Builds and tries the Python package. What the machine lacks for that is told, and is a failure only where DEEPFIELD_PYTHON_TESTS
/// is `require`.
fn test_python() -> Result<u8, String> {
    let named = std::env::var_os("PYO3_PYTHON").unwrap_or_else(|| "python3".into());
    // The interpreter itself: a version manager's stand-in changes PATH, for which the native part would be compiled again.
    let asked = Command::new(&named).args(["-c", "import sys; print(sys.executable)"]).output();
    let Some(asked) = asked.ok().filter(|asked| asked.status.success()) else {
        println!("The Python package was not tested: no {}.", Path::new(&named).display());
        return Ok(u8::from(std::env::var_os("DEEPFIELD_PYTHON_TESTS").is_some_and(|value| value == "require")));
    };
    let interpreter = String::from_utf8_lossy(&asked.stdout);
    run(in_root(interpreter.trim()).arg(root().join("python/tests/run.py")))
}

/// The arguments without `--long`, and the environment that property tests get: where `--long` is given a new seed and ten times
/// the cases, unless the environment says how many, else what `.cargo/config.toml` says. Tells how the run is repeated.
fn property_tests(arguments: &[String]) -> (Vec<String>, Vec<(&'static str, String)>) {
    let rest: Vec<String> = arguments.iter().filter(|argument| *argument != "--long").cloned().collect();
    if rest.len() == arguments.len() {
        return (rest, Vec::new());
    }
    let cases = std::env::var("PROPTEST_CASES").unwrap_or_else(|_| "2560".to_owned());
    let chosen =
        [("PROPTEST_RNG_SEED", RandomState::new().build_hasher().finish().to_string()), ("PROPTEST_CASES", cases)];
    let text = chosen.each_ref().map(|(name, value)| format!("{name}={value}")).join(" ");
    println!("Property tests try new cases; the same ones again: {text} cargo test-all {}", rest.join(" "));
    (rest, chosen.into())
}

/// The repository's root: this package lies two folders below it.
fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).unwrap_or(here)
}

/// Cargo in the repository's root.
fn cargo() -> Command {
    in_root(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// A program in the repository's root, with cargo's output in the user's cache unless the user chose a place.
fn in_root(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root());
    // What cargo says of this package to it. Build scripts that ask for these names, and all that stands on them, would run once for each
    // of both ways that cargo is reached.
    for (name, _) in std::env::vars_os() {
        if ["CARGO_MANIFEST_", "CARGO_PKG_"].iter().any(|group| name.to_string_lossy().starts_with(group)) {
            command.env_remove(name);
        }
    }
    if std::env::var_os("CARGO_TARGET_DIR").is_none()
        && let Some(cache) = user_cache()
    {
        command.env("CARGO_TARGET_DIR", cache.join("deepfield").join("target"));
    }
    command
}

/// The user's cache folder by the platform's convention.
fn user_cache() -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if cfg!(windows) {
        variable("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        variable("HOME").map(|home| home.join("Library/Caches"))
    } else {
        variable("XDG_CACHE_HOME").or_else(|| variable("HOME").map(|home| home.join(".cache")))
    }
}

fn run(command: &mut Command) -> Result<u8, String> {
    let status = command.status().map_err(|error| format!("cannot start {:?}: {error}", command.get_program()))?;
    Ok(status.code().map_or(1, |code| u8::try_from(code).unwrap_or(1)))
}

/// Installs the packages of all requirements that are not met, after saying or asking. Other systems than Linux
/// bring what deepfield needs.
fn see_to(requirements: &[&Requirement]) -> Result<(), String> {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let missing: Vec<&Requirement> =
        requirements.iter().copied().filter(|requirement| !(requirement.is_met)()).collect();
    if missing.is_empty() {
        return Ok(());
    }
    println!("deepfield needs these Debian packages, which this machine lacks:");
    for requirement in &missing {
        println!("  {:22} {}", requirement.package, requirement.why);
    }
    let packages: Vec<&str> = missing.iter().map(|requirement| requirement.package).collect();
    let by_hand = format!("apt-get install {}", packages.join(" "));
    if !has_program("apt-get") {
        return Err(format!("Please install their equivalents (on Debian: {by_hand}) and try again."));
    }
    if std::io::stdin().is_terminal() {
        print!("Install them now with apt-get? [Y/n] ");
        std::io::stdout().flush().map_err(|error| error.to_string())?;
        let mut answer = String::new();
        std::io::stdin().read_line(&mut answer).map_err(|error| error.to_string())?;
        if !matches!(answer.trim(), "" | "y" | "Y" | "yes") {
            return Err(format!("Nothing was installed. By hand: {by_hand}"));
        }
    } else {
        eprintln!("Installing them with apt-get.");
    }
    let install = "apt-get update -qq && apt-get install -y -qq --no-install-recommends ";
    let mut command = if is_root() { Command::new("sh") } else { Command::new("sudo") };
    if !is_root() {
        command.arg("sh");
    }
    command.arg("-c").arg(format!("{install}{}", packages.join(" "))).env("DEBIAN_FRONTEND", "noninteractive");
    match run(&mut command)? {
        0 => Ok(()),
        code => Err(format!("apt-get ended with code {code}. By hand: {by_hand}")),
    }
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

fn has_program(name: &str) -> bool {
    std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(name).is_file()))
}

/// Whether the dynamic loader's usual folders hold a library.
fn has_library(name: &str) -> bool {
    let architecture = format!("{}-linux-gnu", std::env::consts::ARCH);
    let own = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    std::env::split_paths(&own)
        .chain(["/lib", "/usr/lib", "/usr/local/lib", "/usr/lib64"].map(PathBuf::from))
        .flat_map(|folder| [folder.join(name), folder.join(&architecture).join(name)])
        .any(|path| path.exists())
}

/// Whether a Vulkan driver is registered with the loader.
fn has_vulkan_driver() -> bool {
    if ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some()) {
        return true;
    }
    let home = std::env::var_os("HOME").map(PathBuf::from).unwrap_or_default();
    ["/usr/share", "/usr/local/share", "/etc", "/usr/local/etc"]
        .map(PathBuf::from)
        .into_iter()
        .chain([home.join(".local/share"), home.join(".config")])
        .filter_map(|folder| std::fs::read_dir(folder.join("vulkan/icd.d")).ok())
        .flatten()
        .flatten()
        .any(|entry| entry.path().extension().is_some_and(|extension| extension == "json"))
}
