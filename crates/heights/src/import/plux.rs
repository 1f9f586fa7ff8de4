//! Sensofar's newer files (`.plux`): a ZIP archive of a description in XML, and of each layer heights as floats in micrometres.

use super::archive::Archive;
use super::content::Content;
use super::dimensions::{dimensions, distance};
use super::plu::LOST;
use super::raw::Layout;
use super::xml::{Elements, parsed};
use super::{HeightDescription, HeightFormat, HeightSource, NoData, always};
use crate::model::HeightGrid;
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::{SampleType, Unit};

/// The first layer of such a file.
pub(super) const PLUX: HeightFormat =
    HeightFormat { name: "plux", extensions: &["plux"], is_sure: always, detect, open };

/// The description's name, and the most bytes that it has.
const INDEX: &str = "index.xml";
const LONGEST_XML: u64 = 16 << 20;

fn detect(content: &Content) -> bool {
    if !content.head.starts_with(b"PK\x03\x04") {
        return false;
    }
    let is_layer = |name: String| name.to_lowercase().trim_start_matches("./").starts_with("layer_");
    let holds = |archive: Archive| archive.named(INDEX).is_some() && archive.names().any(is_layer);
    content.has_extension("plux") || Archive::open(content).is_ok_and(holds)
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let mut archive = Archive::open(content)?;
    let xml = archive.whole(INDEX, LONGEST_XML)?;
    let text = String::from_utf8_lossy(&xml);
    let document = parsed(content, INDEX, &text)?;
    let index = Elements { content, name: INDEX, document: &document };
    let count = |name: &str| -> Result<i64, ImportError> {
        let path = ["GENERAL", name];
        index.number(&path, "a whole number")?.ok_or_else(|| index.missing(&path))
    };
    let (columns, rows) = (count("IMAGE_SIZE_X")?, count("IMAGE_SIZE_Y")?);
    let size = dimensions(content, ("IMAGE_SIZE_X", columns.into()), ("IMAGE_SIZE_Y", rows.into()), SampleType::F32)?;
    let mut grid = HeightGrid::new(size[0], size[1], SampleType::F32);
    if content.options.spacing.is_none() {
        for (step, name) in grid.step.iter_mut().zip(["FOV_X", "FOV_Y"]) {
            let path = ["GENERAL", name];
            let stated = index.number(&path, "a number")?.ok_or_else(|| index.missing(&path))?;
            *step = distance(content, &path.join("/"), stated)?;
        }
    }
    (grid.xy_unit, grid.height_unit) = (Unit::new("um"), Unit::new("um"));

    let layers = index.document.descendants().filter(|node| {
        let number = node.tag_name().name().strip_prefix("LAYER_");
        number.is_some_and(|number| number.bytes().all(|byte| byte.is_ascii_digit()))
    });
    let layers = layers.count();
    let name = index.text(&["LAYER_0", "FILENAME_Z"]).unwrap_or("LAYER_0.raw");
    let layout = Layout::packed(size, 0, SampleType::F32, ByteOrder::Little);
    let bytes = layout.row_stride.saturating_mul(size[1]);
    let samples = archive.unpack(name, bytes, &grid.described(), |_| ())?.samples(content, name, layout)?;
    let mut about = HeightDescription::new(content, PLUX.name, grid);
    about.has_spacing = true;
    if layers > 1 {
        about.notes.push(format!("the first of {layers} layers is read"));
    }
    if archive.names().any(|name| name.to_lowercase().ends_with(".stack.raw")) {
        about.notes.push("its pictures are left out".into());
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Value(LOST)))
}
