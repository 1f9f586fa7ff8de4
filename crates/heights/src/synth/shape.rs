//! The shapes that there are.

use std::str::FromStr;

/// A shape of synthetic surfaces. Lengths are in samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SurfaceShape {
    /// A cap of a sphere upon a plane at 0, as large as fits.
    SphereCap,
    /// `A sin(k x) sin(k y)`, with the amplitude 20 and the wavelength 256.
    Sines,
    /// 0 left of the middle column, 1000 from there on.
    Step,
    /// `x / 10 + y / 5`.
    Plane,
    /// Fractional Brownian motion: increments over a distance `d` have a variance that goes with `d^(2 H)`.
    Fbm,
    /// The same with round holes of many sizes.
    Holes,
}

impl SurfaceShape {
    /// Every shape.
    pub const ALL: [SurfaceShape; 6] = [
        SurfaceShape::SphereCap,
        SurfaceShape::Sines,
        SurfaceShape::Step,
        SurfaceShape::Plane,
        SurfaceShape::Fbm,
        SurfaceShape::Holes,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            SurfaceShape::SphereCap => "sphere-cap",
            SurfaceShape::Sines => "sines",
            SurfaceShape::Step => "step",
            SurfaceShape::Plane => "plane",
            SurfaceShape::Fbm => "fbm",
            SurfaceShape::Holes => "holes",
        }
    }
}

impl std::fmt::Display for SurfaceShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SurfaceShape {
    type Err = String;

    fn from_str(text: &str) -> Result<SurfaceShape, String> {
        let found = SurfaceShape::ALL.into_iter().find(|shape| shape.name() == text);
        found.ok_or_else(|| format!("expected {}", SurfaceShape::ALL.map(SurfaceShape::name).join(", ")))
    }
}
