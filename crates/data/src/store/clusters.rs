//! The clusters of a node of a page file (HE03): all of them, or what is left of them where the later splits are undone.

use super::content::{ClusterUnions, Content, Particles, Representative};
use super::metadata::{AttributeMerge, ClusterBook};
use super::page::Frame;
use crate::codec::clusters::{NO_CLASS, PackedClusters, cluster_limit, step_clusters};
use crate::codec::{Codebook, CodebookScope, QuantityError};
use crate::hierarchy::pca::members::{DiameterRule, attribute_of_shares, attribute_share, published_diameter};
use crate::hierarchy::pca::{Step, bright, steps::runs};
use crate::model::{Covariance, Kernel, Placement};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// A node's clusters as they are stored, where a placement puts them.
#[derive(Debug)]
pub(super) struct NodeClusters {
    frame: Frame,
    packed: PackedClusters,
    codes: Vec<u16>,
    book: Arc<ClusterBook>,
    rules: Arc<[AttributeMerge]>,
    kernel: Kernel,
    placement: Placement,
    steps: Vec<Step>,
    /// Sums over larger groups, from which those over still larger ones are made.
    coarse: OnceLock<Coarse>,
}

/// One group in so many clusters, at least, has its sums kept: for five to six bytes a cluster, and half a byte for each attribute.
const COARSE: u32 = 16;

/// The groups that are left where most splits are undone, with their sums.
#[derive(Debug)]
struct Coarse {
    /// Where each begins, and where the last one ends.
    starts: Vec<usize>,
    /// The classes of the splits between them.
    ranks: Vec<u8>,
    sums: Vec<Sum>,
    /// For each attribute what each group adds to that of several.
    shares: Vec<Vec<f64>>,
}

/// Groups of clusters with their sums, and for each attribute their values.
struct Groups {
    ranges: Vec<Range<usize>>,
    sums: Vec<Sum>,
    attributes: Vec<Vec<f32>>,
}

/// What is summed of clusters that become one; lengths in cells.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    mass: f64,
    presence: f64,
    along: [f64; 3],
    squares: [f64; 6],
}

/// The pairs of axes of second moments.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl NodeClusters {
    /// The clusters of a node in a cell, which a placement has put where it is; codes are valid in the book, shapes too.
    ///
    /// # Errors
    /// What was expected of codes of shapes.
    pub fn new(
        frame: Frame,
        packed: PackedClusters,
        codes: Vec<u16>,
        about: (&Arc<ClusterBook>, Arc<[AttributeMerge]>, Kernel),
        placement: &Placement,
    ) -> Result<NodeClusters, String> {
        let (book, rules, kernel) = about;
        let entries = book.moments.len();
        if let Some(code) = packed.shapes.iter().find(|&&code| usize::from(code) >= entries) {
            return Err(format!("shapes below {entries}, found {code}"));
        }
        let count = packed.len() as u32;
        let area = frame.size * frame.size;
        // Those of the paper's rule come with sizes of the paper, and are not told apart by brightness.
        let priority = match packed.published {
            None => placement.mass * bright(placement.mass, placement.scale * placement.scale),
            Some(_) => placement.mass,
        };
        let step = |(number, step): (usize, &crate::codec::clusters::StoredStep)| Step {
            clusters: step_clusters(number, count),
            priority: f64::from(step.priority) * priority,
            scale: f64::from(step.scale) * area,
            misfit: f64::from(step.misfit) * placement.mass,
            largest: f64::from(step.largest) * area,
        };
        let steps = packed.steps.iter().enumerate().map(step).collect();
        let book = Arc::clone(book);
        let coarse = OnceLock::new();
        Ok(NodeClusters { frame, packed, codes, book, rules, kernel, placement: *placement, steps, coarse })
    }

    /// A cluster alone.
    fn one(&self, i: usize) -> Sum {
        let packed = &self.packed;
        let mass = packed.masses.0.value(packed.masses.1[i]);
        let size = packed.sizes.0.value(packed.sizes.1[i]);
        let place = packed.place(i);
        let shape = &self.book.moments[usize::from(packed.shapes[i])];
        let square = |(k, (a, b)): (usize, (usize, usize))| mass * (shape[k] * size * size + place[a] * place[b]);
        let mut squares = [0.0; 6];
        PAIRS.into_iter().enumerate().for_each(|pair| squares[pair.0] = square(pair));
        Sum { mass, presence: self.presence(i, mass), along: place.map(|x| mass * x), squares }
    }

    fn presence(&self, i: usize, mass: f64) -> f64 {
        mass * f64::from(self.book.values.density[usize::from(self.codes[i])])
    }

    /// The sums over groups of clusters, and what they have as attributes.
    fn groups(&self, ranges: Vec<Range<usize>>) -> Groups {
        let sums: Vec<Sum> = ranges.iter().map(|group| group.clone().map(|i| self.one(i)).sum()).collect();
        let attribute = |(rule, column): (&AttributeMerge, &Vec<f32>)| {
            let value = |(group, sum): (&Range<usize>, &Sum)| match group.len() {
                1 => column[usize::from(self.codes[group.start])],
                _ => attribute_of_shares(*rule, self.shares(*rule, column, group), sum.mass),
            };
            ranges.iter().zip(&sums).map(value).collect()
        };
        let attributes = self.rules.iter().zip(&self.book.values.attributes).map(attribute).collect();
        Groups { ranges, sums, attributes }
    }

    /// What the clusters of a group add to an attribute of several.
    fn shares(&self, rule: AttributeMerge, column: &[f32], group: &Range<usize>) -> f64 {
        let share = |i: usize| {
            let mass = self.packed.masses.0.value(self.packed.masses.1[i]);
            attribute_share(rule, mass, column[usize::from(self.codes[i])])
        };
        group.clone().map(share).sum()
    }

    /// The groups that splits of a class below `limit` part: of many clusters, which lie in few groups, by the sums that are kept.
    fn parted(&self, limit: u16) -> Groups {
        let coarse = cluster_limit(Some(self.packed.len() as u32 / COARSE), self.packed.len() as u32);
        if limit > coarse {
            return self.groups(runs(&self.packed.ranks, |class| u16::from(*class) < limit).collect());
        }
        let coarse = self.coarse.get_or_init(|| self.coarse(coarse));
        let parts: Vec<Range<usize>> = runs(&coarse.ranks, |class| u16::from(*class) < limit).collect();
        let sums: Vec<Sum> = parts.iter().map(|part| coarse.sums[part.clone()].iter().copied().sum()).collect();
        let ranges: Vec<Range<usize>> =
            parts.iter().map(|part| coarse.starts[part.start]..coarse.starts[part.end]).collect();
        let attribute = |((rule, shares), column): ((&AttributeMerge, &Vec<f64>), &Vec<f32>)| {
            let value = |((part, group), sum): ((&Range<usize>, &Range<usize>), &Sum)| match group.len() {
                1 => column[usize::from(self.codes[group.start])],
                _ => attribute_of_shares(*rule, shares[part.clone()].iter().sum(), sum.mass),
            };
            parts.iter().zip(&ranges).zip(&sums).map(value).collect()
        };
        let columns = self.rules.iter().zip(&coarse.shares).zip(&self.book.values.attributes);
        Groups { attributes: columns.map(attribute).collect(), ranges, sums }
    }

    /// The groups that splits of a class below `limit` part, with their sums.
    fn coarse(&self, limit: u16) -> Coarse {
        let ranges: Vec<Range<usize>> = runs(&self.packed.ranks, |class| u16::from(*class) < limit).collect();
        let shares = |(rule, column): (&AttributeMerge, &Vec<f32>)| {
            ranges.iter().map(|group| self.shares(*rule, column, group)).collect()
        };
        Coarse {
            starts: ranges.iter().map(|group| group.start).chain([self.packed.len()]).collect(),
            ranks: ranges.iter().skip(1).map(|group| self.packed.ranks[group.start - 1]).collect(),
            sums: ranges.iter().map(|group| group.clone().map(|i| self.one(i)).sum()).collect(),
            shares: self.rules.iter().zip(&self.book.values.attributes).map(shares).collect(),
        }
    }

    /// What stands for groups of clusters, one after the other.
    fn represented(&self, groups: Groups, representative: Representative) -> Particles {
        let count = groups.ranges.len();
        let mut out = Codebook {
            scope: CodebookScope::Clusters,
            particles: count as u64,
            mass: Vec::with_capacity(count),
            density: Vec::with_capacity(count),
            smoothing_length: Vec::with_capacity(count),
            attributes: groups.attributes,
            errors: vec![QuantityError::default(); 3 + self.rules.len()],
        };
        let (mut positions, mut covariances) = (Vec::with_capacity(count), Vec::new());
        for (group, sum) in groups.ranges.iter().zip(&groups.sums) {
            let middle = sum.along.map(|x| x / sum.mass);
            positions.push(std::array::from_fn(|k| self.frame.min[k] + self.frame.size * middle[k]));
            let area = self.frame.size * self.frame.size;
            let moments =
                |(k, (a, b)): (usize, (usize, usize))| area * (sum.squares[k] / sum.mass - middle[a] * middle[b]);
            let mut covariance = [0.0; 6];
            PAIRS.into_iter().enumerate().for_each(|pair| covariance[pair.0] = moments(pair));
            let variance = (covariance[0] + covariance[1] + covariance[2]) / 3.0;
            if representative == Representative::Ellipsoid {
                covariances.push(Covariance(covariance.map(|value| value as f32)));
            }
            out.mass.push((sum.mass * self.placement.mass) as f32);
            out.density.push(self.placement.placed_density((sum.presence / sum.mass) as f32));
            let h = match (&self.packed.published, representative) {
                (Some((ladder, steps)), Representative::Published) => {
                    let away = |place: [f64; 3]| (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum::<f64>().sqrt();
                    let one = |i: usize| (ladder.value(steps[i]), away(self.packed.place(i)));
                    0.5 * self.frame.size * published_diameter(group.clone().map(one), DiameterRule::Averaged)
                }
                _ => (variance.max(0.0) / self.kernel.variance()).sqrt(),
            };
            out.smoothing_length.push(h as f32);
        }
        Particles { positions, values: out, covariances }
    }
}

impl std::iter::Sum for Sum {
    fn sum<I: Iterator<Item = Sum>>(sums: I) -> Sum {
        sums.fold(Sum::default(), |mut whole, one| {
            whole.mass += one.mass;
            whole.presence += one.presence;
            whole.along.iter_mut().zip(one.along).for_each(|(sum, x)| *sum += x);
            whole.squares.iter_mut().zip(one.squares).for_each(|(sum, x)| *sum += x);
            whole
        })
    }
}

/// The groups of clusters that some number of splits leaves together, by the classes of the splits.
#[derive(Debug, Default, PartialEq)]
struct Unions {
    groups: Vec<Range<usize>>,
    from: Vec<u16>,
    to: Vec<u16>,
}

impl Unions {
    /// All there are, in the order in which they come to be.
    fn of(classes: &[u8]) -> Unions {
        let mut found = Vec::new();
        let mut open = vec![(0..classes.len() + 1, 0_u16)];
        while let Some((group, from)) = open.pop() {
            let inner = &classes[group.start..group.end - 1];
            let next = inner.iter().min();
            if let Some(next) = next {
                // What comes next parts them wherever it stands.
                let parts = runs(inner, |class| class == next);
                let start = group.start;
                open.extend(parts.map(|part| (start + part.start..start + part.end, u16::from(*next) + 1)));
            }
            found.push((from, next.map_or(NO_CLASS, |class| u16::from(*class)), group));
        }
        found.sort_by_key(|(from, ..)| *from);
        let mut unions = Unions::default();
        for (from, to, group) in found {
            unions.groups.push(group);
            unions.from.push(from);
            unions.to.push(to);
        }
        unions
    }
}

impl Content for NodeClusters {
    fn particles(&self, _time: f64) -> Cow<'_, Particles> {
        let each = (0..self.packed.len()).map(|i| i..i + 1).collect();
        Cow::Owned(self.represented(self.groups(each), Representative::default()))
    }

    fn clusters(&self, count: Option<u32>, representative: Representative) -> Option<Particles> {
        let limit = cluster_limit(count, self.packed.len() as u32);
        Some(self.represented(self.parted(limit), representative))
    }

    fn cluster_unions(&self, representative: Representative) -> Option<ClusterUnions> {
        let unions = Unions::of(&self.packed.ranks);
        let clusters = self.represented(self.groups(unions.groups), representative);
        Some(ClusterUnions { clusters, from: unions.from, to: unions.to })
    }

    fn steps(&self) -> &[Step] {
        &self.steps
    }

    fn memory(&self) -> u64 {
        // Beside what the page table tells of, which is counted with its page.
        let coarse = self.packed.len() / COARSE as usize * (size_of::<Sum>() + 16 + 8 * self.rules.len());
        (size_of::<NodeClusters>() + self.steps.len() * size_of::<Step>() + coarse) as u64
    }
}
