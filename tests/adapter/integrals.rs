//! What the GPU backends accumulate, held against the CPU's exact integrals on the same particles.

use crate::adapters::Adapters;
use crate::support::Random;
use deepfield::codec::clusters::NO_CLASS;
use deepfield::codec::coordinates::{pack_grid, pack_leaf, unpack_grid, unpack_leaf};
use deepfield::color::Accumulation;
use deepfield::cpu::{Extent, Method, Positions, SplatOptions, Splats, draw};
use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, GpuError, HeadlessFrame, HeadlessNode, HeadlessRequest, NodeId, NodeUpload,
    Payload, RawParticle, TableEntry, Withheld, render_headless,
};
use deepfield::mode::sample::Sample;
use deepfield::model::{Bounds, Kernel};
use deepfield::view::{self, Projection, View};
use glam::DVec3;

struct Particles {
    positions: Vec<[f64; 3]>,
    smoothing_length: Vec<f32>,
    weight: Vec<f32>,
    attribute: Vec<f32>,
}

/// Particles around the origin, with smoothing lengths from `h_min` to `h_max`, evenly in their logarithm.
fn particles(n: usize, size: f64, h_min: f64, h_max: f64, seed: u64) -> Particles {
    let mut random = Random(seed);
    let mut all = Particles { positions: vec![], smoothing_length: vec![], weight: vec![], attribute: vec![] };
    for _ in 0..n {
        all.positions.push([0; 3].map(|_| size * (random.next() - 0.5)));
        all.smoothing_length.push((h_min * (h_max / h_min).powf(random.next())) as f32);
        all.weight.push((0.5 + random.next()) as f32);
        all.attribute.push((100.0 * random.next()) as f32);
    }
    all
}

/// The techniques, each forced.
pub const BACKENDS: [Backend; 2] = [Backend::Compute, Backend::Raster];
const CUBIC_SPLINE: Footprint = Footprint::Kernel(Kernel::CubicSpline);

impl Particles {
    fn cpu(&self, view: &View, footprint: Footprint) -> Accumulation {
        let (extent, kernel) = match footprint {
            Footprint::Kernel(kernel) => (Extent::World(&self.smoothing_length), kernel),
            Footprint::Pixels { radius } => (Extent::Pixels(radius), Kernel::CubicSpline),
        };
        let splats =
            Splats::new(Positions::World(&self.positions), extent, &self.weight, Some(&self.attribute)).unwrap();
        draw(view, &[splats], &SplatOptions { method: Method::Exact, kernel, ..SplatOptions::default() })
    }

    /// What a GPU draws of it, as one node of raw particles.
    fn request(&self, view: &View, footprint: Footprint, backend: Backend) -> HeadlessRequest {
        let raw = (0..self.positions.len())
            .map(|i| RawParticle {
                position: view.to_camera(DVec3::from_array(self.positions[i])).as_vec3().to_array(),
                smoothing_length: self.smoothing_length[i],
                weight: self.weight[i],
                attribute: self.attribute[i],
                density: 0.0,
                unused: 0.0,
            })
            .collect();
        request(view, footprint, backend, vec![node(DVec3::ZERO, 0.0, Payload::Camera(raw))], vec![])
    }

    fn gpu(&self, adapters: &mut Adapters, view: &View, footprint: Footprint, backend: Backend) -> HeadlessFrame {
        adapters.draw(self.request(view, footprint, backend))
    }
}

pub fn node(min: DVec3, size: f64, payload: Payload) -> HeadlessNode {
    let table = matches!(payload, Payload::Grid { .. } | Payload::Leaf { .. }).then_some(0);
    let upload = NodeUpload { id: NodeId { source: 0, page: 0, node: 0 }, min, size, payload };
    // Splats do without.
    let reach = view::Extent { bounds: Bounds::EMPTY, margin: 0.0 };
    HeadlessNode { upload, table, weight_scale: 1.0, offset: DVec3::ZERO, sample: Sample::ALL, limit: NO_CLASS, reach }
}

pub fn request(
    view: &View,
    footprint: Footprint,
    backend: Backend,
    nodes: Vec<HeadlessNode>,
    tables: Vec<Vec<TableEntry>>,
) -> HeadlessRequest {
    HeadlessRequest {
        view: *view,
        mode: None,
        footprint,
        backend,
        culling: true,
        faintest: 0.0,
        nodes,
        tables: tables.into_iter().map(Into::into).collect(),
        attribute: true,
        transfer: None,
        repeat: 1,
        device: DeviceOptions::default(),
    }
}

pub fn look(projection: Projection, width: u32, height: u32) -> View {
    View::look_at(DVec3::new(1.3, 0.7, 2.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
}

/// Both pictures agree to a relative L1 and L2 of `limit`, in `P` and in `P S`.
pub fn assert_same(name: &str, gpu: &HeadlessFrame, cpu: &Accumulation, limit: f64) {
    use deepfield::color::accumulation::relative_error;
    let errors = [relative_error(&gpu.accumulation.p, &cpu.p), relative_error(&gpu.accumulation.ps, &cpu.ps)];
    println!("{name}: {errors:?}, {:?}", gpu.stats);
    assert!(cpu.sum() > 0.0, "{name}: an empty picture proves nothing");
    for (l1, l2) in errors {
        assert!(l1 < limit && l2 < limit, "{name}: relative L1 {l1}, L2 {l2}");
    }
}

/// Both techniques agree with the exact integrals, in both projections.
fn compare(name: &str, particles: &Particles, footprint: Footprint) {
    let mut adapters = Adapters::default();
    for (projection, of_it) in [(ORTHO, "orthographic"), (PINHOLE, "perspective")] {
        let view = look(projection, 320, 240);
        let cpu = particles.cpu(&view, footprint);
        for backend in BACKENDS {
            let gpu = particles.gpu(&mut adapters, &view, footprint, backend);
            assert_eq!(gpu.stats.backend, backend.name());
            assert_same(&format!("{name}, {of_it}, {}", backend.name()), &gpu, &cpu, 1e-3);
        }
    }
}

pub const ORTHO: Projection = Projection::Orthographic { height: 1.2 };
pub const PINHOLE: Projection = Projection::Perspective { fov_y: 0.8 };

// The picture is 240 pixels high and shows about one unit: pixels are 1/200 to 1/240.
#[test]
fn small_splats() {
    compare("small", &particles(20_000, 1.0, 0.0002, 0.018, 1), CUBIC_SPLINE);
}

#[test]
fn medium_splats() {
    compare("medium", &particles(5_000, 1.0, 0.018, 0.1, 2), CUBIC_SPLINE);
}

#[test]
fn large_splats() {
    compare("large", &particles(500, 1.0, 0.1, 1.0, 3), CUBIC_SPLINE);
}

#[test]
fn other_kernels() {
    for kernel in Kernel::ALL {
        compare(kernel.name(), &particles(3_000, 1.0, 0.001, 0.3, 4), Footprint::Kernel(kernel));
    }
}

#[test]
fn discs_of_fixed_size() {
    let particles = particles(2_000, 1.0, 0.1, 0.2, 5);
    for radius in [0.7, 2.5, 6.0, 29.0] {
        compare(&format!("discs of {radius} pixels"), &particles, Footprint::Pixels { radius });
    }
}

#[test]
fn pictures_of_every_size() {
    // One pixel, one level, rows that no texture copy is aligned to, more rows than columns.
    let (particles, mut adapters) = (particles(500, 1.0, 0.01, 0.5, 6), Adapters::default());
    for (width, height) in [(1, 1), (7, 5), (33, 31), (61, 127), (255, 17)] {
        let view = look(PINHOLE, width, height);
        let cpu = particles.cpu(&view, CUBIC_SPLINE);
        for backend in BACKENDS {
            let gpu = particles.gpu(&mut adapters, &view, CUBIC_SPLINE, backend);
            // In a few pixels the errors of the splats do not average out: 1.9e-3 in a single one.
            assert_same(&format!("{width}x{height}, {}", backend.name()), &gpu, &cpu, 2.2e-3);
        }
    }
}

#[test]
fn nothing_in_view_is_black() {
    let mut particles = particles(1_000, 1.0, 0.01, 0.1, 7);
    particles.positions.iter_mut().for_each(|position| position[0] += 100.0);
    for backend in BACKENDS {
        for empty in [false, true] {
            let view = look(PINHOLE, 64, 48);
            let mut request = particles.request(&view, CUBIC_SPLINE, backend);
            if empty {
                request.nodes.clear();
            }
            let frame = render_headless(request).unwrap();
            assert!(frame.accumulation.p.iter().chain(&frame.accumulation.ps).all(|&value| value == 0.0));
            assert!(frame.stats.splats.is_none_or(|splats| splats == 0));
        }
    }
}

#[test]
fn work_is_split_where_buffers_are_small() {
    let particles = particles(60_000, 1.0, 0.002, 0.05, 8);
    let view = look(PINHOLE, 160, 120);
    let cpu = particles.cpu(&view, CUBIC_SPLINE);
    for backend in BACKENDS {
        let mut request = particles.request(&view, CUBIC_SPLINE, backend);
        let bytes = request.nodes[0].upload.payload.bytes();
        // The particles lie in several buffers, and are sorted in several batches.
        let limit = 1 << 19;
        assert!(bytes > 3 * limit);
        let limits =
            wgpu::Limits { max_storage_buffer_binding_size: limit, max_buffer_size: limit, ..wgpu::Limits::default() };
        request.device.constrained_limits = Some(limits);
        let gpu = render_headless(request).unwrap();
        assert_same(&format!("split, {}", backend.name()), &gpu, &cpu, 1e-3);
    }
}

/// Parts, of which some do not hold the middle line of sight, meet without a seam: the columns and rows where they meet are as right as
/// all others.
#[test]
fn a_picture_larger_than_textures_is_drawn_in_parts() {
    let wide = Projection::Perspective { fov_y: 1.7 };
    let limits = wgpu::Limits { max_texture_dimension_2d: 256, ..wgpu::Limits::default() };
    let mut adapters = Adapters::of(DeviceOptions { constrained_limits: Some(limits), ..DeviceOptions::default() });
    for (projection, h_min, h_max) in [(ORTHO, 0.001, 0.1), (PINHOLE, 0.001, 0.1), (wide, 0.01, 1.0)] {
        let particles = particles(5_000, 1.0, h_min, h_max, 12);
        let view = look(projection, 330, 270);
        let cpu = particles.cpu(&view, CUBIC_SPLINE);
        for backend in BACKENDS {
            let frame = adapters.draw(particles.request(&view, CUBIC_SPLINE, backend));
            let name = format!("parts, {projection:?}, {}", backend.name());
            assert!(frame.stats.splats.is_none(), "{name}: not in parts");
            assert_same(&name, &frame, &cpu, 1e-3);
            // Compute: 2 by 2 parts of 165 by 135 pixels.
            if backend == Backend::Compute {
                let beside = |pixel: usize| {
                    let (x, y) = (pixel % 330, pixel / 330);
                    (164..166).contains(&x) || (134..136).contains(&y)
                };
                let (mut wrong, mut all) = (0.0, 0.0);
                for pixel in (0..cpu.p.len()).filter(|&pixel| beside(pixel)) {
                    wrong += f64::from((frame.accumulation.p[pixel] - cpu.p[pixel]).abs());
                    all += f64::from(cpu.p[pixel]);
                }
                assert!(all > 0.0 && wrong < 1e-3 * all, "{name}: {wrong} of {all} where parts meet");
            }
        }
    }
}

#[test]
fn crowded_tiles_lose_nothing() {
    let withheld = Withheld { subgroup: true, ..Withheld::default() };
    let mut with_and_without =
        [DeviceOptions::default(), DeviceOptions { withheld, ..DeviceOptions::default() }].map(Adapters::of);
    // All in a few tiles: more splats than a driver's loop may take rounds.
    for (h_min, h_max) in [(0.003, 0.01), (0.05, 0.1)] {
        let particles = particles(150_000, 0.02, h_min, h_max, 10);
        let view = look(ORTHO, 48, 32);
        let cpu = particles.cpu(&view, CUBIC_SPLINE);
        for (adapters, subgroup) in with_and_without.iter_mut().zip([false, true]) {
            let gpu = adapters.draw(particles.request(&view, CUBIC_SPLINE, Backend::Compute));
            assert_same(&format!("h from {h_min}, no subgroups {subgroup}"), &gpu, &cpu, 1e-3);
        }
    }
}

/// A table's entries and particles that use them, packed in a cell.
struct Packed {
    table: Vec<TableEntry>,
    steps: Vec<[u32; 3]>,
    codes: Vec<u16>,
}

impl Packed {
    fn new(n: usize, bits: u32) -> Packed {
        let mut random = Random(bits.into());
        let entry = |random: &mut Random| TableEntry {
            smoothing_length: (0.002 * 100_f64.powf(random.next())) as f32,
            weight: (0.5 + random.next()) as f32,
            attribute: (100.0 * random.next()) as f32,
            importance: 1.0,
        };
        Packed {
            table: (0..100).map(|_| entry(&mut random)).collect(),
            steps: (0..n).map(|_| [0; 3].map(|_| (random.next() * f64::from(1 << bits)) as u32)).collect(),
            codes: (0..n).map(|_| (100.0 * random.next()) as u16).collect(),
        }
    }

    /// The particles that it stands for, their places as fractions of the cell from `fraction`.
    fn particles(&self, min: DVec3, size: f64, fraction: impl Fn(usize) -> [f32; 3]) -> Particles {
        let entries = || self.codes.iter().map(|&code| self.table[usize::from(code)]);
        let position = |i: usize| (min + size * DVec3::from_array(fraction(i).map(f64::from))).to_array();
        Particles {
            positions: (0..self.steps.len()).map(position).collect(),
            smoothing_length: entries().map(|entry| entry.smoothing_length).collect(),
            weight: entries().map(|entry| entry.weight).collect(),
            attribute: entries().map(|entry| entry.attribute).collect(),
        }
    }
}

#[test]
fn packed_nodes_are_decoded_as_on_the_cpu() {
    let (min, size) = (DVec3::new(-0.45, -0.4, -0.5), 0.9);
    let view = look(PINHOLE, 320, 240);
    // An odd number: two codes share a word.
    let grid = Packed::new(3_001, 10);
    let positions: Vec<u32> = grid.steps.iter().map(|&steps| pack_grid(steps, steps[0] % 2 == 0)).collect();
    let expected = grid.particles(min, size, |i| unpack_grid(positions[i])).cpu(&view, CUBIC_SPLINE);
    let payload = Payload::Grid { positions, codes: grid.codes.clone() };
    let leaf = Packed::new(3_001, 21);
    let fine: Vec<u64> = leaf.steps.iter().map(|&steps| pack_leaf(steps, steps[0] % 2 == 0)).collect();
    let expected_fine = leaf.particles(min, size, |i| unpack_leaf(fine[i])).cpu(&view, CUBIC_SPLINE);
    let payload_fine = Payload::Leaf { positions: fine, codes: leaf.codes.clone() };
    let mut adapters = Adapters::default();
    for backend in BACKENDS {
        for (name, packed, payload, expected) in
            [("grid", &grid, &payload, &expected), ("leaf", &leaf, &payload_fine, &expected_fine)]
        {
            let nodes = vec![node(min, size, payload.clone())];
            let gpu = adapters.draw(request(&view, CUBIC_SPLINE, backend, nodes, vec![packed.table.clone()]));
            assert_same(&format!("{name}, {}", backend.name()), &gpu, expected, 1e-3);
        }
    }
}

#[test]
fn adapters_that_lack_something_are_served() {
    let particles = particles(5_000, 1.0, 0.001, 0.1, 9);
    let view = look(PINHOLE, 160, 120);
    let cpu = particles.cpu(&view, CUBIC_SPLINE);
    let without = |withheld: Withheld, backend| {
        let mut request = particles.request(&view, CUBIC_SPLINE, backend);
        request.device.withheld = withheld;
        render_headless(request)
    };
    let frame = without(Withheld { subgroup: true, ..Withheld::default() }, Backend::Auto).unwrap();
    assert_eq!(frame.stats.backend, "compute");
    assert_same("without subgroups", &frame, &cpu, 1e-3);
    let frame = without(Withheld { compute: true, ..Withheld::default() }, Backend::Auto).unwrap();
    assert_eq!(frame.stats.backend, "raster");
    assert_same("without compute shaders", &frame, &cpu, 1e-3);
    for (withheld, backend, missing) in [
        (Withheld { blending: true, ..Withheld::default() }, Backend::Raster, "blending of 32-bit floats"),
        (Withheld { compute: true, ..Withheld::default() }, Backend::Compute, "compute shaders"),
        (Withheld { compute: true, blending: true, subgroup: false }, Backend::Auto, "compute shaders, and blending"),
    ] {
        match without(withheld, backend) {
            Err(error @ GpuError::Unsupported { .. }) => {
                let text = error.to_string();
                assert!(text.contains(missing) && text.contains(backend.name()), "{text}");
            }
            other => panic!("{backend:?} with {withheld:?}: {:?}", other.map(|frame| frame.stats)),
        }
    }
}

/// The middle of what a picture shows, pixels.
fn centroid(picture: &Accumulation) -> [f64; 2] {
    let mut sums = [0.0; 3];
    for (index, &p) in picture.p.iter().enumerate() {
        let (x, y) = (index % picture.width as usize, index / picture.width as usize);
        let p = f64::from(p);
        sums = [sums[0] + p, sums[1] + p * (x as f64 + 0.5), sums[2] + p * (y as f64 + 0.5)];
    }
    [sums[1] / sums[0], sums[2] / sums[0]]
}

#[test]
fn a_particle_a_billionth_of_the_box_away_is_where_it_belongs() {
    // A leaf in the middle of a box of edge 50, far from the origin of coordinates.
    let (corner, size) = (DVec3::new(1025.0, 1012.5, 981.25), 3.125);
    let word = pack_leaf([1_234_567, 345_678, 2_000_001], true);
    let fraction = unpack_leaf(word).map(f64::from);
    let particle = corner + size * DVec3::from_array(fraction);
    let distance = 1e-9 * 50.0;
    let eye = particle + distance * DVec3::new(0.3, -0.5, 0.81).normalize();
    let table = vec![TableEntry { smoothing_length: 1e-9, weight: 1.0, attribute: 1.0, importance: 1.0 }];
    let (footprint, mut adapters) = (Footprint::Pixels { radius: 5.0 }, Adapters::default());
    for step in 0..4 {
        // A fraction of a pixel each time, as a slow drag does.
        let aside = distance * (0.07 + 0.004 * f64::from(step));
        let target = particle + aside * DVec3::new(0.9, 0.1, 0.2);
        let view = View::look_at(eye, target, DVec3::Y, Projection::Perspective { fov_y: 0.8 }, 96, 80).unwrap();
        let expected = view.to_pixels(view.to_camera(particle)).unwrap();
        let offsets = [unpack_leaf(word)];
        let positions = Positions::Relative { origin: corner, scale: size, offsets: &offsets };
        let splats = Splats::new(positions, Extent::Pixels(5.0), &[1.0], None).unwrap();
        let mut pictures = vec![("cpu", draw(&view, &[splats], &SplatOptions::default()))];
        for backend in BACKENDS {
            let payload = Payload::Leaf { positions: vec![word], codes: vec![0] };
            let nodes = vec![node(corner, size, payload)];
            let request =
                HeadlessRequest { attribute: false, ..request(&view, footprint, backend, nodes, vec![table.clone()]) };
            pictures.push((backend.name(), adapters.draw(request).accumulation));
        }
        for (name, picture) in pictures {
            let found = centroid(&picture);
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            println!("{name} {step}: {off} px at {expected:?}");
            assert!(off < 0.02, "{name}: {found:?} in place of {expected:?}");
        }
    }
}
