//! Esri's grids of floats (`.flt`), which a text beside them (`.hdr`) describes. Rows go from north to south.

use super::content::{Content, LONGEST_HEAD, latin1};
use super::dimensions::{dimensions, distance};
use super::raw::{Layout, RawSamples};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;

/// Floats with their description. Nothing in the file itself says what it is.
pub(super) const FLT: HeightFormat = HeightFormat {
    name: "flt",
    extensions: &["flt"],
    is_sure: always,
    detect: |content| content.has_extension("flt"),
    open,
};

/// The file beside this one that describes it, whatever the case of its ending.
fn description(content: &Content) -> Result<Content, ImportError> {
    content
        .beside("hdr")
        .or_else(|_| content.beside("HDR"))
        .map_err(|_| content.missing("description", "a file with .hdr in place of .flt"))
}

/// Names and values, a line each.
struct Lines<'c> {
    header: &'c Content,
    found: Vec<(String, String)>,
}

impl Lines<'_> {
    fn get(&self, name: &str) -> Option<&str> {
        self.found.iter().find(|(own, _)| own == name).map(|(_, value)| &**value)
    }

    fn number<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, ImportError> {
        let wrong = |value: &str| self.header.malformed(name, value, "a number");
        self.get(name).map(|value| value.parse().map_err(|_| wrong(value))).transpose()
    }

    fn needed<T: std::str::FromStr>(&self, name: &str) -> Result<T, ImportError> {
        self.number(name)?.ok_or_else(|| self.header.missing(name, "a line of the description"))
    }
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let header = description(content)?;
    if header.length > LONGEST_HEAD as u64 {
        return Err(header.malformed(
            "description",
            format!("{} bytes", header.length),
            format!("at most {LONGEST_HEAD}"),
        ));
    }
    let text = latin1(&header.head);
    let found = text.lines().filter_map(|line| {
        let (name, value) = line.trim().split_once(char::is_whitespace)?;
        Some((name.to_lowercase(), value.trim().to_owned()))
    });
    let lines = Lines { header: &header, found: found.collect() };
    let columns = ("ncols", lines.needed::<i64>("ncols")?.into());
    let size = dimensions(&header, columns, ("nrows", lines.needed::<i64>("nrows")?.into()), SampleType::F32)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F32);
    let step = match content.options.spacing {
        Some(step) => step,
        None => [distance(&header, "cellsize", lines.needed("cellsize")?)?; 2],
    };
    for (axis, letter) in ["x", "y"].into_iter().enumerate() {
        // The middle of the first sample, or the corner of its area.
        let place = match lines.number(&format!("{letter}llcenter"))? {
            Some(middle) => middle,
            None => lines.number(&format!("{letter}llcorner"))?.map_or(0.0, |corner: f64| corner + step[axis] / 2.0),
        };
        grid.origin[axis] = place;
    }
    grid.origin[1] += step[1] * (size[1] - 1) as f64;
    grid.step = [step[0], -step[1]];
    let order = match lines.get("byteorder").map(str::to_uppercase).as_deref() {
        None | Some("LSBFIRST" | "I" | "VMS_FFLOAT") => ByteOrder::Little,
        Some("MSBFIRST" | "M") => ByteOrder::Big,
        Some(other) => return Err(header.malformed("byteorder", other, "LSBFIRST or MSBFIRST")),
    };
    let no_data = lines
        .number::<f64>("nodata_value")?
        .map_or(NoData::Value(-9999.0), |value| NoData::Value(f64::from(value as f32)));
    let samples = RawSamples::new(content, "samples", Layout::packed(size, 0, SampleType::F32, order))?;
    let mut about = HeightDescription::new(content, FLT.name, grid);
    about.has_spacing = true;
    Ok(HeightSource::new(about, Box::new(samples), no_data))
}
