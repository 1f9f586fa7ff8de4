//! From particles to a page file: chooses families and attributes, builds a tree of each family and writes it.
//!
//! A family is read twice: once to look through it ([`survey`]), once to send each particle to its bucket ([`partition`]). The
//! buckets are built one by one ([`tree`]), the nodes coded ([`coding`]) and written. Whatever has to be kept in between is kept
//! in memory as far as [`BuildOptions::memory`] allows, and in temporary files beyond ([`spill`]); the output is the same.

mod against_sources;
pub mod cluster;
mod clusters;
mod coding;
mod column_error;
mod derive;
mod estimates;
mod family;
mod flow;
mod flow_levels;
mod flow_region;
mod flow_regions;
mod flow_sums;
mod found;
pub mod grid;
mod grid_shelf;
mod in_order;
mod left_out;
mod matching;
mod memory;
mod partition;
mod reach;
mod run;
mod shuffle;
mod spill;
mod states;
mod survey;
mod track_leaves;
mod track_nodes;
mod tracks;
mod tree;

use crate::codec::VqBits;
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::hierarchy::attribute_info::set_units;
use crate::hierarchy::kind::PCA;
use crate::hierarchy::octree::Context;
use crate::hierarchy::{ClusterOptions, Kinds, OctreeOptions};
use crate::import::{ImportError, LoadOptions, Source, SourceStream, Streams, open_with, streams};
use crate::model::progress::Progress;
use crate::model::{Dataset, Family, FamilyName, FamilyStream, Kernel, ParticleStream, ReadMethod, StreamError};
use crate::store::paging::{PAGE_BYTES, write_trees};
use crate::store::temporary::{clean, folder_of};
use crate::store::writer::CompletePageFile;
use crate::store::{FamilyMetadata, Metadata, PageFileWriter, StoreError};
pub use against_sources::compare_with_sources;
use cluster::PartError;
use family::Outline;
pub use flow::FlowOptions;
use memory::Memory;
pub use memory::default_memory;
use partition::Partition;
pub use run::{BuiltRun, RunBuild, StepProgress, StillOf};
use serde::{Deserialize, Serialize};
use spill::Spill;
use std::path::{Path, PathBuf};
use survey::Survey;
pub use tracks::{Matching, TrackOptions};
use tree::Grower;

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

/// As many particles as the largest codebook has entries.
pub const FEW_PARTICLES: u64 = 1 << 16;

/// What to build, and with what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildOptions {
    /// Families to keep; none named: all.
    pub families: Vec<FamilyName>,
    /// Attributes to keep, by name; `None`: the most useful ones that there are.
    pub attributes: Option<Vec<String>>,
    /// How the trees are built.
    pub octree: OctreeOptions,
    /// The kinds of hierarchies that are built.
    pub hierarchies: Kinds,
    /// How clusters are made, where they are.
    pub clusters: ClusterOptions,
    /// Source particles of all families from which on a file gets clusters, where [`BuildOptions::hierarchies`] has them beside others.
    pub clusters_from: u64,
    /// Source particles of all families below which indices have [`VqBits::Sixteen`] whatever [`OctreeOptions::vq_bits`] is: up to
    /// [`FEW_PARTICLES`] each has an entry of the codebook of its own.
    pub exact_below: u64,
    /// Bytes that a page aims at; only a page of a single node may be longer.
    pub page_bytes: usize,
    /// Bytes of memory that the build may take; `None`: half of what the machine has free.
    pub memory: Option<u64>,
    /// Folder for temporary files; `None`: that of the output.
    pub temporary: Option<PathBuf>,
    /// Threads; `None`: as many as the machine has. The file is the same for any number.
    pub threads: Option<usize>,
    /// How the source and temporary files are read. The file is the same for both.
    pub read: ReadMethod,
}

impl BuildOptions {
    /// The same for a source of so many particles.
    fn for_particles(&self, particles: u64) -> BuildOptions {
        let without: Kinds = Kinds::of(self.hierarchies.iter().filter(|kind| **kind != PCA));
        let is_small = particles < self.clusters_from && !without.is_empty();
        let hierarchies = if is_small { without } else { self.hierarchies };
        let vq_bits = if particles < self.exact_below { VqBits::Sixteen } else { self.octree.vq_bits };
        BuildOptions { hierarchies, octree: OctreeOptions { vq_bits, ..self.octree }, ..self.clone() }
    }
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            families: Vec::new(),
            attributes: None,
            octree: OctreeOptions::default(),
            hierarchies: Kinds::default(),
            clusters: ClusterOptions::default(),
            clusters_from: 0,
            exact_below: 0,
            page_bytes: PAGE_BYTES,
            memory: None,
            temporary: None,
            threads: None,
            read: ReadMethod::default(),
        }
    }
}

impl BuildOptions {
    /// The default options with this many bits for a codebook index.
    pub fn with_vq_bits(vq_bits: VqBits) -> BuildOptions {
        BuildOptions { octree: OctreeOptions { vq_bits, ..OctreeOptions::default() }, ..BuildOptions::default() }
    }

    /// What of the hierarchy differs from the defaults, for the file's provenance; `None`: nothing.
    fn hierarchy_note(&self) -> Option<String> {
        let (own, usual) = (&self.octree, OctreeOptions::default());
        let differing = [
            (self.page_bytes != PAGE_BYTES, format!("pages of {} bytes", self.page_bytes)),
            (own.leaf_capacity != usual.leaf_capacity, format!("leaves of {} particles", own.leaf_capacity)),
            (own.refined != usual.refined, "plain codes of leaves".to_owned()),
            (own.fusion != usual.fusion, format!("fusion within {} cells", own.fusion)),
            (own.thinning_budget != usual.thinning_budget, format!("thinning of {}", own.thinning_budget)),
            (own.relay_fraction != usual.relay_fraction, format!("relays from {}", own.relay_fraction)),
            (
                own.root_particles != usual.root_particles,
                format!("a larger root beyond {} particles", own.root_particles),
            ),
        ];
        let differing: Vec<_> = differing.into_iter().filter(|(differs, _)| *differs).map(|(_, what)| what).collect();
        (!differing.is_empty()).then(|| format!("built with {}", differing.join(", ")))
    }
}

/// What was built.
#[derive(Clone, Debug, PartialEq)]
pub struct Built {
    /// What the file's footer says.
    pub metadata: Metadata,
    /// Length of the file.
    pub bytes: u64,
    /// Most bytes that temporary files took.
    pub temporary_bytes: u64,
}

/// Why nothing was built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// The page file could not be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The source could not be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The particles could not be read.
    #[error(transparent)]
    Stream(StreamError),
    /// A column breaks its promise.
    #[error("{family}: {field}: expected {expected}")]
    Column {
        /// The family.
        family: FamilyName,
        /// The field that is wrong.
        field: String,
        /// What it should be.
        expected: &'static str,
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
    #[error(
        "{path}: {what} takes about {needed} MiB of memory, more than the {} MiB that the build may take",
        mebibytes(*allowed)
    )]
    Memory {
        /// The output.
        path: PathBuf,
        /// What needs it.
        what: String,
        /// Mebibytes needed.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// Temporary files would fill the disk.
    #[error(
        "{folder}: building {path} takes about {needed} MiB there for a while, and the disk has {free} MiB left; another folder can be \
         named with --temporary"
    )]
    Space {
        /// The output.
        path: PathBuf,
        /// The folder of temporary files.
        folder: PathBuf,
        /// Mebibytes needed.
        needed: u64,
        /// Mebibytes free.
        free: u64,
    },
    /// A job's folder, or a file in it, is not what it should be.
    #[error("{path}: {what}")]
    Job {
        /// The folder or file.
        path: PathBuf,
        /// What was found, and what was expected.
        what: String,
    },
    /// A temporary file could not be written or read.
    #[error("{folder}: temporary file: {source}")]
    Temporary {
        /// Its folder.
        folder: PathBuf,
        /// The system's answer.
        source: std::io::Error,
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

impl BuildError {
    fn temporary(spill: &Spill, source: std::io::Error) -> BuildError {
        BuildError::of_part(spill.folder(), source)
    }

    /// Of a file in a folder, which says itself what is wrong where it is a task's.
    fn of_part(folder: &Path, source: std::io::Error) -> BuildError {
        match source.downcast::<PartError>() {
            Ok(PartError { path, what }) => BuildError::Job { path, what },
            Err(source) => BuildError::Temporary { folder: folder.to_owned(), source },
        }
    }
}

/// Bytes as mebibytes in a message: whole ones, with two digits where they are few and none of the whole.
fn mebibytes(bytes: u64) -> String {
    match bytes {
        few if few < 10 << 20 && !few.is_multiple_of(1 << 20) => format!("{:.2}", few as f64 / f64::from(1 << 20)),
        many => (many >> 20).to_string(),
    }
}

impl From<StreamError> for BuildError {
    fn from(error: StreamError) -> BuildError {
        match error.downcast::<ImportError>() {
            Ok(import) => BuildError::Import(*import),
            Err(other) => BuildError::Stream(other),
        }
    }
}

/// Builds the page file `out` from the source at `path`, which is streamed: it may be larger than memory.
///
/// # Errors
/// When the source cannot be read or the page file not be written. Nothing is left behind then, and a file that was there before
/// stays as it was.
pub fn build_source(
    path: &Path,
    load_options: &LoadOptions,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    alone(options, out, || {
        let source = open_with(path, options.read)?;
        built_of(source.as_ref(), load_options, options, out, progress)?.named()
    })
}

/// [`build_source`] of an opened source.
///
/// # Errors
/// As [`build_source`].
pub fn build_opened(
    source: &dyn Source,
    load_options: &LoadOptions,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    alone(options, out, || built_of(source, load_options, options, out, progress)?.named())
}

/// The page file of a source, without a name; it lies in the folder of `out`.
fn built_of(
    source: &dyn Source,
    load_options: &LoadOptions,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Unnamed, BuildError> {
    let (streams, options) = streams_of(source, load_options, options)?;
    built_of_streams(&streams, &options, out, progress)
}

/// The page file of the families of a source, without a name.
fn built_of_streams(
    streams: &Streams,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Unnamed, BuildError> {
    let mut build = Build::new(options, streams.about.kernel, out, progress)?;
    for stream in &streams.families {
        build.family(stream)?;
    }
    build.finish(Dataset { skipped: SourceStream::skipped(&streams.families), ..streams.about.clone() })
}

/// The families of a source as they are built, and the options for so many particles.
fn streams_of<'a>(
    source: &'a dyn Source,
    load_options: &LoadOptions,
    options: &BuildOptions,
) -> Result<(Streams<'a>, BuildOptions), BuildError> {
    let streams = streams(source, load_options, &|names| kept(names, options, load_options))?;
    let particles = source.description().families.iter().map(|family| family.count).sum();
    Ok((streams, options.for_particles(particles)))
}

/// Builds the page file `out` from `dataset`, whose families are freed as they are used.
///
/// # Errors
/// When a column breaks its promise or the page file cannot be written. Nothing is left behind then, and a file that was there
/// before stays as it was.
pub fn build(
    dataset: Dataset,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    alone(options, out, || build_here(dataset, options, out, progress)?.named())
}

/// Has one process alone build the file `out`. What killed ones have left of it goes first: it may be what fills the disk.
fn alone<R: Send>(
    options: &BuildOptions,
    out: &Path,
    work: impl FnOnce() -> Result<R, BuildError> + Send,
) -> Result<R, BuildError> {
    remove_left(options, out);
    in_pool(options, work)
}

/// Removes what killed builds have left of the file `out`. Tasks of a job do not ask for that: several may be at work on the same file, and where
/// locks hold on one machine only, those on others do not look alive.
fn remove_left(options: &BuildOptions, out: &Path) {
    for folder in std::iter::once(folder_of(out)).chain(options.temporary.as_deref()) {
        clean(out, folder);
    }
}

fn in_pool<R: Send>(
    options: &BuildOptions,
    work: impl FnOnce() -> Result<R, BuildError> + Send,
) -> Result<R, BuildError> {
    match options.threads {
        None => work(),
        Some(threads) => pool(threads)?.install(work),
    }
}

fn pool(threads: usize) -> Result<rayon::ThreadPool, BuildError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| BuildError::Threads { threads, reason: error.to_string() })
}

fn build_here(
    mut dataset: Dataset,
    options: &BuildOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Unnamed, BuildError> {
    let families = std::mem::take(&mut dataset.families);
    let families = selected_families(families, options, &dataset.provenance.path)?;
    let mut build = Build::new(options, dataset.kernel, out, progress)?;
    for family in families {
        let count = family.positions.len();
        let columns =
            [("mass", &family.mass), ("density", &family.density), ("smoothing-length", &family.smoothing_length)];
        let attributes = family.attributes.iter().map(|attribute| (attribute.name.as_str(), &attribute.values));
        if let Some((field, _)) = columns.into_iter().chain(attributes).find(|(_, values)| values.len() != count) {
            return Err(survey::column_error(family.name, field, "a value for each particle"));
        }
        build.family(&FamilyStream::new(&family))?;
    }
    build.finish(dataset)
}

/// A page file that has no name yet.
struct Unnamed {
    metadata: Metadata,
    file: CompletePageFile,
    temporary_bytes: u64,
}

impl Unnamed {
    /// Gives it its name.
    fn named(self) -> Result<Built, BuildError> {
        let Unnamed { metadata, file, temporary_bytes } = self;
        Ok(Built { metadata, bytes: file.persist()?, temporary_bytes })
    }
}

/// A page file that is being built, family by family.
struct Build<'a> {
    options: &'a BuildOptions,
    kernel: Kernel,
    out: &'a Path,
    progress: &'a dyn Progress,
    writer: PageFileWriter,
    families: Vec<FamilyMetadata>,
    notes: Vec<String>,
    temporary_bytes: u64,
}

impl<'a> Build<'a> {
    fn new(
        options: &'a BuildOptions,
        kernel: Kernel,
        out: &'a Path,
        progress: &'a dyn Progress,
    ) -> Result<Build<'a>, BuildError> {
        let writer = PageFileWriter::create(out)?;
        Ok(Build {
            options,
            kernel,
            out,
            progress,
            writer,
            families: Vec::new(),
            notes: Vec::new(),
            temporary_bytes: 0,
        })
    }

    fn family(&mut self, stream: &dyn ParticleStream) -> Result<(), BuildError> {
        let Build { options, out, progress, .. } = *self;
        let octree = &options.octree;
        let survey = Survey::of(stream, octree, progress)?;
        let Some(mut outline) = Outline::of(survey, stream, octree, out)? else { return Ok(()) };
        let (root, count) = (outline.root, outline.survey.count);
        let memory = Memory::plan(options, out, count, outline.most_columns(), outline.most, outline.plan.len())?;

        if memory.on_disk > 0 {
            let (family, size) = (stream.family(), memory.on_disk.div_ceil(1 << 20));
            progress.say(&format!("{family}: up to {size} MiB of temporary files in {}", memory.folder.display()));
        }
        let particles = Spill::new(out, &memory.folder, memory.particles, options.read);
        let extents = outline.has_neighbours();
        let (mut partition, mut histograms) =
            Partition::of(stream, &outline.survey.ranges, &outline.plan, root, extents, particles, progress)?;
        if let Some(estimating) = outline.estimating() {
            self.notes.extend(outline.note());
            let (found, counts) = estimating.estimate(&mut partition, memory.neighbour_block(), progress)?;
            histograms.splice(1..3, partition::histograms(&found.ranges, counts));
            outline.survey.estimated(found);
        }
        if let Some(derivation) = stream.derivation() {
            let deriving = outline.deriving(derivation, self.kernel);
            let (found, counts) = deriving.derive(&mut partition, memory.motion_block(), progress)?;
            histograms.truncate(3 + outline.own);
            histograms.splice(3..3, partition::histograms(&found.ranges, counts));
            outline.derived(found);
        }
        let scaling = outline.scaling();
        let (rules, octree) = (outline.rules(), outline.octree(octree));
        let context = Context { root, options: &octree, rules: &rules };

        let largest = (0..outline.plan.len()).map(|bucket| partition.len(bucket)).max().unwrap_or(0);
        let workers = memory.workers(largest, out)?;
        let nodes = Spill::new(out, &memory.folder, memory.nodes, options.read);
        let before = partition.on_disk();
        let (family, plan) = (stream.family(), &outline.plan);
        let grower = Grower { context: &context, family, plan, scaling: &scaling, spill: &nodes, progress };
        let built = grower.grow(&partition, 0..plan.len(), workers)?;
        drop(partition);
        let trees = grower.join(built)?;
        let clustering = options.hierarchies.has(&PCA).then_some((&context, options.clusters, self.kernel));
        let bits = octree.code_bits();
        let picture = outline.picture(self.kernel, bits);
        let coded = tree::code(family, trees, clustering, &scaling, picture, nodes, bits, progress)?;
        self.temporary_bytes = self.temporary_bytes.max(before + coded.on_disk());

        let sections =
            |levels, depth, index| coded.sections(levels, depth, index, bits).map_err(|error| coded.failed(error));
        let number = self.families.len() as u32;
        let others = family::others(&coded);
        let trees = family::trees(&coded, &others, options);
        let written = write_trees(&mut self.writer, number, trees, options.page_bytes, sections, progress)?;
        self.families.push(outline.metadata(&histograms, coded, written, options)?);
        Ok(())
    }

    /// Writes the footer.
    fn finish(self, about: Dataset) -> Result<Unnamed, BuildError> {
        let metadata = metadata(about, self.families, self.notes, self.options)?;
        let file = self.writer.complete(&metadata)?;
        Ok(Unnamed { metadata, file, temporary_bytes: self.temporary_bytes })
    }
}

/// What a file with these families says of them and of its source.
fn metadata(
    about: Dataset,
    mut families: Vec<FamilyMetadata>,
    notes: Vec<String>,
    options: &BuildOptions,
) -> Result<Metadata, BuildError> {
    if families.is_empty() {
        let field = "particles that can be drawn".into();
        return Err(ImportError::NoParticles { path: about.provenance.path, field }.into());
    }
    families.iter_mut().for_each(|family| set_units(&mut family.quantities, &about.mass_unit, &about.length_unit));
    let mut provenance = about.provenance;
    provenance.notes.extend(notes);
    provenance.notes.extend(options.hierarchy_note());
    Ok(Metadata {
        length_unit: about.length_unit,
        mass_unit: about.mass_unit,
        kernel: about.kernel,
        bits: options.octree.code_bits(),
        provenance,
        skipped: about.skipped,
        families,
    })
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
        let names: Vec<&str> = family.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        let order = chosen(&names, options);
        let mut attributes: Vec<_> = std::mem::take(&mut family.attributes).into_iter().map(Some).collect();
        family.attributes = order.into_iter().filter_map(|index| attributes[index].take()).collect();
    }
    Ok(families)
}

/// Which of a family's attributes are kept beside those that are derived, by index, in order.
fn kept(names: &[&str], options: &BuildOptions, load_options: &LoadOptions) -> Vec<usize> {
    let mut own = chosen(names, options);
    // What is derived is asked for; the most telling others fill the rest.
    if options.attributes.is_none() {
        own.truncate(DEFAULT_ATTRIBUTES.saturating_sub(load_options.derive.len()));
    }
    own
}

/// Which of a family's attributes are kept, by index, in order.
fn chosen(names: &[&str], options: &BuildOptions) -> Vec<usize> {
    let rank = |name: &str| match &options.attributes {
        Some(wanted) => wanted.iter().position(|wanted| wanted == name),
        None => Some(PREFERRED.iter().position(|&preferred| preferred == name).unwrap_or(PREFERRED.len())),
    };
    let mut order: Vec<(usize, usize)> =
        names.iter().enumerate().filter_map(|(index, name)| Some((rank(name)?, index))).collect();
    order.sort_unstable();
    if options.attributes.is_none() {
        order.truncate(DEFAULT_ATTRIBUTES);
    }
    order.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::mebibytes;

    #[test]
    fn little_memory_is_told_with_its_digits() {
        let told = [1_000_000, 1 << 20, 1_600_000, 512 << 20, (64 << 20) + 5].map(mebibytes);
        assert_eq!(told, ["0.95", "1", "1.53", "512", "64"]);
    }
}
