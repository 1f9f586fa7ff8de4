//! Pictures as files: PNG for colours, EXR and NumPy arrays for the raw accumulation. A file appears under its name
//! only when it is complete.

use super::Accumulation;
use super::composite::Image;
use crate::color::Colors;
use crate::model::new_file;
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, WritableImage};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A picture that could not be written.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The file system refused.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The encoder refused.
    #[error("{}: cannot encode the picture: {message}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// What the encoder says.
        message: String,
    },
}

/// Above this files are a few percent smaller, and take more than twice as long.
const DEFLATE: png::DeflateCompression = png::DeflateCompression::Level(4);

/// Writes colours as an sRGB PNG.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_png(path: &Path, image: &Image) -> Result<(), OutputError> {
    write_with(path, |out| {
        encode_png(out, image).map_err(|error| match error {
            png::EncodingError::IoError(source) => refused(path)(source),
            error => encode(path)(error),
        })
    })
}

/// The bytes of such a file.
///
/// # Errors
/// What the encoder says of a picture without pixels.
pub fn png(image: &Image) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    encode_png(&mut bytes, image)?;
    Ok(bytes)
}

fn encode_png(out: impl Write, image: &Image) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(out, image.width, image.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_deflate_compression(DEFLATE);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.rgba.as_flattened())?;
    writer.finish()
}

/// Writes the raw channels `P` and, where there is one, `S` (not multiplied with `P`; 0 where nothing was drawn) as
/// 32-bit floats.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_exr(path: &Path, picture: &Accumulation) -> Result<(), OutputError> {
    let mut channels = vec![AnyChannel::new("P", FlatSamples::F32(picture.p.clone()))];
    if picture.has_attribute() {
        let s = (0..picture.p.len()).map(|index| picture.s(index).unwrap_or(0.0)).collect();
        channels.push(AnyChannel::new("S", FlatSamples::F32(s)));
    }
    write_channels(path, "accumulation", [picture.width, picture.height], channels)
}

/// Writes premultiplied colours in linear light as 32-bit floats, channels `R`, `G`, `B` and `A`.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_exr_colors(path: &Path, colors: &Colors) -> Result<(), OutputError> {
    let channel = |(k, name): (usize, &'static str)| {
        AnyChannel::new(name, FlatSamples::F32(colors.rgba.iter().map(|pixel| pixel[k]).collect()))
    };
    let channels = ["R", "G", "B", "A"].into_iter().enumerate().map(channel);
    write_channels(path, "colors", [colors.width, colors.height], channels)
}

/// The same with further channels of numbers, each with a value for each pixel; these are rounded to single precision.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_exr_with<const N: usize>(
    path: &Path,
    colors: &Colors,
    names: [&'static str; N],
    values: &[[f64; N]],
) -> Result<(), OutputError> {
    let color = |(k, name): (usize, &'static str)| {
        AnyChannel::new(name, FlatSamples::F32(colors.rgba.iter().map(|pixel| pixel[k]).collect()))
    };
    let number = |(k, name): (usize, &'static str)| {
        AnyChannel::new(name, FlatSamples::F32(values.iter().map(|pixel| pixel[k] as f32).collect()))
    };
    let all = ["R", "G", "B", "A"].into_iter().enumerate().map(color).chain(names.into_iter().enumerate().map(number));
    write_channels(path, "colors", [colors.width, colors.height], all)
}

fn write_channels(
    path: &Path,
    name: &str,
    size: [u32; 2],
    channels: impl IntoIterator<Item = AnyChannel<FlatSamples>>,
) -> Result<(), OutputError> {
    let layer = Layer::new(
        (size[0] as usize, size[1] as usize),
        LayerAttributes::named(name),
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(channels.into_iter().collect()),
    );
    let mut bytes = std::io::Cursor::new(Vec::new());
    // In one thread blocks are written in their order, so that the same picture is the same file.
    exr::prelude::Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).map_err(encode(path))?;
    write_atomically(path, bytes.get_ref())
}

/// Writes premultiplied colours in linear light as a float32 NumPy array of shape (height, width, 4), row 0 at the top.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_npy_colors(path: &Path, colors: &Colors) -> Result<(), OutputError> {
    let shape = [u64::from(colors.height), u64::from(colors.width), 4];
    write_array(path, &shape, colors.rgba.as_flattened())
}

/// Writes `P` as a float32 NumPy array of shape (height, width), row 0 at the top.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_npy(path: &Path, picture: &Accumulation) -> Result<(), OutputError> {
    write_npy_values(path, [picture.width, picture.height], &picture.p)
}

/// Writes a number for each pixel as a float32 NumPy array of shape (height, width), row 0 at the top.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_npy_values(path: &Path, size: [u32; 2], values: &[f32]) -> Result<(), OutputError> {
    let [width, height] = size.map(u64::from);
    write_array(path, &[height, width], values)
}

/// Writes doubles as a float64 NumPy array of this shape, the last axis fastest.
///
/// # Errors
/// [`OutputError`] with the file named.
pub fn write_npy_doubles(path: &Path, shape: &[u64], values: &[f64]) -> Result<(), OutputError> {
    write_array(path, shape, values)
}

fn write_array<T: npyz::AutoSerialize + Copy>(path: &Path, shape: &[u64], values: &[T]) -> Result<(), OutputError> {
    use npyz::WriterBuilder;
    write_with(path, |out| {
        let options = npyz::WriteOptions::<T>::new().default_dtype().shape(shape);
        let mut writer = options.writer(out).begin_nd().map_err(refused(path))?;
        writer.extend(values.iter().copied()).map_err(refused(path))?;
        writer.finish().map_err(refused(path))
    })
}

/// Writes bytes to a temporary file beside `path` and renames it.
///
/// # Errors
/// [`OutputError::Io`] with the file named.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write_with(path, |out| out.write_all(bytes).map_err(refused(path)))
}

fn write_with(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<&mut std::fs::File>) -> Result<(), OutputError>,
) -> Result<(), OutputError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file =
        new_file::builder().tempfile_in(folder).map_err(|error| refused(path)(new_file::without_name(&error)))?;
    let mut out = BufWriter::new(file.as_file_mut());
    content(&mut out)?;
    out.flush().map_err(refused(path))?;
    drop(out);
    file.persist(path).map_err(|error| refused(path)(error.error))?;
    Ok(())
}

fn refused(path: &Path) -> impl Fn(std::io::Error) -> OutputError + '_ {
    |source| OutputError::Io { path: path.to_owned(), source }
}

fn encode<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> OutputError + '_ {
    |error| OutputError::Encode { path: path.to_owned(), message: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Accumulation {
        Accumulation {
            width: 3,
            height: 2,
            p: vec![1.0, 2.0, 0.0, 4.0, 5.5, 6.0],
            ps: vec![2.0, 2.0, 0.0, 1.0, 1.0, 3.0],
        }
    }

    #[test]
    fn a_file_in_a_folder_that_is_not_there_is_told_by_its_own_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing").join("a.json");
        let error = write_atomically(&path, b"{}").unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: cannot be written: ", path.display())), "{error}");
        assert!(!error.contains(new_file::UNFINISHED) && !error.contains(" at path "), "{error}");
    }

    #[test]
    fn arrays_and_exr_read_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let npy = folder.path().join("p.npy");
        write_npy(&npy, &picture()).unwrap();
        let array = npyz::NpyFile::new(std::io::BufReader::new(std::fs::File::open(&npy).unwrap())).unwrap();
        assert_eq!(array.shape(), [2, 3]);
        assert_eq!(array.into_vec::<f32>().unwrap(), picture().p);

        let exr = folder.path().join("p.exr");
        write_exr(&exr, &picture()).unwrap();
        let image = exr::prelude::read_first_flat_layer_from_file(&exr).unwrap();
        let channel = |name: &str| {
            let found = image.layer_data.channel_data.list.iter().find(|channel| channel.name.eq(name)).unwrap();
            found.sample_data.values_as_f32().collect::<Vec<f32>>()
        };
        assert_eq!(channel("P"), picture().p);
        assert_eq!(channel("S")[4], 1.0 / 5.5);
    }

    #[test]
    fn a_failed_write_names_the_file_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no").join("such").join("p.png");
        let image = Image { width: 1, height: 1, rgba: vec![[0; 4]] };
        assert!(write_png(&path, &image).unwrap_err().to_string().contains("p.png"));
        // A picture whose size does not fit its pixels makes the encoder fail half-way.
        let broken = Image { width: 9, height: 9, rgba: vec![[0; 4]] };
        assert!(write_png(&folder.path().join("q.png"), &broken).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
