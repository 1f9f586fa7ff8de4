//! Clouds of particles, and an adapter that draws volumes of them.

use deepfield::codec::clusters::NO_CLASS;
use deepfield::color::Colors;
use deepfield::color::transfer::TransferFunction;
use deepfield::cpu::volume::extents::{self, planes_and_widest};
use deepfield::cpu::volume::range::Sketch;
use deepfield::cpu::volume::{Classifier, FieldRange, Light, Scenery, Surface, VolumeLevels, VolumeOptions};
use deepfield::cpu::{self, Positions, Splats};
use deepfield::gpu::volume::Shows;
use deepfield::gpu::{
    Backend, DeviceOptions, Footprint, GpuError, HeadlessNode, HeadlessRenderer, HeadlessRequest, NodeId, NodeUpload,
    Payload, RawParticle, VolumeFindings, VolumeJob, VolumeView,
};
use deepfield::mode::LightPasses;
use deepfield::mode::sample::Sample;
use deepfield::model::Kernel;
use deepfield::synth::merger::Merger;
use deepfield::view::{Extent, Projection, View};
use glam::DVec3;
use std::sync::Arc;

/// Particles, their attribute and the densities and attributes that are to be seen.
pub struct Cloud {
    pub positions: Vec<[f64; 3]>,
    pub h: Vec<f32>,
    pub mass: Vec<f32>,
    pub attribute: Option<Vec<f32>>,
    pub density: [f64; 2],
    pub range: [f64; 2],
    pub unit: f64,
}

impl Cloud {
    pub fn one() -> Cloud {
        Cloud {
            positions: vec![[0.1, -0.2, 0.3]],
            h: vec![0.8],
            mass: vec![2.0],
            attribute: None,
            density: [1e-2, 10.0],
            range: [0.0, 1.0],
            unit: 0.3,
        }
    }

    /// Particles of all widths, among them some that fill the picture: about as many cells wide as smoothing lengths are
    /// wide in thousandths.
    pub fn wide(count: usize) -> Cloud {
        // Places by multiples of irrational numbers: spread out evenly, and the same in every run.
        let share = |i: usize, step: f64| ((i + 1) as f64 * step).fract();
        let position = |i: usize| [0.754_877, 0.569_840, 0.430_159].map(|step| 2.0 * share(i, step) - 1.0);
        let h: Vec<f32> = (0..count).map(|i| 0.02 * 190.0f64.powf(share(i, 0.618_034).powi(2)) as f32).collect();
        let positions: Vec<[f64; 3]> = (0..count).map(position).collect();
        Cloud {
            mass: h.iter().map(|h| h.powf(1.5)).collect(),
            attribute: Some(positions.iter().map(|at| 2.0 + at[1] as f32).collect()),
            positions,
            h,
            density: [1.0, 1e3],
            range: [1.0, 3.0],
            unit: 0.5,
        }
    }

    /// Particles that all reach the same few cells.
    pub fn crowd(count: usize) -> Cloud {
        let share = |i: usize, step: f64| ((i + 1) as f64 * step).fract();
        let position = |i: usize| [0.754_877, 0.569_840, 0.430_159].map(|step| 0.1 * share(i, step));
        let positions: Vec<[f64; 3]> = (0..count).map(position).collect();
        Cloud {
            h: vec![0.15; count],
            mass: vec![1.0 / count as f32; count],
            attribute: Some(positions.iter().map(|at| 2.0 + at[0] as f32).collect()),
            positions,
            density: [1.0, 1e3],
            range: [2.0, 2.1],
            unit: 0.1,
        }
    }

    /// A lattice of mass density 1 in the cube of width 2.
    pub fn lattice(count: i32) -> Cloud {
        let spacing = 2.0 / f64::from(count);
        let at = |n: i32| (f64::from(n % count) + 0.5) * spacing - 1.0;
        let positions: Vec<_> = (0..count.pow(3)).map(|i| [at(i), at(i / count), at(i / count / count)]).collect();
        Cloud {
            h: vec![2.6 * spacing as f32; positions.len()],
            mass: vec![spacing.powi(3) as f32; positions.len()],
            attribute: Some(positions.iter().map(|at| 2.0 + at[0] as f32).collect()),
            positions,
            density: [1e-2, 1.2],
            range: [1.0, 3.0],
            unit: 0.2,
        }
    }

    pub fn merger(count: u64) -> Cloud {
        let family = deepfield::synth::dataset(&Merger::new(3, count)).families.swap_remove(0);
        let attribute = family.attribute("internal-energy").unwrap().values.clone();
        let quantile = |values: &[f32], share: f64| {
            let mut sorted = values.to_vec();
            sorted.sort_by(f32::total_cmp);
            f64::from(sorted[(share * (sorted.len() - 1) as f64) as usize])
        };
        Cloud {
            density: [quantile(&family.density, 0.05), quantile(&family.density, 0.99)],
            range: [quantile(&attribute, 0.05), quantile(&attribute, 0.95)],
            attribute: Some(attribute),
            positions: family.positions,
            h: family.smoothing_length,
            mass: family.mass,
            unit: 0.5,
        }
    }

    pub fn batch(&self) -> Splats<'_> {
        let extent = cpu::Extent::World(&self.h);
        Splats::new(Positions::World(&self.positions), extent, &self.mass, self.attribute.as_deref()).unwrap()
    }

    fn classifier(&self) -> Classifier {
        let levels = VolumeLevels { density: self.density, attribute: self.range, unit_length: self.unit };
        let attribute = self.attribute.is_some();
        Classifier::new(&TransferFunction::of_volumes(attribute), levels, attribute)
    }

    pub fn volume(&self) -> Scenery {
        let classifier = self.classifier();
        let (light, volume_light) = (None, None);
        Scenery { classifier, volume: true, surfaces: Vec::new(), light, volume_light, termination: 0.999 }
    }

    /// The density at a place of the logarithmic range.
    fn density_at(&self, place: f64) -> f32 {
        let [min, max] = self.density;
        (min * (max / min).powf(place)) as f32
    }

    pub fn surfaces(&self, volume: bool, opacities: [f32; 3]) -> Scenery {
        let surface = |(place, opacity, color)| Surface { value: self.density_at(place), color, opacity };
        let [a, b, c] = opacities;
        let surfaces = [(0.4, a, Some([0.9, 0.3, 0.1])), (0.65, b, None), (0.9, c, Some([0.2, 0.8, 0.5]))];
        Scenery {
            surfaces: surfaces.into_iter().map(surface).collect(),
            light: Some(Light { ambient: 0.12, specular: 0.15, shininess: 40.0 }),
            volume,
            ..self.volume()
        }
    }
}

pub fn look(eye: DVec3, projection: Projection, width: u32, height: u32) -> View {
    View::look_at(eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0), projection, width, height).unwrap()
}

pub fn near(eye: [f64; 3], width: u32, height: u32) -> View {
    look(DVec3::from_array(eye), Projection::Perspective { fov_y: 0.8 }, width, height)
}

/// An adapter that draws clouds.
pub struct Renderer {
    pub renderer: HeadlessRenderer,
    /// Of the picture that was asked for last.
    pub number: u64,
    /// Bytes that a volume may work in.
    pub memory: u64,
}

impl Renderer {
    pub fn open(device: &DeviceOptions) -> Renderer {
        Renderer { renderer: HeadlessRenderer::bare(device, Backend::Compute).unwrap(), number: 0, memory: 1 << 30 }
    }

    /// Loads a cloud in nodes of its own encoding, and says what is to be drawn of it.
    pub fn load(&mut self, view: &View, cloud: &Cloud) -> Vec<Extent> {
        let extent = extents::of(&[cloud.batch()])[0];
        let particle = |i: usize| RawParticle {
            position: view.to_camera(DVec3::from_array(cloud.positions[i])).as_vec3().to_array(),
            smoothing_length: cloud.h[i],
            weight: cloud.mass[i],
            attribute: cloud.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
            density: 0.0,
            unused: 0.0,
        };
        let all: Vec<RawParticle> = (0..cloud.h.len()).map(particle).collect();
        let node = |(index, particles): (usize, &[RawParticle])| HeadlessNode {
            upload: NodeUpload {
                id: NodeId { source: self.number as u32, page: 0, node: index as u32 },
                min: DVec3::ZERO,
                size: 0.0,
                payload: Payload::Camera(particles.to_vec()),
            },
            table: None,
            weight_scale: 1.0,
            offset: DVec3::ZERO,
            sample: Sample::ALL,
            limit: NO_CLASS,
            reach: extent,
        };
        let nodes: Vec<HeadlessNode> = all.chunks(6_000).enumerate().map(node).collect();
        let extents = vec![extent; nodes.len()];
        let request = HeadlessRequest {
            view: *view,
            mode: None,
            footprint: Footprint::Kernel(Kernel::CubicSpline),
            backend: Backend::Compute,
            culling: true,
            faintest: 0.0,
            nodes,
            tables: Vec::new(),
            attribute: cloud.attribute.is_some(),
            transfer: None,
            repeat: 1,
            device: DeviceOptions::default(),
        };
        self.renderer.load(&request).unwrap();
        extents
    }

    pub fn view(&mut self, cloud: &Cloud, extents: Vec<Extent>, job: VolumeJob) -> VolumeView {
        let (light, ranges) = match job.shows {
            Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Field(_) => (Some(job), None),
            Shows::Ranges => (None, Some(job)),
        };
        let attribute = cloud.attribute.is_some();
        VolumeView {
            extents: extents.into(),
            light,
            ranges,
            attribute,
            ranges_only: false,
            memory: self.memory,
            slabs: 3,
        }
    }

    pub fn draw(
        &mut self,
        view: &View,
        cloud: &Cloud,
        scenery: &Scenery,
        options: &VolumeOptions,
    ) -> (Colors, VolumeFindings) {
        self.number += 1;
        let extents = self.load(view, cloud);
        let (grid, _) = planes_and_widest(view, extents.iter().copied(), options).unwrap();
        let shows = Shows::Light(Arc::new(scenery.clone()));
        let (number, view, options) = (self.number, *view, *options);
        let job = VolumeJob { number, view, grid, options, stride: 1, shows, covers: false };
        let volume = self.view(cloud, extents, job);
        let (colors, found, _) = self.renderer.volume(volume, 1).unwrap();
        (colors, found)
    }

    /// What a technique's passes draw; an error where it does not fit.
    pub fn pass(
        &mut self,
        view: &View,
        cloud: &Cloud,
        passes: &LightPasses,
    ) -> Result<(Colors, VolumeFindings), GpuError> {
        let job = self.job(view, cloud, passes);
        self.load(&job.view, cloud);
        self.again(view, cloud, passes)
    }

    /// The same of what has been loaded.
    pub fn again(
        &mut self,
        view: &View,
        cloud: &Cloud,
        passes: &LightPasses,
    ) -> Result<(Colors, VolumeFindings), GpuError> {
        let job = self.job(view, cloud, passes);
        let volume = self.view(cloud, extents::of(&[cloud.batch()]), job);
        let (colors, found, _) = self.renderer.volume(volume, 1)?;
        Ok((colors, found))
    }

    fn job(&mut self, view: &View, cloud: &Cloud, passes: &LightPasses) -> VolumeJob {
        self.number += 1;
        let (extents, attribute) = (extents::of(&[cloud.batch()]), cloud.attribute.is_some());
        VolumeJob::picture_of(self.number, passes, view, &extents, attribute).unwrap().unwrap()
    }

    pub fn ranges(&mut self, view: &View, cloud: &Cloud, options: &VolumeOptions) -> Option<FieldRange> {
        self.number += 1;
        let extents = self.load(view, cloud);
        let sketch = Sketch::of(view, cloud.h.len(), options);
        let (grid, _) = sketch.grid(extents.iter().copied()).unwrap();
        let Sketch { view, options, stride } = sketch;
        let (number, stride) = (self.number, stride as u32);
        let job = VolumeJob { number, view, grid, options, stride, shows: Shows::Ranges, covers: false };
        let volume = self.view(cloud, extents, job);
        self.renderer.ranges(volume).unwrap()
    }
}

pub fn renderer() -> Renderer {
    Renderer::open(&DeviceOptions::default())
}

/// Relative L2 of all channels, and the largest difference.
pub fn difference(found: &Colors, expected: &Colors) -> (f64, f32) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let pairs = || found.rgba.as_flattened().iter().zip(expected.rgba.as_flattened());
    let square: f64 = pairs().map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let norm: f64 = expected.rgba.as_flattened().iter().map(|b| f64::from(*b).powi(2)).sum();
    assert!(norm > 1.0, "an empty picture");
    ((square / norm).sqrt(), pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f32::max))
}
