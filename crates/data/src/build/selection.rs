//! Which families and attributes of a source are kept.

use super::{BuildError, BuildOptions};
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::import::{AttributeChoice, LoadOptions};
use crate::model::Family;
use std::path::Path;

/// Attributes that are kept when the user names none: at most this many of [`PREFERRED`] and then of the others. Of those that are named to be loaded
/// while none is named to be kept there are as many as a file has places for.
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
        let order = chosen(&names, options, DEFAULT_ATTRIBUTES);
        let mut attributes: Vec<_> = std::mem::take(&mut family.attributes).into_iter().map(Some).collect();
        family.attributes = order.into_iter().filter_map(|index| attributes[index].take()).collect();
    }
    Ok(families)
}

/// Which of a family's attributes are kept beside those that are derived, by index, in order.
pub(super) fn kept(names: &[&str], options: &BuildOptions, load_options: &LoadOptions) -> Vec<usize> {
    let places = match load_options.attributes {
        AttributeChoice::Named(_) => MAX_ATTRIBUTES,
        AttributeChoice::Usual | AttributeChoice::All => DEFAULT_ATTRIBUTES,
    };
    // What is derived is asked for; the most telling others fill the rest.
    chosen(names, options, places.saturating_sub(load_options.derive.len()))
}

/// Which of a family's attributes are kept, by index, in order: those that are named, else so many.
fn chosen(names: &[&str], options: &BuildOptions, most: usize) -> Vec<usize> {
    let rank = |name: &str| match &options.attributes {
        Some(wanted) => wanted.iter().position(|wanted| wanted == name),
        None => Some(PREFERRED.iter().position(|&preferred| preferred == name).unwrap_or(PREFERRED.len())),
    };
    let mut order: Vec<(usize, usize)> =
        names.iter().enumerate().filter_map(|(index, name)| Some((rank(name)?, index))).collect();
    order.sort_unstable();
    if options.attributes.is_none() {
        order.truncate(most);
    }
    order.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::DerivedQuantity;

    #[test]
    fn the_most_telling_are_kept_and_of_named_ones_as_many_as_there_are_places() {
        let names = ["x", "metallicity", "a", "temperature", "b", "speed", "c"];
        let found = |load: &LoadOptions, keep: Option<Vec<String>>| -> Vec<&str> {
            let options = BuildOptions { attributes: keep, ..BuildOptions::default() };
            kept(&names, &options, load).into_iter().map(|index| names[index]).collect()
        };
        let all = names.map(str::to_owned).to_vec();
        let named = LoadOptions { attributes: AttributeChoice::Named(all), ..LoadOptions::default() };
        let derived = LoadOptions { derive: DerivedQuantity::ALL.to_vec(), ..named.clone() };
        assert_eq!(found(&LoadOptions::default(), None), ["temperature", "speed", "metallicity", "x"]);
        assert_eq!(found(&named, None), ["temperature", "speed", "metallicity", "x", "a"]);
        assert_eq!(found(&derived, None), ["temperature"]);
        assert_eq!(found(&named, Some(vec!["c".into(), "x".into()])), ["c", "x"]);
    }
}
