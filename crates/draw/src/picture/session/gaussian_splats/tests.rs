#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::build::{BuildOptions, build};
use crate::color::transfer::TransferFunction;
use crate::hierarchy::{ClusterOptions, Kinds, OctreeOptions};
use crate::look::LookPatch;
use crate::mode::SettingValue;
use crate::mode::levels::{LEVELS, SPLATS};
use crate::model::{Attribute, Dataset, Family, FamilyName, Provenance, Unit};
use crate::modes::column_density;
use crate::store::PageFile;
use crate::synth::random::Random;
use glam::{DMat3, DQuat};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// The top of the range in these files, the opacity there, and so the optical depth of a column of 1.
const TOP: f64 = 2e4;
const OPACITY: f64 = 0.9;

/// Particles along filaments, far from 0.
fn dataset(count: usize) -> Dataset {
    let mut random = Random::new(3, 1);
    let mut family = Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: vec![Attribute { name: "temperature".into(), unit: Unit::new("K"), values: Vec::new() }],
    };
    for i in 0..count {
        let [a, b, c, d] = std::array::from_fn(|_| random.uniform());
        let place = match i % 3 {
            0 => [a, 0.3 + 0.02 * b, 0.2 + 0.02 * c],
            1 => [0.7 + 0.01 * b, a, a],
            _ => [a, b, c],
        };
        family.positions.push([100.0 + place[0], place[1], place[2] - 5.0]);
        family.mass.push((1.0 + d) as f32);
        family.smoothing_length.push((0.05 + 0.03 * d) as f32);
        family.density.push((1e3 * (1.0 + d)) as f32);
        family.attributes[0].values.push((1e4 * 10f64.powf(a)) as f32);
    }
    Dataset {
        families: vec![family],
        length_unit: Unit::new("kpc"),
        mass_unit: Unit::new("Msun"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    }
}

fn page_file(folder: &Path, dataset: Dataset, pca: bool) -> PathBuf {
    let path = folder.join(if pca { "clusters.df" } else { "octree.df" });
    let octree =
        OctreeOptions { leaf_capacity: 600, vq_bits: crate::codec::VqBits::Sixteen, ..OctreeOptions::default() };
    let options = BuildOptions {
        hierarchies: if pca { Kinds::of_particles() } else { Kinds::default() },
        clusters: ClusterOptions { shape_bits: 16, ..ClusterOptions::default() },
        octree,
        ..BuildOptions::default()
    };
    build(dataset, &options, &path, &()).unwrap();
    path
}

fn shot(levels: &str, splats: Option<f64>, range: &str) -> Shot {
    let text = format!("(range: {range}, opacity: [(0.0, 0.0), (1.0, {OPACITY})])");
    let mut look = LookPatch {
        mode: Some(&column_density::MODE),
        transfer: Some(TransferFunction::parse(&text, "t").unwrap()),
        ..LookPatch::default()
    };
    look.budget.set(&LEVELS, SettingValue::Name(levels.into()));
    if let Some(splats) = splats {
        look.budget.set(&SPLATS, SettingValue::Number(splats));
    }
    Shot { look, size: Some((64, 64)), ..Shot::default() }
}

/// A file as any reader of PLY sees it.
struct Ply {
    header: Vec<String>,
    columns: HashMap<String, Vec<f64>>,
    count: usize,
}

impl Ply {
    fn read(path: &Path) -> Ply {
        let bytes = std::fs::read(path).unwrap();
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
        let header: Vec<String> = std::str::from_utf8(&bytes[..start]).unwrap().lines().map(str::to_owned).collect();
        assert_eq!(header[..2], ["ply", "format binary_little_endian 1.0"]);
        let count: usize =
            header.iter().find_map(|line| line.strip_prefix("element vertex ")).unwrap().parse().unwrap();
        let names: Vec<&str> = header.iter().filter_map(|line| line.strip_prefix("property float ")).collect();
        assert_eq!(bytes.len() - start, count * names.len() * 4);
        let mut columns: HashMap<String, Vec<f64>> = HashMap::new();
        for (index, value) in bytes[start..].chunks(4).enumerate() {
            let value = f32::from_le_bytes(value.try_into().unwrap());
            assert!(value.is_finite());
            columns.entry(names[index % names.len()].to_owned()).or_default().push(f64::from(value));
        }
        Ply { columns, count, header }
    }

    fn vector(&self, names: [&str; 3], i: usize) -> DVec3 {
        DVec3::from_array(names.map(|name| self.columns[name][i]))
    }

    fn origin(&self) -> DVec3 {
        let line = self.header.iter().find_map(|line| line.strip_prefix("comment origin: ")).unwrap();
        let numbers: Vec<f64> = line.split(',').next().unwrap().split(' ').map(|n| n.parse().unwrap()).collect();
        DVec3::from_slice(&numbers)
    }

    fn covariance(&self, i: usize) -> DMat3 {
        let [w, x, y, z] = ["rot_0", "rot_1", "rot_2", "rot_3"].map(|name| self.columns[name][i]);
        let turn = DQuat::from_xyzw(x, y, z, w);
        assert!((turn.length() - 1.0).abs() < 1e-6);
        let scales = self.vector(["scale_0", "scale_1", "scale_2"], i).exp();
        let axes = DMat3::from_quat(turn);
        axes * DMat3::from_diagonal(scales * scales) * axes.transpose()
    }

    /// The weight that an opacity stands for.
    fn weight(&self, i: usize) -> f64 {
        let opacity = 1.0 / (1.0 + (-self.columns["opacity"][i]).exp());
        let mean = self.vector(["scale_0", "scale_1", "scale_2"], i).to_array().iter().sum::<f64>() / 3.0;
        let depth = -(1.0 - OPACITY).ln() / TOP;
        -(1.0 - opacity).ln() / depth * TAU * (2.0 * mean).exp()
    }

    fn moments(&self) -> (f64, DVec3, DMat3) {
        moments(
            (0..self.count)
                .map(|i| (self.origin() + self.vector(["x", "y", "z"], i), self.weight(i), self.covariance(i))),
        )
    }
}

/// Sum of weights, centre and second moments about it.
fn moments(splats: impl Iterator<Item = (DVec3, f64, DMat3)> + Clone) -> (f64, DVec3, DMat3) {
    let sum: f64 = splats.clone().map(|(_, weight, _)| weight).sum();
    let centre = splats.clone().map(|(at, weight, _)| weight * at).sum::<DVec3>() / sum;
    let one = |(at, weight, own): (DVec3, f64, DMat3)| {
        let d = at - centre;
        (DMat3::from_cols(d * d.x, d * d.y, d * d.z) + own) * (weight / sum)
    };
    (sum, centre, splats.map(one).fold(DMat3::ZERO, |sum, own| sum + own))
}

#[test]
fn the_file_has_the_sums_of_the_particles() {
    let folder = tempfile::tempdir().unwrap();
    let own = dataset(4_000);
    let family = own.families[0].clone();
    let variance = Kernel::CubicSpline.variance();
    let particles = (0..family.mass.len()).map(|i| {
        let h = f64::from(family.smoothing_length[i]);
        let round = DMat3::from_diagonal(DVec3::splat(variance * h * h));
        (DVec3::from_array(family.positions[i]), f64::from(family.mass[i]), round)
    });
    let (mass, centre, spread) = moments(particles);
    let path = page_file(folder.path(), own, true);
    let file = Arc::new(PageFile::open(&path).unwrap());
    let finest = file.metadata().families[0].clusters.as_ref().unwrap().finest();
    let range = format!("fixed({}, {TOP})", 1e-4 * TOP);
    let mut session = Session::of(file, u64::MAX);
    let out = folder.path().join("a.ply");
    for (levels, splats) in [("clusters", None), ("clusters", Some(500.0)), ("splats", None), ("clusters", Some(1e6))] {
        let count = session.export_gaussian_splats(&shot(levels, splats, &range), &out).unwrap();
        let ply = Ply::read(&out);
        assert_eq!(ply.count as u64, count);
        match (levels, splats) {
            ("splats", _) | (_, Some(1e6)) => assert_eq!(count, 4_000),
            (_, Some(_)) => assert!((100..=500).contains(&count), "{count}"),
            // Small leaves have no clusters, and their particles are written.
            _ => assert!(count >= finest && count < 3_500, "{count} {finest}"),
        }
        let (found_mass, found_centre, found_spread) = ply.moments();
        assert!((found_mass / mass - 1.0).abs() < 1e-3, "{levels} {splats:?}: {found_mass} {mass}");
        assert!((found_centre - centre).length() < 1e-4, "{levels} {splats:?}: {found_centre} {centre}");
        assert!(found_spread.abs_diff_eq(spread, 5e-3 * spread.x_axis.x), "{found_spread} {spread}");
        for i in 0..ply.count {
            let colors = ["f_dc_0", "f_dc_1", "f_dc_2"].map(|name| 0.5 + 0.28209479177387814 * ply.columns[name][i]);
            assert!(colors.iter().all(|c| (-1e-6..=1.0 + 1e-6).contains(c)));
            if levels == "splats" {
                assert_eq!(ply.columns["scale_0"][i], ply.columns["scale_2"][i]);
            }
        }
        // No more and no less than once, and the same bytes again.
        let bytes = std::fs::read(&out).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| session.export_gaussian_splats(&shot(levels, splats, &range), &out)).unwrap();
        assert!(bytes == std::fs::read(&out).unwrap());
    }
    // Ranges that are found from a picture.
    session.export_gaussian_splats(&shot("clusters", None, "auto"), &out).unwrap();
    assert!(Ply::read(&out).columns["opacity"].iter().any(|logit| *logit > -5.0));
}

#[test]
fn what_is_not_there_is_said_and_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = page_file(folder.path(), dataset(500), false);
    let mut session = Session::of(Arc::new(PageFile::open(&path).unwrap()), u64::MAX);
    let out = folder.path().join("a.ply");
    std::fs::write(&out, "old").unwrap();
    let why = session.export_gaussian_splats(&shot("clusters", None, "auto"), &out).unwrap_err().to_string();
    assert!(why.ends_with("octree.df: clusters: not in this file, expected one built with --hierarchy pca"), "{why}");
    let mut volume = shot("auto", None, "auto");
    volume.look.mode = crate::modes::find("volume");
    let why = session.export_gaussian_splats(&volume, &out).unwrap_err().to_string();
    assert!(why.contains("the mode volume has no splats with an extent in space"), "{why}");
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    // Particles alone are there.
    assert_eq!(session.export_gaussian_splats(&shot("splats", None, "auto"), &out).unwrap(), 500);
}
