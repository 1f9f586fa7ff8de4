//! The cut through the hierarchy of least error for a number of points.
//!
//! A node is drawn as its large point, as its directed set, or refined: then its children are. Drawn so its error is known; refined, the
//! least error for a number of points is a convex curve, the sum of its children's. A price of a point, in error, decides between
//! them: the dearer, the fewer. As the price rises a node goes once from refined to its set or large point (below [`Level::refine`] it is
//! refined) and once from its set to its large point (below [`Level::direct`] it is its set), so two numbers a node give the cut of every
//! budget, and of every price, without a search.

use super::grid::{children, factors, for_each_place, index, place, volume};
use super::sets::{NONE, Set};
use super::tree::{Hierarchy, Level};
use rayon::prelude::*;

/// A change of the best cut of a subtree at a price: so many points less, so much error more.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    price: f32,
    fewer: f64,
    error: f64,
}

/// Events of a subtree beyond which those of nearly the same price become one.
const MANY: usize = 1024;

/// Finds the prices of all nodes, from the events of the nodes below the first level; none where these are samples. Errors are the
/// variation of each level's nodes where it is given. The events of the last level's nodes.
pub(super) fn prices(hierarchy: &mut Hierarchy, variation: &[Vec<f32>], mut below: Vec<Vec<Event>>) -> Vec<Vec<Event>> {
    let d = hierarchy.dimensions;
    let mut shape = hierarchy.shape;
    for (own, level) in hierarchy.levels.iter_mut().enumerate() {
        let find = |at| {
            let node = index(level.shape, at);
            let (large, set) = match variation.get(own) {
                Some(variation) => (variation[node], variation[node]),
                None => (level.large_error[node], level.set_error[node]),
            };
            let mut events: Vec<Event> = Vec::new();
            if !below.is_empty() {
                children(d, shape, at).for_each(|child| events.extend_from_slice(&below[child]));
                events.sort_by(|a, b| a.price.total_cmp(&b.price));
            }
            let set = Set::points_of(d, level.set[node]).map(|points| (f64::from(set), points as f64));
            let prices = node_prices(&mut events, f64::from(level.samples[node]), f64::from(large), set);
            if events.len() > MANY {
                events = merged(&events);
            }
            (prices, events)
        };
        let found = for_each_place(level.shape, find);
        level.refine = found.par_iter().map(|f| f.0.0).collect();
        level.direct = found.par_iter().map(|f| f.0.1).collect();
        below = found.into_par_iter().map(|f| f.1).collect();
        shape = level.shape;
    }
    below
}

/// The prices of a node from its children's events, to which its own are added; `samples` is what it has refined for nothing.
fn node_prices(events: &mut Vec<Event>, samples: f64, large: f64, set: Option<(f64, f64)>) -> (f32, f32) {
    if samples <= 1.0 {
        // Nothing to gain: a single sample is its own large point.
        events.clear();
        return if samples < 1.0 { (-1.0, -1.0) } else { (0.0, 0.0) };
    }
    let (mut points, mut error, mut at) = (samples, 0.0_f64, 0);
    // The first price from which a node's own points are no worse.
    let (refine, own, own_points) = loop {
        let crossing = |(own, n): (f64, f64)| {
            (own <= error || points > n).then(|| ((own - error) / (points - n).max(1e-9)).max(0.0))
        };
        let options = [Some((large, 1.0)), set];
        let best = options
            .into_iter()
            .flatten()
            .filter_map(|option| crossing(option).map(|price| (price, option)))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.1.total_cmp(&b.1.1)));
        match (best, events.get(at)) {
            (Some((price, option)), next) if next.is_none_or(|next| price <= f64::from(next.price)) => {
                let reached = at.checked_sub(1).and_then(|last| events.get(last)).map_or(0.0, |e| f64::from(e.price));
                break (price.max(reached), option.0, option.1);
            }
            (_, Some(next)) => {
                points -= next.fewer;
                error += next.error;
                at += 1;
            }
            (_, None) => break (f64::MAX, large, 1.0),
        }
    };
    events.truncate(at);
    let refine = (refine as f32).min(f32::MAX);
    events.push(Event { price: refine, fewer: points - own_points, error: own - error });
    if own_points <= 1.0 {
        return (refine, refine);
    }
    let direct = (((large - own) / (own_points - 1.0)) as f32).max(refine).min(f32::MAX);
    events.push(Event { price: direct, fewer: own_points - 1.0, error: large - own });
    (refine, direct)
}

/// Fewer events: those within a two-hundredth of a price together, at their mean price.
fn merged(events: &[Event]) -> Vec<Event> {
    let mut all: Vec<Event> = Vec::new();
    let mut first = 0.0_f32;
    for event in events {
        match all.last_mut() {
            Some(last) if event.price <= first * 1.005 => {
                last.fewer += event.fewer;
                last.error += event.error;
            }
            _ => {
                first = event.price;
                all.push(*event);
            }
        }
    }
    all
}

/// How a node is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drawn {
    /// Not at all: a node above it is, or it has no samples that are numbers.
    #[default]
    Not,
    /// As its children, or its samples.
    Refined,
    /// As its large point.
    Large,
    /// As its directed set.
    Directed,
}

/// A cut: how each node of each level is drawn, and how many points that are.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// For each level its nodes.
    pub drawn: Vec<Vec<Drawn>>,
    /// Number of points.
    pub points: usize,
    /// How many of them are samples.
    pub leaves: usize,
}

impl Hierarchy {
    /// Points of a node drawn so.
    fn points_of(&self, level: &Level, node: usize, drawn: Drawn) -> usize {
        match drawn {
            Drawn::Large => 1,
            Drawn::Directed => Set::points_of(self.dimensions, level.set[node]).unwrap_or(1),
            Drawn::Not | Drawn::Refined => 0,
        }
    }

    /// The cut in which each node that is reached is drawn as `choose` says of its level (0: the finest) and index.
    pub fn cut(&self, choose: impl Fn(usize, usize) -> Drawn + Sync) -> Cut {
        let mut drawn: Vec<Vec<Drawn>> = Vec::new();
        let by = factors(self.dimensions);
        for (at, level) in self.levels.iter().enumerate().rev() {
            let above = drawn.last();
            let coarse = self.levels.get(at + 1).map_or([1; 3], |l| l.shape);
            drawn.push(for_each_place(level.shape, |place| {
                let node = index(level.shape, place);
                let parent = index(coarse, std::array::from_fn(|k| place[k] / by[k]));
                if above.is_some_and(|above| above[parent] != Drawn::Refined) || level.samples[node] == 0 {
                    return Drawn::Not;
                }
                let how = choose(at, node);
                if how == Drawn::Directed && level.set[node] == NONE { Drawn::Large } else { how }
            }));
        }
        drawn.reverse();
        let mut cut = Cut { drawn, points: 0, leaves: 0 };
        self.count(&mut cut);
        cut
    }

    /// Counts the points of a cut.
    pub(super) fn count(&self, cut: &mut Cut) {
        if self.levels.is_empty() {
            (cut.points, cut.leaves) = (volume(self.shape), volume(self.shape));
            return;
        }
        let sum = |(at, level): (usize, &Level)| -> (usize, usize) {
            cut.drawn[at]
                .par_iter()
                .enumerate()
                .map(|(node, &how)| match how {
                    Drawn::Refined if at == 0 => (level.samples[node] as usize, level.samples[node] as usize),
                    how => (self.points_of(level, node, how), 0),
                })
                .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
        };
        (cut.points, cut.leaves) = self.levels.iter().enumerate().map(sum).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    }

    /// The cut at a price of a point: the least sum of errors and price.
    pub fn cut_at_price(&self, price: f32) -> Cut {
        self.cut(|at, node| {
            let level = &self.levels[at];
            if price < level.refine[node] {
                Drawn::Refined
            } else if price < level.direct[node] {
                Drawn::Directed
            } else {
                Drawn::Large
            }
        })
    }

    /// Prices at which a cut changes, the highest first, with the number of points below each. The first is of a cut of one point.
    pub fn curve(&self) -> Vec<(f32, usize)> {
        let by = factors(self.dimensions);
        // A node is reached below the least price of those above it.
        let mut reached: Vec<f32> = Vec::new();
        let mut changes: Vec<(f32, i32)> = Vec::new();
        for (at, level) in self.levels.iter().enumerate().rev() {
            let coarse = self.levels.get(at + 1).map_or([1; 3], |l| l.shape);
            let all: Vec<(f32, [(f32, i32); 3])> = for_each_place(level.shape, |place| {
                let node = index(level.shape, place);
                let parent = index(coarse, std::array::from_fn(|k| place[k] / by[k]));
                let above = reached.get(parent).copied().unwrap_or(f32::INFINITY);
                if level.samples[node] == 0 {
                    return (-1.0, [(above, 0); 3]);
                }
                let (refine, direct) = (level.refine[node].min(above), level.direct[node].min(above));
                let set = self.points_of(level, node, Drawn::Directed) as i32;
                let own = if direct > refine { set } else { 1 };
                let below = if at == 0 { level.samples[node] as i32 } else { 0 };
                (refine, [(above, 1), (direct, own - 1), (refine, below - own)])
            });
            reached = all.par_iter().map(|(refine, _)| *refine).collect();
            changes.par_extend(
                all.into_par_iter().flat_map_iter(|(_, three)| three).filter(|&(price, n)| n != 0 && price > 0.0),
            );
        }
        changes.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let mut curve: Vec<(f32, usize)> = Vec::new();
        let mut points = 0_i64;
        for (price, n) in changes {
            points += i64::from(n);
            match curve.last_mut() {
                Some(last) if last.0 == price => last.1 = points.max(0) as usize,
                _ => curve.push((price, points.max(0) as usize)),
            }
        }
        curve
    }

    /// The best cut of at most `most` points; at least one.
    pub fn cut_of_points(&self, most: usize) -> Cut {
        self.cut_on(&self.curve(), most)
    }

    /// The same where its [`Hierarchy::curve`] is known.
    pub fn cut_on(&self, curve: &[(f32, usize)], most: usize) -> Cut {
        // The number of points may fall a little on the way down where sets give way: take the last that fits.
        let fits = curve.partition_point(|&(_, points)| points <= most);
        let Some(&(next, _)) = curve.get(fits) else {
            // More points than any price takes: what rounded values leave goes, too, where these are enough for it.
            let exact = self.exact();
            return if exact.points <= most { exact } else { self.cut_at_price(0.0) };
        };
        // At a price itself nodes are not refined yet.
        let mut cut = self.cut_at_price(next);
        self.spend(&mut cut, next, most);
        cut
    }

    /// Refines nodes that come next until `most` points are used: those of the highest price first, then by place. A node that is refined
    /// comes with all that is refined below it at its price, since what lies between may be worse than the node itself; where that is too
    /// much, with as much as fits of what is no worse.
    fn spend(&self, cut: &mut Cut, price: f32, most: usize) {
        let least = price * 0.9;
        let mut next: Vec<(f32, usize, usize)> = Vec::new();
        for (at, level) in self.levels.iter().enumerate() {
            next.par_extend(cut.drawn[at].par_iter().enumerate().filter_map(|(node, &how)| {
                let open = match how {
                    Drawn::Large | Drawn::Directed => level.refine[node].max(level.direct[node]) >= least,
                    _ => false,
                };
                open.then_some((level.refine[node], at, node))
            }));
        }
        next.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)).then(a.2.cmp(&b.2)));
        let mut left = most.saturating_sub(cut.points);
        let mut below = Vec::new();
        for (refine, at, node) in next {
            if left == 0 {
                break;
            }
            let level = &self.levels[at];
            let now = self.points_of(level, node, cut.drawn[at][node]);
            let set = self.points_of(level, node, Drawn::Directed);
            below.clear();
            let points = if refine >= least { self.below(at, node, refine, now + left, &mut below) } else { None };
            if let Some(points) = points {
                cut.drawn[at][node] = Drawn::Refined;
                below.iter().for_each(|&(at, node, how)| cut.drawn[at][node] = how);
                left = (left + now).saturating_sub(points);
            } else if cut.drawn[at][node] == Drawn::Large && set > 1 && set <= now + left {
                cut.drawn[at][node] = Drawn::Directed;
                left = (left + now).saturating_sub(set);
            }
        }
        self.count(cut);
    }

    /// How what is below a refined node is drawn at a price, and how many points that is; `None` where even its children alone are more
    /// than `most`, or are not drawn as near as the node.
    fn below(
        &self,
        at: usize,
        node: usize,
        price: f32,
        most: usize,
        all: &mut Vec<(usize, usize, Drawn)>,
    ) -> Option<usize> {
        let level = &self.levels[at];
        let Some(finer) = at.checked_sub(1) else {
            let points = level.samples[node] as usize;
            return (points <= most).then_some(points);
        };
        let nodes = &self.levels[finer];
        let first = all.len();
        let (mut points, mut most_off) = (0, 0.0_f32);
        for child in children(self.dimensions, nodes.shape, place(level.shape, node)) {
            if nodes.samples[child] == 0 {
                continue;
            }
            let is_set = nodes.set[child] != NONE && price <= nodes.direct[child];
            let how = if is_set { Drawn::Directed } else { Drawn::Large };
            most_off = most_off.max(if is_set { nodes.set_max[child] } else { nodes.large_max[child] });
            points += self.points_of(nodes, child, how);
            all.push((finer, child, how));
        }
        if points > most {
            return None;
        }
        let end = all.len();
        let is_nearer = most_off <= level.large_max[node].min(level.set_max[node]);
        for i in first..end {
            let (_, child, how) = all[i];
            if nodes.refine[child] < price {
                continue;
            }
            let own = self.points_of(nodes, child, how);
            let room = most + own - points;
            let before = all.len();
            match self.below(finer, child, price, room, all) {
                Some(more) => {
                    all[i].2 = Drawn::Refined;
                    points += more - own;
                }
                None => all.truncate(before),
            }
        }
        let is_whole = (first..end).all(|i| nodes.refine[all[i].1] < price || all[i].2 == Drawn::Refined);
        (is_whole || is_nearer).then_some(points)
    }
}
