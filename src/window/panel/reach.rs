//! How far sliders of a surface's settings go: as far as its heights do, where the numbers themselves may be nearly any.

use super::theme::Reach;
use crate::mode::{Setting, Settings};
use crate::modes::surface;
use crate::picture::surface::OpenSurface;

/// The least value above 0 that a slider from 0 reaches, as a share of its end.
const LEAST: f64 = 1e-3;
/// How many times lower and higher a surface may be drawn.
const LIFTS: [f64; 2] = [0.1, 100.0];
/// Of how many lines one is stronger at most.
const LINES: f64 = 20.0;
/// The widest gap, cells.
const CELLS: f64 = 1000.0;

/// The slider of a setting of a field's pictures; `None` where it goes as far as the setting.
pub(super) fn of(setting: &Setting, opened: &OpenSurface, settings: &Settings) -> Option<Reach> {
    let about = opened.file().about();
    let cell = match settings.name(&surface::GAP_UNIT) == "lengths" {
        true => about.grid.step[0].abs().max(about.grid.step[1].abs()),
        false => 1.0,
    };
    let size = || opened.bounds(settings).map_or(1.0, |bounds| bounds.size().length());
    let found = reach(setting, [about.facts.min, about.facts.max], cell, size);
    // A field without a measured sample has no heights.
    found.filter(|found| found.ends.into_iter().all(f64::is_finite))
}

/// The same of heights, of a cell as wide as gaps are told in, and of a field that is so large in its pictures.
fn reach(setting: &Setting, heights: [f64; 2], cell: f64, size: impl FnOnce() -> f64) -> Option<Reach> {
    let is = |own: &Setting| setting.name == own.name;
    let up_to = |end: f64| Reach { ends: [0.0, end], least: Some(LEAST * end) };
    if is(&surface::EXAGGERATION) {
        Some(Reach { ends: LIFTS, least: Some(LIFTS[0]) })
    } else if is(&surface::BASE) || is(&surface::CONTOUR_BASE) {
        Some(Reach { ends: heights, least: None })
    } else if is(&surface::CONTOURS) {
        Some(up_to(heights[1] - heights[0]))
    } else if is(&surface::CONTOUR_MAJOR) {
        Some(Reach { ends: [0.0, LINES], least: None })
    } else if is(&surface::LARGEST_GAP) {
        Some(up_to(CELLS * cell))
    } else if is(&surface::CLEARANCE) {
        Some(up_to(size()))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::SettingKind;

    #[test]
    fn every_slider_goes_as_far_as_the_field_does_and_no_further() {
        for setting in surface::MODE.own_settings() {
            let SettingKind::Number { min, max, .. } = setting.kind else { continue };
            let found = reach(setting, [-50.0, 150.0], 0.5, || 800.0);
            let Some(Reach { ends: [low, high], least }) = found else {
                assert!(max - min <= 1000.0, "{}", setting.name);
                continue;
            };
            let is_within = min <= low && low < high && high <= max && high <= 1000.0;
            assert!(is_within && least.is_none_or(|least| least > 0.0 && least >= low), "{}: {found:?}", setting.name);
        }
        let ends = |setting: &Setting| reach(setting, [-50.0, 150.0], 0.5, || 800.0).unwrap().ends;
        assert_eq!((ends(&surface::CONTOURS), ends(&surface::BASE)), ([0.0, 200.0], [-50.0, 150.0]));
        assert_eq!((ends(&surface::LARGEST_GAP), ends(&surface::CLEARANCE)), ([0.0, 500.0], [0.0, 800.0]));
    }
}
