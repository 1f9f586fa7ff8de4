//! What OME and ImageJ write into a first page's description: how far pixels and slices are apart, and which pages are channels.

use super::super::layout::PLANAR;
use super::super::source::MOST_CHANNELS;
use crate::model::{Channel, Grid, Unit};
use glam::{DAffine3, DVec3};
use std::io::{Read, Seek};
use tiff::decoder::Decoder;
use tiff::decoder::ifd::Value;
use tiff::tags::Tag;

/// A page for each channel of a slice, then those of the next slice.
const BY_SLICE: [usize; 4] = [1, 2, 0, 3];

/// What a description says.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Stack {
    /// Channels, slices and times.
    counts: [u64; 3],
    /// Names of channels, where they have any.
    names: Vec<String>,
    /// Whether all slices of a channel come before those of the next.
    is_by_channel: bool,
    /// From a pixel and from a slice to the next, where that is stated with a unit.
    steps: [Option<f64>; 3],
    unit: &'static str,
}

impl Stack {
    /// Reads the description of a page; nothing where neither program wrote it.
    pub(super) fn read<R: Read + Seek>(decoder: &mut Decoder<R>) -> Option<Stack> {
        let text = decoder.find_tag(Tag::ImageDescription).ok().flatten()?.into_string().ok()?;
        let mut size = |tag: Tag| match decoder.find_tag(tag).ok().flatten()? {
            Value::Rational(pixels, lengths) if pixels > 0 => Some(f64::from(lengths) / f64::from(pixels)),
            _ => None,
        };
        let sizes = [size(Tag::XResolution), size(Tag::YResolution)];
        Stack::of(&text, sizes)
    }

    /// Of a description and the sizes of pixels that other entries tell, in the unit that the description names.
    fn of(text: &str, sizes: [Option<f64>; 2]) -> Option<Stack> {
        if text.starts_with("ImageJ=") { Some(Stack::image_j(text, sizes)) } else { Stack::ome(text) }
    }

    fn image_j(text: &str, [x, y]: [Option<f64>; 2]) -> Stack {
        let value = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
        let count = |name: &str| value(name).map_or(Some(1), |value| value.trim().parse::<u64>().ok()).unwrap_or(0);
        let unit = value("unit").and_then(length);
        let spacing = value("spacing").and_then(|value| value.trim().parse::<f64>().ok());
        Stack {
            counts: ["channels", "slices", "frames"].map(count),
            steps: if unit.is_some() { [x, y, spacing] } else { [None; 3] },
            unit: unit.unwrap_or_default(),
            ..Stack::default()
        }
    }

    fn ome(text: &str) -> Option<Stack> {
        if !text.contains("<OME") {
            return None;
        }
        let mut images = text.split("<Pixels").skip(1);
        let pixels = tag(images.next()?);
        // Several images are as much as none: whose pages are whose is not told here.
        let is_one = images.next().is_none();
        let count =
            |name: &str| attribute(&pixels, name).filter(|_| is_one).and_then(|value| value.parse::<u64>().ok());
        let order = attribute(&pixels, "DimensionOrder").unwrap_or("XYZCT");
        let units = ["X", "Y", "Z"].map(|axis| match attribute(&pixels, &format!("PhysicalSize{axis}Unit")) {
            Some(unit) => length(unit),
            None => Some("um"),
        });
        let unit = units[0].filter(|_| units.iter().all(|unit| *unit == units[0]));
        let step = |axis: &str| attribute(&pixels, &format!("PhysicalSize{axis}"))?.parse::<f64>().ok();
        let names = text.split("<Channel ").skip(1).map(|part| attribute(&tag(part), "Name").map(str::to_owned));
        Some(Stack {
            counts: ["SizeC", "SizeZ", "SizeT"].map(|name| count(name).unwrap_or(0)),
            names: names.flatten().collect(),
            is_by_channel: order.find('Z') < order.find('C'),
            steps: if unit.is_some() { ["X", "Y", "Z"].map(step) } else { [None; 3] },
            unit: unit.unwrap_or_default(),
        })
    }

    /// So many pages like `one` as an image or a volume, and the order of their axes in the file where pages are channels; `None` where the counts
    /// are not those of the pages, or there are several times, or more channels than a sample may have.
    pub(super) fn arranged(&self, one: &Grid, pages: u64) -> Option<(Grid, Option<[usize; 4]>)> {
        let samples = one.channels.len() as u64;
        let [channels, slices, times] = self.counts;
        // Values that are side by side in a page are channels, too.
        let channels = if samples > 1 && channels == samples { 1 } else { channels };
        let are_too_many = samples > 1 && channels > 1 || channels > MOST_CHANNELS as u64;
        if times != 1 || channels.checked_mul(slices) != Some(pages) || are_too_many {
            return None;
        }
        let own = if channels == 1 { one.channels.clone() } else { self.channels(channels) };
        let grid = match slices {
            1 => Grid { channels: own, ..one.clone() },
            _ => Grid::volume([one.shape[0], one.shape[1], slices], one.sample_type, own),
        };
        let axes = if self.is_by_channel { PLANAR } else { BY_SLICE };
        Some((grid, (channels > 1).then_some(axes)))
    }

    /// Channels by their names, where each has one of its own.
    fn channels(&self, count: u64) -> Vec<Channel> {
        let mut different = self.names.clone();
        different.sort_unstable();
        different.dedup();
        let is_named = different.len() == self.names.len() && different.iter().all(|name| !name.trim().is_empty());
        match is_named && self.names.len() as u64 == count {
            true => self.names.iter().map(|name| Channel::new(name.as_str())).collect(),
            false => Channel::numbered(count),
        }
    }

    /// Gives a grid the steps that are stated.
    pub(super) fn scale(&self, grid: &mut Grid) {
        let [Some(x), Some(y), z] = self.steps else { return };
        let steps = [x, y, z.unwrap_or(x)];
        if steps.iter().all(|step| *step > 0.0 && step.is_finite()) {
            grid.to_world = DAffine3::from_scale(DVec3::from_array(steps)) * grid.to_world;
            grid.length_unit = Unit::new(self.unit);
        }
    }

    /// What becomes of pages that are not arranged as the description says, in a sentence.
    pub(super) fn unlike(&self, pages: u64) -> String {
        let [channels, slices, times] = self.counts;
        format!(
            "{pages} pages are slices, where the description says {channels} channels, {slices} slices and {times} times"
        )
    }
}

/// What is in a tag, with plain spaces and quotes.
fn tag(text: &str) -> String {
    text.split('>').next().unwrap_or_default().replace(char::is_whitespace, " ").replace('\'', "\"")
}

/// An attribute of a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = format!(" {tag}").find(&format!(" {name}=\"")).map(|at| tag.split_at(at))?;
    rest.split('"').nth(1)
}

/// A unit of length as either program writes it.
fn length(name: &str) -> Option<&'static str> {
    match name.trim() {
        "micron" | "microns" | "um" | "µm" | "μm" | "\\u00B5m" => Some("um"),
        "nm" => Some("nm"),
        "mm" => Some("mm"),
        "cm" => Some("cm"),
        "m" => Some("m"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SampleType;

    const OME: &str = "<?xml version=\"1.0\"?><OME xmlns=\"x\"><Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" DimensionOrder='XYZCT'\n \
                       SizeX=\"6\" SizeY=\"5\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\" PhysicalSizeX=\"0.1\" PhysicalSizeY=\"0.2\" \
                       PhysicalSizeZ=\"0.5\"><Channel ID=\"Channel:0:0\" Name=\"DAPI\"/><Channel ID=\"Channel:0:1\" Name=\"GFP\"/>\
                       </Pixels></Image></OME>";

    #[test]
    fn ome_tells_channels_slices_and_steps() {
        let stack = Stack::of(OME, [None; 2]).unwrap();
        assert_eq!((stack.counts, stack.is_by_channel, stack.unit), ([2, 3, 1], true, "um"));
        assert_eq!(stack.steps, [Some(0.1), Some(0.2), Some(0.5)]);
        let one = Grid::image([6, 5], SampleType::U16, Channel::of_picture(1));
        let (mut grid, axes) = stack.arranged(&one, 6).unwrap();
        assert_eq!((grid.shape, axes), ([6, 5, 3], Some(PLANAR)));
        assert_eq!(grid.channels, [Channel::new("DAPI"), Channel::new("GFP")]);
        stack.scale(&mut grid);
        assert_eq!(grid.length_unit, Unit::new("um"));
        assert_eq!(grid.to_world.transform_point3(DVec3::ONE), DVec3::new(0.1, 0.2, 0.5));
        let mixed = Stack::of(&OME.replace("XYZCT", "XYCZT"), [None; 2]).unwrap();
        assert_eq!(mixed.arranged(&one, 6).unwrap().1, Some(BY_SLICE));
        // Another number of pages, several times, and several images leave pages as slices.
        assert_eq!(stack.arranged(&one, 7), None);
        assert!(stack.unlike(7).starts_with("7 pages are slices, where the description says 2 channels, 3 slices"));
        let times = OME.replace("SizeT=\"1\"", "SizeT=\"2\"");
        for text in [&times, &OME.replace("</Image>", "</Image><Image><Pixels SizeC=\"1\"/></Image>")] {
            assert_eq!(Stack::of(text, [None; 2]).unwrap().arranged(&one, 12), None, "{text}");
        }
        // Steps in different units are none.
        let units = OME.replace("PhysicalSizeZ=", "PhysicalSizeZUnit=\"mm\" PhysicalSizeZ=");
        assert_eq!(Stack::of(&units, [None; 2]).unwrap().steps, [None; 3]);
        // Colours within a page are its channels.
        let picture = Grid::image([6, 5], SampleType::U8, Channel::of_picture(2));
        let (colored, axes) = stack.arranged(&picture, 3).unwrap();
        assert_eq!((colored.shape, colored.channels.len(), axes), ([6, 5, 3], 2, None));
    }

    #[test]
    fn image_j_tells_channels_slices_and_steps() {
        let text =
            "ImageJ=1.53t\nimages=6\nchannels=2\nslices=3\nhyperstack=true\nunit=\\u00B5m\nspacing=0.5\nloop=false\n";
        let stack = Stack::of(text, [Some(0.1), Some(0.2)]).unwrap();
        assert_eq!((stack.counts, stack.unit), ([2, 3, 1], "um"));
        assert_eq!(stack.steps, [Some(0.1), Some(0.2), Some(0.5)]);
        let one = Grid::image([6, 5], SampleType::U16, Channel::of_picture(1));
        let (grid, axes) = stack.arranged(&one, 6).unwrap();
        assert_eq!((grid.shape, axes), ([6, 5, 3], Some(BY_SLICE)));
        assert_eq!(grid.channels, Channel::numbered(2));
        // Dots on paper are no lengths of the specimen.
        let plain = Stack::of("ImageJ=1.53t\nimages=6\nslices=6\n", [Some(1.0 / 72.0); 2]).unwrap();
        assert_eq!((plain.steps, plain.arranged(&one, 6).unwrap().1), ([None; 3], None));
        assert_eq!(Stack::of("{\"shape\": [6, 5]}", [None; 2]), None);
    }
}
