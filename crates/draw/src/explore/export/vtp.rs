//! VTK's `PolyData` in XML with appended raw data (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>): a point and
//! a vertex for each row, arrays of doubles, the family as a byte (Gadget's number, 255: another family) and ids as unsigned numbers of 64
//! bits. What a family does not have is not a number. Units are `UNITS_LABEL` of the arrays.

use super::columnwise::{Array, Spool};
use super::stated::Stated;
use super::{Block, Layout, Out, Table};
use crate::model::Unit;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

pub(super) struct Vtp<'a> {
    out: Out<'a>,
    /// The arrays of numbers, and their units.
    arrays: Vec<(Array, Unit)>,
    has_ids: bool,
    time: Option<f64>,
    /// The arrays, families and ids.
    spool: Spool,
    rows: u64,
}

impl<'a> Vtp<'a> {
    pub(super) fn new(out: Out<'a>, layout: &Layout, stated: &Stated, path: &Path) -> io::Result<Vtp<'a>> {
        let with_unit = |array: Array| {
            let unit = layout.columns[array.columns.start].unit.clone();
            (array, unit)
        };
        let arrays: Vec<_> = Array::all(&layout.columns).into_iter().map(with_unit).collect();
        let spool = Spool::new(path, arrays.len() + 2)?;
        let time = stated.time.filter(|time| time.is_finite());
        Ok(Vtp { out, arrays, has_ids: layout.has_ids, time, spool, rows: 0 })
    }

    /// The header, as far as the byte that data begins behind.
    fn header(&self) -> String {
        let mut places = Places::default();
        let (mut points, mut others) = (String::new(), String::new());
        // In the order in which the arrays are written.
        for (number, (array, unit)) in self.arrays.iter().enumerate() {
            let is_points = array.name == "position";
            let name = if is_points { "Points" } else { array.name.as_str() };
            let text = places.array("Float64", name, array.components(), unit, self.spool.bytes(number));
            let section = if is_points { &mut points } else { &mut others };
            section.push_str(&text);
        }
        let (family, ids) = (self.arrays.len(), self.arrays.len() + 1);
        others.push_str(&places.array("UInt8", "family", 1, &Unit::default(), self.spool.bytes(family)));
        if self.has_ids {
            others.push_str(&places.array("UInt64", "id", 1, &Unit::default(), self.spool.bytes(ids)));
        }
        let cells =
            ["connectivity", "offsets"].map(|name| places.array("Int64", name, 1, &Unit::default(), 8 * self.rows));
        let time = self.time.map_or_else(String::new, |time| {
            format!(
                "<FieldData>\n<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" \
                 format=\"ascii\">{time:e}</DataArray>\n</FieldData>\n"
            )
        });
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n<PolyData>\n{time}<Piece NumberOfPoints=\"{rows}\" NumberOfVerts=\"{rows}\" \
             NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n<Points>\n{points}</Points>\n\
             <PointData>\n{others}</PointData>\n<Verts>\n{}</Verts>\n</Piece>\n</PolyData>\n\
             <AppendedData encoding=\"raw\">\n_",
            cells.concat(),
            rows = self.rows,
        )
    }
}

/// Where appended arrays are.
#[derive(Default)]
struct Places {
    /// The byte at which the next one begins.
    next: u64,
}

impl Places {
    /// The element of an array of so many bytes.
    fn array(&mut self, kind: &str, name: &str, components: usize, unit: &Unit, bytes: u64) -> String {
        let mut text = format!(
            "<DataArray type=\"{kind}\" Name=\"{}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"{}\"",
            escaped(name),
            self.next,
        );
        self.next += 8 + bytes;
        // Writing to memory cannot fail.
        let _ = match unit.is_unknown() {
            true => writeln!(text, "/>"),
            false => writeln!(
                text,
                ">\n<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">{}</InformationKey>\n</DataArray>",
                escaped(&unit.0)
            ),
        };
        text
    }
}

/// A text as it may stand in XML and HTML.
pub fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

impl Table for Vtp<'_> {
    type Piece = Block;

    fn prepare(block: Block) -> Block {
        block
    }

    fn write(&mut self, block: Block) -> io::Result<()> {
        for (number, (array, _)) in self.arrays.iter().enumerate() {
            self.spool.push(number, |out| array.write(&block, out))?;
        }
        let family = block.family.gadget_type().unwrap_or(u8::MAX);
        self.spool.push(self.arrays.len(), |out| out.resize(out.len() + block.rows, family))?;
        if self.has_ids {
            self.spool.push(self.arrays.len() + 1, |out| match &block.ids {
                Some(ids) => out.extend(ids.iter().flat_map(|id| id.to_le_bytes())),
                None => out.resize(out.len() + 8 * block.rows, u8::MAX),
            })?;
        }
        self.rows += block.rows as u64;
        Ok(())
    }

    fn finish(mut self) -> io::Result<u64> {
        let header = self.header();
        self.out.write_all(header.as_bytes())?;
        let spooled = self.arrays.len() + 1 + usize::from(self.has_ids);
        for array in 0..spooled {
            self.out.write_all(&self.spool.bytes(array).to_le_bytes())?;
            self.spool.copy(array, &mut self.out)?;
        }
        // Each vertex is the point of its number, and ends before the next one's.
        for first in [0, 1] {
            self.out.write_all(&(8 * self.rows).to_le_bytes())?;
            for number in first..first + self.rows {
                self.out.write_all(&number.to_le_bytes())?;
            }
        }
        self.out.write_all(b"\n</AppendedData>\n</VTKFile>\n")?;
        self.out.flush()?;
        Ok(self.rows)
    }
}
