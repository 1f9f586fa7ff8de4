//! The footer after its page table: metadata, attribute tables and codebooks as bytes and back. Files with an index of pages have version 7,
//! else files with nodes deeper than 14 version 6, else files whose codes of leaves are refined version 5, else files with families that are none of Gadget's, or with clusters,
//! version 4, else files with levels for volumes version 3, and all others version 2.

use super::error::Damage;
use super::layout::{DEPTH_BEFORE, VERSION, VERSION_DEEP, VERSION_NAMED, VERSION_REFINED, VERSION_VOLUME};
use super::metadata::{
    AttributeInfo, AttributeMerge, ClusterBook, ClusterLevel, ClusterTree, FamilyMetadata, Histogram, LevelInfo,
    Metadata, VolumeTree,
};
use super::page::PageId;
use super::wire::{Decoder, Encoder};
use crate::codec::clusters::shape_packing;
use crate::codec::refinement::STEPS;
use crate::codec::shapes::{COORDINATES, ShapeBook};
use crate::codec::{CodeBits, Codebook, CodebookScope, QuantityError, Refinement, VqBits};
use crate::hierarchy::RootCell;
use crate::model::{Bounds, FamilyName, Kernel, Provenance, Skipped, Unit};
use std::sync::Arc;

/// The bit that tells the scope of a codebook of levels for volumes.
const VOLUME_SCOPE: u8 = 1 << 7;

/// What tells that a codebook is that of clusters: no depth either.
const CLUSTER_SCOPE: u8 = u8::MAX - 1;

/// Bits that tell the kinds of levels of a family beside those for splats.
const VOLUME: u8 = 1;
const CLUSTERS: u8 = 2;

/// In place of a family's Gadget type: its name follows.
const NAMED: u8 = u8::MAX;

/// The first version that can hold a file whose page table the footer has.
pub(super) fn version(metadata: &Metadata) -> u32 {
    let any = |is: fn(&FamilyMetadata) -> bool| metadata.families.iter().any(is);
    let is_new = |family: &FamilyMetadata| family.name.gadget_type().is_none() || family.clusters.is_some();
    // All trees of a family have the same cells.
    if any(|family| family.levels.len() > usize::from(DEPTH_BEFORE) + 1) {
        return VERSION_DEEP;
    }
    if metadata.bits.is_refined() {
        return VERSION_REFINED;
    }
    match (any(is_new), any(|family| family.volume.is_some())) {
        (true, _) => VERSION_NAMED,
        (false, true) => VERSION_VOLUME,
        (false, false) => VERSION,
    }
}

/// The number that stands for a kernel.
fn kernel_code(kernel: Kernel) -> u8 {
    match kernel {
        Kernel::CubicSpline => 0,
        Kernel::Poly6 => 1,
        Kernel::QuarticSpline => 2,
        Kernel::QuinticSpline => 3,
        Kernel::WendlandC2 => 4,
        Kernel::WendlandC4 => 5,
        Kernel::WendlandC6 => 6,
    }
}

/// The footer's bytes after the page table in a file of this version, which can hold it.
pub(super) fn encode(metadata: &Metadata, version: u32) -> Vec<u8> {
    let mut out = Encoder::default();
    out.text(&metadata.length_unit.0);
    out.text(&metadata.mass_unit.0);
    out.u8(kernel_code(metadata.kernel));
    out.u8(metadata.bits.entries.bits());
    if version >= VERSION_REFINED {
        out.u8(metadata.bits.leaves.bits());
    }
    encode_provenance(&mut out, &metadata.provenance);
    out.u32(metadata.skipped.len() as u32);
    for skipped in &metadata.skipped {
        out.text(&skipped.reason);
        out.u64(skipped.count);
    }
    out.u32(metadata.families.len() as u32);
    for family in &metadata.families {
        encode_family(&mut out, family, version);
    }
    out.bytes
}

/// Reads what follows the page table in the footer of a file of this version.
pub(super) fn decode(bytes: &[u8], version: u32) -> Result<Metadata, Damage> {
    let mut input = Decoder::new(bytes, "footer");
    let length_unit = Unit(input.text("the length unit")?);
    let mass_unit = Unit(input.text("the mass unit")?);
    let code = input.u8("the kernel")?;
    let kernel = Kernel::ALL.into_iter().find(|&kernel| kernel_code(kernel) == code);
    let kernel = kernel.ok_or_else(|| Damage::new("footer", format!("kernel 0 to 6, found {code}")))?;
    let bits = decode_bits(&mut input, version)?;
    let provenance = decode_provenance(&mut input)?;
    let skipped = (0..input.count(12, "reasons of skipping")?)
        .map(|_| Ok(Skipped { reason: input.text("a reason")?, count: input.u64("a count")? }))
        .collect::<Result<_, Damage>>()?;
    let families = (0..input.count(100, "families")?).map(|_| decode_family(&mut input, version, bits));
    let families = families.collect::<Result<_, _>>()?;
    input.finish()?;
    Ok(Metadata { length_unit, mass_unit, kernel, bits, provenance, skipped, families })
}

fn decode_bits(input: &mut Decoder, version: u32) -> Result<CodeBits, Damage> {
    let one = |bits: u8| VqBits::try_from(bits).map_err(|error| Damage::new("footer", error));
    let plain = CodeBits::plain(one(input.u8("the index bits")?)?);
    if version < VERSION_REFINED {
        return Ok(plain);
    }
    let bits = CodeBits { leaves: one(input.u8("the bits of leaves' codes")?)?, ..plain };
    let refined = CodeBits::refined(plain.entries);
    if bits == plain || bits == refined {
        return Ok(bits);
    }
    let expected = format!("{} or {} bits of leaves' codes, found {}", plain.leaves, refined.leaves, bits.leaves);
    Err(Damage::new("footer", expected))
}

pub(super) fn encode_provenance(out: &mut Encoder, provenance: &Provenance) {
    out.text(&provenance.path.to_string_lossy());
    out.text(&provenance.format);
    out.u64(provenance.bytes);
    out.option_f64(provenance.time);
    out.option_f64(provenance.redshift);
    out.option_f64(provenance.box_size);
    out.u32(provenance.notes.len() as u32);
    for note in &provenance.notes {
        out.text(note);
    }
}

pub(super) fn decode_provenance(input: &mut Decoder) -> Result<Provenance, Damage> {
    Ok(Provenance {
        path: input.text("the source's path")?.into(),
        format: input.text("the source's format")?,
        bytes: input.u64("the source's size")?,
        time: input.option_f64("the time")?,
        redshift: input.option_f64("the redshift")?,
        box_size: input.option_f64("the box size")?,
        notes: (0..input.count(4, "notes")?).map(|_| input.text("a note")).collect::<Result<_, _>>()?,
    })
}

fn encode_family(out: &mut Encoder, family: &FamilyMetadata, version: u32) {
    out.u8(family.name.gadget_type().unwrap_or(NAMED));
    if family.name.gadget_type().is_none() {
        out.text(family.name.as_str());
    }
    out.u64(family.count);
    out.f64(family.mass);
    out.f64(family.mass_density);
    out.vec3(family.bounds.min);
    out.vec3(family.bounds.max);
    out.vec3(family.root.min);
    out.f64(family.root.size);
    out.u32(family.root_page.0);
    out.u32(family.attributes.len() as u32);
    for attribute in family.quantities.iter().chain(&family.attributes) {
        encode_attribute(out, attribute);
    }
    encode_levels(out, &family.levels);
    out.u32(family.codebooks.len() as u32);
    let mut refinements = family.refinements.iter();
    for codebook in &family.codebooks {
        let refinement = if codebook.scope == CodebookScope::Leaves { refinements.next() } else { None };
        encode_codebook(out, codebook, refinement);
    }
    if version >= VERSION_REFINED {
        out.option_f64(family.column_error);
    }
    if version >= VERSION_VOLUME {
        let volume = if family.volume.is_some() { VOLUME } else { 0 };
        out.u8(volume | if family.clusters.is_some() { CLUSTERS } else { 0 });
        if let Some(volume) = &family.volume {
            out.u32(volume.root_page.0);
            encode_levels(out, &volume.levels);
        }
        if let Some(clusters) = &family.clusters {
            encode_clusters(out, clusters);
        }
    }
}

fn decode_family_name(input: &mut Decoder, version: u32) -> Result<FamilyName, Damage> {
    let code = input.u8("a family")?;
    if code == NAMED && version >= VERSION_NAMED {
        let name = input.text("a family's name")?;
        let found = FamilyName::parse(&name).filter(|name| name.gadget_type().is_none());
        return found.ok_or_else(|| Damage::new("footer", format!("a family's name, found {name:?}")));
    }
    let expected = || Damage::new("footer", format!("a family below {}, found {code}", FamilyName::GADGET.len()));
    FamilyName::GADGET.get(usize::from(code)).copied().ok_or_else(expected)
}

fn encode_levels(out: &mut Encoder, levels: &[LevelInfo]) {
    out.u32(levels.len() as u32);
    for level in levels {
        out.u8(level.depth);
        let counts = [
            level.grid_nodes,
            level.leaf_nodes,
            level.relay_nodes,
            level.input,
            level.merged,
            level.skipped,
            level.relayed,
            level.sprites,
            level.points,
            level.leaf_particles,
            level.bytes,
        ];
        counts.into_iter().for_each(|count| out.u64(count));
    }
}

fn decode_family(input: &mut Decoder, version: u32, bits: CodeBits) -> Result<FamilyMetadata, Damage> {
    let name = decode_family_name(input, version)?;
    let count = input.u64("a family's count")?;
    let mass = input.f64("a family's mass")?;
    let mass_density = input.f64("a family's sum of mass times density")?;
    let bounds = Bounds { min: input.vec3("a family's bounds")?, max: input.vec3("a family's bounds")? };
    let root = RootCell { min: input.vec3("a root cell")?, size: input.f64("a root cell")? };
    let sound = bounds.min.is_finite() && bounds.max.is_finite() && root.min.is_finite() && root.size.is_finite();
    if !sound || root.size <= 0.0 || bounds.is_empty() || count == 0 {
        return Err(Damage::new("footer", format!("finite bounds and a root cell of positive size for {name}")));
    }
    let root_page = PageId(input.u32("a root page")?);
    let attributes = input.count(50, "attributes")?;
    let quantities = [decode_attribute(input)?, decode_attribute(input)?, decode_attribute(input)?];
    let attributes: Vec<_> = (0..attributes).map(|_| decode_attribute(input)).collect::<Result<_, _>>()?;
    let levels = decode_levels(input)?;
    let (mut codebooks, mut refinements) = (Vec::new(), Vec::new());
    for _ in 0..input.count(13, "codebooks")? {
        let (codebook, refinement) = decode_codebook(input, attributes.len(), bits)?;
        codebooks.push(codebook);
        refinements.extend(refinement);
    }
    let column_error =
        if version >= VERSION_REFINED { input.option_f64("the error of column densities")? } else { None };
    let kinds = if version >= VERSION_VOLUME { input.u8("kinds of levels")? } else { 0 };
    if kinds > if version >= VERSION_NAMED { VOLUME | CLUSTERS } else { VOLUME } {
        return Err(Damage::new(
            "footer",
            format!("levels for volumes (1), clusters (2), both or none, found {kinds}"),
        ));
    }
    let volume = match kinds & VOLUME {
        0 => None,
        _ => Some(VolumeTree { root_page: PageId(input.u32("a root page")?), levels: decode_levels(input)? }),
    };
    let clusters = match kinds & CLUSTERS {
        0 => None,
        _ => Some(decode_clusters(input, attributes.len())?),
    };
    Ok(FamilyMetadata {
        name,
        count,
        mass,
        mass_density,
        bounds,
        root,
        root_page,
        quantities,
        attributes,
        levels,
        volume,
        codebooks,
        refinements,
        column_error,
        clusters,
    })
}

fn encode_clusters(out: &mut Encoder, clusters: &ClusterTree) {
    out.u32(clusters.root_page.0);
    out.u32(clusters.levels.len() as u32);
    for level in &clusters.levels {
        out.u8(level.depth);
        [level.nodes, level.clusters, level.finest].into_iter().for_each(|count| out.u64(count));
        out.f64(level.size);
        out.f64(level.misfit);
        out.u64(level.bytes);
    }
    out.u8(clusters.shape_bits);
    out.u8(u8::from(clusters.is_published));
    out.u32(clusters.book.shapes.entries.len() as u32);
    for step in clusters.book.shapes.entries.iter().flatten() {
        out.bytes.extend_from_slice(&step.to_le_bytes());
    }
    encode_codebook(out, &clusters.book.values, None);
}

fn decode_clusters(input: &mut Decoder, attributes: usize) -> Result<ClusterTree, Damage> {
    let root_page = PageId(input.u32("a root page")?);
    let level = |input: &mut Decoder| {
        let depth = input.u8("a level's depth")?;
        let mut next = || input.u64("a level's counts");
        let (nodes, clusters, finest) = (next()?, next()?, next()?);
        let (size, misfit) = (input.f64("a level's size")?, input.f64("a level's misfit")?);
        Ok(ClusterLevel { depth, nodes, clusters, finest, size, misfit, bytes: input.u64("a level's bytes")? })
    };
    let levels = (0..input.count(49, "levels of clusters")?).map(|_| level(input)).collect::<Result<_, Damage>>()?;
    let shape_bits = input.u8("the bits of shapes")?;
    if shape_bits != 0 && shape_packing(shape_bits).is_none() {
        return Err(Damage::new("footer", format!("shapes of 0, 8, 12 or 16 bits, found {shape_bits}")));
    }
    let is_published = match input.u8("how clusters were split")? {
        0 => false,
        1 => true,
        other => return Err(Damage::new("footer", format!("clusters split as 0 or 1 says, found {other}"))),
    };
    let entries = input.count(2 * COORDINATES, "shapes")?;
    if entries > 1 << shape_bits || (entries == 0) != (shape_bits == 0) {
        return Err(Damage::new("footer", format!("shapes that {shape_bits} bits can name, found {entries}")));
    }
    let bytes = input.bytes(2 * COORDINATES * entries, "shapes")?;
    let step = |entry: &[u8], k: usize| i16::from_le_bytes([entry[2 * k], entry[2 * k + 1]]);
    let entry = |entry: &[u8]| std::array::from_fn(|k| step(entry, k));
    let shapes = ShapeBook { entries: bytes.chunks_exact(2 * COORDINATES).map(entry).collect() };
    // Those of clusters are never refined.
    let (values, _) = decode_codebook(input, attributes, CodeBits::plain(VqBits::Sixteen))?;
    let book = Arc::new(ClusterBook::new(shapes, values));
    Ok(ClusterTree { root_page, levels, shape_bits, is_published, book })
}

fn decode_levels(input: &mut Decoder) -> Result<Vec<LevelInfo>, Damage> {
    (0..input.count(89, "levels")?).map(|_| decode_level(input)).collect()
}

fn decode_level(input: &mut Decoder) -> Result<LevelInfo, Damage> {
    let depth = input.u8("a level's depth")?;
    let mut next = || input.u64("a level's counts");
    Ok(LevelInfo {
        depth,
        grid_nodes: next()?,
        leaf_nodes: next()?,
        relay_nodes: next()?,
        input: next()?,
        merged: next()?,
        skipped: next()?,
        relayed: next()?,
        sprites: next()?,
        points: next()?,
        leaf_particles: next()?,
        bytes: next()?,
    })
}

fn encode_attribute(out: &mut Encoder, attribute: &AttributeInfo) {
    out.text(&attribute.name);
    out.text(&attribute.unit.0);
    out.f64(attribute.min);
    out.f64(attribute.max);
    out.f64(attribute.mean);
    out.u64(attribute.missing);
    out.u8(match attribute.merge {
        AttributeMerge::Mean => 0,
        AttributeMerge::Magnitude => 1,
    });
    out.u8(u8::from(attribute.histogram.logarithmic));
    out.f64(attribute.histogram.min);
    out.f64(attribute.histogram.max);
    out.u32(attribute.histogram.counts.len() as u32);
    attribute.histogram.counts.iter().for_each(|&count| out.u64(count));
}

fn decode_attribute(input: &mut Decoder) -> Result<AttributeInfo, Damage> {
    Ok(AttributeInfo {
        name: input.text("an attribute's name")?,
        unit: Unit(input.text("an attribute's unit")?),
        min: input.f64("an attribute's range")?,
        max: input.f64("an attribute's range")?,
        mean: input.f64("an attribute's mean")?,
        missing: input.u64("an attribute's missing values")?,
        merge: match input.u8("how an attribute is merged")? {
            0 => AttributeMerge::Mean,
            1 => AttributeMerge::Magnitude,
            other => return Err(Damage::new("footer", format!("a merge rule of 0 or 1, found {other}"))),
        },
        histogram: Histogram {
            logarithmic: match input.u8("a histogram's scale")? {
                0 => false,
                1 => true,
                other => return Err(Damage::new("footer", format!("a histogram's scale of 0 or 1, found {other}"))),
            },
            min: input.f64("a histogram's range")?,
            max: input.f64("a histogram's range")?,
            counts: (0..input.count(8, "histogram bins")?)
                .map(|_| input.u64("a histogram bin"))
                .collect::<Result<_, _>>()?,
        },
    })
}

/// A codebook, or the lines that were unrolled to it.
fn encode_codebook(out: &mut Encoder, codebook: &Codebook, refinement: Option<&Refinement>) {
    // 255 is no depth, so it names the leaves; depths are far below 128.
    out.u8(match codebook.scope {
        CodebookScope::Leaves => u8::MAX,
        CodebookScope::Depth(depth) => depth,
        CodebookScope::VolumeDepth(depth) => VOLUME_SCOPE | depth,
        CodebookScope::Clusters => CLUSTER_SCOPE,
    });
    out.u64(codebook.particles);
    if let Some(lines) = refinement {
        let of_lines = |column: &Vec<f32>| column.iter().copied().step_by(STEPS).collect::<Vec<f32>>();
        out.u32(lines.density.len() as u32);
        out.f32s(&[lines.slope]);
        out.f32s(&of_lines(&codebook.mass));
        out.f32s(&lines.density);
        out.f32s(&lines.shortest);
        out.f32s(&lines.longest);
        codebook.attributes.iter().for_each(|column| out.f32s(&of_lines(column)));
    } else {
        encode_entries(out, codebook);
    }
    for error in &codebook.errors {
        out.f64(error.mean);
        out.f64(error.max);
    }
}

fn encode_entries(out: &mut Encoder, codebook: &Codebook) {
    out.u32(codebook.len() as u32);
    // Masses and sizes of clusters are told elsewhere.
    let is_whole = codebook.scope != CodebookScope::Clusters;
    if is_whole {
        out.f32s(&codebook.mass);
    }
    out.f32s(&codebook.density);
    if is_whole {
        out.f32s(&codebook.smoothing_length);
    }
    codebook.attributes.iter().for_each(|column| out.f32s(column));
}

/// A codebook of a file with codes like this, unrolled where it holds lines.
fn decode_codebook(
    input: &mut Decoder,
    attributes: usize,
    bits: CodeBits,
) -> Result<(Codebook, Option<Refinement>), Damage> {
    let scope = match input.u8("a codebook's scope")? {
        u8::MAX => CodebookScope::Leaves,
        CLUSTER_SCOPE => CodebookScope::Clusters,
        scope if scope & VOLUME_SCOPE != 0 => CodebookScope::VolumeDepth(scope & !VOLUME_SCOPE),
        depth => CodebookScope::Depth(depth),
    };
    let particles = input.u64("a codebook's particles")?;
    let columns = 3 + attributes;
    let is_whole = scope != CodebookScope::Clusters;
    let is_refined = scope == CodebookScope::Leaves && bits.is_refined();
    let told = if is_whole { columns + usize::from(is_refined) } else { 1 + attributes };
    let entries = input.count(4 * told, "codebook entries")?;
    let most = if is_refined { bits.entries.entries() } else { VqBits::Sixteen.entries() };
    if entries > most {
        return Err(Damage::new("footer", format!("at most {most} codebook entries, found {entries}")));
    }
    let slope = if is_refined { Some(input.f32("a slope")?) } else { None };
    let mut column = || input.f32s(entries, "a codebook column");
    let mass = if is_whole { column()? } else { vec![1.0; entries] };
    let density = column()?;
    let smoothing_length = if is_whole { column()? } else { vec![1.0; entries] };
    let refinement = match slope {
        None => None,
        Some(slope) => {
            Some(Refinement { slope, density: density.clone(), shortest: smoothing_length.clone(), longest: column()? })
        }
    };
    let attributes: Vec<Vec<f32>> = (0..attributes).map(|_| column()).collect::<Result<_, _>>()?;
    let errors: Vec<QuantityError> = (0..columns)
        .map(|_| Ok(QuantityError { mean: input.f64("an error")?, max: input.f64("an error")? }))
        .collect::<Result<_, Damage>>()?;
    let stored = Codebook { scope, particles, mass, density, smoothing_length, attributes, errors };
    match refinement {
        Some(lines) if !lines.is_sound() => Err(Damage::new(
            "footer",
            "lines of a codebook with a slope within 4, from a positive smoothing length to one no shorter",
        )),
        Some(lines) => Ok((lines.unrolled(stored), Some(lines))),
        None => Ok((stored, None)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_need_it_are_written_out() {
        let decode = |code: u8, name: &str, version| {
            let mut out = Encoder::default();
            out.u8(code);
            out.text(name);
            decode_family_name(&mut Decoder::new(&out.bytes, "footer"), version).map_err(|damage| damage.expected)
        };
        assert_eq!(decode(NAMED, "tracer", VERSION_NAMED).ok(), FamilyName::parse("tracer"));
        assert_eq!(decode(4, "", VERSION).ok(), Some(FamilyName::Stars));
        for wrong in ["stars", "", "Tracer", "a b", &"g".repeat(300)] {
            assert!(decode(NAMED, wrong, VERSION_NAMED).is_err_and(|why| why.contains("a family's name")), "{wrong}");
        }
        for (code, version) in [(NAMED, VERSION_VOLUME), (6, VERSION_NAMED)] {
            assert!(decode(code, "tracer", version).is_err_and(|why| why.contains("a family below 6")));
        }
    }
}
