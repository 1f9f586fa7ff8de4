//! A tour with its data: from a time to a scene, and from that to a picture.

use super::exposure::is_searched;
use super::{Exposure, State, Surroundings, Timeline, TourFile, play_along};
use crate::annotate::overlay::{Overlay, read_png};
use crate::color::{Image, output};
use crate::look::{Camera, DatasetRef, Film, LookPatch, Member, SceneFile, Shot, file_among};
use crate::picture::ranges::Format;
use crate::picture::{AnySession, Picture, Session};
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A tour that is shown.
pub struct Show {
    /// What was read, with what is asked for over it.
    pub tour: TourFile,
    /// The data, and what is said of it where it is of heights.
    pub data: Member,
    /// When what is shown.
    pub timeline: Timeline,
    session: AnySession,
    exposure: Exposure,
    /// The tour's folder.
    folder: PathBuf,
    /// Whether anything was drawn coarser than the tour asks for.
    is_coarser: bool,
}

/// A drawn frame.
pub struct Take {
    /// The finished picture.
    pub image: Image,
    /// What it was made from.
    pub picture: Picture,
}

impl Show {
    /// Resolves a tour, of a file or of none, for data that is open; what there is to tell goes to `tell`.
    ///
    /// # Errors
    /// When the data or a picture to lay over it cannot be read, or a keyframe looks at something that is not there, or shows it by what is not
    /// in the data.
    pub fn open(
        mut tour: TourFile,
        file: Option<PathBuf>,
        data: Member,
        mut session: AnySession,
        tell: &mut dyn FnMut(String),
    ) -> Result<Show, Failure> {
        if session.has_z_up() {
            tour.up = tour.up.or(Some([0.0, 0.0, 1.0]));
        }
        let framed = session.framed(&LookPatch::default())?;
        let particles = session.particles().map(|session| &*session);
        let parent = file.as_deref().and_then(Path::parent).filter(|parent| !parent.as_os_str().is_empty());
        let folder = parent.unwrap_or(Path::new(".")).to_owned();
        let surroundings = Surroundings {
            file: file.as_ref().map_or_else(|| "the tour".into(), |file| file.display().to_string()),
            text: file.as_ref().and_then(|file| std::fs::read_to_string(file).ok()).unwrap_or_default(),
            folder: folder.clone(),
            framed,
            aspect: f64::from(tour.size.0) / f64::from(tour.size.1),
            times: particles.and_then(Session::run).map(|run| run.times().clone()),
            data: particles.and_then(Session::opened).filter(|data| data.run().is_some()).cloned(),
        };
        if let (None, Some(times)) = (&file, &surroundings.times) {
            play_along(&mut tour, times);
        }
        if surroundings.times.is_none() && tour.keyframes.iter().any(|keyframe| keyframe.look.time.is_some()) {
            tell(format!("{}: is one snapshot, so the tour's times are left out", data.path.display()));
        }
        let timeline = Timeline::new(&tour, &surroundings)?;
        // Not only when the recording comes there.
        let place = |number: usize| format!("{}: keyframe {}", surroundings.file, number + 1);
        for (number, stop) in timeline.stops().iter().enumerate() {
            session.check(&stop.look).map_err(|error| format!("{}: {error}", place(number)))?;
        }
        for (number, keyframe) in tour.keyframes.iter().enumerate() {
            for image in keyframe.images.iter().flatten() {
                read_png(&folder.join(&image.path)).map_err(|error| format!("{}: {error}", place(number)))?;
            }
        }
        Ok(Show {
            exposure: Exposure::new(&timeline),
            tour,
            data,
            timeline,
            session,
            folder: folder.canonicalize().unwrap_or(folder),
            is_coarser: false,
        })
    }

    /// Looks whether frames would be written over the data, or over what the tour names, before any is.
    ///
    /// # Errors
    /// One line with the first of the files `frames` for which they would.
    pub fn check_written(&self, frames: &[PathBuf]) -> Result<(), Failure> {
        // Only its folder counts.
        let mut read = self.tour.files(&self.folder.join("tour"));
        read.push(self.data.path.clone());
        match file_among(frames.iter().map(PathBuf::as_path), &read) {
            Some(over) => {
                let over = over.display();
                Err(format!("{over}: cannot be written: found a file that is read, expected another folder").into())
            }
            None => Ok(()),
        }
    }

    /// How long it is, seconds.
    pub fn duration(&self) -> f64 {
        self.timeline.duration()
    }

    /// Whether it begins again at its end.
    pub fn repeats(&self) -> bool {
        self.timeline.repeats()
    }

    /// Bytes that what is drawn may take in memory, where frames that need more are coarser.
    pub fn memory(&self) -> Option<u64> {
        self.session.memory()
    }

    /// Whether a frame so far, or a picture that ranges were found from, was drawn coarser than the tour asks for, since memory has no room for more:
    /// then frames are the same only with as much.
    pub fn is_coarser(&self) -> bool {
        self.is_coarser
    }

    fn note_memory(&mut self) {
        self.is_coarser |= self.session.lacks_memory();
    }

    /// The scene of a look from a camera, as a file in `place` names the data.
    fn scene(&self, look: &LookPatch, camera: Camera, place: &Path) -> SceneFile {
        let dataset = DatasetRef::of_member(&self.data, place);
        let TourFile { size, projection, stereo, .. } = self.tour;
        let look = look.clone();
        SceneFile { look, size: Some(size), camera: Some(camera), projection, stereo, ..SceneFile::new(vec![dataset]) }
    }

    /// What is shown at a time, as a scene file in `place` says it: a scene with numbers for all ranges that are found from pictures.
    ///
    /// # Errors
    /// When a picture that ranges are found from cannot be drawn.
    pub fn shot(&mut self, time: f64, place: &Path) -> Result<SceneFile, Failure> {
        let state = self.timeline.state(time);
        let look = self.exposed(state.keyframe, state.time, &state.look)?;
        let mut scene = self.scene(&look, state.camera, place);
        let mut film = Film { overlay: self.overlay(&state), ..Film::default() };
        if let Some(blend) = &state.blend {
            let before = self.exposed(state.keyframe.saturating_sub(1), state.time, &blend.look)?;
            film.from = Some(Box::new(self.scene(&before, blend.camera, place)));
            film.share = blend.share as f32;
        }
        scene.film = (film.from.is_some() || !film.overlay.is_empty()).then_some(film);
        Ok(scene)
    }

    fn overlay(&self, state: &State) -> Overlay {
        let mut images = state.images.clone();
        images.iter_mut().for_each(|image| image.path = self.folder.join(&image.path));
        Overlay { caption: state.caption.text.clone(), caption_opacity: state.caption.opacity, images }
    }

    /// A look after a keyframe with the ranges that it has at a time.
    fn exposed(&mut self, keyframe: usize, time: f64, look: &LookPatch) -> Result<LookPatch, Failure> {
        if is_searched(look) {
            let needed = self.exposure.needed(keyframe, time);
            for &moment in &needed {
                if self.exposure.knows(moment) {
                    continue;
                }
                let state = self.timeline.state(self.exposure.time(moment));
                let format = Format { size: self.tour.size, surround: self.tour.projection };
                let measured = self.session.ranges(&state.look, &state.camera, format)?;
                self.note_memory();
                self.exposure.take(moment, measured);
            }
            // Moments long past are not needed again by one who goes on.
            needed.first().into_iter().for_each(|first| self.exposure.forget_before(*first));
        }
        Ok(self.exposure.exposed(keyframe, time, look).unwrap_or_else(|| look.clone()))
    }

    /// Draws a shot; what the shot at `next` will need is read meanwhile. What there is no memory for is drawn coarser.
    ///
    /// # Errors
    /// When it cannot be drawn, or some of it cannot be read.
    pub fn take(&mut self, shot: &SceneFile, next: Option<f64>) -> Result<Take, Failure> {
        if let Some(session) = self.session.particles() {
            let (width, height) = self.tour.size;
            let periodic = session.tree().metadata().periodic_box();
            let ahead = next.map(|next| self.timeline.state(next)).and_then(|state| {
                let view = state.camera.view(width, height).ok()?;
                Some(state.look.cut.unwrap_or_default().applied(&view, state.camera.target.into(), periodic))
            });
            session.look_ahead(ahead);
        }
        let shot = Shot::of_scene(shot.clone(), Path::new(""));
        let picture = self.session.draw(&shot)?;
        self.note_memory();
        // All of an image or a volume is there: what is not converged keeps to the time that its look leaves it.
        if !picture.converged && !picture.is_coarser && self.session.field().is_none() {
            let why = match self.session.particles().is_some_and(|session| session.misses_for_memory()) {
                true => "a page that the frame needs does not fit into memory; --memory sets how much there is",
                false => "pages that the frame needs cannot be read",
            };
            return Err(format!("{}: {why}", self.data.path.display()).into());
        }
        let image = self.session.finished(&shot, &picture)?;
        // The picture that it is blended with was drawn just now.
        self.note_memory();
        Ok(Take { image, picture })
    }

    /// Draws one frame into a file.
    ///
    /// # Errors
    /// As [`Show::take`], and when the file cannot be written.
    pub fn still(&mut self, time: f64, output: &Path) -> Result<(), Failure> {
        let extension = output.extension().and_then(|extension| extension.to_str());
        if !matches!(extension, Some("png" | "exr")) {
            return Err(format!("{}: expected a name that ends in .png or .exr", output.display()).into());
        }
        let shot = self.shot(time, output)?;
        let take = self.take(&shot, None)?;
        match extension {
            Some("exr") => Ok(take.picture.write_exr(output)?),
            _ => Ok(output::write_png(output, &take.image)?),
        }
    }
}
