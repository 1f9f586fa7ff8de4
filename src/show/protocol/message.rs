//! What leader and followers say to each other: a version, then RON, of which every field is checked before it is used.

use crate::look::Camera;
use crate::model::ron_file::{self, RonError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The version of the messages that this program sends and understands: the first byte of each.
pub const VERSION: u8 = 2;

/// Bytes of a scene's or tour's text at most.
pub const MOST_TEXT: usize = 2 << 20;
/// Characters of a follower's name at most.
pub const MOST_NAME: usize = 64;
/// Characters of what a follower tells at most.
pub const MOST_WORDS: usize = 500;

/// A message that is not used, and why.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// It is of another version of the program.
    #[error("a message of version {found}, expected {VERSION}: leader and followers have to be the same deepfield")]
    Version {
        /// Its version.
        found: u8,
    },
    /// It is too long, or empty.
    #[error("a message of {bytes} bytes, expected 2 to {most}")]
    Length {
        /// Its length.
        bytes: usize,
        /// What it may be.
        most: usize,
    },
    /// It is no text.
    #[error("a message that is not UTF-8")]
    Text,
    /// It is not what it should be.
    #[error(transparent)]
    Ron(#[from] RonError),
}

/// Something that is sent.
pub trait Message: Serialize + DeserializeOwned {
    /// Bytes of its encoding at most.
    const MOST: usize;
    /// What errors call it.
    const NAME: &'static str;

    /// Checks what types cannot.
    ///
    /// # Errors
    /// The first field that makes no sense.
    fn check(&self) -> Result<(), MessageError>;

    /// Its bytes; none where it is too long to be sent.
    fn encode(&self) -> Option<Vec<u8>> {
        let text = ron::to_string(self).ok()?;
        let mut bytes = Vec::with_capacity(1 + text.len());
        bytes.push(VERSION);
        bytes.extend_from_slice(text.as_bytes());
        (bytes.len() <= Self::MOST).then_some(bytes)
    }

    /// What the bytes say.
    ///
    /// # Errors
    /// [`MessageError`].
    fn decode(bytes: &[u8]) -> Result<Self, MessageError> {
        let (bytes, most) = (bytes, Self::MOST);
        if !(2..=most).contains(&bytes.len()) {
            return Err(MessageError::Length { bytes: bytes.len(), most });
        }
        if bytes[0] != VERSION {
            return Err(MessageError::Version { found: bytes[0] });
        }
        let text = std::str::from_utf8(&bytes[1..]).map_err(|_| MessageError::Text)?;
        let message: Self = ron_file::parse(Self::NAME, text)?;
        message.check()?;
        Ok(message)
    }
}

fn refuse<T>(name: &str, field: &str, found: impl std::fmt::Debug, expected: &str) -> Result<T, MessageError> {
    Err(RonError::value(name, field, format!("{found:?}"), expected).into())
}

/// What a picture shows at one moment; sent with every frame of the leader, and lost for good where the network loses it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Counts up with every frame.
    pub number: u64,
    /// Seconds since the leader was started.
    pub time: f64,
    /// Where the camera stands.
    pub camera: Camera,
    /// The ranges of the colours.
    pub ranges: Option<Ranges>,
    /// Where the tour is that plays.
    pub tour: Option<TourTime>,
    /// Where the run is that is shown.
    pub run: Option<RunTime>,
}

/// A moment of a run of snapshots.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunTime {
    /// Its time, in the unit of the steps' times.
    pub time: f64,
    /// Whether the stored step before it is shown, and nothing that moves.
    pub holds: bool,
}

/// The ranges of values that colours are for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ranges {
    /// Of the brightness.
    pub p: [f64; 2],
    /// Of the attribute that gives the hue.
    pub s: [f64; 2],
}

/// A moment of a tour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TourTime {
    /// Seconds from the tour's beginning; goes on counting where it repeats.
    pub time: f64,
    /// Whether it goes on; else it stands, or waits for the presenter.
    pub running: bool,
}

impl Message for Frame {
    /// What fits into one packet.
    const MOST: usize = 1100;
    const NAME: &'static str = "the leader's frame";

    fn check(&self) -> Result<(), MessageError> {
        if !(self.time >= 0.0 && self.time.is_finite()) {
            return refuse(Self::NAME, "time", self.time, "seconds, not negative");
        }
        let camera = &self.camera;
        if !(camera.fov > 0.0 && camera.fov < 180.0) {
            return refuse(Self::NAME, "camera.fov", camera.fov, "between 0 and 180 degrees");
        }
        if let Err(error) = camera.view(64, 64) {
            return refuse(Self::NAME, "camera", camera, &format!("a camera that sees something: {error}"));
        }
        if let Some(ranges) = self.ranges {
            for (name, [low, high]) in [("ranges.p", ranges.p), ("ranges.s", ranges.s)] {
                if !(low.is_finite() && high.is_finite() && low <= high) {
                    return refuse(Self::NAME, name, [low, high], "two finite numbers, the lower one first");
                }
            }
        }
        if let Some(run) = self.run.filter(|run| !run.time.is_finite()) {
            return refuse(Self::NAME, "run.time", run.time, "a finite number");
        }
        match self.tour {
            Some(moment) if !(moment.time >= 0.0 && moment.time.is_finite()) => {
                refuse(Self::NAME, "tour.time", moment.time, "seconds, not negative")
            }
            _ => Ok(()),
        }
    }
}

/// What a leader says and has to arrive, in this order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum FromLeader {
    /// To one who has just come: the number of this meeting, which no recording of an earlier one has.
    Welcome {
        /// The number.
        session: u64,
    },
    /// All that is shown, as a scene file; checked as one.
    Scene {
        /// The text of the file.
        text: String,
    },
    /// The open tour; none for an empty text.
    Tour {
        /// The text of the file; checked as one.
        text: String,
        /// The folder that its pictures are named from, on the leader's machine.
        folder: String,
        /// Width over height of the leader's picture.
        aspect: f64,
    },
}

impl Message for FromLeader {
    const MOST: usize = 2 * MOST_TEXT;
    const NAME: &'static str = "the leader's message";

    fn check(&self) -> Result<(), MessageError> {
        let long = |text: &str| text.len() > MOST_TEXT;
        match self {
            FromLeader::Welcome { .. } => Ok(()),
            FromLeader::Scene { text } | FromLeader::Tour { text, .. } if long(text) => {
                refuse(Self::NAME, "text", text.len(), &format!("{MOST_TEXT} bytes at most"))
            }
            FromLeader::Tour { aspect, .. } if !(1e-3..=1e3).contains(aspect) => {
                refuse(Self::NAME, "aspect", aspect, "a number from 0.001 to 1000")
            }
            FromLeader::Scene { .. } | FromLeader::Tour { .. } => Ok(()),
        }
    }
}

/// How bad it is what a follower tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Severity {
    /// Good to know.
    Info,
    /// Something does not work there.
    Error,
}

/// What a follower says and has to arrive, in this order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum FromFollower {
    /// The answer to a welcome.
    Hello {
        /// The number of the meeting.
        session: u64,
        /// What the follower is called.
        name: String,
        /// The number of this run of the program.
        instance: u64,
    },
    /// Something that the presenter should know.
    Told {
        /// The number of the meeting.
        session: u64,
        /// How bad it is.
        severity: Severity,
        /// A sentence.
        text: String,
    },
}

impl Message for FromFollower {
    const MOST: usize = 8192;
    const NAME: &'static str = "a follower's message";

    fn check(&self) -> Result<(), MessageError> {
        let (field, text, most) = match self {
            FromFollower::Hello { name, .. } => ("name", name, MOST_NAME),
            FromFollower::Told { text, .. } => ("text", text, MOST_WORDS),
        };
        if plain(text, most) != *text || text.is_empty() {
            return refuse(Self::NAME, field, text, &format!("1 to {most} characters, none that control"));
        }
        Ok(())
    }
}

/// How a follower is; sent with every frame of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// The number of the meeting.
    pub session: u64,
    /// The leader's frame that it shows.
    pub frame: u64,
    /// Milliseconds from frame to frame.
    pub frame_ms: f64,
    /// Pages that its view needs and that are not there yet.
    pub missing: u64,
    /// Pages that it cannot read.
    pub failed: u64,
    /// Whether it shows all that its view needs.
    pub converged: bool,
}

impl Message for Report {
    const MOST: usize = 512;
    const NAME: &'static str = "a follower's report";

    fn check(&self) -> Result<(), MessageError> {
        if !(0.0..=1e9).contains(&self.frame_ms) {
            return refuse(Self::NAME, "frame_ms", self.frame_ms, "milliseconds, not negative");
        }
        Ok(())
    }
}

/// A text without characters that control, in one line, cut where it is too long.
pub fn plain(text: &str, most: usize) -> String {
    let plain = text.chars().map(|c| if c.is_control() { ' ' } else { c });
    plain.take(most).collect()
}

#[cfg(test)]
mod tests;
