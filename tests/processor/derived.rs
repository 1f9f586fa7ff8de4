//! Attributes that are derived from velocities, against sums over all pairs in double precision that are written down here once more.

use crate::support::{in_reference_data, in_repository, ok, program, run};
use deepfield::build::{BuildOptions, build_source};
use deepfield::hierarchy::OctreeOptions;
use deepfield::import::{AttributeChoice, LoadOptions, Smoothing, load};
use deepfield::model::{Bounds, DerivedQuantity, Family, FamilyName, Kernel, PeriodicBox};
use deepfield::store::verify;
use glam::{DMat3, DVec3};
use std::path::{Path, PathBuf};

/// What the neighbours of a particle say, from its definition, the nearest images of them in a periodic box; `None` where too many lie
/// within the smoothing length, or all but in a plane.
fn expected(family: &Family, edge: Option<f64>, i: usize) -> Option<[f64; 3]> {
    let column = |name: &str| &family.attribute(name).unwrap().values;
    let components = ["velocity-x", "velocity-y", "velocity-z"].map(column);
    let velocity = |j: usize| DVec3::from_array(components.map(|values| f64::from(values[j])));
    let at = DVec3::from_array(family.positions[i]);
    let h = f64::from(family.smoothing_length[i]).min(edge.map_or(f64::INFINITY, |edge| 0.5 * edge));
    let away = |j: usize| {
        let straight = DVec3::from_array(family.positions[j]) - at;
        edge.map_or(straight, |edge| straight - edge * (straight / edge).round())
    };
    let near: Vec<usize> = (0..family.len()).filter(|&j| away(j).length() < h).collect();
    if near.len() >= 512 {
        return None;
    }
    // The cubic spline and its slope, without the factor that all sums have.
    let spline = |q: f64| if q < 0.5 { 1.0 - 6.0 * q * q + 6.0 * q.powi(3) } else { 2.0 * (1.0 - q).powi(3) };
    let slope = |q: f64| if q < 0.5 { 18.0 * q * q - 12.0 * q } else { -6.0 * (1.0 - q).powi(2) };
    let q = |j: usize| away(j).length() / h;
    let weights: Vec<f64> = near.iter().map(|&j| f64::from(family.mass[j]) * spline(q(j))).collect();
    let total: f64 = weights.iter().sum();
    let mean = near.iter().zip(&weights).map(|(&j, weight)| *weight * velocity(j)).sum::<DVec3>() / total;
    let squares = near.iter().zip(&weights).map(|(&j, weight)| weight * (velocity(j) - mean).length_squared());
    let dispersion = (squares.sum::<f64>() / total).sqrt();
    let (mut change, mut place) = (DMat3::ZERO, DMat3::ZERO);
    for &j in near.iter().filter(|&&j| q(j) > 0.0) {
        let away = away(j);
        let volume = f64::from(family.mass[j]) / f64::from(family.density[j]);
        let gradient = slope(q(j)) / h.powi(4) * volume * away.normalize();
        let outer = |a: DVec3| DMat3::from_cols(a * gradient.x, a * gradient.y, a * gradient.z);
        change += outer(velocity(j) - velocity(i));
        place += outer(away);
    }
    let trace = place.x_axis.x + place.y_axis.y + place.z_axis.z;
    let spread = (place * trace.recip()).determinant();
    // No number where nothing is near.
    if spread.is_nan() || spread < 1e-4 {
        return None;
    }
    let of = change * place.inverse();
    let curl = DVec3::new(of.y_axis.z - of.z_axis.y, of.z_axis.x - of.x_axis.z, of.x_axis.y - of.y_axis.x);
    Some([dispersion, of.x_axis.x + of.y_axis.y + of.z_axis.z, curl.length()])
}

/// Loads a source with what is asked for and the components of velocities.
fn loaded(path: &Path, derive: &[DerivedQuantity], more: &[&str]) -> deepfield::model::Dataset {
    let names = ["velocity-x", "velocity-y", "velocity-z"].iter().chain(more).map(|name| (*name).to_owned());
    let attributes = AttributeChoice::Named(names.collect());
    load(path, &LoadOptions { attributes, derive: derive.to_vec(), ..LoadOptions::default() }, &()).unwrap()
}

const OF_NEIGHBOURS: [DerivedQuantity; 3] =
    [DerivedQuantity::VelocityDispersion, DerivedQuantity::Divergence, DerivedQuantity::Vorticity];

/// Compares every `step`th particle of each family; how many were compared.
fn compare(path: &Path, step: usize) -> usize {
    let data = loaded(path, &OF_NEIGHBOURS, &["speed"]);
    assert_eq!(data.kernel, Kernel::CubicSpline);
    let mut compared = 0;
    for family in &data.families {
        let own = OF_NEIGHBOURS.map(|quantity| &family.attribute(quantity.name()).unwrap().values);
        let periodic = PeriodicBox::of(data.provenance.box_size, Bounds::of(family.positions.iter().copied()));
        for i in (0..family.len()).step_by(step) {
            let Some(expected) = expected(family, periodic.map(|periodic| periodic.edge), i) else { continue };
            let [dispersion, divergence, vorticity] = own.map(|values| f64::from(values[i]));
            let name = format!("{} {} {i}", path.display(), family.name);
            // What moves as one has nothing but rounding.
            let speed = f64::from(family.attribute("speed").unwrap().values[i]);
            let around = expected[0] + 1e-6 * speed;
            assert!((dispersion - expected[0]).abs() <= 1e-6 * around, "{name}: {dispersion} {expected:?}");
            let scale = expected[1].abs() + expected[2] + around / f64::from(family.smoothing_length[i]);
            assert!((divergence - expected[1]).abs() <= 1e-6 * scale, "{name}: {divergence} {expected:?}");
            assert!((vorticity - expected[2]).abs() <= 1e-6 * scale, "{name}: {vorticity} {expected:?}");
            compared += 1;
        }
    }
    compared
}

fn gas_sphere() -> PathBuf {
    in_repository("tests/data/gas_sphere_collapse_025.hdf5")
}

#[test]
fn derived_attributes_agree_with_sums_over_all_pairs() {
    assert!(compare(&gas_sphere(), 3) > 400);
    assert!(compare(&in_repository("tests/data/emitter_000.hdf5"), 7) > 20);
}

#[test]
fn derived_attributes_agree_with_sums_over_all_pairs_across_periodic_faces() {
    let folder = tempfile::tempdir().unwrap();
    let path = snapshot(folder.path(), 3000);
    assert!(load(&path, &LoadOptions::default(), &()).unwrap().periodic_box().is_some());
    assert!(compare(&path, 5) > 300);
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn derived_attributes_agree_with_sums_over_all_pairs_of_the_reference_data() {
    for (name, step) in [
        ("particles/fire_galaxy_a.hdf5", 701),
        ("particles/lcdm64_z0.hdf5", 997),
        ("particles/adiabtophat_glass_28721.tipsy", 97),
        ("particles/run581.20000.tipsy", 31),
        ("sequences/star_merger/snapshot_010.hdf5", 31),
        ("sequences/dam_break/snapshot_020.hdf5", 31),
    ] {
        let compared = compare(&in_reference_data(name), step);
        println!("{name}: {compared} particles");
        assert!(compared > 100, "{name}: {compared}");
    }
}

#[test]
fn mach_numbers_come_from_internal_energy_or_temperature() {
    let data = loaded(&gas_sphere(), &[DerivedQuantity::MachNumber], &["speed", "internal-energy"]);
    let gas = &data.families[0];
    let [mach, speed, energy] =
        ["mach-number", "speed", "internal-energy"].map(|name| &gas.attribute(name).unwrap().values);
    for i in 0..gas.len() {
        let sound = (5.0 / 3.0 * (2.0 / 3.0) * f64::from(energy[i])).sqrt();
        let expected = f64::from(speed[i]) / sound;
        assert!((f64::from(mach[i]) - expected).abs() <= 1e-6 * expected, "{i}: {} {expected}", mach[i]);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hot.csv");
    let header = "x [kpc],y [kpc],z [kpc],vx [km/s],vy [km/s],vz [km/s],temp [K]\n";
    std::fs::write(&path, format!("{header}0,0,0,0,30,40,1e4\n1,0,0,1,0,0,-1\n")).unwrap();
    let hot = loaded(&path, &[DerivedQuantity::MachNumber], &[]);
    let mach = &hot.families[0].attribute("mach-number").unwrap().values;
    // 5/3 k T by 0.59 proton masses.
    let square: f64 = 5.0 / 3.0 * 1.380_649e-23 * 1e4 / (0.59 * 1.672_621_9e-27);
    let sound = square.sqrt() / 1e3;
    assert!((f64::from(mach[0]) * sound / 50.0 - 1.0).abs() < 1e-6 && mach[1].is_nan(), "{mach:?} {sound}");
    assert!(hot.provenance.notes.iter().any(|note| note.contains("mean molecular weight 0.59")));
}

#[test]
fn rates_have_the_unit_of_velocities_by_lengths() {
    let data = loaded(&in_repository("tests/data/eagle.hdf5"), &OF_NEIGHBOURS, &[]);
    let family = &data.families[0];
    let unit = |quantity: DerivedQuantity| family.attribute(quantity.name()).unwrap().unit.to_string();
    assert_eq!(OF_NEIGHBOURS.map(unit), ["a^0.5 km/s", "(a^0.5 km/s)/(a Mpc/h)", "(a^0.5 km/s)/(a Mpc/h)"]);
}

/// A snapshot of so many particles, written by the program.
fn snapshot(folder: &Path, particles: usize) -> PathBuf {
    let path = folder.join("snapshot");
    let mut command = program();
    let output = command.args(["synth", "clusters", "-n", &particles.to_string(), "-o"]).arg(&path).output().unwrap();
    assert!(output.status.success());
    path
}

/// What a build finds bucket by bucket is what a search among all particles of the periodic box finds, in the same bytes for any memory and
/// threads.
#[test]
fn derived_attributes_do_not_depend_on_buckets() {
    let folder = tempfile::tempdir().unwrap();
    let source = snapshot(folder.path(), 30_000);
    let out = folder.path().join("out.df");
    for (smoothing, bucket_particles) in [(Smoothing::Auto, 700), (Smoothing::Knn(40), 150)] {
        let derive = DerivedQuantity::ALL.to_vec();
        let load_options = LoadOptions { smoothing, derive, ..LoadOptions::default() };
        let whole = load(&source, &load_options, &()).unwrap();
        let octree = OctreeOptions { bucket_particles: Some(bucket_particles), ..OctreeOptions::default() };
        let options = BuildOptions { octree, ..BuildOptions::default() };
        let built = build_source(&source, &load_options, &options, &out, &()).unwrap();
        verify(&out, &()).unwrap();
        let bytes = std::fs::read(&out).unwrap();
        for (threads, memory) in [(1, 1 << 30), (2, 1 << 30), (3, 12 << 20), (1, 6 << 20)] {
            let options = BuildOptions { threads: Some(threads), memory: Some(memory), ..options.clone() };
            build_source(&source, &load_options, &options, &out, &()).unwrap();
            assert!(std::fs::read(&out).unwrap() == bytes, "{threads} threads, {memory} bytes of memory");
        }
        for (quantity, info) in DerivedQuantity::ALL.into_iter().zip(&built.metadata.families[0].attributes) {
            assert_eq!(info.name, quantity.name());
            let attribute = whole.families[0].attribute(quantity.name()).unwrap();
            assert_eq!(info.unit, attribute.unit);
            let values: Vec<f64> =
                attribute.values.iter().map(|&value| f64::from(value)).filter(|value| !value.is_nan()).collect();
            let min = values.iter().copied().fold(f64::INFINITY, f64::min);
            let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            for (found, expected) in [(info.min, min), (info.max, max), (info.mean, mean)] {
                assert!(
                    (found - expected).abs() < 1e-5 * max.abs().max(min.abs()),
                    "{}: {found} {expected}",
                    info.name
                );
            }
            assert_eq!(info.missing as usize, attribute.values.len() - values.len());
            assert_eq!(info.histogram.counts.iter().sum::<u64>() as usize, values.len());
        }
        assert_eq!(built.metadata.provenance.notes, whole.provenance.notes);
    }
}

#[test]
fn what_cannot_be_derived_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let said = |arguments: &[&str]| {
        let output = run(folder.path(), &[&["build", "-o", "out.df"][..], arguments].concat());
        assert!(!output.status.success(), "{arguments:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    std::fs::write(folder.path().join("still.csv"), "x,y,z\n0,0,0\n1,0,0\n").unwrap();
    let text = said(&["still.csv", "--derive", "vorticity"]);
    assert!(
        text.contains("still.csv: velocity: missing, expected velocities, as vorticity is to be derived"),
        "{text}"
    );
    std::fs::write(folder.path().join("cold.csv"), "x,y,z,vx,vy,vz\n0,0,0,1,2,3\n1,0,0,4,5,6\n").unwrap();
    let text = said(&["cold.csv", "--derive", "mach-number,vorticity"]);
    assert!(text.contains("cold.csv: internal-energy: missing, expected internal-energy or temperature"), "{text}");
    let text = said(&["cold.csv", "--derive", "speed"]);
    assert!(text.contains("velocity-dispersion, divergence, vorticity, mach-number"), "{text}");
    std::fs::write(folder.path().join("bare.csv"), "x,y,z,vx,vy,vz,temp\n0,0,0,1,2,3,5\n1,0,0,4,5,6,5\n").unwrap();
    let text = said(&["bare.csv", "--derive", "mach-number"]);
    assert!(text.contains("unit of velocity: found code units, expected cm/s, m/s or km/s"), "{text}");
    // Of all what can be had.
    for (name, why) in [("cold.csv", "no mach-number: expected internal-energy"), ("bare.csv", "unit of velocity")] {
        let output = run(folder.path(), &["build", "-o", "all.df", name, "--derive", "all"]);
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(run(folder.path(), &["info", "all.df"]).stdout).unwrap();
        assert!(text.contains("vorticity") && text.contains("no mach-number") && text.contains(why), "{name}: {text}");
    }
    let text = said(&["still.csv", "--derive", "all"]);
    assert!(text.contains("still.csv: velocity: missing"), "{text}");
    let text = said(&["cold.csv", "still.csv", "--times", "0:1", "--derive", "vorticity"]);
    assert!(text.contains("still.csv: velocity: missing, expected velocities"), "{text}");
}

#[test]
fn derived_attributes_come_first_and_have_five_places() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.df");
    let names = |load_options: LoadOptions, attributes: Option<&[&str]>| {
        let attributes = attributes.map(|names| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        let load_options = LoadOptions {
            attributes: attributes.clone().map_or(AttributeChoice::Usual, AttributeChoice::Named),
            families: vec![FamilyName::Gas],
            ..load_options
        };
        let options = BuildOptions { attributes, ..BuildOptions::default() };
        let built =
            build_source(&gas_sphere(), &load_options, &options, &out, &()).map_err(|error| error.to_string())?;
        let attributes = &built.metadata.families[0].attributes;
        Ok::<_, String>(attributes.iter().map(|info| info.name.clone()).collect::<Vec<_>>().join(" "))
    };
    let all = || LoadOptions { derive: DerivedQuantity::ALL.to_vec(), ..LoadOptions::default() };
    let derived = "velocity-dispersion divergence vorticity mach-number";
    assert_eq!(names(all(), None).unwrap(), derived);
    let one = LoadOptions { derive: vec![DerivedQuantity::Vorticity], ..LoadOptions::default() };
    assert_eq!(names(one, None).unwrap(), "vorticity internal-energy");
    // A derived one may be named among those that are kept.
    let kept = names(all(), Some(&["internal-energy", "vorticity"])).unwrap();
    assert_eq!(kept, format!("{derived} internal-energy"));
    let text = names(all(), Some(&["internal-energy", "speed"])).unwrap_err();
    assert!(text.contains("6 attributes of gas, 4 of them derived; at most 5"), "{text}");
}

/// A snapshot that is opened with `--derive` is what it would be if it were built with it.
#[test]
fn what_is_derived_unbuilt_is_what_a_build_derives() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::copy(gas_sphere(), folder.join("gas.hdf5")).unwrap();
    let succeed = |arguments: &[&str]| ok(folder, arguments).stdout;
    let picture = |more: &[&str]| {
        let own = ["--attribute", "vorticity", "--backend", "cpu", "--size", "64x48", "-o", "picture.png"];
        succeed(&[&["render"][..], more, &own].concat());
        std::fs::read(folder.join("picture.png")).unwrap()
    };
    succeed(&["build", "gas.hdf5", "--derive", "vorticity,divergence", "-o", "built.df"]);
    let expected = picture(&["built.df"]);
    assert!(picture(&["gas.hdf5", "--derive", "vorticity,divergence"]) == expected);
    assert!(picture(&["built.df", "--derive", "vorticity"]) == expected, "it is there");
    let scene = "(version: 1, datasets: [(path: \"gas.hdf5\", derive: [\"vorticity\", \"divergence\"])])";
    std::fs::write(folder.join("gas.scene.ron"), scene).unwrap();
    assert!(picture(&["gas.scene.ron"]) == expected);

    let weights = |more: &[&str]| {
        let own = ["--histogram", "vorticity", "--bins", "7", "--json", "-"];
        let answer: serde_json::Value =
            serde_json::from_slice(&succeed(&[&["plot"][..], more, &own].concat())).unwrap();
        answer["weights"].clone()
    };
    let found = weights(&["gas.hdf5", "--derive", "vorticity,divergence"]);
    assert!(found.as_array().is_some_and(|bins| bins.len() == 7) && found == weights(&["built.df"]));

    let refused = |arguments: &[&str]| {
        let output = run(folder, arguments);
        assert!(!output.status.success(), "{arguments:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let text = refused(&["render", "built.df", "--derive", "mach-number", "-o", "x.png"]);
    assert!(text.contains("built.df: --derive: found a page file of particles without mach-number"), "{text}");
    let text = refused(&["probe", "built.df", "--exact", "--derive", "vorticity"]);
    assert!(text.contains("built.df: --derive: --exact asks the source itself"), "{text}");
    let text = refused(&["select", "gas.hdf5", "--derive", "vorticity", "-o", "x.ids"]);
    assert!(text.contains("gas.hdf5: --derive: a selection of ids asks the source itself"), "{text}");
}
