//! Selections in a picture: a layer of coloured points over whatever a mode draws, the same for every mode and backend.
//!
//! The particles of the drawn nodes that belong to a set are accumulated as small discs, set by set. Where `n` of them overlap a
//! pixel it is covered by `1 - exp(-k n)`, and its colour is the mean of the sets' colours weighted with their points, so that
//! the order of sets does not matter.

use super::error::ExploreError;
use super::highlight::{Highlighter, Marked};
use super::ids::IdSet;
use super::places::Places;
use super::region::Region;
use super::selection::{Members, SelectionSet, Show};
use crate::color::composite::Image;
use crate::cpu::{Extent, Positions, SplatOptions, Splats, draw_counted};
use crate::model::{FamilyName, Kernel};
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::View;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Radius of a point in a picture of [`ROWS`] rows, pixels; larger pictures have larger points.
const RADIUS: f32 = 1.6;
/// Rows of a picture whose points have the radius [`RADIUS`].
const ROWS: f32 = 720.0;
/// Coverage of one point's middle.
const COVER: f64 = 0.9;

/// Sets that are shown, ready to be drawn.
#[derive(Debug, Default)]
pub struct Marks {
    sets: Vec<(Arc<Highlighter>, [u8; 3])>,
    /// Sets by the places of their particles, whatever nodes are drawn.
    places: Vec<(Places, [u8; 3])>,
    alone: bool,
}

/// A layer over a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Pixels along x.
    pub width: u32,
    /// Pixels along y.
    pub height: u32,
    /// Gamma-encoded sRGB and coverage, not multiplied; row 0 at the top.
    pub rgba: Vec<[u8; 4]>,
    /// Whether nothing else is shown.
    pub alone: bool,
}

impl Marks {
    /// Those of the sets that are shown; distances are taken around a periodic box of edge `periodic`, or none. Where a set is shown
    /// alone, only such sets are. Ids are not in page files: `found` gives what has been looked up in the source
    /// ([`super::FoundIds`]); a set of ids for which it has nothing is left out.
    ///
    /// # Errors
    /// [`ExploreError::Value`] where a region makes no sense.
    pub fn new<'a>(
        sets: impl IntoIterator<Item = &'a SelectionSet>,
        metadata: &Metadata,
        periodic: Option<f64>,
        mut found: impl FnMut(&IdSet) -> Option<Arc<Highlighter>>,
    ) -> Result<Marks, ExploreError> {
        let (shown, alone) = shown(sets);
        let mut marks = Marks { sets: Vec::new(), places: Vec::new(), alone };
        for set in shown {
            let color = set.rgb().unwrap_or([255; 3]);
            match &set.members {
                Members::Region(region) => marks.add(region, color, metadata, periodic)?,
                Members::Ids(ids) => marks.sets.extend(found(ids).map(|highlighter| (highlighter, color))),
                // Only a run knows who they are: [`Marks::add_places`].
                Members::Tracked { .. } => {}
            }
        }
        Ok(marks)
    }

    /// Adds the particles in a region in a colour (gamma-encoded sRGB).
    ///
    /// # Errors
    /// [`ExploreError::Value`] where the region makes no sense.
    pub fn add(
        &mut self,
        region: &Region,
        color: [u8; 3],
        metadata: &Metadata,
        periodic: Option<f64>,
    ) -> Result<(), ExploreError> {
        self.sets.push((Arc::new(Highlighter::new(region, metadata, periodic)?), color));
        Ok(())
    }

    /// Adds particles by their places in a colour.
    pub fn add_places(&mut self, places: Places, color: [u8; 3]) {
        self.places.push((places, color));
    }

    /// Whether nothing is marked.
    pub fn is_empty(&self) -> bool {
        self.sets.is_empty() && self.places.is_empty() && !self.alone
    }

    /// Draws the layer over a picture of these nodes; of sets by places the families `families` alone.
    pub fn draw(&self, view: &View, nodes: &[SceneNode], families: &[FamilyName]) -> Layer {
        let radius = radius(view);
        let mut sums = Sums::new(view, radius);
        for (highlighter, color) in &self.sets {
            let marked: Vec<MarkedNode> =
                nodes.par_iter().filter_map(|node| MarkedNode::of(highlighter, view, node)).collect();
            let batches: Vec<Splats<'_>> = marked.iter().filter_map(|node| node.splats(radius)).collect();
            sums.add(view, &batches, *color);
        }
        self.places.iter().for_each(|(places, color)| sums.add_places(view, places, *color, families));
        sums.layer(view, self.alone)
    }
}

/// The sets that are shown, and whether they are alone.
pub fn shown<'a>(sets: impl IntoIterator<Item = &'a SelectionSet>) -> (Vec<&'a SelectionSet>, bool) {
    let mut shown: Vec<&SelectionSet> = sets.into_iter().filter(|set| set.show != Show::Hidden).collect();
    let alone = shown.iter().any(|set| set.show == Show::Alone);
    shown.retain(|set| !alone || set.show == Show::Alone);
    (shown, alone)
}

/// Draws the layer over a picture of a source's own particles: each set by the places of its particles, with its colour. Of
/// `families` alone.
pub fn draw_places(view: &View, sets: &[(Places, [u8; 3])], alone: bool, families: &[FamilyName]) -> Layer {
    let mut sums = Sums::new(view, radius(view));
    sets.iter().for_each(|(places, color)| sums.add_places(view, places, *color, families));
    sums.layer(view, alone)
}

/// Radius of points in a picture, pixels.
fn radius(view: &View) -> f32 {
    RADIUS * (view.height as f32 / ROWS).max(1.0)
}

/// Points of all sets so far: per pixel the sum of colours weighted with points, and the points.
struct Sums {
    pixels: Vec<[f32; 4]>,
    /// From points per pixel to coverage.
    strength: f64,
}

impl Sums {
    fn new(view: &View, radius: f32) -> Sums {
        // From points per pixel to coverage, so that the middle of one point is covered by COVER.
        let peak = Kernel::CubicSpline.projected(0.0) / f64::from(radius * radius);
        let strength = -(1.0 - COVER).ln() / peak;
        Sums { pixels: vec![[0.0; 4]; view.width as usize * view.height as usize], strength }
    }

    /// Adds the points of a set in its colour.
    fn add(&mut self, view: &View, batches: &[Splats<'_>], color: [u8; 3]) {
        let (points, _) = draw_counted(view, batches, &SplatOptions::default());
        let [r, g, b] = color.map(f32::from);
        self.pixels.par_iter_mut().zip(&points.p).for_each(|(sum, &p)| {
            let p = p.max(0.0);
            *sum = [sum[0] + p * r, sum[1] + p * g, sum[2] + p * b, sum[3] + p];
        });
    }

    /// Adds particles of `families` by their places.
    fn add_places(&mut self, view: &View, places: &Places, color: [u8; 3], families: &[FamilyName]) {
        let drawn = families.iter().copied();
        let images = || view.images.offsets().collect::<Vec<DVec3>>();
        let at = drawn.flat_map(|name| places.family(name)).flat_map(|at| images().into_iter().map(move |by| *at + by));
        let positions: Vec<[f64; 3]> = at.filter(|at| view.cut.keeps(*at)).map(|at| at.to_array()).collect();
        let weight = vec![1.0; positions.len()];
        let splats = Splats::new(Positions::World(&positions), Extent::Pixels(radius(view)), &weight, None);
        self.add(view, splats.ok().as_slice(), color);
    }

    fn layer(&self, view: &View, alone: bool) -> Layer {
        let pixel = |&[r, g, b, p]: &[f32; 4]| {
            let cover = 1.0 - (-self.strength * f64::from(p)).exp();
            let [r, g, b] = [r, g, b].map(|sum| if p > 0.0 { (sum / p).round() as u8 } else { 0 });
            [r, g, b, (255.0 * cover).round() as u8]
        };
        let rgba = self.pixels.par_iter().map(pixel).collect();
        Layer { width: view.width, height: view.height, rgba, alone }
    }
}

impl Layer {
    /// Lays it over a picture of its size; another size is left as it is.
    pub fn blend(&self, image: &mut Image) {
        if (self.width, self.height) != (image.width, image.height) {
            return;
        }
        image.rgba.par_iter_mut().zip(&self.rgba).for_each(|(below, &[r, g, b, cover])| {
            let share = f32::from(cover) / 255.0;
            let under = if self.alone { [0; 3] } else { [below[0], below[1], below[2]] };
            for (k, (over, under)) in [r, g, b].into_iter().zip(under).enumerate() {
                below[k] = (share * f32::from(over) + (1.0 - share) * f32::from(under)).round() as u8;
            }
        });
    }
}

/// The particles of a node that belong to a set.
struct MarkedNode {
    origin: DVec3,
    size: f64,
    offsets: Vec<[f32; 3]>,
    weight: Vec<f32>,
}

impl MarkedNode {
    /// Those that the view shows; `None` without any.
    fn of(highlighter: &Highlighter, view: &View, drawn: &SceneNode) -> Option<MarkedNode> {
        let index = drawn.node.node as usize;
        let node = drawn.page.nodes.get(index)?;
        let mut bits = Vec::new();
        let marked = highlighter.mark(&drawn.page, index, drawn.time, &mut bits);
        if marked == Marked::None {
            return None;
        }
        let (origin, size) = (node.frame.min + drawn.offset, node.frame.size);
        // Discs of some pixels need no more than single precision in the frame.
        let held = drawn.page.content(index).map(|content| content.particles(drawn.time));
        let particles = drawn.page.particles(index);
        let count = held.as_ref().map_or(particles.len(), |held| held.len());
        let fraction = |i: usize| match &held {
            Some(held) => ((DVec3::from(held.positions[i]) - node.frame.min) / size).as_vec3().to_array(),
            None => particles.fraction(i),
        };
        let is_marked =
            |i: usize| marked == Marked::All || bits.get(i / 64).is_some_and(|word| word >> (i % 64) & 1 == 1);
        let keeps = |offset: &[f32; 3]| {
            view.cut.is_none() || view.cut.keeps(origin + size * Vec3::from_array(*offset).as_dvec3())
        };
        let offsets: Vec<[f32; 3]> = (0..count).filter(|&i| is_marked(i)).map(fraction).filter(keeps).collect();
        let weight = vec![1.0; offsets.len()];
        (!offsets.is_empty()).then_some(MarkedNode { origin, size, offsets, weight })
    }

    fn splats(&self, radius: f32) -> Option<Splats<'_>> {
        let positions = Positions::Relative { origin: self.origin, scale: self.size, offsets: &self.offsets };
        Splats::new(positions, Extent::Pixels(radius), &self.weight, None).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build_source};
    use crate::explore::{FoundIds, Work};
    use crate::import::LoadOptions;
    use crate::store::PageFile;
    use crate::stream::Scene;
    use crate::view::Projection;

    #[test]
    fn a_selection_is_drawn_in_its_colour_where_its_particles_are() {
        let source = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo/lcdm64_z0.hdf5");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("demo.df");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &path, &()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        let center = DVec3::new(29.16, 35.0, 27.36);
        let projection = Projection::Orthographic { height: 50.0 };
        let view = View::look_at(center + DVec3::Z * 100.0, center, DVec3::Y, projection, 200, 200).unwrap();
        let nodes = Scene::new(Arc::clone(&file), u64::MAX).converge_blocking(&view, 0.5).unwrap().nodes;
        // A massive halo, 2 units in radius: 8 pixels around the picture's middle.
        let mut set = SelectionSet::new("halo", Region::sphere(center, 2.0), 0);
        let layer =
            |set: &SelectionSet| Marks::new([set], file.metadata(), None, |_| None).unwrap().draw(&view, &nodes, &[]);
        let drawn = layer(&set);
        let from_middle = |at: usize| ((at % 200) as f64 + 0.5 - 100.0).hypot((at / 200) as f64 + 0.5 - 100.0);
        let covered: Vec<usize> = (0..drawn.rgba.len()).filter(|&at| drawn.rgba[at][3] > 0).collect();
        assert!(covered.len() > 40 && covered.iter().all(|&at| from_middle(at) < 8.0 + 3.0), "{}", covered.len());
        assert!(covered.iter().all(|&at| drawn.rgba[at][..3] == set.rgb().unwrap()));
        assert!(drawn.rgba[100 * 200 + 100][3] > 200, "the core is covered");

        // By what is found in the source, as sets of ids are, and by the source's own places, it is drawn where its region is.
        let opened = crate::import::open(&source).unwrap();
        let places = Places::of(opened.as_ref(), &set.members, None, Work::quiet()).unwrap();
        let found = FoundIds::of(opened.as_ref(), &set.members, file.metadata(), Work::quiet()).unwrap();
        assert_eq!(found.count, places.len() as u64);
        let ids = IdSet::new(vec![7, 9]);
        let by_id = SelectionSet { members: Members::Ids(ids.clone()), ..set.clone() };
        let look_up = |wanted: &IdSet| (*wanted == ids).then(|| Arc::clone(&found.highlighter));
        let marks = Marks::new([&by_id], file.metadata(), None, look_up).unwrap();
        let exact = draw_places(&view, &[(places, set.rgb().unwrap())], false, &FamilyName::GADGET);
        for (name, other) in [("ids", marks.draw(&view, &nodes, &[])), ("places", exact)] {
            let differ =
                (0..other.rgba.len()).filter(|&at| (other.rgba[at][3] > 128) != (drawn.rgba[at][3] > 128)).count();
            assert!(differ <= covered.len() / 10, "{name}: {differ} of {}", covered.len());
            assert!(other.rgba.iter().all(|pixel| pixel[3] == 0 || pixel[..3] == set.rgb().unwrap()), "{name}");
        }

        // Over a picture: the colour where it covers, the picture elsewhere; alone, black elsewhere.
        let below = Image { width: 200, height: 200, rgba: vec![[9, 99, 199, 255]; 200 * 200] };
        let mut over = below.clone();
        drawn.blend(&mut over);
        assert_eq!(over.rgba[0], below.rgba[0]);
        assert_ne!(over.rgba[100 * 200 + 100], below.rgba[0]);
        set.show = Show::Alone;
        let mut alone = below.clone();
        layer(&set).blend(&mut alone);
        assert_eq!(alone.rgba[0], [0, 0, 0, 255]);
        set.show = Show::Hidden;
        assert!(Marks::new([&set], file.metadata(), None, |_| None).unwrap().is_empty());
    }
}
