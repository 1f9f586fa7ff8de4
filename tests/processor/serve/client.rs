//! The other end: requests as text, answers in their parts.

use deepfield::serve::{Offer, Running, ServeOptions, Server};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An answer.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Answer {
    /// An answer from its bytes.
    pub fn parsed(bytes: &[u8]) -> Answer {
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").expect("a head");
        let head = std::str::from_utf8(&bytes[..end]).unwrap();
        let mut lines = head.split("\r\n");
        let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
        let pair = |line: &str| line.split_once(": ").map(|(name, value)| (name.to_lowercase(), value.to_owned()));
        Answer { status, headers: lines.filter_map(pair).collect(), body: bytes[end + 4..].to_vec() }
    }

    /// A header, empty where there is none.
    pub fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(own, _)| own == name).map_or("", |(_, value)| value)
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// What stands in a cookie that is set.
    pub fn cookie(&self, name: &str) -> Option<&str> {
        let mut set = self.headers.iter().filter(|(own, _)| own == "set-cookie").map(|(_, value)| value.as_str());
        set.find_map(|value| value.split(';').next()?.strip_prefix(name)?.strip_prefix('='))
    }
}

/// A server on any port that is free.
pub fn serving(options: ServeOptions, offer: Offer) -> Running {
    let options = ServeOptions { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..options };
    Server::bind(options, offer).unwrap().start().unwrap()
}

/// A connection to it.
pub fn connected(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    stream
}

/// What is answered to a request with these headers, each a line, on a connection of its own.
pub fn asked(address: SocketAddr, request: &str, headers: &[&str], body: &[u8]) -> Answer {
    on(connected(address), request, headers, body)
}

/// The same on a connection that is there.
pub fn on(mut stream: impl Read + Write, request: &str, headers: &[&str], body: &[u8]) -> Answer {
    let lines: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
    let head = format!(
        "{request} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{lines}Content-Length: {}\r\n\r\n",
        body.len()
    );
    // A server that refuses does not read to the end, and closes with what there is to say.
    let _ = stream.write_all(&[head.as_bytes(), body].concat());
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    Answer::parsed(&bytes)
}
