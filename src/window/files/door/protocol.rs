//! What is said at a door: who asks sends a mark, the door's token, the length of a path and the path; who is asked answers with one byte.

use crate::model::is_url;
use crate::model::url::shown;
use std::io::{self, Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How everything begins that is asked.
const MARK: [u8; 8] = *b"DFopen1\n";
/// Bytes of the longest path.
const LONGEST: usize = 32 << 10;
/// The path will be opened.
const TAKEN: u8 = 1;
/// It will not.
const REFUSED: u8 = 0;

/// What only processes of the user know.
pub type Token = [u8; 32];

/// A connection whose reads and writes can be given a time.
pub trait Wire: Read + Write {
    /// Each of the next reads and writes fails after that time.
    fn limit(&self, time: Duration) -> io::Result<()>;
}

/// A connection on which everything together may take so long.
struct Timed<'a, W> {
    wire: &'a mut W,
    until: Instant,
}

impl<'a, W: Wire> Timed<'a, W> {
    fn new(wire: &'a mut W, patience: Duration) -> Timed<'a, W> {
        Timed { wire, until: Instant::now() + patience }
    }

    /// The connection, for as long as is left.
    fn wire(&mut self) -> io::Result<&mut W> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.wire.limit(left)?;
        Ok(self.wire)
    }
}

impl<W: Wire> Read for Timed<'_, W> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.wire()?.read(bytes)
    }
}

impl<W: Wire> Write for Timed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.wire()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.wire()?.flush()
    }
}

/// Asks for a file to be opened, by its whole path; whether it will be.
///
/// # Errors
/// When the path is too long or not Unicode where it has to be, and when the other side does not answer in time.
pub fn ask<W: Wire>(wire: &mut W, token: &Token, path: &Path, patience: Duration) -> io::Result<bool> {
    let path = bytes_of(path)?;
    let length = u32::try_from(path.len()).ok().filter(|_| path.len() <= LONGEST);
    let length = length.ok_or_else(|| refused("length", path.len(), &format!("at most {LONGEST} bytes")))?;
    let mut wire = Timed::new(wire, patience);
    wire.write_all(&[MARK.as_slice(), token.as_slice(), length.to_le_bytes().as_slice(), path].concat())?;
    let mut answer = [REFUSED];
    wire.read_exact(&mut answer)?;
    Ok(answer[0] == TAKEN)
}

/// The file that somebody asks to be opened, who is told whether it will be.
///
/// # Errors
/// When he says anything else, or not all in time.
pub fn answer<W: Wire>(wire: &mut W, token: &Token, patience: Duration) -> io::Result<PathBuf> {
    let mut wire = Timed::new(wire, patience);
    let asked = receive(&mut wire, token);
    wire.write_all(&[if asked.is_ok() { TAKEN } else { REFUSED }])?;
    asked
}

fn receive(wire: &mut impl Read, token: &Token) -> io::Result<PathBuf> {
    let (mut mark, mut own, mut length) = ([0; MARK.len()], [0; size_of::<Token>()], [0; 4]);
    wire.read_exact(&mut mark)?;
    if mark != MARK {
        return Err(refused("mark", mark.escape_ascii(), &MARK.escape_ascii().to_string()));
    }
    wire.read_exact(&mut own)?;
    // As long for one that begins right as for any other.
    if own.iter().zip(token).fold(0, |differing, (a, b)| differing | (a ^ b)) != 0 {
        return Err(refused("token", "another one", "this window's"));
    }
    wire.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > LONGEST {
        return Err(refused("length", length, &format!("at most {LONGEST} bytes")));
    }
    let mut path = vec![0; length];
    wire.read_exact(&mut path)?;
    let path = path_of(path)?;
    match path.is_absolute() || is_url(&path) {
        true => Ok(shown(&path)),
        false => Err(refused("path", path.display(), "a whole path")),
    }
}

fn refused(field: &str, found: impl std::fmt::Display, expected: &str) -> Error {
    Error::new(ErrorKind::InvalidData, format!("request to open a file: {field}: found {found}, expected {expected}"))
}

#[cfg(unix)]
fn bytes_of(path: &Path) -> io::Result<&[u8]> {
    Ok(std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str()))
}

#[cfg(not(unix))]
fn bytes_of(path: &Path) -> io::Result<&[u8]> {
    let text = path.to_str().ok_or_else(|| refused("path", path.display(), "Unicode"))?;
    Ok(text.as_bytes())
}

/// A path from its bytes, which may hold anything but a zero.
fn path_of(bytes: Vec<u8>) -> io::Result<PathBuf> {
    if bytes.contains(&0) {
        return Err(refused("path", "a zero byte", "none"));
    }
    #[cfg(unix)]
    let path = <std::ffi::OsString as std::os::unix::ffi::OsStringExt>::from_vec(bytes).into();
    #[cfg(not(unix))]
    let path = String::from_utf8(bytes).map_err(|error| refused("path", error, "Unicode"))?.into();
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;

    /// What was said to one side, and what it says.
    #[derive(Default)]
    struct Heard(Cursor<Vec<u8>>, Vec<u8>);

    impl Read for Heard {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            // In pieces, as they may come.
            let few = bytes.len().min(7);
            self.0.read(&mut bytes[..few])
        }
    }

    impl Write for Heard {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.1.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Wire for Heard {
        fn limit(&self, _: Duration) -> io::Result<()> {
            Ok(())
        }
    }

    const PATIENCE: Duration = Duration::from_secs(60);

    /// What is sent to ask for a path.
    fn request(token: &Token, path: &Path) -> Vec<u8> {
        let mut wire = Heard(Cursor::new(vec![TAKEN]), Vec::new());
        assert!(ask(&mut wire, token, path, PATIENCE).unwrap());
        wire.1
    }

    /// What comes of bytes, and the answer.
    fn heard(bytes: Vec<u8>, token: &Token) -> (io::Result<PathBuf>, Vec<u8>) {
        let mut wire = Heard(Cursor::new(bytes), Vec::new());
        (answer(&mut wire, token, PATIENCE), wire.1)
    }

    proptest! {
        /// Every whole path arrives, and one changed bit before it, a shorter message and any other bytes are refused.
        #[test]
        fn whole_paths_arrive_and_nothing_else(
            name in "[^/\\\\\u{0}:*?\"<>|]{1,40}",
            token in any::<Token>(),
            bit in 0..8 * (MARK.len() + size_of::<Token>()),
            cut in any::<prop::sample::Index>(),
            noise in prop::collection::vec(any::<u8>(), 0..200),
        ) {
            let path = std::env::temp_dir().join(name);
            let bytes = request(&token, &path);
            let (asked, said) = heard(bytes.clone(), &token);
            prop_assert_eq!((asked.unwrap(), said), (path, vec![TAKEN]));
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            for bytes in [changed, bytes[..cut.index(bytes.len())].to_vec(), noise] {
                let (asked, said) = heard(bytes, &token);
                prop_assert!(asked.is_err() && said == [REFUSED]);
            }
        }
    }

    #[test]
    fn what_makes_no_sense_is_told() {
        let token = [7; size_of::<Token>()];
        let head = [MARK.as_slice(), token.as_slice()].concat();
        let with = |rest: &[u8]| [head.as_slice(), rest].concat();
        for (bytes, why) in [
            (with(&u32::MAX.to_le_bytes()), "length: found 4294967295, expected at most 32768 bytes"),
            (with(b"\x04\0\0\0a.df"), "path: found a.df, expected a whole path"),
            (with(b"\0\0\0\0"), "path: found , expected a whole path"),
            (with(b"\x03\0\0\0/\0a"), "path: found a zero byte, expected none"),
            (b"GET / HTTP/1.1\r\n\r\n".to_vec(), "mark: found GET / HT, expected DFopen1\\n"),
        ] {
            let told = heard(bytes, &token).0.unwrap_err().to_string();
            assert!(told.ends_with(why), "{told}");
        }
        let long = Path::new("/").join("a".repeat(LONGEST));
        assert!(ask(&mut Heard::default(), &token, &long, PATIENCE).unwrap_err().to_string().contains("found 32769"));
        // Nobody waits for one who says nothing more.
        let mut wire = Heard(Cursor::new(request(&token, Path::new("/a.df"))), Vec::new());
        assert_eq!(answer(&mut wire, &token, Duration::ZERO).unwrap_err().kind(), ErrorKind::TimedOut);
    }
}
