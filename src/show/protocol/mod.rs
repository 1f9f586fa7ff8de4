//! One leads, others follow: the picture's camera, time and settings over a network, for several machines or processes that show
//! one thing together.
//!
//! Everything goes over UDP, encrypted and authenticated with a key that all machines of a show have ([`key`]): a packet that was
//! not made with it, is damaged or comes a second time is dropped before anything is read in it ([`transport`]). What was made with
//! the key is checked all the same, field by field, before it changes anything ([`message`]). A [`Leader`] sends; a [`Follower`]
//! receives, reports how it is, and comes back by itself when it has lost the leader. Neither waits for the other, neither blocks:
//! both are asked once a frame.

pub mod follower;
pub mod key;
pub mod leader;
pub mod message;

mod transport;

pub use follower::{Follower, FollowerEvent};
pub use key::{KeyError, ShowKey};
pub use leader::{FollowerInfo, Leader, LeaderEvent};
pub use message::{Frame, MessageError, Ranges, Report, RunTime, Severity, TourTime};

use std::net::{SocketAddr, ToSocketAddrs};

/// The port of a show where none is named.
pub const DEFAULT_PORT: u16 = 47_800;

/// Followers of a leader at most.
pub const MOST_FOLLOWERS: usize = 64;

/// Why there is no show.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// The leader's port cannot be had.
    #[error("{address}: the show cannot be led from there: {source}")]
    Bind {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// An address that is none.
    #[error("{text}: expected ADDRESS:PORT, as in 192.168.0.10:{DEFAULT_PORT}{why}")]
    Address {
        /// What was named.
        text: String,
        /// What the system says, after a colon.
        why: String,
    },
}

/// The address that a user names: `ADDRESS:PORT`, or only an address for [`DEFAULT_PORT`]. Names of machines are looked up.
///
/// # Errors
/// [`NetworkError::Address`].
pub fn address(text: &str) -> Result<SocketAddr, NetworkError> {
    if let Ok(address) = text.parse() {
        return Ok(address);
    }
    if let Ok(ip) = text.parse() {
        return Ok(SocketAddr::new(ip, DEFAULT_PORT));
    }
    let named = if text.contains(':') { text.to_socket_addrs() } else { (text, DEFAULT_PORT).to_socket_addrs() };
    let refuse = |why: String| NetworkError::Address { text: text.to_owned(), why };
    let mut found = named.map_err(|error| refuse(format!(": {error}")))?;
    found.next().ok_or_else(|| refuse(String::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_with_and_without_a_port() {
        assert_eq!(address("10.0.0.7:99").unwrap().to_string(), "10.0.0.7:99");
        assert_eq!(address("10.0.0.7").unwrap().port(), DEFAULT_PORT);
        assert_eq!(address("[::1]:5").unwrap().port(), 5);
        assert_eq!(address("::1").unwrap().to_string(), format!("[::1]:{DEFAULT_PORT}"));
        for wrong in ["", "1.2.3.4:", "1.2.3.4:99999", "data.hdf5/x:1", "a:b:c"] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }
}
