//! Plots of a part of a page file: as near to those of all of it as is allowed, and from fewer pages where much is.

use crate::support::{Random, dataset_of, gas, run};
use deepfield::build::{BuildOptions, build};
use deepfield::explore::{
    Binned, BinnedAxis, Data, Effort, Members, Plot, PlotOptions, ProfileOptions, Radial, Region, Shape, Weight, Work,
    farthest, radial, radials,
};
use deepfield::store::PageFile;
use glam::DVec3;
use serde_json::Value;
use std::path::Path;
use std::time::Instant;

const EDGE: f64 = 100.0;

/// A box of close groups of eight, hotter to the right, as a file of hundreds of pages: merged particles stand for groups.
fn built(path: &Path) -> PageFile {
    let mut random = Random(3);
    let mut family = gas();
    for _ in 0..3000 {
        let middle = [(); 3].map(|()| EDGE * random.next());
        for _ in 0..8 {
            family.positions.push(middle.map(|x| x + 1e-4 * random.next()));
            family.mass.push((1.0 + random.next()) as f32);
            family.smoothing_length.push(0.5);
            family.density.push(1.0);
            let exponent = 3.0 + 3.0 * middle[0] / EDGE + 0.1 * random.next();
            family.attributes[0].values.push(10f64.powf(exponent) as f32);
        }
    }
    let mut options = BuildOptions { page_bytes: 2048, ..BuildOptions::default() };
    options.octree.leaf_capacity = 32;
    build(dataset_of(family), &options, path, &()).unwrap();
    PageFile::open(path).unwrap()
}

fn plot(file: &PageFile, region: &Region, options: &PlotOptions, effort: Effort) -> Plot {
    Plot::find(Data::Pages(file), &Members::Region(region.clone()), options, effort, None, Work::quiet()).unwrap()
}

/// The histogram of four bins of a region.
fn histogram(file: &PageFile, region: &Region, weight: &Weight, effort: Effort) -> Binned {
    let axis = BinnedAxis { field: "temperature".into(), bins: 4, logarithmic: Some(true), range: None };
    let options = PlotOptions::Binned { axes: vec![axis], weight: weight.clone() };
    match plot(file, region, &options, effort) {
        Plot::Binned(found) => found,
        other => panic!("{other:?}"),
    }
}

/// Around the middle of the box, up to its corners.
fn ball() -> Region {
    Region::sphere(DVec3::splat(0.5 * EDGE), 0.87 * EDGE)
}

/// Five shells of equal width.
fn shells(field: Option<&str>) -> ProfileOptions {
    ProfileOptions { shells: 5, inner: None, field: field.map(str::to_owned) }
}

fn profile(file: &PageFile, effort: Effort) -> Radial {
    match plot(file, &ball(), &PlotOptions::Radial(shells(Some("temperature"))), effort) {
        Plot::Radial(found) => found,
        other => panic!("{other:?}"),
    }
}

/// Bins along the diagonal of the cells of which a scatter plot tells errors.
const CELLS: usize = 16;

/// Temperatures over themselves: the shares of points in bins of equal width in the logarithm, their errors, and how many particles there are.
fn shares(file: &PageFile, ends: Option<[f64; 2]>, effort: Effort) -> ([f64; CELLS], Vec<f64>, u64, [f64; 2]) {
    let options = PlotOptions::Scatter { fields: ["temperature", "temperature"].map(str::to_owned), points: 100_000 };
    let Plot::Scatter { x, of, estimate, .. } = plot(file, &Region::whole(), &options, effort) else { panic!() };
    let own = [x.iter().copied().fold(f64::INFINITY, f64::min), x.iter().copied().fold(0.0, f64::max)];
    let [low, high] = ends.unwrap_or(own);
    let mut shares = [0.0; CELLS];
    for value in &x {
        let bin = ((value / low).ln() / (high / low).ln() * CELLS as f64) as usize;
        shares[bin.min(CELLS - 1)] += 1.0 / x.len() as f64;
    }
    let errors = estimate.map_or_else(Vec::new, |of| (0..CELLS).map(|bin| of.errors[bin * (CELLS + 1)]).collect());
    (shares, errors, of, own)
}

#[test]
fn errors_of_parts_are_as_told_and_save_pages() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&folder.path().join("groups.df"));
    let ball = Region::sphere(DVec3::splat(0.5 * EDGE), 0.45 * EDGE).with_range("temperature", Some(1e3), Some(2e6));
    for region in [Region::whole(), ball] {
        for weight in [Weight::Mass, Weight::Count, Weight::Field("temperature".into())] {
            let of_all = histogram(&file, &region, &weight, Effort::ALL);
            assert!(of_all.estimate.is_none());
            assert_eq!(histogram(&file, &region, &weight, Effort::within(0.0)), of_all);
            for allowed in [0.01, 0.1, 0.6] {
                let found = histogram(&file, &region, &weight, Effort::within(allowed));
                let about = format!("{weight} within {allowed}: {:?}, expected {:?}", found.weights, of_all.weights);
                let share = 0.01 * of_all.total;
                // Three standard errors are what is told.
                let slack = if found.estimate.is_some() { 1.5 } else { 1.0 };
                let is_whole = region.shapes.is_empty();
                if is_whole {
                    assert_eq!(found.axes, of_all.axes);
                    for (one, all) in found.weights.iter().zip(&of_all.weights) {
                        assert!((one - all).abs() <= slack * allowed * all.max(share), "{about}");
                    }
                    // Of other weights than these numbers have no error of their own.
                    if !matches!(weight, Weight::Field(_)) {
                        let off = (found.count as f64 / of_all.count as f64 - 1.0).abs();
                        assert!(off <= slack * allowed, "{} of {} particles", found.count, of_all.count);
                    }
                } else {
                    // Axes reach over the whole file.
                    let off = (found.total / of_all.total - 1.0).abs();
                    assert!(off <= slack * allowed, "{about}");
                }
                if let Some(estimate) = &found.estimate {
                    assert!(
                        estimate.largest <= allowed && estimate.pages == u64::from(file.page_count()),
                        "{estimate:?}"
                    );
                    assert!(estimate.pages_read < estimate.pages && estimate.parts_read < estimate.parts);
                }
                if allowed > 0.5 && is_whole && !matches!(weight, Weight::Field(_)) {
                    assert!(found.estimate.is_some(), "{about}");
                }
            }
        }
    }
}

/// How estimates of one number lie about it: whether they are right on average, and how many are farther off than was told.
#[derive(Default)]
struct Spread {
    off: Vec<f64>,
    told: Vec<f64>,
}

impl Spread {
    fn add(&mut self, estimated: f64, exact: f64, told: f64) {
        self.off.push(estimated - exact);
        self.told.push(told);
    }

    /// Draws that are as far off as was told or less.
    fn covered(&self) -> usize {
        self.off.iter().zip(&self.told).filter(|(off, told)| off.abs() <= **told).count()
    }

    /// The mean, in its own standard errors as they were told.
    fn bias(&self) -> f64 {
        let draws = self.off.len() as f64;
        let mean = self.off.iter().sum::<f64>() / draws;
        let squares: f64 = self.told.iter().map(|told| (told / 3.0).powi(2)).sum();
        mean * draws / squares.sqrt()
    }
}

#[test]
fn estimates_of_many_draws_are_right_on_average_and_within_what_is_told() {
    const DRAWS: u64 = 12;
    // More than any error: as few parts as tell it are read.
    const MUCH: f64 = 1e6;
    let folder = tempfile::tempdir().unwrap();
    let file = built(&folder.path().join("groups.df"));
    let of_all = profile(&file, Effort::ALL);
    assert!(of_all.estimate.is_none());
    assert_eq!(profile(&file, Effort::within(0.0)), of_all);
    let (shares_of_all, none, particles, ends) = shares(&file, None, Effort::ALL);
    assert!(none.is_empty());
    let bins_of_all = histogram(&file, &Region::whole(), &Weight::Count, Effort::ALL);

    // With no time left, ways through parts are read in place of all of them.
    for is_hurried in [false, true] {
        let effort = |draw| {
            let any = if is_hurried { Effort::until(Instant::now()) } else { Effort::within(MUCH) };
            any.drawn(draw)
        };
        let mut spreads: Vec<Spread> = Vec::new();
        let mut of_means = Vec::new();
        let mut told_of_means = Vec::new();
        for draw in 0..DRAWS {
            let mut next = 0;
            let mut add = |estimated: f64, exact: f64, told: f64| {
                spreads.resize_with(spreads.len().max(next + 1), Spread::default);
                spreads[next].add(estimated, exact, told);
                next += 1;
            };
            let found = profile(&file, effort(draw));
            let estimate = found.estimate.as_ref().unwrap();
            assert!(estimate.of_masses.pages_read < estimate.of_masses.pages && found.error.is_some());
            for (index, (shell, exact)) in found.shells.iter().zip(&of_all.shells).enumerate() {
                add(shell.mass, exact.mass, estimate.of_masses.errors[index]);
                let weighted = (shell.mass_weighted_mean.unwrap(), exact.mass_weighted_mean.unwrap());
                let errors =
                    [&estimate.mean_errors, &estimate.mass_weighted_mean_errors].map(|all| all[index].unwrap());
                let plain = (shell.mean.unwrap(), exact.mean.unwrap());
                for ((mean, exact), error) in [plain, weighted].into_iter().zip(errors) {
                    of_means.push((mean - exact).abs() <= error);
                    told_of_means.push(error / exact);
                }
            }
            let found = histogram(&file, &Region::whole(), &Weight::Count, effort(draw));
            let estimate = found.estimate.as_ref().unwrap();
            for (bin, (weight, exact)) in found.weights.iter().zip(&bins_of_all.weights).enumerate() {
                add(*weight, *exact, estimate.errors[bin]);
            }
            let (shares, errors, of, _) = shares(&file, Some(ends), effort(draw));
            assert!((of as f64 / particles as f64 - 1.0).abs() < 0.05, "{of} of {particles}");
            for ((share, exact), error) in shares.iter().zip(&shares_of_all).zip(errors) {
                add(*share, *exact, error);
            }
        }
        let all = spreads.len() * DRAWS as usize;
        let covered: usize = spreads.iter().map(Spread::covered).sum();
        assert!(covered as f64 > 0.9 * all as f64, "hurried {is_hurried}: {covered} of {all}");
        // Values differ a thousandfold here, and a shell is of few parts, not all of which are read.
        told_of_means.sort_unstable_by(f64::total_cmp);
        let usual = told_of_means[told_of_means.len() / 2];
        assert!(usual < 0.05, "hurried {is_hurried}: errors of means are {usual} of them");
        let covered = of_means.iter().filter(|is_covered| **is_covered).count();
        assert!(
            covered as f64 > 0.9 * of_means.len() as f64,
            "hurried {is_hurried}: {covered} of {} means",
            of_means.len()
        );
        for (number, spread) in spreads.iter().enumerate() {
            assert!(spread.bias().abs() < 5.0, "hurried {is_hurried}: number {number} is off by {}", spread.bias());
        }
    }
}

#[test]
fn profiles_of_one_pass_are_those_of_a_pass_each() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&folder.path().join("groups.df"));
    let few = ProfileOptions { shells: 3, ..shells(Some("temperature")) };
    let asked = [shells(None), shells(Some("temperature")), few, shells(Some("temperature"))];
    let (data, ball) = (Data::Pages(&file), ball());
    // All of the file, and as little of it as tells errors.
    for effort in [Effort::ALL, Effort::within(1e6)] {
        let together = radials(data, &ball, &asked, effort, None, Work::quiet()).unwrap();
        let each = asked.iter().map(|asked| radial(data, &ball, asked, effort, None, Work::quiet()).unwrap());
        assert_eq!(together, each.collect::<Vec<_>>());
        assert!(together.iter().all(|found| found.estimate.is_some() == (effort != Effort::ALL)));
    }
    assert!(radials(data, &ball, &[], Effort::ALL, None, Work::quiet()).unwrap().is_empty());
    let many = vec![shells(None); 257];
    assert!(radials(data, &ball, &many, Effort::ALL, None, Work::quiet()).is_err());
}

#[test]
fn the_farthest_particle_is_found_without_a_look_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&folder.path().join("groups.df"));
    let hot = Region::sphere(DVec3::splat(0.5 * EDGE), 0.4 * EDGE).with_range("temperature", Some(1e5), None);
    for region in [Region::whole(), hot] {
        for center in [DVec3::splat(0.5 * EDGE), DVec3::new(-3.0, 0.2 * EDGE, 2.0 * EDGE)] {
            let found = farthest(Data::Pages(&file), &region, center, Work::quiet()).unwrap();
            let count = |of: Region| histogram(&file, &of, &Weight::Count, Effort::ALL).count;
            let within = |radius: f64| {
                let mut ball = region.clone();
                ball.shapes.push(Shape::Sphere { center, radius });
                count(ball)
            };
            let all = count(region.clone());
            assert_eq!(within((1.0 + 1e-9) * found), all, "{found}");
            assert!(within((1.0 - 1e-6) * found) < all, "{found}");
        }
    }
}

#[test]
fn an_estimate_says_so_in_every_output() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    built(&folder.join("groups.df"));
    let plot = |more: &[&str]| {
        let all = [&["plot", "groups.df", "--histogram", "temperature", "--bins", "4", "--log"][..], more].concat();
        run(folder, &all)
    };
    let output = plot(&["--error", "0.6", "-o", "part.csv", "--json", "part.json"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("an estimate from") && text.contains("standard errors"), "{text}");
    let answer: Value = serde_json::from_slice(&std::fs::read(folder.join("part.json")).unwrap()).unwrap();
    let errors = answer["estimate"]["errors"].as_array().unwrap();
    let table = std::fs::read_to_string(folder.join("part.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("# an estimate from") && lines[1].contains("error of mass"), "{table}");
    for (line, error) in lines[2..].iter().zip(errors) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[3].parse::<f64>().unwrap()), (5, error.as_f64().unwrap()));
    }
    assert_eq!((lines.len(), errors.len()), (6, 4));
    assert_eq!(plot(&["--error", "0.1", "--exact", "-o", "x.csv"]).status.code(), Some(2));

    // Other plots, each with what it tells of errors.
    let ball = ["--radial", "temperature", "--sphere", "50,50,50,90", "--bins", "5", "--scale", "linear"];
    let points = ["--scatter", "density,temperature"];
    for (asked, word, columns) in [(&ball[..], "shell with", 13), (&points[..], "cell of 16 by 16", 2)] {
        let more = ["--error", "1000", "-o", "other.csv", "-o", "other.svg", "--json", "other.json"];
        let output = run(folder, &[&["plot", "groups.df"][..], asked, &more].concat());
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains("an estimate from") && text.contains(word), "{text}");
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.contains("groups.df: --error: found 1000: what is plotted may be off by all of it"), "{told}");
        let table = std::fs::read_to_string(folder.join("other.csv")).unwrap();
        let lines: Vec<&str> = table.lines().collect();
        assert!(lines[0].starts_with("# an estimate from"), "{table}");
        assert!(lines[1..].iter().all(|line| line.split(',').count() == columns), "{}", lines[1]);
        assert_eq!(lines[1].matches("error of").count(), if columns > 2 { 4 } else { 0 });
        let answer: Value = serde_json::from_slice(&std::fs::read(folder.join("other.json")).unwrap()).unwrap();
        let estimate = &answer["estimate"];
        assert!(estimate["pages_read"].as_u64() < estimate["pages"].as_u64() && estimate["errors"].is_array());
        assert_eq!(estimate["mean_errors"].is_array(), columns > 2);
    }
}
