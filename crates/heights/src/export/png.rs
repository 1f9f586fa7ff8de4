//! Grey PNG pictures whose values are the samples, where these are whole numbers without a sign, of 8 or 16 bits.

use super::new_file::NewFile;
use super::numbers::written_type;
use super::{Export, ExportError, Exported};
use deepfield_data::model::SampleType;
use std::io::Write;

pub(super) fn write(export: &Export) -> Result<Exported, ExportError> {
    let sample_type = written_type(export.grid(), || export.all_valid())?;
    let depth = match sample_type {
        SampleType::U8 => png::BitDepth::Eight,
        SampleType::U16 => png::BitDepth::Sixteen,
        other => {
            let expected = "uint8 or uint16 samples that were all measured; .tif holds any";
            return Err(export.refused("samples", other, expected));
        }
    };
    let window = export.window;
    let sides =
        u32::try_from(window.columns).ok().zip(u32::try_from(window.rows).ok()).filter(|(x, y)| *x.max(y) < 1 << 31);
    let Some((width, height)) = sides else {
        return Err(export.refused("size", format!("{} x {}", window.columns, window.rows), "sides below 2^31"));
    };
    let mut file = NewFile::create(export.output, 0)?;
    let fail = |error: png::EncodingError| ExportError::io(export.output, error.into());
    let io = |source| ExportError::io(export.output, source);
    let mut encoder = png::Encoder::new(file.inner(), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().map_err(fail)?;
    let mut stream = writer.stream_writer().map_err(fail)?;
    let mut bytes = Vec::new();
    let valid = export.each_band(true, |_, values| {
        bytes.clear();
        match depth {
            png::BitDepth::Eight => bytes.extend(values.iter().map(|value| *value as u8)),
            _ => values.iter().for_each(|value| bytes.extend((*value as u16).to_be_bytes())),
        }
        stream.write_all(&bytes).map_err(io)
    })?;
    stream.finish().map_err(fail)?;
    writer.finish().map_err(fail)?;
    file.finish()?;
    let mut done = export.done(valid);
    done.notes.push("the format says neither where samples are nor in which unit".into());
    Ok(done)
}
