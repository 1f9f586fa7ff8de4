//! Catalogues of named objects: haloes, clusters, stars that have names. For labels, flights and probes of what they name.
//!
//! They are told apart by their content: tables (CSV with a header), RON, group catalogues of Gadget-4, AREPO and SUBFIND (HDF5), and the
//! lists of other halo finders: Rockstar, AHF, VELOCIraptor and HBT+.

mod finder;
pub(super) mod groups;
pub(super) mod halo_records;
mod halo_tables;
pub(super) mod halo_text;
mod properties;
mod sphere;
pub(super) mod table;
mod written;

pub use properties::Property;
pub use sphere::{files_of_catalogue, sphere_at};

use super::error::ExploreError;
use super::merger_tree::MergerTree;
use crate::annotate::Label;
use crate::import::Hdf5Tables;
use crate::model::Unit;
use glam::DVec3;
use properties::Kept;
use serde::Serialize;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most objects that a catalogue may have; labels of more would help nobody.
pub const MOST_OBJECTS: u64 = 10_000_000;

/// A named object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Object {
    /// Its name: the catalogue's own, or `Group 0`, `Subhalo 12`.
    pub name: String,
    /// Where it is, in the catalogue's length unit.
    pub position: DVec3,
    /// How large it is, where the catalogue says so; positive.
    pub radius: Option<f64>,
    /// Its mass, where the catalogue says so.
    pub mass: Option<f64>,
}

/// Named objects, the most important first: by mass, then by size, then in the file's order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Catalogue {
    /// The file.
    pub path: PathBuf,
    /// What kind of file: `csv`, `ron`, `groups`, `trees`, `consistent-trees`, or the halo finder: `rockstar`, `ahf`, `velociraptor`, `hbt`.
    pub format: &'static str,
    /// Unit of positions and radii; empty when unknown.
    pub length_unit: Unit,
    /// Unit of masses; empty when unknown.
    pub mass_unit: Unit,
    /// Edge of the periodic box, where the file says so.
    pub box_size: Option<f64>,
    /// Entries without a finite position, which are left out.
    pub left_out: u64,
    /// The objects.
    pub objects: Vec<Object>,
    /// What else the file says of them, where that was asked for ([`Catalogue::read_whole`]).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub properties: Vec<Property>,
    /// Whether positions are places in a plane alone, on which they have z 0 ([`Catalogue::in_plane`]).
    #[serde(skip)]
    pub is_in_plane: bool,
    /// Where the file has objects of several steps: all of them.
    #[serde(skip)]
    pub tree: Option<Arc<MergerTree>>,
}

/// The beginning of a file.
fn head_of(path: &Path) -> Result<Vec<u8>, ExploreError> {
    let mut head = Vec::new();
    let file = std::fs::File::open(path).map_err(|source| ExploreError::io(path, "opening", source))?;
    file.take(4096).read_to_end(&mut head).map_err(|source| ExploreError::io(path, "reading", source))?;
    Ok(head)
}

impl Catalogue {
    /// Reads a catalogue of any kind; of a file with objects of several steps those of the last.
    ///
    /// # Errors
    /// [`ExploreError`] with file and field when it cannot be read, is damaged, or has no object.
    pub fn read(path: &Path) -> Result<Catalogue, ExploreError> {
        Catalogue::read_keeping(path, &mut Kept::nothing())
    }

    /// The same with other numbers that the file has of its objects: those of these names, or all, which may take `memory` bytes. Trees and RON
    /// have none.
    ///
    /// # Errors
    /// As [`Catalogue::read`], where they take more, and where the file has nothing of one of the names.
    pub fn read_whole(path: &Path, fields: Option<&[String]>, memory: u64) -> Result<Catalogue, ExploreError> {
        let mut kept = Kept::new(fields, memory);
        let catalogue = Catalogue::read_keeping(path, &mut kept)?;
        kept.check(&catalogue.path)?;
        Ok(catalogue)
    }

    fn read_keeping(path: &Path, kept: &mut Kept) -> Result<Catalogue, ExploreError> {
        let path = &crate::import::file_in(path, &[])?;
        let head = head_of(path)?;
        let text = std::str::from_utf8(&head).unwrap_or_default().trim_start_matches('\u{feff}').trim_start();
        let is_ron =
            text.starts_with(['(', '[']) || text.starts_with("//") || text.starts_with("/*") || text.starts_with("#!");
        let is_hdf5 = Hdf5Tables::are_in(path)?;
        let catalogue = match () {
            () if is_ron => written::read(path)?,
            () => {
                let of_finder = match is_hdf5 {
                    true => match halo_tables::read(path, kept)? {
                        None => halo_records::read(path, kept)?,
                        found => found,
                    },
                    false => halo_text::read(path, kept)?,
                };
                match of_finder {
                    Some(catalogue) => catalogue,
                    // Catalogues of one step are read as that, though others may lie beside them.
                    None => match MergerTree::of_file(path)? {
                        Some(tree) => return Catalogue::of_tree(Arc::new(tree), None),
                        None if is_hdf5 => groups::read(path, kept)?,
                        None => table::read(path, kept)?,
                    },
                }
            }
        };
        catalogue.checked()
    }

    /// Reads a table that says where things are in a plane alone (`x` and `y`): what stands on a surface, whose coordinates these are. Positions
    /// have z 0. `None` of every other file, which is not read to its end.
    ///
    /// # Errors
    /// As [`Catalogue::read`].
    pub fn in_plane(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
        let path = &crate::import::file_in(path, &[])?;
        table::read_in_plane(path)?.map(Catalogue::checked).transpose()
    }

    /// The objects of a merger tree at a time, `None`: at its last step.
    ///
    /// # Errors
    /// [`ExploreError`] where none has a position.
    pub fn of_tree(tree: Arc<MergerTree>, time: Option<f64>) -> Result<Catalogue, ExploreError> {
        let catalogue = Catalogue {
            path: tree.path.clone(),
            format: tree.format,
            length_unit: tree.length_unit.clone(),
            mass_unit: tree.mass_unit.clone(),
            box_size: tree.box_size,
            left_out: 0,
            objects: tree.objects_at(time),
            properties: Vec::new(),
            is_in_plane: false,
            tree: Some(tree),
        };
        catalogue.checked()
    }

    /// Reads a catalogue with the objects of a time, where the file has several steps; with `series` of catalogues with links between them,
    /// too, of which it is one. Without a time of the file's own step.
    ///
    /// # Errors
    /// As [`Catalogue::read`].
    pub fn read_at(path: &Path, time: Option<f64>, series: bool) -> Result<Catalogue, ExploreError> {
        let path = &crate::import::file_in(path, &[])?;
        if let Some(tree) = if series { MergerTree::of_series(path)? } else { None } {
            return Catalogue::of_tree(Arc::new(tree), time);
        }
        let catalogue = Catalogue::read(path)?;
        Ok(catalogue.at(time).unwrap_or(catalogue))
    }

    /// The same with the objects of another time, `None`: of the last step; of a catalogue of one step there is none.
    pub fn at(&self, time: Option<f64>) -> Option<Catalogue> {
        Catalogue::of_tree(self.tree.clone()?, time).ok()
    }

    /// Leaves out what has no place, and sorts by importance.
    fn checked(mut self) -> Result<Catalogue, ExploreError> {
        let before = self.objects.len();
        // With the rows in which they are.
        let mut objects: Vec<(usize, Object)> = self.objects.into_iter().enumerate().collect();
        objects.retain(|(_, object)| object.position.is_finite());
        self.left_out += (before - objects.len()) as u64;
        if objects.is_empty() {
            return Err(ExploreError::malformed(&self.path, "objects", "none with a position", "at least one"));
        }
        for (_, object) in &mut objects {
            object.radius = object.radius.filter(|radius| *radius > 0.0 && radius.is_finite());
            object.mass = object.mass.filter(|mass| mass.is_finite());
        }
        let importance = |object: &Object| (object.mass.unwrap_or(0.0), object.radius.unwrap_or(0.0));
        objects.sort_by(|(_, a), (_, b)| {
            let ((mass_a, radius_a), (mass_b, radius_b)) = (importance(a), importance(b));
            mass_b.total_cmp(&mass_a).then(radius_b.total_cmp(&radius_a))
        });
        for Property { values, .. } in &mut self.properties {
            *values = objects.iter().map(|(row, _)| values[*row]).collect();
        }
        let objects = objects.into_iter().map(|(_, object)| object).collect();
        Ok(Catalogue { objects, ..self })
    }

    /// The objects as names to be written into a picture, in their order.
    pub fn labels(&self) -> Vec<Label> {
        let label =
            |object: &Object| Label { name: object.name.clone(), position: object.position, radius: object.radius };
        self.objects.iter().map(label).collect()
    }

    /// What to say where the catalogue states another unit of lengths than the data's.
    pub fn unlike(&self, unit: &Unit) -> Option<String> {
        let differs = !self.length_unit.is_unknown() && !unit.is_unknown() && self.length_unit != *unit;
        differs.then(|| {
            let (path, own) = (self.path.display(), &self.length_unit);
            format!("{path}: positions are in {own}, those of the data in {unit}; they are taken as they are")
        })
    }

    /// The object of that name, capital letters or not.
    ///
    /// # Errors
    /// [`ExploreError::Missing`] with names that begin alike, or the first ones.
    pub fn named(&self, name: &str) -> Result<&Object, ExploreError> {
        let wanted = name.trim().to_lowercase();
        let found = self.objects.iter().find(|object| object.name.to_lowercase() == wanted);
        found.ok_or_else(|| {
            let alike = |object: &&Object| object.name.to_lowercase().contains(&wanted);
            let mut names: Vec<&str> =
                self.objects.iter().filter(alike).take(3).map(|object| object.name.as_str()).collect();
            if names.is_empty() {
                names = self.objects.iter().take(3).map(|object| object.name.as_str()).collect();
            }
            let expected = format!("one of {} objects such as {}", self.objects.len(), names.join(", "));
            ExploreError::missing(&self.path, format!("object {name:?}"), expected)
        })
    }

    /// The object at place `index` by importance, from 0.
    ///
    /// # Errors
    /// [`ExploreError::Missing`] where there are not so many.
    pub fn ranked(&self, index: usize) -> Result<&Object, ExploreError> {
        self.objects.get(index).ok_or_else(|| {
            let expected = format!("0 to {}, by importance", self.objects.len() - 1);
            ExploreError::missing(&self.path, format!("object #{index}"), expected)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn tables_are_read_in_any_order_of_columns() {
        let text = "mass [Msun],z [kpc],name,y [kpc],x [kpc],radius [kpc]\n5,3,Small,2,1,0.5\n7,6,\"Big, far\",5,4,\n,1,Lost,,1,1\n";
        let (_folder, path) = written("a.csv", text);
        let catalogue = Catalogue::read(&path).unwrap();
        assert_eq!((catalogue.length_unit.0.as_str(), catalogue.mass_unit.0.as_str()), ("kpc", "Msun"));
        assert_eq!((catalogue.format, catalogue.left_out), ("csv", 1));
        let big =
            Object { name: "Big, far".into(), position: DVec3::new(4.0, 5.0, 6.0), radius: None, mass: Some(7.0) };
        let small =
            Object { name: "Small".into(), position: DVec3::new(1.0, 2.0, 3.0), radius: Some(0.5), mass: Some(5.0) };
        assert_eq!(catalogue.objects, [big, small]);
        assert_eq!(catalogue.named("small").unwrap().mass, Some(5.0));
        let message = catalogue.named("smal").unwrap_err().to_string();
        assert!(message.contains("a.csv") && message.contains("Small"), "{message}");
        assert!(catalogue.ranked(1).is_ok() && catalogue.ranked(2).is_err());
    }

    #[test]
    fn tables_of_places_in_a_plane_are_told_by_their_header() {
        let text = "y,Name,x [m],mass\n2,Small,1,5\n4,\"Big, far\",3.5,7\n,Lost,1,\n-1e2,,6,\n";
        let (_folder, path) = written("a.csv", text);
        let catalogue = Catalogue::in_plane(&path).unwrap().unwrap();
        assert_eq!((catalogue.length_unit.0.as_str(), catalogue.left_out), ("m", 1));
        let found: Vec<_> = catalogue.objects.iter().map(|object| (object.name.as_str(), object.position)).collect();
        let place = |x, y| DVec3::new(x, y, 0.0);
        let expected = [("Big, far", place(3.5, 4.0)), ("Small", place(1.0, 2.0)), ("Object 3", place(6.0, -100.0))];
        assert_eq!(found, expected);
        // Tables with places in space, on the sky, without any, and what is no table.
        for text in ["name,x,y,z\nA,1,2,3\n", "name,x,y,ra,dec\nA,1,2,3,4\n", "name,x\nA,1\n", "([])", ""] {
            let (_folder, path) = written("a.csv", text);
            assert!(Catalogue::in_plane(&path).unwrap().is_none(), "{text}");
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data");
        assert!(Catalogue::in_plane(&folder.join("groups.0.hdf5")).unwrap().is_none());
        for (text, parts) in [
            ("name,x,y\nA,1,far\n", &["a.csv", "y in line 2", "far"][..]),
            ("x,y\n1,2\n", &["a.csv", "names"]),
            ("name,x,y\nA,,\n", &["a.csv", "objects"]),
        ] {
            let (_folder, path) = written("a.csv", text);
            let message = Catalogue::in_plane(&path).unwrap_err().to_string();
            assert!(parts.iter().all(|part| message.contains(part)), "{text:?} gave {message}");
        }
    }

    #[test]
    fn directions_on_the_sky_become_places() {
        let (_folder, path) = written("stars.csv", "name,ra,dec,dist\nPole,0,90,10\nOrigin of RA,90,0,2\n");
        let catalogue = Catalogue::read(&path).unwrap();
        assert!((catalogue.named("pole").unwrap().position - DVec3::new(0.0, 0.0, 10.0)).length() < 1e-12);
        assert!((catalogue.named("origin of ra").unwrap().position - DVec3::new(0.0, 2.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn ron_is_read() {
        let text = "(length_unit: \"kpc\", objects: [\n (name: \"A\", position: (1, 2, 3), radius: 2.0),\n (name: \"B\", position: (0, 0, 0), mass: 1e3)])";
        let (_folder, path) = written("a.ron", text);
        let catalogue = Catalogue::read(&path).unwrap();
        assert_eq!(catalogue.objects[0].name, "B");
        assert_eq!((catalogue.objects[1].radius, catalogue.length_unit.0.as_str()), (Some(2.0), "kpc"));
    }

    #[test]
    fn groups_in_several_files_are_one_catalogue() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data");
        for number in 0..3 {
            // Any file of them names all, the last one too, which holds nothing itself.
            let catalogue = Catalogue::read(&folder.join(format!("groups.{number}.hdf5"))).unwrap();
            let names: Vec<&str> = catalogue.objects.iter().map(|object| object.name.as_str()).collect();
            let expected = ["Group 4", "Group 3", "Group 2", "Subhalo 0", "Subhalo 1", "Group 1", "Group 0"];
            assert_eq!(names, expected);
            assert_eq!((catalogue.box_size, catalogue.format), (Some(10.0), "groups"));
            // A radius of 0 is none.
            assert_eq!(catalogue.named("group 0").unwrap().radius, Some(0.25));
            assert_eq!(catalogue.named("group 4").unwrap().radius, None);
            assert_eq!(catalogue.named("subhalo 1").unwrap().radius, Some(0.125));
        }
    }

    #[test]
    fn files_that_are_wrong_say_where() {
        for (name, text, parts) in [
            ("a.csv", "name,x,y\nA,1,2\n", &["a.csv", "positions"][..]),
            ("a.csv", "name,x,y,z\nA,1,2,far\n", &["a.csv", "line 2", "far"]),
            ("a.csv", "x,y,z\n1,2,3\n", &["a.csv", "name"]),
            ("a.csv", "name,x,y,z\n", &["a.csv"]),
            ("a.csv", "name,x,y,z\nA,,1,2\n", &["a.csv", "objects"]),
            ("a.csv", "", &["a.csv"]),
            ("a.csv", "\u{1}\u{2}", &["a.csv"]),
            ("a.ron", "(objects: [(name: \"A\", positions: (1, 2, 3))])", &["a.ron:1:", "positions"]),
            ("a.ron", "(objects: [])", &["a.ron", "objects"]),
            ("a.hdf5", "\u{1}", &["a.hdf5"]),
        ] {
            let (_folder, path) = written(name, text);
            let message = Catalogue::read(&path).unwrap_err().to_string();
            assert!(parts.iter().all(|part| message.contains(part)), "{text:?} gave {message}");
        }
        let (_folder, path) = written("a.hdf5", "");
        std::fs::write(&path, b"\x89HDF\r\n\x1a\n and then nothing").unwrap();
        assert!(Catalogue::read(&path).unwrap_err().to_string().contains("a.hdf5"));
        assert!(Catalogue::read(Path::new("/nowhere/at.csv")).unwrap_err().to_string().contains("/nowhere/at.csv"));
    }
}
