//! A run at any moment as a source: what its tracks say between two steps, read as a snapshot is.

use super::RunFile;
use super::track_layout::{Tangents, TrackFamily};
use crate::hierarchy::spacetime::{Interpolation, Moving};
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source};
use crate::model::{Moment, Unit, scale_factor_of};
use crate::store::error::StoreError;
use rayon::prelude::*;
use std::ops::Range;

/// The particles of a run at a moment, in memory.
pub struct RunSnapshot {
    about: Description,
    families: Vec<Moving>,
}

/// Which of [`Moving`]'s columns a field is.
const COLUMNS: [(&str, FieldKind, usize); 6] = [
    ("position", FieldKind::Position, 3),
    ("velocity", FieldKind::Velocity, 3),
    ("mass", FieldKind::Mass, 1),
    ("smoothing-length", FieldKind::SmoothingLength, 1),
    ("density", FieldKind::Density, 1),
    ("id", FieldKind::Id, 1),
];

impl RunFile {
    /// The particles at a moment, as `interpolation` moves them between the steps around it. At a step that is where the tracks begin
    /// which go on from there; at the last one, where those end that came there.
    ///
    /// # Errors
    /// Where the run has no tracks, or they cannot be read or are damaged.
    pub fn at(&self, moment: Moment, interpolation: Interpolation) -> Result<RunSnapshot, StoreError> {
        let layout = self.tracks()?;
        let last = self.directory().intervals.len();
        let (number, u) = if moment.step >= last { (last - 1, 1.0) } else { (moment.step, moment.u) };
        // What stands still at the last step is that step.
        let interpolation = match interpolation {
            Interpolation::Hold if u >= 1.0 => Interpolation::Hermite,
            other => other,
        };
        let interval = self.interval(number)?;
        let held = if interpolation == Interpolation::Hold { Moment { u: 0.0, ..moment } } else { moment };
        let time = self.time(held);
        let still = self.still(number)?;
        let redshift = self.redshift(held);
        let scale_factor = self.directory().is_comoving().then(|| redshift.and_then(scale_factor_of)).flatten();
        let factor = layout.velocity_factor(self.directory().clock, time, scale_factor);
        let mut about = Description {
            length_unit: self.directory().length_unit.clone(),
            mass_unit: self.directory().mass_unit.clone(),
            kernel: still.metadata().kernel,
            time: Some(time),
            redshift,
            scale_factor,
            cosmology: layout.cosmology,
            motion: layout.motion,
            box_size: self.directory().box_size,
            ..Description::unitless(self.path(), "deepfield-run", self.bytes())
        };
        let mut families = Vec::new();
        for (family, info) in layout.families.iter().enumerate() {
            let index = self.track_index(number, family)?;
            let rules = info.rules();
            // Tracks without tangents are straight.
            let interpolation = match (info.tangents, interpolation) {
                (Tangents::None, Interpolation::Auto | Interpolation::Hermite) => Interpolation::Linear,
                (_, interpolation) => interpolation,
            };
            let parts = index.leaves.par_iter().map(|leaf| {
                let tracks = self.track_leaf(number, family, leaf, true)?;
                let mut moving = Moving::default();
                tracks.at(&interval, u, interpolation, &rules, &mut moving);
                Ok(moving)
            });
            let parts: Vec<Moving> = parts.collect::<Result<_, StoreError>>()?;
            let mut moving = joined(parts, rules.len());
            let stored = 1.0 / (factor * info.velocity_scale);
            moving.velocities.par_iter_mut().flatten().for_each(|v| *v *= stored);
            if !moving.ids.is_empty() {
                about.families.push(described(info, &moving, &about));
                families.push(moving);
            }
        }
        Ok(RunSnapshot { about, families })
    }
}

impl RunSnapshot {
    /// The ids of a family's particles, or their rows where they have none.
    pub fn ids(&self, family: usize) -> &[u64] {
        self.families.get(family).map_or(&[], |family| &family.ids)
    }

    /// Mass of what fades from place to place.
    pub fn faded_mass(&self) -> f64 {
        self.families.iter().map(|family| family.faded_mass).sum()
    }
}

/// All parts, one after the other.
fn joined(parts: Vec<Moving>, attributes: usize) -> Moving {
    let count = parts.iter().map(|part| part.ids.len()).sum();
    let mut all = Moving { attributes: vec![Vec::with_capacity(count); attributes], ..Moving::default() };
    all.ids.reserve_exact(count);
    all.positions.reserve_exact(count);
    all.velocities.reserve_exact(count);
    [&mut all.mass, &mut all.density, &mut all.smoothing_length]
        .into_iter()
        .for_each(|column| column.reserve_exact(count));
    for part in parts {
        all.ids.extend(part.ids);
        all.positions.extend(part.positions);
        all.velocities.extend(part.velocities);
        all.mass.extend(part.mass);
        all.density.extend(part.density);
        all.smoothing_length.extend(part.smoothing_length);
        all.attributes.iter_mut().zip(part.attributes).for_each(|(all, part)| all.extend(part));
        all.faded_mass += part.faded_mass;
    }
    all
}

/// What a family says of itself.
fn described(info: &TrackFamily, moving: &Moving, about: &Description) -> FamilyInfo {
    let unit = |kind| match kind {
        FieldKind::Position | FieldKind::SmoothingLength => about.length_unit.clone(),
        FieldKind::Mass => about.mass_unit.clone(),
        FieldKind::Velocity => info.velocity_unit.clone(),
        _ => Unit::default(),
    };
    let has_ids = |kind| kind != FieldKind::Id || info.has_ids;
    let columns = COLUMNS.into_iter().filter(|(_, kind, _)| has_ids(*kind));
    let mut fields: Vec<Field> = columns
        .map(|(name, kind, components)| Field {
            name: name.into(),
            stored_as: name.into(),
            unit: unit(kind),
            components,
            kind,
        })
        .collect();
    fields.extend(info.attributes.iter().map(|(name, unit)| Field {
        name: name.clone(),
        stored_as: name.clone(),
        unit: unit.clone(),
        components: 1,
        kind: FieldKind::Other,
    }));
    FamilyInfo { name: info.name, count: moving.ids.len() as u64, fields }
}

impl Source for RunSnapshot {
    fn description(&self) -> &Description {
        &self.about
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let found = self.about.check_range(family, field, &range, out.len())?;
        let moving = &self.families[family];
        let rows = range.start as usize..range.end as usize;
        let scalars = |column: &[f32], out: &mut [f64]| {
            out.iter_mut().zip(&column[rows.clone()]).for_each(|(out, value)| *out = f64::from(*value));
        };
        match found.kind {
            FieldKind::Position => out.copy_from_slice(moving.positions[rows].as_flattened()),
            FieldKind::Velocity => out.copy_from_slice(moving.velocities[rows].as_flattened()),
            FieldKind::Mass => scalars(&moving.mass, out),
            FieldKind::SmoothingLength => scalars(&moving.smoothing_length, out),
            FieldKind::Density => scalars(&moving.density, out),
            FieldKind::Id => {
                out.iter_mut().zip(&moving.ids[rows]).for_each(|(out, id)| *out = *id as f64);
            }
            FieldKind::Other => {
                let fields = &self.about.families[family].fields;
                let number = fields[..field].iter().filter(|field| field.kind == FieldKind::Other).count();
                scalars(&moving.attributes[number], out);
            }
        }
        Ok(())
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        self.about.check_range(family, field, &range, out.len())?;
        out.copy_from_slice(&self.families[family].ids[range.start as usize..range.end as usize]);
        Ok(())
    }
}
