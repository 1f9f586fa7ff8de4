//! The rows of a level while a field goes by from its first row to its last.

use super::coarse::{self, Below, Row};
use super::compact::Compact;
use super::lattice::Lattice;
use super::sums::{self, Sums};
use crate::codec::values::Values;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Rows of a level: those that are made and still needed, and sums of the next ones.
#[derive(Debug)]
pub struct LevelRows {
    lattice: Lattice,
    level: u32,
    planes: usize,
    first: u64,
    made: VecDeque<Row>,
    sums: VecDeque<Sums>,
}

impl LevelRows {
    /// Of a level from 1 on.
    pub fn new(lattice: Lattice, level: u32, planes: usize) -> LevelRows {
        LevelRows { lattice, level, planes, first: 0, made: VecDeque::new(), sums: VecDeque::new() }
    }

    /// The number of rows that are made: the first one that is not.
    pub fn made(&self) -> u64 {
        self.first + self.made.len() as u64
    }

    /// A row that is made and still kept.
    pub fn get(&self, row: u64) -> Option<&Row> {
        self.made.get(usize::try_from(row.checked_sub(self.first)?).ok()?)
    }

    /// Adds what a leaf says of rows and columns from a place on.
    pub fn add(&mut self, [row, column]: [u64; 2], sums: &Sums) {
        let (planes, width) = (self.planes, self.lattice.samples_of(self.level)[1] as usize);
        let Some(skipped) = row.checked_sub(self.made()) else { return };
        while self.sums.len() < skipped as usize + sums.rows() {
            self.sums.push_back(Sums::new(1, width, planes));
        }
        let column = column as usize;
        for (number, own) in self.sums.iter_mut().skip(skipped as usize).take(sums.rows()).enumerate() {
            let part = number * sums.columns..(number + 1) * sums.columns;
            sums::add_row(&mut own.sums[column..column + sums.columns], &sums.sums[part.clone()]);
            let light = &sums.light[part.start * planes..part.end * planes];
            sums::add_light(&mut own.light[column * planes..][..light.len()], light);
        }
    }

    /// Makes the rows before `end`, of which all sums are known. `below` gives rows of the level below.
    pub fn make<'a>(&mut self, end: u64, values: Values, below: impl Fn(u64) -> Option<&'a Compact> + Sync) {
        let (lattice, level, planes, start) = (self.lattice, self.level, self.planes, self.made());
        let sums = &self.sums;
        let make = |row: u64| {
            let own = coarse::stand_in(&lattice, 0, level, row);
            let own = own.checked_sub(start).and_then(|at| sums.get(at as usize));
            let at = lattice.below(0, level, row);
            let heights = [at.checked_sub(1).and_then(&below), below(at), below(at + 1)];
            let below = Below { lattice, level, row, values, heights };
            let sum = |column: usize| own.and_then(|own| own.sums.get(column)).copied().unwrap_or_default().into();
            let light = |column: usize, plane: usize| {
                let light = own.and_then(|own| own.light.get(column * planes + plane));
                light.map_or([0.0; 2], |light| light.map(|light| light as f64))
            };
            coarse::row(&below, planes, sum, light)
        };
        let made: Vec<Row> = (start..end).into_par_iter().map(make).collect();
        self.sums.drain(..made.len().min(self.sums.len()));
        self.made.extend(made);
    }

    /// Forgets rows before this one.
    pub fn forget(&mut self, row: u64) {
        while self.first < row && self.made.pop_front().is_some() {
            self.first += 1;
        }
    }
}
