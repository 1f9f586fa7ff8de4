//! What pictures of heights would be without what makes them right, each of it left out on its own, against the picture without error.

mod less;
#[cfg(test)]
mod tests;

use super::Bench;
use crate::bench::Times;
use crate::bench::splat::Failure;
use crate::color::composite::Background;
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::picture::scene;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::raster::{self, Visibility};
use crate::cpu::surface::rays::Caster;
use crate::cpu::surface::select::{Coarse, Technique};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::source::SurfaceNodes;
use crate::cpu::surface::stitch::Mesh;
use crate::cpu::surface::{SurfaceOptions, SurfacePicture, draw};
use crate::look::CameraConfig;
use crate::view::View;
use glam::DVec3;
use less::{Left, Less};
use serde::Serialize;
use std::time::Instant;

/// Differences of colours beyond this, of 255, are counted.
const SEEN: u8 = 8;
/// What is opaque covers so much of a pixel, and what is open at most so much.
const OPAQUE: f32 = 0.999;
const OPEN: f32 = 0.5;
/// Pictures that cracks are counted in.
const VIEWS: u32 = 32;
/// How far these look, by the field's shorter side, with which angle of view (degrees), and how far they lean from straight down (radians).
const AWAY: f64 = 0.3;
const FOV: f64 = 20.0;
const LEANS: [f64; 2] = [0.15, 0.9];

/// A way to draw.
#[derive(Clone, Copy)]
struct Way {
    name: &'static str,
    technique: Technique,
    coarse: Coarse,
    left: Left,
    grows: bool,
}

const SHIPS: Way = Way {
    name: "as it ships",
    technique: Technique::Hybrid,
    coarse: Coarse::Nested,
    left: Left::Nothing,
    grows: false,
};
const WAYS: [Way; 8] = [
    SHIPS,
    Way { name: "points only", technique: Technique::Points, ..SHIPS },
    Way { name: "triangles only", technique: Technique::Triangles, ..SHIPS },
    Way { name: "rays only", technique: Technique::Rays, ..SHIPS },
    Way { name: "without coverage: as if whole", left: Left::Coverage, ..SHIPS },
    Way { name: "without coverage: holes grow", grows: true, ..SHIPS },
    Way { name: "without mean normals", left: Left::MeanNormals, ..SHIPS },
    Way { name: "pyramid of means", coarse: Coarse::Means, ..SHIPS },
];

/// What leaving things out came to.
#[derive(Clone, Debug, Serialize)]
pub struct Ablations {
    /// Each way in each view.
    pub pictures: Vec<Ablated>,
    /// Cracks with and without places that neighbours share; none over a globe.
    pub cracks: Option<Cracks>,
}

/// What a picture came to that lacks something.
#[derive(Clone, Debug, Serialize)]
pub struct Ablated {
    /// Where the camera is.
    pub view: &'static str,
    /// What is left out.
    pub way: &'static str,
    /// The mean difference of colours from the picture without error, of 255.
    pub mean: f64,
    /// The share of pixels with a colour that is more than 8 of 255 from there.
    pub beyond: f64,
    /// Pixels that are covered by what was measured.
    pub covered: f64,
    /// The same without error.
    pub valid: f64,
    /// Pixels that are opaque without error and more than half open here.
    pub open: usize,
    /// Points that were drawn.
    pub points: u64,
    /// Triangles that were drawn.
    pub triangles: u64,
    /// Seconds of the picture, its chunks being in memory.
    pub seconds: Times,
}

/// Pixels that show what is behind the surface where it fills the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Cracks {
    /// Pictures that the surface fills.
    pub views: u32,
    /// Where corners that chunks share come from the same operations.
    pub shared: u64,
    /// Where each chunk counts from its own first sample, which is from the eye as singles have it. Places within a chunk are not rounded: this is the
    /// least that singles do.
    pub own: u64,
}

impl Bench<'_> {
    /// Draws a field without each of what makes its pictures right.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(super) fn ablations(&self) -> Result<Ablations, Failure> {
        let surface = self.fresh()?;
        let mut pictures = Vec::new();
        for (view, camera) in self.cameras() {
            let sight = self.sight(camera)?;
            let (exact, _) = self.against(&surface, &sight, view, &SHIPS, None);
            for way in WAYS {
                let (_, found) = self.against(&surface, &sight, view, &way, Some(&exact));
                eprintln!(
                    "{view}, {}: mean {:.3} of 255, {:.2} % beyond {SEEN}, {:.0} of {:.0} pixels covered, {} open, {:.0} ms",
                    found.way,
                    found.mean,
                    100.0 * found.beyond,
                    found.covered,
                    found.valid,
                    found.open,
                    1e3 * found.seconds.median
                );
                pictures.push(found);
            }
        }
        let cracks = if self.placed.is_flat() { Some(self.cracks(&surface)?) } else { None };
        if let Some(Cracks { views, shared, own }) = cracks {
            eprintln!(
                "cracks in {views} pictures that the surface fills: {shared} pixels, from chunks' own origins {own}"
            );
        }
        Ok(Ablations { pictures, cracks })
    }

    /// A picture drawn some way, and what it came to against one without error; without that it is the one without error itself.
    fn against(
        &self,
        surface: &PagedSurface,
        sight: &Sight,
        view: &'static str,
        way: &Way,
        exact: Option<&SurfacePicture>,
    ) -> (SurfacePicture, Ablated) {
        let plain = self.options();
        let repeat = if exact.is_some() { self.arguments.repeat } else { 0 };
        let options = match exact {
            Some(_) => SurfaceOptions { technique: way.technique, coarse: way.coarse, holes_grow: way.grows, ..plain },
            // Points fill what they are in: of holes between them triangles know, at more places of a pixel.
            None => SurfaceOptions { technique: Technique::Triangles, tau: 0.0, samples: 16, ..plain },
        };
        surface.prepare(&self.placed, sight, &options);
        let less = Less::new(surface, way.left, &self.placed);
        let picture = draw(&less, &self.placed, sight, &options);
        let again = |_| {
            let start = Instant::now();
            drop(draw(&less, &self.placed, sight, &options));
            start.elapsed()
        };
        let seconds = Times::of((0..repeat).map(again).collect());
        let exact = exact.unwrap_or(&picture);
        let [mean, beyond] = differences(&picture, exact);
        let found = Ablated {
            view,
            way: way.name,
            mean,
            beyond,
            covered: picture.report.covered,
            valid: exact.report.covered,
            open: opened(&picture, exact),
            points: picture.report.points,
            triangles: picture.report.triangles,
            seconds,
        };
        (picture, found)
    }

    /// Counts cracks in pictures from above the middle of a flat field.
    fn cracks(&self, surface: &PagedSurface) -> Result<Cracks, Failure> {
        let mut found = Cracks::default();
        let [low, high] = self.ends();
        let (middle, size) = (0.5 * (low + high), high - low);
        let away = AWAY * size.x.min(size.y);
        for number in 0..VIEWS {
            // Spread evenly (Roberts's sequence).
            let [turn, lean] =
                [0.754_877_666_246_692_8, 0.569_840_290_998_053_2].map(|step| (0.5 + step * f64::from(number)).fract());
            let (turn, lean) = (std::f64::consts::TAU * turn, LEANS[0] + (LEANS[1] - LEANS[0]) * lean);
            let target = middle.with_z(high.z);
            let eye = target + away * DVec3::new(lean.sin() * turn.cos(), lean.sin() * turn.sin(), lean.cos());
            let camera = CameraConfig {
                eye: Some(eye.to_array()),
                target: Some(target.to_array()),
                up: Some(DVec3::Z.to_array()),
                fov: Some(FOV),
                ortho: None,
            };
            let Sight::Flat(view) = self.sight(camera)? else { continue };
            let options = SurfaceOptions { technique: Technique::Triangles, look: None, ..self.options() };
            if let Some([shared, own]) = cracks_of(surface, &self.placed, &view, &options) {
                found.views += 1;
                found.shared += shared;
                found.own += own;
            }
        }
        Ok(found)
    }
}

/// The mean difference of colours, and the share of pixels with a larger one than is seen.
fn differences(own: &SurfacePicture, exact: &SurfacePicture) -> [f64; 2] {
    let [own, exact] = [own, exact].map(|picture| picture.colors.image_on(Background::Black).rgba);
    let (mut sum, mut beyond) = (0_u64, 0_u64);
    for (one, other) in own.iter().zip(&exact) {
        let apart = [0, 1, 2].map(|k| one[k].abs_diff(other[k]));
        sum += apart.into_iter().map(u64::from).sum::<u64>();
        beyond += u64::from(apart.into_iter().any(|apart| apart > SEEN));
    }
    let pixels = own.len().max(1) as f64;
    [sum as f64 / (3.0 * pixels), beyond as f64 / pixels]
}

/// Pixels that are opaque without error and open here.
fn opened(own: &SurfacePicture, exact: &SurfacePicture) -> usize {
    let pairs = own.colors.rgba.iter().zip(&exact.colors.rgba);
    pairs.filter(|(own, exact)| exact[3] >= OPAQUE && own[3] < OPEN).count()
}

/// Pixels that show nothing, with places that chunks share and with each chunk's own; `None` where rays find such, too.
fn cracks_of(source: &dyn SurfaceNodes, placed: &Placed, view: &View, options: &SurfaceOptions) -> Option<[u64; 2]> {
    let sight = Sight::Flat(*view);
    let mut scene = scene(source, placed, &sight, options);
    let nothing = || Visibility::new([view.width, view.height]);
    let open = |seen: &Visibility| (0..seen.width * seen.height).filter(|index| !seen.is_shown(*index)).count() as u64;
    let (rays, shared, own) = (nothing(), nothing(), nothing());
    Caster::new(&scene).draw(&sight, &rays);
    if open(&rays) > 0 {
        return None;
    }
    raster::draw(&scene, view, &shared, [1; 2]);
    for mesh in std::mem::take(&mut scene.meshes) {
        scene.placed = from_its_own_origin(placed, &mesh, view.eye);
        scene.meshes = vec![mesh];
        raster::draw(&scene, view, &own, [1; 2]);
    }
    Some([open(&shared), open(&own)])
}

/// The field as a chunk has it that counts from its own first sample, if that and its steps are singles, seen from an eye.
fn from_its_own_origin(placed: &Placed, mesh: &Mesh, eye: DVec3) -> Placed {
    let (row, column, height) = (mesh.rows[0] as f64, mesh.columns[0] as f64, mesh.node.facts.min);
    let first = eye + (placed.world(row, column, height) - eye).as_vec3().as_dvec3();
    let single = |value: f64| f64::from(value as f32);
    let (step, lift) = (placed.step.map(single), single(placed.lift));
    let origin = [first.x - column * step[0], first.y - row * step[1]];
    Placed { origin, step, lift, zero: first.z - lift * height, ..*placed }
}
