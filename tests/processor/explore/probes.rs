//! Probes against sums over all particles.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles, region};
use deepfield::explore::{
    Data, ExploreError, Fields, Probe, ProbeOptions, ProfileOptions, Region, Work, center, ids_of, probe,
};
use deepfield::model::{FamilyName, Progress};
use glam::DVec3;
use proptest::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

fn options(periodic: bool) -> ProbeOptions {
    ProbeOptions { periodic: periodic.then_some(EDGE), ..ProbeOptions::default() }
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * a.abs().max(b.abs()) + 1e-12
}

/// Mean and dispersion, plain and weighted with mass.
fn moments(own: &[&Particle], of: impl Fn(&Particle) -> f64) -> [f64; 4] {
    let n = own.len() as f64;
    let mass: f64 = own.iter().map(|p| p.mass).sum();
    let mean = own.iter().map(|p| of(p)).sum::<f64>() / n;
    let weighted = own.iter().map(|p| p.mass * of(p)).sum::<f64>() / mass;
    let spread = (own.iter().map(|p| (of(p) - mean).powi(2)).sum::<f64>() / n).sqrt();
    let weighted_spread = (own.iter().map(|p| p.mass * (of(p) - weighted).powi(2)).sum::<f64>() / mass).sqrt();
    [mean, spread, weighted, weighted_spread]
}

/// Holds a probe of the source against brute force.
fn check_exact(found: &Probe, members: &[&Particle]) {
    assert_eq!(found.count, members.len() as u64);
    assert!(close(found.mass, members.iter().map(|p| p.mass).sum(), 1e-12));
    for family in &found.families {
        let own: Vec<&Particle> = members.iter().filter(|p| p.family == family.name).copied().collect();
        assert_eq!(family.count, own.len() as u64);
        assert!(family.uncertain.is_none());
        for field in &family.fields {
            let of = |p: &Particle| match field.name.as_str() {
                "mass" => p.mass,
                "density" => p.density,
                "smoothing-length" => p.h,
                "temperature" => p.temperature,
                "speed" => p.velocity.length(),
                other => panic!("{other}"),
            };
            let expected = moments(&own, of);
            let stated = [field.mean, field.dispersion, field.mass_weighted_mean, field.mass_weighted_dispersion];
            for (stated, expected) in stated.into_iter().zip(expected) {
                assert!(close(stated.unwrap(), expected, 1e-9), "{}: {stated:?} {expected}", field.name);
            }
            assert_eq!(field.min, own.iter().map(|p| of(p)).reduce(f64::min), "{}", field.name);
            assert_eq!(field.max, own.iter().map(|p| of(p)).reduce(f64::max), "{}", field.name);
            assert_eq!((field.count, field.error), (own.len() as u64, None));
        }
        let velocity = family.velocity.unwrap();
        for axis in 0..3 {
            let [_, _, mean, dispersion] = moments(&own, |p| p.velocity[axis]);
            assert!(close(velocity.mean[axis], mean, 1e-9) && close(velocity.dispersion[axis], dispersion, 1e-9));
        }
    }
}

proptest! {
    #![proptest_config(crate::cases::cases(96))]

    #[test]
    fn a_probe_of_the_source_sums_up_every_particle(region in region(), periodic: bool) {
        let source = Memory::new(false);
        let found = probe(Data::Source(&source), &region, &options(periodic), Work::quiet()).unwrap();
        let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region, p, periodic)).collect();
        check_exact(&found, &members);
    }

    /// The page file's answer differs by no more than it says that it may.
    #[test]
    fn a_probe_of_the_page_file_is_within_its_stated_error(region in region(), periodic: bool) {
        let found = probe(Data::Pages(page_file()), &region, &options(periodic), Work::quiet()).unwrap();
        let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region, p, periodic)).collect();
        let mut told = 0;
        for family in &found.families {
            let own: Vec<&Particle> = members.iter().filter(|p| p.family == family.name).copied().collect();
            let uncertain = family.uncertain.unwrap();
            told += own.len();
            prop_assert!(family.count.abs_diff(own.len() as u64) <= uncertain.count, "{} {} {:?}", family.count, own.len(), uncertain);
            let mass_error = family.fields.iter().find(|field| field.name == "mass").unwrap().error.unwrap().max;
            let mass: f64 = own.iter().map(|p| p.mass).sum();
            let allowed = 2.0 * uncertain.mass + (mass_error + 1e-3) * mass.max(family.mass) + 1e-9;
            prop_assert!((family.mass - mass).abs() <= allowed, "{} {}", family.mass, mass);
            if uncertain.count > 0 || own.is_empty() {
                continue;
            }
            let temperature = family.fields.iter().find(|field| field.name == "temperature");
            let fields = [("smoothing-length", moments(&own, |p| p.h)), ("density", moments(&own, |p| p.density))];
            let gas = temperature.map(|_| ("temperature", moments(&own, |p| p.temperature)));
            for (name, [mean, ..]) in fields.into_iter().chain(gas) {
                let field = family.fields.iter().find(|field| field.name == name).unwrap();
                let error = field.error.unwrap();
                prop_assert!(error.of_range.is_none());
                prop_assert!(close(field.mean.unwrap(), mean, error.max + 1e-6), "{}: {:?} {}", name, field, mean);
            }
            let (velocity, error) = (family.velocity.unwrap(), |axis: &str| {
                let error = family.fields.iter().find(|field| field.name == axis).unwrap().error.unwrap();
                error.max * error.of_range.unwrap()
            });
            for (axis, name) in ["velocity-x", "velocity-y", "velocity-z"].into_iter().enumerate() {
                let [_, _, mean, _] = moments(&own, |p| p.velocity[axis]);
                // The weights are coded as well.
                prop_assert!((velocity.mean[axis] - mean).abs() <= error(name) + 400.0 * 2.0 * mass_error + 1e-3);
            }
        }
        // Families that are not told of have nothing in the region.
        prop_assert_eq!(told, members.len());
    }

    #[test]
    fn shells_hold_what_lies_in_them(
        center in prop::array::uniform3(0.0..EDGE),
        radius in 5.0..45.0_f64,
        inner in prop::option::of(0.01..0.5_f64),
        shells in 1..12_usize,
    ) {
        let center = DVec3::from_array(center);
        let profile = ProfileOptions { shells, inner, field: Some("temperature".into()) };
        let asked = ProbeOptions { profile: Some(profile), fields: Fields::Named(vec!["mass".into()]), ..options(true) };
        let source = Memory::new(false);
        let region = Region::sphere(center, radius);
        let found = probe(Data::Source(&source), &region, &asked, Work::quiet()).unwrap();
        let profile = found.profile.unwrap();
        prop_assert_eq!(profile.shells.len(), shells);
        prop_assert!(close(profile.shells[shells - 1].to, radius, 1e-12) && profile.shells[0].from == 0.0);
        let distance = |p: &Particle| {
            let offset = p.at - center;
            (offset - EDGE * (offset / EDGE).round()).length()
        };
        let mut volume = 0.0;
        for shell in &profile.shells {
            let own: Vec<&Particle> =
                particles().iter().filter(|p| distance(p) > shell.from && distance(p) <= shell.to).collect();
            prop_assert!(shell.count.abs_diff(own.len() as u64) <= 1, "{:?}", shell);
            if shell.count == own.len() as u64 {
                prop_assert!(close(shell.mass, own.iter().map(|p| p.mass).sum(), 1e-12));
                let gas: Vec<&Particle> = own.into_iter().filter(|p| p.family == FamilyName::Gas).collect();
                if gas.is_empty() {
                    prop_assert_eq!(shell.mean, None);
                } else {
                    let [mean, dispersion, weighted, _] = moments(&gas, |p| p.temperature);
                    prop_assert!(close(shell.mean.unwrap(), mean, 1e-9));
                    prop_assert!(close(shell.dispersion.unwrap(), dispersion, 1e-6));
                    prop_assert!(close(shell.mass_weighted_mean.unwrap(), weighted, 1e-9));
                }
            }
            volume += shell.mass / shell.density.max(f64::MIN_POSITIVE);
        }
        prop_assert_eq!(profile.shells.iter().map(|shell| shell.count).sum::<u64>(), found.count);
        prop_assert!(volume <= 4.2 * radius.powi(3));
    }
}

#[test]
fn the_whole_is_what_the_footer_says() {
    let file = page_file();
    let data = Data::Pages(file);
    assert_eq!(data.periodic_edge().unwrap(), Some(EDGE));
    for fields in [Fields::None, Fields::All] {
        let asked = ProbeOptions { fields: fields.clone(), ..ProbeOptions::default() };
        let found = probe(data, &Region::whole(), &asked, Work::quiet()).unwrap();
        assert_eq!(found.count, file.metadata().particles());
        for (family, stated) in found.families.iter().zip(&file.metadata().families) {
            assert_eq!(family.count, stated.count);
            let tolerance = if fields == Fields::None { 0.0 } else { 1e-6 };
            assert!((family.mass - stated.mass).abs() <= tolerance * stated.mass, "{} {}", family.mass, stated.mass);
            assert_eq!(family.uncertain.unwrap().count, 0);
            assert_eq!(family.center_of_mass.is_some(), fields == Fields::All);
        }
    }
}

/// Count and mass alone are taken from whole nodes, and are the same as those of their particles.
#[test]
fn whole_nodes_count_as_their_particles() {
    let data = Data::Pages(page_file());
    let region = Region::sphere(DVec3::new(95.0, 50.0, 3.0), 30.0);
    let sums = ProbeOptions { fields: Fields::None, ..options(true) };
    let (sums, all) = (probe(data, &region, &sums, Work::quiet()), probe(data, &region, &options(true), Work::quiet()));
    let (sums, all) = (sums.unwrap(), all.unwrap());
    assert_eq!(sums.count, all.count);
    assert!(close(sums.mass, all.mass, 1e-6), "{} {}", sums.mass, all.mass);
    assert_eq!(sums.families[0].uncertain.unwrap().count, all.families[0].uncertain.unwrap().count);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let region = Region::sphere(DVec3::splat(50.0), 40.0).with_range("temperature", Some(1e4), None);
    let source = Memory::new(false);
    let asked = ProbeOptions { profile: Some(ProfileOptions::logarithmic(7)), ..options(true) };
    for data in [Data::Source(&source), Data::Pages(page_file())] {
        let answers = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| probe(data, &region, &asked, Work::quiet()).unwrap())
        });
        assert_eq!(answers[0], answers[1]);
    }
}

#[derive(Default)]
struct Counted {
    total: AtomicU64,
    done: AtomicU64,
}

impl Progress for Counted {
    fn begin(&self, _: &str, total: u64) {
        self.total.store(total, Ordering::Relaxed);
    }

    fn advance(&self, n: u64) {
        self.done.fetch_add(n, Ordering::Relaxed);
    }
}

#[test]
fn progress_is_told_and_work_can_be_stopped() {
    let source = Memory::new(false);
    for data in [Data::Source(&source), Data::Pages(page_file())] {
        let (counted, stop) = (Counted::default(), AtomicBool::new(false));
        let region = Region::sphere(DVec3::splat(20.0), 5.0);
        probe(data, &region, &options(false), Work { progress: &counted, stop: &stop }).unwrap();
        let [total, done] = [&counted.total, &counted.done].map(|n| n.load(Ordering::Relaxed));
        assert_eq!((total, done), (particles().len() as u64, particles().len() as u64));
        stop.store(true, Ordering::Relaxed);
        let stopped = probe(data, &region, &options(false), Work { progress: &counted, stop: &stop });
        assert!(matches!(stopped, Err(ExploreError::Stopped)));
    }
}

#[test]
fn what_is_not_there_is_named() {
    let source = Memory::new(false);
    for data in [Data::Source(&source), Data::Pages(page_file())] {
        let ask = |region: &Region, fields: Fields, profile| {
            let asked = ProbeOptions { fields, profile, periodic: None };
            probe(data, region, &asked, Work::quiet()).unwrap_err().to_string()
        };
        let whole = Region::whole();
        for (message, parts) in [
            (ask(&whole.clone().with_range("entropy", None, None), Fields::All, None), ["entropy", "temperature"]),
            (ask(&whole, Fields::Named(vec!["colour".into()]), None), ["colour", "density"]),
            (ask(&whole.clone().with_family(FamilyName::Stars), Fields::All, None), ["stars", "gas, dark"]),
            (ask(&whole, Fields::All, Some(ProfileOptions::logarithmic(3))), ["profile", "sphere"]),
            (ask(&Region::sphere(DVec3::ZERO, -1.0), Fields::All, None), ["shapes[0].radius", "-1"]),
        ] {
            assert!(parts.iter().all(|part| message.contains(part)), "{message}");
        }
    }
}

/// Particles known by their ids are where those of their region are, across the faces of the box too.
#[test]
fn ids_across_the_faces_have_the_centre_of_their_region() {
    let source = Memory::new(true);
    let data = Data::Source(&source);
    let options = ProbeOptions { periodic: Some(EDGE), ..ProbeOptions::default() };
    for at in [DVec3::new(0.5, 99.0, 50.0), DVec3::new(50.0, 0.0, 0.0), DVec3::splat(30.0)] {
        let region = Region::sphere(at, 18.0);
        let ids = ids_of(&source, &region, Some(EDGE), Work::quiet()).unwrap();
        let by_region = probe(data, &region, &options, Work::quiet()).unwrap();
        let by_id = probe(data, &ids, &options, Work::quiet()).unwrap();
        assert_eq!((by_id.count, by_id.count), (by_region.count, ids.len()));
        let [a, b] = [&by_region, &by_id].map(|probe| DVec3::from(probe.center_of_mass.unwrap()));
        assert!((a - b).abs().max_element() < 1e-9 * EDGE, "{a} {b}");
        let found = center(data, &ids, Some(EDGE), Work::quiet()).unwrap().unwrap();
        assert!((found.position - a).abs().max_element() < 1e-9 * EDGE && found.count == ids.len());
    }
}
