//! What is kept of the nodes of a level, as columns: values, sets, prices and errors as whole numbers that are near each other where the
//! nodes are, so that they take few bytes ([`crate::codec::samples`]).

use crate::codec::samples::{Words, decode, encode};
use crate::hierarchy::wavelet::Level;
use crate::hierarchy::wavelet::sets::{MOST, NONE, Set};

/// Steps of a price's logarithm to base 2.
const PRICE_STEPS: f32 = 8.0;
/// Steps of an error's logarithm to base 2.
const ERROR_STEPS: f32 = 4.0;
/// The price of what is refined whatever a point costs, and of what is not there.
const ALWAYS: u64 = 0xffff;
const NEVER: u64 = 0xfffe;
/// Of a node's flags: the large point blends with its neighbours, the set lies on blended points, all samples are the same.
const SOFT: u64 = 1;
const LAID: u64 = 2;
const CONSTANT: u64 = 4;
/// The logarithm that code 1 stands for.
const LEAST: f32 = -140.0;

/// How values of points are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ValueCode {
    /// As whole multiples of a step above the smallest value of the plane.
    Steps(f32),
    /// As singles.
    Singles,
}

/// The code of values of samples that are whole numbers of so many bytes.
pub fn value_code(sample_bytes: usize, is_float: bool) -> ValueCode {
    match (is_float, sample_bytes) {
        (false, 1) => ValueCode::Steps(0.25),
        (false, 2) => ValueCode::Steps(1.0),
        _ => ValueCode::Singles,
    }
}

impl ValueCode {
    fn words(self) -> Words {
        match self {
            ValueCode::Steps(_) => Words { bits: 32, is_float: false },
            ValueCode::Singles => Words { bits: 32, is_float: true },
        }
    }

    fn code(self, value: f32, low: f32) -> u64 {
        match self {
            // The cast saturates.
            ValueCode::Steps(step) => u64::from(((value - low) / step).round() as i32 as u32),
            ValueCode::Singles => value.to_bits().into(),
        }
    }

    fn value(self, code: u64, low: f32) -> f32 {
        match self {
            ValueCode::Steps(step) => low + step * code as u32 as i32 as f32,
            ValueCode::Singles => f32::from_bits(code as u32),
        }
    }

    /// The value of a point of a set, by how far it is from the node's large point where that is known to be near.
    fn code_near(self, value: f32, low: f32, near: Option<f32>) -> u64 {
        let (code, from) = (self.code(value, low), self.origin(near, low));
        u64::from((code as u32).wrapping_sub(from))
    }

    fn value_near(self, code: u64, low: f32, near: Option<f32>) -> f32 {
        self.value(u64::from((code as u32).wrapping_add(self.origin(near, low))), low)
    }

    /// The code that others are differences from.
    fn origin(self, near: Option<f32>, low: f32) -> u32 {
        match (self, near) {
            (ValueCode::Steps(_), Some(near)) => self.code(near, low) as u32,
            _ => 0,
        }
    }

    /// The value as it comes back.
    pub fn rounded(self, value: f32, low: f32) -> f32 {
        self.value(self.code(value, low), low)
    }
}

fn price_code(price: f32) -> u64 {
    match price {
        price if price < 0.0 => NEVER,
        0.0 => 0,
        f32::MAX => ALWAYS,
        price => (((price.log2() - LEAST) * PRICE_STEPS).round().max(1.0) as u64).min(NEVER - 1),
    }
}

fn price(code: u64) -> f32 {
    match code {
        NEVER => -1.0,
        0 => 0.0,
        ALWAYS => f32::MAX,
        code => (LEAST + code as f32 / PRICE_STEPS).exp2(),
    }
}

/// An error, rounded up.
fn error_code(error: f32) -> u64 {
    match error {
        error if error.is_nan() || error <= 0.0 => 0,
        error => (((error.log2() - LEAST) * ERROR_STEPS).ceil().max(1.0) as u64).min(0xffff),
    }
}

fn error(code: u64) -> f32 {
    match code {
        0 => 0.0,
        0xffff => f32::INFINITY,
        code => (LEAST + code as f32 / ERROR_STEPS).exp2(),
    }
}

/// What the columns of a part of a level are.
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a> {
    /// 2 or 3.
    pub dimensions: usize,
    /// How values are written.
    pub values: ValueCode,
    /// The smallest value of each plane.
    pub low: &'a [f32],
    /// Whether nodes may have fewer samples than their place says.
    pub has_holes: bool,
}

const SHORT: Words = Words { bits: 16, is_float: false };
const BYTE: Words = Words { bits: 8, is_float: false };
const WHOLE: Words = Words { bits: 32, is_float: false };

impl Columns<'_> {
    /// Appends the columns of some nodes of a level, which make a box of this shape, the first axis fastest.
    pub fn encode(&self, level: &Level, nodes: &[usize], shape: [usize; 3], out: &mut Vec<u8>) {
        let mut column = |words, shape, of: &dyn Fn(usize) -> u64, nodes: &[usize]| {
            encode(words, shape, &[nodes.iter().map(|node| of(*node)).collect()], out);
        };
        let flag = |is: bool, flag: u64| if is { flag } else { 0 };
        let is_constant = |node: usize| {
            let prices = [level.refine[node], level.direct[node]];
            level.set[node] == NONE && level.large_max[node] == 0.0 && prices == [0.0; 2]
        };
        let flags = |node: usize| {
            let known = flag(level.soft[node], SOFT) | flag(level.laid[node], LAID);
            known | flag(is_constant(node), CONSTANT)
        };
        column(BYTE, shape, &flags, nodes);
        if self.has_holes {
            column(WHOLE, shape, &|node| level.samples[node].into(), nodes);
        }
        for (plane, &low) in level.large.iter().zip(self.low) {
            column(self.values.words(), shape, &|node| self.values.code(plane[node], low), nodes);
        }
        // What some nodes alone have is in rows.
        let uneven: Vec<usize> = nodes.iter().copied().filter(|&node| !is_constant(node)).collect();
        if uneven.is_empty() {
            return;
        }
        let row = [uneven.len(), 1, 1];
        column(BYTE, row, &|node| level.set[node].into(), &uneven);
        column(SHORT, row, &|node| price_code(level.refine[node]), &uneven);
        column(SHORT, row, &|node| error_code(level.large_max[node]), &uneven);
        let directed: Vec<usize> = uneven.into_iter().filter(|node| level.set[*node] != NONE).collect();
        if directed.is_empty() {
            return;
        }
        let row = [directed.len(), 1, 1];
        column(SHORT, row, &|node| price_code(level.direct[node]), &directed);
        column(SHORT, row, &|node| error_code(level.set_max[node]), &directed);
        for point in 0..MOST {
            let with: Vec<usize> = directed.iter().copied().filter(|&node| self.points(level, node) > point).collect();
            if with.is_empty() {
                return;
            }
            let row = [with.len(), 1, 1];
            for ((plane, large), &low) in level.points.iter().zip(&level.large).zip(self.low) {
                let code = |node: usize| {
                    let near = (!level.laid[node]).then_some(large[node]);
                    self.values.code_near(plane[node][point], low, near)
                };
                column(self.values.words(), row, &code, &with);
            }
        }
    }

    /// Points of a node's directed set.
    fn points(&self, level: &Level, node: usize) -> usize {
        Set::points_of(self.dimensions, level.set[node]).unwrap_or(0)
    }

    /// Reads what [`Columns::encode`] has written into a level, and how many bytes that was; `None` where it makes no sense.
    pub fn decode(&self, bytes: &[u8], nodes: &[usize], shape: [usize; 3], level: &mut Level) -> Option<usize> {
        let mut at = 0;
        let mut column = |words, shape| -> Option<Vec<u64>> {
            let (mut columns, taken) = decode(words, shape, 1, bytes.get(at..)?)?;
            at += taken;
            columns.pop()
        };
        let flags = column(BYTE, shape)?;
        if flags.iter().any(|flags| *flags > (SOFT | LAID | CONSTANT)) {
            return None;
        }
        for (&node, flags) in nodes.iter().zip(&flags) {
            (level.soft[node], level.laid[node]) = (flags & SOFT != 0, flags & LAID != 0);
            (level.set[node], level.refine[node], level.direct[node], level.large_max[node]) = (NONE, 0.0, 0.0, 0.0);
        }
        if self.has_holes {
            let samples = column(WHOLE, shape)?;
            nodes.iter().zip(samples).for_each(|(&node, samples)| level.samples[node] = samples as u32);
        }
        for (plane, &low) in level.large.iter_mut().zip(self.low) {
            let values = column(self.values.words(), shape)?;
            nodes.iter().zip(values).for_each(|(&node, code)| plane[node] = self.values.value(code, low));
        }
        let uneven: Vec<usize> =
            nodes.iter().zip(flags).filter(|(_, flags)| flags & CONSTANT == 0).map(|(node, _)| *node).collect();
        if uneven.is_empty() {
            return Some(at);
        }
        let row = [uneven.len(), 1, 1];
        for (&node, code) in uneven.iter().zip(column(BYTE, row)?) {
            let set = code as u8;
            if set != NONE && Set::direction_of(self.dimensions, set).is_none() {
                return None;
            }
            level.set[node] = set;
        }
        for (&node, refine) in uneven.iter().zip(column(SHORT, row)?) {
            (level.refine[node], level.direct[node]) = (price(refine), price(refine));
        }
        for (&node, most) in uneven.iter().zip(column(SHORT, row)?) {
            level.large_max[node] = error(most);
        }
        let directed: Vec<usize> = uneven.into_iter().filter(|node| level.set[*node] != NONE).collect();
        if directed.is_empty() {
            return Some(at);
        }
        let row = [directed.len(), 1, 1];
        for (&node, direct) in directed.iter().zip(column(SHORT, row)?) {
            level.direct[node] = price(direct);
        }
        for (&node, most) in directed.iter().zip(column(SHORT, row)?) {
            level.set_max[node] = error(most);
        }
        for point in 0..MOST {
            let with: Vec<usize> = directed.iter().copied().filter(|&node| self.points(level, node) > point).collect();
            if with.is_empty() {
                break;
            }
            let row = [with.len(), 1, 1];
            for ((plane, large), &low) in level.points.iter_mut().zip(&level.large).zip(self.low) {
                for (&node, code) in with.iter().zip(column(self.values.words(), row)?) {
                    let near = (!level.laid[node]).then_some(large[node]);
                    plane[node][point] = self.values.value_near(code, low, near);
                }
            }
        }
        Some(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prices_and_errors_come_back_near(value in 1e-30f32..1e30) {
            prop_assert!((price(price_code(value)) / value).log2().abs() < 0.51 / PRICE_STEPS + 1e-4);
            let back = error(error_code(value));
            prop_assert!(back >= value * 0.99999 && back < value * 1.2);
            prop_assert!(price_code(value) >= price_code(value * 0.9));
        }
    }

    #[test]
    fn what_is_no_price_stays_none() {
        for (value, expected) in [(-1.0, -1.0), (0.0, 0.0), (f32::MAX, f32::MAX)] {
            assert_eq!(price(price_code(value)), expected);
        }
        assert_eq!((error(error_code(0.0)), error(error_code(f32::INFINITY))), (0.0, f32::INFINITY));
        let steps = value_code(1, false);
        assert!((0..=1020).all(|q| steps.rounded(0.25 * q as f32, 0.0) == 0.25 * q as f32));
    }
}
