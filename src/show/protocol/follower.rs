//! A follower: hears what the leader shows, and comes back by itself where it has lost it.

use super::message::{FromFollower, FromLeader, MOST_NAME, MOST_WORDS, Message, plain};
use super::transport::{ClientSide, NO_ANSWER, RELIABLE, UNRELIABLE};
use super::{Frame, Report, Severity, ShowKey};
use crate::look::SceneFile;
use crate::tour::TourFile;
use renetcode::generate_random_bytes;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Pauses between two attempts, the first and the longest.
const PAUSES: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(2)];
/// Messages that are taken at a time.
const MOST_AT_ONCE: usize = 256;
/// What is told before the leader is there, and is kept for it, at most.
const MOST_KEPT: usize = 32;

/// Something new from the leader, checked.
#[derive(Clone, Debug)]
pub enum FollowerEvent {
    /// It is there.
    Joined,
    /// It is not there any more, or does not answer; it is asked again and again.
    Lost(String),
    /// All that is shown has changed.
    Scene(Box<SceneFile>),
    /// Another tour is open, or none.
    Tour(Option<Box<LedTour>>),
    /// Something that it sent was not used.
    Refused(String),
}

/// The tour that the leader plays.
#[derive(Clone, Debug, PartialEq)]
pub struct LedTour {
    /// The tour.
    pub tour: TourFile,
    /// Its text.
    pub text: String,
    /// The folder that its pictures are named from, on the leader's machine.
    pub folder: PathBuf,
    /// Width over height of the leader's picture.
    pub aspect: f64,
}

/// Where one stands with the leader.
enum Link {
    /// Nothing is done until then.
    Pause(Duration),
    /// It is asked, or there.
    Open(Box<ClientSide>),
}

/// One who follows.
pub struct Follower {
    leader: SocketAddr,
    key: ShowKey,
    name: String,
    instance: u64,
    link: Link,
    pause: Duration,
    session: Option<u64>,
    frame: Option<Frame>,
    /// The number of the latest frame of this meeting.
    newest: u64,
    heard: Option<Duration>,
    /// Whether it was told that there is no answer.
    told_silence: bool,
    to_tell: VecDeque<(Severity, String)>,
}

impl Follower {
    /// Follows the leader at an address.
    pub fn new(leader: SocketAddr, key: ShowKey, name: &str) -> Follower {
        let name = plain(plain(name, 10 * MOST_NAME).trim(), MOST_NAME).trim().to_owned();
        Follower {
            leader,
            key,
            name: if name.is_empty() { "follower".to_owned() } else { name },
            instance: u64::from_le_bytes(generate_random_bytes()),
            link: Link::Pause(Duration::ZERO),
            pause: PAUSES[0],
            session: None,
            frame: None,
            newest: 0,
            heard: None,
            told_silence: false,
            to_tell: VecDeque::new(),
        }
    }

    /// What it is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where the leader is.
    pub fn leader(&self) -> SocketAddr {
        self.leader
    }

    /// Whether the leader is there.
    pub fn is_joined(&self) -> bool {
        self.session.is_some()
    }

    /// The latest frame of the leader that has come; stays when the leader is gone.
    pub fn frame(&self) -> Option<&Frame> {
        self.frame.as_ref()
    }

    /// When that was.
    pub fn heard(&self) -> Option<Duration> {
        self.heard
    }

    /// Seconds that a packet takes to the leader and back.
    pub fn round_trip(&self) -> Option<f64> {
        match &self.link {
            Link::Open(side) if self.is_joined() => Some(side.round_trip()),
            _ => None,
        }
    }

    /// Takes in what has come until `now`, which never goes back.
    pub fn receive(&mut self, now: Duration) -> Vec<FollowerEvent> {
        let mut events = Vec::new();
        if let Link::Pause(until) = self.link {
            if now < until {
                return events;
            }
            match ClientSide::new(now, self.leader, &self.key) {
                Ok(side) => self.link = Link::Open(Box::new(side)),
                Err(error) => return self.leave(now, &error.to_string()),
            }
        }
        let Link::Open(side) = &mut self.link else { return events };
        let state = side.receive(now);
        while let Some(bytes) = side.message(UNRELIABLE) {
            // A frame that makes no sense is not shown, and the next one comes soon. Frames may overtake one another.
            if let Some(frame) = Frame::decode(&bytes).ok().filter(|frame| frame.number > self.newest) {
                self.newest = frame.number;
                (self.frame, self.heard) = (Some(frame), Some(now));
            }
        }
        let mut over = None;
        for _ in 0..MOST_AT_ONCE {
            let Some(bytes) = side.message(RELIABLE) else { break };
            match FromLeader::decode(&bytes) {
                Ok(FromLeader::Welcome { session }) => {
                    let (name, instance) = (self.name.clone(), self.instance);
                    if let Some(hello) = (FromFollower::Hello { session, name, instance }).encode() {
                        side.give(RELIABLE, hello);
                    }
                    self.session = Some(session);
                    self.pause = PAUSES[0];
                    self.told_silence = false;
                    events.push(FollowerEvent::Joined);
                }
                Ok(FromLeader::Scene { text }) => events.push(match SceneFile::parse("the leader's scene", &text) {
                    Ok(scene) => FollowerEvent::Scene(Box::new(scene)),
                    Err(error) => FollowerEvent::Refused(plain(&error.to_string(), MOST_WORDS)),
                }),
                Ok(FromLeader::Tour { text, .. }) if text.is_empty() => events.push(FollowerEvent::Tour(None)),
                Ok(FromLeader::Tour { text, folder, aspect }) => {
                    events.push(match TourFile::parse("the leader's tour", &text) {
                        Ok(tour) => {
                            let folder = PathBuf::from(folder);
                            FollowerEvent::Tour(Some(Box::new(LedTour { tour, text, folder, aspect })))
                        }
                        Err(error) => FollowerEvent::Refused(plain(&error.to_string(), MOST_WORDS)),
                    });
                }
                Err(error) => {
                    over = Some(plain(&error.to_string(), MOST_WORDS));
                    break;
                }
            }
        }
        if let Some(why) = over {
            events.push(FollowerEvent::Refused(why.clone()));
            events.extend(self.leave(now, &why));
        } else if let Err(why) = state {
            events.extend(self.leave(now, why));
        }
        events
    }

    /// Ends the meeting, and begins to wait for the next attempt.
    fn leave(&mut self, now: Duration, why: &str) -> Vec<FollowerEvent> {
        self.link = Link::Pause(now + self.pause);
        self.pause = (2 * self.pause).min(PAUSES[1]);
        // Another leader counts anew.
        self.newest = 0;
        let was_there = self.session.take().is_some();
        // Once is enough.
        let told = std::mem::replace(&mut self.told_silence, true);
        let leader = self.leader;
        let event = match (was_there, why) {
            (true, why) => FollowerEvent::Lost(format!("the leader at {leader} is lost: {why}")),
            (false, _) if told => return Vec::new(),
            (false, NO_ANSWER) => FollowerEvent::Lost(format!(
                "the leader at {leader} does not answer: is it started, with the same key, and does its firewall let UDP to port {} through?",
                leader.port()
            )),
            (false, why) => FollowerEvent::Lost(format!("the leader at {leader} cannot be followed: {why}")),
        };
        vec![event]
    }

    /// Tells the leader something that the presenter should know: as soon as the leader is there.
    pub fn tell(&mut self, severity: Severity, text: &str) {
        let text = plain(text.trim(), MOST_WORDS);
        if !text.is_empty() {
            self.to_tell.push_back((severity, text));
            if self.to_tell.len() > MOST_KEPT {
                self.to_tell.pop_front();
            }
        }
    }

    /// Sends how it is, and what was told.
    pub fn send(&mut self, report: Report) {
        let Link::Open(side) = &mut self.link else { return };
        if let Some(session) = self.session {
            for (severity, text) in self.to_tell.drain(..) {
                if let Some(bytes) = (FromFollower::Told { session, severity, text }).encode() {
                    side.give(RELIABLE, bytes);
                }
            }
            if let Some(bytes) = (Report { session, ..report }).encode() {
                side.give(UNRELIABLE, bytes);
            }
        }
        side.send();
    }
}
