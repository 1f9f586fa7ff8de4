//! Generated particles as a source in memory and as a page file, and membership by brute force.

use crate::support::Random;
use deepfield::build::{BuildOptions, build};
use deepfield::explore::{Lasso, LassoProjection, Region, Shape};
use deepfield::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::store::PageFile;
use glam::DVec3;
use proptest::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Edge of the box that the particles are in.
pub const EDGE: f64 = 100.0;

/// One particle, with all that is known of it.
#[derive(Clone, Copy, Debug)]
pub struct Particle {
    pub family: FamilyName,
    pub id: u64,
    pub at: DVec3,
    pub velocity: DVec3,
    pub mass: f64,
    pub h: f64,
    pub density: f64,
    pub temperature: f64,
}

/// Gas and dark matter, half of it in clumps, some of those across the faces of the box. Ids do not fit into a double.
pub fn particles() -> &'static [Particle] {
    static PARTICLES: OnceLock<Vec<Particle>> = OnceLock::new();
    PARTICLES.get_or_init(|| {
        let mut random = Random(5);
        let clumps: Vec<DVec3> =
            (0..9).map(|_| EDGE * DVec3::new(random.next(), random.next(), random.next())).collect();
        (0..6000)
            .map(|i| {
                let family = if i < 4000 { FamilyName::Gas } else { FamilyName::Dark };
                let mut any = || DVec3::new(random.next(), random.next(), random.next());
                let at = if i % 2 == 0 { EDGE * any() } else { clumps[i % 9] + 12.0 * (any() - 0.5) * any().x };
                let at = (at - EDGE * (at / EDGE).floor()).clamp(DVec3::ZERO, DVec3::splat(EDGE));
                let velocity = 400.0 * (any() - 0.5) + DVec3::new(100.0, 0.0, -50.0);
                let single = |value: f64| f64::from(value as f32);
                let h = single(0.1 + random.next());
                Particle {
                    family,
                    id: (1 << 60) + (random.whole() >> 44) * 8192 + i as u64,
                    at,
                    velocity,
                    mass: single(1.0 + (i % 3) as f64 * 0.25),
                    h,
                    density: single(h.powi(-3)),
                    temperature: single(10f64.powf(3.0 + 3.0 * random.next())),
                }
            })
            .collect()
    })
}

/// The particles as a source. `reversed`: with its rows in reversed order, as another snapshot may have them.
pub struct Memory {
    description: Description,
    rows: Vec<Vec<Particle>>,
}

impl Memory {
    pub fn new(reversed: bool) -> Memory {
        let mut description = Description {
            length_unit: Unit::new("kpc"),
            mass_unit: Unit::new("Msun"),
            box_size: Some(EDGE),
            ..Description::unitless(Path::new("memory"), "memory", 0)
        };
        let mut rows = Vec::new();
        for name in [FamilyName::Gas, FamilyName::Dark] {
            let mut own: Vec<Particle> = particles().iter().filter(|p| p.family == name).copied().collect();
            if reversed {
                own.reverse();
            }
            let field = |name: &str, unit: &str, components, kind| Field {
                name: name.into(),
                stored_as: name.to_uppercase(),
                unit: Unit::new(unit),
                components,
                kind,
            };
            let mut fields = vec![
                field("position", "kpc", 3, FieldKind::Position),
                field("velocity", "km/s", 3, FieldKind::Velocity),
                field("mass", "Msun", 1, FieldKind::Mass),
                field("smoothing-length", "kpc", 1, FieldKind::SmoothingLength),
                field("density", "", 1, FieldKind::Density),
                field("id", "", 1, FieldKind::Id),
            ];
            if name == FamilyName::Gas {
                fields.push(field("temperature", "K", 1, FieldKind::Other));
            }
            description.families.push(FamilyInfo { name, count: own.len() as u64, fields });
            rows.push(own);
        }
        Memory { description, rows }
    }
}

impl Source for Memory {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let found = self.description.check_range(family, field, &range, out.len())?;
        let rows = &self.rows[family][range.start as usize..range.end as usize];
        for (particle, out) in rows.iter().zip(out.chunks_mut(found.components)) {
            match found.name.as_str() {
                "position" => out.copy_from_slice(&particle.at.to_array()),
                "velocity" => out.copy_from_slice(&particle.velocity.to_array()),
                "mass" => out[0] = particle.mass,
                "smoothing-length" => out[0] = particle.h,
                "density" => out[0] = particle.density,
                "temperature" => out[0] = particle.temperature,
                other => panic!("{other} is not read as numbers"),
            }
        }
        Ok(())
    }

    fn read_ids(&self, family: usize, _: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let rows = &self.rows[family][range.start as usize..range.end as usize];
        out.iter_mut().zip(rows).for_each(|(out, particle)| *out = particle.id);
        Ok(())
    }
}

/// The particles as a page file.
pub fn page_file() -> &'static PageFile {
    static FILE: OnceLock<(TempDir, PageFile)> = OnceLock::new();
    let (_, file) = FILE.get_or_init(|| {
        let family = |name: FamilyName| {
            let own: Vec<&Particle> = particles().iter().filter(|p| p.family == name).collect();
            let column = |of: fn(&Particle) -> f64| own.iter().map(|p| of(p) as f32).collect::<Vec<f32>>();
            let mut attributes = Vec::new();
            if name == FamilyName::Gas {
                let values = column(|p| p.temperature);
                attributes.push(Attribute { name: "temperature".into(), unit: Unit::new("K"), values });
            }
            for (axis, name) in ["velocity-x", "velocity-y", "velocity-z"].into_iter().enumerate() {
                let values = own.iter().map(|p| p.velocity[axis] as f32).collect();
                attributes.push(Attribute { name: name.into(), unit: Unit::new("km/s"), values });
            }
            Family {
                name,
                positions: own.iter().map(|p| p.at.to_array()).collect(),
                mass: column(|p| p.mass),
                smoothing_length: column(|p| p.h),
                density: column(|p| p.density),
                attributes,
            }
        };
        let dataset = Dataset {
            families: vec![family(FamilyName::Gas), family(FamilyName::Dark)],
            length_unit: Unit::new("kpc"),
            mass_unit: Unit::new("Msun"),
            kernel: Kernel::CubicSpline,
            skipped: Vec::new(),
            provenance: Provenance { box_size: Some(EDGE), ..Provenance::default() },
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("particles.df");
        let mut options = BuildOptions::default();
        // Small leaves, so that there are many.
        options.octree.leaf_capacity = 64;
        build(dataset, &options, &path, &()).unwrap();
        let file = PageFile::open(&path).unwrap();
        (folder, file)
    });
    file
}

/// Membership by looking at every image of a particle, and by projecting it by hand.
pub fn is_inside(region: &Region, particle: &Particle, periodic: bool) -> bool {
    let in_shapes = region.shapes.iter().all(|shape| in_shape(shape, particle.at, periodic));
    let in_ranges = region.ranges.iter().all(|range| {
        let value = match range.field.as_str() {
            "mass" => particle.mass,
            "density" => particle.density,
            "smoothing-length" => particle.h,
            "temperature" if particle.family == FamilyName::Gas => particle.temperature,
            "temperature" => return false,
            other => panic!("{other}"),
        };
        range.min.is_none_or(|min| value >= min) && range.max.is_none_or(|max| value <= max)
    });
    in_shapes && in_ranges && (region.families.is_empty() || region.families.contains(&particle.family))
}

fn in_shape(shape: &Shape, at: DVec3, periodic: bool) -> bool {
    let images = if periodic { -1..=1 } else { 0..=0 };
    let images = || images.clone().map(|n| f64::from(n) * EDGE);
    let any = |test: &dyn Fn(DVec3) -> bool| {
        images().any(|x| images().any(|y| images().any(|z| test(at + DVec3::new(x, y, z)))))
    };
    match shape {
        Shape::Sphere { center, radius } => any(&|at| at.distance(*center) <= *radius),
        Shape::Box { min, max } => any(&|at| at.cmpge(*min).all() && at.cmple(*max).all()),
        Shape::Lasso(lasso) => in_lasso(lasso, at),
    }
}

fn in_lasso(lasso: &Lasso, at: DVec3) -> bool {
    let forward = (lasso.target - lasso.eye).normalize();
    let right = forward.cross(lasso.up).normalize();
    let up = right.cross(forward);
    let offset = at - lasso.eye;
    let depth = offset.dot(forward);
    let (width, height) = (f64::from(lasso.size.0), f64::from(lasso.size.1));
    let scale = match lasso.projection {
        LassoProjection::Perspective { fov_deg } => height / (2.0 * (0.5 * fov_deg).to_radians().tan()) / depth,
        LassoProjection::Orthographic { height: world } => height / world,
    };
    let (x, y) = (0.5 * width + offset.dot(right) * scale, 0.5 * height - offset.dot(up) * scale);
    let mut inside = false;
    for (i, &(xi, yi)) in lasso.polygon.iter().enumerate() {
        let (xj, yj) = lasso.polygon[(i + 1) % lasso.polygon.len()];
        if (yi > y) != (yj > y) && x < (xj - xi) * (y - yi) / (yj - yi) + xi {
            inside = !inside;
        }
    }
    let in_front = matches!(lasso.projection, LassoProjection::Orthographic { .. }) || depth > 0.0;
    inside && in_front && lasso.near.is_none_or(|near| depth >= near) && lasso.far.is_none_or(|far| depth <= far)
}

/// Any shape that may have particles.
pub fn shape() -> impl Strategy<Value = Shape> {
    let place = || prop::array::uniform3(0.0..EDGE).prop_map(DVec3::from_array);
    let corner = (-50.0..850.0_f64, -50.0..650.0_f64);
    let projection = prop_oneof![
        (20.0..90.0_f64).prop_map(|fov_deg| LassoProjection::Perspective { fov_deg }),
        (50.0..200.0_f64).prop_map(|height| LassoProjection::Orthographic { height }),
    ];
    let lasso = (place(), place(), projection, prop::collection::vec(corner, 3..12), prop::option::of(10.0..60.0_f64));
    prop_oneof![
        (place(), 2.0..49.0_f64).prop_map(|(center, radius)| Shape::Sphere { center, radius }),
        (place(), prop::array::uniform3(5.0..80.0_f64))
            .prop_map(|(min, size)| Shape::Box { min, max: min + DVec3::from_array(size) }),
        lasso.prop_map(|(eye, target, projection, polygon, near)| Shape::Lasso(Lasso {
            eye: eye * 1.5,
            target,
            up: DVec3::new(0.1, 1.0, 0.05),
            projection,
            size: (800, 600),
            polygon,
            near,
            far: near.map(|near| near + 40.0),
        })),
    ]
}

/// Any region: up to two shapes, ranges of values, a family.
pub fn region() -> impl Strategy<Value = Region> {
    let range = prop_oneof![
        (3.0..5.0_f64, 0.2..2.0_f64).prop_map(|(from, width)| (
            "temperature",
            10f64.powf(from),
            10f64.powf(from + width)
        )),
        (0.1..0.8_f64, 0.1..0.5_f64).prop_map(|(from, width)| ("smoothing-length", from, from + width)),
        Just(("mass", 1.1, 1.6)),
    ];
    let family = prop_oneof![2 => Just(None), 1 => Just(Some(FamilyName::Gas)), 1 => Just(Some(FamilyName::Dark))];
    (prop::collection::vec(shape(), 0..3), prop::option::of(range), family).prop_map(|(shapes, range, family)| {
        let region = Region { shapes, ..Region::default() };
        let region = match range {
            Some((field, min, max)) => region.with_range(field, Some(min), Some(max)),
            None => region,
        };
        family.into_iter().fold(region, Region::with_family)
    })
}
