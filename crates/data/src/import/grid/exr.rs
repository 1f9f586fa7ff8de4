//! OpenEXR: the first layer of flat samples, as an image of floats or whole numbers of 32 bits.

use super::choice::shown;
use super::content::{Content, in_one_line};
use super::layout::{Layout, NATIVE, PLANAR};
use super::picture::seekable;
use super::scratch::Scratch;
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::model::{Channel, Grid, SampleType};
use exr::meta::MetaData;
use exr::meta::attribute::SampleType as Stored;
use exr::meta::header::Header;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
use std::io::BufReader;

/// EXR; half precision becomes single. Deep samples, and channels with fewer samples than others, are named as unsupported.
pub(super) const EXR: GridFormat = GridFormat {
    name: "exr",
    extensions: &["exr"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"\x76\x2f\x31\x01"),
    open,
};

/// The channels of pictures by their names in a file, in the order of a picture's.
const PICTURES: [&[&str]; 4] = [&["Y"], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]];

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let wrong = |field: &str, error: exr::error::Error| {
        ImportError::malformed(path, field, in_one_line(&error), "an OpenEXR picture")
    };
    let meta = MetaData::read_from_buffered(BufReader::new(seekable(content)?), false);
    let meta = meta.map_err(|error| wrong("header", error))?;
    let flat = || ImportError::malformed(path, "header", "deep samples", "a layer of flat ones");
    let header = meta.headers.iter().find(|header| !header.deep).ok_or_else(flat)?;
    let (grid, order) = described(content, header)?;
    let bytes = checked(path, &grid, "dataWindow", "dataWindow")?;
    // Every block has a place in a table, whatever is in it.
    content.check_packed(content.most(), bytes.max(8 * header.chunk_count as u64), &grid)?;
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let reader = reader.all_attributes().non_parallel();
    let image = reader.from_buffered(BufReader::new(seekable(content)?)).map_err(|error| wrong("data", error))?;
    let channels = &image.layer_data.channel_data.list;
    let samples = grid.shape[0] * grid.shape[1];
    let mut scratch = Scratch::new(path);
    for (index, name) in order {
        let found = channels.get(index).filter(|channel| channel.name.to_string() == name);
        let found = found.filter(|channel| channel.sample_data.len() as u64 == samples);
        let found = found.ok_or_else(|| ImportError::missing(path, shown(&name), format!("{samples} samples")))?;
        scratch.write(&values(&found.sample_data, grid.sample_type))?;
    }
    let layout = Layout::packed(&grid, PLANAR, 0, NATIVE);
    let mut about = GridDescription::new(path, EXR.name, content.length, grid);
    if header.channels.list.iter().any(|channel| channel.sample_type == Stored::F16) {
        about.notes.push("values of half precision as single precision".into());
    }
    if meta.headers.len() > 1 {
        about.notes.push(format!("the first of {} layers", meta.headers.len()));
    }
    Ok(GridSource::new(about, scratch.into_storage()?, layout))
}

/// The grid of a layer, and where in the file each of its channels is, with its name.
fn described(content: &Content, header: &Header) -> Result<(Grid, Vec<(usize, String)>), ImportError> {
    let list = &header.channels.list;
    if let Some(channel) = list.iter().find(|channel| (channel.sampling.0, channel.sampling.1) != (1, 1)) {
        let found = format!("one sample for {} x {} pixels", channel.sampling.0, channel.sampling.1);
        let field = shown(&channel.name.to_string());
        return Err(ImportError::malformed(&content.path, field, found, "one for each pixel"));
    }
    let is_whole = |stored: &Stored| *stored == Stored::U32;
    let kind = match (list.iter().any(|channel| is_whole(&channel.sample_type)), header.channels.uniform_sample_type) {
        (false, _) => SampleType::F32,
        (true, Some(_)) => SampleType::U32,
        // Both fit into it.
        (true, None) => SampleType::F64,
    };
    let names: Vec<String> = list.iter().map(|channel| channel.name.to_string()).collect();
    let is_picture = |picture: &&[&str]| {
        picture.len() == names.len() && picture.iter().all(|name| names.iter().any(|own| own == name))
    };
    let (channels, names): (Vec<Channel>, Vec<String>) = match PICTURES.iter().find(|picture| is_picture(picture)) {
        Some(picture) => (Channel::of_picture(names.len() as u64), picture.iter().map(ToString::to_string).collect()),
        None => (names.iter().map(|name| Channel::new(shown(name))).collect(), names),
    };
    let place =
        |name: String| (list.iter().position(|channel| channel.name.to_string() == name).unwrap_or(usize::MAX), name);
    let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
    Ok((Grid::image([width, height], kind, channels), names.into_iter().map(place).collect()))
}

/// Samples of one channel as this type, in this machine's byte order.
fn values(samples: &FlatSamples, kind: SampleType) -> Vec<u8> {
    match (samples, kind) {
        (FlatSamples::U32(values), SampleType::U32) => values.iter().flat_map(|value| value.to_ne_bytes()).collect(),
        (FlatSamples::U32(values), _) => values.iter().flat_map(|value| f64::from(*value).to_ne_bytes()).collect(),
        (FlatSamples::F16(values), SampleType::F64) => {
            values.iter().flat_map(|value| value.to_f64().to_ne_bytes()).collect()
        }
        (FlatSamples::F16(values), _) => values.iter().flat_map(|value| value.to_f32().to_ne_bytes()).collect(),
        (FlatSamples::F32(values), SampleType::F64) => {
            values.iter().flat_map(|value| f64::from(*value).to_ne_bytes()).collect()
        }
        (FlatSamples::F32(values), _) => values.iter().flat_map(|value| value.to_ne_bytes()).collect(),
    }
}
