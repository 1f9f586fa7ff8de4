//! How a server serves, and why it does not.

use super::{Certificate, Token};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// How a server serves.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Where it listens; port 0 is any that is free.
    pub listen: SocketAddr,
    /// The secret that readers have to know.
    pub token: Option<Token>,
    /// TLS, where there is a certificate.
    pub certificate: Option<Certificate>,
    /// Whether others than this machine may read without a token and without TLS, also through another server of it.
    pub is_insecure: bool,
    /// The other sites whose scripts may read: one, or `*` for all; none where nothing is said.
    pub allow_origin: Option<String>,
    /// Connections at a time; more wait.
    pub connections: usize,
    /// How long the head of a request may take, and nothing of an answer be taken.
    pub patience: Duration,
}

impl Default for ServeOptions {
    fn default() -> ServeOptions {
        ServeOptions {
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            token: None,
            certificate: None,
            is_insecure: false,
            allow_origin: None,
            connections: 256,
            patience: Duration::from_secs(20),
        }
    }
}

impl ServeOptions {
    /// Refuses to let others read what was not meant for them.
    ///
    /// # Errors
    /// A sentence that names the options.
    pub fn check(&self) -> Result<(), ServeError> {
        let address = self.listen;
        let without = match (&self.token, &self.certificate) {
            _ if address.ip().is_loopback() || self.is_insecure => None,
            (Some(_), Some(_)) => None,
            (None, Some(_)) => Some("a token"),
            (Some(_), None) => Some("TLS"),
            (None, None) => Some("a token and TLS"),
        };
        if let Some(without) = without {
            return Err(ServeError::Asked(format!(
                "--listen: found {address}, which others reach, without {without}, expected --token with --certificate \
                 and --key, or --insecure"
            )));
        }
        match &self.allow_origin {
            Some(origin) if origin.is_empty() || !origin.bytes().all(|byte| byte.is_ascii_graphic()) => {
                let expected = "* or an origin such as https://example.org";
                Err(ServeError::Asked(format!("--allow-origin: found {origin:?}, expected {expected}")))
            }
            _ => Ok(()),
        }
    }

    /// Whether this machine alone may read, and nothing but the name by which requests come keeps other sites' pages in its browsers away.
    pub(super) fn is_for_this_machine(&self) -> bool {
        self.token.is_none() && self.listen.ip().is_loopback() && !self.is_insecure
    }
}

/// Why nothing is served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// What is asked for makes no sense.
    #[error("{0}")]
    Asked(String),
    /// The data is not there, or cannot be read.
    #[error("{}: {source}", file.display())]
    File {
        /// The file or folder.
        file: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The certificate cannot be used.
    #[error("{}: {why}", file.display())]
    Certificate {
        /// The file.
        file: PathBuf,
        /// What was found.
        why: String,
    },
    /// The address cannot be had.
    #[error("--listen: {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// The system gives no threads.
    #[error("starting the server: {0}")]
    Start(std::io::Error),
}
