//! Units of columns, and how long their lists are, which Parquet itself has no place for: programs write them into texts beside the schema.

use super::super::columns::MOST_COMPONENTS;
use super::super::ecsv_header;
use crate::import::grid::base64::Base64;
use parquet::file::metadata::KeyValue;
use serde_json::Value;
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

/// The most entries of one column that are looked at.
const MOST_ENTRIES: usize = 64;

/// The longest name or unit, bytes: entries may share one text, which then is looked at again and again.
const LONGEST_TEXT: usize = 1 << 12;

/// The units that the texts of a file state, by column; the first that is stated counts.
pub(super) fn units(path: &Path, texts: &[KeyValue]) -> HashMap<String, String> {
    let mut units = HashMap::new();
    let mut add = |name: &str, unit: &str| {
        units.entry(name.to_owned()).or_insert_with(|| unit.to_owned());
    };
    let pairs = || texts.iter().filter_map(|text| Some((text.key.as_str(), text.value.as_deref()?)));
    let named = |name: &str| pairs().find(|(key, _)| *key == name).map(|(_, value)| value);
    let json = |name: &str| named(name).and_then(|text| serde_json::from_str(text).ok()).unwrap_or(Value::Null);
    for (name, unit) in pairs().filter_map(|(key, unit)| Some((key.strip_prefix("unit.")?, unit))) {
        add(name, unit);
    }
    let pandas = json("pandas");
    for stated in [&json("units"), &pandas["attributes"]["units"], &pandas["attributes"]["unit"]] {
        for (name, unit) in stated.as_object().into_iter().flatten() {
            if let Some(unit) = unit.as_str() {
                add(name, unit);
            }
        }
    }
    for column in pandas["columns"].as_array().into_iter().flatten() {
        let unit = ["unit", "units"].into_iter().find_map(|key| column["metadata"][key].as_str());
        if let (Some(name), Some(unit)) = (column["name"].as_str(), unit) {
            add(name, unit);
        }
    }
    // What astropy writes is the header of an ECSV file.
    let lines: Vec<String> = named("table_meta_yaml").unwrap_or_default().lines().map(str::to_owned).collect();
    for column in ecsv_header::described(path, &lines).into_iter().flat_map(|header| header.columns) {
        add(&column.name, &column.unit);
    }
    arrow(&schema(texts), &mut |field, name| field.units(|unit| add(name, unit)));
    units.retain(|_, unit| !unit.trim().is_empty());
    units
}

/// How many numbers lists have in columns of which a schema of Arrow says that all have as many, and not too many.
pub(super) fn list_sizes(texts: &[KeyValue]) -> HashMap<String, usize> {
    let mut sizes = HashMap::new();
    arrow(&schema(texts), &mut |field, name| {
        if let Some(size) = field.list_size().filter(|size| (1..=MOST_COMPONENTS).contains(size)) {
            sizes.insert(name.to_owned(), size);
        }
        Some(())
    });
    sizes
}

/// The schema of Arrow among the texts of a file; empty without one.
fn schema(texts: &[KeyValue]) -> Vec<u8> {
    let text = texts.iter().find(|text| text.key == "ARROW:schema").and_then(|text| text.value.as_deref());
    let mut message = Vec::new();
    // What is damaged shows what came before the damage.
    let _ = Base64::new(text.unwrap_or_default().as_bytes()).read_to_end(&mut message);
    message
}

/// Calls `each` with the fields in a schema of Arrow and their names, a message in the form of FlatBuffers
/// (<https://arrow.apache.org/docs/format/Columnar.html>, `Message.fbs` and `Schema.fbs`). `None` where it is damaged, or `each` gives none.
fn arrow<'a>(message: &'a [u8], each: &mut impl FnMut(Field<'a>, &'a str) -> Option<()>) -> Option<()> {
    let bytes = Flat(message);
    // Since version 0.15 the message's length stands behind a mark.
    let root = if bytes.u32(0)? == u32::MAX { 8 } else { 4 };
    let schema = bytes.indirect(bytes.slot(bytes.indirect(root)?, 2)?)?;
    for field in bytes.items(bytes.slot(schema, 1)?)?.take(message.len()) {
        let field = bytes.indirect(field)?;
        let name = bytes.text(bytes.slot(field, 0)?)?;
        each(Field { bytes, at: field }, name)?;
    }
    Some(())
}

/// A field of a schema.
#[derive(Clone, Copy)]
struct Field<'a> {
    bytes: Flat<'a>,
    at: usize,
}

impl<'a> Field<'a> {
    /// Calls `add` with its units. `None` where it is damaged.
    fn units(self, mut add: impl FnMut(&'a str)) -> Option<()> {
        let Field { bytes, at } = self;
        let Some(entries) = bytes.slot(at, 6) else { return Some(()) };
        for entry in bytes.items(entries)?.take(MOST_ENTRIES) {
            let entry = bytes.indirect(entry)?;
            let (Some(key), Some(value)) = (bytes.slot(entry, 0), bytes.slot(entry, 1)) else { continue };
            if matches!(bytes.text(key)?, "unit" | "units") {
                add(bytes.text(value)?);
            }
        }
        Some(())
    }

    /// How long its lists are, where all are as long. `None` of other types, or where it is damaged.
    fn list_size(self) -> Option<usize> {
        /// The number of this type (`FixedSizeList`) among all.
        const LISTS: u8 = 16;
        let Field { bytes, at } = self;
        let kind = bytes.0.get(bytes.slot(at, 2)?)?;
        let list = bytes.indirect(bytes.slot(at, 3)?).filter(|_| *kind == LISTS)?;
        usize::try_from(bytes.u32(bytes.slot(list, 0)?)?).ok()
    }
}

/// Bytes in the form of FlatBuffers.
#[derive(Clone, Copy)]
struct Flat<'a>(&'a [u8]);

impl<'a> Flat<'a> {
    fn u32(&self, at: usize) -> Option<u32> {
        Some(u32::from_le_bytes(self.0.get(at..at.checked_add(4)?)?.try_into().ok()?))
    }

    fn u16(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(self.0.get(at..at.checked_add(2)?)?.try_into().ok()?))
    }

    /// Where the offset at byte `at` leads to.
    fn indirect(&self, at: usize) -> Option<usize> {
        at.checked_add(usize::try_from(self.u32(at)?).ok()?)
    }

    /// Where the entry `slot` of a table is; `None` where it has none.
    fn slot(&self, table: usize, slot: usize) -> Option<usize> {
        let back = i64::from(self.u32(table)?.cast_signed());
        let list = usize::try_from(i64::try_from(table).ok()?.checked_sub(back)?).ok()?;
        let place = 4 + 2 * slot;
        let offset = if place < usize::from(self.u16(list)?) { self.u16(list.checked_add(place)?)? } else { 0 };
        (offset > 0).then(|| table.checked_add(usize::from(offset))).flatten()
    }

    /// Where the offsets in a list are, which the offset at `at` leads to.
    fn items(&self, at: usize) -> Option<impl Iterator<Item = usize> + use<>> {
        let list = self.indirect(at)?;
        let count = usize::try_from(self.u32(list)?).ok()?;
        Some((1..=count).map_while(move |item| list.checked_add(4_usize.checked_mul(item)?)))
    }

    fn text(&self, at: usize) -> Option<&'a str> {
        let start = self.indirect(at)?;
        let length = usize::try_from(self.u32(start)?).ok().filter(|length| *length <= LONGEST_TEXT)?;
        let start = start.checked_add(4)?;
        std::str::from_utf8(self.0.get(start..start.checked_add(length)?)?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The schema that pyarrow 26 writes of a column `x` with an entry `unit`, `kpc`.
    const SCHEMA: &str = "/////6gAAAAQAAAAAAAKAAwABgAFAAgACgAAAAABBAAMAAAACAAIAAAABAAIAAAABAAAAAEAAAAYAAAAAAASABgACAAGAAcADAAAABAAFAASAA\
        AAAAABAxQAAABMAAAACAAAABAAAAAAAAAAAQAAAHgAAAABAAAADAAAAAgADAAEAAgACAAAABAAAAAEAAAAAwAAAGtwYwAEAAAAdW5pdAAABgAIAAYABgAAAAAAAgA=";

    #[test]
    fn every_way_to_state_units_is_read() {
        let yaml = "datatype:\n- {name: x, unit: pc, datatype: float64}\n- {name: d, unit: deg, datatype: float32}\n";
        let pandas = r#"{"columns":[{"name":"c","metadata":{"unit":"mag"}},{"name":"e","metadata":null}],"attributes":{"units":{"b":"km/s"}}}"#;
        let texts = [
            ("ARROW:schema", SCHEMA),
            ("table_meta_yaml", yaml),
            ("pandas", pandas),
            ("units", r#"{"a":"Msun","n":1}"#),
            ("unit.f", "K"),
            ("unit.g", " "),
        ];
        let texts = |count: usize| -> Vec<KeyValue> {
            texts[..count].iter().map(|(key, text)| KeyValue::new((*key).to_owned(), (*text).to_owned())).collect()
        };
        let path = Path::new("table.parquet");
        assert_eq!(units(path, &texts(1)), HashMap::from([("x".to_owned(), "kpc".to_owned())]));
        let expected = [("x", "pc"), ("d", "deg"), ("c", "mag"), ("b", "km/s"), ("a", "Msun"), ("f", "K")];
        assert_eq!(
            units(path, &texts(6)),
            HashMap::from(expected.map(|(name, unit)| (name.to_owned(), unit.to_owned())))
        );
    }

    #[test]
    fn damaged_schemas_state_nothing_or_something_else() {
        let mut message = Vec::new();
        Base64::new(SCHEMA.as_bytes()).read_to_end(&mut message).unwrap();
        for at in 0..message.len() {
            for byte in [0, 1, 0x7f, 0xff] {
                let mut damaged = message.clone();
                damaged[at] = byte;
                for bytes in [&damaged[..], &damaged[..at]] {
                    arrow(bytes, &mut |field, _| field.units(|_| {}).or(field.list_size().map(drop)));
                }
            }
        }
    }
}
