//! Selections by id: exact, and the same particles in another snapshot.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles, region};
use deepfield::explore::{Data, IdSet, ProbeOptions, Region, Work, find_id, ids_of, probe};
use glam::DVec3;
use proptest::prelude::*;

proptest! {
    #![proptest_config(crate::cases::cases(48))]

    #[test]
    fn ids_are_those_of_the_members_and_find_them_again(region in region()) {
        let (source, later) = (Memory::new(false), Memory::new(true));
        let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region, p, true)).collect();
        let ids = ids_of(&source, &region, Some(EDGE), Work::quiet()).unwrap();
        prop_assert_eq!(&ids, &IdSet::new(members.iter().map(|p| p.id).collect()));
        prop_assert_eq!(ids.len(), members.len() as u64);
        let found = probe(Data::Source(&later), &ids, &ProbeOptions::default(), Work::quiet()).unwrap();
        prop_assert_eq!(found.count, members.len() as u64);
        let mass: f64 = members.iter().map(|p| p.mass).sum();
        prop_assert!((found.mass - mass).abs() <= 1e-9 * mass);
        prop_assert_eq!(ids_of(&later, &ids, None, Work::quiet()).unwrap(), ids);
    }
}

#[test]
fn one_id_finds_its_row() {
    let source = Memory::new(true);
    let wanted = &particles()[17];
    assert!(wanted.id > 1 << 53);
    let found = find_id(&source, wanted.id, Work::quiet()).unwrap().unwrap();
    assert_eq!((found.id, found.family), (Some(wanted.id), wanted.family));
    assert_eq!(DVec3::from_array(found.position), wanted.at);
    assert_eq!(find_id(&source, 1, Work::quiet()).unwrap(), None);
}

#[test]
fn page_files_have_no_ids() {
    let ids = IdSet::new(vec![1]);
    let message =
        probe(Data::Pages(page_file()), &ids, &ProbeOptions::default(), Work::quiet()).unwrap_err().to_string();
    assert!(message.contains("ids") && message.contains("particles.df"), "{message}");
    assert!(Region::whole().is_whole());
}
