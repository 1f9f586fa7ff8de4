//! The kinds of hierarchies: what each is called, what it is built over, and what its inner nodes are for and hold. A kind is one constant
//! here and one line in [`Kind::ALL`]; builds, their help, `info`, `verify` and the window's cache ask this list.

use super::{Encoding, Purpose};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// What a hierarchy is built over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matter {
    /// Particles: several kinds share a file's leaves.
    Particles,
    /// Samples of an image or a volume: a file has one kind.
    Grids,
}

/// A kind of hierarchy.
#[derive(Debug)]
pub struct Kind {
    /// What users call it.
    pub name: &'static str,
    /// What it is, for lists.
    pub about: &'static str,
    /// What it is built over.
    pub matter: Matter,
    /// What its inner nodes over particles are for; those for the first are there wherever the kind is.
    pub purposes: &'static [Purpose],
    /// What its inner nodes over particles hold.
    pub encodings: &'static [Encoding],
}

/// Merged particles in an octree's cells (F12).
pub static OCTREE: Kind = Kind {
    name: "octree",
    about: "merged particles, an error on the screen",
    matter: Matter::Particles,
    purposes: &[Purpose::Splats, Purpose::Samples],
    encodings: &[Encoding::Relay, Encoding::Grid],
};

/// Clusters with a shape by splits along principal axes (HE03).
pub static PCA: Kind = Kind {
    name: "pca",
    about: "clusters with a shape, for pictures of few splats",
    matter: Matter::Particles,
    purposes: &[Purpose::Clusters],
    encodings: &[Encoding::Relay, Encoding::Clusters, Encoding::LeafClusters],
};

/// Oriented points over bricks of samples (WM03); its nodes are columns of a brick and not nodes of particles.
pub static WAVELET: Kind =
    Kind { name: "wavelet", about: "oriented points", matter: Matter::Grids, purposes: &[], encodings: &[] };

impl Kind {
    /// All kinds.
    pub const ALL: [&'static Kind; 3] = [&OCTREE, &PCA, &WAVELET];

    /// The kind whose inner nodes are for a purpose.
    pub fn of(purpose: Purpose) -> &'static Kind {
        // Every purpose is listed by one kind, which a test checks.
        Kind::ALL.into_iter().find(|kind| kind.purposes.contains(&purpose)).unwrap_or(&OCTREE)
    }

    /// The kind of that name.
    pub fn named(name: &str) -> Option<&'static Kind> {
        Kind::ALL.into_iter().find(|kind| kind.name == name)
    }

    /// All kinds over something with what they are, for help.
    pub fn list(matter: Matter) -> String {
        let kinds = Kind::ALL.into_iter().filter(|kind| kind.matter == matter);
        kinds.map(|kind| format!("{} ({})", kind.name, kind.about)).collect::<Vec<_>>().join(", ")
    }

    fn bit(&self) -> u8 {
        let place = Kind::ALL.iter().position(|kind| kind.name == self.name);
        place.map_or(0, |place| 1 << place)
    }
}

impl PartialEq for Kind {
    fn eq(&self, other: &Kind) -> bool {
        self.name == other.name
    }
}

impl Eq for Kind {}

/// A set of kinds that a file gets, over the same leaves.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Kinds(u8);

impl Kinds {
    /// These.
    pub fn of<'a>(kinds: impl IntoIterator<Item = &'a Kind>) -> Kinds {
        Kinds(kinds.into_iter().fold(0, |bits, kind| bits | kind.bit()))
    }

    /// All that are built over particles.
    pub fn of_particles() -> Kinds {
        Kinds::of(Kind::ALL.into_iter().filter(|kind| kind.matter == Matter::Particles))
    }

    /// What they are built over: all the same; `None` where there is none.
    pub fn matter(self) -> Option<Matter> {
        self.iter().next().map(|kind| kind.matter)
    }

    /// Whether a kind is among them.
    pub fn has(self, kind: &Kind) -> bool {
        self.0 & kind.bit() != 0
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Those that are, in the order of [`Kind::ALL`].
    pub fn iter(self) -> impl Iterator<Item = &'static Kind> {
        Kind::ALL.into_iter().filter(move |kind| self.has(kind))
    }
}

impl Default for Kinds {
    fn default() -> Kinds {
        Kinds::of([&OCTREE])
    }
}

impl fmt::Display for Kinds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.iter().map(|kind| kind.name).collect::<Vec<_>>().join(","))
    }
}

impl fmt::Debug for Kinds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl TryFrom<String> for Kinds {
    type Error = String;

    fn try_from(text: String) -> Result<Kinds, String> {
        text.parse()
    }
}

impl From<Kinds> for String {
    fn from(kinds: Kinds) -> String {
        kinds.to_string()
    }
}

impl FromStr for Kinds {
    type Err = String;

    fn from_str(text: &str) -> Result<Kinds, String> {
        let kinds = text.split(',').map(str::trim).map(|name| {
            let names = || Kind::ALL.map(|kind| kind.name).join(", ");
            Kind::named(name).ok_or_else(|| format!("{name:?}: expected {}", names()))
        });
        let kinds = Kinds::of(kinds.collect::<Result<Vec<_>, _>>()?);
        let mut matters = kinds.iter().map(|kind| kind.matter);
        match matters.next() {
            Some(first) if matters.any(|other| other != first) => {
                Err(format!("{text:?}: expected hierarchies of particles, or one of images and volumes"))
            }
            _ => Ok(kinds),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_purpose_is_of_one_kind_and_each_kind_has_a_name_of_its_own() {
        for purpose in Purpose::ALL {
            let kinds: Vec<_> = Kind::ALL.into_iter().filter(|kind| kind.purposes.contains(&purpose)).collect();
            assert_eq!(kinds, [Kind::of(purpose)]);
        }
        for kind in Kind::ALL {
            assert_eq!(Kind::named(kind.name), Some(kind));
            assert_eq!(kind.name.parse(), Ok(Kinds::of([kind])));
            let of_particles = kind.matter == Matter::Particles;
            assert_eq!([kind.purposes.is_empty(), kind.encodings.is_empty()], [!of_particles; 2]);
        }
        let all = Kinds::of_particles();
        assert_eq!(all.to_string().parse(), Ok(all));
        assert_eq!((all.iter().collect::<Vec<_>>(), all.matter()), (vec![&OCTREE, &PCA], Some(Matter::Particles)));
        assert_eq!(Kinds::of([&WAVELET]).matter(), Some(Matter::Grids));
    }

    #[test]
    fn what_is_no_kind_is_named_with_those_that_are() {
        assert_eq!("octree,kd".parse::<Kinds>(), Err("\"kd\": expected octree, pca, wavelet".into()));
        assert_eq!(" pca , octree".parse(), Ok(Kinds::of_particles()));
        let why = "octree,wavelet".parse::<Kinds>().unwrap_err();
        assert!(why.contains("expected hierarchies of particles, or one of images and volumes"), "{why}");
        assert!("".parse::<Kinds>().is_err());
    }
}
