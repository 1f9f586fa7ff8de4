//! A depiction drawn by the CPU renderer: nodes of a tree, or source particles as they are.

use crate::color::Accumulation;
use crate::cpu::overdraw::{Overdraw, overdraw};
use crate::cpu::volume::{Processor, VolumeError};
use crate::cpu::{Counts, Extent, Method, Positions, SplatError, SplatOptions, Splats, around, draw_counted};
use crate::mode::sample::Sample;
use crate::mode::{CodeTable, Depiction, Footprint, Job, Output, Plan, SourceColumns};
use crate::model::{Bounds, Dataset, Family};
use crate::picture::paint::{densest, densest_of};
use crate::store::{Metadata, Node, Page, Particles};
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;

/// The particles of one node, decoded: structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct DecodedNode {
    origin: DVec3,
    /// Edge of the frame, world units; offsets are fractions of it.
    size: f64,
    offsets: Vec<[f32; 3]>,
    /// World positions of those that are not told in the frame, instead of `offsets`.
    places: Vec<[f64; 3]>,
    smoothing_length: Vec<f32>,
    weight: Vec<f32>,
    attribute: Option<Vec<f32>>,
    density: Option<Vec<f32>>,
}

impl DecodedNode {
    /// Decodes what is drawn of one node of other content, with a table of its particles, displaced by `offset`.
    fn of_content(held: &Particles, table: &CodeTable, scale: f32, sample: Sample, offset: DVec3) -> DecodedNode {
        let mut out = DecodedNode {
            attribute: table.attribute.as_ref().map(|_| Vec::new()),
            density: table.density.as_ref().map(|_| Vec::new()),
            ..DecodedNode::default()
        };
        let importance = |i: u32| table.importance[i as usize];
        sample.each(held.len() as u32, importance, |i, factor| {
            let i = i as usize;
            out.places.push((DVec3::from_array(held.positions[i]) + offset).to_array());
            out.smoothing_length.push(sample.growth * table.smoothing_length[i]);
            out.weight.push(factor * (scale * table.weight[i]));
            for (out, column) in [(&mut out.attribute, &table.attribute), (&mut out.density, &table.density)] {
                if let (Some(out), Some(column)) = (out, column) {
                    out.push(column[i]);
                }
            }
        });
        out
    }

    /// Decodes what is drawn of one node, with the table of its codebook.
    fn new(depiction: &Depiction, page: &Page, index: usize, table: &CodeTable, sample: Sample) -> DecodedNode {
        let node: &Node = &page.nodes[index];
        let particles = page.particles(index);
        let scale = depiction.node_scale(node);
        if !sample.is_all() {
            let mut out = DecodedNode { origin: node.frame.min, size: node.frame.size, ..DecodedNode::default() };
            out.attribute = table.attribute.as_ref().map(|_| Vec::new());
            out.density = table.density.as_ref().map(|_| Vec::new());
            let code = |i: u32| usize::from(particles.codes[i as usize]);
            let importance = |i: u32| table.importance[code(i)];
            sample.each(particles.len() as u32, importance, |i, factor| {
                out.offsets.push(particles.fraction(i as usize));
                out.smoothing_length.push(sample.growth * table.smoothing_length[code(i)]);
                out.weight.push(factor * (scale * table.weight[code(i)]));
                let optional = [(&mut out.attribute, &table.attribute), (&mut out.density, &table.density)];
                for (out, column) in optional {
                    if let (Some(out), Some(column)) = (out, column) {
                        out.push(column[code(i)]);
                    }
                }
            });
            return out;
        }
        let at = |column: &[f32]| particles.codes.iter().map(|&code| column[usize::from(code)]).collect();
        DecodedNode {
            origin: node.frame.min,
            size: node.frame.size,
            places: Vec::new(),
            offsets: (0..particles.len()).map(|i| particles.fraction(i)).collect(),
            smoothing_length: at(&table.smoothing_length),
            weight: particles.codes.iter().map(|&code| scale * table.weight[usize::from(code)]).collect(),
            attribute: table.attribute.as_deref().map(at),
            density: table.density.as_deref().map(at),
        }
    }
}

impl DecodedNode {
    /// Number of particles that are drawn.
    pub fn len(&self) -> usize {
        self.weight.len()
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
        let DecodedNode { origin, size, offsets, places, smoothing_length, weight, attribute, density } = self;
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
            weight[kept] = (f64::from(weight[i]) * view.fade(position)) as f32;
            for column in [&mut *attribute, &mut *density].into_iter().flatten() {
                column[kept] = column[i];
            }
            kept += 1;
        }
        offsets.truncate(kept);
        places.truncate(kept);
        let columns = [Some(smoothing_length), Some(weight), attribute.as_mut(), density.as_mut()];
        columns.into_iter().flatten().for_each(|column| column.truncate(kept));
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

/// Decodes all particles of the selected nodes, in parallel; [`cut`] leaves out what a view does.
pub fn decode(depiction: &Depiction, metadata: &Metadata, nodes: &[SceneNode]) -> Vec<DecodedNode> {
    decode_some(depiction, metadata, nodes, |table| table, |_, _| Sample::ALL)
}

/// Decodes what `plan` draws of the selected nodes and the view does not leave out, in parallel.
pub fn decode_planned(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    plan: &Plan,
) -> Vec<DecodedNode> {
    let sample = |drawn: &SceneNode, table: &CodeTable| {
        let family = &metadata.families[drawn.page.family as usize];
        plan.sample(
            &view.of_image(drawn.offset),
            depiction,
            family,
            &drawn.page.nodes[drawn.node.node as usize],
            table.most_important,
        )
    };
    cut(view, decode_some(depiction, metadata, nodes, |table| table, sample))
}

/// Decoded nodes without the particles that the view leaves out, the others faded as it says.
pub fn cut(view: &View, mut nodes: Vec<DecodedNode>) -> Vec<DecodedNode> {
    if !view.cut.is_none() {
        nodes.par_iter_mut().for_each(|node| node.cut(view));
    }
    nodes
}

/// Decodes the samples of the selected nodes that `sample` gives for the table of a node's codebook, in parallel, with
/// tables as `change` makes them.
pub(super) fn decode_some(
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    change: impl Fn(CodeTable) -> CodeTable + Sync,
    sample: impl Fn(&SceneNode, &CodeTable) -> Sample + Sync,
) -> Vec<DecodedNode> {
    let tables: Vec<Vec<CodeTable>> = metadata
        .families
        .iter()
        .map(|family| family.codebooks.iter().map(|codebook| change(depiction.table(family, codebook))).collect())
        .collect();
    nodes
        .par_iter()
        .map(|drawn| {
            let index = drawn.node.node as usize;
            if let Some(content) = drawn.page.content(index) {
                let held = content.particles(drawn.time);
                let family = &metadata.families[drawn.page.family as usize];
                let table = change(depiction.table(family, &held.values));
                let scale = depiction.node_scale(&drawn.page.nodes[index]);
                return DecodedNode::of_content(&held, &table, scale, sample(drawn, &table), drawn.offset);
            }
            let codebook = usize::from(drawn.page.nodes[index].codebook);
            let table = &tables[drawn.page.family as usize][codebook];
            let mut node = DecodedNode::new(depiction, &drawn.page, index, table, sample(drawn, table));
            node.origin += drawn.offset;
            node
        })
        .collect()
}

/// Draws decoded nodes.
///
/// # Errors
/// As [`draw_batches`].
pub fn draw_nodes(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    method: Method,
) -> Result<Accumulation, VolumeError> {
    draw_planned(view, depiction, metadata, nodes, method, &Plan::default()).map(|drawn| drawn.0)
}

/// Draws decoded nodes with a plan's culling and presence acceleration, and says what became of the particles.
///
/// # Errors
/// As [`draw_batches`].
pub fn draw_planned(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    method: Method,
    plan: &Plan,
) -> Result<(Accumulation, Counts), VolumeError> {
    let batches = batches(depiction, nodes)?;
    let known = || (metadata.bounds(), densest_of(metadata));
    draw_batches(view, depiction, &batches, options(metadata, method, plan), known)
}

/// Sums of splats, whatever the mode draws: for ranges of pictures that the processor does not draw.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn sum_planned(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    plan: &Plan,
) -> Result<Accumulation, SplatError> {
    Ok(draw_counted(view, &batches(depiction, nodes)?, &options(metadata, Method::Pyramid, plan)).0)
}

/// Draws batches of a mode whose pictures a transfer function colours. `known` finds the data's bounds and its largest
/// density, where the mode may ask for them.
///
/// # Errors
/// [`VolumeError`] as [`crate::mode::Mode::draw`], and for a mode that draws colours.
pub fn draw_batches(
    view: &View,
    depiction: &Depiction,
    batches: &[Splats<'_>],
    options: SplatOptions,
    known: impl FnOnce() -> (Bounds, f64),
) -> Result<(Accumulation, Counts), VolumeError> {
    let (diameter, densest) = match depiction.mode.technique.output() {
        Output::Sums => (0.0, 0.0),
        Output::Values | Output::Light => {
            let (bounds, densest) = known();
            (bounds.size().length(), densest)
        }
    };
    let settings = &depiction.settings;
    let job = Job { view, batches, options, settings, transfer: None, diameter, densest, caster: &Processor };
    depiction.mode.draw(&job)?.sums(depiction.mode)
}

/// Draws batches as [`draw_batches`] on a face of a panorama whose pixels are `pixel` radians wide.
///
/// # Errors
/// As [`draw_batches`].
pub fn draw_face(
    view: &View,
    depiction: &Depiction,
    batches: &[Splats<'_>],
    pixel: f64,
    options: SplatOptions,
    known: impl FnOnce() -> (Bounds, f64),
) -> Result<(Accumulation, Counts), VolumeError> {
    match depiction.mode.technique.output() {
        Output::Sums => Ok(around::draw_face(view, batches, pixel, &options)?),
        Output::Values | Output::Light => draw_batches(view, depiction, batches, options, known),
    }
}

/// How many of the splats lie over each pixel.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn overdraw_of(
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[DecodedNode],
    plan: &Plan,
) -> Result<Overdraw, SplatError> {
    Ok(overdraw(view, &batches(depiction, nodes)?, &options(metadata, Method::Pyramid, plan)))
}

fn options(metadata: &Metadata, method: Method, plan: &Plan) -> SplatOptions {
    SplatOptions { method, kernel: metadata.kernel, culling: plan.culling, faintest: plan.faintest }
}

/// The splats of decoded nodes.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn batches<'a>(depiction: &Depiction, nodes: &'a [DecodedNode]) -> Result<Vec<Splats<'a>>, SplatError> {
    let footprint = depiction.footprint();
    nodes
        .iter()
        .map(|node| {
            let relative = Positions::Relative { origin: node.origin, scale: node.size, offsets: &node.offsets };
            Splats::new(
                if node.places.is_empty() { relative } else { Positions::World(&node.places) },
                extent(footprint, &node.smoothing_length),
                &node.weight,
                node.attribute.as_deref(),
            )?
            .with_density(node.density.as_deref())
        })
        .collect()
}

/// The particles of a family that a view does not leave out, with their weights as it fades them.
pub struct SeenFamily<'a> {
    /// World positions.
    pub positions: Cow<'a, [[f64; 3]]>,
    /// Smoothing lengths, world units.
    pub smoothing_length: Cow<'a, [f32]>,
    /// Weights and attributes.
    pub columns: SourceColumns,
}

impl<'a> SeenFamily<'a> {
    /// Every image of every family; what is drawn as it is is borrowed.
    pub fn of(view: &View, depiction: &Depiction, families: &[&'a Family]) -> Vec<SeenFamily<'a>> {
        let images = families.iter().flat_map(|family| view.images.offsets().map(move |offset| (*family, offset)));
        images.map(|(family, offset)| SeenFamily::new(view, depiction, family, offset)).collect()
    }

    /// One image, displaced by `offset`.
    fn new(view: &View, depiction: &Depiction, family: &'a Family, offset: DVec3) -> SeenFamily<'a> {
        let columns = depiction.source_columns(family);
        let (positions, lengths) = (&family.positions, &family.smoothing_length);
        if view.cut.is_none() && offset == DVec3::ZERO {
            let (positions, smoothing_length) = (Cow::Borrowed(&positions[..]), Cow::Borrowed(&lengths[..]));
            return SeenFamily { positions, smoothing_length, columns };
        }
        let place = |i: usize| DVec3::from(positions[i]) + offset;
        let places: Vec<usize> = (0..positions.len()).into_par_iter().filter(|&i| view.cut.keeps(place(i))).collect();
        let at = |column: &[f32]| -> Vec<f32> { places.iter().map(|&i| column[i]).collect() };
        let weight = places.iter().map(|&i| (f64::from(columns.weight[i]) * view.fade(place(i))) as f32).collect();
        SeenFamily {
            positions: places.iter().map(|&i| place(i).to_array()).collect(),
            smoothing_length: at(lengths).into(),
            columns: SourceColumns {
                weight,
                attribute: columns.attribute.as_deref().map(at),
                density: columns.density.as_deref().map(at),
            },
        }
    }
}

/// The splats of source particles.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn seen_batches<'a>(depiction: &Depiction, seen: &'a [SeenFamily<'_>]) -> Result<Vec<Splats<'a>>, SplatError> {
    let footprint = depiction.footprint();
    seen.iter()
        .map(|SeenFamily { positions, smoothing_length, columns }| {
            let extent = extent(footprint, smoothing_length);
            Splats::new(Positions::World(positions), extent, &columns.weight, columns.attribute.as_deref())?
                .with_density(columns.density.as_deref())
        })
        .collect()
}

/// Draws source particles at their full precision.
///
/// # Errors
/// As [`draw_batches`].
pub fn draw_particles(
    view: &View,
    depiction: &Depiction,
    dataset: &Dataset,
    families: &[&Family],
    method: Method,
) -> Result<Accumulation, VolumeError> {
    let seen = SeenFamily::of(view, depiction, families);
    let batches = seen_batches(depiction, &seen)?;
    let options = SplatOptions { method, kernel: dataset.kernel, ..SplatOptions::default() };
    let known = || (dataset.bounds(), densest(families));
    draw_batches(view, depiction, &batches, options, known).map(|drawn| drawn.0)
}

fn extent(footprint: Footprint, smoothing_length: &[f32]) -> Extent<'_> {
    match footprint {
        Footprint::Kernel => Extent::World(smoothing_length),
        Footprint::Pixels(radius) => Extent::Pixels(radius),
    }
}
