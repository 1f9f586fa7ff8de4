//! What several test programs share.

#![allow(dead_code, unused_imports, reason = "each program uses a part of it")]

mod eclipse;
pub mod fault_server;
mod files;
mod gas;
pub mod golden;
pub mod hdf5;
pub mod page_checksums;
mod pages;
mod program;
mod random;
mod told;

pub use eclipse::eclipse;
pub use files::{demo, gzip, in_reference_data, in_repository, keep_demo_pages, kept_page_file};
pub use gas::{dataset_of, gas};
pub use pages::{
    Built, built, built_from, built_from_dataset, built_plainly, core, draw_nodes, draw_pages, draw_source,
    paint_pages, sum_nodes, view_from, view_of, whole, write_box, write_demo_pages,
};
#[cfg(target_os = "linux")]
pub use program::peak_memory;
pub use program::{alone, error, json, ok, program, run, text};
pub use random::Random;
pub use told::Told;
