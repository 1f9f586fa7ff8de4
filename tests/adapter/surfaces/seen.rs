//! What an adapter's passes see, read back: raw channels, and heights along lines of equal height.

use super::*;
use deepfield::cpu::surface::labels::ContourLabel;

/// Depth, x, y, height, row, column and coverage of a pixel.
pub(super) type Channels = [f64; 7];

/// A field of which one half is rough and has holes, and the other is smooth.
fn halves() -> HeightField {
    let mut field = hills(SIZE, Holes::Lakes);
    for (index, height) in field.stored.iter_mut().enumerate() {
        let (x, y) = ((index % SIZE[0]) as f64, (index / SIZE[0]) as f64);
        if x > 300.0 {
            *height = 25.0 * (x / 45.0).sin() + 20.0 * (y / 50.0 + x / 90.0).cos();
        }
    }
    field
}

/// T at a row and a column: NaN where it is open.
fn height_at(field: &HeightField, row: f64, column: f64) -> f64 {
    let [columns, rows] = SIZE;
    let (r, c) = ((row.max(0.0) as usize).min(rows - 2), (column.max(0.0) as usize).min(columns - 2));
    let (u, v) = (column - c as f64, row - r as f64);
    let [a, b, c, d] = [0, 1, columns, columns + 1].map(|next| field.stored[r * columns + c + next]);
    let (above, below) = (a + u * (b - a) + v * (d - b), a + v * (c - a) + u * (d - c));
    let first = if u >= v { above } else { below };
    match first.is_nan() {
        // Triangles of three corners whose diagonal runs the other way.
        true if u + v <= 1.0 => a + u * (b - a) + v * (c - a),
        true => d + (1.0 - u) * (c - d) + (1.0 - v) * (b - d),
        false => first,
    }
}

pub(super) fn reading(path: &Path, backend: Backend) -> SurfaceSession {
    let options = SessionOptions { backend: Some(backend), raw: true, ..SessionOptions::default() };
    let session = SurfaceSession::open(path, &HeightsSaid::default(), options, Arc::new(())).unwrap();
    session.with_adapter(Some(Box::new(Offscreen::preferred())))
}

/// A picture, and the channels of its pixels.
pub(super) fn read(session: &mut SurfaceSession, shot: &Shot) -> (Picture, Vec<Channels>) {
    let picture = session.draw(shot).unwrap();
    let channels = picture.surface.as_ref().and_then(|surface| surface.channels.clone()).unwrap();
    assert_eq!(Some((channels.width, channels.height)), shot.size);
    (picture, channels.values)
}

fn labels_of(picture: &Picture) -> Vec<ContourLabel> {
    picture.surface.as_ref().and_then(|surface| surface.labels.clone()).unwrap_or_default()
}

fn is_hit(channels: &Channels) -> bool {
    !channels[0].is_nan()
}

/// The pixels of a square about one.
fn around(index: usize, reach: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (index % width, index / width);
    let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
    rows.flat_map(move |y| (x.saturating_sub(reach)..(x + reach + 1).min(width)).map(move |x| y * width + x))
}

/// Channels are the same to the bit but where rounding decides for the triangle, or the sample, next to it: then they are among those of the
/// pixels around. Only at edges there is a hit in one picture alone.
pub(super) fn assert_alike(found: &[Channels], expected: &[Channels], size: [usize; 2], what: &str) {
    let (mut both, mut same, mut beyond, mut lost) = (0_usize, 0_usize, 0_usize, 0_usize);
    for (index, (own, other)) in found.iter().zip(expected).enumerate() {
        let near: Vec<&Channels> = around(index, 1, size).map(|index| &expected[index]).collect();
        let hits = near.iter().filter(|channels| is_hit(channels)).count();
        match (is_hit(own), is_hit(other)) {
            (true, true) => {
                both += 1;
                same += usize::from((0..7).all(|k| own[k].to_bits() == other[k].to_bits()));
                let is_among = |k: usize| {
                    let values = near.iter().filter(|channels| is_hit(channels)).map(|channels| channels[k]);
                    let [low, high] = values.fold([f64::MAX, f64::MIN], |[a, b], value| [a.min(value), b.max(value)]);
                    let room = high - low;
                    (low - room..=high + room).contains(&own[k])
                };
                beyond += usize::from(!(0..6).all(is_among));
            }
            (false, false) => {}
            _ => lost += usize::from(hits == 0 || hits == near.len()),
        }
    }
    println!("{what}: of {both} hits {same} are the same, {beyond} are not among those around; {lost} beside edges");
    assert!(both > expected.len() / 8, "{what}: {both} hits");
    assert!(10 * same >= 9 * both, "{what}: {same} of {both} are the same");
    assert!(200 * beyond <= both, "{what}: {beyond} of {both}");
    assert!(1000 * lost <= expected.len(), "{what}: {lost} beside edges");
}

/// T at the place of each hit is seen within the error that is told of the pixel's middle; a point stands for its pixel.
fn assert_within(
    field: &HeightField,
    session: &SurfaceSession,
    shot: &Shot,
    (found, error_px): (&[Channels], f64),
    what: &str,
) {
    let facts = &session.file().about().facts;
    let (sight, placed) = SurfaceSession::sight(session.file(), [facts.min, facts.max], shot).unwrap();
    let width = sight.size()[0] as usize;
    let (mut worst, mut count) = (0.0_f64, 0);
    for (index, &[_, _, _, _, row, column, _]) in found.iter().enumerate().filter(|(_, channels)| is_hit(channels)) {
        let height = height_at(field, row, column);
        if height.is_nan() {
            continue;
        }
        let (place, _) = sight.project(placed.world(row, column, height) - sight.eye()).unwrap();
        let middle = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
        let is_sample = row.fract() == 0.0 && column.fract() == 0.0;
        let point = if is_sample { std::f64::consts::FRAC_1_SQRT_2 } else { 0.0 };
        worst = worst.max((place[0] - middle[0]).hypot(place[1] - middle[1]) - point);
        count += 1;
    }
    println!("{what}: {count} places of T are within {worst:.4} pixels");
    assert!(worst <= error_px + 0.01, "{what}: {worst} of {error_px}");
    assert!(count > found.len() / 8, "{what}: {count} places");
}

/// Heights say their levels and stand on lines of these; most are the processor's. Beside them the picture is that without heights.
fn assert_lettered(
    (found, channels, plain): (&Picture, &[Channels], &Picture),
    expected: &Picture,
    shot: &Shot,
    what: &str,
) {
    let (labels, others) = (labels_of(found), labels_of(expected));
    let (width, height) = shot.size.unwrap();
    let size = [width as usize, height as usize];
    for label in &labels {
        assert_eq!(label.text.parse::<f64>().unwrap(), label.level, "{what}");
        let [x, y] = label.middle.map(|at| at as usize);
        let near: Vec<f64> = around(y * size[0] + x, 2, size).map(|index| channels[index][3]).collect();
        let [low, high] = near.iter().fold([f64::MAX, f64::MIN], |[a, b], height| [a.min(*height), b.max(*height)]);
        assert!((low - 0.3..=high + 0.3).contains(&label.level), "{what}: {} of {low} to {high}", label.level);
    }
    let is_known = |label: &&ContourLabel| {
        let away = |other: &ContourLabel| (0..2).map(|k| (label.middle[k] - other.middle[k]).abs()).fold(0.0, f64::max);
        others.iter().any(|other| other.text == label.text && away(other) < 1.0)
    };
    let same = labels.iter().filter(is_known).count();
    println!("{what}: {same} of {} heights are where the processor writes {}", labels.len(), others.len());
    assert!(labels.len() >= 4 && 2 * same >= labels.len(), "{what}: {same} of {}", labels.len());
    let (lettered, plain) = (found.image(shot).unwrap(), plain.image(shot).unwrap());
    let is_beside = |index: usize| {
        let at = [(index % size[0]) as f64 + 0.5, (index / size[0]) as f64 + 0.5];
        labels.iter().all(|label| {
            let [left, top, right, bottom] = label.area();
            at[0] < left - 4.0 || at[0] > right + 4.0 || at[1] < top - 4.0 || at[1] > bottom + 4.0
        })
    };
    let pairs = || lettered.rgba.iter().zip(&plain.rgba).enumerate();
    assert!(pairs().all(|(index, (with, without))| with == without || !is_beside(index)), "{what}");
    assert!(pairs().filter(|(_, (with, without))| with != without).count() > 20 * labels.len(), "{what}");
}

#[test]
fn an_adapter_finds_raw_channels_and_places_of_heights() {
    let folder = tempfile::tempdir().unwrap();
    let (field, globe) = (halves(), world(Holes::Lakes));
    let from_above = Wanted {
        eye: Some([465.0, 265.0, 900.0]),
        target: Some([465.0, 265.5, 0.0]),
        ortho: Some(260.0),
        attribute: Some("height"),
        settings: &[
            ("contours", number(10.0)),
            ("contour-major", number(1.0)),
            ("contour-labels", SettingValue::Flag(true)),
        ],
    };
    let without = Wanted { settings: &from_above.settings[..2], ..from_above };
    let [lettered, plain] = [&from_above, &without].map(|wanted| Shot { size: Some((320, 220)), ..wanted.shot() });
    let far = |wanted: &Wanted<'_>, error_px: f64| {
        let shot = wanted.shot();
        Shot { look: LookPatch { error_px: Some(error_px), ..shot.look.clone() }, ..shot }
    };
    let wide = Wanted { settings: &[("point", number(3.0))], ..PLAIN };
    let shots = [("far away", far(&PLAIN, 0.8)), ("coarse", far(&wide, 2.0)), ("from above", lettered.clone())];
    let path = built(folder.path(), &field);
    let mut processor = reading(&path, Backend::Cpu);
    let expected: Vec<_> = shots.iter().map(|(_, shot)| read(&mut processor, shot)).collect();
    for (backend, passes) in [(Backend::Compute, "compute"), (Backend::Raster, "raster")] {
        let mut adapter = reading(&path, backend);
        for ((what, shot), (by_processor, expected)) in shots.iter().zip(&expected) {
            let what = format!("{what}, {passes}");
            let (picture, found) = read(&mut adapter, shot);
            let (width, height) = shot.size.unwrap();
            assert_eq!(picture.drawn_by[0], passes, "{what}");
            assert_eq!(picture.error_px, by_processor.error_px, "{what}");
            assert_alike(&found, expected, [width as usize, height as usize], &what);
            assert_within(&field, &adapter, shot, (&found, picture.error_px), &what);
            if *shot == lettered {
                let (plain, _) = read(&mut adapter, &plain);
                assert_lettered((&picture, &found, &plain), by_processor, shot, &what);
            }
        }
    }
    let path = built(folder.path(), &globe);
    let shot = far(&PLAIN, 0.8);
    let (_, expected) = read(&mut reading(&path, Backend::Cpu), &shot);
    let (picture, found) = read(&mut reading(&path, Backend::Compute), &shot);
    assert_eq!(picture.drawn_by[0], "compute");
    assert_alike(&found, &expected, [210, 140], "a globe");
}
