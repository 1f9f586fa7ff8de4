//! The clusters of a node as bytes: `docs/page-file.md` has the layout.
//!
//! Clusters come in an order in which those of a common ancestor lie together. Between each and the one before it stands the rank of the
//! split that parted them, on a scale of [`RANKS_AN_OCTAVE`] to a factor of 2; a part of the clusters is drawn by leaving out the later splits.

use super::coordinates::{LEAF_BITS, bin, pack_leaf, unpack_leaf};
use super::packing::VqBits;

/// Classes of ranks between a number and its double: a part of a node is drawn to within 1/19 of the number that is asked for.
pub const RANKS_AN_OCTAVE: u32 = 19;
/// Clusters of a node at most, so that classes fit in a byte.
pub const MOST: usize = 1 << 13;
/// Clusters whose places are stored together.
const BLOCK: usize = 16;
/// Bits of the width of a coordinate in a block, and of the bits that are dropped of all of them.
const WIDTH_BITS: u32 = 5;
/// Places are told in steps of at most this share of the smallest cluster's size in a block.
const STEPS_PER_SIZE: f64 = 4.0;

/// The class of a split's rank, which is 1 for the first one.
pub fn class_of(rank: u32) -> u8 {
    let octave = rank.max(1).ilog2();
    let within = (u64::from(rank.max(1) - (1 << octave)) * u64::from(RANKS_AN_OCTAVE)) >> octave;
    (octave * RANKS_AN_OCTAVE + within as u32).min(255) as u8
}

/// The smallest rank of a class and of those after it: how many clusters there are without these.
pub fn first_of(class: u32) -> u32 {
    let (octave, within) = (class / RANKS_AN_OCTAVE, class % RANKS_AN_OCTAVE);
    (1 << octave) + (within << octave).div_ceil(RANKS_AN_OCTAVE)
}

/// The largest number of clusters, at most `count`, that whole classes of splits make; at least 1.
pub fn whole_classes(count: u32) -> u32 {
    let count = count.max(1);
    first_of(u32::from(class_of(count)))
}

/// Above the class of any split.
pub const NO_CLASS: u16 = u8::MAX as u16 + 1;

/// The class from which on splits are undone, for so many of a node's clusters to be drawn, or all.
pub fn cluster_limit(count: Option<u32>, clusters: u32) -> u16 {
    count.filter(|count| *count < clusters).map_or(NO_CLASS, |count| class_of(whole_classes(count)).into())
}

/// Numbers by their logarithm, in 256 steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ladder {
    /// Base 2 logarithm of step 0.
    pub low: f32,
    /// From one step to the next.
    pub step: f32,
}

impl Ladder {
    /// The finest that reaches from the smallest to the largest of some positive numbers; what is not positive counts as the smallest
    /// that is.
    pub fn over(values: impl Iterator<Item = f64>) -> Ladder {
        let logarithms = values.filter(|value| *value > 0.0 && value.is_finite()).map(f64::log2);
        let (low, high) = logarithms.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Ladder { low: -1000.0, step: 0.0 };
        }
        Ladder { low: low as f32, step: ((high - low) / 255.0) as f32 }
    }

    /// The nearest step.
    pub fn step_of(self, value: f64) -> u8 {
        let up = (value.log2() - f64::from(self.low)) / f64::from(self.step);
        // What is not a number, and what divides by zero, becomes the first.
        if up.is_finite() { up.round().clamp(0.0, 255.0) as u8 } else { 0 }
    }

    /// The number of a step.
    pub fn value(self, step: u8) -> f64 {
        (f64::from(self.low) + f64::from(self.step) * f64::from(step)).exp2()
    }
}

/// What is known of a node that is drawn with its first 1, 2, 4, ... clusters, or with all: [`crate::hierarchy::pca::Step`]. Lengths in cells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StoredStep {
    /// Priority of the split that comes next ([`crate::hierarchy::pca::SplitRule`]), in the data's units.
    pub priority: f32,
    /// What its cluster's shape is as large as, squared.
    pub scale: f32,
    /// Sum of masses times misfit.
    pub misfit: f32,
    /// Largest trace of any cluster's moments.
    pub largest: f32,
}

/// The clusters of a node; the codes of their densities and attributes lie elsewhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedClusters {
    /// What the decoded places have to be moved by for the node's centre of mass to be where it is, cells.
    pub shift: [f32; 3],
    /// Masses, and sizes in cells: the geometric mean of the standard deviations along the principal axes.
    pub masses: (Ladder, Vec<u8>),
    /// See there.
    pub sizes: (Ladder, Vec<u8>),
    /// Diameters by equation 2 of HE03, cells, where clusters were split as there.
    pub published: Option<(Ladder, Vec<u8>)>,
    /// Class of the split before each cluster but the first.
    pub ranks: Vec<u8>,
    /// Code of each shape.
    pub shapes: Vec<u16>,
    /// Places: words as those of leaves ([`super::coordinates::pack_leaf`]).
    pub words: Vec<u64>,
    /// For 1, 2, 4, ... clusters, and all.
    pub steps: Vec<StoredStep>,
}

/// Steps of a node of so many clusters.
pub fn step_count(clusters: usize) -> usize {
    clusters.max(1).next_power_of_two().ilog2() as usize + 1
}

/// Clusters that a node is drawn with at a step.
pub fn step_clusters(step: usize, clusters: u32) -> u32 {
    1_u32.checked_shl(step as u32).unwrap_or(u32::MAX).min(clusters)
}

/// Bits of shape codes as they are packed; `None`: there are none.
pub fn shape_packing(bits: u8) -> Option<VqBits> {
    VqBits::try_from(bits).ok()
}

impl PackedClusters {
    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Sets the places, as fractions of the cell, of clusters of these sizes; as exact as these ask for.
    pub fn set_places(&mut self, places: &[[f64; 3]], sizes: &[f64]) {
        self.words.clear();
        for (places, sizes) in places.chunks(BLOCK).zip(sizes.chunks(BLOCK)) {
            let smallest = sizes.iter().copied().fold(f64::INFINITY, f64::min);
            let steps = (smallest / STEPS_PER_SIZE * f64::from(1 << LEAF_BITS)).log2().floor();
            // The cast saturates: what is tiny keeps all bits.
            let dropped = (steps as u32).min(LEAF_BITS - 1);
            for place in places {
                let coarse = |x: f64| (bin(x, LEAF_BITS) >> dropped) << dropped | (1 << dropped) >> 1;
                self.words.push(pack_leaf(place.map(coarse), false));
            }
        }
    }

    /// Where a cluster is, as fractions of the cell.
    pub fn place(&self, i: usize) -> [f64; 3] {
        let told = unpack_leaf(self.words[i]);
        std::array::from_fn(|k| (f64::from(told[k]) + f64::from(self.shift[k])).clamp(0.0, 1.0))
    }

    /// Appends the section.
    pub fn encode(&self, shape_bits: u8, out: &mut Vec<u8>) {
        let mut single = |value: f32| out.extend_from_slice(&value.to_le_bytes());
        self.shift.into_iter().for_each(&mut single);
        for ladder in [self.masses.0, self.sizes.0] {
            single(ladder.low);
            single(ladder.step);
        }
        if let Some((ladder, _)) = &self.published {
            single(ladder.low);
            single(ladder.step);
        }
        for StoredStep { priority, scale, misfit, largest } in &self.steps {
            for value in [priority, scale, misfit, largest] {
                out.extend_from_slice(&half_up(*value).to_le_bytes());
            }
        }
        out.extend_from_slice(&self.ranks);
        out.extend_from_slice(&self.masses.1);
        out.extend_from_slice(&self.sizes.1);
        if let Some((_, sizes)) = &self.published {
            out.extend_from_slice(sizes);
        }
        if let Some(packing) = shape_packing(shape_bits) {
            packing.pack(&self.shapes, out);
        }
        encode_places(&self.words, out);
    }

    /// Reads the section of `count` clusters at the start of `bytes`, of which it may have `MOST` at most; and its length.
    ///
    /// # Errors
    /// What was expected.
    pub fn decode(
        bytes: &[u8],
        count: usize,
        shape_bits: u8,
        is_published: bool,
    ) -> Result<(PackedClusters, usize), &'static str> {
        if count == 0 || count > MOST {
            return Err("from 1 to 8192 clusters");
        }
        let mut input = bytes;
        let mut take = |len: usize| {
            let (part, rest) = input.split_at_checked(len).ok_or("room for its clusters")?;
            input = rest;
            Ok::<_, &'static str>(part)
        };
        let singles = |part: &[u8]| -> Vec<f32> {
            let single = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
            part.chunks_exact(4).map(single).collect()
        };
        let head = singles(take(4 * if is_published { 9 } else { 7 })?);
        let half = |two: &[u8]| f32::from_bits(u32::from(u16::from_le_bytes([two[0], two[1]])) << 16);
        let steps: Vec<f32> = take(8 * step_count(count))?.chunks_exact(2).map(half).collect();
        if !head.iter().chain(&steps).all(|value| value.is_finite()) {
            return Err("finite numbers in the tables of its clusters");
        }
        let step = |four: &[f32]| StoredStep { priority: four[0], scale: four[1], misfit: four[2], largest: four[3] };
        let ranks = take(count - 1)?.to_vec();
        let masses = (Ladder { low: head[3], step: head[4] }, take(count)?.to_vec());
        let sizes = (Ladder { low: head[5], step: head[6] }, take(count)?.to_vec());
        let published = match is_published {
            true => Some((Ladder { low: head[7], step: head[8] }, take(count)?.to_vec())),
            false => None,
        };
        let mut shapes = Vec::with_capacity(count);
        match shape_packing(shape_bits) {
            Some(packing) => packing.unpack(take(packing.packed_len(count).ok_or("room")?)?, count, &mut shapes),
            None => shapes.resize(count, 0),
        }
        let (words, places) = decode_places(input, count)?;
        let shift = [head[0], head[1], head[2]];
        let steps = steps.chunks_exact(4).map(step).collect();
        let read = bytes.len() - input.len() + places;
        Ok((PackedClusters { shift, masses, sizes, published, ranks, shapes, words, steps }, read))
    }
}

/// The upper half of a positive single, rounded up: bounds stay bounds.
fn half_up(value: f32) -> u16 {
    let bits = value.max(0.0).to_bits();
    ((bits >> 16) + u32::from(bits & 0xffff != 0)).min(0x7f7f) as u16
}

/// Places in blocks: how many of the lowest bits are dropped of all coordinates, the smallest value and the width of each, then what each
/// is above it; the lowest bit first, whole bytes.
fn encode_places(words: &[u64], out: &mut Vec<u8>) {
    let mut bits = Bits { out, held: 0, count: 0 };
    for block in words.chunks(BLOCK) {
        // What is dropped ends with a bit that stands for the middle of it.
        let trailing = |word: &u64| (0..3).map(|axis| coordinate(*word, axis).trailing_zeros()).min().unwrap_or(0);
        let dropped = block.iter().map(|word| (trailing(word) + 1).min(LEAF_BITS - 1)).min().unwrap_or(0);
        let is_middle = |word: &u64| (0..3).all(|axis| coordinate(*word, axis) >> (dropped.max(1) - 1) & 1 == 1);
        let dropped = if dropped > 0 && block.iter().all(is_middle) { dropped } else { 0 };
        let value = |word: u64, axis: usize| coordinate(word, axis) >> dropped;
        bits.put(dropped, WIDTH_BITS);
        let axes = [0, 1, 2].map(|axis| {
            let values = block.iter().map(|&word| value(word, axis));
            let (low, high) = values.fold((u32::MAX, 0), |(low, high), v| (low.min(v), high.max(v)));
            (low, 32 - (high - low).leading_zeros())
        });
        for (low, width) in axes {
            bits.put(low, LEAF_BITS - dropped);
            bits.put(width, WIDTH_BITS);
        }
        for &word in block {
            for (axis, (low, width)) in axes.into_iter().enumerate() {
                bits.put(value(word, axis) - low, width);
            }
        }
    }
    bits.finish();
}

fn decode_places(bytes: &[u8], count: usize) -> Result<(Vec<u64>, usize), &'static str> {
    let mut words = Vec::with_capacity(count);
    let mut at = 0_usize;
    let mut next = |width: u32| -> Result<u32, &'static str> {
        let mut value = 0_u64;
        let (first, shift) = (at / 8, at % 8);
        for k in 0..(shift + width as usize).div_ceil(8) {
            value |= u64::from(*bytes.get(first + k).ok_or("room for the places of its clusters")?) << (8 * k);
        }
        at += width as usize;
        Ok((value >> shift) as u32 & ((1 << width) - 1))
    };
    while words.len() < count {
        let dropped = next(WIDTH_BITS)?;
        if dropped >= LEAF_BITS {
            return Err("at most 20 bits to be dropped");
        }
        let mut axes = [(0, 0); 3];
        for (low, width) in &mut axes {
            (*low, *width) = (next(LEAF_BITS - dropped)?, next(WIDTH_BITS)?);
            if *width + dropped > LEAF_BITS {
                return Err("coordinates of at most 21 bits");
            }
        }
        for _ in 0..BLOCK.min(count - words.len()) {
            let mut place = [0; 3];
            for (place, (low, width)) in place.iter_mut().zip(axes) {
                let value = low + next(width)?;
                if value >> (LEAF_BITS - dropped) != 0 {
                    return Err("places inside the cell");
                }
                *place = value << dropped | (1 << dropped) >> 1;
            }
            words.push(pack_leaf(place, false));
        }
    }
    let read = at.div_ceil(8);
    // What is left of the last byte is zero.
    if !at.is_multiple_of(8) && bytes[read - 1] >> (at % 8) != 0 {
        return Err("zeros behind the places of its clusters");
    }
    Ok((words, read))
}

fn coordinate(word: u64, axis: usize) -> u32 {
    (word >> (LEAF_BITS * axis as u32)) as u32 & ((1 << LEAF_BITS) - 1)
}

/// Bits on their way into bytes.
struct Bits<'a> {
    out: &'a mut Vec<u8>,
    held: u64,
    count: u32,
}

impl Bits<'_> {
    fn put(&mut self, value: u32, width: u32) {
        self.held |= u64::from(value) << self.count;
        self.count += width;
        while self.count >= 8 {
            self.out.push(self.held as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    fn finish(self) {
        if self.count > 0 {
            self.out.push(self.held as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn classes_are_in_order_and_tell_how_many_there_are() {
        for rank in 1..MOST as u32 {
            let class = u32::from(class_of(rank));
            assert!(first_of(class) <= rank && rank < first_of(class + 1), "{rank}: {class}");
            let whole = whole_classes(rank);
            assert!(whole <= rank && f64::from(whole) >= 0.95 * f64::from(rank), "{rank}: {whole}");
            // Without that class and those after it there are as many clusters as it says.
            let drawn = 1 + (1..MOST as u32).filter(|&other| class_of(other) < class_of(whole)).count();
            assert!(rank > 300 || drawn == whole as usize, "{rank}: {drawn} {whole}");
        }
        assert_eq!((step_count(1), step_count(2), step_count(5), step_count(8192)), (1, 2, 4, 14));
        assert_eq!((step_clusters(0, 5), step_clusters(2, 5), step_clusters(3, 5)), (1, 4, 5));
    }

    fn packed() -> impl Strategy<Value = PackedClusters> {
        let cluster = (0..1_u64 << 63, any::<u8>(), any::<u8>(), any::<u8>(), 0..4096_u16);
        prop::collection::vec(cluster, 1..200).prop_map(|clusters| PackedClusters {
            shift: [0.25, -1.0, 0.5],
            masses: (Ladder { low: -3.0, step: 0.5 }, clusters.iter().map(|c| c.1).collect()),
            sizes: (Ladder { low: 3.0, step: 0.25 }, clusters.iter().map(|c| c.2).collect()),
            published: Some((Ladder { low: 1.0, step: 0.125 }, clusters.iter().map(|c| c.1 ^ c.2).collect())),
            ranks: clusters[1..].iter().map(|c| c.3).collect(),
            shapes: clusters.iter().map(|c| c.4).collect(),
            words: clusters.iter().map(|c| c.0).collect(),
            steps: vec![
                StoredStep { priority: 1.0, scale: 2.0, misfit: 3.0, largest: 4.0 };
                step_count(clusters.len())
            ],
        })
    }

    proptest! {
        #[test]
        fn places_are_as_exact_as_sizes_ask_for(
            clusters in prop::collection::vec((prop::array::uniform3(0.0..1.0f64), -30.0..0.0f64), 1..100),
        ) {
            let places: Vec<[f64; 3]> = clusters.iter().map(|cluster| cluster.0).collect();
            let sizes: Vec<f64> = clusters.iter().map(|cluster| cluster.1.exp2()).collect();
            let count = places.len();
            let mut packed = PackedClusters {
                masses: (Ladder::default(), vec![0; count]),
                sizes: (Ladder::default(), vec![0; count]),
                ranks: vec![0; count - 1],
                shapes: vec![0; count],
                steps: vec![StoredStep::default(); step_count(count)],
                ..PackedClusters::default()
            };
            packed.set_places(&places, &sizes);
            let mut bytes = vec![];
            packed.encode(0, &mut bytes);
            let (back, _) = PackedClusters::decode(&bytes, count, 0, false).unwrap();
            prop_assert_eq!(&back.words, &packed.words);
            for (i, (place, size)) in places.iter().zip(&sizes).enumerate() {
                for (a, b) in back.place(i).iter().zip(place) {
                    prop_assert!((a - b).abs() <= size / 4.0 + 1e-6, "{a} {b} {size}");
                }
            }
        }

        #[test]
        fn sections_come_back_and_broken_ones_are_refused(clusters in packed(), cut in 0.0..1.0f64, flip: (usize, u8)) {
            let mut bytes = vec![];
            clusters.encode(12, &mut bytes);
            let (back, len) = PackedClusters::decode(&bytes, clusters.len(), 12, true).unwrap();
            prop_assert_eq!(len, bytes.len());
            prop_assert_eq!(&back, &clusters);
            let shorter = &bytes[..(cut * bytes.len() as f64) as usize];
            prop_assert!(PackedClusters::decode(shorter, clusters.len(), 12, true).is_err());
            let at = flip.0 % bytes.len();
            bytes[at] ^= 1 << (flip.1 % 8);
            let _ = PackedClusters::decode(&bytes, clusters.len(), 12, true);
        }

        #[test]
        fn ladders_are_off_by_half_a_step(values in prop::collection::vec(1e-9..1e9f64, 1..50)) {
            let ladder = Ladder::over(values.iter().copied());
            for value in values {
                let decoded = ladder.value(ladder.step_of(value));
                prop_assert!((decoded / value).log2().abs() <= 0.51 * f64::from(ladder.step) + 1e-5);
            }
        }
    }

    #[test]
    fn ladders_of_nothing_have_one_step() {
        for ladder in [Ladder::over([0.0, f64::NAN].into_iter()), Ladder::over([3.0].into_iter())] {
            assert_eq!((ladder.step, ladder.step_of(0.0), ladder.step_of(5.0)), (0.0, 0, 0));
        }
    }
}
