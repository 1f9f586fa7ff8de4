//! `deepfield render`: a picture of a source or page file, without a window.

use super::CommandResult;
use super::heights;
use super::region_options::own_time;
pub use super::render_arguments::Arguments;
use super::request::{Request, open_any};
use super::statistics;
use crate::color::{Image, output};
use crate::explore::Catalogue;
use crate::import::step_at;
use crate::look::{DataKind, Member, MemberKind, is_field, one_snapshot};
use crate::mode::Mode;
use crate::model::When;
use crate::picture::Picture;
use crate::view::{CubeLayout, Side, Surround};

/// Renders the picture and writes it.
///
/// # Errors
/// When the source cannot be read, a setting does not fit the data, no adapter draws, or a file cannot be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let request = arguments.request()?;
    match arguments.threads {
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build()?;
            pool.install(|| render(arguments, request))
        }
        None => render(arguments, request),
    }
}

fn render(arguments: &Arguments, mut request: Request) -> CommandResult {
    let output = &arguments.output;
    let is_exr = match output.extension().and_then(|extension| extension.to_str()) {
        Some("png") => false,
        Some("exr") => true,
        _ => return Err(format!("{}: expected a name that ends in .png or .exr", output.display()).into()),
    };
    if is_exr {
        if arguments.annotate.is_given() {
            let why = "an EXR picture holds numbers, only PNG pictures are annotated";
            return Err(format!("{}: {why}", output.display()).into());
        }
        request.shot.look.annotations = None;
    }
    let Request { mut members, mut shot, mut options } = request;
    // Heights have numbers in an EXR picture, where they have any.
    let has_numbers = shot.stereo.is_none() && (shot.surround.is_flat() || members.len() == 1);
    options.raw |= is_exr && has_numbers && members.iter().any(Member::is_of_heights);
    if !members.iter().any(Member::is_of_heights) {
        let spacing = ("--spacing", !arguments.spacing.spacing.is_empty());
        heights::refuse_without(&arguments.path, &[&arguments.heights.given()[..], &[spacing]].concat())?;
        arguments.texture.refuse()?;
        arguments.before.refuse()?;
    }
    let is_surface = shot.look.mode.is_none_or(Mode::takes_surfaces) && members.iter().all(Member::is_of_heights);
    if let (true, Some(first)) = (is_surface, members.first()) {
        heights::refuse_options(&first.path, &arguments.of_particles(), "")?;
    }
    let is_field = match &members[..] {
        [only] => only.is_of_heights() || is_field(&only.path),
        all => all.iter().all(|member| member.kind() != MemberKind::Particles),
    };
    if let (Some(when), Some(first)) = (shot.look.time, members.first_mut())
        && matches!(DataKind::of(&first.path), Ok(DataKind::Source))
        && let Some(step) = step_at(&first.path, when, options.read)?
    {
        (first.path, shot.look.time) = (step, None);
    }
    let has_times = members.iter().any(|member| matches!(DataKind::of(&member.path), Ok(DataKind::Run)));
    if has_times && shot.look.time.is_none() && shot.is_of_tails() {
        // At the first step no path has come from anywhere.
        shot.look.time = Some(When::Last);
    }
    if let (false, false, Some(_), Some(first)) = (is_field, has_times, shot.look.time, members.first()) {
        let why = one_snapshot(&first.path, own_time(&first.path)?);
        match arguments.time {
            Some(_) => return Err(why.into()),
            // What a scene says is for data like that which it was saved with.
            None => eprintln!("deepfield: {why}; the scene's time is left out"),
        }
    }
    // A mistake in it is told before anything is built and drawn.
    if let Some(labels) = &shot.labels
        && Catalogue::in_plane(labels)?.is_none()
    {
        Catalogue::read(labels)?;
    }
    let mut session = open_any(&members, options, [&shot])?;
    let picture = session.draw(&shot)?;
    if shot.surround != (Surround::Cube { layout: CubeLayout::Files }) {
        return write(arguments, &picture, is_exr, || Ok(session.finished(&shot, &picture)?));
    }
    if is_exr {
        return Err("--layout files: writes .png; a strip can be .exr".into());
    }
    for (side, face) in Side::ALL.iter().zip(faces(&session.finished(&shot, &picture)?)) {
        output::write_png(&output.with_extension(format!("{}.png", side.as_str())), &face)?;
    }
    write_numbers(arguments, &picture)
}

/// Writes a picture, whose colours are `finished`, and its numbers.
fn write(
    arguments: &Arguments,
    picture: &Picture,
    is_exr: bool,
    finished: impl FnOnce() -> Result<Image, Box<dyn std::error::Error + Send + Sync>>,
) -> CommandResult {
    match is_exr {
        true => picture.write_exr(&arguments.output)?,
        false => output::write_png(&arguments.output, &finished()?)?,
    }
    write_numbers(arguments, picture)
}

/// Writes what numbers of a picture are asked for.
fn write_numbers(arguments: &Arguments, picture: &Picture) -> CommandResult {
    if let Some(raw) = &arguments.raw {
        picture.write_npy(raw)?;
    }
    if let Some(json) = &arguments.json {
        statistics::write(json, picture)?;
    }
    Ok(())
}

/// The six faces of a strip.
fn faces(strip: &Image) -> Vec<Image> {
    let edge = strip.height;
    let face = |index: usize| {
        let rows = strip.rgba.chunks(strip.width as usize);
        let start = index * edge as usize;
        let rgba = rows.flat_map(|row| row[start..start + edge as usize].iter().copied()).collect();
        Image { width: edge, height: edge, rgba }
    };
    (0..6).map(face).collect()
}
