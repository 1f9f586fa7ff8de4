//! Merger trees: links that are written are read back from every kind of file, histories are those that were made up, haloes move from
//! step to step, and links that lead nowhere are refused.

use crate::support::hdf5::{Hdf5, Values};
use crate::support::{run, text};
use deepfield::explore::{Catalogue, MergerTree};
use glam::DVec3;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const EDGE: f64 = 10.0;
const FACTORS: [f64; 3] = [0.25, 0.5, 1.0];

/// A halo: place, mass, radius, and which halo of the next step it becomes.
type Made = ([f64; 3], f64, f64, Option<usize>);

/// Three steps: two haloes merge into one, one crosses the box's face, one vanishes, one is born.
fn made() -> [Vec<Made>; 3] {
    [
        vec![
            ([1.0, 5.0, 5.0], 3.0, 0.5, Some(1)),
            ([2.0, 5.0, 5.0], 8.0, 0.8, Some(1)),
            ([9.5, 1.0, 1.0], 2.0, 0.4, Some(0)),
            ([7.0, 7.0, 7.0], 1.0, 0.3, None),
        ],
        vec![([0.5, 1.0, 1.0], 2.5, 0.4, Some(2)), ([2.0, 6.0, 5.0], 11.0, 1.0, Some(0))],
        vec![([2.0, 8.0, 5.0], 12.0, 1.2, None), ([4.0, 4.0, 4.0], 0.5, 0.1, None), ([1.5, 1.0, 1.0], 3.0, 0.4, None)],
    ]
}

fn column(made: &[Made], of: impl Fn(&Made) -> Vec<f64>) -> Values {
    Values::F64(made.iter().flat_map(of).collect())
}

/// The index of a halo at the next step, or -1.
fn link(made: &Made) -> f64 {
    made.3.map_or(-1.0, |descendant| descendant as f64)
}

fn with_subhaloes(file: &mut Hdf5, group: &str, made: &[Made]) {
    file.dataset(group, "SubhaloPos", 3, column(made, |halo| halo.0.to_vec()));
    file.dataset(group, "SubhaloMass", 1, column(made, |halo| vec![halo.1]));
    file.dataset(group, "SubhaloHalfmassRad", 1, column(made, |halo| vec![halo.2]));
}

/// Catalogues with links beside them; those of step 10 are named.
fn catalogues(folder: &Path, made: &[Vec<Made>; 3]) -> PathBuf {
    for (step, (own, factor)) in made.iter().zip(FACTORS).enumerate() {
        let number = 9 + step;
        let mut file = Hdf5::default();
        file.attribute("Header", "Time", Values::F64(vec![factor]));
        file.attribute("Header", "Redshift", Values::F64(vec![1.0 / factor - 1.0]));
        file.attribute("Header", "BoxSize", Values::F64(vec![EDGE]));
        file.attribute("Header", "NumFiles", Values::I32(vec![1]));
        with_subhaloes(&mut file, "Subhalo", own);
        file.write(&folder.join(format!("fof_subhalo_tab_{number:03}.hdf5")));
        if step < 2 {
            let mut links = Hdf5::default();
            links.attribute("Header", "NumFiles", Values::I32(vec![1]));
            links.dataset("Subhalo", "SubhaloNr", 1, Values::F64((0..own.len()).map(|number| number as f64).collect()));
            links.dataset("Subhalo", "DescSubhaloNr", 1, column(own, |halo| vec![link(halo)]));
            links.write(&folder.join(format!("subhalo_desc_{number:03}.hdf5")));
        }
    }
    folder.join("fof_subhalo_tab_010.hdf5")
}

/// The same as one file of trees: those that end in each halo of the last step and in the one that vanishes, descendants first.
fn trees(path: &Path, made: &[Vec<Made>; 3]) {
    let mut rows: Vec<(usize, usize, u64, usize, i64)> = Vec::new();
    let roots = (0..3).flat_map(|step| (0..made[step].len()).map(move |halo| (step, halo)));
    let roots = roots.filter(|(step, halo)| made[*step][*halo].3.is_none());
    for (tree, root) in roots.enumerate() {
        // By step and number, and the place in the tree of what it becomes.
        let mut open = vec![(root, -1)];
        let mut own = Vec::new();
        while let Some(((step, halo), descendant)) = open.pop() {
            let index = own.len();
            own.push((step, halo, tree as u64, index, descendant));
            let before = step
                .checked_sub(1)
                .map(|before| made[before].iter().enumerate().map(move |(i, halo)| (before, i, halo)));
            let before = before.into_iter().flatten().filter(|(.., other)| other.3 == Some(halo));
            open.extend(before.map(|(step, i, _)| ((step, i), index as i64)));
        }
        rows.extend(own);
    }
    let haloes: Vec<Made> = rows.iter().map(|(step, halo, ..)| made[*step][*halo]).collect();
    let mut file = Hdf5::default();
    file.attribute("Header", "NumFiles", Values::I32(vec![1]));
    file.attribute("Parameters", "BoxSize", Values::F64(vec![EDGE]));
    let whole = |of: &dyn Fn(&(usize, usize, u64, usize, i64)) -> i32| Values::I32(rows.iter().map(of).collect());
    file.dataset("TreeHalos", "SnapNum", 1, whole(&|row| row.0 as i32));
    file.dataset("TreeHalos", "SubhaloNr", 1, whole(&|row| row.1 as i32));
    file.dataset("TreeHalos", "TreeID", 1, Values::U64(rows.iter().map(|row| row.2).collect()));
    file.dataset("TreeHalos", "TreeIndex", 1, whole(&|row| row.3 as i32));
    file.dataset("TreeHalos", "TreeDescendant", 1, whole(&|row| row.4 as i32));
    with_subhaloes(&mut file, "TreeHalos", &haloes);
    file.dataset("TreeTimes", "Time", 1, Values::F64(FACTORS.to_vec()));
    file.dataset("TreeTimes", "Redshift", 1, Values::F64(FACTORS.map(|a| 1.0 / a - 1.0).to_vec()));
    file.write(path);
}

/// The same as a table, rows in any order; ids are unique, or those of each step from 0.
fn table(path: &Path, made: &[Vec<Made>; 3], unique: bool) {
    let id = |step: usize, halo: usize| if unique { 100 * step + halo } else { halo };
    let mut rows = Vec::new();
    for (step, own) in made.iter().enumerate() {
        for (halo, (at, mass, radius, descendant)) in own.iter().enumerate() {
            let descendant = descendant.map_or("-1".into(), |halo| id(step + 1, halo).to_string());
            let [x, y, z] = at;
            let time = FACTORS[step];
            rows.push(format!("{},{step},{time},{descendant},{x},{y},{z},{mass},{radius}", id(step, halo)));
        }
    }
    rows.reverse();
    std::fs::write(path, format!("id,step,time,descendant,x,y,z,mass,radius\n{}\n", rows.join("\n"))).unwrap();
}

/// Of a tree what the made-up one has: time, place, mass, radius and the descendant's place and mass.
fn content(tree: &MergerTree) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for (number, halo) in tree.haloes().iter().enumerate() {
        let step =
            (0..tree.steps().len()).find(|step| (0..=*step).map(|step| tree.count(step)).sum::<usize>() > number);
        let then = halo.descendant.map(|other| (tree.haloes()[other].position, tree.haloes()[other].mass));
        let time = tree.steps()[step.unwrap()].time;
        all.push(format!("{time} {:?} {:?} {:?} {then:?}", halo.position, halo.mass, halo.radius));
    }
    all.sort();
    all
}

fn read(path: &Path) -> MergerTree {
    MergerTree::of_series(path).unwrap().unwrap()
}

#[test]
fn all_kinds_of_files_have_the_same_tree() {
    let folder = tempfile::tempdir().unwrap();
    let made = made();
    let groups = catalogues(folder.path(), &made);
    let [forest, by_step, by_run] = ["trees.hdf5", "steps.csv", "run.csv"].map(|name| folder.path().join(name));
    trees(&forest, &made);
    table(&by_step, &made, false);
    table(&by_run, &made, true);
    let tree = read(&groups);
    assert_eq!((tree.format, tree.own_step, tree.steps().len(), tree.haloes().len()), ("groups", 1, 3, 9));
    assert_eq!(content(&tree).len(), 9);
    for (path, format, box_size) in [(&forest, "trees", Some(EDGE)), (&by_step, "csv", None), (&by_run, "csv", None)] {
        let other = read(path);
        assert_eq!((other.format, other.box_size, other.own_step), (format, box_size, 2));
        assert_eq!(content(&other), content(&tree), "{format}");
    }
    // One catalogue alone is that of its step; the file of all steps has those of the last.
    assert!(MergerTree::of_file(&groups).unwrap().is_none());
    assert_eq!(Catalogue::read(&groups).unwrap().objects.len(), 2);
    assert_eq!(Catalogue::read(&forest).unwrap().objects.len(), 3);
    assert_eq!(Catalogue::read_at(&groups, Some(0.3), true).unwrap().objects.len(), 4);
}

#[test]
fn haloes_move_along_their_links() {
    let folder = tempfile::tempdir().unwrap();
    let groups = catalogues(folder.path(), &made());
    let tree = read(&groups);
    let at =
        |time: f64, name: &str| tree.objects_at(Some(time)).into_iter().find(|object| object.name == name).unwrap();
    // At a step each is where it is; before the first and after the last those of these.
    for (step, factor) in FACTORS.into_iter().enumerate() {
        for (halo, made) in made()[step].iter().enumerate() {
            let object = at(factor, &format!("Subhalo {halo}"));
            assert_eq!((object.position.to_array(), object.mass, object.radius), (made.0, Some(made.1), Some(made.2)));
        }
    }
    assert_eq!(tree.objects_at(Some(0.1)).len(), 4);
    assert_eq!(tree.objects_at(Some(7.0)).len(), 3);
    // Whoever merges comes to where both are then, with what it has; the heavier one becomes it.
    let end = 0.5 - 1e-9;
    for (name, mass) in [("Subhalo 0", 3.0), ("Subhalo 1", 11.0)] {
        let object = at(end, name);
        assert!((object.position - DVec3::new(2.0, 6.0, 5.0)).length() < 1e-6, "{name}");
        assert!((object.mass.unwrap() - mass).abs() < 1e-6, "{name}");
    }
    // Through the face of the box, the short way round: it moves evenly.
    let halfway = at(0.375, "Subhalo 2").position;
    assert!((halfway.x - 0.0).abs().min((halfway.x - EDGE).abs()) < 0.2 && halfway.y == 1.0, "{halfway}");
    // The velocity has no jump at the step.
    let speed = |time: f64, name: &str| (at(time + 1e-7, name).position - at(time, name).position) / 1e-7;
    let (before, after) = (speed(0.5 - 2e-7, "Subhalo 1"), speed(0.5 + 1e-7, "Subhalo 1"));
    assert!((before - after).length() < 1e-4, "{before} {after}");
}

#[test]
fn the_history_of_a_halo_is_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    catalogues(folder, &made());
    let ok = |arguments: &[&str]| text(folder, arguments);
    let catalogue = "fof_subhalo_tab_010.hdf5";
    let text = ok(&["catalogue", catalogue, "--history", "subhalo 1"]);
    let expected = "step,time,redshift,id,name,x,y,z,radius,mass,mergers,merged-mass\n\
                    9,0.25,3,1,Subhalo 1,2,5,5,0.8,8,0,0\n\
                    10,0.5,1,1,Subhalo 1,2,6,5,1,11,1,3\n\
                    11,1,0,0,Subhalo 0,2,8,5,1.2,12,0,0\n";
    assert_eq!(text, expected);
    // The same one by its name at another step, in a file.
    ok(&["catalogue", catalogue, "--time", "z:0", "--history", "Subhalo 0", "-o", "same.csv"]);
    assert_eq!(std::fs::read_to_string(folder.join("same.csv")).unwrap(), expected);
    // The lighter one is there until it merges, and goes on as what it has become.
    let text = ok(&["catalogue", catalogue, "--time", "step:0", "--history", "Subhalo 0"]);
    assert_eq!(text.lines().skip(1).map(|line| line.split(',').nth(9).unwrap()).collect::<Vec<_>>(), ["3", "11", "12"]);
    let listed = ok(&["catalogue", catalogue, "--time", "a:0.25"]);
    assert!(listed.contains("4 objects") && listed.contains("Subhalo 3"), "{listed}");
    let told = |arguments: &[&str]| String::from_utf8(run(folder, arguments).stderr).unwrap();
    assert!(told(&["catalogue", catalogue, "--history", "Subhalo 7"]).contains("Subhalo 0"));
    assert!(told(&["catalogue", catalogue, "--time", "30", "--history", "Subhalo 0"]).contains("--time"));
    std::fs::write(folder.join("one.csv"), "name,x,y,z\nA,1,2,3\n").unwrap();
    assert!(told(&["catalogue", "one.csv", "--history", "A"]).contains("one.csv: one step, without links"));
}

#[test]
fn links_that_lead_nowhere_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let told = |rows: &str| {
        std::fs::write(&path, format!("id,step,descendant,x,y,z\n{rows}")).unwrap();
        MergerTree::of_file(&path).unwrap_err().to_string()
    };
    for (rows, expected) in [
        ("1,0,1,0,0,0\n2,1,-1,0,0,0\n", "line 2: descendant: found 1, expected the id of a halo of a later step"),
        ("1,0,2,0,0,0\n2,1,1,0,0,0\n", "line 3: descendant: found 1"),
        ("1,0,2,0,0,0\n2,0,1,0,0,0\n", "line 2: descendant: found 2"),
        ("1,0,7,0,0,0\n2,1,-1,0,0,0\n", "line 2: descendant: found 7"),
        ("1,0,5,0,0,0\n1,1,-1,0,0,0\n", "expected the id of a halo of the next step"),
        ("1,0,-2,0,0,0\n", "descendant: found -2, expected an id, or -1"),
        ("1,0.5,-1,0,0,0\n", "step: found 0.5, expected a whole number"),
        ("1,0,-1,0,0,0\n1,0,-1,0,0,0\n", "line 3: id: found 1, expected an id that no other halo of the step has"),
    ] {
        let told = told(rows);
        assert!(told.contains("a.csv: ") && told.contains(expected) && !told.contains('\n'), "{rows:?}: {told}");
    }
    // A link that skips a step is sound where ids say which step; and empty cells are none.
    std::fs::write(&path, "id,step,descendant,x,y,z\n1,0,3,0,0,0\n2,1,,1,0,0\n3,2,,2,0,0\n").unwrap();
    let tree = read(&path);
    assert_eq!(tree.history(tree.named(0, "Halo 1").unwrap()).len(), 2);
    assert_eq!(tree.objects_at(Some(1.0)).len(), 1);

    // Numbers beyond the next catalogue, and too few of them.
    let mut wrong = made();
    wrong[0][2].3 = Some(2);
    let told = MergerTree::of_series(&catalogues(folder.path(), &wrong)).unwrap_err().to_string();
    let expected = "DescSubhaloNr of row 2: found 2, expected -1, or a number below 2";
    assert!(told.contains("subhalo_desc_009.hdf5: ") && told.contains(expected), "{told}");
    let mut links = Hdf5::default();
    links.dataset("Subhalo", "DescSubhaloNr", 1, Values::F64(vec![0.0]));
    links.write(&folder.path().join("subhalo_desc_009.hdf5"));
    let told = MergerTree::of_series(&folder.path().join("fof_subhalo_tab_010.hdf5")).unwrap_err().to_string();
    assert!(told.contains("DescSubhaloNr: found 1, expected 4, one for each subhalo"), "{told}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_trees_are_errors_or_other_trees(changes in prop::collection::vec((0.0..1.0, any::<u8>()), 1..9), cut in 0.0..2.0) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trees.hdf5");
        trees(&path, &made());
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, byte) in changes {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = byte;
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        std::fs::write(&path, bytes).unwrap();
        match MergerTree::of_file(&path) {
            Ok(Some(tree)) => {
                // Whatever it says: every history ends, and every moment has its objects.
                (0..tree.haloes().len()).for_each(|halo| assert!(tree.history(halo).len() <= tree.steps().len()));
                prop_assert!(tree.objects_at(Some(0.4)).len() <= tree.haloes().len());
            }
            Ok(None) => {}
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }
}
