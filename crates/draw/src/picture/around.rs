//! Modes that draw colours, on the faces of a panorama: what a flat picture finds from its own view is found once here, so
//! that all faces are drawn alike and none shows where it ends.
//!
//! - Near and far plane: every face has the same, so that what is in front is left out within a cube around the eye. Unless set,
//!   far is the distance of the data's farthest corner and near a 256th of it.
//! - Ranges of densities and attributes are those of all the data; of the fields of attributes, and of slices, of what all views show together.
//! - Particles too small for the picture are raised to the least size in the panorama's pixels, in every direction; the same for
//!   all, as faces have wider pixels in their middle than towards their edges. Modes that raise none in a flat picture do not here.
//! - A Cartesian grid is laid around all the data.

use super::subject::Subject;
use crate::color::transfer::{Range, TransferFunction};
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::range::FieldRange;
use crate::cpu::volume::{VolumeError, VolumeOptions, range};
use crate::cpu::{Extent, SplatError, Splats};
use crate::mode::{Depiction, InView, LightPicture, SettingValue};
use crate::model::{Bounds, Covariance, Kernel};
use crate::modes::grid;
use crate::view::perspective_grid::GridError;
use crate::view::{PerspectiveGrid, Projection, View, ViewError};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Longest side of the picture of all data by which ranges are found, pixels.
const SIDE: u32 = 512;

/// A mode and its settings, as all faces have them.
#[derive(Clone)]
pub struct SharedLook {
    /// The mode, with the planes set.
    pub depiction: Depiction,
    /// The transfer function, with its ranges set.
    pub transfer: TransferFunction,
    /// What all views show together, where ranges are looked for in that.
    pub in_views: Option<Arc<InView>>,
    /// Least smoothing length over distance; 0 where nothing is raised.
    least: f64,
    /// The camera: lamps beside the eye go with it, not with a face.
    camera: View,
}

/// The batches of one node or family, with smoothing lengths of their own.
struct Raised {
    sizes: Sizes,
    density: Option<Vec<f32>>,
}

/// How large raised particles are.
enum Sizes {
    /// Smoothing lengths.
    Balls(Vec<f32>),
    /// Second moments.
    Ellipsoids(Vec<Covariance>),
}

/// A parallel view of all that lies in `bounds`, whose longest side is `pixels`.
///
/// # Errors
/// [`ViewError`] for bounds that are not finite.
pub fn whole(view: &View, bounds: Bounds, pixels: u32) -> Result<View, ViewError> {
    let reach = bounds.size().length().max(bounds.center().abs().max_element() * 1e-9).max(1e-30);
    let projection = Projection::Orthographic { height: 1.02 * reach };
    let eye = bounds.center() - reach * view.forward;
    let all = View::look_at(eye, bounds.center(), view.up, projection, pixels, pixels)?;
    Ok(View { cut: view.cut, images: view.images, ..all })
}

/// The view whose selection of nodes shows all data as finely as ranges are found.
///
/// # Errors
/// As [`whole`].
pub fn sketch(view: &View, bounds: Bounds) -> Result<View, ViewError> {
    whole(view, bounds, SIDE)
}

impl SharedLook {
    /// What all faces share: for an eye and data within `bounds`, where a pixel is `pixel` radians wide. `all` are the
    /// particles that [`sketch`] selects.
    ///
    /// # Errors
    /// [`VolumeError`] where there is nothing in the data.
    pub fn new(
        subject: &Subject<'_>,
        view: &View,
        bounds: Bounds,
        pixel: f64,
        all: &[Splats<'_>],
    ) -> Result<SharedLook, VolumeError> {
        let mut depiction = subject.depiction.clone();
        let of_data = depiction.needs().of_data;
        let settings = &mut depiction.settings;
        let corner = |index: usize| {
            let pick = |axis: usize| if index >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            DVec3::new(pick(0), pick(1), pick(2)).distance(view.eye)
        };
        let (near, mut far) = (settings.number(&grid::NEAR), settings.number(&grid::FAR));
        if far <= 0.0 {
            far = 1.02 * (0..8).map(corner).fold(0.0, f64::max);
        }
        settings.set(&grid::FAR, SettingValue::Number(far));
        if near <= 0.0 {
            settings.set(&grid::NEAR, SettingValue::Number(PerspectiveGrid::NEAREST * far));
        }
        let smallest = settings.number(&grid::SMALLEST_CELLS) * pixel;
        let raises = depiction.mode.own_settings().any(|own| own.name == grid::SMALLEST_CELLS.name);
        let least = match raises && !of_data {
            true => smallest / settings.number(&grid::RESOLUTION),
            false => 0.0,
        };
        depiction.mode.technique.for_panorama(settings, all, subject.metadata.kernel);
        let mut transfer = subject.transfer.clone();
        if transfer.numbers().is_none() && !depiction.mode.technique.looks_in_view(settings, &transfer) {
            let flat = |_| VolumeError::Grid(GridError::NothingInView);
            let options = VolumeOptions { kernel: subject.metadata.kernel, ..VolumeOptions::default() };
            let FieldRange { density, attribute } =
                range::measure(&sketch(view, bounds).map_err(flat)?, all, &options)?;
            if transfer.range == Range::Auto {
                transfer.range = Range::Fixed(density[0], density[1]);
            }
            if let Some(hue) = transfer.hue.as_mut().filter(|hue| hue.range == Range::Auto) {
                let [low, high] = Range::apart(attribute);
                hue.range = Range::Fixed(low, high);
            }
        }
        Ok(SharedLook { depiction, transfer, in_views: None, least, camera: *view })
    }

    /// Paints a face of a panorama whose pixels are `around` radians wide, or a flat picture, paths among what it shows; `None` where it
    /// shows nothing but these.
    ///
    /// # Errors
    /// [`VolumeError`] for settings that do not fit.
    pub fn paint(
        &self,
        subject: &Subject<'_>,
        view: &View,
        batches: &[Splats<'_>],
        (paths, around): (Option<&PathFragments>, Option<f64>),
    ) -> Result<Option<LightPicture>, VolumeError> {
        let raised: Vec<Option<Raised>> = batches.par_iter().map(|batch| self.raised(view.eye, batch)).collect();
        let batches = batches.iter().zip(&raised).map(|(batch, raised)| match raised {
            None => Ok(*batch),
            Some(Raised { sizes, density }) => {
                let extent = match sizes {
                    Sizes::Balls(lengths) => Extent::World(lengths),
                    Sizes::Ellipsoids(covariances) => Extent::Ellipsoids(covariances),
                };
                let same = Splats::new(batch.positions(), extent, batch.weight(), batch.attribute())?;
                same.with_traits(batch.traits()).with_density(density.as_deref())?.with_fields(batch.fields())
            }
        });
        let batches = batches.collect::<Result<Vec<_>, SplatError>>()?;
        let subject = self.subject(subject);
        let drawn = subject.draw_face(view, &batches, paths, around);
        unless_empty(drawn.and_then(|raw| raw.light(self.depiction.mode)))
    }

    /// A subject as all faces have it.
    pub fn subject<'a>(&'a self, subject: &Subject<'a>) -> Subject<'a> {
        let in_views = self.in_views.as_deref();
        let lighting = Lighting { camera: Some(&self.camera), ..subject.lighting };
        Subject { depiction: &self.depiction, transfer: &self.transfer, in_views, lighting, ..*subject }
    }

    /// A batch whose smallest particles are as large as the panorama's pixels ask for, its masses what they are. Of ellipsoids each
    /// principal semi-axis is.
    fn raised(&self, eye: DVec3, batch: &Splats<'_>) -> Option<Raised> {
        if self.least <= 0.0 {
            return None;
        }
        let positions = batch.positions();
        let least = |i: usize| self.least * positions.world(i).distance(eye);
        let lengths = match batch.extent() {
            Extent::Pixels(_) => return None,
            Extent::World(lengths) => lengths,
            Extent::Ellipsoids(covariances) => return raised_ellipsoids(batch, covariances, least),
        };
        let least = |i: usize| least(i) as f32;
        if (0..lengths.len()).all(|i| lengths[i] >= least(i)) {
            return None;
        }
        // What has no extent stays without.
        let grown = |i: usize| if lengths[i] > 0.0 { lengths[i].max(least(i)) } else { lengths[i] };
        let h: Vec<f32> = (0..lengths.len()).map(grown).collect();
        let density = batch.density().map(|densities| {
            let thinner = |(i, &density): (usize, &f32)| density * (lengths[i] / h[i]).powi(3);
            densities.iter().enumerate().map(thinner).collect()
        });
        Some(Raised { sizes: Sizes::Balls(h), density })
    }
}

/// The same of ellipsoids, whose semi-axes for the default kernel become at least `least` long.
fn raised_ellipsoids(batch: &Splats<'_>, covariances: &[Covariance], least: impl Fn(usize) -> f64) -> Option<Raised> {
    let variance = Kernel::default().variance();
    let mut density = batch.density().map(<[f32]>::to_vec);
    let mut is_raised = false;
    let grown = |(i, covariance): (usize, &Covariance)| {
        let (values, axes) = covariance.principal();
        let least = variance * least(i) * least(i);
        // What is no covariance stays none.
        if !(values.z < least && values.x > 0.0 && values.is_finite()) {
            return *covariance;
        }
        is_raised = true;
        let raised = values.max(DVec3::splat(least));
        if let Some(density) = &mut density {
            let thinner = (values.max(DVec3::ZERO) / raised).element_product().sqrt();
            density[i] *= thinner as f32;
        }
        Covariance::of(axes * DMat3::from_diagonal(raised) * axes.transpose())
    };
    let covariances = covariances.iter().enumerate().map(grown).collect();
    is_raised.then_some(Raised { sizes: Sizes::Ellipsoids(covariances), density })
}

/// The light of a face; `None` where it shows nothing.
///
/// # Errors
/// Whatever else is wrong.
pub(super) fn unless_empty(drawn: Result<LightPicture, VolumeError>) -> Result<Option<LightPicture>, VolumeError> {
    match drawn {
        Ok(painted) => Ok(Some(painted)),
        Err(VolumeError::Grid(GridError::NothingInView)) => Ok(None),
        // No particle in this face is dense enough; where none is in any, that is said before.
        Err(VolumeError::Setting { field: "threshold", .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The places between which data lies, with all images of a periodic box that a view draws.
pub fn with_images(view: &View, bounds: Bounds) -> Bounds {
    view.images.offsets().map(|offset| bounds.moved(offset)).fold(Bounds::EMPTY, Bounds::union)
}
