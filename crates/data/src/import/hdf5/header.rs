//! The header of an HDF5 snapshot, whichever code wrote it.

use super::expansion::Expansion;
use super::file::{Attributes, H5Group};
use super::units::System;
use crate::import::ImportError;
use crate::model::Kernel;

/// What one file of a snapshot says about itself and the whole.
pub(super) struct Header {
    /// Particles in this file by type; `None` in a file without a header.
    pub counts: Option<Vec<u64>>,
    /// Particles in all files by type, where the header says so.
    pub totals: Option<Vec<u64>>,
    /// Mass of every particle by type, 0 where masses vary.
    pub masses: Vec<f64>,
    /// Number of files.
    pub files: u64,
    pub time: Option<f64>,
    pub redshift: Option<f64>,
    pub box_size: Option<f64>,
    pub units: System,
    /// Written by SWIFT, or for it.
    pub swift: bool,
    /// A file of SWIFT without particles of its own, which stands for others that have them.
    pub is_virtual: bool,
    /// Particles of GADGET-4's light cones, each of which is of a time of its own.
    pub is_light_cone: bool,
    /// The kernel function that the file names.
    pub kernel: Option<String>,
    /// SWIFT's support radius over its smoothing length, where the file says it.
    pub gamma: Option<f64>,
    /// What it says of the expansion of space.
    pub expansion: Expansion,
}

/// Options that GADGET-4 is compiled with, of which a snapshot lists those that are set: one of these, or none.
const GADGET4_KERNELS: [&str; 4] =
    ["CUBIC_SPLINE_KERNEL", "WENDLAND_C2_KERNEL", "WENDLAND_C4_KERNEL", "WENDLAND_C6_KERNEL"];

/// Kernels by GIZMO's numbers for them (its `KERNEL_FUNCTION`).
const GIZMO_KERNELS: [(u8, &str); 8] = [
    (1, "linear ramp"),
    (2, "quadratic peak"),
    (3, "cubic spline"),
    (4, "quartic spline"),
    (5, "quintic spline"),
    (6, "Wendland C2"),
    (7, "Wendland C4"),
    (9, "Wendland C6"),
];

/// The kernel that SWIFT's scheme, GADGET-4's options or GIZMO's header names.
fn kernel([hydro, config, header]: [Option<&Attributes>; 3]) -> Option<String> {
    let compiled = |config: &Attributes| GADGET4_KERNELS.into_iter().find(|option| config.has(option));
    let numbered = |header: &Attributes| {
        let number = header.number("Kernel_Function_ID")?;
        let known = GIZMO_KERNELS.iter().find(|(own, _)| f64::from(*own) == number);
        Some(known.map_or_else(|| format!("GIZMO's number {number}"), |(_, name)| (*name).to_owned()))
    };
    hydro
        .and_then(|hydro| hydro.text("Kernel function"))
        .or_else(|| config.and_then(compiled).map(str::to_owned))
        .or_else(|| header.and_then(numbered))
}

impl Header {
    /// Reads the header of one file; `groups` are the names of the root's groups.
    pub(super) fn read(root: &H5Group, groups: &[String]) -> Result<Header, ImportError> {
        let optional = |name: &str| -> Result<Option<Attributes>, ImportError> {
            let group = groups.iter().any(|group| group == name).then(|| root.group(name)).transpose()?;
            group.map(|group| group.attributes()).transpose()
        };
        let header = optional("Header")?;
        let parameters = optional("Parameters")?;
        let unit_group = optional("Units")?;
        let hydro = optional("HydroScheme")?;
        let code = optional("Code")?;

        let mut units = System::default();
        [&unit_group, &parameters, &header].into_iter().flatten().try_for_each(|group| units.learn(group))?;
        let number = |name: &str| {
            let groups = [&header, &parameters].into_iter().flatten();
            groups.into_iter().find_map(|group| group.number(name))
        };
        if number("GravityConstantInternal").is_some_and(|g| g != 0.0) {
            units = units.without_nominal();
        }
        let hubble = number("HubbleParam").filter(|h| *h > 0.0 && *h != 1.0);
        let comoving = number("ComovingIntegrationOn").is_some_and(|on| on != 0.0);
        units.comoving = (if comoving { 1.0 } else { 0.0 }, if hubble.is_some() { -1.0 } else { 0.0 });
        let swift = unit_group.as_ref().is_some_and(|group| group.number("Unit length in cgs (U_L)").is_some())
            || code.as_ref().and_then(|code| code.text("Code")).is_some_and(|code| code == "SWIFT");
        // No more than the kernel depends on this one.
        let config = optional("Config").ok().flatten();
        let kernel = kernel([&hydro, &config, &header].map(Option::as_ref));
        let gamma = hydro.as_ref().and_then(|hydro| hydro.number("Kernel gamma"));

        let (mut counts, mut totals, mut masses) = (None, None, Vec::new());
        if let Some(header) = &header {
            counts = header.counts("NumPart_ThisFile")?;
            totals = header.counts("NumPart_Total")?;
            let high = header.counts("NumPart_Total_HighWord")?.unwrap_or_default();
            for (total, high) in totals.iter_mut().flatten().zip(high) {
                *total = total.saturating_add(high.saturating_mul(1 << 32));
            }
            masses = header.numbers("MassTable").unwrap_or_default();
        }
        let expansion = Expansion::read(
            [header.as_ref(), parameters.as_ref(), optional("Cosmology")?.as_ref()],
            [unit_group.as_ref(), optional("InternalCodeUnits")?.as_ref()],
        );
        // What they cross repeats; they do not.
        let is_light_cone = header.as_ref().is_some_and(|header| {
            header.has("NumPart_ThisFile")
                && !header.has("Time")
                && (header.has("Npix_Total") || header.has("Ntrees_Total"))
        });
        let files = ["NumFilesPerSnapshot", "NumFilesPerSnap", "NumFiles"].into_iter().find_map(number);
        Ok(Header {
            counts,
            totals,
            masses,
            files: files.map_or(1, |files| (files as u64).max(1)),
            time: number("Time"),
            redshift: number("Redshift"),
            box_size: number("BoxSize").filter(|size| *size > 0.0 && !is_light_cone),
            units,
            swift,
            is_light_cone,
            is_virtual: number("Virtual").is_some_and(|flag| flag != 0.0),
            kernel,
            gamma,
            expansion,
        })
    }
}

/// A part of the name that codes give a kernel, which that is, and its support radius over SWIFT's smoothing length, in three
/// dimensions (Dehnen and Aly 2012, table 1).
pub(super) type Named = (&'static str, Kernel, f64);

const KERNELS: [Named; 6] = [
    ("cubic", Kernel::CubicSpline, 1.825742),
    ("quartic", Kernel::QuarticSpline, 2.018932),
    ("quintic", Kernel::QuinticSpline, 2.195775),
    ("wendland c2", Kernel::WendlandC2, 1.936492),
    ("wendland c4", Kernel::WendlandC4, 2.207940),
    ("wendland c6", Kernel::WendlandC6, 2.449490),
];

/// The kernel, where it is named and known.
pub(super) fn named_kernel(header: &Header) -> Option<&'static Named> {
    let name = header.kernel.as_deref()?.to_lowercase().replace(['-', '_'], " ");
    KERNELS.iter().find(|(kernel, ..)| name.contains(kernel))
}

/// The support radius of SWIFT's kernel over its smoothing length: of the cubic spline where no kernel is told.
pub(super) fn kernel_gamma(header: &Header) -> f64 {
    let stated = header.gamma.filter(|gamma| (1.0..=4.0).contains(gamma));
    stated.or_else(|| named_kernel(header).map(|(.., gamma)| *gamma)).unwrap_or(KERNELS[0].2)
}
