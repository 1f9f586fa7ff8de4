//! A Fourier transform of squares and cubes with powers of two as edges, the same to the last bit on every machine: scalar
//! arithmetic in a fixed order, with roots of unity from `libm` rather than from the platform.

use rayon::prelude::*;
use std::f64::consts::PI;

/// Lines that are transformed together, side by side.
const LANES: usize = 16;

/// Which way to transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// With `exp(-i k x)`.
    Forward,
    /// With `exp(+i k x)`.
    Inverse,
}

/// A cube of complex numbers, index `(z * size + y) * size + x`, in single precision.
pub struct ComplexCube {
    size: usize,
    /// Real parts.
    pub re: Vec<f32>,
    /// Imaginary parts.
    pub im: Vec<f32>,
}

/// The part of a table of work that one task has: lines side by side.
struct Lines {
    re: Vec<[f32; LANES]>,
    im: Vec<[f32; LANES]>,
}

/// What transforms of lines of a length need.
struct Plan {
    roots: Vec<[f32; 2]>,
    reversed: Vec<usize>,
}

impl Plan {
    fn new(size: usize, direction: Direction) -> Plan {
        let sign = if direction == Direction::Forward { -1.0 } else { 1.0 };
        let root = |k: usize| {
            let angle = 2.0 * PI * k as f64 / size as f64;
            [libm::cos(angle) as f32, (sign * libm::sin(angle)) as f32]
        };
        let bits = size.trailing_zeros();
        let reversed = (0..size).map(|i| i.reverse_bits() >> (usize::BITS - bits)).collect();
        Plan { roots: (0..size / 2).map(root).collect(), reversed }
    }

    fn lines(&self) -> Lines {
        let size = self.reversed.len();
        Lines { re: vec![[0.0; LANES]; size], im: vec![[0.0; LANES]; size] }
    }

    /// Transforms one slab: along its rows, then across them.
    fn slab(&self, lines: &mut Lines, re: &mut [f32], im: &mut [f32]) {
        let size = self.reversed.len();
        if !along_rows(re, im, lines, &self.roots, &self.reversed) {
            return;
        }
        let (mut re, mut im): (Vec<_>, Vec<_>) = (re.chunks_mut(size).collect(), im.chunks_mut(size).collect());
        across_rows(&mut re, &mut im, lines, &self.roots, &self.reversed);
    }
}

/// Transforms of squares or cubes of one size, many of them, each by one thread; neither direction divides by the number of cells.
pub struct BoxTransform {
    forward: Plan,
    inverse: Plan,
}

impl BoxTransform {
    /// For boxes with an edge of `size`, a power of two of at least 16.
    ///
    /// # Panics
    /// When `size` is anything else.
    pub fn new(size: usize) -> BoxTransform {
        assert!(size.is_power_of_two() && size >= LANES, "an edge of {size}");
        BoxTransform { forward: Plan::new(size, Direction::Forward), inverse: Plan::new(size, Direction::Inverse) }
    }

    /// Transforms a square or a cube in place.
    pub fn apply(&self, direction: Direction, re: &mut [f32], im: &mut [f32]) {
        let plan = if direction == Direction::Forward { &self.forward } else { &self.inverse };
        let size = plan.reversed.len();
        let slab = size * size;
        let mut lines = plan.lines();
        for (re, im) in re.chunks_exact_mut(slab).zip(im.chunks_exact_mut(slab)) {
            plan.slab(&mut lines, re, im);
        }
        if re.len() > slab {
            let (mut re, mut im): (Vec<_>, Vec<_>) = (re.chunks_mut(slab).collect(), im.chunks_mut(slab).collect());
            across_rows(&mut re, &mut im, &mut lines, &plan.roots, &plan.reversed);
        }
    }
}

impl ComplexCube {
    /// A cube of zeros; `size` is a power of two of at least 16.
    ///
    /// # Panics
    /// When `size` is anything else.
    pub fn new(size: usize) -> ComplexCube {
        assert!(size.is_power_of_two() && size >= LANES, "an edge of {size}");
        let cells = size * size * size;
        ComplexCube { size, re: vec![0.0; cells], im: vec![0.0; cells] }
    }

    /// Transforms in place; neither direction divides by the number of cells.
    pub fn transform(&mut self, direction: Direction) {
        let size = self.size;
        let plan = Plan::new(size, direction);
        let slab = size * size;
        let slabs = self.re.par_chunks_mut(slab).zip(self.im.par_chunks_mut(slab));
        slabs.for_each_init(|| plan.lines(), |lines, (re, im)| plan.slab(lines, re, im));
        // Rows of equal y, one of each slab, belong together.
        let mut by_y: Vec<(Vec<&mut [f32]>, Vec<&mut [f32]>)> =
            (0..size).map(|_| (Vec::with_capacity(size), Vec::with_capacity(size))).collect();
        for (index, (re, im)) in self.re.chunks_mut(size).zip(self.im.chunks_mut(size)).enumerate() {
            let rows = &mut by_y[index % size];
            rows.0.push(re);
            rows.1.push(im);
        }
        by_y.par_iter_mut()
            .for_each_init(|| plan.lines(), |lines, (re, im)| across_rows(re, im, lines, &plan.roots, &plan.reversed));
    }
}

/// Whether all of some rows are zeros without a sign: their transform is what they are, to the last bit.
fn are_zeros(rows: &[f32]) -> bool {
    rows.chunks(LANES).all(|some| some.iter().fold(0_u32, |bits, value| bits | value.to_bits()) == 0)
}

/// Transforms along the rows of one slab; false where there is nothing in it. Filters leave many rows of zeros: those take no time.
fn along_rows(re: &mut [f32], im: &mut [f32], lines: &mut Lines, roots: &[[f32; 2]], reversed: &[usize]) -> bool {
    let size = reversed.len();
    let mut is_any = false;
    for (re, im) in re.chunks_mut(size * LANES).zip(im.chunks_mut(size * LANES)) {
        if are_zeros(re) && are_zeros(im) {
            continue;
        }
        is_any = true;
        for lane in 0..LANES {
            for (x, &to) in reversed.iter().enumerate() {
                lines.re[to][lane] = re[lane * size + x];
                lines.im[to][lane] = im[lane * size + x];
            }
        }
        butterflies(&mut lines.re, &mut lines.im, roots);
        for lane in 0..LANES {
            for x in 0..size {
                re[lane * size + x] = lines.re[x][lane];
                im[lane * size + x] = lines.im[x][lane];
            }
        }
    }
    is_any
}

/// Transforms along the index of the rows, whose length is a multiple of the lanes.
fn across_rows(
    re: &mut [&mut [f32]],
    im: &mut [&mut [f32]],
    lines: &mut Lines,
    roots: &[[f32; 2]],
    reversed: &[usize],
) {
    let length = re.first().map_or(0, |row| row.len());
    for first in (0..length).step_by(LANES) {
        for (row, &to) in reversed.iter().enumerate() {
            lines.re[to].copy_from_slice(&re[row][first..first + LANES]);
            lines.im[to].copy_from_slice(&im[row][first..first + LANES]);
        }
        butterflies(&mut lines.re, &mut lines.im, roots);
        for row in 0..reversed.len() {
            re[row][first..first + LANES].copy_from_slice(&lines.re[row]);
            im[row][first..first + LANES].copy_from_slice(&lines.im[row]);
        }
    }
}

/// The transform of lines whose elements stand in bit-reversed order (decimation in time, radix 2).
fn butterflies(re: &mut [[f32; LANES]], im: &mut [[f32; LANES]], roots: &[[f32; 2]]) {
    let size = re.len();
    let mut half = 1;
    while half < size {
        let stride = size / (2 * half);
        for (re, im) in re.chunks_exact_mut(2 * half).zip(im.chunks_exact_mut(2 * half)) {
            let ((re_low, re_high), (im_low, im_high)) = (re.split_at_mut(half), im.split_at_mut(half));
            let low = re_low.iter_mut().zip(im_low);
            let high = re_high.iter_mut().zip(im_high);
            for (((ar, ai), (br, bi)), [cos, sin]) in low.zip(high).zip(roots.iter().step_by(stride)) {
                for lane in 0..LANES {
                    let turned = [br[lane] * cos - bi[lane] * sin, br[lane] * sin + bi[lane] * cos];
                    br[lane] = ar[lane] - turned[0];
                    bi[lane] = ai[lane] - turned[1];
                    ar[lane] += turned[0];
                    ai[lane] += turned[1];
                }
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::random::Random;

    #[test]
    fn a_wave_becomes_one_mode_and_back() {
        let size = 16;
        let mut cube = ComplexCube::new(size);
        let (kx, ky, kz) = (3, 14, 5);
        for z in 0..size {
            for y in 0..size {
                for x in 0..size {
                    let phase = 2.0 * PI * (kx * x + ky * y + kz * z) as f64 / size as f64;
                    let at = (z * size + y) * size + x;
                    (cube.re[at], cube.im[at]) = (phase.cos() as f32, phase.sin() as f32);
                }
            }
        }
        cube.transform(Direction::Forward);
        for (at, value) in cube.re.iter().enumerate() {
            let expected = if at == (kz * size + ky) * size + kx { 4096.0 } else { 0.0 };
            assert!((value - expected).abs() < 2e-3, "{at}: {value}");
        }
        cube.transform(Direction::Inverse);
        assert!((cube.re[0] / 4096.0 - 1.0).abs() < 1e-5);
    }

    #[test]
    fn boxes_are_transformed_as_cubes_are() {
        let size = 16;
        let mut cube = ComplexCube::new(size);
        let mut random = Random::new(1, 2);
        cube.re.iter_mut().for_each(|value| *value = random.signed() as f32);
        let (mut re, mut im) = (cube.re.clone(), cube.im.clone());
        cube.transform(Direction::Forward);
        let transform = BoxTransform::new(size);
        transform.apply(Direction::Forward, &mut re, &mut im);
        assert!(re == cube.re && im == cube.im);
        // A square that is constant along y has the transform of its rows there, and nothing else.
        let mut re: Vec<f32> = (0..size * size).map(|i| if i % size == 3 { 1.0 } else { 0.0 }).collect();
        let mut im = vec![0.0; size * size];
        transform.apply(Direction::Forward, &mut re, &mut im);
        assert!(re[..size].iter().zip(&im).all(|(re, im)| (re.hypot(*im) - 16.0).abs() < 1e-4));
        assert!(re[size..].iter().chain(&im[size..]).all(|value| value.abs() < 1e-4));
    }

    #[test]
    fn zeros_that_are_passed_by_change_no_bit() {
        for direction in [Direction::Forward, Direction::Inverse] {
            let plan = Plan::new(64, direction);
            let mut lines = plan.lines();
            butterflies(&mut lines.re, &mut lines.im, &plan.roots);
            assert!(lines.re.iter().chain(&lines.im).flatten().all(|value| value.to_bits() == 0));
        }
        assert!(are_zeros(&[0.0; 40]) && !are_zeros(&[-0.0; 40]));
        // An impulse amid zeros, of either part, holds all frequencies alike.
        let size = 32;
        let transform = BoxTransform::new(size);
        for at in [[0, 0, 0], [3, 17, 5], [31, 15, 31]] {
            for is_imaginary in [false, true] {
                let (mut re, mut im) = (vec![0.0_f32; size * size * size], vec![0.0_f32; size * size * size]);
                let own = if is_imaginary { &mut im } else { &mut re };
                own[(at[2] * size + at[1]) * size + at[0]] = 1.0;
                transform.apply(Direction::Inverse, &mut re, &mut im);
                for (cell, (re, im)) in re.iter().zip(&im).enumerate() {
                    let k = [cell % size, cell / size % size, cell / (size * size)];
                    let turns = (0..3).map(|axis| k[axis] * at[axis]).sum::<usize>() as f64 / size as f64;
                    let (sin, cos) = (2.0 * PI * turns).sin_cos();
                    let expected = if is_imaginary { [-sin, cos] } else { [cos, sin] };
                    let off = [f64::from(*re) - expected[0], f64::from(*im) - expected[1]];
                    assert!(off.iter().all(|off| off.abs() < 1e-5), "{at:?}, {k:?}: {off:?}");
                }
            }
        }
    }

    #[test]
    fn there_and_back_and_energy() {
        let size = 32;
        let mut cube = ComplexCube::new(size);
        let mut random = Random::new(1, 1);
        cube.re.iter_mut().chain(&mut cube.im).for_each(|value| *value = random.signed() as f32);
        let before = (cube.re.clone(), cube.im.clone());
        let energy = |cube: &ComplexCube| cube.re.iter().chain(&cube.im).map(|x| f64::from(x * x)).sum::<f64>();
        let first = energy(&cube);
        cube.transform(Direction::Forward);
        let cells = (size * size * size) as f64;
        assert!((energy(&cube) / cells / first - 1.0).abs() < 1e-5);
        cube.transform(Direction::Inverse);
        for (now, was) in cube.re.iter().zip(&before.0).chain(cube.im.iter().zip(&before.1)) {
            assert!((now / cells as f32 - was).abs() < 1e-5);
        }
    }
}
