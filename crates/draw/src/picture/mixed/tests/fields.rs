//! Images and volumes among particles and heights.

use super::*;
use crate::build::grid::{GridBuildOptions, build_grid};
use crate::color::transfer::TransferFunction;
use crate::explore::export::grid::{GridFormat, write_grid};
use crate::import::{GridOptions, open_grid};
use crate::look::{OwnLook, TakenFor};
use crate::model::{Channel, Grid, SampleType};

/// Haze of a tenth opacity in two lengths, whatever the value.
const HAZE: &str = "(scale: linear, range: fixed(0.0, 255.0), color_map: [(0.0, \"#000000\"), (1.0, \"#ffffff\")], \
                    opacity: [(0.0, 0.1), (1.0, 0.1)], brightness: [(0.0, 0.0), (1.0, 1.0)], unit_length: fixed(2.0))";

/// A volume of bytes whose first sample is at the origin.
fn volume(folder: &Path, name: &str, shape: [u64; 3], value: impl Fn([u64; 3]) -> f64) -> PathBuf {
    let mut grid = Grid::volume(shape, SampleType::U8, Channel::numbered(1));
    grid.length_unit = Unit::new("m");
    let [x, y, z] = shape;
    let samples: Vec<u8> =
        (0..x * y * z).map(|i| value([i % x, i / x % y, i / (x * y)]).round().clamp(0.0, 255.0) as u8).collect();
    let path = folder.join(name);
    write_grid(&path, GridFormat::Nrrd, &grid, &samples).unwrap();
    path
}

/// A soft ball in a cube of 32.
fn ball(folder: &Path) -> PathBuf {
    volume(folder, "ball.nrrd", [32; 3], |at| {
        let r = at.map(|k| (k as f64 - 15.5).powi(2)).iter().sum::<f64>().sqrt();
        255.0 * (1.0 - r / 14.0).clamp(0.0, 1.0)
    })
}

fn transfer(text: &str) -> Option<TransferFunction> {
    Some(TransferFunction::parse(text, "t").unwrap())
}

fn mixed(members: &[Member]) -> MixedSession {
    MixedSession::open(members, SessionOptions::default(), [], |path| Ok(path.to_owned()), Arc::new(())).unwrap()
}

/// Straight along -z, above the middle of a cube of 32.
fn above(mode: Option<&str>, ortho: Option<f64>) -> Shot {
    let camera = CameraConfig {
        eye: Some([15.5, 15.5, 80.0]),
        target: Some([15.5, 15.5, 0.0]),
        up: Some([0.0, 1.0, 0.0]),
        fov: Some(30.0).filter(|_| ortho.is_none()),
        ortho,
    };
    let look = LookPatch { mode: mode.map(|name| modes::find(name).unwrap()), ..LookPatch::default() };
    Shot { look, camera, size: Some((96, 96)), ..Shot::default() }
}

/// What is seen of masses in haze is what the haze in front of them lets through: of points, of kernels of less than a pixel, and of wide ones.
#[test]
fn haze_dims_what_is_in_it_by_the_way_through() {
    let folder = tempfile::tempdir().unwrap();
    let haze = volume(folder.path(), "haze.nrrd", [32, 32, 24], |_| 100.0);
    let per_length = -(0.9_f64.ln()) / 2.0;
    for (mode, h) in [("points", 0.1), ("column-density", 0.05), ("column-density", 0.6), ("column-density", 4.0)] {
        for z in [-6.0, 2.0, 11.5, 18.0, 30.0] {
            let star = [(DVec3::new(15.5, 15.5, z), h, 1.0)];
            let star = particles(folder.path(), &format!("star {mode} {h} {z}.df"), &star, "m", None);
            let own_look = Some(OwnLook { transfer: transfer(HAZE), ..OwnLook::default() });
            let members = [Member::new(star), Member { own_look, ..Member::new(&haze) }];
            let sum = |members: &[Member]| {
                let picture = match members {
                    [only] => Session::open(
                        std::slice::from_ref(only),
                        SessionOptions::default(),
                        [],
                        |path| Ok(path.to_owned()),
                        Arc::new(()),
                    )
                    .unwrap()
                    .draw(&above(Some(mode), Some(20.0)))
                    .unwrap(),
                    members => mixed(members).draw(&above(Some(mode), Some(20.0))).unwrap(),
                };
                let Raw::Sums(sums, _) = picture.values else { panic!("sums") };
                sums.sum()
            };
            let found = sum(&members) / sum(&members[..1]);
            // Of a kernel, the mean of what is let through is that at its middle to the second order.
            let way = (23.5 - z).clamp(0.0, 24.0);
            let spread = if way > 0.0 && way < 24.0 { (per_length * h).powi(2) } else { 0.0 };
            let expected = (-per_length * way).exp();
            assert!((found - expected).abs() < 0.04 + spread, "{mode} {h} at {z}: {found}, expected {expected}");
        }
    }
}

/// What is seen through something has its own colour, dimmed: not the one that a logarithm gives to less of it.
#[test]
fn what_is_seen_through_is_dimmer_by_what_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let haze = volume(folder.path(), "haze.nrrd", [32, 32, 24], |_| 100.0);
    let star = particles(folder.path(), "star.df", &[(DVec3::new(15.5, 15.5, -4.0), 3.0, 1.0)], "m", None);
    let dark = HAZE.replace("#ffffff", "#000000");
    let own_look = Some(OwnLook { transfer: transfer(&dark), ..OwnLook::default() });
    let behind = [Member::new(&star), Member { own_look: own_look.clone(), ..Member::new(&haze) }];
    // The haze lies elsewhere.
    let free = [Member::new(&star), Member { own_look, offset: DVec3::X * 1e4, ..Member::new(&haze) }];
    let brightest = |members: &[Member], surround: Surround| {
        let mut shot = above(Some("column-density"), None);
        shot.surround = surround;
        if !surround.is_flat() {
            (shot.camera.eye, shot.size) = (Some([15.5, 15.5, 40.0]), Some((128, 64)));
        }
        let mut session = mixed(members);
        let picture = session.draw(&shot).unwrap();
        assert!(picture.unfiltered.is_some());
        let image = picture.image(&shot).unwrap();
        let (_, most) = session
            .image(&shot.look, &picture.annotation.view, None, 10.0, u64::MAX)
            .map(|(image, _)| most_of(&image))
            .map(|most| (0, most))
            .unwrap();
        (most_of(&image), most)
    };
    let let_through = 0.9_f64.powf(12.0);
    for surround in [Surround::Flat, Surround::Equirectangular] {
        let ((behind, seen), (free, seen_free)) = (brightest(&behind, surround), brightest(&free, surround));
        let pairs = if surround.is_flat() { vec![(behind, free), (seen, seen_free)] } else { vec![(behind, free)] };
        for (behind, free) in pairs {
            assert!(free > 100.0 && (behind / free - let_through).abs() < 0.05, "{surround:?}: {behind} of {free}");
        }
    }
}

/// The brightest value of a picture.
fn most_of(image: &Image) -> f64 {
    image.rgba.iter().flat_map(|color| &color[..3]).fold(0, |most: u8, value| most.max(*value)).into()
}

#[test]
fn each_is_drawn_in_its_own_mode() {
    let folder = tempfile::tempdir().unwrap();
    let (source, built) = (ball(folder.path()), folder.path().join("ball.df"));
    build_grid(&open_grid(&source, &GridOptions::default()).unwrap(), &GridBuildOptions::default(), &built, &())
        .unwrap();
    let stars: Vec<_> = (0..40)
        .map(|k| {
            let turn = f64::from(k) * 0.7;
            (DVec3::new(15.5 + 13.0 * turn.cos(), 15.5 + 13.0 * turn.sin(), f64::from(k % 30)), 0.3, 1.0)
        })
        .collect();
    let stars = Member::new(particles(folder.path(), "stars.df", &stars, "m", Some(1.0)));
    let [source, built] = [source, built].map(Member::new);
    for volume in [&source, &built] {
        // The first dataset says what a picture is about that names no mode.
        let mut session = mixed(&[volume.clone(), stars.clone()]);
        let picture = session.draw(&above(None, None)).unwrap();
        assert_eq!(picture.annotation.depiction.mode.name, "volume");
        assert!(picture.told.is_some() && picture.points.is_some() && picture.converged);
        let image = picture.image(&above(None, None)).unwrap();
        let mut other = mixed(&[stars.clone(), volume.clone()]);
        let picture = other.draw(&above(None, None)).unwrap();
        assert_eq!(picture.annotation.depiction.mode.name, "points");
        let same = picture.image(&above(None, None)).unwrap();
        let differs = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).any(|k| a[k].abs_diff(b[k]) > 1);
        assert!(!image.rgba.iter().zip(&same.rgba).any(differs), "one picture, told in two ways");
        let alone = FieldSession::open(&volume.path, SessionOptions::default(), Arc::new(())).unwrap();
        let alone = { alone }.draw(&above(None, None)).unwrap().image(&above(None, None)).unwrap();
        let lit = image.rgba.iter().zip(&alone.rgba).filter(|(a, b)| a != b).count();
        assert!((20..4000).contains(&lit), "{lit} pixels show stars");
        // A surface in front of stars hides them; the mode is the volume's, since particles have no density here that it is about.
        let own_look = Some(OwnLook { mode: modes::find("isosurface"), ..OwnLook::default() });
        let mut session = mixed(&[stars.clone(), Member { own_look, ..volume.clone() }]);
        session.draw(&above(None, None)).unwrap();
        for (mode, about) in
            [("volume", MemberKind::Field), ("slice", MemberKind::Field), ("points", MemberKind::Particles)]
        {
            let session = mixed(&[volume.clone(), stars.clone()]);
            assert_eq!(session.looks(&above(Some(mode), None).look).unwrap().about, about, "{mode}");
        }
        for mode in ["xray", "primitives"] {
            let refused = session.draw(&above(Some(mode), None)).err().unwrap().to_string();
            assert!(refused.contains("among other data") && refused.contains("volume-isosurface"), "{mode}: {refused}");
        }
    }
    // Voxels are particles where that is said.
    let mut members = [stars, source];
    say(&mut members, &HeightsSaid { taken_for: Some(TakenFor::Particles), ..HeightsSaid::default() });
    assert!(!MixedSession::is_for(&members));
}

/// An opaque surface hides what is behind it, and nothing of what is before it.
#[test]
fn surfaces_of_volumes_and_slices_hide_what_is_behind() {
    let folder = tempfile::tempdir().unwrap();
    let ball = ball(folder.path());
    for (mode, settings) in [("isosurface", r#"{"isovalues": [100.0], "iso-opacities": [1.0]}"#), ("slice", "{}")] {
        for (z, is_seen) in [(2.0, false), (14.0, false), (30.0, true)] {
            let star =
                particles(folder.path(), &format!("{mode}{z}.df"), &[(DVec3::new(15.5, 15.5, z), 0.5, 1.0)], "m", None);
            let settings: Settings = ron::from_str(settings).unwrap();
            let own_look = OwnLook { mode: modes::find(mode), settings, ..OwnLook::default() };
            let mut session = mixed(&[Member::new(star), Member { own_look: Some(own_look), ..Member::new(&ball) }]);
            let picture = session.draw(&above(Some("points"), Some(20.0))).unwrap();
            let Raw::Sums(sums, _) = picture.values else { panic!("sums") };
            assert_eq!(sums.sum() > 0.0, is_seen, "{mode}, a star at {z}: {}", sums.sum());
        }
    }
}

/// Where a volume lies is where it is drawn, whatever else there is.
#[test]
fn a_volume_lies_where_it_is_placed() {
    let folder = tempfile::tempdir().unwrap();
    let ball = ball(folder.path());
    let mut here = mixed(&[Member::new(&ball), Member { offset: DVec3::X * 1e6, ..Member::new(&ball) }]);
    let offset = DVec3::new(5.0, -3.0, 7.0);
    let moved = Member { offset, scale: Some(0.5), ..Member::new(&ball) };
    let far = Member { offset: DVec3::X * 1e6, ..Member::new(&ball) };
    let mut there = mixed(&[moved, far]);
    let own = above(None, None);
    let mut same = own.clone();
    let place = |at: [f64; 3]| (offset + 0.5 * DVec3::from(at)).to_array();
    (same.camera.eye, same.camera.target) = (own.camera.eye.map(place), own.camera.target.map(place));
    let [one, other] = [(&mut here, &own), (&mut there, &same)].map(|(session, shot)| {
        let mut shot = shot.clone();
        shot.look.transfer = transfer(&HAZE.replace("opacity: [(0.0, 0.1)", "opacity: [(0.0, 0.0)"));
        session.draw(&shot).unwrap().image(&shot).unwrap()
    });
    let most = one.rgba.iter().zip(&other.rgba).map(|(a, b)| (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap()).max();
    assert!(most.unwrap() <= 1 && one.rgba.iter().any(|color| color[0] > 50), "{most:?}");
}
