//! What needs no graphics adapter and no window: from files of many formats to page files and to pictures of the processor, by
//! the library and by the program.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../support/cases.rs"]
mod cases;
#[path = "../support/mod.rs"]
mod support;

mod import;
mod synth;

/// From particles to a page file and back.
mod page_file {
    mod clusters;
    mod damage;
    mod deep;
    mod promises;
}
mod derived;
mod estimated_plots;
mod out_of_core;

/// From source to picture, across the rooms: the screen-space guarantee, conservation, colour errors, golden images.
mod pictures {
    mod bloom;
    mod clusters;
    mod clusters_around;
    mod codes;
    mod color_error;
    mod conservation;
    mod cut;
    mod fields;
    mod golden;
    mod guarantee;
    mod heights;
    mod hue;
    mod joined;
    mod lod_budget;
    #[cfg(target_os = "linux")]
    mod memory;
    mod one_range;
    mod passes;
    mod paths;
    mod periodic;
    mod primitives;
    mod runs;
    mod session;
    mod slices;
    mod stand_in;
}
mod panoramas;
mod projections;
mod raster;
mod runs;
mod volume {
    mod fields;
    mod levels;
    mod occlusion;
    mod settings;
}

/// Pages that come while pictures are drawn.
mod stream {
    pub mod disk;
    mod faults;
    mod flight;
    mod height_faults;
    pub mod soak;
    mod trees;
}

/// Looking closer: regions, probes, selections, ids and exports, against brute force and against independent readers.
mod explore {
    mod commands;
    mod export;
    mod halo_catalogues;
    mod hostile;
    mod marks;
    mod merger_trees;
    mod particles;
    mod probes;
    mod reference;
    mod rows;
    mod selections;
    mod trees_of_finders;
}

mod cluster;
mod heights;
mod meshes;
mod network;
mod outputs;
#[cfg(target_os = "linux")]
mod packaging;
mod plots;
#[cfg(target_os = "linux")]
mod release;
#[cfg(feature = "remote")]
mod remote;
#[cfg(feature = "remote")]
mod serve;
#[cfg(unix)]
mod slurm;
mod tours;
mod tracked;
mod vector_fields;
