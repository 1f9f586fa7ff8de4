//! Particles on their way through an interval, as shaders evaluate them (`load_moving` in shaders/lib/particle.wgsl): a copy serves every
//! moment of the interval, and another moment costs a number for each node.

use super::content_look::ContentLook;
use super::scene::MOVING_WORDS;
use crate::hierarchy::spacetime::Motion;
use crate::mode::{Columns, Depiction, SourceColumns};
use crate::store::Page;
use crate::stream::copies::MOVING_BYTES;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// A particle on its way, in the order in which shaders read it.
///
/// The place is the cubic Hermite spline. The weight is the mean of both shares by the place in the interval, times what lies as far
/// between both weights; these, densities and smoothing lengths are linear in the logarithm where both are positive.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct MovingParticle {
    /// The place at the beginning, from the node's origin, world units.
    pub begin: [f32; 3],
    /// The smoothing length there.
    pub smoothing_begin: f32,
    /// The place at the end.
    pub end: [f32; 3],
    /// The smoothing length there.
    pub smoothing_end: f32,
    /// The velocity at the beginning times the length of the interval.
    pub tangent_begin: [f32; 3],
    /// The factor on the weight there that is linear in time.
    pub share_begin: f32,
    /// The velocity at the end times the length of the interval.
    pub tangent_end: [f32; 3],
    /// The factor on the weight there.
    pub share_end: f32,
    /// The weights at both ends without these factors.
    pub weight: [f32; 2],
    /// The attributes at both ends.
    pub attribute: [f32; 2],
    /// The densities at both ends, for modes that draw with them.
    pub density: [f32; 2],
    /// 1 where the attribute is linear in the logarithm, else 0.
    pub is_logarithmic: f32,
    /// Makes it whole vectors of four.
    pub unused: f32,
}

const _: () = assert!(size_of::<MovingParticle>() as u64 == MOVING_BYTES && MOVING_WORDS * 4 == MOVING_BYTES as usize);

/// When a node's particles are where, and the box that they are wrapped into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// See [`Motion::span`].
    pub span: [f64; 2],
    /// See [`Motion::holds`].
    pub holds: bool,
    /// The edge of the periodic box, world units; 0 where there is none.
    pub edge: f64,
}

impl Passage {
    /// Where in the interval a time is, from 0 to 1.
    pub fn place(&self, time: f64) -> f32 {
        Motion::place(self.span, self.holds, time) as f32
    }
}

/// A node that moves, as it is to be seen.
#[derive(Clone, Debug)]
pub struct MovingNode {
    /// The page.
    pub page: Arc<Page>,
    /// Index of the node in it.
    pub node: u32,
    /// How it is to be seen.
    pub look: Arc<ContentLook>,
}

impl MovingNode {
    /// Number of its particles.
    pub fn len(&self) -> usize {
        self.page.nodes.get(self.node as usize).map_or(0, |node| node.particles as usize)
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The particles, placed from an origin, and their passage; `None` where they do not move.
    pub(super) fn particles(&self, origin: DVec3) -> Option<(Vec<MovingParticle>, Passage)> {
        let motion = self.page.content(self.node as usize)?.motion()?;
        let names = self.look.names(self.page.family)?;
        let passage = Passage { span: motion.span, holds: motion.holds, edge: motion.box_size.unwrap_or(0.0) };
        Some((moving_particles(&self.look.depiction, names, &motion, origin), passage))
    }
}

/// What a depiction makes of a motion.
fn moving_particles(depiction: &Depiction, names: &[String], motion: &Motion, origin: DVec3) -> Vec<MovingParticle> {
    let length = motion.span[1] - motion.span[0];
    let values = |end: usize, mass: &[f32]| -> SourceColumns {
        let own = &motion.ends[end];
        let attributes: Vec<(&str, &[f32])> =
            names.iter().map(String::as_str).zip(own.attributes.iter().map(Vec::as_slice)).collect();
        depiction.values_of(&Columns {
            mass,
            density: &own.density,
            smoothing_length: &own.smoothing_length,
            attributes: &attributes,
        })
    };
    let ends = [0, 1].map(|end| values(end, &motion.ends[end].mass));
    let count = motion.ends[0].positions.len();
    // Most weights are in proportion to the mass, which is linear in time, and the rest of them is linear in the logarithm. Others
    // are so as a whole.
    let [ones, twos] = [1.0, 2.0].map(|mass| [0, 1].map(|end| values(end, &vec![mass; count]).weight));
    let is_proportional = |i: usize| (0..2).all(|end| twos[end][i] == 2.0 * ones[end][i]);
    let is_linear = depiction.attribute.as_ref().is_none_or(|coloring| match &*coloring.name {
        "mass" => true,
        "density" | "smoothing-length" => false,
        name => {
            let number = names.iter().position(|known| known == name);
            number.and_then(|k| motion.is_logarithmic.get(k)).is_none_or(|logarithmic| !logarithmic)
        }
    });
    let place = |end: usize, i: usize| (DVec3::from(motion.ends[end].positions[i]) - origin).as_vec3().to_array();
    let tangent = |end: usize, i: usize| (DVec3::from(motion.ends[end].velocities[i]) * length).as_vec3().to_array();
    let pair = |column: fn(&SourceColumns) -> Option<&Vec<f32>>, i: usize| {
        [0, 1].map(|end| column(&ends[end]).map_or(0.0, |values| values[i]))
    };
    let particle = |i: usize| {
        let (shares, weight) = match is_proportional(i) {
            true => ([0, 1].map(|end| motion.ends[end].mass[i]), [ones[0][i], ones[1][i]]),
            false => ([1.0; 2], [ends[0].weight[i], ends[1].weight[i]]),
        };
        let attribute = pair(|columns| columns.attribute.as_ref(), i);
        let is_logarithmic = !is_linear && attribute.iter().all(|value| *value > 0.0);
        MovingParticle {
            begin: place(0, i),
            smoothing_begin: motion.ends[0].smoothing_length[i],
            end: place(1, i),
            smoothing_end: motion.ends[1].smoothing_length[i],
            tangent_begin: tangent(0, i),
            share_begin: shares[0],
            tangent_end: tangent(1, i),
            share_end: shares[1],
            weight,
            attribute,
            density: pair(|columns| columns.density.as_ref(), i),
            is_logarithmic: f32::from(u8::from(is_logarithmic)),
            unused: 0.0,
        }
    };
    (0..count).into_par_iter().map(particle).collect()
}
