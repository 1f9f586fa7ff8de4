//! A depiction drawn by the CPU renderer: nodes of a page file, or source particles as they are.

use super::{CodeTable, Depiction, Footprint};
use crate::model::{Dataset, Family};
use crate::raster::{Accumulation, Extent, Method, Positions, RasterError, RasterOptions, Splats, draw};
use crate::store::{Metadata, Node, Page};
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;
use rayon::prelude::*;

/// The particles of one node, decoded: structure of arrays, positions relative to the node's cell.
#[derive(Clone, Debug, Default)]
pub struct DecodedNode {
    origin: DVec3,
    offsets: Vec<[f32; 3]>,
    smoothing_length: Vec<f32>,
    weight: Vec<f32>,
    attribute: Option<Vec<f32>>,
}

impl DecodedNode {
    /// Decodes one node with the table of its codebook.
    fn new(depiction: &Depiction, metadata: &Metadata, page: &Page, index: usize, table: &CodeTable) -> DecodedNode {
        let family = &metadata.families[page.family as usize];
        let node: &Node = &page.nodes[index];
        let particles = page.particles(index);
        let size = node.key.size(family.root) as f32;
        let scale = depiction.node_scale(node);
        let at = |column: &[f32]| particles.codes.iter().map(|&code| column[usize::from(code)]).collect();
        DecodedNode {
            origin: node.key.min(family.root),
            offsets: (0..particles.len()).map(|i| particles.fraction(i).map(|x| x * size)).collect(),
            smoothing_length: at(&table.smoothing_length),
            weight: particles.codes.iter().map(|&code| scale * table.weight[usize::from(code)]).collect(),
            attribute: table.attribute.as_deref().map(at),
        }
    }
}

/// Decodes the selected nodes, in parallel.
pub fn decode(depiction: &Depiction, metadata: &Metadata, nodes: &[SceneNode]) -> Vec<DecodedNode> {
    let tables: Vec<Vec<CodeTable>> = metadata
        .families
        .iter()
        .map(|family| family.codebooks.iter().map(|codebook| depiction.table(family, codebook)).collect())
        .collect();
    nodes
        .par_iter()
        .map(|drawn| {
            let index = drawn.node.node as usize;
            let codebook = usize::from(drawn.page.nodes[index].codebook);
            let table = &tables[drawn.page.family as usize][codebook];
            DecodedNode::new(depiction, metadata, &drawn.page, index, table)
        })
        .collect()
}

/// Draws decoded nodes.
///
/// # Errors
/// [`RasterError`] as [`Splats::new`].
pub fn draw_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    method: Method,
) -> Result<Accumulation, RasterError> {
    let footprint = depiction.footprint();
    let batches = nodes
        .iter()
        .map(|node| {
            Splats::new(
                Positions::Relative { origin: node.origin, offsets: &node.offsets },
                extent(footprint, &node.smoothing_length),
                &node.weight,
                node.attribute.as_deref(),
            )
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(draw(view, &batches, &RasterOptions { method, kernel: metadata.kernel }))
}

/// Draws source particles at their full precision.
///
/// # Errors
/// [`RasterError`] as [`Splats::new`].
pub fn draw_particles(
    view: &View,
    depiction: &Depiction,
    dataset: &Dataset,
    families: &[&Family],
    method: Method,
) -> Result<Accumulation, RasterError> {
    let footprint = depiction.footprint();
    let columns: Vec<_> = families.iter().map(|family| depiction.source_columns(family)).collect();
    let batches = families
        .iter()
        .zip(&columns)
        .map(|(family, columns)| {
            Splats::new(
                Positions::World(&family.positions),
                extent(footprint, &family.smoothing_length),
                &columns.weight,
                columns.attribute.as_deref(),
            )
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(draw(view, &batches, &RasterOptions { method, kernel: dataset.kernel }))
}

fn extent(footprint: Footprint, smoothing_length: &[f32]) -> Extent<'_> {
    match footprint {
        Footprint::Kernel => Extent::World(smoothing_length),
        Footprint::Pixels(radius) => Extent::Pixels(radius),
    }
}
