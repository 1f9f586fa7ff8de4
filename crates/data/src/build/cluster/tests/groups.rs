//! What a task reads of those that have sorted particles: what they have of its own group of buckets, and no more.

use super::*;
use crate::build::spill::Blob;
use crate::model::portable::Portable;

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
