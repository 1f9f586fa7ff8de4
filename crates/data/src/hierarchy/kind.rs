//! The kinds of hierarchies: what each is called, and what its inner nodes are for and hold. A kind is one constant here and one line in
//! [`Kind::ALL`]; builds, their help, `info`, `verify` and the window's cache ask this list.

use super::{Encoding, Purpose};
use std::fmt;
use std::str::FromStr;

/// A kind of hierarchy.
#[derive(Debug)]
pub struct Kind {
    /// What users call it.
    pub name: &'static str,
    /// What it is, for lists.
    pub about: &'static str,
    /// What its inner nodes are for; those for the first are there wherever the kind is.
    pub purposes: &'static [Purpose],
    /// What its inner nodes hold.
    pub encodings: &'static [Encoding],
}

/// Merged particles in an octree's cells (F12).
pub static OCTREE: Kind = Kind {
    name: "octree",
    about: "merged particles, an error on the screen",
    purposes: &[Purpose::Splats, Purpose::Samples],
    encodings: &[Encoding::Relay, Encoding::Grid],
};

/// Clusters with a shape by splits along principal axes (HE03).
pub static PCA: Kind = Kind {
    name: "pca",
    about: "clusters with a shape, for pictures of few splats",
    purposes: &[Purpose::Clusters],
    encodings: &[Encoding::Relay, Encoding::Clusters, Encoding::LeafClusters],
};

impl Kind {
    /// All kinds.
    pub const ALL: [&'static Kind; 2] = [&OCTREE, &PCA];

    /// The kind whose inner nodes are for a purpose.
    pub fn of(purpose: Purpose) -> &'static Kind {
        // Every purpose is listed by one kind, which a test checks.
        Kind::ALL.into_iter().find(|kind| kind.purposes.contains(&purpose)).unwrap_or(&OCTREE)
    }

    /// The kind of that name.
    pub fn named(name: &str) -> Option<&'static Kind> {
        Kind::ALL.into_iter().find(|kind| kind.name == name)
    }

    /// All kinds with what they are, for help.
    pub fn list() -> String {
        Kind::ALL.map(|kind| format!("{} ({})", kind.name, kind.about)).join(", ")
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
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Kinds(u8);

impl Kinds {
    /// These.
    pub fn of<'a>(kinds: impl IntoIterator<Item = &'a Kind>) -> Kinds {
        Kinds(kinds.into_iter().fold(0, |bits, kind| bits | kind.bit()))
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

impl FromStr for Kinds {
    type Err = String;

    fn from_str(text: &str) -> Result<Kinds, String> {
        let kinds = text.split(',').map(str::trim).map(|name| {
            let names = || Kind::ALL.map(|kind| kind.name).join(", ");
            Kind::named(name).ok_or_else(|| format!("{name:?}: expected {}", names()))
        });
        Ok(Kinds::of(kinds.collect::<Result<Vec<_>, _>>()?))
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
            assert!(!kind.purposes.is_empty() && !kind.encodings.is_empty());
        }
        let all = Kinds::of(Kind::ALL);
        assert_eq!(all.to_string().parse(), Ok(all));
        assert_eq!(all.iter().collect::<Vec<_>>(), Kind::ALL);
    }

    #[test]
    fn what_is_no_kind_is_named_with_those_that_are() {
        assert_eq!("octree,kd".parse::<Kinds>(), Err("\"kd\": expected octree, pca".into()));
        assert_eq!(" pca , octree".parse(), Ok(Kinds::of(Kind::ALL)));
        assert!("".parse::<Kinds>().is_err());
    }
}
