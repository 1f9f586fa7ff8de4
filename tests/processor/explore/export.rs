//! Exported tables, read back.

use super::particles::{EDGE, Memory, Particle, is_inside, page_file, particles};
use crate::support::in_repository;
use deepfield::explore::{Data, Format, Frame, IdSet, Region, Work, export};
use deepfield::import::{Description, FamilyRows, FieldKind, Source, open};
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
    // Components are attributes of a page file, and vectors again in formats that have these.
    let path = folder.path().join("halo.hdf5");
    let (data, region) = (Data::Pages(page_file()), region());
    let again = export(data, &region, Format::Gadget, &Frame::Stored, &path, Some(EDGE), Work::quiet()).unwrap();
    let read = open(&path).unwrap();
    assert_eq!((read.description().particles(), again.rows), (done.rows, done.rows));
    assert!(read.description().families.iter().all(|info| info.find(FieldKind::Velocity).is_some()));
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
    assert_units(open(&path).unwrap().description(), "halo.ply");
}

/// Units of lengths, masses and velocities are those of the source.
fn assert_units(about: &Description, name: &str) {
    let velocity = &about.families[0].fields[about.families[0].find(FieldKind::Velocity).unwrap()].unit.0;
    assert_eq!((&*about.length_unit.0, &*about.mass_unit.0, &**velocity), ("kpc", "Msun", "km/s"), "{name}");
}

/// All numbers of a field of a family, bit for bit.
fn bits_of(source: &dyn Source, family: usize, name: &str) -> Vec<u64> {
    let info = &source.description().families[family];
    let field = info.named(name).unwrap_or_else(|| panic!("{name} of {}: {:?}", info.name, info.fields));
    let mut values = vec![0.0; info.count as usize * info.fields[field].components];
    source.read(family, field, 0..info.count, &mut values).unwrap();
    values.into_iter().map(f64::to_bits).collect()
}

/// All ids of a family.
fn ids_of(source: &dyn Source, family: usize) -> Option<Vec<u64>> {
    let info = &source.description().families[family];
    let mut ids = vec![0; info.count as usize];
    source.read_ids(family, info.find(FieldKind::Id)?, 0..info.count, &mut ids).unwrap();
    Some(ids)
}

#[test]
fn tables_for_other_programs_are_read_back_to_the_last_bit() {
    let source = Memory::new(false);
    let folder = tempfile::tempdir().unwrap();
    let members: Vec<&Particle> = particles().iter().filter(|p| is_inside(&region(), p, true)).collect();
    for (name, format) in [
        ("halo.fits", Format::Fits),
        ("halo.vtp", Format::Vtp),
        ("halo.hdf5", Format::Gadget),
        ("halo.parquet", Format::Parquet),
    ] {
        let path = folder.path().join(name);
        assert_eq!(Format::of(&path), Some(format));
        let done =
            export(Data::Source(&source), &region(), format, &Frame::Stored, &path, Some(EDGE), Work::quiet()).unwrap();
        assert_eq!((done.rows, done.bytes), (members.len() as u64, std::fs::metadata(&path).unwrap().len()));
        let again = open(&path).unwrap();
        // One of them keeps families apart.
        let families: Vec<Vec<&Particle>> = match format {
            Format::Gadget => [FamilyName::Gas, FamilyName::Dark]
                .map(|name| members.iter().copied().filter(|p| p.family == name).collect::<Vec<&Particle>>())
                .to_vec(),
            _ => vec![members.clone()],
        };
        let about = again.description();
        assert_eq!(about.families.len(), families.len());
        for (family, own) in families.iter().enumerate() {
            let vectors = |of: fn(&Particle) -> DVec3| -> Vec<u64> {
                own.iter().flat_map(|p| of(p).to_array()).map(f64::to_bits).collect()
            };
            let numbers = |of: fn(&Particle) -> f64| -> Vec<u64> { own.iter().map(|p| of(p).to_bits()).collect() };
            let found = |name: &str| bits_of(&*again, family, name);
            assert!(found("position") == vectors(|p| p.at) && found("velocity") == vectors(|p| p.velocity), "{name}");
            assert!(found("mass") == numbers(|p| p.mass) && found("smoothing-length") == numbers(|p| p.h), "{name}");
            assert!(found("density") == numbers(|p| p.density), "{name}");
            assert_eq!(ids_of(&*again, family), Some(own.iter().map(|p| p.id).collect()), "{name}");
            match (format, own[0].family) {
                (Format::Gadget, FamilyName::Dark) => assert!(about.families[family].named("temperature").is_none()),
                _ => {
                    let expected = numbers(|p| if p.family == FamilyName::Gas { p.temperature } else { f64::NAN });
                    assert!(found("temperature") == expected, "{name}");
                }
            }
        }
        if format == Format::Parquet {
            let bytes = std::fs::read(&path).unwrap();
            let exact = b"deepfield.exact\x18\x04true";
            assert!(bytes.windows(exact.len()).any(|part| part == exact), "the table does not say that it is exact");
        }
        assert_units(about, name);
    }
}

/// Snapshots of several codes say the same when they have been written in Gadget's layout.
#[test]
fn snapshots_stay_what_they_are_in_gadgets_layout() {
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "arepo.0.hdf5",
        "comoving_gadget4.hdf5",
        "comoving_swift.hdf5",
        "eagle.hdf5",
        "gas_sphere_collapse_025.hdf5",
        "gizmo.hdf5",
        "swift.hdf5",
    ] {
        let source = open(&in_repository("tests/data").join(name)).unwrap();
        let out = folder.path().join(name);
        let (data, all) = (Data::Source(&*source), Region::whole());
        let done = export(data, &all, Format::Gadget, &Frame::Stored, &out, None, Work::quiet()).unwrap();
        let again = open(&out).unwrap();
        let (about, found) = (source.description(), again.description());
        assert_eq!(done.rows, about.particles());
        assert_eq!(found.format, "gadget-hdf5");
        assert_eq!((about.scale_factor, about.motion), (found.scale_factor, found.motion), "{name}");
        assert_eq!(about.box_size, found.box_size, "{name}");
        assert_eq!((&about.length_unit, &about.mass_unit), (&found.length_unit, &found.mass_unit), "{name}");
        if let Some(redshift) = about.redshift {
            assert_eq!(found.redshift, Some(redshift), "{name}");
        }
        match (about.cosmology, found.cosmology) {
            (Some(own), Some(other)) => {
                assert!((other.hubble / own.hubble - 1.0).abs() < 1e-9, "{name}: {other:?} of {own:?}");
                assert_eq!((own.omega_matter, own.omega_lambda), (other.omega_matter, other.omega_lambda), "{name}");
                assert_eq!(own.hubble_assumed, other.hubble_assumed, "{name}");
            }
            pair => assert_eq!(pair, (None, None), "{name}"),
        }
        assert_eq!(about.families.len(), found.families.len());
        for (family, (own, other)) in about.families.iter().zip(&found.families).enumerate() {
            assert_eq!((own.name, own.count), (other.name, other.count));
            for field in &own.fields {
                let index =
                    other.named(&field.name).unwrap_or_else(|| panic!("{name}: {} of {}", field.name, own.name));
                assert_eq!((&other.fields[index].unit, other.fields[index].kind), (&field.unit, field.kind), "{name}");
                let is_same = field.kind == FieldKind::Id
                    || bits_of(&*source, family, &field.name) == bits_of(&*again, family, &field.name);
                assert!(is_same, "{name}: {} of {}", field.name, own.name);
            }
            assert_eq!(ids_of(&*source, family), ids_of(&*again, family), "{name}");
        }
        // FITS keeps units, too, though it means something else by `a` and `h`.
        let out = out.with_extension("fits");
        export(data, &all, Format::Fits, &Frame::Stored, &out, None, Work::quiet()).unwrap();
        let table = open(&out).unwrap();
        let found = table.description();
        assert_eq!((found.particles(), &found.length_unit), (about.particles(), &about.length_unit), "{name}");
        assert_eq!(found.mass_unit, about.mass_unit, "{name}");
    }
}
