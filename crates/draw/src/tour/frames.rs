//! Which frames a recording has, when they are, and what they are called.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Frames at a fixed rate: number `n` of the tour is at `n / rate` seconds, whatever part is recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    /// Frames per second.
    pub rate: f64,
    /// The numbers that are recorded.
    pub range: RangeInclusive<u32>,
    last: u32,
}

/// Most frames of a tour: a day at a thousand a second.
const MOST: f64 = 86_400_000.0;

impl Frames {
    /// The frames of a tour of so many seconds from one time to another. A tour that begins again at its end does not show its
    /// first frame twice.
    ///
    /// # Errors
    /// When there are none, or too many.
    pub fn new(duration: f64, repeats: bool, rate: f64, [start, end]: [Option<f64>; 2]) -> Result<Frames, String> {
        // A frame that is late by less than a thousandth of its time is meant to be there.
        let before = |time: f64| (time * rate - 1e-3).ceil() - 1.0;
        let last = if repeats && duration > 0.0 { before(duration) } else { (duration * rate + 1e-3).floor() };
        if last.is_nan() || last > MOST {
            return Err(format!("--fps: {duration} s at {rate} frames a second are too many frames"));
        }
        let first = (start.unwrap_or(0.0) * rate - 1e-3).ceil().max(0.0);
        let end = end.map_or(last, |end| before(end).min(last));
        if end < first {
            return Err(format!("--start, --end: no frame lies there; the tour is {duration:.2} s long"));
        }
        Ok(Frames { rate, range: first as u32..=end as u32, last: last.max(0.0) as u32 })
    }

    /// The number of the tour's last frame.
    pub fn last(&self) -> u32 {
        self.last
    }

    /// When a frame is, seconds.
    pub fn time(&self, number: u32) -> f64 {
        f64::from(number) / self.rate
    }

    /// How many frames are recorded.
    pub fn count(&self) -> usize {
        self.range.clone().count()
    }
}

/// Names with a number in them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    before: String,
    digits: usize,
    after: String,
    text: String,
}

impl std::str::FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Pattern, String> {
        let expected = || "expected a name with one number such as frame-%05d, without folders".to_owned();
        let (before, rest) = text.split_once('%').ok_or_else(expected)?;
        let (digits, after) = rest.split_once('d').ok_or_else(expected)?;
        let digits = if digits.is_empty() { Some(1) } else { digits.strip_prefix('0').and_then(|n| n.parse().ok()) };
        let digits = digits.filter(|digits| (1..=12).contains(digits)).ok_or_else(expected)?;
        let is_plain = |part: &str| !part.contains(['/', '\\', '%', '\0']);
        match is_plain(before) && is_plain(after) && !before.starts_with('.') {
            true => Ok(Pattern { before: before.into(), digits, after: after.into(), text: text.into() }),
            false => Err(expected()),
        }
    }
}

impl std::fmt::Display for Pattern {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

impl Pattern {
    /// The name of a number.
    pub fn name(&self, number: u64) -> String {
        let Pattern { before, digits, after, .. } = self;
        format!("{before}{number:0digits$}{after}")
    }

    /// The file of a number in a folder, with an extension.
    pub fn file(&self, folder: &Path, number: u64, extension: &str) -> PathBuf {
        folder.join(format!("{}.{extension}", self.name(number)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_are_where_their_times_say() {
        let all = Frames::new(2.0, false, 30.0, [None, None]).unwrap();
        assert_eq!((all.range.clone(), all.count(), all.time(60)), (0..=60, 61, 2.0));
        assert_eq!(Frames::new(2.0, true, 30.0, [None, None]).unwrap().range, 0..=59);
        let part = |start, end| Frames::new(2.0, false, 30.0, [start, end]).unwrap().range;
        assert_eq!(
            (part(Some(1.0), None), part(None, Some(1.0)), part(Some(0.5), Some(1.0))),
            (30..=60, 0..=29, 15..=29)
        );
        assert_eq!(Frames::new(0.0, true, 30.0, [None, None]).unwrap().range, 0..=0);
        assert!(Frames::new(2.0, false, 30.0, [Some(3.0), None]).is_err());
        assert!(Frames::new(1e9, false, 1e9, [None, None]).is_err());
    }

    #[test]
    fn names_have_their_numbers() {
        let pattern: Pattern = "frame-%05d".parse().unwrap();
        assert_eq!((pattern.name(7), pattern.name(123_456)), ("frame-00007".into(), "frame-123456".into()));
        assert_eq!("%dx".parse::<Pattern>().unwrap().name(7), "7x");
        for wrong in ["frame", "a/%05d", "%5d", "%05x", "%0d%d", ".%05d", "%099d"] {
            assert!(wrong.parse::<Pattern>().is_err(), "{wrong}");
        }
    }

    proptest! {
        /// Parts that meet make the whole, and no frame is there twice.
        #[test]
        fn parts_make_the_whole(duration in 0.1..20.0f64, rate in 1.0..60.0f64, cut in 0.1..0.9f64, repeats in any::<bool>()) {
            let part = |range| Frames::new(duration, repeats, rate, range).map(|frames| frames.range);
            let all = part([None, None]).unwrap();
            let at = Some(cut * duration);
            if let (Ok(first), Ok(second)) = (part([None, at]), part([at, None])) {
                prop_assert_eq!(first.chain(second).collect::<Vec<_>>(), all.collect::<Vec<_>>());
            }
        }
    }
}
