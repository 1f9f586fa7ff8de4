//! The plot of the panel: found on a thread of its own while the panel shows it, first as an estimate from a part of the page file, then from
//! all of it; once more where the data, its moment or whose values are meant have changed; and what is brushed in it, which is a selection like
//! any other.

use super::asking::Asking;
use super::prober::Prober;
use crate::color::output::{OutputError, write_atomically, write_png};
use crate::explore::{
    ChartScales, Effort, ExploreError, Fields, Lasso, Members, Plot, PlotKind, PlotOf, PlotOptions, PlotSettings,
    ProbeOptions, Region, SelectionSet, Shape, members_about, probe,
};
use crate::model::{Bounds, FamilyName};
use crate::view::View;
use crate::window::camera::Viewpoint;
use crate::window::free_name::free_name;
use crate::window::pages::ViewSelection;
use crate::window::picture::DataCamera;
use crate::window::scene::{Scene, Settings};
use crate::window::state::answer::Answer;
use crate::window::state::choices::Choices;
use crate::window::state::notices::Notices;
use crate::window::state::plots::PlotChoice;
use bevy::math::DVec3;
use bevy::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The name of the selection that is brushed. Under another name it stays when something else is brushed.
pub const BRUSH: &str = "Brush";
/// How long the camera rests before what it shows is plotted.
const REST: Duration = Duration::from_millis(300);
/// How long it takes until there is an estimate of a plot, as far as its error can be told by then: about a frame; and a better one.
const BUDGETS: [Duration; 3] = [Duration::from_millis(33), Duration::from_millis(500), Duration::from_secs(8)];
/// Where all can be read within so many times the next budget, that is not spent on an estimate.
const WORTH: u32 = 4;
/// Size of a picture that is written, pixels.
const SIZE: [u32; 2] = [900, 600];

/// The plot of the panel.
#[derive(Resource, Default)]
pub struct Plotting {
    /// The panel shows it in this frame; it says so in each.
    pub is_shown: bool,
    /// Somebody wants to see all particles plotted: all of a file is not read just because it was opened.
    pub is_wanted: bool,
    /// It is shown over the picture, larger than in the panel.
    pub is_large: bool,
    /// What is on its way.
    pub coming: Answer<Found>,
    /// What was asked for last.
    asked: Option<Asked>,
    /// What was found last. It stays until the next is here.
    pub found: Option<Found>,
    /// Why there is none.
    pub failed: Option<String>,
    /// Counts up with every plot that is found.
    pub revision: u64,
    /// The file that is being written.
    pub writing: Answer<PathBuf>,
    /// How many particles are brushed.
    pub brushed: Answer<Brushed>,
    counted: Option<Counted>,
    /// The data that all of this is of.
    dataset: u32,
}

/// A plot, and whose values it shows.
#[derive(Clone)]
pub struct Found {
    /// The plot.
    pub plot: Arc<Plot>,
    /// What is to be said of it.
    pub notes: Vec<String>,
    /// The file that was asked.
    pub path: PathBuf,
    /// The region that brushes take particles of; `None` where members are told by who they are.
    pub region: Option<Region>,
}

/// Particles that are brushed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Brushed {
    /// How many.
    pub count: u64,
    /// Of a page file: how many may or may not belong to them.
    pub uncertain: u64,
}

/// A question.
#[derive(Clone, Debug, PartialEq)]
struct Asked {
    options: PlotOptions,
    members: Members,
    /// Centre of a profile, where the members have none.
    about: Option<DVec3>,
    moment: Moment,
}

/// When a question is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moment {
    generation: u32,
    time: Option<f64>,
}

/// A brush that is counted.
#[derive(Clone, PartialEq)]
struct Counted {
    members: Members,
    moment: Moment,
}

impl Asked {
    /// Whether only the moment differs.
    fn is_same_but_for_moment(&self, other: &Asked) -> bool {
        Asked { moment: other.moment, ..self.clone() } == *other
    }
}

impl Plotting {
    /// Asks, where something else is wanted than was asked for: what was going on is stopped. While a run plays, each plot is finished before
    /// that of the next moment is begun.
    fn follow(&mut self, asked: Asked, start: impl FnOnce(&Asked) -> Answer<Found>) {
        let is_coming = matches!(self.coming, Answer::Coming(_));
        match &self.asked {
            Some(before) if *before == asked => return,
            Some(before) if is_coming && before.is_same_but_for_moment(&asked) => return,
            _ => {}
        }
        self.coming = start(&asked);
        self.asked = Some(asked);
    }

    /// Counts what is brushed, in the same way.
    fn count(&mut self, counted: Counted, start: impl FnOnce(&Counted) -> Answer<Brushed>) {
        let is_coming = matches!(self.brushed, Answer::Coming(_));
        match &self.counted {
            Some(before) if *before == counted => return,
            Some(before) if is_coming && before.members == counted.members => return,
            _ => {}
        }
        self.brushed = start(&counted);
        self.counted = Some(counted);
    }

    /// Stops what is going on: nobody looks any more. What was found stays.
    fn rest(&mut self) {
        if matches!(self.coming, Answer::Coming(_)) {
            (self.coming, self.asked) = (Answer::Nothing, None);
        }
        if matches!(self.brushed, Answer::Coming(_)) {
            (self.brushed, self.counted) = (Answer::Nothing, None);
        }
    }

    /// Takes what was found.
    fn receive(&mut self) {
        self.brushed.receive();
        if let Some(found) = self.coming.so_far() {
            (self.found, self.failed) = (Some(found), None);
            self.revision += 1;
        }
        if !self.coming.receive() {
            return;
        }
        match std::mem::take(&mut self.coming) {
            Answer::Here(found) => {
                (self.found, self.failed) = (Some(found), None);
                self.revision += 1;
            }
            Answer::Failed(why) => (self.found, self.failed) = (None, Some(why)),
            Answer::Nothing | Answer::Coming(_) => {}
        }
    }

    /// Writes the plot beside the data, as its extension says.
    pub fn write(&mut self, scene: &Scene, extension: &'static str, scales: ChartScales) {
        let Some(found) = self.found.clone() else { return };
        let out = free_name(&scene.path, &found.plot.title(), extension);
        self.writing = Answer::ask("plot", move |_| {
            let Found { plot, notes, path, .. } = &found;
            match extension {
                "csv" => write_atomically(&out, plot.csv().as_bytes())?,
                "svg" => {
                    plot.chart(path, notes, scales, |chart| write_atomically(&out, chart.svg(SIZE).as_bytes()))?;
                }
                _ => plot.chart(path, notes, scales, |chart| write_png(&out, &chart.picture(SIZE)))?,
            }
            Ok::<_, OutputError>(out)
        });
    }
}

/// The quantities that can be plotted.
pub fn fields_of(scene: &Scene) -> Vec<String> {
    Choices::attributes_of(scene.file.metadata())
}

/// Whether somebody has said whose values are meant: then no button has to be pressed.
pub fn is_meant(of: &PlotOf, prober: &Prober) -> bool {
    match of {
        PlotOf::Selection(_) => true,
        PlotOf::Region => prober.members.is_some(),
        PlotOf::All | PlotOf::View => false,
    }
}

/// The selection that is brushed.
pub fn brush_of(selections: &[SelectionSet]) -> Option<&SelectionSet> {
    selections.iter().find(|set| set.name == BRUSH)
}

/// Makes a region the selection that is brushed.
pub fn brush(selections: &mut Vec<SelectionSet>, region: Region) {
    match selections.iter_mut().find(|set| set.name == BRUSH) {
        Some(set) => set.members = Members::Region(region),
        None => selections.push(SelectionSet::new(BRUSH, region, selections.len())),
    }
}

/// Takes the brush away.
pub fn clear_brush(selections: &mut Vec<SelectionSet>) {
    selections.retain(|set| set.name != BRUSH);
}

/// What a flat picture of a view shows: what is seen in it, of the families that are shown, within the clip box and the slab.
fn in_view(view: &View, data: Bounds, families: Vec<FamilyName>, settings: &Settings) -> Region {
    let (width, height) = (f64::from(view.width), f64::from(view.height));
    let corners = vec![(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)];
    let mut region = Region { families, ..Region::lasso(Lasso::on(view, corners)) };
    let cut = settings.cut.cut();
    if cut.clips() {
        region.shapes.push(Shape::Box { min: cut.bounds.min.max(data.min), max: cut.bounds.max.min(data.max) });
    }
    region
}

/// The families that are shown; none where all are.
fn shown_families(scene: &Scene, settings: &Settings) -> Vec<FamilyName> {
    let is_shown = |index: usize| settings.families.get(index).copied().unwrap_or(true);
    let all = &scene.metadata().families;
    match (0..all.len()).all(is_shown) {
        true => Vec::new(),
        false => all.iter().enumerate().filter(|(index, _)| is_shown(*index)).map(|(_, family)| family.name).collect(),
    }
}

/// Follows what is to be plotted and what is brushed, while the panel shows it.
pub(super) fn follow_plot(
    mut plotting: ResMut<Plotting>,
    mut notices: ResMut<Notices>,
    (scene, settings): (Option<Res<Scene>>, Res<Settings>),
    choice: Res<PlotChoice>,
    (prober, selection, buttons): (Res<Prober>, Res<ViewSelection>, Res<ButtonInput<MouseButton>>),
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let plotting = plotting.bypass_change_detection();
    plotting.receive();
    if plotting.writing.receive() {
        match &plotting.writing {
            Answer::Here(path) => notices.info(format!("plot written to {}", path.display())),
            Answer::Failed(why) => notices.error(why),
            Answer::Nothing | Answer::Coming(_) => {}
        }
    }
    let is_shown = std::mem::take(&mut plotting.is_shown);
    let Some(scene) = scene.filter(|_| is_shown) else { return plotting.rest() };
    if plotting.dataset != scene.dataset {
        let (revision, is_large) = (plotting.revision, plotting.is_large);
        *plotting = Plotting { revision, is_large, dataset: scene.dataset, ..Plotting::default() };
    }
    let moment = Moment { generation: scene.generation, time: scene.time };
    follow_brush(plotting, &scene, &settings, moment, buttons.get_pressed().next().is_some());

    let mut chosen: PlotSettings = choice.0.clone();
    chosen.fit(&fields_of(&scene));
    if !(is_meant(&chosen.of, &prober) || plotting.is_wanted) {
        return;
    }
    let members = match &chosen.of {
        PlotOf::All => Members::Region(Region::whole()),
        PlotOf::Region => prober.members.clone().unwrap_or(Members::Region(Region::whole())),
        PlotOf::View => {
            let Some(view) = &selection.view else { return };
            Members::Region(in_view(view, scene.bounds, shown_families(&scene, &settings), &settings))
        }
        PlotOf::Selection(name) => match settings.selections.iter().find(|set| set.name == *name) {
            Some(set) => set.members.clone(),
            None => {
                (plotting.coming, plotting.found, plotting.asked) = (Answer::Nothing, None, None);
                plotting.failed = Some(format!("there is no selection {name}"));
                return;
            }
        },
    };
    let has_center = members.region().is_some_and(|region| region.first_sphere().is_some());
    let about = (chosen.kind == PlotKind::Radial && !has_center).then_some(camera.target);
    let looks = chosen.of == PlotOf::View || about.is_some();
    if looks && selection.moved.is_some_and(|moved| moved.elapsed() < REST) {
        return;
    }
    plotting.follow(Asked { options: chosen.options(), members, about, moment }, |asked| find(&scene, asked));
}

/// Counts what is brushed, once the mouse is let go.
fn follow_brush(plotting: &mut Plotting, scene: &Scene, settings: &Settings, moment: Moment, is_drawn: bool) {
    let Some(set) = brush_of(&settings.selections) else {
        (plotting.brushed, plotting.counted) = (Answer::Nothing, None);
        return;
    };
    if is_drawn {
        return;
    }
    plotting.count(Counted { members: set.members.clone(), moment }, |counted| {
        let (asking, members) = (Asking::about(scene, &counted.members, false), counted.members.clone());
        Answer::ask("brush", move |work| {
            asking.ask(&members, work, |data, members, periodic| {
                let options = ProbeOptions { fields: Fields::None, profile: None, periodic };
                let found = probe(data, members, &options, work)?;
                let uncertain: u64 = found.families.iter().filter_map(|family| Some(family.uncertain?.count)).sum();
                Ok(Brushed { count: found.count, uncertain })
            })
        })
    });
}

/// Begins to find a plot.
fn find(scene: &Scene, asked: &Asked) -> Answer<Found> {
    let (asking, asked) = (Asking::about(scene, &asked.members, false), asked.clone());
    Answer::ask_in_steps("plot", move |work, tell| {
        asking.ask(&asked.members, work, |data, members, periodic| {
            let members = match asked.about {
                Some(center) => members_about(data, members.clone(), (center, None), periodic, work)?,
                None => members.clone(),
            };
            let region = match &asked.members {
                Members::Region(region) => Some(region.clone()),
                Members::Ids(_) | Members::Tracked { .. } => None,
            };
            let found = |plot: Plot| {
                let (notes, path, region) = (plot.notes(), data.path().to_owned(), region.clone());
                Found { plot: Arc::new(plot), notes, path, region }
            };
            let of = |effort| Plot::find(data, &members, &asked.options, effort, periodic, work);
            let mut longest: Option<Duration> = None;
            for budget in BUDGETS {
                // A source is read as a whole.
                if data.is_exact() || longest.is_some_and(|longest| longest <= WORTH * budget) {
                    break;
                }
                let begun = Instant::now();
                let plot = of(Effort::until(begun + budget))?;
                let Some(estimate) = plot.estimate() else { break };
                let pages = estimate.pages as f64 / estimate.pages_read.max(1) as f64;
                longest = Duration::try_from_secs_f64(pages * begun.elapsed().as_secs_f64()).ok();
                tell(found(plot));
            }
            Ok::<_, ExploreError>(found(of(Effort::ALL)?))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::plot::ScatterAxis;
    use crate::explore::{PlotScale, Show};
    use crate::model::Unit;
    use crate::view::Projection;
    use std::sync::atomic::{AtomicBool, Ordering};

    fn asked(kind: PlotKind, generation: u32) -> Asked {
        let settings = PlotSettings { kind, x: "a".into(), y: "b".into(), ..PlotSettings::default() };
        let moment = Moment { generation, time: None };
        Asked { options: settings.options(), members: Members::Region(Region::whole()), about: None, moment }
    }

    fn found(of: u64) -> Found {
        let fields = ["a", "b"].map(|field| ScatterAxis { field: field.to_owned(), unit: Unit::default() });
        let plot = Plot::Scatter { fields, x: vec![1.0], y: vec![2.0], of, exact: true, estimate: None };
        Found { plot: Arc::new(plot), notes: Vec::new(), path: PathBuf::from("a.df"), region: Some(Region::whole()) }
    }

    /// Work that goes on until it is stopped, and whether it was.
    fn endless() -> (Answer<Found>, Arc<AtomicBool>) {
        let stopped = Arc::new(AtomicBool::new(false));
        let tell = Arc::clone(&stopped);
        let answer = Answer::ask("test", move |work| {
            while !work.stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
            }
            tell.store(true, Ordering::Relaxed);
            Err::<Found, _>("stopped")
        });
        (answer, stopped)
    }

    fn wait(until: impl Fn() -> bool) {
        let start = std::time::Instant::now();
        while !until() {
            assert!(start.elapsed() < Duration::from_secs(30), "waited in vain");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn a_plot_is_asked_for_once_stays_until_the_next_and_is_stopped_for_another() {
        let mut plotting = Plotting::default();
        plotting.follow(asked(PlotKind::Histogram, 1), |_| Answer::ready(found(1)));
        plotting.receive();
        assert_eq!((plotting.revision, plotting.found.as_ref().map(|found| found.plot.particles())), (1, Some(1)));
        plotting.follow(asked(PlotKind::Histogram, 1), |_| unreachable!("it is there"));

        // The next moment's plot is on its way; those after it wait for it, what is shown stays.
        let (first, stopped) = endless();
        plotting.follow(asked(PlotKind::Histogram, 2), |_| first);
        plotting.receive();
        assert!(plotting.found.is_some() && matches!(plotting.coming, Answer::Coming(_)));
        plotting.follow(asked(PlotKind::Histogram, 3), |_| unreachable!("one is on its way"));
        assert!(!stopped.load(Ordering::Relaxed));

        // Another plot ends it.
        plotting.follow(asked(PlotKind::Phase, 3), |_| Answer::ready(found(2)));
        wait(|| stopped.load(Ordering::Relaxed));
        plotting.receive();
        assert_eq!((plotting.revision, plotting.found.as_ref().map(|found| found.plot.particles())), (2, Some(2)));

        // So does closing the panel, and the same is asked for when it opens.
        let (second, stopped) = endless();
        plotting.follow(asked(PlotKind::Scatter, 3), |_| second);
        plotting.rest();
        wait(|| stopped.load(Ordering::Relaxed));
        assert!(plotting.found.is_some());
        let mut is_asked = false;
        plotting.follow(asked(PlotKind::Scatter, 3), |_| {
            is_asked = true;
            Answer::ready(found(3))
        });
        plotting.receive();
        assert!(is_asked && plotting.revision == 3);
        plotting.rest();
        plotting.follow(asked(PlotKind::Scatter, 3), |_| unreachable!("what was found stays"));

        // An estimate is shown until the plot is there.
        let (go, wait) = std::sync::mpsc::channel::<()>();
        plotting.follow(asked(PlotKind::Histogram, 4), |_| {
            Answer::ask_in_steps("test", move |_, tell| {
                tell(found(4));
                wait.recv().map(|()| found(5))
            })
        });
        let particles = |plotting: &Plotting| plotting.found.as_ref().map(|found| found.plot.particles());
        for (revision, of) in [(4, 4), (5, 5)] {
            let start = Instant::now();
            while plotting.revision < revision && start.elapsed() < Duration::from_secs(30) {
                plotting.receive();
            }
            assert_eq!((plotting.revision, particles(&plotting)), (revision, Some(of)));
            assert_eq!(matches!(plotting.coming, Answer::Coming(_)), of == 4);
            // Nobody waits the second time.
            let _ = go.send(());
        }

        // An error takes the place of the plot; it is told once.
        let failing = |_: &Asked| Answer::ask("test", |_| Err::<Found, _>("no such field"));
        plotting.follow(asked(PlotKind::Radial, 3), failing);
        let start = std::time::Instant::now();
        while plotting.failed.is_none() && start.elapsed() < Duration::from_secs(30) {
            plotting.receive();
        }
        assert!(plotting.found.is_none() && plotting.failed.as_deref() == Some("no such field"));
        plotting.follow(asked(PlotKind::Radial, 3), |_| unreachable!("it was told"));
    }

    #[test]
    fn the_scale_of_weights_is_no_other_question() {
        let of = |scale, weight_scale| PlotSettings { scale, weight_scale, ..PlotSettings::default() }.options();
        assert_eq!(of(PlotScale::Auto, PlotScale::Auto), of(PlotScale::Auto, PlotScale::Log));
        assert_ne!(of(PlotScale::Auto, PlotScale::Auto), of(PlotScale::Log, PlotScale::Auto));
    }

    #[test]
    fn there_is_one_brush_which_keeps_its_look_and_what_is_renamed_stays() {
        let region = |x: f64| Region::whole().with_range("a", Some(x), Some(x + 1.0));
        let mut sets = vec![SelectionSet::new("core", region(0.0), 0)];
        brush(&mut sets, region(1.0));
        sets[1].show = Show::Alone;
        brush(&mut sets, region(2.0));
        assert_eq!((sets.len(), sets[1].show), (2, Show::Alone));
        assert_eq!(brush_of(&sets).map(|set| &set.members), Some(&Members::Region(region(2.0))));
        sets[1].name = "hot".into();
        brush(&mut sets, region(3.0));
        assert_eq!(sets.iter().map(|set| set.name.as_str()).collect::<Vec<_>>(), ["core", "hot", BRUSH]);
        clear_brush(&mut sets);
        assert_eq!((sets.len(), brush_of(&sets)), (2, None));
    }

    #[test]
    fn what_is_in_view_is_seen_in_the_picture_and_not_cut_away() {
        use crate::explore::Shapes;
        use crate::window::preset::Preset;
        let projection = Projection::Perspective { fov_y: 0.7 };
        let view = View::look_at(DVec3::new(0.0, 0.0, 9.0), DVec3::ZERO, DVec3::Y, projection, 80, 60).unwrap();
        let data = Bounds { min: DVec3::splat(-5.0), max: DVec3::splat(5.0) };
        let mut settings = Settings::new(&Preset::default(), None);
        let holds = |settings: &Settings, at: DVec3| {
            let region = in_view(&view, data, Vec::new(), settings);
            Shapes::new(&region, None).unwrap().contains(at)
        };
        let beside = DVec3::new(6.0, 0.0, 0.0);
        assert!(holds(&settings, DVec3::ZERO) && !holds(&settings, beside));
        settings.cut.slab =
            Some(crate::view::cut::Slab { axis: crate::view::cut::Axis::Z, middle: 0.0, thickness: 1.0 });
        assert!(holds(&settings, DVec3::ZERO) && !holds(&settings, DVec3::new(0.0, 0.0, 2.0)));
    }
}
