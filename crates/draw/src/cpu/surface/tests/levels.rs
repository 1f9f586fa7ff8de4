//! What the levels say of T, against T itself.

use super::super::source::{NodeFacts, NodeSamples};
use super::*;

fn height_of(samples: &NodeSamples, rows: &[u64], columns: &[u64], row: f64, column: f64) -> f64 {
    let index =
        |places: &[u64], at: f64| places.partition_point(|place| *place as f64 <= at).clamp(1, places.len() - 1) - 1;
    let (r, c) = (index(rows, row), index(columns, column));
    let share = |places: &[u64], k: usize, at: f64| (at - places[k] as f64) / (places[k + 1] - places[k]) as f64;
    let first = r * samples.columns + c;
    let cell =
        Cell([first, first + 1, first + samples.columns, first + samples.columns + 1].map(|k| samples.heights.at(k)));
    cell.height(share(columns, c, column), share(rows, r, row))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Nothing that is drawn of a chunk is further from T than it says, and its range and steps hold.
    #[test]
    fn facts_hold_everywhere(rows in 2usize..700, columns in 2usize..700, holes in 0.0..0.5f64, seed in 0u64..1000) {
        let holes = if seed % 3 == 0 { 0.0 } else { holes };
        let field = hills(rows, columns, holes, seed);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        let lattice = source.lattice();
        let mut random = Random::new(seed);
        for key in lattice.keys() {
            let facts: NodeFacts = source.facts(key).unwrap();
            let samples = source.samples(key).unwrap();
            let [row_places, column_places] = [0, 1].map(|axis| lattice.places(key, axis));
            prop_assert!(row_places.len() == samples.rows && column_places.len() == samples.columns);
            prop_assert!(key.level > 0 || facts.delta == 0.0);
            for _ in 0..3000 {
                let at = |places: &[u64], random: &mut Random| random.between(places[0] as f64, places[places.len() - 1] as f64);
                let (row, column) = (at(&row_places, &mut random), at(&column_places, &mut random));
                let (own, true_height) = (height_of(&samples, &row_places, &column_places, row, column), t_height(&field, row, column));
                if own.is_nan() || true_height.is_nan() {
                    continue;
                }
                prop_assert!((own - true_height).abs() <= facts.delta + 1e-9, "{key:?}: {own} {true_height} {}", facts.delta);
                prop_assert!(facts.min <= true_height + 1e-9 && true_height <= facts.max + 1e-9);
            }
        }
    }

    /// Valid area is conserved at every level, and what was measured vanishes nowhere.
    #[test]
    fn coverage_is_conserved(rows in 2usize..600, columns in 2usize..600, holes in 0.0..1.0f64, seed in 0u64..1000) {
        let field = hills(rows, columns, holes, seed);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        let lattice = source.lattice();
        let mut area = 0.0;
        for (r, c) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
            let first = r * columns + c;
            let cell = Cell([first, first + 1, first + columns, first + columns + 1].map(|k| field.stored[k]));
            area += 0.5 * cell.triangles().count() as f64;
        }
        for level in 0..=lattice.top() {
            let (mut sum, mut weights) = (0.0, 0.0);
            for key in lattice.keys().filter(|key| key.level == level) {
                let samples = source.samples(key).unwrap();
                let [row_places, column_places] = [0, 1].map(|axis| lattice.places(key, axis));
                // What a sample of this chunk stands for within the chunk.
                let half = |places: &[u64], k: usize| {
                    let before = if k > 0 { places[k] - places[k - 1] } else { 0 };
                    let after = if k + 1 < places.len() { places[k + 1] - places[k] } else { 0 };
                    0.5 * (before + after) as f64
                };
                for (r, c) in (0..samples.rows).flat_map(|r| (0..samples.columns).map(move |c| (r, c))) {
                    let share = samples.coverage_at(r * samples.columns + c);
                    let weight = half(&row_places, r) * half(&column_places, c);
                    sum += weight * f64::from(share) / 255.0;
                    weights += weight;
                    prop_assert_eq!(share == 0, samples.heights.at(r * samples.columns + c).is_nan());
                }
            }
            prop_assert!((weights - ((rows - 1) * (columns - 1)) as f64).abs() < 1e-6 * weights);
            // Cells at the rim are shorter than what the filter takes them for.
            let rim = ((rows + columns) << level) as f64;
            prop_assert!((sum - area).abs() <= 0.003 * weights + 0.6 * rim, "level {level}: {sum}, T has {area}");
            if rows % (1 << level) == 1 && columns % (1 << level) == 1 {
                prop_assert!((sum - area).abs() <= 0.003 * weights, "level {level}: {sum}, T has {area}");
            }
        }
    }
}
