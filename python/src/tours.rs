//! Tours of data: frames as files, and what is shown at a time as a scene.

use crate::error::Failure;
use deepfield_draw::build::default_memory;
use deepfield_draw::color::output;
use deepfield_draw::look::{Backend, DatasetRef, Member};
use deepfield_draw::model::Progress;
use deepfield_draw::picture::asked::State;
use deepfield_draw::picture::{AnySession, PictureError, SessionOptions};
use deepfield_draw::tour::{Frames, Pattern, Show, TourFile, around_data};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A tour that is asked for.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedTour {
    /// Its text in RON; a tour around the data where there is none.
    tour: Option<String>,
    /// The file that it was read from.
    file: Option<PathBuf>,
    /// How long a tour around the data is, seconds.
    seconds: Option<f64>,
    /// Width and height of frames, pixels.
    size: Option<(u32, u32)>,
    /// Frames a second.
    fps: Option<f64>,
    /// From when until when, seconds.
    start: Option<f64>,
    end: Option<f64>,
    /// Names of frames.
    pattern: Option<String>,
    /// Largest displacement of a particle on screen, pixels.
    error_px: Option<f64>,
    /// Bytes that pages, or chunks of heights, may take.
    memory: Option<u64>,
    /// Threads that draw; all where nothing is said.
    pub threads: Option<usize>,
}

impl AskedTour {
    /// Opens it, with what `open` opens of the data.
    ///
    /// # Errors
    /// When the tour or the data cannot be read, or do not fit together.
    pub fn open(
        &self,
        data: &Member,
        open: impl FnOnce(&[Member], SessionOptions) -> Result<AnySession, PictureError>,
        state: &State,
    ) -> Result<Show, Failure> {
        let mut tour = match &self.tour {
            Some(text) => {
                let name = self.file.as_ref().map_or_else(|| "tour".to_owned(), |file| file.display().to_string());
                TourFile::parse(&name, text)?
            }
            None => around_data(self.seconds.unwrap_or(10.0).clamp(2.0, 86_400.0)),
        };
        tour.size = self.size.unwrap_or(tour.size);
        if let Some(error_px) = self.error_px {
            tour.keyframes.iter_mut().for_each(|keyframe| keyframe.look.error_px = Some(error_px));
        }
        // What is said beside the text is checked as the text is.
        let tour = TourFile::parse("tour", &tour.to_ron())?;
        let options = SessionOptions {
            backend: Some(Backend::Cpu),
            page_memory: Some(self.memory.unwrap_or_else(default_memory)),
            chunk_memory: self.memory,
            ..SessionOptions::default()
        };
        let session = open(std::slice::from_ref(data), options)?;
        // A tour of no file is one around the data, which a run plays along.
        let file = self.tour.as_ref().map(|_| self.file.clone().unwrap_or_else(|| PathBuf::from("tour")));
        Show::open(tour, file, data.clone(), session, &mut |note| state.note(note))
    }

    /// Draws the frames into a folder; gives their files.
    ///
    /// # Errors
    /// When a frame cannot be drawn or written. What is finished stays.
    pub fn record(&self, show: &mut Show, folder: &Path, state: &State) -> Result<Vec<PathBuf>, Failure> {
        let rate = self.fps.unwrap_or(show.tour.rate);
        if !(rate.is_finite() && rate > 0.0) {
            return Err(format!("fps: found {rate}, expected a number greater than 0").into());
        }
        let frames = Frames::new(show.duration(), show.repeats(), rate, [self.start, self.end])?;
        let pattern = self.pattern.as_deref().unwrap_or("frame-%05d");
        let pattern =
            pattern.parse::<Pattern>().map_err(|expected| format!("pattern: found {pattern:?}, {expected}"))?;
        let named = |frame: u32| pattern.file(folder, u64::from(frame), "png");
        show.check_written(&frames.range.clone().map(named).collect::<Vec<_>>())?;
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        state.begin("drawing frames", frames.count() as u64);
        let mut last = None;
        let mut files = Vec::new();
        for frame in frames.range.clone() {
            // Until there is a picture, which may take long.
            state.set_writing(false);
            let shot = show.shot(frames.time(frame), folder)?;
            state.go_on();
            // Frames of a pause are the same picture.
            let image = match last.take() {
                Some((before, image)) if before == shot => image,
                _ => show.take(&shot, None)?.image,
            };
            state.set_writing(true);
            // Whoever has given up may look at what is there meanwhile: no more frames come.
            state.go_on();
            let file = named(frame);
            output::write_png(&file, &image)?;
            files.push(file);
            last = Some((shot, image));
            state.advance(1);
        }
        Ok(files)
    }

    /// The text in RON of the scene that is shown at a time: data.render(scene=...) draws the same.
    ///
    /// # Errors
    /// When a picture that ranges are found from cannot be drawn.
    pub fn scene(&self, show: &mut Show, time: f64) -> Result<String, Failure> {
        if !time.is_finite() {
            return Err(format!("time: found {time}, expected a number of seconds").into());
        }
        let place = Path::new("tour");
        let mut scene = show.shot(time, place)?;
        // It may be written into any folder.
        for dataset in &mut scene.datasets {
            *dataset = DatasetRef { fingerprint: dataset.fingerprint, ..DatasetRef::from(show.data.clone()) };
        }
        Ok(scene.text(place)?)
    }
}
