//! A leader and followers over the loopback, frame by frame: followers stay in step, come back, and hear nobody without the key.

use deepfield::look::{Camera, DatasetRef, SceneFile};
use deepfield::show::protocol::{
    Follower, FollowerEvent, Frame, Leader, LeaderEvent, Ranges, Report, Severity, ShowKey, TourTime,
};
use deepfield::tour::{Keyframe, TourFile};
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

const STEP: Duration = Duration::from_millis(16);

fn camera(i: u64) -> Camera {
    let angle = 0.01 * i as f64;
    let eye = [30.0 * angle.cos(), 1.0 / 3.0 + 1e-9 * angle, 30.0 * angle.sin()];
    Camera { eye, target: [0.1, 0.2, 0.3], up: [0.0, 1.0, 0.0], fov: 40.0 + angle.sin(), ortho: None }
}

/// Frame `i` of the show.
fn frame(i: u64, now: Duration) -> Frame {
    let tour = i.is_multiple_of(3).then_some(TourTime { time: 0.016 * i as f64, running: true });
    let ranges = Some(Ranges { p: [1e-7 * i as f64, 1.0 + i as f64], s: [0.0, 2.0] });
    Frame { number: 0, time: now.as_secs_f64(), camera: camera(i), ranges, tour, run: None }
}

fn scene(error_px: f64) -> String {
    let data = DatasetRef { path: "box.df".into(), ..DatasetRef::of("box.df".as_ref(), "a.scene.ron".as_ref()) };
    let mut scene = SceneFile::new(vec![data]);
    scene.look.error_px = Some(error_px);
    scene.text("a".as_ref()).unwrap()
}

/// What a follower shows.
struct Screen {
    follower: Follower,
    error_px: Option<f64>,
    tour: Option<TourFile>,
    told: Vec<String>,
}

impl Screen {
    fn new(leader: SocketAddr, key: &ShowKey, name: &str) -> Screen {
        Screen { follower: Follower::new(leader, key.clone(), name), error_px: None, tour: None, told: Vec::new() }
    }

    fn step(&mut self, now: Duration) {
        for event in self.follower.receive(now) {
            match event {
                FollowerEvent::Scene(scene) => self.error_px = scene.look.error_px,
                FollowerEvent::Tour(tour) => self.tour = tour.map(|led| led.tour),
                FollowerEvent::Joined => self.told.push("joined".into()),
                FollowerEvent::Lost(why) | FollowerEvent::Refused(why) => self.told.push(why),
            }
        }
        let frame = self.number();
        self.follower.send(Report { session: 0, frame, frame_ms: 16.0, missing: 3, failed: 0, converged: false });
    }

    fn number(&self) -> u64 {
        self.follower.frame().map_or(0, |frame| frame.number)
    }
}

fn loopback() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

#[test]
fn two_followers_stay_within_a_frame_for_a_thousand_frames_and_one_is_killed_on_the_way() {
    let key = ShowKey::random();
    let mut leader = Leader::bind(loopback(), key.clone()).unwrap();
    let address = leader.address().unwrap();
    let mut screens = vec![Some(Screen::new(address, &key, "left")), Some(Screen::new(address, &key, "right"))];
    let mut now = Duration::ZERO;
    let mut events = Vec::new();
    let mut frames = 0;
    assert!(leader.set_scene(scene(1.0)));
    let all_there = |screens: &[Option<Screen>]| screens.iter().flatten().all(|screen| screen.number() > 0);
    let (mut checked, mut settle) = (0, 0);
    let tour = TourFile::new(vec![Keyframe { at: Some(0.0), camera: Some(camera(1)), ..Keyframe::default() }]);
    while checked < 1000 {
        now += STEP;
        events.extend(leader.receive(now));
        frames += 1;
        let number = leader.send(frame(frames, now));
        assert_eq!(number, frames);
        screens.iter_mut().flatten().for_each(|screen| screen.step(now));
        if settle > 0 || !all_there(&screens) {
            // Somebody is on the way in: the others are in step all the while.
            assert!(frames < 100 || screens[0].as_ref().is_none_or(|screen| screen.number() + 1 >= number));
            settle = if all_there(&screens) { settle.max(1) - 1 } else { 3 };
            assert!(frames < 2000, "nobody comes");
            continue;
        }
        for screen in screens.iter().flatten() {
            let shown = screen.follower.frame().unwrap();
            assert!(shown.number + 1 >= number, "frame {number}: {}", shown.number);
            // Bit for bit what the leader showed in that frame.
            assert_eq!(shown.camera, camera(shown.number));
            assert_eq!((shown.ranges, shown.tour), (frame(shown.number, now).ranges, frame(shown.number, now).tour));
        }
        checked += 1;
        match checked {
            // Killed: no word of leave.
            300 => std::mem::forget(screens[1].take()),
            400 => screens[1] = Some(Screen::new(address, &key, "right")),
            500 => assert!(leader.set_scene(scene(2.0)) && leader.set_tour(tour.to_ron(), "/shows".into(), 1.5)),
            _ => {}
        }
    }
    for screen in screens.iter().flatten() {
        assert_eq!(screen.error_px, Some(2.0));
        assert_eq!(screen.tour.as_ref(), Some(&tour));
        assert_eq!(screen.told, ["joined"]);
    }
    let followers = leader.followers();
    assert_eq!(followers.iter().map(|info| info.name.as_str()).collect::<Vec<_>>().len(), 2);
    assert!(followers.iter().all(|info| info.is_in_step() && info.report.unwrap().missing == 3), "{followers:?}");
    let came = |name: &str, again| events.contains(&LeaderEvent::Came { name: name.into(), again });
    assert!(came("left", false) && came("right", false) && came("right", true) && !came("left", true), "{events:?}");
}

#[test]
fn a_leader_that_was_started_again_is_followed_again() {
    let key = ShowKey::random();
    let mut leader = Leader::bind(loopback(), key.clone()).unwrap();
    let address = leader.address().unwrap();
    let mut screen = Screen::new(address, &key, "dome");
    let mut now = Duration::ZERO;
    let run = |leader: &mut Option<Leader>, screen: &mut Screen, now: &mut Duration, steps: u64| {
        for _ in 0..steps {
            *now += STEP;
            if let Some(leader) = leader {
                leader.receive(*now);
                leader.send(frame(7, *now));
            }
            screen.step(*now);
        }
    };
    leader.set_scene(scene(1.0));
    let mut leader = Some(leader);
    run(&mut leader, &mut screen, &mut now, 500);
    assert!(screen.number() > 480 && screen.error_px == Some(1.0));
    // It ends; the last picture stays.
    drop(leader.take());
    run(&mut leader, &mut screen, &mut now, 600);
    assert!(screen.number() > 480 && !screen.follower.is_joined());
    assert_eq!(screen.told.len(), 2, "{:?}", screen.told);
    // Another one at the same place, which counts from the beginning: at most a pause and a round trip later.
    let mut other = Leader::bind(address, key).unwrap();
    other.set_scene(scene(3.0));
    let mut leader = Some(other);
    run(&mut leader, &mut screen, &mut now, 140);
    assert!(screen.number() <= 140 && screen.error_px == Some(3.0), "{:?}", screen.told);
    // One that falls silent without a word is found out.
    std::mem::forget(leader.take());
    run(&mut leader, &mut screen, &mut now, 400);
    assert!(
        !screen.follower.is_joined() && screen.told.last().unwrap().contains("nothing is heard"),
        "{:?}",
        screen.told
    );
}

#[test]
fn who_has_another_key_or_none_neither_leads_nor_follows() {
    let key = ShowKey::random();
    let mut leader = Leader::bind(loopback(), key.clone()).unwrap();
    let address = leader.address().unwrap();
    let mut good = Screen::new(address, &key, "good");
    let mut bad = Screen::new(address, &ShowKey::random(), "bad");
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut now = Duration::ZERO;
    let mut events = Vec::new();
    for i in 0..500u64 {
        now += STEP;
        events.extend(leader.receive(now));
        leader.send(frame(1, now));
        good.step(now);
        bad.step(now);
        // Noise of all lengths and kinds; a generator of Knuth's is random enough.
        let mut state = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let noise: Vec<u8> = (0..i * 5 % 1400)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            })
            .collect();
        stranger.send_to(&noise, address).unwrap();
    }
    assert_eq!(events, [LeaderEvent::Came { name: "good".into(), again: false }]);
    assert_eq!(leader.followers().len(), 1);
    assert!(good.number() > 480 && bad.number() == 0);
    assert!(bad.told.len() == 1 && bad.told[0].contains("does not answer"), "{:?}", bad.told);
}

#[test]
fn followers_tell_and_names_are_kept_apart() {
    let key = ShowKey::random();
    let mut leader = Leader::bind(loopback(), key.clone()).unwrap();
    let address = leader.address().unwrap();
    let mut screens = [Screen::new(address, &key, "wall"), Screen::new(address, &key, "wall\n\u{7}")];
    screens[0].follower.tell(Severity::Error, "page 7 is\ndamaged");
    let (mut now, mut events) = (Duration::ZERO, Vec::new());
    for _ in 0..30 {
        now += STEP;
        events.extend(leader.receive(now));
        leader.send(frame(1, now));
        screens.iter_mut().for_each(|screen| screen.step(now));
    }
    let mut names: Vec<&str> = leader.followers().iter().map(|info| info.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["wall", "wall (2)"]);
    let told = events.iter().find_map(|event| match event {
        LeaderEvent::Told { severity: Severity::Error, text, .. } => Some(text.as_str()),
        _ => None,
    });
    assert_eq!(told, Some("page 7 is damaged"));
    assert_eq!(leader.followers().iter().filter(|info| info.warning.is_some()).count(), 1);
    // Who says too much is not heard all the time.
    for i in 0..1000 {
        screens[0].follower.tell(Severity::Info, &format!("word {i}"));
    }
    let before = events.len();
    for _ in 0..30 {
        now += STEP;
        events.extend(leader.receive(now));
        leader.send(frame(1, now));
        screens.iter_mut().for_each(|screen| screen.step(now));
    }
    assert!(events.len() - before <= 20, "{}", events.len() - before);
    // A follower that leaves says so, and can be forgotten.
    let [left, _right] = screens;
    drop(left);
    now += STEP;
    let gone = leader.receive(now);
    let [LeaderEvent::Gone { name }] = &gone[..] else { panic!("{gone:?}") };
    leader.forget(name);
    assert_eq!(leader.followers().len(), 1);
}
