//! Fields of particles' columns by compute passes against the processor's: the same nodes, settings and colours.

use crate::support::{built_from_dataset, view_from};
use crate::volumes::difference;
use deepfield::codec::VqBits;
use deepfield::gpu::Offscreen;
use deepfield::look::LookPatch;
use deepfield::mode::{Depiction, Plan, SettingValue, Settings};
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
