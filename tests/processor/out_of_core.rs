//! Builds of what does not fit in the memory they may take: the same bytes for any memory and any number of threads, peak memory,
//! builds killed at any moment, and disks that take no more.

#[cfg(target_os = "linux")]
use crate::support::peak_memory;
use crate::support::{Random, dataset_of, gas, program};
use deepfield::build::{BuildOptions, build, build_source};
use deepfield::hierarchy::OctreeOptions;
use deepfield::import::{LoadOptions, Smoothing, load};
use deepfield::model::{Dataset, ReadMethod};
use deepfield::store::verify;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use tempfile::TempDir;

/// A zoom simulation in its box: most particles in a region a thousand times smaller, so that whole buckets lie inside a cell of
/// depth 8, and a sparse rest.
fn zoom(count: usize) -> Dataset {
    let mut random = Random(5);
    let mut family = gas();
    for i in 0..count {
        let (scale, h) = if i % 5 == 0 { (1.0, 0.05) } else { (1e-3, 2e-5) };
        let place = |x: f64| 0.3 + scale * (x - 0.5) * (2.0 * x - 1.0).abs();
        family.positions.push([place(random.next()), place(random.next()), place(random.next())]);
        family.mass.push((1.0 + random.next()) as f32);
        let h = h * (0.5 + random.next());
        family.smoothing_length.push(h as f32);
        family.density.push((1e-9 / h.powi(3)) as f32);
        family.attributes[0].values.push((1e4 * random.next()) as f32);
    }
    dataset_of(family)
}

#[test]
fn neither_memory_nor_threads_change_a_byte() {
    let folder = tempfile::tempdir().unwrap();
    let data = zoom(60_000);
    let mass: f64 = data.families[0].mass.iter().map(|&m| f64::from(m)).sum();
    for volume_levels in [false, true] {
        builds_are_the_same(&folder, &data, mass, volume_levels);
    }
}

fn builds_are_the_same(folder: &TempDir, data: &Dataset, mass: f64, volume_levels: bool) {
    let octree = OctreeOptions {
        bucket_particles: Some(1500),
        leaf_capacity: 200,
        root_particles: 4000,
        volume_levels,
        ..OctreeOptions::default()
    };
    let run = |memory: Option<u64>, threads: usize, read: ReadMethod| {
        let path = folder.path().join("out.df");
        let options = BuildOptions { octree, memory, threads: Some(threads), read, ..BuildOptions::default() };
        let built = build(data.clone(), &options, &path, &()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "temporary files stay behind");
        (std::fs::read(&path).unwrap(), built, path)
    };
    let (whole, built, path) = run(Some(1 << 30), 1, ReadMethod::default());
    assert_eq!(built.temporary_bytes, 0);
    assert_eq!(verify(&path, &()).unwrap().particles, 60_000);
    let family = &built.metadata.families[0];
    assert!((family.mass / mass - 1.0).abs() < 1e-12);
    assert!(family.levels.len() > 10, "{} levels", family.levels.len());
    assert_eq!(family.volume.is_some(), volume_levels);
    for (memory, threads) in [(None, 2), (Some(10 << 20), 1), (Some(10 << 20), 3), (Some(16 << 20), 2)] {
        for read in [ReadMethod::Positioned, ReadMethod::Mapped] {
            let (bytes, built, _) = run(memory, threads, read);
            assert!(bytes == whole, "{memory:?} bytes of memory, {threads} threads, {read:?}");
            assert_eq!(built.temporary_bytes > 0, memory.is_some(), "{memory:?}");
        }
    }
}

#[test]
fn too_little_memory_and_too_small_a_disk_are_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("never.df");
    let options = BuildOptions { memory: Some(1 << 20), ..BuildOptions::default() };
    let error = build(zoom(30_000), &options, &path, &()).unwrap_err().to_string();
    assert!(error.contains("never.df") && error.contains("MiB") && !error.contains('\n'), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A snapshot of so many particles, written by the program.
fn snapshot(folder: &TempDir, particles: usize) -> PathBuf {
    let path = folder.path().join("snapshot");
    let status =
        deepfield().args(["synth", "clusters", "-n", &particles.to_string(), "-o"]).arg(&path).status().unwrap();
    assert!(status.success());
    path
}

fn deepfield() -> Command {
    let mut command = program();
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn build_command(source: &Path, out: &Path, memory: &str) -> Command {
    let mut command = deepfield();
    command.args(["build", "--threads", "2", "--memory", memory]).arg(source).arg("-o").arg(out);
    command
}

/// Kills builds after these shares of the time that one takes: the file that was there stays whole, and what dead ones
/// leave is removed by those that follow.
fn kill_builds(build: impl Fn(&Path) -> Command, moments: &[f64]) {
    let results = tempfile::tempdir().unwrap();
    let out = results.path().join("out.df");
    let start = Instant::now();
    assert!(build(&out).status().unwrap().success());
    let whole = start.elapsed();
    let finished = std::fs::read(&out).unwrap();
    std::fs::write(&out, b"the old file").unwrap();
    let mut killed = 0;
    for moment in moments {
        let mut child = build(&out).spawn().unwrap();
        std::thread::sleep(whole.mul_f64(*moment));
        child.kill().unwrap();
        killed += usize::from(!child.wait().unwrap().success());
        let now = std::fs::read(&out).unwrap();
        // A build that had come to its end before it was killed may have replaced the file, as a whole.
        assert!(now == b"the old file" || now == finished, "killed after {moment} of its time");
        let left = std::fs::read_dir(results.path()).unwrap().count();
        assert!(left <= 3, "{left} files: what dead runs left is not removed");
    }
    assert!(2 * killed >= moments.len(), "{killed} of {} builds were killed", moments.len());
    assert!(build(&out).status().unwrap().success());
    assert!(std::fs::read(&out).unwrap() == finished);
    assert_eq!(std::fs::read_dir(results.path()).unwrap().count(), 1);
}

#[test]
fn builds_killed_at_any_moment_leave_the_old_file_and_the_next_one_cleans_up() {
    let folder = tempfile::tempdir().unwrap();
    let source = snapshot(&folder, 70_000);
    let moments: Vec<f64> = (0..25).map(|k| 1.1 * (f64::from(k) + 0.5) / 25.0).collect();
    kill_builds(|out| build_command(&source, out, "100MiB"), &moments);
}

#[test]
fn builds_of_heights_killed_at_any_moment_leave_the_old_file_and_the_next_one_cleans_up() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("hills.npy");
    // Four by three chunks and what is above them: small, for there are many moments.
    let hills = ["synth", "surface", "--shape", "fbm", "--type", "i16", "--size", "900,660", "-o"];
    assert!(deepfield().args(hills).arg(&source).status().unwrap().success());
    let moments: Vec<f64> = (0..50).map(|k| (f64::from(k) + 0.5) / 50.0).collect();
    kill_builds(|out| build_command(&source, out, "100MiB"), &moments);
}

/// A limit on the length of files stands in for a full disk: both end in an error of the write.
#[cfg(unix)]
#[test]
fn a_full_disk_is_said_in_one_line_and_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let source = snapshot(&folder, 400_000);
    let results = tempfile::tempdir().unwrap();
    let out = results.path().join("out.df");
    std::fs::write(&out, b"the old file").unwrap();
    // Little memory, so that the temporary file is what fills the disk; then much, so that the output is.
    for memory in ["146MiB", "2GiB"] {
        let script = "trap '' XFSZ; ulimit -f 1000; exec \"$0\" build \"$1\" -o \"$2\" --memory \"$3\"";
        let output = Command::new("sh")
            .args(["-c", script, env!("CARGO_BIN_EXE_deepfield")])
            .args([&source, &out])
            .arg(memory)
            .output()
            .unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert!(message.contains(results.path().to_str().unwrap()), "{message}");
        assert_eq!(std::fs::read(&out).unwrap(), b"the old file");
        assert_eq!(std::fs::read_dir(results.path()).unwrap().count(), 1);
    }
}

/// Bytes of the files in a folder that a process has open and that are not finished: without a name, or with that of a temporary one.
#[cfg(target_os = "linux")]
fn unfinished(process: u32, folder: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt;
    let open = std::fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().flatten();
    let mut files = std::collections::BTreeMap::new();
    for entry in open {
        let Ok(path) = std::fs::read_link(entry.path()) else { continue };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_unfinished = name.ends_with(" (deleted)") || name.contains(".tmp");
        if path.parent() == Some(folder)
            && is_unfinished
            && let Ok(about) = std::fs::metadata(entry.path())
        {
            files.insert(about.ino(), about.len());
        }
    }
    files.values().sum()
}

/// Peak resident size of a build, as Linux counts it, and the temporary files that it says it will take at most.
#[cfg(target_os = "linux")]
#[test]
fn a_build_stays_within_its_memory() {
    let folder = tempfile::tempdir().unwrap();
    let source = snapshot(&folder, 2_000_000);
    // Neighbours are found for a whole bucket at least, with what lies around it.
    for (smoothing, mebibytes) in [("auto", 160_u64), ("knn:32", 320)] {
        let results = tempfile::tempdir().unwrap();
        let out = results.path().join("out.df");
        let allowed = mebibytes << 20;
        let mut command = build_command(&source, &out, &format!("{mebibytes}MiB"));
        let mut child = command.args(["--smoothing", smoothing]).stderr(Stdio::piped()).spawn().unwrap();
        let (mut peak, mut temporary) = (0, 0);
        let done = loop {
            peak = peak.max(peak_memory(child.id()).unwrap_or(0));
            temporary = temporary.max(unfinished(child.id(), results.path()));
            if let Some(done) = child.try_wait().unwrap() {
                break done;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        };
        assert!(done.success());
        assert!(peak > 0 && peak <= allowed, "{smoothing}: {peak} bytes at the peak, {allowed} allowed");
        if smoothing != "auto" {
            continue;
        }
        let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
        let announced = said.split("up to ").nth(1).and_then(|rest| rest.split(" MiB").next()).unwrap();
        let announced = announced.parse::<u64>().unwrap() << 20;
        // The output grows under a temporary name too, after the particles' file is gone.
        let written = std::fs::metadata(&out).unwrap().len();
        assert!(temporary <= announced + written, "{temporary} bytes of temporary files, {announced} announced");
        assert!(temporary > announced / 2, "{temporary} bytes of temporary files, {announced} announced");
        assert!(peak > allowed / 2, "{peak} bytes at the peak, {allowed} allowed: too little was asked of it");
    }
}

/// Smoothing lengths and densities found bucket by bucket are those of a search among all particles.
#[test]
fn estimates_do_not_depend_on_buckets() {
    let folder = tempfile::tempdir().unwrap();
    let source = snapshot(&folder, 30_000);
    let out = folder.path().join("out.df");
    // Threads and memory: one block, several, and one for each bucket. Many neighbours take longest.
    let ways = [
        (32, 700, &[(1, 1 << 30), (3, 12 << 20), (1, 5 << 20), (3, 2 << 20)][..]),
        (5, 90, &[(3, 12 << 20), (1, 5 << 20)][..]),
        (200, 150, &[(3, 2 << 20)][..]),
    ];
    for (k, bucket_particles, ways) in ways {
        let load_options = LoadOptions { smoothing: Smoothing::Knn(k), ..LoadOptions::default() };
        let whole = load(&source, &load_options, &()).unwrap();
        let octree = OctreeOptions { bucket_particles: Some(bucket_particles), ..OctreeOptions::default() };
        let options = BuildOptions { octree, ..BuildOptions::default() };
        let built = build_source(&source, &load_options, &options, &out, &()).unwrap();
        verify(&out, &()).unwrap();
        let bytes = std::fs::read(&out).unwrap();
        for &(threads, memory) in ways {
            let options = BuildOptions { threads: Some(threads), memory: Some(memory), ..options.clone() };
            build_source(&source, &load_options, &options, &out, &()).unwrap();
            assert!(std::fs::read(&out).unwrap() == bytes, "{threads} threads, {memory} bytes of memory");
        }
        let [_, density, smoothing_length] = &built.metadata.families[0].quantities;
        for (info, values) in
            [(density, &whole.families[0].density), (smoothing_length, &whole.families[0].smoothing_length)]
        {
            let min = values.iter().fold(f32::INFINITY, |least, &v| least.min(v));
            let max = values.iter().fold(0.0, |most: f32, &v| most.max(v));
            let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
            for (found, expected) in [(info.min, f64::from(min)), (info.max, f64::from(max)), (info.mean, mean)] {
                assert!((found / expected - 1.0).abs() < 1e-5, "{} of {k}: {found}, expected {expected}", info.name);
            }
            assert_eq!(info.histogram.counts.iter().sum::<u64>(), 30_000);
        }
        assert_eq!(built.metadata.provenance.notes, whole.provenance.notes);
    }
}
