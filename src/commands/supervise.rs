//! A show's windows, kept open by a process that has none: what each of them is started with.

use super::CommandResult;
use super::view::WindowArguments;
use crate::look::is_scene_file;
use crate::show::protocol::ShowKey;
use crate::show::rig::OutputsFile;
use crate::show::supervisor::{RunFolder, ShowPlan};
use crate::show::window::output::OutputWindow;
use std::ffi::OsString;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::path::Path;

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Whether somebody relies on the window that the settings ask for, so that it is kept open: one that leads, follows, or plays a tour.
pub(super) fn is_show(settings: &WindowArguments) -> bool {
    settings.lead.is_some() || settings.follow.is_some() || settings.outputs.is_some() || settings.tour.is_some()
}

/// Keeps the window that the command line asks for open, and those of its outputs, until it is closed.
///
/// # Errors
/// When the key or the outputs cannot be used, or the windows not be started. Where the window itself cannot be opened it has
/// said why, and its exit code becomes that of this process.
pub(super) fn supervise(path: &Path, settings: &WindowArguments) -> CommandResult {
    let folder = tempfile::Builder::new().prefix("deepfield-show").tempdir();
    let folder = folder.map_err(|error| format!("a folder for the show's windows: {error}"))?;
    let run = RunFolder::at(folder.path());
    let program = std::env::current_exe().map_err(|error| format!("the program's own file: {error}"))?;
    let mut plan =
        ShowPlan { program, window: std::env::args_os().skip(1).collect(), outputs: Vec::new(), folder: run };
    match &settings.show_key {
        Some(key) => ShowKey::read(key)?.write(&plan.folder.key())?,
        // Windows of this machine alone need no key that others have.
        None if settings.outputs.is_some() => ShowKey::random().write(&plan.folder.key())?,
        None => {}
    }
    if settings.lead.is_some() || settings.outputs.is_some() {
        let address = free_port(settings.lead.unwrap_or(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))))?;
        plan.folder.set_address(address).map_err(|error| format!("{}: {error}", folder.path().display()))?;
        if let Some(file) = &settings.outputs {
            plan.outputs = outputs(file, path, settings, &plan.folder, reachable(address))?;
        }
    }
    let code = plan.carry_out().map_err(|error| format!("{}: {error}", plan.program.display()))?;
    drop(folder);
    match code {
        0 => Ok(()),
        // What is wrong has been said by the window.
        code => std::process::exit(code),
    }
}

/// An address with a port that stays the same when the window is opened again.
fn free_port(address: SocketAddr) -> Result<SocketAddr, Error> {
    if address.port() != 0 {
        return Ok(address);
    }
    let bound = UdpSocket::bind(address).and_then(|socket| socket.local_addr());
    Ok(bound.map_err(|error| format!("{address}: the show cannot be led from there: {error}"))?)
}

/// Where a process of this machine reaches one that listens at an address.
fn reachable(mut address: SocketAddr) -> SocketAddr {
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
        _ => {}
    }
    address
}

/// The windows of a file's outputs, which follow the one that leads at an address.
fn outputs(
    file: &Path,
    path: &Path,
    settings: &WindowArguments,
    folder: &RunFolder,
    leader: SocketAddr,
) -> Result<Vec<(String, Vec<OsString>)>, Error> {
    let read = OutputsFile::read(file)?;
    let mut shared: Vec<OsString> = vec!["--preset".into(), settings.preset.clone().into()];
    if !path.as_os_str().is_empty() && !is_scene_file(path) {
        shared.push(path.as_os_str().to_owned());
    }
    if let Some(frame_ms) = settings.frame_ms {
        shared.extend(["--frame-ms".into(), frame_ms.to_string().into()]);
    }
    if let Some(backend) = settings.backend {
        use clap::ValueEnum;
        let name = backend.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
        shared.extend(["--backend".into(), name.into()]);
    }
    let mut all = Vec::new();
    for output in read.outputs {
        // What is wrong with its files is better said before there is any window.
        OutputWindow::open(file, &output.name)?;
        let mut named = file.as_os_str().to_owned();
        named.push("#");
        named.push(&output.name);
        let mut arguments: Vec<OsString> = ["view", "--follow"].map(OsString::from).to_vec();
        arguments.extend([leader.to_string().into(), "--name".into(), output.name.clone().into()]);
        arguments.extend(["--show-key".into(), folder.key().into_os_string(), "--output".into(), named]);
        arguments.extend(shared.iter().cloned());
        all.push((output.name, arguments));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_reached_at_its_own_address() {
        for (listens, reached) in [("0.0.0.0:5", "127.0.0.1:5"), ("[::]:5", "[::1]:5"), ("10.1.2.3:5", "10.1.2.3:5")] {
            assert_eq!(reachable(listens.parse().unwrap()).to_string(), reached);
        }
    }

    #[test]
    fn a_port_is_found_where_none_is_named() {
        let found = free_port("127.0.0.1:0".parse().unwrap()).unwrap();
        assert!(found.port() != 0 && found.ip().is_loopback());
        assert_eq!(free_port("0.0.0.0:47800".parse().unwrap()).unwrap().port(), 47_800);
    }

    #[test]
    fn outputs_follow_with_what_the_window_was_started_with() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rig.ron");
        let rig =
            r#"(version: 1, outputs: [(name: "a b", window: (0, 0, 64, 64)), (name: "c", window: (64, 0, 64, 64))])"#;
        std::fs::write(&file, rig).unwrap();
        let settings = WindowArguments { preset: "laptop".into(), frame_ms: Some(20.0), ..WindowArguments::default() };
        let run = RunFolder::at(folder.path());
        let all = outputs(&file, Path::new("box.df"), &settings, &run, "127.0.0.1:9".parse().unwrap()).unwrap();
        assert_eq!(all.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["a b", "c"]);
        let named = format!("{}#a b", file.display());
        let has = |pair: [&str; 2]| all[0].1.windows(2).any(|two| two[0] == *pair[0] && two[1] == *pair[1]);
        for pair in [
            ["--follow", "127.0.0.1:9"],
            ["--name", "a b"],
            ["--output", &named],
            ["--preset", "laptop"],
            ["--frame-ms", "20"],
        ] {
            assert!(has(pair), "{pair:?} in {:?}", all[0].1);
        }
        assert!(all[0].1.contains(&"box.df".into()));
        std::fs::write(&file, rig.replace("64, 64)", "64, 0)")).unwrap();
        let refused = outputs(&file, Path::new(""), &settings, &run, "127.0.0.1:9".parse().unwrap());
        assert!(refused.is_err());
    }
}
