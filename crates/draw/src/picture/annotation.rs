//! What is written into a picture and marked in it.

use super::drawn::Coloration;
use super::session::Reporter;
use crate::annotate::{self, Annotations, KeyArrow, Label, Legend, Paper, Subject, Units};
use crate::color::Image;
use crate::cpu::slice::arrows::ArrowKey;
use crate::explore::data::source_of;
use crate::explore::marks::{self, Layer, Marks};
use crate::explore::{Catalogue, Data, ExploreError, FoundIds, IdSet, Members, Places, SelectionSet, Work};
use crate::import::Source;
use crate::look::Shot;
use crate::mode::Depiction;
use crate::model::{Bounds, FamilyName, Unit};
use crate::store::{PageFile, StoreError};
use crate::stream::SceneNode;
use crate::view::View;
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;

/// What a picture shows, and from where.
#[derive(Clone)]
pub struct Annotation {
    /// The camera; of a panorama or a pair of pictures, the one in their middle.
    pub view: View,
    /// The mode and the attribute.
    pub depiction: Depiction,
    target: DVec3,
    bounds: Bounds,
    units: Units,
    /// The moment of a run, in its words.
    time: String,
    paper: Paper,
    labels: Vec<Label>,
    /// Selections over the picture.
    marks: Option<Layer>,
}

/// The objects of a catalogue as labels, the most important one first; of several steps those at the time.
///
/// # Errors
/// What is wrong with the catalogue.
fn labels_of(
    catalogue: &Path,
    time: Option<f64>,
    of_run: bool,
    unit: &Unit,
    reporter: &dyn Reporter,
) -> Result<Vec<Label>, ExploreError> {
    let catalogue = Catalogue::read_at(catalogue, time, of_run)?;
    catalogue.unlike(unit).into_iter().for_each(|why| reporter.tell(why.to_string()));
    Ok(catalogue.labels())
}

impl Annotation {
    /// For a shot of what lies in `bounds` in these units, of a run at a time, which is in the data's words, too; other data has a time
    /// of its `own` or none.
    ///
    /// # Errors
    /// What is wrong with the catalogue of the objects to name.
    pub(super) fn new(
        shot: &Shot,
        view: View,
        bounds: Bounds,
        time: Option<(f64, String)>,
        units: Units,
        own: Option<f64>,
        depiction: &Depiction,
        reporter: &dyn Reporter,
    ) -> Result<Annotation, ExploreError> {
        let target = shot.camera.target.map_or(bounds.center(), DVec3::from);
        let paper = Paper::of(shot.look.background.unwrap_or_default());
        let at = time.as_ref().map(|(time, _)| *time).or(own);
        let labels = shot
            .labels
            .as_deref()
            .map(|path| labels_of(path, at, time.is_some(), &units.length, reporter))
            .transpose()?;
        let (labels, time) = (labels.unwrap_or_default(), time.map(|(_, words)| words).unwrap_or_default());
        Ok(Annotation { view, target, bounds, units, time, paper, labels, marks: None, depiction: depiction.clone() })
    }

    /// With a legend of something else, and in these units.
    pub(super) fn telling(self, depiction: Depiction, units: Units) -> Annotation {
        Annotation { depiction, units, ..self }
    }

    /// With names that stand on a surface, where there are such, in place of those of a catalogue.
    pub(super) fn naming(self, labels: Option<Vec<Label>>) -> Annotation {
        Annotation { labels: labels.unwrap_or(self.labels), ..self }
    }

    /// The units that it is in.
    pub(super) fn units(&self) -> &Units {
        &self.units
    }

    /// With selections over the picture of these nodes; `run` says where those are whose members stay the same, where they are of a run.
    ///
    /// # Errors
    /// When a selection makes no sense.
    pub(super) fn with_selections(
        self,
        selections: &[SelectionSet],
        file: &PageFile,
        nodes: &[SceneNode],
        run: Option<FollowedPlaces<'_>>,
        families: &[FamilyName],
        reporter: &dyn Reporter,
    ) -> Result<Annotation, ExploreError> {
        let has_ids = |set: &SelectionSet| matches!(set.members, Members::Ids(_)) && run.is_none();
        let by_id = marks::shown(selections).0.into_iter().any(has_ids);
        let left_out = |what: &str, error: &ExploreError| reporter.tell(not_drawn(what, error));
        let source = match by_id.then(|| source_of(file)).transpose() {
            Ok(source) => source,
            Err(error) => {
                left_out("selections by id", &error);
                None
            }
        };
        let find = |ids: &IdSet| {
            let progress = reporter.progress();
            let found = FoundIds::of(source.as_ref()?.as_ref(), ids, file.metadata(), Work::told(&*progress));
            found.map(|found| found.highlighter).map_err(|error| left_out("a selection by id", &error)).ok()
        };
        let mut marks = Marks::new(selections, file.metadata(), Data::Pages(file).periodic_edge()?, find)?;
        for set in marks::shown(selections).0 {
            match (&run, &set.members) {
                (_, Members::Region(_)) | (None, Members::Ids(_)) => {}
                (Some(run), members) => {
                    if let Some(places) = told(run(members), &set.name, reporter)? {
                        marks.add_places(places, set.rgb().unwrap_or([255; 3]));
                    }
                }
                (None, Members::Tracked { .. }) => reporter.tell(not_tracked(&set.name)),
            }
        }
        let layer = (!marks.is_empty()).then(|| marks.draw(&self.view, nodes, families));
        Ok(Annotation { marks: layer, ..self })
    }

    /// With selections over the picture of the particles of a source; of `families` alone.
    ///
    /// # Errors
    /// When a selection makes no sense, or the source cannot be read.
    pub(super) fn with_source_selections(
        self,
        selections: &[SelectionSet],
        source: &dyn Source,
        run: Option<FollowedPlaces<'_>>,
        families: &[FamilyName],
        reporter: &dyn Reporter,
    ) -> Result<Annotation, ExploreError> {
        let (shown, alone) = marks::shown(selections);
        let periodic = Data::Source(source).periodic_edge()?;
        let mut sets = Vec::new();
        for set in shown {
            let places = match (&run, &set.members) {
                (Some(run), members) if members.stay() => run(members),
                (_, members) => Places::of(source, members, periodic, Work::told(&*reporter.progress())),
            };
            if let Some(places) = told(places, &set.name, reporter)? {
                sets.push((places, set.rgb().unwrap_or([255; 3])));
            }
        }
        Ok(Annotation { marks: Some(marks::draw_places(&self.view, &sets, alone, families)), ..self })
    }

    /// Lays the selections over the finished picture.
    pub(super) fn mark(&self, image: &mut Image) {
        if let Some(layer) = &self.marks {
            layer.blend(image);
        }
    }

    /// What colours mean; `None` where no axis tells it.
    pub(super) fn legend(&self, Coloration { transfer, levels }: &Coloration) -> Option<Legend> {
        let lut = match self.depiction.mode.is_light() {
            true => transfer.bake_colors(),
            false => transfer.bake_lut(),
        };
        Legend::told(&self.depiction, transfer, Arc::new(lut), levels, &self.units)
    }

    /// Writes what is asked for into the finished picture, or on a sheet in it that `view` sees; `arrows` says how long arrows in it are, where there
    /// are some.
    pub(super) fn write(
        &self,
        image: &mut Image,
        view: &View,
        annotations: &Annotations,
        coloration: &Coloration,
        arrows: Option<ArrowKey>,
    ) {
        let legend = self.legend(coloration).map(|legend| {
            let found = arrows.and_then(|key| KeyArrow::of(key.scale, key.spacing, &self.units.vector));
            Legend { arrow: found.or_else(|| legend.arrow.clone()), ..legend }
        });
        let scale = annotations.scale_for(image.width, image.height);
        let subject = Subject {
            view,
            scale,
            target: self.target,
            bounds: self.bounds,
            length_unit: &self.units.length.to_string(),
            time: &self.time,
            legend: legend.as_ref(),
            labels: &self.labels,
        };
        annotate::paint(image, &annotate::layout(annotations, &subject), scale, self.paper);
    }
}

/// Where the particles of a selection of a run are in the picture, whose members stay the same.
pub(super) type FollowedPlaces<'a> = &'a dyn Fn(&Members) -> Result<Places, ExploreError>;

/// What has been found of a selection; what the data does not have is told and left out.
fn told(
    found: Result<Places, ExploreError>,
    name: &str,
    reporter: &dyn Reporter,
) -> Result<Option<Places>, ExploreError> {
    match found {
        Err(error @ (ExploreError::Missing { .. } | ExploreError::Store(StoreError::Moment { .. }))) => {
            reporter.tell(not_drawn(name, &error));
            Ok(None)
        }
        found => found.map(Some),
    }
}

/// Says that a selection of a run is not drawn, as the data is none.
fn not_tracked(name: &str) -> String {
    format!("{name}: left out of the picture: only a run with tracks knows who was in a region at another time")
}

/// Says that a selection is not drawn, and why.
fn not_drawn(what: &str, error: &ExploreError) -> String {
    format!("{what}: left out of the picture: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_the_largest_objects_first() {
        let folder = tempfile::tempdir().unwrap();
        let catalogue = folder.path().join("clusters.csv");
        std::fs::write(&catalogue, "name,x,y,z,radius,mass\nsmall,1,2,3,0.5,1\nlarge,4,5,6,2,9\n").unwrap();
        let labels = labels_of(&catalogue, None, false, &Unit::default(), &()).unwrap();
        assert_eq!((labels.len(), labels[0].name.as_str(), labels[0].radius), (2, "large", Some(2.0)));
        assert!(labels_of(&folder.path().join("none.csv"), None, false, &Unit::default(), &()).is_err());
    }
}
