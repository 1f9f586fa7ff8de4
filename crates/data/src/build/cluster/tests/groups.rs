//! What a task reads of those that have sorted particles: what they have of its own group of buckets, and no more. And what one task does for all
//! groups: it has the nodes of one of them at a time.

use super::*;
use crate::build::coding::{Book, Entry};
use crate::build::found::Seen;
use crate::build::spill::{Blob, Spill};
use crate::build::tree::Draft;
use crate::hierarchy::LevelInfo;
use crate::model::portable::Portable;
use std::sync::Arc;

/// Bytes of the header of a task's file, and of a table of no lanes.
const FIXED: u64 = 80 + 8;

/// Of four runs of chunks.
fn case(is_lacking: bool) -> Case {
    let made_up = MadeUp { seed: 5, gas: 15_000, dark: 0, is_lacking };
    Case::new(&made_up, LoadOptions::default(), options(VqBits::Eight, 600, 150, false))
}

/// A job whose stages before one of this name are done.
fn job_before(case: &Case, stage: &str) -> Job {
    let job = case.plan(4).unwrap();
    run_before(&job, stage);
    job
}

/// Where the index of a task's file begins, and its bytes.
fn index(job: &Job, stage: &str, task: u32) -> (u64, Vec<u8>) {
    let bytes = std::fs::read(job.names().path(job.number(stage, task).unwrap())).unwrap();
    let start = u64::from_le_bytes(bytes[24..32].try_into().unwrap());
    (start, bytes[start as usize..].to_vec())
}

/// All tasks together read each share and each particle once, and each of them of each file where the shares of its group are.
#[test]
fn tasks_read_of_their_own_group_only() {
    let case = case(false);
    let job = job_before(&case, "join");
    let tasks = |stage: &str| job.stages().iter().find(|own| own.name == stage).unwrap().tasks;
    let (inputs, groups) = (tasks("partition"), tasks("grow"));
    assert_eq!((inputs, groups), (4, 4));
    let mut shared = 0;
    for task in 0..inputs {
        let (start, bytes) = index(&job, "partition", task);
        let sorted = Vec::<Blob>::of_bytes(&bytes).unwrap();
        assert_eq!(sorted.len() as u32, 1 + groups);
        assert_eq!(bytes.len() as u64, 8 + u64::from(1 + groups) * Blob::TOLD);
        // The first one is of all groups, and read by the task that plans pages.
        shared += start - FIXED - sorted[0].len() as u64;
    }
    let scaled = index(&job, "scale", 0).1.len() as u64;
    let header = |task: u32| job.names().done(job.number("grow", task).unwrap()).unwrap();
    let read: Vec<u64> = (0..groups).map(|task| header(task).read - scaled).collect();
    assert_eq!(read.iter().sum::<u64>(), shared + u64::from(inputs * groups) * Blob::TOLD, "{read:?}");
    assert!(read.iter().all(|read| *read < shared / 4 * 3), "{read:?} of {shared}");
}

/// Shares and particles are at the same places when a task is done again, whatever its threads do, so that others find them there.
#[test]
fn shares_are_where_they_were_when_they_are_made_again() {
    let case = case(true);
    let job = job_before(&case, "neighbours");
    let path = job.names().path(job.number("partition", 1).unwrap());
    let first = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    job.run("partition", 1, Some(0), &()).unwrap();
    assert!(std::fs::read(&path).unwrap() == first);
}

/// What the index of `join` has of a family: nodes, levels and codebooks of each tree, and counts.
type Joined = (Vec<(Vec<Blob>, (Vec<LevelInfo>, Vec<Book>))>, (Vec<Vec<u64>>, Vec<Vec<u64>>));
/// The index of `pages`, where a task's are found by their heads and nodes.
type Pages = (Vec<(Blob, u64)>, (Blob, (u64, (u32, Vec<u8>))));
type OwnPages = (Vec<(u32, (u32, (u64, u32)))>, Vec<Blob>);

/// Whatever is put away at once, on the way from leaves to pages, is of a part of the nodes; and the file is the same.
#[test]
fn nodes_are_joined_and_paged_a_group_at_a_time() {
    let made_up = MadeUp { seed: 6, gas: 24_000, dark: 0, is_lacking: false };
    let case = Case::new(&made_up, LoadOptions::default(), options(VqBits::Eight, 600, 60, true));
    let job = case.plan(8).unwrap();
    run_before(&job, "write");
    let groups = job.stages().iter().find(|own| own.name == "grow").unwrap().tasks as usize;
    assert_eq!(groups, 8);
    let spill = Spill::of_parts(Arc::new(Parts::reader(job.names())));
    let bytes = |blob: &Blob| spill.get(blob).unwrap().to_vec();
    let families = Vec::<Joined>::of_bytes(&index(&job, "join", 0).1).unwrap();
    let (trees, _) = &families[0];
    assert_eq!(trees.len(), 2);
    let mut written = 0;
    for (kind, (drafts, (levels, books))) in trees.iter().enumerate() {
        let count = |blob: &Blob| Draft::of_bytes(&bytes(blob)).unwrap().nodes.iter().map(Vec::len).sum::<usize>();
        let counts: Vec<usize> = drafts.iter().map(count).collect();
        let all: usize = counts.iter().sum();
        assert_eq!((counts.len(), all as u64), (groups, levels.iter().map(LevelInfo::nodes).sum::<u64>()));
        // Beside the nodes of a group there are those above that were whole with it.
        assert!(counts.iter().all(|count| (1..all / 3).contains(count)), "{counts:?}");
        // Leaves are written with the first tree.
        let leaves: u64 = levels.iter().map(|level| level.leaf_nodes).sum();
        written += all as u64 - if kind > 0 { leaves } else { 0 };
        // Runs of batches, which are coded and read by themselves, are of a group that sums are taken of.
        for book in books {
            let runs: Vec<usize> =
                book.runs().map(|(_, run)| Vec::<Entry>::of_bytes(&bytes(run)).unwrap().len()).collect();
            assert_eq!(runs.iter().sum::<usize>(), book.batches());
            assert!(book.batches() < 120 || runs.iter().all(|run| 3 * run < book.batches()), "{runs:?}");
        }
    }
    let (tasks, _) = Pages::of_bytes(&index(&job, "pages", 0).1).unwrap();
    let own: Vec<OwnPages> = tasks.iter().map(|(blob, _)| OwnPages::of_bytes(&bytes(blob)).unwrap()).collect();
    let nodes: u64 = own.iter().flat_map(|(pages, _)| pages).map(|(_, (_, (_, nodes)))| u64::from(*nodes)).sum();
    assert_eq!(nodes, written);
    let put: Vec<usize> = own.iter().flat_map(|(_, nodes)| nodes).map(Blob::len).collect();
    assert!(put.iter().all(|len| 3 * len < put.iter().sum::<usize>()), "{put:?}");
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// By the lengths of their files alone.
#[test]
fn what_takes_too_much_memory_to_be_joined_is_refused_before_it_is_read() {
    let case = case(false);
    for (stage, before, mebibytes, what) in [
        ("plan", "survey", 60, "stage plan, which knows all sampled positions,"),
        ("join", "grow", 20, "stage join, which knows all leaves"),
    ] {
        let job = job_before(&case, stage);
        let number = job.number(before, 1).unwrap();
        Parts::of_task(job.names(), number).unwrap().finish(&vec![0_u8; mebibytes << 20], 0, 0).unwrap();
        let run = |memory: u64| job.run(stage, 0, Some(memory), &()).unwrap_err().to_string();
        let told = run(32 << 20);
        let is_refused = told.contains(&format!("out.df: {what}")) && told.ends_with("that the build may take");
        assert!(is_refused, "{told}");
        let (_, needed) = told.split_once("takes about ").unwrap();
        let needed: u64 = needed.split_once(" MiB").unwrap().0.parse().unwrap();
        assert!((200..400).contains(&needed), "{told}");
        // With as much as it says it is read.
        let told = run(needed << 20);
        let is_read = told.contains(&format!("{before}.1: index: found other values"));
        assert!(is_read && told.ends_with(&format!("run stage {before}, task 1")), "{told}");
        job.run(before, 1, None, &()).unwrap();
    }
    run_all(&case.plan(4).unwrap());
    assert!(case.built() == case.expected());
}

/// Of each bucket a stage that finds columns tells what one task adds up.
#[test]
fn what_was_found_for_buckets_adds_up_to_all_particles() {
    let case = case(true);
    let job = job_before(&case, "scale");
    let number = job.number("neighbours", 2).unwrap();
    let path = job.names().path(number);
    let sound = std::fs::read(&path).unwrap();
    let found = || Parts::reader(job.names()).index::<Vec<(Seen, Option<Blob>)>>(number).unwrap();
    let forged: [fn(&mut Seen); 3] = [
        |seen| seen.ranges[1] = crate::hierarchy::attribute_info::Range::EMPTY,
        |seen| seen.ranges[1].missing += 1,
        |seen| seen.ranges[0].missing = u64::MAX,
    ];
    for forge in forged {
        let mut others = found();
        forge(&mut others[0].0);
        Parts::of_task(job.names(), number).unwrap().finish(&others, 0, 0).unwrap();
        let told = job.run("scale", 0, None, &()).unwrap_err().to_string();
        assert!(told.contains("values: found ") && told.contains("in all results of stage neighbours"), "{told}");
        std::fs::write(&path, &sound).unwrap();
    }
    run_all(&job);
    assert!(case.built() == case.expected());
}
