//! Scenes survive the way through text, and each field that is misspelled or mistyped is named with its place.

use super::*;
use crate::annotate::Annotations;
use crate::annotate::overlay::{Corner, Overlay};
use crate::color::transfer::{Hue, Range, TransferFunction};
use crate::explore::{IdSet, Members, PlotKind, PlotOf, PlotSettings, Region, SelectionSet, Show};
use crate::heights::import::PhotoChoice;
use crate::look::Film;
use crate::look::{
    Attribute, Bookmark, Camera, DatasetRef, Fingerprint, HeightsSaid, LookPatch, OwnLook, Panels, TakenFor,
    VERSION_TIME,
};
use crate::mode::{Focus, PathSettings, PathShape, PathsOf, SettingValue, Settings, Span};
use crate::model::{FamilyName, Unit, When};
use crate::modes::volume_isosurface;
use crate::view::cut::{Axis, ClipBox, Fade, Slab};
use glam::DVec3;
use proptest::prelude::*;

fn camera(seed: f64) -> Camera {
    Camera {
        eye: [0.1 + seed, -1.0 / 3.0, 1.0e9 + seed],
        target: [5e-324, 1e120, 0.1 + 0.2],
        up: [0.0, 1.0, 0.0],
        fov: 45.000_000_000_000_01,
        ortho: Some(1.0 / 7.0),
    }
}

/// A scene in which every field is set.
fn full() -> SceneFile {
    let mut settings = Settings::default();
    settings.0.insert("resolution".into(), SettingValue::Number(0.5));
    settings.0.insert("lambda".into(), SettingValue::Flag(false));
    settings.0.insert("kernel".into(), SettingValue::Name("poly6".into()));
    settings.0.insert("isovalues".into(), SettingValue::Numbers(vec![0.1, 3.0]));
    settings.0.insert("iso-colors".into(), SettingValue::Names(vec!["#ff8000".into(), "#00ff00".into()]));
    let budget = Settings([("presence".into(), SettingValue::Number(20.0))].into());
    let dataset = DatasetRef {
        path: "snapdir/box \"1\".hdf5".into(),
        fingerprint: Some(Fingerprint { bytes: 123_456_789_012, crc32c: u32::MAX }),
        families: Some(vec![crate::model::FamilyName::Gas, crate::model::FamilyName::BlackHoles]),
        offset: [0.5, -1.0, 1e3],
        scale: Some(0.25),
        said: HeightsSaid {
            taken_for: Some(TakenFor::Heights),
            nodata: Some(-9999.0),
            spacing: Some([0.5, 2.0]),
            xy_unit: Some(Unit::new("um")),
            height_unit: Some(Unit::new("nm")),
            texture: Some(PhotoChoice { path: "photo.jpg".into(), rectangle: Some([-1.0, 0.0, 1.0, 2.5]) }),
            before: Some("before.df".into()),
            derive: crate::model::DerivedQuantity::ALL.to_vec(),
        },
        own_look: Some(OwnLook {
            mode: Some(&volume_isosurface::MODE),
            settings: Settings([("isovalues".to_owned(), SettingValue::Numbers(vec![0.5, 2.0]))].into_iter().collect()),
            attribute: Some(Attribute::Named("metallicity".into())),
            transfer: Some(TransferFunction::of_values(true)),
        }),
    };
    SceneFile {
        version: VERSION_TIME,
        look: LookPatch {
            mode: Some(&volume_isosurface::MODE),
            settings,
            budget,
            attribute: Some(Attribute::Named("temperature".into())),
            families: Some(vec![crate::model::FamilyName::Stars]),
            time: Some(When::ScaleFactor(0.4)),
            interpolation: Some(crate::hierarchy::spacetime::Interpolation::Linear),
            transfer: Some(TransferFunction {
                range: Range::Fixed(1e-3, 7.5),
                hue: Some(Hue { reverse: true, ..Hue::default() }),
                ..TransferFunction::default()
            }),
            annotations: Some(Annotations { caption: "a \"box\"".into(), scale: Some(1.5), ..Annotations::default() }),
            error_px: Some(1.25),
            cut: Some(crate::view::CutSettings {
                clip: Some(ClipBox { min: DVec3::splat(-1.5), max: DVec3::new(1.0, 2.0, 3.0) }),
                slab: Some(Slab { axis: Axis::Y, middle: 0.25, thickness: 0.1 }),
                fade: Some(Fade { start: 10.0, length: 3.5 }),
                periodic: crate::view::Periodic::Tiled([2, 3, 1]),
            }),
            selections: Some(vec![
                SelectionSet::new(
                    "core",
                    Region::sphere(DVec3::new(0.1, 0.2, 0.3), 1.0 / 3.0)
                        .with_range("temperature", Some(1e4), Some(1e6))
                        .with_family(crate::model::FamilyName::Gas),
                    2,
                ),
                SelectionSet {
                    show: Show::Alone,
                    follow: true,
                    members: Members::Ids(IdSet::new(vec![1, 2, 3, 9, u64::MAX])),
                    ..SelectionSet::new("ids", Region::whole(), 0)
                },
            ]),
            paths: Some(PathSettings {
                of: Some(PathsOf::Selections(vec!["core".into()])),
                tail: Span::Steps(2.5),
                level: Some(3),
                focus: Some(Focus::Selection("ids".into())),
                shape: PathShape::Arrow,
                color: "#ff8000".into(),
                opacity: 0.5,
                ..PathSettings::default()
            }),
            background: Some(crate::color::composite::Background::Transparent),
            exposure: Some(crate::color::ExposureMode::Adaptive { bright: 0.25, dark: 2.0 }),
            bloom: Some(crate::color::Bloom { strength: 0.3, threshold: 0.7, radius: 0.05 }),
        },
        size: Some((976, 720)),
        camera: Some(camera(0.0)),
        projection: crate::view::Surround::Dome { aperture: 210.0, tilt: 15.0 },
        stereo: Some(crate::view::Stereo {
            kind: crate::view::StereoKind::Omnidirectional,
            separation: 0.1,
            zero_parallax: 3.0,
            eyes: crate::view::Eyes::OverUnder,
        }),
        bookmarks: vec![
            Bookmark { key: 0, name: "the \"halo\"".into(), camera: camera(1.0) },
            Bookmark { key: 9, name: String::new(), camera: Camera { ortho: None, ..camera(2.0) } },
        ],
        labels: Some("groups.hdf5".into()),
        panels: Panels { shown: false, closed: Some(vec!["data".into()]) },
        plot: Some(PlotSettings {
            kind: PlotKind::Phase,
            x: "density".into(),
            y: "temperature".into(),
            of: PlotOf::Selection("core".into()),
            ..PlotSettings::default()
        }),
        film: Some(Film {
            from: Some(Box::new(SceneFile {
                labels: Some("haloes.csv".into()),
                ..SceneFile::new(vec![dataset.clone()])
            })),
            share: 0.25,
            overlay: Overlay {
                caption: "Words\nin two lines".into(),
                caption_opacity: 0.5,
                images: vec![crate::annotate::overlay::Picture {
                    path: "logo.png".into(),
                    anchor: Corner::TopLeft,
                    height: 0.1,
                    margin: 0.02,
                    opacity: 0.75,
                }],
            },
        }),
        ..SceneFile::new(vec![dataset])
    }
}

fn text(scene: &SceneFile) -> String {
    scene.text(Path::new("a.scene.ron")).unwrap()
}

fn parse(text: &str) -> Result<SceneFile, String> {
    SceneFile::parse("a.scene.ron", text).map_err(|error| error.to_string())
}

#[test]
fn a_full_scene_and_an_empty_one_come_back_as_they_were() {
    let scene = full();
    assert_eq!(parse(&text(&scene)).unwrap(), scene, "{}", text(&scene));
    let little = parse("(version: 1, datasets: [(path: \"box.df\")])").unwrap();
    let dataset = DatasetRef { path: "box.df".into(), ..DatasetRef::default() };
    assert_eq!(little, SceneFile::new(vec![dataset]));
    assert_eq!(parse(&text(&little)).unwrap(), little);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scene.ron");
    scene.write(&path).unwrap();
    assert_eq!(SceneFile::read(&path).unwrap(), scene);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
}

/// Places of the field names and map keys in a scene's text: from the first letter to the colon.
fn names(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut names = Vec::new();
    let (mut start, mut quoted) = (0, false);
    for (at, c) in text.char_indices().skip_while(|(at, _)| *at < text.find('(').unwrap()) {
        match c {
            '"' if !text[..at].ends_with('\\') => {
                quoted = !quoted;
                if quoted {
                    start = at + 1;
                }
            }
            ':' if !quoted => names.push(start..at - usize::from(text[..at].ends_with('"'))),
            _ if quoted => {}
            _ if c.is_alphanumeric() || c == '_' || c == '"' => {}
            _ => start = at + 1,
        }
    }
    names
}

/// The value behind a colon: until the comma or bracket that ends it.
fn value_at(text: &str, colon: usize) -> std::ops::Range<usize> {
    let start = colon + 1 + text[colon + 1..].find(|c: char| !c.is_whitespace()).unwrap();
    let (mut depth, mut quoted) = (0, false);
    for (at, c) in text[start..].char_indices() {
        match c {
            '"' if !text[..start + at].ends_with('\\') => quoted = !quoted,
            _ if quoted => {}
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' if depth > 0 => depth -= 1,
            ')' | ']' | '}' | ',' if depth == 0 => return start..start + at,
            _ => {}
        }
    }
    panic!("a value without end at {start}");
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text[..at].matches('\n').count()
}

#[test]
fn every_field_misspelled_once_is_named_with_its_line() {
    let text = text(&full());
    let names = names(&text);
    assert!(names.len() > 60, "{names:?} in {text}");
    for name in names {
        let wrong = format!("{}x", &text[name.clone()]);
        let mutated = format!("{}{wrong}{}", &text[..name.start], &text[name.end..]);
        let message = parse(&mutated).unwrap_err();
        let place = format!("a.scene.ron:{}:", line_of(&text, name.start));
        assert!(message.starts_with(&place) && message.contains(&wrong), "{wrong}: {message}");
    }
}

#[test]
fn every_value_of_a_wrong_type_is_named_with_its_field() {
    let text = text(&full());
    for name in names(&text) {
        let field = &text[name.clone()];
        let colon = name.end + usize::from(text[name.end..].starts_with('"'));
        let value = value_at(&text, colon);
        let is_text = text[value.clone()].starts_with(['"', 't', 'f']) || text[value.clone()].starts_with("Some(\"");
        let wrong = if is_text { "12.5" } else { "\"wrong\"" };
        let mutated = format!("{}{wrong}{}", &text[..value.start], &text[value.end..]);
        let message = parse(&mutated).unwrap_err();
        assert!(message.starts_with("a.scene.ron:") && message.contains(field), "{field}: {message}");
    }
}

#[test]
fn values_out_of_range_are_named_with_their_place() {
    let set = |old: &str, new: &str| {
        let text = text(&full());
        assert!(text.contains(old), "{old} in {text}");
        parse(&text.replacen(old, new, 1)).unwrap_err()
    };
    for (old, new, expected) in [
        ("version: 2", "version: 0", ":3:5: version: found 0, expected 1 or 2"),
        ("version: 2", "version: 3", "version is 3, expected at most 2: a later deepfield"),
        ("\"volume-isosurface\"", "\"volumes\"", "mode: found volumes, expected one of column-density"),
        ("\"poly6\"", "\"gauss\"", "kernel: found gauss, expected one of data"),
        ("error_px: Some(1.25)", "error_px: Some(-1.0)", "error_px: found -1, expected 0.05 to 64"),
        ("(976, 720)", "(976, 0)", "size: found 976x0"),
        ("key: 9", "key: 0", "bookmarks: found key 0 twice"),
        ("key: 9", "key: 10", "key: found 10, expected 0 to 9"),
        ("fov: 45.00000000000001", "fov: 180.0", "fov: found 180, expected between 0 and 180"),
        ("ortho: Some(0.14285714285714285)", "ortho: Some(0.0)", "ortho: found 0, expected a finite height"),
        ("up: (0.0, 1.0, 0.0)", "up: (0.0, 0.0, 0.0)", "eye: found"),
        ("scale: Some(0.25)", "scale: Some(0.0)", "scale: found 0, expected a positive number"),
        ("1000.0)", "inf)", "offset: found [0.5, -1.0, inf], expected finite numbers"),
        ("thickness: 0.1", "thickness: 0.0", "thickness: found 0, expected a finite number above 0"),
    ] {
        let message = set(old, new);
        assert!(message.starts_with("a.scene.ron") && message.contains(expected), "{new}: {message}");
    }
    let quoted = parse("(version: 1, datasets: [(path: \"a.df\")], attribute: \"slope\")").unwrap_err();
    assert!(quoted.contains("attribute: Expected identifier: a word without quotes"), "{quoted}");
    let bare = parse("(version: 1, datasets: [(path: \"a.df\")], projection: dome)").unwrap_err();
    assert!(bare.contains("projection: Expected opening `(`, also before no fields, as in dome()"), "{bare}");
    let none = "(version: 1, datasets: [])";
    assert!(parse(none).unwrap_err().contains("datasets: found a list of 0, expected 1 to 64 datasets"));
}

#[test]
fn words_with_hyphens_stand_as_the_documents_have_them() {
    let scene = parse(
        "(version: 1, datasets: [(path: \"a.df\", families: [gas, black-holes])],
          stereo: (kind: off-axis, separation: 0.5, zero_parallax: 60.0, eyes: side-by-side))",
    )
    .unwrap();
    assert_eq!(scene.datasets[0].families, Some(vec![FamilyName::Gas, FamilyName::BlackHoles]));
    let read = parse(&text(&scene)).unwrap();
    assert!(read.stereo.is_some() && read == scene);
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]
    /// Cameras come back to the last bit, whatever they are.
    #[test]
    fn cameras_come_back_exactly(
        eye in prop::array::uniform3(prop_oneof![-1e9..1e9f64, -1e-300..1e-300f64]),
        target in prop::array::uniform3(-1e6..1e6f64),
        fov in 0.001..179.0f64,
        ortho in prop::option::of(1e-9..1e9f64),
    ) {
        let camera = Camera { eye, target, up: [0.0, 1.0, 0.0], fov, ortho };
        prop_assume!(camera.view(64, 64).is_ok());
        let scene = SceneFile { camera: Some(camera), ..full() };
        prop_assert_eq!(parse(&text(&scene)).unwrap().camera, Some(camera));
    }

    /// No text makes the reader panic.
    #[test]
    fn any_text_is_read_or_refused(at in 0usize..4000, byte in any::<char>()) {
        let mut text = text(&full());
        let at = (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
        text.insert(at, byte);
        let _ = parse(&text);
    }
}
