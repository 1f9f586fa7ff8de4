//! A link between a server and whoever reads from it, within this machine: all connections share its rate, each request and each new
//! connection takes a round trip, a connection sends more with each round trip, and answers are spoilt where that is asked for.

use crate::model::mixing::{GOLDEN, mix_bits};
use serde::Serialize;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

/// Bytes that go out at a time: what a new connection may send before anything of it is acknowledged (RFC 6928: ten segments).
const PIECE: usize = 14_600;
/// Bytes of a server's answer that are read at a time.
const BUFFER: usize = 4 * PIECE;
/// Longest head of a request or an answer, bytes.
const LONGEST_HEAD: u64 = 64 << 10;
/// Whoever comes so late to send has not left the link idle: sleeping is not exact.
const LATE: Duration = Duration::from_millis(2);
/// Of so many answers one is spoilt.
const SPOILT: u64 = 8;
/// How long nothing comes of an answer that stalls: longer than readers wait.
const STALL: Duration = Duration::from_secs(12);
/// How long who waits for what may pass looks away.
const PAUSE: Duration = Duration::from_millis(20);

/// What a link is like.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Bytes per second of all connections together.
    pub rate: f64,
    /// Time of a round trip.
    pub latency: Duration,
    /// The seed by which answers are spoilt; `None`: none is.
    pub faults: Option<u64>,
}

/// What has passed so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Requests.
    pub requests: u64,
    /// Bytes of answers, their heads too.
    pub bytes: u64,
    /// Answers that were spoilt.
    pub spoilt: u64,
}

impl Counts {
    /// What has passed since then.
    pub fn since(self, then: Counts) -> Counts {
        Counts {
            requests: self.requests - then.requests,
            bytes: self.bytes - then.bytes,
            spoilt: self.spoilt - then.spoilt,
        }
    }
}

/// What is done to an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Another one is given: status and reason.
    Status(&'static str),
    /// The connection ends before it.
    Cut,
    /// Nothing comes.
    Stall,
    /// Half of what its head promises comes.
    Short,
}

/// All of them, each as often.
const FAULTS: [Fault; 5] = [
    Fault::Status("429 Too Many Requests"),
    Fault::Status("503 Service Unavailable"),
    Fault::Cut,
    Fault::Stall,
    Fault::Short,
];

/// A link; nobody gets through any more when it is dropped.
pub struct Link {
    address: SocketAddr,
    shared: Arc<Shared>,
    listening: Option<JoinHandle<()>>,
}

/// What connections share.
struct Shared {
    server: SocketAddr,
    shape: Shape,
    /// When all that was sent is through.
    free: Mutex<Instant>,
    counts: Mutex<Counts>,
    is_over: AtomicBool,
}

/// How much a connection sends in a round trip.
struct Flow {
    /// Bytes; twice as many with each round trip that they were not enough for.
    window: usize,
    /// Bytes since the present round trip began.
    sent: usize,
    since: Instant,
}

impl Link {
    /// A link to a server of HTTP/1.1 on this machine.
    ///
    /// # Errors
    /// Where no address is to be had.
    pub fn new(server: SocketAddr, shape: Shape) -> io::Result<Link> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            server,
            shape,
            free: Mutex::new(Instant::now()),
            counts: Mutex::default(),
            is_over: AtomicBool::new(false),
        });
        let own = Arc::clone(&shared);
        let accept = move || {
            for stream in listener.incoming() {
                if own.is_over.load(Ordering::Relaxed) {
                    return;
                }
                // Whoever was about to connect went away, or there are too many connections for now.
                let Ok(stream) = stream else {
                    sleep(PAUSE);
                    continue;
                };
                let own = Arc::clone(&own);
                // Who goes away, and a connection that there is no thread for, is no fault of the link's.
                let serve = move || drop(own.converse(&stream));
                drop(std::thread::Builder::new().name("deepfield link".into()).spawn(serve));
            }
        };
        let listening = std::thread::Builder::new().name("deepfield link".into()).spawn(accept)?;
        Ok(Link { address, shared, listening: Some(listening) })
    }

    /// The URL of a server's file through the link. Readers take it for another file for each `name`.
    pub fn url(&self, name: &str, file: &str) -> PathBuf {
        format!("http://{}/{name}/{file}", self.address).into()
    }

    /// What has passed so far.
    pub fn counts(&self) -> Counts {
        *locked(&self.shared.counts)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        // Wakes whoever waits for a connection.
        drop(TcpStream::connect(self.address));
        if let Some(listening) = self.listening.take() {
            let _ = listening.join();
        }
    }
}

impl Shared {
    /// Passes requests on and answers back, one after the other.
    fn converse(&self, stream: &TcpStream) -> io::Result<()> {
        // Pieces go out as the link has them.
        stream.set_nodelay(true)?;
        let mut reader = BufReader::new(stream);
        let mut flow = Flow { window: PIECE, sent: 0, since: Instant::now() };
        // On a way between two places, a connection is there after a round trip.
        let connected = Instant::now() + self.shape.latency;
        while let Some(mut request) = head(&mut reader)? {
            let fault = self.begin();
            sleep_until(connected.max(Instant::now()) + self.shape.latency);
            if self.is_over.load(Ordering::Relaxed) {
                return Ok(());
            }
            (flow.sent, flow.since) = (0, Instant::now());
            match fault {
                Some(Fault::Cut) => return Ok(()),
                Some(Fault::Stall) => return self.stall(),
                Some(Fault::Status(status)) => {
                    let answer = format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\n\r\n");
                    self.send(stream, answer.as_bytes(), &mut flow)?;
                    continue;
                }
                Some(Fault::Short) | None => {}
            }
            let unnamed = request.first().and_then(|line| without_name(line)).ok_or(ErrorKind::InvalidData)?;
            request[0] = unnamed;
            let mut server = TcpStream::connect(self.server)?;
            server.write_all(format!("{}\r\n\r\n", request.join("\r\n")).as_bytes())?;
            let mut server = BufReader::new(server);
            let answer = head(&mut server)?.ok_or(ErrorKind::UnexpectedEof)?;
            self.send(stream, format!("{}\r\n\r\n", answer.join("\r\n")).as_bytes(), &mut flow)?;
            let length = body_length(&request[0], &answer);
            let is_short = fault == Some(Fault::Short);
            let mut left = if is_short { length / 2 } else { length };
            let mut buffer = vec![0; BUFFER];
            while left > 0 {
                let part = &mut buffer[..left.min(BUFFER as u64) as usize];
                server.read_exact(part)?;
                self.send(stream, part, &mut flow)?;
                left -= part.len() as u64;
            }
            if is_short {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Counts a request and says what is to be done to its answer.
    fn begin(&self) -> Option<Fault> {
        let mut counts = locked(&self.counts);
        counts.requests += 1;
        let hash = mix_bits(self.shape.faults?.wrapping_add(counts.requests.wrapping_mul(GOLDEN)));
        if !hash.is_multiple_of(SPOILT) {
            return None;
        }
        counts.spoilt += 1;
        Some(FAULTS[((hash >> 8) % FAULTS.len() as u64) as usize])
    }

    /// Sends bytes as the link and the connection take them.
    fn send(&self, mut stream: &TcpStream, mut bytes: &[u8], flow: &mut Flow) -> io::Result<()> {
        while !bytes.is_empty() {
            let (piece, rest) = bytes.split_at(flow.admit(bytes.len().min(PIECE), self.shape.latency));
            sleep_until(self.through(piece.len()));
            locked(&self.counts).bytes += piece.len() as u64;
            stream.write_all(piece)?;
            bytes = rest;
        }
        Ok(())
    }

    /// When so many bytes more are through, after all that is under way.
    fn through(&self, bytes: usize) -> Instant {
        let now = Instant::now();
        let mut free = locked(&self.free);
        let begin = (*free).max(now.checked_sub(LATE).unwrap_or(now));
        *free = begin + Duration::from_secs_f64(bytes as f64 / self.shape.rate);
        *free
    }

    /// Waits for as long as an answer stalls, unless the link is over.
    fn stall(&self) -> io::Result<()> {
        let end = Instant::now() + STALL;
        while Instant::now() < end && !self.is_over.load(Ordering::Relaxed) {
            sleep(PAUSE);
        }
        Ok(())
    }
}

impl Flow {
    /// How many of so many bytes, one at least, may be under way now; waits where none may.
    fn admit(&mut self, bytes: usize, latency: Duration) -> usize {
        if self.sent >= self.window {
            sleep_until(self.since + latency);
            self.window = self.window.saturating_mul(2);
            (self.sent, self.since) = (0, Instant::now());
        }
        let admitted = bytes.min(self.window - self.sent);
        self.sent += admitted;
        admitted
    }
}

fn locked<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

fn sleep_until(then: Instant) {
    sleep(then.saturating_duration_since(Instant::now()));
}

/// The lines of a head without the empty one at its end; `None` where the connection has ended.
fn head(from: &mut impl BufRead) -> io::Result<Option<Vec<String>>> {
    let (mut from, mut lines) = (from.take(LONGEST_HEAD), Vec::new());
    loop {
        let mut line = String::new();
        if from.read_line(&mut line)? == 0 {
            return Ok(None);
        }
        line.truncate(line.trim_end().len());
        if line.is_empty() {
            return Ok(Some(lines));
        }
        lines.push(line);
    }
}

/// The first line of a request without the first part of its path, which only tells files apart: `GET /name/a.df HTTP/1.1`.
fn without_name(line: &str) -> Option<String> {
    let (method, path) = line.split_once(" /")?;
    Some(format!("{method} /{}", path.split_once('/')?.1))
}

/// Bytes that follow the head of an answer to a request with this first line (RFC 9112, 6.3); 0 where it says nothing of that.
fn body_length(request: &str, answer: &[String]) -> u64 {
    let status = answer.first().and_then(|line| line.split(' ').nth(1)).unwrap_or_default();
    if request.starts_with("HEAD ") || status.starts_with('1') || matches!(status, "204" | "304") {
        return 0;
    }
    let field = |line: &String| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse().ok())?
    };
    answer.iter().find_map(field).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers every connection with so many bytes.
    fn server(bytes: usize) -> SocketAddr {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || {
            for mut stream in listener.incoming().map_while(Result::ok) {
                std::thread::spawn(move || {
                    let request = head(&mut BufReader::new(&stream)).unwrap().unwrap();
                    assert_eq!(request, ["GET /a.df HTTP/1.1", "Host: here"]);
                    stream.write_all(format!("HTTP/1.1 206 So\r\nContent-Length: {bytes}\r\n\r\n").as_bytes()).unwrap();
                    stream.write_all(&vec![7; bytes]).unwrap();
                });
            }
        });
        address
    }

    /// Status and length of the body of so many answers on one connection; fewer where it ends.
    fn ask(link: &Link, times: usize) -> Vec<(String, u64)> {
        let stream = TcpStream::connect(link.address).unwrap();
        let mut reader = BufReader::new(&stream);
        let mut answers = Vec::new();
        for _ in 0..times {
            (&stream).write_all(b"GET /some/a.df HTTP/1.1\r\nHost: here\r\n\r\n").unwrap();
            let Some(answer) = head(&mut reader).unwrap() else { break };
            let length = body_length("GET /some/a.df HTTP/1.1", &answer);
            let read = io::copy(&mut reader.by_ref().take(length), &mut io::sink()).unwrap();
            answers.push((answer[0].clone(), read));
            if read < length {
                break;
            }
        }
        answers
    }

    #[test]
    fn all_connections_share_the_rate_and_each_answer_takes_a_round_trip() {
        const BYTES: usize = 100_000;
        let shape = Shape { rate: 2e6, latency: Duration::from_millis(20), faults: None };
        let link = Link::new(server(BYTES), shape).unwrap();
        let start = Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| assert_eq!(ask(&link, 1), [("HTTP/1.1 206 So".to_owned(), BYTES as u64)]));
            }
        });
        let seconds = start.elapsed().as_secs_f64();
        let counts = link.counts();
        assert_eq!((counts.requests, counts.spoilt), (3, 0));
        assert!(counts.bytes >= 3 * BYTES as u64 && counts.bytes < 3 * (BYTES as u64 + 100), "{counts:?}");
        // Connection, request, and 150 ms of sending; a busy machine is slower.
        let least = 0.04 + counts.bytes as f64 / shape.rate - LATE.as_secs_f64();
        assert!(seconds >= least && seconds < 10.0 * least, "{seconds} s of at least {least} s");
        // A connection is asked for once.
        let start = Instant::now();
        assert_eq!(ask(&link, 2).len(), 2);
        assert!(start.elapsed().as_secs_f64() >= 0.06 + 2.0 * (BYTES as f64 / shape.rate - LATE.as_secs_f64()));
    }

    #[test]
    fn one_answer_in_eight_is_spoilt_and_the_others_are_whole() {
        // A seed whose first hundred requests meet no stall.
        let shape = Shape { rate: 1e9, latency: Duration::ZERO, faults: Some(4) };
        let link = Link::new(server(1000), shape).unwrap();
        let (mut whole, mut refused, mut short) = (0, 0, 0);
        while link.counts().requests < 100 {
            for (status, read) in ask(&link, 10_usize.min(100 - link.counts().requests as usize)) {
                match (status.contains("206"), read) {
                    (true, 1000) => whole += 1,
                    (true, 500) => short += 1,
                    (false, 0) => refused += 1,
                    other => panic!("{status}: {other:?}"),
                }
            }
        }
        // The two that are left were cut.
        assert_eq!((whole, refused, short, link.counts().spoilt), (87, 8, 3, 13));
    }

    #[test]
    fn only_answers_that_have_a_body_are_followed_by_one() {
        for (method, status, length) in [
            ("GET", "206 Partial Content", 1000),
            ("HEAD", "200 OK", 0),
            ("GET", "304 Not Modified", 0),
            ("GET", "204 No Content", 0),
            ("GET", "416 Range Not Satisfiable", 1000),
        ] {
            let answer = [format!("HTTP/1.1 {status}"), "content-LENGTH: 1000".to_owned()];
            assert_eq!(body_length(&format!("{method} /a.df HTTP/1.1"), &answer), length, "{method}, {status}");
        }
        assert_eq!(body_length("GET /a.df HTTP/1.1", &[]), 0);
    }
}
