//! Particles in memory as a tree: a single node for each family, which holds them at their full precision.

use super::content::{Content, Particles};
use super::error::{Damage, StoreError};
use super::metadata::{AttributeInfo, FamilyMetadata, Metadata};
use super::page::{Branch, NODE_MEMORY, Node, Page, PageId};
use super::page_file::PageBytes;
use super::tree::Tree;
use crate::codec::{CodeBits, Codebook, CodebookScope, QuantityError, VqBits};
use crate::hierarchy::RootCell;
use crate::hierarchy::attribute_info::{Histogram, Range, set_units};
use crate::model::{Dataset, Family, Unit};
use std::path::Path;
use std::sync::Arc;

/// A dataset as a tree.
#[derive(Debug)]
pub struct InMemory {
    metadata: Metadata,
    families: Vec<Arc<Particles>>,
}

impl InMemory {
    /// The tree of a dataset; families without particles are left out. Its metadata has no histograms.
    pub fn new(dataset: Dataset) -> InMemory {
        let Dataset { families, length_unit, mass_unit, kernel, skipped, provenance } = dataset;
        let mut metadata = Metadata {
            length_unit,
            mass_unit,
            kernel,
            // Nothing is coded.
            bits: CodeBits::plain(VqBits::Sixteen),
            provenance,
            skipped,
            families: Vec::with_capacity(families.len()),
        };
        let mut held = Vec::with_capacity(families.len());
        for family in families.into_iter().filter(|family| !family.is_empty()) {
            let mut about = described(&family, PageId(held.len() as u32));
            set_units(&mut about.quantities, &metadata.mass_unit, &metadata.length_unit);
            metadata.families.push(about);
            held.push(Arc::new(particles_of(family)));
        }
        InMemory { metadata, families: held }
    }
}

/// What is known of a family.
fn described(family: &Family, root_page: PageId) -> FamilyMetadata {
    let unit = Unit::default();
    // Counting what lies where takes longer than a picture, and pictures do not ask.
    let column = |name: &str, unit: &Unit, values: &[f32]| {
        AttributeInfo::new(name, unit, &Range::of(values), Histogram::default())
    };
    let bounds = family.bounds();
    let sum = |weight: &dyn Fn(usize) -> f64| (0..family.len()).map(weight).sum();
    FamilyMetadata {
        name: family.name,
        count: family.len() as u64,
        mass: sum(&|i| f64::from(family.mass[i])),
        mass_density: sum(&|i| f64::from(family.mass[i]) * f64::from(family.density[i])),
        bounds,
        root: RootCell::around(bounds, 1.0),
        root_page,
        quantities: [
            column("mass", &unit, &family.mass),
            column("density", &unit, &family.density),
            column("smoothing-length", &unit, &family.smoothing_length),
        ],
        attributes: family.attributes.iter().map(|own| column(&own.name, &own.unit, &own.values)).collect(),
        levels: Vec::new(),
        volume: None,
        codebooks: Vec::new(),
        refinements: Vec::new(),
        column_error: None,
        clusters: None,
    }
}

fn particles_of(family: Family) -> Particles {
    let Family { positions, mass, smoothing_length, density, attributes, .. } = family;
    let values = Codebook {
        scope: CodebookScope::Leaves,
        particles: positions.len() as u64,
        errors: vec![QuantityError::default(); 3 + attributes.len()],
        mass,
        density,
        smoothing_length,
        attributes: attributes.into_iter().map(|attribute| attribute.values).collect(),
    };
    Particles { positions, values, covariances: Vec::new() }
}

impl Tree for InMemory {
    fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn path(&self) -> &Path {
        &self.metadata.provenance.path
    }

    fn page_count(&self) -> u32 {
        self.families.len() as u32
    }

    fn page_bytes(&self, _page: PageId) -> u64 {
        0
    }

    fn page_memory(&self, page: PageId) -> u64 {
        self.families.get(page.0 as usize).map_or(0, |family| NODE_MEMORY + family.memory())
    }

    fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
        Ok(PageBytes::new(page, Vec::new()))
    }

    fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
        let page = bytes.page();
        let absent =
            || Damage::new(format!("page {}", page.0), format!("one of {}", self.families.len())).in_file(self.path());
        let particles = self.families.get(page.0 as usize).ok_or_else(absent)?;
        let family = &self.metadata.families[page.0 as usize];
        let largest = particles.values.smoothing_length.iter().copied().fold(0.0, f32::max);
        let node = Node {
            mass: family.mass,
            mass_density: family.mass_density,
            smoothing_length_max: largest,
            ..Node::leaf(family.bounds, particles.len() as u32)
        };
        let content: Arc<dyn Content> = particles.clone();
        Ok(Page::new(page, page.0, [Branch { node, children: Vec::new(), content }]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hierarchy::Purpose;

    #[test]
    fn a_family_is_a_node_that_holds_it() {
        let dataset = crate::synth::dataset(&crate::synth::merger::Merger::new(3, 500));
        let tree = InMemory::new(dataset.clone());
        let families: Vec<u32> = (0..tree.page_count()).collect();
        assert_eq!(tree.metadata().particles(), dataset.len() as u64);
        assert_eq!(tree.metadata().bounds(), dataset.bounds());
        for (root, family) in tree.roots(&families, Purpose::Samples, 0.0).into_iter().zip(&dataset.families) {
            assert!(tree.is_root(root.page));
            let page = tree.read_page(root.page).unwrap();
            let node = &page.nodes[root.node as usize];
            assert!(node.is_leaf() && page.children(0).is_empty() && page.particles(0).is_empty());
            assert_eq!((node.bounds, node.delta, node.source_particles), (family.bounds(), 0.0, family.len() as u64));
            let held = page.content(0).unwrap().particles(0.0);
            assert_eq!((&held.positions, &held.values.mass), (&family.positions, &family.mass));
        }
        assert!(tree.read_page(PageId(tree.page_count())).is_err());
    }
}
