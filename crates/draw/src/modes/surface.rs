//! `surface`: measured heights, as points, triangles or rays of the surface that they stand for.

use super::shadowing;
use crate::color::transfer::{Range, Scale, TransferFunction};
use crate::cpu::shadowing::Shadowing;
use crate::cpu::surface::SurfaceOptions;
use crate::cpu::surface::holes::{Gap, Holes};
use crate::cpu::surface::look::{Attribute, Contours, Light, Look};
use crate::cpu::surface::placed::Map;
use crate::cpu::surface::select::{Coarse, Technique as How, USUAL_TAU};
use crate::cpu::volume::VolumeError;
use crate::heights::measure::FormKind;
use crate::heights::model::{Facts, Globe, HeightGrid, units};
use crate::heights::store::HeightAbout;
use crate::mode::{Job, Mode, Output, Raw, Setting, SettingKind, Settings, Technique};
use crate::model::Unit;

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

const MAPS: [&str; 15] = [
    "automatic",
    "plate",
    "local",
    "globe",
    "globe:earth",
    "globe:wgs84",
    "globe:grs80",
    "globe:moon",
    "globe:mars",
    "globe:mercury",
    "globe:venus",
    "globe:titan",
    "globe:ganymede",
    "globe:ceres",
    "globe:pluto",
];

/// Mean radii of bodies, metres (IAU working group on cartographic coordinates, 2015).
const BODIES: [(&str, f64); 9] = [
    ("earth", 6_371_008.8),
    ("moon", 1_737_400.0),
    ("mars", 3_389_500.0),
    ("mercury", 2_439_400.0),
    ("venus", 6_051_800.0),
    ("titan", 2_575_150.0),
    ("ganymede", 2_631_200.0),
    ("ceres", 469_700.0),
    ("pluto", 1_188_300.0),
];

/// Ellipsoids, metres (EPSG 7030, 7019), and reference systems of longitude and latitude on them.
const ELLIPSOIDS: [(&str, Globe, &[&str]); 2] = [
    ("wgs84", Globe { equator: 6_378_137.0, pole: 6_356_752.314_245_179 }, &["EPSG:4326", "EPSG:4979"]),
    ("grs80", Globe { equator: 6_378_137.0, pole: 6_356_752.314_140_356 }, &["EPSG:4258", "EPSG:4269", "EPSG:4283"]),
];

/// Fields in degrees that are at least so wide are a globe unless they are told otherwise.
const GLOBE_FROM: f64 = 20.0;

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
}

/// How a grid's places become places in the world, where a setting says `name`.
fn map_of(name: &str, grid: &HeightGrid) -> Result<Map, String> {
    let is_degrees = units::is_degrees(&grid.xy_unit);
    let unit = units::metres(&grid.height_unit).unwrap_or(1.0);
    let radius =
        |body: &str| BODIES.iter().find(|(name, _)| *name == body).map_or(BODIES[0].1, |(_, metres)| *metres) / unit;
    let ellipsoid = |body: &str| ELLIPSOIDS.iter().find(|(name, _, _)| *name == body);
    let globe = |body: &str| match ellipsoid(body) {
        Some((_, globe, _)) => globe.in_unit(unit),
        None => Globe::sphere(radius(body)),
    };
    // The one that the reference system of a file is of.
    let of_file = || {
        let found =
            ELLIPSOIDS.iter().find(|(_, _, systems)| grid.crs.as_deref().is_some_and(|crs| systems.contains(&crs)));
        found.map(|(name, _, _)| globe(name))
    };
    let extent = grid.step[0].abs() * (grid.columns - 1) as f64;
    let down = grid.step[1].abs() * (grid.rows - 1) as f64;
    match name.split_once(':').unwrap_or((name, "earth")) {
        ("plate", _) => Ok(Map::Plate),
        ("automatic", _) if !is_degrees => Ok(Map::Plate),
        ("automatic", _) if extent.max(down) < GLOBE_FROM => Ok(Map::Local { radius: radius("earth") }),
        ("automatic" | "globe", _) if is_degrees && !name.contains(':') => {
            Ok(Map::Globe(of_file().unwrap_or(globe("earth"))))
        }
        (kind, _) if !is_degrees => {
            let named = |unit: &Unit| if unit.is_unknown() { "no unit".to_owned() } else { unit.to_string() };
            let found = format!("x and y in {}, heights in {}", named(&grid.xy_unit), named(&grid.height_unit));
            Err(format!("map {kind}: found {found}, expected x and y in degrees (--xy-unit deg), or map plate"))
        }
        ("local", body) => Ok(Map::Local { radius: radius(body) }),
        (_, body) => Ok(Map::Globe(globe(body))),
    }
}

/// The radius in metres of the body that a map places a grid's degrees on; `None` where it is `plate`.
///
/// # Errors
/// A map that is not known, or that does not fit the grid's units.
pub fn radius_of(name: &str, grid: &HeightGrid) -> Result<Option<f64>, String> {
    if !MAPS.contains(&name) {
        return Err(format!("map: found {name}, expected one of {}", MAPS.join(", ")));
    }
    let metres = units::metres(&grid.height_unit).unwrap_or(1.0);
    Ok(match map_of(name, grid)? {
        Map::Plate => None,
        Map::Local { radius } => Some(radius * metres),
        Map::Globe(globe) => Some((2.0 * globe.equator + globe.pole) / 3.0 * metres),
    })
}

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

/// A transfer function as a field has it, whose colours are spread over these `heights`: where places are degrees and the range goes across height 0,
/// the colours of `terrain` have their shore there.
pub fn with_shore(
    transfer: TransferFunction,
    attribute: Attribute,
    grid: &HeightGrid,
    heights: [f64; 2],
) -> TransferFunction {
    let is_of_places = attribute == Attribute::Height && units::is_degrees(&grid.xy_unit);
    let [low, high] = range_of(&transfer, attribute, heights, 2, 1.0);
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

impl SurfaceSettings {
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

    #[test]
    fn aspects_go_round() {
        let colors = usual_transfer(Attribute::Aspect).bake_colors();
        let [first, last] = [0, colors.rgba.len() - 1].map(|at| colors.rgba[at]);
        assert!((0..3).all(|k| first[k].abs_diff(last[k]) <= 1), "{first:?} {last:?}");
        let range = range_of(&usual_transfer(Attribute::Aspect), Attribute::Aspect, [5.0, 6.0], 2, 1.0);
        assert_eq!(range, [0.0, 360.0]);
    }

    #[test]
    fn degrees_are_a_globe_from_twenty_on() {
        let grid = |columns: u64, unit: &str| HeightGrid {
            xy_unit: Unit::new(unit),
            height_unit: Unit::new("km"),
            ..HeightGrid::new(columns, 5, SampleType::F32)
        };
        assert_eq!(map_of("automatic", &grid(30, "m")), Ok(Map::Plate));
        assert_eq!(map_of("automatic", &grid(10, "deg")), Ok(Map::Local { radius: 6371.0088 }));
        assert_eq!(map_of("automatic", &grid(21, "deg")), Ok(Map::Globe(Globe::sphere(6371.0088))));
        assert_eq!(map_of("globe:moon", &grid(4, "deg")), Ok(Map::Globe(Globe::sphere(1737.4))));
        assert_eq!(
            map_of("globe:moon", &grid(4, "")),
            Err("map globe: found x and y in no unit, heights in km, expected x and y in degrees (--xy-unit deg), or map plate".into())
        );
        assert!(MAPS.iter().all(|name| map_of(name, &grid(4, "deg")).is_ok()));
    }
}
