//! Gadget's binary snapshots, formats 1 and 2, in either byte order, in one or several files.

mod blocks;
mod header;
mod records;

pub(super) use records::record as fortran_record;

use super::bytes::{Number, Order, RangeFile, Records};
use super::{Description, FamilyInfo, Field, FieldKind, Format, ImportError, Source, multifile};
use crate::model::{FamilyName, ReadMethod, Unit};
use blocks::Block;
use header::{Header, Types};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The Gadget binary format.
pub(super) struct Gadget;

impl Format for Gadget {
    fn name(&self) -> &'static str {
        "Gadget 1 or 2"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        records::recognise(head).is_some()
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Snapshot::open(path, method)?))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let own = SnapshotFile::open(path, ReadMethod::Positioned, &mut Vec::new())?;
        multifile::names(path, own.header.files)
    }
}

/// An opened snapshot.
struct Snapshot {
    description: Description,
    files: Vec<SnapshotFile>,
    /// By family and field.
    stored: Vec<Vec<Stored>>,
}

/// Where a field is: one part for each file that has particles of the family.
struct Stored {
    parts: Vec<Part>,
}

/// The part of a field that one file holds.
struct Part {
    file: usize,
    count: u64,
    place: Place,
}

enum Place {
    /// A mass from the header's table.
    Constant(f64),
    /// In the block, from this byte on.
    Block { block: usize, offset: u64 },
}

struct SnapshotFile {
    file: RangeFile,
    order: Order,
    header: Header,
    blocks: Vec<Block>,
}

impl SnapshotFile {
    fn open(path: &Path, method: ReadMethod, notes: &mut Vec<String>) -> Result<SnapshotFile, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut head = vec![0u8; file.length.min(8) as usize];
        file.read(0, &mut head, "header")?;
        let Some((order, format)) = records::recognise(&head) else {
            let expected = "a header record of 256 bytes or a HEAD label";
            return Err(ImportError::malformed(path, "header", format!("bytes {head:?}"), expected));
        };
        let records = records::scan(&file, order, format)?;
        let Some(first) = records.first().filter(|first| first.length == records::HEADER as u64) else {
            let found = records.first().map_or(0, |first| first.length);
            return Err(ImportError::malformed(path, "header", format!("{found} bytes"), "a record of 256 bytes"));
        };
        let header = Header::read(&file, order, first.offset)?;
        let blocks = blocks::name(path, &header, &records[1..], notes)?;
        Ok(SnapshotFile { file, order, header, blocks })
    }

    /// Where this file has a field of a type.
    fn place(&self, field: &Field, kind: usize) -> Option<Place> {
        let block = self.blocks.iter().position(|block| block.name == field.name && block.types.has(kind));
        if let Some(index) = block {
            let block = &self.blocks[index];
            let before = Types(block.types.0 & ((1u8 << kind) - 1));
            let size = (block.components * block.number.size()) as u64;
            return Some(Place::Block { block: index, offset: block.offset + self.header.particles(before) * size });
        }
        let mass = self.header.masses[kind];
        (field.kind == FieldKind::Mass && mass > 0.0).then_some(Place::Constant(mass))
    }

    /// The fields of a type, positions first.
    fn fields(&self, kind: usize) -> Vec<Field> {
        let blocks = self.blocks.iter().filter(|block| block.types.has(kind));
        let mut fields: Vec<Field> = blocks
            .map(|block| Field {
                name: block.name.clone(),
                stored_as: block.label.clone(),
                unit: Unit::default(),
                components: block.components,
                kind: block.kind,
            })
            .collect();
        if self.header.masses[kind] > 0.0 && !fields.iter().any(|field| field.kind == FieldKind::Mass) {
            fields.push(Field {
                name: "mass".into(),
                stored_as: "header mass table".into(),
                unit: Unit::default(),
                components: 1,
                kind: FieldKind::Mass,
            });
        }
        fields.sort_by_key(|field| field.kind);
        fields
    }
}

impl Snapshot {
    fn open(path: &Path, method: ReadMethod) -> Result<Snapshot, ImportError> {
        let mut notes = Vec::new();
        let first = SnapshotFile::open(path, method, &mut notes)?;
        let names = multifile::names(path, first.header.files)?;
        let files = match names.as_slice() {
            [_] => vec![first],
            names => {
                notes.clear();
                names.iter().map(|name| SnapshotFile::open(name, method, &mut notes)).collect::<Result<Vec<_>, _>>()?
            }
        };
        notes.dedup();
        let mut families = Vec::new();
        let mut stored = Vec::new();
        for (kind, name) in FamilyName::GADGET.into_iter().enumerate() {
            let Some(first) = files.iter().find(|file| file.header.counts[kind] > 0) else { continue };
            let count = files.iter().map(|file| file.header.counts[kind]).sum();
            let total = first.header.totals[kind];
            if total != 0 && total != count {
                let expected = format!("{count}, the particles of {} file(s) together", files.len());
                return Err(ImportError::malformed(path, format!("header total of type {kind}"), total, expected));
            }
            let fields = first.fields(kind);
            stored.push(fields.iter().map(|field| store(&files, field, kind)).collect::<Result<Vec<_>, _>>()?);
            families.push(FamilyInfo { name, count, fields });
        }
        if families.is_empty() {
            return Err(ImportError::NoParticles { path: path.into(), field: "header counts".into() });
        }
        let header = &files[0].header;
        let positive = |value: f64| (value > 0.0 && value.is_finite()).then_some(value);
        let mut description = Description {
            time: Some(header.time).filter(|time| time.is_finite()),
            redshift: Some(header.redshift).filter(|redshift| redshift.is_finite()),
            box_size: positive(header.box_size),
            notes,
            families,
            files: files.len(),
            ..Description::unitless(path, "gadget", files.iter().map(|file| file.file.length).sum())
        };
        header.describe_expansion(&mut description);
        Ok(Snapshot { description, files, stored })
    }
}

/// Finds a field in every file that has particles of the type.
fn store(files: &[SnapshotFile], field: &Field, kind: usize) -> Result<Stored, ImportError> {
    let mut parts = Vec::new();
    for (index, file) in files.iter().enumerate() {
        let count = file.header.counts[kind];
        if count == 0 {
            continue;
        }
        let shape = |place: &Place| match place {
            Place::Constant(_) => true,
            Place::Block { block, .. } => file.blocks[*block].components == field.components,
        };
        let Some(place) = file.place(field, kind).filter(shape) else {
            let name = format!("block {} of type {kind}", field.stored_as);
            return Err(ImportError::missing(&file.file.path, name, "the same blocks in every file"));
        };
        parts.push(Part { file: index, count, place });
    }
    Ok(Stored { parts })
}

impl Source for Snapshot {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        let parts = &self.stored[family][field].parts;
        multifile::pieces(parts.iter().map(|part| part.count), range, |part, rows, at| {
            let part = &parts[part];
            let values = (rows.end - rows.start) as usize * info.components;
            let out = &mut out[at * info.components..][..values];
            match part.place {
                Place::Constant(mass) => out.fill(mass),
                Place::Block { block, offset } => {
                    let file = &self.files[part.file];
                    let block = &file.blocks[block];
                    let stride = block.components * block.number.size();
                    let Block { number, components, .. } = *block;
                    let records = Records { number, order: file.order, stride, column: 0, components };
                    file.file.decode(offset + rows.start * stride as u64, records, out, &block.label)?;
                }
            }
            Ok(())
        })
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        let parts = &self.stored[family][field].parts;
        multifile::pieces(parts.iter().map(|part| part.count), range, |part, rows, at| {
            let part = &parts[part];
            let out = &mut out[at..at + (rows.end - rows.start) as usize];
            let file = &self.files[part.file];
            match part.place {
                Place::Block { block, offset } if matches!(file.blocks[block].number, Number::U32 | Number::U64) => {
                    let Block { number, ref label, .. } = file.blocks[block];
                    file.file.whole(offset + rows.start * number.size() as u64, number, file.order, out, label)
                }
                _ => Err(ImportError::malformed(&file.file.path, &*info.name, "no whole numbers", "a block of ids")),
            }
        })
    }
}
