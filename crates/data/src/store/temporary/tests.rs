use super::*;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn only_the_files_of_dead_runs_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.df");
    let living = Temporary::create_named(&output, folder.path()).unwrap();
    std::fs::write(folder.path().join("out.df.tmpDead"), [7; 100]).unwrap();
    std::fs::write(folder.path().join("other.df.tmpDead"), [7; 100]).unwrap();
    assert_eq!(clean(&output, folder.path()), 100);
    assert_eq!(names(folder.path()).len(), 2);
    assert_eq!(names(folder.path())[0], "other.df.tmpDead");
    living.persist(&output).unwrap();
    assert_eq!(names(folder.path()), ["other.df.tmpDead", "out.df"]);
    drop(Temporary::create_named(&output, folder.path()).unwrap());
    assert_eq!(names(folder.path()), ["other.df.tmpDead", "out.df"]);
}

#[test]
fn a_folder_that_takes_no_files_is_told_without_a_name_that_nobody_has_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = Temporary::create(&folder.path().join("missing/out.df"), None).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotFound);
    assert!(!error.to_string().contains("out.df"), "{error}");
}

/// However often others clean up while a file is begun.
#[test]
fn the_files_of_living_runs_stay() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.df");
    let is_over = AtomicBool::new(false);
    let kept = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                clean(&output, folder.path());
            }
        });
        let is_kept = |_: &usize| {
            let file = Temporary::create_named(&output, folder.path());
            file.and_then(|file| file.persist(&output)).is_ok()
        };
        let kept = (0..5000).filter(is_kept).count();
        is_over.store(true, Ordering::Relaxed);
        kept
    });
    assert_eq!(kept, 5000);
    assert_eq!(names(folder.path()), ["out.df"]);
}

/// With and without a name: dropped files leave nothing, others take the place of what was there, in whole and readable as any other.
#[test]
fn files_appear_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.df");
    let any: [&dyn Fn() -> Temporary; 2] =
        [&|| Temporary::create(&output, None).unwrap(), &|| Temporary::create_named(&output, folder.path()).unwrap()];
    for create in any {
        for round in 0..3_u8 {
            let dropped = create();
            dropped.file().write_all(&[9; 10]).unwrap();
            drop(dropped);
            let file = create();
            file.file().write_all(&[round; 1000]).unwrap();
            // What was there is there until the last moment.
            assert!(round == 0 || std::fs::read(&output).unwrap() == [round - 1; 1000]);
            file.persist(&output).unwrap();
            assert_eq!(std::fs::read(&output).unwrap(), [round; 1000]);
            assert_eq!(names(folder.path()), ["out.df"]);
        }
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let plain = File::create(folder.path().join("plain")).unwrap();
            let mode = |file: &File| file.metadata().unwrap().permissions().mode();
            assert_eq!(mode(&File::open(&output).unwrap()), mode(&plain));
            std::fs::remove_file(folder.path().join("plain")).unwrap();
        }
        std::fs::remove_file(&output).unwrap();
    }
}

#[test]
fn a_folder_is_not_replaced_and_nothing_stays_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.df");
    std::fs::create_dir(&output).unwrap();
    assert!(Temporary::create(&output, None).unwrap().persist(&output).is_err());
    assert!(Temporary::create_named(&output, folder.path()).unwrap().persist(&output).is_err());
    assert_eq!(names(folder.path()), ["out.df"]);
    assert!(Temporary::create(&folder.path().join("none").join("out.df"), None).is_err());
}

/// Where a file cannot be given a name, what is in it is written to one that has a name.
#[test]
fn a_copy_is_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.df");
    std::fs::write(&output, "before").unwrap();
    let file = Temporary::create(&output, None).unwrap();
    file.file().write_all(b"all of it").unwrap();
    file.copy(&output).unwrap();
    drop(file);
    assert_eq!(std::fs::read(&output).unwrap(), b"all of it");
    assert_eq!(names(folder.path()), ["out.df"]);
}

/// Nothing can stay of a file that never had a name.
#[cfg(target_os = "linux")]
#[test]
fn files_without_names_are_in_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    // The folder of temporary files may lie on a file system that has none.
    let Some(file) = unnamed::create(folder.path()) else { return };
    assert_eq!(names(folder.path()), [""; 0]);
    unnamed::link(&file, &folder.path().join("now")).unwrap();
    let taken = unnamed::link(&file, &folder.path().join("now")).unwrap_err();
    assert_eq!(taken.kind(), ErrorKind::AlreadyExists);
    assert_eq!(names(folder.path()), ["now"]);
}
