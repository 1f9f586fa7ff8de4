//! GenericIO, the format of HACC (Habib et al. 2016, New Astronomy 42, 49; `GenericIO.cxx`): a header with a checksum, and for every process
//! one array for each variable, with a checksum behind it. A file may be a map of others, in which the arrays are.
//!
//! The header is a magic number that tells the order of bytes, numbers of 8 bytes, and tables of variables, processes and, in newer files, of
//! where each array is and how it is compressed: with BLOSC, whose container is behind a checksum of what is in it.

mod arrays;
mod blosc;

use self::arrays::{Array, Arrays, Blocks};
use super::bytes::{Order, RangeFile};
use super::grid::scratch::Storage;
use super::packed::MOST_EXPANSION;
use super::typed_columns::{Column, Component, FieldList, Run, TypedColumns, TypedFamily, VECTORS, Vector};
use super::{Description, FamilyInfo, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, SampleType};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The GenericIO format.
pub(super) struct GenericIo;

/// What a file begins with, by the order of its bytes; a byte 0 follows.
const MAGIC: [(&[u8; 7], Order); 2] = [(b"HACC01L", Order::Little), (b"HACC01B", Order::Big)];
/// Bytes of the numbers of the first version, of those that tell the box, and of those that tell where arrays are.
const FIRST: u64 = 104;
const WITH_BOX: u64 = 152;
const WITH_BLOCKS: u64 = 168;
/// Bytes of a checksum, and of what is known of an entry of the tables.
const CHECKSUM: u64 = 8;
const VARIABLE: u64 = 272;
const PROCESS: u64 = 40;
const BLOCK: u64 = 48;
/// Letters of a variable's name, of the names of an array's filters, and of one of them.
const NAME: usize = 256;
const FILTERS: usize = 32;
const FILTER: usize = 8;
/// The filter that there is.
const BLOSC: &[u8] = b"BLOSC";

/// The longest header, bytes; the most variables, and numbers of one in a particle.
const MOST_HEADER: u64 = 1 << 30;
const MOST_VARIABLES: u64 = 256;
const MOST_COMPONENTS: u64 = 64;
/// The most files of one map, and the bytes of it that are read at once.
const MOST_FILES: usize = 1 << 16;
const PIECE: u64 = 1 << 16;

/// Centres and mean velocities of HACC's groups.
const OF_GROUPS: [Vector; 2] = [
    ("position", ["fof_halo_center_x", "fof_halo_center_y", "fof_halo_center_z"], FieldKind::Position),
    ("velocity", ["fof_halo_mean_vx", "fof_halo_mean_vy", "fof_halo_mean_vz"], FieldKind::Velocity),
];

/// The variable of a map that says in which file the arrays of a process are.
const PARTITION: &str = "$partition";

impl Format for GenericIo {
    fn name(&self) -> &'static str {
        "GenericIO"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["gio", "genericio"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        order_of(head).is_some()
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let blocks = Arc::default();
        let first = Contents::open(path, method, (&blocks, 0))?;
        let mut about = Description::unitless(path, "generic-io", first.length);
        let names = first.parts()?;
        let files = match &names {
            Some(names) => {
                let opened = names.iter().zip(1..).map(|(name, file)| Contents::open(name, method, (&blocks, file)));
                opened.collect::<Result<Vec<_>, _>>()?
            }
            None => vec![first],
        };
        // A map says none.
        about.box_size = files.first().and_then(|contents| contents.box_size);
        if names.is_some() {
            about.bytes += files.iter().map(|contents| contents.length).sum::<u64>();
            about.notes.push(format!("{} files of the snapshot are read", files.len()));
        }
        let mut family: Option<(FamilyInfo, TypedFamily)> = None;
        let mut storages = Vec::new();
        for contents in files {
            let number = storages.len();
            for process in contents.processes.iter().filter(|process| process.count > 0) {
                let fields = contents.fields(process, number, &mut about.notes);
                if !fields.has_positions() {
                    return Err(ImportError::missing(&contents.path, "positions", "variables x, y and z"));
                }
                let (info, columns) = fields.family(FamilyName::Dark, process.count, vec![Run::WHOLE]);
                match &mut family {
                    None => family = Some((info, columns)),
                    Some((known, all)) if known.fields == info.fields => {
                        all.extend(columns, known.count);
                        known.count += info.count;
                    }
                    Some(_) => {
                        let expected = "those of the files before";
                        return Err(ImportError::malformed(&contents.path, "variables", "others", expected));
                    }
                }
            }
            storages.push(contents.storage);
        }
        let Some(family) = family else {
            return Err(ImportError::NoParticles { path: path.into(), field: "processes".into() });
        };
        Ok(Box::new(TypedColumns::new(about, storages, vec![family])))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        let mut files = vec![path.to_owned()];
        let contents = Contents::open(path, ReadMethod::Positioned, (&Arc::default(), 0))?;
        files.extend(contents.parts()?.into_iter().flatten());
        Ok(files)
    }
}

/// The order of bytes of a file that begins so.
fn order_of(head: &[u8]) -> Option<Order> {
    MAGIC.iter().find(|(magic, _)| head.starts_with(*magic)).map(|(_, order)| *order)
}

/// A variable.
struct Variable {
    name: String,
    /// How its numbers are stored, and how many a particle has; `None` where they are no numbers that are read.
    stored: Option<(SampleType, u64)>,
    /// Bytes of a particle.
    size: u64,
}

/// What a process has written.
struct Process {
    count: u64,
    /// By variable: where its array begins in the storage.
    starts: Vec<u64>,
}

/// What a file holds.
struct Contents {
    path: PathBuf,
    /// Bytes of the file.
    length: u64,
    /// The file, or its arrays one behind the other where some are compressed.
    storage: Storage,
    order: Order,
    variables: Vec<Variable>,
    processes: Vec<Process>,
    box_size: Option<f64>,
}

/// A header.
struct Header<'a> {
    file: &'a RangeFile,
    order: Order,
    bytes: Vec<u8>,
}

impl Header<'_> {
    /// The number at a byte of the header, which is in it.
    fn number(&self, at: u64) -> u64 {
        self.order.f64(&self.bytes, at as usize).to_bits()
    }

    fn wrong(&self, field: &str, found: impl ToString, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(&self.file.path, field, found, expected)
    }

    /// Where the entries of a table begin: each at least `least` bytes long, at most `most` of them, all inside the header. The table is told by
    /// three numbers of the header, of which the last is where it begins.
    fn table(&self, name: &str, count: u64, [size, start]: [u64; 2], least: u64) -> Result<Vec<u64>, ImportError> {
        let end = count.checked_mul(size).and_then(|bytes| bytes.checked_add(start));
        if size < least || end.is_none_or(|end| end > self.bytes.len() as u64) {
            let found = format!("{count} entries of {size} bytes from byte {start} on");
            let expected = format!("entries of {least} bytes or more in a header of {}", self.bytes.len());
            return Err(self.wrong(name, found, expected));
        }
        Ok((0..count).map(|entry| start + entry * size).collect())
    }

    /// The variable of an entry.
    fn variable(&self, entry: u64, size_of_entry: u64) -> Result<Variable, ImportError> {
        let name = self.bytes.get(entry as usize..).and_then(|rest| rest.get(..NAME)).unwrap_or_default();
        let name = String::from_utf8_lossy(name.split(|byte| *byte == 0).next().unwrap_or_default());
        let name: String = name.chars().filter(|letter| !letter.is_control()).collect();
        let (flags, size) = (self.number(entry + 256), self.number(entry + 264));
        let element = if size_of_entry >= VARIABLE + 8 { self.number(entry + VARIABLE) } else { size };
        // Older files leave the size of an element out.
        let element = if element == 0 { size } else { element };
        let components = size.checked_div(element).filter(|count| count.checked_mul(element) == Some(size));
        let Some(components) = components.filter(|count| (1..=MOST_COMPONENTS).contains(count)) else {
            let found = format!("{size} bytes in elements of {element}");
            return Err(self.wrong(&name, found, format!("1 to {MOST_COMPONENTS} elements")));
        };
        let number = match flags & 1 {
            1 => SampleType::float(element as usize),
            _ => SampleType::whole(element as usize, flags & 2 != 0),
        };
        // Any variable may be marked as a coordinate.
        let axis = ["x", "y", "z"].into_iter().zip([4, 8, 16]).find(|(_, mark)| flags & mark != 0);
        let name = axis.map_or(name, |(axis, _)| axis.to_owned());
        Ok(Variable { name, stored: number.map(|number| (number, components)), size })
    }
}

impl Contents {
    /// `kept` is where unpacked blocks of all files are, and the file's number among them.
    fn open(path: &Path, method: ReadMethod, kept: (&Arc<Blocks>, usize)) -> Result<Contents, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut start = [0; FIRST as usize];
        file.read(0, &mut start, "header")?;
        let Some(order) = order_of(&start) else {
            return Err(ImportError::malformed(path, "header", "something else", "HACC01L or HACC01B"));
        };
        let length = order.f64(&start, 8).to_bits();
        let whole = length.checked_add(CHECKSUM).filter(|whole| *whole <= file.length.min(MOST_HEADER));
        let Some(whole) = whole.filter(|_| length >= FIRST) else {
            let expected = format!("{FIRST} or more, within the {} bytes of the file", file.length);
            return Err(ImportError::malformed(path, "header", format!("{length} bytes"), expected));
        };
        let mut bytes = vec![0; whole as usize];
        file.read(0, &mut bytes, "header")?;
        if crc64(&bytes) != u64::MAX {
            return Err(ImportError::malformed(path, "header", "bytes of another checksum", "those of its own"));
        }
        bytes.truncate(length as usize);
        let header = Header { file: &file, order, bytes };
        // Of the numbers those are known that the header says it has.
        let known = header.number(96).min(length);
        let (variable_count, process_count) = (header.number(48), header.number(72));
        if variable_count > MOST_VARIABLES {
            return Err(header.wrong("variables", variable_count, format!("at most {MOST_VARIABLES}")));
        }
        let size = header.number(56);
        let entries = header.table("variables", variable_count, [size, header.number(64)], VARIABLE)?;
        let variables = entries.into_iter().map(|entry| header.variable(entry, size));
        let variables: Vec<Variable> = variables.collect::<Result<_, _>>()?;
        if variables.is_empty() && header.number(16) > 0 {
            return Err(ImportError::missing(path, "positions", "variables x, y and z"));
        }
        let places = [header.number(80), header.number(88)];
        let entries = header.table("processes", process_count, places, PROCESS)?;
        let blocks = match known >= WITH_BLOCKS && header.number(152) > 0 {
            true => {
                // As many as the header can hold; the product of two tables that are in it.
                let count = variable_count.saturating_mul(process_count);
                header.table("arrays", count, [header.number(152), header.number(160)], BLOCK)?
            }
            false => Vec::new(),
        };
        let (mut counts, mut arrays) = (Vec::new(), Vec::new());
        let (mut total, mut stored) = (0u64, 0u64);
        for (index, entry) in entries.into_iter().enumerate() {
            let (count, start) = (header.number(entry + 24), header.number(entry + 32));
            let blocks = blocks.get(index * variables.len()..).unwrap_or_default();
            total = total.saturating_add(count);
            if count > 0 {
                let own = arrays_of(&header, (count, start), &variables, blocks)?;
                stored = own.iter().map(Array::stored).fold(stored, u64::saturating_add);
                if stored > file.length {
                    let expected = format!("no more than the file's {}, as none lies in another", file.length);
                    return Err(header.wrong("arrays", format!("{stored} bytes"), expected));
                }
                arrays.extend(own);
                counts.push(count);
            }
        }
        if total != header.number(16) {
            return Err(header.wrong("particles", header.number(16), format!("{total}, those of all processes")));
        }
        let is_packed = arrays.iter().any(|array| array.packed.is_some());
        let numbers = |at: u64| [0, 8, 16].map(|axis| f64::from_bits(header.number(at + axis)));
        let [origin, scale] = if known >= WITH_BOX { [numbers(104), numbers(128)] } else { [[0.0; 3]; 2] };
        let is_cube = origin == [0.0; 3] && scale[0] > 0.0 && scale[0].is_finite() && scale == [scale[0]; 3];
        let box_size = is_cube.then_some(scale[0]);
        let mut processes = Vec::with_capacity(counts.len());
        // Where some are compressed, they are read as if they followed each other.
        let mut next = 0_u64;
        for (arrays, count) in arrays.chunks_exact(variables.len().max(1)).zip(counts) {
            let mut starts = Vec::with_capacity(arrays.len());
            for array in arrays {
                starts.push(if is_packed { next } else { array.start });
                next = next.saturating_add(array.length);
            }
            processes.push(Process { count, starts });
        }
        let (path, length) = (path.to_owned(), file.length);
        let storage = if is_packed {
            let names = variables.iter().map(|variable| variable.name.clone()).collect();
            Storage::Pieces(Box::new(Arrays::new(file, names, arrays.into_iter(), kept)))
        } else {
            Storage::File(file)
        };
        Ok(Contents { path, length, storage, order, variables, processes, box_size })
    }

    /// The files that this one is a map of.
    ///
    /// # Errors
    /// When the map cannot be read, or names too many.
    fn parts(&self) -> Result<Option<Vec<PathBuf>>, ImportError> {
        let Some(place) = self.variables.iter().position(|variable| variable.name == PARTITION) else {
            return Ok(None);
        };
        let mut numbers = BTreeSet::new();
        for process in &self.processes {
            let whole = self.variables[place].stored == Some((SampleType::I32, 1));
            let wrong =
                |found: String, expected: String| ImportError::malformed(&self.path, PARTITION, found, expected);
            if !whole {
                return Err(wrong("numbers of another type".into(), "whole numbers of 4 bytes".into()));
            }
            let (start, bytes) = (process.starts[place], 4 * process.count);
            for at in (0..bytes).step_by(PIECE as usize) {
                let mut piece = vec![0; (bytes - at).min(PIECE) as usize];
                self.storage.read(&self.path, start + at, &mut piece)?;
                numbers.extend(piece.chunks_exact(4).map(|word| self.order.u32(word, 0)));
                if numbers.len() > MOST_FILES {
                    return Err(wrong(format!("more than {MOST_FILES} files"), "fewer".into()));
                }
            }
        }
        let named = numbers.into_iter().map(|number| {
            let mut name = self.path.as_os_str().to_owned();
            name.push(format!("#{number}"));
            PathBuf::from(name)
        });
        Ok(Some(named.collect()))
    }

    /// The variables of a process as fields.
    fn fields(&self, process: &Process, storage: usize, notes: &mut Vec<String>) -> FieldList {
        let mut fields = FieldList::default();
        let mut scalars = Vec::new();
        let mut others = Vec::new();
        for (variable, start) in self.variables.iter().zip(&process.starts) {
            let Some((number, components)) = variable.stored else {
                let note = format!("{} is no number of a known size and is left out", variable.name);
                notes.extend((!notes.contains(&note)).then_some(note));
                continue;
            };
            let component = |index: u64| {
                let offset = start + index * number.size() as u64;
                Component::plain(Column { storage, offset, stride: variable.size, number, order: self.order })
            };
            match components {
                1 => scalars.push((variable.name.clone(), component(0))),
                _ => others.push((&variable.name, (0..components).map(component).collect::<Vec<_>>())),
            }
        }
        fields.push_named(scalars, &[&VECTORS[..2], &OF_GROUPS[..]].concat());
        for (name, components) in others {
            fields.push(name, name, FieldKind::Other, components);
        }
        fields
    }
}

/// Where the arrays of a process of `count` particles are: from byte `start` on unless blocks say where.
fn arrays_of(
    header: &Header,
    (count, start): (u64, u64),
    variables: &[Variable],
    blocks: &[u64],
) -> Result<Vec<Array>, ImportError> {
    let mut at = start;
    let mut arrays = Vec::with_capacity(variables.len());
    for (index, variable) in variables.iter().enumerate() {
        let field = &variable.name;
        let mut packed = None;
        if let Some(block) = blocks.get(index) {
            let filters = header.bytes.get(*block as usize..).and_then(|rest| rest.get(..FILTERS)).unwrap_or_default();
            let names = filters.chunks(FILTER).filter_map(|name| name.split(|byte| *byte == 0).next());
            let names: Vec<&[u8]> = names.filter(|name| !name.is_empty()).collect();
            at = header.number(block + 32);
            packed = match names[..] {
                [] => None,
                [BLOSC] => Some(header.number(block + 40)),
                _ => {
                    let found = format!("numbers compressed with {}", names.join(&b", "[..]).escape_ascii());
                    return Err(header.wrong(field, found, "numbers that are not compressed, or with BLOSC"));
                }
            };
        }
        let length = count.checked_mul(variable.size);
        let stored = packed.filter(|bytes| *bytes >= CHECKSUM).or(length.filter(|_| packed.is_none()));
        let end = stored.and_then(|bytes| bytes.checked_add(at)?.checked_add(CHECKSUM));
        let (Some(length), Some(end)) = (length, end.filter(|end| *end <= header.file.length)) else {
            let found = match packed {
                None => format!("{count} times {} bytes from byte {at} on", variable.size),
                Some(bytes) => format!("{bytes} compressed bytes from byte {at} on"),
            };
            return Err(header.wrong(field, found, format!("a file of {} bytes holds them", header.file.length)));
        };
        arrays.push(Array { start: at, length, packed });
        at = end;
    }
    // Of a few numbers that repeat themselves there may be far fewer bytes, of all of a process's not.
    let unpacked = arrays.iter().map(|array| array.length).fold(0, u64::saturating_add);
    let stored = arrays.iter().map(Array::stored).fold(0, u64::saturating_add);
    if unpacked > stored.saturating_mul(MOST_EXPANSION) {
        let expected = format!("at most {MOST_EXPANSION} times the {stored} bytes that they are compressed to");
        return Err(header.wrong("arrays of a process", format!("{unpacked} bytes"), expected));
    }
    Ok(arrays)
}

/// The checksum of ECMA-182 with its bits reversed, from all ones on and turned over in the end. Of what ends in its own checksum, turned over, it is
/// all ones.
fn crc64(bytes: &[u8]) -> u64 {
    !bytes.iter().fold(u64::MAX, |sum, byte| CRC64[((sum ^ u64::from(*byte)) & 0xff) as usize] ^ (sum >> 8))
}

/// What every byte does to the checksum.
static CRC64: [u64; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < table.len() {
        let mut sum = byte as u64;
        let mut bit = 0;
        while bit < 8 {
            sum = if sum & 1 == 1 { (sum >> 1) ^ 0xc96c_5795_d787_0f42 } else { sum >> 1 };
            bit += 1;
        }
        table[byte] = sum;
        byte += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::crc64;

    #[test]
    fn checksums_are_those_of_the_catalogue() {
        // The check value of CRC-64/XZ.
        assert_eq!(crc64(b"123456789"), 0x995d_c9bb_df19_39fa);
        let mut bytes = b"a header".to_vec();
        bytes.extend((!crc64(&bytes)).to_le_bytes());
        assert_eq!(crc64(&bytes), u64::MAX);
    }
}
