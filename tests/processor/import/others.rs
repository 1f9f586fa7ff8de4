//! Files that libraries of other authors wrote, the same particles in each: they hold what the formulas of `tests/data/make_others.py` say.

use super::{data, read_all};
use crate::support::{built_from, draw_pages, whole};
use deepfield::codec::VqBits;
use deepfield::import::{FieldKind, LoadOptions, load, open};
use glam::DVec3;
use std::collections::BTreeSet;

/// Particles of a file.
const ROWS: u64 = 24;

/// A family: its name, and the numbers of its particles in their order.
type Family = (&'static str, fn() -> Vec<u64>);

/// A field of one component: name, unit, and values by the particle's number.
type Scalar = (&'static str, &'static str, fn(f64) -> f64);

/// Files that hold the same.
#[derive(Clone, Copy)]
struct Sample {
    files: &'static [&'static str],
    format: &'static str,
    length_unit: &'static str,
    time: Option<f64>,
    families: &'static [Family],
    /// Cells beside the particles, a family of their own.
    cells: u64,
    place: fn([f64; 3]) -> [f64; 3],
    /// The unit of velocities, where there are any.
    velocity_unit: Option<&'static str>,
    id: Option<fn(u64) -> u64>,
    scalars: &'static [Scalar],
}

/// Points without units, with ids of 32 bits.
const POINTS: Sample = Sample {
    files: &[],
    format: "",
    length_unit: "",
    time: None,
    families: &[("dark", || (0..ROWS).collect())],
    cells: 0,
    place: |place| place,
    velocity_unit: Some(""),
    id: Some(id),
    scalars: &[("temperature", "", temperature)],
};

/// Rows of a table with units and ids of 64 bits.
const TABLE: Sample = Sample {
    length_unit: "kpc",
    id: Some(long_id),
    scalars: &[("temperature", "K", temperature), ("close", "", |i| 1.0 - i % 2.0)],
    ..POINTS
};

/// Points of a scanner.
const SCAN: Sample = Sample {
    format: "las",
    velocity_unit: None,
    id: None,
    scalars: &[
        ("gps-time", "", temperature),
        ("intensity", "", |i| 1000.0 + 3.0 * i),
        ("classification", "", |i| i % 5.0),
        ("red", "", |i| i),
        ("green", "", |i| 2.0 * i),
        ("blue", "", |i| 3.0 * i),
    ],
    ..POINTS
};

const SAMPLES: &[Sample] = &[
    Sample { files: &["plyfile-ascii.ply", "plyfile-little.ply", "plyfile-big.ply"], format: "ply", ..POINTS },
    Sample {
        files: &["laspy-1.2.las", "laspy-1.4.las", "laspy-1.2.laz", "laspy-1.4.laz"],
        scalars: &[
            ("temperature", "", temperature),
            ("level", "", |i| 3.0 + 0.25 * i),
            ("gps-time", "", temperature),
            ("intensity", "", |i| 1000.0 + 3.0 * i),
            ("classification", "", |i| i % 5.0),
            ("red", "", |i| i),
            ("green", "", |i| 2.0 * i),
            ("blue", "", |i| 3.0 * i),
        ],
        ..SCAN
    },
    Sample { files: &["copclib.copc.laz"], ..SCAN },
    Sample {
        files: &[
            "vtk-ascii.vtp",
            "vtk-base64.vtp",
            "vtk-raw.vtp",
            "vtk-zlib.vtp",
            "vtk-lz4.vtp",
            "vtk-ascii.vtu",
            "vtk-base64.vtu",
            "vtk-raw.vtu",
            "vtk-zlib.vtu",
            "vtk-lz4.vtu",
            "vtk-poly-text.vtk",
            "vtk-poly-binary.vtk",
            "vtk-grid-text.vtk",
            "vtk-grid-binary.vtk",
            "meshio.vtu",
            "meshio.vtk",
        ],
        format: "vtk-points",
        id: Some(long_id),
        ..POINTS
    },
    Sample { files: &["astropy.fits"], format: "fits", velocity_unit: Some("km s-1"), ..TABLE },
    Sample { files: &["astropy.ecsv"], format: "ecsv", velocity_unit: Some("km / s"), ..TABLE },
    Sample { files: &["astropy-vectors.fits"], format: "fits", velocity_unit: Some("km s-1"), ..TABLE },
    Sample { files: &["astropy-vectors.ecsv"], format: "ecsv", velocity_unit: Some("km / s"), ..TABLE },
    Sample { files: &["astropy-vectors.parquet"], format: "parquet", velocity_unit: Some("km / s"), ..TABLE },
    Sample { files: &["astropy-vectors.hdf5"], format: "hdf5", velocity_unit: Some("km / s"), ..TABLE },
    Sample {
        files: &["pandas-blocks.h5", "pandas-columns.h5", "tables.h5", "h5py-records.hdf5"],
        format: "hdf5",
        length_unit: "",
        ..TABLE
    },
    Sample {
        files: &["pyarrow-fixed.parquet", "pyarrow-plain.parquet"],
        format: "parquet",
        length_unit: "",
        scalars: &[("temperature", "K", temperature)],
        ..TABLE
    },
    Sample {
        files: &[
            "astropy-tabledata.vot",
            "astropy-binary.vot",
            "astropy-binary2.vot",
            "astropy-vectors-tabledata.vot",
            "astropy-vectors-binary2.vot",
        ],
        format: "votable",
        velocity_unit: Some("km.s**-1"),
        ..TABLE
    },
    Sample {
        files: &["h5py.hdf5"],
        format: "gadget-hdf5",
        time: Some(0.5),
        id: Some(long_id),
        scalars: &[("temperature", "K", temperature), ("mass", "", mass)],
        ..POINTS
    },
    Sample {
        files: &["openpmd.h5"],
        format: "openpmd",
        length_unit: "m",
        time: Some(5.0),
        families: &[("electrons", || (0..ROWS).collect())],
        cells: 0,
        // Those of the file are in units of 2 m, from 10 m on.
        place: |place| place.map(|x| 2.0 * x + 10.0),
        velocity_unit: None,
        id: Some(long_id),
        scalars: &[("temperature", "K", temperature), ("mass", "kg", |_| 2.0)],
    },
    Sample {
        files: &["ase.xyz"],
        format: "xyz",
        length_unit: "Angstrom",
        time: Some(2.5),
        scalars: &[("temperature", "", temperature), ("atomic-number", "", element), ("mass", "u", atomic_weight)],
        ..POINTS
    },
    Sample {
        files: &["ase-plain.xyz"],
        format: "xyz",
        length_unit: "Angstrom",
        velocity_unit: None,
        id: None,
        scalars: &[("atomic-number", "", element), ("mass", "u", atomic_weight)],
        ..POINTS
    },
    Sample {
        files: &["lammps-custom.dump"],
        format: "lammps-dump",
        length_unit: "Angstrom",
        time: Some(0.0),
        // It was sorted so.
        families: &[("dark", || (0..ROWS).rev().collect())],
        cells: 0,
        place: from_corner,
        velocity_unit: Some("Angstrom/fs"),
        id: Some(|row| row + 1),
        scalars: &[
            ("v_temperature", "", temperature),
            ("particle-type", "", |i| 1.0 + i % 2.0),
            ("mass", "u", |i| 1.0 + i % 2.0),
        ],
    },
    Sample {
        files: &["lammps-atom.dump"],
        format: "lammps-dump",
        time: Some(0.0),
        place: from_corner,
        velocity_unit: None,
        id: Some(|row| row + 1),
        scalars: &[("particle-type", "", |i| 1.0 + i % 2.0)],
        ..POINTS
    },
    Sample {
        files: &["pynbody-gadget.dat"],
        format: "gadget",
        time: Some(0.5),
        // The library writes stars as particles of its first type for them.
        families: &[("dark", || (0..16).collect()), ("type2", || (16..ROWS).collect())],
        scalars: &[("mass", "", mass)],
        ..POINTS
    },
    Sample {
        files: &["pynbody-tipsy.dat"],
        format: "tipsy",
        time: Some(0.5),
        families: &[("dark", || (0..16).collect()), ("stars", || (16..ROWS).collect())],
        id: None,
        scalars: &[("mass", "", mass), ("softening", "", |_| 0.25), ("potential", "", |i| -mass(i))],
        ..POINTS
    },
    Sample {
        files: &["sarracen_00010"],
        format: "phantom",
        length_unit: "au",
        time: Some(1.5),
        families: &[
            ("gas", || (0..ROWS).filter(|row| row % 3 != 2).collect()),
            ("dust", || (0..ROWS).filter(|row| row % 3 == 2).collect()),
        ],
        id: Some(long_id),
        scalars: &[
            ("temperature", "", temperature),
            ("mass", "Msun", |i| if i % 3.0 == 2.0 { 0.25 } else { 0.5 }),
            ("smoothing-length", "au", |i| 1.0 + 0.5 * (i % 3.0)),
        ],
        ..POINTS
    },
    Sample {
        files: &["genericio.gio", "genericio-blocks.gio", "genericio-map/snapshot.gio"],
        format: "generic-io",
        id: Some(long_id),
        scalars: &[
            ("temperature", "", temperature),
            ("mass", "", mass),
            ("mask", "", |i| 65535.0 - i),
            ("status", "", |i| -i),
        ],
        ..POINTS
    },
    Sample {
        files: &["tipsy2salsa"],
        format: "nchilada",
        time: Some(0.5),
        families: &[("dark", || (0..16).collect()), ("stars", || (16..ROWS).collect())],
        id: Some(|row| 1000 + row),
        scalars: &[("mass", "", mass), ("soft", "", |_| 0.25), ("pot", "", |i| -mass(i))],
        ..POINTS
    },
    Sample {
        files: &["ramses/periodic/output_00001"],
        format: "ramses",
        length_unit: "kpc",
        time: Some(0.0),
        cells: 71,
        id: Some(|row| row + 1),
        scalars: &[("mass", "Msun", mass), ("levelp", "", |_| 2.0)],
        ..POINTS
    },
    Sample {
        files: &["ramses/expanding/output_00001"],
        format: "ramses",
        length_unit: "a Mpc",
        time: Some(-1.159_808_150_011_42),
        // The box is 1 Mpc.
        place: |place| place.map(|x| x / 32.0),
        velocity_unit: Some("km/s"),
        id: Some(|row| row + 1),
        scalars: &[("levelp", "", |_| 2.0)],
        ..POINTS
    },
];

fn place(i: f64) -> [f64; 3] {
    [i, 2.0 * i % 7.0, 0.5 * i]
}

/// In a box that begins at -0.5 in each direction.
fn from_corner(place: [f64; 3]) -> [f64; 3] {
    place.map(|x| x + 0.5)
}

fn velocity(i: f64) -> [f64; 3] {
    [0.25 * i, -i, 3.0 - i]
}

fn temperature(i: f64) -> f64 {
    10.0 + 1.5 * i
}

fn mass(i: f64) -> f64 {
    1.0 + i % 4.0
}

/// Oxygen and hydrogen in turn.
fn element(i: f64) -> f64 {
    if i % 2.0 == 0.0 { 8.0 } else { 1.0 }
}

fn atomic_weight(i: f64) -> f64 {
    if i % 2.0 == 0.0 { 15.999 } else { 1.008 }
}

fn id(row: u64) -> u64 {
    1000 + 3 * row
}

/// Between those that double precision holds.
fn long_id(row: u64) -> u64 {
    (1 << 60) + 1 + id(row)
}

/// Looks whether a file holds what it should.
fn holds(sample: &Sample, file: &str) {
    let path = data("others").join(file);
    let source = open(&path).unwrap_or_else(|error| panic!("{error}"));
    let about = source.description();
    let found = (&*about.format, &*about.length_unit.0, about.time, about.families.len());
    let families = sample.families.len() + usize::from(sample.cells > 0);
    assert_eq!(found, (sample.format, sample.length_unit, sample.time, families), "{file}");
    for (name, rows) in sample.families {
        let rows = rows();
        let family = about.families.iter().position(|family| family.name.as_str() == *name);
        let family = family.unwrap_or_else(|| panic!("{file}: no {name} in {:?}", about.families));
        let info = &about.families[family];
        assert_eq!(info.count, rows.len() as u64, "{file}: {name}");
        let compare = |field: &str, unit: &str, expected: Vec<f64>| {
            let found = read_all(source.as_ref(), family, field, 7);
            let is_near =
                found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(is_near, "{file}: {field} of {name}: {found:?}, not {expected:?}");
            assert_eq!(info.fields[info.named(field).unwrap()].unit.0, unit, "{file}: {field} of {name}");
        };
        let places = rows.iter().flat_map(|row| (sample.place)(place(*row as f64)));
        compare("position", sample.length_unit, places.collect());
        assert_eq!(info.find(FieldKind::Velocity).is_some(), sample.velocity_unit.is_some(), "{file}: velocities");
        if let Some(unit) = sample.velocity_unit {
            compare("velocity", unit, rows.iter().flat_map(|row| velocity(*row as f64)).collect());
        }
        for (field, unit, value) in sample.scalars {
            compare(field, unit, rows.iter().map(|row| value(*row as f64)).collect());
        }
        let ids = info.find(FieldKind::Id).map(|field| {
            let mut ids = vec![0; rows.len()];
            source.read_ids(family, field, 0..info.count, &mut ids).unwrap();
            ids
        });
        let expected = sample.id.map(|id| rows.iter().map(|row| id(*row)).collect::<Vec<u64>>());
        assert_eq!(ids, expected, "{file}: ids of {name}");
    }
    let particles = load(&path, &LoadOptions::default(), &()).unwrap();
    assert_eq!(particles.len() as u64, ROWS + sample.cells, "{file}");
}

#[test]
fn files_of_other_libraries_hold_what_was_written() {
    for sample in SAMPLES {
        sample.files.iter().for_each(|file| holds(sample, file));
    }
    let files = SAMPLES.iter().flat_map(|sample| sample.files);
    let listed: BTreeSet<Option<&str>> = files.map(|file| file.split('/').next()).collect();
    assert_eq!(std::fs::read_dir(data("others")).unwrap().count(), listed.len());
}

/// Other files, in formats or layouts that those have not.
const MORE: &[&str] = &[
    "../arepo.0.hdf5",
    "../blosc/little.gio",
    "../catalogue.ecsv.zst",
    "../catalogue.fits",
    "../catalogue.vot",
    "../eagle.hdf5",
    "../gizmo.hdf5",
    "../groups.0.hdf5",
    "../hats",
    "../swift.hdf5",
    "../table.parquet",
    "../trajectory.gsd",
];

/// Pictures of page files, seen along z, have all of the mass, about its middle.
#[test]
fn files_of_every_format_are_drawn() {
    const PIXELS: u32 = 64;
    for file in SAMPLES.iter().flat_map(|sample| sample.files).chain(MORE) {
        let built = built_from(&data("others").join(file), &LoadOptions::default(), VqBits::Eight);
        let (view, area) = whole(&built.dataset, PIXELS);
        let picture = draw_pages(&built.file, "column-density", &view, 0.8);
        let (mut mass, mut moment) = (0.0, DVec3::ZERO);
        for family in &built.dataset.families {
            for (at, own) in family.positions.iter().zip(&family.mass) {
                mass += f64::from(*own);
                moment += f64::from(*own) * (DVec3::from(*at) - built.dataset.bounds().center());
            }
        }
        let (mut seen, mut across, mut down) = (0.0, 0.0, 0.0);
        for (index, &p) in (0..PIXELS * PIXELS).zip(&picture.p) {
            let p = f64::from(p);
            seen += p;
            across += p * (f64::from(index % PIXELS) + 0.5);
            down += p * (f64::from(index / PIXELS) + 0.5);
        }
        assert!((seen * area / mass - 1.0).abs() < 0.02, "{file}: {} of the mass {mass}", seen * area);
        let middle = f64::from(PIXELS) / 2.0;
        let expected = [middle + moment.x / mass / area.sqrt(), middle - moment.y / mass / area.sqrt()];
        let found = [across / seen, down / seen];
        let is_near = found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 1.0);
        assert!(is_near, "{file}: the middle is at {found:?}, not {expected:?}");
    }
}
