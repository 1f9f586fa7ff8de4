//! Exported tables, read back.

use crate::support::{EDGE, Memory, Particle, is_inside, page_file, particles};
use deepfield::explore::{Data, Format, IdSet, Region, Work, export};
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
    let done = export(Data::Source(&source), &region(), Format::Csv, &path, Some(EDGE), Work::quiet()).unwrap();
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
    let done = export(Data::Source(&source), &ids, Format::Csv, &path, None, Work::quiet()).unwrap();
    assert_eq!(done.rows, wanted.len() as u64);
}

#[test]
fn page_files_export_what_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.csv");
    let done = export(Data::Pages(page_file()), &region(), Format::Csv, &path, Some(EDGE), Work::quiet()).unwrap();
    assert!(!done.exact && !done.columns.contains(&"id".to_owned()));
    let mut table = csv::Reader::from_path(&path).unwrap();
    assert_eq!(table.headers().unwrap().len(), done.columns.len());
    assert_eq!(table.records().filter(Result::is_ok).count() as u64, done.rows);
}

#[test]
fn a_file_that_cannot_be_written_is_named_and_nothing_is_left() {
    let source = Memory::new(false);
    let out = Path::new("/nowhere/at/all.csv");
    let message =
        export(Data::Source(&source), &region(), Format::Csv, out, None, Work::quiet()).unwrap_err().to_string();
    assert!(message.starts_with("/nowhere/at/all.csv: writing"), "{message}");
}

/// The parts of a Parquet file that hold a column, by a reader of its own.
#[test]
fn parquet_is_read_back() {
    let source = Memory::new(false);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("halo.parquet");
    assert_eq!(Format::of(&path), Some(Format::Parquet));
    let done = export(Data::Source(&source), &region(), Format::Parquet, &path, Some(EDGE), Work::quiet()).unwrap();
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

/// As much of a Parquet reader as these files need.
mod parquet {
    use flate2::read::GzDecoder;
    use std::collections::HashMap;
    use std::io::Read;

    pub struct Contents {
        pub rows: i64,
        pub names: Vec<String>,
        /// The 64 bits of each value; `None` where there is none.
        pub columns: Vec<Vec<Option<u64>>>,
        pub about: Vec<(String, String)>,
    }

    #[derive(Debug)]
    enum Value {
        Number(i64),
        Text(Vec<u8>),
        List(Vec<Value>),
        Struct(HashMap<i16, Value>),
    }

    impl Value {
        fn number(&self) -> i64 {
            match self {
                Value::Number(number) => *number,
                other => panic!("{other:?}"),
            }
        }
        fn text(&self) -> String {
            match self {
                Value::Text(text) => String::from_utf8(text.clone()).unwrap(),
                other => panic!("{other:?}"),
            }
        }
        fn list(&self) -> &[Value] {
            match self {
                Value::List(list) => list,
                other => panic!("{other:?}"),
            }
        }
        fn get(&self, field: i16) -> &Value {
            match self {
                Value::Struct(fields) => &fields[&field],
                other => panic!("{other:?}"),
            }
        }
        fn has(&self, field: i16) -> bool {
            matches!(self, Value::Struct(fields) if fields.contains_key(&field))
        }
    }

    fn varint(at: &mut &[u8]) -> u64 {
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = at[0];
            *at = &at[1..];
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                return value;
            }
        }
    }

    fn value(at: &mut &[u8], kind: u8) -> Value {
        match kind {
            5 | 6 => {
                let zigzag = varint(at);
                Value::Number((zigzag >> 1) as i64 ^ -((zigzag & 1) as i64))
            }
            8 => {
                let length = varint(at) as usize;
                let text = at[..length].to_vec();
                *at = &at[length..];
                Value::Text(text)
            }
            9 => {
                let head = at[0];
                *at = &at[1..];
                let length = if head >> 4 == 15 { varint(at) } else { u64::from(head >> 4) };
                Value::List((0..length).map(|_| value(at, head & 15)).collect())
            }
            12 => {
                let (mut fields, mut last) = (HashMap::new(), 0);
                loop {
                    let head = at[0];
                    *at = &at[1..];
                    if head == 0 {
                        return Value::Struct(fields);
                    }
                    last += i16::from(head >> 4);
                    fields.insert(last, value(at, head & 15));
                }
            }
            other => panic!("type {other}"),
        }
    }

    pub fn read(bytes: &[u8]) -> Contents {
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
        let end = bytes.len() - 8;
        let length = u32::from_le_bytes(bytes[end..end + 4].try_into().unwrap()) as usize;
        let footer = value(&mut &bytes[end - length..end], 12);
        let schema = footer.get(2).list();
        assert_eq!(schema[0].get(5).number() as usize, schema.len() - 1);
        let names: Vec<String> = schema[1..].iter().map(|element| element.get(4).text()).collect();
        let mut columns = vec![Vec::new(); names.len()];
        for group in footer.get(4).list() {
            let rows = group.get(3).number() as usize;
            for (i, chunk) in group.get(1).list().iter().enumerate() {
                let about = chunk.get(3);
                assert_eq!(about.get(3).list()[0].text(), names[i]);
                let offset = about.get(9).number() as usize;
                let mut page = &bytes[offset..offset + about.get(7).number() as usize];
                let header = value(&mut page, 12);
                assert_eq!(header.get(5).get(1).number() as usize, rows);
                assert_eq!(header.get(3).number() as usize, page.len());
                let mut plain = Vec::new();
                GzDecoder::new(page).read_to_end(&mut plain).unwrap();
                assert_eq!(header.get(2).number() as usize, plain.len());
                let levels = u32::from_le_bytes(plain[..4].try_into().unwrap()) as usize;
                let mut run = &plain[4..4 + levels];
                assert_eq!(varint(&mut run), (rows as u64) << 1);
                let values = &plain[4 + levels..];
                let is_there = run == [1];
                match about.get(1).number() {
                    6 => columns[i].extend((0..rows).map(|_| None)),
                    _ if is_there => {
                        assert_eq!(values.len(), 8 * rows);
                        let all = values.as_chunks::<8>().0.iter();
                        columns[i].extend(all.map(|value| Some(u64::from_le_bytes(*value))));
                    }
                    _ => columns[i].extend((0..rows).map(|_| None)),
                }
            }
        }
        let about = footer.get(5).list().iter().map(|pair| (pair.get(1).text(), pair.get(2).text())).collect();
        assert!(schema[1].has(6), "the family is text");
        Contents { rows: footer.get(3).number(), names, columns, about }
    }
}
