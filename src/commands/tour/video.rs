//! Frames to a video: by ffmpeg where it is installed, or as Motion-JPEG, which needs nothing.

use super::{Arguments, avi};
use crate::commands::CommandResult;
use crate::tour::Frames;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What makes a video.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoder {
    /// ffmpeg, for H.264 or what the name's extension says.
    Ffmpeg,
    /// The program itself.
    MotionJpeg,
}

/// The folder of the frames of a video whose frames nobody asked for.
pub(super) fn frames_folder(video: &Path) -> PathBuf {
    let name = video.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    video.with_file_name(format!("{name}.frames"))
}

impl Encoder {
    /// The encoder for a video of that name: known before the first frame is drawn.
    ///
    /// # Errors
    /// When there is none for it.
    pub fn of(video: &Path) -> Result<Encoder, String> {
        let extension = video.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("avi") => Ok(Encoder::MotionJpeg),
            Some("mp4" | "mkv" | "webm" | "mov") if has_ffmpeg() => Ok(Encoder::Ffmpeg),
            Some("mp4" | "mkv" | "webm" | "mov") => {
                let (other, video) = (video.with_extension("avi"), video.display());
                Err(format!(
                    "{video}: that needs ffmpeg, which is not installed; without it a video is called .avi: --video {}",
                    other.display()
                ))
            }
            _ => Err(format!("{}: expected a name that ends in .avi, .mp4, .mkv, .webm or .mov", video.display())),
        }
    }

    /// Makes the video of recorded frames.
    ///
    /// # Errors
    /// When a frame cannot be read, ffmpeg fails, or the video cannot be written.
    pub fn encode(self, video: &Path, folder: &Path, frames: &Frames, arguments: &Arguments) -> CommandResult {
        let first = u64::from(*frames.range.start()) + u64::from(arguments.offset);
        let files: Vec<PathBuf> =
            (first..).take(frames.count()).map(|number| arguments.name.file(folder, number, "png")).collect();
        match self {
            Encoder::MotionJpeg => Ok(avi::write(video, &files, frames.rate)?),
            Encoder::Ffmpeg => {
                let made = ffmpeg(video, folder, &format!("{}.png", arguments.name), first, frames);
                made.map_err(|error| format!("{error}; its frames are in {}", folder.display()).into())
            }
        }
    }
}

/// Whether ffmpeg can be run.
fn has_ffmpeg() -> bool {
    let mut run = Command::new("ffmpeg");
    run.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    matches!(run.status(), Ok(status) if status.success())
}

/// Makes a video of the pictures in a folder whose names have numbers from `first` on.
fn ffmpeg(video: &Path, folder: &Path, pattern: &str, first: u64, frames: &Frames) -> Result<(), String> {
    let place = |error: std::io::Error| format!("{}: {error}", video.display());
    // Under another name first; the extension says the format.
    let name = video.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let unfinished = video.with_file_name(format!(".deepfield-{name}"));
    let mut command = Command::new("ffmpeg");
    command.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"]);
    // From their folder, whose own name may look like a pattern, and theirs like an option.
    command.current_dir(folder).args(["-framerate", &frames.rate.to_string(), "-start_number", &first.to_string()]);
    command.args(["-i", &format!("./{pattern}")]);
    command.args(["-frames:v", &frames.count().to_string()]);
    // Sides of even length, which the usual players need, and the colours that they take them for.
    let filter = "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";
    command.args(["-vf", filter, "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]);
    command.args(["-color_range", "tv"]);
    match video.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("webm") => {
            command.args(["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"])
        }
        _ => command.args(["-c:v", "libx264", "-crf", "16", "-preset", "slow", "-movflags", "+faststart"]),
    };
    let output = command.arg(std::path::absolute(&unfinished).map_err(place)?).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("ffmpeg: {error}"))?;
    if !output.status.success() {
        let _ = std::fs::remove_file(&unfinished);
        let said = String::from_utf8_lossy(&output.stderr);
        let lines: Vec<&str> = said.lines().collect();
        let last = lines[lines.len().saturating_sub(2)..].join(" ");
        return Err(format!("{}: ffmpeg failed ({}): {last}", video.display(), output.status));
    }
    std::fs::rename(&unfinished, video).map_err(place)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use crate::color::Image;
    use crate::color::output::write_png;

    #[test]
    fn names_say_who_encodes() {
        assert_eq!(Encoder::of(Path::new("a.AVI")), Ok(Encoder::MotionJpeg));
        assert!(Encoder::of(Path::new("a.gif")).unwrap_err().contains(".avi, .mp4"));
        match Encoder::of(Path::new("a.mp4")) {
            Ok(encoder) => assert_eq!(encoder, Encoder::Ffmpeg),
            Err(message) => assert!(message.contains("--video a.avi"), "{message}"),
        }
        assert_eq!(frames_folder(Path::new("x/a.mp4")), Path::new("x/a.mp4.frames"));
    }

    /// Where ffmpeg is installed: a player that takes a video for one of high definition shows the colours of the pictures.
    #[test]
    fn colors_of_videos_are_those_of_their_frames() {
        if !has_ffmpeg() {
            return;
        }
        let folder = tempfile::Builder::new().prefix("100%d").tempdir().unwrap();
        let (width, height) = (33, 17);
        let image = Image { width, height, rgba: vec![[32, 192, 64, 255]; (width * height) as usize] };
        for number in 7..10 {
            write_png(&folder.path().join(format!("a-{number}.png")), &image).unwrap();
        }
        let frames = Frames::new(0.25, true, 12.0, [None, None]).unwrap();
        for name in ["a.mp4", "a.WEBM"] {
            let video = folder.path().join(name);
            ffmpeg(&video, folder.path(), "a-%d.png", 7, &frames).unwrap();
            let mut decode = Command::new("ffmpeg");
            decode.args(["-v", "error", "-i"]).arg(&video);
            decode.args(["-vf", "scale=in_color_matrix=bt709:in_range=tv", "-pix_fmt", "rgb24", "-f", "rawvideo", "-"]);
            let decoded = decode.output().unwrap().stdout;
            assert_eq!(decoded.len(), 3 * 34 * 18 * 3, "three frames with even sides");
            let pixel = &decoded[3 * (34 * 9 + 12)..][..3];
            assert!(pixel.iter().zip([32u8, 192, 64]).all(|(a, b)| a.abs_diff(b) <= 6), "{name}: {pixel:?}");
        }
        let error = ffmpeg(&folder.path().join("b.mp4"), folder.path(), "none-%d.png", 0, &frames).unwrap_err();
        assert!(error.contains("b.mp4: ffmpeg failed") && error.contains("none-%d.png"), "{error}");
    }
}
