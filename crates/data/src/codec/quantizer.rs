//! The quantiser's space: code words, the splitting planes that lead near them, and the search for the nearest one.

use super::pca_split::{self, Plane, Split};
use crate::lanes::in_lanes;
use crate::model::portable::{Portable, portable};

/// Nearest code words that each code word knows; the search walks along them.
const NEIGHBOURS: usize = 8;
/// Bound on the walk: it ends at a local minimum long before.
const LONGEST_WALK: usize = 16;
/// Vectors that are coded in step with each other: while one waits for its next plane or word, there is work for the others.
const TOGETHER: usize = 32;
/// A place in the tree of planes: another plane, or (high bit) a code word.
const CODE: u32 = 1 << 31;

/// A trained quantiser of vectors with `L` coordinates (unused ones are zero).
pub struct Quantizer<const L: usize> {
    planes: Vec<Plane<L>>,
    words: Vec<[f32; L]>,
    neighbours: Vec<[Neighbour; NEIGHBOURS]>,
    around: Vec<Around<L>>,
}

/// A code word near another one, and a quarter of their squared distance: a vector nearer to the one than half their
/// distance cannot be nearer to the other.
#[derive(Clone, Copy)]
struct Neighbour {
    code: u32,
    quarter: f32,
}

portable!(Neighbour { code, quarter });

/// The neighbours of a code word for SIMD lanes.
struct Around<const L: usize> {
    quarters: [f32; NEIGHBOURS],
    codes: [u32; NEIGHBOURS],
    /// Coordinates of their words, by axis.
    words: [[f32; NEIGHBOURS]; L],
}

impl<const L: usize> Portable for Quantizer<L> {
    fn put(&self, to: &mut Vec<u8>) {
        self.planes.put(to);
        self.words.put(to);
        self.neighbours.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Quantizer<L>> {
        let (planes, (words, neighbours)) = Portable::take(from)?;
        let mut quantizer = Quantizer { planes, words, neighbours, around: Vec::new() };
        let Quantizer { planes, words, neighbours, .. } = &quantizer;
        let is_word = |code: u32| (code as usize) < words.len();
        // Planes lead to later ones, so that every way ends.
        let is_below = |number: usize, child: u32| match child & CODE {
            0 => child as usize > number && (child as usize) < planes.len(),
            _ => is_word(child & !CODE),
        };
        let are_planes =
            planes.iter().zip(0..).all(|(plane, number)| plane.children.iter().all(|&c| is_below(number, c)));
        let are_words = neighbours.iter().flatten().all(|neighbour| is_word(neighbour.code));
        if words.is_empty() || neighbours.len() != words.len() || !are_planes || !are_words {
            return None;
        }
        quantizer.look_around();
        Some(quantizer)
    }
}

/// When LBG stops (F12 3.4).
#[derive(Clone, Copy, Debug)]
pub struct LbgLimits {
    /// Largest number of iterations.
    pub k_max: usize,
    /// Smallest relative improvement of the distortion that is worth another one.
    pub epsilon: f64,
}

impl<const L: usize> Quantizer<L> {
    /// Trains at most `entries` code words on `sample`: PCA splits (F12 3.3), then LBG (F12 3.4). With at most `entries`
    /// distinct vectors in the sample each of them is a code word. The order of `sample` is lost. `go_on` is called every few
    /// milliseconds, from any thread, and may unwind.
    pub fn train(
        sample: &mut [[f32; L]],
        entries: usize,
        limits: LbgLimits,
        go_on: &(dyn Fn() + Sync),
    ) -> Quantizer<L> {
        let (mut quantizer, cells) = Quantizer::start(sample, entries, go_on);
        let mut previous = f64::INFINITY;
        for _ in 0..limits.k_max {
            let (distortion, means) = quantizer.assign_sample(sample, &cells, go_on);
            quantizer.words = means;
            quantizer.measure_neighbours();
            quantizer.look_around();
            if distortion == 0.0 || (previous - distortion) / distortion < limits.epsilon {
                break;
            }
            previous = distortion;
        }
        quantizer
    }

    /// What LBG begins with, and the cell of each vector of the sample: planes stay where they are when words move.
    fn start(sample: &mut [[f32; L]], entries: usize, go_on: &(dyn Fn() + Sync)) -> (Quantizer<L>, Vec<u32>) {
        let Split { planes, means, cells } = pca_split::split(sample, entries, go_on);
        let mut quantizer = Quantizer { planes, words: means, neighbours: Vec::new(), around: Vec::new() };
        quantizer.find_neighbours(go_on);
        quantizer.look_around();
        (quantizer, cells)
    }

    /// The code words.
    pub fn words(&self) -> &[[f32; L]] {
        &self.words
    }

    /// Number of code words.
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Whether there is no code word.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The codes of vectors, as many of them as there is room in `codes`: of each the code of the cell that it falls into, or of
    /// a nearer word among the neighbours. This finds the nearest word nearly always, and never one farther away than the cell's own.
    pub fn codes(&self, vectors: &[[f32; L]], codes: &mut [u32]) {
        in_lanes!({
            let mut distances = [0.0; TOGETHER];
            for (vectors, codes) in vectors.chunks(TOGETHER).zip(codes.chunks_mut(TOGETHER)) {
                self.descend(vectors, codes);
                self.walk(vectors, codes, &mut distances);
            }
        });
    }

    /// The cells that at most [`TOGETHER`] vectors fall into.
    #[inline(always)]
    fn descend(&self, vectors: &[[f32; L]], codes: &mut [u32]) {
        codes.fill(if self.planes.is_empty() { CODE } else { 0 });
        let last = self.planes.len().saturating_sub(1);
        let mut arrived = self.planes.is_empty();
        while !arrived {
            let mut all = CODE;
            for (vector, at) in vectors.iter().zip(&mut *codes) {
                // One that has arrived looks at some plane and stays.
                let plane = &self.planes[((*at & !CODE) as usize).min(last)];
                let next = plane.children[usize::from(plane.side(vector) > 0.0)];
                *at = if *at & CODE != 0 { *at } else { next };
                all &= *at;
            }
            arrived = all != 0;
        }
        codes.iter_mut().for_each(|code| *code &= !CODE);
    }

    /// Walks from the cells of at most [`TOGETHER`] vectors to the nearest words, to which `best` are the squared distances then.
    #[inline(always)]
    fn walk(&self, vectors: &[[f32; L]], codes: &mut [u32], best: &mut [f32; TOGETHER]) {
        let mut walking = [0_u32; TOGETHER];
        let mut count = vectors.len().min(codes.len()).min(TOGETHER);
        for (i, (vector, &code)) in vectors.iter().zip(&*codes).enumerate().take(count) {
            best[i] = distance(vector, &self.words[code as usize]);
            walking[i] = i as u32;
        }
        for _ in 0..LONGEST_WALK {
            let mut going_on = 0;
            for walker in 0..count {
                let i = walking[walker] as usize;
                let around = &self.around[codes[i] as usize];
                let (nearest, distance) = around.nearest(&vectors[i], best[i]);
                let is_nearer = distance < best[i];
                codes[i] = if is_nearer { around.codes[nearest] } else { codes[i] };
                best[i] = if is_nearer { distance } else { best[i] };
                walking[going_on] = i as u32;
                going_on += usize::from(is_nearer);
            }
            count = going_on;
            if count == 0 {
                break;
            }
        }
    }

    /// Mean squared distance of the sample, whose cells these are, to its code words, and the mean of each word's vectors.
    fn assign_sample(&self, sample: &[[f32; L]], cells: &[u32], go_on: &(dyn Fn() + Sync)) -> (f64, Vec<[f32; L]>) {
        use rayon::prelude::*;
        // The number of parts is fixed, so that sums do not depend on the number of threads.
        let part = sample.len().div_ceil(8).max(1);
        let parts: Vec<_> = sample
            .par_chunks(part)
            .zip(cells.par_chunks(part))
            .map(|(vectors, cells)| {
                go_on();
                in_lanes!(self.assign(vectors, cells))
            })
            .collect();
        let total: f64 = parts.iter().map(|(total, _)| total).sum();
        let means = (0..self.words.len())
            .map(|code| {
                let mut sum = [0.0; L];
                let mut count = 0;
                for (_, sums) in &parts {
                    sum.iter_mut().zip(sums[code].0).for_each(|(sum, v)| *sum += v);
                    count += sums[code].1;
                }
                // A word that lost all its vectors stays where it is.
                if count == 0 { self.words[code] } else { sum.map(|v| (v / f64::from(count)) as f32) }
            })
            .collect();
        (total / sample.len().max(1) as f64, means)
    }

    /// The work of [`Quantizer::assign_sample`] on a part of the sample: the sum of squared distances, and for each code word the sum of its
    /// vectors and their number.
    #[inline(always)]
    fn assign(&self, vectors: &[[f32; L]], cells: &[u32]) -> (f64, Vec<([f64; L], u32)>) {
        let mut sums = vec![([0.0_f64; L], 0_u32); self.words.len()];
        let mut total = 0.0;
        let (mut codes, mut distances) = ([0; TOGETHER], [0.0; TOGETHER]);
        for (vectors, cells) in vectors.chunks(TOGETHER).zip(cells.chunks(TOGETHER)) {
            let codes = &mut codes[..cells.len()];
            codes.copy_from_slice(cells);
            self.walk(vectors, codes, &mut distances);
            for ((vector, &code), &distance) in vectors.iter().zip(&*codes).zip(&distances) {
                total += f64::from(distance);
                let (sum, count) = &mut sums[code as usize];
                sum.iter_mut().zip(vector).for_each(|(sum, &v)| *sum += f64::from(v));
                *count += 1;
            }
        }
        (total, sums)
    }

    /// Finds the words nearest to each word. The words are the means of their cells here, so a plane that is farther
    /// away than the farthest neighbour known hides nothing nearer.
    fn find_neighbours(&mut self, go_on: &(dyn Fn() + Sync)) {
        use rayon::prelude::*;
        let this = &*self;
        let found = (0..this.words.len() as u32)
            .into_par_iter()
            .map(|own| {
                go_on();
                let mut nearest = [(f32::INFINITY, own); NEIGHBOURS];
                if !this.planes.is_empty() {
                    this.search(0, own, &mut nearest);
                }
                nearest.map(|(distance, code)| Neighbour { code, quarter: 0.25 * distance })
            })
            .collect();
        self.neighbours = found;
    }

    /// Measures the distances to the neighbours again after the words have moved, and sorts them.
    fn measure_neighbours(&mut self) {
        let words = &self.words;
        for (own, neighbours) in self.neighbours.iter_mut().enumerate() {
            for neighbour in neighbours.iter_mut().filter(|neighbour| neighbour.code as usize != own) {
                neighbour.quarter = 0.25 * distance(&words[own], &words[neighbour.code as usize]);
            }
            neighbours.sort_by(|a, b| a.quarter.total_cmp(&b.quarter));
        }
    }

    /// Brings the neighbours together with their words.
    fn look_around(&mut self) {
        let words = &self.words;
        let around = self.neighbours.iter().map(|neighbours| Around {
            quarters: neighbours.map(|neighbour| neighbour.quarter),
            codes: neighbours.map(|neighbour| neighbour.code),
            words: std::array::from_fn(|axis| neighbours.map(|neighbour| words[neighbour.code as usize][axis])),
        });
        self.around = around.collect();
    }

    fn search(&self, at: u32, own: u32, nearest: &mut [(f32, u32); NEIGHBOURS]) {
        let vector = &self.words[own as usize];
        if at & CODE != 0 {
            let code = at & !CODE;
            let found = (distance(vector, &self.words[code as usize]), code);
            if code != own && found.0 < nearest[NEIGHBOURS - 1].0 {
                nearest[NEIGHBOURS - 1] = found;
                // Insertion into the sorted list.
                for i in (1..NEIGHBOURS).rev() {
                    if nearest[i].0 < nearest[i - 1].0 {
                        nearest.swap(i, i - 1);
                    }
                }
            }
            return;
        }
        let plane = &self.planes[at as usize];
        let side = plane.side(vector);
        let near = usize::from(side > 0.0);
        self.search(plane.children[near], own, nearest);
        // The normals have unit length, so `side` is the distance to the plane.
        if side * side < nearest[NEIGHBOURS - 1].0 {
            self.search(plane.children[1 - near], own, nearest);
        }
    }
}

impl<const L: usize> Around<L> {
    /// The nearest neighbour of those that may be nearer than `own`, the first one of equals, and its distance; infinite if
    /// there is none. All distances are squares.
    #[inline(always)]
    fn nearest(&self, vector: &[f32; L], own: f32) -> (usize, f32) {
        let mut squares = [[0.0_f32; NEIGHBOURS]; L];
        for ((squares, words), &at) in squares.iter_mut().zip(&self.words).zip(vector) {
            for (square, &word) in squares.iter_mut().zip(words) {
                *square = (at - word) * (at - word);
            }
        }
        // The order of [`pca_split::sum`].
        let mut len = L;
        while len > 1 {
            len /= 2;
            let (sums, others) = squares.split_at_mut(len);
            for (sums, others) in sums.iter_mut().zip(others) {
                sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += *other);
            }
        }
        // Distances are not negative, so that they are in the order of their bits.
        let mut keys = [0_u64; NEIGHBOURS];
        for (((i, key), &quarter), &square) in (0..).zip(&mut keys).zip(&self.quarters).zip(&squares[0]) {
            let distance = if quarter < own { square } else { f32::INFINITY };
            *key = u64::from(distance.to_bits()) << 32 | i;
        }
        let mut len = NEIGHBOURS;
        while len > 1 {
            len /= 2;
            let (least, others) = keys.split_at_mut(len);
            least.iter_mut().zip(others).for_each(|(least, other)| *least = (*least).min(*other));
        }
        (keys[0] as usize % NEIGHBOURS, f32::from_bits((keys[0] >> 32) as u32))
    }
}

/// Marks a code word as a child of a plane.
pub(super) fn code_child(code: u32) -> u32 {
    code | CODE
}

#[inline(always)]
fn distance<const L: usize>(a: &[f32; L], b: &[f32; L]) -> f32 {
    let mut sum = [0.0; L];
    for i in 0..L {
        let d = a[i] - b[i];
        sum[i] = d * d;
    }
    pca_split::sum(&sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: LbgLimits = LbgLimits { k_max: 6, epsilon: 1e-3 };

    fn vectors(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[f32; 4]>> {
        prop::collection::vec(prop::array::uniform4(-10.0..10.0_f32), count)
    }

    impl<const L: usize> Quantizer<L> {
        /// One code, looked for in the plain way.
        fn code(&self, vector: &[f32; L]) -> u32 {
            let mut at = if self.planes.is_empty() { CODE } else { 0 };
            while at & CODE == 0 {
                let plane = &self.planes[at as usize];
                at = plane.children[usize::from(plane.side(vector) > 0.0)];
            }
            let mut code = at & !CODE;
            let mut best = distance(vector, &self.words[code as usize]);
            for _ in 0..LONGEST_WALK {
                let (from, own) = (code, best);
                // Nearest first, so that the first one out of reach ends the search.
                for neighbour in self.neighbours[from as usize].iter().take_while(|neighbour| neighbour.quarter < own) {
                    let d = distance(vector, &self.words[neighbour.code as usize]);
                    if d < best {
                        (best, code) = (d, neighbour.code);
                    }
                }
                if code == from {
                    break;
                }
            }
            code
        }
    }

    fn coded<const L: usize>(quantizer: &Quantizer<L>, vectors: &[[f32; L]]) -> Vec<u32> {
        let mut codes = vec![0; vectors.len()];
        quantizer.codes(vectors, &mut codes);
        codes
    }

    proptest! {
        #[test]
        fn few_distinct_vectors_are_words(distinct in vectors(1..16), picks in prop::collection::vec(0..16_usize, 1..200)) {
            let mut sample: Vec<_> = picks.iter().map(|pick| distinct[pick % distinct.len()]).collect();
            let quantizer = Quantizer::train(&mut sample, 16, LIMITS, &|| ());
            for (vector, code) in sample.iter().zip(coded(&quantizer, &sample)) {
                prop_assert_eq!(&quantizer.words[code as usize], vector);
            }
        }

        #[test]
        fn many_together_are_coded_like_each_alone(sample in vectors(1..400), entries in 1..64_usize) {
            let quantizer = Quantizer::train(&mut sample.clone(), entries, LIMITS, &|| ());
            let alone: Vec<u32> = sample.iter().map(|vector| quantizer.code(vector)).collect();
            prop_assert_eq!(coded(&quantizer, &sample), alone);
            let wide: Vec<[f32; 8]> = sample.windows(2).map(|pair| std::array::from_fn(|i| pair[i / 4][i % 4])).collect();
            let quantizer = Quantizer::train(&mut wide.clone(), entries, LIMITS, &|| ());
            let alone: Vec<u32> = wide.iter().map(|vector| quantizer.code(vector)).collect();
            prop_assert_eq!(coded(&quantizer, &wide), alone);
        }

        /// A sample's cells are those that planes lead to, whatever lies on a plane, and words get what is coded as theirs.
        #[test]
        fn samples_are_assigned_as_they_are_coded(sample in vectors(1..400), entries in 1..64_usize, is_whole: bool) {
            let place = |v: f32| if is_whole { (0.2 * v).round() } else { v };
            let mut sample: Vec<[f32; 4]> = sample.into_iter().map(|vector| vector.map(place)).collect();
            let (quantizer, cells) = Quantizer::start(&mut sample, entries, &|| ());
            let mut found = vec![0; sample.len()];
            for (vectors, cells) in sample.chunks(TOGETHER).zip(found.chunks_mut(TOGETHER)) {
                quantizer.descend(vectors, cells);
            }
            prop_assert_eq!(&cells, &found);
            let (distortion, means) = quantizer.assign_sample(&sample, &cells, &|| ());
            let codes = coded(&quantizer, &sample);
            let squares = |part: usize| {
                let own = part * sample.len().div_ceil(8)..sample.len().min((part + 1) * sample.len().div_ceil(8));
                own.map(|i| f64::from(distance(&sample[i], &quantizer.words[codes[i] as usize]))).sum::<f64>()
            };
            let total: f64 = (0..sample.len().div_ceil(sample.len().div_ceil(8))).map(squares).sum();
            prop_assert_eq!(distortion, total / sample.len() as f64);
            for (code, (mean, word)) in means.iter().zip(&quantizer.words).enumerate() {
                let own: Vec<&[f32; 4]> =
                    sample.iter().zip(&codes).filter(|(_, own)| **own as usize == code).map(|(vector, _)| vector).collect();
                for axis in 0..4 {
                    let sum: f64 = own.iter().map(|vector| f64::from(vector[axis])).sum();
                    let expected = if own.is_empty() { word[axis] } else { (sum / own.len() as f64) as f32 };
                    prop_assert!((mean[axis] - expected).abs() <= 1e-5, "{} {}", mean[axis], expected);
                }
            }
        }

        #[test]
        fn codes_are_nearly_nearest(sample in vectors(100..600)) {
            let quantizer = Quantizer::train(&mut sample.clone(), 32, LIMITS, &|| ());
            prop_assert!(quantizer.len() <= 32);
            let (mut found, mut nearest) = (0.0, 0.0);
            for (vector, code) in sample.iter().zip(coded(&quantizer, &sample)) {
                found += distance(vector, &quantizer.words[code as usize]);
                nearest += quantizer.words.iter().map(|word| distance(vector, word)).fold(f32::INFINITY, f32::min);
            }
            // About 1 in 10 000 random samples exceeds 1.035; of some 200 000 one has exceeded 1.05.
            prop_assert!(found <= 1.1 * nearest, "{} against {}", found, nearest);
        }

        #[test]
        fn lbg_never_makes_it_worse(sample in vectors(50..300)) {
            let distortion = |k_max| {
                let quantizer = Quantizer::train(&mut sample.clone(), 16, LbgLimits { k_max, epsilon: 0.0 }, &|| ());
                let codes = coded(&quantizer, &sample);
                let own = |(vector, code): (&[f32; 4], u32)| f64::from(distance(vector, &quantizer.words[code as usize]));
                sample.iter().zip(codes).map(own).sum::<f64>()
            };
            prop_assert!(distortion(5) <= distortion(0) * 1.02);
        }
    }
}
