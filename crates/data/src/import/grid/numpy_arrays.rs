//! The arrays of NumPy files as they are, of any number of axes: what is time, a component or a coordinate is up to who reads them.

use super::content::{Content, LONGEST_HEADER, filled, in_one_line};
use super::npy::{Array, NPY};
use super::npy_header::NpyHeader;
use super::npz::NPZ;
use super::picture::seekable;
use super::{GridDescription, GridSource, part_name};
use crate::import::ImportError;
use crate::model::{Channel, Grid, ReadMethod, SampleType};
use std::io::{BufReader, Read};
use std::path::Path;
use zip::ZipArchive;
use zip::result::ZipError;

/// The most numbers that are read of an array with one axis.
const MOST_NUMBERS: u64 = 1 << 24;

/// An opened file of one array, or an archive of several.
pub(in crate::import) struct NumpyArrays {
    content: Content,
    /// Their names, empty of the only one of a file.
    arrays: Vec<(String, NpyHeader)>,
    is_archive: bool,
}

impl NumpyArrays {
    /// Opens a file, behind whose name an array in it may be named; `None` where it is none of NumPy's.
    ///
    /// # Errors
    /// When it cannot be read, or is damaged. Arrays of an archive that hold no numbers are left out.
    pub(in crate::import) fn open(path: &Path, method: ReadMethod) -> Result<Option<NumpyArrays>, ImportError> {
        if !part_name::parts(path).0.is_file() {
            return Ok(None);
        }
        let content = Content::open(path, method)?;
        if (NPY.detect)(&content) {
            let arrays = vec![(String::new(), NpyHeader::read(&content.path, &content.head)?)];
            return Ok(Some(NumpyArrays { content, arrays, is_archive: false }));
        }
        if !(NPZ.detect)(&content) {
            return Ok(None);
        }
        let mut arrays = Vec::new();
        let mut archive = archive(&content)?;
        for index in 0..archive.len() {
            let mut member = archive.by_index(index).map_err(|error| wrong(&content.path, &error))?;
            let name = in_one_line(&member.name().map_err(|error| wrong(&content.path, &error))?);
            let mut head = Vec::new();
            // What is damaged shows when the samples are read.
            let _ = (&mut member).take(LONGEST_HEADER as u64).read_to_end(&mut head);
            if let Ok(header) = NpyHeader::read(&content.path, &head) {
                arrays.push((name.trim_end_matches(".npy").to_owned(), header));
            }
        }
        Ok(Some(NumpyArrays { content, arrays, is_archive: true }))
    }

    /// The file.
    pub(in crate::import) fn path(&self) -> &Path {
        &self.content.path
    }

    /// The format's name.
    pub(in crate::import) fn format(&self) -> &'static str {
        if self.is_archive { NPZ.name } else { NPY.name }
    }

    /// Length of the file, bytes.
    pub(in crate::import) fn bytes(&self) -> u64 {
        self.content.length
    }

    /// The array that was named behind the file.
    pub(in crate::import) fn part(&self) -> Option<&str> {
        self.content.part.as_deref()
    }

    /// The names of all arrays with their shapes, the slowest axis first.
    pub(in crate::import) fn shapes(&self) -> impl Iterator<Item = (&str, &[u64])> {
        self.arrays.iter().map(|(name, header)| (name.as_str(), &header.sizes[..]))
    }

    /// The shape of the array of that name.
    pub(in crate::import) fn shape(&self, name: &str) -> Option<&[u64]> {
        self.shapes().find(|(own, _)| *own == name).map(|(_, shape)| shape)
    }

    /// The type of the numbers of the array of that name.
    pub(in crate::import) fn sample_type(&self, name: &str) -> Option<SampleType> {
        self.arrays.iter().find(|(own, _)| own == name).map(|(_, header)| header.kind)
    }

    /// The message that the array of that name has another shape.
    pub(in crate::import) fn wrong_shape(&self, name: &str, expected: &str) -> ImportError {
        match self.arrays.iter().find(|(own, _)| own == name) {
            Some((_, header)) => header.wrong_shape(&self.content.path, expected),
            None => self.missing(name),
        }
    }

    /// The message that there is no such array.
    pub(in crate::import) fn missing(&self, name: &str) -> ImportError {
        let names: Vec<&str> = self.shapes().map(|(name, _)| name).collect();
        let expected = if names.is_empty() { "an array of numbers".to_owned() } else { names.join(", ") };
        ImportError::missing(&self.content.path, format!("array {name}"), format!("one of {expected}"))
    }

    /// The numbers of an array as the samples of a volume of these sides, x first, of so many channels; as many as the array has.
    ///
    /// # Errors
    /// Where there is no such array, it has another size, its first axis is the fastest, or its numbers cannot be read.
    pub(in crate::import) fn volume(
        &self,
        name: &str,
        shape: [u64; 3],
        channels: u64,
    ) -> Result<GridSource, ImportError> {
        let path = &*self.content.path;
        let found = self.arrays.iter().find(|(own, _)| own == name);
        let (_, header) = found.ok_or_else(|| self.missing(name))?;
        if header.is_fortran && header.sizes.len() > 1 {
            return Err(ImportError::malformed(path, "fortran_order", "True", "False, the last axis the fastest"));
        }
        let product = |sides: &[u64]| sides.iter().try_fold(1_u64, |all, &side| all.checked_mul(side));
        if product(&header.sizes) != product(&[shape[0], shape[1], shape[2], channels]) {
            let expected = format!("as many numbers as {} x {} x {} of {channels}", shape[0], shape[1], shape[2]);
            return Err(header.wrong_shape(path, &expected));
        }
        let grid = Grid::volume(shape, header.kind, Channel::numbered(channels));
        let array = Array::of(path, header, grid)?;
        let about = GridDescription::new(path, self.format(), self.content.length, array.grid.clone());
        if !self.is_archive {
            let storage = self.content.samples(array.start, array.bytes, &array.grid)?;
            let offset = if self.content.is_packed { 0 } else { array.start };
            return Ok(GridSource::new(about, storage, array.layout(offset)));
        }
        let mut archive = archive(&self.content)?;
        for index in 0..archive.len() {
            let mut member = archive.by_index(index).map_err(|error| wrong(path, &error))?;
            if in_one_line(&member.name().map_err(|error| wrong(path, &error))?).trim_end_matches(".npy") != name {
                continue;
            }
            let packed = member.compressed_size().min(self.content.most());
            self.content.check_packed(packed, array.bytes, &array.grid)?;
            // Behind the header.
            let _ = std::io::copy(&mut (&mut member).take(array.start), &mut std::io::sink());
            let storage = filled(member, path, array.bytes, &array.grid)?;
            return Ok(GridSource::new(about, storage, array.layout(0)));
        }
        Err(self.missing(name))
    }

    /// The numbers of an array with one axis.
    ///
    /// # Errors
    /// Where it has more axes, there is no such array, or it cannot be read.
    pub(in crate::import) fn numbers(&self, name: &str) -> Result<Vec<f64>, ImportError> {
        let Some(&[count @ 1..=MOST_NUMBERS]) = self.shape(name) else {
            return Err(self.wrong_shape(name, "one axis"));
        };
        let source = self.volume(name, [count, 1, 1], 1)?;
        let grid = source.grid();
        let mut bytes = vec![0; count as usize * grid.sample_type.size()];
        source.read(&grid.region(), &mut bytes)?;
        let mut values = Vec::with_capacity(count as usize);
        grid.sample_type.decode(&bytes, 1, &mut values);
        Ok(values)
    }
}

type Archive = ZipArchive<BufReader<Box<dyn super::picture::SeekRead>>>;

fn archive(content: &Content) -> Result<Archive, ImportError> {
    ZipArchive::new(BufReader::new(seekable(content)?)).map_err(|error| wrong(&content.path, &error))
}

fn wrong(path: &Path, error: &ZipError) -> ImportError {
    ImportError::malformed(path, "archive", in_one_line(error), "a ZIP archive")
}
