//! Levels nest, end at the field's border, and what samples stand for is the field.

use super::*;
use proptest::prelude::*;

proptest! {
    #[test]
    fn levels_nest_and_samples_stand_for_the_field(rows in 2_u64..200, columns in 2_u64..200, side_bits in 1_u32..4) {
        let lattice = Lattice { samples: [rows, columns], side_bits, is_closed: false };
        for axis in 0..2 {
            for level in 0..lattice.levels() {
                let count = lattice.samples_of(level)[axis];
                let places: Vec<u64> = (0..count).map(|index| lattice.place(axis, level, index)).collect();
                prop_assert!(places.windows(2).all(|pair| pair[0] < pair[1]));
                prop_assert_eq!((places[0], places[count as usize - 1]), (0, lattice.samples[axis] - 1));
                if level == 0 {
                    continue;
                }
                let mut end = 0;
                for index in 0..count {
                    let below = lattice.below(axis, level, index);
                    prop_assert_eq!(lattice.place(axis, level - 1, below), places[index as usize]);
                    let [first, last] = lattice.stands_for(axis, level, index);
                    prop_assert_eq!(first, end);
                    prop_assert!(last > first || index + 1 == count);
                    end = last;
                }
                prop_assert_eq!(end, lattice.samples[axis] - 1);
            }
        }
        let keys: Vec<ChunkKey> = lattice.keys().collect();
        prop_assert_eq!(keys.len() as u64, lattice.chunks());
        for (number, key) in keys.iter().enumerate() {
            prop_assert_eq!(lattice.number(*key), number);
            let part = lattice.part(*key);
            prop_assert!(part.rows >= 2 && part.columns >= 2);
            let [rows, columns] = [0, 1].map(|axis| lattice.places(*key, axis));
            prop_assert_eq!([rows.len(), columns.len()], [part.rows, part.columns]);
            let ends = |places: &[u64]| [places[0], places[places.len() - 1]];
            prop_assert_eq!(lattice.rectangle(*key), [ends(&rows), ends(&columns)]);
            for child in lattice.children(*key) {
                prop_assert_eq!(lattice.parent(child), Some(*key));
                prop_assert!(lattice.number(child) < number);
                prop_assert_eq!(child.ancestor(key.level), *key);
            }
            prop_assert_eq!(lattice.children(*key).count() == 0, key.level == 0);
        }
        prop_assert_eq!(keys.last(), Some(&lattice.root()));
    }
}
