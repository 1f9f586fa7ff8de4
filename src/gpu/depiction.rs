//! A depiction drawn by the GPU techniques without a window: nodes of a tree, coded or as they are.

use crate::codec::Codebook;
use crate::codec::clusters::{NO_CLASS, cluster_limit};
use crate::cpu::volume::attributes::Column;
use crate::gpu::clusters::ClusterNode;
use crate::gpu::content_look::{ContentLook, of_column, table_of_column};
use crate::gpu::{
    self, Backend, DeviceOptions, HeadlessNode, HeadlessRequest, ModeView, NodeId, NodeUpload, Payload, RawParticle,
};
use crate::gpu::{Table, TableEntry};
use crate::mode::sample::Sample;
use crate::mode::{CodeTable, Columns, Depiction, Footprint, Plan, SourceColumns};
use crate::model::{Bounds, Family, Kernel};
use crate::picture::decode::{reach, reach_now, reach_of_clusters};
use crate::store::{FamilyMetadata, Metadata, Particles};
use crate::stream::SceneNode;
use crate::view::{Extent, View};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Particles of one payload: few enough that any adapter binds them.
const BATCH: usize = 1 << 18;

/// What the renderer needs to know of a depiction's particle shape.
pub fn footprint(depiction: &Depiction, kernel: Kernel) -> gpu::Footprint {
    match depiction.footprint() {
        Footprint::Kernel => gpu::Footprint::Kernel(kernel),
        Footprint::Pixels(radius) => gpu::Footprint::Pixels { radius },
    }
}

/// The renderer's table of one codebook.
pub fn table(depiction: &Depiction, family: &FamilyMetadata, codebook: &Codebook) -> Table {
    entries(&depiction.table(family, codebook))
}

/// The renderer's form of a table.
pub fn entries(table: &CodeTable) -> Table {
    let entries = (0..table.weight.len())
        .map(|i| TableEntry {
            smoothing_length: table.smoothing_length[i],
            weight: table.weight[i],
            attribute: table.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
            importance: table.importance[i],
        })
        .collect();
    Table { entries, densities: table.density.clone().unwrap_or_default() }
}

/// A request for selected nodes of a tree.
pub fn request_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    plan: &Plan,
    backend: Backend,
) -> HeadlessRequest {
    request_from((view, view), depiction, metadata, nodes, plan, (backend, &[Column::Attribute]))
}

/// A request for nodes that are selected for a view and whose particles another camera sees: all of them with each of the columns as their
/// attribute, one column after the other.
pub fn request_from(
    (view, camera): (&View, &View),
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    plan: &Plan,
    (backend, columns): (Backend, &[Column]),
) -> HeadlessRequest {
    let mut tables = Vec::new();
    let mut requested = Vec::with_capacity(columns.len() * nodes.len());
    for (number, column) in columns.iter().enumerate() {
        let with = With { view, camera, depiction, metadata, plan, number, column: *column };
        with.add(nodes, &mut tables, &mut requested);
    }
    let tables = tables.iter().map(entries).collect();
    HeadlessRequest {
        view: *view,
        mode: Some(ModeView { mode: depiction.mode, settings: depiction.settings.clone() }),
        footprint: footprint(depiction, metadata.kernel),
        backend,
        culling: plan.culling,
        faintest: plan.faintest,
        nodes: requested,
        tables,
        attribute: depiction.attribute.is_some(),
        transfer: None,
        repeat: 1,
        device: DeviceOptions::default(),
    }
}

/// Clusters with another column than the first are others: their names have its number from this bit on.
const COLUMN_BIT: u32 = 24;

/// How nodes are requested with a column as their attribute.
struct With<'a> {
    view: &'a View,
    camera: &'a View,
    depiction: &'a Depiction,
    metadata: &'a Metadata,
    plan: &'a Plan,
    /// Which of the columns.
    number: usize,
    column: Column,
}

impl With<'_> {
    /// Adds nodes, and the tables that they need.
    fn add(&self, nodes: &[SceneNode], tables: &mut Vec<CodeTable>, requested: &mut Vec<HeadlessNode>) {
        let With { view, depiction, metadata, plan, number, column, .. } = *self;
        let mut first_table = Vec::with_capacity(metadata.families.len());
        for family in &metadata.families {
            first_table.push(tables.len());
            let table = |codebook| table_of_column(depiction.table(family, codebook), column);
            tables.extend(family.codebooks.iter().map(table));
        }
        let look = Arc::new(ContentLook::new(depiction.clone(), metadata).of_column(column));
        for drawn in nodes {
            let index = drawn.node.node;
            let node = &drawn.page.nodes[index as usize];
            let family = &metadata.families[drawn.page.family as usize];
            let weight_scale = depiction.node_scale(node);
            let source = drawn.page.family | (number as u32) << COLUMN_BIT;
            if let Some(content) = drawn.page.content(index as usize).filter(|content| !content.steps().is_empty()) {
                let look = Arc::clone(&look);
                requested.push(HeadlessNode {
                    upload: NodeUpload {
                        id: NodeId { source, page: drawn.node.page.0, node: index },
                        min: node.frame.min,
                        size: node.frame.size,
                        payload: Payload::Clusters(ClusterNode { page: drawn.page.clone(), node: index, look }),
                    },
                    table: None,
                    weight_scale,
                    offset: drawn.offset,
                    sample: Sample::ALL,
                    limit: cluster_limit(drawn.part, node.particles),
                    reach: reach_of_clusters(drawn, content.steps(), metadata.kernel),
                });
                continue;
            }
            if let Some(content) = drawn.page.content(index as usize) {
                let held = content.particles(drawn.time);
                self.own_content(family, (&held, weight_scale), drawn, requested);
                continue;
            }
            let table = first_table[drawn.page.family as usize] + usize::from(node.codebook);
            let most_important = tables[table].most_important;
            let sample = plan.sample(&view.of_image(drawn.offset), depiction, family, node, most_important);
            requested.push(HeadlessNode {
                upload: NodeUpload {
                    id: NodeId { source: drawn.page.family, page: drawn.node.page.0, node: index },
                    min: node.frame.min,
                    size: node.frame.size,
                    payload: Payload::Page { page: drawn.page.clone(), node: index },
                },
                table: Some(table),
                weight_scale,
                offset: drawn.offset,
                sample,
                limit: NO_CLASS,
                reach: reach(drawn, sample.growth),
            });
        }
    }
}

/// The name of particles that lie where this picture's camera sees them: no other picture has them.
const OWN: u32 = u32::MAX;

/// The particle at an index of its columns, with a factor on its weight.
fn raw(i: usize, position: Vec3, smoothing_length: f32, columns: &SourceColumns, scale: f32) -> RawParticle {
    RawParticle {
        position: position.to_array(),
        smoothing_length,
        weight: scale * columns.weight[i],
        attribute: columns.attribute.as_ref().map_or(0.0, |attribute| attribute[i]),
        density: columns.density.as_ref().map_or(0.0, |density| density[i]),
        unused: 0.0,
    }
}

/// A family's particles as they are, for any camera: payloads, the origin of each, and how far its particles reach.
pub fn world_payloads(depiction: &Depiction, family: &Family) -> Vec<(Payload, DVec3, Extent)> {
    let attributes: Vec<(&str, &[f32])> =
        family.attributes.iter().map(|attribute| (attribute.name.as_str(), &attribute.values[..])).collect();
    let Family { positions, mass, density, smoothing_length, .. } = family;
    let columns = depiction.values_of(&Columns { mass, density, smoothing_length, attributes: &attributes });
    batches(positions, smoothing_length, &columns)
}

/// Particles for any camera, some at a time.
fn batches(positions: &[[f64; 3]], smoothing_length: &[f32], columns: &SourceColumns) -> Vec<(Payload, DVec3, Extent)> {
    let batch = |start: usize| {
        let range = start..positions.len().min(start + BATCH);
        let place = |i: usize| DVec3::from_array(positions[i]);
        let around = |i: usize| (place(i), place(i), smoothing_length[i]);
        let widest = |a: (DVec3, DVec3, f32), b: (DVec3, DVec3, f32)| (a.0.min(b.0), a.1.max(b.1), a.2.max(b.2));
        let (min, max, margin) = range.clone().into_par_iter().map(around).reduce(|| around(start), widest);
        let particle = |i: usize| raw(i, (place(i) - min).as_vec3(), smoothing_length[i], columns, 1.0);
        let particles = range.into_par_iter().map(particle).collect();
        (Payload::World(particles), min, Extent { bounds: Bounds { min, max }, margin: f64::from(margin) })
    };
    (0..positions.len()).step_by(BATCH).map(batch).collect()
}

impl With<'_> {
    /// Adds a node whose particles are not coded, with the factor on their weights; their places are found in double precision,
    /// relative to the camera.
    fn own_content(
        &self,
        family: &FamilyMetadata,
        (held, scale): (&Particles, f32),
        drawn: &SceneNode,
        nodes: &mut Vec<HeadlessNode>,
    ) {
        let offset = drawn.offset;
        let columns = of_column(self.depiction.columns_of(family, &held.values), self.column);
        let particle = |i: usize| {
            let position = self.camera.to_camera(DVec3::from_array(held.positions[i]) + offset).as_vec3();
            raw(i, position, held.values.smoothing_length[i], &columns, scale)
        };
        for start in (0..held.len()).step_by(BATCH) {
            let particles = (start..held.len().min(start + BATCH)).into_par_iter().map(particle).collect();
            let id = NodeId { source: OWN, page: nodes.len() as u32, node: 0 };
            nodes.push(HeadlessNode {
                upload: NodeUpload { id, min: DVec3::ZERO, size: 0.0, payload: Payload::Camera(particles) },
                table: None,
                weight_scale: 1.0,
                offset: DVec3::ZERO,
                sample: Sample::ALL,
                limit: NO_CLASS,
                reach: reach_now(drawn, held, 1.0),
            });
        }
    }
}
