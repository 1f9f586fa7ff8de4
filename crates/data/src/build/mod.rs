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
mod error;
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
mod options;
mod partition;
mod process;
mod reach;
mod run;
mod selection;
mod shuffle;
mod spill;
mod states;
mod survey;
mod track_leaves;
mod track_nodes;
mod track_options;
mod tracks;
mod tree;

use crate::hierarchy::attribute_info::set_units;
use crate::hierarchy::kind::PCA;
use crate::hierarchy::octree::Context;
use crate::import::{ImportError, LoadOptions, Source, SourceStream, Streams, open_with, streams};
use crate::model::progress::Progress;
use crate::model::{Dataset, FamilyStream, Kernel, ParticleStream};
use crate::store::paging::write_trees;
use crate::store::writer::CompletePageFile;
use crate::store::{FamilyMetadata, Metadata, PageFileWriter};
pub use against_sources::compare_with_sources;
pub use error::BuildError;
use family::{Outline, Summary};
pub use flow::FlowOptions;
use memory::Memory;
pub use memory::default_memory;
pub use options::{BuildOptions, FEW_PARTICLES};
use partition::Partition;
use process::{alone, in_pool, pool, remove_left};
pub use run::{BuiltRun, RunBuild, StepProgress, StillOf};
pub use selection::DEFAULT_ATTRIBUTES;
use selection::{kept, selected_families};
use spill::Spill;
use std::path::Path;
use survey::Survey;
pub use track_options::{Matching, TrackOptions};
use tree::Grower;

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
        // A source of text has been read by now, which asks nobody.
        progress.go_on();
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
        let (mut partition, mut histograms) =
            Partition::of(stream, &outline.survey, &outline.plan, root, (particles, memory.waiting), progress)?;
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
        // 2 MB for each column, which nothing else asks for.
        drop(outline.survey.take_samples());
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
        let summary = Summary::of(coded, options);
        self.families.push(outline.metadata(&histograms, summary, written, options)?);
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
