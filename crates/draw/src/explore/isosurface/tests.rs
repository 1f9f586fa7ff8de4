use super::*;
use crate::cpu::mesh::Field;
use crate::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use crate::store::InMemory;
use glam::DVec3;
use std::convert::Infallible;
use std::f64::consts::PI;

/// Particles at places with smoothing lengths, each of mass 1, with its number as an attribute.
fn tree(particles: &[(DVec3, f32)]) -> InMemory {
    let smoothing_length: Vec<f32> = particles.iter().map(|(_, length)| *length).collect();
    let family = Family {
        name: FamilyName::Gas,
        positions: particles.iter().map(|(at, _)| at.to_array()).collect(),
        mass: vec![1.0; particles.len()],
        density: smoothing_length.iter().map(|length| 2.5 / length.powi(3)).collect(),
        smoothing_length,
        attributes: vec![Attribute {
            name: "number".into(),
            unit: Unit::default(),
            values: (0..particles.len()).map(|number| number as f32).collect(),
        }],
    };
    InMemory::new(Dataset {
        families: vec![family],
        length_unit: Unit::new("kpc"),
        mass_unit: Unit::new("Msun"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    })
}

/// Places and smoothing lengths that differ thirtyfold, the same in every run.
fn cloud(count: usize) -> Vec<(DVec3, f32)> {
    let mut state = 7_u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..count)
        .map(|_| {
            let at = DVec3::new(next(), next(), next()) * 2.0 - 1.0;
            (at * at.length(), (0.04 + 1.2 * next().powi(6)) as f32)
        })
        .collect()
}

fn options(isovalue: f64, spacing: f64) -> IsosurfaceOptions {
    let spacing = Some(spacing);
    IsosurfaceOptions { isovalue, spacing, most_cells: 1 << 30, memory: 1 << 20, attribute: None }
}

fn written(tree: &InMemory, options: &IsosurfaceOptions, side: usize) -> Result<Isosurface, ExploreError> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("surface.ply");
    let found =
        isosurface_in_bricks(tree, (&Region::whole(), None), options, (MeshFormat::Ply, &out), side, Work::quiet());
    match &found {
        Ok(found) => assert_eq!(found.bytes, std::fs::metadata(&out).unwrap().len()),
        Err(_) => assert!(!out.exists()),
    }
    // Nothing else is left.
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), usize::from(found.is_ok()));
    found
}

/// The density as a sum over all particles, everywhere.
struct Brute<'a> {
    particles: &'a [(DVec3, f32)],
    lattice: Lattice,
}

impl Field for Brute<'_> {
    type Error = Infallible;

    fn sample(&self, corner: [u32; 3], samples: &mut Samples) -> Result<(), Infallible> {
        let row = samples.row();
        for index in 0..row * row * row {
            let place = [index % row, index / row % row, index / row / row];
            let at =
                [0, 1, 2].map(|axis| self.lattice.coordinate(axis, i64::from(corner[axis]) + place[axis] as i64 - 1));
            let at = DVec3::from_array(at);
            let of = |(position, length): &(DVec3, f32)| {
                let length = f64::from(*length);
                Kernel::CubicSpline.value(at.distance(*position) / length) / length.powi(3)
            };
            samples.values[index] = self.particles.iter().map(of).sum();
        }
        samples.active.fill(true);
        Ok(())
    }
}

#[test]
fn a_particle_is_a_ball() {
    let (center, length, radius) = (DVec3::new(3.1, -2.2, 7.3), 0.5_f32, 0.31);
    let isovalue = Kernel::CubicSpline.value(radius / 0.5) / 0.125;
    let found = written(&tree(&[(center, length)]), &options(isovalue, 0.0125), BRICK).unwrap();
    let (volume, area) = (4.0 / 3.0 * PI * radius.powi(3), 4.0 * PI * radius * radius);
    assert!((found.mesh.volume / volume - 1.0).abs() < 1e-3, "{found:?} {volume}");
    assert!((found.mesh.area / area - 1.0).abs() < 1e-2, "{found:?} {area}");
    assert_eq!((found.mesh.components, found.mesh.boundary_edges, found.particles), (1, 0, 1));
    assert_eq!(2 * found.mesh.vertices, found.mesh.triangles + 4);
}

#[test]
fn nothing_of_the_surface_is_left_out() {
    let particles = cloud(200);
    let (spacing, isovalue) = (0.05, 120.0);
    let reaches = particles.iter().flat_map(|(at, length)| {
        let reach = DVec3::splat((*length).into());
        [(*at - reach).to_array(), (*at + reach).to_array()]
    });
    let lattice = Lattice::around(Bounds::of(reaches), spacing).unwrap();
    let brute = Brute { particles: &particles, lattice };
    let Ok(expected) = extract(&lattice, (32, &lattice.bricks(32)), isovalue, &brute, &(), |_| Ok(()));
    assert!(expected.components > 1 && expected.boundary_edges == 0, "{expected:?}");
    let tree = tree(&particles);
    for side in [8, 32, 64] {
        let found = written(&tree, &options(isovalue, spacing), side).unwrap();
        let counts = |of: &MeshReport| [of.vertices, of.triangles, of.components, of.boundary_edges];
        assert_eq!(counts(&found.mesh), counts(&expected), "{side}");
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
        assert!(close(found.mesh.volume, expected.volume), "{found:?} {expected:?}");
        assert!(close(found.mesh.area, expected.area), "{found:?} {expected:?}");
        // Most of the lattice is never looked into in small bricks.
        let all = lattice.cells.map(u64::from).iter().product::<u64>();
        assert!(side > 8 || found.cells < all / 2, "{} of {all}", found.cells);
    }
}

#[test]
fn the_spacing_is_that_of_the_data_where_cells_are_enough() {
    let particles: Vec<(DVec3, f32)> =
        (0..64).map(|i| (DVec3::from_array([i % 4, i / 4 % 4, i / 16].map(f64::from)), 1.0)).collect();
    let tree = tree(&particles);
    let any = IsosurfaceOptions { spacing: None, ..options(0.5, 1.0) };
    let found = written(&tree, &any, 8).unwrap();
    assert!((found.spacing - 0.5).abs() < 0.02 && found.finer_spacing.is_none(), "{found:?}");
    assert_eq!(found.mesh.boundary_edges, 0);
    let few = written(&tree, &IsosurfaceOptions { most_cells: 512, ..any }, 8).unwrap();
    assert!(few.spacing > found.spacing && few.finer_spacing == Some(found.spacing) && few.cells <= 512, "{few:?}");
}

#[test]
fn what_cannot_be_is_told() {
    let tree = tree(&cloud(50));
    let error = |options: &IsosurfaceOptions| written(&tree, options, 8).unwrap_err().to_string();
    let high = error(&options(1e9, 0.05));
    assert!(high.contains("--isovalue") && high.contains("largest density") && !high.contains('\n'), "{high}");
    let many = error(&IsosurfaceOptions { most_cells: 512, ..options(50.0, 0.01) });
    assert!(many.contains("--spacing") && many.contains("512"), "{many}");
    let unknown = error(&IsosurfaceOptions { attribute: Some("heat".into()), ..options(50.0, 0.05) });
    assert!(unknown.contains("heat") && unknown.contains("number"), "{unknown}");
}
