//! A server and those at the other end of it, over the loopback.

pub mod client;
mod files;
mod view;
