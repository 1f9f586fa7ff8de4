//! Leaves of tracks: a bucket of an interval sorted by where tracks begin, cut into cells of few.

use super::matching::{TrackRecord, UNRESOLVED, track_words};
use super::states::StateLayout;
use super::track_nodes::BuiltNode;
use crate::codec::morton::MORTON_BITS;
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::hierarchy::spacetime::{Interval, TrackFlags, Tracks};
use crate::store::run::{LEAF_TRACKS, as_stored};

/// A node whose mass is unresolved to more than this share has tracks that fade.
const FADING_NODE: f64 = 0.5;
/// Tracks of such a node fade above this.
const FADING: f32 = 0.15;

/// The leaves of a bucket, in Morton order; `has_flow`: the tracks are numbered by those of the finest flow level.
pub(super) fn leaves_of(
    records: &[u32],
    layout: &StateLayout,
    family: usize,
    interval: &Interval,
    has_flow: bool,
) -> Vec<BuiltNode> {
    let words = track_words(layout);
    let mut order: Vec<(u64, &[u32])> =
        records.chunks_exact(words).map(|record| (morton_key(TrackRecord::of(record).places[0]), record)).collect();
    // By everything that a record holds, so that their order in the bucket does not matter.
    order.sort_unstable();
    let mut leaves = Vec::new();
    let attributes = layout.families[family].1.len();
    cut(&order, 0, &mut |tracks, depth| leaves.push(leaf(tracks, depth, attributes, interval, has_flow)));
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

/// A leaf of tracks.
fn leaf(order: &[(u64, &[u32])], depth: u32, attributes: usize, interval: &Interval, has_flow: bool) -> BuiltNode {
    let mut tracks = Tracks::new(attributes);
    let (mut mass, mut unresolved_mass, mut c) = (0.0, 0.0, Vec::with_capacity(order.len()));
    for (_, record) in order {
        let record = TrackRecord::of(record);
        tracks.ids.push(record.id);
        tracks.flags.push(record.flags);
        for (end, values) in record.values.into_iter().enumerate() {
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
        let own = f64::from(record.values[0][0]);
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
    let cell = (order.first().map_or(0, |(key, _)| *key), depth as u8);
    let members: Vec<u32> = order.iter().map(|(_, record)| TrackRecord::of(record).numbers[0]).collect();
    BuiltNode::leaf(interval, cell, tracks, has_flow.then_some(&members[..]))
}
