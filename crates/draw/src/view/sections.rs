//! The perspective pictures that a panorama is put together from: faces of a cube around the eye, cut to what the panorama
//! shows of them; for omnidirectional stereo a cube for each slice of azimuth, turned to its middle.
//!
//! A face's middle, where its pixels are widest, has as many pixels per angle as the panorama, times a factor. Each pixel of
//! the panorama is the mean of a few evenly spread samples, and each of these belongs to one face.

use super::{Omnidirectional, Panorama, Projection, Side, View};
use glam::DVec3;
use rayon::prelude::*;

/// How faces are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Pixels of a face's middle for one of the panorama, along each axis. A cube's faces are drawn as they are.
    pub oversampling: f64,
    /// Samples for each of the face's pixels along each axis, where a pixel of the panorama covers several: from 1 on no light
    /// falls between samples.
    pub density: f64,
    /// Pixels that a face is drawn beyond what is looked at, on each side: what draws it may look at neighbours.
    pub margin: u32,
}

/// The part of a face that is looked at, pixels: smallest and largest coordinates.
type Seen = [[f64; 2]; 2];

const NOTHING: Seen = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];

/// One perspective picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Which side of the cube it is a part of.
    pub side: Side,
    /// Where its top left corner lies on that side, pixels.
    pub corner: [i64; 2],
    /// What is drawn.
    pub view: View,
}

/// How a panorama is put together.
#[derive(Clone, Debug)]
pub struct Sections {
    panorama: Panorama,
    circle: Option<Omnidirectional>,
    sampling: Sampling,
    /// Edge of a side, pixels.
    edge: f64,
    /// The section of each pixel; empty where there is only one.
    owners: Vec<u16>,
    /// What is looked at of each section's sides.
    seen: Vec<[Seen; 6]>,
}

impl Sections {
    /// The sections of a panorama: one, or as many as the circle of a stereo picture has slices.
    pub fn new(panorama: Panorama, circle: Option<Omnidirectional>, sampling: Sampling) -> Sections {
        let (sampling, edge) = match panorama.face_edge() {
            Some(edge) => (Sampling { oversampling: 1.0, ..sampling }, f64::from(edge)),
            None => (sampling, (2.0 * sampling.oversampling / panorama.pixel_angle()).ceil()),
        };
        let count = circle.map_or(1, |circle| circle.slices as usize);
        let width = panorama.width as usize;
        let mut sections =
            Sections { panorama, circle, sampling, edge, owners: Vec::new(), seen: vec![[NOTHING; 6]; count] };
        if let Some(circle) = circle {
            let mut owners = vec![0; width * panorama.height as usize];
            owners.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (x, owner) in row.iter_mut().enumerate() {
                    let azimuth = shown_by(&panorama, [x, y])
                        .map_or(0.0, |direction| direction.dot(panorama.right).atan2(direction.dot(panorama.forward)));
                    *owner = circle.slice(azimuth) as u16;
                }
            });
            sections.owners = owners;
        }
        let row = |mut seen: Vec<[Seen; 6]>, y: usize| {
            for x in 0..width {
                let section = sections.owner(x, y);
                let axes = sections.axes(section);
                sections.samples([x, y], axes, |side, at, _| {
                    let seen = &mut seen[section][side as usize];
                    for k in 0..2 {
                        seen[0][k] = seen[0][k].min(at[k]);
                        seen[1][k] = seen[1][k].max(at[k]);
                    }
                });
            }
            seen
        };
        let none = || vec![[NOTHING; 6]; count];
        let rows = (0..panorama.height as usize).into_par_iter().fold(none, row);
        sections.seen = rows.reduce(none, |mut a, b| {
            for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
                for k in 0..2 {
                    a[0][k] = a[0][k].min(b[0][k]);
                    a[1][k] = a[1][k].max(b[1][k]);
                }
            }
            a
        });
        sections
    }

    /// The panorama.
    pub fn panorama(&self) -> &Panorama {
        &self.panorama
    }

    /// Number of sections.
    pub fn count(&self) -> usize {
        self.seen.len()
    }

    /// Pixels of a face's middle for one of the panorama.
    pub fn oversampling(&self) -> f64 {
        self.sampling.oversampling
    }

    /// The section that a pixel belongs to.
    pub fn owner(&self, x: usize, y: usize) -> usize {
        self.owners.get(y * self.panorama.width as usize + x).map_or(0, |&owner| usize::from(owner))
    }

    /// Right, up and forward of a section's cube.
    pub fn axes(&self, section: usize) -> [DVec3; 3] {
        let Panorama { right, up, forward, .. } = self.panorama;
        match self.circle {
            None => self.panorama.frame(),
            Some(circle) => {
                let (sin, cos) = circle.middle(section as u32).sin_cos();
                [cos * right - sin * forward, up, cos * forward + sin * right]
            }
        }
    }

    /// The faces of a section, seen from its eye; `base` stands in the panorama's middle and says what is left out.
    pub fn faces(&self, section: usize, base: &View) -> Vec<Face> {
        let axes = self.axes(section);
        let Panorama { right, forward, .. } = self.panorama;
        let away = self.circle.map_or(DVec3::ZERO, |circle| circle.eye(circle.middle(section as u32), right, forward));
        let margin = i64::from(self.sampling.margin);
        let face = |side: Side| {
            let [low, high] = self.seen[section][side as usize];
            if low[0] > high[0] {
                return None;
            }
            // A sample lies between the centres of four pixels.
            let corner = low.map(|at| (at - 0.5).floor() as i64 - margin);
            let end = high.map(|at| (at - 0.5).floor() as i64 + 2 + margin);
            let [right, up, forward] = side.axes(axes);
            let edge = self.edge as u32;
            let projection = Projection::Perspective { fov_y: std::f64::consts::FRAC_PI_2 };
            let eye = base.eye + away;
            let whole =
                View { eye, right, up, forward, projection, width: edge, height: edge, shift: [0.0; 2], ..*base };
            let size = [0, 1].map(|k| (end[k] - corner[k]).clamp(1, 1 << 20) as u32);
            Some(Face { side, corner, view: whole.part(corner.map(|at| at as f64), size[0], size[1]) })
        };
        Side::ALL.into_iter().filter_map(face).collect()
    }

    /// Calls `each` for every sample of a pixel that shows something: the side that it lies on, where, in pixels of that
    /// side, and its share in the pixel.
    pub fn samples(&self, [x, y]: [usize; 2], axes: [DVec3; 3], mut each: impl FnMut(Side, [f64; 2], f32)) {
        let count = self.samples_across([x, y], axes);
        let share = 1.0 / (count * count) as f32;
        let step = 1.0 / f64::from(count);
        let place = |index: u32| (f64::from(index) + 0.5) * step;
        for (i, j) in (0..count).flat_map(|j| (0..count).map(move |i| (i, j))) {
            let point = [x as f64 + place(i), y as f64 + place(j)];
            let Some(direction) = self.panorama.direction(point) else { continue };
            let (side, [u, v]) = Side::of(DVec3::from(axes.map(|axis| direction.dot(axis))));
            each(side, [0.5 * self.edge * (1.0 + u), 0.5 * self.edge * (1.0 - v)], share);
        }
    }

    /// Samples of a pixel along each axis: a face's pixels are narrower towards its edges, by the squared cosine of the angle from
    /// its middle.
    fn samples_across(&self, [x, y]: [usize; 2], axes: [DVec3; 3]) -> u32 {
        if self.panorama.face_edge().is_some() {
            return 1;
        }
        let Some(direction) = self.panorama.direction([x as f64 + 0.5, y as f64 + 0.5]) else { return 2 };
        let cosine = axes.map(|axis| direction.dot(axis).abs()).into_iter().fold(0.5, f64::max);
        let Sampling { oversampling, density, .. } = self.sampling;
        (density * oversampling / (cosine * cosine) - 1e-9).ceil().clamp(1.0, 16.0) as u32
    }
}

/// The direction that a pixel's middle shows; of a pixel on a rim whose middle shows none, one that its samples show.
fn shown_by(panorama: &Panorama, [x, y]: [usize; 2]) -> Option<DVec3> {
    let places = [[0.5, 0.5], [0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];
    places.into_iter().find_map(|[dx, dy]| panorama.direction([x as f64 + dx, y as f64 + dy]))
}

#[cfg(test)]
mod tests {
    use super::super::{CubeLayout, Surround};
    use super::*;

    const SAMPLING: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };

    fn base() -> View {
        let projection = Projection::Perspective { fov_y: 1.0 };
        View::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y, projection, 60, 60).unwrap()
    }

    /// Every sample lies between four pixels of its face, and shows the direction that the panorama's pixel does.
    #[test]
    fn faces_hold_what_is_looked_at() {
        let base = base();
        let circle = Omnidirectional { offset: 0.02, slices: 12 };
        for (surround, circle, most) in [
            (Surround::Dome { aperture: 180.0, tilt: 15.0 }, None, 5),
            (Surround::Dome { aperture: 60.0, tilt: 15.0 }, None, 1),
            (Surround::Dome { aperture: 360.0, tilt: 0.0 }, None, 6),
            // 15 degrees to each side of a slice's middle are within its front, its zenith and its nadir, on the rim too.
            (Surround::Dome { aperture: 180.0, tilt: 15.0 }, Some(circle), 2),
            (Surround::Equirectangular, Some(circle), 3),
            (Surround::Equirectangular, None, 6),
            (Surround::Cube { layout: CubeLayout::Cross }, None, 6),
        ] {
            let panorama = Panorama::around(&base, surround).unwrap().unwrap();
            let sections = Sections::new(panorama, circle, SAMPLING);
            assert_eq!(sections.count(), if circle.is_some() { 12 } else { 1 });
            for section in 0..sections.count() {
                let faces = sections.faces(section, &base);
                assert!(faces.len() <= most, "{surround:?}: {} faces", faces.len());
                for (x, y) in
                    (0..panorama.height as usize).flat_map(|y| (0..panorama.width as usize).map(move |x| (x, y)))
                {
                    if sections.owner(x, y) != section {
                        continue;
                    }
                    sections.samples([x, y], sections.axes(section), |side, at, _| {
                        let face = faces.iter().find(|face| face.side == side).unwrap();
                        let within = [at[0] - face.corner[0] as f64, at[1] - face.corner[1] as f64];
                        let size = [face.view.width, face.view.height].map(f64::from);
                        assert!((0..2).all(|k| within[k] >= 0.5 && within[k] <= size[k] - 0.5), "{within:?} {size:?}");
                        let shown = (face.view.at_depth(within, 1.0) - face.view.eye).normalize();
                        let near = panorama.pixel(shown).is_none_or(|[u, v]| {
                            let wrapped = (u - x as f64 - 0.5).abs() > 30.0;
                            wrapped || (u - x as f64 - 0.5).abs() <= 0.51 && (v - y as f64 - 0.5).abs() <= 0.51
                        });
                        assert!(near, "{surround:?}");
                    });
                }
            }
        }
    }
}
