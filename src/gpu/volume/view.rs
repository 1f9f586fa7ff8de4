//! What the main world says of a camera's volume, and what it hears of it.

use super::cut::Cut;
use super::layout::MOST_TIERS;
use super::prepare::VolumeWork;
use crate::cpu::cartesian::Lattice;
use crate::cpu::field::{Field, ValueAxis};
use crate::cpu::volume::attributes::ColumnMarch;
use crate::cpu::volume::extents::planes_and_widest;
use crate::cpu::volume::{FieldRange, OpaqueDepths, Scenery, VolumeError, VolumeOptions};
use crate::gpu::light::LightCells;
use crate::gpu::news::News;
use crate::mode::{FieldMarch, LightPasses};
use crate::view::{Extent, PerspectiveGrid, View};
use bevy::prelude::Component;
use bevy::render::extract_component::ExtractComponent;
use std::sync::Arc;

/// The particles in a camera's [`SplatView`](crate::gpu::SplatView) are drawn as a volume, in place of splats, or looked at as one; or a
/// sampled field is drawn in their place.
#[derive(Component, Clone, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, VolumeWork, LightCells))]
pub struct VolumeView {
    /// How far the particles of each item in the list reach.
    pub extents: Arc<[Extent]>,
    /// The picture; an unchanged one is not drawn again.
    pub light: Option<VolumeJob>,
    /// Whose ranges are looked for.
    pub ranges: Option<VolumeJob>,
    /// Other passes draw the camera's light: only ranges are looked for.
    pub ranges_only: bool,
    /// Whether particles have an attribute, or another channel colours a field.
    pub attribute: bool,
    /// Bytes of the adapter's memory that may be used.
    pub memory: u64,
    /// Slabs that one frame draws.
    pub slabs: u32,
}

impl VolumeView {
    /// Draws the samples of a job in place of particles, so many slabs a frame.
    pub fn of_field(job: VolumeJob, memory: u64, slabs: u32) -> VolumeView {
        let attribute = job.field().is_some_and(|picture| picture.hue.is_some());
        VolumeView { extents: [].into(), light: Some(job), ranges: None, ranges_only: false, attribute, memory, slabs }
    }
}

/// A field, and what is wanted of it.
#[derive(Clone, Debug)]
pub struct VolumeJob {
    /// The caller's name for it: what comes back is for this number.
    pub number: u64,
    /// The camera and the pixels. The target may have more: then the picture is stretched.
    pub view: View,
    /// Where the samples lie.
    pub grid: PerspectiveGrid,
    /// How particles are summed. The planes are the grid's.
    pub options: VolumeOptions,
    /// One of so many particles is drawn, with the mass and the volume of all.
    pub stride: u32,
    /// What is wanted.
    pub shows: Shows,
    /// Whether it is kept what covers each pixel of a picture: see [`super::covering`].
    pub covers: bool,
}

/// What is wanted of a field.
#[derive(Clone, Debug)]
pub enum Shows {
    /// Its picture from where its grid is laid, slab by slab.
    Light(Arc<Scenery>),
    /// The same of the fields of columns: items, and their extents, are those of one column after the other, as many of each.
    Columns(Arc<ColumnMarch>),
    /// A picture of a Cartesian grid, all of which is held.
    Cartesian(Arc<CartesianPicture>),
    /// The picture of samples from where its grid is laid, slab by slab; particles have no part in it.
    Field(Arc<FieldPicture>),
    /// Between which values its mass lies.
    Ranges,
}

/// Samples, and what is shown of them.
#[derive(Clone, Debug)]
pub struct FieldPicture {
    /// The samples; the first channel is shown.
    pub field: Arc<Field>,
    /// The channel that colours it.
    pub hue: Option<usize>,
    /// The values as numbers.
    pub axis: ValueAxis,
    /// What is drawn of these.
    pub scenery: Scenery,
}

/// What is shown of a Cartesian grid, from where.
#[derive(Clone, Debug)]
pub struct CartesianPicture {
    /// The camera and the pixels of the picture; the job's own view is the grid's.
    pub view: View,
    /// Depths between which its rays go.
    pub planes: [f64; 2],
    /// The grid.
    pub lattice: Lattice,
    /// What is drawn of it.
    pub scenery: Scenery,
}

impl CartesianPicture {
    /// Most cells along the longest side with which the box's grid fits into so many bytes.
    pub fn most_cells(&self, attribute: bool, bytes: u64) -> u32 {
        let longest = self.lattice.cells.into_iter().max().unwrap_or(1);
        let fits =
            |cells: u32| Cut::whole(&self.lattice.coarser(cells).grid, MOST_TIERS, attribute, 0, bytes).is_some();
        // What fits with some cells fits with fewer.
        let (mut most, mut behind) = (0, longest);
        while most + 1 < behind {
            let cells = most.midpoint(behind);
            *if fits(cells) { &mut most } else { &mut behind } = cells;
        }
        most
    }
}

impl VolumeJob {
    /// The picture that a technique's passes draw of particles within extents as the processor would; `None` for passes that are not those
    /// of volumes. `attribute`: whether particles have one.
    ///
    /// # Errors
    /// [`VolumeError`] for planes and grids that make no sense, and where nothing is in view.
    pub fn picture_of(
        number: u64,
        passes: &LightPasses,
        view: &View,
        extents: &[Extent],
        attribute: bool,
    ) -> Result<Option<VolumeJob>, VolumeError> {
        let (view, grid, options, shows) = match passes {
            LightPasses::March(scenery, options) => {
                let (grid, _) = planes_and_widest(view, extents.iter().copied(), options)?;
                (*view, grid, *options, Shows::Light(Arc::new(scenery.clone())))
            }
            LightPasses::Columns(march) => {
                let (grid, _) = planes_and_widest(view, extents.iter().copied(), &march.options)?;
                (*view, grid, march.options, Shows::Columns(Arc::new(ColumnMarch::clone(march))))
            }
            LightPasses::Cartesian(scenery, options, cartesian) => {
                let (lattice, planes) = Lattice::of(view, extents, cartesian, attribute, options)?;
                let picture = CartesianPicture { view: *view, planes, lattice, scenery: scenery.clone() };
                // What is behind something else belongs to the grid too.
                let options = VolumeOptions { occlusion: false, ..*options };
                (lattice.view.with_cut(view.cut), lattice.grid, options, Shows::Cartesian(Arc::new(picture)))
            }
            _ => return Ok(None),
        };
        Ok(Some(VolumeJob { number, view, grid, options, stride: 1, shows, covers: false }))
    }

    /// The picture of a field as the processor would march through it, coloured by a channel of its own where one is named.
    pub fn of_field(number: u64, view: &View, field: &Arc<Field>, hue: Option<usize>, march: &FieldMarch) -> VolumeJob {
        let FieldMarch { grid, axis, scenery, options, .. } = march;
        let picture = FieldPicture { field: Arc::clone(field), hue, axis: *axis, scenery: scenery.clone() };
        let shows = Shows::Field(Arc::new(picture));
        VolumeJob { number, view: *view, grid: *grid, options: *options, stride: 1, shows, covers: false }
    }

    /// The same with what covers each pixel, in the light that it has before that is smoothed.
    #[must_use]
    pub fn covering(self) -> VolumeJob {
        VolumeJob { covers: true, options: VolumeOptions { smoothing: 0, ..self.options }, ..self }
    }

    /// The camera and the pixels of the picture.
    pub fn seen_from(&self) -> &View {
        match &self.shows {
            Shows::Cartesian(picture) => &picture.view,
            Shows::Light(_) | Shows::Columns(_) | Shows::Field(_) | Shows::Ranges => &self.view,
        }
    }

    /// The camera that particles are brought to, of a list that is made for `list`.
    pub fn camera<'a>(&'a self, list: &'a View) -> &'a View {
        match &self.shows {
            Shows::Cartesian(_) | Shows::Field(_) => &self.view,
            Shows::Light(_) | Shows::Columns(_) | Shows::Ranges => list,
        }
    }

    /// What is drawn; `None` for ranges.
    pub fn scenery(&self) -> Option<&Scenery> {
        match &self.shows {
            Shows::Light(scenery) => Some(scenery),
            Shows::Columns(march) => Some(&march.scenery),
            Shows::Cartesian(picture) => Some(&picture.scenery),
            Shows::Field(picture) => Some(&picture.scenery),
            Shows::Ranges => None,
        }
    }

    /// The Cartesian grid, if it is that.
    pub fn cartesian(&self) -> Option<&CartesianPicture> {
        match &self.shows {
            Shows::Cartesian(picture) => Some(picture),
            Shows::Light(_) | Shows::Columns(_) | Shows::Field(_) | Shows::Ranges => None,
        }
    }

    /// The samples, if they are drawn.
    pub fn field(&self) -> Option<&FieldPicture> {
        match &self.shows {
            Shows::Field(picture) => Some(picture),
            Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Ranges => None,
        }
    }

    /// The columns, if their fields are drawn.
    pub fn columns(&self) -> Option<&ColumnMarch> {
        match &self.shows {
            Shows::Columns(march) => Some(march),
            Shows::Light(_) | Shows::Cartesian(_) | Shows::Field(_) | Shows::Ranges => None,
        }
    }

    /// Whether rays go through it slab by slab.
    pub fn is_cast(&self) -> bool {
        matches!(self.shows, Shows::Light(_) | Shows::Columns(_) | Shows::Field(_))
    }

    /// Whether it is read back where rays end: what hides particles. Of a field nothing is left out for it.
    pub fn reads_ends(&self) -> bool {
        self.options.occlusion && matches!(self.shows, Shows::Light(_) | Shows::Columns(_))
    }

    /// Whether the light on its surfaces is smoothed.
    pub fn smooths(&self) -> bool {
        let has_light =
            |scenery: &Scenery| self.options.smoothing > 0 && scenery.light.is_some() && !scenery.surfaces.is_empty();
        self.is_cast() && self.scenery().is_some_and(has_light)
    }

    /// Whether it is kept what covers each pixel.
    pub fn keeps_covering(&self) -> bool {
        let has_surfaces = |scenery: &Scenery| !scenery.surfaces.is_empty();
        self.covers && self.is_cast() && self.scenery().is_some_and(has_surfaces)
    }

    /// Whether a surface is kept for each pixel: to be smoothed, or since it covers.
    pub fn keeps_faces(&self) -> bool {
        self.smooths() || self.keeps_covering()
    }

    /// Whether the same is wanted.
    pub fn is_same(&self, other: &VolumeJob) -> bool {
        let shows = match (&self.shows, &other.shows) {
            (Shows::Light(a), Shows::Light(b)) => Arc::ptr_eq(a, b),
            (Shows::Columns(a), Shows::Columns(b)) => Arc::ptr_eq(a, b),
            (Shows::Cartesian(a), Shows::Cartesian(b)) => Arc::ptr_eq(a, b),
            (Shows::Field(a), Shows::Field(b)) => Arc::ptr_eq(a, b),
            (Shows::Ranges, Shows::Ranges) => true,
            _ => false,
        };
        shows
            && self.number == other.number
            && self.view == other.view
            && self.grid == other.grid
            && self.options == other.options
            && self.stride == other.stride
            && self.covers == other.covers
    }
}

/// What has been found out about the volumes of a camera's frames.
#[derive(Clone, Debug, Default)]
pub struct VolumeFindings {
    /// The ranges of a job.
    pub ranges: Option<(u64, Option<FieldRange>)>,
    /// The last picture that is complete.
    pub drawn: Option<u64>,
    /// What a complete picture hides, where that was asked for.
    pub opaque: Option<(u64, Arc<OpaqueDepths>)>,
    /// Slabs that have been drawn of the present picture, and how many it has.
    pub slabs: [usize; 2],
    /// Pairs of a bin and a particle in it, over all slabs of the last complete picture.
    pub pairs: u64,
    /// Particles that the grid has enlarged, without those of slabs that nobody saw.
    pub raised: u64,
    /// Bricks that something may have reached.
    pub bricks: u64,
    /// Bytes on the adapter.
    pub bytes: u64,
    /// The job for which there was no room even for the thinnest slabs.
    pub no_room: Option<u64>,
    /// Most cells along the longest side of a Cartesian grid that would have fitted in its place.
    pub most_cells: Option<u32>,
    /// Slabs are thinner than asked for, since the adapter has no more memory.
    pub thinner: bool,
    /// By how many levels the samples of a field in a job are coarser than its grid asks for, since the adapter has no more memory.
    pub coarser: Option<(u64, usize)>,
}

/// What is known of volumes.
pub type VolumeNews = News<VolumeFindings>;
