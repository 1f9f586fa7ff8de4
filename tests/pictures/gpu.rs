//! Page files on the GPU techniques: the same selection, the same picture and the same colours as on the CPU.

use crate::golden;
use crate::support::{built, demo, view_from};
use deepfield::codec::VqBits;
use deepfield::gpu::{Backend, HeadlessFrame, HeadlessRequest, render_headless};
use deepfield::modes::gpu::request_nodes;
use deepfield::modes::{self, Depiction, Settings, cpu};
use deepfield::raster::accumulation::relative_error;
use deepfield::raster::composite::composite;
use deepfield::raster::transfer::TransferFunction;
use deepfield::raster::{Accumulation, Method};
use deepfield::store::PageFile;
use deepfield::stream::Scene;
use deepfield::view::View;
use glam::DVec3;
use std::sync::Arc;

const BACKENDS: [Backend; 2] = [Backend::Compute, Backend::Raster];

/// One selection, drawn by the CPU and by a GPU technique, with its mode's usual colours.
fn draw_both(file: &Arc<PageFile>, mode: &str, view: &View, backend: Backend) -> (Accumulation, HeadlessFrame) {
    let metadata = file.metadata();
    let mode = modes::find(mode).unwrap();
    let depiction = Depiction::of_pages(mode, Settings::default(), None, metadata).unwrap();
    let selection = Scene::new(Arc::clone(file), u64::MAX).converge_blocking(view, 0.8).unwrap();
    let nodes = cpu::decode(&depiction, metadata, &selection.nodes);
    let cpu = cpu::draw_nodes(view, &depiction, metadata, &nodes, Method::Pyramid).unwrap();
    let transfer = TransferFunction::preset(mode.transfer[usize::from(cpu.has_attribute())]);
    let request = request_nodes(view, &depiction, metadata, &selection.nodes, backend);
    (cpu, render_headless(HeadlessRequest { transfer, ..request }).unwrap())
}

#[test]
fn every_mode_draws_its_golden_image_on_the_gpu() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_from(&built.dataset, DVec3::new(0.35, 0.3, 1.0), 1.5, 240, 160);
    for mode in modes::MODES {
        for backend in BACKENDS {
            let (cpu, gpu) = draw_both(&built.file, mode.name, &view, backend);
            let (_, error) = relative_error(&gpu.accumulation.p, &cpu.p);
            assert!(error < 1e-3, "{} on {}: L2 of P {error}", mode.name, backend.name());
            golden::check_against(mode.name, &gpu.picture.unwrap());
        }
    }
}

#[test]
fn near_and_far_views_agree_with_the_cpu() {
    let built = built(&demo(), VqBits::Eight);
    for distance in [0.05, 0.4, 6.0] {
        let view = view_from(&built.dataset, DVec3::new(-0.7, 0.2, 0.4), distance, 300, 200);
        for backend in BACKENDS {
            let (cpu, gpu) = draw_both(&built.file, "density-squared", &view, backend);
            let (l1, l2) = relative_error(&gpu.accumulation.p, &cpu.p);
            println!("distance {distance}, {}: L1 {l1}, L2 {l2}", backend.name());
            assert!(l1 < 1e-3 && l2 < 1e-3, "distance {distance}, {}: L1 {l1}, L2 {l2}", backend.name());
        }
    }
}

#[test]
fn colors_are_the_cpus() {
    let built = built(&demo(), VqBits::Eight);
    let view = view_from(&built.dataset, DVec3::new(0.35, 0.3, 1.0), 1.5, 161, 90);
    for mode in ["column-density", "density-squared", "points"] {
        let (_, gpu) = draw_both(&built.file, mode, &view, Backend::Compute);
        let preset = modes::find(mode).unwrap().transfer[usize::from(gpu.accumulation.has_attribute())];
        let expected = composite(&gpu.accumulation, &TransferFunction::preset(preset).unwrap());
        let found = gpu.picture.unwrap();
        let difference =
            expected.rgba.as_flattened().iter().zip(found.rgba.as_flattened()).map(|(a, b)| a.abs_diff(*b));
        assert!(difference.max().unwrap() <= 1, "{mode}");
    }
}
