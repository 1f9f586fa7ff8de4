//! Sampled grids: images and volumes, where their samples are in the world, and what the samples mean.

use super::{Bounds, SampleType, Unit};
use glam::{DAffine3, DVec3};
use serde::Serialize;
use std::ops::Range;

/// What stored samples mean: `slope * stored + intercept`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scale {
    /// The factor.
    pub slope: f64,
    /// What is added.
    pub intercept: f64,
}

impl Scale {
    /// Stored samples are the values.
    pub const NONE: Scale = Scale { slope: 1.0, intercept: 0.0 };

    /// The value of a stored sample.
    #[inline]
    pub fn value(self, stored: f64) -> f64 {
        if self == Scale::NONE { stored } else { self.slope.mul_add(stored, self.intercept) }
    }
}

/// One of the values that every sample has.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The source's own name, or `value`, `red`, `green`, `blue`, `alpha`.
    pub name: String,
    /// Unit of the values; empty when unknown.
    pub unit: Unit,
    /// From stored samples to values.
    pub scale: Scale,
    /// The stored sample that stands for none, where there is one.
    pub no_data: Option<f64>,
}

impl Channel {
    /// A channel of values as they are stored, without a unit.
    pub fn new(name: impl Into<String>) -> Channel {
        Channel { name: name.into(), unit: Unit::default(), scale: Scale::NONE, no_data: None }
    }

    /// So many channels with usual names: `value` alone, `value-1` and so on of several.
    pub fn numbered(count: u64) -> Vec<Channel> {
        if count == 1 {
            return vec![Channel::new("value")];
        }
        (1..=count).map(|number| Channel::new(format!("value-{number}"))).collect()
    }

    /// The channels of a picture with 1 to 4 of them: grey or colours, the last of 2 and 4 opacity.
    pub fn of_picture(count: u64) -> Vec<Channel> {
        let names: &[&str] = match count {
            1 => &["value"],
            2 => &["value", "alpha"],
            3 => &["red", "green", "blue"],
            4 => &["red", "green", "blue", "alpha"],
            _ => return Channel::numbered(count),
        };
        names.iter().map(|name| Channel::new(*name)).collect()
    }
}

/// A regular grid of samples: an image or a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// 2 for images, 3 for volumes.
    pub dimensions: usize,
    /// Samples along each axis, the fastest first; each at least 1, the third of images 1.
    pub shape: [u64; 3],
    /// From indices of samples to the world: the centre of sample (0, 0, 0) is its translation. Invertible; the third axis
    /// of images is across them.
    pub to_world: DAffine3,
    /// Unit of the world's lengths; empty when unknown.
    pub length_unit: Unit,
    /// How the samples of all channels are stored.
    pub sample_type: SampleType,
    /// What every sample holds; at least one.
    pub channels: Vec<Channel>,
}

impl Grid {
    /// A volume whose samples are 1 apart, the first at the origin.
    pub fn volume(shape: [u64; 3], sample_type: SampleType, channels: Vec<Channel>) -> Grid {
        let length_unit = Unit::default();
        Grid { dimensions: 3, shape, to_world: DAffine3::IDENTITY, length_unit, sample_type, channels }
    }

    /// An image of pixels of size 1 whose first row is at the top, the centre of its lower left pixel at the origin.
    pub fn image(shape: [u64; 2], sample_type: SampleType, channels: Vec<Channel>) -> Grid {
        let [width, height] = shape;
        let top = DVec3::new(0.0, height.saturating_sub(1) as f64, 0.0);
        let to_world = DAffine3 { translation: top, ..DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0)) };
        Grid { dimensions: 2, to_world, ..Grid::volume([width, height, 1], sample_type, channels) }
    }

    /// `image` or `volume`.
    pub fn kind(&self) -> &'static str {
        if self.dimensions == 2 { "image" } else { "volume" }
    }

    /// Whether its first channels are red, green and blue.
    pub fn has_colors(&self) -> bool {
        let names = ["red", "green", "blue"];
        self.channels.len() >= 3 && self.channels.iter().zip(names).all(|(channel, name)| channel.name == name)
    }

    /// Distance of the centres of neighbouring samples along each axis, in the length unit.
    pub fn spacing(&self) -> Vec<f64> {
        self.columns().map(DVec3::length).collect()
    }

    /// Directions of the axes in the world, unit vectors; two of an image, three of a volume.
    pub fn axes(&self) -> Vec<DVec3> {
        self.columns().map(|column| column / column.length()).collect()
    }

    fn columns(&self) -> impl Iterator<Item = DVec3> {
        (0..self.dimensions.min(3)).map(|axis| self.to_world.matrix3.col(axis))
    }

    /// The box around all samples, each of which is as large as the grid's spacing; an image has no thickness.
    pub fn bounds(&self) -> Bounds {
        let corners = (0..8).map(|corner| {
            let end = |axis: usize| match (axis < self.dimensions, corner >> axis & 1) {
                (false, _) => 0.0,
                (true, 0) => -0.5,
                (true, _) => self.shape[axis] as f64 - 0.5,
            };
            self.to_world.transform_point3(DVec3::new(end(0), end(1), end(2))).to_array()
        });
        Bounds::of(corners)
    }

    /// All of its samples.
    pub fn region(&self) -> Region {
        Region { min: [0; 3], max: self.shape }
    }

    /// Every `every`-th sample along each axis, the first one among them.
    #[must_use]
    pub fn thinned(&self, every: u64) -> Grid {
        let (every, mut grid) = (every.max(1), self.clone());
        for axis in 0..self.dimensions.min(3) {
            grid.shape[axis] = self.shape[axis].div_ceil(every);
            *grid.to_world.matrix3.col_mut(axis) *= every as f64;
        }
        grid
    }

    /// Size of one sample, all channels, bytes.
    pub fn sample_bytes(&self) -> u64 {
        self.sample_type.size() as u64 * self.channels.len() as u64
    }

    /// Size of all samples in memory, bytes; `None` where that exceeds what can be counted.
    pub fn bytes(&self) -> Option<u64> {
        self.shape.iter().try_fold(self.sample_bytes(), |bytes, &count| bytes.checked_mul(count))
    }

    /// Shape, channels and type in words, as messages have them: `256 x 256 x 133 of uint8`.
    pub fn described(&self) -> String {
        let sizes: Vec<String> = self.shape[..self.dimensions.min(3)].iter().map(u64::to_string).collect();
        let channels = match self.channels.len() {
            1 => String::new(),
            several => format!("{several} "),
        };
        format!("{} of {channels}{}", sizes.join(" x "), self.sample_type)
    }
}

/// A half-open box of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// The first sample along each axis.
    pub min: [u64; 3],
    /// The first one after it that is not in the box; above `min`.
    pub max: [u64; 3],
}

impl Region {
    /// Samples along each axis.
    pub fn shape(&self) -> [u64; 3] {
        std::array::from_fn(|axis| self.max[axis].saturating_sub(self.min[axis]))
    }

    /// The same box with other ends along one axis.
    pub fn with(mut self, axis: usize, range: Range<u64>) -> Region {
        (self.min[axis], self.max[axis]) = (range.start, range.end);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn a_grid_knows_where_its_samples_are() {
        let mut grid = Grid::volume([4, 5, 6], SampleType::I16, Channel::numbered(2));
        let turned = DMat3::from_rotation_z(0.5) * DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0));
        grid.to_world = DAffine3::from_mat3_translation(turned, DVec3::new(7.0, 8.0, 9.0));
        assert!(grid.spacing().iter().zip([1.0, 2.0, 3.0]).all(|(have, want)| (have - want).abs() < 1e-12));
        assert!((grid.axes()[0] - DVec3::new(0.5_f64.cos(), 0.5_f64.sin(), 0.0)).length() < 1e-12);
        assert_eq!((grid.kind(), grid.sample_bytes(), grid.bytes()), ("volume", 4, Some(480)));
        assert_eq!(grid.described(), "4 x 5 x 6 of 2 int16");
        let bounds = grid.bounds();
        assert!((bounds.min.z - 7.5).abs() < 1e-12 && (bounds.max.z - 25.5).abs() < 1e-12);
        grid.shape = [u64::MAX, 2, 2];
        assert_eq!(grid.bytes(), None);
    }

    #[test]
    fn the_first_row_of_an_image_is_at_the_top() {
        let image = Grid::image([3, 2], SampleType::U8, Channel::of_picture(3));
        assert_eq!(image.kind(), "image");
        assert_eq!((image.spacing(), image.axes()), (vec![1.0; 2], vec![DVec3::X, -DVec3::Y]));
        assert_eq!(image.bounds(), Bounds { min: DVec3::new(-0.5, -0.5, 0.0), max: DVec3::new(2.5, 1.5, 0.0) });
        assert_eq!(image.channels[2].name, "blue");
    }
}
