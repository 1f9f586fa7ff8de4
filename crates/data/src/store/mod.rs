//! The page file (design decision 1): layout, writer, reader and verifier. Its specification is `docs/page-file.md`.
//!
//! A file is a fixed header, pages aligned to 4096 bytes, and a footer. A page is copied from it and checked once as it
//! is loaded, by positioned reads or from a mapping ([`ReadMethod`](crate::model::ReadMethod)); the operating system's page cache
//! serves repeated reads.

pub mod budget;
pub mod container;
pub mod disk;
pub mod error;
pub mod grid;
pub mod layout;
pub mod metadata;
pub mod page;
pub mod page_file;
pub mod page_table;
pub mod paging;
pub mod run;
pub mod temporary;
pub mod verify;
pub mod wire;
pub mod writer;

mod block;
mod clusters;
mod content;
mod footer;
mod in_memory;
mod joined;
mod located;
mod open_disk;
mod reader;
#[cfg(feature = "remote")]
mod remote;
#[cfg(test)]
mod specification;
mod tree;

pub use block::Block;
pub use content::{ClusterUnions, Content, Particles, Representative};
pub use disk::{Change, Disk, LocalFile};
pub use error::StoreError;
pub use grid::GridFile;
pub use in_memory::InMemory;
pub use located::{Located, SourcePlace};
pub use metadata::{
    AttributeInfo, AttributeMerge, ClusterBook, ClusterLevel, ClusterTree, FamilyMetadata, Histogram, LevelInfo,
    Metadata, VolumeTree,
};
pub use open_disk::{first_bytes, keep_pages_from_afar, known_disk, open_disk, take_notes};
pub use page::{Branch, Encoding, Frame, Node, NodeParticles, NodeRef, Page, PageId, Positions};
pub use page_file::{PageBytes, PageFile, PartInfo};
pub use run::{RunFile, RunFileWriter};
pub use tree::Tree;
pub use verify::{Verified, verify};
pub use writer::PageFileWriter;
