//! A format: a first line `xyz`, then a particle in each line: x, y, z and mass.

use deepfield::import::{Description, FamilyInfo, Field, FieldKind, Format, ImportError, Source};
use deepfield::model::{FamilyName, ReadMethod, Unit};
use std::ops::Range;
use std::path::Path;

/// The format.
pub struct Xyz;

impl Format for Xyz {
    fn name(&self) -> &'static str {
        "xyz points"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        head.starts_with(b"xyz\n")
    }

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let text = std::fs::read_to_string(path).map_err(|error| ImportError::io(path, "file", error))?;
        let row = |(index, line): (usize, &str)| {
            let numbers: Vec<f64> = line.split_whitespace().map_while(|word| word.parse().ok()).collect();
            let expected = "four numbers: x, y, z and mass";
            <[f64; 4]>::try_from(numbers)
                .map_err(|_| ImportError::malformed(path, format!("line {}", index + 2), line, expected))
        };
        let rows = text.lines().skip(1).enumerate().map(row).collect::<Result<Vec<_>, _>>()?;
        let mut description = Description::unitless(path, "xyz", text.len() as u64);
        let field = |name: &str, components, kind| Field {
            name: name.into(),
            stored_as: name.into(),
            unit: Unit::default(),
            components,
            kind,
        };
        description.families.push(FamilyInfo {
            name: FamilyName::Gas,
            count: rows.len() as u64,
            fields: vec![field("position", 3, FieldKind::Position), field("mass", 1, FieldKind::Mass)],
        });
        Ok(Box::new(Points { description, rows }))
    }
}

/// An opened file.
struct Points {
    description: Description,
    rows: Vec<[f64; 4]>,
}

impl Source for Points {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let components = self.description.check_range(family, field, &range, out.len())?.components;
        let columns = if components == 3 { 0..3 } else { 3..4 };
        let rows = &self.rows[range.start as usize..range.end as usize];
        out.iter_mut().zip(rows.iter().flat_map(|row| &row[columns.clone()])).for_each(|(out, value)| *out = *value);
        Ok(())
    }
}
