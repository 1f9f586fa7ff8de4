//! Portable float maps: a grid of points with three numbers each.

use std::path::Path;

/// Most points along a side.
const MOST: usize = 16384;

/// A grid of points, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Pfm {
    columns: usize,
    rows: usize,
    /// `columns * rows` points; the third number of maps of two is 0.
    points: Vec<[f32; 3]>,
}

impl Pfm {
    /// Reads a file.
    ///
    /// # Errors
    /// What is wrong with it, and what was expected.
    pub fn read(path: &Path) -> Result<Pfm, String> {
        let length = std::fs::metadata(path).map_err(|error| error.to_string())?.len();
        let most = (MOST * MOST * 12 + 64) as u64;
        if length > most {
            return Err(format!("{length} bytes, expected at most {most}"));
        }
        Pfm::parse(&std::fs::read(path).map_err(|error| error.to_string())?)
    }

    /// Reads a map from bytes: `PF` (three numbers a point) or `Pf` (one, which is no map of points), the sides, a scale whose sign
    /// is the byte order, then the numbers.
    ///
    /// # Errors
    /// What is wrong with it, and what was expected.
    pub fn parse(bytes: &[u8]) -> Result<Pfm, String> {
        let mut at = 0;
        let mut word = || -> Result<&str, String> {
            while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
                at += 1;
            }
            let start = at;
            while bytes.get(at).is_some_and(|byte| !byte.is_ascii_whitespace()) && at - start < 32 {
                at += 1;
            }
            // One white space ends the header's last word, numbers begin behind it.
            at += 1;
            let word = bytes.get(start..at - 1).and_then(|word| std::str::from_utf8(word).ok());
            word.filter(|word| !word.is_empty())
                .ok_or_else(|| "its header ends early, expected PF, sides and scale".into())
        };
        let kind = word()?;
        if kind != "PF" {
            return Err(format!("it begins with {kind:?}, expected PF: a portable float map of three numbers a point"));
        }
        let mut side = || -> Result<usize, String> {
            let text = word()?;
            let side = text.parse().ok().filter(|side| (2..=MOST).contains(side));
            side.ok_or_else(|| format!("a side is {text:?}, expected 2 to {MOST}"))
        };
        let (columns, rows) = (side()?, side()?);
        let scale = word()?;
        let scale: f64 = scale.parse().map_err(|_| format!("its scale is {scale:?}, expected a number"))?;
        let expected = columns * rows * 12;
        let data = bytes.get(at..).unwrap_or(&[]);
        if data.len() < expected {
            return Err(format!("{} bytes of numbers, expected {expected}: {columns} x {rows} x 3", data.len()));
        }
        let number = |four: &[u8; 4]| if scale < 0.0 { f32::from_le_bytes(*four) } else { f32::from_be_bytes(*four) };
        let numbers: Vec<f32> = data[..expected].as_chunks::<4>().0.iter().map(number).collect();
        Ok(Pfm { columns, rows, points: numbers.as_chunks::<3>().0.to_vec() })
    }

    /// The map with its rows in the other order.
    pub fn turned(self) -> Pfm {
        let rows = self.points.chunks(self.columns).rev();
        Pfm { points: rows.flatten().copied().collect(), ..self }
    }

    /// The map of other numbers.
    pub fn map(self, each: impl Fn([f32; 3]) -> [f32; 3]) -> Pfm {
        Pfm { points: self.points.into_iter().map(each).collect(), ..self }
    }

    /// Whether the second number becomes larger from row to row, on the whole.
    pub fn rises(&self) -> bool {
        let step = |(above, below): (&[f32; 3], &[f32; 3])| f64::from(below[1]) - f64::from(above[1]);
        let steps = self.points.iter().zip(&self.points[self.columns..]).map(step);
        steps.filter(|step| step.is_finite()).sum::<f64>() > 0.0
    }

    /// The map between its points, whose first and last lie on the edges: `at` is a share of the width and of the height. `None`
    /// outside and where a point beside it is no number.
    pub fn at(&self, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
        if !((0.0..=1.0).contains(&x) && (0.0..=1.0).contains(&y)) {
            return None;
        }
        let [x, y] = [x * (self.columns - 1) as f64, y * (self.rows - 1) as f64];
        let [column, row] = [(x as usize).min(self.columns - 2), (y as usize).min(self.rows - 2)];
        let [u, v] = [x - column as f64, y - row as f64];
        let point = |dx: usize, dy: usize| self.points[(row + dy) * self.columns + column + dx].map(f64::from);
        let corners = [
            (point(0, 0), (1.0 - u) * (1.0 - v)),
            (point(1, 0), u * (1.0 - v)),
            (point(0, 1), (1.0 - u) * v),
            (point(1, 1), u * v),
        ];
        let sum: [f64; 3] = std::array::from_fn(|k| corners.iter().map(|(corner, weight)| corner[k] * weight).sum());
        sum.iter().all(|number| number.is_finite()).then_some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bytes(columns: usize, rows: usize, little: bool, f: impl Fn(usize, usize) -> [f32; 3]) -> Vec<u8> {
        let mut bytes = format!("PF\n{columns} {rows}\n{}\n", if little { "-1.0" } else { "1.0" }).into_bytes();
        for row in 0..rows {
            for column in 0..columns {
                for number in f(column, row) {
                    bytes.extend(if little { number.to_le_bytes() } else { number.to_be_bytes() });
                }
            }
        }
        bytes
    }

    #[test]
    fn a_linear_map_is_itself_in_both_byte_orders() {
        for little in [true, false] {
            let map = Pfm::parse(&bytes(5, 3, little, |x, y| [x as f32 / 4.0, 2.0 * y as f32, 1.0])).unwrap();
            for at in [[0.0, 0.0], [1.0, 1.0], [0.3, 0.7], [0.999, 0.001]] {
                let [u, v, w] = map.at(at).unwrap();
                assert!((u - at[0]).abs() < 1e-6 && (v - 4.0 * at[1]).abs() < 1e-6 && w == 1.0);
            }
            assert!(map.at([1.1, 0.0]).is_none());
        }
        let holes = Pfm::parse(&bytes(3, 3, true, |x, _| [if x == 2 { f32::NAN } else { 0.5 }, 0.5, 0.0])).unwrap();
        assert!(holes.at([0.4, 0.5]).is_some() && holes.at([0.6, 0.5]).is_none());
    }

    proptest! {
        #[test]
        fn no_bytes_break_it(mut whole in Just(bytes(4, 4, true, |x, y| [x as f32, y as f32, 0.0])), at in 0..200usize, byte: u8, cut in 0..220usize) {
            whole[at] = byte;
            whole.truncate(cut);
            if let Ok(map) = Pfm::parse(&whole) {
                map.at([0.5, 0.5]);
            }
        }
    }
}
