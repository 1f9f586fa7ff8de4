//! The colours of paths: what they follow, and the ranges of what is drawn.

use crate::color::colormap::ColorMap;
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::cpu::paths::{Curves, Palette, Quantity};
use crate::mode::{Depiction, PathColor, PathSettings};
use std::sync::Arc;

/// Colours of a map.
const COLORS: usize = 256;
/// Shares of the values that automatic ranges begin and end at.
const SHARES: [f64; 2] = [0.02, 0.98];
/// Above this ratio of its ends a range of positive values is placed by its logarithm.
const DECADES: f64 = 30.0;

/// What a path's colour follows, without the name of an attribute.
pub fn quantity(settings: &PathSettings) -> Quantity {
    match settings.colored_by() {
        PathColor::Speed => Quantity::Speed,
        PathColor::Direction => Quantity::Direction,
        PathColor::Mass => Quantity::Mass,
        PathColor::Time => Quantity::Time,
        PathColor::Attribute(_) => Quantity::Value,
        PathColor::Plain(color) => Quantity::Plain(color.map(|part| (255.0 * part).round() as u8)),
    }
}

/// The colours of these curves: the colour map is that of the transfer function's hue; so is the range, where both follow the same
/// attribute.
pub fn palette(
    settings: &PathSettings,
    depiction: &Depiction,
    transfer: &TransferFunction,
    curves: &[Arc<Curves>],
) -> Palette {
    let quantity = quantity(settings);
    let hue = transfer.hue.as_ref();
    // Maps that begin in black would hide what is slow.
    let map = hue.map(|hue| (hue.color_map.clone(), hue.span, hue.reverse));
    let (map, span, reverse) = map.unwrap_or((ColorMap::named("plasma").unwrap_or_default(), (0.15, 1.0), false));
    let mut colors: Vec<[u8; 3]> = map.sample_span(span, COLORS).into_iter().map(byte).collect();
    if reverse {
        colors.reverse();
    }
    let found = |value: &dyn Fn(&Curves, usize) -> f32| {
        let all = curves.iter().flat_map(|curves| curves.sample().map(move |i| (curves, i)));
        ends(all.map(|(curves, i)| value(curves, i)).filter(|value| value.is_finite()).collect())
    };
    let automatic = match quantity {
        Quantity::Speed => found(&|curves, i| curves.speed(i)),
        Quantity::Mass => found(&|curves, i| curves.mass[i][0].max(curves.mass[i][1])),
        Quantity::Value => found(&|curves, i| curves.values.get(i).map_or(f32::NAN, |ends| 0.5 * (ends[0] + ends[1]))),
        Quantity::Time | Quantity::Direction | Quantity::Plain(_) => [0.0, 1.0],
    };
    let is_same = match (settings.colored_by(), &depiction.attribute) {
        (PathColor::Attribute(name), Some(own)) => name == own.name,
        _ => false,
    };
    let spans_decades = automatic[0] > 0.0 && automatic[1] > DECADES * automatic[0];
    let (scale, range) = match hue.filter(|_| is_same) {
        Some(hue) => (
            hue.scale,
            match hue.range {
                Range::Fixed(low, high) => [low, high],
                Range::Auto => automatic,
            },
        ),
        None if quantity != Quantity::Time && spans_decades => (Scale::Log, automatic),
        None => (Scale::Linear, automatic),
    };
    Palette { quantity, colors, scale, range: scale.usable(Range::apart(range)) }
}

fn byte(color: [f32; 3]) -> [u8; 3] {
    color.map(|part| (255.0 * part.clamp(0.0, 1.0)).round() as u8)
}

/// Where most values lie.
fn ends(mut values: Vec<f32>) -> [f64; 2] {
    if values.is_empty() {
        return [0.0, 1.0];
    }
    let last = values.len() - 1;
    SHARES.map(|share| f64::from(*values.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp).1))
}
