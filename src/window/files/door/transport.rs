//! By what a door is reached.

use super::protocol::{Token, Wire};
#[cfg(any(not(unix), test))]
use renetcode::generate_random_bytes;
use std::io;
#[cfg(any(not(unix), test))]
use std::net::{Ipv4Addr, TcpListener, TcpStream};
#[cfg(unix)]
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;

/// A way to a door, which has a place in a folder that only the user can look into.
pub trait Transport: 'static {
    /// How places end.
    const EXTENSION: &'static str;
    /// What waits behind the door.
    type Listener: Send + 'static;
    /// A connection.
    type Stream: Wire;

    /// Opens a door.
    fn listen(place: &Path) -> io::Result<(Self::Listener, Token)>;

    /// The next one who comes.
    fn accept(listener: &Self::Listener) -> io::Result<Self::Stream>;

    /// Goes to a door; its token is what is to be shown there.
    fn connect(place: &Path, patience: Duration) -> io::Result<(Self::Stream, Token)>;
}

/// What this system has.
#[cfg(unix)]
pub type Here = Socket;
#[cfg(not(unix))]
pub type Here = Port;

/// A Unix socket: whoever finds it may come in.
#[cfg(unix)]
pub struct Socket;

/// The token where none is needed.
#[cfg(unix)]
const NO_TOKEN: Token = [0; size_of::<Token>()];

#[cfg(unix)]
impl Transport for Socket {
    const EXTENSION: &'static str = "sock";
    type Listener = UnixListener;
    type Stream = UnixStream;

    fn listen(place: &Path) -> io::Result<(UnixListener, Token)> {
        Ok((UnixListener::bind(place)?, NO_TOKEN))
    }

    fn accept(listener: &UnixListener) -> io::Result<UnixStream> {
        listener.accept().map(|(stream, _)| stream)
    }

    fn connect(place: &Path, _: Duration) -> io::Result<(UnixStream, Token)> {
        Ok((UnixStream::connect(place)?, NO_TOKEN))
    }
}

#[cfg(unix)]
impl Wire for UnixStream {
    fn limit(&self, time: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(time))?;
        self.set_write_timeout(Some(time))
    }
}

/// A port that only this machine reaches. Any of its users does: the place is a file that holds the port and a token.
#[cfg(any(not(unix), test))]
pub struct Port;

#[cfg(any(not(unix), test))]
impl Transport for Port {
    const EXTENSION: &'static str = "port";
    type Listener = TcpListener;
    type Stream = TcpStream;

    fn listen(place: &Path) -> io::Result<(TcpListener, Token)> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let token: Token = generate_random_bytes();
        let port = listener.local_addr()?.port();
        crate::model::new_file::write(place, &ron::to_string(&(port, token)).map_err(io::Error::other)?)?;
        Ok((listener, token))
    }

    fn accept(listener: &TcpListener) -> io::Result<TcpStream> {
        listener.accept().map(|(stream, _)| stream)
    }

    fn connect(place: &Path, patience: Duration) -> io::Result<(TcpStream, Token)> {
        let text = std::fs::read_to_string(place)?;
        let (port, token): (u16, Token) = ron::from_str(&text).map_err(io::Error::other)?;
        Ok((TcpStream::connect_timeout(&(Ipv4Addr::LOCALHOST, port).into(), patience)?, token))
    }
}

#[cfg(any(not(unix), test))]
impl Wire for TcpStream {
    fn limit(&self, time: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(time))?;
        self.set_write_timeout(Some(time))
    }
}
