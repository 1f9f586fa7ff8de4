//! What the colours of the picture mean: quantities, units, ranges and scales, for the colour bar and the panel.

use super::look::Look;
use super::number;
use crate::raster::transfer::Scale;
use crate::store::Metadata;

/// One axis of the colours.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendAxis {
    /// The quantity.
    pub title: String,
    /// Its unit; empty where it is not known.
    pub unit: String,
    /// The values at the two ends.
    pub range: [f64; 2],
    /// Whether values are placed logarithmically.
    pub log: bool,
}

/// The axes of the colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Brightness.
    pub p: LegendAxis,
    /// Hue, where it follows an attribute.
    pub s: Option<LegendAxis>,
}

impl Legend {
    /// What the colours mean in this look.
    pub fn of(look: &Look, metadata: &Metadata) -> Legend {
        let mode = look.depiction.mode;
        let p = LegendAxis {
            title: capitalized(mode.quantity),
            unit: tidy((mode.unit)(&metadata.mass_unit, &metadata.length_unit).0),
            range: look.levels.p,
            log: look.transfer.scale == Scale::Log,
        };
        let hue = look.transfer.hue.zip(look.depiction.attribute.as_ref());
        let s = hue.map(|(hue, coloring)| {
            let columns = metadata.families.iter().flat_map(|f| f.attributes.iter().chain(&f.quantities));
            let unit = columns.filter(|info| info.name == coloring.name).map(|info| info.unit.0.clone()).next();
            LegendAxis {
                title: capitalized(&coloring.name.replace('-', " ")),
                unit: tidy(unit.unwrap_or_default()),
                range: look.levels.s,
                log: hue.scale == Scale::Log,
            }
        });
        Legend { p, s }
    }
}

/// A name with a capital first letter.
fn capitalized(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A unit with superscripts in place of carets: `km^2` becomes `km²`.
fn tidy(unit: String) -> String {
    let mut text = String::with_capacity(unit.len());
    let mut raised = false;
    for c in unit.chars() {
        match (c, raised) {
            ('^', _) => raised = true,
            ('-', true) => text.push(number::MINUS),
            ('0'..='9', true) => {
                text.push(['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c as usize - '0' as usize])
            }
            _ => {
                raised = false;
                text.push(c);
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_and_names_are_typeset() {
        assert_eq!(tidy("(1e10 Msun)^2 / (kpc)^-5 K".into()), "(1e10 Msun)² / (kpc)¯⁵ K");
        assert_eq!(tidy("km/s".into()), "km/s");
        assert_eq!(capitalized("velocity dispersion"), "Velocity dispersion");
        assert_eq!(capitalized(""), "");
    }
}
