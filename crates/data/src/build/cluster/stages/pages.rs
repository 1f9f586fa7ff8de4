//! The stage that plans pages. A few bytes of each node decide which page it is in; then the nodes that were whole with each group of buckets are read
//! once more, one group after the other, and put away for the tasks that write their pages.

use super::*;
use crate::build::coding::{CodedNode, picture_error};
use crate::build::column_error::Picture;
use crate::build::family::Summary;
use crate::build::tree::{Books, section_lengths, stored, without_leaves};
use crate::hierarchy::Encoding;
use crate::store::paging::{PageSize, Placed, TreeSizes};
use std::collections::VecDeque;

/// Bytes by which a task tells of a node, mostly more.
const NODE_TOLD: u64 = 150;
/// Bytes that nodes of a group of buckets take while they are put away, for each byte that tells of them.
pub(super) const NODES: u64 = 8;
/// The same of the batches of a group, with what they were coded to.
const BATCHES: u64 = 7;

/// A family whose pages are planned.
struct Family {
    scaled: Scaled,
    /// Tasks that have built it.
    tasks: Range<u32>,
    trees: Vec<Joined>,
    /// Where the coded batches of each tree are: of each codebook, by part.
    coded: Vec<Vec<Vec<Blob>>>,
    placed: Vec<Placed>,
}

/// A tree on its way to pages.
struct Walk<'a> {
    kind: Purpose,
    tree: &'a Joined,
    coded: &'a [Vec<Blob>],
    /// Codebooks of the family before its own.
    before: u16,
    placed: &'a Placed,
    checked: Checked,
    /// The group whose batches are to be gathered next, and what was gathered of nodes that have not come, by depth and index.
    group: u32,
    gathered: BTreeMap<(usize, usize), Gathered>,
    /// Of nodes of each depth whose parents have not come, in order: up to where smoothing lengths are in and below them.
    lengths: Vec<VecDeque<f32>>,
}

/// What the batches of a node were coded to.
#[derive(Default)]
struct Gathered {
    coded: CodedNode,
    is_leaf: bool,
    particles: u64,
}

impl Task<'_> {
    pub(super) fn pages(self) -> Result<(), BuildError> {
        let source = self.source()?;
        let about_source = self.streams(source.as_ref())?.about;
        let (kernel, bits) = (about_source.kernel, self.options.octree.code_bits());
        let (scaled, joined) = (self.scaled()?, self.joined()?);
        let (outlines, left_out) = self.outlines()?;
        let (coded, squares) = self.coded_books()?;
        let mut coded = coded.into_iter();
        let spill = self.spill();
        let (mut families, mut metadata) = (Vec::new(), Vec::new());
        let (mut notes, mut numbers) = (Vec::new(), Vec::new());
        let (mut pages, mut ends, mut held) = (Vec::new(), Vec::new(), 0);
        let known = scaled.into_iter().zip(outlines).zip(joined.into_iter().zip(self.settings.groups())).enumerate();
        for (number, ((scaled, outline), (joined, tasks))) in known {
            let Some((scaled, outline)) = scaled.zip(outline) else { continue };
            let JoinedFamily { trees, estimated, derived } = joined;
            held = self.check_paging(&trees, held)?;
            let mut books = Books::default();
            let mut parts: Vec<Vec<Vec<Blob>>> = Vec::new();
            for (kind, tree) in trees.iter().enumerate() {
                let own: Vec<CodedBook> = coded.by_ref().take(tree.books.len()).collect();
                if own.len() != tree.books.len() {
                    return Err(self.unsound("fewer codebooks than stage join has told"));
                }
                if kind == 0 {
                    let drawn = squares.as_ref().map(|all| all.range((number, 0)..(number + 1, 0)));
                    let picture = scaled.outline.picture(kernel, bits);
                    books.column_error = match (drawn, picture) {
                        (Some(drawn), _) => picture_error(drawn.map(|(_, own)| *own)),
                        (None, Some(picture)) => self.column_error(&spill, tree, &scaled, &picture, &own)?,
                        (None, None) => None,
                    };
                }
                let mut own_parts = Vec::with_capacity(own.len());
                for CodedBook { book, parts } in own {
                    books.codebooks.push(book.codebook);
                    books.refinements.extend(book.refinement);
                    books.numbers.push(book.numbers);
                    own_parts.push(parts);
                }
                parts.push(own_parts);
            }
            let (sizes, [mass, mass_density]) = self.sizes(&spill, &trees, outline.survey.count)?;
            let mut sizes = sizes.into_iter();
            let (Some(splats), Some(about)) = (sizes.next(), trees.first()) else {
                return Err(self.unsound("a family without a tree"));
            };
            let placed = splats.placed(sizes.next(), self.options.page_bytes, &mut pages);
            ends.push(pages.len());
            numbers.push(books.numbers.clone());
            notes.extend(scaled.note.clone());
            let volume = trees.get(1).map(|tree| {
                let mut levels = tree.levels.clone();
                levels.iter_mut().for_each(without_leaves);
                levels
            });
            let levels = about.levels.clone();
            let summary = Summary { mass, mass_density, levels, volume, clusters: None, books, has_octree: true };
            let written = placed.iter().map(|tree| tree.written.clone()).collect();
            let histograms = self.histograms(number, &outline, &scaled, estimated, derived)?;
            metadata.push(scaled.outline.metadata(&histograms, summary, written, self.options)?);
            families.push(Family { scaled, tasks, trees, coded: parts, placed });
        }
        let about_source = Dataset { skipped: left_out.into_skipped(), ..about_source };
        let (version, about) = self.footer(about_source, metadata, notes, pages.len())?;
        let (tasks, end) = self.put_pages(&spill, &families, &pages, &ends)?;
        let numbers = spill.put(&[&numbers.bytes()]).map_err(|error| BuildError::temporary(&spill, error))?;
        drop(spill);
        self.hand_on(&Pages { tasks, numbers, end, version, about }, 0, 0)
    }

    /// Whether the task may hold what it does of a family's trees, beside so many bytes of those before; how many it is with those that are held to the
    /// end.
    fn check_paging(&self, trees: &[Joined], before: u64) -> Result<u64, BuildError> {
        let len = |blob: &Blob| blob.len() as u64;
        let nodes = || trees.iter().flat_map(|tree| &tree.drafts).map(len);
        let held = before.saturating_add(total(nodes()) / NODE_TOLD * TreeSizes::HELD);
        let mut groups: BTreeMap<u32, u64> = BTreeMap::new();
        for (parts, run) in trees.iter().flat_map(|tree| &tree.books).flat_map(|book| book.runs()) {
            let bytes = groups.entry(parts[0].group).or_default();
            *bytes = bytes.saturating_add(len(run));
        }
        let nodes = nodes().max().unwrap_or(0).saturating_mul(NODES * trees.len() as u64);
        let batches = groups.into_values().max().unwrap_or(0).saturating_mul(BATCHES);
        let what =
            "stage pages, which knows the sizes of all nodes and puts those of one group of buckets away at a time,";
        self.left_beside(held.saturating_add(nodes).saturating_add(batches), what)?;
        Ok(held)
    }

    /// The error of the picture that is told of a tree, whose codebooks were coded so.
    fn column_error(
        &self,
        spill: &Spill,
        tree: &Joined,
        scaled: &Scaled,
        picture: &Picture,
        coded: &[CodedBook],
    ) -> Result<Option<f64>, BuildError> {
        let leaves = self.drawn_leaves(spill, tree, scaled, picture)?;
        let squares = leaves.par_iter().map(|leaf| {
            let book = leaf.book();
            self.leaf_squares(spill, picture, leaf, &tree.books[book], &coded[book])
        });
        Ok(picture_error(squares.collect::<Result<Vec<[f64; 2]>, BuildError>>()?))
    }

    /// What decides which pages the nodes of a family's trees are in; mass, and sum of `m rho`, of the root.
    fn sizes(&self, spill: &Spill, trees: &[Joined], count: u64) -> Result<(Vec<TreeSizes>, [f64; 2]), BuildError> {
        let bits = self.options.octree.code_bits();
        let mut all: Vec<(TreeSizes, Checked)> = trees.iter().map(|_| Default::default()).collect();
        let mut top = [0.0; 2];
        for run in 0..trees.first().map_or(0, |tree| tree.drafts.len()) {
            let mut first: Option<Draft> = None;
            for (tree, (sizes, checked)) in trees.iter().zip(&mut all) {
                let blob = &tree.drafts[run];
                let draft = self.next_draft(spill, blob, checked)?;
                first
                    .as_ref()
                    .map_or(Ok(()), |first| draft.check_cells(first))
                    .map_err(|what| BuildError::temporary(spill, spill.damaged(blob, &what)))?;
                for (depth, level) in draft.nodes.iter().enumerate() {
                    for (index, node) in level.iter().enumerate() {
                        if depth == 0 && first.is_none() {
                            top = [node.mass, node.mass_density];
                        }
                        let sections = section_lengths(node, draft.positions(depth, index), bits);
                        let children = node.children.iter().flatten().count();
                        sizes.add(depth, sections, children, node.encoding == Encoding::Leaf);
                    }
                }
                first = first.or(Some(draft));
            }
        }
        for (tree, (_, checked)) in trees.iter().zip(&all) {
            checked.end(&tree.levels, count).map_err(|what| self.damaged("join", 0, &what))?;
        }
        Ok((all.into_iter().map(|(sizes, _)| sizes).collect(), top))
    }

    /// Puts the nodes of all pages away for each task that writes some: where they are, and how many pages; and where pages end in the output. Pages of
    /// each family end behind so many.
    fn put_pages(
        &self,
        spill: &Spill,
        families: &[Family],
        pages: &[PageSize],
        ends: &[usize],
    ) -> Result<(Vec<(Blob, u64)>, u64), BuildError> {
        let temporary = |error| BuildError::temporary(spill, error);
        let lengths: Vec<u64> = pages.iter().map(|page| page.bytes).collect();
        let runs = runs(&lengths, self.settings.write);
        let mut nodes: Vec<Vec<Blob>> = runs.iter().map(|_| Vec::new()).collect();
        for family in families {
            self.put_nodes(spill, family, &runs, &mut nodes)?;
        }
        let mut end = ALIGNMENT;
        let mut tasks = Vec::with_capacity(runs.len());
        for (run, nodes) in runs.into_iter().zip(nodes) {
            let head = |page: usize| {
                let PageSize { bytes, nodes } = pages[page];
                let offset = end;
                end = align_up(end + bytes, ALIGNMENT).unwrap_or(end + bytes);
                let family = ends.partition_point(|end| *end <= page) as u32;
                PageHead { id: PageId(page as u32), family, offset, nodes }
            };
            let own = OwnPages { pages: run.map(head).collect(), nodes };
            let count = own.pages.len() as u64;
            tasks.push((spill.put(&[&own.bytes()]).map_err(temporary)?, count));
        }
        Ok((tasks, end))
    }

    /// Puts the nodes of a family away, for each task that writes pages of such a run.
    fn put_nodes(
        &self,
        spill: &Spill,
        family: &Family,
        runs: &[Range<usize>],
        nodes: &mut [Vec<Blob>],
    ) -> Result<(), BuildError> {
        let Family { scaled, tasks, trees, coded, placed } = family;
        let mut walks: Vec<Walk<'_>> = Vec::with_capacity(trees.len());
        let kinds = self.options.octree.levels().iter().zip(trees);
        for ((&kind, tree), (coded, placed)) in kinds.zip(coded.iter().zip(placed)) {
            let before = walks.last().map_or(0, |walk| walk.before + walk.coded.len() as u16);
            walks.push(Walk {
                kind,
                tree,
                coded,
                before,
                placed,
                checked: Checked::default(),
                group: 0,
                gathered: BTreeMap::new(),
                lengths: Vec::new(),
            });
        }
        for (run, task) in tasks.clone().enumerate() {
            let last = self.buckets(task, &scaled.outline).end.checked_sub(1);
            let groups = last.map_or(0, |bucket| scaled.outline.plan.group(bucket) + 1);
            let mut own: BTreeMap<usize, (u64, Vec<u8>)> = BTreeMap::new();
            let mut leaves: Vec<VecDeque<f32>> = Vec::new();
            for walk in &mut walks {
                self.gather(spill, scaled, walk, groups)?;
                self.walk(spill, walk, run, &mut leaves, |node| {
                    let page = node.0.page.0 as usize;
                    let (count, bytes) = own.entry(runs.partition_point(|run| run.end <= page)).or_default();
                    *count += 1;
                    node.put(bytes);
                })?;
            }
            for (task, (count, bytes)) in own {
                let blob = spill.put(&[&count.bytes(), &bytes]);
                nodes[task].push(blob.map_err(|error| BuildError::temporary(spill, error))?);
            }
            self.progress.go_on();
        }
        let is_done = |walk: &Walk<'_>| {
            let is_read = |book: &Book| book.parts.last().is_none_or(|part| part.group < walk.group);
            walk.gathered.is_empty() && walk.tree.books.iter().all(is_read)
        };
        match walks.iter().all(is_done) {
            true => Ok(()),
            false => Err(self.damaged("join", 0, "batch: found that of no node, expected one of a node of its tree")),
        }
    }

    /// Gathers the batches of the groups before one of this number, by their nodes: each node's in the order of groups.
    fn gather(&self, spill: &Spill, scaled: &Scaled, walk: &mut Walk<'_>, end: u32) -> Result<(), BuildError> {
        let Walk { tree, coded, group: next, gathered, .. } = walk;
        while *next < end {
            for (number, (book, coded)) in tree.books.iter().zip(coded.iter()).enumerate() {
                let mut at = 0;
                for (parts, run) in book.runs() {
                    let own = at..at + parts.len();
                    at = own.end;
                    if parts[0].group != *next {
                        continue;
                    }
                    let mut entries = self.run_of(spill, scaled, book, parts, run)?.into_iter();
                    for (part, blob) in parts.iter().zip(&coded[own]) {
                        let batches = self.coded_part(spill, part, blob)?;
                        for (batch, Entry { depth, index, batch: about }) in batches.into_iter().zip(entries.by_ref()) {
                            let node: &mut Gathered = gathered.entry((depth, index)).or_default();
                            node.coded.codebook = number as u16;
                            node.coded.add(&about, batch);
                            node.is_leaf = book.is_of_leaves();
                            node.particles = node.particles.saturating_add(about.info.particles as u64);
                        }
                    }
                }
            }
            *next += 1;
        }
        Ok(())
    }

    /// Hands out the nodes of a tree, as they are stored, that were whole with a group of buckets. `leaves` has up to where the smoothing lengths of
    /// leaves are, by depth, which the tree that has them puts there and another one takes.
    fn walk(
        &self,
        spill: &Spill,
        walk: &mut Walk<'_>,
        run: usize,
        leaves: &mut Vec<VecDeque<f32>>,
        mut sink: impl FnMut(PlacedNode),
    ) -> Result<(), BuildError> {
        let Walk { kind, tree, before, placed, checked, gathered, lengths, .. } = walk;
        let firsts: Vec<usize> = checked.nodes().collect();
        let draft = self.next_draft(spill, &tree.drafts[run], checked)?;
        let depths = draft.nodes.len();
        lengths.resize_with(lengths.len().max(depths + 1), VecDeque::new);
        leaves.resize_with(leaves.len().max(depths), VecDeque::new);
        // Children before their parents.
        for (depth, (nodes, positions)) in draft.into_levels().enumerate().rev() {
            let first = firsts.get(depth).copied().unwrap_or(0);
            for (index, (node, positions)) in (first..).zip(nodes.into_iter().zip(positions)) {
                let is_leaf = node.encoding == Encoding::Leaf;
                if is_leaf && *kind != Purpose::Splats {
                    // Both trees have the same cells.
                    let length = leaves[depth].pop_front().unwrap_or(0.0);
                    lengths[depth].push_back(length);
                    continue;
                }
                let own = gathered.remove(&(depth, index)).unwrap_or_default();
                let Gathered { coded, is_leaf: is_of_leaves, particles } = own;
                expect("particles of batches", particles, node.particles)
                    .and_then(|()| {
                        let is_sound = particles == 0 || is_leaf == is_of_leaves;
                        expect_that(is_sound, "batch", "one of a node of its tree")
                    })
                    .map_err(|what| self.damaged("join", 0, &what))?;
                let children = node.children.map(|child| child.map(|child| placed.places[depth + 1][child]));
                let below = lengths[depth + 1].drain(..children.iter().flatten().count());
                let node = StoredNode { children, ..stored(&node, &coded, (*kind, *before), below) };
                lengths[depth].push_back(node.smoothing_length_max);
                if is_leaf {
                    leaves[depth].push_back(node.smoothing_length_max);
                }
                sink((placed.places[depth][index], (node, NodeSections::new(positions, coded))));
            }
        }
        Ok(())
    }
}
