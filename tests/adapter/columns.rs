//! Fields of particles' columns by compute passes against the processor's: the same nodes, settings and colours.

use crate::clouds::difference;
use crate::support::{built_from_dataset, view_from};
use deepfield::codec::VqBits;
use deepfield::gpu::column_tables::ColumnTables;
use deepfield::gpu::content_look::ContentLook;
use deepfield::gpu::page_copies::{self, CopyState};
use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, HeadlessRenderer, HeadlessRequest, Offscreen, SplatView, VolumeJob, VolumeView,
};
use deepfield::look::LookPatch;
use deepfield::mode::{Depiction, LightPasses, Plan, SettingValue, Settings};
use deepfield::modes;
use deepfield::picture::Subject;
use deepfield::picture::adapter::{AdapterJob, Passes, draw_on};
use deepfield::picture::look::transfer_of;
use deepfield::store::{InMemory, Metadata, Tree};
use deepfield::stream::{Scene, SceneNode, first_nodes};
use deepfield::synth::merger::Merger;
use deepfield::view::View;
use glam::DVec3;
use std::sync::Arc;

/// Settings that are names.
fn named(names: &[(&str, &str)]) -> Settings {
    Settings(names.iter().map(|(setting, name)| ((*setting).into(), SettingValue::Name((*name).into()))).collect())
}

/// Draws nodes with both, and compares the pictures.
fn compare(
    adapter: &mut Offscreen,
    (view, metadata, nodes): (&View, &Metadata, &[SceneNode]),
    (mode, attribute, settings): (&str, Option<&str>, Settings),
    what: &str,
) {
    let mode = modes::find(mode).unwrap();
    let depiction = Depiction::new(mode, settings, attribute, metadata).unwrap();
    let transfer = transfer_of(&LookPatch::default(), &depiction);
    let subject = Subject::new(metadata, &depiction, &transfer, metadata.bounds().size().length());
    let plan = Plan::default();
    let passes = Passes::Compute;
    let job = AdapterJob { view, depiction: &depiction, metadata, nodes, plan: &plan, passes, light: None, repeat: 1 };
    let (found, frame) = draw_on(adapter, &subject, job).unwrap();
    let (found, expected) = (found.light(mode).unwrap(), subject.draw_nodes(view, nodes, &plan).unwrap());
    let expected = expected.light(mode).unwrap();
    assert_eq!((found.levels, found.isovalues), (expected.levels, expected.isovalues), "{what}");
    let particles =
        nodes.iter().map(|drawn| u64::from(drawn.page.nodes[drawn.node.node as usize].particles)).sum::<u64>();
    assert_eq!(found.report.particles, particles, "{what}: each counts once");
    let shown = expected.colors.rgba.iter().filter(|pixel| pixel[3] > 0.02).count();
    let (l2, most) = difference(&found.colors, &expected.colors);
    println!("{what}: L2 {l2:.2e}, at most {most:.2e}, {shown} pixels by {}", frame.backend);
    // A value between two hues may be rounded to either.
    assert!(shown > 100 && l2 < 2e-4, "{what}: L2 {l2}, at most {most}, {shown} pixels");
}

#[test]
fn fields_of_columns_look_as_on_the_processor() {
    let dataset = deepfield::synth::dataset(&Merger::new(3, 800));
    let mut adapter = Offscreen::preferred();
    let view = view_from(&dataset, DVec3::new(0.35, 0.3, 1.0), 1.1, 64, 64);

    // Source particles, which are there once for each column.
    let tree = InMemory::new(dataset.clone());
    let nodes = first_nodes(&tree, &view).unwrap();
    let source = (&view, tree.metadata(), &nodes[..]);
    let heat = named(&[("field", "internal-energy")]);
    compare(&mut adapter, source, ("volume", Some("temperature"), heat), "a mean, opaque by density");

    // Coded ones, which have a table for each.
    let built = built_from_dataset(dataset, VqBits::Twelve);
    let selection = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap();
    let coded = (&view, built.file.metadata(), &selection.nodes[..]);
    let sum = named(&[("field", "internal-energy"), ("field-sum", "plain"), ("field-opacity", "field")]);
    compare(&mut adapter, coded, ("volume", None, sum), "a plain sum");
    // Four columns, and rays between the centres of cells.
    let mut hot = named(&[("field", "smoothing-length"), ("surface-field", "internal-energy")]);
    hot.0.insert("resolution".into(), SettingValue::Number(0.6));
    compare(&mut adapter, coded, ("volume-isosurface", Some("temperature"), hot), "surfaces of another column");
}

/// As a window draws them: from copies of pages that are on the adapter once, with the plan that the processor has found.
#[test]
fn copies_of_pages_show_fields_as_files_do() {
    let dataset = deepfield::synth::dataset(&Merger::new(3, 800));
    let view = view_from(&dataset, DVec3::new(0.35, 0.3, 1.0), 1.1, 64, 64);
    let built = built_from_dataset(dataset, VqBits::Twelve);
    let metadata = built.file.metadata();
    let nodes = Scene::new(Arc::clone(&built.file), u64::MAX).converge_blocking(&view, 0.8).unwrap().nodes;
    let mode = modes::find("volume").unwrap();
    let settings = named(&[("field", "internal-energy")]);
    let depiction = Depiction::new(mode, settings, Some("temperature"), metadata).unwrap();
    let transfer = transfer_of(&LookPatch::default(), &depiction);
    let subject = Subject::new(metadata, &depiction, &transfer, metadata.bounds().size().length());
    let plan = Plan::default();
    let job = AdapterJob {
        view: &view,
        depiction: &depiction,
        metadata,
        nodes: &nodes,
        plan: &plan,
        passes: Passes::Compute,
        light: None,
        repeat: 1,
    };
    let (expected, _) = draw_on(&mut Offscreen::preferred(), &subject, job).unwrap();
    let expected = expected.light(mode).unwrap();

    let mut renderer = HeadlessRenderer::bare(&DeviceOptions::default(), Backend::Compute).unwrap();
    renderer.load(&HeadlessRequest::without_particles(&view, true)).unwrap();
    let scene = renderer.scene().clone();
    let look = Arc::new(ContentLook::new(depiction.clone(), metadata));
    let mut pages: Vec<_> = nodes.iter().map(|drawn| &drawn.page).collect();
    pages.sort_by_key(|page| page.id.0);
    pages.dedup_by_key(|page| page.id.0);
    pages.iter().for_each(|page| page_copies::insert(&scene, 0, page, &look));
    while pages.iter().any(|page| page_copies::state(&scene, 0, page) == CopyState::Waiting) {
        renderer.frame().unwrap();
    }
    let light = subject.light_of_fields(&view, &nodes, &plan).unwrap().unwrap();
    assert_eq!(light.levels, expected.levels);
    let LightPasses::Columns(march) = &light.passes else { panic!("{:?}", light.passes) };
    let tables = ColumnTables::new(&scene, &depiction, metadata);
    let (items, extents) = tables.items(&march.columns, &nodes, (0, &view), (&depiction, metadata, &plan));
    assert_eq!(items.len(), 3 * nodes.len(), "energies, densities and temperatures");
    let job = VolumeJob::picture_of(1, &light.passes, &view, &extents, true).unwrap();
    renderer.show(SplatView {
        view,
        footprint: Footprint::Kernel(metadata.kernel),
        backend: Backend::Compute,
        culling: true,
        faintest: 0.0,
        items: items.into(),
        always: false,
        keeps_last: false,
    });
    let volume = VolumeView {
        extents: extents.into(),
        light: job,
        ranges: None,
        ranges_only: false,
        attribute: true,
        memory: 256 << 20,
        slabs: 2,
    };
    let (found, ..) = renderer.volume(volume, 1).unwrap();
    let (l2, most) = difference(&found, &expected.colors);
    assert!(l2 < 2e-4, "L2 {l2}, at most {most}");
}
