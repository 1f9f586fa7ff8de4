//! Which nodes to draw: top-down from the roots, refined where [`Detail`] is not enough, culled where the view sees nothing, and
//! held at the parent where children are not resident yet (F12 4.7.2, 4.8, 5.5.2).

use super::budget::select_within;
use super::frustum::Extent;
use super::{Detail, View};
use crate::hierarchy::pca::Step;
use glam::DVec3;

/// What selection needs to know of a node.
#[derive(Clone, Copy, Debug)]
pub struct NodeInfo {
    /// Where the node's particles are and how far they reach.
    pub extent: Extent,
    /// Largest distance between a source particle in the node and the particle drawn for it, world units; infinite
    /// for a node that holds no particles of its own and only leads to its children.
    pub delta: f64,
    /// Edge of the cells in which particles were merged for the node, world units; 0 where none were.
    pub spacing: f64,
    /// Number of particles drawn for the node.
    pub particles: u64,
    /// Number of source particles that it stands for.
    pub source_particles: u64,
    /// Sum of their masses.
    pub mass: f64,
    /// Whether no nodes refine it.
    pub is_leaf: bool,
    /// Whether a leaf in the same place refines it.
    pub stands_for_leaf: bool,
    /// When it is there, in the data's unit of time: from the first to before the last.
    pub time: [f64; 2],
}

impl NodeInfo {
    /// Whether it is there at a time.
    pub fn is_at(&self, time: f64) -> bool {
        self.time[0] <= time && time < self.time[1]
    }
}

/// Opaque things that have been drawn of a view.
pub trait Occluder: Send + Sync {
    /// Whether nothing shows that lies in the extent, or reaches out of it by its margin.
    fn hides(&self, extent: &Extent) -> bool;
}

/// A hierarchy of which a part is resident.
pub trait NodeTree {
    /// Names a node.
    type Id: Copy + PartialEq;

    /// The node, if it is resident.
    fn node(&self, id: Self::Id) -> Option<NodeInfo>;

    /// The nodes that refine a resident node.
    fn children(&self, id: Self::Id) -> impl Iterator<Item = Self::Id>;

    /// What a part of the clusters of a resident node is worth; none if it holds no clusters.
    fn steps(&self, _id: Self::Id) -> &[Step] {
        &[]
    }

    /// Whether the node is known to be hidden from the view, before an [`Occluder`] is asked.
    fn is_hidden(&self, _id: Self::Id) -> bool {
        false
    }
}

/// A node that the view needs and that is not resident.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missing<Id> {
    /// The node.
    pub id: Id,
    /// Screen-space error, in pixels, of what is drawn in its place; infinite where nothing is.
    pub error_pixels: f64,
}

/// A node to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn<Id> {
    /// The node.
    pub id: Id,
    /// Its screen-space error, pixels.
    pub error_pixels: f64,
    /// Number of particles drawn for it.
    pub particles: u64,
    /// Whether these are less than it has: of its clusters those of the first splits.
    pub part: bool,
    /// By how much its image is displaced from where the data is, world units.
    pub offset: DVec3,
}

/// A node behind something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hidden<Id> {
    /// The node.
    pub id: Id,
    /// Where it is, in the image that is hidden.
    pub extent: Extent,
}

/// The nodes a view draws, and what it lacks.
#[derive(Clone, Debug)]
pub struct Selection<Id> {
    /// Nodes to draw; no node is an ancestor of another.
    pub draw: Vec<Drawn<Id>>,
    /// Nodes to load, the most missed first.
    pub missing: Vec<Missing<Id>>,
    /// Every resident node that was looked at, the drawn ones included.
    pub visited: Vec<Id>,
    /// Those of them that are hidden: they are drawn as they are, if they hold anything, and nothing below them is asked for.
    pub hidden: Vec<Hidden<Id>>,
}

impl<Id> Selection<Id> {
    /// Whether everything that the view needs at its error bound is resident.
    pub fn is_converged(&self) -> bool {
        self.missing.is_empty()
    }

    /// Largest screen-space error among the drawn nodes, pixels; 0 if none is drawn.
    pub fn error_pixels(&self) -> f64 {
        self.draw.iter().fold(0.0, |largest, node| largest.max(node.error_pixels))
    }

    /// Particles in the drawn nodes.
    pub fn particles(&self) -> u64 {
        self.draw.iter().map(|node| node.particles).sum()
    }
}

/// Selects the nodes below `roots` that draw `view` in this detail, as far as they are resident. A leaf whose own error is too
/// large is drawn all the same and counted in [`Selection::error_pixels`].
///
/// A node with any child missing is drawn itself: parent and children overlap, so drawing both would count their
/// mass twice.
pub fn select<Tree: NodeTree>(
    view: &View,
    detail: impl Into<Detail>,
    tree: &Tree,
    roots: &[Tree::Id],
) -> Selection<Tree::Id> {
    select_unhidden(view, detail, None, tree, roots)
}

/// The same where `occluder`, if there is one, hides some of the nodes.
pub fn select_unhidden<Tree: NodeTree>(
    view: &View,
    detail: impl Into<Detail>,
    occluder: Option<&dyn Occluder>,
    tree: &Tree,
    roots: &[Tree::Id],
) -> Selection<Tree::Id> {
    let detail = detail.into();
    if let Detail::Budget { splats, scope } = detail {
        return select_within((view, scope), splats, tree, roots);
    }
    let selection = Selection { draw: Vec::new(), missing: Vec::new(), visited: Vec::new(), hidden: Vec::new() };
    let mut traversal = Traversal { view: *view, offset: DVec3::ZERO, detail, occluder, tree, selection };
    for offset in view.images.offsets() {
        (traversal.view, traversal.offset) = (view.of_image(offset), offset);
        for &id in roots {
            match tree.node(id) {
                Some(info) => {
                    traversal.visit(id, info);
                }
                None => traversal.selection.missing.push(Missing { id, error_pixels: f64::INFINITY }),
            }
        }
    }
    let mut selection = traversal.selection;
    selection.missing.sort_by(|a, b| b.error_pixels.total_cmp(&a.error_pixels));
    selection
}

/// One walk down the tree.
struct Traversal<'a, Tree: NodeTree> {
    /// The view of the image that is walked through.
    view: View,
    offset: DVec3,
    detail: Detail,
    occluder: Option<&'a dyn Occluder>,
    tree: &'a Tree,
    selection: Selection<Tree::Id>,
}

impl<Tree: NodeTree> Traversal<'_, Tree> {
    /// Draws a resident node or what refines it; false where neither is possible because the node holds no particles
    /// and its refinement is missing, so that an ancestor has to be drawn.
    fn visit(&mut self, id: Tree::Id, info: NodeInfo) -> bool {
        self.selection.visited.push(id);
        let is_there = info.is_at(self.view.time);
        if !is_there || !self.view.sees(&info.extent) || !self.view.cut.reaches(&info.extent.bounds) {
            return true;
        }
        let error_pixels = self.view.error_pixels(&info.extent, info.delta);
        let suffices = self.detail.suffices(&self.view, &info, error_pixels);
        let extent = info.extent.moved(self.offset);
        let is_hidden = self.tree.is_hidden(id) || self.occluder.is_some_and(|occluder| occluder.hides(&extent));
        if is_hidden {
            self.selection.hidden.push(Hidden { id, extent });
        }
        if !suffices && !is_hidden && !info.is_leaf && self.refine(id, error_pixels) {
            return true;
        }
        if info.delta.is_infinite() {
            return is_hidden;
        }
        // What is hidden is displaced by nothing that shows.
        let error_pixels = if is_hidden { 0.0 } else { error_pixels };
        self.selection.draw.push(Drawn {
            id,
            error_pixels,
            particles: info.particles,
            part: false,
            offset: self.offset,
        });
        true
    }

    /// Draws the children in a node's place; draws nothing and is false if that is not possible yet.
    fn refine(&mut self, id: Tree::Id, error_pixels: f64) -> bool {
        let drawn = self.selection.draw.len();
        let mut complete = true;
        let tree = self.tree;
        for child in tree.children(id) {
            match tree.node(child) {
                Some(child_info) => complete &= self.visit(child, child_info),
                None => {
                    self.selection.missing.push(Missing { id: child, error_pixels });
                    complete = false;
                }
            }
        }
        if !complete {
            self.selection.draw.truncate(drawn);
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use crate::view::Projection;
    use glam::DVec3;
    use std::collections::{HashMap, HashSet};

    /// A complete octree of the unit cube; ids are (depth, index along each axis).
    struct Full {
        depth: u8,
        absent: HashSet<(u8, [u32; 3])>,
        relays: HashSet<(u8, [u32; 3])>,
        hidden: HashSet<(u8, [u32; 3])>,
    }

    impl NodeTree for Full {
        type Id = (u8, [u32; 3]);

        fn node(&self, id: Self::Id) -> Option<NodeInfo> {
            if self.absent.contains(&id) {
                return None;
            }
            let size = 0.5f64.powi(i32::from(id.0));
            let min = size * DVec3::from(id.1.map(f64::from));
            // The paper's bound for 256^3 bins: half a bin's diagonal.
            let delta = if id.0 < self.depth { 3f64.sqrt() / 2.0 * size / 256.0 } else { 0.0 };
            let extent = Extent { bounds: Bounds { min, max: min + size }, margin: 0.0 };
            Some(NodeInfo {
                extent,
                delta: if self.relays.contains(&id) { f64::INFINITY } else { delta },
                spacing: if id.0 < self.depth { size / 256.0 } else { 0.0 },
                particles: 1,
                source_particles: 1,
                mass: 1.0,
                stands_for_leaf: false,
                is_leaf: id.0 == self.depth,
                time: [f64::NEG_INFINITY, f64::INFINITY],
            })
        }

        fn children(&self, id: Self::Id) -> impl Iterator<Item = Self::Id> {
            let octants = if id.0 < self.depth { 8 } else { 0 };
            (0..octants).map(move |octant| (id.0 + 1, [0, 1, 2].map(|axis| 2 * id.1[axis] + (octant >> axis & 1))))
        }

        fn is_hidden(&self, id: Self::Id) -> bool {
            self.hidden.contains(&id)
        }
    }

    fn view(eye: DVec3) -> View {
        let projection = Projection::Perspective { fov_y: 0.9 };
        View::look_at(eye, DVec3::splat(0.5), DVec3::Y, projection, 1024, 768).unwrap()
    }

    #[test]
    fn drawn_nodes_cover_what_is_seen_exactly_once_within_tau() {
        let tree = Full { depth: 5, absent: HashSet::new(), relays: HashSet::new(), hidden: HashSet::new() };
        for distance in [0.2, 0.9, 2.0, 5.0, 30.0] {
            let view = view(DVec3::splat(0.5) + distance * DVec3::new(0.3, 0.5, 0.81));
            let selection = select(&view, 0.8, &tree, &[(0, [0; 3])]);
            assert!(selection.is_converged() && selection.error_pixels() <= 0.8);
            let mut cover: HashMap<[u32; 3], u32> = HashMap::new();
            for (depth, [x, y, z]) in selection.draw.iter().map(|node| node.id) {
                let span = 1 << (5 - depth);
                for i in 0..span * span * span {
                    let cell = [x * span + i % span, y * span + i / span % span, z * span + i / (span * span)];
                    *cover.entry(cell).or_default() += 1;
                }
            }
            assert!(cover.values().all(|&times| times == 1), "a cell drawn twice at distance {distance}");
            for i in 0..32u32.pow(3) {
                let cell = [i % 32, i / 32 % 32, i / 1024];
                let corner = DVec3::from(cell.map(f64::from)) / 32.0;
                let point = view.to_camera(corner + 0.5 / 32.0);
                let seen =
                    view.to_pixels(point).is_some_and(|[x, y]| (0.0..1024.0).contains(&x) && (0.0..768.0).contains(&y));
                assert!(!seen || cover.contains_key(&cell), "a seen cell is not drawn");
            }
        }
    }

    /// `d_min` is right to a percent: the node is drawn just beyond it and refined just within it.
    #[test]
    fn a_node_is_refined_at_d_min() {
        let tree = Full { depth: 1, absent: HashSet::new(), relays: HashSet::new(), hidden: HashSet::new() };
        let delta = 3f64.sqrt() / 2.0 / 256.0;
        let tau = 0.8;
        let focal = 768.0 / (2.0 * 0.45f64.tan());
        let d_min = focal * delta / tau;
        let select_at = |distance: f64| {
            // The nearest face is at this distance; the secant of so far a cell is 1 to a few tenths of a percent.
            let view = view(DVec3::new(0.5, 0.5, 1.0 + distance));
            select(&view, tau, &tree, &[(0, [0; 3])]).draw.len()
        };
        assert_eq!(select_at(1.1 * d_min), 1);
        assert!(select_at(0.95 * d_min) > 1);
    }

    #[test]
    fn a_parent_stands_in_for_children_that_are_not_resident() {
        let absent = HashSet::from([(1, [0, 0, 0]), (1, [1, 1, 1])]);
        let tree = Full { depth: 3, absent, relays: HashSet::new(), hidden: HashSet::new() };
        let selection = select(&view(DVec3::new(0.5, 0.5, 2.0)), 0.01, &tree, &[(0, [0; 3])]);
        assert_eq!(selection.draw.iter().map(|node| node.id).collect::<Vec<_>>(), [(0, [0; 3])]);
        assert_eq!(selection.missing.len(), 2);
        assert!(!selection.is_converged() && selection.error_pixels() > 0.01);
    }

    /// Everything in one half is behind something.
    struct Wall;

    impl Occluder for Wall {
        fn hides(&self, extent: &Extent) -> bool {
            extent.bounds.max.z <= 0.5
        }
    }

    #[test]
    fn hidden_nodes_are_not_refined_and_nothing_below_them_is_missed() {
        let absent = HashSet::from([(2, [0, 0, 0])]);
        let tree = Full { depth: 3, absent, relays: HashSet::from([(1, [1, 1, 0])]), hidden: HashSet::new() };
        let view = view(DVec3::new(0.5, 0.5, 2.0));
        let root = [(0, [0; 3])];
        assert!(!select(&view, 0.01, &tree, &root).is_converged());
        let selection = select_unhidden(&view, 0.01, Some(&Wall), &tree, &root);
        assert!(selection.is_converged());
        assert_eq!(selection.hidden.len(), 4);
        let back: Vec<_> = selection.draw.iter().filter(|node| node.id.1[2] < 1 << node.id.0 >> 1).collect();
        assert_eq!(back.len(), 3, "all but the one without particles");
        let is_hidden = |id| selection.hidden.iter().any(|hidden| hidden.id == id && hidden.extent.bounds.max.z <= 0.5);
        assert!(back.iter().all(|node| node.id.0 == 1 && is_hidden(node.id)));
        assert_eq!(selection.draw.len(), 3 + 256);
        // What is known to be hidden is no less so.
        let hidden = HashSet::from([0, 1].map(|x| (1, [x, 0, 1])));
        let selection = select_unhidden(&view, 0.01, Some(&Wall), &Full { hidden, ..tree }, &root);
        assert_eq!((selection.hidden.len(), selection.draw.len()), (6, 3 + 2 + 128));
    }

    #[test]
    fn an_ancestor_stands_in_for_a_node_without_particles_that_cannot_be_refined() {
        let absent = HashSet::from([(2, [0, 0, 0])]);
        let relays = HashSet::from([(1, [0, 0, 0])]);
        let tree = Full { depth: 3, absent, relays, hidden: HashSet::new() };
        let selection = select(&view(DVec3::new(0.5, 0.5, 2.0)), 0.01, &tree, &[(0, [0; 3])]);
        assert_eq!(selection.draw.iter().map(|node| node.id).collect::<Vec<_>>(), [(0, [0; 3])]);
        assert!(selection.missing.iter().any(|missing| missing.id == (2, [0, 0, 0])));
    }
}
