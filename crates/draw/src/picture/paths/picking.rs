//! The path under a pixel of a picture: what it stands for, and who is in it.

use super::{Chosen, PathLayer, PathRequest, Selected, Sight};
use crate::explore::IdSet;
use crate::model::FamilyName;
use crate::picture::PictureError;
use crate::store::StoreError;
use crate::store::run::TrackNode;
use crate::view::View;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashSet;

/// Straight parts that a curve is looked at in.
const PARTS: usize = 16;

/// A path of a picture: the track of a particle or of a cluster over an interval.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedPath {
    /// Whose.
    pub family: FamilyName,
    /// The interval, by the step that begins it.
    pub interval: usize,
    /// The flow level; 0 for a particle.
    pub level: usize,
    /// Particles that it stands for.
    pub count: u32,
    /// Mass at both ends, by its weight there.
    pub mass: [f64; 2],
    /// Speed in the middle, world units by the clock's.
    pub speed: f64,
    /// Where it begins and ends, world units; in a periodic box the end is the image that it reaches.
    pub positions: [DVec3; 2],
    /// The attribute that colours paths, at both ends.
    pub value: Option<(String, [f64; 2])>,
    /// How far it is from the pixel's middle, pixels.
    pub pixels: f64,
    /// The family's number in the run, the leaf (0 of clusters), and the track among those that were read of it.
    track: [u32; 3],
}

impl PathLayer {
    /// The path of a picture that is nearest to a place in it, within `reach` pixels.
    ///
    /// # Errors
    /// As [`PathLayer::gather`].
    pub fn pick(
        &mut self,
        request: &PathRequest<'_>,
        at: [f64; 2],
        reach: f64,
    ) -> Result<Option<PickedPath>, PictureError> {
        let sight = Sight::flat([*request.view], request.view.height);
        let Some(Selected { chosen, .. }) = self.select(request, &sight, false)? else { return Ok(None) };
        let offsets: Vec<DVec3> = request.view.images.offsets().collect();
        let nearest = |own: &Chosen| -> Option<(f64, u32)> {
            let near = |i: u32| {
                let away =
                    offsets.iter().filter_map(|offset| distance(own, i as usize, *offset, request.view, at, reach));
                Some((away.reduce(f64::min)?, i))
            };
            let first = |a: (f64, u32), b: (f64, u32)| if b.0 < a.0 { b } else { a };
            match &own.which {
                Some(which) => which.iter().filter_map(|i| near(*i)).reduce(first),
                None => (0..own.curves.len() as u32).filter_map(near).reduce(first),
            }
        };
        let found = chosen.par_iter().enumerate().filter_map(|(k, own)| nearest(own).map(|(away, i)| (away, k, i)));
        // The first of equals, whatever the number of threads.
        let best = found.min_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let Some((pixels, k, i)) = best else { return Ok(None) };
        let own = &chosen[k];
        let [interval, family, level, leaf] = own.place;
        let layout = self.run.tracks()?;
        let Some(name) = layout.families.get(family as usize).map(|family| family.name) else { return Ok(None) };
        let curve = i as usize;
        let end = |point: usize| own.curves.origin + Vec3::from(own.curves.points[curve][point]).as_dvec3();
        let value = self.kept_of.1.clone().zip(own.curves.values.get(curve).map(|ends| ends.map(f64::from)));
        Ok(Some(PickedPath {
            family: name,
            interval: interval as usize,
            level: level as usize,
            count: own.curves.count(curve),
            mass: own.curves.mass[curve].map(f64::from),
            speed: f64::from(own.curves.speed(curve)),
            positions: [end(0), end(3)],
            value,
            pixels,
            track: [family, leaf, i],
        }))
    }

    /// The particles of a path that [`PathLayer::pick`] has found last.
    ///
    /// # Errors
    /// Where the run cannot be read.
    pub fn members(&self, picked: &PickedPath) -> Result<IdSet, StoreError> {
        let [family, leaf, track] = picked.track;
        let (interval, number) = (picked.interval, family as usize);
        let index = self.run.track_index(interval, number)?;
        if picked.level == 0 {
            let Some(node) = index.nodes.get(leaf as usize) else { return Ok(IdSet::default()) };
            let tracks = self.run.node_tracks(interval, number, node, true)?;
            let is_wanted = |id: &&u64| self.kept_of.0.as_ref().is_none_or(|who| who.has(number, **id));
            let id = tracks.ids.iter().filter(is_wanted).nth(track as usize);
            return Ok(IdSet::new(id.copied().into_iter().collect()));
        }
        // The tracks of the finest level that it consists of.
        let mut parts = vec![track];
        for level in (1..picked.level).rev() {
            let coarser = self.run.flow_tracks(interval, number, level + 1)?;
            parts = parts.iter().flat_map(|part| coarser.children_of(*part as usize)).collect();
        }
        let parts: HashSet<u32> = parts.into_iter().collect();
        let leaves: Vec<&TrackNode> = index.leaves().collect();
        let of_leaf = |leaf: &&TrackNode| -> Result<Vec<u64>, StoreError> {
            let flow = self.run.leaf_flow(interval, number, leaf)?;
            if !flow.iter().any(|own| parts.contains(own)) {
                return Ok(Vec::new());
            }
            let tracks = self.run.node_tracks(interval, number, leaf, true)?;
            let is_wanted = |id: &u64| self.kept_of.0.as_ref().is_none_or(|who| who.has(number, *id));
            let own = tracks.ids.iter().zip(&flow).filter(|(id, flow)| parts.contains(flow) && is_wanted(id));
            Ok(own.map(|(id, _)| *id).collect())
        };
        let found: Vec<Vec<u64>> = leaves.par_iter().map(of_leaf).collect::<Result<_, StoreError>>()?;
        Ok(IdSet::new(found.concat()))
    }
}

/// How far the part of a curve that is drawn is from a place in the picture, if not more than `reach`, pixels.
fn distance(own: &Chosen, i: usize, offset: DVec3, view: &View, at: [f64; 2], reach: f64) -> Option<f64> {
    let points =
        own.curves.points[i].map(|point| view.to_camera(own.curves.origin + offset + Vec3::from(point).as_dvec3()));
    let pixels: [Option<[f64; 2]>; 4] = points.map(|point| view.to_pixels(point));
    // A curve lies within the hull of its control points, where all of them are before the eye.
    if let [Some(a), Some(b), Some(c), Some(d)] = pixels {
        let hull = [a, b, c, d];
        let is_beyond = |axis: usize| {
            let ends = hull.iter().map(|point| point[axis]);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
            at[axis] < low - reach || at[axis] > high + reach
        };
        if is_beyond(0) || is_beyond(1) {
            return None;
        }
    }
    let [from, to] = own.part.u.map(f64::from);
    let place = |k: usize| {
        let u = from + (to - from) * k as f64 / PARTS as f64;
        let v = 1.0 - u;
        let [a, b, c, d] = points;
        view.to_pixels(v * v * v * a + 3.0 * v * v * u * b + 3.0 * v * u * u * c + u * u * u * d)
    };
    let parts = (0..PARTS).filter_map(|k| Some(to_part(at, place(k)?, place(k + 1)?)));
    parts.reduce(f64::min).filter(|away| *away <= reach)
}

/// How far a place is from a straight part.
fn to_part([x, y]: [f64; 2], [ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    let (dx, dy) = (bx - ax, by - ay);
    let square = dx * dx + dy * dy;
    let share = if square > 0.0 { (((x - ax) * dx + (y - ay) * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
    (x - ax - share * dx).hypot(y - ay - share * dy)
}
