//! Radial profiles: what is in shells around a centre.

use super::batch::Batch;
use super::error::ExploreError;
use super::moments::Moments;
use super::region::Region;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Which shells, and the mean of what in them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileOptions {
    /// Number of shells, 1 to 4096.
    pub shells: usize,
    /// Radius of the innermost shell's outer edge over that of the outermost, where shells are of equal width in the logarithm; the
    /// first shell goes down to the centre. None: shells of equal width.
    #[serde(default)]
    pub inner: Option<f64>,
    /// The field whose mean and dispersion are taken in each shell.
    #[serde(default)]
    pub field: Option<String>,
}

impl ProfileOptions {
    /// Shells of equal width in the logarithm over two decades.
    pub fn logarithmic(shells: usize) -> ProfileOptions {
        ProfileOptions { shells, inner: Some(0.01), field: None }
    }
}

/// One shell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shell {
    /// Inner radius.
    pub from: f64,
    /// Outer radius, which belongs to the shell.
    pub to: f64,
    /// Particles in it.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Their mass over the shell's volume.
    pub density: f64,
    /// Mean of the field, if one was asked for and there are values.
    pub mean: Option<f64>,
    /// Its dispersion.
    pub dispersion: Option<f64>,
    /// Mass-weighted mean of the field.
    pub mass_weighted_mean: Option<f64>,
    /// Its mass-weighted dispersion.
    pub mass_weighted_dispersion: Option<f64>,
}

impl Shell {
    /// Its volume.
    pub(in crate::explore) fn volume(&self) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * (self.to.powi(3) - self.from.powi(3))
    }

    /// Sets its mass, and with it its density.
    pub(super) fn set_mass(&mut self, mass: f64) {
        (self.mass, self.density) = (mass, mass / self.volume());
    }
}

/// Shells that are being filled.
pub(super) struct Shells {
    /// The centre, from the region's reference.
    center: DVec3,
    /// Squared outer radii, ascending.
    squared: Vec<f64>,
    edges: Vec<f64>,
}

/// What is in the shells so far.
#[derive(Clone)]
pub(super) struct Filled {
    pub counts: Vec<u64>,
    pub masses: Vec<f64>,
    pub values: Vec<Moments>,
}

impl Shells {
    /// The shells in the first sphere of a region.
    pub(super) fn new(options: &ProfileOptions, region: &Region, reference: DVec3) -> Result<Shells, ExploreError> {
        let Some((center, radius)) = region.first_sphere() else {
            return Err(ExploreError::value("profile", "of a region without a sphere", "a sphere to have shells in"));
        };
        if !(1..=4096).contains(&options.shells) {
            return Err(ExploreError::value("profile.shells", options.shells, "1 to 4096 shells"));
        }
        let last = options.shells - 1;
        let edges: Vec<f64> = match options.inner {
            None => (0..=last).map(|i| radius * (i + 1) as f64 / options.shells as f64).collect(),
            Some(inner) if inner > 0.0 && inner < 1.0 => {
                let share = |i: usize| if last == 0 { 0.0 } else { (last - i) as f64 / last as f64 };
                (0..=last).map(|i| radius * inner.powf(share(i))).collect()
            }
            Some(inner) => {
                return Err(ExploreError::value("profile.inner", inner, "a share of the radius between 0 and 1"));
            }
        };
        let squared = edges.iter().map(|edge| edge * edge).collect();
        Ok(Shells { center: center - reference, squared, edges })
    }

    pub(super) fn len(&self) -> usize {
        self.edges.len()
    }

    /// The shell that a place is in, which counts from the region's reference.
    pub(super) fn shell(&self, at: DVec3) -> usize {
        let squared = (at - self.center).length_squared();
        // What rounding puts a hair outside of the sphere belongs to its last shell.
        self.squared.partition_point(|&edge| edge < squared).min(self.squared.len() - 1)
    }

    pub(super) fn empty(&self) -> Filled {
        let n = self.len();
        Filled { counts: vec![0; n], masses: vec![0.0; n], values: vec![Moments::NONE; n] }
    }

    /// Adds a run of particles; `values` is the field's column, or empty.
    pub(super) fn fill(&self, filled: &mut Filled, batch: &Batch, values: &[f64]) {
        for (i, (at, &mass)) in batch.relative.iter().zip(&batch.mass).enumerate() {
            let shell = self.shell(*at);
            filled.counts[shell] += 1;
            filled.masses[shell] += mass;
            if let Some(&value) = values.get(i) {
                filled.values[shell].add(value, mass);
            }
        }
    }

    /// The mass of a run of particles that are nearer than `reach` to an edge between shells.
    pub(super) fn near_edges(&self, batch: &Batch, reach: f64) -> f64 {
        let last = self.edges.len() - 1;
        let shell = |radius: f64| self.edges.partition_point(|&edge| edge < radius).min(last);
        let near = |at: &DVec3| {
            let radius = (*at - self.center).length();
            shell(radius - reach) != shell(radius + reach)
        };
        batch.relative.iter().zip(&batch.mass).filter(|(at, _)| near(at)).map(|(_, mass)| mass).sum()
    }

    /// The shells as numbers.
    pub(super) fn finish(&self, filled: &Filled) -> Vec<Shell> {
        let inner = std::iter::once(0.0).chain(self.edges.iter().copied());
        let shells = inner.zip(&self.edges).zip(filled.counts.iter().zip(&filled.masses).zip(&filled.values));
        shells
            .map(|((from, &to), ((&count, &mass), values))| {
                let mut shell = Shell {
                    from,
                    to,
                    count,
                    mass: 0.0,
                    density: 0.0,
                    mean: values.mean(),
                    dispersion: values.dispersion(),
                    mass_weighted_mean: values.weighted_mean(),
                    mass_weighted_dispersion: values.weighted_dispersion(),
                };
                shell.set_mass(mass);
                shell
            })
            .collect()
    }
}

impl Filled {
    /// As though each particle had been there so many times.
    pub(super) fn scaled(mut self, factor: f64) -> Filled {
        self.counts.iter_mut().for_each(|count| *count = (factor * *count as f64).round() as u64);
        self.masses.iter_mut().for_each(|mass| *mass *= factor);
        self.values.iter_mut().for_each(|values| *values = values.scaled(factor));
        self
    }

    pub(super) fn join(&mut self, other: &Filled) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.masses.iter_mut().zip(&other.masses).for_each(|(a, b)| *a += b);
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| a.join(b));
    }
}
