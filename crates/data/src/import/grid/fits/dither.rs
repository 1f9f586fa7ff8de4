//! The noise that was added to floats before they were rounded (section 10.2 of the standard), to be taken away again.

/// Random numbers, the same in every file.
pub(super) struct Dither {
    numbers: Vec<f64>,
    /// Where the first tile begins among them.
    seed: u64,
    /// Whether zeros were kept by a step of their own.
    keeps_zeros: bool,
}

/// How many numbers there are.
const COUNT: usize = 10_000;

/// The step of zeros.
const ZERO: i32 = -2_147_483_646;

impl Dither {
    /// The noise that a header names, where it is one.
    pub(super) fn of(method: &str, seed: i64) -> Option<Dither> {
        let keeps_zeros = match method {
            "SUBTRACTIVE_DITHER_1" => false,
            "SUBTRACTIVE_DITHER_2" => true,
            _ => return None,
        };
        let mut state: u64 = 1;
        let next = |_| {
            state = state * 16807 % 2_147_483_647;
            state as f64 / 2_147_483_647.0
        };
        let numbers = (0..COUNT).map(next).collect();
        Some(Dither { numbers, seed: u64::try_from(seed - 1).unwrap_or_default() % COUNT as u64, keeps_zeros })
    }

    /// Whether a step stands for zero.
    pub(super) fn is_zero(&self, step: i32) -> bool {
        self.keeps_zeros && step == ZERO
    }

    /// The noise of a tile, counted from 0.
    pub(super) fn of_tile(&self, number: u64) -> Noise<'_> {
        let row = ((number % COUNT as u64 + self.seed) % COUNT as u64) as usize;
        Noise { numbers: &self.numbers, row, at: start(self.numbers[row]) }
    }
}

/// Where among the numbers one begins that has this one.
fn start(number: f64) -> usize {
    (number * 500.0) as usize
}

/// The noise of a tile.
pub(super) struct Noise<'a> {
    numbers: &'a [f64],
    row: usize,
    at: usize,
}

impl Noise<'_> {
    /// The next number, from 0 to 1.
    pub(super) fn next(&mut self) -> f64 {
        let number = self.numbers[self.at];
        self.at += 1;
        if self.at == COUNT {
            self.row = (self.row + 1) % COUNT;
            self.at = start(self.numbers[self.row]);
        }
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_of_the_standard() {
        let dither = Dither::of("SUBTRACTIVE_DITHER_1", 1).unwrap();
        // The standard states the last one before it is scaled.
        assert_eq!((dither.numbers[COUNT - 1] * 2_147_483_647.0).round(), 1_043_618_065.0);
        assert!(Dither::of("NO_DITHER", 1).is_none());
        let mut noise = dither.of_tile(3);
        assert!((0..30_000).all(|_| (0.0..1.0).contains(&noise.next())));
    }
}
