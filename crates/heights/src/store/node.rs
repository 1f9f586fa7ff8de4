//! The record of a chunk in the footer: 64 bytes.
//!
//! Page, first byte in it and number of bytes (4 bytes each); coverage (0 none, 1 partial, 2 whole) and three zeros; `delta`, `step`, `min`,
//! `max` (doubles); area (8 bytes); deviations of normals and colours (singles). A chunk without a page has page 2^32 - 1: nothing of it
//! was measured, and it is no leaf with colour planes.

use super::place::Place;
use crate::hierarchy::chunks::{ChunkNode, Coverage};
use deepfield_data::store::error::Damage;
use deepfield_data::store::wire::{Decoder, Encoder};

/// Bytes of a record.
pub const RECORD_LEN: usize = 64;
/// A chunk, and where it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeRecord {
    /// Where it is. Where nothing was measured only leaves with colour planes are in a page.
    pub place: Place,
    /// What is known of it.
    pub node: ChunkNode,
}

impl NodeRecord {
    /// Appends the record.
    pub fn encode(&self, out: &mut Encoder) {
        self.place.encode(out);
        out.u32(match self.node.coverage {
            Coverage::None => 0,
            Coverage::Partial => 1,
            Coverage::Whole => 2,
        });
        let ChunkNode { delta, step, min, max, area, normal_deviation, colour_deviation, .. } = self.node;
        [delta, step, min, max].into_iter().for_each(|value| out.f64(value));
        out.u64(area);
        out.f32s(&[normal_deviation, colour_deviation]);
    }

    /// Reads a record.
    ///
    /// # Errors
    /// Where it is none.
    pub fn decode(input: &mut Decoder<'_>) -> Result<NodeRecord, Damage> {
        let field = "a chunk's record";
        let place = Place::decode(input, field)?;
        let wrong = |expected: &str| Damage::new("footer", format!("chunks with {expected}"));
        let coverage = match input.u32(field)? {
            0 => Coverage::None,
            1 => Coverage::Partial,
            2 => Coverage::Whole,
            _ => return Err(wrong("a coverage of 0, 1 or 2")),
        };
        let (delta, step, min, max) = (input.f64(field)?, input.f64(field)?, input.f64(field)?, input.f64(field)?);
        let area = input.u64(field)?;
        let (normal_deviation, colour_deviation) = (input.f32(field)?, input.f32(field)?);
        let is_there = coverage != Coverage::None;
        if !(delta >= 0.0 && step >= 0.0) || is_there != (min <= max) || (is_there && !place.is_written()) {
            return Err(wrong("distances, and heights where there is something"));
        }
        if ![normal_deviation, colour_deviation].iter().all(|deviation| (0.0..=1.0).contains(deviation)) {
            return Err(wrong("deviations from 0 to 1"));
        }
        let node = ChunkNode { delta, step, min, max, area, coverage, normal_deviation, colour_deviation };
        Ok(NodeRecord { place, node })
    }
}
