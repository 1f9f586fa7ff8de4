//! How large pictures are drawn, of how many particles, and from how many samples of light, while the view moves and when it rests.

use crate::mode::{SettingValue, Settings};
use crate::modes::shadowing::{self, LIGHT_SAMPLES, LIGHT_SIZE};
use crate::view::{CubeLayout, Eyes, Stereo, Surround};
use crate::window::preset::{MotionPreset, Preset};
use bevy::prelude::*;
use std::time::Instant;

/// The size of the picture to draw now; `strained`: there is no time for all particles.
pub(crate) fn drawing_size(full: UVec2, strained: bool, fixed_discs: bool, motion: &MotionPreset) -> UVec2 {
    // Discs of a fixed number of pixels would cover another share of a smaller picture.
    let shrink = if strained && !fixed_discs { motion.splat_shrink } else { 1 };
    (full / shrink).max(UVec2::ONE)
}

/// The size of a volume's picture in motion, from the size and milliseconds of the last one: a volume has as many cells as
/// the cube of a side.
pub(crate) fn moving_size(full: UVec2, last: Option<(UVec2, f64)>, budget: f64, motion: &MotionPreset) -> UVec2 {
    let shrink = last.map_or(motion.volume_shrink, |(size, milliseconds)| {
        let sides = f64::from(full.max_element()) / f64::from(size.max_element().max(1));
        (milliseconds / budget).cbrt() * sides
    });
    // In quarters of a step, so that times that differ a little do not make another picture.
    let shrink = ((4.0 * shrink).ceil() / 4.0).min(motion.volume_shrink).max(1.0);
    (full.as_dvec2() / shrink).as_uvec2().max(UVec2::ONE)
}

/// Which picture is wanted and since when, and what the last one cost: whatever draws it on a background task.
pub(crate) struct Wanted<C> {
    content: Option<(C, Instant)>,
    cost: Option<(UVec2, f64)>,
}

impl<C> Default for Wanted<C> {
    fn default() -> Wanted<C> {
        Wanted { content: None, cost: None }
    }
}

impl<C: Clone + PartialEq> Wanted<C> {
    /// Notes what is wanted now. Its size, up to `full` where it is the same for a while: then the second is true.
    pub(crate) fn follow(&mut self, content: &C, full: UVec2, preset: &Preset) -> (UVec2, bool) {
        if self.content.as_ref().is_none_or(|(known, _)| known != content) {
            self.content = Some((content.clone(), Instant::now()));
        }
        let motion = &preset.motion;
        let rest = u128::from(motion.rest_ms);
        let rests = self.content.as_ref().is_some_and(|(_, since)| since.elapsed().as_millis() >= rest);
        let size = if rests { full } else { moving_size(full, self.cost, moving_ms(preset), motion) };
        (size, rests)
    }

    /// Notes what a picture of that size took.
    pub(crate) fn took(&mut self, size: UVec2, milliseconds: f64) {
        self.cost = Some((size, milliseconds));
    }

    /// Milliseconds of the last one.
    pub(crate) fn milliseconds(&self) -> Option<f64> {
        self.cost.map(|(_, milliseconds)| milliseconds)
    }
}

/// Milliseconds that a picture in motion may take.
pub(crate) fn moving_ms(preset: &Preset) -> f64 {
    if preset.drawing.frame_ms > 0.0 { preset.drawing.frame_ms } else { preset.motion.volume_ms }
}

/// The size of a panorama, or of the picture of one eye, as large as the whole fits into a room of so many pixels. As on the command
/// line, that of a cube is one face's.
pub(crate) fn panorama_size(room: UVec2, surround: Surround, stereo: Option<Stereo>) -> UVec2 {
    let eyes = match stereo.map(|stereo| stereo.eyes) {
        Some(Eyes::SideBySide) => UVec2::new(2, 1),
        Some(Eyes::OverUnder) => UVec2::new(1, 2),
        Some(Eyes::Left | Eyes::Right) | None => UVec2::ONE,
    };
    let room = room / eyes;
    let size = match surround {
        Surround::Flat => room,
        Surround::Dome { .. } => UVec2::splat(room.min_element()),
        Surround::Equirectangular => UVec2::new(2, 1) * (room.x / 2).min(room.y),
        Surround::Cube { layout: CubeLayout::Cross } => UVec2::splat((room.x / 4).min(room.y / 3)),
        Surround::Cube { .. } => UVec2::splat((room.x / 6).min(room.y)),
    };
    size.max(UVec2::ONE)
}

/// How many particles a volume's picture may take of so many in the view: all at rest.
pub(crate) fn volume_limit(moving: bool, on_adapter: bool, particles: u64, motion: &MotionPreset) -> u64 {
    let most = if on_adapter { motion.volume_particles_gpu } else { motion.volume_particles };
    if moving && particles > most { most } else { u64::MAX }
}

/// Samples of light in motion.
const FEW: u32 = 4;
/// How many times as many samples each picture at rest has as the one before it: all of them together cost little more than the last.
const MORE: u32 = 4;

/// From how many samples ambient occlusion and shadows are found: few while the view moves, and at rest more in each picture, until it has those that
/// a file's has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LightSamples {
    /// At rest.
    full: u32,
    /// Whether each of them is another picture of the scene: one that a lamp sees.
    are_pictures: bool,
}

impl LightSamples {
    /// What a mode's settings ask for; `None` where nothing is darkened.
    pub(crate) fn of(settings: &Settings) -> Option<LightSamples> {
        let are_pictures = shadowing::casts(settings) && settings.number(&LIGHT_SIZE) > 0.0;
        shadowing::is_on(settings).then(|| LightSamples { full: settings.number(&LIGHT_SAMPLES) as u32, are_pictures })
    }

    /// How many the next picture has; `last`: how many the one has that is there, if it is the same but for them.
    pub(crate) fn next(self, rests: bool, last: Option<u32>) -> u32 {
        let few = FEW.min(self.full);
        // What is there already is not given up.
        let more = if rests { MORE } else { 1 };
        last.map_or(few, |last| last.saturating_mul(more).clamp(few, self.full))
    }

    /// Milliseconds that a picture takes in motion, where it took so many with `samples`.
    pub(crate) fn in_motion(self, milliseconds: f64, samples: u32) -> f64 {
        match self.are_pictures {
            true => milliseconds * f64::from(1 + FEW.min(samples)) / f64::from(1 + samples),
            false => milliseconds,
        }
    }

    /// Has a picture drawn from so many.
    pub(crate) fn set(settings: &mut Settings, samples: Option<u32>) {
        if let Some(samples) = samples {
            settings.set(&LIGHT_SAMPLES, SettingValue::Number(f64::from(samples)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::StereoKind;

    #[test]
    fn volumes_in_motion_are_as_large_as_there_is_time_for() {
        let full = UVec2::new(1000, 600);
        let motion = MotionPreset::default();
        let size = |last, motion: &MotionPreset| moving_size(full, last, 50.0, motion);
        assert_eq!(size(None, &motion), full / 4);
        assert_eq!(size(Some((full, 40.0)), &motion), full);
        assert_eq!(size(Some((full, 400.0)), &motion), full / 2);
        assert_eq!(size(Some((full / 2, 50.0)), &motion), full / 2);
        assert_eq!(size(Some((full / 4, 1e6)), &motion), full / 4);
        let sharper = MotionPreset { volume_shrink: 2.0, ..motion };
        assert_eq!(size(None, &sharper), full / 2);
        assert_eq!(size(Some((full / 4, 1e6)), &sharper), full / 2);
    }

    #[test]
    fn light_has_few_samples_in_motion_and_at_rest_ever_more_up_to_those_of_a_file() {
        let of = |set: &[(&'static crate::mode::Setting, f64)]| {
            let mut settings = Settings::default();
            set.iter().for_each(|(setting, number)| settings.set(setting, SettingValue::Number(*number)));
            (LightSamples::of(&settings), settings)
        };
        assert_eq!(of(&[(&LIGHT_SAMPLES, 8.0)]).0, None);
        for full in [1_u32, 3, 4, 5, 16, 64] {
            let (samples, mut settings) = of(&[(&shadowing::SHADOWS, 0.5), (&LIGHT_SAMPLES, f64::from(full))]);
            let samples = samples.unwrap();
            assert_eq!([None, Some(full)].map(|last| samples.next(false, last)), [full.min(FEW), full]);
            let mut last = None;
            let mut pictures = Vec::new();
            while last != Some(full) {
                last = Some(samples.next(true, last));
                pictures.extend(last);
                assert!(pictures.len() < 5 && pictures.is_sorted_by(|a, b| a < b), "{pictures:?}");
            }
            // What has all of them stays, and is what a file has.
            assert_eq!(samples.next(true, last), full);
            let whole = settings.number(&LIGHT_SAMPLES);
            LightSamples::set(&mut settings, last);
            assert_eq!(settings.number(&LIGHT_SAMPLES), whole);
            assert!(samples.in_motion(170.0, full) <= 170.0);
        }
        assert_eq!(of(&[(&shadowing::SHADOWS, 0.5)]).0.unwrap().in_motion(170.0, 16), 50.0);
        assert_eq!(of(&[(&shadowing::AMBIENT_OCCLUSION, 0.5)]).0.unwrap().in_motion(170.0, 16), 170.0);
    }

    #[test]
    fn panoramas_are_as_large_as_the_whole_fits() {
        let room = UVec2::new(1920, 1080);
        let size = |surround, eyes: Option<Eyes>| {
            let pair = |eyes| Stereo { kind: StereoKind::Omnidirectional, separation: 0.1, zero_parallax: 2.0, eyes };
            panorama_size(room, surround, eyes.map(pair)).to_array()
        };
        let dome = Surround::Dome { aperture: 180.0, tilt: 0.0 };
        assert_eq!(size(dome, None), [1080, 1080]);
        assert_eq!(size(dome, Some(Eyes::SideBySide)), [960, 960]);
        assert_eq!(size(dome, Some(Eyes::Left)), [1080, 1080]);
        assert_eq!(size(Surround::Equirectangular, None), [1920, 960]);
        assert_eq!(size(Surround::Equirectangular, Some(Eyes::OverUnder)), [1080, 540]);
        assert_eq!(size(Surround::Cube { layout: CubeLayout::Cross }, None), [360, 360]);
        assert_eq!(size(Surround::Cube { layout: CubeLayout::Strip }, None), [320, 320]);
        assert_eq!(size(Surround::Flat, Some(Eyes::SideBySide)), [960, 1080]);
        assert_eq!(panorama_size(UVec2::ONE, Surround::Cube { layout: CubeLayout::Files }, None), UVec2::ONE);
    }

    #[test]
    fn volumes_in_motion_take_a_sample_of_many_particles() {
        let motion = MotionPreset::default();
        assert_eq!(volume_limit(true, false, 1_000, &motion), u64::MAX);
        assert_eq!(volume_limit(true, false, 1_000_000, &motion), 200_000);
        assert_eq!(volume_limit(true, true, 1_000_000, &motion), u64::MAX);
        assert_eq!(volume_limit(false, false, 1_000_000_000, &motion), u64::MAX);
        let few = MotionPreset { volume_particles: 300, volume_particles_gpu: 500, ..motion };
        assert_eq!([false, true].map(|on_adapter| volume_limit(true, on_adapter, 1_000, &few)), [300, 500]);
    }

    #[test]
    fn strain_costs_pixels_and_rest_brings_them_back() {
        let full = UVec2::new(1000, 600);
        let motion = MotionPreset::default();
        assert_eq!(drawing_size(full, false, false, &motion), full);
        assert_eq!(drawing_size(full, true, false, &motion), full / 2);
        assert_eq!(drawing_size(full, true, true, &motion), full);
        let sharp = MotionPreset { splat_shrink: 1, ..motion.clone() };
        assert_eq!(drawing_size(full, true, false, &sharp), full);
    }
}
