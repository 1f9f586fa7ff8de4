//! A leader and followers at 60 frames a second over a wire that delays, reorders and loses packets. Prints what it measures, and
//! takes two minutes:
//! `cargo bench --no-default-features --bench network_loss`
#![allow(clippy::unwrap_used, reason = "what cannot be set up cannot be measured")]

use deepfield::look::{Camera, DatasetRef, SceneFile};
use deepfield::show::protocol::{Follower, FollowerEvent, Frame, Leader, Ranges, Report, ShowKey, TourTime};
use std::collections::{BinaryHeap, HashMap};
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const FRAME: Duration = Duration::from_micros(16_667);
/// Bytes of Ethernet, IPv4 and UDP around a packet.
const HEADERS: u64 = 14 + 20 + 8;

/// A packet on its way: the earliest is the greatest.
#[derive(PartialEq, Eq)]
struct Flight {
    due: Instant,
    number: u64,
    bytes: Vec<u8>,
    /// The follower that it belongs to, and whether it goes there.
    follower: SocketAddr,
    is_down: bool,
}

impl Ord for Flight {
    fn cmp(&self, other: &Flight) -> std::cmp::Ordering {
        (other.due, other.number).cmp(&(self.due, self.number))
    }
}

impl PartialOrd for Flight {
    fn partial_cmp(&self, other: &Flight) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// What a wire does, the same in either direction.
#[derive(Clone, Copy, Default)]
struct Quality {
    /// Share of packets that are lost.
    loss: f64,
    /// How long the others take, and by how much more or less.
    delay_ms: f64,
    jitter_ms: f64,
}

/// The wire between a leader and its followers.
#[derive(Default)]
struct Wire {
    quality: Mutex<Quality>,
    /// Bytes from the leader and from the followers, before any are lost.
    bytes: [AtomicU64; 2],
    ends: AtomicBool,
}

impl Wire {
    /// Starts it; followers find the leader at the address that is returned.
    fn start(leader: SocketAddr) -> (Arc<Wire>, SocketAddr, JoinHandle<()>) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_nonblocking(true).unwrap();
        let address = socket.local_addr().unwrap();
        let wire = Arc::new(Wire::default());
        let running = Arc::clone(&wire);
        (wire, address, std::thread::spawn(move || running.run(&socket, leader)))
    }

    fn run(&self, socket: &UdpSocket, leader: SocketAddr) {
        let mut ways: HashMap<SocketAddr, UdpSocket> = HashMap::new();
        let (mut flights, mut number, mut buffer) = (BinaryHeap::new(), 0u64, [0; 2048]);
        let mut state = 7u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        while !self.ends.load(Relaxed) {
            let quality = *self.quality.lock().unwrap();
            let mut take = |bytes: &[u8], follower, is_down: bool| {
                self.bytes[usize::from(!is_down)].fetch_add(bytes.len() as u64 + HEADERS, Relaxed);
                number += 1;
                if random() >= quality.loss {
                    let delay = (quality.delay_ms + quality.jitter_ms * (2.0 * random() - 1.0)).max(0.0);
                    let due = Instant::now() + Duration::from_secs_f64(1e-3 * delay);
                    flights.push(Flight { due, number, bytes: bytes.to_vec(), follower, is_down });
                }
            };
            while let Ok((length, from)) = socket.recv_from(&mut buffer) {
                ways.entry(from).or_insert_with(|| {
                    let way = UdpSocket::bind("127.0.0.1:0").unwrap();
                    way.set_nonblocking(true).unwrap();
                    way
                });
                take(&buffer[..length], from, false);
            }
            for (&follower, way) in &ways {
                while let Ok((length, _)) = way.recv_from(&mut buffer) {
                    take(&buffer[..length], follower, true);
                }
            }
            while flights.peek().is_some_and(|flight| flight.due <= Instant::now()) {
                let Some(flight) = flights.pop() else { break };
                // A packet that the system does not take is lost.
                let _ = match flight.is_down {
                    true => socket.send_to(&flight.bytes, flight.follower),
                    false => ways[&flight.follower].send_to(&flight.bytes, leader),
                };
            }
            std::thread::sleep(Duration::from_micros(200));
        }
    }

    fn bytes(&self) -> [u64; 2] {
        [0, 1].map(|way| self.bytes[way].load(Relaxed))
    }
}

/// What a follower has seen, frame by frame of its own.
#[derive(Clone, Default)]
struct Seen {
    /// Frames of the leader that it has shown.
    shown: u64,
    /// Milliseconds since the leader was where the follower shows it.
    ages: Vec<f64>,
    /// When it got its last settings, and which.
    settings: Option<(Instant, f64)>,
}

struct Screen {
    seen: Arc<Mutex<Seen>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Screen {
    fn start(leader: SocketAddr, key: &ShowKey, name: String, begin: Instant) -> Screen {
        let (seen, ends) = (Arc::new(Mutex::new(Seen::default())), Arc::new(AtomicBool::new(false)));
        let (key, kept, stop) = (key.clone(), Arc::clone(&seen), Arc::clone(&ends));
        let thread = std::thread::spawn(move || {
            let mut follower = Follower::new(leader, key, &name);
            let (mut last, mut next) = (0, Instant::now());
            while !stop.load(Relaxed) {
                let events = follower.receive(begin.elapsed());
                let mut seen = kept.lock().unwrap();
                for event in events {
                    if let FollowerEvent::Scene(scene) = event {
                        seen.settings = scene.look.error_px.map(|error_px| (Instant::now(), error_px));
                    }
                }
                let frame = follower.frame().map_or(0, |frame| frame.number);
                if let Some(frame) = follower.frame() {
                    seen.shown += u64::from(frame.number != last);
                    last = frame.number;
                    seen.ages.push(1e3 * (begin.elapsed().as_secs_f64() - frame.time));
                }
                drop(seen);
                let report = Report { session: 0, frame, frame_ms: 16.7, missing: 0, failed: 0, converged: true };
                follower.send(report);
                next += FRAME;
                std::thread::sleep(next.saturating_duration_since(Instant::now()));
            }
        });
        Screen { seen, ends, thread: Some(thread) }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.ends.store(true, Relaxed);
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}

fn scene(error_px: f64) -> String {
    let data = DatasetRef { path: "box.df".into(), ..DatasetRef::of("box.df".as_ref(), "a.scene.ron".as_ref()) };
    let mut scene = SceneFile::new(vec![data]);
    scene.look.error_px = Some(error_px);
    scene.text("a".as_ref()).unwrap()
}

/// A leader, a wire and followers.
struct Show {
    begin: Instant,
    next: Instant,
    leader: Leader,
    wire: Arc<Wire>,
    thread: Option<JoinHandle<()>>,
    screens: Vec<Screen>,
}

impl Show {
    fn start(followers: usize) -> Show {
        let (key, begin) = (ShowKey::random(), Instant::now());
        let mut leader = Leader::bind("127.0.0.1:0".parse().unwrap(), key.clone()).unwrap();
        assert!(leader.set_scene(scene(1.0)));
        let (wire, address, thread) = Wire::start(leader.address().unwrap());
        let screens = (0..followers).map(|i| Screen::start(address, &key, format!("screen {i}"), begin)).collect();
        Show { begin, next: Instant::now(), leader, wire, thread: Some(thread), screens }
    }

    fn frame(&mut self) {
        self.leader.receive(self.begin.elapsed());
        let time = self.begin.elapsed().as_secs_f64();
        let eye = [30.0 * time.cos(), 1.0 / 3.0, 30.0 * time.sin()];
        let camera = Camera { eye, target: [0.1, 0.2, 0.3], up: [0.0, 1.0, 0.0], fov: 40.0 + time.sin(), ortho: None };
        let ranges = Some(Ranges { p: [1e-7 * time, 1.0 + time], s: [0.0, 2.0] });
        self.leader.send(Frame {
            number: 0,
            time,
            camera,
            ranges,
            tour: Some(TourTime { time, running: true }),
            run: None,
        });
        self.next += FRAME;
        std::thread::sleep(self.next.saturating_duration_since(Instant::now()));
    }

    fn frames(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.frame();
        }
    }

    /// Milliseconds until something is so; infinite where that takes more than two minutes.
    fn until(&mut self, is_so: impl Fn(&Show) -> bool) -> f64 {
        let begin = Instant::now();
        while !is_so(self) {
            if begin.elapsed() > Duration::from_secs(120) {
                return f64::INFINITY;
            }
            self.frame();
        }
        1e3 * begin.elapsed().as_secs_f64()
    }

    fn is_in_step(&self) -> bool {
        let followers = self.leader.followers();
        followers.len() == self.screens.len() && followers.iter().all(|follower| follower.is_in_step())
    }

    fn is_heard(&self) -> bool {
        self.leader.followers().iter().filter(|follower| follower.is_here).count() == self.screens.len()
    }

    fn seen(&self) -> Vec<Seen> {
        self.screens.iter().map(|screen| screen.seen.lock().unwrap().clone()).collect()
    }
}

impl Drop for Show {
    fn drop(&mut self) {
        self.screens.clear();
        self.wire.ends.store(true, Relaxed);
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}

/// The share `at` of sorted numbers; no number where there are none.
fn quantile(sorted: &[f64], at: f64) -> f64 {
    let index = (sorted.len().saturating_sub(1) as f64 * at).round() as usize;
    sorted.get(index).copied().unwrap_or(f64::NAN)
}

/// Measures a show over a wire.
fn measure(followers: usize, quality: Quality) {
    let mut show = Show::start(followers);
    *show.wire.quality.lock().unwrap() = quality;
    let joined = show.until(Show::is_heard);
    show.frames(Duration::from_secs(1));
    let (first, bytes, start) = (show.leader.frame(), show.wire.bytes(), Instant::now());
    show.screens.iter().for_each(|screen| {
        let mut seen = screen.seen.lock().unwrap();
        (seen.shown, seen.ages) = (0, Vec::new());
    });
    let mut behind = Vec::new();
    while start.elapsed() < Duration::from_secs(10) {
        show.frame();
        behind.extend(show.leader.followers().iter().map(|follower| follower.behind as f64));
    }
    let seconds = start.elapsed().as_secs_f64();
    let sent = (show.leader.frame() - first) as f64;
    let [down, up] = [0, 1].map(|way| (show.wire.bytes()[way] - bytes[way]) as f64 / seconds / 1e3);
    let seen = show.seen();
    let shown = seen.iter().map(|seen| seen.shown as f64).sum::<f64>() / followers as f64 / sent;
    let mut ages: Vec<f64> = seen.iter().flat_map(|seen| seen.ages.iter().copied()).collect();
    ages.sort_by(f64::total_cmp);
    behind.sort_by(f64::total_cmp);
    let changed = Instant::now();
    assert!(show.leader.set_scene(scene(2.0)));
    show.until(|show| show.seen().iter().all(|seen| seen.settings.is_some_and(|(_, error_px)| error_px == 2.0)));
    let seen = show.seen();
    let settings = seen.iter().filter_map(|seen| seen.settings).map(|(at, _)| at.duration_since(changed));
    let settings = 1e3 * settings.max().unwrap_or_default().as_secs_f64();
    let Quality { loss, delay_ms, jitter_ms } = quality;
    println!(
        "{followers} followers, {:.0} % lost, {delay_ms} ± {jitter_ms} ms each way: there after {joined:.0} ms; \
         {:.1} % of {sent} frames shown; age {:.1} ms median, {:.1} ms 99 %, {:.1} ms most; \
         {} frames behind median, {} 99 %; settings after {settings:.0} ms; {down:.1} kB/s down, {up:.1} kB/s up",
        100.0 * loss,
        100.0 * shown,
        quantile(&ages, 0.5),
        quantile(&ages, 0.99),
        quantile(&ages, 1.0),
        quantile(&behind, 0.5),
        quantile(&behind, 0.99),
    );
}

fn main() {
    for followers in [1, 3] {
        for (loss, delay_ms, jitter_ms) in
            [(0.0, 0.0, 0.0), (0.05, 20.0, 5.0), (0.2, 20.0, 5.0), (0.2, 100.0, 30.0), (0.5, 20.0, 5.0)]
        {
            measure(followers, Quality { loss, delay_ms, jitter_ms });
        }
    }
    for (seconds, loss) in [(3, 0.05), (10, 0.05), (10, 0.2)] {
        let mut show = Show::start(2);
        let good = Quality { loss, delay_ms: 5.0, jitter_ms: 2.0 };
        *show.wire.quality.lock().unwrap() = good;
        show.until(Show::is_in_step);
        *show.wire.quality.lock().unwrap() = Quality { loss: 1.0, ..good };
        show.frames(Duration::from_secs(seconds));
        let gone = show.leader.followers().iter().filter(|follower| !follower.is_here).count();
        *show.wire.quality.lock().unwrap() = good;
        let restored = show.begin.elapsed();
        let back = show.until(|show| {
            show.is_in_step() && show.leader.followers().iter().all(|follower| follower.heard > restored)
        });
        println!("{seconds} s without a network ({gone} of 2 given up): in step again after {back:.0} ms");
    }
}
