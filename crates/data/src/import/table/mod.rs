//! Tables and catalogues: a row per particle or star. Text is parsed in one pass into numbers, which are kept in memory or a temporary
//! file; rows of FITS, HDF5 and Parquet files are read in place. Neither is ever held.

mod ascii;
mod catalogue;
mod columns;
mod csv;
mod ecsv;
mod ecsv_header;
mod fits;
mod geojson;
mod hdf5;
mod hdf5_records;
mod ids;
mod joined;
mod kstars;
mod masked;
mod parquet;
mod parts;
mod pickled;
mod records;
mod separated;
mod sky;
mod store;
mod text;
mod votable;

pub(super) use ascii::Ascii;
pub(super) use csv::Csv;
pub(super) use ecsv::Ecsv;
pub(super) use fits::FitsTable;
pub(super) use geojson::GeoJson;
pub(super) use hdf5::{are_columns, in_root};
pub(super) use hdf5_records::in_records;
pub(super) use kstars::KStars;
pub(super) use parquet::{Hats, Parquet, catalogue_in, is_partitioned};
pub(super) use parts::{Parts, same_columns};
pub(super) use text::head as text_head;
pub(super) use votable::VoTable;

use super::FieldKind;

/// Standard name, kind and unit of the columns that have one, by name in lower case.
pub(super) const STANDARD: &[(&[&str], &str, FieldKind, &str)] = &[
    (&["mass", "m", "masses"], "mass", FieldKind::Mass, ""),
    (&["h", "hsml", "smoothing_length", "smoothinglength"], "smoothing-length", FieldKind::SmoothingLength, ""),
    (&["rho", "density"], "density", FieldKind::Density, ""),
    (&["id", "particle_id", "ids", "source_id", "objid", "object_id", "objectid"], "id", FieldKind::Id, ""),
    (&["mag", "vmag", "magnitude", "phot_g_mean_mag"], "magnitude", FieldKind::Other, "mag"),
    (&["ci", "bv", "b_v", "color_index", "bp_rp"], "color-index", FieldKind::Other, "mag"),
    (&["absmag", "absolute_magnitude"], "absolute-magnitude", FieldKind::Other, "mag"),
    (&["lum", "luminosity"], "luminosity", FieldKind::Other, ""),
    (&["temperature", "temp", "teff"], "temperature", FieldKind::Other, "K"),
    (&["u", "internal_energy"], "internal-energy", FieldKind::Other, ""),
    (&["velocity_dispersion"], "velocity-dispersion", FieldKind::Other, ""),
    (&["metallicity"], "metallicity", FieldKind::Other, ""),
    (&["parallax", "plx"], "parallax", FieldKind::Other, "mas"),
];
