//! What a picture need not read, since it hides it (F12 5.7.2), where no window shows pictures one after the other.
//!
//! What the picture before hides, or a small one, is an estimate: nodes behind it are drawn as they are, and nothing below them is
//! read. The picture itself then says whether it hides them too. If it does, no ray has read anything of them, whatever they
//! hold, and the picture is that of all nodes, bit by bit; if not, it is drawn again with what it hides itself, and in the end with
//! all nodes. That holds where nothing else depends on what is hidden ([`is_sure`]): ranges that are found from all that is in
//! view would, and so would slices up to the depth of the last particle.

use crate::color::transfer::{Range, TransferFunction};
use crate::cpu::volume::OpaqueDepths;
use crate::mode::{Depiction, Raw, Settings};
use crate::modes::grid;
use crate::store::NodeRef;
use crate::view::{Hidden, Occluder, PerspectiveGrid, Projection, View};
use std::sync::Arc;

/// Pictures that are drawn in the hope that they hide what was left out, before one is drawn of everything.
pub(super) const ATTEMPTS: usize = 2;
/// How much smaller than the picture each side of a sketch is, and its longer side at least, pixels: what is small hides nothing, since
/// some pixels around an extent count as well.
const SKETCH: f64 = 4.0;
const SKETCH_SIDE: f64 = 160.0;

/// What a picture hides, if anything.
pub(super) struct Hiding {
    /// Where it is opaque.
    pub opaque: Arc<OpaqueDepths>,
    mode: &'static str,
    settings: Settings,
}

/// Whether a picture does not depend on what it hides, as far as that is known before it is drawn: its ranges are numbers, and where
/// slices lie between the planes, the far one is set.
pub(super) fn is_sure(depiction: &Depiction, transfer: &TransferFunction) -> bool {
    let is_given = |range: Range| range != Range::Auto;
    let settings = &depiction.settings;
    depiction.needs().hides
        && settings.flag(&grid::OCCLUSION)
        && is_given(transfer.range)
        && (depiction.attribute.is_none() || transfer.hue.as_ref().is_none_or(|hue| is_given(hue.range)))
        && (!depiction.needs().slices || settings.number(&grid::FAR) > 0.0)
}

/// The view of a sketch.
pub(super) fn sketch_view(view: &View) -> View {
    let shrink = SKETCH.min(f64::from(view.width.max(view.height)) / SKETCH_SIDE).max(1.0);
    let side = |pixels: u32| ((f64::from(pixels) / shrink).round() as u32).max(1);
    view.resized(side(view.width), side(view.height))
}

impl Hiding {
    /// What a picture hides; `None` of one that does not say.
    pub fn of(depiction: &Depiction, values: &Raw) -> Option<Hiding> {
        let Raw::Light(light) = values else { return None };
        let opaque = light.report.opaque.clone()?;
        Some(Hiding { opaque, mode: depiction.mode.name, settings: depiction.settings.clone() })
    }

    /// Whether a depiction's pictures hide as much.
    pub fn is_of(&self, depiction: &Depiction) -> bool {
        self.mode == depiction.mode.name && self.settings == depiction.settings
    }

    /// Whether the picture that this is of shows that it would be the same with what was hidden from it: it hides that too, and its
    /// near plane is where it is for what is in front.
    pub fn shows(&self, hidden: &[Hidden<NodeRef>], values: &Raw, depiction: &Depiction) -> bool {
        let Raw::Light(light) = values else { return false };
        let [near, far] = light.report.planes;
        let is_flat = matches!(self.opaque.view().projection, Projection::Orthographic { .. });
        let is_set = depiction.settings.number(&grid::NEAR) > 0.0;
        let has_own_near = is_set || is_flat || near > PerspectiveGrid::NEAREST * far;
        has_own_near && hidden.iter().all(|hidden| self.opaque.hides(&hidden.extent))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::build::{self, BuildOptions};
    use crate::hierarchy::OctreeOptions;
    use crate::look::{CameraConfig, LookPatch, Shot};
    use crate::mode::SettingValue;
    use crate::model::{Dataset, Family, FamilyName, Kernel, Provenance, Unit};
    use crate::modes;
    use crate::picture::{Picture, Session};
    use crate::store::PageFile;
    use crate::synth::random::Random;
    use proptest::prelude::*;
    use proptest::test_runner::TestRunner;
    use std::cell::Cell;
    use std::path::Path;

    /// A dense block in front of a wide cloud.
    #[derive(Clone, Copy, Debug)]
    struct Eclipse {
        particles: usize,
        /// Edge of the block, and how far it is shifted to the right.
        block: [f64; 2],
        /// Edge of the cloud.
        cloud: f64,
        /// Smoothing lengths of block and cloud.
        lengths: [f32; 2],
        /// Densities of block and cloud are 4e4 and 2e3 such units.
        unit: f32,
    }

    const ECLIPSE: Eclipse =
        Eclipse { particles: 60_000, block: [0.8, 0.0], cloud: 2.0, lengths: [0.08, 0.06], unit: 1.0 };

    impl Eclipse {
        fn dataset(&self) -> Dataset {
            let mut random = Random::new(7, 7);
            let mut family = Family {
                name: FamilyName::Gas,
                positions: Vec::new(),
                mass: Vec::new(),
                smoothing_length: Vec::new(),
                density: Vec::new(),
                attributes: Vec::new(),
            };
            for i in 0..self.particles {
                let at = [0; 3].map(|_| 0.5 * random.signed());
                let is_block = i % 3 == 0;
                let (scale, x, z) =
                    if is_block { (self.block[0], self.block[1], 1.0) } else { (self.cloud, 0.0, -2.0) };
                family.positions.push([scale * at[0] + x, scale * at[1], scale * at[2] + z]);
                family.smoothing_length.push(self.lengths[usize::from(!is_block)]);
                family.mass.push(if is_block { 1.0 } else { 0.4 });
                family.density.push(self.unit * if is_block { 4e4 } else { 2e3 });
            }
            Dataset {
                families: vec![family],
                length_unit: Unit::default(),
                mass_unit: Unit::default(),
                kernel: Kernel::CubicSpline,
                skipped: Vec::new(),
                provenance: Provenance::default(),
            }
        }

        fn file(&self, path: &Path, volume_levels: bool) -> Arc<PageFile> {
            let octree = OctreeOptions { leaf_capacity: 200, volume_levels, ..OctreeOptions::default() };
            build::build(self.dataset(), &BuildOptions { octree, ..BuildOptions::default() }, path, &()).unwrap();
            Arc::new(PageFile::open(path).unwrap())
        }
    }

    /// Settings that make each mode opaque where the block is, and `own`, as far as the mode has them.
    fn shot(mode: &str, camera: CameraConfig, range: Range, own: &[(&str, SettingValue)]) -> Shot {
        let mode = modes::find(mode).unwrap();
        let mut settings = Settings::default();
        let numbers = |values: &[f64]| SettingValue::Numbers(values.to_vec());
        let usual = [
            ("opacity", SettingValue::Number(50.0)),
            ("near", SettingValue::Number(0.5)),
            ("far", SettingValue::Number(6.0)),
            ("isovalues", numbers(&[1e3, 1e4])),
            ("iso-opacities", numbers(&[0.3, 1.0])),
            ("threshold", SettingValue::Number(1e3)),
        ];
        for (name, value) in usual.iter().chain(own) {
            if mode.own_settings().any(|setting| setting.name == *name) {
                settings.0.insert((*name).to_owned(), value.clone());
            }
        }
        let transfer = TransferFunction { range, ..TransferFunction::of_volumes(false) };
        let (mode, transfer) = (Some(mode), Some(transfer));
        let look = LookPatch { mode, settings, transfer, error_px: Some(0.2), ..LookPatch::default() };
        Shot { look, camera, size: Some((120, 96)), ..Shot::default() }
    }

    fn camera(eye: [f64; 3]) -> CameraConfig {
        let (target, up) = (Some([0.0; 3]), Some([0.0, 1.0, 0.0]));
        CameraConfig { eye: Some(eye), target, up, fov: Some(34.0), ortho: None }
    }

    fn occlusion(is_on: bool) -> (&'static str, SettingValue) {
        ("occlusion", SettingValue::Flag(is_on))
    }

    fn bits(picture: &Picture) -> Vec<u32> {
        let Raw::Light(light) = &picture.values else { panic!("colours") };
        light.colors.rgba.as_flattened().iter().map(|channel| channel.to_bits()).collect()
    }

    const RANGE: Range = Range::Fixed(1.0, 1e6);

    #[test]
    fn pictures_are_the_same_to_the_bit_without_what_they_hide() {
        let folder = tempfile::tempdir().unwrap();
        let [plain, with_levels] =
            [false, true].map(|levels| ECLIPSE.file(&folder.path().join(format!("{levels}.df")), levels));
        for (mode, file) in [
            ("volume", &with_levels),
            ("isosurface", &with_levels),
            ("volume-isosurface", &plain),
            ("layered", &plain),
            ("sorted-splats", &plain),
            ("spheres", &plain),
        ] {
            let mut session = Session::of(Arc::clone(file), u64::MAX);
            // After a sketch, as a tour's camera goes on, and from where the picture before tells nothing.
            for (eye, is_near) in [([0.0, 0.0, 3.0], true), ([0.03, 0.01, 2.98], true), ([0.9, 0.0, 2.6], false)] {
                let shot = |is_on: bool| shot(mode, camera(eye), RANGE, &[occlusion(is_on)]);
                let found = session.draw(&shot(true)).unwrap();
                let all = Session::of(Arc::clone(file), u64::MAX).draw(&shot(false)).unwrap();
                println!("{mode} {eye:?}: {} of {} nodes", found.nodes, all.nodes);
                assert!(bits(&found) == bits(&all), "{mode}, {eye:?}");
                assert!(
                    found.converged && (found.nodes < all.nodes || !is_near),
                    "{mode}, {eye:?}: {} nodes",
                    found.nodes
                );
            }
            // Ranges that are found from all that is there need all that is there: a volume and splats are all ways to find them.
            if !["volume", "layered"].contains(&mode) {
                continue;
            }
            let auto = |is_on: bool| {
                let shot = shot(mode, camera([0.0, 0.0, 3.0]), Range::Auto, &[occlusion(is_on)]);
                Session::of(Arc::clone(file), u64::MAX).draw(&shot).unwrap()
            };
            let (found, all) = (auto(true), auto(false));
            assert!(found.nodes == all.nodes && bits(&found) == bits(&all), "{mode}");
        }
    }

    /// What nobody sees may cast shadows: then nothing is left out. Surfaces become darker, and nothing else changes.
    #[test]
    fn what_casts_shadows_is_not_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let eclipse = Eclipse { particles: 12_000, lengths: [0.12, 0.1], ..ECLIPSE };
        let file = eclipse.file(&folder.path().join("eclipse.df"), false);
        let number = |name: &'static str, number: f64| (name, SettingValue::Number(number));
        let numbers = |name: &'static str, numbers: [f64; 2]| (name, SettingValue::Numbers(numbers.to_vec()));
        // The first one is rough.
        let surfaces = [numbers("isovalues", [300.0, 2e3]), numbers("iso-opacities", [0.9, 1.0])];
        for mode in ["isosurface", "volume-isosurface", "spheres"] {
            let draw = |own: &[(&str, SettingValue)]| {
                let own = [&surfaces[..], own].concat();
                let shot = shot(mode, camera([0.9, 0.7, 2.9]), RANGE, &own);
                // As fine as the shadows of rough surfaces.
                let shot = Shot { size: Some((160, 128)), ..shot };
                Session::of(Arc::clone(&file), u64::MAX).draw(&shot).unwrap()
            };
            let plain = draw(&[]);
            let off = draw(&[number("ambient-occlusion", 0.0), number("shadows", 0.0), number("light-size", 5.0)]);
            assert!(bits(&plain) == bits(&off), "{mode}");
            let lamp = [number("shadows", 1.0), number("light-size", 0.0), number("shadow-azimuth", 60.0)];
            let cast = draw(&lamp);
            let all = draw(&[&lamp[..], &[occlusion(false)]].concat());
            assert!(bits(&cast) == bits(&all) && cast.nodes == all.nodes, "{mode}");
            let hidden = draw(&[number("ambient-occlusion", 1.0), number("occlusion-radius", 0.1)]);
            for picture in [&cast, &hidden] {
                let (Raw::Light(plain), Raw::Light(dark)) = (&plain.values, &picture.values) else { panic!("colours") };
                let mut darkest = 1.0f32;
                for (plain, dark) in plain.colors.rgba.iter().zip(&dark.colors.rgba) {
                    assert!((plain[3] - dark[3]).abs() < 1e-3, "{mode}: {plain:?} {dark:?}");
                    assert!((0..3).all(|k| dark[k] <= plain[k] + 1e-3), "{mode}: {plain:?} {dark:?}");
                    if plain[0] > 0.05 {
                        darkest = darkest.min(dark[0] / plain[0]);
                    }
                }
                assert!(darkest < 0.8, "{mode}: {darkest}");
            }
        }
    }

    /// What hides and what is hidden, in files whose densities are not in the unit of their masses too, seen from anywhere.
    #[test]
    fn whatever_hides_something_changes_no_bit_of_the_picture() {
        let folder = tempfile::tempdir().unwrap();
        let modes = ["layered", "sorted-splats", "spheres"];
        let scene =
            (0.4..1.2, -0.3..0.3, 0.8..2.5, 0.05..0.1f32, 0.03..0.12f32, prop::sample::select(vec![1.0, 1e-4, 1e6f32]));
        let eye = (-0.6..0.6, -0.6..0.6, 2.2..4.0, prop::option::of(1.0..3.0));
        let looks = (0..modes.len(), prop::sample::select(vec![10.0, 50.0, 400.0]), prop::bool::ANY);
        let saved = modes.map(|_| Cell::new(0));
        let config = ProptestConfig { cases: 36, failure_persistence: None, ..ProptestConfig::default() };
        let tried =
            TestRunner::new(config).run(&(scene, eye, looks), |(scene, (x, y, z, ortho), (mode, opacity, nearest))| {
                let (block, shift, cloud, near, far, unit) = scene;
                let eclipse = Eclipse { particles: 24_000, block: [block, shift], cloud, lengths: [near, far], unit };
                let file = eclipse.file(&folder.path().join("eclipse.df"), false);
                let own = [
                    ("opacity", SettingValue::Number(opacity)),
                    // Below the data's densest in each unit.
                    ("threshold", SettingValue::Number(1.0)),
                    ("assignment", SettingValue::Name(if nearest { "nearest" } else { "kernel" }.into())),
                ];
                let camera = match ortho {
                    Some(_) => CameraConfig { ortho, fov: None, ..camera([x, y, z]) },
                    None => camera([x, y, z]),
                };
                let draw = |is_on: bool| {
                    let own = [&own[..], &[occlusion(is_on)]].concat();
                    Session::of(Arc::clone(&file), u64::MAX).draw(&shot(modes[mode], camera, RANGE, &own)).unwrap()
                };
                let (found, all) = (draw(true), draw(false));
                saved[mode].set(saved[mode].get() + all.nodes - found.nodes);
                prop_assert!(bits(&found) == bits(&all), "{} of {} nodes", found.nodes, all.nodes);
                Ok(())
            });
        tried.unwrap();
        for (mode, saved) in modes.iter().zip(&saved) {
            assert!(saved.get() > 100, "{mode}: {} nodes", saved.get());
        }
    }
}
