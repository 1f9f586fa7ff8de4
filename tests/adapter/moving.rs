//! What moves, evaluated where it is drawn: one copy serves every moment of an interval, and the picture is that of particles which the
//! processor has moved, one by one, in double precision.

use crate::support::view_of;
use deepfield::bench::flight::canvas::{Canvas, GpuCanvas};
use deepfield::build::{BuildOptions, RunBuild, TrackOptions};
use deepfield::color::accumulation::relative_error;
use deepfield::gpu::depiction::request_nodes;
use deepfield::gpu::{Backend, DeviceOptions, HeadlessRenderer};
use deepfield::hierarchy::Purpose;
use deepfield::hierarchy::spacetime::Interpolation;
use deepfield::import::{LoadOptions, RunOptions, open_run};
use deepfield::mode::{Depiction, Plan, Raw, Settings};
use deepfield::model::{Moment, ReadMethod};
use deepfield::modes;
use deepfield::store::run::RunTree;
use deepfield::store::{RunFile, Tree};
use deepfield::stream::{CopyOptions, SceneNode, StreamOptions, Streamer};
use deepfield::synth::moving::{self, Births, Halo, Moving, Pancake};
use deepfield::view::View;
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn run(folder: &Path, kind: &dyn Moving, times: &[f64]) -> Arc<RunFile> {
    let files = moving::write(kind, times, 3, &folder.join("run"), &()).unwrap();
    let (load, options, tracks) = (LoadOptions::default(), BuildOptions::default(), TrackOptions::default());
    let run = open_run(&files, &RunOptions::default(), ReadMethod::default()).unwrap();
    let build = RunBuild { load: &load, options: &options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    build.build(run, &folder.join("run.df"), &()).unwrap();
    Arc::new(RunFile::open(&folder.join("run.df"), ReadMethod::default()).unwrap())
}

/// Nodes of a view once everything is there that it needs.
fn converged(streamer: &mut Streamer, canvas: &mut dyn Canvas, view: &View, tau: f64) -> Vec<SceneNode> {
    let families = 0..streamer.residency.tree().metadata().families.len() as u32;
    for _ in 0..2000 {
        streamer.arrive();
        canvas.receive(streamer);
        let roots = streamer.roots(families.clone(), Purpose::Splats, view.time);
        let chosen = streamer.select(view, tau, &roots);
        streamer.serve();
        streamer.take_evicted();
        canvas.copy(streamer);
        let node = |id, offset, error_pixels| {
            let page = Arc::clone(streamer.residency.page(id).unwrap());
            (page, offset, error_pixels)
        };
        let nodes: Vec<SceneNode> = chosen
            .draw
            .iter()
            .map(|drawn| {
                let (page, offset, error_pixels) = node(drawn.id.page, drawn.offset, drawn.error_pixels);
                SceneNode { page, node: drawn.id, error_pixels, offset, time: view.time, part: None }
            })
            .collect();
        // A frame carries out what is queued.
        canvas.draw(view, &nodes, &Plan::default()).unwrap();
        if chosen.is_converged() && !nodes.is_empty() {
            return nodes;
        }
        streamer.wait(Duration::from_millis(5));
    }
    panic!("not converged");
}

#[test]
fn a_copy_serves_every_moment_of_its_interval() {
    let evenly = |kind: &dyn Moving| moving::times(kind, 3, 1.0, 3);
    let (births, pancake, halo) = (Births::new(5, 6000, 3), Pancake::new(2, 8000), Halo::new(2, 6000));
    let kinds: [(&str, &dyn Moving, Vec<f64>); 3] = [
        ("births", &births, evenly(&births)),
        ("pancake", &pancake, evenly(&pancake)),
        // Much of it fades.
        ("halo", &halo, vec![0.0, 5.0, 10.0]),
    ];
    for (number, (name, kind, times)) in kinds.into_iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let run = run(folder.path(), kind, &times);
        for (way, interpolation) in [Interpolation::Auto, Interpolation::Linear].into_iter().enumerate() {
            let tree = Arc::new(RunTree::new(Arc::clone(&run), interpolation).unwrap());
            let drawn = Arc::clone(&tree) as Arc<dyn Tree>;
            let bounds = tree.metadata().bounds();
            let view = view_of(bounds, DVec3::new(0.35, 0.3, 1.0), 1.6, 160, 120);
            let mut beside = HeadlessRenderer::bare(&DeviceOptions::default(), Backend::Auto).unwrap();
            // Each interpolation and each kind with both of them.
            let mode = modes::find(["column-density", "density-squared"][(number + way) % 2]).unwrap();
            let depiction = Depiction::new(mode, Settings::default(), None, tree.metadata()).unwrap();
            let copies = CopyOptions { budget: 256 << 20, on_their_way: 16 << 20 };
            let mut gpu = GpuCanvas::open(Arc::clone(&drawn), depiction.clone(), Backend::Auto, &view, copies).unwrap();
            let request = |view: &View, nodes: &[SceneNode]| {
                request_nodes(view, &depiction, tree.metadata(), nodes, &Plan::default(), Backend::Auto)
            };
            let mut streamer = Streamer::new(Arc::clone(&tree), StreamOptions::default());
            streamer.keep_copies(gpu.copies());
            let copied = |streamer: &Streamer| streamer.copies.as_ref().unwrap().copied_bytes();
            let mut of_interval = None;
            for u in [0.0, 0.25, 0.6, 0.99] {
                let view = View { time: tree.time(Moment { step: 1, u }), ..view };
                let nodes = converged(&mut streamer, &mut gpu, &view, 0.0);
                beside.load(&request(&view, &nodes)).unwrap();
                beside.complete().unwrap();
                let (expected, _) = beside.accumulation(depiction.attribute.is_some()).unwrap();
                let Raw::Sums(found, _) = gpu.picture().unwrap() else { panic!("sums") };
                for (found, expected) in [(&found.p, &expected.p), (&found.ps, &expected.ps)] {
                    assert_eq!(found.len(), expected.len());
                    let (l1, l2) = relative_error(found, expected);
                    assert!(l1 < 1e-5 && l2 < 1e-5, "{name} {} at {u}: L1 {l1}, L2 {l2}", mode.name);
                }
                assert_eq!(*of_interval.get_or_insert(copied(&streamer)), copied(&streamer), "{name} at {u}");
                assert!(copied(&streamer) > 0);
            }
        }
    }
}
