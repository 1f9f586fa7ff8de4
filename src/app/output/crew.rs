//! The outputs of the presenter's machine: each is a window of a process of its own that follows this one, so that one that fails,
//! with its driver or its adapter, takes nothing with it. It is started again.

use crate::app::messages::Messages;
use crate::app::network::Leading;
use crate::app::options::OutputsRequest;
use crate::network::{KeyError, ShowKey};
use bevy::prelude::*;
use bevy::render::error_handler::{RenderError, RenderErrorPolicy};
use std::ffi::OsString;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A process that ran for so long did not fail at its start.
const STEADY: Duration = Duration::from_secs(20);
/// The longest time before one that failed is started again.
const LONGEST: Duration = Duration::from_secs(15);

/// The windows of a presenter's machine.
#[derive(Resource)]
pub struct Crew {
    program: PathBuf,
    /// What each is started with, beside its name and where it finds the leader.
    arguments: Vec<OsString>,
    outputs: PathBuf,
    posts: Vec<Post>,
    /// A folder with the show's key, which only this user reads.
    key: tempfile::TempDir,
}

/// One of them.
struct Post {
    name: String,
    child: Option<Child>,
    started: Option<Instant>,
    /// How often it failed at its start, one time after the other.
    failures: u32,
}

/// Outputs that cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum CrewError {
    /// There is no place for the show's key.
    #[error("a folder for the show's key: {0}")]
    Folder(std::io::Error),
    /// The show's key cannot be written.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The program does not find itself.
    #[error("the program's own file: {0}")]
    Program(std::io::Error),
}

impl Crew {
    /// A crew that is not on its posts yet.
    ///
    /// # Errors
    /// [`CrewError`].
    pub fn new(request: OutputsRequest, key: &ShowKey) -> Result<Crew, CrewError> {
        let OutputsRequest { file, names, arguments } = request;
        let folder = tempfile::Builder::new().prefix("deepfield-show").tempdir().map_err(CrewError::Folder)?;
        key.write(&folder.path().join("key"))?;
        let program = std::env::current_exe().map_err(CrewError::Program)?;
        let posts = names.into_iter().map(|name| Post { name, child: None, started: None, failures: 0 }).collect();
        Ok(Crew { program, arguments, outputs: file, posts, key: folder })
    }

    /// The processes that run now, with their names.
    pub fn running(&self) -> impl Iterator<Item = (&str, u32)> {
        self.posts.iter().filter_map(|post| Some((post.name.as_str(), post.child.as_ref()?.id())))
    }

    fn start(&self, name: &str, address: &str) -> std::io::Result<Child> {
        let mut output = self.outputs.clone().into_os_string();
        output.push("#");
        output.push(name);
        Command::new(&self.program)
            .args(["view", "--follow", address, "--name", name, "--show-key"])
            .arg(self.key.path().join("key"))
            .arg("--output")
            .arg(output)
            .args(&self.arguments)
            .stdin(Stdio::null())
            .spawn()
    }
}

impl Crew {
    /// Leaves the windows on their screens when this process ends.
    fn leave(&mut self) {
        self.posts.clear();
    }
}

impl Drop for Crew {
    /// Ends the windows, unless this process ends by a mistake of its own: the audience keeps its picture.
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        for child in self.posts.iter_mut().filter_map(|post| post.child.as_mut()) {
            // One that has ended by itself cannot be ended again.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
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

/// Starts what does not run, and says what has ended.
pub(crate) fn watch(mut crew: ResMut<Crew>, leading: Option<Res<Leading>>, mut messages: ResMut<Messages>) {
    let Some(address) = leading.and_then(|leading| leading.leader().address()) else { return };
    let crew = crew.bypass_change_detection();
    let address = reachable(address).to_string();
    for i in 0..crew.posts.len() {
        let post = &mut crew.posts[i];
        let ended = match post.child.as_mut().map(Child::try_wait) {
            Some(Ok(Some(status))) => Some(format!("{status}")),
            Some(Err(error)) => Some(error.to_string()),
            Some(Ok(None)) => continue,
            None => None,
        };
        if let Some(how) = ended {
            post.child = None;
            let was_steady = post.started.is_some_and(|started| started.elapsed() >= STEADY);
            post.failures = if was_steady { 1 } else { post.failures.saturating_add(1) };
            messages.error(format!("{}: its window has ended ({how}) and is opened again", post.name));
        }
        let pause = match post.failures {
            0 => Duration::ZERO,
            failures => Duration::from_millis(250u64 << failures.min(8)).min(LONGEST),
        };
        if post.started.is_some_and(|started| started.elapsed() < pause) {
            continue;
        }
        let name = post.name.clone();
        let started = crew.start(&name, &address);
        let post = &mut crew.posts[i];
        post.started = Some(Instant::now());
        match started {
            Ok(child) => post.child = Some(child),
            Err(error) => {
                post.failures = post.failures.saturating_add(1);
                messages.error(format!("{name}: its window cannot be opened: {error}"));
            }
        }
    }
}

/// Ends the windows with the presenter's; where that ends by an error, they stay.
pub(crate) fn end(mut exits: MessageReader<AppExit>, mut crew: ResMut<Crew>) {
    match exits.read().next() {
        Some(AppExit::Success) => {
            crew.posts.iter_mut().filter_map(|post| post.child.as_mut()).for_each(|child| drop(child.kill()));
        }
        Some(AppExit::Error(_)) => crew.leave(),
        None => {}
    }
}

/// The presenter's window has lost its adapter, or used it wrongly: it ends, the audience's windows stay.
pub(super) fn outlive(error: &RenderError, world: &mut World, _: &mut World) -> RenderErrorPolicy {
    error!("the presenter's window ends ({:?}); those of the outputs stay, Esc closes each", error.ty);
    if let Some(mut crew) = world.get_resource_mut::<Crew>() {
        crew.leave();
    }
    world.write_message(AppExit::error());
    RenderErrorPolicy::StopRendering
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use bevy::render::error_handler::ErrorType;

    fn crew(child: Child) -> Crew {
        let request = OutputsRequest { file: "rig.ron".into(), names: vec!["a".into()], arguments: Vec::new() };
        let mut crew = Crew::new(request, &ShowKey::random()).unwrap();
        crew.posts[0].child = Some(child);
        crew
    }

    fn sleeper() -> Child {
        Command::new("sleep").arg("60").spawn().unwrap()
    }

    fn is_running(process: u32) -> bool {
        Command::new("kill").args(["-0", &process.to_string()]).stderr(Stdio::null()).status().unwrap().success()
    }

    #[test]
    fn windows_end_with_the_presenters_but_not_with_its_failure() {
        let child = sleeper();
        let process = child.id();
        drop(crew(child));
        assert!(!is_running(process));

        let child = sleeper();
        let process = child.id();
        let mut world = World::new();
        world.init_resource::<bevy::ecs::message::Messages<AppExit>>();
        world.insert_resource(crew(child));
        let error = RenderError { ty: ErrorType::DeviceLost, description: String::new(), source: None };
        let policy = outlive(&error, &mut world, &mut World::new());
        assert!(matches!(policy, RenderErrorPolicy::StopRendering));
        drop(world);
        assert!(is_running(process));
        assert!(Command::new("kill").arg(process.to_string()).status().unwrap().success());
    }

    #[test]
    fn this_machine_is_reached_at_its_own_address() {
        for (listens, reached) in [("0.0.0.0:5", "127.0.0.1:5"), ("[::]:5", "[::1]:5"), ("10.1.2.3:5", "10.1.2.3:5")] {
            assert_eq!(reachable(listens.parse().unwrap()).to_string(), reached);
        }
    }
}
