//! Leaves of tracks: the buckets of an interval sorted by where tracks begin, cut into cells of few, coded and written.

use super::BuildError;
use super::matching::{TrackRecord, UNRESOLVED, track_words};
use super::shuffle::Shuffle;
use super::states::{StateLayout, key_of};
use crate::codec::morton::MORTON_BITS;
use crate::hierarchy::spacetime::{Interval, TrackFlags, Tracks};
use crate::model::{Bounds, Progress};
use crate::store::run::{
    LEAF_TRACKS, LeafPart, RunFileWriter, Section, TrackCoding, TrackIndex, TrackLeaf, as_stored, encode_ids,
};
use rayon::prelude::*;
use std::ops::Range;

/// A node whose mass is unresolved to more than this share has tracks that fade.
const FADING_NODE: f64 = 0.5;
/// Tracks of such a node fade above this.
const FADING: f32 = 0.15;

/// A leaf before it has a place in the file.
struct Leaf {
    about: TrackLeaf,
    states: Vec<u8>,
    ids: Vec<u8>,
}

/// Writes the leaves of a family's buckets, in order.
///
/// # Errors
/// When tracks cannot be read back, or the run not be written.
pub(super) fn write_leaves(
    sorted: &Shuffle,
    buckets: Range<usize>,
    layout: &StateLayout,
    family: usize,
    interval: &Interval,
    writer: &mut RunFileWriter,
    progress: &dyn Progress,
) -> Result<(Section, TrackIndex), BuildError> {
    let mut section = writer.begin();
    let mut index = TrackIndex::default();
    let buckets: Vec<usize> = buckets.collect();
    for some in buckets.chunks(rayon::current_num_threads().max(1)) {
        let built = some.par_iter().map(|bucket| {
            let leaves = leaves_of(&sorted.get(*bucket)?, layout, family, interval);
            progress.advance(1);
            Ok(leaves)
        });
        for leaf in built.collect::<Result<Vec<_>, BuildError>>()?.into_iter().flatten() {
            let about = TrackLeaf { offset: section.len, ..leaf.about };
            writer.extend(&mut section, &leaf.states)?;
            writer.extend(&mut section, &leaf.ids)?;
            index.leaves.push(about);
        }
    }
    writer.close()?;
    Ok((section, index))
}

/// The leaves of a bucket.
fn leaves_of(records: &[u32], layout: &StateLayout, family: usize, interval: &Interval) -> Vec<Leaf> {
    let words = track_words(layout);
    let mut order: Vec<(u64, &[u32])> =
        records.chunks_exact(words).map(|record| (key_of(TrackRecord::of(record).places[0]), record)).collect();
    // By everything that a record holds, so that their order in the bucket does not matter.
    order.sort_unstable();
    let mut leaves = Vec::new();
    let attributes = layout.families[family].1.len();
    cut(&order, 0, &mut |tracks, depth| leaves.push(leaf(tracks, depth, attributes, interval)));
    leaves
}

/// Cuts sorted tracks into cells of few.
fn cut(tracks: &[(u64, &[u32])], depth: u32, put: &mut impl FnMut(&[(u64, &[u32])], u32)) {
    let (Some((first, _)), Some((last, _))) = (tracks.first(), tracks.last()) else { return };
    // The smallest cell that holds them all.
    let common = ((first ^ last) << 1).leading_zeros() / 3;
    let depth = common.min(MORTON_BITS).max(depth);
    if tracks.len() <= LEAF_TRACKS || depth >= MORTON_BITS {
        return put(tracks, depth);
    }
    let shift = 3 * (MORTON_BITS - depth - 1);
    for cell in tracks.chunk_by(|a, b| a.0 >> shift == b.0 >> shift) {
        cut(cell, depth + 1, put);
    }
}

/// A leaf of tracks, coded.
fn leaf(order: &[(u64, &[u32])], depth: u32, attributes: usize, interval: &Interval) -> Leaf {
    let mut tracks = Tracks::new(attributes);
    let (mut mass, mut unresolved_mass, mut c) = (0.0, 0.0, Vec::with_capacity(order.len()));
    for (_, record) in order {
        let record = TrackRecord::of(record);
        tracks.ids.push(record.id);
        tracks.flags.push(record.flags);
        let half = record.values.len() / 2;
        for (end, values) in [&record.values[..half], &record.values[half..]].into_iter().enumerate() {
            let own = &mut tracks.ends[end];
            own.mass.push(values[0]);
            own.density.push(values[1]);
            own.smoothing_length.push(values[2]);
            own.attributes.iter_mut().zip(&values[3..]).for_each(|(column, value)| column.push(*value));
            own.places.push(record.places[end]);
            let exponent = interval.lattice.exponent(values[2]);
            let velocity = record.velocities[end].map(f64::from);
            own.movements.push(interval.lattice.movement(velocity, interval.spans[end], exponent));
        }
        let own = f64::from(record.values[0]);
        mass += own;
        unresolved_mass += if record.unresolved > UNRESOLVED { own } else { 0.0 };
        c.push(record.unresolved);
    }
    if unresolved_mass > FADING_NODE * mass {
        for (flags, _) in tracks.flags.iter_mut().zip(&c).filter(|(_, c)| **c > FADING) {
            flags.0 |= TrackFlags::FADES;
        }
    }
    tracks.ends.iter_mut().for_each(as_stored);
    let mut about = TrackLeaf {
        key: order.first().map_or(0, |(key, _)| *key),
        depth: depth as u8,
        tracks: order.len() as u32,
        flagged: [0; 3],
        offset: 0,
        states: LeafPart::default(),
        ids: LeafPart::default(),
        bounds: Bounds::EMPTY,
        mass: [0.0; 2],
        faded_mass: 0.0,
        smoothing_length_max: 0.0,
    };
    for i in 0..tracks.len() {
        let spline = interval.spline(&tracks, i);
        about.bounds = spline.control_points().into_iter().fold(about.bounds, Bounds::with);
        if let Some(kind) = tracks.flags[i].kind() {
            about.flagged[kind] += 1;
        }
        let weights = tracks.flags[i].weights();
        for ((own, weight), mass) in tracks.ends.iter().zip(weights).zip(&mut about.mass) {
            *mass += weight * f64::from(own.mass[i]);
            about.smoothing_length_max = about.smoothing_length_max.max(own.smoothing_length[i]);
        }
        if tracks.flags[i].has(TrackFlags::FADES) {
            about.faded_mass += f64::from(tracks.ends[0].mass[i]);
        }
    }
    let coding = TrackCoding { rates: interval.spans.map(|span| interval.length / span) };
    let (states, ids) = (coding.encode(&tracks), encode_ids(&tracks.ids));
    let part = |bytes: &[u8]| LeafPart { len: bytes.len() as u32, crc: crc32c::crc32c(bytes) };
    about.states = part(&states);
    about.ids = part(&ids);
    Leaf { about, states, ids }
}
