//! The tracks of certain particles over an interval: found by their ids, or carried on from the interval before.
//!
//! Who ends in a place begins there in the next interval, to the bit. So the successors of tracks are in the leaves that hold the places
//! where those end, and nothing else is read. What comes in an interval had no track before; the index says which leaves have such.

use super::RunFile;
use super::ids::decode_ids;
use super::track_layout::TrackLayout;
use super::tracks::TrackNode;
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::hierarchy::spacetime::{TrackFlags, Tracks};
use crate::store::error::StoreError;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Who is meant: whether a particle of a family (by its number in the run) with an id is.
pub type Wanted<'a> = &'a (dyn Fn(usize, u64) -> bool + Sync);

/// The share of the edge of a periodic box within which a place at a face is looked for at the other face, too: places are rounded.
const AT_A_FACE: i64 = 1 << 16;

/// All tracks of certain particles over an interval.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MemberTracks {
    /// The interval.
    pub interval: usize,
    /// By family of the run.
    pub families: Vec<FamilyMembers>,
}

/// Those of a family.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FamilyMembers {
    /// Leaves that hold some, by their numbers among the leaves, and which of their tracks those are; both rise.
    pub rows: Vec<(u32, Vec<u32>)>,
    /// The tracks, in that order, with their ids.
    pub tracks: Tracks,
}

impl MemberTracks {
    /// Number of tracks.
    pub fn len(&self) -> usize {
        self.families.iter().map(|family| family.tracks.len()).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl RunFile {
    /// The tracks of certain particles over an interval: the ids of all tracks are read.
    ///
    /// # Errors
    /// Where the run has no tracks, or they cannot be read or are damaged.
    pub fn find_members(&self, interval: usize, wanted: Wanted<'_>) -> Result<MemberTracks, StoreError> {
        let families = 0..self.tracks()?.families.len();
        let families = families.map(|family| {
            let leaves: Vec<TrackNode> = self.track_index(interval, family)?.leaves().cloned().collect();
            let all: Vec<u32> = (0..leaves.len() as u32).collect();
            self.members_of(interval, family, &leaves, &all, wanted)
        });
        Ok(MemberTracks { interval, families: families.collect::<Result<_, _>>()? })
    }

    /// The tracks over the next interval of the same particles: of `before`, which has all tracks of those that are wanted.
    ///
    /// # Errors
    /// As [`RunFile::find_members`], and where there is no next interval.
    pub fn carry_members(&self, before: &MemberTracks, wanted: Wanted<'_>) -> Result<MemberTracks, StoreError> {
        let (layout, interval) = (self.tracks()?, before.interval + 1);
        let families = before.families.iter().enumerate().map(|(family, own)| {
            let leaves: Vec<TrackNode> = self.track_index(interval, family)?.leaves().cloned().collect();
            let candidates = candidates(layout, &own.tracks, &leaves);
            let found = self.members_of(interval, family, &leaves, &candidates, wanted)?;
            // As many begin as ended, or one was looked for in the wrong place: at a face of the box.
            let count = |tracks: &Tracks, flag: u8| tracks.flags.iter().filter(|flags| !flags.has(flag)).count();
            match count(&found.tracks, TrackFlags::COMES) == count(&own.tracks, TrackFlags::GOES) {
                true => Ok(found),
                false => {
                    let all: Vec<u32> = (0..leaves.len() as u32).collect();
                    self.members_of(interval, family, &leaves, &all, wanted)
                }
            }
        });
        Ok(MemberTracks { interval, families: families.collect::<Result<_, _>>()? })
    }

    /// The tracks that are wanted of some leaves.
    fn members_of(
        &self,
        interval: usize,
        family: usize,
        leaves: &[TrackNode],
        which: &[u32],
        wanted: Wanted<'_>,
    ) -> Result<FamilyMembers, StoreError> {
        let of_leaf = |&number: &u32| {
            let leaf = &leaves[number as usize];
            let ids = self.leaf_ids(interval, family, leaf)?;
            let rows: Vec<u32> = (0..).zip(&ids).filter(|(_, id)| wanted(family, **id)).map(|(row, _)| row).collect();
            if rows.is_empty() {
                return Ok(None);
            }
            let tracks = self.node_tracks(interval, family, leaf, false)?;
            Ok(Some((number, rows, Tracks { ids, ..tracks })))
        };
        let found = which.par_iter().map(of_leaf).collect::<Result<Vec<_>, StoreError>>()?;
        let attributes = self.tracks()?.families.get(family).map_or(0, |family| family.attributes.len());
        let mut members = FamilyMembers { rows: Vec::new(), tracks: Tracks::new(attributes) };
        for (leaf, rows, tracks) in found.into_iter().flatten() {
            members.tracks.extend_from(&tracks, &rows);
            members.rows.push((leaf, rows));
        }
        Ok(members)
    }

    /// The ids of a leaf's tracks.
    fn leaf_ids(&self, interval: usize, family: usize, leaf: &TrackNode) -> Result<Vec<u64>, StoreError> {
        let start = self.family_tracks(interval, family)?.nodes.offset + leaf.offset + u64::from(leaf.states.len);
        let place = || format!("interval {interval}, family {family}, ids at {}", leaf.offset);
        let bytes = self.checked(start, leaf.ids, place)?;
        decode_ids(&bytes, leaf.tracks as usize).map_err(|expected| self.damaged(place(), expected))
    }
}

/// The leaves that hold the successors of tracks, and those in which tracks come.
fn candidates(layout: &TrackLayout, before: &Tracks, leaves: &[TrackNode]) -> Vec<u32> {
    let comes = (0..).zip(leaves).filter(|(_, leaf)| leaf.flagged[0] > 0).map(|(number, _)| number);
    let mut found: BTreeSet<u32> = comes.collect();
    let edge = layout
        .box_size
        .map(|edge| ((edge / layout.lattice.unit()).round() as i64).min(1 << 60))
        .filter(|edge| *edge > 0);
    let origin = layout.lattice.place([0.0; 3]);
    let mut last = None;
    let mut look = |place: [i64; 3]| {
        let key = morton_key(place);
        if last == Some(key) {
            return;
        }
        last = Some(key);
        // A leaf is known by its first key, which those before it may have, too.
        let from = leaves.partition_point(|leaf| leaf.key < key).saturating_sub(1);
        let to = leaves.partition_point(|leaf| leaf.key <= key);
        found.extend(from as u32..to as u32);
    };
    let ends = before.flags.iter().zip(&before.ends[1].places).filter(|(flags, _)| !flags.has(TrackFlags::GOES));
    for (_, &place) in ends {
        let Some(edge) = edge else {
            look(place);
            continue;
        };
        let near = edge / AT_A_FACE;
        let inside: [i64; 3] = std::array::from_fn(|axis| place[axis].saturating_sub(origin[axis]).rem_euclid(edge));
        let other = inside.map(|x| match x {
            x if x <= near => Some(x + edge),
            x if x >= edge - near => Some(x - edge),
            _ => None,
        });
        for image in 0..8_u32 {
            let at = |axis: usize| if image >> axis & 1 == 0 { Some(inside[axis]) } else { other[axis] };
            if let (Some(x), Some(y), Some(z)) = (at(0), at(1), at(2)) {
                look([x + origin[0], y + origin[1], z + origin[2]]);
            }
        }
    }
    found.into_iter().collect()
}
