//! Snapshots in Gadget's HDF5 layout: a group `PartTypeN` for each family, with a data set for each quantity, and a group `Header`, as
//! Gadget-2 to -4, AREPO and GIZMO write them. Numbers are doubles, ids unsigned. What a family does not have is left out.

mod header;
mod units;

use super::columnwise::{Array, Spool};
use super::hdf5::{self, Attributes, Dataset, Group, Number};
use super::stated::Stated;
use super::{Block, Layout, Out, Table};
use crate::model::Unit;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

/// Types of particles.
const TYPES: usize = 6;

/// Gadget's names of quantities.
const NAMES: [(&str, &str); 13] = [
    ("position", "Coordinates"),
    ("velocity", "Velocities"),
    ("mass", "Masses"),
    ("smoothing-length", "SmoothingLength"),
    ("density", "Density"),
    ("internal-energy", "InternalEnergy"),
    ("temperature", "Temperature"),
    ("pressure", "Pressure"),
    ("velocity-dispersion", "VelocityDispersion"),
    ("metallicity", "Metallicity"),
    ("potential", "Potential"),
    ("acceleration", "Acceleration"),
    ("star-formation-rate", "StarFormationRate"),
];
const IDS: &str = "ParticleIDs";
/// Numbers of GIZMO's that readers make ids with; ids that are written have them in them already.
const CHILDREN: &str = "ParticleChildIDsNumber";

pub(super) struct Gadget<'a> {
    out: Out<'a>,
    quantities: Vec<Quantity>,
    stated: Stated,
    /// By type, quantity, and behind these ids.
    spool: Spool,
    counts: [u64; TYPES],
}

/// A quantity that some family has.
struct Quantity {
    array: Array,
    unit: Unit,
    /// Its data set.
    dataset: String,
}

impl<'a> Gadget<'a> {
    pub(super) fn new(mut out: Out<'a>, layout: &Layout, stated: Stated, path: &Path) -> io::Result<Gadget<'a>> {
        let mut quantities: Vec<Quantity> = Vec::new();
        for array in Array::all(&layout.columns) {
            let taken =
                |name: &str| [IDS, CHILDREN].contains(&name) || quantities.iter().any(|other| other.dataset == name);
            let dataset = dataset_name(&array.name, taken);
            let unit = layout.columns[array.columns.start].unit.clone();
            quantities.push(Quantity { array, unit, dataset });
        }
        let spool = Spool::new(path, TYPES * (quantities.len() + 1))?;
        out.write_all(&[0; hdf5::SUPERBLOCK])?;
        Ok(Gadget { out, quantities, stated, spool, counts: [0; TYPES] })
    }

    /// The number of an array in the spool.
    fn spooled(&self, number: usize, quantity: usize) -> usize {
        number * (self.quantities.len() + 1) + quantity
    }

    /// Writes the numbers of a type's data sets, the first of them at byte `at`, and gives its group.
    fn group(&mut self, number: usize, at: &mut u64) -> io::Result<Group> {
        let mut datasets = Vec::new();
        let known = self.quantities.iter().map(|quantity| {
            let attributes = header::of_dataset(&quantity.array.name, &quantity.unit, &self.stated);
            (quantity.dataset.clone(), Number::F64, quantity.array.components(), attributes)
        });
        let ids = (IDS.to_owned(), Number::U64, 1, Attributes::new());
        let all: Vec<_> = known.chain(std::iter::once(ids)).collect();
        for (quantity, (name, number_of, columns, attributes)) in all.into_iter().enumerate() {
            let array = self.spooled(number, quantity);
            let bytes = self.spool.bytes(array);
            if bytes == 0 {
                continue;
            }
            self.spool.copy(array, &mut self.out)?;
            let rows = self.counts[number];
            datasets.push(Dataset { name, number: number_of, rows, columns, at: *at, attributes });
            // All numbers have 8 bytes, so that each data set begins where one may.
            *at += bytes;
        }
        Ok(Group { name: format!("PartType{number}"), attributes: Attributes::new(), datasets })
    }
}

/// The data set of a quantity: what Gadget calls it, else its own name in letters that names of data sets may have; another than others have.
fn dataset_name(quantity: &str, taken: impl Fn(&str) -> bool) -> String {
    let letter = |letter: char| if letter.is_ascii_graphic() && letter != '/' { letter } else { '_' };
    let own: String = quantity.chars().map(letter).take(200).collect();
    // A single dot is the group itself.
    let own = if matches!(&*own, "" | ".") { "_".to_owned() } else { own };
    let standard = NAMES.iter().find(|(name, _)| *name == quantity).map(|(_, dataset)| (*dataset).to_owned());
    let first = standard.into_iter().chain(std::iter::once(own.clone())).find(|name| !taken(name));
    // Among as many names as there are quantities and one more is one that none of them has.
    first.unwrap_or_else(|| {
        (2_u32..).map(|number| format!("{own}_{number}")).find(|name| !taken(name)).unwrap_or(own.clone())
    })
}

impl Table for Gadget<'_> {
    type Piece = Block;

    fn prepare(block: Block) -> Block {
        block
    }

    fn write(&mut self, block: Block) -> io::Result<()> {
        let Some(number) = block.family.gadget_type().map(usize::from) else {
            let message =
                format!("the family {} has no type in Gadget's layout, expected gas, dark or stars", block.family);
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        };
        for (place, quantity) in self.quantities.iter().enumerate() {
            if quantity.array.is_in(&block) {
                let array = number * (self.quantities.len() + 1) + place;
                self.spool.push(array, |out| quantity.array.write(&block, out))?;
            }
        }
        if let Some(ids) = &block.ids {
            let array = self.spooled(number, self.quantities.len());
            self.spool.push(array, |out| out.extend(ids.iter().flat_map(|id| id.to_le_bytes())))?;
        }
        self.counts[number] += block.rows as u64;
        Ok(())
    }

    fn finish(mut self) -> io::Result<u64> {
        let system = self.quantities.iter().map(|quantity| (quantity.array.name.as_str(), &quantity.unit));
        let mut groups = header::groups(self.counts, &self.stated, &system.collect::<Vec<_>>());
        let mut at = hdf5::SUPERBLOCK as u64;
        for (number, count) in self.counts.into_iter().enumerate() {
            if count > 0 {
                groups.push(self.group(number, &mut at)?);
            }
        }
        let (objects, superblock) = hdf5::structure(&groups, at);
        self.out.write_all(&objects)?;
        self.out.flush()?;
        let file = self.out.get_mut();
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&superblock)?;
        Ok(self.counts.iter().sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_sets_have_names_of_their_own() {
        let mut names: Vec<String> = Vec::new();
        for quantity in
            ["density", "Density", "Density", "Density_2", "a/b c", "a_b_c", "", ".", "ParticleIDs", "größe"]
        {
            names.push(dataset_name(quantity, |name| name == IDS || names.iter().any(|other| other == name)));
        }
        let expected = [
            "Density",
            "Density_2",
            "Density_3",
            "Density_2_2",
            "a_b_c",
            "a_b_c_2",
            "_",
            "__2",
            "ParticleIDs_2",
            "gr__e",
        ];
        assert_eq!(names, expected);
    }
}
