//! What shaders are told of a surface: who looks and what it looks like; a chunk; and what is drawn at a time.

use super::constants;
use super::globe::{Anchor, drawn_ends};
use super::list::{DrawList, counted};
use super::photo::PhotoPlace;
use crate::color::transfer::Scale;
use crate::cpu::surface::holes::Holes;
use crate::cpu::surface::horizon::Limb;
use crate::cpu::surface::look::{Attribute, Contours, Light};
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::stitch::{Mesh, Scene};
use crate::picture::adapter::AdapterSurface;
use crate::view::{Projection, View};
use bevy::math::DVec3;
use bytemuck::{Pod, Zeroable};

/// WGSL `SurfaceView`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "shaders/lib/surface_view.wgsl says what each is")]
pub struct SurfaceUniform {
    pub contour_color: [f32; 3],
    pub contour_major: u32,
    pub origin: [f32; 3],
    pub focal: f32,
    pub per_column: [f32; 3],
    pub near: f32,
    pub per_row: [f32; 3],
    pub perspective: u32,
    pub per_height: [f32; 3],
    pub parts: u32,
    pub eye: [f32; 3],
    pub stride: u32,
    pub right: [f32; 3],
    pub spacing: f32,
    pub up: [f32; 3],
    pub fade_start: f32,
    pub forward: [f32; 3],
    pub fade_rate: f32,
    pub world_right: [f32; 3],
    pub clips: u32,
    pub world_up: [f32; 3],
    pub point_side: u32,
    pub world_forward: [f32; 3],
    pub lone_side: u32,
    pub clip_min: [f32; 3],
    pub colored_by: u32,
    pub clip_max: [f32; 3],
    pub ramp_last: u32,
    pub sun: [f32; 3],
    pub is_sun: u32,
    pub size: [u32; 2],
    pub middle: [f32; 2],
    pub anchor: [i32; 2],
    pub last: [u32; 2],
    pub step: [f32; 2],
    pub low: f32,
    pub per: f32,
    pub is_log: u32,
    pub reference: f32,
    pub ambient: f32,
    pub steeper: f32,
    pub true_lift: f32,
    pub contour_interval: f32,
    pub contour_base: f32,
    pub contour_width: f32,
    pub far: f32,
    pub tree: u32,
    pub top: u32,
    pub has_form: u32,
    pub pole_at: [u32; 2],
    pub pole_height: [f32; 2],
    pub pole_rows: [f32; 2],
    pub turn: [f32; 2],
    pub open: u32,
    pub latitude: f32,
    pub radius: f32,
    pub lift: f32,
    pub lengths: [f32; 2],
    pub photo_size: [u32; 2],
    pub photo_anchor: [i32; 2],
    pub photo_at: [f32; 2],
    pub photo_per: [f32; 2],
    pub photo_rows: [f32; 2],
    pub photo_columns: [f32; 2],
    pub photo_period: f32,
    pub photo_is_endless: u32,
    pub photo_light: u32,
    pub photo_table: u32,
    pub photo_levels: u32,
    pub rim_width: f32,
    pub box_min: [f32; 3],
    pub wall_base: f32,
    pub box_max: [f32; 3],
    pub spans: f32,
    pub limb: [f32; 3],
    pub limb_away: f32,
    pub equator: f32,
    pub squared_eccentricity: f32,
    pub lifted: f32,
    pub goes_round: u32,
}

/// WGSL `Draw`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Draw {
    /// Its first word among the samples.
    pub start: u32,
    /// Rows of samples.
    pub rows: u32,
    /// Samples of a row.
    pub columns: u32,
    /// Its level.
    pub level: u32,
    /// Its row among the chunks of its level.
    pub key_row: u32,
    /// Its column among them.
    pub key_column: u32,
    /// Whether it is points, has holes or is found by rays, and which of its sides are special.
    pub flags: u32,
    /// Where its heights along its sides are listed, or [`NONE`](constants::NONE).
    pub border: u32,
    /// Where the chunks that it lies in are listed.
    pub chain: u32,
    /// How many these are, itself included.
    pub chain_length: u32,
    /// Between which heights it is, from the reference.
    pub low: f32,
    /// The upper end of these.
    pub high: f32,
    /// On a globe where its rows are listed.
    pub rows_at: u32,
    /// And its columns.
    pub columns_at: u32,
    /// Where its squares of cells with rims are listed, or [`NONE`](constants::NONE).
    pub rims: u32,
    /// Where its squares of samples with a membrane are listed, or [`NONE`](constants::NONE).
    pub fill: u32,
    /// On a globe that rays are cast through: where its triangles whose corners are listed are found, or [`NONE`](constants::NONE).
    pub fans: u32,
    /// And the longest distance between two of its rows.
    pub row_length: f32,
}

/// WGSL `SurfaceStep`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SurfaceStep {
    /// Whether numbers are found, and not depths.
    pub is_second: u32,
    /// Where the chunks' numbers, the triangles, or chunks with squares of the picture are listed.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// Which counter the list of large triangles has.
    pub counter: u32,
    /// How many that list has room for.
    pub most: u32,
    /// Padding.
    pub unused: u32,
    /// Padding.
    pub unused_end: [u32; 2],
}

impl SurfaceUniform {
    /// What a job's shaders need: rows of the picture are `stride` samples apart, and there are `ramp` colours.
    pub fn new(job: &AdapterSurface, stride: u32, ramp: u32, list: &DrawList) -> SurfaceUniform {
        let (scene, view, look) = (&job.scene, &job.view, &job.look);
        let placed = &scene.placed;
        let on_globe = Anchor::of(scene, view.eye, job.reference);
        let anchor = on_globe.as_ref().map_or_else(|| anchor_of(scene, view.eye), |anchor| anchor.sample);
        let flat = || placed.world(anchor[1] as f64, anchor[0] as f64, job.reference);
        let at_anchor = on_globe.as_ref().map_or_else(flat, Anchor::place) - view.eye;
        let camera = |away: DVec3| DVec3::new(away.dot(view.right), away.dot(view.up), away.dot(view.forward));
        let camera = |away: DVec3| camera(away).as_vec3().to_array();
        let flat = || [DVec3::X * placed.step[0], DVec3::Y * placed.step[1], DVec3::Z * placed.lift];
        let axes = on_globe.as_ref().map_or_else(flat, Anchor::axes).map(camera);
        let closes = u64::from(scene.lattice.is_closed);
        let [equator, squared_eccentricity] = on_globe.as_ref().map_or([0.0; 2], Anchor::ellipse);
        let pole_rows = [0, 1].map(|end| {
            let row = if end == 0 { 0.0 } else { (placed.samples[1] - 1) as f64 };
            scene.poles[end].map_or(0.0, |pole| (pole.latitude - placed.origin[1]) / placed.step[1] - row) as f32
        });
        // Of world lengths the columns, rows and heights.
        let per = DVec3::new(placed.step[0], placed.step[1], placed.lift);
        let grid = |away: DVec3| (away / per).as_vec3().to_array();
        let focal = view.focal_pixels();
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let [x, y] = placed.spacing();
        let limb = Limb::of(scene, &Sight::Flat(*view));
        let cut = &view.cut;
        // The box as rows, columns and heights have it, which may run the other way.
        let ends = |pick: fn(f64, f64) -> f64| -> [f32; 3] {
            let [min, max] = [cut.bounds.min, cut.bounds.max].map(|end| (end - view.eye - at_anchor) / per);
            std::array::from_fn(|axis| pick(min[axis], max[axis]).clamp(-1e37, 1e37) as f32)
        };
        let sun = match look.light {
            Light::Eye => None,
            Light::Sun { azimuth, altitude } => {
                let (up, level) = altitude.to_radians().sin_cos();
                let (east, north) = azimuth.to_radians().sin_cos();
                Some(DVec3::new(level * east, level * north, up))
            }
        };
        let photo = job.photo.as_ref().map(|cut| PhotoPlace::new(&cut.laid, placed, anchor)).unwrap_or_default();
        let [low, high] = look.range;
        let base = if look.attribute == Attribute::Height { job.reference } else { 0.0 };
        let (low, per_value, is_log) = match look.transfer.scale {
            Scale::Linear => (low - base, 1.0 / (high - low), 0),
            Scale::Log => (low.ln(), 1.0 / (high / low).ln(), 1),
        };
        let contours = look.contours.unwrap_or(Contours {
            interval: 0.0,
            base: 0.0,
            major: 0,
            width: 1.0,
            color: [0.0; 3],
            labels: None,
        });
        // Another line with the same strength, near the reference.
        let period = contours.interval * f64::from(contours.major.max(1));
        let contour_base = match period > 0.0 {
            true => (contours.base - job.reference) - ((contours.base - job.reference) / period).round() * period,
            false => 0.0,
        };
        SurfaceUniform {
            contour_color: contours.color,
            contour_major: contours.major,
            origin: camera(at_anchor),
            focal: focal as f32,
            per_column: axes[0],
            // A thousandth of a sample before the eye.
            near: if is_perspective { (1e-3 * x.min(y)) as f32 } else { 0.0 },
            per_row: axes[1],
            perspective: u32::from(is_perspective),
            per_height: axes[2],
            parts: job.parts,
            eye: grid(-at_anchor),
            stride,
            right: grid(view.right),
            spacing: x.max(y) as f32,
            up: grid(view.up),
            fade_start: cut.fade_start as f32,
            forward: grid(view.forward),
            fade_rate: cut.fade_rate as f32,
            world_right: view.right.as_vec3().to_array(),
            clips: u32::from(cut.clips()),
            world_up: view.up.as_vec3().to_array(),
            point_side: job.technique.side(job.point, job.parts),
            world_forward: view.forward.as_vec3().to_array(),
            lone_side: job.parts,
            clip_min: (cut.bounds.min - view.eye).max(DVec3::splat(-1e37)).as_vec3().to_array(),
            colored_by: match look.attribute {
                Attribute::Height => constants::BY_HEIGHT,
                Attribute::Residual => constants::BY_RESIDUAL,
                Attribute::Difference => constants::BY_DIFFERENCE,
                Attribute::Slope => constants::BY_SLOPE,
                Attribute::Aspect => constants::BY_ASPECT,
                Attribute::Curvature => constants::BY_CURVATURE,
                Attribute::Level => constants::BY_LEVEL,
                Attribute::Primitive => constants::BY_PRIMITIVE,
                Attribute::Plane(_) => constants::BY_PLANE,
                Attribute::Texture(_) => constants::BY_TEXTURE,
                Attribute::Photo => constants::BY_PHOTO,
            },
            clip_max: (cut.bounds.max - view.eye).min(DVec3::splat(1e37)).as_vec3().to_array(),
            ramp_last: ramp.saturating_sub(1),
            sun: sun.unwrap_or_default().as_vec3().to_array(),
            is_sun: u32::from(sun.is_some()),
            size: [view.width, view.height],
            middle: view.middle().map(|pixels| pixels as f32),
            anchor: anchor.map(|at| at as i32),
            last: placed.samples.map(|samples| (samples - 1) as u32),
            step: [x as f32, y as f32],
            low: low as f32,
            per: per_value as f32,
            is_log,
            reference: job.reference as f32,
            ambient: look.ambient,
            steeper: (placed.lift / placed.true_lift) as f32,
            true_lift: placed.true_lift as f32,
            contour_interval: contours.interval as f32,
            contour_base: contour_base as f32,
            contour_width: contours.width as f32,
            far: far_of(scene, view) as f32,
            tree: list.tree,
            top: u32::from(scene.lattice.top()),
            has_form: u32::from(job.form.is_some()),
            pole_at: list.poles,
            pole_height: scene.poles.map(|pole| pole.map_or(0.0, |pole| counted(pole.height, job.reference))),
            pole_rows,
            turn: placed.step.map(|degrees| degrees.to_radians() as f32),
            open: (placed.samples[0] - 1 - closes) as u32,
            latitude: on_globe.as_ref().map_or(0.0, Anchor::latitude) as f32,
            radius: on_globe.as_ref().map_or(0.0, Anchor::radius) as f32,
            lift: placed.lift as f32,
            lengths: placed.lengths().map(|length| length as f32),
            photo_size: photo.size,
            photo_anchor: photo.anchor,
            photo_at: photo.at,
            photo_per: photo.per,
            photo_rows: photo.rows,
            photo_columns: photo.columns,
            photo_period: photo.period,
            photo_is_endless: photo.is_endless,
            photo_light: list.photo.light,
            photo_table: list.photo.table,
            photo_levels: list.photo.levels,
            rim_width: match job.holes {
                Holes::Outlined(width) => (width * f64::from(job.parts)) as f32,
                Holes::Open | Holes::Filled(_) => 0.0,
            },
            box_min: ends(f64::min),
            wall_base: (job.walls.unwrap_or(job.reference) - job.reference) as f32,
            box_max: ends(f64::max),
            spans: job.holes.spans(placed).into_iter().fold(0.0, f64::max).min(1e37) as f32,
            limb: limb.map_or([0.0; 3], |limb| camera(limb.normal)),
            limb_away: limb.map_or(0.0, |limb| limb.away as f32),
            equator: equator as f32,
            squared_eccentricity: squared_eccentricity as f32,
            lifted: on_globe.as_ref().map_or(0.0, |anchor| anchor.lifted) as f32,
            goes_round: u32::from(placed.around == Some(placed.samples[0] - 1)),
        }
    }
}

/// Column and row of the sample that is nearest to an eye among those of the drawn chunks of a flat field.
fn anchor_of(scene: &Scene, eye: DVec3) -> [u64; 2] {
    let (placed, ends) = (&scene.placed, drawn_ends(scene));
    std::array::from_fn(|axis| {
        let nearest = ((eye[axis] - placed.origin[axis]) / placed.step[axis]).round();
        nearest.clamp(ends[axis][0], ends[axis][1]) as u64
    })
}

/// A depth beyond all chunks.
fn far_of(scene: &Scene, view: &View) -> f64 {
    let corners = |mesh: &Mesh| {
        let bounds = mesh.node.extent.bounds;
        let pick = |corner: usize, axis: usize| [bounds.min, bounds.max][corner >> axis & 1][axis];
        (0..8)
            .map(|corner| view.to_camera(DVec3::new(pick(corner, 0), pick(corner, 1), pick(corner, 2))).z)
            .fold(0.0, f64::max)
    };
    2.0 * scene.meshes.iter().map(corners).fold(0.0, f64::max).max(f64::MIN_POSITIVE)
}
