//! The hierarchies that are compared, and which data each of them takes.

use crate::bench::splat::Failure;
use crate::command_line::usage;
use crate::look::{DataKind, is_field};
use clap::ValueEnum;
use serde::Serialize;
use std::fmt::{Display, Formatter};
use std::path::Path;

/// A way from a hierarchy to a picture.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// An even sample of the particles.
    Sample,
    /// Merged particles within 0.8 pixels.
    OctreeTau,
    /// Merged particles, best first.
    Octree,
    /// Round splats of equal spread in octree cells.
    OctreeVolume,
    /// Clusters with their second moments.
    Pca,
    /// The same, drawn round.
    PcaRound,
    /// The same of a tree that no octree cuts, uncoded.
    PcaFree,
    /// HE03: splits by distortion, sizes by equation 2.
    PcaPublished,
    /// Clusters, each a Gaussian.
    PcaGaussian,
    /// Clusters, each a disc.
    PcaDisc,
    /// Clusters, each a pixel.
    PcaPixel,
    /// Of images and volumes: oriented points.
    Wavelet,
    /// The same without directions.
    WaveletRound,
    /// Of images and volumes: box means of an evenly coarser grid.
    Mip,
}

impl Way {
    /// Whether it takes such data.
    pub fn takes(self, data: Data) -> bool {
        match self {
            Way::Sample
            | Way::OctreeTau
            | Way::Octree
            | Way::OctreeVolume
            | Way::Pca
            | Way::PcaRound
            | Way::PcaFree
            | Way::PcaPublished
            | Way::PcaGaussian
            | Way::PcaDisc
            | Way::PcaPixel => data == Data::Particles,
            // A built file has one kind of points already.
            Way::WaveletRound => data == Data::Samples,
            Way::Wavelet | Way::Mip => data != Data::Particles,
        }
    }

    /// Whether it is compared unless something else is asked for: it differs from the others in more than the footprint.
    fn is_usual(self) -> bool {
        !matches!(self, Way::PcaGaussian | Way::PcaDisc | Way::PcaPixel)
    }
}

impl Display for Way {
    fn fmt(&self, out: &mut Formatter<'_>) -> std::fmt::Result {
        // No way is hidden from the command line.
        let value = self.to_possible_value();
        out.pad(value.as_ref().map_or("", |value| value.get_name()))
    }
}

/// What is simplified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Data {
    /// Particles, built or not.
    Particles,
    /// An image or a volume.
    Samples,
    /// An image or a volume in a built file.
    BuiltSamples,
}

impl Data {
    /// What a file holds.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of(path: &Path) -> Result<Data, Failure> {
        let kind = DataKind::of(path)?;
        Ok(match is_field(path) {
            true if kind == DataKind::Grid => Data::BuiltSamples,
            true => Data::Samples,
            false => Data::Particles,
        })
    }

    /// The ways that are asked for, the usual ones where none is.
    ///
    /// # Errors
    /// Wrong usage, where one of them does not take such data; `named` is the data's name.
    pub fn chosen(self, asked: &[Way], named: &str) -> Result<Vec<Way>, Failure> {
        match asked.iter().find(|way| !way.takes(self)) {
            Some(other) => Err(self.refusal(*other, named)),
            None if asked.is_empty() => Ok(self.ways().filter(|way| way.is_usual()).collect()),
            None => Ok(asked.to_vec()),
        }
    }

    /// That a way does not take such data, and which do.
    pub fn refusal(self, way: Way, named: &str) -> Failure {
        let possible: Vec<String> = self.ways().map(|way| way.to_string()).collect();
        let what = match self {
            Data::Particles => "particles",
            Data::Samples => "an image or a volume",
            Data::BuiltSamples => "a built image or volume",
        };
        usage(format!("{named}: --hierarchies: found {way}, expected, of {what}, {}", possible.join(", ")))
    }

    fn ways(self) -> impl Iterator<Item = Way> {
        Way::value_variants().iter().copied().filter(move |way| way.takes(self))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;

    #[test]
    fn data_is_compared_by_what_takes_it() {
        let usual = |data: Data| data.chosen(&[], "a").unwrap();
        assert_eq!(usual(Data::Particles).len(), 8);
        assert_eq!(usual(Data::Samples), [Way::Wavelet, Way::WaveletRound, Way::Mip]);
        assert_eq!(usual(Data::BuiltSamples), [Way::Wavelet, Way::Mip]);
        let asked = [Way::PcaDisc, Way::Sample];
        assert_eq!(Data::Particles.chosen(&asked, "a").unwrap(), asked);
        for (data, asked, found, expected) in [
            (Data::Particles, [Way::Sample, Way::Mip], "mip", "octree-tau"),
            (Data::Samples, [Way::Pca, Way::Wavelet], "pca", "wavelet, wavelet-round, mip"),
            (Data::BuiltSamples, [Way::Wavelet, Way::WaveletRound], "wavelet-round", "wavelet, mip"),
        ] {
            let told = data.chosen(&asked, "a.nrrd").unwrap_err().to_string();
            assert!(told.contains(&format!("a.nrrd: --hierarchies: found {found}, expected")), "{told}");
            assert!(told.contains(expected) && told.trim_end().lines().count() == 1, "{told}");
        }
    }

    #[test]
    fn names_are_the_same_in_tables_and_files() {
        for way in Way::value_variants() {
            assert_eq!(serde_json::to_string(way).unwrap(), format!("\"{way}\""));
        }
        assert_eq!(format!("{:<14}|", Way::OctreeTau), "octree-tau    |");
    }
}
