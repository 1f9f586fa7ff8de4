//! What is shown where nothing was measured, and the sides of a field, by an adapter's passes.

use super::*;
use deepfield::view::CutSettings;
use deepfield::view::cut::ClipBox;

/// Lakes of several sizes, and beyond a column a third of all samples.
pub(super) fn broken() -> HeightField {
    let mut field = hills(SIZE, Holes::Lakes);
    let mut random = Random(3);
    for (index, height) in field.stored.iter_mut().enumerate() {
        if index % SIZE[0] > 480 && random.next() < 0.33 {
            *height = f64::NAN;
        }
    }
    field
}

pub(super) fn covered(picture: &Picture) -> f64 {
    picture.surface.as_ref().unwrap().report.covered
}

/// Has an adapter draw a shot, and compares what it draws with what the processor has drawn.
fn assert_alike(expected: &Picture, adapter: &mut SurfaceSession, shot: &Shot, most: f64, what: &str) {
    let found = adapter.draw(shot).unwrap();
    assert_ne!(found.drawn_by[0], "cpu", "{what}");
    let (share, mean) = differences(&found.image(shot).unwrap(), &expected.image(shot).unwrap());
    let covered = [&found, expected].map(covered);
    println!("{what}, {}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}, {covered:?}", found.drawn_by[0]);
    assert!(share <= most && mean < 0.6, "{what}: {share} {mean}");
    // Membranes, sides, and what closes a pole were not measured.
    assert!((covered[0] - covered[1]).abs() < 0.005 * covered[1], "{what}: {covered:?}");
}

#[test]
fn an_adapter_draws_holes_and_sides() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &broken());
    let sides = [("walls", SettingValue::Flag(true)), ("base", number(-120.0))];
    let with = |settings: &[(&'static str, SettingValue)]| [&sides[..], settings].concat();
    let outlined = with(&[("holes", name("outlined")), ("contour-width", number(2.0))]);
    let filled = with(&[("holes", name("filled"))]);
    let narrow = with(&[("holes", name("filled")), ("largest-gap", number(40.0)), ("contours", number(8.0))]);
    let points = with(&[("holes", name("filled")), ("technique", name("points"))]);
    let far = Wanted { attribute: Some("height"), ..PLAIN };
    let near = Wanted { eye: Some([310.0, 200.0, 60.0]), target: Some([480.0, 350.0, -20.0]), ..PLAIN };
    let ahead = Wanted { eye: Some([250.0, -150.0, 260.0]), target: Some([280.0, 265.0, 0.0]), ..PLAIN };
    let above = Wanted {
        eye: Some([310.0, 265.0, 900.0]),
        target: Some([310.0, 265.5, 0.0]),
        ortho: Some(560.0),
        attribute: Some("slope"),
        ..PLAIN
    };
    let cut = |shot: Shot| {
        let clip = Some(ClipBox { min: DVec3::new(100.3, 80.2, -500.0), max: DVec3::new(430.6, 400.4, 70.0) });
        let cut = Some(CutSettings { clip, ..CutSettings::default() });
        Shot { look: LookPatch { cut, ..shot.look }, ..shot }
    };
    let shot = |wanted: &Wanted<'_>, settings: &[(&'static str, SettingValue)]| Wanted { settings, ..*wanted }.shot();
    let rims = [
        ("rims", shot(&far, &outlined)),
        ("rims near by", shot(&near, &outlined)),
        ("rims and sides of a box", cut(shot(&ahead, &outlined))),
    ];
    let membranes = [
        ("membranes", shot(&far, &filled)),
        ("narrow membranes near by, and lines", shot(&near, &narrow)),
        ("membranes from above", shot(&above, &filled)),
        ("membranes among points", shot(&far, &points)),
        ("membranes and sides of a box", cut(shot(&ahead, &filled))),
    ];
    let mut processor = session(&path, Backend::Cpu);
    let mut adapters = [Backend::Compute, Backend::Raster].map(|backend| session(&path, backend));
    // Lines are the same function of what is seen, whatever found that.
    let by_one = rims.iter().map(|rim| (rim, 1));
    for ((what, shot), backends) in by_one.chain(membranes.iter().map(|membrane| (membrane, 2))) {
        let expected = processor.draw(shot).unwrap();
        for adapter in &mut adapters[..backends] {
            assert_alike(&expected, adapter, shot, 0.025, what);
        }
    }
}

#[test]
fn an_adapter_draws_holes_of_globes() {
    let folder = tempfile::tempdir().unwrap();
    let path = built(folder.path(), &world(Holes::Lakes));
    let common = [("exaggeration", number(3000.0)), ("light", name("eye"))];
    let target = Some([0.0; 3]);
    let [seam, pole, near] = [above(180.0, 10.0, 2e7), above(30.0, 88.0, 8e6), above(100.0, 40.0, 9e6)];
    let mut processor = session(&path, Backend::Cpu);
    for (backend, holes, places) in
        [(Backend::Raster, "outlined", [seam, near]), (Backend::Compute, "filled", [seam, pole])]
    {
        let mut adapter = session(&path, backend);
        let settings = [&common[..], &[("holes", name(holes)), ("contour-width", number(2.0))]].concat();
        for eye in places {
            let shot = Wanted { eye, target, settings: &settings, ..PLAIN }.shot();
            let expected = processor.draw(&shot).unwrap();
            // Lines are moved by parts of a pixel, as lines of equal height are.
            assert_alike(&expected, &mut adapter, &shot, 0.02, &format!("{holes} from {eye:?}"));
        }
    }
}
