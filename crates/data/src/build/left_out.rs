//! How good splines are: sampled particles of a step, compared with the spline between the steps around it.

use super::matching::Joining;
use super::states::State;
use crate::hierarchy::spacetime::HermiteSpline;
use crate::store::run::{Deviation, Tangents};
use glam::DVec3;

/// How far the sampled particles of the middle one of three steps (records and clock) are from the spline between the others, for
/// each family with velocities that has such.
pub(super) fn left_out(joining: &Joining, samples: [&[u32]; 3], clock: [f64; 3]) -> Vec<(usize, Deviation)> {
    let (length, u) = (clock[2] - clock[0], (clock[1] - clock[0]) / (clock[2] - clock[0]));
    let lattice = joining.layout.lattice;
    let mut all: Vec<Vec<f64>> = vec![Vec::new(); joining.layout.families.len()];
    let [first, middle, last] = samples.map(|sample| alone(sample, joining.layout.words));
    for begin in &first {
        let other = |states: &[State]| states.binary_search_by_key(&begin.id, |state| state.id).ok();
        let (Some(at), Some(end)) = (other(&middle), other(&last)) else { continue };
        let (truth, end) = (&middle[at], &last[end]);
        let (Tangents::Velocity, scale) = joining.tangents[begin.family] else { continue };
        if truth.family != begin.family || end.family != begin.family {
            continue;
        }
        let tangents = [begin, end].map(|state| DVec3::from(state.velocity.map(f64::from)) * scale * length);
        let way = 0.5 * (tangents[0] + tangents[1]) / lattice.unit();
        let predicted = std::array::from_fn(|axis| begin.place[axis].saturating_add(way[axis] as i64));
        let places = [begin.place, joining.nearest_image(predicted, end.place)];
        let spline = HermiteSpline { positions: places.map(|place| DVec3::from(lattice.position(place))), tangents };
        let there = spline.position(u);
        let near = joining.nearest_image(lattice.place(there.to_array()), truth.place);
        let distance = (DVec3::from(lattice.position(near)) - there).length();
        if distance.is_finite() {
            all[begin.family].push(distance);
        }
    }
    let found = all.into_iter().enumerate().filter(|(_, distances)| !distances.is_empty());
    found.map(|(family, distances)| (family, deviation(distances))).collect()
}

/// The states of a sample whose ids are theirs alone, by id.
fn alone(sample: &[u32], words: usize) -> Vec<State<'_>> {
    let mut states: Vec<State> = sample.chunks_exact(words).map(State::of).collect();
    states.sort_by_key(|state| state.id);
    let groups = states.chunk_by(|a, b| a.id == b.id);
    groups.filter_map(|group| if let [only] = group { Some(*only) } else { None }).collect()
}

/// Of distances, of which there are some.
fn deviation(mut distances: Vec<f64>) -> Deviation {
    distances.sort_by(f64::total_cmp);
    let at = |share: f64| distances[((distances.len() - 1) as f64 * share).round() as usize];
    let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
    Deviation { rms: (squares / distances.len() as f64).sqrt(), p99: at(0.99), max: at(1.0) }
}
