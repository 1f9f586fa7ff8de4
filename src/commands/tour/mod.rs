//! `deepfield tour`: pictures and videos of a tour, every frame converged.

mod avi;
mod journal;
mod manifest;
mod record;
mod timetable;
mod video;

use super::arguments::{PictureSize, not_negative, positive};
use super::light_options::LightOptions;
use super::projection_options::ProjectionOptions;
use super::{CommandResult, request};
use crate::build::default_memory;
use crate::look::{Backend, Member, Shot, data_file};
use crate::model::ron_file::RonError;
use crate::picture::SessionOptions;
use crate::tour::{Frames, Pattern, Show, TourError, TourFile, around_data};
use crate::view::{CubeLayout, Surround};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Renders a tour: pictures, a video, one frame, or its timetable.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield tour --around snapshot_099.hdf5 --seconds 10 --video around.mp4      a video of any data
  deepfield tour assets/tours/demo.ron --check                                   the timetable, and what is too fast or not there
  deepfield tour assets/tours/demo.ron --record frames --size 1920x1080 --fps 30
  deepfield tour show.ron snapshot_099.hdf5 --record frames --video show.mp4     other data than the tour names
  deepfield tour --around snapshot_099.hdf5 --projection dome --tilt 20 --size 2048x2048 --video dome.avi
  deepfield tour show.ron --exposure adaptive --bloom 0.3 --video show.mp4       as an eye sees it
  deepfield tour show.ron --frame 250 still.png
  deepfield tour show.ron --record frames --start 12.5 --end 20                  a part, with the same numbers
  deepfield render frames/scenes/frame-00250.scene.ron -o same.png               any frame again
A recording that was interrupted goes on where it was: give the same command again.
The processor draws, at any size up to 32768x32768, unless --backend says otherwise.")]
#[command(group = clap::ArgGroup::new("what").args(["record", "video", "frame", "check"]).required(true).multiple(true))]
pub struct Arguments {
    /// The tour file.
    #[arg(required_unless_present = "around", conflicts_with = "around")]
    pub tour: Option<PathBuf>,
    /// The data, instead of what the tour names: a file, or the URL of a built one.
    pub data: Option<PathBuf>,
    /// A tour around this data, a file or the URL of a built one, instead of one from a file.
    #[arg(long, value_name = "DATA")]
    pub around: Option<PathBuf>,
    /// How long that tour is, 2 seconds at least [default: 10].
    #[arg(long, value_name = "SECONDS", value_parser = positive, requires = "around")]
    pub seconds: Option<f64>,
    /// The mode of that tour; `deepfield modes` lists them [default: the data's usual one].
    #[arg(long, value_name = "NAME", value_parser = super::arguments::mode_name, requires = "around")]
    pub mode: Option<&'static crate::mode::Mode>,
    /// Write every frame into this folder, and beside each a scene file that makes it again.
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Write a video: .avi (Motion-JPEG, nothing else needed), or .mp4, .mkv, .webm or .mov where ffmpeg is installed.
    #[arg(long, value_name = "FILE")]
    pub video: Option<PathBuf>,
    /// Write one frame, counted from 0, to a PNG file.
    #[arg(long, num_args = 2, value_names = ["N", "OUT.png"], conflicts_with_all = ["record", "video"])]
    pub frame: Option<Vec<String>>,
    /// Print the timetable with speeds, and what is too fast or not in the data; nothing is drawn.
    #[arg(long, conflicts_with_all = ["record", "video", "frame"])]
    pub check: bool,
    /// Picture size in pixels [default: the tour's; 1280x720 around data].
    #[arg(long, value_name = "WxH")]
    pub size: Option<PictureSize>,
    /// How directions become a picture, and for which eyes.
    #[command(flatten)]
    pub projection: ProjectionOptions,
    /// Frames per second [default: the tour's, 30 unless it says so].
    #[arg(long, value_name = "RATE", value_parser = positive)]
    pub fps: Option<f64>,
    /// The first frame is the one at this time, seconds [default: 0].
    #[arg(long, value_name = "SECONDS", value_parser = not_negative)]
    pub start: Option<f64>,
    /// No frames from this time on, seconds [default: the tour's end].
    #[arg(long, value_name = "SECONDS", value_parser = not_negative)]
    pub end: Option<f64>,
    /// Number in the name of the tour's first frame.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub offset: u32,
    /// Names of frames without their extension; %05d stands for the number with at least five digits.
    #[arg(long, value_name = "PATTERN", default_value = "frame-%05d")]
    pub name: Pattern,
    /// What frames are written as: png, exr (raw channels) or png,exr.
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', default_value = "png")]
    pub format: Vec<Format>,
    /// Write no scene file for each frame.
    #[arg(long)]
    pub no_scenes: bool,
    /// Begin anew in a folder that holds another recording, or that of a video which was interrupted: its frames are removed.
    #[arg(long, conflicts_with_all = ["frame", "check"])]
    pub restart: bool,
    /// How light is exposed and spreads.
    #[command(flatten)]
    pub light: LightOptions,
    /// Largest displacement of a particle on screen, pixels; a quarter of it where an attribute colours density-squared
    /// [default: the tour's, else 0.8].
    #[arg(long, value_name = "TAU", value_parser = positive)]
    pub error_px: Option<f64>,
    /// What draws: cpu, or compute or raster (an adapter, opened anew for each frame) [default: cpu].
    #[arg(long)]
    pub backend: Option<Backend>,
    /// Memory that pages of particles may take, with what is drawn of them at a time [default: half of what is free], and what chunks of
    /// heights may take [default: 1GiB]: they stay from frame to frame, and pages of the next frame are read ahead. Sums that need more
    /// are drawn in passes, volumes in slabs, and all else, heights too, is drawn coarser, the same however often with as much: a
    /// recording goes on in what its coarser frames were drawn in.
    #[arg(long, value_name = "BYTES", value_parser = super::arguments::bytes)]
    pub memory: Option<u64>,
    /// Threads that draw [default: all].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// What frames are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Format {
    Png,
    Exr,
}

/// Does what the arguments say.
///
/// # Errors
/// When the tour, its data or a setting cannot be used, when pages that a frame needs cannot be read, or when a file cannot be
/// written.
pub fn run(arguments: &Arguments) -> CommandResult {
    match arguments.threads {
        Some(threads) => {
            rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?.install(|| render(arguments))
        }
        None => render(arguments),
    }
}

fn render(arguments: &Arguments) -> CommandResult {
    let video = arguments.video.as_deref().map(video::Encoder::of).transpose()?;
    if video.is_some() && !arguments.format.contains(&Format::Png) {
        return Err("--video: a video is made of PNG frames, add png to --format".into());
    }
    let folder = arguments.record.clone().or_else(|| arguments.video.as_deref().map(video::frames_folder));
    let mut show = open(arguments, memory(arguments, folder.as_deref())?)?;
    if arguments.check {
        return Ok(std::io::stdout().write_all(timetable::text(&show).as_bytes())?);
    }
    let frames = Frames::new(
        show.duration(),
        show.repeats(),
        arguments.fps.unwrap_or(show.tour.rate),
        [arguments.start, arguments.end],
    )?;
    if let Some([number, output]) = arguments.frame.as_deref() {
        let expected = || format!("--frame {number}: expected a number from 0 to {}", frames.last());
        let number = number.parse().ok().filter(|number| *number <= frames.last()).ok_or_else(expected)?;
        return show.still(frames.time(number), output.as_ref());
    }
    let Some(folder) = folder else { return Ok(()) };
    let recorded = record::record(&mut show, &frames, arguments, &folder)?;
    eprintln!("deepfield: {recorded}");
    if let (Some(encoder), Some(path)) = (video, arguments.video.as_deref()) {
        encoder.encode(path, &folder, &frames, arguments)?;
        eprintln!("deepfield: {}", path.display());
        if arguments.record.is_none() {
            // Only what was made for the video's sake; it can be made again.
            record::remove(&folder)?;
        }
    }
    Ok(())
}

/// Why a file is no tour; where it is data, how to name that.
fn no_tour(path: &Path, error: TourError) -> Failure {
    match &error {
        TourError::Ron(RonError::Io { source, .. }) if source.kind() == ErrorKind::InvalidData => {
            format!("{error}; --around {} makes a tour around data", path.display()).into()
        }
        _ => error.into(),
    }
}

/// Memory that is asked for, bytes. A recording that goes on has what its coarser frames were drawn in: what is free now may be another amount.
fn memory(arguments: &Arguments, folder: Option<&Path>) -> Result<Option<u64>, String> {
    let before = folder.filter(|_| !arguments.restart).map(manifest::Manifest::read).transpose()?.flatten();
    Ok(arguments.memory.or(before.and_then(|before| before.memory)))
}

/// The tour that the arguments name, with its data, of which pages or chunks may take so much memory, or the usual amount.
fn open(arguments: &Arguments, memory: Option<u64>) -> Result<Show, Failure> {
    let (mut tour, file, data) = match (&arguments.around, &arguments.tour) {
        (Some(data), _) => {
            let mut tour = around_data(arguments.seconds.unwrap_or(10.0).max(2.0));
            tour.size = (1280, 720);
            tour.keyframes[0].look.mode = arguments.mode;
            (tour, None, Member::new(data_file(data)?))
        }
        (None, Some(path)) => {
            let tour = TourFile::read(path).map_err(|error| no_tour(path, error))?;
            let data = match (&arguments.data, &tour.dataset) {
                (Some(data), _) => Member::new(data_file(data)?),
                (None, Some(dataset)) => {
                    let located = dataset.locate(path)?;
                    located.notes.iter().for_each(|note| eprintln!("deepfield: {note}"));
                    let first = located.members.into_iter().next().unwrap_or_default();
                    Member { said: first.said, ..Member::new(first.path) }
                }
                (None, None) => {
                    let path = path.display();
                    return Err(format!("{path}: it names no dataset; name one: deepfield tour {path} DATA").into());
                }
            };
            (tour, Some(path.clone()), data)
        }
        (None, None) => return Err("no tour".into()),
    };
    if let Some(PictureSize { width, height }) = arguments.size {
        tour.size = (width, height);
    }
    let was = tour.projection;
    (tour.projection, tour.stereo) = arguments.projection.over(tour.projection, tour.stereo)?;
    if tour.projection == (Surround::Cube { layout: CubeLayout::Files }) {
        return Err("--layout files: a frame is one picture; name cross or strip".into());
    }
    if arguments.size.is_none() && tour.projection != was {
        // The tour's size is meant for its own projection.
        tour.size = Shot { surround: tour.projection, ..Shot::default() }.size();
    }
    tour.expose(&arguments.light.look());
    if let Some(error_px) = arguments.error_px {
        tour.keyframes.iter_mut().for_each(|keyframe| keyframe.look.error_px = Some(error_px));
    }
    let options = SessionOptions {
        backend: Some(arguments.backend.unwrap_or(Backend::Cpu)),
        page_memory: Some(memory.unwrap_or_else(default_memory)),
        chunk_memory: memory,
        ..SessionOptions::default()
    };
    let session = request::open_any(std::slice::from_ref(&data), options, [])?;
    Show::open(tour, file, data, session, &mut |note| eprintln!("deepfield: {note}"))
}
