//! What a tour shows besides the camera: kept from keyframe to keyframe, changed by what each says, and mixed between them.

use super::file::Keyframe;
use crate::annotate::Annotations;
use crate::color::transfer::{Curve, Range, Scale, TransferFunction};
use crate::explore::SelectionSet;
use crate::look::{Attribute, DatasetRef, SceneFile};
use crate::mode::{SettingKind, SettingValue, Settings};
use crate::model::FamilyName;
use crate::modes;
use crate::view::CutSettings;
use crate::view::cut::{ClipBox, Fade, Slab};

/// Everything of a scene but data, camera and panels; what is `None` is the program's own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Visualization mode.
    pub mode: Option<String>,
    /// Settings of the mode.
    pub settings: Settings,
    /// Which attribute gives the hue.
    pub attribute: Attribute,
    /// The families that are drawn.
    pub families: Option<Vec<FamilyName>>,
    /// From values to colours.
    pub transfer: Option<TransferFunction>,
    /// What is written into the picture.
    pub annotations: Option<Annotations>,
    /// Largest displacement of a particle on screen, pixels.
    pub error_px: Option<f64>,
    /// What is left out and faded.
    pub cut: CutSettings,
    /// Coloured selections.
    pub selections: Vec<SelectionSet>,
}

impl Look {
    /// The same with what a keyframe says. Another mode keeps the settings that it has too,
    /// and begins with its own colours.
    pub fn changed(&self, keyframe: &Keyframe) -> Look {
        let mut look = self.clone();
        if keyframe.mode.is_some() && keyframe.mode != look.mode {
            look.mode = keyframe.mode.clone();
            let mode = keyframe.mode.as_deref().and_then(modes::find).unwrap_or(modes::first());
            look.settings.0.retain(|name, _| mode.all_settings().any(|setting| setting.name == name));
            look.transfer = None;
        }
        look.settings.0.extend(keyframe.settings.0.clone());
        let set = |own: &mut Option<_>, said: &Option<_>| *own = said.clone().or(own.take());
        set(&mut look.transfer, &keyframe.transfer);
        look.annotations = keyframe.annotations.clone().or(look.annotations);
        look.families = keyframe.families.clone().or(look.families);
        look.error_px = keyframe.error_px.or(look.error_px);
        look.attribute = keyframe.attribute.clone().unwrap_or(look.attribute);
        look.cut = keyframe.cut.unwrap_or(look.cut);
        look.selections = keyframe.selections.clone().unwrap_or(look.selections);
        look
    }

    /// Whether the same values are shown, so that the ranges of their colours can be compared.
    pub fn is_measured_like(&self, other: &Look) -> bool {
        let scales = |look: &Look| {
            look.transfer.as_ref().map(|transfer| (transfer.scale, transfer.hue.as_ref().map(|hue| hue.scale)))
        };
        self.mode == other.mode
            && self.attribute == other.attribute
            && self.families == other.families
            && scales(self) == scales(other)
    }

    /// A scene that looks like this.
    pub fn scene(&self, mut dataset: DatasetRef) -> SceneFile {
        dataset.families = self.families.clone().or(dataset.families);
        SceneFile {
            mode: self.mode.clone(),
            settings: self.settings.clone(),
            attribute: self.attribute.clone(),
            transfer: self.transfer.clone(),
            annotations: self.annotations.clone(),
            error_px: self.error_px,
            cut: self.cut,
            selections: self.selections.clone(),
            ..SceneFile::new(vec![dataset])
        }
    }
}

/// What is shown between two keyframes, at a share of the way: numbers are between theirs, and what is no number is as at the
/// first.
pub fn mix(a: &Look, b: &Look, share: f64) -> Look {
    if a == b || share <= 0.0 {
        return a.clone();
    }
    let same_mode = a.mode == b.mode;
    Look {
        settings: if same_mode { mix_settings(a, b, share) } else { a.settings.clone() },
        transfer: match (&a.transfer, &b.transfer) {
            (Some(first), Some(last)) if same_mode => Some(mix_transfer(first, last, share)),
            _ => a.transfer.clone(),
        },
        error_px: a.error_px.zip(b.error_px).map(|(a, b)| logarithmic(a, b, share)).or(a.error_px),
        cut: mix_cut(&a.cut, &b.cut, share),
        ..a.clone()
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

fn mix_settings(a: &Look, b: &Look, share: f64) -> Settings {
    let mode = a.mode.as_deref().and_then(modes::find).unwrap_or(modes::first());
    let mut mixed = a.settings.clone();
    for setting in mode.all_settings() {
        let value = |settings: &Settings| settings.0.get(setting.name).cloned().unwrap_or(setting.default());
        let is_set = [a, b].iter().any(|look| look.settings.0.contains_key(setting.name));
        let mixed_value = match (setting.kind, value(&a.settings), value(&b.settings)) {
            (SettingKind::Number { min, max, .. }, SettingValue::Number(first), SettingValue::Number(last)) => {
                // What spans decades is felt by its factor.
                let spans = min > 0.0 && max >= 100.0 * min;
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
