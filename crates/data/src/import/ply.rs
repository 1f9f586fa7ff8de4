//! PLY: the vertices of a file as points, text or binary in either byte order (Greg Turk, "The PLY Polygon File Format", 1994). Scalar
//! properties of any type are attributes. Faces and other elements are left out. The format has no units: comments `unit of x: kpc` say them.

use super::bytes::{Order, RangeFile};
use super::grid::scratch::{Scratch, Storage};
use super::typed_columns::{Column, Component, FieldList, Run, TypedColumns, VECTORS};
use super::{Description, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, SampleType, Unit};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The PLY format.
pub(super) struct Ply;

/// The longest header, and the longest line of an element in text, bytes.
const LONGEST_HEADER: u64 = 1 << 16;
const LONGEST_LINE: u64 = 1 << 20;

/// Numbers parsed before they are put away, bytes.
const BATCH: usize = 1 << 16;

const TYPES: &[(&[&str], SampleType)] = &[
    (&["char", "int8"], SampleType::I8),
    (&["uchar", "uint8"], SampleType::U8),
    (&["short", "int16"], SampleType::I16),
    (&["ushort", "uint16"], SampleType::U16),
    (&["int", "int32"], SampleType::I32),
    (&["uint", "uint32"], SampleType::U32),
    (&["int64"], SampleType::I64),
    (&["uint64"], SampleType::U64),
    (&["float", "float32"], SampleType::F32),
    (&["double", "float64"], SampleType::F64),
];

impl Format for Ply {
    fn name(&self) -> &'static str {
        "PLY points"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["ply"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut head = vec![0; file.length.min(LONGEST_HEADER) as usize];
        file.read(0, &mut head, "header")?;
        let header = Header::parse(path, &head)?;
        let place = header.elements.iter().position(|element| element.name == VERTEX);
        let Some(place) = place else {
            return Err(ImportError::missing(path, "element vertex", "vertices, which are the points"));
        };
        let vertex = &header.elements[place];
        if vertex.count == 0 {
            return Err(ImportError::NoParticles { path: path.into(), field: "element vertex".into() });
        }
        if let Some(list) = vertex.properties.iter().find(|property| property.is_list) {
            let found = format!("a list {}", list.name);
            return Err(ImportError::malformed(path, "element vertex", found, "one number for each property"));
        }
        let before = &header.elements[..place];
        let length = file.length;
        let (storage, start, order) = match header.order {
            Some(order) => {
                let start = binary_start(path, &file, &header, before, vertex)?;
                (Storage::File(file), start, order)
            }
            None => (parsed(&file, &header, before, vertex)?, 0, Order::NATIVE),
        };
        let about = Description::unitless(path, "ply", length);
        let mut offset = start;
        let mut scalars = Vec::with_capacity(vertex.properties.len());
        for property in &vertex.properties {
            let column = Column { storage: 0, offset, stride: vertex.bytes(), number: property.number, order };
            scalars.push((property.name.clone(), Component::plain(column)));
            offset += property.number.size() as u64;
        }
        let mut fields = FieldList::default();
        fields.push_named(scalars, &VECTORS);
        for (name, unit) in &header.units {
            fields.set_unit_stored_as(name, unit);
        }
        if !fields.has_positions() {
            return Err(ImportError::missing(path, "element vertex", "properties x, y and z"));
        }
        let others = header.elements.iter().filter(|element| element.name != VERTEX && element.count > 0);
        let others: Vec<&str> = others.map(|element| &*element.name).collect();
        let left_out = (!others.is_empty()).then(|| format!("vertices alone are read, not: {}", others.join(", ")));
        let (length_unit, mass_unit) = (fields.unit_of(FieldKind::Position), fields.unit_of(FieldKind::Mass));
        let about = Description { notes: left_out.into_iter().collect(), length_unit, mass_unit, ..about };
        let family = fields.family(FamilyName::Dark, vertex.count, vec![Run::WHOLE]);
        Ok(Box::new(TypedColumns::new(about, vec![storage], vec![family])))
    }
}

const VERTEX: &str = "vertex";

/// A property of an element.
struct Property {
    name: String,
    number: SampleType,
    is_list: bool,
}

/// An element: how many there are, and what each has.
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    /// Size of one of them without lists, bytes.
    fn bytes(&self) -> u64 {
        self.properties.iter().map(|property| property.number.size() as u64).sum()
    }
}

/// A file's header.
struct Header {
    /// The order of bytes; `None` for text.
    order: Option<Order>,
    elements: Vec<Element>,
    /// Units that comments say, by the name of the property.
    units: Vec<(String, Unit)>,
    /// Its length, bytes.
    length: u64,
}

impl Header {
    fn parse(path: &Path, head: &[u8]) -> Result<Header, ImportError> {
        let mut coding = None;
        let (mut elements, mut units): (Vec<Element>, Vec<(String, Unit)>) = Default::default();
        let mut length = 0;
        for line in head.split_inclusive(|&byte| byte == b'\n').filter(|line| line.ends_with(b"\n")) {
            length += line.len() as u64;
            let text = String::from_utf8_lossy(line);
            let wrong = |expected: &str| {
                let found: String = text.trim().chars().filter(|c| !c.is_control()).take(80).collect();
                ImportError::malformed(path, "header", found, expected)
            };
            let words: Vec<&str> = text.split_whitespace().collect();
            match words[..] {
                ["comment", "unit", "of", ..] => units.extend(unit_of(&text)),
                ["ply"] | [] | ["comment" | "obj_info", ..] => {}
                ["format", "ascii", _] => coding = Some(None),
                ["format", "binary_little_endian", _] => coding = Some(Some(Order::Little)),
                ["format", "binary_big_endian", _] => coding = Some(Some(Order::Big)),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| wrong("a number of elements"))?;
                    if elements.iter().any(|element| element.name == name) {
                        return Err(wrong("each element once"));
                    }
                    let name: String = name.chars().filter(|c| !c.is_control()).collect();
                    elements.push(Element { name, count, properties: Vec::new() });
                }
                ["property", "list", _, kind, name] | ["property", kind, name] => {
                    let number = TYPES.iter().find(|(names, _)| names.contains(&kind));
                    let (_, number) = number.ok_or_else(|| wrong("a type such as uchar, int or float"))?;
                    let element = elements.last_mut().ok_or_else(|| wrong("an element before its properties"))?;
                    let name: String = name.chars().filter(|c| !c.is_control()).collect();
                    element.properties.push(Property { name, number: *number, is_list: words.len() == 5 });
                }
                ["end_header"] => {
                    let order = coding.ok_or_else(|| {
                        let expected = "ascii, binary_little_endian or binary_big_endian";
                        ImportError::missing(path, "format", expected)
                    })?;
                    return Ok(Header { order, elements, units, length });
                }
                _ => return Err(wrong("format, comment, element, property or end_header")),
            }
        }
        let expected = format!("this line in the first {LONGEST_HEADER} bytes");
        Err(ImportError::missing(path, "end_header", expected))
    }
}

/// The property and the unit of a comment `unit of NAME: UNIT`.
fn unit_of(comment: &str) -> Option<(String, Unit)> {
    let (name, unit) = comment.trim().strip_prefix("comment unit of ")?.split_once(": ")?;
    let unit: String = unit.chars().filter(|letter| !letter.is_control()).collect();
    Some((name.to_owned(), Unit::new(unit.trim())))
}

/// The byte of the first vertex, after a look at whether all are in the file.
fn binary_start(
    path: &Path,
    file: &RangeFile,
    header: &Header,
    before: &[Element],
    vertex: &Element,
) -> Result<u64, ImportError> {
    let mut start = Some(header.length);
    for element in before {
        if element.properties.iter().any(|property| property.is_list) && element.count > 0 {
            let found = format!("lists in front of them ({})", element.name);
            return Err(ImportError::malformed(path, "element vertex", found, "vertices before elements with lists"));
        }
        start = start.and_then(|start| start.checked_add(element.count.checked_mul(element.bytes())?));
    }
    let end = start.and_then(|start| start.checked_add(vertex.count.checked_mul(vertex.bytes())?));
    match (start, end) {
        (Some(start), Some(end)) if end <= file.length => Ok(start),
        _ => {
            let found = format!("the file's end at byte {}", file.length);
            Err(ImportError::malformed(path, "element vertex", found, format!("{} vertices", vertex.count)))
        }
    }
}

/// The vertices of a file of text as numbers of their types, in this machine's byte order, one behind the other.
fn parsed(file: &RangeFile, header: &Header, before: &[Element], vertex: &Element) -> Result<Storage, ImportError> {
    let (path, length) = (&*file.path, file.length);
    // Of every number a digit and what separates it are there.
    let numbers = vertex.count.checked_mul(vertex.properties.len() as u64);
    let most = length.saturating_sub(header.length).saturating_add(1) / 2;
    if numbers.is_none_or(|numbers| numbers > most) {
        let found = format!("{} bytes of text", length.saturating_sub(header.length));
        return Err(ImportError::malformed(path, "element vertex", found, format!("{} vertices", vertex.count)));
    }
    let reader = BufReader::with_capacity(1 << 18, file.reader(header.length));
    let mut lines = Lines { path, reader, line: Vec::new() };
    for element in before {
        for _ in 0..element.count {
            lines.next(&element.name)?;
        }
    }
    let mut scratch = Scratch::new(path);
    let mut samples = Vec::with_capacity(BATCH);
    for number in 1..=vertex.count {
        let text = lines.next(VERTEX)?;
        let mut words = text.split_ascii_whitespace();
        for property in &vertex.properties {
            let word = words.next().unwrap_or_default();
            if !property.number.parse_into(word, &mut samples) {
                let field = format!("vertex {number}: {}", property.name);
                let found: String = word.chars().filter(|c| !c.is_control()).take(40).collect();
                let found = if found.is_empty() { "nothing".into() } else { found };
                return Err(ImportError::malformed(
                    path,
                    field,
                    found,
                    format!("a number of type {}", property.number),
                ));
            }
        }
        if samples.len() >= BATCH {
            scratch.write(&samples)?;
            samples.clear();
        }
    }
    scratch.write(&samples)?;
    scratch.into_storage()
}

/// The lines of a text that are not empty.
struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    line: Vec<u8>,
}

impl<R: BufRead> Lines<'_, R> {
    /// The next, of an element of this name.
    fn next(&mut self, name: &str) -> Result<String, ImportError> {
        loop {
            self.line.clear();
            let read = (&mut self.reader).take(LONGEST_LINE).read_until(b'\n', &mut self.line);
            let read = read.map_err(|error| ImportError::io(self.path, format!("element {name}"), error))?;
            if read == 0 || read as u64 == LONGEST_LINE {
                let found = if read == 0 { "the file's end" } else { "a line without an end" };
                return Err(ImportError::malformed(self.path, format!("element {name}"), found, "a line for each"));
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(String::from_utf8_lossy(&self.line).into_owned());
            }
        }
    }
}
