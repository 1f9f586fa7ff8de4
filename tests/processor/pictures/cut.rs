//! What a view leaves out and fades: the picture's integral is that of the particles that are left, from a page file and from
//! the source, and nodes beyond the box are not selected.

use crate::support::{built, demo, draw_nodes, draw_source, sum_nodes};
use deepfield::codec::VqBits;
use deepfield::cpu::Method;
use deepfield::mode::{Depiction, Plan, Settings};
use deepfield::model::Bounds;
use deepfield::modes;
use deepfield::stream::Scene;
use deepfield::view::cut::{Axis, ClipBox, Fade, Slab};
use deepfield::view::{Cut, CutSettings, Projection, View};
use glam::DVec3;
use std::sync::Arc;

/// An orthographic view of all of a box.
fn view_of(bounds: Bounds, cut: Cut) -> View {
    let eye = bounds.center() + DVec3::new(0.2, 0.1, 1.0) * 3.0 * bounds.size().length();
    let projection = Projection::Orthographic { height: 2.0 * bounds.size().length() };
    View::look_at(eye, bounds.center(), DVec3::Y, projection, 200, 200).unwrap().with_cut(cut)
}

#[test]
fn the_picture_holds_the_mass_that_is_left() {
    let built = built(&demo(), VqBits::Sixteen);
    let (file, dataset) = (&built.file, &built.dataset);
    let metadata = file.metadata();
    let bounds = metadata.bounds();
    let at = |share: f64| bounds.min + share * bounds.size();
    let clip = Some(ClipBox { min: at(0.2), max: at(0.7) });
    let slab = Some(Slab { axis: Axis::Y, middle: at(0.5).y, thickness: 0.1 * bounds.size().y });
    let fade = Some(Fade { start: 3.0 * bounds.size().length(), length: 0.3 * bounds.size().length() });
    let mut nodes_drawn = Vec::new();
    for settings in [
        CutSettings::default(),
        CutSettings { clip, ..CutSettings::default() },
        CutSettings { slab, ..CutSettings::default() },
        CutSettings { fade, ..CutSettings::default() },
        CutSettings { clip, slab, fade, ..CutSettings::default() },
    ] {
        let cut = settings.cut();
        let view = view_of(bounds, cut);
        let masses = dataset.families.iter().flat_map(|family| family.positions.iter().zip(&family.mass));
        let left = masses.filter(|(position, _)| cut.keeps(DVec3::from_array(**position)));
        let mass: f64 = left
            .map(|(position, mass)| f64::from(*mass) * cut.fade(view.to_camera(DVec3::from_array(*position)).z))
            .sum();
        let pixel = (2.0 * bounds.size().length() / 200.0).powi(2);
        let exact = draw_source(dataset, "column-density", &view, Method::Exact).sum() * pixel;
        assert!((exact / mass - 1.0).abs() < 1e-4, "{settings:?}: {exact} of {mass}");

        let mode = modes::find("column-density").unwrap();
        let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
        let mut scene = Scene::new(Arc::clone(file), u64::MAX);
        let selection = scene.converge_blocking(&view, 0.001).unwrap();
        let found = sum_nodes(&view, &depiction, metadata, &selection.nodes).sum() * pixel;
        // Particles that the quantised positions move across a face: few.
        assert!((found / mass - 1.0).abs() < 2e-3, "{settings:?}: {found} of {mass}");
        nodes_drawn.push(selection.nodes.len());
        assert!(
            selection.nodes.iter().all(|drawn| { cut.reaches(&drawn.page.nodes[drawn.node.node as usize].bounds) })
        );
    }
    let [all, clipped, sliced, faded, both] = nodes_drawn[..] else { panic!("{nodes_drawn:?}") };
    assert!(clipped < all && sliced < all && both < clipped, "nodes beyond the box are selected: {nodes_drawn:?}");
    assert_eq!(faded, all);
}

/// Modes that draw colours get the same particles: outside of a slab at the data's edge there is nothing of them.
#[test]
fn every_mode_of_colors_leaves_out_the_same() {
    let built = built(&demo(), VqBits::Eight);
    let metadata = built.file.metadata();
    let bounds = metadata.bounds();
    let slab = Slab { axis: Axis::X, middle: bounds.min.x, thickness: bounds.size().x };
    let cut = CutSettings { slab: Some(slab), ..CutSettings::default() }.cut();
    let eye = bounds.center() + 3.0 * bounds.size().z * DVec3::Z;
    let projection = Projection::Orthographic { height: 1.2 * bounds.size().y };
    let view = View::look_at(eye, bounds.center(), DVec3::Y, projection, 64, 64).unwrap().with_cut(cut);
    let selection = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap();
    for mode in modes::all().into_iter().filter(|mode| mode.is_light() && mode.takes_particles() && !mode.is_of_paths())
    {
        let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
        let drawn = draw_nodes(&view, &depiction, metadata, &selection.nodes, Method::Pyramid, &Plan::default());
        let image = drawn.light(mode).unwrap().colors.image();
        let light = |columns: std::ops::Range<usize>| -> u64 {
            let pixels = (0..64).flat_map(|y| columns.clone().map(move |x| y * 64 + x));
            pixels.map(|at| image.rgba[at][..3].iter().map(|&c| u64::from(c)).sum::<u64>()).sum()
        };
        let (kept, left_out) = (light(0..32), light(40..64));
        assert!(kept > 0 && left_out * 50 < kept, "{}: {left_out} beside {kept}", mode.name);
    }
}
