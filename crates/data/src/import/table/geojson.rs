//! Star catalogues as GeoJSON: a feature collection of points with right ascension (as a longitude from -180 to 180) and
//! declination in degrees, and numbers as properties, possibly as text.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, number};
use super::store::StoreWriter;
use super::{ids, text};
use crate::import::source::exact_id;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The GeoJSON format.
pub(in crate::import) struct GeoJson;

#[derive(Deserialize)]
struct Collection {
    features: Vec<Feature>,
}

#[derive(Deserialize)]
struct Feature {
    geometry: Geometry,
    #[serde(default)]
    properties: BTreeMap<String, Value>,
}

#[derive(Deserialize)]
struct Geometry {
    coordinates: Vec<f64>,
}

impl Format for GeoJson {
    fn name(&self) -> &'static str {
        "GeoJSON points"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["geojson", "json"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        text::head(head).is_some_and(|text| text.trim_start().starts_with('{') && text.contains("FeatureCollection"))
    }

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let (reader, bytes) = text::open(path)?;
        let collection: Collection = serde_json::from_reader(reader).map_err(|error| {
            let found = error.to_string().replace(['\n', '\r'], " ");
            ImportError::malformed(path, "features", found, "a GeoJSON collection of points")
        })?;
        let value = |feature: &Feature, name: &str| match feature.properties.get(name) {
            Some(Value::Number(number)) => number.as_f64(),
            Some(Value::String(text)) => number(text),
            None | Some(Value::Null) => Some(f64::NAN),
            Some(_) => None,
        };
        let features = &collection.features;
        let id = |feature: &Feature, name: &str, value: f64| match feature.properties.get(name) {
            Some(Value::Number(number)) => number.as_u64().or_else(|| exact_id(value)),
            Some(Value::String(text)) => ids::of_text(text, value),
            _ => None,
        };
        let mut names: std::collections::BTreeSet<&String> =
            features.iter().flat_map(|feature| feature.properties.keys()).collect();
        names.retain(|name| features.iter().all(|feature| value(feature, name).is_some()));
        let mut columns = vec![Column::new("ra [deg]"), Column::new("dec [deg]")];
        columns.extend(names.iter().map(|name| Column::new(name)));
        let widths: Vec<usize> = columns[2..].iter().map(Column::width).collect();
        let mut rows = StoreWriter::new(path, columns);
        for (index, feature) in features.iter().enumerate() {
            let [longitude, latitude] = feature.geometry.coordinates[..] else {
                let found = format!("{} coordinates", feature.geometry.coordinates.len());
                return Err(ImportError::malformed(
                    path,
                    format!("features[{index}]"),
                    found,
                    "longitude and latitude",
                ));
            };
            let mut row = vec![longitude, latitude];
            for (name, width) in names.iter().zip(&widths) {
                let value = value(feature, name).unwrap_or(f64::NAN);
                row.extend_from_slice(&[value, ids::rest(value, id(feature, name, value))][..*width]);
            }
            rows.push(&row)?;
        }
        let table = Box::new(rows.finish(|_| true)?);
        Ok(Box::new(Catalogue::new(path, Opened { table, format: "geojson", bytes, notes: Vec::new() })?))
    }
}
