//! Periodic boxes: images add up to what one gets by drawing the box from shifted eyes, and wrapping moves each particle to its
//! nearest image; from a page file as from the source.

use crate::support::{built, demo, draw_source, sum_nodes};
use deepfield::codec::VqBits;
use deepfield::color::Accumulation;
use deepfield::color::accumulation::relative_error;
use deepfield::cpu::Method;
use deepfield::mode::{Depiction, Settings};
use deepfield::modes;
use deepfield::stream::Scene;
use deepfield::view::{CutSettings, Periodic, Projection, View};
use glam::DVec3;
use std::sync::Arc;

const SIDE: u32 = 120;

fn view(target: DVec3, height: f64) -> View {
    let eye = target + DVec3::new(0.3, 0.2, 1.0) * 4.0 * height;
    View::look_at(eye, target, DVec3::Y, Projection::Orthographic { height }, SIDE, SIDE).unwrap()
}

#[test]
fn images_add_up_and_wrapping_keeps_the_mass() {
    let built = built(&demo(), VqBits::Sixteen);
    let (file, dataset) = (&built.file, &built.dataset);
    let metadata = file.metadata();
    let periodic = metadata.periodic_box();
    let edge = periodic.unwrap().edge;
    assert_eq!(dataset.periodic_box().map(|of| of.edge), Some(edge));
    let pages = |view: &View| -> Accumulation {
        let mode = modes::find("column-density").unwrap();
        let depiction = Depiction::new(mode, Settings::default(), None, metadata).unwrap();
        let selection = Scene::new(Arc::clone(file), u64::MAX).converge_blocking(view, 0.01).unwrap();
        sum_nodes(view, &depiction, metadata, &selection.nodes)
    };
    let source = |view: &View| draw_source(dataset, "column-density", view, Method::Pyramid);
    let target = DVec3::new(0.05, 0.9, 0.3) * edge;

    let plain = view(target, 1.7 * edge);
    let tiled = CutSettings { periodic: Periodic::Tiled([3, 1, 2]), ..CutSettings::default() };
    let tiled = tiled.applied(&plain, target, periodic);
    let mut sum = vec![0.0f32; (SIDE * SIDE) as usize];
    for i in [-1.0, 0.0, 1.0] {
        for k in [0.0, 1.0] {
            let shifted = View { eye: plain.eye - edge * DVec3::new(i, 0.0, k), ..plain };
            source(&shifted).p.iter().zip(&mut sum).for_each(|(&p, sum)| *sum += p);
        }
    }
    for (name, picture) in [("source", source(&tiled)), ("pages", pages(&tiled))] {
        let (l1, l2) = relative_error(&picture.p, &sum);
        assert!(l1 < 2e-2 && l2 < 4e-2, "{name}: {l1} {l2}");
    }

    let whole = view(target, 3.0 * edge);
    let wrapped = CutSettings { periodic: Periodic::Wrapped, ..CutSettings::default() };
    let wrapped = wrapped.applied(&whole, target, periodic);
    let mass: f64 = metadata.families.iter().map(|family| family.mass).sum();
    let pixel = (3.0 * edge / f64::from(SIDE)).powi(2);
    for (name, picture) in [("source", source(&wrapped)), ("pages", pages(&wrapped))] {
        let found = picture.sum() * pixel;
        assert!((found / mass - 1.0).abs() < 2e-3, "{name}: {found} of {mass}");
        // The middle of what is drawn is the target: nothing is farther than half the box, and kernels, from it.
        let reach = 0.5 * edge * 3f64.sqrt() + 0.1 * edge;
        let far = reach / (3.0 * edge) * f64::from(SIDE);
        let middle = 0.5 * f64::from(SIDE);
        let outside = (0..SIDE * SIDE).filter(|at| {
            let (x, y) = (f64::from(at % SIDE) + 0.5, f64::from(at / SIDE) + 0.5);
            (x - middle).hypot(y - middle) > far
        });
        let lost: f64 = outside.map(|at| f64::from(picture.p[at as usize])).sum();
        assert!(lost * pixel < 1e-3 * mass, "{name}: {lost}");
    }
}
