//! What is clustered, and what becomes of it: particles or clusters, with the same columns.

use super::split::Splitting;
use crate::codec::AttributeMerge;

/// Symmetric second moments: xx, yy, zz, xy, xz, yz.
pub type Moments = [f64; 6];

/// The pairs of axes of [`Moments`].
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Particles or clusters, structure of arrays. Lengths are in fractions of the root cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Members {
    /// Centroids.
    pub places: Vec<[f64; 3]>,
    /// Masses.
    pub mass: Vec<f64>,
    /// Densities: mass-weighted means.
    pub density: Vec<f32>,
    /// Attributes, in the family's order.
    pub attributes: Vec<Vec<f32>>,
    /// Second moments of each around its centroid, per mass: of a particle those of its kernel.
    pub moments: Vec<Moments>,
    /// Mass-weighted mean of `ln det` of the moments of the source particles in each: what [`misfit`] compares with.
    pub log_volume: Vec<f64>,
    /// How far from its centroid a source particle of each is at most.
    pub reach: Vec<f64>,
    /// Diameters as HE03 has them ([`published_diameter`]).
    pub diameters: Vec<f64>,
}

impl Members {
    /// Number of members.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Adds a particle with a smoothing length, whose kernel has so much variance along each axis.
    pub fn push_particle(&mut self, place: [f64; 3], mass: f64, density: f32, (h, variance): (f64, f64)) {
        self.places.push(place);
        self.mass.push(mass);
        self.density.push(density);
        self.moments.push([variance, variance, variance, 0.0, 0.0, 0.0]);
        self.log_volume.push(3.0 * variance.ln());
        self.reach.push(0.0);
        self.diameters.push(2.0 * h);
    }

    /// Adds those of another.
    pub fn append(&mut self, mut other: Members) {
        self.places.append(&mut other.places);
        self.mass.append(&mut other.mass);
        self.density.append(&mut other.density);
        self.attributes.resize_with(other.attributes.len(), Vec::new);
        self.attributes.iter_mut().zip(&mut other.attributes).for_each(|(own, other)| own.append(other));
        self.moments.append(&mut other.moments);
        self.log_volume.append(&mut other.log_volume);
        self.reach.append(&mut other.reach);
        self.diameters.append(&mut other.diameters);
    }

    /// The clusters that a splitting makes of these: masses are added, centroids, densities, second moments and attributes are mass-weighted
    /// (fluxes of magnitudes are added).
    pub fn merged(&self, splitting: &Splitting, rules: &[AttributeMerge]) -> Members {
        let groups = splitting.groups();
        let mut out = Members { attributes: rules.iter().map(|_| Vec::new()).collect(), ..Members::default() };
        for group in groups {
            let sums = self.sum(group.iter().copied());
            out.places.push(sums.place);
            out.mass.push(sums.mass);
            out.moments.push(sums.moments);
            out.log_volume.push(sums.log_volume);
            out.reach.push(self.reach_from(sums.place, group.iter().copied()));
            out.diameters.push(self.published_diameter(group, sums.place, DiameterRule::Averaged));
            let presence: f64 = group.iter().map(|&i| self.presence(i)).sum();
            out.density.push((presence / sums.mass) as f32);
            for ((out, values), rule) in out.attributes.iter_mut().zip(&self.attributes).zip(rules) {
                out.push(merged_attribute(*rule, group.iter().map(|&i| (self.mass[i as usize], values[i as usize]))));
            }
        }
        out
    }

    /// The diameters that HE03 gives the clusters `merged` that a splitting has made of these ([`published_diameter`]).
    pub fn published_diameters(&self, splitting: &Splitting, merged: &Members, rule: DiameterRule) -> Vec<f64> {
        let groups = splitting.groups().zip(&merged.places);
        groups.map(|(group, place)| self.published_diameter(group, *place, rule)).collect()
    }

    fn published_diameter(&self, group: &[u32], place: [f64; 3], rule: DiameterRule) -> f64 {
        published_diameter(group.iter().map(|&i| (self.diameters[i as usize], self.distance(i, place))), rule)
    }

    fn presence(&self, i: u32) -> f64 {
        self.mass[i as usize] * f64::from(self.density[i as usize])
    }

    /// The farthest that a source particle of some members is from a place.
    pub fn reach_from(&self, place: [f64; 3], group: impl Iterator<Item = u32>) -> f64 {
        group.map(|i| self.distance(i, place) + self.reach[i as usize]).fold(0.0, f64::max)
    }

    fn distance(&self, i: u32, place: [f64; 3]) -> f64 {
        (0..3).map(|k| (self.places[i as usize][k] - place[k]).powi(2)).sum::<f64>().sqrt()
    }

    /// Mass, centroid and second moments of some members together; there has to be one.
    pub fn sum(&self, group: impl Iterator<Item = u32> + Clone) -> Sum {
        let first = group.clone().next().unwrap_or(0) as usize;
        // Around a place nearby nothing is lost to cancellation.
        let origin = self.places[first];
        let (mut mass, mut log_volume) = (0.0, 0.0);
        let (mut along, mut squares) = ([0.0; 3], [0.0; 6]);
        for i in group {
            let i = i as usize;
            let m = self.mass[i];
            let d: [f64; 3] = std::array::from_fn(|k| self.places[i][k] - origin[k]);
            mass += m;
            log_volume += m * self.log_volume[i];
            (0..3).for_each(|k| along[k] += m * d[k]);
            for (k, (a, b)) in PAIRS.into_iter().enumerate() {
                squares[k] += m * (self.moments[i][k] + d[a] * d[b]);
            }
        }
        let middle = along.map(|sum| sum / mass);
        let mut moments = [0.0; 6];
        for (k, (a, b)) in PAIRS.into_iter().enumerate() {
            moments[k] = squares[k] / mass - middle[a] * middle[b];
            if k < 3 {
                // No variance is negative, however it is rounded.
                moments[k] = moments[k].max(0.0);
            }
        }
        let place = std::array::from_fn(|k| origin[k] + middle[k]);
        Sum { mass, place, moments, log_volume: log_volume / mass }
    }
}

/// The attribute of several, each with its mass and value, as one.
pub fn merged_attribute(rule: AttributeMerge, values: impl Iterator<Item = (f64, f32)>) -> f32 {
    let add = |(sum, weight): (f64, f64), (w, v): (f64, f32)| (sum + attribute_share(rule, w, v), weight + w);
    let (sum, weight) = values.fold((0.0, 0.0), add);
    attribute_of_shares(rule, sum, weight)
}

/// What one with this mass and value adds to the attribute of several.
pub fn attribute_share(rule: AttributeMerge, mass: f64, value: f32) -> f64 {
    match rule {
        AttributeMerge::Mean => mass * f64::from(value),
        AttributeMerge::Magnitude => 10.0_f64.powf(-0.4 * f64::from(value)),
    }
}

/// The attribute of several, of what each adds to it and of their mass.
pub fn attribute_of_shares(rule: AttributeMerge, shares: f64, mass: f64) -> f32 {
    let value = match rule {
        AttributeMerge::Mean => shares / mass,
        AttributeMerge::Magnitude => -2.5 * shares.log10(),
    };
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// How equation 2 of HE03 is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DiameterRule {
    /// The number of members divides under the root, so that it is over an average, as the text has it.
    #[default]
    Averaged,
    /// It divides outside of the root, as printed, so that large clusters hardly grow.
    Printed,
}

/// The diameter `s_j` that HE03 gives a cluster of members with diameters `s_i` and distances `|x_i - X_j|` from its centroid (equation 2):
/// that of the largest member, `m`, and `0.5 sqrt(mean of s_i |x_i - X_j|)` over the others, or `0.5 / (n - 1) sqrt(sum)` of `n` members.
pub fn published_diameter(members: impl Iterator<Item = (f64, f64)>, rule: DiameterRule) -> f64 {
    let (mut largest, mut sum, mut count) = ((0.0, 0.0), 0.0, 0_u32);
    for (size, away) in members {
        sum += size * away;
        count += 1;
        if size > largest.0 {
            largest = (size, away);
        }
    }
    let (size, away) = largest;
    let (root, others) = ((sum - size * away).max(0.0).sqrt(), f64::from(count.max(2) - 1));
    size + 0.5 * root / if rule == DiameterRule::Averaged { others.sqrt() } else { others }
}

/// Some members together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sum {
    /// Mass.
    pub mass: f64,
    /// Centroid.
    pub place: [f64; 3],
    /// Second moments around it.
    pub moments: Moments,
    /// As [`Members::log_volume`].
    pub log_volume: f64,
}

impl Sum {
    /// See [`misfit`].
    pub fn misfit(&self) -> f64 {
        misfit(&self.moments, self.log_volume)
    }
}

/// A bound on the L1 distance in space, relative to the mass, between source particles with Gaussian kernels and the one Gaussian that
/// represents them: projecting both onto a picture never enlarges it.
///
/// The representative `R` has the mixture's first and second moments, so the Kullback-Leibler divergence of the mixture from it is the
/// difference of their entropies; and the mixture's entropy is at least the mean of its parts'. Hence
/// `KL <= (ln det C - mean ln det C_i) / 2`, and by Pinsker's inequality `L1 <= sqrt(2 KL)`. No two pictures of the same mass differ by
/// more than 2. SPH kernels, whose moments these are, are nearly Gaussians.
pub fn misfit(moments: &Moments, log_volume: f64) -> f64 {
    let bound = (determinant(moments).ln() - log_volume).max(0.0).sqrt();
    if bound < 2.0 { bound } else { 2.0 }
}

/// The determinant of symmetric moments.
pub fn determinant([xx, yy, zz, xy, xz, yz]: &Moments) -> f64 {
    xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
}

/// Their trace: three times the mean variance along an axis.
pub fn trace(moments: &Moments) -> f64 {
    moments[0] + moments[1] + moments[2]
}
