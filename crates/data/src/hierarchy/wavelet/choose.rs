//! Which directed set a node has: the one that explains most of its cells.

use super::around::Changes;
use super::sets::turned_directions;
use super::tables::{Table, dot};

/// What single precision makes of a difference of two explanations, of the whole.
const ROUNDING: f32 = 1e-4;
/// Directions of images and of volumes whose sets are looked at in full.
const BEST: [usize; 2] = [4, 3];
/// Of sets that explain the same but for this share of the whole, the one counts along whose direction values around change more.
const TIE: f32 = 1e-3;
/// So few cells differ in three ways, two of which any turned set of three points shows: they do not tell its direction.
const FEW: usize = 4;
/// In nodes of so few cells sets are looked at along whose direction values around change at least this much of the most: less than 55 degrees
/// from the way in which a wave or an edge changes.
const LIKELY: f32 = 0.35;

/// The entry of the set that explains most of cells without their mean, for its points; with the cells is the weighted sum of their squares.
/// A third point must spare as much as those that the children have more. How values around the node change is told where it has few cells.
pub(super) fn choose(
    table: &Table,
    (x, variation): (&[f32], f32),
    weights: &[f32],
    changes: Option<&Changes>,
    children: usize,
) -> Option<usize> {
    let n = table.cells;
    let explained = |basis: &[Vec<f32>]| -> f32 {
        weights
            .iter()
            .enumerate()
            .map(|(p, w)| {
                let x = &x[p * n..(p + 1) * n];
                w * basis.iter().map(|b| dot(b, x)).map(|along| along * along).sum::<f32>()
            })
            .sum()
    };
    let is_likely = |n: usize| changes.is_none_or(|changes| table.cells > FEW || changes.along(n) >= LIKELY);
    let before = |n: usize| changes.map_or(0.0, |changes| TIE * variation * changes.along(n));
    // The best directions by what any of their sets could explain, or by their wide sets.
    let mut ranked = [(0_usize, 0.0_f32); turned_directions(3)];
    let mut count = 0;
    for (direction, span) in table.spans.iter().enumerate() {
        if !span.is_empty() && is_likely(direction) {
            ranked[count] = (direction, explained(span) + before(direction));
            count += 1;
        }
    }
    let ranked = &mut ranked[..count];
    ranked.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    // Of sets of two points and of three: the entry, what it explains, and that with what puts it before others.
    let mut best: [Option<(usize, f32, f32)>; 2] = [None, None];
    for &(direction, _) in ranked.iter().take(BEST[table.dimensions - 2]) {
        let before = before(direction);
        for entry in table.of_direction[direction].clone() {
            let points = table.entries[entry].set.points;
            if points >= children {
                continue;
            }
            let gain = explained(&table.entries[entry].basis);
            let best = &mut best[points - 2];
            if best.is_none_or(|(_, _, most)| gain + before > most) {
                *best = Some((entry, gain, gain + before));
            }
        }
    }
    match best {
        [Some((two, less, _)), Some((three, more, _))] => {
            let left = (variation - more).max(0.0) / (children as f32 - 3.0).max(1.0);
            // Where two points explain all of it, a third spares nothing but rounding.
            let spared = more - less;
            Some(if spared >= left.min(less) && spared > ROUNDING * variation { three } else { two })
        }
        [two, three] => two.or(three).map(|(entry, ..)| entry),
    }
}
