//! The program in its windows, driven as a user would under virtual X servers.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on has failed")]

#[path = "../support/mod.rs"]
mod support;

mod budgets;
mod comparison;
mod desktop;
mod effects;
mod fields;
mod files;
mod frames;
mod growing;
mod heights;
mod ids;
mod looking;
mod network;
mod occlusion;
mod outputs;
mod over;
mod panels;
mod panorama;
mod picture;
mod plots;
mod series;
mod shaders;
mod tools;
mod tour;
mod tour_pictures;
mod transfer;
