use super::*;
use crate::codec::clusters::{step_clusters, step_count};
use crate::model::Bounds;
use crate::view::Projection;
use proptest::prelude::*;

/// Families in one place: each has a root of clusters that a leaf refines.
struct Families(Vec<Family>);

struct Family {
    clusters: u64,
    particles: u64,
    steps: Vec<Step>,
}

impl Family {
    fn new(clusters: u32, more: f64, worth: f64) -> Family {
        let step = |number: usize| {
            let clusters = step_clusters(number, clusters);
            let priority = worth.exp2() * f64::from(clusters).powf(-1.5);
            Step { clusters, priority, scale: 1.0, misfit: 0.0, largest: 1.0 }
        };
        let steps = (0..step_count(clusters as usize)).map(step).collect();
        Family { clusters: u64::from(clusters), particles: (more * f64::from(clusters)) as u64, steps }
    }
}

impl NodeTree for Families {
    /// Of which family, and whether it is the leaf.
    type Id = (usize, bool);

    fn node(&self, (family, is_leaf): (usize, bool)) -> Option<NodeInfo> {
        let own = &self.0[family];
        Some(NodeInfo {
            extent: Extent { bounds: Bounds { min: DVec3::ZERO, max: DVec3::ONE }, margin: 0.0 },
            delta: 0.1,
            spacing: 0.0,
            particles: if is_leaf { own.particles } else { own.clusters },
            source_particles: own.particles,
            mass: 1.0,
            is_leaf,
            stands_for_leaf: !is_leaf,
            time: [f64::NEG_INFINITY, f64::INFINITY],
        })
    }

    fn children(&self, (family, is_leaf): (usize, bool)) -> impl Iterator<Item = (usize, bool)> {
        (!is_leaf).then_some((family, true)).into_iter()
    }

    fn steps(&self, (family, is_leaf): (usize, bool)) -> &[Step] {
        if is_leaf { &[] } else { &self.0[family].steps }
    }
}

fn selected(families: &Families, splats: u64) -> Selection<(usize, bool)> {
    let projection = Projection::Orthographic { height: 2.0 };
    let view = View::look_at(DVec3::new(0.5, 0.5, 5.0), DVec3::splat(0.5), DVec3::Y, projection, 256, 256).unwrap();
    let roots: Vec<_> = (0..families.0.len()).map(|family| (family, false)).collect();
    select_within((&view, Scope::Picture), splats, families, &roots)
}

proptest! {
    /// However different families are, a budget is kept, and used where there are clusters for it.
    #[test]
    fn budgets_are_kept_and_used(
        families in prop::collection::vec((1..8192_u32, 1.5..8.0f64, -40.0..40.0f64), 1..5), share in 0.0..1.0f64,
    ) {
        let families = Families(families.into_iter().map(|(n, more, worth)| Family::new(n, more, worth)).collect());
        let clusters: u64 = families.0.iter().map(|family| family.clusters).sum();
        let splats = ((share * clusters as f64) as u64).max(families.0.len() as u64);
        let used = selected(&families, splats).particles();
        prop_assert!(used <= splats, "{used} of {splats}");
        prop_assert!(used as f64 >= 0.94 * splats as f64 - 1.0, "{used} of {splats}");
        // With room for all there is, all leaves are drawn.
        let particles: u64 = families.0.iter().map(|family| family.particles).sum();
        let all = selected(&families, particles);
        prop_assert_eq!(all.particles(), particles);
        prop_assert!(all.draw.iter().all(|node| node.id.1));
    }
}

/// Where the leaf that is worth most does not fit into what is left, another one does.
#[test]
fn what_does_not_fit_is_passed_over() {
    let families = Families(vec![Family::new(1000, 8.0, 20.0), Family::new(500, 2.0, 0.0)]);
    let selection = selected(&families, 2500);
    let mut drawn: Vec<_> = selection.draw.iter().map(|node| (node.id, node.particles)).collect();
    drawn.sort_unstable();
    assert_eq!(drawn, [((0, false), 1000), ((1, true), 1000)]);
    // A little more room makes no difference, enough for the large one does.
    assert_eq!(selected(&families, 2600).particles(), 2000);
    assert!(selected(&families, 8600).draw.iter().any(|node| node.id == (0, true)));
}
