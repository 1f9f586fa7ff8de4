//! The leader: tells everybody what is shown, and keeps a list of who follows and how they are.

use super::message::{FromFollower, FromLeader, MOST_TEXT, Message, MessageError, plain};
use super::transport::{RELIABLE, ServerSide, UNRELIABLE};
use super::{Frame, NetworkError, Report, Severity, ShowKey};
use renet::{Bytes, ClientId, ServerEvent};
use renetcode::generate_random_bytes;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::time::Duration;

/// Frames that a follower may be behind and count as in step: the way there and back, and a frame on either side.
pub const IN_STEP: u64 = 3;
/// Time after which a follower that says nothing may be replaced by another one of its name: one that was started again.
const REPLACED: Duration = Duration::from_millis(500);
/// Time in which who has come has to answer the welcome.
const ANSWER: Duration = Duration::from_secs(3);
/// Messages that are taken of a follower at a time, and sentences that are passed on of it in a second.
const MOST_AT_ONCE: usize = 256;
const MOST_TOLD: u32 = 10;

/// A follower as the presenter sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct FollowerInfo {
    /// What it is called; no two are called the same.
    pub name: String,
    /// Where it is.
    pub address: SocketAddr,
    /// Whether it is there.
    pub is_here: bool,
    /// Since when it is there or gone.
    pub since: Duration,
    /// How it is, as it says.
    pub report: Option<Report>,
    /// Frames that it is behind, by its last report.
    pub behind: u64,
    /// Seconds that a packet takes to it and back.
    pub round_trip: f64,
    /// When it was heard last.
    pub heard: Duration,
    /// The last error that it told.
    pub warning: Option<String>,
    base: String,
    instance: u64,
    client: ClientId,
}

impl FollowerInfo {
    /// Whether it shows what the leader shows.
    pub fn is_in_step(&self) -> bool {
        self.is_here && self.report.is_some() && self.behind <= IN_STEP
    }
}

/// Something that the presenter should know.
#[derive(Clone, Debug, PartialEq)]
pub enum LeaderEvent {
    /// A follower has come; again where it was there before.
    Came {
        /// Which.
        name: String,
        /// Whether it was there before.
        again: bool,
    },
    /// A follower has gone.
    Gone {
        /// Which.
        name: String,
    },
    /// A follower tells something.
    Told {
        /// Which.
        name: String,
        /// How bad it is.
        severity: Severity,
        /// What.
        text: String,
    },
    /// Somebody holds the key and speaks otherwise.
    Refused {
        /// Who.
        address: Option<SocketAddr>,
        /// Why.
        why: String,
    },
}

/// A meeting with somebody who holds the key.
struct Meeting {
    session: u64,
    since: Duration,
    answered: bool,
    /// What was sent last of the scene and of the tour.
    scene: u64,
    tour: u64,
    /// Sentences that were passed on since a time.
    told: (Duration, u32),
}

/// Something that is sent whenever it changes.
#[derive(Default)]
struct Kept {
    revision: u64,
    bytes: Option<Bytes>,
}

impl Kept {
    fn set(&mut self, message: &FromLeader) -> bool {
        let Some(bytes) = message.encode() else { return false };
        self.revision += 1;
        self.bytes = Some(bytes.into());
        true
    }
}

/// One who leads.
pub struct Leader {
    side: ServerSide,
    now: Duration,
    frame: u64,
    scene: Kept,
    tour: Kept,
    meetings: HashMap<ClientId, Meeting>,
    followers: Vec<FollowerInfo>,
}

impl Leader {
    /// Leads from an address; port 0 takes any that is free.
    ///
    /// # Errors
    /// [`NetworkError::Bind`].
    pub fn bind(address: SocketAddr, key: ShowKey) -> Result<Leader, NetworkError> {
        let side = ServerSide::bind(address, key).map_err(|source| NetworkError::Bind { address, source })?;
        let (now, scene, tour) = (Duration::ZERO, Kept::default(), Kept::default());
        let (meetings, followers) = (HashMap::new(), Vec::new());
        let mut leader = Leader { side, now, frame: 0, scene, tour, meetings, followers };
        // A follower that comes may still have the tour of another leader.
        leader.set_tour(String::new(), String::new(), 1.0);
        Ok(leader)
    }

    /// Where it is heard.
    pub fn address(&self) -> Option<SocketAddr> {
        self.side.address().ok()
    }

    /// The followers, those included that are gone.
    pub fn followers(&self) -> &[FollowerInfo] {
        &self.followers
    }

    /// The number of the last frame.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// What is shown from now on, as the text of a scene file. False where it is too long to be sent.
    pub fn set_scene(&mut self, text: String) -> bool {
        text.len() <= MOST_TEXT && self.scene.set(&FromLeader::Scene { text })
    }

    /// The tour that is open from now on: text, folder of its pictures and width over height of the picture; none for an empty text.
    /// False where it is too long to be sent.
    pub fn set_tour(&mut self, text: String, folder: String, aspect: f64) -> bool {
        text.len() <= MOST_TEXT && self.tour.set(&FromLeader::Tour { text, folder, aspect })
    }

    /// Forgets a follower that is gone.
    pub fn forget(&mut self, name: &str) {
        self.followers.retain(|follower| follower.is_here || follower.name != name);
    }

    /// Takes in what has come until `now`.
    pub fn receive(&mut self, now: Duration) -> Vec<LeaderEvent> {
        self.now = self.now.max(now);
        let mut events = Vec::new();
        let changes = self.side.receive(now);
        for change in changes {
            match change {
                ServerEvent::ClientConnected { client_id } => self.welcome(client_id),
                ServerEvent::ClientDisconnected { client_id, .. } => {
                    self.meetings.remove(&client_id);
                    self.lose(client_id, &mut events);
                }
            }
        }
        let clients: Vec<ClientId> = self.meetings.keys().copied().collect();
        // Reports first: they say who is alive when somebody comes under a name that is taken.
        for &client in &clients {
            self.take_reports(client);
        }
        for &client in &clients {
            self.take_messages(client, &mut events);
        }
        let late = |meeting: &Meeting| !meeting.answered && self.now.saturating_sub(meeting.since) > ANSWER;
        let silent: Vec<ClientId> =
            self.meetings.iter().filter(|(_, meeting)| late(meeting)).map(|(client, _)| *client).collect();
        silent.into_iter().for_each(|client| self.dismiss(client));
        events
    }

    fn welcome(&mut self, client: ClientId) {
        let session = u64::from_le_bytes(generate_random_bytes());
        if let Some(bytes) = (FromLeader::Welcome { session }).encode() {
            self.side.give(client, RELIABLE, bytes.into());
        }
        let (since, told) = (self.now, (self.now, 0));
        self.meetings.insert(client, Meeting { session, since, answered: false, scene: 0, tour: 0, told });
    }

    fn dismiss(&mut self, client: ClientId) {
        self.meetings.remove(&client);
        self.side.dismiss(client);
    }

    fn lose(&mut self, client: ClientId, events: &mut Vec<LeaderEvent>) {
        let now = self.now;
        if let Some(follower) = self.followers.iter_mut().find(|info| info.is_here && info.client == client) {
            (follower.is_here, follower.since) = (false, now);
            events.push(LeaderEvent::Gone { name: follower.name.clone() });
        }
    }

    fn take_reports(&mut self, client: ClientId) {
        for _ in 0..MOST_AT_ONCE {
            let Some(bytes) = self.side.message(client, UNRELIABLE) else { break };
            let Some(meeting) = self.meetings.get(&client) else { break };
            // A report that makes no sense says nothing, and the next one comes soon.
            let Ok(report) = Report::decode(&bytes) else { continue };
            if report.session != meeting.session || report.frame > self.frame {
                continue;
            }
            let round_trip = self.side.round_trip(client);
            if let Some(follower) = self.followers.iter_mut().find(|info| info.is_here && info.client == client) {
                // Reports may overtake one another.
                if follower.report.is_none_or(|last| last.session != report.session || report.frame >= last.frame) {
                    follower.behind = self.frame - report.frame;
                    follower.report = Some(report);
                }
                (follower.heard, follower.round_trip) = (self.now, round_trip);
            }
        }
    }

    fn take_messages(&mut self, client: ClientId, events: &mut Vec<LeaderEvent>) {
        for _ in 0..MOST_AT_ONCE {
            let Some(bytes) = self.side.message(client, RELIABLE) else { break };
            let Some(meeting) = self.meetings.get_mut(&client) else { break };
            match FromFollower::decode(&bytes) {
                Ok(FromFollower::Hello { session, name, instance }) if session == meeting.session => {
                    if !std::mem::replace(&mut meeting.answered, true) {
                        self.admit(client, name, instance, events);
                    }
                }
                Ok(FromFollower::Told { session, severity, text }) if session == meeting.session => {
                    if self.now.saturating_sub(meeting.told.0) >= Duration::from_secs(1) {
                        meeting.told = (self.now, 0);
                    }
                    meeting.told.1 += 1;
                    let heard = meeting.told.1 <= MOST_TOLD;
                    let known = self.followers.iter_mut().find(|info| info.is_here && info.client == client);
                    if let Some(follower) = known.filter(|_| heard) {
                        if severity == Severity::Error {
                            follower.warning = Some(text.clone());
                        }
                        events.push(LeaderEvent::Told { name: follower.name.clone(), severity, text });
                    }
                }
                // Of another meeting: somebody plays back what was recorded.
                Ok(_) => self.dismiss(client),
                Err(error) => {
                    let (address, why) = (self.side.address_of(client), words(&error));
                    events.push(LeaderEvent::Refused { address, why });
                    self.dismiss(client);
                    self.lose(client, events);
                }
            }
        }
    }

    /// Puts somebody who has answered on the list: where they were, if they were there before.
    fn admit(&mut self, client: ClientId, base: String, instance: u64, events: &mut Vec<LeaderEvent>) {
        let Some(address) = self.side.address_of(client) else { return };
        let now = self.now;
        let is_free = |info: &FollowerInfo| {
            info.instance == instance || !info.is_here || now.saturating_sub(info.heard) > REPLACED
        };
        let place = self.followers.iter().position(|info| info.base == base && is_free(info));
        let again = place.is_some();
        let place = place.unwrap_or_else(|| {
            let taken = |name: &String| self.followers.iter().any(|info| info.name == *name);
            let names = std::iter::once(base.clone()).chain((2..).map(|i| format!("{base} ({i})")));
            let name = names.into_iter().find(|name| !taken(name)).unwrap_or_else(|| base.clone());
            self.followers.push(FollowerInfo {
                name,
                address,
                is_here: false,
                since: now,
                report: None,
                behind: 0,
                round_trip: 0.0,
                heard: now,
                warning: None,
                base,
                instance,
                client,
            });
            self.followers.len() - 1
        });
        let follower = &mut self.followers[place];
        let before = follower.is_here.then_some(follower.client).filter(|before| *before != client);
        (follower.address, follower.client, follower.instance) = (address, client, instance);
        (follower.is_here, follower.since, follower.heard) = (true, now, now);
        (follower.report, follower.behind, follower.warning) = (None, 0, None);
        events.push(LeaderEvent::Came { name: follower.name.clone(), again });
        if let Some(before) = before {
            self.dismiss(before);
        }
    }

    /// Sends a frame to everybody, and what has changed since the last one. The number that the frame has got.
    pub fn send(&mut self, frame: Frame) -> u64 {
        self.frame += 1;
        let frame: Option<Bytes> = Frame { number: self.frame, ..frame }.encode().map(Bytes::from);
        for (&client, meeting) in self.meetings.iter_mut().filter(|(_, meeting)| meeting.answered) {
            for (kept, sent) in [(&self.tour, &mut meeting.tour), (&self.scene, &mut meeting.scene)] {
                let Some(bytes) = kept.bytes.clone().filter(|_| *sent != kept.revision) else { continue };
                // What changes faster than it arrives is sent as it is then.
                if self.side.has_room(client) && self.side.give(client, RELIABLE, bytes) {
                    *sent = kept.revision;
                }
            }
            if let Some(frame) = &frame {
                self.side.give(client, UNRELIABLE, frame.clone());
            }
        }
        self.side.send();
        self.frame
    }
}

/// An error as one line that is safe to show.
fn words(error: &MessageError) -> String {
    plain(&error.to_string(), 300)
}
