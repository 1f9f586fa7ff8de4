//! A web server of one file, which answers requests for parts of it and misbehaves as it is told.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Bytes that are sent at a time.
const PIECE: usize = 1 << 16;

/// What is done about a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It is answered.
    Sound,
    /// A status without a body, and the seconds after which to ask again.
    Status(u16, Option<u32>),
    /// Another place to ask.
    Elsewhere(&'static str),
    /// This text, whatever was asked for.
    Text(&'static str),
    /// The whole file, as servers send it that know no ranges.
    Whole,
    /// Half of what the header promises, then the end of the connection.
    Short,
    /// Another part than the one that was asked for, of the same length.
    WrongPart,
    /// A body as long as the file where a part was asked for.
    Long,
    /// The part that was asked for, with other bytes.
    Damaged,
    /// The part that was asked for, up to the end of the connection: nothing says how long it is.
    Unsized,
    /// The end of the connection.
    Cut,
    /// Nothing, as long as that is what is done.
    Stall,
}

/// A request.
#[derive(Clone, Debug, Default)]
pub struct Asked {
    /// What stands between the method and `HTTP/1.1`.
    pub target: String,
    /// First byte and the one after the last.
    pub range: Option<(u64, u64)>,
    pub authorization: Option<String>,
    /// What whoever has a role for a while shows beside a signature.
    pub session_token: Option<String>,
    if_match: Option<String>,
}

type Decide = Arc<dyn Fn(&Asked) -> Fault + Send + Sync>;

struct State {
    bytes: Arc<Vec<u8>>,
    tag: Option<String>,
    modified: Option<&'static str>,
    decide: Decide,
    asked: Vec<Asked>,
    sent: u64,
    /// Requests that are not answered yet, and the most there have been.
    under_way: (usize, usize),
}

struct Shared {
    state: Mutex<State>,
    is_over: AtomicBool,
    /// Time before each answer, and bytes per second of all answers together.
    link: Option<(Duration, f64)>,
    turn: Mutex<()>,
}

/// The server; it ends when it is dropped.
pub struct FaultServer {
    address: SocketAddr,
    shared: Arc<Shared>,
    listening: Option<JoinHandle<()>>,
}

impl FaultServer {
    /// Serves these bytes, with a strong tag.
    pub fn new(bytes: impl Into<Arc<Vec<u8>>>) -> FaultServer {
        FaultServer::behind(bytes.into(), None)
    }

    /// The same over a link of some latency and bytes per second.
    pub fn over_link(bytes: Vec<u8>, latency: Duration, rate: f64) -> FaultServer {
        FaultServer::behind(bytes.into(), Some((latency, rate)))
    }

    fn behind(bytes: Arc<Vec<u8>>, link: Option<(Duration, f64)>) -> FaultServer {
        let state = State {
            bytes,
            tag: Some("\"first\"".into()),
            modified: Some("Sun, 06 Nov 1994 08:49:37 GMT"),
            decide: Arc::new(|_| Fault::Sound),
            asked: Vec::new(),
            sent: 0,
            under_way: (0, 0),
        };
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let shared = Shared { state: Mutex::new(state), is_over: AtomicBool::new(false), link, turn: Mutex::new(()) };
        let shared = Arc::new(shared);
        let own = Arc::clone(&shared);
        let listening = std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                if own.is_over.load(Ordering::Relaxed) {
                    return;
                }
                let own = Arc::clone(&own);
                // A client that goes away is no fault of the server's.
                std::thread::spawn(move || drop(serve(&own, &stream)));
            }
        });
        FaultServer { address, shared, listening: Some(listening) }
    }

    /// The URL of the file under any name.
    pub fn url(&self, name: &str) -> String {
        format!("http://{}/{name}", self.address)
    }

    /// From now on requests are answered so.
    pub fn answer(&self, decide: impl Fn(&Asked) -> Fault + Send + Sync + 'static) {
        self.shared.state.lock().unwrap().decide = Arc::new(decide);
    }

    /// From now on the file is this one; its tag and time are as they are given.
    pub fn replace(&self, bytes: Vec<u8>, tag: Option<&str>, modified: Option<&'static str>) {
        let mut state = self.shared.state.lock().unwrap();
        (state.bytes, state.tag, state.modified) = (Arc::new(bytes), tag.map(str::to_owned), modified);
    }

    /// The requests so far.
    pub fn asked(&self) -> Vec<Asked> {
        self.shared.state.lock().unwrap().asked.clone()
    }

    /// Bytes of bodies that were sent so far.
    pub fn sent(&self) -> u64 {
        self.shared.state.lock().unwrap().sent
    }

    /// The most requests at a time so far, where all of them were answered.
    pub fn most_at_once(&self) -> usize {
        self.shared.state.lock().unwrap().under_way.1
    }
}

impl Drop for FaultServer {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        // Wakes whoever waits for a client. From then on nobody listens.
        drop(TcpStream::connect(self.address));
        if let Some(listening) = self.listening.take() {
            let _ = listening.join();
        }
    }
}

/// Answers one request after the other.
fn serve(shared: &Shared, stream: &TcpStream) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream).lines();
    while let Some(first) = lines.next().transpose()? {
        let mut asked = Asked { target: first.split(' ').nth(1).unwrap_or_default().into(), ..Asked::default() };
        let mut range = None;
        for line in lines.by_ref() {
            let line = line?;
            let Some((name, value)) = line.split_once(':') else { break };
            match name.to_ascii_lowercase().as_str() {
                "range" => range = Some(value.trim().to_owned()),
                "if-match" => asked.if_match = Some(value.trim().into()),
                "authorization" => asked.authorization = Some(value.trim().into()),
                "x-amz-security-token" => asked.session_token = Some(value.trim().into()),
                _ => {}
            }
        }
        let (bytes, tag, modified) = {
            let mut state = shared.state.lock().unwrap();
            asked.range = range.and_then(|range| part(&range, state.bytes.len() as u64));
            state.asked.push(asked.clone());
            state.under_way.0 += 1;
            state.under_way.1 = state.under_way.1.max(state.under_way.0);
            (Arc::clone(&state.bytes), state.tag.clone(), state.modified)
        };
        let decide = || {
            let decide = Arc::clone(&shared.state.lock().unwrap().decide);
            decide(&asked)
        };
        let mut fault = decide();
        while fault == Fault::Stall {
            if shared.is_over.load(Ordering::Relaxed) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(5));
            fault = decide();
        }
        // A server that is gone keeps none of its connections.
        if fault == Fault::Cut || shared.is_over.load(Ordering::Relaxed) {
            return Ok(());
        }
        let size = bytes.len() as u64;
        let mut head = String::from("HTTP/1.1 ");
        let damaged: Vec<u8>;
        let mut body: &[u8] = &[];
        let tells = |head: &mut String, name: &str, value: &dyn std::fmt::Display| {
            *head += &format!("{name}: {value}\r\n");
        };
        let status = |head: &mut String, status: u16| *head += &format!("{status} So\r\n");
        match (fault, asked.range) {
            (Fault::Status(code, after), _) => {
                status(&mut head, code);
                after.iter().for_each(|seconds| tells(&mut head, "Retry-After", seconds));
            }
            (Fault::Elsewhere(place), _) => {
                status(&mut head, 302);
                tells(&mut head, "Location", &place);
            }
            (Fault::Text(text), _) => {
                status(&mut head, 200);
                body = text.as_bytes();
            }
            _ if asked.if_match.as_ref().is_some_and(|expected| tag.as_ref() != Some(expected)) => {
                status(&mut head, 412);
            }
            (Fault::Whole, _) => {
                status(&mut head, 200);
                body = &bytes;
            }
            (_, None) => status(&mut head, 416),
            (_, Some((start, end))) => {
                status(&mut head, 206);
                body = &bytes[start as usize..end as usize];
                let shift = u64::from(fault == Fault::WrongPart);
                tells(&mut head, "Content-Range", &format!("bytes {}-{}/{size}", start + shift, end - 1 + shift));
                if fault == Fault::Long {
                    body = &bytes;
                }
                if fault == Fault::Damaged {
                    damaged = body.iter().map(|byte| byte ^ 1).collect();
                    body = &damaged;
                }
            }
        }
        tag.iter().for_each(|tag| tells(&mut head, "ETag", tag));
        modified.iter().for_each(|modified| tells(&mut head, "Last-Modified", modified));
        if fault != Fault::Unsized {
            tells(&mut head, "Content-Length", &body.len());
        }
        head += "\r\n";
        if fault == Fault::Short {
            body = &body[..body.len() / 2];
        }
        if let Some((latency, _)) = shared.link {
            std::thread::sleep(latency);
        }
        let mut stream = stream;
        stream.write_all(head.as_bytes())?;
        let last = body.len().div_ceil(PIECE).saturating_sub(1);
        for (number, piece) in body.chunks(PIECE).enumerate() {
            if let Some((_, rate)) = shared.link {
                let _turn = shared.turn.lock().unwrap();
                std::thread::sleep(Duration::from_secs_f64(piece.len() as f64 / rate));
            }
            if number == last {
                shared.state.lock().unwrap().under_way.0 -= 1;
            }
            stream.write_all(piece)?;
            shared.state.lock().unwrap().sent += piece.len() as u64;
        }
        if matches!(fault, Fault::Short | Fault::Unsized) {
            return Ok(());
        }
    }
    Ok(())
}

/// The part that a header names: `bytes=0-99` or `bytes=-100`; `None` where the file has no such.
fn part(range: &str, size: u64) -> Option<(u64, u64)> {
    let (first, last) = range.strip_prefix("bytes=")?.split_once('-')?;
    let part = match (first, last.parse::<u64>().ok()) {
        ("", Some(count)) => (size.saturating_sub(count), size),
        (first, last) => (first.parse().ok()?, last.map_or(size, |last| size.min(last + 1))),
    };
    (part.0 < part.1).then_some(part)
}
