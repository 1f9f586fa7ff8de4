//! How much memory each part of a build may take.

use super::cluster::MOST_TASKS;
use super::partition::{RUN, particle_bytes};
use super::spill::Blob;
use super::survey::Survey;
use super::{BuildError, BuildOptions};
use crate::codec::VqBits;
use crate::model::ParticleStream;
use crate::store::temporary::{folder_of, free_bytes};
use std::path::{Path, PathBuf};

/// Memory of the program itself: code, buffers of the threads, tables of nodes.
const BASE: u64 = 96 << 20;
/// What a machine is taken to have free that does not say.
const UNKNOWN: u64 = 4 << 30;
/// Bytes that building a bucket takes for each of its particles, beside its attributes: sorted, and merged at two depths.
const BUCKET_PARTICLE: u64 = 368;
/// The same for each attribute.
const BUCKET_ATTRIBUTE: u64 = 24;
/// Bytes that finding neighbours takes for each particle that is searched for at a time, with those around.
const NEIGHBOUR_PARTICLE: u64 = 480;
/// Bytes of the output for each particle at most, about.
pub(super) const OUTPUT_PARTICLE: u64 = 12;
/// Particles that all nodes of a tree draw, for each source particle, at most about.
const NODE_PARTICLES: f64 = 2.4;
/// The same for the levels for volumes, whose leaves are those of the tree.
const VOLUME_PARTICLES: f64 = 1.4;

/// Bytes by which a task of a job that reads particles tells of those of a bucket, and of those of a group of buckets beside that.
const JOB_SHARE: u64 = 1 + Blob::TOLD;
const JOB_SHARES: u64 = 16 + Blob::TOLD;
/// Bytes by which a process knows of a bucket, and of a run of its particles, such as what a task that has read some has of it: in a list that
/// has just grown.
const HELD_BUCKET: u64 = 512;
const HELD_SHARE: u64 = 2 * size_of::<Blob>() as u64;
/// Particles of a bucket that have room to wait on average, however little memory there is: shorter runs are read no faster, and where they are takes
/// memory, too.
const SHORTEST_RUN: u64 = 64;
/// Groups of buckets around a task's own that it keeps at most: as many as cubes around one.
const AROUND: u64 = 26;
/// Bytes of the sample of a column that is found for the particles of a bucket.
const JOB_FOUND: u64 = 4 << 10;
/// Bytes of what a job's tasks hand on whatever they read: codebooks, histograms, metadata.
const JOB_TABLES: u64 = 4 << 20;
/// Codebooks of a family at most, about.
const JOB_BOOKS: u64 = 64;
/// Parts that what shares a codebook is coded in: so many, and one for each group of buckets, of which there are so many at most.
const JOB_PARTS: (u64, u64) = (16, 64);

/// The shares of a build's memory, bytes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Memory {
    /// Folder of temporary files.
    pub folder: PathBuf,
    /// For the particles of buckets; what exceeds it goes to the disk.
    pub particles: u64,
    /// For particles that wait in their buckets until they are put away.
    pub waiting: u64,
    /// For the particles of nodes.
    pub nodes: u64,
    /// Bytes of temporary files, at most about.
    pub on_disk: u64,
    /// For buckets while they are built.
    buckets: u64,
    /// Bytes that are held meanwhile, at most, without the program.
    held: u64,
    /// For one particle of them.
    bucket_particle: u64,
    allowed: u64,
}

impl Memory {
    /// Shares the memory out for a family of `count` particles in `buckets` buckets of about `most`, and checks that the disk has
    /// room for what memory has not.
    pub fn plan(
        options: &BuildOptions,
        out: &Path,
        count: u64,
        attributes: usize,
        most: usize,
        buckets: usize,
    ) -> Result<Memory, BuildError> {
        let allowed = options.memory.unwrap_or_else(default_memory);
        let folder = options.temporary.clone().unwrap_or_else(|| folder_of(out).to_owned());
        let particle = particle_bytes(attributes);
        let bucket_particle = BUCKET_PARTICLE + BUCKET_ATTRIBUTE * attributes as u64;
        let bucket = bucket_particle * (most as u64).min(count);
        let known = buckets as u64 * HELD_BUCKET;
        let rest = beside(allowed, known);
        let waiting = most_waiting(rest, particle, buckets);
        let all_waiting = count * while_waiting(particle);
        let rest = rest.saturating_sub(waiting.min(all_waiting));
        let held = known + longest_waiting(particle, buckets).min(all_waiting);
        let workers = (rayon::current_num_threads() as u64).min((rest / 2) / bucket.max(1)).max(1);
        let building = (workers * bucket).min(rest);
        let room = room(rest - building);
        let for_particles = count * particle;
        let for_nodes = (count as f64 * node_particles(options) * (4.0 * (3 + attributes) as f64 + 6.0)) as u64;
        let share = |needed: u64| (room as f64 * needed as f64 / (for_particles + for_nodes).max(1) as f64) as u64;
        let (particles, nodes) = (share(for_particles), share(for_nodes));
        let on_disk = for_particles.saturating_sub(particles) + for_nodes.saturating_sub(nodes);
        if on_disk > 0 {
            // The output itself comes on top.
            check_room(&folder, on_disk + OUTPUT_PARTICLE * count, out)?;
        }
        Ok(Memory { folder, particles, waiting, nodes, on_disk, buckets: rest, held, bucket_particle, allowed })
    }

    /// Shares out what a task of a job may take for a family with so many attributes, beside bytes that it holds whatever that is. What it hands
    /// on goes to its file; what it cannot hold goes to the disk in `folder`.
    pub fn of_task(allowed: u64, folder: &Path, attributes: usize, held: u64) -> Memory {
        let rest = beside(allowed, held);
        Memory {
            folder: folder.to_owned(),
            particles: room(rest),
            waiting: 0,
            nodes: rest / 4,
            on_disk: 0,
            buckets: rest,
            held,
            bucket_particle: BUCKET_PARTICLE + BUCKET_ATTRIBUTE * attributes as u64,
            allowed,
        }
    }

    /// Bytes that are left to a task which cannot do with less than it holds.
    ///
    /// # Errors
    /// When that is more than a task of `out` may take; `what` needs it.
    pub fn left(allowed: u64, held: u64, (what, out): (&str, &Path)) -> Result<u64, BuildError> {
        // So much the program takes itself.
        if held > beside(allowed, 0).max(BASE) {
            let needed = held.saturating_add(BASE).div_ceil(1 << 20);
            return Err(BuildError::Memory { path: out.to_owned(), what: what.to_owned(), needed, allowed });
        }
        Ok(room(beside(allowed, held)))
    }

    /// The same as [`Memory::of_task`] of a task that sorts so many particles, of `all` of the job, into so many buckets.
    ///
    /// # Errors
    /// When the buckets, each with room for as few particles as may be, take more than a task of `out` may.
    pub fn of_sorting(
        allowed: u64,
        folder: &Path,
        attributes: usize,
        buckets: usize,
        (particles, all): (u64, u64),
        out: &Path,
    ) -> Result<Memory, BuildError> {
        let known = (buckets as u64).saturating_mul(HELD_BUCKET);
        let (particle, rest) = (particle_bytes(attributes), beside(allowed, known));
        let waiting = most_waiting(rest, particle, buckets);
        let room = while_waiting(particle);
        let runs = particles / (waiting / (particle * buckets as u64).max(1)).max(1);
        let held = known
            .saturating_add(waiting.min(particles.saturating_mul(room)))
            .saturating_add(runs.saturating_mul(HELD_SHARE));
        // So much the program takes itself.
        if held > beside(allowed, 0).max(BASE) {
            // Where all of a task's particles may wait, and where they are put away then.
            let each = room + HELD_SHARE.div_ceil(SHORTEST_RUN);
            let tasks = all.saturating_mul(each).checked_div(rest).map(|tasks| tasks + 1);
            let tasks = tasks.filter(|tasks| *tasks <= u64::from(MOST_TASKS));
            let fewer = tasks.map(|tasks| format!(" (--tasks {tasks} would leave it few enough)"));
            let fewer = fewer.unwrap_or_default();
            return Err(BuildError::Memory {
                path: out.to_owned(),
                what: format!("a task that sorts {particles} particles into {buckets} buckets{fewer}"),
                needed: held.div_ceil(1 << 20),
                allowed,
            });
        }
        Ok(Memory { waiting, ..Memory::of_task(allowed, folder, attributes, held) })
    }

    /// How many groups of buckets around its own a task keeps that finds columns, where one of `groups` takes `each` bytes: one at least, which it
    /// reads, and else no more than an eighth of what it may take.
    pub fn groups_around(allowed: u64, each: u64, groups: u32) -> usize {
        (allowed / 8 / each.max(1)).min(u64::from(groups).saturating_sub(1)).clamp(1, AROUND) as usize
    }

    /// Bytes that a task holds which reads the particles of so many buckets: where each of `tasks` has put some of them.
    pub fn shares(buckets: usize, tasks: u32) -> u64 {
        (buckets as u64).saturating_mul(HELD_BUCKET + u64::from(tasks) * HELD_SHARE)
    }

    /// Bytes that a task holds which sums up what was found in so many columns of so many buckets: the samples of all, in a list that grows.
    pub fn found(buckets: usize, columns: usize) -> u64 {
        (buckets as u64).saturating_mul(2 * JOB_FOUND * columns as u64)
    }

    /// Bytes that the files of a job's tasks take at most, about, for a family with so many columns that `input` tasks read, and whose buckets
    /// are in so many groups; `in_parts` where what shares a codebook is coded in parts. What a task puts away while it works comes on top.
    pub fn of_job(
        options: &BuildOptions,
        stream: &dyn ParticleStream,
        columns: usize,
        (input, groups): (u32, u32),
        in_parts: bool,
    ) -> u64 {
        let count = stream.particles();
        // Positions and codes, which are put away twice where they are refined, beside quantities; estimates beside particles.
        let node_particle = 4.0 * (3 + columns) as f64 + 6.0 + 4.0;
        let for_nodes = (count as f64 * node_particles(options) * node_particle) as u64;
        let for_particles = count.saturating_mul(particle_bytes(columns) + 8);
        let sampled = Survey::bytes_of_parts(stream, columns, &options.octree);
        // Where particles lie close together there are more than the fewest that hold them all.
        let buckets = (count / options.octree.bucket_size(count).max(1) as u64).saturating_mul(2).saturating_add(2);
        let of_bucket = u64::from(input) * JOB_SHARE + (2 + columns as u64) * JOB_FOUND;
        let of_groups = u64::from(input) * u64::from(groups) * JOB_SHARES;
        let tables = buckets.saturating_mul(of_bucket).saturating_add(of_groups);
        let coded = if in_parts { coded_in_parts(options, count, columns, buckets) } else { 0 };
        [for_particles, for_nodes, sampled, tables, coded].into_iter().fold(JOB_TABLES, u64::saturating_add)
    }

    /// Particles whose neighbours may be found at a time: in the memory that nodes and buckets take later.
    pub fn neighbour_block(&self) -> usize {
        ((self.nodes + self.buckets / 4) / NEIGHBOUR_PARTICLE) as usize
    }

    /// Particles whose neighbours' motion may be looked at at a time: in the same memory, with densities and velocities of each.
    pub fn motion_block(&self) -> usize {
        self.neighbour_block() / 2
    }

    /// How many buckets may be built at a time, the largest of which has so many particles.
    pub fn workers(&self, largest: usize, out: &Path) -> Result<usize, BuildError> {
        let needed = self.bucket_particle * largest as u64;
        if needed > self.buckets {
            return Err(BuildError::Memory {
                path: out.to_owned(),
                what: format!("one cell with {largest} particles"),
                needed: with_program(needed.saturating_add(self.held)).div_ceil(1 << 20),
                allowed: self.allowed,
            });
        }
        Ok(((self.buckets / 2) / needed.max(1)).clamp(1, rayon::current_num_threads() as u64) as usize)
    }
}

/// Bytes that are left of what a process may take beside the program and bytes that it holds whatever that is.
fn beside(allowed: u64, held: u64) -> u64 {
    allowed.saturating_sub(BASE.min(allowed / 3).saturating_add(held))
}

/// Bytes that a process must be allowed to take so that as many are left beside the program.
fn with_program(bytes: u64) -> u64 {
    bytes.saturating_add(BASE.min(bytes / 2))
}

/// Bytes that work may use of those that are left: a fifth is for the allocator's gaps.
fn room(rest: u64) -> u64 {
    rest / 5 * 4
}

/// Bytes that a particle of so many takes while it waits in a bucket: room doubles as particles come.
fn while_waiting(particle: u64) -> u64 {
    2 * particle
}

/// Bytes for particles that wait in so many buckets until they are put away, of those that are left: half, as they are kept in memory then, too,
/// where there is room.
fn most_waiting(rest: u64, particle: u64, buckets: usize) -> u64 {
    let one_each = particle * buckets as u64;
    (rest / 2).clamp(SHORTEST_RUN * one_each, longest_waiting(particle, buckets))
}

/// The same where there is room for whole runs.
fn longest_waiting(particle: u64, buckets: usize) -> u64 {
    RUN as u64 * particle * buckets as u64
}

/// Particles that the nodes of all trees draw for each source particle, about.
fn node_particles(options: &BuildOptions) -> f64 {
    NODE_PARTICLES + if options.octree.volume_levels { VOLUME_PARTICLES } else { 0.0 }
}

/// Bytes that tasks hand on, beside codes, where they code what shares a codebook in parts, for `count` particles with so many columns in so
/// many buckets: quantisers, and of each part sums for each code.
fn coded_in_parts(options: &BuildOptions, count: u64, columns: usize, buckets: u64) -> u64 {
    let bits = options.octree.code_bits();
    let drawn = (count as f64 * node_particles(options)) as u64;
    // A code is that of one particle at least.
    let of_all = |bits: VqBits| (JOB_BOOKS * bits.entries() as u64).min(drawn);
    let parts = JOB_PARTS.0 + buckets.min(JOB_PARTS.1);
    let columns = 3 + columns as u64;
    let refined = if bits.is_refined() { of_all(bits.leaves) * (64 + parts * 16) } else { 0 };
    of_all(bits.entries) * (256 + 16 * columns + parts * (16 + 8 * columns)) + refined
}

/// Whether the disk of a folder has room for so many bytes more that help to build `out`, as far as the system says.
pub(super) fn check_room(folder: &Path, needed: u64, out: &Path) -> Result<(), BuildError> {
    match free_bytes(folder).filter(|free| needed > *free) {
        Some(free) => Err(BuildError::Space {
            path: out.to_owned(),
            folder: folder.to_owned(),
            needed: needed.div_ceil(1 << 20),
            free: free >> 20,
        }),
        None => Ok(()),
    }
}

/// Bytes that work takes at most where nothing else is said: half of what the machine has free.
pub fn default_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let available = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let kibibytes = available.and_then(|text| text.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
    kibibytes.map_or(UNKNOWN, |kibibytes| kibibytes.saturating_mul(1024)) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10^12 particles in buckets of 2^20, sorted by 4096 tasks, for as many groups.
    #[test]
    fn tasks_hold_what_is_known_of_their_group_and_not_of_all_buckets() {
        let (buckets, tasks) = (953_674, 4096_u32);
        let block = |buckets: usize| {
            Memory::of_task(2 << 30, Path::new(""), 1, Memory::shares(buckets, tasks)).neighbour_block()
        };
        let of_group = buckets / tasks as usize + 1;
        assert_eq!(block(buckets), 0);
        assert!(10 * block(of_group) > 9 * block(0), "{} of {}", block(of_group), block(0));
        assert!(block(2 * of_group) < block(of_group));
    }

    /// The same many, of which all of a task's wait in their buckets if they may.
    #[test]
    fn tasks_that_sort_take_what_they_may_or_say_how_many_there_should_be() {
        let (buckets, all) = (953_674, 1_000_000_000_000_u64);
        let of = |allowed: u64, tasks: u64| {
            Memory::of_sorting(allowed, Path::new(""), 1, buckets, (all / tasks, all), Path::new("huge.df"))
        };
        for allowed in [4 << 30, 8 << 30, 64 << 30] {
            let memory = of(allowed, 4096).unwrap();
            let run = memory.waiting / (particle_bytes(1) * buckets as u64);
            assert!((SHORTEST_RUN..=RUN as u64).contains(&run), "{run}");
            // No more wait than there are.
            let waiting = memory.waiting.min(2 * particle_bytes(1) * all / 4096);
            assert!(waiting + memory.particles + buckets as u64 * HELD_BUCKET < allowed, "{memory:?}");
        }
        let refused = of(2 << 30, 4096).unwrap_err().to_string();
        assert!(refused.starts_with("huge.df: ") && refused.contains("more than the 2048 MiB"), "{refused}");
        let (_, tasks) = refused.split_once("--tasks ").unwrap();
        let tasks: u64 = tasks.split_once(' ').unwrap().0.parse().unwrap();
        assert!(of(2 << 30, tasks).is_ok() && of(2 << 30, tasks / 2).is_err(), "{refused}");
        // Nor is there any number where buckets alone are too many.
        assert!(!of(256 << 20, 4096).unwrap_err().to_string().contains("--tasks"));
        // Of few buckets the program takes more.
        assert!(Memory::of_sorting(0, Path::new(""), 1, 1000, (1_000_000, all), Path::new("")).is_ok());
    }

    #[test]
    fn tasks_that_hold_too_much_say_with_how_much_memory_they_would_not() {
        let of = |allowed: u64| Memory::left(allowed, 5 << 30, ("stage join", Path::new("huge.df")));
        let told = of(5 << 30).unwrap_err().to_string();
        assert!(told.starts_with("huge.df: stage join takes about 5216 MiB of memory"), "{told}");
        assert_eq!(of(5216 << 20).unwrap(), 0);
        // Of few nodes the program takes more.
        assert_eq!(Memory::left(0, BASE, ("stage join", Path::new("small.df"))).unwrap(), 0);
    }

    /// 10^12 particles without densities in buckets of 2^20.
    #[test]
    fn samples_of_what_was_found_are_counted() {
        let scale = |allowed: u64| Memory::left(allowed, Memory::found(953_674, 2), ("stage scale", Path::new("")));
        assert!(scale(12 << 30).is_err() && scale(16 << 30).is_ok());
    }

    /// Also where the program's share is as large as it gets.
    #[test]
    fn what_is_said_to_be_needed_for_a_bucket_is_enough_and_not_much_less_is() {
        for (particles, buckets, attributes) in [(1 << 20, 8, 0), (1 << 20, 9, 5), (1 << 17, 1, 1), (1 << 20, 2, 0)] {
            let largest = particles as usize / buckets;
            let of = |memory: u64| {
                let options = BuildOptions { memory: Some(memory), ..BuildOptions::default() };
                let planned = Memory::plan(&options, Path::new("huge.df"), particles, attributes, largest, buckets);
                planned.unwrap().workers(largest, Path::new("huge.df"))
            };
            let Err(BuildError::Memory { needed, allowed, .. }) = of(16 << 20) else { panic!("{largest} in 16 MiB") };
            assert!(allowed == 16 << 20 && needed > 16, "{needed} MiB");
            assert_eq!(of(needed << 20).unwrap(), 1);
            assert!(of((needed << 20) / 10 * 9).is_err(), "{needed} MiB");
        }
    }

    #[test]
    fn groups_around_are_kept_where_there_is_room() {
        let kept = |allowed: u64, groups: u32| Memory::groups_around(allowed, 1 << 20, groups);
        assert_eq!([kept(0, 9), kept(40 << 20, 9), kept(1 << 30, 9), kept(1 << 40, 4096)], [1, 5, 8, 26]);
        assert_eq!(kept(1 << 30, 1), 1);
    }
}
