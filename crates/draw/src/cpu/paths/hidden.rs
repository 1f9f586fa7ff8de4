//! Which parts of a picture are closed by paths that are known already, so that others need not become strokes.
//!
//! Where a pixel's fragments let less than [`HIDDEN`] through, whatever is behind the farthest of them is left out of the picture. That
//! holds whichever paths they are of: those of a few curves say of all others that are behind them that they are not seen.

use super::raster::HIDDEN;

/// Pixels along a block's side.
pub const BLOCK: usize = 8;
/// Blocks that a curve may reach and be looked up in: one that reaches more is drawn.
const MOST_BLOCKS: usize = 64;
/// What is closed by so little that another order of its fragments may leave it open is open.
const CLOSED: f32 = HIDDEN * (1.0 - 1e-4);

/// From where on the blocks of a picture are closed.
pub struct Hidden {
    across: usize,
    down: usize,
    /// Of each block the depth of the farthest fragment that is seen there; infinite where a pixel is open.
    depths: Vec<f32>,
}

impl Hidden {
    /// A picture of so many pixels in which everything is open.
    pub fn nothing(size: [usize; 2]) -> Hidden {
        let [across, down] = size.map(|pixels| pixels.div_ceil(BLOCK));
        Hidden { across, down, depths: vec![f32::INFINITY; across * down] }
    }

    /// Takes what is closed in a part of the picture: `corner` is its first pixel, on the corner of a block, and `width` its width.
    pub fn close(&mut self, corner: [usize; 2], width: usize, depths: &[f32]) {
        let across = width.div_ceil(BLOCK);
        let [left, top] = corner.map(|pixel| pixel / BLOCK);
        for (row, depths) in depths.chunks(across.max(1)).enumerate() {
            let first = (top + row) * self.across + left;
            if let Some(own) = self.depths.get_mut(first..first + depths.len()) {
                own.copy_from_slice(depths);
            }
        }
    }

    /// Whether nothing is seen of what lies between these pixels, no nearer than `depth`.
    #[inline]
    pub fn hides(&self, low: [f32; 2], high: [f32; 2], depth: f32) -> bool {
        let block = |at: f32, count: usize| (at.max(0.0) as usize / BLOCK).min(count.saturating_sub(1));
        let (left, right) = (block(low[0], self.across), block(high[0], self.across));
        let (top, bottom) = (block(low[1], self.down), block(high[1], self.down));
        if left > right || top > bottom || (right - left + 1) * (bottom - top + 1) > MOST_BLOCKS {
            return false;
        }
        (top..=bottom).all(|row| {
            let row = row * self.across;
            self.depths.get(row + left..=row + right).is_some_and(|own| own.iter().all(|closed| depth > *closed))
        })
    }
}

/// The depths from where on the blocks of a part of a picture are closed, row by row: of its pixels, `width` in a row, how much they let
/// through, and their farthest fragments.
pub fn closed_blocks(width: usize, through: &[f32], behind: &[f32]) -> Vec<f32> {
    let across = width.div_ceil(BLOCK).max(1);
    let rows = through.chunks(width.max(1)).zip(behind.chunks(width.max(1)));
    let mut out = Vec::new();
    for (y, (through, behind)) in rows.enumerate() {
        if y % BLOCK == 0 {
            out.resize(out.len() + across, f32::NEG_INFINITY);
        }
        let first = out.len() - across;
        let blocks = through.chunks(BLOCK).zip(behind.chunks(BLOCK));
        for (own, (through, behind)) in out[first..].iter_mut().zip(blocks) {
            let depth = |(through, behind): (&f32, &f32)| if *through < CLOSED { *behind } else { f32::INFINITY };
            *own = through.iter().zip(behind).map(depth).fold(*own, f32::max);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_behind_closed_blocks_alone_is_hidden() {
        // Twenty by ten pixels, all closed at the depth 5 but the one at (17, 9), and the one at (9, 2) at 7.
        let (mut through, mut behind) = (vec![0.0; 200], vec![5.0; 200]);
        through[9 * 20 + 17] = 0.5;
        behind[2 * 20 + 9] = 7.0;
        let depths = closed_blocks(20, &through, &behind);
        assert_eq!(depths, [5.0, 7.0, 5.0, 5.0, 5.0, f32::INFINITY]);
        let mut hidden = Hidden::nothing([84, 74]);
        hidden.close([64, 64], 20, &depths);
        assert!(hidden.hides([65.0, 65.0], [70.0, 73.0], 5.1));
        assert!(!hidden.hides([65.0, 65.0], [70.0, 73.0], 5.0), "as deep as what is seen");
        assert!(!hidden.hides([65.0, 65.0], [72.0, 66.0], 6.0), "beside a farther one");
        assert!(hidden.hides([65.0, 65.0], [79.9, 66.0], 7.5));
        assert!(!hidden.hides([65.0, 65.0], [85.0, 80.0], 100.0), "in an open block");
        assert!(!hidden.hides([60.0, 65.0], [70.0, 66.0], 100.0), "beyond what is known");
        assert!(hidden.hides([75.0, 65.0], [1e9, 66.0], 100.0), "where the picture ends");
        assert!(!hidden.hides([f32::NAN; 2], [f32::NAN; 2], 100.0));
    }
}
