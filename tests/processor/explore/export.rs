//! Exported tables, read back.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles};
use crate::support::parquet;
use deepfield::explore::{Data, Format, Frame, IdSet, Region, Work, export};
use deepfield::import::{FamilyRows, open};
use deepfield::model::FamilyName;
use glam::DVec3;
use std::path::Path;

fn region() -> Region {
    Region::sphere(DVec3::new(3.0, 95.0, 50.0), 35.0)
}

#[test]
fn rows_are_the_particles_to_the_last_bit() {
    let source = Memory::new(false);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.csv");
    assert_eq!(Format::of(&path), Some(Format::Csv));
    let done = export(Data::Source(&source), &region(), Format::Csv, &Frame::Stored, &path, Some(EDGE), Work::quiet())
        .unwrap();
    let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region(), p, true)).collect();
    assert_eq!((done.rows, done.exact), (members.len() as u64, true));
    assert_eq!(done.bytes, std::fs::metadata(&path).unwrap().len());
    let mut table = csv::Reader::from_path(&path).unwrap();
    let names = "family,id,x [kpc],y [kpc],z [kpc],vx [km/s],vy [km/s],vz [km/s],mass [Msun],smoothing-length [kpc],density,temperature [K]";
    assert_eq!(table.headers().unwrap().iter().collect::<Vec<_>>().join(","), names);
    for (row, member) in table.records().zip(&members) {
        let row = row.unwrap();
        assert_eq!(row[0], *member.family.as_str());
        assert_eq!(row[1].parse(), Ok(member.id));
        let (at, v) = (member.at, member.velocity);
        let numbers = [at.x, at.y, at.z, v.x, v.y, v.z, member.mass, member.h, member.density];
        for (text, number) in row.iter().skip(2).zip(numbers) {
            assert_eq!(text.parse(), Ok(number));
        }
        match member.family {
            FamilyName::Gas => assert_eq!(row[11].parse(), Ok(member.temperature)),
            _ => assert!(row[11].is_empty()),
        }
    }
    // What was written is a source like any other.
    let again = open(&path).unwrap();
    let rows = FamilyRows::new(again.as_ref(), 0).unwrap();
    assert_eq!(rows.info().count, members.len() as u64);
    assert_eq!(again.description().length_unit.0, "kpc");
    assert!(rows.has_masses());
}

#[test]
fn ids_select_rows_too() {
    let source = Memory::new(true);
    let wanted: Vec<&Particle> = particles().iter().step_by(700).collect();
    let ids = IdSet::new(wanted.iter().map(|p| p.id).collect());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("few.csv");
    let done = export(Data::Source(&source), &ids, Format::Csv, &Frame::Stored, &path, None, Work::quiet()).unwrap();
    assert_eq!(done.rows, wanted.len() as u64);
}

#[test]
fn page_files_export_what_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.csv");
    let done =
        export(Data::Pages(page_file()), &region(), Format::Csv, &Frame::Stored, &path, Some(EDGE), Work::quiet())
            .unwrap();
    assert!(!done.exact && !done.columns.contains(&"id".to_owned()));
    let mut table = csv::Reader::from_path(&path).unwrap();
    assert_eq!(table.headers().unwrap().len(), done.columns.len());
    assert_eq!(table.records().filter(Result::is_ok).count() as u64, done.rows);
}

#[test]
fn a_file_that_cannot_be_written_is_named_and_nothing_is_left() {
    let source = Memory::new(false);
    let out = Path::new("/nowhere/at/all.csv");
    let message = export(Data::Source(&source), &region(), Format::Csv, &Frame::Stored, out, None, Work::quiet())
        .unwrap_err()
        .to_string();
    assert!(message.starts_with("/nowhere/at/all.csv: writing"), "{message}");
}

/// The parts of a Parquet file that hold a column, by a reader of its own.
#[test]
fn parquet_is_read_back() {
    let source = Memory::new(false);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.parquet");
    assert_eq!(Format::of(&path), Some(Format::Parquet));
    let done =
        export(Data::Source(&source), &region(), Format::Parquet, &Frame::Stored, &path, Some(EDGE), Work::quiet())
            .unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let file = parquet::read(&bytes);
    let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region(), p, true)).collect();
    assert_eq!((file.rows, done.rows), (members.len() as i64, members.len() as u64));
    assert_eq!(file.names, done.columns);
    let column = |name: &str| &file.columns[file.names.iter().position(|other| other == name).unwrap()];
    let bits = |of: fn(&Particle) -> f64| members.iter().map(|p| Some(of(p).to_bits())).collect::<Vec<_>>();
    assert_eq!(column("x"), &bits(|p| p.at.x));
    assert_eq!(column("vz"), &bits(|p| p.velocity.z));
    assert_eq!(column("mass"), &bits(|p| p.mass));
    assert_eq!(column("id"), &members.iter().map(|p| Some(p.id)).collect::<Vec<_>>());
    let temperature = |p: &&Particle| (p.family == FamilyName::Gas).then(|| p.temperature.to_bits());
    assert_eq!(column("temperature"), &members.iter().map(temperature).collect::<Vec<_>>());
    assert!(file.about.contains(&("unit.x".to_owned(), "kpc".to_owned())));
}

#[test]
fn points_of_ply_are_read_back() {
    let source = Memory::new(false);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.ply");
    assert_eq!(Format::of(&path), Some(Format::Ply));
    let done = export(Data::Source(&source), &region(), Format::Ply, &Frame::Stored, &path, Some(EDGE), Work::quiet())
        .unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region(), p, true)).collect();
    assert!(
        header.starts_with("ply\nformat binary_little_endian 1.0\n") && header.contains("comment unit of x: kpc\n")
    );
    assert!(header.contains(&format!("element vertex {}\n", members.len())), "{header}");
    assert_eq!(done.rows, members.len() as u64);
    let properties: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property ")).collect();
    let expected = "uchar family,uint id_low,uint id_high,double x,double y,double z,double vx,double vy,double vz,double mass,\
                    double smoothing-length,double density,double temperature";
    assert_eq!(properties.join(","), expected);
    let width = 9 + 10 * 8;
    assert_eq!(bytes.len() - end, members.len() * width);
    for (row, member) in bytes[end..].chunks_exact(width).zip(&members) {
        assert_eq!(Some(row[0]), member.family.gadget_type());
        assert_eq!(u64::from_le_bytes(row[1..9].try_into().unwrap()), member.id);
        let number = |column: usize| f64::from_le_bytes(row[9 + 8 * column..][..8].try_into().unwrap());
        assert_eq!([number(0), number(5), number(8)], [member.at.x, member.velocity.z, member.density]);
        assert!(if member.family == FamilyName::Gas { number(9) == member.temperature } else { number(9).is_nan() });
    }
}
