//! What `deepfield info` says about a page file: the table of F12 4.1 for each family, the quantiser's errors, and all of
//! it as JSON.

use super::info::shown_redshift;
use super::probe::short;
use super::text_of;
use crate::codec::{CodeBits, Codebook, CodebookScope};
use crate::store::{ClusterLevel, ClusterTree, FamilyMetadata, LevelInfo, Metadata, PageFile};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The facts as JSON, with the fields that a source's have, and `pages`, `bytes_per_particle`, and for each family
/// `levels` and `codebooks`.
pub fn json(file: &PageFile) -> Value {
    let metadata = file.metadata();
    let provenance = &metadata.provenance;
    json!({
        "kind": "particles",
        "format": "deepfield",
        "bytes": file.bytes(),
        "pages": file.page_count(),
        "particles": metadata.particles(),
        "bytes_per_particle": bytes_per_particle(file),
        "vq_bits": metadata.bits.entries.bits(),
        "leaf_bits": metadata.bits.leaves.bits(),
        "length_unit": metadata.length_unit,
        "mass_unit": metadata.mass_unit,
        "kernel": metadata.kernel,
        "bounds": metadata.bounds(),
        "skipped": metadata.skipped,
        "source": provenance,
        "time": provenance.time,
        "redshift": provenance.redshift,
        "box_size": provenance.box_size,
        "notes": provenance.notes,
        "hierarchies": hierarchies(metadata),
        "levels": metadata.families.iter().map(|family| family.levels.len()).max(),
        "families": metadata.families.iter().map(family_json).collect::<Vec<_>>(),
    })
}

fn family_json(family: &FamilyMetadata) -> Value {
    let fields = family.quantities.iter().chain(&family.attributes);
    json!({
        "name": family.name,
        "count": family.count,
        "mass": family.mass,
        "bounds": family.bounds,
        "fields": fields.map(|field| json!({
            "name": field.name,
            "unit": field.unit,
            "min": field.min,
            "max": field.max,
            "mean": field.mean,
            "missing": field.missing,
        })).collect::<Vec<_>>(),
        "levels": family.levels.iter().map(level_json).collect::<Vec<_>>(),
        "volume_levels": family.volume.as_ref().map(|tree| tree.levels.iter().map(level_json).collect::<Vec<_>>()),
        "clusters": family.clusters.as_ref().map(ClusterTree::finest),
        "cluster_levels": family.clusters.as_ref().map(|tree| tree.levels.iter().map(cluster_level_json).collect::<Vec<_>>()),
        "shape_bits": family.clusters.as_ref().map(|tree| tree.shape_bits),
        "column_error": family.column_error,
        "codebooks": family.codebooks.iter().map(|codebook| codebook_json(family, codebook)).collect::<Vec<_>>(),
    })
}

fn level_json(level: &LevelInfo) -> Value {
    json!({
        "depth": level.depth,
        "nodes": level.nodes(),
        "grid_nodes": level.grid_nodes,
        "leaf_nodes": level.leaf_nodes,
        "relay_nodes": level.relay_nodes,
        "input": level.input,
        "merged": level.merged,
        "skipped": level.skipped,
        "relayed": level.relayed,
        "sprites": level.sprites,
        "points": level.points,
        "leaf_particles": level.leaf_particles,
        "particles": level.particles(),
        "average": average(level),
        "bytes": level.bytes,
    })
}

/// What the kinds of hierarchies over its leaves are called.
pub fn hierarchies(metadata: &Metadata) -> Vec<&'static str> {
    metadata.hierarchies().into_iter().map(|kind| kind.name).collect()
}

fn cluster_level_json(level: &ClusterLevel) -> Value {
    json!({
        "depth": level.depth,
        "nodes": level.nodes,
        "clusters": level.clusters,
        "finest": level.finest,
        "size": level.size,
        "misfit": level.misfit,
        "bytes": level.bytes,
    })
}

fn codebook_json(family: &FamilyMetadata, codebook: &Codebook) -> Value {
    json!({
        "scope": scope(codebook),
        "entries": codebook.len(),
        "particles": codebook.particles,
        "errors": error_names(family).zip(&codebook.errors).map(|(name, error)| json!({
            "field": name,
            "mean_relative": error.mean,
            "max_relative": error.max,
        })).collect::<Vec<_>>(),
    })
}

/// The facts as a table for people.
pub fn table(file: &PageFile) -> String {
    text_of(|text| write_table(text, file))
}

fn write_table(text: &mut String, file: &PageFile) -> std::fmt::Result {
    let metadata = file.metadata();
    let provenance = &metadata.provenance;
    writeln!(
        text,
        "deepfield page file, {} bytes in {} pages: {} particles, {:.2} bytes each, {}",
        file.bytes(),
        file.page_count(),
        metadata.particles(),
        bytes_per_particle(file),
        codes(metadata.bits)
    )?;
    writeln!(text, "source: {} ({}, {} bytes)", provenance.path.display(), provenance.format, provenance.bytes)?;
    writeln!(text, "hierarchies: {}", hierarchies(metadata).join(", "))?;
    writeln!(text, "length unit: {}, mass unit: {}", metadata.length_unit, metadata.mass_unit)?;
    let redshift = shown_redshift(provenance.redshift);
    for (name, value) in [("time", provenance.time), ("redshift", redshift), ("box", provenance.box_size)] {
        if let Some(value) = value {
            writeln!(text, "{name}: {}", short(value))?;
        }
    }
    for skipped in &metadata.skipped {
        writeln!(text, "left out: {} particles, {}", skipped.count, skipped.reason)?;
    }
    provenance.notes.iter().try_for_each(|note| writeln!(text, "note: {note}"))?;
    metadata.families.iter().try_for_each(|family| write_family(text, family))
}

fn write_family(text: &mut String, family: &FamilyMetadata) -> std::fmt::Result {
    writeln!(text, "\n{}: {} particles, mass {}", family.name, family.count, family.mass)?;
    writeln!(text, "  {:<28} {:<24} {:>14} {:>14} {:>14}", "field", "unit", "min", "max", "mean")?;
    for field in family.quantities.iter().chain(&family.attributes) {
        let unit = field.unit.to_string();
        let [min, max, mean] = [field.min, field.max, field.mean].map(|value| format!("{value:.6e}"));
        writeln!(text, "  {:<28} {unit:<24} {min:>14} {max:>14} {mean:>14}", field.name)?;
        if field.missing > 0 {
            writeln!(
                text,
                "  {:<28} {} values were not finite in single precision; the mean stands for them",
                "", field.missing
            )?;
        }
    }
    write_levels(text, &family.levels)?;
    if let Some(volume) = &family.volume {
        writeln!(text, "  levels for volumes, over the same leaves:")?;
        write_levels(text, &volume.levels)?;
    }
    if let Some(clusters) = &family.clusters {
        write_clusters(text, clusters)?;
    }
    writeln!(text, "  relative error of vector quantisation, average / maximum:")?;
    // The leaves may share several codebooks: one line for all.
    for codebooks in family.codebooks.chunk_by(|a, b| a.scope == b.scope) {
        let Some(first) = codebooks.first() else { continue };
        let entries: usize = codebooks.iter().map(Codebook::len).sum();
        write!(text, "  {:>9} {entries:>6} entries", scope(first))?;
        let particles: u64 = codebooks.iter().map(|codebook| codebook.particles).sum();
        for (index, name) in error_names(family).enumerate() {
            let errors =
                || codebooks.iter().filter_map(|codebook| Some((codebook.particles, codebook.errors.get(index)?)));
            let sum: f64 = errors().map(|(particles, error)| particles as f64 * error.mean).sum();
            let max = errors().map(|(_, error)| error.max).fold(0.0, f64::max);
            write!(text, "  {name} {:.2} % / {:.1} %", 100.0 * sum / particles.max(1) as f64, 100.0 * max)?;
        }
        writeln!(text)?;
    }
    if let Some(error) = family.column_error {
        writeln!(
            text,
            "  column density of the box at 1024 pixels, by the codes of leaves: about {:.2} % off",
            100.0 * error
        )?;
    }
    Ok(())
}

/// What codes have how many bits.
fn codes(bits: CodeBits) -> String {
    match bits.is_refined() {
        true => format!("{}-bit codes, {}-bit ones in leaves", bits.entries, bits.leaves),
        false => format!("{}-bit codes", bits.entries),
    }
}

/// The clusters of each depth.
fn write_clusters(text: &mut String, clusters: &ClusterTree) -> std::fmt::Result {
    let shapes = clusters.book.shapes.entries.len();
    writeln!(text, "  clusters, over the same leaves: {} finest ones, {shapes} shapes", clusters.finest())?;
    writeln!(
        text,
        "  {:>5} {:>9} {:>11} {:>11} {:>13} {:>8} {:>12}",
        "level", "nodes", "clusters", "of leaves", "mean size", "misfit", "bytes"
    )?;
    for ClusterLevel { depth, nodes, clusters, finest, size, misfit, bytes } in &clusters.levels {
        writeln!(text, "  {depth:>5} {nodes:>9} {clusters:>11} {finest:>11} {size:>13.6e} {misfit:>8.3} {bytes:>12}")?;
    }
    Ok(())
}

/// The table of F12 4.1.
fn write_levels(text: &mut String, levels: &[LevelInfo]) -> std::fmt::Result {
    writeln!(
        text,
        "  {:>5} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>7} {:>6} {:>10} {:>12}",
        "level",
        "merged",
        "skipped",
        "sprites",
        "points",
        "in leaves",
        "particles",
        "passed on",
        "nodes",
        "relays",
        "average",
        "bytes"
    )?;
    for level in levels {
        writeln!(
            text,
            "  {:>5} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>11} {:>7} {:>6} {:>10.1} {:>12}",
            level.depth,
            level.merged,
            level.skipped,
            level.sprites,
            level.points,
            level.leaf_particles,
            level.particles(),
            level.relayed,
            level.nodes(),
            level.relay_nodes,
            average(level),
            level.bytes
        )?;
    }
    Ok(())
}

fn bytes_per_particle(file: &PageFile) -> f64 {
    file.bytes() as f64 / file.metadata().particles().max(1) as f64
}

/// Particles in a node that holds any.
fn average(level: &LevelInfo) -> f64 {
    level.particles() as f64 / (level.grid_nodes + level.leaf_nodes).max(1) as f64
}

fn scope(codebook: &Codebook) -> String {
    match codebook.scope {
        CodebookScope::Leaves => "leaves".into(),
        CodebookScope::Depth(depth) => format!("level {depth}"),
        CodebookScope::VolumeDepth(depth) => format!("volume {depth}"),
        CodebookScope::Clusters => "clusters".into(),
    }
}

/// Names in the order of [`Codebook::errors`].
fn error_names(family: &FamilyMetadata) -> impl Iterator<Item = &str> {
    family.quantities.iter().chain(&family.attributes).map(|field| field.name.as_str())
}
