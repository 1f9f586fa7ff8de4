//! deepfield for Python: the native part of the package `deepfield`, over the one drawing path of files, tours and windows.
//!
//! What is asked comes as JSON and what is told goes back as JSON, so that it is described once, by the types that the program reads and
//! writes; arrays and callables alone cross over as objects of Python. Work is done away from the interpreter ([`work`]), by the processor
//! alone.

mod arrays;
mod arrow;
mod asked;
mod building;
mod cache;
mod catalogue;
mod cluster;
mod dataset;
mod error;
mod forks;
mod grids;
mod picture;
mod plots;
mod ron;
mod table;
mod tours;
mod work;

use pyo3::prelude::*;

/// The native part of deepfield.
#[pymodule]
mod _deepfield {
    #[pymodule_export]
    use crate::arrow::arrow_stream;
    #[pymodule_export]
    use crate::building::build_arrays;
    #[pymodule_export]
    use crate::building::build_files;
    #[pymodule_export]
    use crate::catalogue::catalogue;
    #[pymodule_export]
    use crate::cluster::cluster_plan;
    #[pymodule_export]
    use crate::cluster::cluster_remove;
    #[pymodule_export]
    use crate::cluster::cluster_run;
    #[pymodule_export]
    use crate::cluster::cluster_status;
    #[pymodule_export]
    use crate::dataset::Dataset;
    #[pymodule_export]
    use crate::dataset::open;
    #[pymodule_export]
    use crate::error::Error;
    #[pymodule_export]
    use crate::forks::after_fork_in_child;
    #[pymodule_export]
    use crate::forks::after_fork_in_parent;
    #[pymodule_export]
    use crate::forks::before_fork;
    #[pymodule_export]
    use crate::picture::Picture;
    #[pymodule_export]
    use crate::ron::bytes;
    #[pymodule_export]
    use crate::ron::color_map;
    #[pymodule_export]
    use crate::ron::color_maps;
    #[pymodule_export]
    use crate::ron::json_of;
    #[pymodule_export]
    use crate::ron::modes;
    #[pymodule_export]
    use crate::ron::ron_of;
    #[pymodule_export]
    use crate::ron::tour_around;
    #[pymodule_export]
    use crate::ron::transfer_function;
    #[pymodule_export]
    use crate::ron::transfer_functions;
    #[pymodule_export]
    use crate::work::wait_for_writers;
}
