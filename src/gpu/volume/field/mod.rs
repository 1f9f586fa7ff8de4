//! Sampled fields in a perspective grid: what [`crate::cpu::field::FieldBricks`] does on the processor. In place of particles' passes 1 to 5
//! a slab has two:
//!
//! 1. `plan_field`: bricks are listed around which something may show, by the largest values of blocks of samples.
//! 2. `fill`: each cell gets the value at its centre.
//!
//! A layer of bricks is filled from the level of the field whose samples lie as close as its cells; [`runs`] take those of a slab together
//! that have the same. Surfaces in the nearest slices, all that have the finest level, face as its samples say. The levels that a picture needs lie in textures on the adapter ([`crate::gpu::field_samples`]), from picture to picture.

pub mod layout;

pub(super) mod runs;
