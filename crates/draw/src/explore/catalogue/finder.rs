//! What halo finders call the columns of their catalogues.

/// A halo finder. Names of columns are in lower case, the preferred first.
#[derive(Debug)]
pub(super) struct Finder {
    /// Its name as that of a format.
    pub format: &'static str,
    /// Places.
    pub position: [&'static str; 3],
    /// Masses.
    pub mass: &'static [&'static str],
    /// Radii.
    pub radius: &'static [&'static str],
    /// Units of lengths, radii and masses where the file does not say them; empty: nobody knows.
    pub units: [&'static str; 3],
}

/// Rockstar (Behroozi et al. 2013): `out_N.list`, `halos_N.M.ascii`, and the lists that consistent-trees makes of them.
pub(super) static ROCKSTAR: Finder = Finder {
    format: "rockstar",
    position: ["x", "y", "z"],
    mass: &["mvir", "m200b", "m200c", "m500c", "m2500c"],
    radius: &["rvir", "r200b", "r200c", "r500c", "r2500c"],
    units: ["a Mpc/h", "a kpc/h", "Msun/h"],
};

/// AHF (Knollmann and Knebe 2009): `_halos`, in kpc/h and Msun/h as its guide says.
pub(super) static AHF: Finder = Finder {
    format: "ahf",
    position: ["xc", "yc", "zc"],
    mass: &["mvir", "mhalo", "m200c"],
    radius: &["rvir", "rhalo", "r200c"],
    units: ["a kpc/h", "a kpc/h", "Msun/h"],
};

/// VELOCIraptor (Elahi et al. 2019): `.properties`, in units that another file says.
pub(super) static VELOCIRAPTOR: Finder = Finder {
    format: "velociraptor",
    position: ["xc", "yc", "zc"],
    mass: &["mvir", "mass_200crit", "mass_200mean", "mass_tot"],
    radius: &["rvir", "r_200crit", "r_200mean", "r_size"],
    units: ["", "", ""],
};

/// Which columns of a catalogue are which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Columns {
    /// The halo's number, where it has one.
    pub id: Option<usize>,
    /// Places, and then mass and radius.
    pub numbers: [usize; 5],
}

impl Finder {
    /// Its columns among those of these names, capital letters or not; `None` where one is not there.
    pub(super) fn columns(&self, names: &[String]) -> Option<Columns> {
        let find = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
        let first = |wanted: &[&str]| wanted.iter().find_map(|name| find(name));
        let [x, y, z] = self.position.map(find);
        let numbers = [x?, y?, z?, first(self.mass)?, first(self.radius)?];
        Some(Columns { id: find("id"), numbers })
    }
}
