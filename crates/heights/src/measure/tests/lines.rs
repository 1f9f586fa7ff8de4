//! Contour lines against the segments of every triangle, and against circles.

use super::rays::noisy;
use super::truth::{assert_near, cell, height, of, sines, with_holes};
use crate::measure::{Contour, ContourError, GeoJson, contours, levels};
use crate::model::HeightField;
use proptest::prelude::*;
use std::collections::HashMap;
use std::f64::consts::PI;

fn all(field: &HeightField, levels: &[f64]) -> Vec<Contour> {
    let mut found = Vec::new();
    contours(field, levels, |line| {
        found.push(line);
        Ok(())
    })
    .unwrap();
    found
}

/// The segments of a level, triangle by triangle.
fn segments(field: &HeightField, level: f64) -> Vec<[[f64; 2]; 2]> {
    let grid = &field.grid;
    let mut found = Vec::new();
    for row in 0..grid.rows - 1 {
        for column in 0..grid.columns - 1 {
            let here = cell(field, row, column);
            for triangle in here.triangles() {
                let corners = triangle.corners.map(|corner| {
                    ((row + corner as u64 / 2) as f64, (column + corner as u64 % 2) as f64, here.0[corner])
                });
                let mut points = Vec::new();
                for (a, b) in [(0, 1), (1, 2), (0, 2)] {
                    let (a, b) = (corners[a], corners[b]);
                    if (a.2 >= level) != (b.2 >= level) {
                        let part = (level - a.2) / (b.2 - a.2);
                        points.push(grid.place(a.0 + part * (b.0 - a.0), a.1 + part * (b.1 - a.1)));
                    }
                }
                if let [a, b] = points[..] {
                    found.push([a, b]);
                }
            }
        }
    }
    found
}

fn check(field: &HeightField, chosen: &[f64]) {
    let found = all(field, chosen);
    for &level in chosen {
        let lines: Vec<&Contour> = found.iter().filter(|line| line.level == level).collect();
        let wanted = segments(field, level);
        let length: f64 = wanted.iter().map(|[a, b]| (b[0] - a[0]).hypot(b[1] - a[1])).sum();
        assert_near(lines.iter().map(|line| line.length()).sum(), length, 1e-10, "length");
        // Ends of lines are where one segment alone ends.
        let mut ends: HashMap<[u64; 2], usize> = HashMap::new();
        for point in wanted.iter().flatten() {
            *ends.entry(point.map(|part| (part * 1e8).round() as i64 as u64)).or_default() += 1;
        }
        let rim = ends.values().filter(|count| *count % 2 == 1).count();
        let mine = lines.iter().filter(|line| !line.is_closed()).count() * 2;
        assert!(mine == rim || level == 0.0, "{mine} ends, not {rim}");
        for line in lines {
            assert!(line.points.len() > 1 && line.points.windows(2).all(|pair| pair[0] != pair[1]));
            for point in &line.points {
                let [row, column] = field.grid.row_column(*point);
                let on = height(field, row, column).unwrap_or(f64::NAN);
                assert!((on - level).abs() <= 1e-9, "{point:?}: {on}, not {level}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn lines_are_the_segments_of_all_triangles(
        columns in 2_u64..30, rows in 2_u64..30, holes in prop_oneof![Just(0.0), Just(0.2), Just(0.6)], seed in any::<u64>(), steps in any::<bool>(),
    ) {
        let mut field = noisy(columns, rows, holes, seed);
        if steps {
            // Few heights, one of them a level: summits, ridges and plains at the level.
            field.stored.iter_mut().for_each(|height| *height = (*height * 4.0).round() / 4.0);
        }
        (field.grid.step, field.grid.origin) = ([0.7, -0.3], [3.0, 2.0]);
        check(&field, &[-0.3, 0.0, 0.111, 0.4]);
    }
}

#[test]
fn lines_go_on_from_band_to_band() {
    // Far more rows than a band has, so that every line is joined from many.
    let field = of(3000, 700, |row, column| row * 0.01 + 2.0 * (column * 0.004).sin());
    let chosen = [1.234, 4.567];
    let found = all(&field, &chosen);
    for &level in &chosen {
        let length: f64 = segments(&field, level).iter().map(|[a, b]| (b[0] - a[0]).hypot(b[1] - a[1])).sum();
        let lines: Vec<&Contour> = found.iter().filter(|line| line.level == level).collect();
        assert_near(lines.iter().map(|line| line.length()).sum(), length, 1e-10, "length");
        for line in lines.iter().filter(|line| !line.is_closed()) {
            for end in [line.points[0], line.points[line.points.len() - 1]] {
                assert!(end[0] == 0.0 || end[0] == 2999.0 || end[1] == 0.0 || end[1] == 699.0, "{end:?}");
            }
        }
    }
    let upright = all(&of(5000, 300, |_, column| (column - 2500.0) / 5000.0), &[0.000_1]);
    assert_eq!((upright.len(), upright[0].points.len()), (1, 300 + 299));
    let holey = with_holes(sines(900, 600, 128.0, 1.0), 0.1, 3);
    let many = all(&holey, &[0.1, 0.2]);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| all(&holey, &[0.2, 0.1]));
    assert!(many == one, "threads or the order of levels change the lines");
    for level in [0.1, 0.2] {
        let length: f64 = segments(&holey, level).iter().map(|[a, b]| (b[0] - a[0]).hypot(b[1] - a[1])).sum();
        let mine: f64 = many.iter().filter(|line| line.level == level).map(Contour::length).sum();
        assert_near(mine, length, 1e-10, "length");
    }
}

#[test]
fn lines_of_a_cap_are_circles() {
    let field = of(600, 420, |row, column| {
        let away = (column - 299.5).powi(2) + (row - 209.5).powi(2);
        ((320.0_f64.powi(2) - away).max(0.0).sqrt() - 230.0).max(0.0)
    });
    for level in [20.37, 50.37, 80.37] {
        let found = all(&field, &[level]);
        assert_eq!((found.len(), found[0].is_closed()), (1, true));
        let wanted = 2.0 * PI * (320.0_f64.powi(2) - (level + 230.0).powi(2)).sqrt();
        assert_near(found[0].length(), wanted, 1e-3, "length");
    }
}

#[test]
fn summits_and_plains_at_a_level() {
    let summit = of(5, 5, |row, column| if (row, column) == (2.0, 2.0) { 1.0 } else { 0.0 });
    assert!(all(&summit, &[1.0]).is_empty());
    let plain =
        of(7, 7, |row, column| if (2.0..=4.0).contains(&row) && (2.0..=4.0).contains(&column) { 1.0 } else { 0.0 });
    let found = all(&plain, &[1.0]);
    assert_eq!((found.len(), found[0].is_closed(), found[0].length()), (1, true, 8.0));
    assert!(all(&plain, &[0.0, -1.0, f64::NAN]).is_empty());
}

#[test]
fn levels_begin_at_the_base() {
    assert_eq!(levels([-1.0, 6.0], 2.5, 0.5).unwrap(), [0.5, 3.0, 5.5]);
    assert_eq!(levels([1.0, 1.5], 10.0, 0.0).unwrap(), [0.0; 0]);
    assert_eq!(levels([f64::NAN, f64::NAN], 10.0, 0.0).unwrap(), [0.0; 0]);
    for interval in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9, 1e-300] {
        assert!(matches!(levels([0.0, 100.0], interval, 0.0), Err(ContourError::Interval { .. })), "{interval}");
    }
    assert!(matches!(levels([0.0, 100.0], 1.0, f64::NAN), Err(ContourError::Base { .. })));
}

#[test]
fn geojson_reads_back() {
    let mut field = noisy(20, 15, 0.2, 4);
    field.grid.crs = Some("EPSG:\"4326\"".into());
    field.grid.origin = [5e6, 1e-9];
    let lines = all(&field, &[0.1, 0.2]);
    let mut writer = GeoJson::new(Vec::new(), &field.grid).unwrap();
    lines.iter().for_each(|line| writer.line(line).unwrap());
    let read: serde_json::Value = serde_json::from_slice(&writer.finish().unwrap()).unwrap();
    let features = read["features"].as_array().unwrap();
    assert_eq!((read["type"].as_str(), features.len()), (Some("FeatureCollection"), lines.len()));
    for (line, feature) in lines.iter().zip(features) {
        assert_eq!(feature["properties"]["level"].as_f64(), Some(line.level));
        let points: Vec<[f64; 2]> = serde_json::from_value(feature["geometry"]["coordinates"].clone()).unwrap();
        assert!(
            points
                .iter()
                .zip(&line.points)
                .all(|(a, b)| (a[0] - b[0]).abs() <= 1e-9 && (a[1] - b[1]).abs() <= 1e-15 * b[1].abs())
        );
        assert_eq!(points.len(), line.points.len());
    }
    let none = GeoJson::new(Vec::new(), &field.grid).unwrap().finish().unwrap();
    assert!(serde_json::from_slice::<serde_json::Value>(&none).unwrap()["features"].as_array().unwrap().is_empty());
}
