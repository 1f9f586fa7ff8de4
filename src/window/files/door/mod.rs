//! How another process of the same user has a running window open a file. Each window has a door in one folder: on Unix a socket, elsewhere
//! a port of the machine itself with a token in a file. A door takes one whole path and says whether it has taken it; nothing else
//! can be asked there.

mod protocol;
mod transport;

use crate::model::is_url;
use crate::model::url::whole;
use etcetera::BaseStrategy;
use protocol::Token;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use transport::{Here, Transport};

/// How long one that asks, and one that is asked, waits for the other.
const PATIENCE: Duration = Duration::from_secs(2);
/// Doors that are tried.
const MOST_DOORS: usize = 64;

/// Where the user's windows have their doors: in the runtime folder, or where there is none in that of the cache.
pub fn folder_of_user() -> Option<PathBuf> {
    let base = etcetera::choose_base_strategy().ok()?;
    Some(match base.runtime_dir() {
        Some(folder) => folder.join("deepfield"),
        None => base.cache_dir().join("deepfield").join("windows"),
    })
}

/// A window's door, which closes when this is dropped.
pub(super) struct Door {
    place: PathBuf,
    asked: Mutex<Receiver<PathBuf>>,
}

impl Door {
    /// Opens one in a folder, which is made, and made the user's alone.
    ///
    /// # Errors
    /// When the folder is another user's, or cannot be written.
    pub fn open(folder: &Path) -> io::Result<Door> {
        Door::by::<Here>(folder, PATIENCE)
    }

    fn by<T: Transport>(folder: &Path, patience: Duration) -> io::Result<Door> {
        make_private(folder)?;
        let place = folder.join(format!("window-{}.{}", std::process::id(), T::EXTENSION));
        // What a killed process of the same number has left behind.
        drop(std::fs::remove_file(&place));
        let (listener, token) = T::listen(&place)?;
        let (send, asked) = channel();
        let serve = move || serve::<T>(&listener, &token, patience, &send);
        std::thread::Builder::new().name("deepfield door".into()).spawn(serve)?;
        Ok(Door { place, asked: Mutex::new(asked) })
    }

    /// A file that is to be opened.
    pub fn asked(&mut self) -> Option<PathBuf> {
        self.asked.get_mut().unwrap_or_else(PoisonError::into_inner).try_recv().ok()
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        drop(std::fs::remove_file(&self.place));
    }
}

/// Answers one after the other, until the window is gone.
fn serve<T: Transport>(listener: &T::Listener, token: &Token, patience: Duration, send: &Sender<PathBuf>) {
    loop {
        let Ok(mut stream) = T::accept(listener) else {
            // Too many files are open, or the like.
            std::thread::sleep(Duration::from_millis(100));
            continue;
        };
        // What is refused is told to whoever asks, and to nobody else.
        if let Ok(path) = protocol::answer(&mut stream, token, patience)
            && send.send(path).is_err()
        {
            return;
        }
    }
}

/// Has the window that was opened last, of those that have a door in a folder, open a file; whether one has taken it.
///
/// # Errors
/// When the path cannot be made a whole one, or the folder not be read.
pub fn hand_over(folder: &Path, path: &Path) -> io::Result<bool> {
    hand_over_by::<Here>(folder, path, PATIENCE)
}

fn hand_over_by<T: Transport>(folder: &Path, path: &Path, patience: Duration) -> io::Result<bool> {
    // What is not shown of a URL goes no further than the door, which is the user's alone.
    let path = if is_url(path) { PathBuf::from(whole(path)) } else { std::path::absolute(path)? };
    let told = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        entries => entries.map_err(told)?,
    };
    let is_door = |name: &Path| name.extension().is_some_and(|extension| extension == T::EXTENSION);
    let doors = entries.filter_map(Result::ok).filter(|entry| is_door(&entry.path()));
    let opened = |entry: &std::fs::DirEntry| entry.metadata().and_then(|about| about.modified());
    let mut doors: Vec<(SystemTime, PathBuf)> =
        doors.map(|entry| (opened(&entry).unwrap_or(SystemTime::UNIX_EPOCH), entry.path())).collect();
    doors.sort_unstable();
    for (_, place) in doors.into_iter().rev().take(MOST_DOORS) {
        match T::connect(&place, patience) {
            Ok((mut stream, token)) => {
                if let Ok(true) = protocol::ask(&mut stream, &token, &path, patience) {
                    return Ok(true);
                }
            }
            // Its window was killed.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => drop(std::fs::remove_file(&place)),
            Err(_) => {}
        }
    }
    Ok(false)
}

/// Makes a folder that only the user can look into.
fn make_private(folder: &Path) -> io::Result<()> {
    let told = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder).map_err(told)?;
    // One that was there already may be open to others, or theirs, which this refuses to change. Elsewhere the user's folders are his alone.
    #[cfg(unix)]
    std::fs::set_permissions(folder, std::os::unix::fs::PermissionsExt::from_mode(0o700)).map_err(told)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    /// The file that a door is asked for within a moment.
    fn next(door: &mut Door) -> Option<PathBuf> {
        let start = Instant::now();
        loop {
            let asked = door.asked();
            if asked.is_some() || start.elapsed() > Duration::from_secs(10) {
                return asked;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// A file is handed over; what talks nonsense or says nothing is refused, and holds up the next one for no longer than is waited.
    fn files_come_through_and_nothing_else<T: Transport>() {
        let (patience, long) = (Duration::from_secs(1), Duration::from_secs(20));
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("doors");
        let file = folder.join("a file Ω.df");
        assert!(!hand_over_by::<T>(&folder, &file, long).unwrap(), "there is no window");
        let mut door = Door::by::<T>(&folder, patience).unwrap();
        assert!(hand_over_by::<T>(&folder, &file, long).unwrap());
        assert_eq!(next(&mut door), Some(file.clone()));
        let (mut hostile, _) = T::connect(&door.place, patience).unwrap();
        io::Write::write_all(&mut hostile, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\nand so on").unwrap();
        let (_silent, _) = T::connect(&door.place, patience).unwrap();
        assert!(hand_over_by::<T>(&folder, Path::new("relative.df"), long).unwrap());
        assert_eq!(next(&mut door), Some(std::path::absolute("relative.df").unwrap()));
        assert!(hand_over_by::<T>(&folder, Path::new("https://data.example/door.df?sig=1"), long).unwrap());
        assert_eq!(next(&mut door), Some("https://data.example/door.df".into()));
        assert_eq!(door.asked(), None);
        drop(door);
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "a door that is closed is gone");
    }

    #[test]
    fn files_come_through_a_socket() {
        files_come_through_and_nothing_else::<Here>();
    }

    #[test]
    fn files_come_through_a_port() {
        files_come_through_and_nothing_else::<transport::Port>();
    }

    #[cfg(unix)]
    #[test]
    fn a_door_is_the_users_alone_and_one_that_nobody_answers_is_taken_away() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o755)).unwrap();
        let mut door = Door::open(folder.path()).unwrap();
        assert_eq!(std::fs::metadata(folder.path()).unwrap().permissions().mode() & 0o777, 0o700);
        // A socket whose process has ended stays, and is the latest here.
        let stale = folder.path().join("window-999999999.sock");
        drop(std::os::unix::net::UnixListener::bind(&stale).unwrap());
        assert!(hand_over(folder.path(), Path::new("/data/a.df")).unwrap());
        assert_eq!(next(&mut door), Some(PathBuf::from("/data/a.df")));
        assert!(door.place.exists() && !stale.exists());
    }
}
