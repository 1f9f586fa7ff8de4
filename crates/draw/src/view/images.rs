//! Periodic boxes: drawn once, several times side by side, or wrapped so that what one looks at is in the middle.

use crate::model::{Bounds, PeriodicBox};
use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

/// Most images of a box along each axis.
pub const MOST_IMAGES: u32 = 7;

/// How a periodic box is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "PeriodicText", into = "PeriodicText")]
pub enum Periodic {
    /// As it is.
    #[default]
    Once,
    /// Every particle at its image nearest to the point looked at, along each axis.
    Wrapped,
    /// So many times along each axis.
    Tiled([u32; 3]),
}

/// As it is written.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", rename = "Periodic")]
enum PeriodicText {
    Once,
    Wrapped,
    Tiled(u32, u32, u32),
}

impl TryFrom<PeriodicText> for Periodic {
    type Error = String;

    fn try_from(text: PeriodicText) -> Result<Periodic, String> {
        match text {
            PeriodicText::Once => Ok(Periodic::Once),
            PeriodicText::Wrapped => Ok(Periodic::Wrapped),
            PeriodicText::Tiled(x, y, z) => Periodic::tiled([x, y, z]),
        }
    }
}

impl From<Periodic> for PeriodicText {
    fn from(periodic: Periodic) -> PeriodicText {
        match periodic {
            Periodic::Once => PeriodicText::Once,
            Periodic::Wrapped => PeriodicText::Wrapped,
            Periodic::Tiled([x, y, z]) => PeriodicText::Tiled(x, y, z),
        }
    }
}

impl std::str::FromStr for Periodic {
    type Err = String;

    /// `once`, `wrapped`, or `3x3x1`.
    fn from_str(text: &str) -> Result<Periodic, String> {
        let wrong = || "expected once, wrapped, or numbers of images such as 3x3x1".to_owned();
        match text {
            "once" => Ok(Periodic::Once),
            "wrapped" => Ok(Periodic::Wrapped),
            text => {
                let counts: Vec<u32> =
                    text.split('x').map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
                Periodic::tiled(counts.try_into().map_err(|_| wrong())?)
            }
        }
    }
}

impl Periodic {
    /// That many images along each axis.
    ///
    /// # Errors
    /// What is expected, for none or more than [`MOST_IMAGES`].
    pub fn tiled(counts: [u32; 3]) -> Result<Periodic, String> {
        match counts.iter().all(|count| (1..=MOST_IMAGES).contains(count)) {
            true => Ok(Periodic::Tiled(counts)),
            false => Err(format!("{counts:?} images, expected 1 to {MOST_IMAGES} along each axis")),
        }
    }

    /// The images of a box, seen by one who looks at `target`, and the box outside of which nothing of them is drawn. What is not
    /// periodic is drawn once.
    pub fn images(self, periodic: Option<PeriodicBox>, target: DVec3) -> (Images, Bounds) {
        let Some(PeriodicBox { edge, bounds }) = periodic else { return (Images::ONE, Bounds::EVERYTHING) };
        match self {
            Periodic::Once => (Images::ONE, Bounds::EVERYTHING),
            Periodic::Tiled(counts) => {
                let first = counts.map(|count| -((count as i32 - 1) / 2));
                (Images { edge, first: IVec3::from(first), counts }, Bounds::EVERYTHING)
            }
            Periodic::Wrapped => {
                let window = Bounds { min: target - 0.5 * edge, max: target + 0.5 * edge };
                // Images n with bounds + n edge reaching into the window.
                let first = ((window.min - bounds.max) / edge).ceil();
                let last = ((window.max - bounds.min) / edge).floor();
                // So far away that numbers have no digits left for images.
                if !(first.is_finite() && last.is_finite() && first.abs().max_element() < 1e9) {
                    return (Images::ONE, Bounds::EVERYTHING);
                }
                let counts = (last - first + 1.0).clamp(DVec3::ONE, DVec3::splat(3.0)).as_uvec3();
                (Images { edge, first: first.as_ivec3(), counts: counts.to_array() }, window)
            }
        }
    }
}

/// Images of a periodic box: copies displaced by whole multiples of its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Images {
    /// Edge of the box, world units.
    edge: f64,
    /// Number of the first image along each axis; 0 is the box itself.
    first: IVec3,
    /// How many there are along each axis.
    counts: [u32; 3],
}

impl Images {
    /// The box itself.
    pub const ONE: Images = Images { edge: 0.0, first: IVec3::ZERO, counts: [1; 3] };

    /// By how much each image is displaced, world units.
    pub fn offsets(&self) -> impl Iterator<Item = DVec3> + use<> {
        let Images { edge, first, counts: [x, y, z] } = *self;
        let steps =
            (0..x as i32).flat_map(move |i| (0..y as i32).flat_map(move |j| (0..z as i32).map(move |k| [i, j, k])));
        steps.map(move |step| edge * (first + IVec3::from(step)).as_dvec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tiles_lie_around_the_box() {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(50.0) };
        let (images, window) = Periodic::Tiled([3, 2, 1]).images(PeriodicBox::of(Some(50.0), bounds), DVec3::ZERO);
        let offsets: Vec<DVec3> = images.offsets().collect();
        assert_eq!((offsets.len(), window), (6, Bounds::EVERYTHING));
        assert!(offsets.contains(&DVec3::ZERO) && offsets.contains(&DVec3::new(-50.0, 50.0, 0.0)));
        let (images, _) = Periodic::Tiled([3, 3, 3]).images(PeriodicBox::of(Some(30.0), bounds), DVec3::ZERO);
        assert_eq!(images.offsets().collect::<Vec<_>>(), [DVec3::ZERO], "what is not periodic has no images");
        for (text, expected) in [("once", Ok(Periodic::Once)), ("3x1x2", Ok(Periodic::Tiled([3, 1, 2])))] {
            assert_eq!(text.parse::<Periodic>(), expected);
        }
        for wrong in ["0x1x1", "8x1x1", "3x3", "wrap", ""] {
            assert!(wrong.parse::<Periodic>().is_err(), "{wrong}");
        }
        assert_eq!(ron::from_str::<Periodic>("tiled(2,2,2)").unwrap(), Periodic::Tiled([2; 3]));
        assert!(ron::from_str::<Periodic>("tiled(2,2,9)").unwrap_err().to_string().contains("1 to 7"));
    }

    proptest! {
        /// Wrapped, each particle is drawn once, at its image nearest to the target.
        #[test]
        fn wrapped_particles_are_drawn_once(
            particle in prop::array::uniform3(0.0..1.0f64),
            target in prop::array::uniform3(-3.0..4.0f64),
            edge in 0.5..200.0f64,
        ) {
            let (particle, target) = (DVec3::from(particle) * edge, DVec3::from(target) * edge);
            let bounds = Bounds { min: DVec3::ZERO, max: DVec3::splat(edge) };
            let (images, window) = Periodic::Wrapped.images(PeriodicBox::of(Some(edge), bounds), target);
            let drawn: Vec<DVec3> = images
                .offsets()
                .map(|offset| particle + offset)
                .filter(|at| at.cmpge(window.min).all() && at.cmple(window.max).all())
                .collect();
            prop_assert_eq!(drawn.len(), 1, "{:?}", images);
            prop_assert!((drawn[0] - target).abs().max_element() <= 0.5 * edge * (1.0 + 1e-12));
        }
    }
}
