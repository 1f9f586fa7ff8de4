//! What GeoTIFF and GDAL say of an image: where it is, and which value stands for none.

use crate::model::Grid;
use glam::{DAffine3, DVec3};
use std::io::{Read, Seek};
use tiff::decoder::Decoder;
use tiff::tags::Tag;

/// Steps of a pixel along x and y.
const SCALE: Tag = Tag::ModelPixelScaleTag;
/// A pixel, and the place where it is.
const TIE: Tag = Tag::ModelTiepointTag;
/// Keys of four numbers each; that of the first tells what a pixel's place is.
const KEYS: Tag = Tag::GeoKeyDirectoryTag;
const RASTER_TYPE: u32 = 1025;

/// What the page at which the decoder is says; nothing where it is silent.
pub(super) struct Geo {
    scale: Option<[f64; 2]>,
    tie: Option<[f64; 6]>,
    is_point: bool,
    no_data: Option<f64>,
}

impl Geo {
    /// Reads the entries of a page. One that cannot be read is as good as none: the image is all there.
    pub(super) fn read<R: Read + Seek>(decoder: &mut Decoder<R>) -> Geo {
        let mut floats = |tag: Tag| decoder.find_tag(tag).ok().flatten()?.into_f64_vec().ok();
        let scale = floats(SCALE).and_then(|steps| steps.first_chunk().copied());
        let tie = floats(TIE).and_then(|tie| tie.first_chunk().copied());
        let keys = decoder.find_tag(KEYS).ok().flatten().and_then(|keys| keys.into_u32_vec().ok()).unwrap_or_default();
        let is_point =
            keys.as_chunks::<4>().0.iter().any(|[key, _, _, value]: &[u32; 4]| (*key, *value) == (RASTER_TYPE, 2));
        let text = decoder.find_tag(Tag::GdalNodata).ok().flatten().and_then(|value| value.into_string().ok());
        let no_data = text.and_then(|text| text.trim_matches(['\0', ' ', '\n']).parse().ok());
        Geo { scale, tie, is_point, no_data: no_data.filter(|value: &f64| !value.is_nan()) }
    }

    /// Tells a grid.
    pub(super) fn apply(&self, grid: &mut Grid) {
        grid.channels.iter_mut().for_each(|channel| channel.no_data = self.no_data);
        let (Some([dx, dy]), Some([column, row, _, x, y, _])) = (self.scale, self.tie) else { return };
        let numbers = [dx, dy, column, row, x, y];
        if dx == 0.0 || dy == 0.0 || !numbers.iter().all(|number| number.is_finite()) || grid.dimensions != 2 {
            return;
        }
        // The place is that of a pixel's corner, or its centre.
        let half = if self.is_point { 0.0 } else { 0.5 };
        let first = DVec3::new(x + (half - column) * dx, y - (half - row) * dy, 0.0);
        grid.to_world = DAffine3::from_translation(first) * DAffine3::from_scale(DVec3::new(dx, -dy, 1.0));
    }
}
