//! What `deepfield render` writes into its pictures.

use super::progress_bar::TerminalProgress;
use super::request::Request;
use crate::annotate::{self, Annotations, Label, Legend, Paper, Subject, Units};
use crate::color::Image;
use crate::color::transfer::{Levels, TransferFunction};
use crate::explore::data::source_of;
use crate::explore::marks::{self, Layer, Marks};
use crate::explore::{Catalogue, Data, ExploreError, FoundIds, IdSet, Members, Places, SelectionSet, Work};
use crate::mode::Depiction;
use crate::model::{Bounds, FamilyName, Unit};
use crate::store::PageFile;
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is written into a picture.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct AnnotateOptions {
    /// Write into the picture: legend, scale-bar, axes, triad, labels, with commas [default: nothing; without PARTS:
    /// legend,scale-bar].
    #[arg(long, value_name = "PARTS", num_args = 0..=1, require_equals = true,
          default_missing_value = "legend,scale-bar", value_parser = parts)]
    pub annotate: Option<Annotations>,
    /// A line at the top of the picture.
    #[arg(long, value_name = "TEXT")]
    pub caption: Option<String>,
    /// Write the names of a catalogue's objects: CSV, RON, or a group catalogue in HDF5 (see `deepfield catalogue --help`).
    #[arg(long, value_name = "CATALOGUE")]
    pub labels: Option<PathBuf>,
    /// Size of text and lines in the picture: 1 has letters of 13 pixels [default: by the picture's size].
    #[arg(long, value_name = "FACTOR", value_parser = scale)]
    pub text_scale: Option<f32>,
}

/// Parts by name, with commas.
fn parts(text: &str) -> Result<Annotations, String> {
    text.split(',').map(str::trim).try_fold(Annotations::NONE, Annotations::with)
}

fn scale(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|scale| Annotations::SCALES.contains(scale));
    value.ok_or_else(|| "expected a number from 0.25 to 16".into())
}

impl AnnotateOptions {
    /// Whether any is on the command line.
    pub fn is_given(&self) -> bool {
        self.annotate.is_some() || self.caption.is_some() || self.labels.is_some()
    }

    /// What is written, where `config` says so too: nothing for `None`.
    pub fn over(&self, config: Option<Annotations>) -> Option<Annotations> {
        if !self.is_given() && config.is_none() {
            return None;
        }
        let config = config.unwrap_or(Annotations::NONE);
        let named = self.annotate.clone().map(|named| Annotations {
            caption: config.caption.clone(),
            scale: config.scale,
            ..named
        });
        let mut all = named.unwrap_or(config);
        all.caption = self.caption.clone().unwrap_or(all.caption);
        all.scale = self.text_scale.or(all.scale);
        if self.labels.is_some() && all.labels == 0 {
            all.labels = Annotations::default().labels;
        }
        Some(all)
    }
}

/// The objects of a catalogue as labels, the most important one first.
///
/// # Errors
/// What is wrong with the catalogue.
fn labels_of(catalogue: &Path, unit: &Unit) -> Result<Vec<Label>, ExploreError> {
    let catalogue = Catalogue::read(catalogue)?;
    if let Some(why) = catalogue.unlike(unit) {
        eprintln!("deepfield: {why}");
    }
    Ok(catalogue.labels())
}

/// What a picture shows, and from where.
#[derive(Clone)]
pub(super) struct Stage {
    pub view: View,
    target: DVec3,
    bounds: Bounds,
    units: Units,
    paper: Paper,
    labels: Vec<Label>,
    pub depiction: Depiction,
    /// Selections over the picture.
    marks: Option<Layer>,
}

impl Stage {
    /// A picture of what lies in `bounds`.
    ///
    /// # Errors
    /// What is wrong with the catalogue of the objects to name.
    pub fn new(
        request: &Request,
        view: View,
        bounds: Bounds,
        units: Units,
        depiction: &Depiction,
    ) -> Result<Stage, ExploreError> {
        let target = request.shot.camera.target.map_or(bounds.center(), DVec3::from);
        let paper = Paper::of(request.look().background.unwrap_or_default());
        let catalogue = request.shot.labels.as_deref();
        let labels = catalogue.map_or(Ok(Vec::new()), |path| labels_of(path, &units.length))?;
        Ok(Stage { view, target, bounds, units, paper, labels, marks: None, depiction: depiction.clone() })
    }

    /// The same with a scene's selections over the picture of these nodes.
    ///
    /// # Errors
    /// When a selection makes no sense.
    pub fn with_selections(
        self,
        selections: &[SelectionSet],
        file: &PageFile,
        nodes: &[SceneNode],
    ) -> Result<Stage, ExploreError> {
        let has_ids = |set: &SelectionSet| matches!(set.members, Members::Ids(_));
        let by_id = marks::shown(selections).0.into_iter().any(has_ids);
        let source = by_id.then(|| source_of(file)).transpose();
        let source = source.unwrap_or_else(|error| left_out("selections by id", &error));
        let find = |ids: &IdSet| {
            let found =
                FoundIds::of(source.as_ref()?.as_ref(), ids, file.metadata(), Work::told(&TerminalProgress::new()));
            found.map(|found| Some(found.highlighter)).unwrap_or_else(|error| left_out("a selection by id", &error))
        };
        let marks = Marks::new(selections, file.metadata(), Data::Pages(file).periodic_edge()?, find)?;
        let layer = (!marks.is_empty()).then(|| marks.draw(&self.view, nodes));
        Ok(Stage { marks: layer, ..self })
    }

    /// The same with a scene's selections over the picture of the particles of the source at `path`; of
    /// `families` alone.
    ///
    /// # Errors
    /// When a selection makes no sense, or the source cannot be read.
    pub fn with_exact_selections(
        self,
        request: &Request,
        path: &Path,
        families: &[FamilyName],
    ) -> Result<Stage, ExploreError> {
        let (shown, alone) = marks::shown(request.look().selections.as_deref().unwrap_or_default());
        if shown.is_empty() {
            return Ok(self);
        }
        if !matches!(&request.members[..], [only] if only.offset == DVec3::ZERO && only.scale.is_none()) {
            eprintln!("deepfield: an exact picture of several or moved datasets leaves the selections out");
            return Ok(self);
        }
        let source = crate::import::open(path)?;
        let periodic = Data::Source(source.as_ref()).periodic_edge()?;
        let mut sets = Vec::new();
        for set in shown {
            let work = TerminalProgress::new();
            let places = match Places::of(source.as_ref(), &set.members, periodic, Work::told(&work)) {
                // What the source does not have is left out, as in other pictures.
                Err(error @ ExploreError::Missing { .. }) => left_out(&set.name, &error),
                places => Some(places?),
            };
            sets.extend(places.map(|places| (places, set.rgb().unwrap_or([255; 3]))));
        }
        Ok(Stage { marks: Some(marks::draw_places(&self.view, &sets, alone, families)), ..self })
    }

    /// Lays the selections over the finished picture.
    pub fn mark(&self, image: &mut Image) {
        if let Some(layer) = &self.marks {
            layer.blend(image);
        }
    }

    /// Writes what is asked for into the finished picture, or on a sheet in it that `view` sees; its colours come from
    /// `transfer` over `levels`.
    pub fn annotate(
        &self,
        image: &mut Image,
        view: &View,
        annotations: &Annotations,
        transfer: &TransferFunction,
        levels: &Levels,
    ) {
        let lut = match self.depiction.mode.is_light() {
            true => transfer.bake_colors(),
            false => transfer.bake_lut(),
        };
        let legend = Legend::of(&self.depiction, transfer, Arc::new(lut), levels, &self.units);
        let scale = annotations.scale_for(image.width, image.height);
        let subject = Subject {
            view,
            scale,
            target: self.target,
            bounds: self.bounds,
            length_unit: &self.units.length.to_string(),
            legend: Some(&legend),
            labels: &self.labels,
        };
        annotate::paint(image, &annotate::layout(annotations, &subject), scale, self.paper);
    }
}

/// Says that a selection is not drawn, and why.
fn left_out<T>(what: &str, error: &ExploreError) -> Option<T> {
    eprintln!("deepfield: {what}: left out of the picture: {error}");
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_override_the_file() {
        let none = AnnotateOptions::default();
        assert_eq!(none.over(None), None);
        assert_eq!(none.over(Some(Annotations::default())), Some(Annotations::default()));
        let file = Annotations { caption: "from the file".into(), scale: Some(2.0), ..Annotations::default() };
        let named = AnnotateOptions { annotate: Some(parts("axes, legend").unwrap()), ..none.clone() };
        let both = named.over(Some(file.clone())).unwrap();
        assert!(both.axes && both.legend && !both.scale_bar && both.caption == "from the file");
        let caption = AnnotateOptions { caption: Some("mine".into()), text_scale: Some(3.0), ..none };
        let both = caption.over(Some(file)).unwrap();
        assert!(both.scale_bar && both.caption == "mine" && both.scale == Some(3.0));
        let folder = tempfile::tempdir().unwrap();
        let catalogue = folder.path().join("clusters.csv");
        std::fs::write(&catalogue, "name,x,y,z,radius,mass\nsmall,1,2,3,0.5,1\nlarge,4,5,6,2,9\n").unwrap();
        let labels = labels_of(&catalogue, &Unit::default()).unwrap();
        assert_eq!((labels.len(), labels[0].name.as_str(), labels[0].radius), (2, "large", Some(2.0)));
        let named = AnnotateOptions { labels: Some(catalogue), ..AnnotateOptions::default() };
        assert!(named.over(None).unwrap().labels > 0 && !named.over(None).unwrap().legend);
        assert!(labels_of(&folder.path().join("none.csv"), &Unit::default()).is_err());
        assert!(parts("legend,axis").is_err() && scale("0").is_err());
    }
}
