//! The run file: the page files of many steps, and a directory that says when each of them is. Its specification is
//! `docs/series-file.md`.
//!
//! A step's still is a whole page file, to the byte what a build of that snapshot alone writes; it is opened through a window on the
//! file.

mod flow;
mod ids;
mod kept;
mod layout;
mod long_tracks;
mod members;
mod paths;
mod snapshot;
mod track_layout;
mod track_tree;
mod tracks;
mod verify;
mod writer;

pub use flow::{FlowParts, FlowTracks, MOST_FLOW_LEVELS, encode_members};
pub use ids::encode_ids;
pub use layout::{Directory, HEADER_LEN, MAGIC, Section, Step, VERSION};
pub use long_tracks::encode_long_tracks;
pub use members::{FamilyMembers, MemberTracks, Wanted};
pub use paths::{PathsOf, RunPaths};
pub use snapshot::RunSnapshot;
pub use track_layout::{Deviation, FamilyTracks, IntervalTracks, Matches, Tangents, TrackFamily, TrackLayout, span};
pub use track_tree::RunTree;
pub use tracks::{LEAF_TRACKS, NodePart, TrackCoding, TrackIndex, TrackNode, as_stored};
pub use verify::{VerifiedRun, verify_run};
pub use writer::RunFileWriter;

use super::disk::{Disk, Window, room};
use super::error::{Damage, StoreError};
use super::open_disk::open_disk;
use super::page_file::PageFile;
use crate::hierarchy::spacetime::{Interval, Tracks};
use crate::model::url::shown;
use crate::model::{Epoch, Moment, Placement, ReadMethod, StepTimes, When};
use ids::decode_ids;
use layout::{Header, HeaderError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An open run. It holds the directory, never a still.
#[derive(Debug)]
pub struct RunFile {
    path: PathBuf,
    disk: Arc<dyn Disk>,
    header: Header,
    directory: Directory,
    times: StepTimes,
    read: ReadMethod,
}

impl RunFile {
    /// Opens a file, here or behind a URL, and checks its header and directory. Stills are checked as they are read.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read, is no run or is damaged.
    pub fn open(path: &Path, method: ReadMethod) -> Result<RunFile, StoreError> {
        let run = RunFile::open_on(&shown(path), open_disk(path, method, KIND)?)?;
        Ok(RunFile { read: method, ..run })
    }

    /// The same for bytes that lie anywhere; `path` is what messages call them.
    ///
    /// # Errors
    /// As [`RunFile::open`].
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<RunFile, StoreError> {
        let io = |action| move |source| StoreError::Io { path: path.to_path_buf(), action, source };
        let real_len = disk.size().map_err(io("look at"))?;
        let mut head = vec![0; (HEADER_LEN as u64).min(real_len) as usize];
        disk.read_exact_at(&mut head, 0).map_err(io("read the header"))?;
        let header = Header::decode(&head, real_len).map_err(|error| match error {
            HeaderError::NotARun(expected) => StoreError::NotThis { path: path.to_path_buf(), kind: KIND, expected },
            HeaderError::Version(found) => {
                StoreError::Version { path: path.to_path_buf(), kind: KIND, found, supported: [VERSION, VERSION] }
            }
            HeaderError::Damaged(damage) => damage.in_file(path),
        })?;
        let damaged = |place: &str, expected: &str| Damage::new(place, expected).in_file(path);
        // The directory ends the file, so it is no longer than that.
        let len = room(header.directory.len).ok_or_else(|| damaged("header", "a directory that fits in memory"))?;
        let mut bytes = vec![0; len];
        disk.read_known_at(&mut bytes, header.directory.offset, header.directory_crc)
            .map_err(io("read the directory"))?;
        if crc32c::crc32c(&bytes) != header.directory_crc {
            return Err(damaged("directory", "its checksum"));
        }
        let directory = Directory::decode(&bytes, header.directory.offset).map_err(|damage| damage.in_file(path))?;
        let times = directory.times();
        Ok(RunFile { path: path.to_path_buf(), disk, header, directory, times, read: ReadMethod::default() })
    }

    /// Whether `bytes`, the first ones of a file, say that it is a run of any version.
    pub fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    /// What it holds.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// When its steps are.
    pub fn times(&self) -> &StepTimes {
        &self.times
    }

    /// The path as it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    pub fn bytes(&self) -> u64 {
        self.header.file_len
    }

    /// Where `when` lies in the run.
    ///
    /// # Errors
    /// [`StoreError::Moment`] where it lies outside.
    pub fn moment(&self, when: When) -> Result<Moment, StoreError> {
        let refused = |reason| StoreError::Moment { path: self.path.clone(), when, reason };
        let moment = self.times.moment(when).map_err(refused)?;
        Ok(Moment { u: self.directory.clock_share(moment).unwrap_or(moment.u), ..moment })
    }

    /// The time of a moment, in the unit of the steps' times.
    pub fn time(&self, moment: Moment) -> f64 {
        self.times.time(self.evenly(moment))
    }

    /// The place of a step in time, and what velocities of its snapshot mean; `None` where there is no such step, or the run has no tracks.
    pub fn epoch(&self, step: usize) -> Option<Epoch> {
        let tracks = self.directory.tracks.as_ref()?;
        let time = self.directory.steps.get(step)?.time;
        let scale_factor = tracks.is_comoving.then_some(time);
        Some(Epoch { time: Some(time), scale_factor, cosmology: tracks.cosmology, motion: tracks.motion })
    }

    /// The redshift of a moment; `None` where steps have none.
    pub fn redshift(&self, moment: Moment) -> Option<f64> {
        self.times.redshift(self.evenly(moment))
    }

    /// A moment whose place in the interval is by the steps' times, not by the clock, where the two differ.
    fn evenly(&self, moment: Moment) -> Moment {
        if self.directory.clock_share(moment).is_none() || moment.u <= 0.0 {
            return moment;
        }
        // Clocks go forward together, so halving finds it.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let u = 0.5 * (low + high);
            match self.directory.clock_share(Moment { u, ..moment }) {
                Some(share) if share < moment.u => low = u,
                _ => high = u,
            }
        }
        Moment { u: 0.5 * (low + high), ..moment }
    }

    /// The page file of a step as it was built, in its own units.
    ///
    /// # Errors
    /// [`StoreError`] where there is no such step, or its header or footer cannot be read or is damaged.
    pub fn still(&self, step: usize) -> Result<PageFile, StoreError> {
        let file = PageFile::open_on(&self.path, Arc::new(self.window(step)?));
        let file = file.map_err(|error| in_step(error, step))?;
        Ok(PageFile { read: self.read, ..file })
    }

    /// The page file of a step where it lies in the run: in the run's units.
    ///
    /// # Errors
    /// As [`RunFile::still`], and where its values leave the range of 32-bit floats in the run's units.
    pub fn placed_still(&self, step: usize) -> Result<PageFile, StoreError> {
        let still = self.still(step)?;
        let Step { length_scale, mass_scale, .. } = self.step(step)?;
        let placement = Placement { scale: *length_scale, mass: *mass_scale, ..Placement::HERE };
        if placement.is_here() {
            return Ok(still);
        }
        Ok(PageFile::join(vec![(still, placement)])?.0)
    }

    /// What tracks have in common.
    ///
    /// # Errors
    /// Where the run has none.
    pub fn tracks(&self) -> Result<&TrackLayout, StoreError> {
        let none = || StoreError::NoTracks { path: self.path.clone() };
        self.directory.tracks.as_ref().filter(|_| !self.directory.intervals.is_empty()).ok_or_else(none)
    }

    /// The interval after a step.
    ///
    /// # Errors
    /// As [`RunFile::tracks`].
    pub fn interval(&self, interval: usize) -> Result<Interval, StoreError> {
        let layout = self.tracks()?;
        Ok(Interval {
            lattice: layout.lattice,
            length: layout.length(interval),
            spans: [layout.span(interval), layout.span(interval + 1)],
            box_size: layout.box_size,
        })
    }

    /// The nodes of a family's tracks (by its number in the layout) over an interval.
    ///
    /// # Errors
    /// Where there are none, or they cannot be read or are damaged.
    pub fn track_index(&self, interval: usize, family: usize) -> Result<TrackIndex, StoreError> {
        let found = self.family_tracks(interval, family)?;
        let bytes = self.known(found.index.offset, found.index.len, found.index_crc)?;
        let place = format!("interval {interval}, family {family}");
        if crc32c::crc32c(&bytes) != found.index_crc {
            return Err(self.damaged(place, "the checksum of its index"));
        }
        let index = TrackIndex::decode(&bytes, found.tracks, found.nodes.len);
        let index = index.map_err(|damage| damage.in_file(&self.path))?;
        match index.nodes.len() == found.count as usize {
            true => Ok(index),
            false => Err(self.damaged(place, &format!("an index of {} nodes", found.count))),
        }
    }

    /// The tracks of a node; of a leaf with or without their ids.
    ///
    /// # Errors
    /// As [`RunFile::track_index`].
    pub fn node_tracks(
        &self,
        interval: usize,
        family: usize,
        node: &TrackNode,
        with_ids: bool,
    ) -> Result<Tracks, StoreError> {
        self.decode_node(interval, family, node, &self.fetch_node(interval, family, node, with_ids)?)
    }

    /// The bytes of a node's tracks; of a leaf with or without those of their ids.
    fn fetch_node(
        &self,
        interval: usize,
        family: usize,
        node: &TrackNode,
        with_ids: bool,
    ) -> Result<Vec<u8>, StoreError> {
        let start = self.family_tracks(interval, family)?.nodes.offset + node.offset;
        let NodePart { len, crc } = node.states;
        if !with_ids {
            return self.known(start, u64::from(len), crc);
        }
        let crc = crc32c::crc32c_combine(crc, node.ids.crc, node.ids.len as usize);
        self.known(start, u64::from(len) + u64::from(node.ids.len), crc)
    }

    /// The tracks that [`RunFile::fetch_node`] has read.
    fn decode_node(
        &self,
        interval: usize,
        family: usize,
        node: &TrackNode,
        bytes: &[u8],
    ) -> Result<Tracks, StoreError> {
        let attributes = self.tracks()?.families.get(family).map_or(0, |family| family.attributes.len());
        let place = || format!("interval {interval}, family {family}, tracks at {}", node.offset);
        let damaged = |expected: &str| self.damaged(place(), expected);
        let parts = bytes.split_at_checked(node.states.len as usize);
        let (states, ids) = parts.ok_or_else(|| damaged("as many bytes as its index says"))?;
        let with_ids = !ids.is_empty();
        if crc32c::crc32c(states) != node.states.crc || (with_ids && crc32c::crc32c(ids) != node.ids.crc) {
            return Err(damaged("its checksum"));
        }
        let coding = TrackCoding::of(&self.interval(interval)?);
        let mut tracks = coding.decode(states, node.tracks as usize, attributes).map_err(damaged)?;
        if with_ids {
            tracks.ids = decode_ids(ids, node.tracks as usize).map_err(damaged)?;
        }
        Ok(tracks)
    }

    fn family_tracks(&self, interval: usize, family: usize) -> Result<&FamilyTracks, StoreError> {
        let found = self.directory.intervals.get(interval).and_then(|interval| interval.families.get(family));
        found.ok_or_else(|| self.damaged("directory".into(), &format!("an interval {interval} with a family {family}")))
    }

    fn damaged(&self, place: String, expected: &str) -> StoreError {
        Damage::new(place, expected).in_file(&self.path)
    }

    /// Whether steps have stills; else what is shown of them is drawn from tracks.
    pub fn has_stills(&self) -> bool {
        self.directory.has_stills
    }

    /// Copies a step's page file to the end of `out`; returns how many bytes it has.
    ///
    /// # Errors
    /// Where the run cannot be read or `out` not be written; `target` is what messages call it.
    pub fn copy_still(&self, step: usize, out: &mut dyn Write, target: &Path) -> Result<u64, StoreError> {
        if !self.has_stills() {
            return Err(StoreError::NoStills { path: self.path.clone() });
        }
        let window = self.window(step)?;
        let len = self.step(step)?.still.len;
        let mut buffer = vec![0; len.min(1 << 20) as usize];
        let mut done = 0;
        while done < len {
            let part = &mut buffer[..(len - done).min(1 << 20) as usize];
            let read = window.read_exact_at(part, done);
            read.map_err(|source| StoreError::Io { path: self.path.clone(), action: "read a still", source })?;
            let written = out.write_all(part);
            written.map_err(|source| StoreError::Io { path: target.to_path_buf(), action: "write", source })?;
            done += part.len() as u64;
        }
        Ok(len)
    }

    fn step(&self, step: usize) -> Result<&Step, StoreError> {
        let last = self.directory.steps.len() - 1;
        let refused = || StoreError::Moment {
            path: self.path.clone(),
            when: When::Step(u32::try_from(step).unwrap_or(u32::MAX)),
            reason: format!("the run has steps 0 to {last}"),
        };
        self.directory.steps.get(step).ok_or_else(refused)
    }

    fn window(&self, step: usize) -> Result<Window, StoreError> {
        let Section { offset, len } = self.step(step)?.still;
        Ok(Window::new(Arc::clone(&self.disk), offset, len))
    }

    /// How many reads at a time serve best, where that is up to the disk ([`Disk::reads_at_once`]).
    pub fn reads_at_once(&self) -> Option<usize> {
        self.disk.reads_at_once()
    }

    /// Bytes `[start, end)` of the file, for the verifier's look at the padding.
    fn raw(&self, start: u64, end: u64) -> Result<Vec<u8>, StoreError> {
        self.part(start, end.saturating_sub(start), |bytes| self.disk.read_exact_at(bytes, start))
    }

    /// A part of the file that should have this CRC-32C; who asks for it looks whether it has.
    fn known(&self, start: u64, len: u64, crc: u32) -> Result<Vec<u8>, StoreError> {
        self.part(start, len, |bytes| self.disk.read_known_at(bytes, start, crc))
    }

    /// A part of the file that has its checksum; messages call it `place`.
    fn checked(&self, start: u64, part: NodePart, place: impl Fn() -> String) -> Result<Vec<u8>, StoreError> {
        let bytes = self.known(start, u64::from(part.len), part.crc)?;
        match crc32c::crc32c(&bytes) == part.crc {
            true => Ok(bytes),
            false => Err(self.damaged(place(), "its checksum")),
        }
    }

    fn part(
        &self,
        start: u64,
        len: u64,
        read: impl FnOnce(&mut [u8]) -> std::io::Result<()>,
    ) -> Result<Vec<u8>, StoreError> {
        let place = || format!("bytes {start} to {}", start.saturating_add(len));
        let len = room(len).ok_or_else(|| self.damaged(place(), "a part that fits in memory"))?;
        let mut bytes = vec![0; len];
        read(&mut bytes).map_err(|source| StoreError::Io { path: self.path.clone(), action: "read", source })?;
        Ok(bytes)
    }
}

/// What messages call such a file.
const KIND: &str = "run";

/// The error of a page file, which is a step's still.
fn in_step(error: StoreError, step: usize) -> StoreError {
    match error {
        StoreError::Damaged { path, place, expected } => {
            StoreError::Damaged { path, place: format!("step {step}, {place}"), expected }
        }
        StoreError::NotThis { path, expected, .. } => {
            StoreError::Damaged { path, place: format!("step {step}"), expected: format!("a page file: {expected}") }
        }
        error => error,
    }
}
