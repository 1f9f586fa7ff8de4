//! `deepfield serve`: files by HTTP, read-only, for those who read their pages from afar ([`files`]), or pictures of one file for
//! browsers ([`view`]). HTTP is RFC 9110, on connections of HTTP/1.1, with TLS where a certificate is given.

mod access;
mod answer;
mod conditions;
mod content;
mod files;
mod index;
mod options;
mod patience;
mod percent;
mod server;
mod tls;
mod version;
pub mod view;

pub use access::Token;
pub use files::Files;
pub use options::{ServeError, ServeOptions};
pub use server::{Offer, Running, Server};
pub use tls::Certificate;
