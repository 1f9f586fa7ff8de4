//! The script that gives a build to SLURM, with a stand-in for SLURM: the file that one process builds.

use crate::support::program;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

/// Runs the tasks of an array, the last one first, where those that it waits for are done.
const SBATCH: &str = r#"#!/bin/sh
set -eu
after=
while :; do
    case $1 in
    --array=*) last=${1#--array=0-} ;;
    --chdir=*) folder=${1#--chdir=} ;;
    --dependency=afterok:*) after=${1#--dependency=afterok:} ;;
    --*) ;;
    *) break ;;
    esac
    shift
done
for id in $(echo "$after" | tr : ' '); do [ -f "$DONE/$id" ]; done
cd "$folder"
task=${last%%%*}
while [ "$task" -ge 0 ]; do
    SLURM_ARRAY_TASK_ID=$task SLURM_CPUS_ON_NODE=1 SLURM_MEM_PER_NODE=500 sh "$@" >&2
    task=$((task - 1))
done
id=$(ls "$DONE" | wc -l)
id=$((id + 100))
: > "$DONE/$id"
echo $id
"#;

fn succeeds(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_build_by_arrays_of_jobs_is_that_of_one_process() {
    is_as_of_one_process("clusters -n 20000 -o snapshot", &["snapshot"], &[], &["--tasks", "3"]);
}

#[test]
fn a_run_by_arrays_of_jobs_is_that_of_one_process() {
    is_as_of_one_process("orbits -n 500 --steps 3 -o run", &["run_000", "run_001", "run_002"], &["--no-stills"], &[]);
}

/// What is built, with these options, of files that are made so; the plan has more options.
fn is_as_of_one_process(make: &str, sources: &[&str], options: &[&str], of_plan: &[&str]) {
    let around = tempfile::tempdir().unwrap();
    let folder = around.path().join("a user's files");
    let (bin, done, job) = (around.path().join("bin"), around.path().join("done"), folder.join("job"));
    for folder in [&folder, &bin, &done] {
        std::fs::create_dir(folder).unwrap();
    }
    let sbatch = bin.join("sbatch");
    std::fs::write(&sbatch, SBATCH).unwrap();
    std::fs::set_permissions(&sbatch, std::fs::Permissions::from_mode(0o755)).unwrap();
    let [alone, out] = ["alone.df", "out.df"].map(|name| folder.join(name));
    succeeds(program().current_dir(&folder).arg("synth").args(make.split(' ')));
    let build = |out: &Path| {
        let mut command = program();
        command.current_dir(&folder).arg("build").args(sources).args(options).arg("-o").arg(out);
        command
    };
    succeeds(&mut build(&alone));
    let said = succeeds(build(&out).args(of_plan).args(["--slurm", "--plan"]).arg(&job));
    assert!(said.contains("submit.sh") && said.contains("--status"), "{said}");

    // Twice: all is done then.
    for _ in 0..2 {
        let search = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
        let submitted = succeeds(Command::new("sh").arg(job.join("submit.sh")).env("PATH", search).env("DONE", &done));
        assert!(submitted.starts_with("submitted: 1"), "{submitted}");
    }
    assert!(std::fs::read(&out).unwrap() == std::fs::read(&alone).unwrap());
    let state = succeeds(program().args(["build", "--json", "--status"]).arg(&job));
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    assert_eq!(state["finished"], true, "{state}");

    succeeds(program().args(["build", "--cancel"]).arg(&job));
    assert!(!job.exists() && out.exists());
}
