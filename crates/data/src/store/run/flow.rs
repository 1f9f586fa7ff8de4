//! Flow levels of a run: clusters of tracks that stay together within an error in space and time (F12 6.3), level by level.
//!
//! A level of a family over an interval is one part of the file, coded as tracks are, with what clusters have beside. Leaves of tracks
//! say which track of the finest level each of theirs belongs to; the tracks of a coarser level say of which finer ones they consist.

use super::RunFile;
use super::layout::Section;
use super::tracks::{NodePart, TrackCoding, TrackNode};
use crate::codec::states::{BLOCK, as_before, decode, decode_unsigned, encode, encode_unsigned, float_of, round_float};
use crate::hierarchy::spacetime::{Stretch, Tracks};
use crate::store::error::{Damage, StoreError};
use crate::store::wire::{Decoder, Encoder};

/// Flow levels at most.
pub const MOST_FLOW_LEVELS: usize = 16;
/// What messages call a part.
const PLACE: &str = "flow level";
/// Bits of the mantissa of a share.
const SHARE_BITS: u32 = 7;
/// Bits of the mantissas of masses and densities: sums of particles are those of their tracks to single precision.
const SUM_BITS: [u32; 2] = [23, 13];

/// The tracks of clusters of one flow level, of a family over an interval. Where clusters split and merge, several tracks begin or end in
/// one cluster; what a track has of mass, density and everything else is that of its own particles, but its states are the clusters'.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlowTracks {
    /// Both ends of each, without ids. Masses are sums, densities those masses by the sum of volumes, all else means.
    pub tracks: Tracks,
    /// Particles of each.
    pub counts: Vec<u32>,
    /// The clusters at both ends, by their numbers within family and step.
    pub clusters: [Vec<u32>; 2],
    /// The first of the tracks of the next finer level that each consists of, and one more at the end; empty on level 1.
    pub children: Vec<u32>,
    /// Share of the mass of each whose orbits the steps do not resolve.
    pub faded: Vec<f32>,
}

/// Where the flow levels of a family over an interval lie in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlowParts {
    /// All of them, level 1 first, one behind the other, and then their long tracks.
    pub section: Section,
    /// Of each level: its tracks, bytes and checksum.
    pub levels: Vec<(u32, NodePart)>,
    /// Of each level the same of its long tracks over each stretch that ends with the interval, the shortest first.
    pub long: Vec<Vec<(u32, NodePart)>>,
}

impl FlowParts {
    pub(super) fn encode(&self, out: &mut Encoder) {
        out.section(self.section);
        for (tracks, part) in self.parts() {
            [*tracks, part.len, part.crc].into_iter().for_each(|value| out.u32(value));
        }
    }

    /// All parts as they lie in the section.
    fn parts(&self) -> impl Iterator<Item = &(u32, NodePart)> {
        self.levels.iter().chain(self.long.iter().flatten())
    }

    /// Those over an interval, of so many levels.
    pub(super) fn decode(input: &mut Decoder, interval: usize, levels: usize) -> Result<FlowParts, Damage> {
        let section = Section::decode(input)?;
        let mut value = || input.u32("a flow level");
        let mut part = || Ok((value()?, NodePart { len: value()?, crc: value()? }));
        let of_levels = (0..levels).map(|_| part()).collect::<Result<_, Damage>>()?;
        let mut long = || Stretch::ending_with(interval).map(|_| part()).collect::<Result<_, Damage>>();
        let long = (0..levels).map(|_| long()).collect::<Result<_, Damage>>()?;
        let parts = FlowParts { section, levels: of_levels, long };
        match parts.parts().map(|(_, part)| u64::from(part.len)).sum::<u64>() == section.len {
            true => Ok(parts),
            false => Err(Damage::new(PLACE, "flow levels that fill their section")),
        }
    }
}

impl FlowTracks {
    /// Number of tracks.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }

    /// The tracks of the next finer level that track `i` consists of; none on level 1.
    pub fn children_of(&self, i: usize) -> std::ops::Range<u32> {
        match self.children.get(i..i + 2) {
            Some(pair) => pair[0]..pair[1],
            None => 0..0,
        }
    }

    /// As bytes; `coding` that of the interval.
    pub fn encode(&self, coding: TrackCoding) -> Vec<u8> {
        let states = TrackCoding { sum_bits: SUM_BITS, ..coding }.encode(&self.tracks);
        let mut out = (states.len() as u32).to_le_bytes().to_vec();
        out.extend(states);
        let [begin, end] = &self.clusters;
        for column in [&self.counts, begin, end] {
            encode(&column.iter().map(|value| i64::from(*value)).collect::<Vec<_>>(), as_before(0), &mut out);
        }
        let children: Vec<i64> = self.children.windows(2).map(|pair| i64::from(pair[1] - pair[0])).collect();
        encode(&children, as_before(0), &mut out);
        let faded: Vec<i64> = self.faded.iter().map(|share| round_float(*share, SHARE_BITS)).collect();
        encode(&faded, as_before(0), &mut out);
        out
    }

    /// Reads `count` tracks with so many attributes; `finer`: how many the next finer level has, none on level 1.
    fn decode(
        coding: TrackCoding,
        bytes: &[u8],
        count: usize,
        attributes: usize,
        finer: Option<u32>,
    ) -> Result<FlowTracks, &'static str> {
        let (len, rest) = bytes.split_first_chunk::<4>().ok_or("room for the length of its states")?;
        let len = u32::from_le_bytes(*len) as usize;
        let (states, mut input) = rest.split_at_checked(len).ok_or("room for its states")?;
        let tracks = TrackCoding { sum_bits: SUM_BITS, ..coding }.decode(states, count, attributes)?;
        let mut whole = || {
            let values = decode(&mut input, count, as_before(0))?;
            let whole = |value: i64| u32::try_from(value).map_err(|_| "whole numbers of 32 bits");
            values.into_iter().map(whole).collect::<Result<Vec<u32>, _>>()
        };
        let (counts, clusters) = (whole()?, [whole()?, whole()?]);
        let mut children = Vec::new();
        if let Some(finer) = finer {
            let mut first = 0_u32;
            children.push(0);
            for own in decode(&mut input, count, as_before(0))? {
                let next = u32::try_from(own).ok().filter(|own| *own > 0).and_then(|own| first.checked_add(own));
                first = next.filter(|next| *next <= finer).ok_or("tracks of the next finer level for each")?;
                children.push(first);
            }
            if first != finer {
                return Err("all tracks of the next finer level, each in one");
            }
        }
        let shares = decode(&mut input, count, as_before(0))?;
        let faded: Vec<f32> = shares.into_iter().map(|number| float_of(number, SHARE_BITS)).collect();
        if !input.is_empty() || !faded.iter().all(|share| (0.0..=1.0).contains(share)) {
            return Err("shares, and nothing after them");
        }
        Ok(FlowTracks { tracks, counts, clusters, children, faded })
    }
}

/// Which track of level 1 each track of a leaf belongs to, as bytes.
pub fn encode_members(members: &[u32]) -> Vec<u8> {
    let mut all = members.to_vec();
    all.sort_unstable();
    all.dedup();
    let mut out = (all.len() as u32).to_le_bytes().to_vec();
    encode(&all.iter().map(|value| i64::from(*value)).collect::<Vec<_>>(), as_before(0), &mut out);
    let place = |value: &u32| all.partition_point(|known| known < value) as u64;
    encode_unsigned(members.iter().map(place), &mut out);
    out
}

/// Reads [`encode_members`] of `count` tracks, which are below `most`.
fn decode_members(bytes: &[u8], count: usize, most: u32) -> Result<Vec<u32>, &'static str> {
    let (len, mut input) = bytes.split_first_chunk::<4>().ok_or("room for a number")?;
    let len = u32::from_le_bytes(*len) as usize;
    if len > count {
        return Err("no more clusters than tracks");
    }
    let all = decode(&mut input, len, as_before(0))?;
    let places = decode_unsigned(&mut input, count)?;
    if !input.is_empty() || !all.iter().all(|number| (0..i64::from(most)).contains(number)) {
        return Err("tracks of flow level 1");
    }
    let of = |place: u64| all.get(usize::try_from(place).ok()?).map(|number| *number as u32);
    places.into_iter().map(of).collect::<Option<_>>().ok_or("one of its clusters for each")
}

impl RunFile {
    /// The error of each flow level, from level 1, the finest, to the root, run units; none where the run has no flow levels. At no time is
    /// a particle farther than that from the track of its cluster.
    pub fn flow_errors(&self) -> &[f64] {
        self.directory().tracks.as_ref().map_or(&[], |layout| &layout.flow_errors)
    }

    /// The tracks of a flow level, from 1 on, of a family over an interval.
    ///
    /// # Errors
    /// Where there are none, or they cannot be read or are damaged.
    pub fn flow_tracks(&self, interval: usize, family: usize, level: usize) -> Result<FlowTracks, StoreError> {
        let place = || format!("interval {interval}, family {family}, flow level {level}");
        let parts = &self.family_tracks(interval, family)?.flow;
        let index = level.checked_sub(1).filter(|index| *index < parts.levels.len());
        let index =
            index.ok_or_else(|| self.damaged(place(), &format!("one of {} flow levels", parts.levels.len())))?;
        let offset: u64 = parts.levels[..index].iter().map(|(_, part)| u64::from(part.len)).sum();
        let (count, part) = parts.levels[index];
        let start = parts.section.offset + offset;
        // Before there is room for it: it lies in the file.
        let bytes = self.checked(start, part, place)?;
        let attributes = self.tracks()?.families.get(family).map_or(0, |family| family.attributes.len());
        let finer = index.checked_sub(1).map(|finer| parts.levels[finer].0);
        if u64::from(count) > u64::from(part.len) * BLOCK as u64 {
            return Err(self.damaged(place(), "no more tracks than its bytes can hold"));
        }
        let coding = TrackCoding::of(&self.interval(interval)?);
        let tracks = FlowTracks::decode(coding, &bytes, count as usize, attributes, finer);
        tracks.map_err(|expected| self.damaged(place(), expected))
    }

    /// Which track of flow level 1 each track of a leaf belongs to.
    ///
    /// # Errors
    /// As [`RunFile::flow_tracks`].
    pub fn leaf_flow(&self, interval: usize, family: usize, leaf: &TrackNode) -> Result<Vec<u32>, StoreError> {
        let found = self.family_tracks(interval, family)?;
        let place = || format!("interval {interval}, family {family}, flow of tracks at {}", leaf.offset);
        let start = found.nodes.offset + leaf.offset + u64::from(leaf.states.len) + u64::from(leaf.ids.len);
        let bytes = self.checked(start, leaf.flow, place)?;
        let most = found.flow.levels.first().map_or(0, |(tracks, _)| *tracks);
        let members = decode_members(&bytes, leaf.tracks as usize, most);
        members.map_err(|expected| self.damaged(place(), expected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use crate::hierarchy::spacetime::{TrackEnd, TrackFlags};
    use proptest::prelude::*;

    fn flow(counts: &[u32]) -> FlowTracks {
        let n = counts.len();
        let end = |shift: i64| TrackEnd {
            places: (0..n as i64).map(|i| [i * 7 + shift, 3 - i, i << 20]).collect(),
            movements: (0..n as i64).map(|i| [i, -i * shift, 5]).collect(),
            mass: (0..n).map(|i| 0.1 + i as f32).collect(),
            density: vec![0.25; n],
            smoothing_length: vec![0.5; n],
            attributes: vec![(0..n).map(|i| i as f32).collect()],
        };
        let mut ends = [end(1), end(90)];
        for end in &mut ends {
            end.attributes[0].iter_mut().for_each(|value| *value = float_of(round_float(*value, 7), 7));
        }
        FlowTracks {
            tracks: Tracks { ids: Vec::new(), flags: vec![TrackFlags(0); n], ends },
            counts: counts.to_vec(),
            clusters: [(0..n as u32).collect(), (0..n as u32).rev().collect()],
            children: std::iter::once(0).chain((1..=n as u32).map(|i| 2 * i)).collect(),
            faded: vec![0.5; n],
        }
    }

    proptest! {
        #![proptest_config(cases(64))]

        #[test]
        fn levels_come_back(counts in prop::collection::vec(1_u32..1 << 30, 1..90), at: usize, byte: u8) {
            let coding = TrackCoding::new([0.5, 1.0]);
            let (own, n) = (flow(&counts), counts.len());
            let mut bytes = own.encode(coding);
            let finer = Some(2 * n as u32);
            prop_assert_eq!(FlowTracks::decode(coding, &bytes, n, 1, finer).unwrap(), own);
            prop_assert!(FlowTracks::decode(coding, &bytes, n, 1, Some(2 * n as u32 + 1)).is_err());
            prop_assert!(FlowTracks::decode(coding, &bytes[..bytes.len() - 1], n, 1, finer).is_err());
            // Damage that a checksum does not find is no panic.
            let at = at % bytes.len();
            bytes[at] = byte;
            drop(FlowTracks::decode(coding, &bytes, n, 1, finer));
        }

        #[test]
        fn members_come_back(members in prop::collection::vec(0_u32..500, 0..200), at: usize, byte: u8) {
            let mut bytes = encode_members(&members);
            prop_assert_eq!(decode_members(&bytes, members.len(), 500).unwrap(), members.clone());
            let most = members.iter().copied().max().unwrap_or(0);
            prop_assert!(members.is_empty() || decode_members(&bytes, members.len(), most).is_err());
            let at = at % bytes.len();
            bytes[at] = byte;
            drop(decode_members(&bytes, members.len(), 500));
        }
    }
}
