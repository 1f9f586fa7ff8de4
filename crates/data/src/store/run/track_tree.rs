//! The tracks of a run as a tree: what pictures between steps are drawn from. Its time is the clock's, and a node is there for one
//! interval.

use super::RunFile;
use super::kept::Kept;
use super::track_layout::FamilyTracks;
use super::tracks::{TrackIndex, TrackNode};
use crate::codec::{AttributeMerge, Codebook, CodebookScope, QuantityError};
use crate::hierarchy::spacetime::{Interpolation, Interval, Motion, Tracks};
use crate::hierarchy::{Encoding, Purpose};
use crate::model::{Bounds, Moment, Provenance, Unit};
use crate::store::content::{Content, Particles};
use crate::store::error::{Damage, StoreError};
use crate::store::metadata::{AttributeInfo, FamilyMetadata, Metadata};
use crate::store::page::{Branch, NODE_MEMORY, Node, NodeRef, Page, PageId};
use crate::store::page_file::PageBytes;
use crate::store::tree::Tree;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// Steps that are looked at for ranges of quantities at most.
const LOOKED_AT: usize = 9;

/// Intervals that are told of beforehand at most.
const MOST_NEXT: usize = 8;

/// Bytes of a page of a page file, about, and pages that are read for it at most.
const PAGE_BYTES: u64 = 1 << 20;
const MOST_AT_ONCE: u64 = 16;

/// A run's tracks, moved in one way.
#[derive(Debug)]
pub struct RunTree {
    run: Arc<RunFile>,
    metadata: Metadata,
    interpolation: Interpolation,
    /// The first page of each family in each interval, and the number of all pages.
    first: Vec<u32>,
    families: usize,
    indices: Kept<usize, TrackIndex>,
    rules: Vec<Arc<[AttributeMerge]>>,
}

impl RunTree {
    /// The tree of a run with tracks. Ranges of quantities are those of some of its steps together, so that they do not change while it
    /// plays.
    ///
    /// # Errors
    /// Where it has no tracks, or its stills cannot be read.
    pub fn new(run: Arc<RunFile>, interpolation: Interpolation) -> Result<RunTree, StoreError> {
        let layout = run.tracks()?;
        let (mut first, mut pages) = (vec![0], 0_u32);
        for found in run.directory().intervals.iter().flat_map(|interval| &interval.families) {
            let more = pages.checked_add(found.count);
            pages = more.ok_or_else(|| run.damaged("directory".into(), "fewer than 2^32 nodes of tracks"))?;
            first.push(pages);
        }
        let rules = layout.families.iter().map(|family| family.rules().into()).collect();
        let (families, metadata) = (layout.families.len(), metadata(&run)?);
        Ok(RunTree { run, metadata, interpolation, first, families, indices: Kept::default(), rules })
    }

    /// The run.
    pub fn run(&self) -> &Arc<RunFile> {
        &self.run
    }

    /// How particles move.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// The tree's time at a moment of the run.
    pub fn time(&self, moment: Moment) -> f64 {
        let clock = self.clock();
        let at = |step: usize| clock.get(step).or(clock.last()).copied().unwrap_or(0.0);
        at(moment.step) + moment.u * (at(moment.step + 1) - at(moment.step))
    }

    /// Times in the intervals that come next on the way from a time to another one, which may lie before it: the nearest first, and not
    /// more than a few.
    pub fn next_intervals(&self, from: f64, to: f64) -> Vec<f64> {
        let (here, clock) = (self.interval_at(from), self.clock());
        match to > from {
            true => {
                let begins = clock.iter().enumerate().skip(here + 1).take_while(|(_, begin)| **begin <= to);
                begins
                    .filter(|(number, begin)| self.interval_at(**begin) == *number)
                    .map(|(_, begin)| *begin)
                    .take(MOST_NEXT)
                    .collect()
            }
            false => {
                let ends = (1..=here).rev().take_while(|number| clock[*number] >= to);
                ends.map(|number| 0.5 * (clock[number] + clock[number - 1])).take(MOST_NEXT).collect()
            }
        }
    }

    fn clock(&self) -> &[f64] {
        self.run.directory().tracks.as_ref().map_or(&[], |layout| &layout.clock)
    }

    /// The interval that a time lies in.
    fn interval_at(&self, time: f64) -> usize {
        let intervals = self.run.directory().intervals.len();
        self.clock().partition_point(|begin| *begin <= time).saturating_sub(1).min(intervals.saturating_sub(1))
    }

    /// The number of a page's family among those of all intervals, and that of its node there.
    fn place(&self, page: PageId) -> Option<(usize, usize)> {
        let number = self.first.partition_point(|first| *first <= page.0) - 1;
        (page.0 < self.page_count()).then(|| (number, (page.0 - self.first[number]) as usize))
    }

    fn found(&self, number: usize) -> Option<&FamilyTracks> {
        let interval = self.run.directory().intervals.get(number / self.families)?;
        interval.families.get(number % self.families)
    }

    fn index(&self, number: usize) -> Result<Arc<TrackIndex>, StoreError> {
        self.indices.get(number, || self.run.track_index(number / self.families, number % self.families))
    }

    /// A node that its index has; `None` before that is read.
    fn known(&self, page: PageId) -> Option<(usize, TrackNode)> {
        let (number, node) = self.place(page)?;
        Some((number, self.indices.peek(&number)?.nodes.get(node)?.clone()))
    }

    fn node(&self, page: PageId) -> Result<(usize, Arc<TrackIndex>, usize), StoreError> {
        let absent = || {
            Damage::new(format!("page {}", page.0), format!("one of {}", self.page_count())).in_file(self.run.path())
        };
        let (number, node) = self.place(page).ok_or_else(absent)?;
        Ok((number, self.index(number)?, node))
    }

    /// When an interval is shown: before the first step the first one, after the last the last one.
    fn span(&self, interval: usize) -> [f64; 2] {
        let (clock, last) = (self.clock(), self.run.directory().intervals.len().saturating_sub(1));
        let begin = if interval == 0 { f64::NEG_INFINITY } else { clock[interval] };
        [begin, if interval == last { f64::INFINITY } else { clock[interval + 1] }]
    }
}

impl Tree for RunTree {
    fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn path(&self) -> &Path {
        self.run.path()
    }

    fn page_count(&self) -> u32 {
        self.first.last().copied().unwrap_or(0)
    }

    fn page_bytes(&self, page: PageId) -> u64 {
        let average = |found: &FamilyTracks| found.nodes.len / u64::from(found.count.max(1));
        match self.known(page) {
            Some((_, node)) => node.states.len.into(),
            None => self.place(page).and_then(|(number, _)| self.found(number)).map_or(0, average),
        }
    }

    fn page_memory(&self, page: PageId) -> u64 {
        let average = |found: &FamilyTracks| found.tracks / u64::from(found.count.max(1));
        let Some((number, _)) = self.place(page) else { return 0 };
        let tracks = match self.known(page) {
            Some((_, node)) => node.tracks.into(),
            None => self.found(number).map_or(0, average),
        };
        NODE_MEMORY + tracks * track_memory(self.rules[number % self.families].len())
    }

    fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
        let (number, index, node) = self.node(page)?;
        let (interval, family) = (number / self.families, number % self.families);
        Ok(PageBytes::new(page, self.run.fetch_node(interval, family, &index.nodes[node], false)?))
    }

    fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
        let page = bytes.page();
        let (number, index, own) = self.node(page)?;
        let (number, family) = (number / self.families, number % self.families);
        let about = &index.nodes[own];
        let tracks = self.run.decode_node(number, family, about, bytes.bytes())?;
        let space = self.run.interval(number)?;
        let layout = self.run.tracks()?;
        let interpolation = layout.families[family].moved(self.interpolation);
        let sums = |density: bool| {
            let of = |end: usize| {
                let own = &tracks.ends[end];
                let weight = |i: usize| tracks.flags[i].weights()[end] * f64::from(own.mass[i]);
                (0..tracks.len())
                    .map(|i| weight(i) * if density { f64::from(own.density[i]) } else { 1.0 })
                    .sum::<f64>()
            };
            0.5 * (of(0) + of(1))
        };
        let mass = 0.5 * (about.mass[0] + about.mass[1]);
        let drawn = sums(false);
        let bounds = space.in_box(about.bounds);
        let node = Node {
            encoding: if about.is_leaf() { Encoding::Leaf } else { Encoding::Grid },
            // Another one for each node, so that samples of neighbours have nothing in common.
            seed: page.0.wrapping_mul(0x9e37_79b9),
            source_particles: about.sources,
            delta: about.delta,
            spacing: about.spacing,
            smoothing_length_max: about.smoothing_length_max,
            mass,
            mass_density: sums(true),
            mass_scale: if drawn > 0.0 { (mass / drawn) as f32 } else { 1.0 },
            time: self.span(number),
            ..Node::leaf(bounds, tracks.drawn(interpolation) as u32)
        };
        let first = page.0 - own as u32;
        let child = |child: &u32| {
            let bounds = space.in_box(index.nodes[*child as usize].bounds);
            (NodeRef { page: PageId(first + child), node: 0 }, bounds)
        };
        let children = about.children.iter().map(child).collect();
        let content = Arc::new(MovingTracks {
            tracks,
            interval: space,
            begin: layout.clock[number],
            interpolation,
            rules: Arc::clone(&self.rules[family]),
        });
        Ok(Page::new(page, family as u32, [Branch { node, children, content }]))
    }

    fn largest_page_bytes(&self) -> u64 {
        let all = self.run.directory().intervals.iter().flat_map(|interval| &interval.families);
        all.map(|found| found.nodes.len.div_ceil(found.count.max(1).into())).max().unwrap_or(0)
    }

    fn pages_at_once(&self) -> usize {
        (PAGE_BYTES / self.largest_page_bytes().max(1)).clamp(1, MOST_AT_ONCE) as usize
    }

    fn reads_at_once(&self) -> Option<usize> {
        self.run.reads_at_once()
    }

    fn roots(&self, families: &[u32], _purpose: Purpose, time: f64) -> Vec<NodeRef> {
        let interval = self.interval_at(time);
        let root = |family: &u32| {
            let number = interval * self.families + *family as usize;
            let [first, end] = [*self.first.get(number)?, *self.first.get(number + 1)?];
            // The last node stands for all.
            (*family < self.families as u32 && first < end).then(|| NodeRef { page: PageId(end - 1), node: 0 })
        };
        families.iter().filter_map(root).collect()
    }

    fn is_root(&self, page: PageId) -> bool {
        page.0 < self.page_count() && self.first.binary_search(&(page.0 + 1)).is_ok()
    }
}

/// Bytes of a track in memory.
fn track_memory(attributes: usize) -> u64 {
    (1 + 2 * (size_of::<[[i64; 3]; 2]>() + (3 + attributes) * size_of::<f32>())) as u64
}

/// Tracks of a node over an interval, moved in one way.
#[derive(Debug)]
struct MovingTracks {
    tracks: Tracks,
    interval: Interval,
    /// The clock at the beginning.
    begin: f64,
    interpolation: Interpolation,
    rules: Arc<[AttributeMerge]>,
}

impl MovingTracks {
    fn at(&self, time: f64, which: Option<&[u32]>) -> Particles {
        let u = ((time - self.begin) / self.interval.length).clamp(0.0, 1.0);
        let now = self.tracks.drawn_at(&self.interval, u, self.interpolation, &self.rules, which);
        let values = Codebook {
            scope: CodebookScope::Leaves,
            particles: now.positions.len() as u64,
            errors: vec![QuantityError::default(); 3 + now.attributes.len()],
            mass: now.mass,
            density: now.density,
            smoothing_length: now.smoothing_length,
            attributes: now.attributes,
        };
        Particles { positions: now.positions, values, covariances: Vec::new() }
    }
}

impl Content for MovingTracks {
    fn particles(&self, time: f64) -> Cow<'_, Particles> {
        Cow::Owned(self.at(time, None))
    }

    fn some(&self, time: f64, which: &[u32]) -> Particles {
        self.at(time, Some(which))
    }

    fn motion(&self) -> Option<Motion> {
        Some(self.tracks.motion(&self.interval, self.begin, self.interpolation, &self.rules))
    }

    fn moves(&self) -> bool {
        true
    }

    fn memory(&self) -> u64 {
        self.tracks.len() as u64 * track_memory(self.rules.len())
    }
}

/// What some steps say of themselves, as one.
fn metadata(run: &RunFile) -> Result<Metadata, StoreError> {
    let steps = run.directory().steps.len();
    let looked_at = steps.min(LOOKED_AT);
    let step = |i: usize| i * (steps - 1) / (looked_at - 1).max(1);
    let stills = (0..looked_at).map(|i| run.placed_still(step(i))).collect::<Result<Vec<_>, _>>()?;
    let layout = run.tracks()?;
    let families = layout.families.iter().enumerate().map(|(number, own)| {
        // None of the steps that are looked at may have it.
        let all: Vec<&FamilyMetadata> =
            stills.iter().filter_map(|still| Some(still.metadata().family(own.name)?.1)).collect();
        let mean = |value: fn(&FamilyMetadata) -> f64| {
            all.iter().map(|family| value(family)).sum::<f64>() / all.len().max(1) as f64
        };
        let joined = |found: Vec<&AttributeInfo>, name: &str, unit: &Unit| {
            AttributeInfo::joined(found).unwrap_or_else(|| AttributeInfo::of(name, unit, &[]))
        };
        let quantity = |k: usize, name: &str| {
            joined(all.iter().map(|family| &family.quantities[k]).collect(), name, &Unit::default())
        };
        let attribute = |(name, unit): &(String, Unit)| {
            joined(all.iter().filter_map(|family| Some(family.attribute(name)?.1)).collect(), name, unit)
        };
        FamilyMetadata {
            name: own.name,
            count: all.iter().map(|family| family.count).max().unwrap_or(0),
            mass: mean(|family| family.mass),
            mass_density: mean(|family| family.mass_density),
            bounds: all.iter().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds)),
            root: layout.lattice.root,
            root_page: PageId(number as u32),
            quantities: [quantity(0, "mass"), quantity(1, "density"), quantity(2, "smoothing-length")],
            attributes: own.attributes.iter().map(attribute).collect(),
            levels: Vec::new(),
            volume: None,
            clusters: None,
            codebooks: Vec::new(),
            refinements: Vec::new(),
            column_error: None,
        }
    });
    let families = families.collect();
    let first = stills[0].metadata();
    Ok(Metadata {
        provenance: Provenance { path: run.path().to_path_buf(), ..first.provenance.clone() },
        families,
        ..first.clone()
    })
}
