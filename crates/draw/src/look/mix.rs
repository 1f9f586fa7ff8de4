//! Looks between looks: what a tour shows between two keyframes.

use super::LookPatch;
use crate::color::transfer::{Curve, Range, Scale, TransferFunction};
use crate::mode::levels::is_limit;
use crate::mode::{Setting, SettingKind, SettingValue, Settings, lod_budget};
use crate::model::When;
use crate::modes;
use crate::view::CutSettings;
use crate::view::cut::{ClipBox, Fade, Slab};

/// What is shown between two looks, at a share of the way: numbers are between theirs, and what is no number is as at the
/// first.
pub fn mix(a: &LookPatch, b: &LookPatch, share: f64) -> LookPatch {
    if a == b || share <= 0.0 {
        return a.clone();
    }
    let same_mode = a.mode == b.mode;
    let own = a.mode.unwrap_or(modes::first()).own_settings();
    LookPatch {
        settings: if same_mode { mix_settings(own, &a.settings, &b.settings, share) } else { a.settings.clone() },
        budget: match same_mode {
            true => mix_settings(lod_budget::COMMON.into_iter(), &a.budget, &b.budget, share),
            false => a.budget.clone(),
        },
        transfer: match (&a.transfer, &b.transfer) {
            (Some(first), Some(last)) if same_mode => Some(mix_transfer(first, last, share)),
            _ => a.transfer.clone(),
        },
        error_px: a.error_px.zip(b.error_px).map(|(a, b)| logarithmic(a, b, share)).or(a.error_px),
        time: mix_time(a.time, b.time, share),
        paths: a.paths.as_ref().zip(b.paths.as_ref()).map(|(a, b)| a.mixed(b, share)).or(a.paths.clone()),
        bloom: a.bloom.zip(b.bloom).map(|(a, b)| a.mixed(b, share)).or(a.bloom),
        cut: a.cut.as_ref().zip(b.cut.as_ref()).map(|(a, b)| mix_cut(a, b, share)).or(a.cut),
        ..a.clone()
    }
}

/// The time between two times, at a share of the way; the first where they are not named by numbers.
pub fn mix_time(a: Option<When>, b: Option<When>, share: f64) -> Option<When> {
    match (a, b) {
        (Some(When::Time(first)), Some(When::Time(last))) => Some(When::Time(linear(first, last, share))),
        _ => a,
    }
}

/// Evenly from `a` to `b`.
fn linear(a: f64, b: f64, share: f64) -> f64 {
    a + (b - a) * share
}

/// By equal factors from `a` to `b`, which are above 0; evenly if they are not.
fn logarithmic(a: f64, b: f64, share: f64) -> f64 {
    if a > 0.0 && b > 0.0 { a * (b / a).powf(share) } else { linear(a, b, share) }
}

fn mix_settings(all: impl Iterator<Item = &'static Setting>, a: &Settings, b: &Settings, share: f64) -> Settings {
    let mut mixed = a.clone();
    for setting in all {
        let value = |settings: &Settings| settings.0.get(setting.name).cloned().unwrap_or(setting.default());
        let is_set = [a, b].iter().any(|settings| settings.0.contains_key(setting.name));
        let mixed_value = match (setting.kind, value(a), value(b)) {
            (SettingKind::Number { min, max, .. }, SettingValue::Number(first), SettingValue::Number(last)) => {
                // What spans decades is felt by its factor.
                let spans = is_limit(setting.name) || min > 0.0 && max >= 100.0 * min;
                // There is nothing between a limit and none.
                let switches = is_limit(setting.name) && first.min(last) <= 0.0;
                let share = if switches { 0.0 } else { share };
                let mixed = if spans { logarithmic(first, last, share) } else { linear(first, last, share) };
                SettingValue::Number(mixed.clamp(min, max))
            }
            (SettingKind::Numbers { .. }, SettingValue::Numbers(first), SettingValue::Numbers(last))
                if first.len() == last.len() =>
            {
                SettingValue::Numbers(first.iter().zip(&last).map(|(&a, &b)| logarithmic(a, b, share)).collect())
            }
            (_, first, _) => first,
        };
        if is_set {
            mixed.0.insert(setting.name.to_owned(), mixed_value);
        }
    }
    mixed
}

fn mix_range(a: Range, b: Range, scale: Scale, share: f64) -> Range {
    let (Range::Fixed(low, high), Range::Fixed(low_b, high_b)) = (a, b) else { return a };
    let mixed = match scale {
        Scale::Log => [logarithmic(low, low_b, share), logarithmic(high, high_b, share)],
        Scale::Linear => [linear(low, low_b, share), linear(high, high_b, share)],
    };
    if mixed[0] < mixed[1] { Range::Fixed(mixed[0], mixed[1]) } else { a }
}

fn mix_transfer(a: &TransferFunction, b: &TransferFunction, share: f64) -> TransferFunction {
    let curve = |first: &Option<Curve>, last: &Option<Curve>| match (first, last) {
        (Some(first), Some(last)) => Some(first.mixed(last, share as f32)),
        _ => first.clone(),
    };
    let mut mixed = a.clone();
    mixed.gamma = logarithmic(a.gamma.into(), b.gamma.into(), share) as f32;
    mixed.brightness = curve(&a.brightness, &b.brightness);
    mixed.opacity = curve(&a.opacity, &b.opacity);
    if a.scale == b.scale {
        mixed.range = mix_range(a.range, b.range, a.scale, share);
    }
    if let (Some(hue), Some(last)) = (&mut mixed.hue, &b.hue)
        && hue.scale == last.scale
    {
        hue.range = mix_range(hue.range, last.range, hue.scale, share);
        let part = |a: f32, b: f32| linear(a.into(), b.into(), share) as f32;
        hue.span = (part(hue.span.0, last.span.0), part(hue.span.1, last.span.1));
    }
    mixed
}

fn mix_cut(a: &CutSettings, b: &CutSettings, share: f64) -> CutSettings {
    let mut mixed = *a;
    if let (Some(first), Some(last)) = (a.clip, b.clip) {
        let mix = |a: glam::DVec3, b: glam::DVec3| a + (b - a) * share;
        mixed.clip = Some(ClipBox { min: mix(first.min, last.min), max: mix(first.max, last.max) });
    }
    if let (Some(first), Some(last)) = (a.slab, b.slab)
        && first.axis == last.axis
    {
        let (middle, thickness) = (linear(first.middle, last.middle, share), [first.thickness, last.thickness]);
        mixed.slab = Some(Slab { middle, thickness: logarithmic(thickness[0], thickness[1], share), ..first });
    }
    if let (Some(first), Some(last)) = (a.fade, b.fade) {
        let (start, length) = (linear(first.start, last.start, share), logarithmic(first.length, last.length, share));
        mixed.fade = Some(Fade { start, length });
    }
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::levels::SPLATS;

    #[test]
    fn limits_change_by_factors_and_from_none_at_once() {
        let within = |splats: f64| {
            let mut look = LookPatch::default();
            look.budget.set(&SPLATS, SettingValue::Number(splats));
            look
        };
        let mixed = |a: f64, b: f64, share: f64| mix(&within(a), &within(b), share).budget.level_choice().splats;
        assert_eq!(mixed(100.0, 10_000.0, 0.5), Some(1000));
        assert_eq!((mixed(0.0, 10_000.0, 0.01), mixed(10_000.0, 0.0, 0.99)), (None, Some(10_000)));
    }
}
