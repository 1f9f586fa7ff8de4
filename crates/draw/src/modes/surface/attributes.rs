//! What colours a surface: attributes by their names, with the transfer function and the range that suit each.

use super::MODE;
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::cpu::surface::look::Attribute;
use crate::heights::model::{Facts, HeightGrid, units};
use crate::heights::store::HeightAbout;

/// What colours a surface, by the name of an attribute: those that every surface has, the field's colour planes, or (`texture`) the photo that
/// lies over it, without one the three colours among its planes as they are. Of one that is compared with an earlier field the difference is what
/// is seen where nothing is named.
///
/// # Errors
/// The names that there are.
pub fn attribute_of(name: Option<&str>, about: &HeightAbout, is_compared: bool) -> Result<Attribute, String> {
    let grid = &about.grid;
    let plane = |wanted: &str| grid.planes.iter().position(|plane| plane.name == wanted);
    let colors = || Some(Attribute::Texture([plane("red")?, plane("green")?, plane("blue")?]));
    let texture = || about.photo.as_ref().map(|_| Attribute::Photo).or_else(colors);
    match name {
        None if is_compared => Ok(Attribute::Difference),
        None => Ok(texture().unwrap_or(Attribute::Height)),
        Some("height") => Ok(Attribute::Height),
        Some("slope") => Ok(Attribute::Slope),
        Some("aspect") => Ok(Attribute::Aspect),
        Some("curvature") => Ok(Attribute::Curvature),
        Some("residual") => Ok(Attribute::Residual),
        Some("difference") if is_compared => Ok(Attribute::Difference),
        Some("difference") => {
            Err("attribute difference: found no earlier heights to compare with, expected some (--before FILE)".into())
        }
        Some("level") => Ok(Attribute::Level),
        Some("primitive") => Ok(Attribute::Primitive),
        Some("texture") => texture().ok_or_else(|| {
            "attribute texture: the field has no photo, and no colour planes red, green and blue".to_owned()
        }),
        Some(other) => plane(other).map(Attribute::Plane).ok_or_else(|| {
            let planes: Vec<&str> = grid.planes.iter().map(|plane| plane.name.as_str()).collect();
            let all: Vec<&str> = ATTRIBUTES.into_iter().chain(planes).collect();
            format!("attribute {other} is not in the data, expected one of {}", all.join(", "))
        }),
    }
}

/// The attributes that every surface has.
pub const ATTRIBUTES: [&str; 7] = ["height", "slope", "aspect", "curvature", "residual", "level", "primitive"];

/// What values of an attribute are called, and their unit where it is not that of heights; `None` for those of the file, whose planes have names
/// and whose colours are colours.
pub fn quantity_of(attribute: Attribute) -> Option<(&'static str, Option<&'static str>)> {
    match attribute {
        Attribute::Height => Some(("height", None)),
        Attribute::Slope => Some(("slope", Some("degrees"))),
        Attribute::Aspect => Some(("aspect", Some("degrees"))),
        Attribute::Curvature => Some(("curvature", Some(""))),
        Attribute::Residual => Some(("residual", None)),
        Attribute::Difference => Some(("difference", None)),
        Attribute::Level => Some(("level", Some(""))),
        Attribute::Primitive => Some(("points 0, triangles 1", Some(""))),
        Attribute::Plane(_) | Attribute::Texture(_) | Attribute::Photo => None,
    }
}

/// The transfer function of an attribute that nobody has chosen one for.
pub fn usual_transfer(attribute: Attribute) -> TransferFunction {
    let name = match attribute {
        Attribute::Curvature | Attribute::Residual | Attribute::Difference => "signed",
        // North is as far from 359 degrees as from 1.
        Attribute::Aspect => "cyclic",
        Attribute::Plane(_) => "grey",
        _ => MODE.transfer[0],
    };
    TransferFunction::preset(name).unwrap_or_default()
}

/// A transfer function as a field has it, whose colours are spread over these `heights`. Where its range goes down to 0 or below there are no
/// logarithms, and the scale is linear. Where places are degrees and the range goes across height 0, the colours of `terrain` have their shore there.
pub fn suited_transfer(
    transfer: TransferFunction,
    attribute: Attribute,
    grid: &HeightGrid,
    heights: [f64; 2],
) -> TransferFunction {
    let is_of_places = attribute == Attribute::Height && units::is_degrees(&grid.xy_unit);
    let [low, high] = range_of(&transfer, attribute, heights, 2, 1.0);
    let scale = if low > 0.0 { transfer.scale } else { Scale::Linear };
    let transfer = TransferFunction { scale, ..transfer };
    match is_of_places && low < 0.0 && high > 0.0 {
        true => transfer.with_shore(Scale::Linear.place(0.0, [low, high])),
        false => transfer,
    }
}

/// Colours are not spread over a few heights that are far from all others: shares of heights at either end, and how many times as far as those
/// between them all heights have to reach.
const OUTLIERS: [(f64, f64); 2] = [(2e-2, 10.0), (1e-3, 3.0)];

/// The heights that colours are spread over, of a field with an even share of its heights: from the least to the largest, but where those between
/// two quantiles ([`OUTLIERS`]) are so close that a few others would have most of the colours, of what is not farther from these than they are apart.
pub fn usual_heights(facts: &Facts, share: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sorted: Vec<f64> = share.filter(|height| height.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |part: f64| sorted.get((part * sorted.len().saturating_sub(1) as f64).round() as usize).copied();
    let without = |(share, stretch): (f64, f64)| {
        let (low, high) = (at(share)?, at(1.0 - share)?);
        let apart = high - low;
        let first = sorted.partition_point(|height| *height < low - apart);
        let end = sorted.partition_point(|height| *height <= high + apart);
        (apart > 0.0 && facts.max - facts.min > stretch * apart).then(|| [sorted[first], sorted[end - 1]])
    };
    OUTLIERS.into_iter().find_map(without).unwrap_or([facts.min, facts.max])
}

/// The range that colours are spread over: the transfer function's own, or what suits the attribute. `heights` are those that matter
/// ([`usual_heights`]); of curvatures, residuals and differences `most` is the largest that matters.
pub fn range_of(
    transfer: &TransferFunction,
    attribute: Attribute,
    heights: [f64; 2],
    levels: u32,
    most: f64,
) -> [f64; 2] {
    if let Range::Fixed(low, high) = transfer.range {
        return [low, high];
    }
    let [low, high] = match attribute {
        Attribute::Height => heights,
        Attribute::Slope => [0.0, 60.0],
        Attribute::Aspect => [0.0, 360.0],
        Attribute::Curvature | Attribute::Residual | Attribute::Difference => [-most, most],
        Attribute::Level => [0.0, f64::from(levels.max(2) - 1)],
        Attribute::Primitive | Attribute::Plane(_) | Attribute::Texture(_) | Attribute::Photo => [0.0, 1.0],
    };
    if low < high { [low, high] } else { [low - 0.5, low + 0.5] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    #[test]
    fn a_few_outliers_do_not_have_the_colours() {
        let facts = |min: f64, max: f64| Facts { valid: 10_000, lone: 0, min, max, mean: 0.0 };
        let ramp = || (0..10_001).map(|k| f64::from(k) / 10_000.0);
        assert_eq!(usual_heights(&facts(0.0, 1.0), ramp()), [0.0, 1.0]);
        // As far as three times the others is no outlier.
        assert_eq!(usual_heights(&facts(-0.9, 2.0), ramp()), [-0.9, 2.0]);
        let spikes = ramp().map(|height| if height < 0.0005 { -50.0 } else { height });
        assert_eq!(usual_heights(&facts(-50.0, 1.0), spikes), [0.0005, 1.0]);
        // More of them have to be farther away.
        let patch = |depth: f64| ramp().map(move |height| if height < 0.007 { -depth } else { height });
        assert_eq!(usual_heights(&facts(-50.0, 1.0), patch(50.0)), [0.007, 1.0]);
        assert_eq!(usual_heights(&facts(-7.0, 1.0), patch(7.0)), [-7.0, 1.0]);
        // Of a level field what is not level counts.
        let bump = ramp().map(|height| if height > 0.9995 { 7.0 } else { 2.0 });
        assert_eq!(usual_heights(&facts(2.0, 7.0), bump), [2.0, 7.0]);
        assert_eq!(usual_heights(&facts(1.0, 3.0), std::iter::empty()), [1.0, 3.0]);
        assert_eq!(usual_heights(&facts(1.0, 3.0), std::iter::once(f64::NAN)), [1.0, 3.0]);
    }

    #[test]
    fn ranges_without_logarithms_are_linear() {
        let grid = HeightGrid::new(5, 5, SampleType::F32);
        let scale = |text: &str, attribute: Attribute, heights: [f64; 2]| {
            let transfer = TransferFunction::parse(text, "x").expect("a transfer function");
            suited_transfer(transfer, attribute, &grid, heights).scale
        };
        let (plain, stated) = ("(color_map: \"viridis\")", "(color_map: \"viridis\", scale: log)");
        for (text, attribute, heights, expected) in [
            (plain, Attribute::Height, [-1437.0, 2205.0], Scale::Linear),
            (stated, Attribute::Height, [0.0, 7.0], Scale::Linear),
            (plain, Attribute::Height, [141.0, 547.0], Scale::Log),
            ("(range: fixed(0.0, 60.0))", Attribute::Slope, [1.0, 2.0], Scale::Linear),
            ("(range: fixed(0.1, 60.0))", Attribute::Slope, [1.0, 2.0], Scale::Log),
            (plain, Attribute::Curvature, [1.0, 2.0], Scale::Linear),
            (plain, Attribute::Residual, [1.0, 2.0], Scale::Linear),
            ("(scale: linear)", Attribute::Height, [141.0, 547.0], Scale::Linear),
        ] {
            assert_eq!(scale(text, attribute, heights), expected, "{text} {attribute:?} {heights:?}");
        }
    }

    #[test]
    fn aspects_go_round() {
        let colors = usual_transfer(Attribute::Aspect).bake_colors();
        let [first, last] = [0, colors.rgba.len() - 1].map(|at| colors.rgba[at]);
        assert!((0..3).all(|k| first[k].abs_diff(last[k]) <= 1), "{first:?} {last:?}");
        let range = range_of(&usual_transfer(Attribute::Aspect), Attribute::Aspect, [5.0, 6.0], 2, 1.0);
        assert_eq!(range, [0.0, 360.0]);
    }
}
