//! Worker processes that are told one task after the other, and what is measured of builds by them, some of which are killed.

use crate::support::{error, json, program, run, text};
use std::io::Write;
use std::process::{Output, Stdio};

#[test]
fn a_worker_runs_the_tasks_that_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let succeeds = |arguments: &[&str]| text(folder.path(), arguments);
    succeeds(&["synth", "clusters", "-n", "3000", "-o", "snapshot"]);
    succeeds(&["build", "snapshot", "-o", "alone.df"]);
    let planned = succeeds(&["build", "snapshot", "-o", "out.df", "--plan", "job", "--tasks", "2"]);
    let mut tasks = String::new();
    for line in planned.lines() {
        let (stage, count) = line.strip_prefix("deepfield stage job ").unwrap().split_once(" 0..").unwrap();
        (0..count.parse().unwrap()).for_each(|task: u32| tasks += &format!("{stage} {task}\n"));
    }
    let worker = |told: &str| -> Output {
        let mut command = program();
        command.args(["stage", "job"]).current_dir(folder.path());
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(told.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    let done = worker(&tasks);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(String::from_utf8(done.stdout).unwrap(), tasks);
    let built = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(built("out.df") == built("alone.df"));

    let refused = |told: &str| {
        let refused = worker(told);
        assert_eq!(refused.status.code(), Some(1), "{told}");
        (String::from_utf8(refused.stdout).unwrap(), String::from_utf8(refused.stderr).unwrap())
    };
    let (_, said) = refused("grow\n");
    assert!(said.contains("standard input: line: found \"grow\", expected a stage and a task"), "{said}");
    let (done, said) = refused("finish 0..1\nbake 0\n");
    assert_eq!(done, "finish 0..1\n");
    assert!(said.contains("stage: found \"bake\""), "{said}");
}

#[test]
fn what_a_plan_prints_can_be_typed() {
    let folder = tempfile::tempdir().unwrap();
    let succeeds = |arguments: &[&str]| text(folder.path(), arguments);
    succeeds(&["synth", "clusters", "-n", "3000", "-o", "snapshot"]);
    succeeds(&["build", "snapshot", "-o", "alone.df"]);
    let planned = succeeds(&["build", "snapshot", "-o", "out.df", "--plan", "job", "--tasks", "2"]);
    for line in planned.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words[0], "deepfield", "{line}");
        succeeds(&words[1..]);
    }
    let built = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(built("out.df") == built("alone.df"));
    let beyond = error(folder.path(), &["stage", "job", "plan", "0..3"]);
    assert!(beyond.contains("task: found 1 of stage plan, expected 0 to 0"), "{beyond}");
    for wrong in ["0..0", "2..1", "..2", "0..", "0...2", "-1", "4294967295"] {
        let refused = run(folder.path(), &["stage", "job", "plan", wrong]);
        assert_eq!(refused.status.code(), Some(2), "{wrong}");
    }
}

#[test]
fn builds_by_workers_are_measured_and_the_same_whichever_are_killed() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["bench", "cluster", "--sizes", "20000", "--repeat", "1", "--json", "-"];
    let killed = ["--kills", "5", "--builds", "2", "--memory", "1GiB"];
    let outcomes = json(folder.path(), &[&arguments[..], &killed[..]].concat());
    let outcome = &outcomes[0];
    assert_eq!(outcome["killed"], 5, "{outcome}");
    // A moment that met no process is made up for by one more build.
    assert!(outcome["builds"].as_u64().unwrap() >= 2, "{outcome}");
    let stages = outcome["stages"].as_array().unwrap();
    let tasks: u64 = stages.iter().map(|stage| stage["tasks"].as_u64().unwrap()).sum();
    assert_eq!(outcome["tasks"], tasks, "{outcome}");
    assert_eq!(stages[0]["name"], "survey");
    assert!(stages.iter().all(|stage| stage["seconds"].as_f64().unwrap() > 0.0), "{outcome}");
    assert_eq!(outcome["memory_limit"], 1 << 30);
    if cfg!(target_os = "linux") {
        assert_eq!(outcome["over_limit"], 0, "{outcome}");
        assert!((1 << 20..1 << 30).contains(&outcome["worker_peak"].as_u64().unwrap()), "{outcome}");
    } else {
        assert!(outcome["worker_peak"].is_null() && outcome["over_limit"].is_null(), "{outcome}");
    }
}
