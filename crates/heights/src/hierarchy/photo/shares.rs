//! How much of each pixel of a photo lies on T, while the field's rows of cells go by.

use crate::model::{HeightGrid, PhotoAbout};
use std::collections::VecDeque;

/// Shares from here on are all.
const ALL: f64 = 1.0 - 1e-6;

/// Of a row of pixels how much lies on T, in 255ths. Nothing: all of them do.
pub type RowShares = Option<Vec<u8>>;

/// Shares of rows of pixels that the field has begun with.
#[derive(Debug)]
pub struct Shares {
    /// Edges of rows of pixels: the first one, and how tall each is, in rows of cells.
    top: f64,
    tall: f64,
    rows: u64,
    /// Where pixels of a row begin and end among the columns of cells, for each copy of the photo that lies over the field.
    left: f64,
    wide: f64,
    copies: Vec<f64>,
    cells: usize,
    /// How much of each column of pixels lies over the field.
    inside: Vec<f32>,
    is_inside: bool,
    /// The first row whose shares were not taken yet, and what is known of it and those after it.
    first: u64,
    pending: VecDeque<RowSum>,
}

/// What is known of a row of pixels.
#[derive(Clone, Debug, Default)]
struct RowSum {
    /// The part of it that lies on rows of cells that T has all of.
    whole: f64,
    /// Of each pixel what lies on T in others; empty where there are none.
    others: Vec<f32>,
}

impl Shares {
    /// Of a photo over a field.
    pub fn new(photo: &PhotoAbout, grid: &HeightGrid) -> Shares {
        let [rows, columns] = photo.size;
        let place = photo.place;
        let part = |[from, to]: [f64; 2], count: u64| (from, (to - from) / count as f64);
        let ((top, tall), (left, wide)) = (part(place.rows, rows), part(place.columns, columns));
        let cells = grid.columns - 1;
        let copies = match place.period(grid) {
            None => vec![0.0],
            Some(period) => {
                let first = (-place.columns[1] / period).ceil();
                (0..)
                    .map(|number| (first + f64::from(number)) * period)
                    .take_while(|ahead| place.columns[0] + ahead < cells as f64)
                    .collect()
            }
        };
        let mut shares = Shares {
            top,
            tall,
            rows,
            left,
            wide,
            copies,
            cells: cells as usize,
            inside: Vec::new(),
            is_inside: false,
            first: 0,
            pending: VecDeque::new(),
        };
        let inside: Vec<f32> = shares.over(columns as usize, |at| at).collect();
        shares.is_inside = inside.iter().all(|share| f64::from(*share) >= ALL);
        shares.inside = inside;
        shares
    }

    /// How much of each column of pixels lies on T, where `before` says how much of T is to the left of a place in a row of cells.
    fn over(&self, columns: usize, before: impl Fn(f64) -> f64) -> impl Iterator<Item = f32> {
        let cells = self.cells as f64;
        (0..columns).map(move |column| {
            let from = (column as f64).mul_add(self.wide, self.left);
            let share = |ahead: &f64| {
                let [from, to] = [from, from + self.wide].map(|edge| (edge + ahead).clamp(0.0, cells));
                before(to) - before(from)
            };
            (self.copies.iter().map(share).sum::<f64>() / self.wide).min(1.0) as f32
        })
    }

    /// Adds a row of cells, the next one: of each cell how many halves are T; nothing where all are.
    pub fn add(&mut self, row: u64, halves: Option<&[u8]>) {
        let (top, bottom) = (row as f64, (row + 1) as f64);
        let at = |edge: f64| ((edge - self.top) / self.tall).max(0.0);
        let first = (at(top) as u64).max(self.first);
        let end = (at(bottom).ceil() as u64).min(self.rows);
        let others: Option<Vec<f32>> = halves.filter(|_| first < end).map(|halves| {
            let mut sums = Vec::with_capacity(halves.len() + 1);
            let mut sum = 0_u32;
            sums.push(0.0);
            for half in halves {
                sum += u32::from(*half);
                sums.push(f64::from(sum) * 0.5);
            }
            let before = |place: f64| {
                let cell = (place as usize).min(sums.len().saturating_sub(2));
                (place - cell as f64).mul_add(sums[cell + 1] - sums[cell], sums[cell])
            };
            self.over(self.inside.len(), before).collect()
        });
        for number in first..end {
            let index = (number - self.first) as usize;
            if self.pending.len() <= index {
                self.pending.resize_with(index + 1, RowSum::default);
            }
            let upper = (number as f64).mul_add(self.tall, self.top);
            let part = ((upper + self.tall).min(bottom) - upper.max(top)).max(0.0) / self.tall;
            let own = &mut self.pending[index];
            match &others {
                None => own.whole += part,
                Some(others) => {
                    own.others.resize(others.len(), 0.0);
                    own.others.iter_mut().zip(others).for_each(|(own, other)| *own += part as f32 * other);
                }
            }
        }
    }

    /// Takes the next row of pixels of which all is known, where all rows of cells before `row` were added; `is_last`: these are all.
    pub fn next(&mut self, row: u64, is_last: bool) -> Option<RowShares> {
        let bottom = ((self.first + 1) as f64).mul_add(self.tall, self.top);
        if self.first >= self.rows || !is_last && bottom > row as f64 {
            return None;
        }
        self.first += 1;
        let RowSum { whole, others } = self.pending.pop_front().unwrap_or_default();
        if others.is_empty() && self.is_inside && whole >= ALL {
            return Some(None);
        }
        let share = |(column, inside): (usize, &f32)| {
            let share = whole.mul_add(f64::from(*inside), others.get(column).copied().unwrap_or(0.0).into());
            match share {
                0.0 => 0,
                most if most >= ALL => u8::MAX,
                some => (255.0 * some).round().clamp(1.0, 254.0) as u8,
            }
        };
        Some(Some(self.inside.iter().enumerate().map(share).collect()))
    }
}
