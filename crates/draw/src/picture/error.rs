//! Why there is no picture.

use crate::annotate::overlay::OverlayError;
use crate::color::output::OutputError;
use crate::cpu::SplatError;
use crate::cpu::volume::VolumeError;
use crate::explore::ExploreError;
use crate::import::ImportError;
use crate::store::StoreError;
use crate::view::ViewError;
use std::path::PathBuf;
use thiserror::Error;

/// A picture that cannot be drawn.
#[derive(Debug, Error)]
pub enum PictureError {
    /// What is asked for makes no sense, or nothing here does it.
    #[error("{0}")]
    Asked(String),
    /// What is asked for does not fit the data.
    #[error("{}: {why}", file.display())]
    Unfit {
        /// The data, or the file that asks.
        file: PathBuf,
        /// What was found, and what was expected.
        why: String,
    },
    /// Columns that do not fit together.
    #[error(transparent)]
    Splats(#[from] SplatError),
    /// A picture that the technique cannot draw.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A camera that sees nothing.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A tree that cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A source that cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// A catalogue or a selection that makes no sense.
    #[error(transparent)]
    Explore(#[from] ExploreError),
    /// A picture to be laid over it that cannot be read.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Nobody waits for it any more.
    #[error("the picture was given up")]
    Stopped,
    /// Data that cannot be opened.
    #[error(transparent)]
    Open(#[from] Box<dyn std::error::Error + Send + Sync>),
}

impl PictureError {
    /// The same, with the file named that it is about.
    pub(super) fn of(file: impl Into<PathBuf>, why: impl ToString) -> PictureError {
        PictureError::Unfit { file: file.into(), why: why.to_string() }
    }
}
