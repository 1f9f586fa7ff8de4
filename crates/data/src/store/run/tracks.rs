//! The tracks of a family over an interval, as they lie in a run file: nodes, and an index of them.
//!
//! A leaf holds the tracks that begin in a cell of the octree over the run's root cell, in Morton order, as columns of
//! [`crate::codec::states`]. It has two parts, so that nobody has to read ids who only draws. Other nodes hold clusters, which stand
//! for all tracks of leaves that follow one another.

use crate::codec::morton::MORTON_BITS;
use crate::codec::states::{
    BLOCK, MASS_BITS, VALUE_BITS, as_before, decode, decode_bounded, encode, float_of, round_float,
};
use crate::hierarchy::spacetime::{Interpolation, Interval, TrackEnd, TrackFlags, Tracks};
use crate::model::Bounds;
use crate::store::error::Damage;
use crate::store::wire::{Decoder, Encoder};

/// Tracks of a leaf at most: as many as particles of a leaf in a page file, so that small runs are drawn as their steps are.
pub const LEAF_TRACKS: usize = 16384;
/// Most tracks that a leaf in a file may have: where more begin in one place than a cell can be cut for.
const MOST_TRACKS: u32 = 1 << 24;
/// What messages call an index.
const PLACE: &str = "index of tracks";
/// Bytes of a node without children in the index.
const NODE_BYTES: usize = 8 + 1 + 4 + 4 * 3 + 8 + 4 * 6 + 48 + 8 * 3 + 4 + 8 * 3 + 4;

/// A part of a node in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NodePart {
    /// Bytes.
    pub len: u32,
    /// Their CRC-32C.
    pub crc: u32,
}

/// Tracks that begin in one place: of a leaf those of source particles, of another node clusters.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackNode {
    /// Morton key (21 bits a coordinate) of the first place in it.
    pub key: u64,
    /// The depth of a leaf's cell in the octree; 0 for other nodes.
    pub depth: u8,
    /// The nodes that refine it, by their numbers in the index, which are below its own; none for a leaf.
    pub children: Vec<u32>,
    /// Number of source particles that it stands for.
    pub sources: u64,
    /// Largest distance at any time of the interval that a source particle can have from its cluster, run units; 0 for a leaf.
    pub delta: f64,
    /// Longest edge of the cells that tracks were merged in, here and below, run units; 0 for a leaf.
    pub spacing: f64,
    /// Number of tracks.
    pub tracks: u32,
    /// Of these how many come, how many go, and how many fade that do neither.
    pub flagged: [u32; 3],
    /// First byte, from the beginning of the section on; the ids follow the states.
    pub offset: u64,
    /// Everything but ids.
    pub states: NodePart,
    /// The ids, of a leaf.
    pub ids: NodePart,
    /// Which track of the finest flow level each of a leaf's belongs to, where there are flow levels; it follows the ids.
    pub flow: NodePart,
    /// A box around all tracks of it and below it for the whole interval, run units; smoothing lengths reach beyond it.
    pub bounds: Bounds,
    /// Mass of the source particles at both ends, run units.
    pub mass: [f64; 2],
    /// Mass of those that fade from place to place.
    pub faded_mass: f64,
    /// The largest smoothing length at both ends, of it and below it, run units.
    pub smoothing_length_max: f32,
}

impl TrackNode {
    /// Bytes in the file.
    pub fn bytes(&self) -> u64 {
        [self.states, self.ids, self.flow].iter().map(|part| u64::from(part.len)).sum()
    }

    /// Whether it holds the tracks of source particles.
    pub fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }

    /// How many particles there are at `u` of the interval, as `interpolation` moves them: [`Tracks::at`] appends as many.
    pub fn particles(&self, u: f64, interpolation: Interpolation) -> u64 {
        let [tracks, comes, goes, fades] =
            [self.tracks, self.flagged[0], self.flagged[1], self.flagged[2]].map(u64::from);
        match interpolation {
            // There is no weight where a track comes at the beginning, or goes at the end.
            _ if u <= 0.0 || interpolation == Interpolation::Hold => tracks - comes,
            _ if u >= 1.0 => tracks - goes,
            Interpolation::Auto => tracks + fades,
            Interpolation::Fade => tracks + (tracks - comes - goes),
            Interpolation::Hermite | Interpolation::Linear | Interpolation::Hold => tracks,
        }
    }
}

/// The nodes of a family over an interval, as they follow one another in the file: children before parents, leaves in Morton order. The
/// last one stands for all tracks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackIndex {
    /// The nodes.
    pub nodes: Vec<TrackNode>,
}

impl TrackIndex {
    /// The leaves, in Morton order.
    pub fn leaves(&self) -> impl Iterator<Item = &TrackNode> {
        self.nodes.iter().filter(|node| node.is_leaf())
    }

    /// The index as bytes.
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = Encoder::default();
        out.u32(self.nodes.len() as u32);
        for leaf in &self.nodes {
            out.u64(leaf.key);
            out.u8(leaf.depth);
            out.u32(leaf.children.len() as u32);
            leaf.children.iter().for_each(|child| out.u32(*child));
            out.u64(leaf.sources);
            out.f64(leaf.delta);
            out.f64(leaf.spacing);
            out.u32(leaf.tracks);
            leaf.flagged.into_iter().for_each(|count| out.u32(count));
            out.u64(leaf.offset);
            [leaf.states, leaf.ids, leaf.flow].into_iter().for_each(|part| {
                out.u32(part.len);
                out.u32(part.crc);
            });
            out.vec3(leaf.bounds.min);
            out.vec3(leaf.bounds.max);
            leaf.mass.into_iter().chain([leaf.faded_mass]).for_each(|mass| out.f64(mass));
            out.f32s(&[leaf.smoothing_length_max]);
        }
        out.bytes
    }

    /// Reads an index of `tracks` tracks of source particles, whose nodes fill `len` bytes.
    pub(super) fn decode(bytes: &[u8], tracks: u64, len: u64) -> Result<TrackIndex, Damage> {
        let mut input = Decoder::new(bytes, PLACE);
        let count = input.count(NODE_BYTES, "nodes")?;
        let nodes = (0..count).map(|_| decode_node(&mut input)).collect::<Result<Vec<_>, _>>()?;
        input.finish()?;
        let (mut sum, mut end, mut key) = (0, 0, 0);
        // What has no parent yet.
        let mut open: Vec<bool> = Vec::with_capacity(nodes.len());
        for (number, node) in nodes.iter().enumerate() {
            let wrong = |expected: &str| Damage::new(format!("{PLACE}, node {number}"), expected);
            if node.offset != end || node.tracks == 0 || node.tracks > MOST_TRACKS {
                return Err(wrong("tracks right after those of the node before"));
            }
            if u32::from(node.depth) > MORTON_BITS || node.key >> (3 * MORTON_BITS) != 0 {
                return Err(wrong("a cell of the octree"));
            }
            if node.flagged.iter().map(|count| u64::from(*count)).sum::<u64>() > u64::from(node.tracks) {
                return Err(wrong("no more tracks that come, go or fade than there are"));
            }
            if !(node.delta >= 0.0 && node.delta.is_finite() && node.spacing >= 0.0 && node.spacing.is_finite()) {
                return Err(wrong("distances"));
            }
            let box_is_finite = node.bounds.min.is_finite() && node.bounds.max.is_finite();
            if !box_is_finite || !node.mass.iter().chain([&node.faded_mass]).all(|mass| mass.is_finite()) {
                return Err(wrong("a box and masses"));
            }
            end += node.bytes();
            if node.is_leaf() {
                if node.sources != u64::from(node.tracks) || node.key < key {
                    return Err(wrong("tracks of source particles, not before those of the leaf before"));
                }
                key = node.key;
                sum += node.sources;
            } else {
                let mut sources = 0;
                for &child in &node.children {
                    let is_open = open.get_mut(child as usize).is_some_and(std::mem::take);
                    if !is_open {
                        return Err(wrong("children before it, each of one parent"));
                    }
                    sources += nodes[child as usize].sources;
                }
                if sources != node.sources || u64::from(node.tracks) > sources {
                    return Err(wrong("as many source particles as its children have"));
                }
            }
            open.push(true);
        }
        if sum != tracks || end != len {
            return Err(Damage::new(PLACE, format!("{tracks} tracks in {len} bytes, found {sum} in {end}")));
        }
        if open.iter().filter(|is_open| **is_open).count() > 1 || open.last() == Some(&false) {
            return Err(Damage::new(PLACE, "a last node above all others"));
        }
        Ok(TrackIndex { nodes })
    }
}

fn decode_node(input: &mut Decoder) -> Result<TrackNode, Damage> {
    let (key, depth) = (input.u64("a node's place")?, input.u8("a leaf's depth")?);
    let count = input.count(4, "children")?;
    let children = (0..count).map(|_| input.u32("a child")).collect::<Result<_, _>>()?;
    let (sources, delta, spacing) =
        (input.u64("a node's particles")?, input.f64("a node's error")?, input.f64("a node's cells")?);
    let mut count = || input.u32("a node's tracks");
    let (tracks, flagged) = (count()?, [count()?, count()?, count()?]);
    let offset = input.u64("a node's place")?;
    let mut part = || Ok(NodePart { len: input.u32("a node's length")?, crc: input.u32("a node's checksum")? });
    let (states, ids, flow) = (part()?, part()?, part()?);
    Ok(TrackNode {
        key,
        depth,
        children,
        sources,
        delta,
        spacing,
        tracks,
        flagged,
        offset,
        states,
        ids,
        flow,
        bounds: Bounds { min: input.vec3("a node's bounds")?, max: input.vec3("a node's bounds")? },
        mass: [input.f64("a node's mass")?, input.f64("a node's mass")?],
        faded_mass: input.f64("a node's faded mass")?,
        smoothing_length_max: input.f32("a node's largest smoothing length")?,
    })
}

/// What tracks are coded with beside their own columns; the same for a whole interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackCoding {
    /// By what a movement is multiplied to be that of the interval, at both ends: its length by the ends' spans.
    pub rates: [f64; 2],
    /// Bits of the mantissas of masses and densities.
    pub(super) sum_bits: [u32; 2],
}

impl TrackCoding {
    /// With these rates.
    pub fn new(rates: [f64; 2]) -> TrackCoding {
        TrackCoding { rates, sum_bits: [MASS_BITS, VALUE_BITS] }
    }

    /// That of the tracks over an interval.
    pub fn of(interval: &Interval) -> TrackCoding {
        TrackCoding::new(interval.spans.map(|span| interval.length / span))
    }

    /// Where a track is at the end if it goes on as it began.
    fn straight(&self, place: i64, movement: i64) -> i64 {
        place.saturating_add((movement as f64 * self.rates[0]) as i64)
    }

    /// The movement at the end of a track whose velocity changes evenly.
    fn evenly(&self, places: [i64; 2], movement: i64) -> i64 {
        let mean = places[1].saturating_sub(places[0]) as f64;
        ((2.0 * mean - movement as f64 * self.rates[0]) / self.rates[1]) as i64
    }

    /// Densities with as many bits as smoothing lengths have.
    fn as_coarse(&self, densities: [Vec<i64>; 2]) -> [Vec<i64>; 2] {
        let shift = self.sum_bits[1] - VALUE_BITS;
        densities.map(|column| if shift == 0 { column } else { column.into_iter().map(|rho| rho >> shift).collect() })
    }

    /// What a smoothing length is expected to be where density changes: its cube times the density stays. All three are rounded
    /// floats, which are nearly logarithms.
    fn compressed(smoothing_length: i64, densities: [i64; 2]) -> i64 {
        smoothing_length.saturating_sub(densities[1].saturating_sub(densities[0]) / 3)
    }

    /// The states of tracks, as bytes.
    pub fn encode(&self, tracks: &Tracks) -> Vec<u8> {
        let mut out = Vec::with_capacity(tracks.len() * 24);
        let flags: Vec<i64> = tracks.flags.iter().map(|flags| i64::from(flags.0)).collect();
        encode(&flags, as_before(0), &mut out);
        let [begin, end] = &tracks.ends;
        for axis in 0..3 {
            let of = |values: &[[i64; 3]]| values.iter().map(|value| value[axis]).collect::<Vec<i64>>();
            let [x0, v0, x1, v1] =
                [&begin.places, &begin.movements, &end.places, &end.movements].map(|values| of(values));
            encode(&x0, as_before(0), &mut out);
            encode(&v0, as_before(0), &mut out);
            encode(&x1, |i, _| self.straight(x0[i], v0[i]), &mut out);
            encode(&v1, |i, _| self.evenly([x0[i], x1[i]], v0[i]), &mut out);
        }
        let rounded = |values: &[f32], bits| values.iter().map(|value| round_float(*value, bits)).collect::<Vec<i64>>();
        let pair = |values: [&[f32]; 2], bits, out: &mut Vec<u8>| {
            let [begin, end] = values.map(|values| rounded(values, bits));
            encode(&begin, as_before(0), out);
            encode(&end, |i, _| begin[i], out);
            [begin, end]
        };
        let [mass_bits, density_bits] = self.sum_bits;
        pair([&begin.mass, &end.mass], mass_bits, &mut out);
        let rho = pair([&begin.density, &end.density], density_bits, &mut out);
        let [h0, h1] = [begin, end].map(|end| rounded(&end.smoothing_length, VALUE_BITS));
        let rho = self.as_coarse(rho);
        encode(&h0, |i, before| lengths_before(before, i, &rho[0]), &mut out);
        encode(&h1, |i, _| TrackCoding::compressed(h0[i], [rho[0][i], rho[1][i]]), &mut out);
        for (begin, end) in begin.attributes.iter().zip(&end.attributes) {
            pair([begin, end], VALUE_BITS, &mut out);
        }
        out
    }

    /// Reads `count` tracks with so many attributes, without their ids.
    ///
    /// # Errors
    /// What was expected.
    pub fn decode(&self, mut bytes: &[u8], count: usize, attributes: usize) -> Result<Tracks, &'static str> {
        // Before there is room for them: a block of a column takes a byte at least.
        let columns = 1 + 4 * 3 + 2 * (3 + attributes);
        if count.div_ceil(BLOCK).saturating_mul(columns) > bytes.len() {
            return Err("no more tracks than its bytes can hold");
        }
        let input = &mut bytes;
        let mut tracks = Tracks::new(attributes);
        for flags in decode(input, count, as_before(0))? {
            match u8::try_from(flags) {
                Ok(flags)
                    if flags & !TrackFlags::ALL == 0
                        && !TrackFlags(flags).has(TrackFlags::COMES | TrackFlags::GOES) =>
                {
                    tracks.flags.push(TrackFlags(flags));
                }
                _ => return Err("flags that there are, and nothing that comes and goes"),
            }
        }
        let [begin, end] = &mut tracks.ends;
        for values in [&mut begin.places, &mut begin.movements, &mut end.places, &mut end.movements] {
            values.resize(count, [0; 3]);
        }
        for axis in 0..3 {
            let x0 = decode_bounded(input, count, as_before(0))?;
            let v0 = decode_bounded(input, count, as_before(0))?;
            let x1 = decode_bounded(input, count, |i, _| self.straight(x0[i], v0[i]))?;
            let v1 = decode_bounded(input, count, |i, _| self.evenly([x0[i], x1[i]], v0[i]))?;
            for i in 0..count {
                begin.places[i][axis] = x0[i];
                begin.movements[i][axis] = v0[i];
                end.places[i][axis] = x1[i];
                end.movements[i][axis] = v1[i];
            }
        }
        let pair = |input: &mut &[u8]| {
            let begin = decode(input, count, as_before(0))?;
            let end = decode(input, count, |i, _| begin[i])?;
            Ok::<_, &'static str>([begin, end])
        };
        let floats = |values: &[i64], bits| values.iter().map(|number| float_of(*number, bits)).collect::<Vec<f32>>();
        let both = |ends: [Vec<i64>; 2], bits| ends.map(|values| floats(&values, bits));
        let [mass_bits, density_bits] = self.sum_bits;
        let mut mass = Vec::from(both(pair(input)?, mass_bits));
        let rho = pair(input)?;
        let coarse = self.as_coarse(rho.clone());
        let h0 = decode(input, count, |i, before| lengths_before(before, i, &coarse[0]))?;
        let h1 = decode(input, count, |i, _| TrackCoding::compressed(h0[i], [coarse[0][i], coarse[1][i]]))?;
        let mut lengths = Vec::from(both([h0, h1], VALUE_BITS));
        let mut density = Vec::from(both(rho, density_bits));
        for k in 0..attributes {
            [begin.attributes[k], end.attributes[k]] = both(pair(input)?, VALUE_BITS);
        }
        for end in tracks.ends.iter_mut().rev() {
            let take = |column: &mut Vec<Vec<f32>>| column.pop().unwrap_or_default();
            (end.mass, end.density, end.smoothing_length) = (take(&mut mass), take(&mut density), take(&mut lengths));
        }
        if input.is_empty() { Ok(tracks) } else { Err("nothing after the last column") }
    }
}

/// What the smoothing length of particle `i` is expected to be after that of the one before.
fn lengths_before(before: &[i64], i: usize, density: &[i64]) -> i64 {
    before.last().map_or(0, |last| TrackCoding::compressed(*last, [density[i - 1], density[i]]))
}

/// The values of tracks as they will be read back: floats rounded.
pub fn as_stored(end: &mut TrackEnd) {
    let round = |values: &mut Vec<f32>, bits| {
        values.iter_mut().for_each(|value| *value = float_of(round_float(*value, bits), bits))
    };
    round(&mut end.mass, MASS_BITS);
    [&mut end.density, &mut end.smoothing_length]
        .into_iter()
        .chain(&mut end.attributes)
        .for_each(|values| round(values, VALUE_BITS));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use glam::DVec3;
    use proptest::prelude::*;

    fn end(count: usize, attributes: usize) -> impl Strategy<Value = TrackEnd> {
        let vectors = || prop::collection::vec(prop::array::uniform3(-(1_i64 << 40)..1_i64 << 40), count);
        let values = move || prop::collection::vec(any::<f32>().prop_filter("a number", |v| !v.is_nan()), count);
        let others = prop::collection::vec(values(), attributes);
        (vectors(), vectors(), values(), values(), values(), others).prop_map(
            |(places, movements, mass, density, smoothing_length, attributes)| {
                let mut end = TrackEnd { places, movements, mass, density, smoothing_length, attributes };
                as_stored(&mut end);
                end
            },
        )
    }

    fn tracks() -> impl Strategy<Value = Tracks> {
        (0_usize..90, 0_usize..3).prop_flat_map(|(count, attributes)| {
            let flags = (0..=TrackFlags::ALL).prop_map(TrackFlags);
            let is_known = |flags: &TrackFlags| !flags.has(TrackFlags::COMES | TrackFlags::GOES);
            let flags = prop::collection::vec(flags.prop_filter("comes or goes", is_known), count);
            let ids = prop::collection::vec(any::<u64>(), count);
            (ids, flags, [end(count, attributes), end(count, attributes)]).prop_map(|(ids, flags, ends)| Tracks {
                ids,
                flags,
                ends,
            })
        })
    }

    proptest! {
        #![proptest_config(cases(64))]

        #[test]
        fn tracks_come_back(tracks in tracks(), rates in prop::array::uniform2(0.1..1.0f64), at: usize, byte: u8) {
            let coding = TrackCoding::new(rates);
            let mut bytes = coding.encode(&tracks);
            let attributes = tracks.ends[0].attributes.len();
            let back = coding.decode(&bytes, tracks.len(), attributes).unwrap();
            prop_assert_eq!(Tracks { ids: tracks.ids.clone(), ..back }, tracks.clone());
            prop_assert!(coding.decode(&bytes[..bytes.len().saturating_sub(1)], tracks.len(), attributes).is_err() || bytes.is_empty());
            // Damage that a checksum does not find is no panic.
            if !bytes.is_empty() {
                let at = at % bytes.len();
                bytes[at] = byte;
                drop(coding.decode(&bytes, tracks.len(), attributes));
            }
        }
    }

    #[test]
    fn indices_come_back_and_broken_ones_are_refused() {
        let leaf = |key, offset| TrackNode {
            children: Vec::new(),
            sources: 10,
            delta: 0.0,
            spacing: 0.0,
            key,
            depth: 3,
            tracks: 10,
            flagged: [1, 2, 3],
            offset,
            states: NodePart { len: 100, crc: 5 },
            ids: NodePart { len: 20, crc: 6 },
            flow: NodePart::default(),
            bounds: Bounds { min: DVec3::ZERO, max: DVec3::ONE },
            mass: [1.0, 2.0],
            faded_mass: 0.5,
            smoothing_length_max: 0.25,
        };
        let above = |children: &[u32], sources, offset| TrackNode {
            children: children.to_vec(),
            sources,
            delta: 0.5,
            spacing: 0.25,
            ids: NodePart::default(),
            ..leaf(0, offset)
        };
        let index = TrackIndex { nodes: vec![leaf(0, 0), leaf(1 << 40, 120), above(&[0, 1], 20, 240)] };
        let bytes = index.encode();
        assert_eq!(bytes.len(), 4 + 3 * NODE_BYTES + 2 * 4);
        assert_eq!(TrackIndex::decode(&bytes, 20, 340).unwrap(), index);
        assert!(TrackIndex::decode(&bytes, 21, 340).is_err() && TrackIndex::decode(&bytes, 20, 341).is_err());
        for cut in 0..bytes.len() {
            assert!(TrackIndex::decode(&bytes[..cut], 20, 340).is_err());
        }
        let two = || vec![leaf(0, 0), leaf(1 << 40, 120)];
        for wrong in [
            vec![leaf(0, 0), leaf(1 << 40, 121)],
            vec![leaf(0, 0), TrackNode { tracks: 0, ..leaf(0, 120) }],
            vec![leaf(0, 0), TrackNode { depth: 22, ..leaf(0, 120) }],
            vec![leaf(0, 0), TrackNode { delta: f64::NAN, ..leaf(0, 120) }],
            // No node above all others; children that are none, or not below; sums that are not theirs.
            two(),
            [two(), vec![above(&[0], 10, 240)]].concat(),
            [two(), vec![above(&[0, 0], 20, 240)]].concat(),
            [two(), vec![above(&[0, 1, 2], 20, 240)]].concat(),
            [two(), vec![above(&[0, 1], 21, 240)]].concat(),
        ] {
            let end = wrong.last().map_or(0, |last| last.offset + last.bytes());
            let sources = wrong.iter().filter(|node| node.is_leaf()).map(|node| node.sources).sum();
            assert!(TrackIndex::decode(&TrackIndex { nodes: wrong }.encode(), sources, end).is_err());
        }
    }
}
