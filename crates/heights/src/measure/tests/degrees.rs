//! Degrees as lengths on a sphere, against integrals.

use super::truth::{assert_near, of};
use crate::measure::{
    Disc, FormKind, Part, contours, fit, probe, probe_on, profile, profile_on, roughness, volumes, volumes_on,
};
use crate::model::lengths::EARTH;
use crate::model::{HeightField, Heights, Lengths, Window};
use deepfield_data::model::Unit;
use proptest::prelude::*;

/// Heights over longitude and latitude, every tenth of a degree from 10 E, 70 N down to 40 N.
fn zone(height: impl Fn(f64, f64) -> f64) -> HeightField {
    let mut field = of(201, 301, |row, column| height(10.0 + 0.1 * column, 70.0 - 0.1 * row));
    (field.grid.origin, field.grid.step) = ([10.0, 70.0], [0.1, -0.1]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// From 40 to 70 degrees: the integrals of the cosine and of its inverse.
fn integrals() -> [f64; 2] {
    let inverse = |latitude: f64| {
        let (sin, cos) = latitude.to_radians().sin_cos();
        ((1.0 + sin) / cos).ln()
    };
    [70_f64.to_radians().sin() - 40_f64.to_radians().sin(), inverse(70.0) - inverse(40.0)]
}

#[test]
fn volumes_are_over_zones_of_a_sphere() {
    let mut field = zone(|_, _| 5.0);
    let plan = EARTH * EARTH * 20_f64.to_radians() * integrals()[0];
    let found = volumes(&field).unwrap();
    assert_near(found.area, plan, 1e-12, "area");
    assert_near(found.volume_above, 5.0 * plan, 1e-12, "volume");
    field.grid.height_unit = Unit::new("km");
    assert_near(volumes(&field).unwrap().volume_above, 5000.0 * plan, 1e-12, "of kilometres");
    let moon = volumes_on(&field, &Lengths::on(&field.grid, 1_737_400.0)).unwrap();
    assert_near(moon.area, plan * (1_737_400.0_f64 / EARTH).powi(2), 1e-12, "of the Moon");
}

#[test]
fn slopes_are_by_metres() {
    let degree = EARTH * std::f64::consts::PI / 180.0;
    // 1 in 100 to the east at the equator, and to the north.
    let (east, north) = (zone(|x, _| 0.01 * degree * x), zone(|_, y| 0.01 * degree * y));
    let at = [20.04, 60.0];
    assert_near(probe(&east, at).unwrap().slope.unwrap(), 0.02, 1e-9, "to the east at 60 degrees");
    assert_near(probe(&east, at).unwrap().aspect.unwrap(), 270.0, 1e-9, "aspect");
    assert_near(probe(&north, at).unwrap().slope.unwrap(), 0.01, 1e-9, "to the north");
    let moon = Lengths::on(&north.grid, 1_737_400.0);
    let steeper = EARTH / 1_737_400.0;
    assert_near(probe_on(&north, &moon, at).unwrap().slope.unwrap(), 0.01 * steeper, 1e-9, "on the Moon");
    assert_near(roughness(&north).unwrap().iso.sdq.unwrap(), 0.01, 1e-9, "Sdq to the north");
    // The mean over the zone of (0.01 / cos)^2.
    let [cosine, inverse] = integrals();
    let found = roughness(&east).unwrap();
    assert_near(found.iso.sdq.unwrap(), 0.01 * (inverse / cosine).sqrt(), 1e-6, "Sdq to the east");
    assert_near(found.area, EARTH * EARTH * 20_f64.to_radians() * cosine, 1e-12, "area");
}

#[test]
fn what_is_nearest_is_so_in_metres() {
    // At 60 degrees a degree of longitude is half as long as one of latitude.
    let mut field = zone(|x, y| if (50.0..67.0).contains(&y) && (12.0..26.0).contains(&x) { f64::NAN } else { 0.0 });
    let found = probe(&field, [20.0, 60.0]).unwrap().nearest.unwrap();
    assert_near(found.x, 26.0, 1e-12, "to the east");
    assert_near(found.distance, 6_f64.to_radians() * EARTH * 60_f64.to_radians().cos(), 1e-9, "metres");
    field.grid.xy_unit = Unit::new("km");
    assert_near(probe(&field, [20.0, 60.0]).unwrap().nearest.unwrap().distance, 6.0, 1e-9, "as the field says");
}

#[test]
fn profiles_go_by_metres() {
    let mut field = zone(|x, y| x + y);
    // What is open between 13 and 14 degrees east.
    let columns = field.grid.columns as usize;
    for (index, value) in field.stored.iter_mut().enumerate() {
        if (30..=40).contains(&(index % columns)) {
            *value = f64::NAN;
        }
    }
    let lengths = Lengths::on(&field.grid, 1_737_400.0);
    let line = [[11.0, 50.0], [11.0, 60.0], [20.0, 60.0]];
    let (plain, found) = (profile(&field, &line).unwrap(), profile_on(&field, &lengths, &line).unwrap());
    let degree = 1_737_400.0 * std::f64::consts::PI / 180.0;
    assert_near(found.length, (10.0 + 0.5 * 9.0) * degree, 1e-12, "length");
    assert_near(found.valid_length, (10.0 + 0.5 * (9.0 - 1.2)) * degree, 1e-9, "over T");
    assert_eq!(plain.points.len(), found.points.len());
    for (one, other) in plain.points.iter().zip(&found.points) {
        let along = if one.distance <= 10.0 { one.distance } else { 10.0 + 0.5 * (one.distance - 10.0) };
        assert_near(other.distance, along * degree, 1e-12, "distance");
        assert_eq!((one.x, one.y, one.height.to_bits()), (other.x, other.y, other.height.to_bits()));
    }
}

/// What stands at a longitude, whatever its turn, and in a row.
fn height_at(longitude: f64, row: f64) -> f64 {
    (longitude.rem_euclid(360.0) - 180.0).abs() + row * row
}

/// Columns to the east, or where `step` is -1 to the west, from a longitude on, from 70 N down to 50 N.
fn around(first: f64, columns: u64, step: f64) -> HeightField {
    let mut field = of(columns, 21, |row, column| height_at(first + step * column, row));
    (field.grid.origin, field.grid.step) = ([first, 70.0], [step, -1.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// A globe's heights are the same wherever its columns begin, and some turns further.
#[test]
fn places_and_lines_go_on_beyond_the_seam() {
    let (field, wanted, part) = (around(20.0, 361, 1.0), around(-180.0, 361, 1.0), around(20.0, 30, 1.0));
    for (at, plain) in [([10.25, 63.5], [10.25, 63.5]), ([-700.75, 63.5], [19.25, 63.5]), ([380.5, 55.0], [20.5, 55.0])]
    {
        let (found, there) = (probe(&field, at).unwrap(), probe(&wanted, plain).unwrap());
        assert_near(found.height.unwrap(), there.height.unwrap(), 1e-9, "height");
        assert_eq!(found.x, at[0]);
    }
    assert!(probe(&part, [380.5, 55.0]).unwrap().height.is_some());
    assert!(probe(&part, [10.25, 63.5]).unwrap().height.is_none());
    assert_eq!(probe(&part, [10.25, 63.5]).unwrap().nearest.unwrap().x, 20.0);

    let lengths = Lengths::on(&field.grid, 1_737_400.0);
    for line in [[[10.1, 65.0], [30.3, 62.4]], [[30.3, 62.4], [10.1, 65.0]], [[10.1, 65.0], [17.0, 60.0]]] {
        let plain = profile_on(&wanted, &lengths, &line).unwrap();
        // Without the first column once more, and to the west, too.
        let fields = [(&field, 1.0), (&around(20.0, 360, 1.0), 1.0), (&around(20.0, 360, -1.0), -1.0)];
        for ((field, step), turns) in fields.into_iter().flat_map(|field| [-2.0, 0.0, 1.0].map(|turns| (field, turns)))
        {
            let turned = line.map(|[x, y]| [x + 360.0 * turns, y]);
            let mut found = profile_on(field, &lengths, &turned).unwrap();
            assert_near(found.length, plain.length, 1e-9, "length");
            assert_near(found.valid_length, plain.length, 1e-9, "over T");
            if step < 0.0 {
                // T's diagonals are others.
                continue;
            }
            // At the seam one piece ends and the next begins.
            found.points.dedup_by(|next, last| next.distance - last.distance < 1e-3);
            assert_eq!(found.points.len(), plain.points.len());
            for (one, other) in found.points.iter().zip(&plain.points) {
                assert_near(one.distance, other.distance, 1e-6, "distance");
                assert_near(one.height, other.height, 1e-9, "height");
            }
        }
    }
}

/// A line between the last column and the first is there when the field is closed.
#[test]
fn lines_of_equal_height_reach_the_seam() {
    let field = around(20.0, 360, 1.0);
    assert!(Part::closed(&around(20.0, 361, 1.0)).is_none() && Part::closed(&around(20.0, 300, 1.0)).is_none());
    let closed = Part::closed(&field).unwrap();
    let mut length = [0.0; 2];
    for (field, length) in [&field as &dyn Heights, &closed].into_iter().zip(&mut length) {
        contours(field, &[161.0], |line| {
            *length += line.points.windows(2).map(|leg| (leg[1][0] - leg[0][0]).abs()).sum::<f64>();
            Ok(())
        })
        .unwrap();
    }
    // From longitude 19 in the first row to 20 in the second.
    assert!(length[1] > length[0] + 0.5, "{length:?}");
}

proptest! {
    /// Regions over the seam, some turns further, of fields with and without their first column once more, hold the samples that stand there.
    #[test]
    fn regions_go_on_beyond_the_seam(
        first in -200..200i32,
        (columns, step) in (360..=361u64, prop::sample::select(vec![1.0, -1.0])),
        low in -900.0..900.0f64,
        width in 2.0..350.0f64,
        (radius, latitude) in (1.5..9.0f64, 55.0..65.0f64),
    ) {
        let field = around(f64::from(first), columns, step);
        let high = low + width;
        let (east, west) = (high.floor(), low.ceil());
        let part = Part::of_rectangle(&field, [[high, 64.5], [low, 58.5]]).unwrap();
        prop_assert_eq!((part.grid().columns, part.grid().rows), ((east - west) as u64 + 1, 6));
        let [x, y] = part.grid().place(0.0, 0.0);
        prop_assert!((x - if step > 0.0 { west } else { east }).rem_euclid(360.0) < 1e-9 && y == 64.0, "{} {}", x, y);
        let mut found = vec![0.0; part.grid().samples() as usize];
        part.heights(Window::all(part.grid()), &mut found).unwrap();
        for (number, height) in found.chunks_exact(part.grid().columns as usize).enumerate() {
            for (column, height) in height.iter().enumerate() {
                prop_assert_eq!(*height, height_at(x + step * column as f64, 6.0 + number as f64));
            }
        }
        // A disc has the samples that it has where there is no seam near by.
        let count = |field: &HeightField, x: f64| {
            let part = Part::of_disc(field, Disc { center: [x, latitude], radius }).unwrap();
            let mut found = vec![0.0; part.grid().samples() as usize];
            part.heights(Window::all(part.grid()), &mut found).unwrap();
            found.into_iter().filter(|height| !height.is_nan()).collect::<Vec<_>>()
        };
        let plain = around(low.floor() - if step > 0.0 { 180.0 } else { -180.0 }, 361, step);
        prop_assert_eq!(count(&field, low), count(&plain, low));
        prop_assert!(Part::of_rectangle(&field, [[low + 9000.0, 64.5], [high + 9000.0, 58.5]]).is_none());
    }
}

#[test]
fn forms_with_a_radius_need_lengths() {
    let field = zone(|x, y| x * x - y);
    for kind in [FormKind::Sphere, FormKind::Cylinder] {
        let told = fit(&field, kind).err().unwrap().to_string();
        assert!(told.starts_with(&format!("--form {kind}: found x and y in degrees, expected lengths")), "{told}");
    }
    assert!(fit(&field, FormKind::Plane).is_ok());
}
