//! `surface`: measured heights, as points, triangles or rays of the surface that they stand for.

mod attributes;
mod maps;

use super::shadowing;
use crate::color::transfer::TransferFunction;
use crate::cpu::shadowing::Shadowing;
use crate::cpu::surface::SurfaceOptions;
use crate::cpu::surface::holes::{Gap, Holes};
use crate::cpu::surface::look::{Attribute, Contours, Light, Look};
use crate::cpu::surface::placed::Map;
use crate::cpu::surface::select::{Coarse, Technique as How, USUAL_TAU};
use crate::cpu::volume::VolumeError;
use crate::heights::measure::FormKind;
use crate::heights::model::HeightGrid;
use crate::mode::{Job, Mode, Output, Raw, Setting, SettingKind, Settings, Technique};
use maps::{MAPS, map_of};

pub use attributes::{ATTRIBUTES, attribute_of, quantity_of, range_of, suited_transfer, usual_heights, usual_transfer};
pub use maps::radius_of;

/// How it is drawn.
pub static TECHNIQUE: Setting = Setting {
    name: "technique",
    unit: "",
    kind: SettingKind::Choice { options: &["hybrid", "points", "triangles", "rays"] },
    help: "points where samples are as dense as pixels and triangles elsewhere (hybrid), one of them alone, or a ray through each pixel",
};
/// How wide points are.
pub static POINT: Setting = Setting {
    name: "point",
    unit: "px",
    kind: SettingKind::Number { min: 1.0, max: 16.0, default: 1.0 },
    help: "how wide a point is, and how far apart samples are at most that are drawn as points, of which the next whole number is taken: samples \
           of the picture, with technique points pixels; wider ones take the place of more triangles, and add to the error",
};
/// What coarse levels are, and how they are chosen.
pub static PYRAMID: Setting = Setting {
    name: "pyramid",
    unit: "",
    kind: SettingKind::Choice { options: &["nested", "means"] },
    help: "what coarse levels are: samples of the field, chosen by how far the surface may be from where it is (nested), or, to compare with, chunk \
           by chunk a pyramid of means of four, chosen by how far samples are apart (means), which has no bound, and in which holes grow",
};
/// How many times as high as they are heights stand.
pub static EXAGGERATION: Setting = Setting {
    name: "exaggeration",
    unit: "",
    kind: SettingKind::Number { min: 1e-6, max: 1e9, default: 1.0 },
    help: "how many times as high as it is the surface stands; probes and legends say true heights",
};
/// The height that stays where it is.
pub static BASE: Setting = Setting {
    name: "base",
    unit: "",
    kind: SettingKind::Number { min: -1e30, max: 1e30, default: 0.0 },
    help: "the height that exaggeration leaves where it is",
};
/// Where light comes from.
pub static LIGHT: Setting = Setting {
    name: "light",
    unit: "",
    kind: SettingKind::Choice { options: &["sun", "eye"] },
    help: "where light comes from: far away, or the eye",
};
/// Direction of the sun.
pub static AZIMUTH: Setting = Setting {
    name: "azimuth",
    unit: "degrees",
    kind: SettingKind::Number { min: -360.0, max: 360.0, default: 315.0 },
    help: "from where the sun shines, clockwise from y",
};
/// Height of the sun.
pub static ALTITUDE: Setting = Setting {
    name: "altitude",
    unit: "degrees",
    kind: SettingKind::Number { min: -90.0, max: 90.0, default: 45.0 },
    help: "how high the sun stands",
};
/// Light from everywhere.
pub static AMBIENT: Setting = Setting {
    name: "ambient",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.25 },
    help: "the share of light that comes from everywhere; 1: colours alone",
};
/// Samples of a pixel.
pub static SAMPLES: Setting = Setting {
    name: "samples",
    unit: "per pixel",
    kind: SettingKind::Number { min: 1.0, max: 64.0, default: 4.0 },
    help: "samples of a pixel, of which the next square number is taken; more are smoother",
};
/// Lines of equal height.
pub static CONTOURS: Setting = Setting {
    name: "contours",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "from a line of equal height to the next, on slices of equal value, in the unit of heights or values; 0: no lines",
};
/// A height that has a line.
pub static CONTOUR_BASE: Setting = Setting {
    name: "contour-base",
    unit: "",
    kind: SettingKind::Number { min: -1e30, max: 1e30, default: 0.0 },
    help: "a height or a value that has a line",
};
/// Stronger lines.
pub static CONTOUR_MAJOR: Setting = Setting {
    name: "contour-major",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e6, default: 5.0 },
    help: "every so many lines one is stronger; 0 or 1: all are as strong",
};
/// How wide lines are.
pub static CONTOUR_WIDTH: Setting = Setting {
    name: "contour-width",
    unit: "px",
    kind: SettingKind::Number { min: 0.1, max: 100.0, default: 1.2 },
    help: "width of the lines",
};
/// Heights along lines.
pub static CONTOUR_LABELS: Setting = Setting {
    name: "contour-labels",
    unit: "",
    kind: SettingKind::Flag { default: false },
    help: "write heights along the lines",
};
/// What residuals are what is left of.
pub static FORM: Setting = Setting {
    name: "form",
    unit: "",
    kind: SettingKind::Choice { options: &FORMS },
    help: "the form that the attribute residual is without: fitted to the measured samples by least squares",
};
/// Sides of the field.
pub static WALLS: Setting = Setting {
    name: "walls",
    unit: "",
    kind: SettingKind::Flag { default: false },
    help: "draw the sides of the field, and of what a clip box or a slab leaves of it, down or up to base; not of a globe",
};
/// How high the eye stands.
pub static CLEARANCE: Setting = Setting {
    name: "clearance",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "how high the eye stands at least above the surface below it, in the picture's lengths: it is lifted, and looks the same way; \
           0: anywhere",
};
/// What is shown where nothing was measured.
pub static HOLES: Setting = Setting {
    name: "holes",
    unit: "",
    kind: SettingKind::Choice { options: &["open", "outlined", "filled"] },
    help: "what is shown where nothing was measured: nothing, a line along the rims of holes (as wide as contours are), or a hatched membrane, \
           which is no data: probes, numbers and raw channels do not have it",
};
/// Holes from far away.
pub static HOLES_FAR: Setting = Setting {
    name: "holes-far",
    unit: "",
    kind: SettingKind::Choice { options: &["coverage", "grow"] },
    help: "holes from far away: they keep their area (coverage), or a coarse sample is left out if any that it stands for was not measured (grow)",
};
/// How large a hole may be that is filled.
pub static LARGEST_GAP: Setting = Setting {
    name: "largest-gap",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "how far what was measured on both sides of a filled hole is apart at most, along a row or a column; 0: any",
};
/// What `largest-gap` is counted in.
pub static GAP_UNIT: Setting = Setting {
    name: "gap-unit",
    unit: "",
    kind: SettingKind::Choice { options: &["cells", "lengths"] },
    help: "what largest-gap is counted in: cells of the grid, or the unit of x and y",
};
/// How places in degrees become places in the world.
pub static MAP: Setting = Setting {
    name: "map",
    unit: "",
    kind: SettingKind::Choice { options: &MAPS },
    help: "how degrees become places: on a globe, in lengths about the middle (local) or as they are (plate); automatic is a globe of the \
           Earth from 20 degrees on, else local",
};

const FORMS: [&str; 14] = [
    "plane",
    "quadric",
    "sphere",
    "cylinder",
    "polynomial-3",
    "polynomial-4",
    "polynomial-5",
    "polynomial-6",
    "polynomial-7",
    "polynomial-8",
    "polynomial-9",
    "polynomial-10",
    "polynomial-11",
    "polynomial-12",
];

/// Colour of lines of equal height, or value, linear light.
pub const LINE_COLOR: [f32; 3] = [0.02, 0.02, 0.03];
/// An em of heights along lines, pixels, where others are of 13.
const LETTERS: f64 = 11.0;

/// What settings come to for a field.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceSettings {
    /// How it is drawn.
    pub technique: How,
    /// The side of a point, samples of the picture or pixels.
    pub point: u32,
    /// What coarse levels are.
    pub coarse: Coarse,
    /// How many times as high as they are heights stand.
    pub exaggeration: f64,
    /// The height that stays where it is.
    pub base: f64,
    /// How degrees become places.
    pub map: Map,
    /// Where light comes from.
    pub light: Light,
    /// The share of light that comes from everywhere.
    pub ambient: f32,
    /// Samples of a pixel.
    pub samples: u32,
    /// Lines of equal height.
    pub contours: Option<Contours>,
    /// What holes look like.
    pub holes: Holes,
    /// Whether they grow with distance.
    pub holes_grow: bool,
    /// What residuals are what is left of.
    pub form: FormKind,
    /// Whether it has sides down or up to the base.
    pub walls: bool,
    /// How high the eye stands above the surface at least; 0: anywhere.
    pub clearance: f64,
    /// How it darkens itself, for one whose size is 1.
    pub shadowing: Option<Shadowing>,
}

impl SurfaceSettings {
    /// Of a mode's settings, for a grid.
    ///
    /// # Errors
    /// A map that does not fit its units, and what a pyramid of means is not drawn with.
    pub fn new(settings: &Settings, grid: &HeightGrid) -> Result<SurfaceSettings, String> {
        let technique = match settings.name(&TECHNIQUE).as_str() {
            "points" => How::Points,
            "triangles" => How::Triangles,
            "rays" => How::Rays,
            _ => How::Hybrid,
        };
        let light = match settings.name(&LIGHT).as_str() {
            "eye" => Light::Eye,
            _ => Light::Sun { azimuth: settings.number(&AZIMUTH), altitude: settings.number(&ALTITUDE) },
        };
        let contours = Some(settings.number(&CONTOURS)).filter(|interval| *interval > 0.0).map(|interval| Contours {
            interval,
            base: settings.number(&CONTOUR_BASE),
            major: settings.number(&CONTOUR_MAJOR) as u32,
            width: settings.number(&CONTOUR_WIDTH),
            color: LINE_COLOR,
            labels: settings.flag(&CONTOUR_LABELS).then_some(LETTERS),
        });
        let gap = match settings.number(&LARGEST_GAP) {
            0.0 => Gap::Any,
            gap if settings.name(&GAP_UNIT) == "lengths" => Gap::Lengths(gap),
            gap => Gap::Cells(gap),
        };
        let holes = match settings.name(&HOLES).as_str() {
            "outlined" => Holes::Outlined(settings.number(&CONTOUR_WIDTH)),
            "filled" => Holes::Filled(gap),
            _ => Holes::Open,
        };
        let map = map_of(&settings.name(&MAP), grid)?;
        let coarse = if settings.name(&PYRAMID) == "means" { Coarse::Means } else { Coarse::Nested };
        let needs_nested = [
            ("technique rays", technique == How::Rays),
            ("holes outlined or filled", holes != Holes::Open),
            ("walls", settings.flag(&WALLS)),
            ("contour-labels", settings.flag(&CONTOUR_LABELS)),
        ];
        if let Some((what, _)) = needs_nested.iter().find(|(_, is_asked)| *is_asked && coarse == Coarse::Means) {
            return Err(format!("pyramid: found means with {what}, expected nested"));
        }
        Ok(SurfaceSettings {
            technique,
            point: settings.number(&POINT).ceil() as u32,
            coarse,
            exaggeration: settings.number(&EXAGGERATION),
            base: settings.number(&BASE),
            map,
            light,
            ambient: settings.number(&AMBIENT) as f32,
            samples: settings.number(&SAMPLES) as u32,
            contours,
            holes,
            holes_grow: settings.name(&HOLES_FAR) == "grow",
            form: FormKind::named(&settings.name(&FORM)).unwrap_or(FormKind::Plane),
            walls: settings.flag(&WALLS),
            clearance: settings.number(&CLEARANCE),
            shadowing: shadowing::of_sun(settings, light, map, settings.number(&AMBIENT)),
        })
    }

    /// How a surface of this look is drawn, to an error in pixels of the picture.
    pub fn options(&self, look: Look, error_px: Option<f64>) -> SurfaceOptions {
        SurfaceOptions {
            technique: self.technique,
            coarse: self.coarse,
            point: self.point,
            tau: error_px.unwrap_or(USUAL_TAU),
            samples: self.samples,
            holes: self.holes,
            holes_grow: self.holes_grow,
            walls: self.walls.then_some(self.base),
            shadowing: self.shadowing,
            look: Some(look),
            ..SurfaceOptions::default()
        }
    }

    /// What the surface looks like in these colours.
    pub fn look(&self, attribute: Attribute, transfer: TransferFunction, range: [f64; 2]) -> Look {
        let SurfaceSettings { light, ambient, contours, .. } = *self;
        Look { attribute, transfer, range, light, ambient, contours }
    }
}

/// The technique of surfaces, which are drawn from their own data ([`crate::picture::surface`]).
pub struct OfSurfaces;

impl Technique for OfSurfaces {
    fn output(&self) -> Output {
        Output::Light
    }

    fn takes_particles(&self) -> bool {
        false
    }

    fn takes_surfaces(&self) -> bool {
        true
    }

    fn draw(&self, _job: &Job<'_>) -> Result<Raw, VolumeError> {
        Err(VolumeError::OnlyHeights)
    }
}

/// Measured heights.
pub static MODE: Mode = Mode {
    name: "surface",
    help: "of measured heights: the surface, in the light of a sun, coloured by height, slope or its own colours; what was not measured stays open",
    settings: &[
        &[
            &TECHNIQUE,
            &POINT,
            &PYRAMID,
            &EXAGGERATION,
            &BASE,
            &MAP,
            &LIGHT,
            &AZIMUTH,
            &ALTITUDE,
            &AMBIENT,
            &SAMPLES,
            &CONTOURS,
            &CONTOUR_BASE,
            &CONTOUR_MAJOR,
            &CONTOUR_WIDTH,
            &CONTOUR_LABELS,
            &FORM,
            &HOLES,
            &HOLES_FAR,
            &LARGEST_GAP,
            &GAP_UNIT,
            &WALLS,
            &CLEARANCE,
        ],
        shadowing::OF_SUN,
    ],
    technique: &OfSurfaces,
    quantity: "height",
    transfer: ["terrain", "density-hue"],
    ..super::grid::MODE
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    #[test]
    fn pyramids_of_means_are_refused_with_what_they_have_not() {
        let grid = HeightGrid::new(4, 5, SampleType::F32);
        let of = |settings: &str| SurfaceSettings::new(&ron::from_str(settings).unwrap(), &grid);
        let plain = of("{\"pyramid\": \"means\", \"technique\": \"points\", \"contours\": 1.0}").unwrap();
        assert_eq!((plain.coarse, of("{}").unwrap().coarse), (Coarse::Means, Coarse::Nested));
        for (other, named) in [
            ("\"technique\": \"rays\"", "technique rays"),
            ("\"holes\": \"filled\"", "holes"),
            ("\"walls\": true", "walls"),
            ("\"contour-labels\": true", "contour-labels"),
        ] {
            let refused = of(&format!("{{\"pyramid\": \"means\", {other}}}")).unwrap_err();
            assert!(refused.starts_with("pyramid: found means with") && refused.contains(named), "{refused}");
            assert!(of(&format!("{{{other}}}")).is_ok());
        }
    }
}
