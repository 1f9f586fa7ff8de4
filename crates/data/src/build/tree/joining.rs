//! Joining what was built of buckets to the nodes of trees, as buckets come.

use super::{BuildError, Built, Grower, Kept};
use crate::hierarchy::cell::MAX_DEPTH;
use crate::hierarchy::octree::{Assembly, Open, Piece, TreeNode, join};
use crate::hierarchy::{Encoding, LevelInfo, Purpose};

/// Nodes of each depth that follow those before them.
pub(in crate::build) type Nodes = Vec<Vec<TreeNode<Option<Kept>>>>;

/// The trees of a family while what was built of its buckets comes: one for each kind of levels.
pub(in crate::build) struct Joiner<'a> {
    grower: &'a Grower<'a>,
    kinds: Vec<Joining>,
}

struct Joining {
    levels: Purpose,
    assembly: Assembly<Option<Kept>>,
    /// What buckets have left open in merging cells that others have particles in, too.
    open: Vec<Open>,
    /// The first key of what is open that nodes of each depth may still have pieces of.
    first: [u64; MAX_DEPTH as usize + 1],
}

impl Joining {
    fn leave_open(&mut self, open: Open) {
        let above = self.first.iter_mut().take(usize::from(open.depth()));
        above.for_each(|first| *first = open.key().min(*first));
        self.open.push(open);
    }

    /// What is open before a key, in order; it is not open any more.
    fn take_open(&mut self, end: u64) -> Vec<Open> {
        let count = self.open.partition_point(|open| open.key() < end);
        if count == 0 {
            return Vec::new();
        }
        let later = self.open.split_off(count);
        let open = std::mem::take(&mut self.open);
        self.first = [u64::MAX; MAX_DEPTH as usize + 1];
        later.into_iter().for_each(|open| self.leave_open(open));
        open
    }
}

impl Grower<'_> {
    /// Trees of which no bucket has come yet.
    pub fn joiner(&self) -> Joiner<'_> {
        let context = self.context;
        let kind = |&levels: &Purpose| {
            let assembly = Assembly::new(levels, context.root, *context.options);
            Joining { levels, assembly, open: Vec::new(), first: [u64::MAX; MAX_DEPTH as usize + 1] }
        };
        Joiner { grower: self, kinds: context.options.levels().iter().map(kind).collect() }
    }
}

impl Joiner<'_> {
    /// Adds what was built of the buckets that come next, up to the one of number `next`, and gives for each kind of levels the nodes that are
    /// whole now.
    ///
    /// # Errors
    /// When something cannot be put away.
    pub fn add(&mut self, built: impl IntoIterator<Item = Built>, next: usize) -> Result<Vec<Nodes>, BuildError> {
        let Joiner { grower, kinds } = self;
        let grower: &Grower<'_> = grower;
        let are_shared = kinds.len() > 1;
        for bucket in built {
            let mut leaves: Vec<Piece<Option<Kept>>> = Vec::new();
            for (kind, (mut pieces, open)) in kinds.iter_mut().zip(bucket) {
                if kind.levels == Purpose::Splats && are_shared {
                    let own = pieces.iter().filter(|piece| piece.encoding == Encoding::Leaf);
                    leaves.extend(own.map(|leaf| leaf.with(None)));
                } else {
                    pieces.append(&mut leaves);
                }
                pieces.into_iter().for_each(|piece| kind.assembly.add(piece));
                open.into_iter().for_each(|open| kind.leave_open(open));
            }
        }
        let (end, joined) = (grower.plan.keys(next).start, grower.plan.joined_before(next));
        let mut all = Vec::with_capacity(kinds.len());
        for kind in kinds {
            let open = kind.take_open(joined);
            let Joining { levels, assembly, first, .. } = kind;
            join(grower.context, *levels, open, &mut |piece| {
                let bucket = grower.plan.bucket(piece.first);
                assembly.add(grower.keep(piece, bucket, grower.spill)?);
                Ok::<_, BuildError>(())
            })?;
            all.push(assembly.complete(|depth| first[usize::from(depth)].min(end)));
        }
        Ok(all)
    }

    /// What each depth has of each kind, once all buckets have come.
    pub fn levels(self) -> Vec<Vec<LevelInfo>> {
        self.kinds.into_iter().map(|kind| kind.assembly.levels()).collect()
    }
}
