//! Rows in memory are those of a table.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles};
use deepfield::explore::{Data, ExploreError, IdSet, Region, Rows, Work, rows};
use deepfield::model::FamilyName;
use glam::DVec3;

fn region() -> Region {
    Region::sphere(DVec3::new(3.0, 95.0, 50.0), 35.0)
}

fn read(data: Data, fields: Option<&[&str]>, memory: u64) -> Result<Rows, ExploreError> {
    let fields: Option<Vec<String>> = fields.map(|fields| fields.iter().map(|field| (*field).to_owned()).collect());
    rows(data, &region(), fields.as_deref(), memory, Some(EDGE), Work::quiet())
}

fn column<'a>(rows: &'a Rows, name: &str) -> &'a [f64] {
    let found = rows.columns.iter().find(|column| column.name == name);
    &found.unwrap_or_else(|| panic!("{name}: {:?}", rows.columns)).values
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn rows_are_the_particles_and_some_fields_are_a_part_of_all() {
    let source = Memory::new(false);
    let whole = read(Data::Source(&source), None, u64::MAX).unwrap();
    let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region(), p, true)).collect();
    assert_eq!(whole.ids.as_deref(), Some(&members.iter().map(|p| p.id).collect::<Vec<_>>()[..]));
    for (row, member) in members.iter().enumerate() {
        assert_eq!(whole.families[usize::from(whole.family[row])], member.family);
        assert_eq!([column(&whole, "x")[row], column(&whole, "vz")[row]], [member.at.x, member.velocity.z]);
        let temperature = column(&whole, "temperature")[row];
        let is_gas = member.family == FamilyName::Gas;
        assert!(if is_gas { temperature == member.temperature } else { temperature.is_nan() });
    }
    assert_eq!(whole.columns.iter().find(|column| column.name == "vx").unwrap().unit.0, "km/s");
    let some = read(Data::Source(&source), Some(&["temperature", "position", "vy", "vy"]), u64::MAX).unwrap();
    let names: Vec<&str> = some.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!((names, &some.ids, &some.family), (vec!["temperature", "x", "y", "z", "vy"], &None, &whole.family));
    for own in &some.columns {
        assert_eq!(bits(&own.values), bits(column(&whole, &own.name)), "{}", own.name);
    }
    let ids = read(Data::Source(&source), Some(&["id"]), u64::MAX).unwrap();
    assert_eq!((&ids.ids, ids.columns.len()), (&whole.ids, 0));
}

#[test]
fn ids_name_rows() {
    let source = Memory::new(true);
    let wanted: Vec<u64> = particles().iter().step_by(700).map(|p| p.id).collect();
    let found = rows(Data::Source(&source), &IdSet::new(wanted.clone()), None, u64::MAX, None, Work::quiet()).unwrap();
    let mut ids = found.ids.unwrap();
    ids.sort_unstable();
    let mut wanted = wanted;
    wanted.sort_unstable();
    assert_eq!(ids, wanted);
}

#[test]
fn some_fields_of_a_page_file_are_a_part_of_all() {
    let whole = read(Data::Pages(page_file()), None, u64::MAX).unwrap();
    assert!(!whole.exact && whole.ids.is_none() && !whole.family.is_empty());
    let some = read(Data::Pages(page_file()), Some(&["temperature", "z", "mass"]), u64::MAX).unwrap();
    assert_eq!(some.columns.len(), 3);
    for own in &some.columns {
        assert_eq!(bits(&own.values), bits(column(&whole, &own.name)), "{}", own.name);
    }
}

#[test]
fn too_many_rows_and_fields_that_are_not_there_are_refused() {
    let source = Memory::new(false);
    let of = |fields: Option<&[&str]>, memory| read(Data::Source(&source), fields, memory).unwrap_err().to_string();
    let message = of(None, 1000);
    assert!(message.contains("expected at most 1000 bytes") && !message.contains('\n'), "{message}");
    let message = of(Some(&["temperatur"]), u64::MAX);
    assert!(message.contains("field temperatur") && message.contains("one of id, x, y"), "{message}");
}
