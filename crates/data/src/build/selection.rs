//! Which families and attributes of a source are kept.

use super::{BuildError, BuildOptions};
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::import::LoadOptions;
use crate::model::Family;
use std::path::Path;

/// Attributes that are kept when the user names none: at most this many of [`PREFERRED`] and then of the others.
pub const DEFAULT_ATTRIBUTES: usize = 4;

/// Standard attributes, the most telling first.
const PREFERRED: [&str; 10] = [
    "velocity-dispersion",
    "temperature",
    "magnitude",
    "color-index",
    "internal-energy",
    "speed",
    "metallicity",
    "star-formation-rate",
    "age",
    "potential",
];

/// Keeps the families and attributes that were asked for.
pub(super) fn selected_families(
    mut families: Vec<Family>,
    options: &BuildOptions,
    path: &Path,
) -> Result<Vec<Family>, BuildError> {
    let error = |what: String| BuildError::Selection { path: path.to_path_buf(), what };
    families.retain(|family| !family.is_empty());
    let there = families.iter().map(|family| family.name.as_str()).collect::<Vec<_>>().join(", ");
    for name in &options.families {
        if !families.iter().any(|family| family.name == *name) {
            return Err(error(format!("no particles of family {name}; there are {there}")));
        }
    }
    if !options.families.is_empty() {
        families.retain(|family| options.families.contains(&family.name));
    }
    if families.is_empty() {
        return Err(error("no particles".into()));
    }
    if let Some(wanted) = &options.attributes {
        if wanted.len() > MAX_ATTRIBUTES {
            return Err(error(format!("{} attributes asked for, at most {MAX_ATTRIBUTES} can be kept", wanted.len())));
        }
        for name in wanted {
            if families.iter().all(|family| family.attribute(name).is_none()) {
                let mut there: Vec<&str> =
                    families.iter().flat_map(|family| &family.attributes).map(|a| a.name.as_str()).collect();
                there.sort_unstable();
                there.dedup();
                return Err(error(format!("no attribute {name:?}; there are {}", there.join(", "))));
            }
        }
    }
    for family in &mut families {
        let names: Vec<&str> = family.attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        let order = chosen(&names, options);
        let mut attributes: Vec<_> = std::mem::take(&mut family.attributes).into_iter().map(Some).collect();
        family.attributes = order.into_iter().filter_map(|index| attributes[index].take()).collect();
    }
    Ok(families)
}

/// Which of a family's attributes are kept beside those that are derived, by index, in order.
pub(super) fn kept(names: &[&str], options: &BuildOptions, load_options: &LoadOptions) -> Vec<usize> {
    let mut own = chosen(names, options);
    // What is derived is asked for; the most telling others fill the rest.
    if options.attributes.is_none() {
        own.truncate(DEFAULT_ATTRIBUTES.saturating_sub(load_options.derive.len()));
    }
    own
}

/// Which of a family's attributes are kept, by index, in order.
fn chosen(names: &[&str], options: &BuildOptions) -> Vec<usize> {
    let rank = |name: &str| match &options.attributes {
        Some(wanted) => wanted.iter().position(|wanted| wanted == name),
        None => Some(PREFERRED.iter().position(|&preferred| preferred == name).unwrap_or(PREFERRED.len())),
    };
    let mut order: Vec<(usize, usize)> =
        names.iter().enumerate().filter_map(|(index, name)| Some((rank(name)?, index))).collect();
    order.sort_unstable();
    if options.attributes.is_none() {
        order.truncate(DEFAULT_ATTRIBUTES);
    }
    order.into_iter().map(|(_, index)| index).collect()
}
