//! Named objects of a catalogue: their names over the picture, flights to them, and probes of them.

use super::open::Openings;
use super::playhead::Playhead;
use super::scene::{Scene, Settings};
use super::state::answer::Answer;
use super::state::notices::Notices;
use crate::annotate::Label;
use crate::explore::{Catalogue, Object, Region};
use crate::model::Bounds;
use crate::picture::PictureError;
use crate::picture::surface::FieldInScene;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// The catalogue that is open, if any.
#[derive(Resource, Default)]
pub struct Objects {
    /// What is being read or has been read.
    pub catalogue: Answer<Catalogue>,
    /// Its objects as names over the picture, the most important first.
    pub labels: Vec<Label>,
    /// What stands on the heights that are open, where the catalogue is one of places in a plane.
    in_plane: Option<InPlane>,
    /// The time of objects of a catalogue of several steps.
    time: Option<f64>,
    /// What the list in the panel is narrowed to.
    pub search: String,
    /// Files that were dropped and may be catalogues, and whether each joins what is open where it is data.
    dropped: VecDeque<(PathBuf, bool)>,
    /// The first of them, on its way; `None` comes of one that is no catalogue.
    considered: Answer<Option<Catalogue>>,
    /// Whether the command line has named the catalogue, so that the first scene does not change it.
    pub is_given: bool,
}

/// Names whose table does not say how high they are.
struct InPlane {
    /// The table.
    table: Catalogue,
    /// The heights that were asked, by the scene's generation and by where these are the same again, on which T depends.
    asked: Option<(u32, Vec<Option<u64>>)>,
    /// Where they stand.
    standing: Answer<Standing>,
}

/// Of each name of a table the field that it stands on, and row, column and height there.
type Standing = Vec<Option<(usize, [f64; 3])>>;

impl InPlane {
    /// The names that stand on something, where fields are in the scene.
    fn on(&self, standing: &Standing, fields: &[FieldInScene]) -> Catalogue {
        let stood = |(object, on): (&Object, &Option<(usize, [f64; 3])>)| {
            let (field, [row, column, height]) = (*on)?;
            let position = fields.get(field)?.in_scene(row, column, height);
            Some(Object { position, ..object.clone() })
        };
        let objects = self.table.objects.iter().zip(standing).filter_map(stood).collect();
        Catalogue { objects, ..self.table.clone() }
    }
}

/// Where places stand: on the first of the fields that has a surface there.
fn standing_on(fields: &[FieldInScene], places: &[[f64; 2]]) -> Result<Standing, PictureError> {
    let mut standing: Standing = vec![None; places.len()];
    for (number, field) in fields.iter().enumerate() {
        let free = places.iter().enumerate().filter(|(index, _)| standing[*index].is_none());
        let free = free.map(|(index, place)| (index, *place)).collect();
        for (index, on) in field.standing(free)? {
            standing[index] = Some((number, on));
        }
    }
    Ok(standing)
}

impl Objects {
    /// Opens a catalogue, in the place of the one that is open.
    pub fn open(&mut self, path: PathBuf) {
        self.replace(Answer::ask("catalogue", move |_| match Catalogue::in_plane(&path)? {
            Some(table) => Ok(table),
            None => Catalogue::read_at(&path, None, true),
        }));
    }

    /// Takes another catalogue in the place of the one that is open, of which nothing stays.
    fn replace(&mut self, catalogue: Answer<Catalogue>) {
        self.labels.clear();
        (self.time, self.in_plane, self.catalogue) = (None, None, catalogue);
    }

    /// Opens the catalogue that a scene names, if it names one.
    pub fn open_of_scene(&mut self, path: Option<PathBuf>) {
        if let Some(path) = path.filter(|_| !std::mem::take(&mut self.is_given)) {
            self.open(path);
        }
    }

    /// The file of the open catalogue.
    pub fn path(&self) -> Option<&Path> {
        self.catalogue.here().map(|catalogue| catalogue.path.as_path())
    }

    /// Has a look whether a file that was dropped on the window is a catalogue, and opens it as that, or else as data, which `joins` what is open.
    pub fn consider(&mut self, path: PathBuf, joins: bool) {
        self.dropped.push_back((path, joins));
    }

    /// The first objects whose names hold what is searched for, and how many there are.
    pub fn found(&self, most: usize) -> (Vec<&Object>, usize) {
        let Some(catalogue) = self.catalogue.here() else { return (Vec::new(), 0) };
        let wanted = self.search.trim().to_lowercase();
        let mut all = catalogue.objects.iter().filter(|object| object.name.to_lowercase().contains(&wanted));
        let first: Vec<&Object> = all.by_ref().take(most).collect();
        let count = first.len() + all.count();
        (first, count)
    }
}

/// Whether a file that is dropped on the window may name objects rather than being data: a group catalogue, a halo finder's list, or RON that
/// is no scene.
pub fn may_be_catalogue(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    matches!(extension.to_ascii_lowercase().as_str(), "hdf5" | "h5" | "ron" | "list" | "ahf_halos" | "properties")
}

/// What an object takes up: a ball of its radius, or of `usual` where it has none.
pub fn extent(object: &Object, usual: f64) -> (Region, Bounds) {
    let radius = object.radius.unwrap_or(usual);
    let bounds = Bounds { min: object.position - radius, max: object.position + radius };
    (Region::sphere(object.position, radius), bounds)
}

/// How large an object without a radius is taken to be: a hundredth of the data's box.
pub fn usual_radius(bounds: Bounds) -> f64 {
    let size: DVec3 = bounds.size();
    (0.01 * size.max_element()).max(f64::MIN_POSITIVE)
}

/// Objects of a catalogue that are moved at most between steps; of more, those of the step are shown.
const MOST_MOVING: usize = 20_000;

/// Shows the objects of the time that is shown, where the catalogue has those of several steps.
pub(super) fn follow_time(mut objects: ResMut<Objects>, scene: Option<Res<Scene>>, playhead: Option<Res<Playhead>>) {
    let Some(tree) = objects.catalogue.here().and_then(|catalogue| catalogue.tree.as_ref()) else { return };
    // Without a run the catalogue of one step is that of what is shown.
    let own = || scene.filter(|_| tree.format != "groups").and_then(|scene| scene.file.metadata().provenance.time);
    let Some(time) = playhead.map(|playhead| playhead.time()).or_else(own) else { return };
    let step = tree.step_at(time);
    let time = if tree.count(step) > MOST_MOVING { tree.steps()[step].time } else { time };
    if objects.time == Some(time) {
        return;
    }
    objects.time = Some(time);
    if let Some(now) = objects.catalogue.here().and_then(|catalogue| catalogue.at(Some(time))) {
        objects.labels = now.labels();
        objects.catalogue = Answer::Here(now);
    }
}

/// Takes the catalogue that has been read.
pub(super) fn receive_catalogue(
    mut objects: ResMut<Objects>,
    mut openings: ResMut<Openings>,
    scene: Option<Res<Scene>>,
    mut notices: ResMut<Notices>,
) {
    let objects = objects.bypass_change_detection();
    objects.considered.receive();
    if !matches!(objects.considered, Answer::Coming(_))
        && let Some((path, joins)) = objects.dropped.pop_front()
    {
        match std::mem::take(&mut objects.considered) {
            Answer::Nothing => {
                objects.dropped.push_front((path.clone(), joins));
                objects.considered = Answer::ask("catalogue", move |_| Ok::<_, String>(Catalogue::read(&path).ok()));
            }
            Answer::Here(Some(catalogue)) => objects.replace(Answer::ready(catalogue)),
            // A snapshot or a scene, or nothing that can be read: opening it says so.
            _ => openings.open(&path, joins, scene.as_deref()),
        }
    }
    if !objects.catalogue.receive() {
        return;
    }
    match &objects.catalogue {
        Answer::Here(catalogue) => {
            // Names without a height are nowhere until it is known on what they stand.
            objects.labels = if catalogue.is_in_plane { Vec::new() } else { catalogue.labels() };
            objects.in_plane = catalogue.is_in_plane.then(|| InPlane {
                table: catalogue.clone(),
                asked: None,
                standing: Answer::Nothing,
            });
            let count = crate::annotate::number::count(catalogue.objects.len() as u64);
            notices.info(format!("{count} objects of {}", catalogue.path.display()));
            let unit = scene.map(|scene| scene.file.metadata().length_unit.clone());
            if let Some(why) = unit.and_then(|unit| catalogue.unlike(&unit)) {
                notices.error(why);
            }
        }
        Answer::Failed(why) => notices.error(why),
        Answer::Nothing | Answer::Coming(_) => {}
    }
}

/// Lets names whose table does not say how high they are stand on the heights that are open, as high as these stand now.
pub(super) fn stand_on_heights(
    mut objects: ResMut<Objects>,
    scene: Option<Res<Scene>>,
    settings: Res<Settings>,
    mut notices: ResMut<Notices>,
) {
    let objects = objects.bypass_change_detection();
    let (Some(names), Some(scene)) = (objects.in_plane.as_mut(), scene) else { return };
    let has_come = names.standing.receive();
    if !(has_come || names.asked.is_none() || scene.is_changed() || settings.is_changed()) {
        return;
    }
    let fields = scene.fields(&settings);
    let path = names.table.path.display();
    let around: Vec<Option<u64>> = fields.iter().map(|field| field.placed.around).collect();
    let asked = (scene.generation, around);
    if names.asked.as_ref() != Some(&asked) {
        names.asked = Some(asked);
        names.standing = Answer::Nothing;
        objects.labels.clear();
        if fields.is_empty() {
            notices.error(format!("{path}: names without z stand on heights, of which none are shown"));
            return;
        }
        let places: Vec<[f64; 2]> =
            names.table.objects.iter().map(|object| [object.position.x, object.position.y]).collect();
        names.standing = Answer::ask("names", move |_| standing_on(&fields, &places));
        return;
    }
    match &names.standing {
        Answer::Here(standing) => {
            let stood = names.on(standing, &fields);
            let all = names.table.objects.len();
            let missing = all - stood.objects.len();
            if has_come && missing > 0 {
                let why = "there is no surface where they are";
                notices.info(format!("{path}: {missing} of {all} names are left out: {why}"));
            }
            objects.labels = stood.labels();
            objects.catalogue = Answer::Here(stood);
        }
        Answer::Failed(why) if has_come => notices.error(why),
        Answer::Nothing | Answer::Coming(_) | Answer::Failed(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_stays_of_the_catalogue_before_one_that_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("names.ron");
        std::fs::write(&path, r#"(objects: [(name: "Coma", position: (1.0, 2.0, 3.0))])"#).unwrap();
        let mut app = App::new();
        app.insert_resource(Openings::new(std::sync::Arc::new(|_, _, _| Err("no data".to_owned()))))
            .init_resource::<Notices>()
            .insert_resource(Objects { time: Some(2.0), ..Objects::default() })
            .add_systems(Update, receive_catalogue);
        app.world_mut().resource_mut::<Objects>().consider(path.clone(), false);
        let start = std::time::Instant::now();
        while app.world().resource::<Objects>().path() != Some(&path) {
            assert!(start.elapsed() < std::time::Duration::from_secs(60), "the catalogue is not opened");
            app.update();
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        let objects = app.world().resource::<Objects>();
        assert!(objects.labels.len() == 1 && objects.dropped.is_empty());
        assert_eq!(objects.time, None, "it is moved to the time that is shown");
    }

    #[test]
    fn catalogues_are_searched() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("names.ron");
        std::fs::write(
            &path,
            r#"(objects: [(name: "Coma", position: (1.0, 2.0, 3.0), mass: 9.0), (name: "Virgo", position: (0.0, 0.0, 0.0))])"#,
        )
        .unwrap();
        assert!(
            may_be_catalogue(&path) && may_be_catalogue(Path::new("a.HDF5")) && !may_be_catalogue(Path::new("a.csv"))
        );
        let mut objects = Objects { catalogue: Answer::Here(Catalogue::read(&path).unwrap()), ..Objects::default() };
        assert_eq!(objects.found(1).1, 2);
        objects.search = "vir".into();
        let (found, count) = objects.found(10);
        assert_eq!((found[0].name.as_str(), count), ("Virgo", 1));
        let (region, bounds) = extent(found[0], 2.0);
        assert_eq!(region.first_sphere(), Some((DVec3::ZERO, 2.0)));
        assert_eq!(bounds.size(), DVec3::splat(4.0));
    }
}
