//! The flow levels of a family over an interval, put together region by region.

use crate::hierarchy::spacetime::Tracks;
use crate::store::run::FlowTracks;

/// A cluster at one end of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    /// Whether it is of particles that are not there.
    pub is_ghost: bool,
    pub number: u32,
}

/// The flow levels of a family over an interval, as far as regions are done.
pub(super) struct FlowLevels {
    pub levels: Vec<FlowTracks>,
    /// Of each level which clusters its tracks' numbers name.
    pub places: Vec<Vec<[Place; 2]>>,
    /// Clusters of particles that are not there, at both ends.
    pub ghosts: Vec<[u32; 2]>,
}

impl FlowLevels {
    /// None yet; `count` levels of tracks with so many attributes.
    pub fn new(count: usize, attributes: usize) -> FlowLevels {
        let level = |_| FlowTracks { tracks: Tracks::new(attributes), ..FlowTracks::default() };
        FlowLevels {
            levels: (0..count).map(level).collect(),
            places: vec![Vec::new(); count],
            ghosts: vec![[0; 2]; count],
        }
    }

    /// Appends those of another region; `starts`: the number of its first cluster at the end, of each level.
    pub fn append(&mut self, other: FlowLevels, starts: &[u32]) {
        let firsts: Vec<u32> = self.levels.iter().map(|level| level.len() as u32).collect();
        for (level, more) in other.levels.into_iter().enumerate() {
            let own = &mut self.levels[level];
            let children = more.children.iter().skip(usize::from(!own.children.is_empty()));
            let first_child = level.checked_sub(1).map_or(0, |finer| firsts[finer]);
            own.children.extend(children.map(|child| first_child + child));
            own.tracks.flags.extend(more.tracks.flags);
            for (end, more) in own.tracks.ends.iter_mut().zip(more.tracks.ends) {
                end.places.extend(more.places);
                end.movements.extend(more.movements);
                end.mass.extend(more.mass);
                end.density.extend(more.density);
                end.smoothing_length.extend(more.smoothing_length);
                end.attributes.iter_mut().zip(more.attributes).for_each(|(column, more)| column.extend(more));
            }
            own.counts.extend(more.counts);
            own.faded.extend(more.faded);
            let ghosts = self.ghosts[level];
            let global = |places: [Place; 2]| {
                let [begin, end] = places;
                let begin_first = if begin.is_ghost { ghosts[0] } else { 0 };
                let end_first = if end.is_ghost { ghosts[1] } else { starts[level] };
                [Place { number: begin_first + begin.number, ..begin }, Place { number: end_first + end.number, ..end }]
            };
            self.places[level].extend(other.places[level].iter().copied().map(global));
            (0..2).for_each(|end| self.ghosts[level][end] += other.ghosts[level][end]);
        }
    }

    /// With numbers of clusters that are those of their steps: the ones that are there first, as many as `begins` and `ends` say.
    pub fn finish(self, begins: &[usize], ends: &[usize]) -> Vec<FlowTracks> {
        let mut levels = self.levels;
        for (level, own) in levels.iter_mut().enumerate() {
            if level > 0 && own.children.is_empty() {
                own.children.push(0);
            }
            // What would be at the step from the interval before, and from the one after, has no number in common.
            let number = |place: &Place, count: usize, parity: u32| match place.is_ghost {
                true => count as u32 + 2 * place.number + parity,
                false => place.number,
            };
            let places = &self.places[level];
            own.clusters = [
                places.iter().map(|[begin, _]| number(begin, begins[level], 0)).collect(),
                places.iter().map(|[_, end]| number(end, ends[level], 1)).collect(),
            ];
        }
        levels
    }
}
