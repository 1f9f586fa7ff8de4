//! A box of dark matter like those of cosmological simulations today: a web that the linear density of a Lambda-CDM
//! universe has made, and haloes in its knots and filaments, which hold nearly half of the particles.
//!
//! Particles in haloes come first, in the order of the haloes' masses, as Gadget-4 and AREPO write them; the others follow
//! in the order of where they were before they moved. The memory needed does not depend on the number of particles:
//! below 600 MB, in grids of at most 256 cells along an edge.

mod field;
mod haloes;
mod local;
mod nfw;
mod power;

use super::random::{Random, wrap};
use super::{Chunk, Generator, Scalar};
use crate::model::progress::Progress;
use crate::model::{Bounds, FamilyName};
use field::Field;
use haloes::{Catalogue, UNCLAIMED};
use local::Local;
use nfw::{MOST_CONCENTRATED, Nfw, Profile, concentration};
use power::{MEAN_DENSITY, Power};
use std::f64::consts::PI;
use std::ops::Range;

/// Edge of the box where nobody names one, Mpc/h.
pub const DEFAULT_EDGE: f64 = 100.0;
/// Particles within a smoothing length.
const NEIGHBOURS: f64 = 32.0;
/// Most cells along an edge of the grids.
const FINEST: usize = 256;
/// Most columns along an edge of the lattice.
const COLUMNS: u64 = 2048;
/// How far particles of the lattice stand beside their places, in units of its spacing.
const JITTER: f64 = 0.35;
/// Gadget's unit of length in Mpc/h, and of mass in Msun/h.
const KPC: f64 = 1e-3;
const MASS_UNIT: f64 = 1e10;

/// Velocity of what has been displaced by a length, km/s for Mpc/h.
fn velocity_per_length() -> f64 {
    100.0 * power::growth_rate()
}

/// The generator.
pub struct Cosmology {
    seed: u64,
    count: u64,
    field: Field,
    catalogue: Catalogue,
    local: Local,
    profile: Profile,
    lattice: Lattice,
    /// Msun/h.
    particle_mass: f64,
    /// See [`velocity_per_length`].
    speed: f64,
    /// Radius of the sphere that held a kernel's particles before they moved, Mpc/h.
    reach: f64,
}

/// Particles outside of haloes before they moved: columns along x, of which each has its share.
struct Lattice {
    /// Columns along an edge.
    columns: u64,
    /// Number of the first particle of each column, and the number of all.
    starts: Vec<u64>,
    /// Density where no halo has claimed anything, in units of the mean.
    filling: f64,
}

impl Lattice {
    fn new(count: u64, all: u64, size: usize, remaining: &[u8]) -> Lattice {
        let sums: Vec<u64> = remaining.chunks(size).map(|row| row.iter().map(|&part| u64::from(part)).sum()).collect();
        let free = sums.iter().sum::<u64>().max(1) as f64 / (f64::from(UNCLAIMED) * remaining.len() as f64);
        let filling = count as f64 / all as f64 / free;
        let columns = (libm::cbrt(count as f64 / free) as u64).clamp(1, COLUMNS);
        let of_column = |column: u64| {
            let row = |i: u64| ((2 * i + 1) * size as u64 / (2 * columns)) as usize;
            // Nothing is quite empty, so that every particle has a place.
            u128::from(sums[row(column / columns) * size + row(column % columns)] + 1)
        };
        let total: u128 = (0..columns * columns).map(of_column).sum();
        let mut before = 0;
        let starts = (0..=columns * columns).map(|column| {
            let start = (u128::from(count) * before / total) as u64;
            before += if column < columns * columns { of_column(column) } else { 0 };
            start
        });
        Lattice { columns, starts: starts.collect(), filling }
    }
}

impl Cosmology {
    /// `count` particles in a box with an edge of `edge` Mpc/h; the web depends on the seed and the edge alone.
    pub fn new(seed: u64, count: u64, edge: f64, progress: &dyn Progress) -> Cosmology {
        progress.begin("letting structure grow", 0);
        let power = Power::new();
        let profile = Profile::new();
        let particle_mass = MEAN_DENSITY * edge * edge * edge / count.max(1) as f64;
        let cells = (16..FINEST).find(|size| size.is_power_of_two() && (*size as u64).pow(3) >= count);
        let mut field = Field::new(seed, cells.unwrap_or(FINEST), edge, &power);
        let catalogue = Catalogue::new(seed, &field, &power, &profile, count, particle_mass);
        (field.contrast, field.peaks) = (Vec::new(), Vec::new());
        let lattice = Lattice::new(count - catalogue.particles, count, field.size, &catalogue.remaining);
        let local = Local::new(seed, &field, &catalogue, &profile, lattice.filling, particle_mass);
        let reach = edge * libm::cbrt(3.0 * NEIGHBOURS / (4.0 * PI * count.max(1) as f64));
        let speed = velocity_per_length();
        Cosmology { seed, count, field, catalogue, local, profile, lattice, particle_mass, speed, reach }
    }

    /// Number of haloes, satellites among them, and of the particles in them.
    pub fn haloes(&self) -> (usize, u64) {
        (self.catalogue.haloes.len(), self.catalogue.particles)
    }

    /// Adds a particle; `place` and the radius of the kernel in Mpc/h, density in units of the mean.
    fn push(&self, chunk: &mut Chunk, place: [f64; 3], velocity: [f64; 3], density: f64, dispersion: f64) {
        let edge = self.field.edge;
        let whole = (edge / KPC) as f32;
        // Rounding may reach the box's edge, which is its beginning.
        let own = |x: f64| Some((wrap(x / edge) * edge / KPC) as f32).filter(|&x| x < whole).unwrap_or(0.0);
        chunk.positions.push(place.map(own));
        chunk.velocities.push(velocity.map(|v| v as f32));
        chunk.density.push((density * MEAN_DENSITY / MASS_UNIT * KPC * KPC * KPC) as f32);
        let volume = NEIGHBOURS * self.particle_mass / (density * MEAN_DENSITY);
        chunk.smoothing_length.push((libm::cbrt(3.0 / (4.0 * PI) * volume) / KPC) as f32);
        chunk.scalars[0].push(dispersion as f32);
    }

    /// Particles of haloes.
    fn in_haloes(&self, range: Range<u64>, random: &mut Random, chunk: &mut Chunk) {
        let mut at = range.start;
        let mut index = self.catalogue.haloes.partition_point(|halo| halo.first <= at).saturating_sub(1);
        while at < range.end {
            let halo = &self.catalogue.haloes[index];
            let count = self.catalogue.particles_of(index);
            let until = range.end.min(halo.first + count);
            if at < until {
                let shape = Shape::new(self.seed, index as u64);
                let mass = count as f64 * self.particle_mass;
                let concentration = (concentration(mass) * shape.concentration).clamp(2.5, MOST_CONCENTRATED);
                let nfw = Nfw::new(&self.profile, mass, concentration, count as f64, NEIGHBOURS);
                for _ in at..until {
                    let radius = nfw.radius(random.uniform());
                    let offset = shape.apply(random.direction().map(|x| x * radius));
                    let (density, dispersion) = nfw.local(radius);
                    let place = std::array::from_fn(|axis| f64::from(halo.center[axis]) + offset[axis]);
                    let velocity = halo.velocity.map(|v| f64::from(v) + dispersion * random.quick_normal());
                    // What is around the halo adds the mean density.
                    self.push(chunk, place, velocity, density + 1.0, dispersion);
                }
                at = until;
            }
            index += 1;
        }
    }

    /// Particles outside of haloes.
    fn in_web(&self, range: Range<u64>, random: &mut Random, chunk: &mut Chunk) {
        let (size, columns) = (self.field.size, self.lattice.columns);
        let spacing = size as f64 / columns as f64;
        let mut at = range.start;
        let mut column = self.lattice.starts.partition_point(|&start| start <= at).saturating_sub(1);
        while at < range.end {
            let (start, end) = (self.lattice.starts[column], self.lattice.starts[column + 1]);
            let center = [column as u64 % columns, column as u64 / columns].map(|i| (i as f64 + 0.5) * spacing);
            let row = center[1] as usize * size + center[0] as usize;
            let parts = &self.catalogue.remaining[row * size..(row + 1) * size];
            let whole = parts.iter().map(|&part| f64::from(part)).sum::<f64>() + 1.0;
            let step = whole / (end - start).max(1) as f64;
            // The cell that holds the next particle, and what the cells before it hold.
            let (mut cell, mut before) = (0, 0.0);
            for index in at..range.end.min(end) {
                let target = ((index - start) as f64 + 0.5 + JITTER * random.signed()) * step;
                let share = |cell: usize| f64::from(parts[cell]) + 1.0 / size as f64;
                while cell + 1 < size && before + share(cell) < target {
                    before += share(cell);
                    cell += 1;
                }
                // Cells are around their corners, columns between them.
                let x = cell as f64 - 0.5 + ((target - before) / share(cell)).clamp(0.0, 1.0);
                let beside = center.map(|c| c - 0.5 + JITTER * spacing * random.signed());
                self.diffuse(chunk, [x, beside[0], beside[1]], f64::from(parts[cell]) / f64::from(UNCLAIMED));
            }
            at = range.end.min(end);
            column += 1;
        }
    }

    /// The particle that was at a place, in cells, before it moved; `part` of its cell is not in haloes.
    fn diffuse(&self, chunk: &mut Chunk, place: [f64; 3], part: f64) {
        let cell = self.field.cell();
        let (displacement, gradient) = self.field.displacement_at(place);
        let moved: [f64; 3] = std::array::from_fn(|axis| place[axis] + displacement[axis] / cell);
        let velocity = displacement.map(|psi| psi * self.speed);
        let around = self.local.density(moved);
        // Alone, the stream that the particle is in has this density; where streams cross, that of the grid counts.
        let stretch = determinant(&gradient).abs();
        let stream = (part * self.lattice.filling / stretch.max(1e-3)).clamp(0.3 * around, 8.0f64.max(0.3 * around));
        let crossing = ((around - 1.5) / 3.0).clamp(0.0, 1.0);
        let crossing = crossing * crossing * (3.0 - 2.0 * crossing);
        let density = (stream + crossing * (around - stream)).max(0.01);
        // How much the velocity changes within what the kernel held before it moved.
        let shear = gradient.iter().flatten().map(|slope| slope * slope).sum::<f64>() / 15.0;
        let speed = self.speed * self.reach;
        let mixed = crossing * self.local.dispersion(moved);
        let dispersion = (shear * speed * speed + mixed * mixed).sqrt();
        self.push(chunk, moved.map(|x| x * cell), velocity, density, dispersion);
    }
}

/// Of one plus the gradient.
fn determinant(gradient: &[[f64; 3]; 3]) -> f64 {
    let [[a, b, c], [d, e, f], [g, h, i]] = *gradient;
    let (a, e, i) = (1.0 + a, 1.0 + e, 1.0 + i);
    a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
}

/// What makes a halo differ from others of its mass.
struct Shape {
    /// Factor of the concentration.
    concentration: f64,
    /// From a sphere to an ellipsoid of the same volume; columns are its axes.
    axes: [[f64; 3]; 3],
}

impl Shape {
    fn new(seed: u64, halo: u64) -> Shape {
        let mut random = Random::new(seed ^ 0x7368_6170, halo);
        let concentration = libm::exp(0.25 * random.normal());
        let middle = 0.65 + 0.35 * random.uniform();
        let short = middle * (0.7 + 0.3 * random.uniform());
        let whole = libm::cbrt(middle * short);
        let first = random.direction();
        let mut second = random.direction();
        let along = dot(first, second);
        second = std::array::from_fn(|axis| second[axis] - along * first[axis]);
        let length = dot(second, second).sqrt();
        // Parallel directions are as good as never drawn; any turned axis will do then.
        second = if length > 1e-6 { second.map(|x| x / length) } else { [first[1], -first[0], 0.0] };
        let third = [
            first[1] * second[2] - first[2] * second[1],
            first[2] * second[0] - first[0] * second[2],
            first[0] * second[1] - first[1] * second[0],
        ];
        let axes = [(first, 1.0), (second, middle), (third, short)];
        Shape { concentration, axes: axes.map(|(axis, length)| axis.map(|x| x * length / whole)) }
    }

    fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| (0..3).map(|axis| self.axes[axis][i] * point[axis]).sum())
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Generator for Cosmology {
    fn len(&self) -> u64 {
        self.count
    }

    fn family(&self) -> FamilyName {
        FamilyName::Dark
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: glam::DVec3::ZERO, max: glam::DVec3::splat(self.field.edge / KPC) }
    }

    fn particle_mass(&self) -> f64 {
        self.particle_mass / MASS_UNIT
    }

    fn scalars(&self) -> &'static [Scalar] {
        &[Scalar { label: "VELD", name: "velocity-dispersion", unit: "km/s" }]
    }

    fn chunk(&self, index: u64) -> Chunk {
        let range = self.chunk_range(index);
        let mut random = Random::new(self.seed, index);
        let mut chunk = Chunk::with_capacity((range.end - range.start) as usize, 1);
        let border = self.catalogue.particles;
        self.in_haloes(range.start.min(border)..range.end.min(border), &mut random, &mut chunk);
        let web = range.start.max(border) - border..range.end.max(border) - border;
        self.in_web(web, &mut random, &mut chunk);
        chunk
    }
}
