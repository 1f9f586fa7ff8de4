//! Binary splits along the principal component (F12 3.3): the start of the codebook.
//!
//! The paper splits one cluster at a time, the one with the largest distortion. Here each round splits the worse half of
//! the clusters, in parallel, which gives the same clusters but for the last few and does not depend on the number of
//! threads. Distortion is the sum over a cluster's vectors (the paper's mean, times their number), because that is what
//! LBG minimises next; with the mean, single outliers would take codes that thousands of vectors need.

use super::quantizer::code_child;
use crate::model::portable::Portable;
use rayon::prelude::*;

/// A splitting plane: vectors with a positive [`Plane::side`] go to the second child.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane<const L: usize> {
    normal: [f32; L],
    offset: f32,
    pub children: [u32; 2],
}

impl<const L: usize> Portable for Plane<L> {
    fn put(&self, to: &mut Vec<u8>) {
        (self.normal, (self.offset, self.children)).put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Plane<L>> {
        let (normal, (offset, children)) = Portable::take(from)?;
        Some(Plane { normal, offset, children })
    }
}

impl<const L: usize> Plane<L> {
    /// Signed distance of `vector` to the plane.
    #[inline(always)]
    pub fn side(&self, vector: &[f32; L]) -> f32 {
        let mut products = [0.0; L];
        for i in 0..L {
            products[i] = self.normal[i] * vector[i];
        }
        sum(&products) - self.offset
    }
}

/// Sum of the coordinates, pairwise: the halves are added as vectors.
#[inline(always)]
pub(super) fn sum<const L: usize>(v: &[f32; L]) -> f32 {
    let mut v = *v;
    let mut len = L;
    while len > 1 {
        len /= 2;
        for i in 0..len {
            v[i] += v[i + len];
        }
    }
    v[0]
}

/// A range of the sample with the plane that would split it.
struct Cluster<const L: usize> {
    start: usize,
    len: usize,
    mean: [f32; L],
    normal: [f32; L],
    /// Sum of squared distances to the mean; 0 when it cannot be split.
    distortion: f64,
    /// The plane and side that lead here; the first cluster has none.
    parent: Option<(usize, usize)>,
}

/// A sample that has been split.
pub(super) struct Split<const L: usize> {
    /// The first is the root.
    pub planes: Vec<Plane<L>>,
    /// Mean of each cluster.
    pub means: Vec<[f32; L]>,
    /// The cluster of each vector of the sample, as that is ordered now: the one to which planes lead it.
    pub cells: Vec<u32>,
}

/// Splits `sample` into at most `entries` clusters. Clusters of identical vectors are not split, nor those with a vector that is not finite.
/// `L` is a power of two.
pub(super) fn split<const L: usize>(sample: &mut [[f32; L]], entries: usize, go_on: &(dyn Fn() + Sync)) -> Split<L> {
    let mut clusters = vec![analyse(sample, 0, None)];
    let mut planes = Vec::new();
    while clusters.len() < entries.max(1) {
        let mut order: Vec<usize> = (0..clusters.len()).filter(|&i| clusters[i].distortion > 0.0).collect();
        order.sort_by(|&a, &b| clusters[b].distortion.total_cmp(&clusters[a].distortion).then(a.cmp(&b)));
        order.truncate(clusters.len().div_ceil(2).min(entries - clusters.len()));
        if order.is_empty() {
            break;
        }
        // In the order of the sample, so that the ranges can be borrowed apart from each other.
        order.sort_by_key(|&i| clusters[i].start);
        let mut rest = &mut *sample;
        let mut passed = 0;
        let mut jobs = Vec::with_capacity(order.len());
        for &i in &order {
            let (range, after) = std::mem::take(&mut rest)[clusters[i].start - passed..].split_at_mut(clusters[i].len);
            passed = clusters[i].start + clusters[i].len;
            rest = after;
            jobs.push((i, range));
        }
        let one = |(i, range): (usize, &mut [[f32; L]])| {
            go_on();
            (i, halve(range, &clusters[i]))
        };
        let halves: Vec<_> = jobs.into_par_iter().map(one).collect();
        for (i, halves) in halves {
            let Some((plane, mut low, mut high)) = halves else {
                clusters[i].distortion = 0.0;
                continue;
            };
            let number = planes.len();
            if let Some((parent, side)) = clusters[i].parent {
                let parent: &mut Plane<L> = &mut planes[parent];
                parent.children[side] = number as u32;
            }
            planes.push(plane);
            (low.parent, high.parent) = (Some((number, 0)), Some((number, 1)));
            clusters[i] = low;
            clusters.push(high);
        }
    }
    let mut cells = vec![0; sample.len()];
    for (code, cluster) in clusters.iter().enumerate() {
        cells[cluster.start..][..cluster.len].fill(code as u32);
        if let Some((plane, side)) = cluster.parent {
            planes[plane].children[side] = code_child(code as u32);
        }
    }
    Split { planes, means: clusters.into_iter().map(|cluster| cluster.mean).collect(), cells }
}

/// Cuts a cluster through its mean; `None` if rounding leaves one side empty.
fn halve<const L: usize>(range: &mut [[f32; L]], cluster: &Cluster<L>) -> Option<(Plane<L>, Cluster<L>, Cluster<L>)> {
    let mut plane = Plane { normal: cluster.normal, offset: 0.0, children: [0; 2] };
    plane.offset = plane.side(&cluster.mean);
    let mut low = 0;
    for i in 0..range.len() {
        let is_low = plane.side(&range[i]) <= 0.0;
        // With itself rather than not at all: nobody can foretell on which side the next one lies.
        range.swap(if is_low { low } else { i }, i);
        low += usize::from(is_low);
    }
    if low == 0 || low == range.len() {
        return None;
    }
    let (a, b) = range.split_at(low);
    Some((plane, analyse(a, cluster.start, None), analyse(b, cluster.start + low, None)))
}

/// Mean, distortion and principal component of a range of the sample.
fn analyse<const L: usize>(range: &[[f32; L]], start: usize, parent: Option<(usize, usize)>) -> Cluster<L> {
    let mut total = [0.0_f64; L];
    for vector in range {
        for i in 0..L {
            total[i] += f64::from(vector[i]);
        }
    }
    let mean = total.map(|v| (v / range.len().max(1) as f64) as f32);
    // Products are summed as singles over short runs, then as doubles: fast, and no precision is lost in large clusters.
    let mut covariance = [[0.0_f64; L]; L];
    for run in range.chunks(256) {
        let mut partial = [[0.0_f32; L]; L];
        for vector in run {
            let mut d = [0.0; L];
            for i in 0..L {
                d[i] = vector[i] - mean[i];
            }
            for i in 0..L {
                for j in 0..L {
                    partial[i][j] += d[i] * d[j];
                }
            }
        }
        for i in 0..L {
            for j in 0..L {
                covariance[i][j] += f64::from(partial[i][j]);
            }
        }
    }
    let trace: f64 = (0..L).map(|i| covariance[i][i]).sum();
    let identical = range.windows(2).all(|pair| pair[0] == pair[1]);
    let distortion = if identical || !trace.is_finite() { 0.0 } else { trace };
    Cluster { start, len: range.len(), mean, normal: principal_component(&covariance, trace), distortion, parent }
}

/// The eigenvector of the largest eigenvalue, by repeated squaring of the matrix: after `n` squarings the others have
/// shrunk by their ratio to the power `2^n`.
pub(crate) fn principal_component<const L: usize>(covariance: &[[f64; L]; L], trace: f64) -> [f32; L] {
    let mut matrix = *covariance;
    let mut scale = trace;
    for _ in 0..6 {
        if scale <= 0.0 || !scale.is_finite() {
            break;
        }
        matrix.iter_mut().flatten().for_each(|v| *v /= scale);
        let mut squared = [[0.0; L]; L];
        for i in 0..L {
            for (k, row) in matrix.iter().enumerate() {
                for j in 0..L {
                    squared[i][j] += matrix[i][k] * row[j];
                }
            }
        }
        matrix = squared;
        scale = (0..L).map(|i| matrix[i][i]).sum();
    }
    // Every column of the power is a multiple of the eigenvector; the one with the largest diagonal is the longest.
    let column = (0..L).max_by(|&a, &b| matrix[a][a].total_cmp(&matrix[b][b])).unwrap_or(0);
    let vector: [f64; L] = std::array::from_fn(|i| matrix[i][column]);
    let length = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() {
        vector.map(|v| (v / length) as f32)
    } else {
        std::array::from_fn(|i| if i == 0 { 1.0 } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_principal_component_of_a_line_is_its_direction() {
        let sample: Vec<[f32; 4]> = (0..100).map(|i| [3.0 * i as f32, 4.0 * i as f32, 7.0, 0.0]).collect();
        let cluster = analyse(&sample, 0, None);
        let aligned = cluster.normal[0] * 0.6 + cluster.normal[1] * 0.8;
        assert!(aligned.abs() > 0.9999, "{:?}", cluster.normal);
    }

    #[test]
    fn clusters_are_means_of_what_the_planes_separate() {
        let mut sample: Vec<[f32; 4]> = (0..1000).map(|i| [(i % 10) as f32, (i / 10 % 10) as f32, 0.0, 0.0]).collect();
        let Split { planes, means, cells } = split(&mut sample, 100, &|| ());
        assert_eq!((planes.len(), means.len()), (99, 100));
        assert!(sample.iter().zip(&cells).all(|(vector, &cell)| means[cell as usize] == *vector));
    }
}
