//! Looking closer: regions, probes, selections, ids and exports, against brute force and against independent readers.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

#[path = "../support/cases.rs"]
mod cases;
mod commands;
mod export;
mod hostile;
mod marks;
mod parquet;
mod probes;
mod reference;
mod selections;
mod support;
