//! Results and sources that do not fit together, with checksums that are right: whose they are is told, and that is made again.

use super::*;
use crate::build::coding::CodedBatches;
use crate::build::found::Seen;
use crate::build::spill::{Blob, Spill};
use crate::build::tree::Built;
use crate::hierarchy::Encoding;
use crate::model::portable::Portable;
use std::sync::Arc;

/// With all checksums right: whoever puts results together says that they do not fit, and what tells of them counts them.
#[test]
fn results_of_other_numbers_are_told() {
    type CodedBooks = (Vec<(usize, (CodedBatches, Vec<Blob>))>, Vec<((usize, usize), [f64; 2])>);
    let case = Case::small();
    let job = case.plan(1).unwrap();
    run_before(&job, "pages");
    let number = job.number("quantize", 0).unwrap();
    let mut coded: CodedBooks = Parts::reader(job.names()).index(number).unwrap();
    let write = |coded: &CodedBooks| {
        Parts::of_task(job.names(), number).unwrap().finish(coded, u64::MAX, u64::MAX).unwrap();
        let Moved { read, written, .. } = job.status().unwrap().bytes;
        assert_eq!([read, written], [u64::MAX; 2]);
        job.run("pages", 0, None, &()).unwrap_err().to_string()
    };
    coded.0[0].0 += 1;
    let told = write(&coded);
    assert!(told.contains("those of the task's codebooks; run stage quantize, task 0"), "{told}");
    coded.0[0].0 -= 1;
    coded.0[0].1.1.pop();
    let told = write(&coded);
    assert!(told.contains("parts of a codebook: found ") && told.ends_with("run stage quantize, task 0"), "{told}");
}

/// A task's file with another index of the same length, and the checksums that it has then.
fn with_index(sound: &[u8], start: usize, index: &impl Portable) -> Vec<u8> {
    let mut bytes = sound[..start].to_vec();
    index.put(&mut bytes);
    assert_eq!(bytes.len(), sound.len());
    let crc = crc32c::crc32c(&bytes[start..]);
    bytes[64..68].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32c::crc32c(&bytes[..76]);
    bytes[76..80].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// With all checksums right: of the files that do not fit together the wrong one is told, and made again.
#[test]
fn nodes_where_they_cannot_be_are_told_of_their_task() {
    type Grown = (Vec<Built>, (Vec<Vec<u64>>, Vec<Vec<u64>>));
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "join");
    let path = job.names().path(job.number("grow", 1).unwrap());
    let read = || {
        let sound = std::fs::read(&path).unwrap();
        let start = u64::from_le_bytes(sound[24..32].try_into().unwrap()) as usize;
        let grown = Grown::of_bytes(&sound[start..]).unwrap();
        (sound, start, grown)
    };
    let (_, _, (built, _)) = read();
    let leaves = |bucket: usize| -> Vec<usize> {
        let pieces = &built[bucket][0].0;
        (0..pieces.len()).filter(|piece| pieces[*piece].encoding == Encoding::Leaf).collect()
    };
    let bucket = (0..built.len()).find(|bucket| leaves(*bucket).len() > 1).unwrap();
    let [one, two] = [0, 1].map(|leaf| leaves(bucket)[leaf]);
    let mut others =
        (bucket + 1..built.len()).flat_map(|bucket| leaves(bucket).into_iter().map(move |leaf| (bucket, leaf)));
    let (other, elsewhere) = others.next().unwrap();
    let forgeries: [(&str, &dyn Fn(&mut Vec<Built>)); 4] = [
        ("cells of nodes: ", &|built| built[bucket][0].0[one].key = built[bucket][0].0[two].key),
        ("cell of a node: ", &|built| built[bucket][0].0[one].key = built[other][0].0[elsewhere].key),
        ("whole node: found false, expected true", &|built| built[bucket][0].0[one].whole = false),
        ("leaf: found something else, expected a whole one", &|built| {
            let node = &mut built[bucket][1].0[0];
            (node.encoding, node.input, node.merged, node.sources) =
                (Encoding::Leaf, 0, node.particles, node.particles);
        }),
    ];
    for (what, forge) in forgeries {
        let (sound, start, (mut built, counts)) = read();
        forge(&mut built);
        std::fs::write(&path, with_index(&sound, start, &(built, counts))).unwrap();
        let told = job.run("join", 0, None, &()).unwrap_err().to_string();
        assert!(told.contains(what) && told.ends_with("run stage grow, task 1"), "{what}: {told}");
        assert!(!path.exists(), "{what}");
        job.run("grow", 1, None, &()).unwrap();
    }
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// The file of a task of `partition` with one of the blobs that its index lists changed, and the checksums that it has then.
fn with_blob(sound: &[u8], number: usize, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let place_at = |at: usize| u64::from_le_bytes(sound[at..at + 8].try_into().unwrap()) as usize;
    let start = place_at(24);
    // Length, a 1, the numbers of task and lane, place, checksum.
    let told = start + 8 + number * Blob::TOLD as usize;
    let (len, at) = (place_at(told), place_at(told + 17));
    let mut bytes = sound.to_vec();
    change(&mut bytes[at..at + len]);
    let crc = crc32c::crc32c(&bytes[at..at + len]);
    bytes[told + 25..told + 29].copy_from_slice(&crc.to_le_bytes());
    let index = Vec::<Blob>::of_bytes(&bytes[start..]).unwrap();
    with_index(&bytes, start, &index)
}

/// Of shares that are another group's or another task's the task is told that has left them, and its file made again.
#[test]
fn shares_of_others_are_told_of_their_task() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "grow");
    let path = job.names().path(job.number("partition", 0).unwrap());
    let sound = std::fs::read(&path).unwrap();
    let start = u64::from_le_bytes(sound[24..32].try_into().unwrap()) as usize;
    let mut sorted = Vec::<Blob>::of_bytes(&sound[start..]).unwrap();
    sorted.swap(1, 2);
    let swapped = with_index(&sound, start, &sorted);
    // Behind the length of the list, the first blob, and the length of the second one with the 1 that says that its place follows.
    let mut elsewhere = sound.clone();
    elsewhere[start + 8 + Blob::TOLD as usize + 9] ^= 1;
    let mut longer = sound.clone();
    longer[start + 8 + Blob::TOLD as usize] ^= 1;
    // The first run of particles, behind the length of the list and two others: a 1, its length, another 1, the task in whose file it is.
    let other = job.number("survey", 0).unwrap();
    let foreign = with_blob(&sound, 1, |shares| {
        let run = (16..shares.len()).find(|at| shares[*at] == 1).unwrap();
        shares[run + 10..run + 14].copy_from_slice(&other.to_le_bytes());
    });
    for (what, forged) in [
        ("", swapped),
        ("index: found a place in another file", elsewhere),
        ("blob: ", longer),
        ("runs of particles: ", foreign),
    ] {
        std::fs::write(&path, forged).unwrap();
        let told = job.run("grow", 0, None, &()).unwrap_err().to_string();
        assert!(told.contains("partition.0: ") && told.contains(what), "{what}: {told}");
        assert!(told.ends_with("run stage partition, task 0") && !path.exists(), "{what}: {told}");
        job.run("partition", 0, None, &()).unwrap();
    }
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// Where a bucket has no columns, whoever has found those of its group is told.
#[test]
fn columns_that_are_missing_are_told_of_their_task() {
    let made_up = MadeUp { seed: 1, gas: 3000, dark: 0, is_lacking: true };
    let case = Case::new(&made_up, LoadOptions::default(), options(VqBits::Eight, 300, 100, true));
    let job = case.plan(2).unwrap();
    run_before(&job, "grow");
    let number = job.number("neighbours", 1).unwrap();
    let mut found: Vec<(Seen, Option<Blob>)> = Parts::reader(job.names()).index(number).unwrap();
    let bucket = found.iter().position(|(_, blob)| blob.as_ref().is_some_and(|blob| blob.len() > 0)).unwrap();
    found[bucket].1 = None;
    Parts::of_task(job.names(), number).unwrap().finish(&found, 0, 0).unwrap();
    let told = job.run("grow", 1, None, &()).unwrap_err().to_string();
    assert!(told.contains("columns of a bucket: found 0 bytes"), "{told}");
    assert!(told.ends_with("run stage neighbours, task 1") && !job.names().path(number).exists(), "{told}");
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// Where a task tells of more particles than its runs hold, leaves lack them: of all results together, for no one knows which of them is wrong.
#[test]
fn particles_that_are_missing_are_told() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "grow");
    let number = job.number("partition", 0).unwrap();
    let path = job.names().path(number);
    let sound = std::fs::read(&path).unwrap();
    let sorted: Vec<Blob> = Parts::reader(job.names()).index(number).unwrap();
    let old = Spill::of_parts(Arc::new(Parts::reader(job.names())));
    let parts = Arc::new(Parts::of_task(job.names(), number).unwrap());
    let new = Spill::of_parts(Arc::clone(&parts));
    let copy = |blob: &Blob| new.put(&[&old.get(blob).unwrap()]).unwrap();
    let mut is_lost = false;
    let shares = sorted[1..].iter().map(|shares| {
        // Particles of all groups, and a run of each bucket.
        let (all, runs): (u64, Vec<Option<Blob>>) = Portable::of_bytes(&old.get(shares).unwrap()).unwrap();
        let mut runs: Vec<Option<Blob>> = runs.iter().map(|run| run.as_ref().map(copy)).collect();
        if !is_lost {
            is_lost = runs.iter_mut().find_map(Option::take).is_some();
        }
        new.put(&[&(all, runs).bytes()]).unwrap()
    });
    let index: Vec<Blob> = std::iter::once(copy(&sorted[0])).chain(shares).collect();
    assert!(is_lost);
    drop((old, new));
    Arc::into_inner(parts).unwrap().finish(&index, 0, 0).unwrap();
    let grow = job.stages().iter().find(|stage| stage.name == "grow").unwrap();
    (0..grow.tasks).for_each(|task| job.run("grow", task, None, &()).unwrap());
    let told = job.run("join", 0, None, &()).unwrap_err().to_string();
    assert!(
        told.contains("particles of leaves: found ") && told.contains("results of stage partition or grow"),
        "{told}"
    );
    std::fs::write(&path, sound).unwrap();
    (0..grow.tasks).for_each(|task| job.names().forget(job.number("grow", task).unwrap()));
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// Of sums that are those of other parts the task is told that has left them.
#[test]
fn sums_of_other_parts_are_told_of_their_task() {
    type Units = Vec<(usize, (Blob, Blob))>;
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "draft");
    let path = job.names().path(job.number("code", 0).unwrap());
    let sound = std::fs::read(&path).unwrap();
    let start = u64::from_le_bytes(sound[24..32].try_into().unwrap()) as usize;
    let units = Units::of_bytes(&sound[start..]).unwrap();
    let apart = |(number, (codes, sums)): (usize, (Blob, Blob))| ((number, codes), sums);
    let (codes, mut sums): (Vec<(usize, Blob)>, Vec<Blob>) = units.into_iter().map(apart).unzip();
    sums.rotate_left(1);
    let forged: Units = codes.into_iter().zip(sums).map(|((number, codes), sums)| (number, (codes, sums))).collect();
    std::fs::write(&path, with_index(&sound, start, &forged)).unwrap();
    let told = job.run("draft", 0, None, &()).unwrap_err().to_string();
    assert!(told.contains("code.0: ") && told.ends_with("run stage code, task 0") && !path.exists(), "{told}");
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// The same of values.
#[test]
fn values_that_were_not_counted_are_told() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "pages");
    let path = job.names().path(job.number("partition", 0).unwrap());
    let sound = std::fs::read(&path).unwrap();
    // One less in each column.
    let forged = with_blob(&sound, 0, |counts| {
        let mut all = Vec::<Vec<u64>>::of_bytes(counts).unwrap();
        all.iter_mut().for_each(|column| *column.iter_mut().find(|count| **count > 0).unwrap() -= 1);
        counts.copy_from_slice(&all.bytes());
    });
    std::fs::write(&path, forged).unwrap();
    let told = job.run("pages", 0, None, &()).unwrap_err().to_string();
    assert!(told.contains("counted values: found ") && told.contains("in all results of stage partition"), "{told}");
    std::fs::write(&path, sound).unwrap();
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// Tasks that write pages have nothing to do once the job has come to its end. Where that is lost they write them again.
#[test]
fn pages_are_written_again_where_the_end_is_lost() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_all(&job);
    let forget = |stage: &str| std::fs::remove_file(case.path("job").join(stage)).unwrap();
    forget("write.0");
    job.run("write", 0, None, &()).unwrap();
    forget("finish.0");
    for task in 0..2 {
        let told = job.run("finish", 0, None, &()).unwrap_err().to_string();
        assert!(told.ends_with(&format!("run stage write, task {task}")), "{told}");
        job.run("write", task, None, &()).unwrap();
    }
    job.run("finish", 0, None, &()).unwrap();
    assert!(case.built() == case.expected());
    // The end is lost with the output.
    std::fs::remove_file(case.path("out.df")).unwrap();
    assert!(!job.status().unwrap().finished);
    let told = job.run("finish", 0, None, &()).unwrap_err().to_string();
    assert!(told.ends_with("run stage write, task 0, 1"), "{told}");
    run_all(&job);
    assert!(job.status().unwrap().finished && case.built() == case.expected());
}

/// Of the same length and as many particles: no result of a task is to blame.
#[test]
fn sources_with_other_columns_are_told() {
    let case = Case::small();
    let path = case.path("source.csv");
    let write = |column: &str| {
        let rows: String = (0..50).map(|i| format!("{i},{},{},{}\n", i * i % 7, i * i % 11, i + 1)).collect();
        std::fs::write(&path, format!("x,y,z,{column}\n{rows}")).unwrap();
    };
    write("temp");
    let load = LoadOptions { attributes: AttributeChoice::All, ..LoadOptions::default() };
    let split = Split { tasks: Some(1) };
    let job = Job::plan(&case.path("job"), &path, &load, &case.options, split, &case.path("out.df"), &()).unwrap();
    ["survey", "plan"].into_iter().for_each(|stage| job.run(stage, 0, None, &()).unwrap());
    for column in ["mass", "ages"] {
        write(column);
        let told = job.run("partition", 0, None, &()).unwrap_err().to_string();
        assert!(told.contains("source.csv: found other columns"), "{column}: {told}");
        assert!(told.ends_with("expected the source as it was when the job was planned"), "{column}: {told}");
    }
    write("temp");
    run_all(&job);
}
