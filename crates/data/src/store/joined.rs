//! Several page files as one scene.

use super::error::StoreError;
use super::metadata::{AttributeInfo, FamilyMetadata, Metadata};
use super::page::PageId;
use super::page_file::{PageFile, Part};
use crate::codec::Codebook;
use crate::model::{Placement, ReadMethod, Unit};
use std::sync::Arc;

impl PageFile {
    /// The scene of several files, each where its placement says; units, kernel and provenance are those of the first. Also says what
    /// does not fit together, a sentence each.
    ///
    /// # Errors
    /// [`StoreError::Unjoinable`] where a placement cannot be used, or takes masses or lengths out of the range of 32-bit floats, or
    /// there are more pages than page numbers.
    pub fn join(files: Vec<(PageFile, Placement)>) -> Result<(PageFile, Vec<String>), StoreError> {
        let mut joined: Option<(PageFile, Metadata)> = None;
        let mut notes = Vec::new();
        let read = files.first().map(|(file, _)| file.read).unwrap_or_default();
        for (file, placement) in files {
            for part in file.parts {
                let own = Part { placement: part.placement.then(&placement), ..part };
                notes.extend(add(&mut joined, own)?);
            }
        }
        let Some((mut scene, metadata)) = joined else {
            return Err(StoreError::Unjoinable { path: Default::default(), reason: "no file is named".into() });
        };
        scene.metadata = Arc::new(metadata);
        scene.read = read;
        Ok((scene, notes))
    }
}

/// Adds a file to the scene; the first is the scene.
fn add(scene: &mut Option<(PageFile, Metadata)>, part: Part) -> Result<Vec<String>, StoreError> {
    let own = Arc::clone(part.reader.metadata());
    let unjoinable = |reason: &str| StoreError::Unjoinable { path: part.reader.path().into(), reason: reason.into() };
    if !part.placement.is_valid() {
        return Err(unjoinable("it is to lie nowhere: offset and scale must be finite, the scale positive"));
    }
    let first_page = scene.as_ref().map_or(0, |(scene, _)| scene.page_count());
    let first_family = scene.as_ref().map_or(0, |(_, whole)| whole.families.len() as u32);
    if first_page.checked_add(part.reader.page_count()).is_none() {
        return Err(unjoinable("there are more pages than 32 bits can number"));
    }
    let families: Option<Vec<(FamilyMetadata, bool)>> =
        own.families.iter().map(|family| placed(family, first_page, &part.placement)).collect();
    let beyond = "its masses or lengths are beyond 32-bit numbers in the scene's units; a scale says otherwise";
    let (families, are_held): (Vec<_>, Vec<_>) = families.ok_or_else(|| unjoinable(beyond))?.into_iter().unzip();
    let mut notes = scene.as_ref().map_or_else(Vec::new, |(_, whole)| differences(whole, &own, &part));
    if are_held.contains(&true) {
        let path = part.reader.path().display();
        notes.push(format!("{path}: densities are beyond 32-bit numbers in the scene's units: modes that show them are wrong, others are not"));
    }
    let box_size = own.provenance.box_size.filter(|_| part.placement.is_here());
    let part = Part { first_page, first_family, ..part };
    match scene {
        None => {
            let mut whole = Metadata { families, ..own.as_ref().clone() };
            whole.provenance.box_size = box_size;
            *scene = Some((PageFile { metadata: own, parts: vec![part], read: ReadMethod::default() }, whole));
        }
        Some((scene, whole)) => {
            whole.families.extend(families);
            whole.skipped.extend(own.skipped.iter().cloned());
            // Periodic only as long as all of it is, in the same box.
            whole.provenance.box_size = whole.provenance.box_size.filter(|edge| box_size == Some(*edge));
            scene.parts.push(part);
        }
    }
    Ok(notes)
}

/// What of a file does not fit to the scene before it.
fn differences(whole: &Metadata, own: &Metadata, part: &Part) -> Vec<String> {
    let path = part.reader.path().display();
    let mut notes = Vec::new();
    let is_scaled = part.placement.scale != 1.0;
    let is_unlike = |here: &Unit, there: &Unit| here != there && here.ratio(there).is_none();
    if is_unlike(&own.length_unit, &whole.length_unit) && !is_scaled {
        let (here, there) = (&own.length_unit, &whole.length_unit);
        notes.push(format!("{path}: lengths in {here} are taken for {there}; a scale says otherwise"));
    }
    if is_unlike(&own.mass_unit, &whole.mass_unit) {
        notes.push(format!("{path}: masses in {} are taken for {}", own.mass_unit, whole.mass_unit));
    }
    if whole.kernel != own.kernel {
        notes
            .push(format!("{path}: drawn with the kernel of the first file, {:?}, not {:?}", whole.kernel, own.kernel));
    }
    notes
}

/// A family's metadata in the scene, and whether densities are held where 32-bit floats end; `None` where masses or lengths leave their range.
fn placed(family: &FamilyMetadata, first_page: u32, placement: &Placement) -> Option<(FamilyMetadata, bool)> {
    let mut placed = family.clone();
    placed.root_page = PageId(family.root_page.0 + first_page);
    if let Some(volume) = &mut placed.volume {
        volume.root_page = PageId(volume.root_page.0 + first_page);
    }
    if let Some(clusters) = &mut placed.clusters {
        clusters.root_page = PageId(clusters.root_page.0 + first_page);
    }
    if placement.is_here() {
        return Some((placed, false));
    }
    placed.mass *= placement.mass;
    placed.mass_density *= placement.mass * placement.density();
    placed.bounds = placement.bounds(family.bounds);
    placed.root = family.root.placed(placement);
    let factors = [placement.mass, placement.density(), placement.scale];
    for (info, factor) in placed.quantities.iter_mut().zip(factors) {
        scale_info(info, factor);
    }
    let mut is_held = false;
    for codebook in &mut placed.codebooks {
        let Codebook { mass, density, smoothing_length, .. } = codebook;
        for (column, factor) in [(mass, placement.mass), (smoothing_length, placement.scale)] {
            for value in column {
                *value = (f64::from(*value) * factor) as f32;
                if !value.is_normal() {
                    return None;
                }
            }
        }
        for value in density {
            let wanted = (f64::from(*value) * placement.density()) as f32;
            *value = placement.placed_density(*value);
            is_held |= *value != wanted;
        }
    }
    Some((placed, is_held))
}

fn scale_info(info: &mut AttributeInfo, factor: f64) {
    let histogram = &mut info.histogram;
    for value in [&mut info.min, &mut info.max, &mut info.mean, &mut histogram.min, &mut histogram.max] {
        *value *= factor;
    }
}
