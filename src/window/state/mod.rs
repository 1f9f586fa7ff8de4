//! Data of the window that several of its rooms read and write. No system lives here but those that age what is kept.

pub mod aim;
pub mod answer;
pub mod choices;
pub mod histogram;
pub mod notices;
pub mod panels;
pub mod plots;
pub mod progress;
pub mod show;
pub mod tool;
