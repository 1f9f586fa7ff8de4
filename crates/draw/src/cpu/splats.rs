//! What is drawn: borrowed columns of particles.

use crate::model::{Covariance, Kernel};
use crate::view;
use glam::DVec3;
use thiserror::Error;

/// Particle positions, in world units.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// World coordinates.
    World(&'a [[f64; 3]]),
    /// Offsets from one world position, as a page's decoded node has them.
    Relative {
        /// World position of offset zero.
        origin: DVec3,
        /// World units per unit of the offsets: a cell's edge, with which the offsets of packed positions are exact.
        scale: f64,
        /// World position minus `origin`, in units of `scale`.
        offsets: &'a [[f32; 3]],
    },
}

impl Positions<'_> {
    /// Number of positions.
    pub fn len(&self) -> usize {
        match self {
            Positions::World(positions) => positions.len(),
            Positions::Relative { offsets, .. } => offsets.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// World position of one particle; `index` must be below [`Positions::len`].
    pub fn world(&self, index: usize) -> DVec3 {
        match self {
            Positions::World(positions) => DVec3::from_array(positions[index]),
            Positions::Relative { origin, scale, offsets } => {
                *origin + *scale * glam::Vec3::from_array(offsets[index]).as_dvec3()
            }
        }
    }
}

/// How far a splat reaches.
#[derive(Clone, Copy, Debug)]
pub enum Extent<'a> {
    /// Smoothing length `h` of each particle in world units: the kernel's support radius.
    World(&'a [f32]),
    /// One radius in pixels for all particles, at any distance: a point-spread function. `P` is then weight per pixel
    /// area.
    Pixels(f32),
    /// Second moments of each splat about its centre, world units squared: the kernel stretched so that its own are these
    /// ([`super::ellipsoid`]). `C = sigma^2 I` is a particle with `h = sigma / sqrt(v)`, with the kernel's variance `v`.
    Ellipsoids(&'a [Covariance]),
}

/// What splats stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SplatKind {
    /// Source particles, or samples of an image or a volume.
    Leaf,
    /// Particles that were merged within an error, or all samples of a node as one large point.
    Merged,
    /// Clusters with a shape, or the parts of a node in a directed set.
    Cluster,
}

/// The node of a hierarchy that a batch is of, for pictures of the hierarchy itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeTraits {
    /// Steps from the root.
    pub level: u8,
    /// What its splats stand for.
    pub kind: SplatKind,
    /// Mean of its splats' relative L1 distances in space from the particles they stand for, at most 2; `None` where it is not known, or
    /// each splat has one of its own ([`Splats::misfits`]).
    pub misfit: Option<f64>,
}

/// Columns that do not fit together.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SplatError {
    /// A column's length differs from the number of positions.
    #[error("{column} has {found} values, expected {expected}")]
    Length {
        /// Which column.
        column: &'static str,
        /// Its length.
        found: usize,
        /// Number of positions.
        expected: usize,
    },
}

/// A batch of particles as structure of arrays, all columns of the same length. Particles with a value that is not
/// finite, or an extent that is not positive, are left out.
#[derive(Clone, Copy, Debug)]
pub struct Splats<'a> {
    positions: Positions<'a>,
    extent: Extent<'a>,
    weight: &'a [f32],
    attribute: Option<&'a [f32]>,
    density: Option<&'a [f32]>,
    /// Whether densities fall where particles are enlarged.
    dilutes: bool,
    reach: Option<view::Extent>,
    traits: Option<NodeTraits>,
    misfits: Option<&'a [f32]>,
    fields: &'a [Vec<f32>],
}

impl<'a> Splats<'a> {
    /// A batch with `weight` `w` and, for the `S` channel, `attribute` `a` of each particle.
    ///
    /// # Errors
    /// [`SplatError::Length`] when a column's length differs from the number of positions.
    pub fn new(
        positions: Positions<'a>,
        extent: Extent<'a>,
        weight: &'a [f32],
        attribute: Option<&'a [f32]>,
    ) -> Result<Splats<'a>, SplatError> {
        let expected = positions.len();
        let check = |column, found| match found == expected {
            true => Ok(()),
            false => Err(SplatError::Length { column, found, expected }),
        };
        if let Extent::World(lengths) = extent {
            check("smoothing length", lengths.len())?;
        }
        if let Extent::Ellipsoids(covariances) = extent {
            check("covariance", covariances.len())?;
        }
        check("weight", weight.len())?;
        if let Some(attribute) = attribute {
            check("attribute", attribute.len())?;
        }
        let (density, reach, traits, misfits) = (None, None, None, None);
        Ok(Splats { positions, extent, weight, attribute, density, dilutes: true, reach, traits, misfits, fields: &[] })
    }

    /// The same with each particle's own density, for what is classified particle by particle.
    ///
    /// # Errors
    /// [`SplatError::Length`] when the column's length differs from the number of positions.
    pub fn with_density(self, density: Option<&'a [f32]>) -> Result<Splats<'a>, SplatError> {
        match density.map_or(self.len(), <[f32]>::len) {
            found if found == self.len() => Ok(Splats { density, dilutes: true, ..self }),
            found => Err(SplatError::Length { column: "density", found, expected: self.len() }),
        }
    }

    /// The same with a value of each particle in place of its density: what is enlarged keeps it, where the same mass in more space would be less
    /// dense.
    ///
    /// # Errors
    /// [`SplatError::Length`] when the column's length differs from the number of positions.
    pub fn with_values(self, values: &'a [f32]) -> Result<Splats<'a>, SplatError> {
        match values.len() {
            found if found == self.len() => Ok(Splats { density: Some(values), dilutes: false, ..self }),
            found => Err(SplatError::Length { column: "value", found, expected: self.len() }),
        }
    }

    /// The same with columns whose fields are drawn, beside the attribute.
    ///
    /// # Errors
    /// [`SplatError::Length`] when a column's length differs from the number of positions.
    pub fn with_fields(self, fields: &'a [Vec<f32>]) -> Result<Splats<'a>, SplatError> {
        match fields.iter().map(Vec::len).find(|found| *found != self.len()) {
            None => Ok(Splats { fields, ..self }),
            Some(found) => Err(SplatError::Length { column: "field", found, expected: self.len() }),
        }
    }

    /// The same with how far each splat is from what it stands for.
    ///
    /// # Errors
    /// [`SplatError::Length`] when the column's length differs from the number of positions.
    pub fn with_misfits(self, misfits: &'a [f32]) -> Result<Splats<'a>, SplatError> {
        match misfits.len() {
            found if found == self.len() => Ok(Splats { misfits: Some(misfits), ..self }),
            found => Err(SplatError::Length { column: "misfit", found, expected: self.len() }),
        }
    }

    /// The same with a box around the particles and what they reach at most out of it, where that is known.
    pub fn with_reach(self, reach: Option<view::Extent>) -> Splats<'a> {
        Splats { reach, ..self }
    }

    /// The same with what is known of the node that it is of.
    pub fn with_traits(self, traits: Option<NodeTraits>) -> Splats<'a> {
        Splats { traits, ..self }
    }

    /// What is known of the node that it is of.
    pub fn traits(&self) -> Option<NodeTraits> {
        self.traits
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether the batch is empty.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Positions of the particles.
    pub fn positions(&self) -> Positions<'a> {
        self.positions
    }

    /// Extents of the particles.
    pub fn extent(&self) -> Extent<'a> {
        self.extent
    }

    /// The smoothing length of a particle, for what draws balls alone; `None` where extents are in pixels.
    ///
    /// An ellipsoid counts as the ball of equal volume whose kernel is the default one.
    pub fn ball(&self, index: usize) -> Option<f32> {
        match self.extent {
            Extent::World(lengths) => Some(lengths[index]),
            Extent::Pixels(_) => None,
            Extent::Ellipsoids(covariances) => {
                let trace = covariances[index].trace();
                let volume = (covariances[index].matrix() * trace.recip()).determinant().max(0.0);
                Some((trace * volume.cbrt() / Kernel::default().variance()).sqrt() as f32)
            }
        }
    }

    /// How far a particle reaches from its centre at most, world units: the longest semi-axis of an ellipsoid with the default kernel,
    /// which reaches farthest of all. `None` where extents are in pixels.
    pub fn farthest(&self, index: usize) -> Option<f32> {
        match self.extent {
            Extent::World(_) | Extent::Pixels(_) => self.ball(index),
            Extent::Ellipsoids(covariances) => {
                Some((covariances[index].radii().x / Kernel::default().variance().sqrt()) as f32)
            }
        }
    }

    /// A box around the particles and what they reach at most out of it, where that is known.
    pub fn reach(&self) -> Option<view::Extent> {
        self.reach
    }

    /// Weights `w`.
    pub fn weight(&self) -> &'a [f32] {
        self.weight
    }

    /// Densities of the particles themselves, or values in their place, where something is classified particle by particle.
    pub fn density(&self) -> Option<&'a [f32]> {
        self.density
    }

    /// Whether [`Splats::density`] falls where a particle is enlarged.
    pub fn dilutes(&self) -> bool {
        self.dilutes
    }

    /// How far each splat is from what it stands for, where each has a misfit of its own: of points of images and volumes the root of the mean
    /// squared difference of values in their node.
    pub fn misfits(&self) -> Option<&'a [f32]> {
        self.misfits
    }

    /// Columns whose fields are drawn, beside the attribute.
    pub fn fields(&self) -> &'a [Vec<f32>] {
        self.fields
    }

    /// The same with one of the columns whose fields are drawn as the attribute; `None` where there is no such column.
    pub fn of_field(self, index: usize) -> Option<Splats<'a>> {
        self.fields.get(index).map(|values| Splats { attribute: Some(values), ..self })
    }

    /// Attributes `a`, when the `S` channel is wanted.
    pub fn attribute(&self) -> Option<&'a [f32]> {
        self.attribute
    }
}
