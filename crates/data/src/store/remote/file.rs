//! One file behind a URL.

use super::address::{Address, Object};
use super::failure::told;
use super::kept::{Ends, Kept};
use super::note;
use super::pause::{LONG, in_seconds};
use super::runtime::{begin, outcome, wait};
use super::traffic::{Outcome, Traffic};
use super::version::Version;
use crate::store::disk::{Change, Disk};
use crate::store::error::may_pass;
use object_store::{GetOptions, GetRange, ObjectStore};
use std::fmt;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// First bytes that are read to open a file: the header, and what is small whole.
const HEAD: u64 = 64 << 10;
/// Last bytes that are read to open a file: the footer, unless it is longer.
const TAIL: u64 = 256 << 10;
/// Longest part that is asked for at a time, bytes: what a server says of lengths is no reason to fill the memory.
const LONGEST: u64 = 1 << 30;
/// A read waits for so long where the server asks to be left alone, and then fails: one that took much longer would count as stalled.
const PATIENCE: Duration = Duration::from_secs(50);
/// Pauses between attempts to open a file, as between those to read a page.
const PAUSES: [Duration; 3] = [Duration::from_millis(100), Duration::from_millis(400), Duration::from_millis(1600)];
/// How often bytes are asked for that have another checksum than they should: once more, as the link may have damaged them.
const ATTEMPTS: usize = 2;
/// A file was changed between the two requests that open it, which is done again.
const CHANGED: ErrorKind = ErrorKind::Interrupted;

/// An open file behind a URL. It holds how the file begins and ends, never pages.
pub(in crate::store) struct RemoteFile {
    url: String,
    host: String,
    object: Object,
    ends: Ends,
    /// What is kept on this machine.
    kept: Option<Kept>,
    /// Whether it was opened without an answer of the server.
    is_from_before: bool,
    traffic: Mutex<Traffic>,
    change: Mutex<Option<Change>>,
    opened: Instant,
}

/// The URL may hold a secret, and so may what asks the server.
impl fmt::Debug for RemoteFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RemoteFile")
            .field("host", &self.host)
            .field("version", &self.ends.version)
            .finish_non_exhaustive()
    }
}

impl RemoteFile {
    /// Opens a file: two requests side by side, unless something is in their way. Where the server cannot be reached, what was kept of the
    /// file opens it, which is told.
    pub(super) fn open(address: Address) -> io::Result<RemoteFile> {
        let mut kept = Kept::of(&address.shown, &address.url);
        let (mut pauses, mut is_from_before) = (PAUSES.iter(), false);
        let ends = loop {
            let error = match ends_of(&address.object, &address.host) {
                Ok(ends) => {
                    kept.iter().for_each(|kept| kept.keep_ends(&ends));
                    break ends;
                }
                Err(error) => error,
            };
            if !may_pass(error.kind()) {
                return Err(error);
            }
            // A server that answers has the last word.
            let is_away = error.kind() != CHANGED;
            if is_away && let Some(ends) = kept.as_ref().and_then(Kept::ends) {
                note(format!("{}: {error}; what was read of it before is shown", address.shown));
                is_from_before = true;
                break ends;
            }
            // A server that does not answer has been waited for long enough.
            let is_soon = error.kind() != ErrorKind::TimedOut && address.object.pause.left() < LONG;
            match pauses.next().filter(|_| is_soon) {
                Some(pause) => std::thread::sleep(*pause),
                None => return Err(error),
            }
        };
        kept.iter_mut().for_each(|kept| kept.open(&ends));
        let Address { url, host, object, .. } = address;
        let now = Instant::now();
        let traffic = Mutex::new(Traffic::new(now));
        let change = Mutex::new(None);
        Ok(RemoteFile { url, host, object, ends, kept, is_from_before, traffic, change, opened: now })
    }

    /// All of its URL; may hold a secret.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Time since it was opened.
    pub fn age(&self) -> Duration {
        self.opened.elapsed()
    }

    /// Whether the server has another one by now, as far as answers have said.
    pub fn is_changed(&self) -> bool {
        self.noted().is_some()
    }

    fn noted(&self) -> MutexGuard<'_, Option<Change>> {
        self.change.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn traffic(&self) -> MutexGuard<'_, Traffic> {
        self.traffic.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fills `buffer` from what opening has read, if it is there.
    fn read_ends(&self, buffer: &mut [u8], offset: u64) -> bool {
        let Ends { version, head, tail } = &self.ends;
        let found = [(0, head), (version.size - tail.len() as u64, tail)].into_iter().find_map(|(start, bytes)| {
            let from = usize::try_from(offset.checked_sub(start)?).ok()?;
            bytes.get(from..from.checked_add(buffer.len())?)
        });
        found.map(|bytes| buffer.copy_from_slice(bytes)).is_some()
    }

    /// Fills `buffer` with what the server sends.
    fn receive(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        let end = offset.checked_add(buffer.len() as u64).filter(|end| *end <= self.ends.version.size);
        let end = end.ok_or(ErrorKind::UnexpectedEof)?;
        if !buffer.is_empty() {
            buffer.copy_from_slice(&self.ask(offset..end)?);
        }
        Ok(())
    }

    /// Asks the server for a part.
    fn ask(&self, range: Range<u64>) -> io::Result<Vec<u8>> {
        let RemoteFile { host, .. } = self;
        let wanted = range.end - range.start;
        if wanted > LONGEST {
            let what = format!("{host} is to send {wanted} bytes at a time, expected at most {LONGEST}");
            return Err(io::Error::new(ErrorKind::InvalidInput, what));
        }
        let replaced =
            || io::Error::new(ErrorKind::StaleNetworkFileHandle, format!("{host} has another version of it"));
        if let Some(left) = self.object.pause.left_untold() {
            note(format!(
                "{host} asks for no requests within {} s: what has not come waits for that",
                in_seconds(left)
            ));
        }
        self.object.pause.wait(host, PATIENCE)?;
        if self.is_changed() {
            return Err(replaced());
        }
        let expected = &self.ends.version;
        self.traffic().begin(Instant::now());
        let answer = wait(fetch(self.object.clone(), GetRange::Bounded(range), expected.e_tag.clone()));
        let answer = answer.and_then(|answer| answer.map_err(|error| told(host, &error)));
        let came = match &answer {
            Ok(answer) => Outcome::Came(answer.bytes.len() as u64, answer.first),
            Err(error) if matches!(error.kind(), ErrorKind::ResourceBusy | ErrorKind::TimedOut) => Outcome::TooMany,
            Err(_) => Outcome::Failed,
        };
        self.traffic().end(came, Instant::now());
        let change = match &answer {
            Ok(answer) if expected.is_other(&answer.version) => Some(Change::Replaced),
            Err(error) if error.kind() == ErrorKind::StaleNetworkFileHandle => Some(Change::Replaced),
            Err(error) if error.kind() == ErrorKind::NotFound => Some(Change::Deleted),
            _ => None,
        };
        if change.is_some() {
            *self.noted() = change;
        }
        let answer = answer?;
        match answer.bytes.len() as u64 {
            _ if change.is_some() => Err(replaced()),
            len if len == wanted => Ok(answer.bytes),
            len => Err(io::Error::new(ErrorKind::ConnectionAborted, format!("{host} sent {len} bytes of {wanted}"))),
        }
    }
}

impl Disk for RemoteFile {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        match self.read_ends(buffer, offset) {
            true => Ok(()),
            false => self.receive(buffer, offset),
        }
    }

    fn read_known_at(&self, buffer: &mut [u8], offset: u64, crc: u32) -> io::Result<()> {
        let is_sound = |bytes: &[u8]| crc32c::crc32c(bytes) == crc;
        let is_here = self.read_ends(buffer, offset) && is_sound(buffer);
        if is_here || self.kept.as_ref().is_some_and(|kept| kept.read_part(buffer, offset, crc)) {
            return Ok(());
        }
        for _ in 0..ATTEMPTS {
            self.receive(buffer, offset)?;
            if is_sound(buffer) {
                self.kept.iter().for_each(|kept| kept.keep_part(buffer, offset, crc));
                break;
            }
        }
        Ok(())
    }

    fn read_sealed_at(&self, buffer: &mut [u8], offset: u64, is_sound: fn(&[u8]) -> bool) -> io::Result<()> {
        let Some(kept) = &self.kept else { return self.read_exact_at(buffer, offset) };
        if self.read_ends(buffer, offset) || (self.is_from_before && kept.read_sealed(buffer, offset, is_sound)) {
            return Ok(());
        }
        match self.read_exact_at(buffer, offset) {
            // A server that answers has the last word.
            Err(error) if may_pass(error.kind()) && kept.read_sealed(buffer, offset, is_sound) => Ok(()),
            Ok(()) if is_sound(buffer) => {
                kept.keep_sealed(buffer, offset);
                Ok(())
            }
            read => read,
        }
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.ends.version.size)
    }

    fn change(&self) -> Option<Change> {
        *self.noted()
    }

    /// Every answer says which version it is of.
    fn knows_changes(&self) -> bool {
        true
    }

    fn reads_at_once(&self) -> Option<usize> {
        Some(self.traffic().at_once())
    }
}

/// What a server has sent.
struct Answer {
    version: Version,
    bytes: Vec<u8>,
    /// Time until the first of it came.
    first: Duration,
}

async fn fetch(object: Object, range: GetRange, if_match: Option<String>) -> object_store::Result<Answer> {
    let asked = Instant::now();
    let options = GetOptions { range: Some(range), if_match, ..GetOptions::default() };
    let found = object.store.get_opts(&object.key, options).await?;
    let (version, first) = (Version::of(&found.meta), asked.elapsed());
    let bytes = found.bytes().await?.into();
    Ok(Answer { version, bytes, first })
}

/// Reads how a file begins and ends.
fn ends_of(object: &Object, host: &str) -> io::Result<Ends> {
    let sent = |answer: object_store::Result<Answer>| answer.map_err(|error| told(host, &error));
    object.pause.wait(host, LONG)?;
    let head = begin(fetch(object.clone(), GetRange::Bounded(0..HEAD), None))?;
    let tail = begin(fetch(object.clone(), GetRange::Suffix(TAIL), None))?;
    let head = sent(outcome(&head)?)?;
    let (version, len) = (head.version, head.bytes.len() as u64);
    if len != version.size.min(HEAD) {
        let what = format!("{host} sent {len} bytes of {}", version.size.min(HEAD));
        return Err(io::Error::new(ErrorKind::ConnectionAborted, what));
    }
    let start = version.size.saturating_sub(TAIL).max(if version.size <= HEAD { version.size } else { 0 });
    if start == version.size {
        return Ok(Ends { version, head: head.bytes, tail: Vec::new() });
    }
    let is_tail = |tail: &Answer| !version.is_other(&tail.version) && tail.bytes.len() as u64 == version.size - start;
    let changed = || io::Error::new(CHANGED, format!("{host} has changed it while it was opened"));
    let tail = match outcome(&tail)? {
        Ok(tail) if is_tail(&tail) => tail,
        // A server that counts from the beginning only, or a file that was changed meanwhile.
        _ => {
            object.pause.wait(host, LONG)?;
            let range = GetRange::Bounded(start..version.size);
            match sent(wait(fetch(object.clone(), range, version.e_tag.clone()))?) {
                Err(error) if error.kind() == ErrorKind::StaleNetworkFileHandle => return Err(changed()),
                tail => tail?,
            }
        }
    };
    match is_tail(&tail) {
        true => Ok(Ends { version, head: head.bytes, tail: tail.bytes }),
        false => Err(changed()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::pause::Pause;
    use super::*;
    use object_store::ObjectStoreExt;
    use object_store::memory::InMemory;
    use std::io::{BufRead, BufReader, Write};
    use std::net::{TcpListener, TcpStream};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn object(bytes: Vec<u8>) -> Object {
        let object = Object { store: Arc::new(InMemory::new()), key: "a.df".into(), pause: Pause::default() };
        put(&object, bytes);
        object
    }

    fn block_on<T>(work: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(work)
    }

    fn put(object: &Object, bytes: Vec<u8>) {
        block_on(object.store.put(&object.key, bytes.into())).unwrap();
    }

    fn open(object: &Object) -> io::Result<RemoteFile> {
        let text = "mem://a.df".to_owned();
        RemoteFile::open(Address { url: text.clone(), shown: text, host: "memory".into(), object: object.clone() })
    }

    /// Bytes that no two places share.
    fn bytes(len: usize) -> Vec<u8> {
        (0..len.div_ceil(4) as u32).flat_map(|word| word.wrapping_mul(2_654_435_761).to_le_bytes()).take(len).collect()
    }

    #[test]
    fn every_part_of_a_file_of_any_length_is_what_was_put() {
        let lengths = [1, 100, HEAD - 1, HEAD, HEAD + 1, TAIL, HEAD + TAIL, HEAD + TAIL + 1, 3 * TAIL];
        for length in lengths.map(|length| length as usize) {
            let all = bytes(length);
            let file = open(&object(all.clone())).unwrap();
            assert_eq!(file.size().unwrap(), length as u64);
            let ends = [HEAD as usize, length.saturating_sub(TAIL as usize)];
            for offset in ends.into_iter().flat_map(|end| [end.saturating_sub(3), end, end + 3]).chain([0, length]) {
                for len in [0, 1, 10, 70_000, length] {
                    let mut part = vec![0; len];
                    let read = file.read_exact_at(&mut part, offset as u64);
                    match all.get(offset..offset.saturating_add(len)) {
                        Some(expected) => assert!(read.is_ok() && part == expected, "{length}: {offset} + {len}"),
                        None => assert_eq!(read.unwrap_err().kind(), ErrorKind::UnexpectedEof),
                    }
                }
            }
            assert!(file.read_exact_at(&mut [0; 2], u64::MAX).is_err() && file.change().is_none());
        }
    }

    /// Whether these are the hundred bytes after what is read to open a file of [`bytes`].
    fn is_sound(part: &[u8]) -> bool {
        let start = HEAD as usize + 100;
        *part == bytes(start + 100)[start..]
    }

    #[test]
    fn parts_that_know_themselves_are_kept_and_a_server_that_answers_has_the_last_word() {
        let (folder, object) = (tempfile::tempdir().unwrap(), object(bytes((HEAD + TAIL) as usize + 1000)));
        let mut file = open(&object).unwrap();
        let mut kept = Kept::within(folder.path().into(), 1 << 20, "mem://a.df", "mem://a.df");
        kept.open(&file.ends);
        file.kept = Some(kept);
        let read = |file: &RemoteFile| {
            let mut part = [0; 100];
            file.read_sealed_at(&mut part, HEAD + 100, is_sound).map(|()| is_sound(&part)).map_err(|error| error.kind())
        };
        assert_eq!(read(&file), Ok(true));
        put(&object, vec![0; (HEAD + TAIL) as usize + 1000]);
        assert_eq!(read(&file), Err(ErrorKind::StaleNetworkFileHandle));
        file.is_from_before = true;
        assert_eq!(read(&file), Ok(true));
        block_on(object.store.delete(&object.key)).unwrap();
        file.kept = None;
        assert!(read(&file).is_err());
    }

    #[test]
    fn another_version_is_never_read_and_an_absent_one_is_told() {
        let length = (HEAD + TAIL) as usize + 1000;
        let object = object(bytes(length));
        let [replaced, deleted] = [open(&object).unwrap(), open(&object).unwrap()];
        put(&object, bytes(length));
        let mut part = [0; 100];
        let error = replaced.read_exact_at(&mut part, HEAD + 100).unwrap_err();
        assert_eq!((error.kind(), part), (ErrorKind::StaleNetworkFileHandle, [0; 100]));
        assert_eq!(replaced.change(), Some(Change::Replaced));
        // What opening has read is of the version that is open.
        assert!(replaced.read_exact_at(&mut part, 5).is_ok() && part[..] == bytes(105)[5..]);
        block_on(object.store.delete(&object.key)).unwrap();
        assert_eq!(deleted.read_exact_at(&mut part, HEAD + 100).unwrap_err().kind(), ErrorKind::NotFound);
        assert_eq!(deleted.change(), Some(Change::Deleted));
        let error = open(&object).unwrap_err();
        assert_eq!(
            (error.kind(), error.to_string().as_str()),
            (ErrorKind::NotFound, "memory has no such file (status 404)")
        );
    }

    /// Answers one request after the other with parts of [`bytes`]; of an answer so many halves come, and without both no end.
    fn serve(stream: &TcpStream, length: usize, halves: &AtomicUsize) -> io::Result<()> {
        let mut lines = BufReader::new(stream).lines();
        while let Some(line) = lines.next().transpose()? {
            let line = line.to_ascii_lowercase();
            let Some((first, last)) = line.strip_prefix("range: bytes=").and_then(|range| range.split_once('-')) else {
                continue;
            };
            let number = |text: &str| text.trim().parse::<usize>().ok();
            let (start, end) = match (number(first), number(last)) {
                (Some(first), Some(last)) => (first, length.min(last + 1)),
                (_, count) => (length.saturating_sub(count.unwrap_or(0)), length),
            };
            // The rest of the head.
            lines.by_ref().map_while(Result::ok).find(String::is_empty);
            let halves = halves.load(Ordering::Relaxed);
            if halves == 0 {
                // Until the other end closes.
                return lines.next().transpose().map(drop);
            }
            let (all, mut stream) = (bytes(length), stream);
            let body = &all[start..end];
            write!(
                stream,
                "HTTP/1.1 206 Part\r\nContent-Range: bytes {start}-{}/{length}\r\nContent-Length: {}\r\n\
                 ETag: \"a\"\r\nLast-Modified: Sun, 06 Nov 1994 08:49:37 GMT\r\n\r\n",
                end - 1,
                body.len()
            )?;
            stream.write_all(&body[..body.len() * halves / 2])?;
            if halves < 2 {
                return lines.next().transpose().map(drop);
            }
        }
        Ok(())
    }

    #[test]
    fn an_answer_that_does_not_come_or_stalls_midway_is_given_up_and_asked_for_again() {
        std::thread::scope(|scope| {
            for halves in [0, 1] {
                scope.spawn(move || stalls_and_goes_on(halves));
            }
        });
    }

    /// Reads a part of which so many halves come, and then again.
    fn stalls_and_goes_on(come: usize) {
        let length = (HEAD + TAIL) as usize + 1000;
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/a.df", listener.local_addr().unwrap());
        let halves = Arc::new(AtomicUsize::new(2));
        let own = Arc::clone(&halves);
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                let own = Arc::clone(&own);
                // A client that goes away is no fault of the server's.
                std::thread::spawn(move || drop(serve(&stream, length, &own)));
            }
        });
        let file = RemoteFile::open(Address::within(&url, Duration::from_secs(1)).unwrap()).unwrap();
        let (before, mut part) = (file.reads_at_once().unwrap(), [0; 100]);
        halves.store(come, Ordering::Relaxed);
        let asked = Instant::now();
        let error = file.read_exact_at(&mut part, HEAD + 100).unwrap_err();
        assert_eq!((error.kind(), part), (ErrorKind::TimedOut, [0; 100]), "{error}");
        assert!(may_pass(error.kind()) && asked.elapsed() < Duration::from_secs(8), "{:?}", asked.elapsed());
        assert!(file.reads_at_once().unwrap() < before);
        halves.store(2, Ordering::Relaxed);
        file.read_exact_at(&mut part, HEAD + 100).unwrap();
        assert!(is_sound(&part));
    }
}
