//! The words that name the kinds of particles in a file, and the numbers that stand for them.

use super::elements;
use std::collections::BTreeSet;

/// Kinds that are told apart; a file with more of them names particles, not kinds.
const MOST: usize = 512;

/// The words of a file, in their order.
#[derive(Clone, Debug, Default)]
pub(super) struct Labels {
    known: BTreeSet<Vec<u8>>,
    /// The word that came last: mostly that of the next row, too.
    last: Vec<u8>,
    is_too_many: bool,
}

impl Labels {
    /// Takes note of a word.
    pub(super) fn add(&mut self, word: &[u8]) {
        if self.is_too_many || (self.last == word && !word.is_empty()) {
            return;
        }
        self.last = word.to_vec();
        if !self.known.contains(word) {
            self.is_too_many = self.known.len() == MOST;
            if !self.is_too_many {
                self.known.insert(word.to_vec());
            }
        }
    }

    /// What the words are.
    pub(super) fn species(self) -> Species {
        let labels: Vec<Vec<u8>> = self.known.into_iter().collect();
        let text = |label: &Vec<u8>| String::from_utf8_lossy(label).into_owned();
        if self.is_too_many {
            return Species { labels: Vec::new(), numbers: Vec::new(), kind: SpeciesKind::Unknown };
        }
        let elements: Option<Vec<f64>> =
            labels.iter().map(|label| elements::number_of(&text(label)).map(f64::from)).collect();
        let numbers: Option<Vec<f64>> =
            labels.iter().map(|label| text(label).parse().ok().filter(|number: &f64| number.is_finite())).collect();
        let (numbers, kind) = match (elements, numbers) {
            (Some(elements), _) => (elements, SpeciesKind::Elements),
            (None, Some(numbers)) => (numbers, SpeciesKind::Numbers),
            (None, None) => ((1..=labels.len()).map(|number| number as f64).collect(), SpeciesKind::Words),
        };
        Species { labels, numbers, kind }
    }
}

/// What the words of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SpeciesKind {
    /// Symbols of elements, all of them; atomic numbers stand for them.
    Elements,
    /// Numbers, which stand for themselves.
    Numbers,
    /// Other words; their places in the alphabet stand for them.
    Words,
    /// There are too many to be kinds.
    Unknown,
}

/// The kinds of particles of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Species {
    labels: Vec<Vec<u8>>,
    numbers: Vec<f64>,
    /// What they are.
    pub kind: SpeciesKind,
}

impl Species {
    /// The number that stands for a word; NaN for one that is not known.
    pub(super) fn number(&self, label: &[u8]) -> f64 {
        let found = self.labels.binary_search_by(|known| known.as_slice().cmp(label)).ok();
        found.and_then(|at| self.numbers.get(at)).copied().unwrap_or(f64::NAN)
    }

    /// What to tell about the numbers.
    pub(super) fn note(&self) -> Option<String> {
        match self.kind {
            SpeciesKind::Words => {
                let named = self.labels.iter().zip(&self.numbers).take(12);
                let named: Vec<String> =
                    named.map(|(label, number)| format!("{number} is {}", String::from_utf8_lossy(label))).collect();
                Some(format!("species are no elements and are numbered by their names: {}", named.join(", ")))
            }
            SpeciesKind::Unknown => Some(format!("more than {MOST} names of species, so they are left out")),
            SpeciesKind::Elements | SpeciesKind::Numbers => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn species(words: &[&str]) -> Species {
        let mut labels = Labels::default();
        words.iter().for_each(|word| labels.add(word.as_bytes()));
        labels.species()
    }

    #[test]
    fn elements_have_their_numbers_and_other_words_their_place() {
        let water = species(&["O", "H", "H", "O"]);
        assert_eq!((water.kind, water.number(b"O"), water.number(b"H")), (SpeciesKind::Elements, 8.0, 1.0));
        let types = species(&["2", "1"]);
        assert_eq!((types.kind, types.number(b"2")), (SpeciesKind::Numbers, 2.0));
        let mixture = species(&["B", "A", "B"]);
        assert_eq!((mixture.kind, mixture.number(b"B"), mixture.number(b"A")), (SpeciesKind::Words, 2.0, 1.0));
        assert!(mixture.note().unwrap().ends_with("1 is A, 2 is B"));
        assert!(mixture.number(b"C").is_nan());
        let names: Vec<String> = (0..600).map(|number| format!("p{number}")).collect();
        assert_eq!(species(&names.iter().map(String::as_str).collect::<Vec<_>>()).kind, SpeciesKind::Unknown);
    }
}
