//! Rays, against the same with each box on the way to a cell tried as cells are.

use super::super::memory::MemorySurface;
use super::super::picture::{SurfaceOptions, scene};
use super::super::tests::{Random, camera_over, hills, placed};
use super::*;
use crate::view::{Projection, View};

/// The first hit where no box is passed by quickly.
fn plain(caster: &Caster<'_>, number: usize, passing: &Passing<'_>, span: [f64; 2]) -> Option<RayHit> {
    let branch = &caster.branches[number];
    let span = within(passing.ray, branch.rectangle, Some(branch.range), span)?;
    match &branch.below {
        Below::Mesh(mesh) => plain_square(caster, (*mesh, caster.pyramids[*mesh].top()), [0, 0], passing, span),
        Below::Parts(parts) => {
            let mut parts = passing.order.into_iter().filter_map(|[row, column]| parts[2 * row + column]);
            parts.find_map(|part| plain(caster, part, passing, span))
        }
    }
}

fn plain_square(
    caster: &Caster<'_>,
    (number, level): (usize, usize),
    at: [usize; 2],
    passing: &Passing<'_>,
    span: [f64; 2],
) -> Option<RayHit> {
    let mesh = &caster.scene.meshes[number];
    if at[0] << level >= mesh.rows.len() - 1 || at[1] << level >= mesh.columns.len() - 1 {
        return None;
    }
    let range = caster.pyramids[number].range_of(level, at);
    let span = within(passing.ray, square(mesh, level, at), range, span)?;
    if level == 0 {
        return caster.cast_cell(number, at, passing, span[0]);
    }
    passing.order.into_iter().find_map(|[down, right]| {
        plain_square(caster, (number, level - 1), [2 * at[0] + down, 2 * at[1] + right], passing, span)
    })
}

/// A ray that leaves a square of cells nowhere on its way through all heights is looked for there, and one along a row in the whole chunk.
#[test]
fn rays_begin_in_the_smallest_square_that_they_do_not_leave() {
    let field = hills(300, 300, 0.0, 8);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let (middle, projection) = (DVec3::new(149.5, 149.5, 0.0), Projection::Orthographic { height: 400.0 });
    let view = View::look_at(middle + 600.0 * DVec3::Z, middle, DVec3::Y, projection, 64, 64).unwrap();
    let scene = scene(&source, &placed, &Sight::Flat(view), &SurfaceOptions { tau: 0.0, ..SurfaceOptions::default() });
    let caster = Caster::new(&scene);
    let Branch { rectangle, range, .. } = &caster.branches[caster.root.unwrap()];
    let number = scene.cut.at(0, 0).unwrap();
    let whole = 1_u64 << scene.meshes[number].node.key.level;
    let around = |column: f64, direction: [f64; 3]| {
        let [column, row] = [column, 6.5].map(|at| at * whole as f64);
        let ray = GridRay { origin: [column, row, 0.5 * (range[0] + range[1])], direction };
        let passing = Passing::new(&ray, [0.0, f64::INFINITY], *rectangle, *range);
        let span = passing.through(*rectangle, *range, passing.part).unwrap();
        caster.around(number, &passing, span)
    };
    let down = [0.0, 0.0, -1.0];
    assert_eq!((around(9.5, down), around(11.9, down)), ((FIRST, [1, 2]), (FIRST, [1, 2])));
    // Just where two squares meet both are tried: what holds them is twice as wide.
    assert_eq!(around(4.0, down), (FIRST + 1, [0, 0]));
    assert_eq!(around(9.5, [1.0, 0.0, -1e-3]), (caster.pyramids[number].top(), [0, 0]));
}

#[test]
fn boxes_are_passed_by_only_where_nothing_is_met() {
    let mut random = Random::new(3);
    let (mut hits, mut misses) = (0, 0);
    for holes in [0.0, 0.2] {
        let field = hills(900, 700, holes, 21);
        let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
        // Pixels' centres are on rows and columns of samples, and rays along axes.
        let middle = DVec3::new(350.5, 450.5, 0.0);
        let straight = [(DVec3::Z, DVec3::Y), (-DVec3::X, DVec3::Z), (DVec3::Y, DVec3::Z)].map(|(back, up)| {
            let projection = Projection::Orthographic { height: 64.0 };
            View::look_at(middle + 600.0 * back, middle, up, projection, 64, 64).unwrap()
        });
        let leaning = (0..6).map(|_| camera_over(&field, &mut random, [64, 48])).collect::<Vec<View>>();
        for view in straight.into_iter().chain(leaning) {
            let (sight, [width, height]) = (Sight::Flat(view), [view.width, view.height]);
            let scene = scene(&source, &placed, &sight, &SurfaceOptions::default());
            let caster = Caster::new(&scene);
            let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y].map(|at| f64::from(at) + 0.5)));
            let seen = pixels.filter_map(|pixel| {
                let (origin, direction) = sight.ray(pixel)?;
                placed.ray(origin, direction)
            });
            let mut any = || GridRay {
                origin: [random.between(-50.0, 750.0), random.between(-50.0, 950.0), random.between(-60.0, 200.0)],
                direction: std::array::from_fn(|_| random.between(-1.0, 1.0)),
            };
            let others = (0..500).map(|_| any()).collect::<Vec<GridRay>>();
            let (root, part) = (caster.root.unwrap(), [0.0, f64::INFINITY]);
            let Branch { rectangle, range, .. } = &caster.branches[root];
            for ray in seen.chain(others) {
                let passing = Passing::new(&ray, part, *rectangle, *range);
                let expected = plain(&caster, root, &passing, part);
                assert_eq!(caster.cast(&ray, part), expected, "{ray:?}");
                if expected.is_some() { hits += 1 } else { misses += 1 }
            }
        }
    }
    assert!(hits > 20_000 && misses > 500, "{hits} hits, {misses} misses");
}
