//! From particles to a page file: chooses families and attributes, builds a tree of each family and writes it.

use crate::codec::VqBits;
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::hierarchy::{AttributeInfo, Octree, OctreeError, OctreeOptions};
use crate::import::{LoadOptions, load};
use crate::model::progress::Progress;
use crate::model::{Dataset, Family, FamilyName, Unit};
use crate::store::paging::write_tree;
use crate::store::{FamilyMetadata, Metadata, PageFileWriter, StoreError};
use std::path::{Path, PathBuf};

/// Attributes that are kept when the user names none: at most this many of [`PREFERRED`] and then of the others.
pub const DEFAULT_ATTRIBUTES: usize = 4;

/// Standard attributes, the most telling first.
const PREFERRED: [&str; 10] = [
    "velocity-dispersion",
    "temperature",
    "magnitude",
    "color-index",
    "internal-energy",
    "speed",
    "metallicity",
    "star-formation-rate",
    "age",
    "potential",
];

/// Imports `source` and builds `out` from it.
///
/// # Errors
/// When the source cannot be read or the page file not be written.
pub fn build_source(
    source: &Path,
    load_options: &LoadOptions,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, Box<dyn std::error::Error + Send + Sync>> {
    Ok(build(load(source, load_options, progress)?, options, out, progress)?)
}

/// What to build, and with what.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuildOptions {
    /// Families to keep; none named: all.
    pub families: Vec<FamilyName>,
    /// Attributes to keep, by name; `None`: the most useful ones that there are.
    pub attributes: Option<Vec<String>>,
    /// How the trees are built.
    pub octree: OctreeOptions,
    /// Bytes of memory that the build may take beside the dataset; `None`: as much as it needs.
    pub memory: Option<u64>,
    /// Threads; `None`: as many as the machine has. The file is the same for any number.
    pub threads: Option<usize>,
}

impl BuildOptions {
    /// The default options with this many bits for a codebook index.
    pub fn with_vq_bits(vq_bits: VqBits) -> BuildOptions {
        BuildOptions { octree: OctreeOptions { vq_bits, ..OctreeOptions::default() }, ..BuildOptions::default() }
    }
}

/// What was built.
#[derive(Clone, Debug, PartialEq)]
pub struct Built {
    /// What the file's footer says.
    pub metadata: Metadata,
    /// Length of the file.
    pub bytes: u64,
}

/// Why nothing was built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// The page file could not be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The source's columns break a promise.
    #[error("{path}: {error}")]
    Source {
        /// The source.
        path: PathBuf,
        /// What is wrong.
        error: OctreeError,
    },
    /// The source has no such family or attribute, or no particle.
    #[error("{path}: {what}")]
    Selection {
        /// The source.
        path: PathBuf,
        /// What was asked for, and what there is.
        what: String,
    },
    /// The build needs more memory than it may take.
    #[error("{path}: building needs about {needed} MiB beside the particles, more than the {allowed} MiB of --memory")]
    Memory {
        /// The source.
        path: PathBuf,
        /// Mebibytes needed.
        needed: u64,
        /// Mebibytes allowed.
        allowed: u64,
    },
    /// The thread pool could not be started.
    #[error("starting {threads} threads: {reason}")]
    Threads {
        /// How many.
        threads: usize,
        /// The system's answer.
        reason: String,
    },
}

/// Builds the page file `out` from `dataset`, whose columns are freed as they are used. On failure nothing is left
/// behind, and a file that was there before stays as it was.
pub fn build(
    dataset: Dataset,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    match options.threads {
        None => build_here(dataset, options, out, progress),
        Some(threads) => rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|error| BuildError::Threads { threads, reason: error.to_string() })?
            .install(|| build_here(dataset, options, out, progress)),
    }
}

fn build_here(
    dataset: Dataset,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    let path = dataset.provenance.path.clone();
    let families = selected_families(dataset.families, options, &path)?;
    if let Some(allowed) = options.memory {
        let needed = families.iter().map(memory_needed).max().unwrap_or(0);
        if needed > allowed {
            return Err(BuildError::Memory { path, needed: needed.div_ceil(1 << 20), allowed: allowed >> 20 });
        }
    }
    let mut writer = PageFileWriter::create(out)?;
    let mut built: Vec<FamilyMetadata> = Vec::with_capacity(families.len());
    let vq_bits = options.octree.vq_bits;
    for (number, family) in families.into_iter().enumerate() {
        let tree = Octree::build(family, &options.octree, progress)
            .map_err(|error| BuildError::Source { path: path.clone(), error })?;
        let mut metadata = write_tree(&mut writer, number as u32, &tree, vq_bits, progress)?;
        set_units(&mut metadata.quantities, &dataset.mass_unit, &dataset.length_unit);
        built.push(metadata);
    }
    let metadata = Metadata {
        length_unit: dataset.length_unit,
        mass_unit: dataset.mass_unit,
        kernel: dataset.kernel,
        vq_bits,
        provenance: dataset.provenance,
        skipped: dataset.skipped,
        families: built,
    };
    let bytes = writer.finish(&metadata)?;
    Ok(Built { metadata, bytes })
}

/// Keeps the families and attributes that were asked for.
fn selected_families(
    mut families: Vec<Family>,
    options: &BuildOptions,
    path: &Path,
) -> Result<Vec<Family>, BuildError> {
    let error = |what: String| BuildError::Selection { path: path.to_path_buf(), what };
    families.retain(|family| !family.is_empty());
    let there = families.iter().map(|family| family.name.as_str()).collect::<Vec<_>>().join(", ");
    for name in &options.families {
        if !families.iter().any(|family| family.name == *name) {
            return Err(error(format!("no particles of family {name}; there are {there}")));
        }
    }
    if !options.families.is_empty() {
        families.retain(|family| options.families.contains(&family.name));
    }
    if families.is_empty() {
        return Err(error("no particles".into()));
    }
    if let Some(wanted) = &options.attributes {
        if wanted.len() > MAX_ATTRIBUTES {
            return Err(error(format!("{} attributes asked for, at most {MAX_ATTRIBUTES} can be kept", wanted.len())));
        }
        for name in wanted {
            if families.iter().all(|family| family.attribute(name).is_none()) {
                let mut there: Vec<&str> =
                    families.iter().flat_map(|family| &family.attributes).map(|a| a.name.as_str()).collect();
                there.sort_unstable();
                there.dedup();
                return Err(error(format!("no attribute {name:?}; there are {}", there.join(", "))));
            }
        }
    }
    for family in &mut families {
        let rank = |name: &str| match &options.attributes {
            Some(wanted) => wanted.iter().position(|wanted| wanted == name),
            None => Some(PREFERRED.iter().position(|&preferred| preferred == name).unwrap_or(PREFERRED.len())),
        };
        family.attributes.retain(|attribute| rank(&attribute.name).is_some());
        family.attributes.sort_by_key(|attribute| rank(&attribute.name));
        if options.attributes.is_none() {
            family.attributes.truncate(DEFAULT_ATTRIBUTES);
        }
    }
    Ok(families)
}

/// Bytes that building a family takes at most beside its columns, roughly: keys and order while sorting, then the merged
/// particles of two depths and their codes.
fn memory_needed(family: &Family) -> u64 {
    let particle = 60 + 8 * family.attributes.len() as u64;
    family.len() as u64 * (16 + 2 * particle)
}

fn set_units(quantities: &mut [AttributeInfo; 3], mass: &Unit, length: &Unit) {
    let [mass_info, density_info, smoothing_info] = quantities;
    mass_info.unit = mass.clone();
    smoothing_info.unit = length.clone();
    density_info.unit = match (mass.is_unknown(), length.is_unknown()) {
        (true, true) => Unit::default(),
        _ => Unit::new(format!("({mass})/({length})^3")),
    };
}
