//! A field's chunks without some of what they say from afar.

use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::photo::PhotoTiles;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::samples::{MeanNormal, SampleNormals};
use crate::cpu::surface::source::{NodeFacts, NodeSamples, SurfaceNodes};
use crate::heights::hierarchy::chunks::{ChunkKey, Lattice};
use crate::heights::model::Cell;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// What is left out of levels above full resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Left {
    /// Nothing is.
    Nothing,
    /// Shares of valid area: what stands for anything that was measured stands for all.
    Coverage,
    /// Mean normals: those of a chunk's own triangles are taken.
    MeanNormals,
}

/// The chunks of a page file without that.
pub(super) struct Less<'a> {
    source: &'a PagedSurface,
    left: Left,
    placed: Placed,
    /// What was made of chunks, so that pictures that follow take no longer for it.
    made: Mutex<HashMap<ChunkKey, Arc<NodeSamples>>>,
}

impl<'a> Less<'a> {
    /// Of a field that is placed so.
    pub(super) fn new(source: &'a PagedSurface, left: Left, placed: &Placed) -> Less<'a> {
        Less { source, left, placed: *placed, made: Mutex::default() }
    }

    fn made(&self, key: ChunkKey, samples: &NodeSamples) -> NodeSamples {
        match self.left {
            Left::Nothing => samples.clone(),
            Left::Coverage => {
                let coverage = samples.heights.iter().map(|height| if height.is_nan() { 0 } else { u8::MAX });
                NodeSamples { coverage: coverage.collect(), ..samples.clone() }
            }
            Left::MeanNormals => NodeSamples { normals: self.normals(key, samples), ..samples.clone() },
        }
    }

    /// Unit normals: of each sample that of the triangles of its chunk around it, alike.
    fn normals(&self, key: ChunkKey, samples: &NodeSamples) -> SampleNormals {
        let [rows, columns] = [0, 1].map(|axis| self.lattice().places(key, axis));
        let slopes = self.placed.lengths().map(|length| self.placed.true_lift / length);
        let mut sums = vec![DVec3::ZERO; samples.heights.len()];
        for (row, down) in rows.windows(2).enumerate() {
            for (column, right) in columns.windows(2).enumerate() {
                let first = row * samples.columns + column;
                let corners = [first, first + 1, first + samples.columns, first + samples.columns + 1];
                for triangle in Cell(corners.map(|corner| samples.heights.at(corner))).triangles() {
                    let [_, across, along] = triangle.at;
                    let x = across * slopes[0] / (right[1] - right[0]) as f64;
                    let y = along * slopes[1] / (down[1] - down[0]) as f64;
                    let unit = DVec3::new(-x, -y, 1.0).normalize();
                    triangle.corners.into_iter().for_each(|corner| sums[corners[corner]] += unit);
                }
            }
        }
        let normal = |sum: DVec3| MeanNormal::new(sum.normalize_or(DVec3::Z).as_vec3().to_array());
        SampleNormals::Parts(sums.into_iter().map(normal).collect())
    }
}

impl SurfaceNodes for Less<'_> {
    fn lattice(&self) -> Lattice {
        self.source.lattice()
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        let facts = self.source.facts(key)?;
        match self.left == Left::Coverage && key.level > 0 && !facts.is_empty() {
            true => Some(NodeFacts { coverage: [u8::MAX; 2], ..facts }),
            false => Some(facts),
        }
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let samples = self.source.samples(key)?;
        if key.level == 0 || self.left == Left::Nothing {
            return Some(samples);
        }
        let known = || self.made.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(made) = known().get(&key) {
            return Some(Arc::clone(made));
        }
        let made = Arc::new(self.made(key, &samples));
        Some(Arc::clone(known().entry(key).or_insert(made)))
    }

    fn is_there(&self, key: ChunkKey) -> bool {
        self.source.is_there(key)
    }

    fn room(&self) -> u64 {
        self.source.room()
    }

    fn bytes(&self, key: ChunkKey) -> u64 {
        self.source.bytes(key)
    }

    fn photo(&self) -> Option<&dyn PhotoTiles> {
        self.source.photo()
    }
}
