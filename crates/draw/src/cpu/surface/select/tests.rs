//! What is chosen where there is room for little.

use super::super::placed::Map;
use super::super::source::NodeSamples;
use super::*;
use crate::view::{Projection, View};
use deepfield_data::model::SampleType;
use deepfield_heights::model::HeightGrid;
use std::sync::Arc;

/// Rough ground without samples, each chunk of which takes a byte.
struct Rough {
    lattice: Lattice,
    room: u64,
}

impl SurfaceNodes for Rough {
    fn lattice(&self) -> Lattice {
        self.lattice
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        let whole = f64::from(1_u32 << key.level);
        let delta = if key.level == 0 { 0.0 } else { 0.3 * whole };
        let coverage = [u8::MAX; 2];
        Some(NodeFacts { delta, step: whole, min: -100.0, max: 100.0, coverage, deviation: 0.0, change: 0.0 })
    }

    fn samples(&self, _: ChunkKey) -> Option<Arc<NodeSamples>> {
        None
    }

    fn room(&self) -> u64 {
        self.room
    }

    fn bytes(&self, _: ChunkKey) -> u64 {
        1
    }
}

/// With little room what is near stays fine, and what is far becomes coarse.
#[test]
fn little_room_is_for_what_shows_most() {
    let side = (1 << 16) + 1;
    let placed = Placed::new(&HeightGrid::new(side, side, SampleType::I16), Map::Plate, 1.0, 0.0);
    let eye = DVec3::new(1000.0, 1000.0, 160.0);
    let target = eye + DVec3::new(1000.0, 1000.0, -60.0);
    let perspective = Projection::Perspective { fov_y: 0.8 };
    let sight = Sight::Flat(View::look_at(eye, target, DVec3::Z, perspective, 1200, 800).unwrap());
    let choice = Choice {
        tau: 0.8,
        technique: Technique::Hybrid,
        point: 1,
        reach: 0.0,
        looks: looked(0.8),
        lines: f64::INFINITY,
        spans: 0.0,
        walls: None,
        most: MOST_NODES,
        change: f64::INFINITY,
    };
    let chosen = |room: u64| choose(&Rough { lattice: Lattice::new(side, side), room }, &placed, &sight, &choice);
    let (whole, scant) = (chosen(u64::MAX), chosen(38));
    assert!(whole.is_converged && whole.nodes.iter().all(|node| node.error_px <= 0.8));
    assert!(scant.is_coarser && !scant.is_converged && !whole.is_coarser);
    assert!((20..=38).contains(&scant.nodes.len()), "{}", scant.nodes.len());
    let levels: Vec<u8> = scant.nodes.iter().map(|node| node.key.level).collect();
    let [finest, coarsest] = [levels.iter().min().unwrap(), levels.iter().max().unwrap()];
    assert!(coarsest - finest >= 4, "{levels:?}");
    // What allows no error takes what it needs.
    let exact =
        choose(&Rough { lattice: Lattice::new(1025, 1025), room: 3 }, &placed, &sight, &Choice { tau: 0.0, ..choice });
    assert!(exact.is_converged);
}
