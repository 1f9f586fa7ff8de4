//! Sampled volumes by compute passes against the processor's march: the same samples, grid and settings.

use crate::clouds::difference;
use crate::support::run;
use deepfield::color::Colors;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::field::Field;
use deepfield::cpu::shadowing::Lighting;
use deepfield::cpu::volume::VolumeReport;
use deepfield::gpu::{DeviceOptions, HeadlessRenderer, HeadlessRequest, Offscreen, VolumeJob, VolumeView};
use deepfield::mode::{FieldJob, FieldPasses, FieldValues, SettingValue, Settings, ValueStatistics};
use deepfield::model::{Bounds, Channel, Grid, SampleType, Unit};
use deepfield::modes;
use deepfield::picture::adapter::{Adapter as _, AdapterField, AdapterFrame, AdapterValues};
use deepfield::view::cut::Cut;
use deepfield::view::{Projection, View};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Samples, and what is known of their values.
struct Volume {
    field: Arc<Field>,
    statistics: [ValueStatistics; 2],
}

/// Blobs in a box that lies askew, with a hole in it; another channel, with a hole of its own, rises along a diagonal. `lift` times the exponential
/// of what the first channel would be makes all of it positive, over decades.
fn volume(lift: Option<f64>) -> Volume {
    let shape = [44, 37, 29];
    let mut grid = Grid::volume(shape, SampleType::F32, Channel::numbered(2));
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.8);
    // Spacings that differ, and axes that are not square to each other.
    let sheared =
        DMat3::from_cols(DVec3::new(0.11, 0.0, 0.0), DVec3::new(0.03, 0.13, 0.0), DVec3::new(0.0, 0.02, 0.17));
    grid.to_world = DAffine3::from_mat3_translation(turned * sheared, DVec3::new(400.0, -150.0, 90.0));
    let blobs = [([12.0, 14.0, 9.0], 5.0), ([28.0, 20.0, 17.0], 7.0), ([34.0, 9.0, 8.0], 4.0)];
    let at = |i: u64| [i % shape[0], i / shape[0] % shape[1], i / (shape[0] * shape[1])].map(|index| index as f64);
    let away = |a: [f64; 3], b: [f64; 3]| DVec3::from(a).distance_squared(DVec3::from(b));
    let value = |i: u64| {
        let at = at(i);
        if away(at, [26.0, 24.0, 18.0]) < 12.0 {
            return f32::NAN;
        }
        let blob = |(center, radius): &([f64; 3], f64)| (-away(at, *center) / (2.0 * radius * radius)).exp();
        let sum = blobs.iter().map(blob).sum::<f64>();
        lift.map_or(400.0 * sum - 100.0, |lift| lift * (7.0 * sum).exp()) as f32
    };
    let hue = |i: u64| {
        let [x, y, z] = at(i);
        if away([x, y, z], [12.0, 16.0, 10.0]) < 6.0 { f32::NAN } else { (0.4 * x + y - 0.5 * z) as f32 }
    };
    let count: u64 = shape.iter().product();
    let channels = [(0..count).map(value).collect::<Vec<f32>>(), (0..count).map(hue).collect()];
    let statistics = [0, 1].map(|channel: usize| ValueStatistics::of(&channels[channel]));
    let names = ["value", "hue"];
    let channels = channels.into_iter().zip(names).map(|(values, name)| (name.into(), Unit::default(), values));
    Volume { field: Arc::new(Field::new(&grid, channels.collect(), None)), statistics }
}

/// A picture, and how it is drawn.
struct Wanted<'a> {
    mode: &'static str,
    settings: &'a [(&'static str, f64)],
    transfer: Option<&'a str>,
    hue: bool,
    view: View,
}

impl Wanted<'_> {
    fn with_job<T>(&self, volume: &Volume, with: impl FnOnce(&FieldJob<'_>) -> T) -> T {
        let settings = self.settings.iter().map(|(name, value)| ((*name).to_owned(), SettingValue::Number(*value)));
        let transfer = self.transfer.map(|text| TransferFunction::parse(text, "test").unwrap());
        let [shown, hue] = &volume.statistics;
        with(&FieldJob {
            view: &self.view,
            field: &volume.field,
            points: None,
            hue: self.hue.then_some(1),
            values: FieldValues { shown, hue: self.hue.then_some(hue), is_volume: true },
            settings: &Settings(settings.collect()),
            transfer: transfer.as_ref(),
            diameter: volume.field.diameter(),
            paths: None,
            lighting: Lighting::default(),
        })
    }

    fn processor(&self, volume: &Volume) -> (Colors, VolumeReport) {
        let mode = modes::find(self.mode).unwrap();
        let light = self.with_job(volume, |job| mode.draw_field(job)).unwrap().light(mode).unwrap();
        (light.colors, light.report)
    }

    fn passes(&self, volume: &Volume) -> FieldPasses {
        let mode = modes::find(self.mode).unwrap();
        self.with_job(volume, |job| mode.field_passes(job)).unwrap().unwrap()
    }

    fn adapter(&self, volume: &Volume, adapter: &mut Offscreen) -> AdapterFrame {
        let passes = self.passes(volume);
        let hue = self.hue.then_some(1);
        let job = AdapterField { view: &self.view, field: &volume.field, hue, passes: &passes, repeat: 1 };
        adapter.field(&job).unwrap()
    }
}

fn light(frame: AdapterFrame) -> (Colors, VolumeReport) {
    match frame.values {
        AdapterValues::Light(colors, report) => (colors, report),
        AdapterValues::Sums(_) => panic!("sums"),
    }
}

/// Holds the adapter's picture against the processor's.
fn compare(adapter: &mut Offscreen, volume: &Volume, wanted: &Wanted<'_>, what: &str) -> (Colors, VolumeReport) {
    let (expected, by_processor) = wanted.processor(volume);
    let (found, report) = light(wanted.adapter(volume, adapter));
    let (error, most) = difference(&found, &expected);
    println!("{what}: {error:.2e}, at most {most:.2e}; {} slabs, {} bricks", report.slabs, report.bricks);
    assert!(error < 5e-5, "{what}: {error:.2e}, at most {most:.2e}");
    assert_eq!(report.grid, by_processor.grid, "{what}");
    assert!(report.bricks > 0, "{what}: {report:?}");
    (found, report)
}

const PERSPECTIVE: Projection = Projection::Perspective { fov_y: 0.7 };

fn view(volume: &Volume, projection: Projection, distance: f64) -> View {
    let middle = volume.field.bounds().center();
    let eye = middle + distance * volume.field.diameter() * DVec3::new(0.5, 0.3, 1.0).normalize();
    View::look_at(eye, middle, DVec3::new(0.2, 1.0, 0.1), projection, 150, 110).unwrap()
}

fn orthographic(volume: &Volume) -> Projection {
    Projection::Orthographic { height: 0.8 * volume.field.diameter() }
}

/// A view that shows a part of the field alone.
fn cut(volume: &Volume, view: View) -> View {
    let bounds = volume.field.bounds();
    let size = bounds.size();
    let kept = Bounds { min: bounds.min + 0.3 * size * DVec3::new(1.0, 0.5, 1.0), max: bounds.max - 0.25 * size };
    view.with_cut(Cut { bounds: kept, ..Cut::NONE })
}

#[test]
fn volumes_and_surfaces_of_samples_are_those_of_the_processor() {
    let volume = volume(None);
    let mut adapter = Offscreen::preferred();
    for mode in ["volume", "isosurface", "volume-isosurface"] {
        for (name, projection) in [("perspective", PERSPECTIVE), ("orthographic", orthographic(&volume))] {
            let whole = view(&volume, projection, 1.1);
            for (hue, is_cut) in [(false, false), (true, false), (true, true)] {
                let view = if is_cut { cut(&volume, whole) } else { whole };
                let wanted = Wanted { mode, settings: &[], transfer: None, hue, view };
                compare(&mut adapter, &volume, &wanted, &format!("{mode}, {name}, hue {hue}, cut {is_cut}"));
            }
        }
    }
}

#[test]
fn decades_are_placed_by_their_logarithm() {
    let volume = volume(Some(0.02));
    let mut adapter = Offscreen::preferred();
    let plain = "(scale: log, range: fixed(0.1, 20.0), opacity: [(0.0, 0.0), (0.2, 0.02), (1.0, 0.9)])";
    let with_hue = "(scale: log, range: fixed(0.1, 20.0), opacity: [(0.0, 0.0), (0.2, 0.02), (1.0, 0.9)], \
                    hue: (scale: linear, range: fixed(0.0, 40.0), color_map: \"turbo\"))";
    for mode in ["volume", "volume-isosurface"] {
        for (hue, transfer) in [(false, plain), (true, with_hue)] {
            let view = view(&volume, PERSPECTIVE, 0.9);
            let wanted = Wanted { mode, settings: &[], transfer: Some(transfer), hue, view };
            compare(&mut adapter, &volume, &wanted, &format!("{mode}, log, hue {hue}"));
        }
    }
}

#[test]
fn cells_are_filled_from_means_and_slab_by_slab() {
    let volume = volume(None);
    let mut adapter = Offscreen::preferred();
    // From within, so that cells are finer than samples near the eye and coarser far away; few cells; thin slabs.
    let from_within = view(&volume, Projection::Perspective { fov_y: 1.4 }, 0.25);
    let far = view(&volume, PERSPECTIVE, 6.0);
    for (what, view, settings) in [
        ("from within", from_within, vec![("near", 0.02), ("resolution", 0.5), ("slab-memory", 1.0)]),
        ("few cells", view(&volume, PERSPECTIVE, 1.1), vec![("resolution", 0.1)]),
        ("from afar", far, vec![]),
        ("opaque", view(&volume, PERSPECTIVE, 0.8), vec![("opacity", 500.0), ("slab-memory", 1.0)]),
    ] {
        let wanted = Wanted { mode: "volume", settings: &settings, transfer: None, hue: true, view };
        let (_, report) = compare(&mut adapter, &volume, &wanted, what);
        assert!(!settings.iter().any(|(name, _)| *name == "slab-memory") || report.slabs > 1, "{what}: {report:?}");
    }
}

#[test]
fn other_samples_take_the_place_of_those_before() {
    let mut adapter = Offscreen::preferred();
    let (one, other) = (volume(None), volume(Some(3.0)));
    let of = |volume: &Volume| Wanted {
        mode: "volume",
        settings: &[],
        transfer: None,
        hue: false,
        view: view(volume, PERSPECTIVE, 1.0),
    };
    let (first, _) = compare(&mut adapter, &one, &of(&one), "one");
    compare(&mut adapter, &other, &of(&other), "other");
    let (again, _) = compare(&mut adapter, &one, &of(&one), "one again");
    assert!(first == again, "the same samples from the same camera");
}

#[test]
fn line_integrals_are_those_of_the_processor() {
    let volume = volume(None);
    let mut adapter = Offscreen::preferred();
    let mode = modes::find("xray").unwrap();
    let whole = view(&volume, PERSPECTIVE, 1.1);
    for (what, view) in [
        ("perspective", whole),
        ("orthographic", view(&volume, orthographic(&volume), 1.1)),
        ("cut", cut(&volume, whole)),
        ("from within", view(&volume, Projection::Perspective { fov_y: 1.4 }, 0.2)),
        ("from afar", view(&volume, PERSPECTIVE, 9.0)),
    ] {
        let wanted = Wanted { mode: "xray", settings: &[], transfer: None, hue: false, view };
        let (expected, _) = wanted.with_job(&volume, |job| mode.draw_field(job)).unwrap().sums(mode).unwrap();
        let AdapterValues::Sums(found) = wanted.adapter(&volume, &mut adapter).values else { panic!("no sums") };
        let pairs = || found.p.iter().zip(&expected.p).map(|(a, b)| [f64::from(*a), f64::from(*b)]);
        let square: f64 = pairs().map(|[a, b]| (a - b) * (a - b)).sum();
        let norm: f64 = pairs().map(|[_, b]| b * b).sum();
        let error = (square / norm).sqrt();
        println!("xray, {what}: {error:.2e}");
        assert!(norm > 0.0 && error < 5e-5, "{what}: {error:.2e}");
    }
}

/// Where the adapter has no room for all samples, means take their place, and that is told.
#[test]
fn little_memory_makes_samples_coarser() {
    let volume = volume(None);
    let view = view(&volume, PERSPECTIVE, 1.0);
    let wanted = Wanted { mode: "volume", settings: &[], transfer: None, hue: false, view };
    let FieldPasses::March(march) = wanted.passes(&volume) else { panic!("no march") };
    // A stand-in for memory, of which adapters have more than a test may take.
    let limits = wgpu::Limits { max_texture_dimension_3d: 32, ..wgpu::Limits::default() };
    let device = DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() };
    let request = HeadlessRequest { device, ..HeadlessRequest::without_particles(&view, false) };
    let mut renderer = HeadlessRenderer::open(&request).unwrap();
    let job = VolumeJob::of_field(1, &view, &volume.field, None, &march);
    let (found, findings, _) = renderer.volume(VolumeView::of_field(job, u64::MAX, 4), 1).unwrap();
    assert_eq!(findings.coarser, Some((1, 1)));
    let (expected, _) = wanted.processor(&volume);
    let (error, _) = difference(&found, &expected);
    assert!(error > 1e-3 && error < 0.2, "means of two along each axis: {error}");

    // Windows of the picture, where cells of all of it do not fit into a buffer.
    let limits =
        wgpu::Limits { max_storage_buffer_binding_size: 4 << 20, max_buffer_size: 4 << 20, ..Default::default() };
    let device = DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() };
    let large = Wanted { view: view.resized(500, 300), ..wanted };
    let FieldPasses::March(march) = large.passes(&volume) else { panic!("no march") };
    let request = HeadlessRequest { device, ..HeadlessRequest::without_particles(&large.view, false) };
    let mut renderer = HeadlessRenderer::open(&request).unwrap();
    let job = VolumeJob::of_field(2, &large.view, &volume.field, None, &march);
    let (found, findings, _) = renderer.volume(VolumeView::of_field(job, u64::MAX, 4), 1).unwrap();
    let (error, most) = difference(&found, &large.processor(&volume).0);
    println!("windows: {error:.2e}, at most {most:.2e}, {:?} slabs", findings.slabs);
    assert!(findings.coarser.is_none() && findings.slabs[1] > 2 && error < 5e-5, "{error} {findings:?}");
}

#[test]
fn the_program_draws_samples_by_the_backend_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = run(folder, &["synth", "blobs", "--size", "40,36,32", "-o", "blobs.nrrd"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let draw = |mode: &str, backend: &str, more: &[&str]| {
        let words = ["render", "blobs.nrrd", "-o", "p.exr", "--mode", mode, "--backend", backend, "--size", "120x90"];
        let raw = format!("{mode}-{backend}.npy");
        let output = run(folder, &[&words[..], &["--raw", &raw, "--json", "told.json"], more].concat());
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{mode} {backend}: {told}");
        let json: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("told.json")).unwrap()).unwrap();
        let values: Vec<f32> = std::fs::read(folder.join(raw)).unwrap()[128..]
            .as_chunks::<4>()
            .0
            .iter()
            .map(|bytes| f32::from_le_bytes(*bytes))
            .collect();
        (values, json["backend"].as_str().unwrap().to_owned(), told)
    };
    let off = |a: &[f32], b: &[f32]| {
        let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>();
        (square(&mut a.iter().zip(b).map(|(a, b)| a - b)) / square(&mut b.iter().copied())).sqrt()
    };
    for (mode, more) in [("volume", &["--attribute", "gradient"][..]), ("isosurface", &[]), ("xray", &[])] {
        let (expected, by, _) = draw(mode, "cpu", more);
        assert_eq!(by, "cpu");
        let (found, by, told) = draw(mode, "compute", more);
        assert_eq!((by.as_str(), told.contains("processor")), ("compute", false), "{told}");
        let error = off(&found, &expected);
        assert!(error < 5e-5, "{mode}: {error}");
    }
    // A plane is the processor's, whatever is asked for, and the program says so.
    let (found, by, told) = draw("slice", "compute", &[]);
    assert!(by == "cpu" && told.contains("the processor draws the mode slice"), "{by}: {told}");
    assert_eq!(found, draw("slice", "cpu", &[]).0);
    let words = ["render", "blobs.nrrd", "-o", "p.png", "--mode", "volume", "--backend", "raster"];
    let refused = run(folder, &words);
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && told.contains("only compute and cpu draw the mode volume"), "{told}");
}
