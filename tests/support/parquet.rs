//! As much of a Parquet reader as the tests' files need.

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
