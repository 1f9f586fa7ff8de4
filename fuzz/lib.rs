//! What every target does with its bytes.

#[path = "../crates/data/tests/support/job_checksums.rs"]
mod job_checksums;
#[path = "../tests/support/page_checksums.rs"]
mod page_checksums;
#[path = "../crates/data/tests/support/run_checksums.rs"]
mod run_checksums;

use deepfield::build::cluster::{Job, Split};
use deepfield::build::{BuildError, BuildOptions};
use deepfield::explore::Catalogue;
use deepfield::heights::import::{HeightOptions, open_heights, summarize_heights};
use deepfield::heights::store::{HeightFile, verify_heights};
use deepfield::hierarchy::spacetime::Interpolation;
use deepfield::hierarchy::{OctreeOptions, Purpose};
use deepfield::import::{GridOptions, LoadOptions, Source, formats, load_source, open};
use deepfield::import::{open_grid, summarize_grid, summarize_source};
use deepfield::look::SceneFile;
use deepfield::model::{DerivedQuantity, ReadMethod};
use deepfield::show::protocol::message::{Frame, FromFollower, FromLeader, Message, Report};
use deepfield::show::rig::{Cover, Mesh, OutputsFile, Pfm, Projector};
use deepfield::store::run::{RunTree, verify_run};
use deepfield::store::{PageFile, PageId, RunFile, Tree, verify};
use deepfield::tour::TourFile;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Opens `bytes` as the format whose name begins with `format`, whatever they look like, and reads all of it. Errors are
/// fine; panics, endless loops and runaway memory are what the fuzzer looks for.
pub fn import(format: &str, bytes: &[u8]) {
    if let Some(file) = file(bytes) {
        read_source(format, file.path());
    }
}

/// Opens `bytes` as the files of an output of RAMSES, of which the first four say how long those of grids and of their cells are, and as a file of a
/// snapshot in the format nchilada, and reads all of them.
pub fn outputs(bytes: &[u8]) {
    const INFO: &[u8] =
        b"ncpu = 1\nndim = 3\nboxlen = 1.0\naexp = 0.5\nH0 = 70.0\nunit_l = 1e24\nunit_d = 1e-28\nunit_t = 1e16\n";
    let (Some((lengths, rest)), Ok(folder)) = (bytes.split_at_checked(4), tempfile::tempdir()) else { return };
    let [grids, cells] = [0, 2].map(|at| usize::from(u16::from_le_bytes([lengths[at], lengths[at + 1]])));
    let (grids, rest) = rest.split_at(grids.min(rest.len()));
    let (cells, particles) = rest.split_at(cells.min(rest.len()));
    let files = [
        ("info_00001.txt", INFO),
        ("amr_00001.out00001", grids),
        ("hydro_00001.out00001", cells),
        ("part_00001.out00001", particles),
        ("gas/pos", bytes),
    ];
    if std::fs::create_dir(folder.path().join("gas")).is_err() {
        return;
    }
    if files.iter().all(|(name, bytes)| std::fs::write(folder.path().join(name), bytes).is_ok()) {
        read_source("RAMSES", &folder.path().join("info_00001.txt"));
        read_source("nchilada", &folder.path().join("gas/pos"));
    }
}

/// Steps of a file that are read.
const MOST_STEPS: u64 = 8;

/// Opens a file as the format whose name begins with `format`, and reads all of it, and of its steps the first few.
fn read_source(format: &str, path: &Path) {
    for format in formats().into_iter().filter(|candidate| candidate.name().starts_with(format)) {
        if let Ok(source) = format.open(path, ReadMethod::default()) {
            read_all(source.as_ref());
        }
        for step in 1..format.steps(path).unwrap_or(0).min(MOST_STEPS) {
            if let Ok(source) = format.open_step(path, step, ReadMethod::default()) {
                read_all(source.as_ref());
            }
        }
    }
}

/// Reads all of a source.
fn read_all(source: &dyn Source) {
    let summary = summarize_source(source);
    let loaded = load_source(source, &LoadOptions::default(), &());
    if let (Ok(summary), Ok(loaded)) = (summary, loaded) {
        let skipped: u64 = loaded.skipped.iter().map(|skipped| skipped.count).sum();
        assert_eq!(loaded.len() as u64 + skipped, summary.particles);
    }
}

/// Files of a folder that is a source.
const FOLDERS: [[&str; 2]; 4] = [
    ["part_0", "part_1"],
    ["snapshot.0", "snapshot.1"],
    ["snapshot.0.hdf5", "snapshot.1.hdf5"],
    ["properties", "dataset/Norder=0/Dir=0/Npix=4.parquet"],
];

/// Opens `bytes` as a folder of two files, told by their content, and reads all of it: a table or a snapshot in several files, or a HATS catalogue. The
/// first byte says which, and the next two how long the first file is.
pub fn folders(bytes: &[u8]) {
    let (Some((&[which, low, high], rest)), Ok(folder)) = (bytes.split_first_chunk::<3>(), tempfile::tempdir()) else {
        return;
    };
    let (first, second) = rest.split_at(usize::from(u16::from_le_bytes([low, high])).min(rest.len()));
    for (name, bytes) in FOLDERS[usize::from(which) % FOLDERS.len()].into_iter().zip([first, second]) {
        let path = folder.path().join(name);
        let folder_of = path.parent().unwrap_or(folder.path());
        if std::fs::create_dir_all(folder_of).and_then(|()| std::fs::write(&path, bytes)).is_err() {
            return;
        }
    }
    if let Ok(source) = open(folder.path()) {
        read_all(source.as_ref());
    }
}

/// Reads `bytes` as a catalogue of objects: a table, RON, groups, or haloes of whatever finder they claim to be of.
pub fn catalogue(bytes: &[u8]) {
    let Some(file) = file(bytes) else { return };
    if let Ok(catalogue) = Catalogue::read_whole(file.path(), None, 64 << 20) {
        assert!(catalogue.objects.iter().all(|object| object.position.is_finite()));
        let objects = catalogue.objects.len();
        assert!(catalogue.properties.iter().all(|property| property.values.len() == objects));
    }
}

/// Opens `bytes` as the image or the volume that they claim to be, and reads every sample.
pub fn grids(bytes: &[u8]) {
    let Some(file) = file(bytes) else { return };
    let Ok(source) = open_grid(file.path(), &GridOptions::default()) else { return };
    let Ok(summary) = summarize_grid(&source) else { return };
    let samples: u64 = summary.shape.iter().product();
    for channel in summary.channels {
        let finite: u64 = channel.histogram.iter().sum();
        assert_eq!(finite + channel.nan + channel.infinite + channel.no_data, samples);
    }
}

/// Opens `bytes` as the heights that they claim to be, images among them, and reads every sample.
pub fn heights(bytes: &[u8]) {
    let Some(file) = file(bytes) else { return };
    let options = HeightOptions { is_asked: true, ..HeightOptions::default() };
    let Ok(source) = open_heights(file.path(), &options) else { return };
    let Ok(summary) = summarize_heights(&source) else { return };
    let invalid = summary.invalid;
    assert_eq!(summary.valid + invalid.no_data + invalid.nan + invalid.infinite, summary.samples);
}

/// Reads `bytes` as every message of a show, and what a message of the leader holds as the scene or the tour that it is.
pub fn messages(bytes: &[u8]) {
    let _ = (Frame::decode(bytes), Report::decode(bytes), FromFollower::decode(bytes));
    match FromLeader::decode(bytes) {
        Ok(FromLeader::Scene { text }) => drop(SceneFile::parse("the scene", &text)),
        Ok(FromLeader::Tour { text, .. }) => drop(TourFile::parse("the tour", &text)),
        Ok(FromLeader::Welcome { .. }) | Err(_) => {}
    }
}

/// Reads `bytes` as a warp and as a rig, and looks along every output of the rig.
pub fn rigs(bytes: &[u8]) {
    if let Ok(warp) = Pfm::parse(bytes) {
        warp.at([0.3, 0.7]);
    }
    let Ok(folder) = tempfile::tempdir() else { return };
    let path = folder.path().join("rig.mpcdi");
    if std::fs::write(&path, bytes).is_err() {
        return;
    }
    for output in OutputsFile::read(&path).map(|file| file.outputs).unwrap_or_default() {
        if let Ok(projector) = Projector::open(&output, folder.path(), [64, 48]) {
            let _ = Cover::of(&projector, [64, 48], 0.8).map(|cover| Mesh::of(&projector, &cover, [64, 48], 0.8));
        }
    }
}

/// Opens `bytes` as a page file, once as they are and once with every checksum made right (no mutation would get past
/// those), reads every particle of every page and verifies the file.
pub fn pages(bytes: &[u8]) {
    let mut forged = bytes.to_vec();
    page_checksums::correct(&mut forged);
    for bytes in [bytes, &forged] {
        let Some(file) = file(bytes) else { return };
        let read = PageFile::open(file.path()).map(|pages| (0..pages.page_count()).all(|id| read(&pages, PageId(id))));
        let verified = verify(file.path(), &());
        assert!(verified.is_err() || read.is_ok_and(|all| all), "verified, but not readable");
    }
}

/// Opens `bytes` as a page file of heights, once as they are and once with every checksum made right, reads every chunk and every tile of a
/// photo, and verifies the file.
pub fn height_pages(bytes: &[u8]) {
    let mut forged = bytes.to_vec();
    page_checksums::correct(&mut forged);
    for bytes in [bytes, &forged] {
        let Some(file) = file(bytes) else { return };
        let read = HeightFile::open(file.path(), ReadMethod::default()).map(|heights| has_all(&heights));
        let verified = verify_heights(file.path(), &());
        assert!(verified.is_err() || read.is_ok_and(|all| all), "verified, but not readable");
    }
}

/// Opens `bytes` as a run, once as they are and once with the checksums of header and directory made right, verifies it, and draws its
/// tracks at some times.
pub fn runs(bytes: &[u8]) {
    let mut forged = bytes.to_vec();
    run_checksums::correct(&mut forged);
    for bytes in [bytes, &forged] {
        let Some(file) = file(bytes) else { return };
        drop(verify_run(file.path(), &()));
        let Ok(run) = RunFile::open(file.path(), ReadMethod::default()) else { continue };
        let Ok(tree) = RunTree::new(std::sync::Arc::new(run), Interpolation::Auto) else { continue };
        let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
        for time in [f64::NEG_INFINITY, 0.3, f64::INFINITY] {
            for root in tree.roots(&families, Purpose::Splats, time) {
                let Ok(page) = tree.read_page(root.page) else { continue };
                let held = page.content(0).map(|content| content.particles(time).len());
                assert_eq!(held, Some(page.nodes[0].particles as usize));
            }
        }
    }
}

/// A job that is done, and the files of its first task of each stage.
struct Done {
    folder: tempfile::TempDir,
    job: Job,
    files: Vec<(String, PathBuf, Vec<u8>)>,
}

impl Done {
    /// Of a table that lacks densities and smoothing lengths, in so many tasks.
    fn of(tasks: u32) -> Result<Done, BuildError> {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let [source, job, out] = ["source.csv", "job", "out.df"].map(|name| folder.path().join(name));
        let place = |i: u32, rate: f64| (rate * f64::from(i)).sin();
        let row = |i: u32| format!("{},{},{},{},1,{i},1\n", place(i, 1.1), place(i, 2.3), place(i, 3.7), place(i, 0.1));
        let header = "x [kpc],y [kpc],z [kpc],vx [km/s],vy [km/s],vz [km/s],mass\n".to_owned();
        std::fs::write(&source, header + &(0..200).map(row).collect::<String>()).expect("room for a table");
        let octree = OctreeOptions { bucket_particles: Some(100), leaf_capacity: 40, ..OctreeOptions::default() };
        let options = BuildOptions { octree, page_bytes: 1 << 12, ..BuildOptions::default() };
        let load = LoadOptions { derive: vec![DerivedQuantity::VelocityDispersion], ..LoadOptions::default() };
        let job = Job::plan(&job, &source, &load, &options, Split { tasks: Some(tasks) }, &out, &())?;
        let mut files = Vec::new();
        for stage in job.stages() {
            (0..stage.tasks).try_for_each(|task| job.run(&stage.name, task, None, &()))?;
            let path = job.folder().join(format!("{}.0", stage.name));
            let bytes = std::fs::read(&path).expect("the file of a task that is done");
            files.push((stage.name.clone(), path, bytes));
        }
        Ok(Done { folder, job, files })
    }
}

/// Reads `bytes` as the plan of a job, as they are and with the right checksum; and with the first byte, which says of which stage, as what
/// a task of a job leaves for others: as the rest is, and with every checksum made right.
pub fn jobs(bytes: &[u8]) {
    static DONE: OnceLock<Vec<Done>> = OnceLock::new();
    let all = DONE.get_or_init(|| [1, 2].map(|tasks| Done::of(tasks).expect("a small job")).into());
    let count = all.iter().map(|done| done.files.len()).sum::<usize>();
    let Some((&which, rest)) = bytes.split_first() else { return };
    let mut files = all.iter().flat_map(|done| done.files.iter().map(move |file| (done, file)));
    if let Some((done, (stage, path, sound))) = files.nth(usize::from(which) % count) {
        let mut forged = rest.to_vec();
        job_checksums::correct(&mut forged, sound);
        for bytes in [rest, &forged] {
            if std::fs::write(path, bytes).is_ok() {
                drop(done.job.verify(stage, 0));
            }
        }
    }
    let plans = all.first().map(|done| done.folder.path().join("plan"));
    let Some(folder) = plans.filter(|folder| std::fs::create_dir_all(folder).is_ok()) else { return };
    let forged = std::str::from_utf8(bytes).ok().and_then(job_checksums::correct_plan);
    for bytes in [Some(bytes), forged.as_ref().map(String::as_bytes)].into_iter().flatten() {
        if std::fs::write(folder.join("job.json"), bytes).is_ok() {
            drop(Job::open(&folder).map(|job| job.stages().to_vec()));
        }
    }
}

/// Decodes every particle of a page, as drawing does.
fn read(pages: &PageFile, id: PageId) -> bool {
    let Ok(page) = pages.read_page(id) else { return false };
    let family = &pages.metadata().families[page.family as usize];
    for (index, node) in page.nodes.iter().enumerate() {
        let particles = page.particles(index);
        assert_eq!(particles.len(), node.particles as usize);
        for particle in 0..particles.len() {
            assert!(particles.fraction(particle).iter().all(|x| (0.0..1.0).contains(x)));
            let code = usize::from(particles.codes[particle]);
            let codebook = &family.codebooks[usize::from(node.codebook)];
            let columns = [&codebook.mass, &codebook.density, &codebook.smoothing_length];
            assert!(columns.into_iter().chain(&codebook.attributes).all(|column| code < column.len()));
        }
    }
    true
}

/// Whether all chunks and tiles of a file can be decoded; each of them is.
fn has_all(heights: &HeightFile) -> bool {
    let tiles = heights.photo().into_iter().flat_map(|photo| photo.lattice.keys());
    let chunks = heights.lattice().keys().filter(|key| heights.chunk(*key).is_err()).count();
    chunks + tiles.filter(|key| heights.tile(*key).is_err()).count() == 0
}

/// A file of these bytes, gone when dropped.
fn file(bytes: &[u8]) -> Option<tempfile::NamedTempFile> {
    let mut file = tempfile::NamedTempFile::new().ok()?;
    file.write_all(bytes).ok()?;
    Some(file)
}
