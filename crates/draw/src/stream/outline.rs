//! What selection needs to know of pages, without the particles in them: it stays where the pages themselves have to make room, so that a
//! view can be selected whose pages do not fit into memory together.

use super::residency::info_of;
use crate::hierarchy::pca::Step;
use crate::store::{NodeRef, Page, PageId};
use crate::view::{Extent, NodeInfo, NodeTree};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// What of pages has to be in memory at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// They themselves.
    Pages,
    /// What they tell of their nodes.
    Outlines,
}

/// The nodes of a page.
#[derive(Clone, Debug)]
struct OutlinedPage {
    nodes: Vec<OutlinedNode>,
    children: Vec<NodeRef>,
    steps: Vec<Step>,
    /// Memory that the page takes, bytes, and what is kept of it here.
    page_bytes: u64,
    own_bytes: u64,
}

/// A node, and which of its page's children and steps are its own.
#[derive(Clone, Debug)]
struct OutlinedNode {
    info: NodeInfo,
    children: Range<u32>,
    steps: Range<u32>,
    /// Whether it is not coded with its family's codebooks, so that what it holds may reach elsewhere than it does at other times.
    has_content: bool,
}

/// The pages of one tree that have been looked at.
#[derive(Clone, Debug, Default)]
pub struct Outline {
    pages: HashMap<PageId, OutlinedPage>,
    bytes: u64,
}

impl Outline {
    /// Takes in what a page tells of its nodes.
    pub fn add(&mut self, page: &Page) {
        if self.has(page.id) {
            return;
        }
        let (mut children, mut steps) = (Vec::new(), Vec::new());
        let outlined = |(index, node)| {
            let first = [children.len() as u32, steps.len() as u32];
            children.extend_from_slice(page.children(index));
            steps.extend_from_slice(page.content(index).map_or(&[], |content| content.steps()));
            OutlinedNode {
                info: info_of(node),
                children: first[0]..children.len() as u32,
                steps: first[1]..steps.len() as u32,
                has_content: page.content(index).is_some(),
            }
        };
        let nodes: Vec<OutlinedNode> = page.nodes.iter().enumerate().map(outlined).collect();
        let sizes = [
            nodes.len() * size_of::<OutlinedNode>(),
            children.len() * size_of::<NodeRef>(),
            steps.len() * size_of::<Step>(),
        ];
        let page_bytes = page.memory();
        let own_bytes: u64 = sizes.iter().map(|size| *size as u64).sum();
        self.bytes += own_bytes;
        self.pages.insert(page.id, OutlinedPage { nodes, children, steps, page_bytes, own_bytes });
    }

    /// Whether a page has been looked at.
    pub fn has(&self, page: PageId) -> bool {
        self.pages.contains_key(&page)
    }

    /// How many have.
    pub fn len(&self) -> usize {
        self.pages.len()
    }

    /// Whether none has.
    pub fn is_empty(&self) -> bool {
        self.pages.is_empty()
    }

    /// Whether a node holds clusters.
    pub fn has_steps(&self, id: NodeRef) -> bool {
        !NodeTree::steps(self, id).is_empty()
    }

    /// What a node's particles reach, where it says exactly that: `None` where they have to be looked at.
    pub fn extent(&self, id: NodeRef) -> Option<Extent> {
        self.found(id).filter(|(_, node)| !node.has_content).map(|(_, node)| node.info.extent)
    }

    /// Memory that it takes, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What is held of these nodes' pages, bytes, as far as they have been looked at.
    pub fn bytes_of(&self, held: Held, nodes: &[NodeRef]) -> u64 {
        let pages: HashSet<PageId> = nodes.iter().map(|node| node.page).collect();
        let bytes = |page: &OutlinedPage| match held {
            Held::Pages => page.page_bytes,
            Held::Outlines => page.own_bytes,
        };
        pages.iter().filter_map(|page| self.pages.get(page)).map(bytes).sum()
    }

    fn found(&self, id: NodeRef) -> Option<(&OutlinedPage, &OutlinedNode)> {
        let page = self.pages.get(&id.page)?;
        Some((page, page.nodes.get(id.node as usize)?))
    }
}

impl NodeTree for Outline {
    type Id = NodeRef;

    fn node(&self, id: NodeRef) -> Option<NodeInfo> {
        self.found(id).map(|(_, node)| node.info)
    }

    fn children(&self, id: NodeRef) -> impl Iterator<Item = NodeRef> {
        let own = self.found(id).and_then(|(page, node)| page.children.get(indices(&node.children)));
        own.unwrap_or_default().iter().copied()
    }

    fn steps(&self, id: NodeRef) -> &[Step] {
        self.found(id).and_then(|(page, node)| page.steps.get(indices(&node.steps))).unwrap_or_default()
    }
}

fn indices(range: &Range<u32>) -> Range<usize> {
    range.start as usize..range.end as usize
}
