//! `deepfield build --plan JOB --slurm`: the script that gives a job's tasks to SLURM, an array of jobs for each stage.

use super::CommandResult;
use crate::build::cluster::{Job, Stage};
use std::io::Write;
use std::path::Path;

/// Tasks of an array at most: SLURM takes indices below `MaxArraySize`, which is 1001 where nobody has set it.
const MOST_IN_ARRAY: u32 = 1000;

/// Tasks of an array that run at a time, unless the script is told otherwise.
const AT_ONCE: u32 = 200;

/// What the script does for every job, below the names of the job's folder and of the program.
const HEAD: &str = r#"
# What SLURM runs: --task STAGE OFFSET
if [ "${1-}" = --task ]; then
    set -- stage "$job" "$2" "$(($3 + SLURM_ARRAY_TASK_ID))"
    memory=${SLURM_MEM_PER_NODE:-$((${SLURM_MEM_PER_CPU:-0} * ${SLURM_CPUS_ON_NODE:-1}))}
    # Beyond all of it SLURM kills a task; files that are read count, too.
    if [ "$memory" -gt 0 ]; then set -- "$@" --memory "$((memory * 4 / 5))MiB"; fi
    if [ -n "${SLURM_CPUS_ON_NODE-}" ]; then export RAYON_NUM_THREADS="$SLURM_CPUS_ON_NODE"; fi
    exec "$program" "$@"
fi

# A job that this is called from has its own, which tasks would take for theirs.
unset SLURM_MEM_PER_NODE SLURM_MEM_PER_CPU

# What is submitted, to be cancelled where something cannot be.
submitted=
undo() { [ $? -eq 0 ] || [ -z "$submitted" ] || scancel $submitted; }
trap undo EXIT
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM

# STAGE OFFSET LAST DEPENDENCIES OPTIONS...: gives the number of the array as `id`
submit() {
    stage=$1 offset=$2 last=$3 after=$4
    shift 4
    # Last, so that a --dependency of the options holds for the first stage, which others wait for.
    id=$(sbatch --parsable --requeue --kill-on-invalid-dep=yes --job-name="deepfield-$stage" --array="0-$last%$at_once" \
        --chdir="$job" --output="$logs/$stage-$offset-%A-%a.log" --open-mode=append "$@" ${after:+--dependency=afterok$after} \
        "$job/submit.sh" --task "$stage" "$offset")
    id=${id%%;*}
    submitted="$submitted $id"
}

mkdir -p "$job/logs"
"#;

/// Writes `submit.sh` into the folder of a job, and says what to do with it.
///
/// # Errors
/// When the file cannot be written.
pub fn write(job: &Job, folder: &Path) -> CommandResult {
    let folder = std::path::absolute(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    if folder.as_os_str().as_encoded_bytes().contains(&b'\\') {
        let folder = folder.display();
        return Err(format!("{folder}: --slurm: found a backslash, expected none: SLURM finds no logs there").into());
    }
    let path = folder.join("submit.sh");
    let text = script(&std::env::current_exe()?, &folder, job.stages());
    std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "submit:  sh {} --account=NAME --cpus-per-task=16 --mem=64G --time=4:00:00", shown(&path))?;
    writeln!(out, "look:    deepfield build --status {}", shown(&folder))?;
    writeln!(out, "go on:   submit again: what is done is not done again")?;
    Ok(())
}

/// The script. All options that it is called with are options of `sbatch`.
fn script(program: &Path, folder: &Path, stages: &[Stage]) -> Vec<u8> {
    let mut text = b"#!/bin/sh\n# Gives the tasks of a build to SLURM: sh submit.sh [OPTIONS OF sbatch]; what is done is not done again.\n".to_vec();
    text.extend(b"set -eu\njob=");
    text.extend(quoted(folder.as_os_str().as_encoded_bytes()));
    // SLURM fills in what follows a % in a log's whole name, also in that of its folder.
    text.extend(b"\nlogs=");
    let logs = folder.join("logs").into_os_string().into_encoded_bytes();
    text.extend(quoted(&logs.split(|&byte| byte == b'%').collect::<Vec<_>>().join(&b"%%"[..])));
    text.extend(b"\nprogram=");
    text.extend(quoted(program.as_os_str().as_encoded_bytes()));
    text.extend(format!("\nat_once=${{AT_ONCE:-{AT_ONCE}}}\n{HEAD}").into_bytes());
    for (number, stage) in stages.iter().enumerate() {
        let before = |name: &String| stages.iter().position(|other| other.name == *name);
        let after: String = stage.after.iter().filter_map(before).map(|number| format!("${{ids_{number}}}")).collect();
        text.extend(format!("ids_{number}=\n").into_bytes());
        for offset in (0..stage.tasks).step_by(MOST_IN_ARRAY as usize) {
            let last = (stage.tasks - offset).min(MOST_IN_ARRAY) - 1;
            text.extend(b"submit ");
            text.extend(quoted(stage.name.as_bytes()));
            let rest = format!(" {offset} {last} \"{after}\" \"$@\"\nids_{number}=\"${{ids_{number}}}:$id\"\n");
            text.extend(rest.into_bytes());
        }
    }
    text.extend(b"echo \"submitted:$submitted\"\n");
    text
}

/// A word that a shell takes as it is.
fn quoted(word: &[u8]) -> Vec<u8> {
    let mut text = vec![b'\''];
    for &byte in word {
        match byte {
            b'\'' => text.extend(br"'\''"),
            other => text.push(other),
        }
    }
    text.push(b'\'');
    text
}

/// A path as a word of a shell, to be read and copied.
pub fn shown(path: &Path) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:,@%".contains(c);
    match path.to_str() {
        Some(text) if text.chars().all(is_plain) => text.to_owned(),
        _ => String::from_utf8_lossy(&quoted(path.as_os_str().as_encoded_bytes())).into_owned(),
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::os::unix::fs::PermissionsExt;
    use std::process::Command;

    /// Writes down what it is called with, and gives a number as clusters of several do.
    const SBATCH: &str = r#"#!/bin/sh
number=$(($(cat "$LOG/number") + 1))
echo $number > "$LOG/number"
[ -z "${SLURM_MEM_PER_NODE-}${SLURM_MEM_PER_CPU-}" ] || exit 1
for word in "$@"; do printf '%s\0' "$word"; done > "$LOG/$number"
[ "$number" != "${FAILS-}" ] || exit 1
echo "$number;somewhere"
"#;

    fn program(path: &Path, text: &str) {
        std::fs::write(path, text).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    fn words(path: &Path) -> Vec<String> {
        let text = std::fs::read_to_string(path).unwrap();
        text.split_terminator('\0').map(str::to_owned).collect()
    }

    #[test]
    fn any_name_is_safe_arrays_have_a_thousand_tasks_and_stages_wait_for_those_before() {
        let around = tempfile::tempdir().unwrap();
        let folder = around.path().join("it's a \"job\"; $(touch never) `touch never` \\ 100%A\n# of two lines");
        let (bin, log) = (around.path().join("bin"), around.path().join("log"));
        for folder in [&folder, &bin, &log] {
            std::fs::create_dir(folder).unwrap();
        }
        program(&bin.join("sbatch"), SBATCH);
        program(&bin.join("scancel"), "#!/bin/sh\nfor id in \"$@\"; do echo $id; done > \"$LOG/cancelled\"\n");
        program(
            &folder.join("deep field"),
            "#!/bin/sh\nfor word in \"$@\"; do printf '%s\\0' \"$word\"; done > \"$LOG/ran\"\n",
        );
        let stage = |name: &str, tasks: u32, after: &[&str]| Stage {
            name: name.into(),
            tasks,
            after: after.iter().map(|&name| name.to_owned()).collect(),
        };
        let stages =
            [stage("survey", 2500, &[]), stage("plan", 1, &["survey"]), stage("write", 1000, &["plan", "survey"])];
        let path = folder.join("submit.sh");
        std::fs::write(&path, script(&folder.join("deep field"), &folder, &stages)).unwrap();
        if let Ok(checked) = Command::new("bash").arg("-n").arg(&path).output() {
            assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
        }
        let shell = |arguments: &[&str], variables: &[(&str, &str)]| {
            std::fs::write(log.join("number"), "10").unwrap();
            let search = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
            let mut command = Command::new("sh");
            command.arg(&path).args(arguments).env("PATH", search).env("LOG", &log).envs(variables.iter().copied());
            command.current_dir(around.path()).output().unwrap()
        };

        // From within a job of SLURM, and after another.
        let around_it = [("AT_ONCE", "7"), ("SLURM_MEM_PER_NODE", "2048"), ("SLURM_MEM_PER_CPU", "1024")];
        let done = shell(&["--comment=two words", "--mem=1G", "--dependency=afterok:5"], &around_it);
        assert!(done.status.success() && done.stderr.is_empty(), "{}", String::from_utf8_lossy(&done.stderr));
        assert_eq!(String::from_utf8(done.stdout).unwrap(), "submitted: 11 12 13 14 15\n");
        let expected = [
            (11, "survey", 0, 999, "afterok:5"),
            (12, "survey", 1000, 999, "afterok:5"),
            (13, "survey", 2000, 499, "afterok:5"),
            (14, "plan", 0, 0, "afterok:11:12:13"),
            (15, "write", 0, 999, "afterok:14:11:12:13"),
        ];
        for (number, name, offset, last, dependency) in expected {
            let words = words(&log.join(number.to_string()));
            let options: BTreeMap<&str, &str> = words.iter().filter_map(|word| word.split_once('=')).collect();
            assert_eq!(options["--array"], format!("0-{last}%7"));
            assert_eq!(options["--dependency"], dependency, "{name}");
            assert_eq!((options["--comment"], options["--mem"]), ("two words", "1G"));
            assert_eq!(Path::new(options["--chdir"]), folder);
            let logs = folder.join("logs").to_str().unwrap().replace('%', "%%");
            let output = format!("{logs}/{name}-{offset}-%A-%a.log");
            assert_eq!(options["--output"], output);
            assert!(words.iter().any(|word| word == "--requeue"));
            let called = [path.to_str().unwrap(), "--task", name, &offset.to_string()].map(str::to_owned);
            assert!(words.ends_with(&called), "{words:?}");
        }
        assert!(folder.join("logs").is_dir() && !around.path().join("never").exists());

        // One that is refused takes those with it that were not.
        let refused = shell(&[], &[("FAILS", "13")]);
        assert!(!refused.status.success());
        assert_eq!(std::fs::read_to_string(log.join("cancelled")).unwrap(), "11\n12\n");

        let node = [("SLURM_ARRAY_TASK_ID", "17"), ("SLURM_MEM_PER_CPU", "1000"), ("SLURM_CPUS_ON_NODE", "4")];
        assert!(shell(&["--task", "survey", "2000"], &node).status.success());
        let ran = words(&log.join("ran"));
        assert_eq!(ran, ["stage", folder.to_str().unwrap(), "survey", "2017", "--memory", "3200MiB"]);
        assert!(shell(&["--task", "plan", "0"], &[("SLURM_ARRAY_TASK_ID", "0")]).status.success());
        assert_eq!(words(&log.join("ran")), ["stage", folder.to_str().unwrap(), "plan", "0"]);
    }
}
