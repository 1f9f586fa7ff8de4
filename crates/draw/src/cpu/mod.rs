//! The CPU renderer: what every GPU result is held against, and what draws where there is no GPU.
//!
//! For particle `i` with weight `w_i`, attribute `a_i`, smoothing length `h_i` and line-of-sight kernel `F(s, h)` (unit
//! 1/length^2, plane integral 1), where `s` is the distance of a pixel's line of sight from the particle:
//!
//! - `P(pixel)` = mean over the pixel's area of `sum w_i F(s_i, h_i)` (F12 equation 4.1 for `w = m rho`),
//! - `P S (pixel)` = mean over the pixel's area of `sum w_i a_i F(s_i, h_i)` (F12 equation 4.2).
//!
//! In an orthographic view the sum of `P` times the area of a pixel is the weight in view. In a perspective view the
//! lines of sight diverge (F12 4.9.1): `P` is the integral along each pixel's own ray. A small particle at depth `z`
//! and angle `theta` off the axis then covers an ellipse that is longer by `sec(theta)` along the radius, and the sum
//! of `P (z / focal)^2` is `w sec(theta)`.
//!
//! Particles at or behind the eye plane (depth <= 0) are dropped. For an eye inside a kernel the whole line counts, the
//! part behind the eye too.

pub mod about_eye;
pub mod among;
pub mod around;
pub mod cartesian;
pub mod ellipse;
pub mod ellipsoid;
pub mod field;
pub mod footprint;
pub mod half_line;
pub mod kernel_products;
pub mod layered;
pub mod mesh;
pub mod outlines;
pub mod over;
pub mod overdraw;
pub mod paths;
pub mod pyramid;
pub mod screen_spheres;
pub mod screen_tiles;
pub mod shadowing;
pub mod slice;
pub mod sorted;
pub mod splats;
pub mod sprites;
pub mod surface;
pub mod table;
pub mod volume;

mod ellipse_area;
mod ellipse_rows;
mod exact;
mod fast;
mod front_to_back;
mod lanes;
mod profile;
mod small;
mod sphere;
mod summation;
mod tiles;

pub use exact::AREA_FILTER;
pub use splats::{Extent, NodeTraits, Positions, SplatError, SplatKind, Splats};
pub use sprites::Sprite;
pub use summation::Summation;

use crate::color::Accumulation;
use crate::model::Kernel;
use crate::view::View;

/// How splats are evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Method {
    /// Area means to better than 1e-5 of each splat's peak, double precision, no approximation by pyramids. The reference.
    Exact,
    /// The image pyramid: bounded cost for each splat, single precision, relative L1 and L2 error below 1e-3.
    #[default]
    Pyramid,
}

/// Settings of [`draw`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatOptions {
    /// Exact or fast.
    pub method: Method,
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// Whether particles that no pixel sees are dropped at once; the picture is the same without, which the exact method
    /// does not know.
    pub culling: bool,
    /// Particles that add less than this to every pixel's `P` are dropped; 0: none.
    pub faintest: f32,
    /// What a splat looks like in the picture.
    pub sprite: Sprite,
}

impl Default for SplatOptions {
    fn default() -> SplatOptions {
        SplatOptions {
            method: Method::default(),
            kernel: Kernel::default(),
            culling: true,
            faintest: 0.0,
            sprite: Sprite::default(),
        }
    }
}

/// What became of the particles that [`draw`] was given. Those that are not finite, have no extent, or lie behind the eye
/// are in none of the numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Reach into the picture, or its surroundings where a coarse level has cells.
    pub drawn: u64,
    /// In front of the eye, but seen by no pixel.
    pub outside: u64,
    /// Dropped because of [`SplatOptions::faintest`].
    pub faint: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Counts) {
        self.drawn += other.drawn;
        self.outside += other.outside;
        self.faint += other.faint;
    }
}

/// Draws all batches into one picture of the view's size, on the threads of the current rayon pool. The result does not
/// depend on the number of threads.
///
/// `P S` is accumulated when any batch has an attribute; batches without one then count with attribute 0.
pub fn draw(view: &View, batches: &[Splats<'_>], options: &SplatOptions) -> Accumulation {
    draw_counted(view, batches, options).0
}

/// As [`draw`], and says what became of the particles.
pub fn draw_counted(view: &View, batches: &[Splats<'_>], options: &SplatOptions) -> (Accumulation, Counts) {
    let mut sums = Summation::new(view, options);
    sums.add(batches);
    sums.finish()
}
