//! `primitives`: the outlines of what a hierarchy draws, to see how it sees the data (HE03 shows its clusters so, WM03 its points).

use super::grid::{self, Layers};
use super::samples::{self, FieldLook};
use crate::color::colors::to_linear;
use crate::color::transfer::TransferFunction;
use crate::cpu::field::{PointLook, ValueAxis};
use crate::cpu::outlines::{self, OutlineOptions};
use crate::cpu::volume::{VolumeError, VolumeLevels};
use crate::cpu::{Extent, NodeTraits, SplatKind, Splats};
use crate::mode::{
    FieldJob, Job, LightPicture, Mode, Output, OwnColors, Raw, Setting, SettingKind, SettingValue, Settings, Technique,
};
use crate::model::{Covariance, Kernel};
use crate::view::View;
use rayon::prelude::*;

/// What colours tell.
pub static COLOR: Setting = Setting {
    name: "outline-color",
    unit: "",
    kind: SettingKind::Choice { options: &["level", "size", "misfit", "type"] },
    help: "what outlines are coloured by: steps from the root, the splat's mean radius, its node's misfit, or whether it is a particle, \
           a merged one or a cluster (of images and volumes a sample, a large point or one of a directed set)",
};

/// Width of the lines.
pub static WIDTH: Setting = Setting {
    name: "outline-width",
    unit: "px",
    kind: SettingKind::Number { min: 0.1, max: 20.0, default: 1.0 },
    help: "width of the outlines",
};

/// Where outlines are.
pub static DEVIATIONS: Setting = Setting {
    name: "outline-radius",
    unit: "standard deviations",
    kind: SettingKind::Number { min: 0.01, max: 10.0, default: 1.0 },
    help: "how far outlines are from the middles of splats, in each direction's standard deviations",
};

/// Opacity within.
pub static FILL: Setting = Setting {
    name: "outline-fill",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.5 },
    help: "opacity of what outlines enclose, darker than they are: what lies behind shows through; 0: nothing is hidden",
};

/// The ends of the colours.
pub static RANGE: Setting = Setting {
    name: "outline-range",
    unit: "",
    kind: SettingKind::Numbers { min: 0.0, max: 1e38, most: 2 },
    help: "levels, sizes (in the data's unit) or misfits at the two ends of the colours; without any, those of what is drawn",
};

/// Light of what outlines enclose, of that of their lines: these are to be seen over it.
const DIMMED: f32 = 0.2;
/// Colours of types in sRGB: leaf particles and samples, merged particles and large points, clusters and points of directed sets.
const TYPES: [[f32; 3]; 3] = [[0.95, 0.95, 0.9], [0.25, 0.75, 0.95], [1.0, 0.55, 0.15]];
/// Colour of what is not known, in sRGB.
const UNKNOWN: [f32; 3] = [0.5, 0.5, 0.5];
/// Where a colour map begins: its dark end cannot be seen.
const DARKEST: f64 = 0.3;
/// Points of images and volumes that are outlined where nothing is said of their number: more than these hide each other.
const USUAL_POINTS: u64 = 10_000;
/// Entries of a colour map.
const ENTRIES: usize = 256;

struct Primitives;

/// What colours tell, and between which values.
struct Colors {
    by: By,
    range: [f64; 2],
    kernel: Kernel,
    /// Whether ellipsoids are ellipses: without a third radius.
    is_flat: bool,
    gradient: Vec<[f32; 3]>,
}

/// What colours tell.
#[derive(Clone, Copy, PartialEq)]
enum By {
    Level,
    Size,
    Misfit,
    Type,
}

impl By {
    fn of(settings: &Settings) -> By {
        match &*settings.name(&COLOR) {
            "size" => By::Size,
            "misfit" => By::Misfit,
            "type" => By::Type,
            _ => By::Level,
        }
    }
}

impl Technique for Primitives {
    fn output(&self) -> Output {
        Output::Light
    }

    fn takes_clusters(&self) -> bool {
        true
    }

    fn own_colors(&self, settings: &Settings, transfer: &TransferFunction) -> Option<OwnColors> {
        let (title, is_length) = match By::of(settings) {
            By::Level => ("level", false),
            By::Size => ("mean radius", true),
            By::Misfit => ("misfit", false),
            By::Type => return Some(OwnColors::Names),
        };
        let place = |i: usize| entry(i as f64 / (ENTRIES - 1) as f64);
        let gradient = transfer.color_map.sample(ENTRIES);
        let colors = (0..ENTRIES).filter_map(|i| gradient.get(place(i)).map(|rgb| encoded(*rgb))).collect();
        let is_whole = By::of(settings) == By::Level;
        Some(OwnColors::Axis { title, is_length, is_whole, log: is_length, colors })
    }

    fn takes_points(&self) -> bool {
        true
    }

    fn usual_points(&self) -> Option<u64> {
        Some(USUAL_POINTS)
    }

    fn for_panorama(&self, settings: &mut Settings, all: &[Splats<'_>], kernel: Kernel) {
        if all.is_empty() || !settings.numbers(&RANGE).is_empty() {
            return;
        }
        let range = Colors::new(settings, all, &TransferFunction::default(), (kernel, false)).told();
        settings.set(&RANGE, SettingValue::Numbers(range.to_vec()));
    }

    fn own_levels(&self, job: &Job<'_>) -> Option<VolumeLevels> {
        Some(Colors::of_job(job).levels())
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        Ok(draw(job.view, job.batches, job.settings, &Colors::of_job(job)))
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        let points = job.points.ok_or(VolumeError::OnlyParticles)?;
        let FieldJob { view, values, settings, .. } = *job;
        let usual = FieldLook::usual_of(&MODE, settings, &values);
        let transfer = job.transfer.unwrap_or(&usual);
        let look = FieldLook::new(&values, settings, Some(transfer), job.diameter, &Layers::VOLUME)?;
        // All of an image is seen; of a volume what is not transparent.
        let least = if values.is_volume { look.classifier.least() } else { ValueAxis::NOTHING };
        let kernel = Kernel::default();
        let seen =
            PointLook { view, axis: look.axis, least, hue: None, spread: 1.0, thickness: 1.0, kernel }.seen(points);
        let batches = seen.iter().map(|seen| seen.splats()).collect::<Result<Vec<_>, _>>()?;
        let colors = Colors::new(settings, &batches, transfer, (kernel, !values.is_volume));
        Ok(draw(view, &batches, settings, &colors))
    }
}

/// Draws the outlines of batches.
fn draw(view: &View, batches: &[Splats<'_>], settings: &Settings, colors: &Colors) -> Raw {
    let options = OutlineOptions {
        kernel: colors.kernel,
        deviations: settings.number(&DEVIATIONS),
        width: settings.number(&WIDTH),
        fill: settings.number(&FILL) as f32,
        dimmed: DIMMED,
    };
    let (drawn, report) = outlines::draw(view, batches, &options, |batch, index| colors.of(batch, index));
    Raw::Light(LightPicture { colors: drawn, report, levels: colors.levels(), isovalues: Vec::new() })
}

impl Colors {
    fn of_job(job: &Job<'_>) -> Colors {
        let usual = TransferFunction::default();
        Colors::new(job.settings, job.batches, job.transfer.unwrap_or(&usual), (job.options.kernel, false))
    }

    fn new(
        settings: &Settings,
        batches: &[Splats<'_>],
        transfer: &TransferFunction,
        (kernel, is_flat): (Kernel, bool),
    ) -> Colors {
        let by = By::of(settings);
        let gradient = transfer.color_map.sample(ENTRIES);
        let colors = Colors { by, range: [0.0, 1.0], kernel, is_flat, gradient };
        if let [low, high] = settings.numbers(&RANGE)[..] {
            let ends =
                if by == By::Size { [low, high].map(|size| size.max(f64::MIN_POSITIVE).ln()) } else { [low, high] };
            return Colors { range: ends, ..colors };
        }
        let of_batch = |batch: &Splats<'_>| {
            let differ = by == By::Size || by == By::Misfit && batch.misfits().is_some();
            let told = if differ { batch.len() } else { batch.len().min(1) };
            (0..told).filter_map(|index| colors.value(batch, index)).fold(NOTHING, wider)
        };
        let both = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let range = batches.par_iter().map(of_batch).reduce(|| NOTHING, both);
        Colors { range: if range[0] <= range[1] { range } else { [0.0, 1.0] }, ..colors }
    }

    /// What colours tell of a splat, where it is known; of sizes the logarithm.
    fn value(&self, batch: &Splats<'_>, index: usize) -> Option<f64> {
        let traits = batch.traits();
        match self.by {
            By::Level => traits.map(|traits| f64::from(traits.level)),
            By::Misfit => match batch.misfits() {
                Some(misfits) => Some(f64::from(misfits[index])),
                None => traits.and_then(|traits| traits.misfit),
            },
            By::Type => traits.map(|traits| f64::from(number(traits))),
            By::Size => {
                let radius = match batch.extent() {
                    Extent::World(lengths) => self.kernel.variance().sqrt() * f64::from(lengths[index]),
                    Extent::Ellipsoids(covariances) if self.is_flat => flat_radius(covariances[index]),
                    Extent::Ellipsoids(covariances) => covariances[index].mean_radius(),
                    Extent::Pixels(_) => return None,
                };
                Some(radius.ln()).filter(|size| size.is_finite())
            }
        }
    }

    /// The values at the ends of the colours.
    fn told(&self) -> [f64; 2] {
        if self.by == By::Size { self.range.map(f64::exp) } else { self.range }
    }

    /// The same as a picture tells it.
    fn levels(&self) -> VolumeLevels {
        VolumeLevels { density: self.told(), attribute: [0.0, 1.0], unit_length: 0.0 }
    }

    /// The colour of a splat's outline, linear light.
    fn of(&self, batch: &Splats<'_>, index: usize) -> [f32; 3] {
        let encoded = match (self.by, self.value(batch, index)) {
            (_, None) => UNKNOWN,
            (By::Type, Some(value)) => TYPES[value as usize % TYPES.len()],
            (_, Some(value)) => {
                let [from, to] = self.range;
                let place = if to > from { ((value - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
                self.gradient.get(entry(place)).copied().unwrap_or(UNKNOWN)
            }
        };
        encoded.map(to_linear)
    }
}

/// The colour map's entry at a place of the range.
fn entry(place: f64) -> usize {
    ((DARKEST + (1.0 - DARKEST) * place) * (ENTRIES - 1) as f64).round() as usize
}

fn encoded(rgb: [f32; 3]) -> [u8; 4] {
    let [r, g, b] = rgb.map(|part| (part * 255.0).round() as u8);
    [r, g, b, 255]
}

/// Geometric mean of the standard deviations along the two axes of an ellipse.
fn flat_radius(covariance: Covariance) -> f64 {
    // The sum of the products of two eigenvalues, of which only one is not 0.
    let matrix = covariance.matrix();
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let minors = x.x * y.y - x.y * x.y + x.x * z.z - x.z * x.z + y.y * z.z - y.z * y.z;
    minors.max(0.0).sqrt().sqrt()
}

/// Which of [`TYPES`] a node's splats have.
fn number(traits: NodeTraits) -> u8 {
    match traits.kind {
        SplatKind::Leaf => 0,
        SplatKind::Merged => 1,
        SplatKind::Cluster => 2,
    }
}

/// Between no values.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn wider([low, high]: [f64; 2], value: f64) -> [f64; 2] {
    [low.min(value), high.max(value)]
}

/// Nothing is weighed.
pub static MODE: Mode = Mode {
    name: "primitives",
    help: "outlines of what the hierarchy draws: ellipses of clusters, circles of particles and of merged ones, coloured by level, size, \
           misfit or type; of images and volumes that were built those of their points",
    settings: &[&[&COLOR, &WIDTH, &DEVIATIONS, &FILL, &RANGE], samples::SAMPLES],
    technique: &Primitives,
    ..grid::MODE
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::over::Order;
    use crate::cpu::shadowing::Lighting;
    use crate::cpu::{Positions, SplatOptions};
    use crate::model::Bounds;
    use crate::view::{Projection, View};
    use glam::DVec3;

    /// Circles of two nodes beside each other: what of the colour map each has.
    fn entries(by: &str, range: Option<[f64; 2]>) -> [Option<usize>; 2] {
        let traits = |level, misfit| NodeTraits { level, kind: SplatKind::Merged, misfit };
        let places = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let lengths = [0.5, 1.0];
        let batch = |i: usize, traits| {
            let extent = Extent::World(&lengths[i..=i]);
            let batch = Splats::new(Positions::World(&places[i..=i]), extent, &[1.0], None);
            batch.expect("columns of one").with_traits(Some(traits))
        };
        let batches = [batch(0, traits(3, Some(0.25))), batch(1, traits(7, None))];
        let mut settings = Settings::default();
        settings.set(&COLOR, SettingValue::Name(by.into()));
        if let Some(range) = range {
            settings.set(&RANGE, SettingValue::Numbers(range.to_vec()));
        }
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, Projection::Orthographic { height: 2.0 }, 128, 64);
        let transfer = TransferFunction::default();
        let job = Job {
            view: &view.expect("a view"),
            batches: &batches,
            options: SplatOptions::default(),
            settings: &settings,
            transfer: Some(&transfer),
            bounds: Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE },
            diameter: 1.0,
            densest: 1.0,
            density_scale: 1.0,
            mean_mass: 1.0,
            paths: None,
            around: None,
            in_views: None,
            lighting: Lighting::default(),
            order: Order::default(),
        };
        let light = MODE.draw(&job).and_then(|raw| raw.light(&MODE)).expect("outlines");
        let gradient = transfer.color_map.sample(ENTRIES);
        [0, 1].map(|half| {
            let pixels = light.colors.rgba.iter().enumerate().filter(|(index, _)| index % 128 / 64 == half);
            let brightest = pixels.map(|(_, rgba)| *rgba).max_by(|a, b| a[0].total_cmp(&b[0])).expect("pixels");
            let is_near = |entry: &[f32; 3]| (0..3).all(|k| (to_linear(entry[k]) - brightest[k]).abs() < 0.02);
            gradient.iter().rposition(is_near)
        })
    }

    #[test]
    fn the_legend_has_the_colours_of_the_outlines() {
        let (mut settings, transfer) = (Settings::default(), TransferFunction::default());
        for (by, expected) in
            [("level", ("level", false)), ("size", ("mean radius", true)), ("misfit", ("misfit", false))]
        {
            settings.set(&COLOR, SettingValue::Name(by.into()));
            let Some(OwnColors::Axis { title, is_length, log, colors, .. }) =
                Primitives.own_colors(&settings, &transfer)
            else {
                panic!("{by}: no axis")
            };
            assert_eq!((title, is_length, log), (expected.0, expected.1, expected.1));
            let gradient = transfer.color_map.sample(ENTRIES);
            assert_eq!(
                (colors[0], colors[ENTRIES - 1]),
                (encoded(gradient[entry(0.0)]), encoded(gradient[ENTRIES - 1]))
            );
        }
        settings.set(&COLOR, SettingValue::Name("type".into()));
        assert_eq!(Primitives.own_colors(&settings, &transfer), Some(OwnColors::Names));
    }

    #[test]
    fn colours_tell_what_is_asked_for() {
        let low = (DARKEST * (ENTRIES - 1) as f64).round() as usize;
        let near = |found: Option<usize>, expected: usize| found.is_some_and(|found| found.abs_diff(expected) < 8);
        for by in ["level", "size"] {
            let [first, second] = entries(by, None);
            assert!(near(first, low) && near(second, ENTRIES - 1), "{by}: {first:?} {second:?}");
        }
        // Only one node's misfit is known.
        let [known, unknown] = entries("misfit", Some([0.0, 0.5]));
        assert!(near(known, (low + ENTRIES - 1) / 2) && unknown.is_none(), "{known:?} {unknown:?}");
        let [below, within] = entries("level", Some([5.0, 9.0]));
        assert!(near(below, low) && near(within, (low + ENTRIES - 1) / 2), "{below:?} {within:?}");
    }
}
