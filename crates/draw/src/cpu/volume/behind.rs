//! What lies behind a picture (F12 5.7.2): for each pixel the depth at which it has become opaque, and a pyramid of the largest of
//! them, so that a few look-ups tell whether a node of the hierarchy is hidden. F12 asks after every slab whether pixels are opaque
//! already; depths say the same for all slabs at once, and outlive the picture, so that what is hidden needs no reading either.
//!
//! The picture may show less than there is while pages come in, or with fewer pixels. So what it hides is an estimate until a
//! picture of what was chosen with it hides the same; then nothing that could show is left out.
//!
//! # From another eye
//!
//! [`OpaqueDepths::seen_from`] tells what is still hidden when the camera has moved. Let the eye have moved by `b`, and let a line of
//! sight of the new eye end in a point of the node, at depth `z` of the picture. Its point at depth `y < z` appears in the picture
//! displaced from the end by
//!
//! ```text
//! f (b_xy - b_z s) (z - y) / (y (z - b_z))        pixels; s: the slope under which the end is seen, f: pixels at depth 1
//! ```
//!
//! along a straight line. If no pixel within that way is opaque at a smaller depth than `y`, the line is in front of everything that
//! the picture shows when it passes `y`; if all of them are opaque in front of the node, it ends behind; so it passes somewhere
//! from in front of a pixel's depth to behind that of the same or a neighbouring pixel. Where neighbours differ by so little that the
//! new eye sees them less than [`OPENING`] pixels apart, the line passes opaque matter within `OPENING` and a pixel. So:
//!
//! - The eye stays (the camera turns, zooms, or is orthographic and shifts): nothing is hidden that shows through an
//!   opening of the opaque matter wider than a pixel of the picture, at which it was sampled.
//! - The eye moves: nothing is hidden that shows through an opening wider than `OPENING` and two pixels, if what hides it are
//!   surfaces: what is opaque from one side is from the other. Matter that becomes opaque along a way through it may be less so along
//!   another line; there the depths are an estimate, as they are while pages come in.
//! - A near plane that moves with the eye uncovers what is behind the matter that it cuts.
//!
//! What lies beside the picture is never hidden.

use crate::view::{Extent, Occluder, Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// How much further particles reach than their smoothing lengths at most: wide ones are interpolated from coarser grids
/// ([`super::coarse`]), through two cells of which 8 make a smoothing length, on every level.
const SPREAD: f64 = 1.5;
/// How far apart the new eye may see neighbouring pixels, pixels of the picture. No setting: more keeps rough surfaces opaque a
/// little longer, and what the picture of the new eye needs it asks for in any case.
const OPENING: f64 = 2.0;
/// Times that a way through the picture is made longer at most, until nothing near it is nearer to the eye than the way goes.
const LONGER: usize = 6;

/// The depths at which a picture's pixels have become opaque.
#[derive(Clone, Debug, PartialEq)]
pub struct OpaqueDepths {
    view: View,
    /// Pixels around an extent that may show it, since samples are read around each pixel and small particles are enlarged.
    around: f64,
    /// What small particles are enlarged to, pixels.
    smallest: f64,
    /// How far particles reach, smoothing lengths.
    spread: f64,
    /// Level 0 is the picture, each further one halves it, rounded up.
    levels: Vec<Level>,
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    cells: Vec<Cell>,
}

/// What is known of some pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    /// The smallest and the largest depth; infinite for what is not opaque.
    nearest: f32,
    farthest: f32,
    /// The largest difference of inverse depths between one of the pixels and one of its eight neighbours (in one or the other of
    /// two neighbours).
    step: f32,
}

impl Cell {
    /// No pixel.
    const NONE: Cell = Cell { nearest: f32::INFINITY, farthest: f32::NEG_INFINITY, step: 0.0 };

    fn and(self, other: Cell) -> Cell {
        Cell {
            nearest: self.nearest.min(other.nearest),
            farthest: self.farthest.max(other.farthest),
            step: self.step.max(other.step),
        }
    }
}

/// The pixels of a picture, one cell each.
fn pixels(width: usize, height: usize, depths: &[f32]) -> Level {
    let inverse: Vec<f32> = depths.iter().map(|depth| 1.0 / depth).collect();
    let cell = |index: usize| {
        let (x, y) = (index % width, index / width);
        let neighbour = |dx: usize, dy: usize| {
            let [x, y] = [(x + dx).wrapping_sub(1), y + dy];
            (x < width && y < height).then(|| (inverse[index] - inverse[y * width + x]).abs())
        };
        // The other four neighbours have their differences to this one.
        let steps = [neighbour(2, 0), neighbour(0, 1), neighbour(1, 1), neighbour(2, 1)];
        let step = steps.into_iter().flatten().fold(0.0, f32::max);
        Cell { nearest: depths[index], farthest: depths[index], step }
    };
    Level { width, height, cells: (0..depths.len()).into_par_iter().map(cell).collect() }
}

/// Where an extent may show in a picture, and between which depths it lies.
struct Footprint {
    depths: [f64; 2],
    /// Pixels, from left to right and from top to bottom.
    span: [[f64; 2]; 2],
}

impl OpaqueDepths {
    /// The depths of a picture of `view`, row by row (missing ones count as infinite), drawn with cells so many pixels wide and with
    /// particles that reach over `smallest` cells at least.
    pub fn new(view: &View, mut depths: Vec<f32>, cell: f64, smallest: f64) -> OpaqueDepths {
        let (width, height) = (view.width as usize, view.height as usize);
        depths.resize(width * height, f32::INFINITY);
        let mut levels = vec![pixels(width, height, &depths)];
        while let Some(fine) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
            let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
            let at = |x: usize, y: usize| match x < fine.width && y < fine.height {
                true => fine.cells[y * fine.width + x],
                false => Cell::NONE,
            };
            let cell =
                |x: usize, y: usize| (0..4).map(|k| at(2 * x + k % 2, 2 * y + k / 2)).fold(Cell::NONE, Cell::and);
            let cells = (0..width * height).map(|index| cell(index % width, index / width)).collect();
            levels.push(Level { width, height, cells });
        }
        let around = 2.0 + ((2.0 + smallest) * cell).ceil();
        OpaqueDepths { view: *view, around, smallest: smallest * cell, spread: SPREAD, levels }
    }

    /// The same for particles that reach further than others, `lengths` smoothing lengths.
    #[must_use]
    pub fn reaching(self, lengths: f64) -> OpaqueDepths {
        OpaqueDepths { spread: self.spread.max(lengths), ..self }
    }

    /// What both hide, of two pictures of the same size.
    pub fn and(&self, other: &OpaqueDepths) -> Option<OpaqueDepths> {
        if self.view != other.view {
            return None;
        }
        let pairs = self.levels[0].cells.iter().zip(&other.levels[0].cells);
        let depths = pairs.map(|(a, b)| a.farthest.max(b.farthest)).collect();
        let both = OpaqueDepths::new(&self.view, depths, 1.0, 0.0);
        let (around, smallest) = (self.around.max(other.around), self.smallest.max(other.smallest));
        Some(OpaqueDepths { around, smallest, spread: self.spread.max(other.spread), ..both })
    }

    /// The view whose picture it is.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Whether a view is the picture's but for the number of pixels.
    pub fn is_of(&self, view: &View) -> bool {
        View { width: self.view.width, height: self.view.height, ..*view } == self.view
    }

    /// Whether no pixel is opaque.
    pub fn is_clear(&self) -> bool {
        self.levels.last().is_none_or(|whole| whole.cells.iter().all(|cell| cell.nearest.is_infinite()))
    }

    /// What hides nodes from a view: the picture itself where it is the view's, else what of it lasts ([`OpaqueDepths::seen_from`]).
    pub fn occluder(self: &Arc<Self>, view: &View) -> Option<Arc<dyn Occluder>> {
        match self.is_of(view) {
            true => Some(Arc::clone(self) as Arc<dyn Occluder>),
            false => self.seen_from(view, 0.0).map(|moved| Arc::new(moved) as Arc<dyn Occluder>),
        }
    }

    /// What is hidden from every eye within `reach` (world units) of that of `view`, wherever it looks. `None` where the picture says
    /// nothing about that: an orthographic view from another direction, another time, other images, another cut, or one that
    /// fades with depth.
    pub fn seen_from(self: &Arc<Self>, view: &View, reach: f64) -> Option<FromElsewhere> {
        let (old, new) = (&self.view, view);
        let is_same_matter =
            (old.cut, old.images, old.time) == (new.cut, new.images, new.time) && new.cut.fade_rate == 0.0;
        let has_same_lines = match (old.projection, new.projection) {
            (Projection::Perspective { .. }, Projection::Perspective { .. }) => true,
            (Projection::Orthographic { .. }, Projection::Orthographic { .. }) => old.forward == new.forward,
            _ => false,
        };
        let magnified = old.focal_pixels() / new.focal_pixels();
        let way = old.to_camera(new.eye);
        (is_same_matter && has_same_lines).then(|| FromElsewhere { picture: Arc::clone(self), way, reach, magnified })
    }

    fn is_perspective(&self) -> bool {
        matches!(self.view.projection, Projection::Perspective { .. })
    }

    /// Where an extent shows whose small particles are enlarged to `growth` times as much as in the picture. `None` for what reaches
    /// behind the eye.
    fn footprint(&self, extent: &Extent, growth: f64) -> Option<Footprint> {
        let view = &self.view;
        let nearest = view.nearest_depth(extent);
        let farthest = 2.0 * view.to_camera(extent.bounds.center()).z - nearest;
        let enlarged = growth * self.smallest / view.focal_pixels();
        let enlarged = |depth: f64| if self.is_perspective() { enlarged * depth.max(0.0) } else { enlarged };
        let reach = self.spread * extent.margin;
        let depths = [nearest - enlarged(nearest).max(reach), farthest + enlarged(farthest).max(reach)];
        if self.is_perspective() && depths[0] <= 0.0 {
            return None;
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let (min, max) = (extent.bounds.min - reach, extent.bounds.max + reach);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
            let pixel = view.to_pixels(view.to_camera(DVec3::new(pick(0), pick(1), pick(2))))?;
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis]);
            }
        }
        let around = growth * self.around;
        Some(Footprint { depths, span: [0, 1].map(|axis| [low[axis] - around, high[axis] + around]) })
    }

    /// What is known of the pixels of a part of the picture, and perhaps of some around it; `None` if it has none. It is looked up where
    /// these are four by four or fewer.
    fn within(&self, [x, y]: [[f64; 2]; 2]) -> Option<Cell> {
        let size = [self.levels[0].width as i64, self.levels[0].height as i64];
        // The casts saturate.
        let clip = |[from, to]: [f64; 2], size: i64| [(from.floor() as i64).max(0), (to.ceil() as i64).min(size - 1)];
        let ([left, right], [top, bottom]) = (clip(x, size[0]), clip(y, size[1]));
        if left > right || top > bottom {
            return None;
        }
        let fits = |shift: &usize| (right >> shift) - (left >> shift) < 4 && (bottom >> shift) - (top >> shift) < 4;
        let shift = (0..self.levels.len()).find(fits)?;
        let level = &self.levels[shift];
        let columns = (left >> shift) as usize..=(right >> shift) as usize;
        let rows = (top >> shift) as usize..=(bottom >> shift) as usize;
        Some(
            rows.flat_map(|y| columns.clone().map(move |x| level.cells[y * level.width + x]))
                .fold(Cell::NONE, Cell::and),
        )
    }

    /// The same for a part that lies in the picture as a whole.
    fn within_whole(&self, span: [[f64; 2]; 2]) -> Option<Cell> {
        let size = [self.view.width, self.view.height].map(f64::from);
        let is_whole = (0..2).all(|axis| span[axis][0] >= 0.0 && span[axis][1] <= size[axis]);
        is_whole.then(|| self.within(span))?
    }
}

impl Occluder for OpaqueDepths {
    /// From the picture's own view: of what is partly beside the picture, the part within it counts.
    fn hides(&self, extent: &Extent) -> bool {
        let Some(Footprint { depths: [nearest, _], span }) = self.footprint(extent, 1.0) else { return false };
        self.within(span).is_some_and(|cell| nearest > f64::from(cell.farthest))
    }
}

/// What a picture hides from another eye than its own: see [`OpaqueDepths::seen_from`].
#[derive(Clone, Debug)]
pub struct FromElsewhere {
    picture: Arc<OpaqueDepths>,
    /// Where the eye is, in the picture's camera coordinates.
    way: DVec3,
    /// How far it may be from there, world units.
    reach: f64,
    /// How much larger a length shows in the picture than in the new view at the same depth.
    magnified: f64,
}

impl FromElsewhere {
    /// The slopes under which the picture sees a footprint, along the pixel axes.
    fn slopes(&self, span: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let (middle, focal) = (self.picture.view.middle(), self.picture.view.focal_pixels());
        [0, 1].map(|axis| span[axis].map(|at| (at - middle[axis]) / focal))
    }

    /// How fast lines of sight that end under these slopes move across the picture, least and most along each axis: `b_xy - b_z s`.
    fn drift(&self, slopes: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let across = [self.way.x, -self.way.y];
        [0, 1].map(|axis| {
            let of = slopes[axis].map(|slope| across[axis] - self.way.z * slope);
            let slack = self.reach * (1.0 + slopes[axis][0].abs().max(slopes[axis][1].abs()));
            [of[0].min(of[1]) - slack, of[0].max(of[1]) + slack]
        })
    }
}

impl Occluder for FromElsewhere {
    fn hides(&self, extent: &Extent) -> bool {
        let Self { picture, way, reach, magnified } = self;
        // No eye is further ahead.
        let ahead = way.z + reach;
        if !picture.is_perspective() {
            // The same lines of sight. What is behind the eye is not drawn.
            let Some(footprint) = picture.footprint(extent, magnified.max(1.0)) else { return false };
            let found = picture.within_whole(footprint.span);
            return found
                .is_some_and(|cell| f64::from(cell.nearest) > ahead && footprint.depths[0] > f64::from(cell.farthest));
        }
        let Some(Footprint { depths: [nearest, _], span }) = picture.footprint(extent, 1.0) else { return false };
        // Small particles are enlarged the more, the deeper they are for the new eye.
        let secant = self.slopes(span).iter().flatten().fold(1.0, |sum, slope| sum + slope * slope).sqrt();
        let growth = (magnified * (secant + (way.length() + reach) / nearest)).max(1.0);
        let Some(Footprint { depths: [nearest, farthest], span }) = picture.footprint(extent, growth) else {
            return false;
        };
        let Some(mut cell) = picture.within_whole(span) else { return false };
        let (drift, focal) = (self.drift(self.slopes(span)), picture.view.focal_pixels());
        for _ in 0..LONGER {
            let from = f64::from(cell.nearest);
            if from <= ahead.max(0.0) || f64::from(cell.farthest) >= nearest {
                return false;
            }
            let length = focal * (farthest - from) / (from * (farthest - ahead));
            let long = [0, 1].map(|axis| {
                let [low, high] = drift[axis].map(|drift| length * drift);
                [span[axis][0] + low.min(0.0), span[axis][1] + high.max(0.0)]
            });
            let Some(found) = picture.within_whole(long) else { return false };
            if f64::from(found.nearest) >= from {
                let most = drift.iter().map(|[low, high]| low.abs().max(high.abs()));
                let fastest = most.fold(0.0, f64::hypot) * nearest / (nearest - ahead.max(0.0));
                return f64::from(found.farthest) < nearest && focal * fastest * f64::from(found.step) <= OPENING;
            }
            cell = found;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use proptest::prelude::*;

    fn view(width: u32, height: u32) -> View {
        let projection = Projection::Perspective { fov_y: 0.8 };
        View::look_at(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
    }

    proptest! {
        /// Whatever is hidden lies behind every pixel that any point of it falls on.
        #[test]
        fn hides_only_what_is_behind_opaque_pixels(
            width in 1u32..50, height in 1u32..50,
            seed in prop::collection::vec(prop_oneof![5.0f32..12.0, Just(f32::INFINITY)], 2500),
            min in prop::array::uniform3(-4.0..4.0f64), size in 0.01..1.0f64, margin in 0.0..0.3f64,
            points in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 20),
        ) {
            let view = view(width, height);
            let depths: Vec<f32> = seed[..(width * height) as usize].to_vec();
            let opaque = OpaqueDepths::new(&view, depths.clone(), 1.0, 0.0);
            let min = DVec3::from(min);
            let extent = Extent { bounds: Bounds { min, max: min + size }, margin };
            if opaque.hides(&extent) {
                for point in points {
                    let place = min - margin + (size + 2.0 * margin) * DVec3::from(point);
                    let camera = view.to_camera(place);
                    let [x, y] = view.to_pixels(camera).unwrap();
                    if x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height) {
                        let depth = depths[(y as u32 * width + x as u32) as usize];
                        prop_assert!(camera.z > f64::from(depth) - margin - 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn extents_are_hidden_behind_what_has_been_drawn() {
        let view = view(128, 128);
        let half = (0..128 * 128).map(|i| if i % 128 < 64 { 10.0 } else { f32::INFINITY }).collect();
        let opaque = OpaqueDepths::new(&view, half, 1.0, 2.0);
        assert!(!opaque.is_clear() && OpaqueDepths::new(&view, Vec::new(), 1.0, 2.0).is_clear());
        let at = |x: f64, z: f64| Extent {
            bounds: Bounds { min: DVec3::new(x, -0.2, z), max: DVec3::new(x + 0.4, 0.2, z + 0.4) },
            margin: 0.1,
        };
        assert!(opaque.hides(&at(-2.0, -2.0)));
        assert!(!opaque.hides(&at(-2.0, 0.5)), "in front of what is opaque");
        assert!(!opaque.hides(&at(1.0, -2.0)), "behind clear pixels");
        assert!(!opaque.hides(&at(-0.2, -2.0)), "behind both");
        assert!(!opaque.hides(&at(-90.0, -2.0)), "beside the picture");
        let other_half = (0..128 * 128).map(|i| if i % 128 >= 32 { 9.0 } else { f32::INFINITY }).collect();
        let both = opaque.and(&OpaqueDepths::new(&view, other_half, 1.0, 2.0)).unwrap();
        assert!(both.hides(&at(-1.6, -2.0)) && !both.hides(&at(-3.0, -2.0)) && !both.hides(&at(1.0, -2.0)));
        assert!(both.and(&OpaqueDepths::new(&self::view(32, 32), Vec::new(), 1.0, 2.0)).is_none());
    }

    /// Balls, and what a picture of their nearest sides hides.
    struct Balls(Vec<(DVec3, f64)>);

    impl Balls {
        /// How far along a ray (a unit vector) the first ball is.
        fn first(&self, from: DVec3, along: DVec3) -> f64 {
            let hit = |&(center, radius): &(DVec3, f64)| {
                let to = center - from;
                let middle = to.dot(along);
                let square = radius * radius - (to.length_squared() - middle * middle);
                if square > 0.0 && middle > square.sqrt() { middle - square.sqrt() } else { f64::INFINITY }
            };
            self.0.iter().map(hit).fold(f64::INFINITY, f64::min)
        }

        fn picture(&self, view: &View) -> Arc<OpaqueDepths> {
            let depth = |index: u32| {
                let pixel = [index % view.width, index / view.width].map(|at| f64::from(at) + 0.5);
                let (from, along) = match view.projection {
                    Projection::Perspective { .. } => (view.eye, view.at_depth(pixel, 1.0) - view.eye),
                    Projection::Orthographic { .. } => (view.at_depth(pixel, 0.0), view.forward),
                };
                (self.first(from, along.normalize()) / along.length()) as f32
            };
            let depths = (0..view.width * view.height).map(depth).collect();
            Arc::new(OpaqueDepths { around: 1.0, ..OpaqueDepths::new(view, depths, 1.0, 0.0) })
        }

        /// Whether a place shows to a view through an opening whose radius is so many of its pixels.
        fn shows(&self, view: &View, place: DVec3, radius: f64) -> bool {
            let camera = view.to_camera(place);
            let Some(middle) = view.to_pixels(camera) else { return false };
            let is_seen = |offset: [f64; 2]| {
                let end = view.at_depth([middle[0] + offset[0], middle[1] + offset[1]], camera.z);
                let from = match view.projection {
                    Projection::Perspective { .. } => view.eye,
                    Projection::Orthographic { .. } => end - camera.z * view.forward,
                };
                self.first(from, (end - from).normalize()) > end.distance(from)
            };
            let ring = |radius: f64| {
                (0..16).map(move |k| [(0.4 * f64::from(k)).cos(), (0.4 * f64::from(k)).sin()].map(|at| at * radius))
            };
            is_seen([0.0; 2]) && ring(radius).chain(ring(0.5 * radius)).all(is_seen)
        }
    }

    fn next(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Large balls, many or few, and small things behind and between them: whatever the camera does, nothing is
    /// hidden that shows through more than the opening that is allowed.
    #[test]
    fn nothing_that_shows_is_hidden_from_another_eye() {
        let state = &mut 11;
        // Turned and zoomed, moved, within reach of a move, and shifted without perspective.
        let (mut hidden, mut uncovered) = ([0; 4], 0);
        for _ in 0..150 {
            let balls = (0..8 + (30.0 * next(state)) as u32).map(|_| {
                let at = DVec3::new(next(state) - 0.5, next(state) - 0.5, 0.3 * next(state));
                (DVec3::new(8.0, 8.0, 8.0) * at, 0.4 + 1.2 * next(state))
            });
            let balls = Balls(balls.collect());
            let signed = |state: &mut u64, most: f64| most * (2.0 * next(state) - 1.0);
            let [x, y, z] = [0; 3].map(|_| signed(state, 1.0));
            let step = 2.0 * next(state).powi(2) * DVec3::new(x, y, z);
            let flat = Projection::Orthographic { height: 5.0 };
            let deep = Projection::Perspective { fov_y: 0.6 };
            let eye = DVec3::new(0.0, 0.0, 10.0);
            let look = |eye: DVec3, target: DVec3, projection: Projection| {
                View::look_at(eye, target, DVec3::Y, projection, 240, 200).unwrap()
            };
            let target = DVec3::new(signed(state, 1.0), signed(state, 1.0), 0.0);
            let zoomed = Projection::Perspective { fov_y: 0.3 + 0.5 * next(state) };
            let cases = [
                (look(eye, DVec3::ZERO, deep), look(eye, target, zoomed), 0.0, 1.5),
                (look(eye, DVec3::ZERO, deep), look(eye + step, target, deep), 0.0, OPENING + 2.0),
                (look(eye, DVec3::ZERO, deep), look(eye + step, target, deep), step.length(), OPENING + 2.0),
                (look(eye, DVec3::ZERO, flat), look(eye + step, step, flat), 0.0, 1.5),
            ];
            for (case, (before, after, reach, opening)) in cases.into_iter().enumerate() {
                // Within reach of where the eye was, where it is now is no more than a place like others.
                let from = if reach > 0.0 { &before } else { &after };
                let picture = balls.picture(&before);
                let elsewhere = picture.seen_from(from, reach).unwrap();
                // In pixels of the picture.
                let opening = opening * (after.focal_pixels() / before.focal_pixels()).max(1.0);
                for _ in 0..60 {
                    let min = DVec3::new(signed(state, 2.5), signed(state, 2.0), signed(state, 2.0) - 2.0);
                    let extent = Extent { bounds: Bounds { min, max: min + 0.2 * next(state) }, margin: 0.0 };
                    if !elsewhere.hides(&extent) {
                        let was_hidden = picture.hides(&extent);
                        uncovered += u32::from(was_hidden && balls.shows(&after, extent.bounds.center(), opening));
                        continue;
                    }
                    hidden[case] += 1;
                    for _ in 0..8 {
                        let share = DVec3::new(next(state), next(state), next(state));
                        let place = extent.bounds.min + share * extent.bounds.size();
                        assert!(!balls.shows(&after, place, opening), "case {case}: {place} from {}", after.eye);
                    }
                }
            }
        }
        println!("{hidden:?} of 9000, {uncovered} uncovered");
        assert!(hidden.iter().all(|&hidden| hidden > 1000) && uncovered > 20, "{hidden:?}, {uncovered} uncovered");
    }

    #[test]
    fn what_was_behind_something_comes_out_from_behind_it_as_the_eye_moves() {
        let mut balls = Balls(vec![(DVec3::new(0.0, 0.0, 4.0), 1.0)]);
        let eye = DVec3::new(0.0, 0.0, 10.0);
        let look = |eye: DVec3, target: DVec3| {
            let projection = Projection::Perspective { fov_y: 0.8 };
            View::look_at(eye, target, DVec3::Y, projection, 200, 200).unwrap()
        };
        let small = Extent { bounds: Bounds { min: DVec3::new(0.0, 0.0, -0.1), max: DVec3::splat(0.1) }, margin: 0.0 };
        let hides = |balls: &Balls, way: DVec3, gaze: DVec3| {
            let moved = balls.picture(&look(eye, DVec3::ZERO)).seen_from(&look(eye + way, eye + way + gaze), 0.0);
            moved.unwrap().hides(&small)
        };
        let ahead = DVec3::NEG_Z;
        assert!(hides(&balls, DVec3::ZERO, ahead) && hides(&balls, DVec3::ZERO, DVec3::new(0.2, 0.1, -1.0)));
        assert!(hides(&balls, 0.8 * DVec3::X, ahead) && hides(&balls, 0.8 * DVec3::NEG_Y, ahead), "a step aside");
        assert!(hides(&balls, 2.0 * DVec3::NEG_Z, ahead) && hides(&balls, 2.0 * DVec3::Z, ahead), "nearer, further");
        assert!(!hides(&balls, 3.0 * DVec3::X, ahead), "beside the ball");
        assert!(!hides(&balls, 6.0 * DVec3::NEG_Z, ahead), "within the ball");
        // A wall behind the ball hides by itself; but from aside there is a gap between both.
        balls.0.push((DVec3::new(0.0, 0.0, -31.0), 30.0));
        let behind = Extent { bounds: Bounds { min: DVec3::splat(-2.0), max: DVec3::splat(-1.9) }, margin: 0.0 };
        let picture = balls.picture(&look(eye, DVec3::ZERO));
        let from = |x: f64, extent: &Extent| {
            picture.seen_from(&look(eye + x * DVec3::X, DVec3::ZERO), 0.0).unwrap().hides(extent)
        };
        assert!(from(0.0, &behind) && from(0.2, &behind));
        assert!(from(0.01, &small) && from(0.8, &small) && !from(3.0, &small));
        // Its edge is seen from everywhere: the wall is a few units behind the ball there.
        let edge =
            Extent { bounds: Bounds { min: DVec3::new(1.9, 0.0, -1.9), max: DVec3::new(2.0, 0.1, -1.8) }, margin: 0.0 };
        assert!(from(0.0, &edge) && !from(1.0, &edge), "what the ball hides of the wall is not known");
        // No line of sight is the same from another direction, or in another picture of the data.
        let flat = |target: DVec3| View { projection: Projection::Orthographic { height: 8.0 }, ..look(eye, target) };
        let picture = balls.picture(&flat(DVec3::ZERO));
        assert!(picture.seen_from(&flat(DVec3::X), 0.0).is_none());
        assert!(picture.seen_from(&look(eye, DVec3::ZERO), 0.0).is_none());
        assert!(picture.seen_from(&View { time: 1.0, ..flat(DVec3::ZERO) }, 0.0).is_none());
        assert!(picture.seen_from(&flat(DVec3::ZERO), 0.0).is_some());
        assert!(picture.is_of(&View { width: 50, ..flat(DVec3::ZERO) }) && !picture.is_of(&look(eye, DVec3::ZERO)));
    }
}
