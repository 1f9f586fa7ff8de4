//! Ambient occlusion and shadows: what modes with opaque surfaces share, off unless they are set.

use super::grid;
use crate::color::Colors;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::ambient_occlusion::FARTHEST;
use crate::cpu::shadowing::{Casters, Lamp, Lighting, Shadowing, covering_depths};
use crate::cpu::surface::look::{Light, toward_sun};
use crate::cpu::surface::placed::Map;
use crate::cpu::volume::{Scenery, VolumeError};
use crate::mode::{Needs, Setting, SettingKind, Settings};
use crate::view::View;

/// Strength of ambient occlusion.
pub static AMBIENT_OCCLUSION: Setting = Setting {
    name: "ambient-occlusion",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.0 },
    help: "how dark opaque surfaces are where others near by hide them from light; 0: not at all",
};
/// How far ambient occlusion reaches.
pub static OCCLUSION_RADIUS: Setting = Setting {
    name: "occlusion-radius",
    unit: "of the size",
    kind: SettingKind::Number { min: 1e-6, max: 1.0, default: 0.03 },
    help: "how far ambient occlusion reaches, of the diameter of all there is; no further than 256 pixels",
};
/// Strength of shadows.
pub static SHADOWS: Setting = Setting {
    name: "shadows",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.0 },
    help: "how dark opaque surfaces are where a lamp does not reach; 0: no shadows",
};
/// How large the lamp is.
pub static LIGHT_SIZE: Setting = Setting {
    name: "light-size",
    unit: "degrees",
    kind: SettingKind::Number { min: 0.0, max: 60.0, default: 2.0 },
    help: "diameter of the lamp that casts shadows: the larger, the softer; 0: hard ones",
};
/// Where the lamp is that lights from beside the eye.
pub static SHADOW_AZIMUTH: Setting = Setting {
    name: "shadow-azimuth",
    unit: "degrees",
    kind: SettingKind::Number { min: -180.0, max: 180.0, default: -40.0 },
    help: "where the lamp is that casts shadows: to the right of the eye",
};
/// The same upwards.
pub static SHADOW_ALTITUDE: Setting = Setting {
    name: "shadow-altitude",
    unit: "degrees",
    kind: SettingKind::Number { min: -90.0, max: 90.0, default: 35.0 },
    help: "where the lamp is that casts shadows: above the eye",
};
/// How finely light is looked for.
pub static LIGHT_SAMPLES: Setting = Setting {
    name: "light-samples",
    unit: "",
    kind: SettingKind::Number { min: 1.0, max: 64.0, default: 16.0 },
    help: "in how many directions ambient occlusion looks, and from how many places of the lamp shadows are cast: time for evenness",
};

/// Settings of modes whose surfaces are lit from somewhere else than the eye.
pub static OF_SUN: &[&Setting] = &[&AMBIENT_OCCLUSION, &OCCLUSION_RADIUS, &SHADOWS, &LIGHT_SIZE, &LIGHT_SAMPLES];
/// Settings of modes whose surfaces are lit from the eye, where no shadow is seen: they have a lamp beside it.
pub static BESIDE_EYE: &[&Setting] =
    &[&AMBIENT_OCCLUSION, &OCCLUSION_RADIUS, &SHADOWS, &LIGHT_SIZE, &LIGHT_SAMPLES, &SHADOW_AZIMUTH, &SHADOW_ALTITUDE];

/// Whether settings ask for any of it.
pub fn is_on(settings: &Settings) -> bool {
    settings.number(&AMBIENT_OCCLUSION) > 0.0 || casts(settings)
}

/// Whether settings ask for shadows: then what nobody sees counts, too.
pub fn casts(settings: &Settings) -> bool {
    settings.number(&SHADOWS) > 0.0
}

/// What a technique needs with settings, where it needs `own` without shadowing: occlusion is of what is beside a picture, too, and shadows are of
/// what is hidden.
pub fn needs(own: Needs, settings: &Settings) -> Needs {
    let margin_px = if settings.number(&AMBIENT_OCCLUSION) > 0.0 { own.margin_px + FARTHEST } else { own.margin_px };
    Needs { margin_px, hides: own.hides && !casts(settings), ..own }
}

/// What settings ask for of a scene that is so large, with a lamp, and a share of light from everywhere; `None` where they ask for nothing.
pub fn of(settings: &Settings, scene: f64, lamp: Option<Lamp>, ambient: f64) -> Option<Shadowing> {
    let shadowing = Shadowing {
        occlusion: settings.number(&AMBIENT_OCCLUSION),
        radius: scene * settings.number(&OCCLUSION_RADIUS),
        shadows: settings.number(&SHADOWS),
        lamp,
        ambient,
        scene,
        slack: 0.0,
        is_costly: false,
        samples: settings.number(&LIGHT_SAMPLES) as u32,
    };
    Some(shadowing).filter(Shadowing::is_on)
}

/// The same of heights in such light, in a scene of size 1. The sun casts shadows where it shines from one direction: on a globe each place has its
/// own, and what is lit from the eye hides its shadows.
pub fn of_sun(settings: &Settings, light: Light, map: Map, ambient: f64) -> Option<Shadowing> {
    let lamp = match (light, map) {
        (Light::Eye, _) | (_, Map::Globe(_)) => None,
        (Light::Sun { azimuth, altitude }, _) => {
            let size = settings.number(&LIGHT_SIZE).to_radians();
            Some(Lamp { toward: toward_sun(azimuth, altitude), size, lights: true })
        }
    };
    of(settings, 1.0, lamp, ambient)
}

/// The same where surfaces are lit from the eye of a view; the lamp goes with the picture's camera.
pub fn beside_eye(settings: &Settings, view: &View, lighting: &Lighting<'_>, scene: f64) -> Option<Shadowing> {
    let angle = |setting: &Setting| settings.number(setting).to_radians().sin_cos();
    let ((right, back), (up, level)) = (angle(&SHADOW_AZIMUTH), angle(&SHADOW_ALTITUDE));
    let camera = lighting.camera.unwrap_or(view);
    let toward = level * (right * camera.right - back * camera.forward) + up * camera.up;
    let lamp = Lamp { toward, size: settings.number(&LIGHT_SIZE).to_radians(), lights: false };
    of(settings, scene, Some(lamp), settings.number(&grid::AMBIENT))
}

/// How what is marched hides light; `parts` draws from any view what [`Scenery::casting`] is of it, if there is some. What is not there for a lamp casts
/// no shadow.
pub fn casters_of<'a, T>(
    scenery: &Scenery,
    parts: impl Fn(&View, &Scenery) -> Result<(PathFragments, T), VolumeError> + Sync + 'a,
) -> Box<Casters<'a>> {
    let casting = scenery.casting();
    Box::new(move |from: &View| Some(covering_depths(&parts(from, casting.as_ref()?).ok()?.0)))
}

/// The colours of parts, with the paths and surfaces among them that a picture has.
pub fn colors_among(parts: &PathFragments, among: Option<&PathFragments>) -> Colors {
    among.map_or_else(|| parts.colors(), |among| parts.merged(among).colors())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::SettingValue;
    use crate::view::Projection;
    use glam::DVec3;

    #[test]
    fn a_lamp_beside_the_eye_goes_with_it() {
        let set = |pairs: &[(&Setting, f64)]| {
            let pair = |(setting, number): &(&Setting, f64)| (setting.name.to_owned(), SettingValue::Number(*number));
            Settings(pairs.iter().map(pair).collect())
        };
        let perspective = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(DVec3::new(3.0, 1.0, 2.0), DVec3::ZERO, DVec3::Z, perspective, 30, 20).unwrap();
        let plain = Lighting::default();
        assert_eq!(beside_eye(&Settings::default(), &view, &plain, 1.0), None);
        let of = |azimuth: f64, altitude: f64| {
            let pairs = [(&SHADOWS, 0.5), (&SHADOW_AZIMUTH, azimuth), (&SHADOW_ALTITUDE, altitude)];
            let found = beside_eye(&set(&pairs), &view, &plain, 1.0).unwrap();
            // The faces of a panorama have the lamp of its camera.
            let face = View { right: view.forward, forward: -view.right, ..view };
            let around = Lighting { camera: Some(&view), ..plain };
            assert_eq!(beside_eye(&set(&pairs), &face, &around, 1.0), Some(found));
            found.lamp.unwrap().toward
        };
        for (azimuth, altitude, expected) in
            [(0.0, 0.0, -view.forward), (90.0, 0.0, view.right), (30.0, 90.0, view.up), (180.0, 0.0, view.forward)]
        {
            assert!((of(azimuth, altitude) - expected).length() < 1e-12, "{azimuth} {altitude}");
        }
        let pairs = [(&AMBIENT_OCCLUSION, 0.5), (&OCCLUSION_RADIUS, 0.1)];
        let half = beside_eye(&set(&pairs), &view, &plain, 20.0).unwrap();
        assert!(half.occlusion == 0.5 && half.radius == 2.0 && half.shadows == 0.0 && half.samples == 16);
    }
}
