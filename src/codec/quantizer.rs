//! The quantiser's space: code words, the splitting planes that lead near them, and the search for the nearest one.

use super::pca_split::{self, Plane};

/// Nearest code words that each code word knows; the search walks along them.
const NEIGHBOURS: usize = 8;
/// Bound on the walk: it ends at a local minimum long before.
const LONGEST_WALK: usize = 16;
/// A place in the tree of planes: another plane, or (high bit) a code word.
const CODE: u32 = 1 << 31;

/// A trained quantiser of vectors with `L` coordinates (unused ones are zero).
pub struct Quantizer<const L: usize> {
    planes: Vec<Plane<L>>,
    words: Vec<[f32; L]>,
    neighbours: Vec<[Neighbour; NEIGHBOURS]>,
}

/// A code word near another one, and a quarter of their squared distance: a vector nearer to the one than half their
/// distance cannot be nearer to the other.
#[derive(Clone, Copy)]
struct Neighbour {
    code: u32,
    quarter: f32,
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
    /// distinct vectors in the sample each of them is a code word. The order of `sample` is lost.
    pub fn train(sample: &mut [[f32; L]], entries: usize, limits: LbgLimits) -> Quantizer<L> {
        let (planes, words) = pca_split::split(sample, entries);
        let mut quantizer = Quantizer { planes, words, neighbours: Vec::new() };
        quantizer.find_neighbours();
        let mut previous = f64::INFINITY;
        for _ in 0..limits.k_max {
            let (distortion, means) = quantizer.assign_sample(sample);
            quantizer.words = means;
            quantizer.measure_neighbours();
            if distortion == 0.0 || (previous - distortion) / distortion < limits.epsilon {
                break;
            }
            previous = distortion;
        }
        quantizer
    }

    /// Number of code words.
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Whether there is no code word.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The code of `vector`: that of the cell it falls into or of a nearer word among the neighbours. This finds the
    /// nearest word nearly always, and never one farther away than the cell's own.
    #[inline]
    pub fn code(&self, vector: &[f32; L]) -> u32 {
        let mut code = self.descend(vector);
        let mut best = distance(vector, &self.words[code as usize]);
        for _ in 0..LONGEST_WALK {
            let from = code;
            let own = best;
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

    #[inline]
    fn descend(&self, vector: &[f32; L]) -> u32 {
        if self.planes.is_empty() {
            return 0;
        }
        let mut at = 0;
        loop {
            let plane = &self.planes[at as usize];
            let next = plane.children[usize::from(plane.side(vector) > 0.0)];
            if next & CODE != 0 {
                return next & !CODE;
            }
            at = next;
        }
    }

    /// Mean squared distance of the sample to its code words, and the mean of each word's vectors.
    fn assign_sample(&self, sample: &[[f32; L]]) -> (f64, Vec<[f32; L]>) {
        use rayon::prelude::*;
        // The number of parts is fixed, so that sums do not depend on the number of threads.
        let part = sample.len().div_ceil(8).max(1);
        let parts: Vec<_> = sample
            .par_chunks(part)
            .map(|vectors| {
                let mut sums = vec![([0.0_f64; L], 0_u32); self.words.len()];
                let mut total = 0.0;
                for vector in vectors {
                    let code = self.code(vector) as usize;
                    total += f64::from(distance(vector, &self.words[code]));
                    let (sum, count) = &mut sums[code];
                    sum.iter_mut().zip(vector).for_each(|(sum, &v)| *sum += f64::from(v));
                    *count += 1;
                }
                (total, sums)
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

    /// Finds the words nearest to each word. The words are the means of their cells here, so a plane that is farther
    /// away than the farthest neighbour known hides nothing nearer.
    fn find_neighbours(&mut self) {
        use rayon::prelude::*;
        let this = &*self;
        let found = (0..this.words.len() as u32)
            .into_par_iter()
            .map(|own| {
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

/// Marks a code word as a child of a plane.
pub(super) fn code_child(code: u32) -> u32 {
    code | CODE
}

#[inline]
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

    proptest! {
        #[test]
        fn few_distinct_vectors_are_words(distinct in vectors(1..16), picks in prop::collection::vec(0..16_usize, 1..200)) {
            let mut sample: Vec<_> = picks.iter().map(|pick| distinct[pick % distinct.len()]).collect();
            let quantizer = Quantizer::train(&mut sample, 16, LIMITS);
            for vector in &sample {
                prop_assert_eq!(&quantizer.words[quantizer.code(vector) as usize], vector);
            }
        }

        #[test]
        fn codes_are_nearly_nearest(sample in vectors(100..600)) {
            let quantizer = Quantizer::train(&mut sample.clone(), 32, LIMITS);
            prop_assert!(quantizer.len() <= 32);
            let (mut found, mut nearest) = (0.0, 0.0);
            for vector in &sample {
                found += distance(vector, &quantizer.words[quantizer.code(vector) as usize]);
                nearest += quantizer.words.iter().map(|word| distance(vector, word)).fold(f32::INFINITY, f32::min);
            }
            // About 1 in 10 000 random samples exceeds 1.035; of some 200 000 one has exceeded 1.05.
            prop_assert!(found <= 1.1 * nearest, "{} against {}", found, nearest);
        }

        #[test]
        fn lbg_never_makes_it_worse(sample in vectors(50..300)) {
            let distortion = |k_max| {
                let quantizer = Quantizer::train(&mut sample.clone(), 16, LbgLimits { k_max, epsilon: 0.0 });
                quantizer.assign_sample(&sample).0
            };
            prop_assert!(distortion(5) <= distortion(0) * 1.02);
        }
    }
}
