//! Long tracks of flow levels in the file: which tracks over the halves of a stretch each consists of, and how far it is from them. They
//! take a few bytes each, since their states are those of the first and the last track of their chain.

use super::RunFile;
use super::tracks::NodePart;
use crate::codec::states::{BLOCK, decode, decode_unsigned, encode, encode_unsigned};
use crate::hierarchy::spacetime::chains::{LEAST_ERROR, MOST_IMAGES};
use crate::hierarchy::spacetime::{Interval, LongTrack, Stretch};
use crate::store::error::StoreError;

/// The long tracks over a stretch, as bytes; images where the box is periodic.
pub fn encode_long_tracks(long: &[LongTrack], is_periodic: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let mut next = 0;
    let gaps = long.iter().map(|own| {
        let gap = own.halves[0] - next;
        next = own.halves[0] + 1;
        u64::from(gap)
    });
    encode_unsigned(gaps, &mut out);
    let second: Vec<i64> = long.iter().map(|own| i64::from(own.halves[1])).collect();
    encode(&second, after, &mut out);
    encode_unsigned(long.iter().map(|own| u64::from(own.error)), &mut out);
    if is_periodic {
        for axis in 0..3 {
            encode(&long.iter().map(|own| own.image[axis]).collect::<Vec<_>>(), |_, _| 0, &mut out);
        }
    }
    out
}

/// What the second half of a long track is expected to be: the one after that of the track before.
fn after(_: usize, before: &[i64]) -> i64 {
    before.last().map_or(0, |last| last.saturating_add(1))
}

/// Reads [`encode_long_tracks`] of `count` tracks, whose halves are among so many.
fn decode_long_tracks(
    mut bytes: &[u8],
    count: usize,
    halves: [u32; 2],
    is_periodic: bool,
) -> Result<Vec<LongTrack>, &'static str> {
    let input = &mut bytes;
    let gaps = decode_unsigned(input, count)?;
    let second = decode(input, count, after)?;
    let errors = decode_unsigned(input, count)?;
    let mut long = Vec::with_capacity(count);
    let mut next = 0_u32;
    for ((gap, second), error) in gaps.into_iter().zip(second).zip(errors) {
        let first = u32::try_from(gap).ok().and_then(|gap| next.checked_add(gap)).filter(|first| *first < halves[0]);
        let first = first.ok_or("tracks of the first half that rise")?;
        next = first + 1;
        let second = u32::try_from(second).ok().filter(|second| *second < halves[1]);
        let second = second.ok_or("tracks of the second half")?;
        let error = u8::try_from(error).ok().filter(|error| *error <= LEAST_ERROR).ok_or("errors that there are")?;
        long.push(LongTrack { halves: [first, second], image: [0; 3], error });
    }
    if is_periodic {
        for axis in 0..3 {
            for (own, image) in long.iter_mut().zip(decode(input, count, |_, _| 0)?) {
                own.image[axis] = image;
            }
        }
    }
    let is_image = |own: &LongTrack| own.image.iter().all(|image| (-MOST_IMAGES..=MOST_IMAGES).contains(image));
    if !input.is_empty() || !long.iter().all(is_image) {
        return Err("images of the box, and nothing after them");
    }
    let mut seconds: Vec<u32> = long.iter().map(|own| own.halves[1]).collect();
    seconds.sort_unstable();
    match seconds.windows(2).any(|pair| pair[0] == pair[1]) {
        true => Err("tracks of the second half, each in one"),
        false => Ok(long),
    }
}

impl RunFile {
    /// A stretch of intervals as if it were one.
    ///
    /// # Errors
    /// As [`RunFile::tracks`], and where there are no such intervals.
    pub fn stretch(&self, stretch: Stretch) -> Result<Interval, StoreError> {
        let layout = self.tracks()?;
        let intervals = stretch.intervals();
        match (layout.clock.get(intervals.start), layout.clock.get(intervals.end)) {
            (Some(begin), Some(end)) if intervals.start < intervals.end => Ok(Interval {
                lattice: layout.lattice,
                length: end - begin,
                spans: [layout.span(intervals.start), layout.span(intervals.end)],
                box_size: layout.box_size,
            }),
            _ => Err(self.no_stretch(stretch)),
        }
    }

    /// The long tracks of a flow level, from 1 on, of a family over a stretch of two intervals or more.
    ///
    /// # Errors
    /// Where there is no such stretch or level, or they cannot be read or are damaged.
    pub fn long_tracks(&self, stretch: Stretch, family: usize, level: usize) -> Result<Vec<LongTrack>, StoreError> {
        let halves = stretch.halves().ok_or_else(|| self.no_stretch(stretch))?;
        let (count, offset, part) = self.long_part(stretch, family, level)?;
        let mut of_halves = [0; 2];
        for (own, half) in of_halves.iter_mut().zip(halves) {
            *own = match half.scale {
                1 => {
                    self.family_tracks(half.number, family)?.flow.levels.get(level - 1).map_or(0, |(tracks, _)| *tracks)
                }
                _ => self.long_part(half, family, level)?.0,
            };
        }
        let place = || format!("{}, family {family}, flow level {level}", named(stretch));
        // Before there is room for it: it lies in the file.
        let bytes = self.checked(offset, part, place)?;
        if u64::from(count) > u64::from(part.len) * BLOCK as u64 {
            return Err(self.damaged(place(), "no more long tracks than its bytes can hold"));
        }
        let is_periodic = self.tracks()?.box_size.is_some();
        let long = decode_long_tracks(&bytes, count as usize, of_halves, is_periodic);
        long.map_err(|expected| self.damaged(place(), expected))
    }

    /// How many long tracks there are over a stretch, and where.
    fn long_part(&self, stretch: Stretch, family: usize, level: usize) -> Result<(u32, u64, NodePart), StoreError> {
        let flow = &self.family_tracks(stretch.last(), family)?.flow;
        let before = Stretch::ending_with(stretch.last()).position(|own| own == stretch);
        let own = flow.long.get(level.wrapping_sub(1)).zip(before).and_then(|(own, before)| own.get(before));
        let (count, part) = *own.ok_or_else(|| self.no_stretch(stretch))?;
        let levels = flow.levels.iter().chain(flow.long[..level - 1].iter().flatten());
        let lower = levels.chain(&flow.long[level - 1][..before.unwrap_or(0)]);
        let offset = lower.map(|(_, part)| u64::from(part.len)).sum::<u64>();
        Ok((count, flow.section.offset + offset, part))
    }

    fn no_stretch(&self, stretch: Stretch) -> StoreError {
        self.damaged("directory".into(), &format!("long tracks over {}", named(stretch)))
    }
}

/// What messages call a stretch.
fn named(stretch: Stretch) -> String {
    let intervals = stretch.intervals();
    format!("intervals {} to {}", intervals.start, intervals.end.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(cases(64))]

        #[test]
        fn long_tracks_come_back(
            gaps in prop::collection::vec((0_u32..9, 0..=LEAST_ERROR, -2..3_i64), 0..90), is_periodic: bool, at: usize, byte: u8,
        ) {
            let mut first = 0;
            let count = gaps.len() as u32;
            let long: Vec<LongTrack> = gaps.iter().zip(0..).map(|((gap, error, image), i)| {
                first += gap + 1;
                let image = if is_periodic { [*image, 0, -image] } else { [0; 3] };
                // In another order, each once: 7919 is a prime number.
                LongTrack { halves: [first - 1, (i * 7919) % count.max(1)], image, error: *error }
            }).collect();
            let mut bytes = encode_long_tracks(&long, is_periodic);
            let halves = [first, count];
            prop_assert_eq!(decode_long_tracks(&bytes, long.len(), halves, is_periodic).unwrap(), long.clone());
            if !long.is_empty() {
                prop_assert!(decode_long_tracks(&bytes, long.len(), [first - 1, count], is_periodic).is_err());
                prop_assert!(decode_long_tracks(&bytes, long.len(), [first, count - 1], is_periodic).is_err());
                prop_assert!(decode_long_tracks(&bytes[..bytes.len() - 1], long.len(), halves, is_periodic).is_err());
                let twice = [long.clone(), vec![LongTrack { halves: [first, long[0].halves[1]], ..long[0] }]].concat();
                let twice = encode_long_tracks(&twice, is_periodic);
                prop_assert!(decode_long_tracks(&twice, long.len() + 1, [first + 1, count], is_periodic).is_err());
                // Damage that a checksum does not find is no panic.
                let at = at % bytes.len();
                bytes[at] = byte;
                drop(decode_long_tracks(&bytes, long.len(), halves, is_periodic));
            }
        }
    }
}
