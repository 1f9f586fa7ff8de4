//! `deepfield bench heights`: building, pictures, a flight, picks and lines of equal height, of a field or of generated ground.

mod ablations;

use super::splat::Failure;
use super::{Arguments, Times};
use crate::cpu::surface::look::Look;
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfaceReport, draw};
use crate::heights::OpenHeights;
use crate::heights::build::HeightBuildOptions;
use crate::heights::import::HeightOptions;
use crate::heights::import::summary::short_name;
use crate::heights::measure::{Ray, contours, levels, pick_all};
use crate::heights::model::Heights;
use crate::heights::store::HeightFile;
use crate::heights::synth::{SurfaceOptions as Ground, SurfaceShape, write_surface};
use crate::look::{CameraConfig, Shot};
use crate::mode::Settings;
use crate::model::SampleType;
use crate::modes::surface::{SurfaceSettings, attribute_of, range_of, usual_transfer};
use crate::picture::surface::SurfaceSession;
use crate::view::View;
use ablations::Ablations;
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The first picture of a file has so many chunks at most, and is so many times narrower and lower, as that of a window is.
const FIRST_CHUNKS: usize = 64;
const FIRST_SHRINK: u32 = 4;
/// Pixels that are asked what is under them.
const PICKS: usize = 10_000;
/// Lines of equal height from the least to the largest height.
const LINES: f64 = 20.0;
/// Generated ground is so many times as wide as it is high.
const WIDE: f64 = 10.0;
/// How high above the highest place a flight is, by the field's longest side, and how steeply it looks down.
const ABOVE: f64 = 0.03;
const DOWN: f64 = 0.35;

/// What a field came to.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The file; none of generated ground.
    pub path: Option<PathBuf>,
    /// Samples of a row.
    pub columns: u64,
    /// Rows.
    pub rows: u64,
    /// How samples are stored.
    pub sample_type: &'static str,
    /// Bytes of the page file by its samples.
    pub bytes_per_sample: f64,
    /// Building it, for each number of threads; nothing of a page file.
    pub builds: Vec<Built>,
    /// Pictures.
    pub frames: Vec<Frame>,
    /// A flight; none over a globe.
    pub flight: Option<Flown>,
    /// Milliseconds of a pick, of many that are asked at once; none of a globe.
    pub pick_ms: Option<f64>,
    /// Lines of equal height.
    pub contours: Lines,
    /// Pictures without what makes them right, where these are asked for.
    pub ablations: Option<Ablations>,
}

/// What building came to.
#[derive(Clone, Debug, Serialize)]
pub struct Built {
    /// Threads.
    pub threads: u16,
    /// Seconds from the source (in the system's file cache) to the page file.
    pub seconds: Times,
    /// Million samples per second.
    pub million_per_second: f64,
}

/// What a picture came to.
#[derive(Clone, Debug, Serialize)]
pub struct Frame {
    /// Where the camera is.
    pub view: &'static str,
    /// Milliseconds from opening the file to a picture of few chunks.
    pub first_ms: f64,
    /// Milliseconds from then to the picture that is within the error.
    pub converged_ms: f64,
    /// Seconds of the same picture again, its chunks being in memory.
    pub again: Times,
    /// Chunks, points and triangles that were drawn.
    pub nodes: u64,
    /// See `nodes`.
    pub points: u64,
    /// See `nodes`.
    pub triangles: u64,
    /// The largest error, pixels; null where a coarse chunk reaches the eye.
    pub error_px: Option<f64>,
    /// Whether the error is kept.
    pub converged: bool,
}

/// What a flight came to.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Flown {
    /// Frames.
    pub frames: usize,
    /// Milliseconds of a frame: the middle one, the 99th of a hundred and the longest.
    pub median_ms: f64,
    /// See `median_ms`.
    pub p99_ms: f64,
    /// See `median_ms`.
    pub longest_ms: f64,
    /// The most bytes of decoded chunks that were kept, and how many may be.
    pub held_bytes: u64,
    /// See `held_bytes`.
    pub budget_bytes: u64,
    /// Frames that were not within the error.
    pub not_converged: usize,
    /// Pictures that were drawn once more from a file just opened, and those of them that were not the same.
    pub checked: usize,
    /// See `checked`.
    pub different: usize,
}

/// What lines of equal height came to.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Lines {
    /// Heights that have lines.
    pub levels: usize,
    /// Lines.
    pub lines: u64,
    /// Their points.
    pub points: u64,
    /// Seconds to find them.
    pub seconds: f64,
}

/// Measures a field, or generated ground of all sizes (numbers of samples, of squares), and prints a table to standard error.
///
/// # Errors
/// When a file cannot be written, read or built.
pub fn measure(arguments: &Arguments) -> Result<Vec<Outcome>, Failure> {
    let folder = tempfile::tempdir()?;
    if let Some(path) = &arguments.path {
        let options = HeightOptions { read: arguments.read, ..HeightOptions::default() };
        return Ok(vec![Outcome {
            path: Some(path.clone()),
            ..field(path, &options, folder.path(), arguments, true)?
        }]);
    }
    let mut outcomes = Vec::new();
    for (number, samples) in arguments.sizes.iter().enumerate() {
        let side = samples.isqrt().max(2);
        let source = folder.path().join("ground.npy");
        let fbm = Ground::new(SurfaceShape::Fbm, side, side);
        write_surface(&Ground { sample_type: SampleType::I16, seed: arguments.seed, ..fbm }, &source, &())?;
        let mut options = HeightOptions { read: arguments.read, ..HeightOptions::default() };
        let found = OpenHeights::open(&source, &options)?.summary()?;
        options.spacing = Some([(WIDE * (found.max - found.min) / side as f64).max(f64::MIN_POSITIVE); 2]);
        let is_last = number + 1 == arguments.sizes.len();
        outcomes.push(field(&source, &options, folder.path(), arguments, is_last)?);
    }
    Ok(outcomes)
}

/// Measures one field; the flight where it is asked for.
fn field(
    path: &Path,
    options: &HeightOptions,
    folder: &Path,
    arguments: &Arguments,
    flies: bool,
) -> Result<Outcome, Failure> {
    let open = OpenHeights::open(path, options)?;
    let samples = open.grid().samples() as f64;
    let mut builds = Vec::new();
    let file = match &open {
        OpenHeights::Pages(_) => path.to_owned(),
        OpenHeights::Source(_) => {
            let built = folder.join("heights.df");
            for &threads in &arguments.threads {
                let options = HeightBuildOptions {
                    memory: arguments.memory,
                    threads: Some(threads.into()),
                    ..HeightBuildOptions::default()
                };
                let mut times = Vec::new();
                for _ in 0..arguments.repeat {
                    let start = Instant::now();
                    open.build(&options, &built, &())?;
                    times.push(start.elapsed());
                }
                let seconds = Times::of(times);
                let million_per_second = samples / seconds.median / 1e6;
                eprintln!("build, {threads} threads: {:.3} s, {million_per_second:.2} M samples/s", seconds.median);
                builds.push(Built { threads, seconds, million_per_second });
            }
            built
        }
    };
    let bench = Bench::open(&file, arguments)?;
    let grid = bench.file.about().grid.clone();
    let bytes_per_sample = bench.file.bytes() as f64 / samples;
    eprintln!("{} x {}: {bytes_per_sample:.3} bytes a sample", grid.columns, grid.rows);
    let frames = bench.cameras().into_iter().map(|(view, camera)| bench.frame(view, camera));
    let frames = frames.collect::<Result<Vec<Frame>, Failure>>()?;
    Ok(Outcome {
        path: None,
        columns: grid.columns,
        rows: grid.rows,
        sample_type: short_name(grid.sample_type),
        bytes_per_sample,
        builds,
        frames,
        flight: if flies { bench.flight()? } else { None },
        pick_ms: bench.picks()?,
        contours: bench.contours()?,
        ablations: if arguments.flight.ablations { Some(bench.ablations()?) } else { None },
    })
}

/// A page file that is measured.
struct Bench<'a> {
    path: PathBuf,
    file: Arc<HeightFile>,
    arguments: &'a Arguments,
    placed: Placed,
    look: Look,
}

impl<'a> Bench<'a> {
    fn open(path: &Path, arguments: &'a Arguments) -> Result<Bench<'a>, Failure> {
        let file = Arc::new(HeightFile::open(path, arguments.read)?);
        let about = file.about();
        let settings = SurfaceSettings::new(&Settings::default(), &about.grid)?;
        let attribute = attribute_of(None, about, false)?;
        let transfer = usual_transfer(attribute);
        let heights = [about.facts.min, about.facts.max];
        let range = range_of(&transfer, attribute, heights, about.levels.len() as u32, 1.0);
        let look = settings.look(attribute, transfer, range);
        let (_, placed) = SurfaceSession::sight(&*file, [about.facts.min, about.facts.max], &Shot::default())?;
        Ok(Bench { path: path.into(), placed, look, arguments, file })
    }

    /// Lowest and highest place of a flat field's box.
    fn ends(&self) -> [DVec3; 2] {
        let (grid, facts) = (&self.file.about().grid, &self.file.about().facts);
        let last = [(grid.rows - 1) as f64, (grid.columns - 1) as f64];
        let corners = [self.placed.world(0.0, 0.0, facts.min), self.placed.world(last[0], last[1], facts.max)];
        [corners[0].min(corners[1]), corners[0].max(corners[1])]
    }

    /// Where pictures are taken from: above and in front as usual, straight from above, and from just above the ground.
    fn cameras(&self) -> Vec<(&'static str, CameraConfig)> {
        let mut cameras = vec![("usual", CameraConfig::default())];
        if self.placed.is_flat() {
            let [low, high] = self.ends();
            let (middle, size) = (0.5 * (low + high), high - low);
            let longest = size.x.max(size.y);
            let camera = |eye: DVec3, target: DVec3, up: DVec3, ortho: Option<f64>| CameraConfig {
                eye: Some(eye.to_array()),
                target: Some(target.to_array()),
                up: Some(up.to_array()),
                fov: None,
                ortho,
            };
            let above = middle.with_z(high.z + longest);
            cameras.push(("above", camera(above, middle, DVec3::Y, Some(size.y))));
            let near = DVec3::new(low.x + 0.1 * size.x, low.y + 0.1 * size.y, high.z + 0.01 * longest);
            cameras.push(("near", camera(near, middle.with_z(low.z), DVec3::Z, None)));
        }
        cameras
    }

    fn sight(&self, camera: CameraConfig) -> Result<Sight, Failure> {
        let (about, size) = (self.file.about(), self.arguments.flight.picture_size());
        let shot = Shot { camera, size: Some((size.width, size.height)), ..Shot::default() };
        Ok(SurfaceSession::sight(&*self.file, [about.facts.min, about.facts.max], &shot)?.0)
    }

    fn options(&self) -> SurfaceOptions {
        SurfaceOptions {
            tau: self.arguments.flight.error_px,
            look: Some(self.look.clone()),
            ..SurfaceOptions::default()
        }
    }

    /// A surface with nothing in memory, of a file that is opened anew.
    fn fresh(&self) -> Result<PagedSurface, Failure> {
        let file = Arc::new(HeightFile::open(&self.path, self.arguments.read)?);
        let mut surface = PagedSurface::new(file, self.arguments.flight.main_memory);
        surface.place(&self.placed);
        Ok(surface)
    }

    fn drawn(&self, surface: &PagedSurface, sight: &Sight, options: &SurfaceOptions) -> (SurfaceReport, Vec<[f32; 4]>) {
        surface.prepare(&self.placed, sight, options);
        let picture = draw(surface, &self.placed, sight, options);
        (picture.report, picture.colors.rgba)
    }

    fn frame(&self, view: &'static str, camera: CameraConfig) -> Result<Frame, Failure> {
        let (sight, options) = (self.sight(camera)?, self.options());
        let start = Instant::now();
        let surface = self.fresh()?;
        let small = match sight {
            Sight::Flat(view) => {
                let [width, height] = [view.width, view.height].map(|side| (side / FIRST_SHRINK).max(1));
                Sight::Flat(view.resized(width, height))
            }
            around => around,
        };
        self.drawn(&surface, &small, &SurfaceOptions { most_nodes: FIRST_CHUNKS, ..options.clone() });
        let first = start.elapsed();
        let (report, _) = self.drawn(&surface, &sight, &options);
        let converged = start.elapsed() - first;
        let mut times = Vec::new();
        for _ in 0..self.arguments.repeat {
            let start = Instant::now();
            self.drawn(&surface, &sight, &options);
            times.push(start.elapsed());
        }
        let again = Times::of(times);
        let [first_ms, converged_ms] = [first, converged].map(milliseconds);
        let nodes = report.nodes_drawn;
        eprintln!(
            "picture, {view}: first after {first_ms:.0} ms, converged after {converged_ms:.0} ms more, again {:.0} ms, {nodes} chunks",
            1e3 * again.median
        );
        Ok(Frame {
            view,
            first_ms,
            converged_ms,
            again,
            nodes,
            points: report.points,
            triangles: report.triangles,
            error_px: Some(report.error_px).filter(|error| error.is_finite()),
            converged: report.is_converged,
        })
    }

    /// Flies over the middle of a flat field for as long as is asked, each frame being drawn to the end; then some of the pictures once more.
    fn flight(&self) -> Result<Option<Flown>, Failure> {
        if !self.placed.is_flat() {
            return Ok(None);
        }
        let flight = &self.arguments.flight;
        let [low, high] = self.ends();
        let longest = (high.x - low.x).max(high.y - low.y);
        let along = (high - low).with_z(0.0).normalize_or(DVec3::X);
        let start = (0.5 * (low + high)).with_z(high.z + ABOVE * longest)
            - 0.5 * flight.duration * flight.velocity * longest * along;
        let camera = |seconds: f64| {
            let eye = start + seconds * flight.velocity * longest * along;
            let target = eye + longest * (along - DVec3::Z * DOWN);
            CameraConfig { eye: Some(eye.to_array()), target: Some(target.to_array()), ..CameraConfig::default() }
        };
        let (surface, options) = (self.fresh()?, self.options());
        let mut flown = Flown { budget_bytes: flight.main_memory, ..Flown::default() };
        let (mut times, begin): (Vec<Duration>, Instant) = (Vec::new(), Instant::now());
        loop {
            let seconds = begin.elapsed().as_secs_f64();
            if seconds >= flight.duration {
                break;
            }
            let frame = Instant::now();
            let (report, _) = self.drawn(&surface, &self.sight(camera(seconds))?, &options);
            times.push(frame.elapsed());
            flown.held_bytes = flown.held_bytes.max(surface.held_bytes());
            flown.not_converged += usize::from(!report.is_converged);
        }
        times.sort();
        flown.frames = times.len();
        let at = |share: f64| times.get((share * (times.len().max(1) - 1) as f64).round() as usize).copied();
        [flown.median_ms, flown.p99_ms, flown.longest_ms] =
            [0.5, 0.99, 1.0].map(|share| at(share).map_or(0.0, milliseconds));
        for number in 0..flight.check {
            let sight = self.sight(camera(flight.duration * f64::from(number) / f64::from(flight.check)))?;
            let (_, kept) = self.drawn(&surface, &sight, &options);
            let (_, anew) = self.drawn(&self.fresh()?, &sight, &options);
            flown.checked += 1;
            flown.different += usize::from(kept != anew);
        }
        eprintln!(
            "flight: {} frames, median {:.0} ms, 99th {:.0} ms, {} MiB held, {} of {} pictures differ from those of a file just opened",
            flown.frames,
            flown.median_ms,
            flown.p99_ms,
            flown.held_bytes >> 20,
            flown.different,
            flown.checked
        );
        Ok(Some(flown))
    }

    /// Asks what is under many pixels of the usual picture of a field, all over it.
    fn picks(&self) -> Result<Option<f64>, Failure> {
        let Sight::Flat(view) = self.sight(CameraConfig::default())? else { return Ok(None) };
        let rays: Option<Vec<Ray>> = (0..PICKS).map(|number| self.ray(&view, number)).collect();
        let Some(rays) = rays else { return Ok(None) };
        let start = Instant::now();
        pick_all(&self.path, &*self.file, Some(&self.file), &self.placed.stands(), &rays)?;
        let each = milliseconds(start.elapsed()) / PICKS as f64;
        eprintln!("pick: {each:.3} ms");
        Ok(Some(each))
    }

    fn ray(&self, view: &View, number: usize) -> Option<Ray> {
        // Spread evenly (Roberts's sequence).
        let share = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2].map(|step| (0.5 + step * number as f64).fract());
        let pixel = [share[0] * f64::from(view.width), share[1] * f64::from(view.height)];
        let (origin, direction) = Sight::Flat(*view).ray(pixel)?;
        let (origin, direction) = self.placed.in_file(origin, direction);
        Some(Ray::new(origin.to_array(), direction.to_array()))
    }

    fn contours(&self) -> Result<Lines, Failure> {
        let facts = &self.file.about().facts;
        let range = [facts.min, facts.max];
        let start = Instant::now();
        let span = range[1] - range[0];
        let wanted = if span > 0.0 { levels(range, span / LINES, range[0] + 0.5 * span / LINES)? } else { Vec::new() };
        let mut found = Lines { levels: wanted.len(), ..Lines::default() };
        contours(&*self.file, &wanted, |line| {
            found.lines += 1;
            found.points += line.points.len() as u64;
            Ok(())
        })?;
        found.seconds = start.elapsed().as_secs_f64();
        eprintln!(
            "lines: {} of {} points at {} heights in {:.3} s",
            found.lines, found.points, found.levels, found.seconds
        );
        Ok(found)
    }
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Words {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn a_small_field_is_measured_whole() {
        let words = "bench heights --sizes 4000,90000 --threads 1 --repeat 1 --duration 1 --velocity 0.1 --size 96x64 --check 2";
        let outcomes = measure(&Words::parse_from(words.split(' ')).arguments).unwrap();
        assert_eq!(outcomes.len(), 2);
        let last = &outcomes[1];
        assert_eq!((last.columns, last.rows, last.sample_type), (300, 300, "i16"));
        assert!(last.builds.len() == 1 && last.builds[0].million_per_second > 0.0);
        assert!(last.frames.len() == 3 && last.frames.iter().all(|frame| frame.converged && frame.nodes > 0));
        let flown = last.flight.as_ref().unwrap();
        assert!(
            flown.frames > 0 && flown.not_converged == 0 && (flown.checked, flown.different) == (2, 0),
            "{flown:?}"
        );
        assert!(flown.held_bytes > 0 && flown.held_bytes <= flown.budget_bytes);
        assert!(last.pick_ms.unwrap() > 0.0 && last.contours.levels == 20 && last.contours.points > 1000);
        assert!(outcomes[0].flight.is_none());
    }
}
