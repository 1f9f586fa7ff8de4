//! Catalogues of halo finders in HDF5 that are no snapshots: VELOCIraptor's `.properties`, whose columns are data sets of the root.

use super::finder::VELOCIRAPTOR;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::Hdf5Tables;
use crate::model::{ReadMethod, Unit};
use glam::DVec3;
use std::path::Path;

/// Names as the file has them.
const POSITION: [&str; 3] = ["Xc", "Yc", "Zc"];
const MASS: [&str; 4] = ["Mvir", "Mass_200crit", "Mass_200mean", "Mass_tot"];
const RADIUS: [&str; 4] = ["Rvir", "R_200crit", "R_200mean", "R_size"];
const ID: &str = "ID";

/// Reads a catalogue; `None` of what is none of these.
pub(super) fn read(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
    let tables = Hdf5Tables::open(path, ReadMethod::default())?;
    let column = |name: &str| -> Result<Option<Vec<f64>>, ExploreError> {
        let column = tables.column("", name, MOST_OBJECTS)?;
        Ok(column.filter(|column| column.components == 1).map(|column| column.values))
    };
    let first = |names: &[&str]| -> Result<Option<Vec<f64>>, ExploreError> {
        for name in names {
            if let Some(values) = column(name)? {
                return Ok(Some(values));
            }
        }
        Ok(None)
    };
    let [x, y, z] = POSITION.map(column);
    let (Some(x), Some(y), Some(z)) = (x?, y?, z?) else { return Ok(None) };
    let (mass, radius, id) = (first(&MASS)?, first(&RADIUS)?, column(ID)?);
    let others = [Some(&y), Some(&z), mass.as_ref(), radius.as_ref(), id.as_ref()];
    if let Some(other) = others.into_iter().flatten().find(|other| other.len() != x.len()) {
        let expected = format!("{} rows as Xc has", x.len());
        return Err(ExploreError::malformed(path, "columns", format!("{} rows", other.len()), expected));
    }
    let of = |column: &Option<Vec<f64>>, row: usize| column.as_ref().map(|values| values[row]);
    let object = |row: usize| Object {
        // Numbers of haloes of the step; those of the whole run are above what a double holds, and are not used.
        name: format!("Halo {}", of(&id, row).unwrap_or(row as f64)),
        position: DVec3::new(x[row], y[row], z[row]),
        radius: of(&radius, row),
        mass: of(&mass, row),
    };
    // Units of comoving output have powers of `h`, too, which depend on how it was configured.
    let is_physical = tables.number("UnitInfo", "Comoving_or_Physical")? == Some(0.0);
    let unit = |name: &str, known: [(f64, &str); 3]| -> Result<Unit, ExploreError> {
        let size = tables.number("UnitInfo", name)?.filter(|_| is_physical);
        let named = size.and_then(|size| known.into_iter().find(|(other, _)| (size / other - 1.0).abs() < 1e-3));
        Ok(Unit::new(named.map_or("", |(_, name)| name)))
    };
    Ok(Some(Catalogue {
        path: path.into(),
        format: VELOCIRAPTOR.format,
        length_unit: unit("Length_unit_to_kpc", [(1e-3, "pc"), (1.0, "kpc"), (1e3, "Mpc")])?,
        mass_unit: unit("Mass_unit_to_solarmass", [(1.0, "Msun"), (1e5, "1e5 Msun"), (1e10, "1e10 Msun")])?,
        box_size: None,
        left_out: 0,
        objects: (0..x.len()).map(object).collect(),
        is_in_plane: false,
        tree: None,
    }))
}
