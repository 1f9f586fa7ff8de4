//! The first pass over a family: its box, what its columns hold, and a sample by which to plan.

use super::BuildError;
use super::found::Seen;
use crate::codec::scaling::ColumnScaling;
use crate::codec::{AttributeMerge, Scaling};
use crate::hierarchy::RootCell;
use crate::hierarchy::attribute_info::{Range, missing_replaced};
use crate::hierarchy::octree::{Columns, OctreeOptions, Place};
use crate::model::portable::{expect, portable};
use crate::model::progress::Progress;
use crate::model::{Bounds, Chunk, FamilyName, ParticleStream};
use rayon::prelude::*;

/// Particles of which columns are sampled at most, about, and positions at least.
const SAMPLE: u64 = 1 << 19;
/// Sampled positions for each bucket at least: the sizes of buckets scatter by an eighth then.
const BUCKET_SAMPLE: u64 = 64;
/// Sampled positions at most, of 24 bytes each: enough for 10^12 particles.
const MOST_POSITIONS: u64 = 1 << 26;
/// Chunks whose sums are added up by themselves, before they are added to those of other blocks, whoever does that.
pub(super) const BLOCK: usize = 1024;

/// Of how many particles one is sampled.
#[derive(Clone, Copy)]
struct Strides {
    positions: u64,
    columns: u64,
}

impl Strides {
    fn of(particles: u64, options: &OctreeOptions) -> Strides {
        let buckets = particles / options.bucket_size(particles).max(1) as u64;
        let positions = buckets.saturating_mul(BUCKET_SAMPLE).clamp(SAMPLE, MOST_POSITIONS);
        let [positions, columns] = [positions, SAMPLE].map(|sample| particles.div_ceil(sample).max(1));
        Strides { positions, columns }
    }
}

/// What the first pass has seen.
pub(super) struct Survey {
    /// Particles.
    pub count: u64,
    /// The box around their positions.
    pub bounds: Bounds,
    /// Of mass, density, smoothing length and each attribute.
    pub ranges: Vec<Range>,
    /// Sum of the chunks' checksums: whoever reads them again finds the same, unless the source has changed.
    pub checksum: u64,
    /// Source particles for each sampled position.
    pub weight: f64,
    positions: Vec<[f64; 3]>,
    columns: Columns,
}

portable!(Survey { count, bounds, ranges, checksum, weight, positions, columns });

impl Survey {
    /// Reads the whole family. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// When it cannot be read, or a column breaks its promise.
    pub fn of(
        stream: &dyn ParticleStream,
        options: &OctreeOptions,
        progress: &dyn Progress,
    ) -> Result<Survey, BuildError> {
        let parts = Survey::parts(stream, options, 0..stream.chunks(), progress)?;
        Ok(Survey::joined(stream, options, [parts]))
    }

    /// Reads some chunks: surveys of the blocks that they are, each with its first chunk, and of single chunks of others.
    ///
    /// # Errors
    /// As [`Survey::of`].
    pub fn parts(
        stream: &dyn ParticleStream,
        options: &OctreeOptions,
        chunks: std::ops::Range<usize>,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, Survey)>, BuildError> {
        let strides = Strides::of(stream.particles(), options);
        let share = chunks.len() as f64 / stream.chunks().max(1) as f64;
        progress.begin(&format!("looking through {}", stream.family()), (stream.particles() as f64 * share) as u64);
        let mut all = Vec::new();
        let mut first = chunks.start;
        while first < chunks.end {
            let block = first / BLOCK * BLOCK..stream.chunks().min((first / BLOCK + 1) * BLOCK);
            let own = first..chunks.end.min(block.end);
            let parts: Vec<Survey> = own
                .clone()
                .into_par_iter()
                .map_init(Chunk::default, |chunk, number| {
                    stream.read(number, chunk)?;
                    check(stream, chunk)?;
                    progress.advance(chunk.positions.len() as u64);
                    Ok(Survey::of_chunk(chunk, number, strides))
                })
                .collect::<Result<_, BuildError>>()?;
            first = own.end;
            match own == block {
                true => all.push((own.start, Survey::sum(stream, options, parts))),
                false => all.extend(own.zip(parts)),
            }
        }
        Ok(all)
    }

    /// Bytes that the surveys of the parts of a family with so many columns take at most, about, and the sampled columns of all once more.
    pub fn bytes_of_parts(stream: &dyn ParticleStream, columns: usize, options: &OctreeOptions) -> u64 {
        let (particles, chunks) = (stream.particles(), stream.chunks() as u64);
        let Strides { positions, columns: stride } = Strides::of(particles, options);
        let (position, column) = (size_of::<[f64; 3]>() as u64, size_of::<f32>() as u64 * (3 + columns as u64));
        let sampled = |stride: u64| particles / stride + chunks;
        // Where tasks end within blocks each chunk has numbers of its own.
        let numbers = 136 + (3 + columns as u64) * size_of::<Range>() as u64;
        let parts = [(position, sampled(positions)), (2 * column, sampled(stride)), (numbers, chunks)];
        parts.into_iter().fold(0, |bytes: u64, (each, count)| bytes.saturating_add(each.saturating_mul(count)))
    }

    /// The survey of a family of which all chunks have been surveyed, in their order.
    pub fn joined(
        stream: &dyn ParticleStream,
        options: &OctreeOptions,
        parts: impl IntoIterator<Item = Vec<(usize, Survey)>>,
    ) -> Survey {
        let mut blocks: Vec<(usize, Vec<Survey>)> = Vec::new();
        for (chunk, part) in parts.into_iter().flatten() {
            match blocks.last_mut() {
                Some((block, parts)) if *block == chunk / BLOCK => parts.push(part),
                _ => blocks.push((chunk / BLOCK, vec![part])),
            }
        }
        let block = |(_, parts): (usize, Vec<Survey>)| Survey::sum(stream, options, parts);
        Survey::sum(stream, options, blocks.into_iter().map(block))
    }

    /// Surveys that follow each other as one.
    fn sum(stream: &dyn ParticleStream, options: &OctreeOptions, parts: impl IntoIterator<Item = Survey>) -> Survey {
        let attributes = stream.columns();
        let nothing = Survey {
            count: 0,
            bounds: Bounds::EMPTY,
            ranges: vec![Range::EMPTY; 3 + attributes],
            checksum: 0,
            weight: Strides::of(stream.particles(), options).positions as f64,
            positions: Vec::new(),
            columns: Columns::with_capacity(attributes, 0),
        };
        parts.into_iter().fold(nothing, Survey::with)
    }

    fn of_chunk(chunk: &Chunk, number: usize, strides: Strides) -> Survey {
        let len = chunk.positions.len() as u64;
        // One particle of each `stride`, not always the same one: sources are often ordered like a lattice.
        let picked = |stride: u64| {
            (0..len.div_ceil(stride))
                .map(move |window| {
                    window * stride + ((number as u64) << 32 | window).wrapping_mul(0x9e37_79b9_7f4a_7c15) % stride
                })
                .filter(move |&i| i < len)
                .map(|i| i as usize)
        };
        let gather = |column: &Vec<f32>| picked(strides.columns).map(|i| column[i]).collect();
        let quantities = [&chunk.mass, &chunk.density, &chunk.smoothing_length];
        Survey {
            count: len,
            bounds: Bounds::of(chunk.positions.iter().copied()),
            ranges: quantities.into_iter().chain(&chunk.attributes).map(|column| Range::of(column)).collect(),
            checksum: chunk.checksum(number),
            weight: 1.0,
            positions: picked(strides.positions).map(|i| chunk.positions[i]).collect(),
            columns: Columns {
                mass: gather(&chunk.mass),
                density: gather(&chunk.density),
                smoothing_length: gather(&chunk.smoothing_length),
                attributes: chunk.attributes.iter().map(gather).collect(),
            },
        }
    }

    fn with(mut self, mut next: Survey) -> Survey {
        self.count += next.count;
        self.bounds = self.bounds.union(next.bounds);
        self.checksum = self.checksum.wrapping_add(next.checksum);
        self.ranges.iter_mut().zip(next.ranges).for_each(|(own, next)| *own = own.with(next));
        append(&mut self.positions, next.positions);
        let columns = self.columns.iter_mut().zip(next.columns.iter_mut());
        columns.for_each(|(own, next)| append(own, std::mem::take(next)));
        self
    }

    /// The root cell.
    pub fn root(&self, options: &OctreeOptions) -> RootCell {
        let smoothing_length = self.ranges[2].max;
        // Without smoothing lengths there is no length that matters but the extent of the positions.
        options.root_cell(self.count, self.bounds, if smoothing_length > 0.0 { 2.0 * smoothing_length } else { 1.0 })
    }

    /// Whether it has so many columns, with a value for each particle; else what was found and expected.
    pub fn check(&self, columns: usize) -> Result<(), String> {
        expect("columns", self.ranges.len(), columns)?;
        self.ranges.iter().try_for_each(|range| expect("values of a column", range.values(), self.count))
    }

    /// Whether densities or smoothing lengths have to be estimated.
    pub fn is_lacking(&self) -> bool {
        self.ranges[1..3].iter().any(|range| range.missing > 0)
    }

    /// Takes note of estimated densities and smoothing lengths.
    pub fn estimated(&mut self, found: Seen) {
        self.ranges.splice(1..3, found.ranges);
        let mut samples = found.samples.into_iter();
        (self.columns.density, self.columns.smoothing_length) =
            (samples.next().unwrap_or_default(), samples.next().unwrap_or_default());
    }

    /// Puts derived attributes in front of the `own` ones, and forgets the columns that they were derived from.
    pub fn derived(&mut self, own: usize, found: Seen) {
        self.ranges.truncate(3 + own);
        self.ranges.splice(3..3, found.ranges);
        self.columns.attributes.truncate(own);
        self.columns.attributes.splice(0..0, found.samples);
    }

    /// Takes the sampled columns out, which few need who need the rest.
    pub fn take_samples(&mut self) -> Columns {
        std::mem::take(&mut self.columns)
    }

    /// Puts them back.
    pub fn put_samples(&mut self, columns: Columns) {
        self.columns = columns;
    }

    /// Morton keys of the sampled positions, sorted; the positions are forgotten.
    pub fn take_keys(&mut self, root: RootCell) -> Vec<u64> {
        let positions = std::mem::take(&mut self.positions);
        let mut keys: Vec<u64> = positions.into_par_iter().map(|position| Place::of(position, root).key).collect();
        keys.par_sort_unstable();
        keys
    }

    /// How the quantiser scales the columns. Attributes are named as in the stream.
    pub fn scaling<'a>(&mut self, names: impl Iterator<Item = &'a str>) -> Scaling {
        let columns = &mut self.columns;
        for (column, range) in columns.attributes.iter_mut().zip(&self.ranges[3..]) {
            missing_replaced(column, range.mean() as f32);
        }
        let mut quantities =
            [&columns.mass, &columns.density, &columns.smoothing_length].map(|values| ColumnScaling::positive(values));
        quantities.iter_mut().zip(WEIGHTS).for_each(|(scaling, weight)| *scaling = scaling.weighted(weight));
        let weights = std::iter::once(FIRST_ATTRIBUTE_WEIGHT).chain(std::iter::repeat(ATTRIBUTE_WEIGHT));
        let attributes = columns.attributes.iter().zip(&self.ranges[3..]).zip(names).zip(weights);
        Scaling {
            quantities,
            attributes: attributes
                .map(|(((values, range), name), weight)| {
                    let merge = AttributeMerge::of(name);
                    // Magnitudes are logarithms, and in `points` they are the brightness.
                    let is_magnitude = merge == AttributeMerge::Magnitude;
                    let ends = (range.min as f32, range.max as f32);
                    let scaling = ColumnScaling::attribute(values, ends, is_magnitude);
                    (scaling.weighted(if is_magnitude { 1.0 } else { weight }), merge)
                })
                .collect(),
        }
    }
}

/// How much an error counts to the quantiser, in octaves. A splat's brightness is `m rho / h^2`, so that an error of `h`
/// counts twice; the first attribute is the one that is shown by default, as hue, and its weight was tuned to the mean
/// colour error of F12 4.10.2 on one dark-matter box, where equal weights miss the bound. The other attributes are seen
/// only when asked for.
const WEIGHTS: [f32; 3] = [1.0, 1.0, 2.0];
const FIRST_ATTRIBUTE_WEIGHT: f32 = 2.0;
const ATTRIBUTE_WEIGHT: f32 = 0.5;

/// What every chunk promises: columns of one length, finite positions, positive quantities.
fn check(stream: &dyn ParticleStream, chunk: &Chunk) -> Result<(), BuildError> {
    let count = chunk.positions.len();
    let error = |field: &str, expected: &'static str| column_error(stream.family(), field, expected);
    let may_lack = stream.neighbours().is_some();
    let columns = [
        ("mass", &chunk.mass, false),
        ("density", &chunk.density, may_lack),
        ("smoothing-length", &chunk.smoothing_length, may_lack),
    ];
    for (field, values, may_lack) in columns {
        let is_sound = |v: f32| v > 0.0 && v.is_finite() || may_lack && v.is_nan();
        if values.len() != count || !values.iter().all(|&v| is_sound(v)) {
            return Err(error(field, "a positive value for each particle"));
        }
    }
    for ((field, _), values) in stream.attributes().iter().zip(&chunk.attributes) {
        if values.len() != count {
            return Err(error(field, "a value for each particle"));
        }
    }
    if !chunk.positions.iter().flatten().all(|v| v.is_finite() && v.abs() < 1e150) {
        return Err(error("position", "coordinates between -1e150 and 1e150"));
    }
    Ok(())
}

/// Puts values behind others; the first ones are not copied, as there may be many and no others.
fn append<T>(own: &mut Vec<T>, next: Vec<T>) {
    if own.is_empty() {
        *own = next;
    } else {
        own.extend(next);
    }
}

/// A family's column that is not what it should be.
pub(super) fn column_error(family: FamilyName, field: &str, expected: &'static str) -> BuildError {
    BuildError::Column { family, field: field.to_owned(), expected }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::partition::Partition;
    use crate::build::spill::Spill;
    use crate::hierarchy::octree::Plan;
    use crate::model::portable::Portable;
    use crate::model::{ReadMethod, StreamError, Unit};
    use proptest::prelude::*;

    /// Chunks of one particle, with these masses.
    struct Masses(Vec<f32>);

    impl ParticleStream for Masses {
        fn family(&self) -> FamilyName {
            FamilyName::Gas
        }

        fn attributes(&self) -> &[(String, Unit)] {
            &[]
        }

        fn particles(&self) -> u64 {
            self.0.len() as u64
        }

        fn chunks(&self) -> usize {
            self.0.len()
        }

        fn read(&self, number: usize, into: &mut Chunk) -> Result<(), StreamError> {
            *into = Chunk {
                positions: vec![[number as f64; 3]],
                mass: vec![self.0[number]],
                density: vec![1.0],
                smoothing_length: vec![1.0],
                attributes: Vec::new(),
            };
            Ok(())
        }
    }

    proptest! {
        #![proptest_config(crate::cases::cases(8))]

        /// Blocks can be surveyed by anybody: their sums are those of families of their own, and the order of blocks is all that counts.
        #[test]
        fn sums_are_those_of_blocks(exponents in prop::collection::vec(-60.0..60.0_f32, 2000..3000)) {
            // So different that the order of a sum tells on its last bits.
            let masses: Vec<f32> = exponents.iter().map(|exponent| exponent.exp2()).collect();
            let survey = |masses: &[f32]| Survey::of(&Masses(masses.to_vec()), &OctreeOptions::default(), &()).unwrap();
            let all = survey(&masses);
            let blocks = masses.chunks(BLOCK).map(|block| survey(block).ranges[0]);
            prop_assert_eq!(all.ranges[0], blocks.fold(Range::EMPTY, Range::with));
            prop_assert_eq!((all.count, all.positions.len()), (masses.len() as u64, masses.len()));
        }

        /// However the chunks are cut into input blocks.
        #[test]
        fn parts_make_the_survey(
            exponents in prop::collection::vec(-60.0..60.0_f32, 1000..3000),
            cuts in prop::collection::vec(0..3000_usize, 0..5),
        ) {
            let stream = Masses(exponents.iter().map(|exponent| exponent.exp2()).collect());
            let options = OctreeOptions::default();
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(stream.chunks())).collect();
            cuts.extend([0, stream.chunks()]);
            cuts.sort_unstable();
            let part = |cut: &[usize]| Survey::parts(&stream, &options, cut[0]..cut[1], &()).unwrap();
            let parts = cuts.windows(2).map(|cut| Vec::<(usize, Survey)>::of_bytes(&part(cut).bytes()).unwrap());
            let joined = Survey::joined(&stream, &options, parts);
            prop_assert_eq!(joined.bytes(), Survey::of(&stream, &options, &()).unwrap().bytes());
        }

        #[test]
        fn every_bucket_has_enough_of_the_sample(octaves in 0.0..40.0_f64) {
            let particles = octaves.exp2() as u64;
            let options = OctreeOptions::default();
            let strides = Strides::of(particles, &options);
            let [positions, columns] = [strides.positions, strides.columns].map(|stride| particles / stride);
            let wanted = BUCKET_SAMPLE * particles / options.bucket_size(particles) as u64;
            prop_assert!(positions == particles || 2 * positions >= wanted);
            prop_assert!(positions <= MOST_POSITIONS && columns <= SAMPLE);
            // Up to 2^33 particles both are the same ones.
            prop_assert!(octaves > 33.0 || positions == columns);
        }
    }

    /// As where a file is written again while it is read.
    #[test]
    fn particles_that_have_changed_since_they_were_surveyed_are_told() {
        let options = OctreeOptions::default();
        let mut survey = Survey::of(&Masses(vec![1.0, 2.0, 3.0]), &options, &()).unwrap();
        let root = survey.root(&options);
        let plan = Plan::new(&survey.take_keys(root), survey.weight, 10);
        let folder = tempfile::tempdir().unwrap();
        let partition = |masses: [f32; 3]| {
            let spill = Spill::new(&folder.path().join("out"), folder.path(), 1 << 20, ReadMethod::default());
            Partition::of(&Masses(masses.into()), &survey, &plan, root, (spill, 1 << 20), &()).map(drop)
        };
        assert!(partition([1.0, 2.0, 3.0]).is_ok());
        // One has another mass, and two have each other's.
        for changed in [[1.0, 2.0, 4.0], [2.0, 1.0, 3.0]] {
            assert!(matches!(partition(changed), Err(BuildError::Changed { family: FamilyName::Gas })), "{changed:?}");
        }
    }
}
