//! Files without a name, which the system frees when whoever writes them ends, however it ends (`O_TMPFILE` of Linux).

use std::fs::File;
use std::io;
use std::path::Path;

/// Creates a file in a folder that has no name yet; `None` where the system or the file system has no such files.
///
/// The process's mask decides who may read it once it has one.
#[cfg(target_os = "linux")]
pub fn create(folder: &Path) -> Option<File> {
    use rustix::fs::{Access, Mode, OFlags, access, open};
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(open(folder, flags, Mode::from_raw_mode(0o666)).ok()?);
    // Without its entry there it could not be given a name.
    access(entry(&file), Access::EXISTS).is_ok().then_some(file)
}

/// The same of a system that has none.
#[cfg(not(target_os = "linux"))]
pub fn create(_: &Path) -> Option<File> {
    None
}

/// Gives such a file a name.
///
/// # Errors
/// When the system refuses: with [`io::ErrorKind::AlreadyExists`] where another file has it.
#[cfg(target_os = "linux")]
pub fn link(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    Ok(linkat(CWD, entry(file), CWD, path, AtFlags::SYMLINK_FOLLOW)?)
}

/// The same of a system that has none.
///
/// # Errors
/// Always.
#[cfg(not(target_os = "linux"))]
pub fn link(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Where the system shows a file that is open here.
#[cfg(target_os = "linux")]
fn entry(file: &File) -> String {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd())
}
