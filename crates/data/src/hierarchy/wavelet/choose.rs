//! Which directed set a node has: the one that explains most of its cells.

use super::sets::turned_directions;
use super::tables::{Table, dot};

/// What single precision makes of a difference of two explanations, of the whole.
const ROUNDING: f32 = 1e-4;
/// Directions whose sets are looked at in full.
const BEST: usize = 3;

/// The entry of the set that explains most of cells without their mean, for its points; `variation` is the weighted sum of their squares.
/// A third point must spare as much as those that the children have more.
pub(super) fn choose(table: &Table, x: &[f32], weights: &[f32], variation: f32, children: usize) -> Option<usize> {
    let n = table.cells;
    let gain = |entry: usize| -> f32 {
        let basis = &table.entries[entry].basis;
        weights
            .iter()
            .enumerate()
            .map(|(p, w)| {
                let x = &x[p * n..(p + 1) * n];
                w * basis.iter().map(|b| dot(b, x)).map(|along| along * along).sum::<f32>()
            })
            .sum()
    };
    // The best directions by their wide sets, where there are many.
    let mut ranked = [(0_usize, 0.0_f32); turned_directions(3)];
    let mut count = 0;
    for (direction, wide) in table.wide.iter().enumerate() {
        if let Some(wide) = wide {
            ranked[count] = (direction, gain(*wide));
            count += 1;
        }
    }
    let ranked = &mut ranked[..count];
    ranked.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut best: [Option<(usize, f32)>; 2] = [None, None];
    for &(direction, _) in ranked.iter().take(BEST) {
        for entry in table.of_direction[direction].clone() {
            let points = table.entries[entry].set.points;
            if points >= children {
                continue;
            }
            let gain = gain(entry);
            let best = &mut best[points - 2];
            if best.is_none_or(|(_, most)| gain > most) {
                *best = Some((entry, gain));
            }
        }
    }
    match best {
        [Some((two, less)), Some((three, more))] => {
            let left = (variation - more).max(0.0) / (children as f32 - 3.0).max(1.0);
            // Where two points explain all of it, a third spares nothing but rounding.
            let spared = more - less;
            Some(if spared >= left.min(less) && spared > ROUNDING * variation { three } else { two })
        }
        [two, three] => two.or(three).map(|(entry, _)| entry),
    }
}
