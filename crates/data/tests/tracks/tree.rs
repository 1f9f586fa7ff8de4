//! The tree of a run: what nodes stand for, how they move, and what is drawn of them at any time.

use super::{Generated, distance, generated, generated_at, rows};
use deepfield_data::hierarchy::Purpose;
use deepfield_data::hierarchy::spacetime::{HermiteSpline, Interpolation, Motion, Tracks};
use deepfield_data::model::Moment;
use deepfield_data::store::run::{RunTree, verify_run};
use deepfield_data::store::{PageId, Particles, Tree};
use deepfield_data::synth::moving::{Births, Halo, Moving, Orbits, Pancake};
use std::sync::Arc;

#[test]
fn clusters_stand_for_what_is_below_them() {
    // Enough for several buckets, so that there are nodes above those of buckets.
    let kinds: [(Box<dyn Moving>, f64); 3] = [
        (Box::new(Orbits::new(1, 90_000)), 0.2),
        (Box::new(Pancake::new(1, 20_000)), 0.2),
        (Box::new(Births::new(1, 12_000, 3)), 0.5),
    ];
    for (kind, coarse) in kinds {
        let generated = generated(&*kind, 3, 2.0);
        let run = generated.usual();
        verify_run(run.path(), &()).unwrap();
        for family in 0..run.tracks().unwrap().families.len() {
            let (space, index) = (run.interval(1).unwrap(), run.track_index(1, family).unwrap());
            let tracks: Vec<Tracks> =
                index.nodes.iter().map(|node| run.node_tracks(1, family, node, node.is_leaf()).unwrap()).collect();
            let inner = || index.nodes.iter().enumerate().filter(|(_, node)| !node.is_leaf());
            assert!(index.leaves().count() == 1 || inner().count() > 0);
            let leaves_of = |node: usize| {
                let (mut open, mut leaves) = (vec![node], Vec::new());
                while let Some(next) = open.pop() {
                    open.extend(index.nodes[next].children.iter().map(|child| *child as usize));
                    if index.nodes[next].is_leaf() {
                        leaves.push(next);
                    }
                }
                leaves
            };
            for (number, node) in inner() {
                assert!((node.tracks as usize) < 20_000 && node.delta > 0.0, "{} clusters", node.tracks);
                let clusters = &tracks[number];
                let leaves = leaves_of(number);
                for u in [0.0, 0.3, 1.0] {
                    let places = |tracks: &Tracks| -> Vec<glam::DVec3> {
                        (0..tracks.len()).map(|i| space.spline(tracks, i).position(u)).collect()
                    };
                    let own = places(clusters);
                    let (mut farthest, mut moments) = (0.0_f64, [(0.0, glam::DVec3::ZERO); 2]);
                    for leaf in &leaves {
                        // Some of them: all pairs take long.
                        for (i, place) in places(&tracks[*leaf]).into_iter().enumerate() {
                            let mass = f64::from(tracks[*leaf].ends[0].mass[i]);
                            moments[0] = (moments[0].0 + mass, moments[0].1 + mass * place);
                            if i % 37 == 0 {
                                let near =
                                    own.iter().map(|own| own.distance_squared(place)).fold(f64::INFINITY, f64::min);
                                farthest = farthest.max(near.sqrt());
                            }
                        }
                    }
                    for (i, place) in own.iter().enumerate() {
                        let mass = f64::from(clusters.ends[0].mass[i]);
                        moments[1] = (moments[1].0 + mass, moments[1].1 + mass * *place);
                    }
                    assert!(farthest <= node.delta, "{farthest} from the nearest cluster, {}", node.delta);
                    let [all, merged] = moments.map(|(mass, sum)| sum / mass);
                    assert!((all - merged).length() < 0.02 * node.spacing + 1e-9, "{all} {merged}");
                    assert!((moments[0].0 / moments[1].0 - 1.0).abs() < 2e-4);
                }
            }
            let root = index.nodes.last().unwrap();
            let extent = run.tracks().unwrap().lattice.root.size;
            assert!(root.is_leaf() || root.delta < coarse * extent, "{} of {extent}", root.delta);
        }
    }
}

/// What a motion says of a time, by its description alone, against what is drawn then.
fn is_moved_to(motion: &Motion, time: f64, drawn: &Particles) {
    let u = Motion::place(motion.span, motion.holds, time);
    let length = motion.span[1] - motion.span[0];
    let [begin, end] = &motion.ends;
    assert_eq!([begin.positions.len(), end.positions.len()], [drawn.len(); 2]);
    let between = |a: f32, b: f32, is_log: bool| match is_log && a > 0.0 && b > 0.0 {
        true => f64::from(a) * (u * f64::from(b / a).ln()).exp(),
        false => f64::from(a) * (1.0 - u) + f64::from(b) * u,
    };
    let close = |found: f64, drawn: f32| (found - f64::from(drawn)).abs() <= 2e-6 * f64::from(drawn).abs() + 1e-12;
    for i in 0..drawn.len() {
        let tangent = |velocity: [f64; 3]| velocity.map(|v| v * length).into();
        let spline = HermiteSpline {
            positions: [begin.positions[i].into(), end.positions[i].into()],
            tangents: [tangent(begin.velocities[i]), tangent(end.velocities[i])],
        };
        let place = spline.position(u).to_array();
        for (found, drawn) in place.into_iter().zip(drawn.positions[i]) {
            let apart = (found - drawn).abs();
            let apart = motion.box_size.map_or(apart, |edge| (apart - edge * (apart / edge).round()).abs());
            assert!(apart < 1e-9, "{found} {drawn} at {u}");
        }
        let values = &drawn.values;
        assert!(close(between(begin.mass[i], end.mass[i], false), values.mass[i]));
        assert!(close(between(begin.density[i], end.density[i], true), values.density[i]));
        assert!(close(between(begin.smoothing_length[i], end.smoothing_length[i], true), values.smoothing_length[i]));
        for (k, is_log) in motion.is_logarithmic.iter().enumerate() {
            assert!(close(between(begin.attributes[k][i], end.attributes[k][i], *is_log), values.attributes[k][i]));
        }
    }
}

#[test]
fn the_motion_of_nodes_is_what_is_drawn_of_them() {
    let kinds: [(Generated, bool); 3] = [
        (generated(&Births::new(5, 3000, 4), 4, 2.0), false),
        // Across the faces of its box.
        (generated(&Pancake::new(2, 4096), 4, 1.0), false),
        // Of which much is unresolved, and fades.
        (generated_at(&Halo::new(2, 3000), vec![0.0, 5.0, 10.0]), true),
    ];
    for (generated, has_fading) in kinds {
        let run = generated.usual();
        for interpolation in Interpolation::ALL {
            let tree = RunTree::new(Arc::clone(&run), interpolation).unwrap();
            let mut stand = 0;
            for page in (0..tree.page_count()).map(PageId) {
                let page = tree.read_page(page).unwrap();
                let content = page.content(0).unwrap();
                assert!(content.moves());
                let motion = content.motion().unwrap();
                for u in [0.0, 0.3, 0.77, 1.0] {
                    let time = motion.span[0] + u * (motion.span[1] - motion.span[0]);
                    is_moved_to(&motion, time, &content.particles(time));
                }
                let [begin, end] = &motion.ends;
                stand += (0..begin.mass.len())
                    .filter(|i| begin.velocities[*i] == [0.0; 3] && end.mass[*i] > begin.mass[*i])
                    .count();
            }
            let expected = interpolation == Interpolation::Fade || has_fading && interpolation == Interpolation::Auto;
            assert!(stand > 0 || !expected, "{interpolation:?}");
        }
    }
}

#[test]
fn the_tree_of_a_run_shows_what_its_tracks_are_at_any_time() {
    let births = Births::new(5, 9000, 4);
    let generated = generated(&births, 4, 2.0);
    let run = generated.usual();
    for interpolation in [Interpolation::Auto, Interpolation::Linear, Interpolation::Fade, Interpolation::Hold] {
        let tree = RunTree::new(Arc::clone(&run), interpolation).unwrap();
        let families: Vec<u32> = (0..tree.metadata().families.len() as u32).collect();
        for (step, u) in [(0, 0.0), (0, 0.4), (1, 0.7), (2, 0.5), (3, 0.0)] {
            let moment = Moment { step, u };
            let snapshot = run.at(moment, interpolation).unwrap();
            let time = tree.time(moment);
            let (mut drawn, mut coarse) = (Vec::new(), 0.0);
            for root in tree.roots(&families, Purpose::Splats, time) {
                assert!(tree.is_root(root.page));
                let page = tree.read_page(root.page).unwrap();
                let scale = f64::from(page.nodes[0].mass_scale);
                let held = page.content(0).unwrap().particles(time);
                coarse += held.values.mass.iter().map(|mass| scale * f64::from(*mass)).sum::<f64>();
                let mut open = vec![page];
                while let Some(page) = open.pop() {
                    let node = &page.nodes[0];
                    assert!(node.time[0] <= time && time < node.time[1]);
                    let held = page.content(0).unwrap().particles(time);
                    assert_eq!(held.len(), node.particles as usize);
                    assert!(page.memory() >= tree.page_bytes(page.id));
                    for (child, bounds) in page.children(0).iter().zip(page.child_bounds(0)) {
                        open.push(tree.read_page(child.page).unwrap());
                        assert_eq!(open.last().unwrap().nodes[0].bounds, *bounds);
                    }
                    if node.is_leaf() {
                        for (i, place) in held.positions.iter().enumerate() {
                            assert!(node.bounds.contains((*place).into()) || run.tracks().unwrap().box_size.is_some());
                            drawn.extend((held.values.mass[i] > 0.0).then_some((*place, held.values.mass[i])));
                        }
                    }
                }
            }
            let mut expected: Vec<([f64; 3], f32)> = Vec::new();
            for row in rows(&snapshot).into_values().flatten() {
                expected.extend((row.1 > 0.0).then_some((row.0, row.1 as f32)));
            }
            // Those that fade are in line with others, up to rounding.
            let key = |row: &([f64; 3], f32)| (row.0.map(|x| (x * 1e9).round() as i64), row.1.to_bits());
            let by_place = |a: &([f64; 3], f32), b: &([f64; 3], f32)| key(a).cmp(&key(b));
            drawn.sort_by(by_place);
            expected.sort_by(by_place);
            assert_eq!(drawn.len(), expected.len(), "{interpolation:?} at {moment:?}");
            for (drawn, expected) in drawn.iter().zip(&expected) {
                let same = distance(drawn.0, expected.0) < 1e-12 && (drawn.1 / expected.1 - 1.0).abs() < 1e-6;
                assert!(same, "{drawn:?} {expected:?} {interpolation:?} at {moment:?}");
            }
            let mass: f64 = expected.iter().map(|(_, mass)| f64::from(*mass)).sum();
            assert!((coarse / mass - 1.0).abs() < 1e-3, "{coarse} {mass}");
        }
    }
    let tree = RunTree::new(run, Interpolation::Auto).unwrap();
    let at = |step, u| tree.time(Moment { step, u });
    assert_eq!(tree.next_intervals(at(0, 0.5), at(1, 0.1)), [at(1, 0.0)]);
    assert_eq!(tree.next_intervals(at(0, 0.5), at(2, 0.1)), [at(1, 0.0), at(2, 0.0)]);
    assert!(tree.next_intervals(at(0, 0.5), at(0, 0.9)).is_empty());
    assert!(tree.next_intervals(at(2, 0.5), at(3, 0.0)).is_empty(), "the last one");
    assert_eq!(tree.next_intervals(at(1, 0.5), at(0, 0.9)), [at(0, 0.5)]);
    assert_eq!(tree.next_intervals(at(2, 0.5), at(0, 0.0)), [at(1, 0.5), at(0, 0.5)]);
    assert!(tree.next_intervals(at(1, 0.5), at(1, 0.1)).is_empty());
    assert!(tree.next_intervals(at(0, 0.5), at(0, 0.0)).is_empty());
    assert!(tree.read_page(PageId(tree.page_count())).is_err());
}
