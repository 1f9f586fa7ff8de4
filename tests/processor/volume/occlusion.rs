//! Volumes hide what lies behind them (F12 5.7.2): what is hidden need not be there, and the picture is the same.

use crate::support::eclipse;
use deepfield::build::{BuildOptions, build};
use deepfield::color::transfer::{Range, TransferFunction};
use deepfield::hierarchy::{OctreeOptions, Purpose};
use deepfield::mode::{Depiction, LightPicture, Plan, SettingValue, Settings};
use deepfield::modes;
use deepfield::picture::Subject;
use deepfield::store::PageFile;
use deepfield::stream::{Scene, SceneSelection};
use deepfield::view::{Occluder, Projection, View};
use glam::DVec3;
use std::sync::Arc;

/// What a view is painted with: ranges and planes that do not depend on what is there.
fn paint(file: &PageFile, depiction: &Depiction, view: &View, selection: &SceneSelection) -> LightPicture {
    let transfer = TransferFunction { range: Range::Fixed(1e-2, 100.0), ..TransferFunction::of_volumes(false) };
    let subject = Subject::new(file.metadata(), depiction, &transfer, 4.0);
    subject.draw_nodes(view, &selection.nodes, &Plan::default()).unwrap().light(depiction.mode).unwrap()
}

#[test]
fn what_is_hidden_need_not_be_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("eclipse.df");
    let dataset = eclipse();
    for volume_levels in [true, false] {
        let octree = OctreeOptions { leaf_capacity: 200, volume_levels, ..OctreeOptions::default() };
        build(dataset.clone(), &BuildOptions { octree, ..BuildOptions::default() }, &path, &()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        let values = [("opacity", 2000.0), ("near", 0.5), ("far", 6.0)];
        let settings = values.map(|(name, value)| (name.to_owned(), SettingValue::Number(value)));
        let settings = Settings(settings.into_iter().collect());
        let mode = modes::find("volume").unwrap();
        let depiction = Depiction::new(mode, settings, None, file.metadata()).unwrap();
        assert_eq!(depiction.purpose(file.metadata()) == Purpose::Samples, volume_levels);
        let projection = Projection::Perspective { fov_y: 0.6 };
        let view = View::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y, projection, 200, 160).unwrap();
        let detail = depiction.detail(&view, 0.2, file.metadata());
        let mut scene = Scene::new(Arc::clone(&file), u64::MAX);
        scene.purpose = depiction.purpose(file.metadata());
        let whole = scene.converge_blocking(&view, detail).unwrap();
        let expected = paint(&file, &depiction, &view, &whole);
        // The first picture is coarse, and may hide too much; from then on each shows what to ask for.
        let coarse = scene.converge_blocking(&view, depiction.detail(&view, 30.0, file.metadata())).unwrap();
        let mut painted = paint(&file, &depiction, &view, &coarse);
        let mut before = None;
        let mut rounds = 0;
        let last = loop {
            scene.streamer.occluder = painted.report.opaque.clone().map(|opaque| opaque as Arc<dyn Occluder>);
            let selection = scene.converge_blocking(&view, detail).unwrap();
            assert!(selection.converged);
            let nodes: Vec<_> = selection.nodes.iter().map(|drawn| drawn.node).collect();
            if before.as_ref() == Some(&nodes) {
                break selection;
            }
            before = Some(nodes);
            painted = paint(&file, &depiction, &view, &selection);
            rounds += 1;
            assert!(rounds < 10, "it does not come to an end");
        };
        println!("{} of {} nodes, {} rounds", last.nodes.len(), whole.nodes.len(), rounds);
        assert!(last.nodes.len() * 4 < whole.nodes.len() * 3, "{} of {}", last.nodes.len(), whole.nodes.len());
        assert!(painted.colors.rgba.iter().filter(|color| color[3] > 0.99).count() > 3000);
        let differs = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-3);
        let differing = expected.colors.rgba.iter().zip(&painted.colors.rgba).filter(|(a, b)| differs(a, b)).count();
        assert_eq!(differing, 0);
    }
}
