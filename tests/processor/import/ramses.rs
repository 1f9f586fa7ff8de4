//! RAMSES: trees of grids and particles that several processes have written, in every layout. Leaves fill the box, particles keep their
//! families.

use super::hostile::{mutate, mutations, survives_at};
use super::writers::file;
use super::{data, message, read_all};
use deepfield::import::{LoadOptions, load, open, summarize};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const CPUS: usize = 2;
const LEVELS: u32 = 4;
/// Length of a coarse cell.
const COARSE: f64 = 10.0;
const GAMMA: f64 = 1.4;

/// How an output is written.
#[derive(Clone, Copy, Debug)]
struct Style {
    big: bool,
    double: bool,
    /// With a layer of coarse cells around the box.
    boundaries: bool,
    layout: Layout,
}

/// Which version names the records of particles, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Layout {
    /// A description with types, families, ids of eight bytes.
    Described,
    /// A list in the header.
    Listed,
    /// Nothing, with families.
    Families,
    /// Nothing, without families.
    Old,
}

/// A grid of eight cells: its level from 1, its middle in coarse cells, whose it is, and which cells are divided.
struct Grid {
    level: u32,
    middle: [f64; 3],
    owner: usize,
    divided: [bool; 8],
}

/// Family, birth, place.
type Particle = (i8, f64, [f64; 3]);

impl Style {
    fn word(self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if self.big {
            bytes.reverse();
        }
        bytes
    }

    fn record(self, out: &mut Vec<u8>, words: impl IntoIterator<Item = Vec<u8>>) {
        let content: Vec<u8> = words.into_iter().flatten().collect();
        let length = self.word(&(content.len() as u32).to_le_bytes());
        out.extend([length.clone(), content, length].concat());
    }

    fn wholes(self, out: &mut Vec<u8>, numbers: &[i32]) {
        self.record(out, numbers.iter().map(|number| self.word(&number.to_le_bytes())));
    }

    fn reals(self, out: &mut Vec<u8>, numbers: &[f64]) {
        let real = |number: &f64| match self.double {
            true => self.word(&number.to_le_bytes()),
            false => self.word(&(*number as f32).to_le_bytes()),
        };
        self.record(out, numbers.iter().map(real));
    }

    fn before(self) -> f64 {
        if self.boundaries { 1.0 } else { 0.0 }
    }
}

/// A tree in which `bits` say which cells are divided.
fn tree(bits: &[bool], style: Style) -> Vec<Grid> {
    let mut waiting = vec![(1, [0.5 + style.before(); 3])];
    let (mut grids, mut next) = (Vec::new(), 0);
    while let Some((level, middle)) = waiting.pop() {
        let mut divided = [false; 8];
        for (cell, divided) in divided.iter_mut().enumerate() {
            *divided = level < LEVELS && bits[next % bits.len()];
            next += 1;
            if *divided {
                waiting.push((level + 1, middle_of(middle, level, cell)));
            }
        }
        grids.push(Grid { level, middle, owner: next / 8 % CPUS, divided });
    }
    grids
}

/// The middle of a cell in coarse cells; x is the fastest.
fn middle_of(middle: [f64; 3], level: u32, cell: usize) -> [f64; 3] {
    let edge = 0.5f64.powi(level as i32);
    [0, 1, 2].map(|axis| middle[axis] + edge * if cell >> axis & 1 == 1 { 0.5 } else { -0.5 })
}

/// Density, velocity and pressure in a cell.
fn values(middle: [f64; 3], level: u32) -> [f64; 5] {
    let [x, y, z] = middle;
    [1.0 + x + 2.0 * y + 4.0 * z, x, y, z, 8.0 + f64::from(level)]
}

/// The files of grids and of what is in their cells that a process writes: its own grids, and those of the other one, which a process knows, too.
fn cells(style: Style, grids: &[Grid], cpu: usize) -> [Vec<u8>; 2] {
    let boundaries = if style.boundaries { 2 } else { 0 };
    let of = |level: u32, owner: usize| grids.iter().filter(move |grid| (grid.level, grid.owner) == (level, owner));
    let (mut amr, mut hydro) = (Vec::new(), Vec::new());
    let out = &mut amr;
    let nx = if style.boundaries { 3 } else { 1 };
    style.wholes(out, &[CPUS as i32]);
    style.wholes(out, &[3]);
    style.wholes(out, &[nx; 3]);
    for number in [LEVELS as i32, 1000, boundaries, grids.len() as i32] {
        style.wholes(out, &[number]);
    }
    style.reals(out, &[COARSE]);
    style.wholes(out, &[1, 1, 1]);
    for count in [1, 1, 1, LEVELS as usize, LEVELS as usize] {
        style.reals(out, &vec![0.5; count]);
    }
    style.wholes(out, &[0, 0]);
    for count in [3, 7, 5, 1] {
        style.reals(out, &vec![0.5; count]);
    }
    let table: Vec<i32> = (1..=LEVELS)
        .flat_map(|level| (0..CPUS).map(move |owner| (level, owner)))
        .map(|(level, owner)| of(level, owner).count() as i32)
        .collect();
    // Where lists of grids begin and end, and how long they are.
    for _ in 0..3 {
        style.wholes(out, &table);
    }
    style.wholes(out, &[0; 10 * LEVELS as usize]);
    // One grid of the first boundary on the first level.
    let mut around = vec![0; (boundaries * LEVELS as i32) as usize];
    if let Some(first) = around.first_mut() {
        *first = 1;
        for _ in 0..3 {
            style.wholes(out, &around);
        }
    }
    style.wholes(out, &[0; 5]);
    style.record(out, [format!("{:<128}", if style.big { "bisection" } else { "hilbert" }).into_bytes()]);
    (0..if style.big { 5 } else { 1 }).for_each(|_| style.reals(out, &[0.0, 1.0]));
    (0..3).for_each(|_| style.wholes(out, &vec![0; (nx * nx * nx) as usize]));

    for number in [CPUS as i32, 5, 3, LEVELS as i32, boundaries] {
        style.wholes(&mut hydro, &[number]);
    }
    style.reals(&mut hydro, &[GAMMA]);
    let outside = Grid { level: 1, middle: [-7.0; 3], owner: 0, divided: [false; 8] };
    for level in 1..=LEVELS {
        for owner in 0..CPUS + boundaries as usize {
            let own: Vec<&Grid> = match owner.checked_sub(CPUS) {
                None => of(level, owner).collect(),
                Some(0) if level == 1 => vec![&outside],
                Some(_) => Vec::new(),
            };
            style.wholes(&mut hydro, &[level as i32]);
            style.wholes(&mut hydro, &[own.len() as i32]);
            if own.is_empty() {
                continue;
            }
            // What is of others is not what it should be: it must not be read.
            let is_own = owner == cpu;
            let same = |out: &mut Vec<u8>, records: usize| {
                (0..records).for_each(|_| style.wholes(out, &vec![1; own.len()]));
            };
            same(&mut amr, 3);
            for axis in 0..3 {
                style.reals(&mut amr, &own.iter().map(|grid| grid.middle[axis]).collect::<Vec<_>>());
            }
            same(&mut amr, 7);
            for cell in 0..8 {
                let sons: Vec<i32> = own.iter().map(|grid| i32::from(is_own && grid.divided[cell])).collect();
                style.wholes(&mut amr, &sons);
            }
            same(&mut amr, 16);
            for cell in 0..8 {
                for quantity in 0..5 {
                    let value = |grid: &&Grid| values(middle_of(grid.middle, level, cell), level)[quantity];
                    style.reals(&mut hydro, &own.iter().map(value).collect::<Vec<_>>());
                }
            }
        }
    }
    [amr, hydro]
}

/// A file of particles.
fn particles(style: Style, particles: &[Particle], first: i64) -> Vec<u8> {
    let mut bytes = Vec::new();
    let out = &mut bytes;
    for number in [CPUS as i32, 3, particles.len() as i32] {
        style.wholes(out, &[number]);
    }
    style.wholes(out, &[1, 2, 3, 4]);
    style.wholes(out, &[0]);
    style.reals(out, &[0.0]);
    style.reals(out, &[0.0]);
    style.wholes(out, &[0]);
    let reals = |out: &mut Vec<u8>, value: &dyn Fn(&Particle) -> f64| {
        style.reals(out, &particles.iter().map(value).collect::<Vec<_>>());
    };
    if particles.is_empty() {
        return bytes;
    }
    for axis in 0..3 {
        reals(out, &|particle| particle.2[axis]);
    }
    for axis in 0..3 {
        reals(out, &|particle| -particle.2[axis]);
    }
    reals(out, &|_| 0.5);
    let ids = first..first + particles.len() as i64;
    match style.layout {
        Layout::Described => style.record(out, ids.map(|id| style.word(&(id + (1 << 60)).to_le_bytes()))),
        _ => style.wholes(out, &ids.map(|id| id as i32).collect::<Vec<_>>()),
    }
    style.wholes(out, &vec![2; particles.len()]);
    if style.layout != Layout::Old {
        style.record(out, particles.iter().map(|particle| vec![particle.0 as u8]));
        style.record(out, particles.iter().map(|_| vec![0]));
    }
    if style.layout == Layout::Listed {
        reals(out, &|_| 9.0);
    }
    reals(out, &|particle| particle.1);
    reals(out, &|_| 0.02);
    bytes
}

/// Writes an output and gives its folder.
fn output(folder: &Path, style: Style, grids: &[Grid], all: [&[Particle]; CPUS]) -> PathBuf {
    let folder = folder.join("output_00007");
    std::fs::create_dir_all(&folder).unwrap();
    let real = |value: f64| format!("{value:23.15E}");
    let info = format!(
        "ncpu        ={CPUS:11}\nndim        =          3\nlevelmin    =          1\n\nboxlen      ={}\ntime        ={}\naexp        ={}\n\
         H0          ={}\nomega_m     ={}\nomega_l     ={}\nunit_l      ={}\nunit_d      ={}\nunit_t      ={}\n\nordering type=hilbert\n",
        real(COARSE),
        real(1.5),
        real(1.0),
        real(1.0),
        real(1.0),
        real(0.0),
        real(3.085_678e21),
        real(6.77e-23),
        real(4.7e14),
    );
    file(&folder, "info_00007.txt", info.as_bytes());
    file(&folder, "hydro_file_descriptor.txt", b"nvar        =          5\nvariable #  1: density\nvariable #  2: velocity_x\nvariable #  3: velocity_y\nvariable #  4: velocity_z\nvariable #  5: thermal_pressure\n");
    match style.layout {
        Layout::Described => {
            let names = "position_x,d position_y,d position_z,d velocity_x,d velocity_y,d velocity_z,d mass,d identity,l levelp,i family,b tag,b birth_time,d metallicity,d";
            let lines = names
                .split(' ')
                .enumerate()
                .map(|(index, name)| format!("{:3}, {}\n", index + 1, name.replace(',', ", ")));
            let text = "# version:  1\n# ivar, variable_name, variable_type\n".to_owned() + &lines.collect::<String>();
            file(&folder, "part_file_descriptor.txt", text.as_bytes());
        }
        Layout::Listed => {
            let text = "#      Family     Count\n           DM         3\n Particle fields\npos vel mass iord level family tag phi tform metal ";
            file(&folder, "header_00007.txt", text.as_bytes());
        }
        Layout::Families | Layout::Old => {}
    }
    let mut first = 1;
    for (cpu, own) in all.into_iter().enumerate() {
        let [amr, hydro] = cells(style, grids, cpu);
        file(&folder, &format!("amr_00007.out{:05}", cpu + 1), &amr);
        file(&folder, &format!("hydro_00007.out{:05}", cpu + 1), &hydro);
        file(&folder, &format!("part_00007.out{:05}", cpu + 1), &particles(style, own, first));
        first += own.len() as i64;
    }
    folder
}

/// A small output.
fn sample(folder: &Path, style: Style) -> PathBuf {
    let grids = tree(&[true, false, false, true, false, false, false], style);
    let of = |i: i32| ([1, 2, 1][i as usize % 3], [0.0, 3.5, 0.0][i as usize % 3], [0.5 + f64::from(i), 2.0, 3.0]);
    let all: Vec<Particle> = (0..9).map(of).collect();
    output(folder, style, &grids, [&all[..4], &all[4..]])
}

const STYLE: Style = Style { big: false, double: true, boundaries: false, layout: Layout::Described };

proptest! {
    #![proptest_config(crate::cases::cases(32))]

    #[test]
    fn what_is_written_comes_back(
        bits in prop::collection::vec(prop::bool::weighted(0.2), 1..40),
        all in prop::collection::vec((prop::sample::select(vec![1_i8, 1, 2, 3, -2, 0]), any::<[u8; 3]>()), 0..12),
        cut in 0..12usize,
        (big, double, boundaries) in any::<(bool, bool, bool)>(),
        layout in prop::sample::select(vec![Layout::Described, Layout::Listed, Layout::Families, Layout::Old]),
        step in 1..40u64,
    ) {
        let style = Style { big, double, boundaries, layout };
        let grids = tree(&bits, style);
        // Only stars were born.
        let of = |(kind, at): (i8, [u8; 3])| (kind, if kind == 2 { -1.25 } else { 0.0 }, at.map(|x| f64::from(x) / 32.0));
        let all: Vec<Particle> = all.into_iter().map(of).collect();
        let folder = tempfile::tempdir().unwrap();
        let (one, other) = all.split_at(cut.min(all.len()));
        let source = open(&output(folder.path(), style, &grids, [one, other])).unwrap();
        let about = source.description();
        prop_assert_eq!((&*about.format, about.time, &*about.length_unit.0), ("ramses", Some(1.5), "kpc"));
        prop_assert_eq!(about.box_size, (!boundaries).then_some(COARSE));

        // The leaves, each once.
        let mut expected = Vec::new();
        for grid in &grids {
            for cell in (0..8).filter(|cell| !grid.divided[*cell]) {
                let middle = middle_of(grid.middle, grid.level, cell);
                expected.push((middle.map(|x| (x - style.before()) * COARSE), grid.level, values(middle, grid.level)));
            }
        }
        let read = |family: usize, name: &str| read_all(source.as_ref(), family, name, step);
        let [at, velocity] = ["position", "velocity"].map(|name| read(0, name));
        let [mass, h, density, energy] =
            ["mass", "smoothing-length", "density", "internal-energy"].map(|name| read(0, name));
        prop_assert_eq!(density.len(), expected.len());
        let volume: f64 = mass.iter().zip(&density).map(|(mass, density)| mass / density).sum();
        prop_assert!((volume / COARSE.powi(3) - 1.0).abs() < 1e-6, "leaves of {} in all", volume);
        let mut found: Vec<usize> = (0..density.len()).collect();
        let place = |at: &[f64]| [at[0], at[1], at[2]].map(|x| (x * 1e3).round() as i64);
        found.sort_by_key(|row| place(&at[3 * row..]));
        expected.sort_by_key(|leaf| place(&leaf.0));
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * b.abs().max(1.0);
        for (row, (middle, level, values)) in found.into_iter().zip(&expected) {
            let edge = COARSE * 0.5f64.powi(*level as i32);
            prop_assert!((0..3).all(|axis| near(at[3 * row + axis], middle[axis])));
            prop_assert!((0..3).all(|axis| near(velocity[3 * row + axis], values[1 + axis])));
            prop_assert!(near(density[row], values[0]) && near(mass[row], values[0] * edge.powi(3)));
            prop_assert!(near(energy[row], values[4] / ((GAMMA - 1.0) * values[0])));
            // A sphere of 32 cells.
            let sphere = 4.0 / 3.0 * std::f64::consts::PI * h[row].powi(3);
            prop_assert!(near(sphere / edge.powi(3), 32.0));
        }

        let mut families: BTreeMap<&str, Vec<(u64, [f64; 3])>> = BTreeMap::new();
        for (index, (kind, _, at)) in all.iter().enumerate() {
            let name = match (kind, layout) {
                (2, _) => "stars",
                (1, _) | (_, Layout::Old) => "dark",
                (3, _) => "sink-clouds",
                _ => "tracers",
            };
            let id = index as u64 + 1 + if layout == Layout::Described { 1 << 60 } else { 0 };
            families.entry(name).or_default().push((id, *at));
        }
        prop_assert_eq!(about.families.len(), 1 + families.len());
        for (family, info) in about.families.iter().enumerate().skip(1) {
            let expected = &families[info.name.as_str()];
            prop_assert_eq!(read(family, "position"), expected.iter().flat_map(|(_, at)| *at).collect::<Vec<_>>());
            prop_assert_eq!(read(family, "velocity"), expected.iter().flat_map(|(_, at)| at.map(|x| -x)).collect::<Vec<_>>());
            prop_assert_eq!(read(family, "mass"), vec![0.5; expected.len()]);
            let mut ids = vec![0; expected.len()];
            source.read_ids(family, info.named("id").unwrap(), 0..info.count, &mut ids).unwrap();
            prop_assert_eq!(ids, expected.iter().map(|(id, _)| *id).collect::<Vec<_>>());
        }
    }

    #[test]
    fn damage_is_survived(
        name in prop::sample::select(vec!["info_00007.txt", "amr_00007.out00001", "hydro_00007.out00002", "part_00007.out00001"]),
        mutations in mutations(),
        at in prop::option::of(0.0..1.0f64),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let output = sample(folder.path(), STYLE);
        let mut bytes = std::fs::read(output.join(name)).unwrap();
        mutate(&mut bytes, &mutations);
        bytes.truncate(at.map_or(bytes.len(), |at| (at * bytes.len() as f64) as usize));
        file(&output, name, &bytes);
        survives_at(&output)?;
    }
}

#[test]
fn shortened_and_missing_files_are_errors_that_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let output = sample(folder.path(), STYLE);
    let whole = load(&output, &LoadOptions::default(), &()).unwrap();
    // The text of the numbers stands for the folder.
    assert_eq!(summarize(&output.join("info_00007.txt")).unwrap().particles, whole.len() as u64);
    for name in ["amr_00007.out00002", "hydro_00007.out00001", "part_00007.out00002"] {
        let bytes = std::fs::read(output.join(name)).unwrap();
        for length in (0..bytes.len()).step_by(61).chain([bytes.len() - 1]) {
            file(&output, name, &bytes[..length]);
            let error = open(&output).err().unwrap_or_else(|| panic!("{name} of {length} bytes"));
            message(&error, &output.join(name));
        }
        std::fs::remove_file(output.join(name)).unwrap();
        // Of the first file of particles that there are none.
        if name.ends_with('2') {
            message(&open(&output).err().unwrap(), &output.join(name));
        }
        file(&output, name, &bytes);
    }
    assert_eq!(load(&output, &LoadOptions::default(), &()).unwrap().len(), whole.len());
}

/// An eighth of the box of 32 kpc is dense, and of that one cell of the second level is divided.
#[test]
fn cells_that_the_code_wrote_are_those_it_was_told_to_begin_with() {
    for (name, box_size) in [("periodic", Some(32.0)), ("closed", None)] {
        let source = open(&data("others/ramses").join(name).join("output_00001")).unwrap();
        let about = source.description();
        assert_eq!((about.box_size, &*about.length_unit.0), (box_size, "kpc"), "{name}");
        let gas = about.families.iter().position(|family| family.name.as_str() == "gas").unwrap();
        let info = &about.families[gas];
        let rows = info.count as usize;
        assert_eq!((rows, &*info.fields[info.named("mass").unwrap()].unit.0), (71, "Msun"), "{name}");
        let read = |field: &str| read_all(source.as_ref(), gas, field, 7);
        let [at, velocity, mass, h] = ["position", "velocity", "mass", "smoothing-length"].map(read);
        let [density, pressure, energy] = ["density", "pressure", "internal-energy"].map(read);
        let mut places = BTreeSet::new();
        for row in 0..rows {
            let (place, speed) = (&at[3 * row..3 * row + 3], &velocity[3 * row..3 * row + 3]);
            let edge: f64 = if place.iter().all(|x| *x < 8.0) { 4.0 } else { 8.0 };
            let is_dense = place.iter().all(|x| *x < 16.0);
            // Density, velocity, pressure, and energy where gamma is 1.5.
            let expected = if is_dense { [4.0, -1.0, 0.25, 0.5, 2.0, 1.0] } else { [0.5, 1.0, 2.0, -3.0, 1.5, 6.0] };
            let found = [density[row], speed[0], speed[1], speed[2], pressure[row], energy[row]];
            let is_near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b.abs().max(1.0);
            assert!(found.iter().zip(&expected).all(|(a, b)| is_near(*a, *b)), "{name}: {found:?} at {place:?}");
            assert!(is_near(mass[row], expected[0] * edge.powi(3)), "{name}: {} at {place:?}", mass[row]);
            let sphere = 4.0 / 3.0 * std::f64::consts::PI * h[row].powi(3);
            assert!(is_near(sphere, 32.0 * edge.powi(3)), "{name}: {} at {place:?}", h[row]);
            // In the middle of a cell of its size, inside the box.
            let cell = |x: &f64| x / edge - 0.5;
            let is_cell = |x: &f64| is_near(cell(x), cell(x).round()) && (0.0..32.0).contains(x);
            assert!(place.iter().all(is_cell), "{name}: {place:?}");
            places.insert([0, 1, 2].map(|axis| place[axis].round() as i64));
        }
        assert_eq!(places.len(), rows, "{name}: cells in the same place");
        // What yt says of both.
        assert!((mass.iter().sum::<f64>() - 30720.0).abs() < 1e-6, "{name}");
    }
}
