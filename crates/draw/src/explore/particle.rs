//! One particle of a page file with all its values, read from the file again, and with what is known of their precision.

use super::data::{Column, error_scale};
use super::paged::around;
use crate::model::{FamilyName, Unit};
use crate::store::{NodeRef, StoreError, Tree};
use glam::DVec3;

/// A particle of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ParticleRef {
    /// Its node.
    pub node: NodeRef,
    /// Its number in the node.
    pub index: u32,
}

/// What a page file says about a particle.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleReport {
    /// Which one.
    pub particle: ParticleRef,
    /// Its family.
    pub family: FamilyName,
    /// Its position, world units, as the file has it.
    pub position: DVec3,
    /// How far at most its source's position is from that along each axis, world units; for merged particles how far at most any of
    /// the source particles is that it stands for.
    pub rounding: f64,
    /// What it was merged from; `None` for a particle of the source.
    pub merged: Option<Merged>,
    /// Its values: mass, density, smoothing length, then the attributes.
    pub values: Vec<ParticleValue>,
}

/// A node whose particles were merged from those of the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Merged {
    /// Source particles that the node stands for.
    pub source_particles: u64,
    /// Particles that the node has in their place.
    pub particles: u64,
    /// Mass of all of them.
    pub mass: f64,
    /// The node's depth in the tree; 0 is the root.
    pub depth: u8,
}

/// One value of a particle.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleValue {
    /// Name of the quantity.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// The value.
    pub value: f64,
    /// What the source's value is at least and at most, by the largest error of its codebook.
    pub between: (f64, f64),
}

/// Reads a particle from the file: position, values and what the source's may be.
///
/// # Errors
/// [`StoreError`] when its page cannot be read; [`StoreError::Damaged`] where the file has no such particle.
pub fn describe(tree: &dyn Tree, particle: ParticleRef) -> Result<ParticleReport, StoreError> {
    let metadata = tree.metadata();
    let page = tree.read_page(particle.node.page)?;
    let absent = || StoreError::Damaged {
        path: tree.path().to_path_buf(),
        place: format!("page {}", particle.node.page.0),
        expected: format!("a particle {} of its node {}", particle.index, particle.node.node),
    };
    let (number, index) = (particle.node.node as usize, particle.index as usize);
    let node = page.nodes.get(number).ok_or_else(absent)?;
    let family = metadata.families.get(page.family as usize).ok_or_else(absent)?;
    let particles = page.block(number, family, node.start()).ok_or_else(absent)?;
    let code = particles.entry(index).ok_or_else(absent)?;
    let codebook = particles.table().ok_or_else(absent)?;
    let own = [Column::Mass, Column::Density, Column::SmoothingLength];
    let columns = own.into_iter().chain((0..family.attributes.len()).map(Column::Attribute));
    let infos = family.quantities.iter().chain(&family.attributes);
    let values = infos.zip(columns).filter_map(|(info, column)| {
        let value = f64::from(*column.of(codebook).get(code)?);
        let error = codebook.errors.get(column.error_index()).map_or(0.0, |error| error.max);
        let between = around(value, error, error_scale(family, column));
        Some(ParticleValue { name: info.name.clone(), unit: info.unit.clone(), value, between })
    });
    Ok(ParticleReport {
        particle,
        family: family.name,
        position: particles.position(index),
        rounding: if node.is_leaf() { particles.rounding(index) } else { node.delta },
        merged: (!node.is_leaf()).then_some(Merged {
            source_particles: node.source_particles,
            particles: particles.len() as u64,
            mass: node.mass,
            depth: node.depth,
        }),
        values: values.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build_source};
    use crate::import::{LoadOptions, load};
    use crate::store::{PageFile, PageId};

    #[test]
    fn every_particle_of_the_demo_is_within_what_is_said_of_it() {
        let source = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/demo/lcdm64_z0.hdf5");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("demo.df");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &path, &()).unwrap();
        let file = PageFile::open(&path).unwrap();
        let dataset = load(&source, &LoadOptions::default(), &()).unwrap();
        let family = &dataset.families[0];
        let mut seen = 0;
        for page in (0..file.page_count()).step_by(3) {
            let nodes = file.read_page(PageId(page)).unwrap().nodes.len();
            for node in (0..nodes as u32).step_by(17) {
                let at = NodeRef { page: PageId(page), node };
                let Ok(report) = describe(&file, ParticleRef { node: at, index: 0 }) else { continue };
                if report.merged.is_some() {
                    assert!(report.rounding.is_finite());
                    continue;
                }
                // Some particle of the source is within the rounding and has such values.
                let near = |i: &usize| {
                    let apart = (DVec3::from(family.positions[*i]) - report.position).abs();
                    apart.max_element() <= report.rounding * (1.0 + 1e-9) + 1e-12
                };
                let fits = |i: usize| {
                    let own = [family.mass[i], family.density[i], family.smoothing_length[i]];
                    report
                        .values
                        .iter()
                        .zip(own)
                        .all(|(value, own)| (value.between.0..=value.between.1).contains(&f64::from(own)))
                };
                assert!((0..family.len()).filter(near).any(fits), "{report:?}");
                seen += 1;
            }
        }
        assert!(seen > 3, "{seen}");
        let nowhere = ParticleRef { node: NodeRef { page: PageId(0), node: 1 << 30 }, index: 0 };
        assert!(describe(&file, nowhere).unwrap_err().to_string().contains("a particle 0 of its node"));
    }
}
