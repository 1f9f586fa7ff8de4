//! Frames to a video: by ffmpeg where it is installed, or as Motion-JPEG, which needs nothing.

use super::frames::Frames;
use super::{Arguments, avi};
use crate::commands::CommandResult;
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
            Encoder::Ffmpeg => ffmpeg(video, folder, first, frames, arguments),
        }
    }
}

/// Whether ffmpeg can be run.
fn has_ffmpeg() -> bool {
    let mut run = Command::new("ffmpeg");
    run.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    matches!(run.status(), Ok(status) if status.success())
}

fn ffmpeg(video: &Path, folder: &Path, first: u64, frames: &Frames, arguments: &Arguments) -> CommandResult {
    // Under another name first; the extension says the format.
    let name = video.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let unfinished = video.with_file_name(format!(".deepfield-{name}"));
    // A path that begins with a dash is no option.
    let pattern = Path::new(".").join(folder).join(format!("{}.png", arguments.name));
    let mut command = Command::new("ffmpeg");
    command.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"]);
    command.args(["-framerate", &frames.rate.to_string(), "-start_number", &first.to_string(), "-i"]).arg(pattern);
    command.args(["-frames:v", &frames.count().to_string()]);
    // Sides of even length, which the usual players need.
    command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,format=yuv420p"]);
    match video.extension().and_then(|extension| extension.to_str()) {
        Some("webm") => command.args(["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"]),
        _ => command.args(["-c:v", "libx264", "-crf", "16", "-preset", "slow", "-movflags", "+faststart"]),
    };
    let output = command.arg(Path::new(".").join(&unfinished)).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("ffmpeg: {error}"))?;
    if !output.status.success() {
        let _ = std::fs::remove_file(&unfinished);
        let said = String::from_utf8_lossy(&output.stderr);
        let said: Vec<&str> = said.lines().rev().take(2).collect();
        return Err(format!("{}: ffmpeg failed ({}): {}", video.display(), output.status, said.join(" ")).into());
    }
    std::fs::rename(&unfinished, video).map_err(|error| format!("{}: {error}", video.display()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
