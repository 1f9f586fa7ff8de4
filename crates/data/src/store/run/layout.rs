//! The run file's fixed structures: its header, and the directory at its end.
//!
//! `docs/series-file.md` holds the same tables; a test compares them with the constants here.

use super::track_layout::{IntervalTracks, TrackLayout};
use crate::model::{Bounds, ClockVariable, Moment, StepTimes, Unit};
use crate::store::error::Damage;
use crate::store::layout::{ALIGNMENT, align_up, u32_at, u64_at};
use crate::store::wire::{Decoder, Encoder};
use std::path::PathBuf;

/// First bytes of the file.
pub const MAGIC: [u8; 8] = *b"\x89DFS\r\n\x1a\n";
/// Version of the file.
pub const VERSION: u32 = 6;
/// Bytes of the header that hold something; the rest of its block is zero.
pub const HEADER_LEN: usize = 64;
/// What messages call the directory.
const PLACE: &str = "directory";
/// The clocks by their numbers in the directory.
const CLOCKS: [ClockVariable; 3] = ClockVariable::ALL;
/// Bytes that a step takes in the directory at least.
const LEAST_STEP: usize = 4 + 4 + 8 + 8 + 9 + 8 + 8 + 48 + 16 + 16;

/// Where a section lies in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// First byte, a multiple of [`ALIGNMENT`].
    pub offset: u64,
    /// Bytes, without the zeros up to the next section.
    pub len: u64,
}

impl Section {
    /// Where the section behind it begins; `None` where no file reaches that far.
    pub(super) fn after(self) -> Option<u64> {
        self.offset.checked_add(self.len).and_then(|end| align_up(end, ALIGNMENT))
    }

    pub(super) fn decode(input: &mut Decoder) -> Result<Section, Damage> {
        Ok(Section { offset: input.u64("a section's place")?, len: input.u64("a section's length")? })
    }
}

impl Encoder {
    pub(super) fn section(&mut self, section: Section) {
        self.u64(section.offset);
        self.u64(section.len);
    }
}

/// A stored step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The snapshot, as it was named.
    pub source: PathBuf,
    /// Its format.
    pub format: String,
    /// Size of all its files, bytes.
    pub source_bytes: u64,
    /// Its time, in [`Directory::time_unit`].
    pub time: f64,
    /// Its redshift, where its header says so.
    pub redshift: Option<f64>,
    /// Particles in all families.
    pub particles: u64,
    /// Their mass, in the run's unit.
    pub mass: f64,
    /// The box around their positions, in the run's unit.
    pub bounds: Bounds,
    /// How many of the run's lengths one of its own is.
    pub length_scale: f64,
    /// The same of masses.
    pub mass_scale: f64,
    /// The page file that was built of it.
    pub still: Section,
}

/// Everything that is known of a run without reading a still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Directory {
    /// What times are.
    pub clock: ClockVariable,
    /// Unit of times; empty where it is not known.
    pub time_unit: Unit,
    /// Unit of lengths: the first step's.
    pub length_unit: Unit,
    /// Unit of masses: the first step's.
    pub mass_unit: Unit,
    /// Edge of the periodic box, where there is one.
    pub box_size: Option<f64>,
    /// What was assumed, converted or left out, one sentence each.
    pub notes: Vec<String>,
    /// Whether steps have stills; else outlines of them, and pictures of steps are drawn from tracks.
    pub has_stills: bool,
    /// The steps, each later than the one before; at least one.
    pub steps: Vec<Step>,
    /// What the tracks have in common; `None` in a file of stills alone.
    pub tracks: Option<TrackLayout>,
    /// The tracks from each step to the next; none in a file of stills alone.
    pub intervals: Vec<IntervalTracks>,
}

impl Directory {
    /// When the steps are.
    pub fn times(&self) -> StepTimes {
        let redshifts: Option<Vec<f64>> = self.steps.iter().map(|step| step.redshift).collect();
        // Scale factors that do not rise say nothing about when a step is.
        let rises = |redshifts: &Vec<f64>| redshifts.windows(2).all(|pair| pair[1] < pair[0]);
        StepTimes { times: self.steps.iter().map(|step| step.time).collect(), redshifts: redshifts.filter(rises) }
    }

    /// Whether positions are comoving: times are scale factors unless the clock counts time, which is that since the beginning.
    pub fn is_comoving(&self) -> bool {
        self.tracks.as_ref().is_some_and(|tracks| tracks.is_comoving)
    }

    /// The share of an interval of the clock that has passed at a moment whose `u` is by times, where the two differ: the times of
    /// comoving steps are scale factors, and their clock may count time or the logarithm.
    pub(super) fn clock_share(&self, moment: Moment) -> Option<f64> {
        let tracks = self.tracks.as_ref().filter(|tracks| tracks.is_comoving)?;
        if self.clock == ClockVariable::ScaleFactor || moment.u <= 0.0 {
            return None;
        }
        let (begin, end) = (tracks.clock.get(moment.step)?, tracks.clock.get(moment.step + 1)?);
        let factors = [self.steps.get(moment.step)?.time, self.steps.get(moment.step + 1)?.time];
        let scale_factor = factors[0] + moment.u * (factors[1] - factors[0]);
        let value = tracks.clock_at(self.clock, scale_factor)?;
        Some(((value - begin) / (end - begin)).clamp(0.0, 1.0))
    }

    /// The directory's bytes.
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut out = Encoder::default();
        out.u8(CLOCKS.iter().position(|clock| *clock == self.clock).unwrap_or(0) as u8);
        for unit in [&self.time_unit, &self.length_unit, &self.mass_unit] {
            out.text(&unit.0);
        }
        out.option_f64(self.box_size);
        out.u32(self.notes.len() as u32);
        self.notes.iter().for_each(|note| out.text(note));
        out.u8(u8::from(self.has_stills));
        out.u32(self.steps.len() as u32);
        for step in &self.steps {
            out.text(&step.source.to_string_lossy());
            out.text(&step.format);
            out.u64(step.source_bytes);
            out.f64(step.time);
            out.option_f64(step.redshift);
            out.u64(step.particles);
            out.f64(step.mass);
            out.vec3(step.bounds.min);
            out.vec3(step.bounds.max);
            out.f64(step.length_scale);
            out.f64(step.mass_scale);
            out.section(step.still);
        }
        out.u8(u8::from(self.tracks.is_some()));
        if let Some(tracks) = &self.tracks {
            tracks.encode(&mut out);
            self.intervals.iter().for_each(|interval| interval.encode(&mut out));
        }
        out.bytes
    }

    /// Reads a directory whose file ends its sections at `end`.
    pub(super) fn decode(bytes: &[u8], end: u64) -> Result<Directory, Damage> {
        let mut input = Decoder::new(bytes, PLACE);
        let number = input.u8("the clock")?;
        let clock = CLOCKS.get(usize::from(number)).copied();
        let clock = clock.ok_or_else(|| Damage::new(PLACE, format!("a clock from 0 to 2, found {number}")))?;
        let mut unit = |what| input.text(what).map(Unit);
        let (time_unit, length_unit, mass_unit) =
            (unit("the unit of time")?, unit("the length unit")?, unit("the mass unit")?);
        let box_size = input.option_f64("the box size")?;
        let notes = (0..input.count(4, "notes")?).map(|_| input.text("a note")).collect::<Result<_, _>>()?;
        let has_stills = match input.u8("whether there are stills")? {
            number @ (0 | 1) => number == 1,
            other => return Err(Damage::new(PLACE, format!("stills (1) or outlines (0), found {other}"))),
        };
        let count = input.count(LEAST_STEP, "steps")?;
        let steps = (0..count).map(|_| decode_step(&mut input)).collect::<Result<Vec<_>, _>>()?;
        let (tracks, intervals) = match input.u8("whether there are tracks")? {
            0 => (None, Vec::new()),
            1 => {
                let layout = TrackLayout::decode(&mut input, steps.len())?;
                let (families, levels) = (layout.families.len(), layout.flow_errors.len());
                let interval = |interval| IntervalTracks::decode(&mut input, interval, families, levels);
                let intervals = (0..steps.len().saturating_sub(1)).map(interval).collect::<Result<_, _>>()?;
                (Some(layout), intervals)
            }
            other => return Err(Damage::new(PLACE, format!("tracks (1) or none (0), found {other}"))),
        };
        input.finish()?;
        let directory = Directory {
            clock,
            time_unit,
            length_unit,
            mass_unit,
            box_size,
            notes,
            has_stills,
            steps,
            tracks,
            intervals,
        };
        directory.check(end)?;
        Ok(directory)
    }

    /// Steps rise in time; their stills, and then tracks, follow one another from the header to the directory.
    fn check(&self, end: u64) -> Result<(), Damage> {
        if self.steps.is_empty() {
            return Err(Damage::new(PLACE, "at least one step"));
        }
        if !self.has_stills && self.intervals.is_empty() {
            return Err(Damage::new(PLACE, "stills or tracks"));
        }
        let mut next = ALIGNMENT;
        for (number, step) in self.steps.iter().enumerate() {
            let wrong = |expected: &str| Damage::new(format!("{PLACE}, step {number}"), expected);
            let scales = [step.length_scale, step.mass_scale];
            if !step.time.is_finite() || !scales.iter().all(|scale| scale.is_finite() && *scale > 0.0) {
                return Err(wrong("a finite time and positive scales"));
            }
            if number > 0 && self.steps[number - 1].time >= step.time {
                return Err(wrong("a later time than that of the step before"));
            }
            let after = step.still.after().filter(|_| step.still.len > 0);
            next = match after {
                Some(after) if step.still.offset == next && after <= end => after,
                _ => return Err(wrong("a still right after the one before")),
            };
        }
        for (number, interval) in self.intervals.iter().enumerate() {
            for section in interval.sections() {
                next = match section.after() {
                    Some(after) if section.offset == next && after <= end => after,
                    _ => {
                        let expected = "tracks right after those before";
                        return Err(Damage::new(format!("{PLACE}, interval {number}"), expected));
                    }
                };
            }
        }
        if next != end {
            return Err(Damage::new(PLACE, "to begin right after the last section"));
        }
        Ok(())
    }
}

fn decode_step(input: &mut Decoder) -> Result<Step, Damage> {
    Ok(Step {
        source: input.text("a step's source")?.into(),
        format: input.text("a step's format")?,
        source_bytes: input.u64("the size of a step's source")?,
        time: input.f64("a step's time")?,
        redshift: input.option_f64("a step's redshift")?,
        particles: input.u64("a step's particles")?,
        mass: input.f64("a step's mass")?,
        bounds: Bounds { min: input.vec3("a step's bounds")?, max: input.vec3("a step's bounds")? },
        length_scale: input.f64("a step's scale of lengths")?,
        mass_scale: input.f64("a step's scale of masses")?,
        still: Section::decode(input)?,
    })
}

/// The fixed header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub version: u32,
    /// Length of the whole file, bytes.
    pub file_len: u64,
    pub directory: Section,
    /// CRC-32C of the directory.
    pub directory_crc: u32,
}

/// Why a header was refused.
pub(super) enum HeaderError {
    NotARun(&'static str),
    Version(u32),
    Damaged(Damage),
}

impl Header {
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        let mut out = [0; HEADER_LEN];
        out[0..8].copy_from_slice(&MAGIC);
        out[8..12].copy_from_slice(&self.version.to_le_bytes());
        out[12..16].copy_from_slice(&(ALIGNMENT as u32).to_le_bytes());
        out[16..24].copy_from_slice(&self.file_len.to_le_bytes());
        out[24..32].copy_from_slice(&self.directory.offset.to_le_bytes());
        out[32..40].copy_from_slice(&self.directory.len.to_le_bytes());
        out[40..44].copy_from_slice(&self.directory_crc.to_le_bytes());
        let crc = crc32c::crc32c(&out[..60]);
        out[60..64].copy_from_slice(&crc.to_le_bytes());
        out
    }

    /// Reads a header and checks it against the file's real length.
    pub fn decode(bytes: &[u8], real_len: u64) -> Result<Header, HeaderError> {
        let bytes: &[u8; HEADER_LEN] = bytes
            .get(..HEADER_LEN)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(HeaderError::NotARun("a header of 64 bytes"))?;
        if bytes[..8] != MAGIC {
            return Err(HeaderError::NotARun("its first eight bytes"));
        }
        let version = u32_at(bytes, 8);
        if version != VERSION {
            return Err(HeaderError::Version(version));
        }
        let damaged = |expected: &str| HeaderError::Damaged(Damage::new("header", expected));
        if crc32c::crc32c(&bytes[..60]) != u32_at(bytes, 60) {
            return Err(damaged("its checksum"));
        }
        let header = Header {
            version,
            file_len: u64_at(bytes, 16),
            directory: Section { offset: u64_at(bytes, 24), len: u64_at(bytes, 32) },
            directory_crc: u32_at(bytes, 40),
        };
        if u64::from(u32_at(bytes, 12)) != ALIGNMENT || bytes[44..60].iter().any(|&byte| byte != 0) {
            return Err(damaged("an alignment of 4096 and zeros in the reserved bytes"));
        }
        if header.file_len != real_len {
            let expected = format!("a file of {} bytes, found {real_len}: truncated or extended", header.file_len);
            return Err(HeaderError::Damaged(Damage::new("header", expected)));
        }
        let Section { offset, len } = header.directory;
        if offset.checked_add(len) != Some(header.file_len) || !offset.is_multiple_of(ALIGNMENT) || offset < ALIGNMENT {
            return Err(damaged("a directory that ends the file and starts at a multiple of 4096"));
        }
        Ok(header)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::specification::fields;
    use glam::DVec3;
    use proptest::prelude::*;

    #[test]
    fn the_header_is_as_specified() {
        let directory = Section { offset: 22 << 40, len: 33 << 40 };
        let header = Header { version: VERSION, file_len: 11 << 40, directory, directory_crc: 44 };
        let bytes = header.encode();
        let field = fields(include_str!("../../../../../docs/series-file.md"), "Header", &bytes);
        assert_eq!(field("magic"), MAGIC);
        assert_eq!(field("version"), VERSION.to_le_bytes());
        assert_eq!(field("alignment"), (ALIGNMENT as u32).to_le_bytes());
        assert_eq!(field("file_len"), (11_u64 << 40).to_le_bytes());
        assert_eq!(field("directory_offset"), (22_u64 << 40).to_le_bytes());
        assert_eq!(field("directory_len"), (33_u64 << 40).to_le_bytes());
        assert_eq!(field("directory_crc"), 44_u32.to_le_bytes());
        assert_eq!(field("header_crc"), crc32c::crc32c(&bytes[..60]).to_le_bytes());
    }

    fn directory(steps: usize, redshift: Option<f64>) -> (Directory, u64) {
        let mut end = ALIGNMENT;
        let step = |number: usize| {
            let still = Section { offset: end, len: 5000 + number as u64 };
            end = align_up(still.offset + still.len, ALIGNMENT).unwrap();
            Step {
                source: format!("snapshot_{number}.hdf5").into(),
                format: "gadget-hdf5".into(),
                source_bytes: 1 << 33,
                time: number as f64 * 0.1,
                redshift: redshift.map(|redshift| redshift - number as f64),
                particles: 1 << 40,
                mass: 1.5,
                bounds: Bounds { min: DVec3::splat(-1.0), max: DVec3::new(1.0, 2.0, 3.0) },
                length_scale: 1e-3,
                mass_scale: 1.0,
                still,
            }
        };
        let steps = (0..steps).map(step).collect();
        let notes = vec!["no file between a and c: the interval is longer".to_owned()];
        let unit = Unit::new("kpc/h");
        (
            Directory {
                length_unit: unit,
                box_size: Some(25.0),
                notes,
                has_stills: true,
                steps,
                ..Directory::default()
            },
            end,
        )
    }

    #[test]
    fn directories_come_back_and_broken_promises_are_found() {
        let (whole, end) = directory(3, Some(9.0));
        let bytes = whole.encode();
        assert_eq!(Directory::decode(&bytes, end).unwrap(), whole);
        assert_eq!(whole.times().redshifts, Some(vec![9.0, 8.0, 7.0]));
        assert!(Directory::decode(&bytes, end + ALIGNMENT).is_err(), "a hole before the directory");
        for cut in 0..bytes.len() {
            assert!(Directory::decode(&bytes[..cut], end).is_err(), "{cut}");
        }
        type Break = fn(&mut Directory);
        let breaks: [(Break, &str); 7] = [
            (|d| d.steps.clear(), "at least one step"),
            (|d| d.steps[1].time = 0.0, "a later time"),
            (|d| d.steps[2].time = f64::NAN, "a finite time"),
            (|d| d.steps[2].length_scale = 0.0, "positive scales"),
            (|d| d.steps[1].still.offset += ALIGNMENT, "right after"),
            (|d| d.steps[1].still.len = u64::MAX - 10, "right after"),
            (|d| d.steps[2].still.len = 0, "right after"),
        ];
        for (damage, expected) in breaks {
            let mut broken = whole.clone();
            damage(&mut broken);
            let told = Directory::decode(&broken.encode(), end).unwrap_err();
            assert!(told.expected.contains(expected), "{told:?}, expected {expected}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(at in 0_usize..600, byte: u8, extra in prop::collection::vec(any::<u8>(), 0..64)) {
            let (whole, end) = directory(2, None);
            let mut bytes = whole.encode();
            let at = at % bytes.len();
            bytes[at] = byte;
            drop(Directory::decode(&bytes, end));
            drop(Directory::decode(&extra, end));
        }
    }
}
