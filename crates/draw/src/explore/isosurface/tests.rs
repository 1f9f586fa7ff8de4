use super::*;
use crate::cpu::mesh::{Field, Vertex, extract};
use crate::cpu::volume::attributes::LEAST_FILLED;
use crate::model::{
    Attribute, Channel, Dataset, Family, FamilyName, Grid, Kernel, Provenance, Region as GridRegion, SampleType, Unit,
};
use crate::store::InMemory;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashSet;
use std::convert::Infallible;
use std::f64::consts::PI;

/// Particles at places with smoothing lengths, each of mass 1, with its number as an attribute.
fn tree(particles: &[(DVec3, f32)]) -> InMemory {
    let smoothing_length: Vec<f32> = particles.iter().map(|(_, length)| *length).collect();
    tree_of(Family {
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
    })
}

/// Particles of density 1 on a regular lattice, of those within, with a function of the place as `value`.
fn regular(
    step: f64,
    is_within: impl Fn(DVec3) -> bool,
    smoothing_length: f32,
    value: impl Fn(DVec3) -> f64,
) -> InMemory {
    let side = (2.0 / step) as i32;
    let along = move || (-side..=side).map(move |index| step * f64::from(index));
    let all = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| DVec3::new(x, y, z))));
    let places: Vec<DVec3> = all.filter(|at| is_within(*at)).collect();
    let values = places.iter().map(|at| value(*at) as f32).collect();
    tree_of(Family {
        name: FamilyName::Gas,
        positions: places.iter().map(|at| at.to_array()).collect(),
        mass: vec![step.powi(3) as f32; places.len()],
        density: vec![1.0; places.len()],
        smoothing_length: vec![smoothing_length; places.len()],
        attributes: vec![Attribute { name: "value".into(), unit: Unit::default(), values }],
    })
}

fn tree_of(family: Family) -> InMemory {
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
    let (most_cells, memory) = (1 << 30, 1 << 20);
    let (field, attribute) = (None, None);
    IsosurfaceOptions { isovalue, field, spacing, most_cells, memory, attribute, is_open: false, smooth: 0 }
}

fn written(tree: &InMemory, options: &IsosurfaceOptions, side: usize) -> Result<Isosurface, ExploreError> {
    written_in(tree, None, options, side)
}

/// The same in a periodic box of that edge.
fn written_in(
    tree: &InMemory,
    periodic: Option<f64>,
    options: &IsosurfaceOptions,
    side: usize,
) -> Result<Isosurface, ExploreError> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("surface.ply");
    let found =
        isosurface_in_bricks(tree, (&Region::whole(), periodic), options, (MeshFormat::Ply, &out), side, Work::quiet());
    match &found {
        Ok(found) => assert_eq!(found.bytes, std::fs::metadata(&out).unwrap().len()),
        Err(_) => assert!(!out.exists()),
    }
    // Nothing else is left.
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), usize::from(found.is_ok()));
    found
}

/// The density as a sum over all particles, everywhere, or the mean of their numbers.
struct Brute<'a> {
    particles: &'a [(DVec3, f32)],
    lattice: Lattice,
    faces: Faces,
    is_mean: bool,
}

impl Field for Brute<'_> {
    type Error = Infallible;

    fn faces(&self) -> Faces {
        self.faces
    }

    fn least_filled(&self) -> Option<f64> {
        self.is_mean.then_some(LEAST_FILLED.into())
    }

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
            if !self.is_mean {
                samples.values[index] = self.particles.iter().map(of).sum();
                continue;
            }
            let (mut filled, mut sum) = (0.0, 0.0);
            for (number, particle) in self.particles.iter().enumerate() {
                // Densities are in single precision.
                let share = of(particle) / f64::from(2.5 / particle.1.powi(3));
                filled += share;
                sum += number as f64 * share;
            }
            (samples.values[index], samples.filled[index]) = (sum / filled, filled);
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
    assert_eq!((found.mesh.components, found.mesh.boundary_edges, found.particles), (1, 0, Some(1)));
    assert_eq!(2 * found.mesh.vertices, found.mesh.triangles + 4);
}

#[test]
fn nothing_of_the_surface_is_left_out() {
    nothing_is_left_out(false, 120.0, 0.05);
}

#[test]
fn nothing_of_a_mean_is_left_out() {
    nothing_is_left_out(true, 100.5, 0.1);
}

fn nothing_is_left_out(is_mean: bool, isovalue: f64, spacing: f64) {
    let particles = cloud(200);
    let reaches = particles.iter().flat_map(|(at, length)| {
        let reach = DVec3::splat((*length).into());
        [(*at - reach).to_array(), (*at + reach).to_array()]
    });
    let lattice = Lattice::around(Bounds::of(reaches), spacing).unwrap();
    let brute = Brute { particles: &particles, lattice, faces: Faces::Open, is_mean };
    let Ok(expected) = extract(&lattice, (32, &lattice.bricks(32)), isovalue, &brute, &(), |_| Ok(()));
    assert!(expected.components > 1 && expected.boundary_edges == 0, "{expected:?}");
    let tree = tree(&particles);
    let field = is_mean.then(|| "number".to_owned());
    let options = IsosurfaceOptions { field, ..options(isovalue, spacing) };
    for side in [8, 32, 64] {
        let found = written(&tree, &options, side).unwrap();
        let counts = |of: &MeshReport| [of.vertices, of.triangles, of.components, of.boundary_edges];
        assert_eq!(counts(&found.mesh), counts(&expected), "{side}");
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
        assert!(close(found.mesh.volume, expected.volume), "{found:?} {expected:?}");
        assert!(close(found.mesh.area, expected.area), "{found:?} {expected:?}");
        // Most of the lattice is never looked into in small bricks.
        let all = lattice.cells.map(u64::from).iter().product::<u64>();
        assert!(side > 8 || is_mean || found.cells < all / 2, "{} of {all}", found.cells);
    }
}

#[test]
fn a_mean_has_its_surface_within_the_particles_and_closes_where_they_end() {
    let spacing = 1.0 / 32.0;
    let ball = |value: fn(DVec3) -> f64| regular(0.1, |at| at.length() < 1.0 + 1e-6, 0.25, value);
    let options = |isovalue: f64| IsosurfaceOptions { field: Some("value".into()), ..options(isovalue, spacing) };
    let of = |value: fn(DVec3) -> f64, isovalue: f64| {
        let mesh = written(&ball(value), &options(isovalue), 32).unwrap().mesh;
        assert_eq!((mesh.boundary_edges, mesh.cap_area), (0, 0.0), "{mesh:?}");
        mesh
    };
    // Where all values are higher it is the surface of the share of space that is filled, which is the density here.
    let whole = of(|_| 3.0, 2.0);
    let filled = IsosurfaceOptions { field: None, ..options(LEAST_FILLED.into()) };
    assert_eq!(whole, written(&ball(|_| 3.0), &filled, 32).unwrap().mesh);
    // The mean of the square of the radius is larger by the variances of the kernel.
    let sphere = of(|at| -at.length_squared(), -0.36);
    let radius = (0.36 - 3.0 * Kernel::CubicSpline.variance() * 0.25 * 0.25).sqrt();
    let volume = 4.0 / 3.0 * PI * radius.powi(3);
    assert!((sphere.volume / volume - 1.0).abs() < 5e-3, "{sphere:?} {volume}");
    assert_eq!((sphere.components, 2 * sphere.vertices), (1, sphere.triangles + 4));
    // What is on one side and what is on the other are the whole; only along the rim of the cut cells have both.
    let shell = of(DVec3::length_squared, 0.36);
    assert_eq!(shell.components, 2);
    assert!(((sphere.volume + shell.volume) / whole.volume - 1.0).abs() < 1e-6, "{sphere:?} {shell:?} {whole:?}");
    let [right, left] = [of(|at| at.x, 0.21), of(|at| -at.x, -0.21)];
    assert_eq!((right.components, left.components), (1, 1));
    assert!(((right.volume + left.volume) / whole.volume - 1.0).abs() < 3e-3, "{right:?} {left:?} {whole:?}");
    // A segment of a ball; at the rim means are of what lies within.
    let (radius, height) = ((0.75 * whole.volume / PI).cbrt(), 0.21_f64);
    let segment = PI * (2.0 / 3.0 * radius.powi(3) - radius.powi(2) * height + height.powi(3) / 3.0);
    assert!((right.volume / segment - 1.0).abs() < 0.04, "{right:?} {segment}");
    // With memory for a page and with memory for all.
    let in_memory = |memory: u64| {
        let (spacing, attribute) = (Some(0.1), Some("value".into()));
        let options = IsosurfaceOptions { memory, spacing, attribute, ..options(0.21) };
        written(&ball(|at| at.x), &options, 8).unwrap()
    };
    assert_eq!(in_memory(0), in_memory(1 << 30));
}

#[test]
fn a_mean_that_is_known_everywhere_in_a_periodic_box_fills_it() {
    let within = |at: DVec3| at.cmpge(DVec3::ZERO).all() && at.cmplt(DVec3::ONE).all();
    let tree = regular(0.25, within, 0.5, |_| -1.0);
    let options = IsosurfaceOptions { field: Some("value".into()), ..options(-2.0, 0.125) };
    let box_of_all = written_in(&tree, Some(1.0), &options, 8).unwrap().mesh;
    assert!((box_of_all.volume - 1.0).abs() < 1e-12 && (box_of_all.cap_area - 6.0).abs() < 1e-12, "{box_of_all:?}");
    assert_eq!((box_of_all.boundary_edges, box_of_all.area, box_of_all.components), (0, 0.0, 1));
    let high =
        written_in(&tree, Some(1.0), &IsosurfaceOptions { isovalue: 0.0, ..options }, 8).unwrap_err().to_string();
    assert!(high.contains("found 0, expected less than the largest value; particles have up to -1"), "{high}");
}

/// The edge of a periodic box, which few numbers of cells divide without rounding.
const EDGE: f64 = 2.7;

/// A cloud in that box, most of it near the corners.
fn wrapped(count: usize) -> Vec<(DVec3, f32)> {
    let wrap = |at: DVec3| DVec3::from_array(at.to_array().map(|coordinate| coordinate.rem_euclid(EDGE)));
    cloud(count).into_iter().map(|(at, length)| (wrap(at), length)).collect()
}

#[test]
fn a_ball_is_the_same_wherever_it_is_in_a_periodic_box() {
    let (edge, radius) = (2.0, 0.31);
    let isovalue = Kernel::CubicSpline.value(radius / 0.5) / 0.125;
    let of = |center: DVec3, is_open: bool| {
        let options = IsosurfaceOptions { is_open, ..options(isovalue, 0.03125) };
        written_in(&tree(&[(center, 0.5)]), Some(edge), &options, 32).unwrap().mesh
    };
    let whole = of(DVec3::splat(1.0), false);
    assert_eq!((whole.components, whole.boundary_edges, whole.cap_area), (1, 0, 0.0));
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
    for (center, parts) in [(DVec3::ZERO, 8_u64), (DVec3::new(1.0, 2.0, 0.0), 4), (DVec3::new(1.0, 1.0, 0.0), 2)] {
        let [closed, open] = [false, true].map(|is_open| of(center, is_open));
        for found in [closed, open] {
            assert!(close(found.volume, whole.volume) && close(found.area, whole.area), "{found:?} {whole:?}");
            assert_eq!(found.components, parts);
            // Each plane through the centre cuts off a disc on both sides.
            let discs = f64::from(parts.ilog2()) * 2.0 * PI * radius * radius;
            assert!((found.cap_area / discs - 1.0).abs() < 0.01, "{found:?} {discs}");
        }
        assert_eq!(closed.boundary_edges, 0);
        assert!(open.boundary_edges > 0 && open.triangles < closed.triangles, "{open:?}");
    }
}

#[test]
fn particles_add_to_the_density_round_a_periodic_box() {
    let particles = wrapped(200);
    let (spacing, isovalue) = (0.09, 40.0);
    let lattice = PeriodicSpace { edge: EDGE }.lattice(spacing).unwrap();
    assert_eq!(lattice.coordinate(0, lattice.cells[0].into()), EDGE);
    // Every image that reaches a point that is looked at.
    let shifts = [-EDGE, 0.0, EDGE];
    let (low, high) = (DVec3::splat(-2.0 * spacing), DVec3::splat(EDGE + 2.0 * spacing));
    let images = particles.iter().flat_map(|&(at, length)| {
        shifts
            .into_iter()
            .flat_map(move |z| shifts.into_iter().flat_map(move |y| shifts.map(|x| (at + DVec3::new(x, y, z), length))))
    });
    let reaches = |&(at, length): &(DVec3, f32)| {
        let reach = DVec3::splat(length.into());
        (at + reach).cmpge(low).all() && (at - reach).cmple(high).all()
    };
    let images: Vec<(DVec3, f32)> = images.filter(reaches).collect();
    let brute = Brute { particles: &images, lattice, faces: Faces::Capped, is_mean: false };
    let Ok(expected) = extract(&lattice, (32, &lattice.bricks(32)), isovalue, &brute, &(), |_| Ok(()));
    assert!(expected.cap_area > 0.0 && expected.boundary_edges == 0, "{expected:?}");
    let tree = tree(&particles);
    for side in [8, 64] {
        let found = written_in(&tree, Some(EDGE), &options(isovalue, spacing), side).unwrap().mesh;
        let counts = |of: &MeshReport| [of.vertices, of.triangles, of.components, of.boundary_edges];
        assert_eq!(counts(&found), counts(&expected), "{side}");
        for (found, expected) in
            [(found.volume, expected.volume), (found.area, expected.area), (found.cap_area, expected.cap_area)]
        {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }
    let narrow = written_in(&tree, Some(0.5), &options(isovalue, spacing), 8).unwrap_err().to_string();
    assert!(narrow.contains("smoothing length") && narrow.contains("--no-wrap"), "{narrow}");
}

#[test]
fn opposite_faces_have_the_same_vertices_to_the_last_bit() {
    let (tree, region, isovalue) = (tree(&wrapped(200)), Region::whole(), 40.0);
    let particles = Particles::new(&tree, (&region, Some(EDGE)), (None, None), 1 << 20, Work::quiet()).unwrap();
    let (leaves, _) = particles.survey(isovalue).unwrap();
    let periodic = PeriodicSpace { edge: EDGE };
    let field = ParticleField {
        particles: &particles,
        leaves: &leaves,
        lattice: periodic.lattice(0.09).unwrap(),
        level: Level::Density(isovalue),
        side: 16,
        has_attribute: false,
        periodic: Some(periodic),
        faces: Faces::Cut,
    };
    let plan = field.plan(1 << 20).unwrap().unwrap();
    let planned = Planned { field: &field, plan: &plan };
    let mut vertices: Vec<Vertex> = Vec::new();
    extract(&field.lattice, (16, &plan.bricks), isovalue, &planned, &(), |piece| {
        vertices.extend(piece.fresh.iter().map(|&place| piece.vertices[place as usize]));
        Ok(())
    })
    .unwrap();
    for axis in 0..3 {
        // A vertex without its coordinate along the axis.
        let rest = |vertex: &Vertex| {
            let others = [(axis + 1) % 3, (axis + 2) % 3].map(|other| vertex.position[other].to_bits());
            (others, vertex.normal.to_array().map(f32::to_bits))
        };
        let at = |place: f64| {
            let there = vertices.iter().filter(|vertex| vertex.position[axis] == place);
            there.map(rest).collect::<HashSet<_>>()
        };
        assert!(at(0.0).len() > 10, "{}", at(0.0).len());
        assert_eq!(at(0.0), at(EDGE));
    }
}

/// A volume in memory.
struct Held {
    grid: Grid,
    samples: Vec<f32>,
}

impl Held {
    /// The values of a function of the world at the samples.
    fn new(shape: [u64; 3], to_world: DAffine3, function: impl Fn(DVec3) -> f64) -> Held {
        let grid = Grid { to_world, ..Grid::volume(shape, SampleType::F32, Channel::numbered(1)) };
        let mut samples = Vec::new();
        for z in 0..shape[2] {
            for y in 0..shape[1] {
                for x in 0..shape[0] {
                    let at = DVec3::from_array([x, y, z].map(|index| index as f64));
                    samples.push(function(to_world.transform_point3(at)) as f32);
                }
            }
        }
        Held { grid, samples }
    }
}

impl ReadGrid for Held {
    fn path(&self) -> &Path {
        Path::new("held")
    }

    fn grid(&self) -> &Grid {
        &self.grid
    }

    fn read(&self, region: &GridRegion, out: &mut [u8]) -> Result<(), ExploreError> {
        let [width, height, _] = self.grid.shape;
        let mut bytes = out.chunks_exact_mut(4);
        for z in region.min[2]..region.max[2] {
            for y in region.min[1]..region.max[1] {
                for x in region.min[0]..region.max[0] {
                    let sample = self.samples[((z * height + y) * width + x) as usize];
                    bytes.next().unwrap().copy_from_slice(&sample.to_ne_bytes());
                }
            }
        }
        Ok(())
    }
}

fn written_of(volume: &Held, options: &IsosurfaceOptions) -> Result<Isosurface, ExploreError> {
    let folder = tempfile::tempdir().unwrap();
    isosurface_of_grid(volume, options, (MeshFormat::Stl, &folder.path().join("surface.stl")), Work::quiet())
}

#[test]
fn a_volume_has_the_ball_that_it_was_sampled_of() {
    // Turned, mirrored and stretched, in two bricks.
    let shape = [42, 40, 80];
    let matrix = DMat3::from_rotation_y(0.7) * DMat3::from_diagonal(DVec3::new(0.1, -0.11, 0.05));
    let middle = DVec3::new(20.3, 19.6, 39.7);
    let to_world = DAffine3::from_mat3_translation(matrix, DVec3::new(3.0, -4.0, 5.0));
    let (center, radius) = (to_world.transform_point3(middle), 1.9);
    let volume = Held::new(shape, to_world, |at| radius - at.distance(center));
    let found = written_of(&volume, &IsosurfaceOptions { spacing: None, ..options(0.0, 1.0) }).unwrap();
    let mesh = found.mesh;
    let (expected, area) = (4.0 / 3.0 * PI * radius.powi(3), 4.0 * PI * radius * radius);
    assert!((mesh.volume / expected - 1.0).abs() < 1e-3, "{mesh:?} {expected}");
    assert!((mesh.area / area - 1.0).abs() < 1e-2, "{mesh:?} {area}");
    assert_eq!((mesh.components, mesh.boundary_edges, mesh.cap_area), (1, 0, 0.0));
    // Euler's number of a sphere.
    assert_eq!(2 * mesh.vertices, mesh.triangles + 4);
    assert_eq!(found.samples, Some(shape.iter().product()));
    // What the volume cuts off is closed by caps, or open with the same volume.
    let beyond = |is_open: bool| {
        let options = IsosurfaceOptions { is_open, spacing: None, ..options(-0.6, 1.0) };
        written_of(&volume, &options).unwrap().mesh
    };
    let (closed, open) = (beyond(false), beyond(true));
    assert!(closed.boundary_edges == 0 && open.boundary_edges > 0, "{closed:?} {open:?}");
    assert!((closed.volume / open.volume - 1.0).abs() < 1e-9, "{closed:?} {open:?}");
    assert!(closed.volume > 1.5 * mesh.volume && closed.cap_area > 0.0, "{closed:?}");
    let high = written_of(&volume, &options(9.0, 1.0)).unwrap_err().to_string();
    assert!(high.contains("held: --isovalue: found 9, expected") && !high.contains('\n'), "{high}");
    let named = IsosurfaceOptions { attribute: Some("heat".into()), ..options(0.0, 1.0) };
    let unknown = written_of(&volume, &named).unwrap_err().to_string();
    assert!(unknown.contains("channel heat") && unknown.contains("value"), "{unknown}");
    // A mesh that is smoothed keeps its volume, where it fits.
    let smoothed = IsosurfaceOptions { smooth: 10, memory: 1 << 26, ..options(0.0, 1.0) };
    let smooth = written_of(&volume, &smoothed).unwrap().mesh;
    assert!((smooth.volume / mesh.volume - 1.0).abs() < 1e-4, "{smooth:?} {mesh:?}");
    let large = written_of(&volume, &IsosurfaceOptions { memory: 1 << 20, ..smoothed }).unwrap_err().to_string();
    assert!(large.contains("--smooth") && large.contains("--memory"), "{large}");
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
    let coarse = error(&options(50.0, 3.0));
    assert!(coarse.contains("finer --spacing than 3: particles have up to"), "{coarse}");
    let many = error(&IsosurfaceOptions { most_cells: 512, ..options(50.0, 0.01) });
    assert!(many.contains("--spacing") && many.contains("512"), "{many}");
    let unknown = error(&IsosurfaceOptions { attribute: Some("heat".into()), ..options(50.0, 0.05) });
    assert!(unknown.contains("heat") && unknown.contains("number"), "{unknown}");
    let field = error(&IsosurfaceOptions { field: Some("heat".into()), ..options(50.0, 0.05) });
    assert_eq!(field, unknown);
}
