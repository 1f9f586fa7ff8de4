//! A depiction drawn by the GPU techniques without a window: nodes of a page file, or source particles as they are.

use crate::codec::Codebook;
use crate::gpu::TableEntry;
use crate::gpu::{
    self, Backend, DeviceOptions, HeadlessNode, HeadlessRequest, ModeView, NodeId, NodeUpload, Payload, RawParticle,
};
use crate::mode::sample::Sample;
use crate::mode::{CodeTable, Depiction, Footprint, Plan};
use crate::model::{Dataset, Family, Kernel};
use crate::store::{FamilyMetadata, Metadata, Particles};
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;
use rayon::prelude::*;

/// Source particles of one payload: few enough that any adapter binds them.
const BATCH: usize = 1 << 18;

/// What the renderer needs to know of a depiction's particle shape.
pub fn footprint(depiction: &Depiction, kernel: Kernel) -> gpu::Footprint {
    match depiction.footprint() {
        Footprint::Kernel => gpu::Footprint::Kernel(kernel),
        Footprint::Pixels(radius) => gpu::Footprint::Pixels { radius },
    }
}

/// The renderer's table of one codebook.
pub fn table(depiction: &Depiction, family: &FamilyMetadata, codebook: &Codebook) -> Vec<TableEntry> {
    entries(&depiction.table(family, codebook))
}

/// The renderer's form of a table.
pub fn entries(table: &CodeTable) -> Vec<TableEntry> {
    (0..table.weight.len())
        .map(|i| TableEntry {
            smoothing_length: table.smoothing_length[i],
            weight: table.weight[i],
            attribute: table.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
            importance: table.importance[i],
        })
        .collect()
}

/// A request for selected nodes of a page file.
pub fn request_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    plan: &Plan,
    backend: Backend,
) -> HeadlessRequest {
    let mut tables = Vec::new();
    let mut first_table = Vec::with_capacity(metadata.families.len());
    for family in &metadata.families {
        first_table.push(tables.len());
        tables.extend(family.codebooks.iter().map(|codebook| depiction.table(family, codebook)));
    }
    let nodes = nodes
        .iter()
        .map(|drawn| {
            let index = drawn.node.node;
            let node = &drawn.page.nodes[index as usize];
            let family = &metadata.families[drawn.page.family as usize];
            let id = NodeId { source: drawn.page.family, page: drawn.node.page.0, node: index };
            if let Some(content) = drawn.page.content(index as usize) {
                let held = content.particles(drawn.time);
                return own_content(view, depiction, family, (&held, depiction.node_scale(node)), id, drawn.offset);
            }
            let table = first_table[drawn.page.family as usize] + usize::from(node.codebook);
            HeadlessNode {
                upload: NodeUpload {
                    id,
                    min: node.frame.min,
                    size: node.frame.size,
                    payload: Payload::Page { page: drawn.page.clone(), node: index },
                },
                table: Some(table),
                weight_scale: depiction.node_scale(node),
                offset: drawn.offset,
                sample: plan.sample(
                    &view.of_image(drawn.offset),
                    depiction,
                    family,
                    node,
                    tables[table].most_important,
                ),
            }
        })
        .collect();
    let tables = tables.iter().map(entries).collect();
    HeadlessRequest {
        culling: plan.culling,
        faintest: plan.faintest,
        ..request(view, depiction, metadata.kernel, nodes, tables, backend)
    }
}

/// A node whose particles are not coded, with the factor on their weights, as [`request_particles`] has them.
fn own_content(
    view: &View,
    depiction: &Depiction,
    family: &FamilyMetadata,
    (held, scale): (&Particles, f32),
    id: NodeId,
    offset: DVec3,
) -> HeadlessNode {
    let table = depiction.table(family, &held.values);
    let particle = |(i, &position): (usize, &[f64; 3])| RawParticle {
        position: view.to_camera(DVec3::from_array(position) + offset).as_vec3().to_array(),
        smoothing_length: table.smoothing_length[i],
        weight: scale * table.weight[i],
        attribute: table.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
        unused: [0.0; 2],
    };
    let payload = Payload::Camera(held.positions.par_iter().enumerate().map(particle).collect());
    HeadlessNode {
        upload: NodeUpload { id, min: DVec3::ZERO, size: 0.0, payload },
        table: None,
        weight_scale: 1.0,
        offset: DVec3::ZERO,
        sample: Sample::ALL,
    }
}

/// A request for source particles; their places are found in double precision, relative to the camera.
pub fn request_particles(
    view: &View,
    depiction: &Depiction,
    dataset: &Dataset,
    families: &[&Family],
    backend: Backend,
) -> HeadlessRequest {
    let mut nodes = Vec::new();
    for (source, family) in families.iter().enumerate() {
        let columns = depiction.source_columns(family);
        for (batch, positions) in family.positions.chunks(BATCH).enumerate() {
            let start = batch * BATCH;
            let particle = |(offset, position): (usize, &[f64; 3])| {
                let i = start + offset;
                RawParticle {
                    position: view.to_camera(DVec3::from_array(*position)).as_vec3().to_array(),
                    smoothing_length: family.smoothing_length[i],
                    weight: columns.weight[i],
                    attribute: columns.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
                    unused: [0.0; 2],
                }
            };
            let particles = positions.par_iter().enumerate().map(particle).collect();
            nodes.push(HeadlessNode {
                upload: NodeUpload {
                    id: NodeId { source: source as u32, page: batch as u32, node: 0 },
                    min: DVec3::ZERO,
                    size: 0.0,
                    payload: Payload::Camera(particles),
                },
                table: None,
                weight_scale: 1.0,
                offset: DVec3::ZERO,
                sample: Sample::ALL,
            });
        }
    }
    request(view, depiction, dataset.kernel, nodes, Vec::new(), backend)
}

fn request(
    view: &View,
    depiction: &Depiction,
    kernel: Kernel,
    nodes: Vec<HeadlessNode>,
    tables: Vec<Vec<TableEntry>>,
    backend: Backend,
) -> HeadlessRequest {
    HeadlessRequest {
        view: *view,
        mode: Some(ModeView { mode: depiction.mode, settings: depiction.settings.clone() }),
        footprint: footprint(depiction, kernel),
        backend,
        culling: true,
        faintest: 0.0,
        nodes,
        tables,
        attribute: depiction.attribute.is_some(),
        transfer: None,
        repeat: 1,
        device: DeviceOptions::default(),
    }
}
