//! The nodes of an interval's tracks: leaves bucket by bucket, and clusters over runs of them, up to one that stands for all.
//!
//! The leaves of a bucket have one node above them, and so have always some nodes that follow one another. What is above depends on
//! the tracks and their order alone, and little is held: clusters of the nodes that wait for their neighbours.

use super::BuildError;
use super::in_order::in_order;
use super::shuffle::Shuffle;
use super::states::StateLayout;
use super::track_leaves::leaves_of;
use crate::codec::AttributeMerge;
use crate::hierarchy::spacetime::{Clusters, Interval, TrackFlags, Tracks, merge};
use crate::model::{Bounds, Progress};
use crate::store::run::{
    NodePart, RunFileWriter, Section, TrackCoding, TrackIndex, TrackNode, as_stored, encode_ids, encode_members,
};
use std::ops::Range;

/// Clusters of a node, about.
const CLUSTERS: usize = 16384;
/// Nodes that have one above them together: each is refined by many, so that the coarse ones take little room.
const CHILDREN: usize = 8;

/// A node that has no place in the file yet.
pub(super) struct BuiltNode {
    about: TrackNode,
    states: Vec<u8>,
    ids: Vec<u8>,
    flow: Vec<u8>,
    clusters: Clusters,
}

impl BuiltNode {
    /// A leaf: `cell` is the Morton key of its first place, and its depth. The values of tracks are as they will be read; `members` says
    /// which track of the finest flow level each belongs to.
    pub fn leaf(interval: &Interval, cell: (u64, u8), mut tracks: Tracks, members: Option<&[u32]>) -> BuiltNode {
        let ids = encode_ids(&std::mem::take(&mut tracks.ids));
        let (mut mass, mut faded_mass, mut smoothing_length_max) = ([0.0; 2], 0.0, 0.0_f32);
        for i in 0..tracks.len() {
            let flags = tracks.flags[i];
            for ((own, weight), mass) in tracks.ends.iter().zip(flags.weights()).zip(&mut mass) {
                *mass += weight * f64::from(own.mass[i]);
                smoothing_length_max = smoothing_length_max.max(own.smoothing_length[i]);
            }
            if flags.has(TrackFlags::FADES) {
                faded_mass += f64::from(tracks.ends[0].mass[i]);
            }
        }
        let about = TrackNode {
            key: cell.0,
            depth: cell.1,
            children: Vec::new(),
            sources: tracks.len() as u64,
            delta: 0.0,
            spacing: 0.0,
            tracks: 0,
            flagged: [0; 3],
            offset: 0,
            states: NodePart::default(),
            ids: NodePart::default(),
            flow: NodePart::default(),
            bounds: Bounds::EMPTY,
            mass,
            faded_mass,
            smoothing_length_max,
        };
        let flow = members.map(encode_members).unwrap_or_default();
        BuiltNode::coded(interval, about, Clusters::of_sources(tracks), ids, flow)
    }

    /// The node above some.
    fn above(interval: &Interval, rules: &[AttributeMerge], parts: &[(u32, &TrackNode, &Clusters)]) -> BuiltNode {
        let clusters: Vec<&Clusters> = parts.iter().map(|(.., clusters)| *clusters).collect();
        let mut merged = merge(interval, rules, &clusters, CLUSTERS);
        merged.clusters.tracks.ends.iter_mut().for_each(as_stored);
        let abouts = || parts.iter().map(|(_, about, _)| *about);
        let lengths = merged.clusters.tracks.ends.iter().flat_map(|end| &end.smoothing_length).copied();
        let about = TrackNode {
            key: parts.first().map_or(0, |(_, first, _)| first.key),
            depth: 0,
            children: parts.iter().map(|(number, ..)| *number).collect(),
            sources: abouts().map(|about| about.sources).sum(),
            delta: merged.delta,
            spacing: abouts().map(|about| about.spacing).fold(merged.spacing, f64::max),
            tracks: 0,
            flagged: [0; 3],
            offset: 0,
            states: NodePart::default(),
            ids: NodePart::default(),
            flow: NodePart::default(),
            bounds: abouts().fold(Bounds::EMPTY, |all, about| all.union(about.bounds)),
            mass: [0, 1].map(|end| abouts().map(|about| about.mass[end]).sum()),
            faded_mass: abouts().map(|about| about.faded_mass).sum(),
            smoothing_length_max: lengths.chain(abouts().map(|about| about.smoothing_length_max)).fold(0.0, f32::max),
        };
        BuiltNode::coded(interval, about, merged.clusters, Vec::new(), Vec::new())
    }

    /// With what its tracks say of themselves.
    fn coded(interval: &Interval, about: TrackNode, clusters: Clusters, ids: Vec<u8>, flow: Vec<u8>) -> BuiltNode {
        let tracks = &clusters.tracks;
        let mut flagged = [0; 3];
        tracks.flags.iter().filter_map(|flags| flags.kind()).for_each(|kind| flagged[kind] += 1);
        let states = TrackCoding::of(interval).encode(tracks);
        let part = |bytes: &[u8]| NodePart { len: bytes.len() as u32, crc: crc32c::crc32c(bytes) };
        let about = TrackNode {
            tracks: tracks.len() as u32,
            flagged,
            states: part(&states),
            ids: part(&ids),
            flow: part(&flow),
            bounds: about.bounds.union(tracks.bounds(interval)),
            ..about
        };
        BuiltNode { about, states, ids, flow, clusters }
    }
}

/// Writes the nodes of a family over an interval, from its buckets in order, which are empty then.
///
/// # Errors
/// When tracks cannot be read back, or the run not be written.
pub(super) fn write_nodes(
    sorted: &Shuffle,
    buckets: Range<usize>,
    layout: &StateLayout,
    family: usize,
    interval: &Interval,
    has_flow: bool,
    writer: &mut RunFileWriter,
    progress: &dyn Progress,
) -> Result<(Section, TrackIndex), BuildError> {
    let rules: Vec<AttributeMerge> =
        layout.families[family].1.iter().map(|(name, _)| AttributeMerge::of(name)).collect();
    let mut levels = Levels { interval, rules: &rules, index: TrackIndex::default(), waiting: Vec::new() };
    let mut section = writer.begin();
    let buckets: Vec<usize> = buckets.collect();
    let build = |bucket: &usize| {
        let leaves = leaves_of(&sorted.take(*bucket)?, layout, family, interval, has_flow);
        let above = (leaves.len() > 1).then(|| {
            let parts: Vec<(u32, &TrackNode, &Clusters)> =
                leaves.iter().enumerate().map(|(i, leaf)| (i as u32, &leaf.about, &leaf.clusters)).collect();
            BuiltNode::above(interval, &rules, &parts)
        });
        progress.advance(1);
        Ok((leaves, above))
    };
    in_order(&buckets, build, |(mut leaves, above)| {
        let first = levels.index.nodes.len() as u32;
        let top = match above {
            Some(mut above) => {
                above.about.children.iter_mut().for_each(|child| *child += first);
                for leaf in leaves {
                    levels.write(leaf, &mut section, writer)?;
                }
                Some(above)
            }
            None => leaves.pop(),
        };
        top.map_or(Ok(()), |top| levels.push(0, top, &mut section, writer))
    })?;
    levels.finish(&mut section, writer)?;
    writer.close()?;
    Ok((section, levels.index))
}

/// The nodes above buckets, as far as they are complete.
struct Levels<'a> {
    interval: &'a Interval,
    rules: &'a [AttributeMerge],
    index: TrackIndex,
    /// Of each level the nodes that have none above them yet: their numbers in the index, and their tracks.
    waiting: Vec<Vec<(u32, Clusters)>>,
}

impl Levels<'_> {
    /// Writes a node; returns its number and tracks.
    fn write(
        &mut self,
        node: BuiltNode,
        section: &mut Section,
        writer: &mut RunFileWriter,
    ) -> Result<(u32, Clusters), BuildError> {
        let number = self.index.nodes.len() as u32;
        self.index.nodes.push(TrackNode { offset: section.len, ..node.about });
        writer.extend(section, &node.states)?;
        writer.extend(section, &node.ids)?;
        writer.extend(section, &node.flow)?;
        Ok((number, node.clusters))
    }

    /// Writes a node of a level, and the ones above it that are complete with it.
    fn push(
        &mut self,
        level: usize,
        node: BuiltNode,
        section: &mut Section,
        writer: &mut RunFileWriter,
    ) -> Result<(), BuildError> {
        let written = self.write(node, section, writer)?;
        self.wait(level, written, section, writer)
    }

    /// Lets a written node of a level wait for its neighbours.
    fn wait(
        &mut self,
        level: usize,
        written: (u32, Clusters),
        section: &mut Section,
        writer: &mut RunFileWriter,
    ) -> Result<(), BuildError> {
        if self.waiting.len() <= level {
            self.waiting.resize_with(level + 1, Vec::new);
        }
        self.waiting[level].push(written);
        if self.waiting[level].len() < CHILDREN {
            return Ok(());
        }
        self.merge(level, section, writer)
    }

    /// Merges what waits in a level.
    fn merge(&mut self, level: usize, section: &mut Section, writer: &mut RunFileWriter) -> Result<(), BuildError> {
        let group = std::mem::take(&mut self.waiting[level]);
        let parts: Vec<(u32, &TrackNode, &Clusters)> =
            group.iter().map(|(number, clusters)| (*number, &self.index.nodes[*number as usize], clusters)).collect();
        let above = BuiltNode::above(self.interval, self.rules, &parts);
        self.push(level + 1, above, section, writer)
    }

    /// Merges what is left, up to one node.
    fn finish(&mut self, section: &mut Section, writer: &mut RunFileWriter) -> Result<(), BuildError> {
        let mut level = 0;
        while level < self.waiting.len() {
            match self.waiting[level].len() {
                0 => {}
                1 if self.waiting[level + 1..].iter().all(Vec::is_empty) => return Ok(()),
                // A single one joins those of the next level as it is.
                1 => {
                    if let Some(written) = self.waiting[level].pop() {
                        self.wait(level + 1, written, section, writer)?;
                    }
                }
                _ => self.merge(level, section, writer)?,
            }
            level += 1;
        }
        Ok(())
    }
}
