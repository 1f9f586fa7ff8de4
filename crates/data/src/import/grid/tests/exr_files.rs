//! Small OpenEXR files.

use super::files::{Case, volume};
use crate::model::SampleType;
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage, f16};

/// A layer of 6 x 5 pixels.
pub fn exr(channels: Vec<(&str, FlatSamples)>, encoding: Encoding) -> Vec<u8> {
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples));
    let layer = Layer::new((6, 5), LayerAttributes::named("layer"), encoding, AnyChannels::sort(channels.collect()));
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn value(channel: usize, pixel: usize) -> f32 {
    (channel * 100 + pixel) as f32 * 0.25
}

/// Colours as floats of which blue is of half precision, compressed.
pub fn every() -> Vec<Case> {
    let floats = |channel: usize| FlatSamples::F32((0..30).map(|pixel| value(channel, pixel)).collect());
    let halves = |channel: usize| FlatSamples::F16((0..30).map(|pixel| f16::from_f32(value(channel, pixel))).collect());
    let colours = |name, encoding| Case {
        shape: vec![6, 5],
        sample_type: SampleType::F32,
        channels: 3,
        samples: (0..30).flat_map(|pixel| (0..3).flat_map(move |c| value(c, pixel).to_ne_bytes())).collect(),
        spacing: None,
        ..volume(name, exr(vec![("R", floats(0)), ("G", floats(1)), ("B", halves(2))], encoding))
    };
    vec![colours("zip.exr", Encoding::SMALL_LOSSLESS), colours("plain.exr", Encoding::UNCOMPRESSED)]
}
