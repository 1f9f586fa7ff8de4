//! Nodes of a tree, decoded: what of their particles a picture draws, as batches for the CPU renderer.

use super::node_traits::traits;
use crate::cpu::{Extent, NodeTraits, Positions, SplatError, Splats};
use crate::hierarchy::pca::Step;
use crate::mode::sample::Sample;
use crate::mode::{CodeTable, Depiction, Footprint, Plan, SourceColumns};
use crate::model::{Covariance, Kernel};
use crate::store::{Metadata, Node, Page, Particles};
use crate::stream::SceneNode;
use crate::view::{self, View};
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Nodes that have been decoded since the program began.
static DECODED: AtomicU64 = AtomicU64::new(0);

/// How many nodes have been decoded for pictures since the program began: none while an adapter draws.
pub fn decoded_nodes() -> u64 {
    DECODED.load(Ordering::Relaxed)
}

/// The particles of one node, decoded: structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct DecodedNode<'a> {
    origin: DVec3,
    /// Edge of the frame, world units; offsets are fractions of it.
    size: f64,
    offsets: Vec<[f32; 3]>,
    /// World positions of those that are not told in the frame, instead of `offsets`.
    places: Cow<'a, [[f64; 3]]>,
    /// Second moments, world units squared, of those that are ellipsoids.
    covariances: Cow<'a, [Covariance]>,
    smoothing_length: Cow<'a, [f32]>,
    weight: Vec<f32>,
    attribute: Option<Vec<f32>>,
    density: Option<Vec<f32>>,
    fields: Vec<Vec<f32>>,
    /// `None` where the view leaves out all.
    reach: Option<view::Extent>,
    traits: Option<NodeTraits>,
}

impl<'a> DecodedNode<'a> {
    /// All of a node that holds particles of its own, displaced by `offset`; what is as the node holds it is borrowed.
    fn whole(held: Cow<'a, Particles>, columns: SourceColumns, scale: f32, offset: DVec3) -> DecodedNode<'a> {
        let SourceColumns { mut weight, attribute, density, fields } = columns;
        if scale != 1.0 {
            weight.iter_mut().for_each(|weight| *weight *= scale);
        }
        let (mut places, smoothing_length, covariances) = match held {
            Cow::Borrowed(held) => {
                (Cow::from(&held.positions), Cow::from(&held.values.smoothing_length), Cow::from(&held.covariances))
            }
            Cow::Owned(held) => (held.positions.into(), held.values.smoothing_length.into(), held.covariances.into()),
        };
        if offset != DVec3::ZERO {
            let moved = |&place: &[f64; 3]| (DVec3::from_array(place) + offset).to_array();
            places = places.par_iter().map(moved).collect::<Vec<_>>().into();
        }
        DecodedNode {
            places,
            covariances,
            smoothing_length,
            weight,
            attribute,
            density,
            fields,
            ..DecodedNode::default()
        }
    }

    /// Particles of a node's own with the factors of a sample on their weights, of which there is one for each, displaced by `offset`.
    fn taken(
        held: &Particles,
        table: &CodeTable,
        (scale, factors): (f32, &[f32]),
        growth: f32,
        offset: DVec3,
    ) -> DecodedNode<'a> {
        let grown = |h: &f32| growth * h;
        DecodedNode {
            places: held.positions.iter().map(|at| (DVec3::from_array(*at) + offset).to_array()).collect(),
            smoothing_length: table.smoothing_length.iter().map(grown).collect(),
            weight: table.weight.iter().zip(factors).map(|(weight, factor)| factor * (scale * weight)).collect(),
            attribute: table.attribute.clone(),
            density: table.density.clone(),
            fields: table.fields.clone(),
            ..DecodedNode::default()
        }
    }

    /// A sample of a node that holds particles of its own, with a table of them, displaced by `offset`.
    fn some(held: &Particles, table: &CodeTable, scale: f32, sample: Sample, offset: DVec3) -> DecodedNode<'a> {
        let mut out = DecodedNode {
            attribute: table.attribute.as_ref().map(|_| Vec::new()),
            density: table.density.as_ref().map(|_| Vec::new()),
            fields: vec![Vec::new(); table.fields.len()],
            ..DecodedNode::default()
        };
        let (mut places, mut lengths) = (Vec::new(), Vec::new());
        let importance = |i: u32| table.importance[i as usize];
        sample.each(held.len() as u32, importance, |i, factor| {
            let i = i as usize;
            places.push((DVec3::from_array(held.positions[i]) + offset).to_array());
            lengths.push(sample.growth * table.smoothing_length[i]);
            out.weight.push(factor * (scale * table.weight[i]));
            for (out, column) in [(&mut out.attribute, &table.attribute), (&mut out.density, &table.density)] {
                if let (Some(out), Some(column)) = (out, column) {
                    out.push(column[i]);
                }
            }
            out.fields.iter_mut().zip(&table.fields).for_each(|(out, column)| out.push(column[i]));
        });
        DecodedNode { places: places.into(), smoothing_length: lengths.into(), ..out }
    }

    /// Decodes what is drawn of one node, with the table of its codebook.
    fn coded(depiction: &Depiction, page: &Page, index: usize, table: &CodeTable, sample: Sample) -> DecodedNode<'a> {
        let node: &Node = &page.nodes[index];
        let particles = page.particles(index);
        let scale = depiction.node_scale(node);
        if !sample.is_all() {
            let mut out = DecodedNode { origin: node.frame.min, size: node.frame.size, ..DecodedNode::default() };
            out.attribute = table.attribute.as_ref().map(|_| Vec::new());
            out.density = table.density.as_ref().map(|_| Vec::new());
            out.fields = vec![Vec::new(); table.fields.len()];
            let mut lengths = Vec::new();
            let code = |i: u32| usize::from(particles.codes[i as usize]);
            let importance = |i: u32| table.importance[code(i)];
            sample.each(particles.len() as u32, importance, |i, factor| {
                out.offsets.push(particles.fraction(i as usize));
                lengths.push(sample.growth * table.smoothing_length[code(i)]);
                out.weight.push(factor * (scale * table.weight[code(i)]));
                let optional = [(&mut out.attribute, &table.attribute), (&mut out.density, &table.density)];
                for (out, column) in optional {
                    if let (Some(out), Some(column)) = (out, column) {
                        out.push(column[code(i)]);
                    }
                }
                out.fields.iter_mut().zip(&table.fields).for_each(|(out, column)| out.push(column[code(i)]));
            });
            return DecodedNode { smoothing_length: lengths.into(), ..out };
        }
        let at =
            |column: &[f32]| -> Vec<f32> { particles.codes.iter().map(|&code| column[usize::from(code)]).collect() };
        DecodedNode {
            origin: node.frame.min,
            size: node.frame.size,
            places: Cow::default(),
            covariances: Cow::default(),
            offsets: (0..particles.len()).map(|i| particles.fraction(i)).collect(),
            smoothing_length: at(&table.smoothing_length).into(),
            weight: particles.codes.iter().map(|&code| scale * table.weight[usize::from(code)]).collect(),
            attribute: table.attribute.as_deref().map(at),
            density: table.density.as_deref().map(at),
            fields: table.fields.iter().map(|column| at(column)).collect(),
            reach: None,
            traits: None,
        }
    }
}

impl DecodedNode<'_> {
    /// Number of particles that are drawn.
    pub fn len(&self) -> usize {
        self.weight.len()
    }

    /// The same without what it borrows.
    pub(super) fn into_owned(self) -> DecodedNode<'static> {
        let DecodedNode { origin, size, offsets, weight, attribute, density, fields, reach, traits, .. } = self;
        let (places, covariances) = (self.places.into_owned().into(), self.covariances.into_owned().into());
        let smoothing_length = self.smoothing_length.into_owned().into();
        DecodedNode {
            origin,
            size,
            offsets,
            places,
            covariances,
            smoothing_length,
            weight,
            attribute,
            density,
            fields,
            reach,
            traits,
        }
    }

    /// Weights, the sample's factor included.
    pub(super) fn weight(&self) -> &[f32] {
        &self.weight
    }

    /// Smoothing lengths, world units.
    pub(super) fn smoothing_length(&self) -> &[f32] {
        &self.smoothing_length
    }

    /// The attribute; empty if there is none.
    pub(super) fn attribute(&self) -> &[f32] {
        self.attribute.as_deref().unwrap_or_default()
    }

    /// Drops the particles that the view leaves out, and fades the others.
    fn cut(&mut self, view: &View) {
        let DecodedNode { origin, size, offsets, places, smoothing_length, weight, reach, .. } = self;
        let DecodedNode { attribute, density, fields, .. } = self;
        let (places, smoothing_length) = (places.to_mut(), smoothing_length.to_mut());
        let covariances = self.covariances.to_mut();
        *reach = reach.and_then(|reach| reach.within(&view.cut.bounds));
        let mut kept = 0;
        for i in 0..weight.len() {
            let position = match places.get(i) {
                Some(&place) => DVec3::from_array(place),
                None => *origin + *size * glam::Vec3::from_array(offsets[i]).as_dvec3(),
            };
            if !view.cut.keeps(position) {
                continue;
            }
            match places.is_empty() {
                true => offsets[kept] = offsets[i],
                false => places[kept] = places[i],
            }
            smoothing_length[kept] = smoothing_length[i];
            if !covariances.is_empty() {
                covariances[kept] = covariances[i];
            }
            weight[kept] = (f64::from(weight[i]) * view.fade(position)) as f32;
            for column in [&mut *attribute, &mut *density].into_iter().flatten().chain(&mut *fields) {
                column[kept] = column[i];
            }
            kept += 1;
        }
        offsets.truncate(kept);
        places.truncate(kept);
        covariances.truncate(kept);
        let columns = [Some(smoothing_length), Some(weight), attribute.as_mut(), density.as_mut()];
        columns.into_iter().flatten().chain(fields).for_each(|column| column.truncate(kept));
    }

    /// Replaces the attribute; it has one value for each particle.
    pub(super) fn set_attribute(&mut self, attribute: Vec<f32>) {
        self.attribute = Some(attribute);
    }

    /// Whether nothing is drawn.
    pub fn is_empty(&self) -> bool {
        self.weight.is_empty()
    }
}

/// A box around what is drawn of a node, and how far that reaches at most out of it, where smoothing lengths grow by a factor.
pub fn reach(drawn: &SceneNode, growth: f32) -> view::Extent {
    let node = &drawn.page.nodes[drawn.node.node as usize];
    view::Extent { bounds: node.bounds.moved(drawn.offset), margin: f64::from(growth * node.smoothing_length_max) }
}

/// The same of particles that bring their own places and are there now, wherever else their node has some.
pub fn reach_now(drawn: &SceneNode, held: &Particles, growth: f32) -> view::Extent {
    // An ellipsoid reaches farther along its longest axis than the ball with the same trace, by the square root of three at most.
    let stretch = if held.covariances.is_empty() { 1.0 } else { 3.0_f32.sqrt() };
    let largest = stretch * held.values.smoothing_length.iter().copied().fold(0.0, f32::max);
    view::Extent { bounds: held.bounds().moved(drawn.offset), margin: f64::from(growth * largest) }
}

/// The same of clusters, as many as are drawn of a node with these steps.
pub fn reach_of_clusters(drawn: &SceneNode, steps: &[Step], kernel: Kernel) -> view::Extent {
    let node = &drawn.page.nodes[drawn.node.node as usize];
    let clusters = drawn.part.unwrap_or(node.particles);
    let largest = steps.iter().rfind(|step| step.clusters <= clusters).map_or(0.0, |step| step.largest);
    // No semi-axis is longer than that of a rod with the same trace.
    view::Extent { bounds: node.bounds.moved(drawn.offset), margin: (largest / kernel.variance()).sqrt() }
}

/// Decodes all particles of the selected nodes, in parallel; [`cut`] leaves out what a view does.
pub fn decode<'a>(depiction: &Depiction, metadata: &Metadata, nodes: &'a [SceneNode]) -> Vec<DecodedNode<'a>> {
    decode_some(depiction, metadata, nodes, |table| table, ALL)
}

/// Decodes what `plan` draws of the selected nodes and the view does not leave out, in parallel.
pub fn decode_planned<'a>(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &'a [SceneNode],
    plan: &Plan,
) -> Vec<DecodedNode<'a>> {
    let sample = |drawn: &SceneNode, most_important: f32| {
        let family = &metadata.families[drawn.page.family as usize];
        plan.sample(
            &view.of_image(drawn.offset),
            depiction,
            family,
            &drawn.page.nodes[drawn.node.node as usize],
            most_important,
        )
    };
    let decoded = match plan.samples() {
        true => decode_some(depiction, metadata, nodes, |table| table, Some(sample)),
        false => decode(depiction, metadata, nodes),
    };
    cut(view, decoded)
}

/// Decoded nodes without the particles that the view leaves out, the others faded as it says.
pub fn cut<'a>(view: &View, mut nodes: Vec<DecodedNode<'a>>) -> Vec<DecodedNode<'a>> {
    if !view.cut.is_none() {
        nodes.par_iter_mut().for_each(|node| node.cut(view));
    }
    nodes
}

/// No sample: all particles.
const ALL: Option<fn(&SceneNode, f32) -> Sample> = None;

/// Decodes the samples of the selected nodes that `sample` gives for the largest importance in a node's table, in parallel, with
/// tables as `change` makes them; without `sample` all particles, as they are.
pub(super) fn decode_some<'a>(
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &'a [SceneNode],
    change: impl Fn(CodeTable) -> CodeTable + Sync,
    sample: Option<impl Fn(&SceneNode, f32) -> Sample + Sync>,
) -> Vec<DecodedNode<'a>> {
    DECODED.fetch_add(nodes.len() as u64, Ordering::Relaxed);
    let tables: Vec<Vec<CodeTable>> = metadata
        .families
        .iter()
        .map(|family| family.codebooks.iter().map(|codebook| change(depiction.table(family, codebook))).collect())
        .collect();
    let decode = |drawn: &'a SceneNode| {
        let index = drawn.node.node as usize;
        if let Some(content) = drawn.page.content(index) {
            let family = &metadata.families[drawn.page.family as usize];
            let own = &drawn.page.nodes[index];
            let scale = depiction.node_scale(own);
            // Of an even sample it is known beforehand who is in it.
            let even = sample.as_ref().map(|sample| sample(drawn, f32::INFINITY));
            let even = even.filter(|sample| sample.even && drawn.part.is_none() && content.steps().is_empty());
            if let Some(sample) = even {
                let (mut which, mut factors) = (Vec::new(), Vec::new());
                sample.each(
                    own.particles,
                    |_| 0.0,
                    |i, factor| {
                        which.push(i);
                        factors.push(factor);
                    },
                );
                let held = content.some(drawn.time, &which);
                let table = change(depiction.table(family, &held.values));
                let reach = Some(reach_now(drawn, &held, sample.growth));
                let node = DecodedNode::taken(&held, &table, (scale, &factors), sample.growth, drawn.offset);
                return DecodedNode { reach, ..node };
            }
            let clusters = content.clusters(drawn.part, depiction.choice.representative);
            let held = clusters.map_or_else(|| content.particles(drawn.time), Cow::Owned);
            // Of clusters all that were chosen are drawn.
            let sample = sample.as_ref().filter(|_| content.steps().is_empty());
            let Some(sample) = sample else {
                let columns = depiction.columns_of(family, &held.values);
                let reach = Some(reach_now(drawn, &held, 1.0));
                return DecodedNode { reach, ..DecodedNode::whole(held, columns, scale, drawn.offset) };
            };
            let table = change(depiction.table(family, &held.values));
            let sample = sample(drawn, table.most_important);
            let node = DecodedNode::some(&held, &table, scale, sample, drawn.offset);
            return DecodedNode { reach: Some(reach_now(drawn, &held, sample.growth)), ..node };
        }
        let codebook = usize::from(drawn.page.nodes[index].codebook);
        let table = &tables[drawn.page.family as usize][codebook];
        let sample = sample.as_ref().map_or(Sample::ALL, |sample| sample(drawn, table.most_important));
        let mut node = DecodedNode::coded(depiction, &drawn.page, index, table, sample);
        node.origin += drawn.offset;
        DecodedNode { reach: Some(reach(drawn, sample.growth)), ..node }
    };
    nodes.par_iter().map(|drawn| DecodedNode { traits: traits(drawn), ..decode(drawn) }).collect()
}

/// The splats of decoded nodes.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn batches<'a>(depiction: &Depiction, nodes: &'a [DecodedNode<'_>]) -> Result<Vec<Splats<'a>>, SplatError> {
    let footprint = depiction.footprint();
    nodes
        .iter()
        .map(|node| {
            let relative = Positions::Relative { origin: node.origin, scale: node.size, offsets: &node.offsets };
            let batch = Splats::new(
                if node.places.is_empty() { relative } else { Positions::World(&node.places) },
                extent(footprint, node),
                &node.weight,
                node.attribute.as_deref(),
            )?;
            let batch = batch.with_density(node.density.as_deref())?.with_fields(&node.fields)?;
            Ok(batch.with_reach(node.reach).with_traits(node.traits))
        })
        .collect()
}

fn extent<'a>(footprint: Footprint, node: &'a DecodedNode<'_>) -> Extent<'a> {
    match footprint {
        Footprint::Kernel if !node.covariances.is_empty() => Extent::Ellipsoids(&node.covariances),
        Footprint::Kernel => Extent::World(&node.smoothing_length),
        Footprint::Pixels(radius) => Extent::Pixels(radius),
    }
}
