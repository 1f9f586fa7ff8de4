//! What needs a graphics adapter, if only one in software: its pictures against those of the processor.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

#[path = "../support/mod.rs"]
mod support;

mod adapters;
mod cartesian;
mod clouds;
mod columns;
mod compare;
mod darkening;
mod ellipsoids;
mod fields;
mod flight;
mod integrals;
mod light;
mod light_modes;
mod live;
mod moving;
mod over;
mod overdraw;
mod pages;
mod panoramas;
mod surfaces;
mod threads;
mod times;
mod volumes;
