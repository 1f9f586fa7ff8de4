//! Legacy files of points: text or big-endian numbers between lines of text
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html>).

use super::arrays::{Arrays, MOST_ARRAYS, MOST_COMPONENTS, Pieces, Place};
use crate::import::ImportError;
use crate::import::bytes::{Order, RangeFile};
use crate::import::grid::scratch::{Scratch, Storage};
use crate::import::grid::{Content, Entry, VTK_TYPES, sample_type};
use crate::model::SampleType;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The longest line and the longest number, bytes.
const LONGEST_LINE: u64 = 1 << 16;
const LONGEST_WORD: usize = 400;

/// Numbers parsed before they are put away, bytes.
const BATCH: usize = 1 << 16;

/// The version of files whose cells are two arrays.
const OFFSETS: f64 = 5.1;

/// The arrays of the points.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn open(content: &Content) -> Result<Pieces, ImportError> {
    let path = &*content.path;
    let mut reader = Reader::new(content)?;
    let version = reader.line()?.unwrap_or_default();
    let version: f64 = version.rsplit(' ').next().and_then(|version| version.parse().ok()).unwrap_or(3.0);
    // The title may be empty.
    reader.raw_line()?;
    let coding = reader.line()?.unwrap_or_default();
    reader.is_text = match &*coding.to_ascii_uppercase() {
        "ASCII" => true,
        "BINARY" => false,
        _ => return Err(Entry { path, name: "coding", text: &coding }.wrong("BINARY or ASCII")),
    };
    let mut arrays = Arrays::default();
    if !reader.is_text {
        reader.storages.push(Storage::File(RangeFile::of(path, content.file()?, content.method())?));
    }
    // Whether data that follow are of points.
    let mut data: Option<bool> = None;
    let mut number = 0;
    while let Some(line) = reader.line()? {
        let words: Vec<&str> = line.split_whitespace().collect();
        let keyword = words.first().map(|word| word.to_ascii_uppercase()).unwrap_or_default();
        let wrong = |expected: &str| Entry { path, name: "line", text: &line }.wrong(expected);
        let value = |text: &str| text.parse::<u64>().map_err(|_| wrong("a number"));
        let of_points = data == Some(true);
        match (&*keyword, words.get(1..).unwrap_or_default()) {
            ("DATASET", _) => {}
            ("POINTS", [count, kind, ..]) => {
                if arrays.count > 0 {
                    return Err(wrong("points once"));
                }
                arrays.count = value(count)?;
                if arrays.count == 0 {
                    return Err(ImportError::NoParticles { path: path.into(), field: "POINTS".into() });
                }
                let place = reader.array(arrays.count, number_type(path, kind)?, 3)?;
                arrays.push_points(&place);
            }
            ("VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" | "CELLS", [first, second, ..]) => {
                let lengths = [value(first)?, value(second)?];
                if version < OFFSETS {
                    reader.skip(SampleType::I32, lengths[1])?;
                    continue;
                }
                for length in lengths {
                    let head = reader.line()?.unwrap_or_default();
                    let kind = head.split_whitespace().nth(1).unwrap_or_default();
                    reader.skip(number_type(path, kind)?, length)?;
                }
            }
            ("CELL_TYPES", [count, ..]) => reader.skip(SampleType::I32, value(count)?)?,
            (kind @ ("POINT_DATA" | "CELL_DATA"), [count, ..]) => {
                let is_points = kind == "POINT_DATA";
                if is_points && value(count)? != arrays.count {
                    return Err(wrong(&format!("{} points", arrays.count)));
                }
                data = Some(is_points);
                reader.cells = value(count)?;
            }
            ("FIELD", [_, count, ..]) => {
                for _ in 0..value(count)? {
                    let head = reader.line_of_array()?;
                    let words: Vec<&str> = head.split_whitespace().collect();
                    let wrong = |expected: &str| Entry { path, name: "FIELD", text: &head }.wrong(expected);
                    let [name, components, tuples, kind, ..] = words[..] else {
                        return Err(wrong("name, components, tuples and type"));
                    };
                    let value = |text: &str| text.parse::<u64>().map_err(|_| wrong("a number"));
                    let (components, tuples) = (value(components)?, value(tuples)?);
                    let all = components.checked_mul(tuples).ok_or_else(|| wrong("fewer numbers"))?;
                    number += 1;
                    if kind.eq_ignore_ascii_case("string") {
                        reader.skip_texts(all)?;
                        arrays.left_out.extend(of_points.then(|| decoded(name)));
                    } else if of_points && tuples == arrays.count {
                        reader.data(&mut arrays, (name, number), number_type(path, kind)?, components)?;
                    } else {
                        reader.skip(number_type(path, kind)?, all)?;
                    }
                }
            }
            ("LOOKUP_TABLE", [_, size, ..]) => {
                let all = value(size)?.checked_mul(4).ok_or_else(|| wrong("fewer colours"))?;
                reader.skip(SampleType::U8, all)?;
            }
            ("METADATA", _) => reader.skip_paragraph()?,
            (keyword, [name, rest @ ..]) => {
                let (components, kind) = match (keyword, rest) {
                    ("SCALARS", [kind]) => (1, number_type(path, kind)?),
                    ("SCALARS", [kind, components, ..]) => (value(components)?, number_type(path, kind)?),
                    ("VECTORS" | "NORMALS", [kind, ..]) => (3, number_type(path, kind)?),
                    ("TENSORS", [kind, ..]) => (9, number_type(path, kind)?),
                    ("TENSORS6", [kind, ..]) => (6, number_type(path, kind)?),
                    ("GLOBAL_IDS" | "PEDIGREE_IDS", [kind, ..]) => (1, number_type(path, kind)?),
                    ("TEXTURE_COORDINATES", [components, kind, ..]) => (value(components)?, number_type(path, kind)?),
                    ("COLOR_SCALARS", [components, ..]) => {
                        // As text they are fractions.
                        (value(components)?, if reader.is_text { SampleType::F32 } else { SampleType::U8 })
                    }
                    _ => return Err(wrong("points, cells or data of them")),
                };
                if keyword == "SCALARS" {
                    let table = reader.line()?.unwrap_or_default();
                    if !table.to_ascii_uppercase().starts_with("LOOKUP_TABLE") {
                        return Err(Entry { path, name: "SCALARS", text: &table }.wrong("LOOKUP_TABLE"));
                    }
                }
                number += 1;
                match data {
                    Some(true) => reader.data(&mut arrays, (*name, number), kind, components)?,
                    Some(false) => {
                        let all = components.checked_mul(reader.cells).ok_or_else(|| wrong("fewer numbers"))?;
                        reader.skip(kind, all)?;
                    }
                    None => return Err(wrong("POINT_DATA or CELL_DATA before")),
                }
            }
            _ => return Err(wrong("points, cells or data of them")),
        }
    }
    Ok(Pieces { arrays: vec![arrays], storages: reader.storages, files: 1, bytes: content.length })
}

/// The type of numbers of that name.
fn number_type(path: &Path, name: &str) -> Result<SampleType, ImportError> {
    let name = name.to_ascii_lowercase();
    // Indices, which are written as whole numbers of 4 bytes.
    if name == "vtkidtype" {
        return Ok(SampleType::I32);
    }
    sample_type(Entry { path, name: "type", text: &name }, VTK_TYPES)
}

/// The name of an array in one line: blanks and such are written as `%20`.
fn decoded(name: &str) -> String {
    let (mut bytes, mut rest) = (Vec::new(), name.as_bytes());
    while let [first, after @ ..] = rest {
        let digits = after.get(..2).filter(|_| *first == b'%').and_then(|digits| std::str::from_utf8(digits).ok());
        let code = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(code.unwrap_or(*first));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    String::from_utf8_lossy(&bytes).chars().filter(|letter| !letter.is_control()).collect()
}

/// A file that is read from its beginning to its end.
struct Reader<'a> {
    path: &'a Path,
    reader: BufReader<Box<dyn Read>>,
    /// The byte that is next.
    at: u64,
    is_text: bool,
    /// Number of cells that data are of.
    cells: u64,
    word: Vec<u8>,
    /// Where arrays are.
    storages: Vec<Storage>,
}

impl<'a> Reader<'a> {
    fn new(content: &'a Content) -> Result<Reader<'a>, ImportError> {
        let reader = BufReader::with_capacity(1 << 18, content.reader(0)?);
        let (word, storages) = (Vec::new(), Vec::new());
        Ok(Reader { path: &content.path, reader, at: 0, is_text: true, cells: 0, word, storages })
    }

    /// The next line, without space around it; `None` at the end.
    fn raw_line(&mut self) -> Result<Option<String>, ImportError> {
        let mut line = Vec::new();
        let read = (&mut self.reader).take(LONGEST_LINE).read_until(b'\n', &mut line);
        let read = read.map_err(|error| ImportError::io(self.path, "line", error))? as u64;
        self.at += read;
        if read == LONGEST_LINE {
            let expected = format!("an end in the first {LONGEST_LINE} bytes");
            return Err(ImportError::malformed(self.path, "line", "a line without an end", expected));
        }
        Ok((read > 0).then(|| String::from_utf8_lossy(&line).trim().to_owned()))
    }

    /// The next line that is not empty.
    fn line(&mut self) -> Result<Option<String>, ImportError> {
        loop {
            match self.raw_line()? {
                Some(line) if line.is_empty() => {}
                found => return Ok(found),
            }
        }
    }

    /// The line in front of an array of a field, behind what is said about the one before.
    fn line_of_array(&mut self) -> Result<String, ImportError> {
        loop {
            match self.line()? {
                Some(line) if line.eq_ignore_ascii_case("METADATA") => self.skip_paragraph()?,
                Some(line) => return Ok(line),
                None => return Err(ImportError::missing(self.path, "FIELD", "more arrays")),
            }
        }
    }

    /// Leaves out everything up to an empty line.
    fn skip_paragraph(&mut self) -> Result<(), ImportError> {
        while self.raw_line()?.is_some_and(|line| !line.is_empty()) {}
        Ok(())
    }

    /// Reads the next word of text. False at the end.
    fn next_word(&mut self) -> Result<bool, ImportError> {
        self.word.clear();
        loop {
            let buffer = self.reader.fill_buf().map_err(|error| ImportError::io(self.path, "numbers", error))?;
            if buffer.is_empty() {
                return Ok(!self.word.is_empty());
            }
            let is_space = |byte: &&u8| byte.is_ascii_whitespace();
            let skipped = if self.word.is_empty() { buffer.iter().take_while(is_space).count() } else { 0 };
            let rest = &buffer[skipped..];
            // The space behind a word is left where it is: it may end the line.
            let end = rest.iter().position(|byte| byte.is_ascii_whitespace());
            let length = end.unwrap_or(rest.len());
            self.word.extend_from_slice(&rest[..length]);
            self.reader.consume(skipped + length);
            self.at += (skipped + length) as u64;
            if self.word.len() > LONGEST_WORD {
                return Err(ImportError::malformed(self.path, "numbers", "a long word", "numbers"));
            }
            if end.is_some() && !self.word.is_empty() {
                return Ok(true);
            }
        }
    }

    fn too_few(&self, expected: u64) -> ImportError {
        let found = format!("the file's end at byte {}", self.at);
        ImportError::malformed(self.path, "numbers", found, format!("{expected} numbers"))
    }

    /// Leaves out numbers.
    fn skip(&mut self, number: SampleType, count: u64) -> Result<(), ImportError> {
        if self.is_text {
            for _ in 0..count {
                if !self.next_word()? {
                    return Err(self.too_few(count));
                }
            }
            return Ok(());
        }
        let bytes = count.checked_mul(number.size() as u64).ok_or_else(|| self.too_few(count))?;
        let skipped = std::io::copy(&mut (&mut self.reader).take(bytes), &mut std::io::sink());
        let skipped = skipped.map_err(|error| ImportError::io(self.path, "numbers", error))?;
        self.at += skipped;
        if skipped < bytes { Err(self.too_few(count)) } else { Ok(()) }
    }

    /// Leaves out texts: lines, or bytes behind a length, of which the first two bits say how many bytes it has.
    fn skip_texts(&mut self, count: u64) -> Result<(), ImportError> {
        for _ in 0..count {
            if self.is_text {
                self.raw_line()?.ok_or_else(|| self.too_few(count))?;
                continue;
            }
            let mut length = [0; 8];
            self.fill(&mut length[..1], count)?;
            let bytes = [8, 4, 2, 1][usize::from(length[0] >> 6)];
            self.fill(&mut length[1..bytes], count)?;
            length[0] &= 0x3f;
            self.skip(SampleType::U8, length[..bytes].iter().fold(0, |sum, byte| sum << 8 | u64::from(*byte)))?;
        }
        Ok(())
    }

    /// The next bytes, of `expected` numbers or texts.
    fn fill(&mut self, out: &mut [u8], expected: u64) -> Result<(), ImportError> {
        self.reader.read_exact(out).map_err(|_| self.too_few(expected))?;
        self.at += out.len() as u64;
        Ok(())
    }

    /// Reads an array of so many numbers a point, or leaves it out where there are too many.
    fn data(
        &mut self,
        arrays: &mut Arrays,
        (name, number): (&str, usize),
        kind: SampleType,
        components: u64,
    ) -> Result<(), ImportError> {
        let name = decoded(name);
        if !(1..=MOST_COMPONENTS).contains(&components) || number > MOST_ARRAYS {
            arrays.left_out.push(name);
            let all = components.checked_mul(arrays.count).ok_or_else(|| self.too_few(arrays.count))?;
            return self.skip(kind, all);
        }
        let place = self.array(arrays.count, kind, components)?;
        arrays.push(&name, number, &place);
        Ok(())
    }

    /// Where the numbers of all points are: in the file, or parsed.
    fn array(&mut self, points: u64, kind: SampleType, components: u64) -> Result<Place, ImportError> {
        let all = components.checked_mul(points).ok_or_else(|| self.too_few(points))?;
        if !self.is_text {
            let offset = self.at;
            self.skip(kind, all)?;
            return Ok(Place { storage: 0, offset, number: kind, order: Order::Big, components });
        }
        let mut scratch = Scratch::new(self.path);
        let mut samples = Vec::with_capacity(BATCH);
        for number in 1..=all {
            if !self.next_word()? {
                return Err(self.too_few(all));
            }
            let word = String::from_utf8_lossy(&self.word);
            if !kind.parse_into(&word, &mut samples) {
                let found: String = word.chars().filter(|letter| !letter.is_control()).take(40).collect();
                let expected = format!("a number of type {kind}");
                return Err(ImportError::malformed(self.path, format!("numbers: number {number}"), found, expected));
            }
            if samples.len() >= BATCH {
                scratch.write(&samples)?;
                samples.clear();
            }
        }
        scratch.write(&samples)?;
        self.storages.push(scratch.into_storage()?);
        let storage = self.storages.len() - 1;
        Ok(Place { storage, offset: 0, number: kind, order: Order::NATIVE, components })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_as_they_were_before_they_were_written() {
        for (written, expected) in [("mass", "mass"), ("a%20text%25", "a text%"), ("50%", "50%"), ("%zz%0Ab", "%zzb")] {
            assert_eq!(decoded(written), expected);
        }
    }
}
