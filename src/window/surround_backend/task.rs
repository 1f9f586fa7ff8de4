//! What the thread does that draws panoramas, and what is handed to and fro.

use super::{Content, Wanted};
use crate::color::Image;
use crate::color::transfer::{Levels, TransferFunction};
use crate::mode::Raw;
use crate::model::Progress;
use crate::picture::field::PointsReport;
use crate::picture::{AnySession, Picture, PictureError, Reporter, Subject};
use crate::window::exposure::Exposure;
use crate::window::statistics::Statistics;
use bevy::math::UVec2;
use std::collections::HashSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// What the session says, each sentence once, and whether it is to go on.
#[derive(Clone, Default)]
pub struct Told(Arc<Messages>);

#[derive(Default)]
struct Messages {
    is_stopped: AtomicBool,
    /// All that was said, and what of it is new.
    said: Mutex<(HashSet<String>, Vec<String>)>,
}

impl Told {
    /// What is drawn is given up, or from now on wanted.
    pub fn stop(&self, is_stopped: bool) {
        self.0.is_stopped.store(is_stopped, Ordering::Relaxed);
    }

    /// What is new.
    pub fn messages(&self) -> Vec<String> {
        std::mem::take(&mut self.0.said.lock().unwrap_or_else(PoisonError::into_inner).1)
    }
}

impl Reporter for Told {
    fn tell(&self, message: String) {
        let mut said = self.0.said.lock().unwrap_or_else(PoisonError::into_inner);
        if said.0.insert(message.clone()) {
            said.1.push(message);
        }
    }

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(())
    }

    fn is_stopped(&self) -> bool {
        self.0.is_stopped.load(Ordering::Relaxed)
    }
}

/// What is known of a picture's values.
#[derive(Default)]
pub struct Facts {
    /// Whether everything was drawn that it needs at its error bound.
    pub converged: bool,
    particles: u64,
    nodes: usize,
    error_px: f64,
    levels: &'static str,
    backend: String,
    points: Option<PointsReport>,
}

impl Facts {
    /// Tells them to whoever looks at the statistics.
    pub fn tell(&self, draw_ms: Option<f64>, statistics: &mut Statistics) {
        if statistics.backend != self.backend {
            self.backend.clone_into(&mut statistics.backend);
        }
        let &Facts { particles, nodes, error_px, levels, .. } = self;
        (statistics.particles, statistics.nodes, statistics.error_px) = (particles, nodes, error_px);
        (statistics.levels, statistics.draw_ms, statistics.points) = (levels, draw_ms, self.points);
        (statistics.sampled, statistics.live, statistics.slabs) = (None, None, None);
        (statistics.missing, statistics.hidden) = (0, 0);
        statistics.passes.clear();
    }
}

/// A picture's values.
pub struct Drawn {
    content: Content,
    /// The room that it was drawn for, pixels.
    pub area: UVec2,
    /// None where no family is shown.
    picture: Option<Picture>,
    /// The transfer function that its exposure was measured for.
    exposed: Option<TransferFunction>,
}

impl Drawn {
    /// What is known of them.
    pub fn facts(&self) -> Facts {
        match &self.picture {
            None => Facts { converged: true, ..Facts::default() },
            Some(picture) => Facts {
                converged: picture.converged,
                particles: picture.particles,
                nodes: picture.nodes,
                error_px: picture.error_px,
                levels: picture.drawn_from,
                backend: picture.drawn_by[0].clone(),
                points: picture.points,
            },
        }
    }
}

/// What the thread hands back.
pub struct Done {
    /// The picture's values.
    pub drawn: Drawn,
    /// Its colours.
    pub image: Image,
    /// What was measured in it, where that is new.
    pub exposure: Option<Exposure>,
    /// How long it took, where it was drawn anew.
    pub milliseconds: Option<f64>,
}

/// Draws what is wanted; `known`: the values of the picture before, of which nothing is drawn where they are the same.
///
/// # Errors
/// As [`AnySession::draw`].
pub fn draw(session: &mut AnySession, wanted: &Wanted, known: Option<Drawn>) -> Result<Done, PictureError> {
    let start = Instant::now();
    let Wanted { content, area, shot, levels, is_empty } = wanted;
    if let Some(session) = session.particles() {
        session.show_members(content.members.clone());
    }
    let known = known.filter(|known| known.content == *content && known.area == *area);
    let is_new = known.is_none();
    let mut drawn = match known {
        Some(known) => known,
        None => {
            let picture = if *is_empty { None } else { Some(session.draw(shot)?) };
            Drawn { content: content.clone(), area: *area, picture, exposed: None }
        }
    };
    let Some(picture) = &mut drawn.picture else {
        let (width, height) = shot.size();
        return Ok(Done { drawn, image: Image::black(width, height), exposure: None, milliseconds: None });
    };
    // The picture that it is blended with may be of another moment.
    let tree = session.particles().map(|session| Arc::clone(session.tree()));
    let transfer = shot.look.transfer.clone().unwrap_or_else(|| picture.transfer.clone());
    if let Raw::Sums(..) = picture.values {
        picture.transfer = levels.map_or_else(|| transfer.clone(), |levels| transfer.clone().with_levels(&levels));
    }
    let image = session.finished(shot, picture)?;
    let measure = || match (&picture.values, tree, session) {
        (Raw::Light(painted), Some(tree), _) => {
            let found = Levels { p: painted.levels.density, s: painted.levels.attribute };
            let subject = Subject::new(tree.metadata(), &picture.annotation.depiction, &transfer, 0.0);
            Ok::<_, PictureError>(Exposure::of_codebooks(&subject, found))
        }
        (Raw::Light(_), None, AnySession::Field(session)) => Ok(Exposure::of_field(&session.prepare(shot)?)),
        (Raw::Sums(sums, _), ..) => Ok(Exposure::of(sums, &transfer)),
        (Raw::Light(painted), None, AnySession::Particles(_) | AnySession::Surface(_) | AnySession::Mixed(_)) => {
            let levels = Levels { p: painted.levels.density, s: painted.levels.attribute };
            Ok(Exposure { levels: Some(levels), ..Exposure::default() })
        }
    };
    let is_measured = drawn.exposed.as_ref() == Some(&transfer);
    let exposure = if is_measured { None } else { Some(measure()?) };
    drawn.exposed = Some(transfer);
    let milliseconds = is_new.then(|| 1e3 * start.elapsed().as_secs_f64());
    Ok(Done { drawn, image, exposure, milliseconds })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build_source};
    use crate::import::LoadOptions;
    use crate::look::{LookPatch, Member, Shot};
    use crate::picture::Session;
    use crate::store::PageFile;
    use crate::view::Surround;
    use crate::window::preset::Backend;
    use std::path::Path;

    #[test]
    fn other_colours_need_no_other_picture_and_nobody_waits_for_one_that_is_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        let output = folder.path().join("demo.df");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &output, &()).unwrap();
        let file = Arc::new(PageFile::open(&output).unwrap());
        let told = Told::default();
        let session = Session::of(Arc::clone(&file), 1 << 30).with_reporter(Arc::new(told.clone()));
        let mut session = AnySession::Particles(Box::new(session));
        let wanted = |transfer: &str, levels| {
            let transfer = TransferFunction::preset(transfer);
            let look = LookPatch { transfer, ..LookPatch::default() };
            let surround = Surround::Dome { aperture: 180.0, tilt: 0.0 };
            let shot = Shot { look, size: Some((64, 64)), surround, ..Shot::default() };
            let content = Content {
                dataset: 1,
                backend: Backend::Auto,
                members: vec![Member::new(&output)],
                shot: Shot { look: LookPatch::default(), size: None, ..shot.clone() },
            };
            Wanted { content, area: UVec2::splat(64), shot, levels, is_empty: false }
        };
        told.stop(true);
        let given_up = draw(&mut session, &wanted("density", None), None);
        assert!(matches!(given_up, Err(PictureError::Stopped)));
        told.stop(false);
        let first = draw(&mut session, &wanted("density", None), None).unwrap();
        assert!(first.milliseconds.is_some() && first.drawn.facts().converged);
        let found = first.exposure.unwrap().levels.unwrap();
        // The same ranges, found and given, give the same picture.
        let same = wanted("density", Some(found));
        let same = draw(&mut session, &same, Some(first.drawn)).unwrap();
        assert!(same.milliseconds.is_none() && same.exposure.is_none() && same.image == first.image);
        // Nothing is drawn for others: it would be given up.
        told.stop(true);
        let brighter = Levels { p: [found.p[0], 0.1 * found.p[1]], ..found };
        let bright = draw(&mut session, &wanted("density", Some(brighter)), Some(same.drawn)).unwrap();
        assert!(bright.image != first.image && bright.exposure.is_none());
        let other = draw(&mut session, &wanted("density-hue", None), Some(bright.drawn)).unwrap();
        assert!(other.exposure.is_some());
        // A message is handed on once.
        told.tell("a".into());
        told.tell("a".into());
        assert_eq!((told.messages(), told.messages().len()), (vec!["a".to_owned()], 0));
    }

    #[test]
    fn a_picture_in_motion_is_not_refined_for_its_hue() {
        let shot = Shot::default();
        let content = Content { dataset: 1, backend: Backend::Auto, members: Vec::new(), shot: shot.clone() };
        let at_rest = Wanted { content, area: UVec2::splat(64), shot, levels: None, is_empty: false };
        let mut moving = at_rest.clone();
        moving.leave_hue(1.0);
        assert!(moving == at_rest);
        moving.leave_hue(0.25);
        for look in [&moving.shot.look, &moving.content.shot.look] {
            assert_eq!(0.25 * look.error_px(), LookPatch::default().error_px());
        }
        assert!(moving != at_rest);
    }
}
