//! Merger trees of halo finders: a made-up forest has the same histories from files of every one of them as from a table, and what is damaged is an
//! error or another tree. Files are laid out as the programs write them, with fewer columns.

use crate::support::hdf5::{Hdf5, Values};
use deepfield::explore::{Catalogue, MergerTree};
use proptest::prelude::*;
use proptest::sample::Index;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Those of the steps.
const REDSHIFTS: [f64; 5] = [3.0, 1.5, 1.0, 0.25, 0.0];

/// A halo, and which of the next step it becomes.
#[derive(Clone, Debug)]
struct Made {
    place: [f64; 3],
    mass: f64,
    radius: f64,
    next: Option<usize>,
}

/// The haloes of each step.
type Forest = Vec<Vec<Made>>;

fn scale(step: usize) -> f64 {
    1.0 / (1.0 + REDSHIFTS[step])
}

/// Haloes of any fate, no two as heavy.
fn forest() -> impl Strategy<Value = Forest> {
    let axis = -1e3..1e3_f64;
    let fate = prop::option::weighted(0.8, any::<Index>());
    let halo = ([axis.clone(), axis.clone(), axis], 1..1000_u32, 1..1000_u32, fate);
    prop::collection::vec(prop::collection::vec(halo, 1..6), 2..=REDSHIFTS.len()).prop_map(|steps| {
        let counts: Vec<usize> = steps.iter().skip(1).map(Vec::len).collect();
        let of_step = |(step, haloes): (usize, Vec<_>)| {
            let made = |(halo, (place, mass, radius, fate)): (usize, ([f64; 3], u32, u32, Option<Index>))| Made {
                place,
                mass: f64::from(mass * 64 + (8 * step + halo) as u32),
                radius: f64::from(radius) / 8.0,
                next: fate.zip(counts.get(step)).map(|(fate, count)| fate.index(*count)),
            };
            haloes.into_iter().enumerate().map(made).collect::<Vec<Made>>()
        };
        steps.into_iter().enumerate().map(of_step).collect::<Forest>()
    })
}

/// Three steps, in which two haloes merge, one vanishes and one is born.
fn small() -> Forest {
    let halo = |x: f64, mass: f64, next| Made { place: [x, 2.0, 3.0], mass, radius: 0.5, next };
    vec![
        vec![halo(1.0, 3.0, Some(0)), halo(2.0, 5.0, Some(0)), halo(7.0, 1.0, None)],
        vec![halo(3.0, 8.0, Some(1))],
        vec![halo(9.0, 2.0, None), halo(4.0, 9.0, None)],
    ]
}

/// The haloes that become one of a step.
fn progenitors(forest: &[Vec<Made>], step: usize, halo: usize) -> Vec<usize> {
    let before = step.checked_sub(1).map_or(&[][..], |before| &forest[before][..]);
    (0..before.len()).filter(|other| before[*other].next == Some(halo)).collect()
}

/// A number that no other halo of the run has.
fn id(step: usize, halo: usize) -> usize {
    100 * (REDSHIFTS.len() - step) + halo
}

fn table(folder: &Path, forest: &[Vec<Made>]) -> PathBuf {
    let mut text = "id,step,time,descendant,x,y,z,mass,radius\n".to_owned();
    for (step, haloes) in forest.iter().enumerate() {
        for (halo, Made { place: [x, y, z], mass, radius, next }) in haloes.iter().enumerate() {
            let next = next.map_or("-1".into(), |next| id(step + 1, next).to_string());
            writeln!(text, "{},{step},{},{next},{x},{y},{z},{mass},{radius}", id(step, halo), scale(step)).unwrap();
        }
    }
    let path = folder.join("forest.csv");
    std::fs::write(&path, text).unwrap();
    path
}

/// `tree_0_0_0.dat` of consistent-trees.
fn consistent_trees(folder: &Path, forest: &[Vec<Made>]) -> PathBuf {
    let mut trees = String::new();
    let mut count = 0;
    let all = (0..forest.len()).flat_map(|step| (0..forest[step].len()).map(move |halo| (step, halo)));
    for root in all.filter(|(step, halo)| forest[*step][*halo].next.is_none()) {
        let root_id = id(root.0, root.1);
        writeln!(trees, "#tree {root_id}").unwrap();
        count += 1;
        let mut open = vec![root];
        while let Some((step, halo)) = open.pop() {
            let Made { place: [x, y, z], mass, radius, next } = &forest[step][halo];
            let next_scale = next.map_or(0.0, |_| scale(step + 1));
            let next = next.map_or("-1".into(), |next| id(step + 1, next).to_string());
            let (own, before) = (id(step, halo), progenitors(forest, step, halo));
            let (time, radius) = (scale(step), radius * 1000.0);
            write!(trees, " {time} {own} {next_scale} {next} {} -1 -1 -1 0 {mass} {mass:e}", before.len()).unwrap();
            write!(trees, " {radius} 1 50 1 0 200 {x} {y} {z} 0 0 0 1e9 0 0 0.05").unwrap();
            writeln!(trees, " 1 2 {root_id} {own} {}", 40 + step).unwrap();
            open.extend(before.into_iter().map(|other| (step - 1, other)));
        }
    }
    let header = "#scale(0) id(1) desc_scale(2) desc_id(3) num_prog(4) pid(5) upid(6) desc_pid(7) phantom(8) sam_mvir(9) \
                  mvir(10) rvir(11) rs(12) vrms(13) mmp?(14) scale_of_last_MM(15) vmax(16) x(17) y(18) z(19) vx(20) vy(21) \
                  vz(22) Jx(23) Jy(24) Jz(25) Spin(26) Breadth_first_ID(27) Depth_first_ID(28) Tree_root_ID(29) \
                  Orig_halo_ID(30) Snap_num(31)\n#Omega_M = 0.3; Omega_L = 0.7; h0 = 0.7\n#Full box size = 4000.000000 Mpc/h\n\
                  #Scale: Scale factor of halo.\n#Tree_root_ID: ID of the halo at the last timestep in the tree.\n\
                  #Consistent Trees Version 1.0\n";
    let path = folder.join("tree_0_0_0.dat");
    std::fs::write(&path, format!("{header}{count:<12}\n{trees}")).unwrap();
    path
}

/// Lists of AHF, and links with particles, where haloes stand below others, too, that have some of theirs, or by numbers alone.
fn ahf(folder: &Path, forest: &[Vec<Made>], particles: bool) -> Vec<PathBuf> {
    let (own_particles, other_particles) = (100, 80);
    let write = |(step, haloes): (usize, &Vec<Made>)| {
        let name = format!("snapshot_{:03}.z{:.3}.AHF_", 8 + step, REDSHIFTS[step]);
        let mut list =
            "#ID(1)\thostHalo(2)\tMvir(3)\tnpart(4)\tXc(5)\tYc(6)\tZc(7)\tVXc(8)\tRvir(9)\tRmax(10)\n".to_owned();
        let mut links = match particles {
            true => "#   HaloID(1)   HaloPart(2)  NumProgenitors(3)\n#      SharedPart(1)    HaloID(2)   HaloPart(3)\n"
                .into(),
            false => format!("{}\n", haloes.len()),
        };
        for (halo, Made { place: [x, y, z], mass, radius, .. }) in haloes.iter().enumerate() {
            writeln!(list, "{halo}\t0\t{mass:e}\t100\t{x}\t{y}\t{z}\t5.5\t{radius}\t1\t").unwrap();
            let own = progenitors(forest, step, halo);
            if !particles && !own.is_empty() {
                writeln!(links, "{halo}  {}", own.len()).unwrap();
                own.iter().for_each(|other| writeln!(links, "{other}").unwrap());
            } else if particles {
                let before = step.checked_sub(1).map_or(&[][..], |before| &forest[before][..]);
                let listed = (0..before.len()).filter(|other| before[*other].next.is_some());
                writeln!(links, "{halo:12} {own_particles:12} {:12}", listed.clone().count()).unwrap();
                for other in listed {
                    let shared = if own.contains(&other) { 40 } else { 10 };
                    writeln!(links, "  {shared:12} {other:12} {other_particles:12}").unwrap();
                }
            }
        }
        std::fs::write(folder.join(format!("{name}mtree")), links).unwrap();
        let path = folder.join(format!("{name}halos"));
        std::fs::write(&path, list).unwrap();
        path
    };
    forest.iter().enumerate().map(write).collect()
}

/// Catalogues of HBT+: a halo has the track of its first progenitor, into which others sink, and these stay in all later files.
fn hbt(folder: &Path, forest: &[Vec<Made>]) -> Vec<PathBuf> {
    let mut count = 0;
    let mut before: Vec<u64> = Vec::new();
    let mut sunk: Vec<(u64, i32)> = Vec::new();
    let write = |(step, haloes): (usize, &Vec<Made>)| {
        let mut tracks = Vec::new();
        for halo in 0..haloes.len() {
            let own = progenitors(forest, step, halo);
            let track = own.first().map_or(count, |first| before[*first]);
            count += u64::from(own.is_empty());
            sunk.extend(own.iter().skip(1).map(|other| (before[*other], track as i32)));
            tracks.push(track);
        }
        before.clone_from(&tracks);
        let rows = haloes.len() + sunk.len();
        let of = |of: fn(&Made) -> Vec<f64>| {
            let own = haloes.iter().flat_map(of);
            let width = of(&haloes[0]).len();
            Values::F64(own.chain(vec![0.5; width * sunk.len()]).collect())
        };
        let (others, sinks): (Vec<u64>, Vec<i32>) = sunk.iter().copied().unzip();
        let none = vec![-1; haloes.len()];
        let mut file = Hdf5::default();
        let members = vec![
            ("TrackId", 1, Values::U64([tracks, others].concat())),
            ("Mbound", 1, of(|halo| vec![halo.mass])),
            ("RHalfComoving", 1, of(|halo| vec![halo.radius])),
            ("ComovingMostBoundPosition", 3, of(|halo| halo.place.to_vec())),
            ("SinkTrackId", 1, Values::I32([none, sinks].concat())),
        ];
        file.dataset("", "Subhalos", 1, Values::Records(rows, members));
        file.dataset("", "NumberOfFiles", 1, Values::I32(vec![1]));
        file.dataset("Cosmology", "ScaleFactor", 1, Values::F64(vec![scale(step)]));
        let path = folder.join(format!("SubSnap_{:03}.0.hdf5", 20 + step));
        file.write(&path);
        path
    };
    forest.iter().enumerate().map(write).collect()
}

fn read(path: &Path) -> MergerTree {
    MergerTree::of_series(path).unwrap().unwrap()
}

/// The history of every halo, without what its files call it.
fn histories(tree: &MergerTree) -> Vec<String> {
    let history = |halo: usize| -> String {
        let rows = tree.history(halo).into_iter().map(|row| {
            let radius = row.radius.unwrap();
            let merged = (row.mergers, row.merged_mass);
            format!("{} {:?} {radius:.6e} {:?} {merged:?};", row.time, row.position, row.mass)
        });
        rows.collect()
    };
    let mut all: Vec<String> = (0..tree.haloes().len()).map(history).collect();
    all.sort();
    all
}

proptest! {
    #![proptest_config(crate::cases::cases(60))]

    #[test]
    fn histories_are_the_same_through_every_format(forest in forest(), at in any::<Index>(), particles in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let expected = histories(&read(&table(folder, &forest)));
        let at = at.index(forest.len());
        let last = forest.len() - 1;
        let files = [
            (consistent_trees(folder, &forest), "consistent-trees", last, format!("halo {}", id(0, 0)), (40, Some(4000.0))),
            (ahf(folder, &forest, particles).swap_remove(at), "ahf", at, "halo 0".into(), (8, None)),
            (hbt(folder, &forest).swap_remove(at), "hbt", at, "track 0".into(), (20, None)),
        ];
        for (path, format, own_step, first, (number, box_size)) in files {
            let tree = read(&path);
            prop_assert_eq!((tree.format, tree.own_step, tree.box_size), (format, own_step, box_size));
            prop_assert_eq!(&histories(&tree), &expected, "{}", format);
            let halo = tree.named(0, &first).unwrap();
            prop_assert_eq!(tree.haloes()[halo].position.to_array(), forest[0][0].place);
            prop_assert_eq!(tree.steps()[0].number, number);
        }
    }

    #[test]
    fn damaged_files_are_errors_or_other_trees(
        which in 0..5_usize,
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 0..6),
        keep in 0.01..1.5_f64,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let forest = small();
        let path = match which {
            0 => consistent_trees(folder, &forest),
            1..4 => ahf(folder, &forest, which < 3).swap_remove(1),
            _ => hbt(folder, &forest).swap_remove(1),
        };
        let damaged = if which == 1 || which == 3 { path.with_file_name("snapshot_009.z1.500.AHF_mtree") } else { path.clone() };
        let mut bytes = std::fs::read(&damaged).unwrap();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate((bytes.len() as f64 * keep).ceil() as usize);
        std::fs::write(&damaged, bytes).unwrap();
        match MergerTree::of_series(&path) {
            Ok(Some(tree)) => {
                (0..tree.haloes().len()).for_each(|halo| assert!(tree.history(halo).len() <= tree.steps().len()));
                prop_assert!(tree.objects_at(Some(0.45)).len() <= tree.haloes().len());
            }
            Ok(None) => {}
            Err(error) => prop_assert!(!error.to_string().contains('\n'), "{}", error),
        }
    }
}

#[test]
fn what_trees_of_finders_contradict_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let told = |path: &Path| {
        let told = MergerTree::of_series(path).unwrap_err().to_string();
        assert!(told.starts_with(folder.to_str().unwrap()) && !told.contains('\n'), "{told}");
        told
    };
    let changed = |path: &Path, from: &str, to: &str| {
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.contains(from), "{text}");
        let changed = path.with_file_name("changed.dat");
        std::fs::write(&changed, text.replacen(from, to, 1)).unwrap();
        changed
    };
    let trees = consistent_trees(folder, &small());
    // The haloes of the last step, as of any catalogue.
    let catalogue = Catalogue::read(&trees).unwrap();
    assert_eq!(
        (catalogue.format, catalogue.objects.len(), &*catalogue.length_unit.0),
        ("consistent-trees", 2, "a Mpc/h")
    );
    for (from, to, expected) in [
        ("\n3           \n", "\n4           \n", "trees: found 3, expected 4, as the line before the first says"),
        ("\n3           \n", "\nXXXXXXXXXXXX\n", "number of trees in line 7: found XXXXXXXXXXXX"),
        (
            " 500 0.4 400 ",
            " 500 0.4 407 ",
            "desc_id of halo 500: found 407, expected -1, or the id of a halo of a later step",
        ),
        (" 500 0.4 400 ", " 500 0.4 501 ", "descendant of halo 500 at step 40: found none of a later step"),
        (" 500 0.4 400 ", " 501 0.4 400 ", "id: found 501, expected a number that no other halo has"),
        (" 500 0.4 400 ", " 500 0.4 400.5 ", "desc_id in line"),
        (" 0.25 500 ", " -0.25 500 ", "found -0.25, expected a number above 0"),
        (" 0.25 500 ", "\n 0.25\n 0.25 500 ", "found 1, expected at least 20"),
    ] {
        let told = told(&changed(&trees, from, to));
        assert!(told.contains(expected), "{told}");
    }
    let list = ahf(folder, &small(), true).swap_remove(1);
    let links = list.with_file_name("snapshot_009.z1.500.AHF_mtree");
    let text = std::fs::read_to_string(&links).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    for (text, expected) in [
        (lines[..lines.len() - 1].join("\n"), "progenitors of the last halo: found 1, expected 2"),
        (format!("{text}5 100 0\n"), "HaloID in line 6: found 5, expected a halo of the list"),
        (format!("{text}0 100 1\n 3 7 9\n"), "HaloID of a progenitor in line 7: found 7"),
        (format!("{text}0 100 x\n"), "NumProgenitors in line 6: found x"),
        (format!("{text}0 100 1 1\n"), "values in line 6: found 4, expected 2 or 3, of a halo"),
    ] {
        std::fs::write(&links, text).unwrap();
        let told = told(&list);
        assert!(told.contains("AHF_mtree: ") && told.contains(expected), "{told}");
    }
    // Without links, and alone, they are of one step.
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.to_str().unwrap().ends_with("_mtree") {
            std::fs::remove_file(path).unwrap();
        }
    }
    assert!(MergerTree::of_series(&list).unwrap().is_none());
    let catalogues = hbt(folder, &small());
    let mut file = Hdf5::default();
    let members =
        vec![("TrackId", 1, Values::U64(vec![0])), ("ComovingMostBoundPosition", 3, Values::F64(vec![1.0; 3]))];
    file.dataset("", "Subhalos", 1, Values::Records(1, members));
    file.write(&catalogues[2]);
    assert!(told(&catalogues[0]).contains("SubSnap_022.0.hdf5: Cosmology/ScaleFactor: not there"));
    catalogues[1..].iter().for_each(|path| std::fs::remove_file(path).unwrap());
    assert!(MergerTree::of_series(&catalogues[0]).unwrap().is_none());
}
