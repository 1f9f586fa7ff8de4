//! Two hierarchies of one dataset side by side: the same view through each, with a divider between them, or their difference.
//!
//! Both pictures are drawn by the processor on a thread of its own, from the page file, once the view rests; whatever draws the window's
//! own picture, which is shown until they are there.

use super::look::Look;
use super::pages::ViewSelection;
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::sheet::Sheet;
use super::state::answer::Answer;
use super::state::notices::Notices;
use super::statistics::ActiveBackend;
use super::touring::look::of;
use crate::color::Image;
use crate::color::composite::{color_error, enlarged_difference};
use crate::color::transfer::Levels as Ranges;
use crate::look::LookPatch;
use crate::mode::SettingValue;
use crate::mode::levels::{LEVELS, REPRESENTATIVE, SPLATS};
use crate::model::FamilyName;
use crate::picture::{PictureError, Session};
use crate::view::View;
use bevy::prelude::*;
use serde::Serialize;

/// Memory for pages that the pictures are drawn from, bytes.
const BUDGET: u64 = 1 << 30;

/// A way from the file's hierarchies to a picture.
#[derive(Debug, PartialEq, Eq)]
pub struct Way {
    /// What users call it.
    pub name: &'static str,
    /// What it is.
    pub about: &'static str,
    levels: &'static str,
    representative: &'static str,
}

/// All ways.
pub static WAYS: [Way; 3] = [
    Way { name: "octree", about: "merged particles", levels: "splats", representative: "ellipsoid" },
    Way { name: "pca", about: "clusters with a shape", levels: "clusters", representative: "ellipsoid" },
    Way { name: "pca-round", about: "clusters, drawn round", levels: "clusters", representative: "round" },
];

/// What is compared, and how it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// At the left and at the right.
    pub ways: [&'static Way; 2],
    /// Splats of either side at most; 0: as many as the error bound asks for.
    pub splats: f64,
}

/// What the pictures are drawn from.
#[derive(Clone, PartialEq)]
struct Key {
    compared: Compared,
    view: View,
    look: LookPatch,
    ranges: Ranges,
    dataset: u32,
}

/// Both pictures.
struct Drawn {
    images: [Image; 2],
    difference: Image,
    /// Particles or clusters of each.
    splats: [u64; 2],
    /// Mean distance of their colours, of 255.
    color_error: f64,
}

/// What is being drawn.
type Coming = Answer<(Session, Result<Drawn, PictureError>)>;

/// The comparison.
#[derive(Resource)]
pub struct Comparison {
    /// Whether there is one.
    pub is_on: bool,
    /// What of.
    pub compared: Compared,
    /// Whether the difference of the pictures is shown in place of them.
    pub shows_difference: bool,
    /// Where the divider is, from 0 at the left to 1.
    pub divider: f32,
    /// Left, right and their difference; filled when they are painted.
    sheets: [Sheet; 3],
    are_filled: bool,
    coming: Option<(Key, Coming)>,
    drawn: Option<(Key, Drawn)>,
    failed: Option<Key>,
    session: Option<(u32, Session)>,
    /// Whether the pictures are of what the window shows.
    is_current: bool,
}

impl Default for Comparison {
    fn default() -> Comparison {
        Comparison {
            is_on: false,
            compared: Compared { ways: [&WAYS[0], &WAYS[1]], splats: 20_000.0 },
            shows_difference: false,
            divider: 0.5,
            sheets: Default::default(),
            are_filled: false,
            coming: None,
            drawn: None,
            failed: None,
            session: None,
            is_current: false,
        }
    }
}

/// What is told of the pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Particles or clusters at the left and at the right.
    pub splats: [u64; 2],
    /// Mean distance of their colours, of 255.
    pub color_error: f64,
}

impl Comparison {
    /// What there is to tell of the pictures, where these are of what the window shows.
    pub fn found(&self) -> Option<Found> {
        let (_, drawn) = self.drawn.as_ref().filter(|_| self.is_on && self.is_current)?;
        Some(Found { splats: drawn.splats, color_error: drawn.color_error })
    }

    /// Whether pictures are being drawn.
    pub fn is_drawing(&self) -> bool {
        self.coming.is_some()
    }

    /// The pictures as textures, left, right and their difference, where they are of what the window shows.
    pub fn sheets(&mut self, ctx: &bevy_egui::egui::Context) -> Option<&[Sheet; 3]> {
        use bevy_egui::egui::{Color32, TextureOptions};
        let (_, drawn) = self.drawn.as_ref().filter(|_| self.is_on && self.is_current)?;
        if !std::mem::replace(&mut self.are_filled, true) {
            let images = [&drawn.images[0], &drawn.images[1], &drawn.difference];
            for ((sheet, image), name) in self.sheets.iter_mut().zip(images).zip(["left", "right", "difference"]) {
                let size = [image.width as usize, image.height as usize];
                let color = |i: usize| Color32::from_rgb(image.rgba[i][0], image.rgba[i][1], image.rgba[i][2]);
                sheet.fill(ctx, (name, TextureOptions::NEAREST), size, color);
            }
        }
        Some(&self.sheets)
    }

    /// Takes in what has been drawn.
    fn receive(&mut self, notices: &mut Notices) {
        let Some((key, mut answer)) = self.coming.take() else { return };
        if !answer.receive() {
            self.coming = Some((key, answer));
            return;
        }
        let drawn = match answer {
            Answer::Here((session, drawn)) => {
                self.session = Some((key.dataset, session));
                drawn.map_err(|error| error.to_string())
            }
            Answer::Failed(why) => Err(why),
            Answer::Nothing | Answer::Coming(_) => return,
        };
        match drawn {
            Ok(drawn) => (self.drawn, self.are_filled) = (Some((key, drawn)), false),
            Err(why) => {
                notices.error(format!("the comparison: {why}"));
                self.failed = Some(key);
            }
        }
    }

    /// Begins to draw.
    fn start(&mut self, key: Key, scene: &Scene) {
        let known = self.session.take().filter(|(dataset, _)| *dataset == scene.dataset);
        let (open, wanted) = (scene.opener(BUDGET), key.clone());
        let diameter = scene.frame.size().length();
        let answer = Answer::ask("comparison", move |_| {
            let mut session = known.map_or_else(open, |(_, session)| Ok(session))?;
            let drawn = draw(&mut session, &wanted, diameter);
            Ok::<_, PictureError>((session, drawn))
        });
        self.coming = Some((key, answer));
    }
}

/// A look through one of the ways.
fn through(look: &LookPatch, way: &Way, splats: f64) -> LookPatch {
    let mut budget = look.budget.clone();
    budget.set(&LEVELS, SettingValue::Name(way.levels.into()));
    budget.set(&REPRESENTATIVE, SettingValue::Name(way.representative.into()));
    budget.set(&SPLATS, SettingValue::Number(splats));
    LookPatch { budget, ..look.clone() }
}

fn draw(session: &mut Session, key: &Key, diameter: f64) -> Result<Drawn, PictureError> {
    let mut side = |way: &Way| {
        let look = through(&key.look, way, key.compared.splats);
        session.image(&look, &key.view, Some(key.ranges), diameter, u64::MAX)
    };
    let [left, right] = key.compared.ways;
    let ((left, few), (right, many)) = (side(left)?, side(right)?);
    let difference = enlarged_difference(&left, &right);
    let color_error = color_error(&left, &right).0;
    Ok(Drawn { images: [left, right], difference, splats: [few, many], color_error })
}

/// Whether hierarchies of what is open can be compared: where a file has several, in modes that draw each of them.
pub fn applies(look: &Look, scene: &Scene) -> bool {
    look.depiction.takes_clusters() && scene.metadata().has_clusters()
}

/// Draws both pictures of a view that rests.
pub(super) fn compare(
    mut comparison: ResMut<Comparison>,
    (scene, settings, look): (Option<Res<Scene>>, Res<Settings>, Option<Res<Look>>),
    (selection, preset, backend): (Res<ViewSelection>, Res<Preset>, Res<ActiveBackend>),
    mut notices: ResMut<Notices>,
) {
    let comparison = comparison.bypass_change_detection();
    comparison.receive(notices.bypass_change_detection());
    comparison.is_current = false;
    let (Some(scene), Some(look), Some(view)) = (scene, look, selection.view) else { return };
    // Where nothing can be compared the panel has no switch to end it.
    if !comparison.is_on || *backend == ActiveBackend::Surround || !applies(&look, &scene) {
        if comparison.coming.is_none() {
            (comparison.drawn, comparison.session) = (None, None);
        }
        return;
    }
    let names: Vec<FamilyName> = scene.metadata().families.iter().map(|family| family.name).collect();
    let shown = LookPatch { time: scene.when(), ..of(&settings, &names) };
    let key = Key {
        compared: comparison.compared.clone(),
        view,
        look: LookPatch { transfer: Some(look.transfer.clone()), ..shown },
        ranges: look.levels,
        dataset: scene.dataset,
    };
    comparison.is_current = comparison.drawn.as_ref().is_some_and(|(drawn, _)| *drawn == key);
    let rests = selection.moved.is_none_or(|at| at.elapsed().as_millis() >= u128::from(preset.motion.rest_ms));
    let has_failed = comparison.failed.as_ref() == Some(&key);
    if comparison.is_current || comparison.coming.is_some() || has_failed || !rests || !look.settled {
        return;
    }
    comparison.start(key, &scene);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::look::follow_settings;
    use crate::window::touring::player::tests::Window;
    use crate::window::transfer_presets::TransferPresets;

    #[test]
    fn nothing_is_compared_in_a_file_with_one_hierarchy() {
        let mut window = Window::new();
        let app = &mut window.app;
        app.init_resource::<TransferPresets>().init_resource::<ViewSelection>().init_resource::<ActiveBackend>();
        app.insert_resource(Comparison { is_on: true, ..Comparison::default() });
        app.add_systems(Last, (follow_settings, compare).chain());
        window.frame(0.0);
        let world = window.app.world_mut();
        assert!(!world.resource::<Scene>().file.metadata().has_clusters(), "the demo has an octree alone");
        let bounds = world.resource::<Scene>().bounds;
        let view = View::around(bounds, 0.8, 32, 24).unwrap();
        world.resource_mut::<ViewSelection>().view = Some(view);
        world.resource_mut::<Look>().settled = true;
        window.frame(0.0);
        assert!(!window.app.world().resource::<Comparison>().is_drawing());
    }
}
