//! Star catalogues as GeoJSON: a feature collection of points with right ascension (as a longitude from -180 to 180) and
//! declination in degrees, and numbers as properties, possibly as text.

use super::columns::{Column, number};
use super::{Catalogue, text};
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

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        text::head(head).is_some_and(|text| text.trim_start().starts_with('{') && text.contains("FeatureCollection"))
    }

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let (reader, bytes) = text::open(path)?;
        let collection: Collection = serde_json::from_reader(reader).map_err(|error| {
            let found = error.to_string().replace(['\n', '\r'], " ");
            ImportError::malformed(path, "features", found, "a GeoJSON collection of points")
        })?;
        let mut columns = vec![Column::new("ra [deg]"), Column::new("dec [deg]")];
        let names: std::collections::BTreeSet<&String> =
            collection.features.iter().flat_map(|feature| feature.properties.keys()).collect();
        for (index, feature) in collection.features.iter().enumerate() {
            let [longitude, latitude] = feature.geometry.coordinates[..] else {
                let found = format!("{} coordinates", feature.geometry.coordinates.len());
                return Err(ImportError::malformed(
                    path,
                    format!("features[{index}]"),
                    found,
                    "longitude and latitude",
                ));
            };
            columns[0].values.push(longitude);
            columns[1].values.push(latitude);
        }
        for name in names {
            let values = collection.features.iter().map(|feature| match feature.properties.get(name) {
                Some(Value::Number(number)) => number.as_f64(),
                Some(Value::String(text)) => number(text),
                None | Some(Value::Null) => Some(f64::NAN),
                Some(_) => None,
            });
            if let Some(values) = values.collect::<Option<Vec<f64>>>() {
                columns.push(Column { values, ..Column::new(name) });
            }
        }
        Ok(Box::new(Catalogue::new(path, "geojson", bytes, columns)?))
    }
}
