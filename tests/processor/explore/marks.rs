//! Marks of particles for renderers, histograms and samples.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles, region};
use deepfield::explore::{
    AxisOptions, Data, Effort, Highlighter, IdSet, Marked, PageParticle, Places, Region, Work, histogram, identify,
    scatter,
};
use deepfield::import::Source;
use deepfield::model::FamilyName;
use deepfield::store::{Encoding, PageId};
use glam::DVec3;
use proptest::prelude::*;

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    /// Bits say of each drawn particle, merged or not, whether its place and values are in the region.
    #[test]
    fn marks_are_membership(region in region(), periodic: bool) {
        let file = page_file();
        let metadata = file.metadata();
        let marks = Highlighter::new(&region, metadata, periodic.then_some(EDGE)).unwrap();
        let mut bits = vec![u64::MAX; 3];
        for id in 0..file.page_count() {
            let page = file.read_page(PageId(id)).unwrap();
            let family = &metadata.families[page.family as usize];
            for (index, node) in page.nodes.iter().enumerate() {
                let marked = marks.mark(&page, index, 0.0, &mut bits);
                let held = page.particles(index);
                let mut count = 0;
                for i in 0..held.len() {
                    let code = usize::from(held.codes[i]);
                    let codebook = &family.codebooks[usize::from(node.codebook)];
                    let gas = family.name == FamilyName::Gas;
                    let drawn = Particle {
                        family: family.name,
                        at: node.frame.position(held.fraction(i)),
                        mass: codebook.mass[code].into(),
                        h: codebook.smoothing_length[code].into(),
                        density: codebook.density[code].into(),
                        temperature: if gas { codebook.attributes[0][code].into() } else { 0.0 },
                        ..particles()[0]
                    };
                    let own = match marked {
                        Marked::None => false,
                        Marked::All => true,
                        Marked::Some(_) => bits[i / 64] >> (i % 64) & 1 == 1,
                    };
                    count += u32::from(own);
                    prop_assert_eq!(own, is_inside(&region, &drawn, periodic));
                }
                let expected = match count {
                    0 => Marked::None,
                    all if all == node.particles => Marked::All,
                    some => Marked::Some(some),
                };
                prop_assert_eq!(marked, expected);
                if let Marked::Some(_) = marked {
                    prop_assert_eq!(bits.len(), held.len().div_ceil(64));
                    prop_assert_eq!(bits.iter().map(|word| word.count_ones()).sum::<u32>(), count);
                }
            }
        }
    }

    #[test]
    fn histograms_count_what_is_in_their_bins(region in region(), bins in 1..40_usize) {
        let source = Memory::new(false);
        let data = Data::Source(&source);
        let axes = [AxisOptions::new("temperature", bins), AxisOptions { logarithmic: Some(false), ..AxisOptions::new("mass", 3) }];
        let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region, p, true)).collect();
        let gas: Vec<&&Particle> = members.iter().filter(|p| p.family == FamilyName::Gas).collect();
        let one = histogram(data, &region, &axes[..1], Some(EDGE), Work::quiet()).unwrap();
        let two = histogram(data, &region, &axes, Some(EDGE), Work::quiet()).unwrap();
        for found in [&one, &two] {
            prop_assert_eq!(found.counts.iter().sum::<u64>(), gas.len() as u64);
            prop_assert_eq!(found.missing, (members.len() - gas.len()) as u64);
            prop_assert_eq!(found.outside, 0);
            let mass: f64 = gas.iter().map(|p| p.mass).sum();
            prop_assert!((found.masses.iter().sum::<f64>() - mass).abs() <= 1e-9 * mass);
        }
        let axis = &one.axes[0];
        for (bin, count) in one.counts.iter().enumerate() {
            let (from, to) = (axis.edge(bin), axis.edge(bin + 1));
            let hair = 1e-9 * to;
            let inside = |slack: f64| {
                gas.iter().filter(|p| p.temperature >= from - slack && p.temperature < to + slack).count() as u64
            };
            let last = bin + 1 == bins;
            prop_assert!(inside(-hair) <= *count && *count <= inside(hair) + u64::from(last));
        }
        // Rows of the joint histogram add up to the histogram of the first field.
        let columns: Vec<u64> = (0..bins).map(|x| (0..3).map(|y| two.counts[y * bins + x]).sum()).collect();
        prop_assert_eq!(columns, one.counts);
    }
}

#[test]
fn samples_are_of_the_selection_and_the_same_every_time() {
    let source = Memory::new(false);
    let region = Region::sphere(DVec3::splat(50.0), 45.0);
    for data in [Data::Source(&source), Data::Pages(page_file())] {
        let ask = |most| {
            scatter(data, &region, ["temperature", "smoothing-length"], most, Effort::ALL, None, Work::quiet()).unwrap()
        };
        let (few, again, all) = (ask(200), ask(200), ask(100_000));
        assert_eq!((few.x.len(), few.y.len()), (200, 200));
        assert_eq!(few, again);
        assert_eq!((all.x.len() as u64, all.of), (few.of, few.of));
        // A larger sample begins with the smaller one.
        assert_eq!((&all.x[..200], &all.y[..200]), (&few.x[..], &few.y[..]));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        assert!((mean(&few.y) / mean(&all.y) - 1.0).abs() < 0.15);
    }
}

/// Selections by id are shown by the places that the source knows: every leaf marks the selected particles, and hardly any other.
#[test]
fn places_of_ids_are_marked_in_leaves_and_merged_nodes() {
    let file = page_file();
    let source = Memory::new(true);
    let wanted: Vec<&Particle> =
        particles().iter().filter(|p| p.at.distance(DVec3::splat(40.0)) < 30.0).step_by(3).collect();
    let ids = IdSet::new(wanted.iter().map(|p| p.id).collect());
    let places = Places::of(&source, &ids, None, Work::quiet()).unwrap();
    assert_eq!(places.len(), wanted.len());
    let marks = Highlighter::of_places(&places, file.metadata());
    let (mut bits, mut leaves, mut merged) = (Vec::new(), 0, 0);
    for id in 0..file.page_count() {
        let page = file.read_page(PageId(id)).unwrap();
        let family = &file.metadata().families[page.family as usize];
        for (index, node) in page.nodes.iter().enumerate() {
            let marked = marks.mark(&page, index, 0.0, &mut bits);
            let held = page.particles(index);
            for i in 0..held.len() {
                let is_marked = match marked {
                    Marked::None => false,
                    Marked::All => true,
                    Marked::Some(_) => bits[i / 64] >> (i % 64) & 1 == 1,
                };
                if !is_marked {
                    continue;
                }
                let at = node.frame.position(held.fraction(i));
                let size = node.frame.size;
                let reach = if node.is_leaf() { held.rounding(i) } else { 1.0 / 256.0 } * size * 1.001;
                let near = |p: &&&Particle| p.family == family.name && (p.at - at).abs().max_element() <= reach;
                assert!(wanted.iter().any(|p| near(&p)), "{at}");
                if node.is_leaf() { leaves += 1 } else { merged += 1 }
            }
        }
    }
    assert!((wanted.len()..wanted.len() + 3).contains(&leaves), "{leaves} of {}", wanted.len());
    assert!(merged > 0);
}

/// What is picked in the page file is found in the source, at full precision and with its id.
#[test]
fn picked_particles_are_identified() {
    let file = page_file();
    let source = Memory::new(false);
    let mut checked = 0;
    for id in (0..file.page_count()).rev() {
        let page = file.read_page(PageId(id)).unwrap();
        for (index, node) in page.nodes.iter().enumerate() {
            if node.encoding != Encoding::Leaf {
                let merged = PageParticle::of(file.metadata(), &page, index, 0);
                assert!(merged.is_none_or(|merged| merged.merged));
                continue;
            }
            if index % 5 != 0 || node.particles == 0 {
                continue;
            }
            let picked = PageParticle::of(file.metadata(), &page, index, node.particles as usize / 2).unwrap();
            let at = DVec3::from_array(picked.position);
            let found = identify(&source, picked.family, at, picked.reach, Work::quiet()).unwrap().unwrap();
            let own = particles().iter().filter(|p| p.family == picked.family);
            let nearest = own.min_by(|a, b| a.at.distance(at).total_cmp(&b.at.distance(at))).unwrap();
            assert_eq!((found.id, found.family), (Some(nearest.id), nearest.family));
            assert_eq!(DVec3::from_array(found.position), nearest.at);
            assert!(found.candidates >= 1 && found.distance <= 2.0 * picked.reach);
            let value = |name: &str| found.fields.iter().find(|field| field.name == name).unwrap().values.clone();
            assert_eq!(value("velocity"), nearest.velocity.to_array());
            assert_eq!(value("mass"), [nearest.mass]);
            let coded = picked.fields.iter().find(|field| field.0 == "mass").unwrap().2;
            // Masses are from 1 to 1.5, and a code's is a mean of some.
            assert!((coded / nearest.mass - 1.0).abs() <= 0.5);
            checked += 1;
        }
    }
    assert!(checked > 20, "{checked}");
    let nowhere = identify(&source, FamilyName::Gas, DVec3::splat(-7.0), 0.1, Work::quiet()).unwrap();
    assert_eq!(nowhere, None);
    assert!(source.description().families.len() == 2);
}
