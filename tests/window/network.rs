//! A show in two windows under virtual X servers: one leads as a presenter would, the other shows its picture and nothing else, is
//! killed, comes back, and is closed.

use super::desktop::{Desktop, PATIENCE, Program, Screen, choose, keep, middle, repeat};
use crate::support::{demo, program};
use serde_json::Value;

const TAB: u32 = 0xff09;
const ESCAPE: u32 = 0xff1b;
/// The leader's window, with both docks: two windows are drawn at once.
const STAGE: [u16; 2] = [960, 540];

/// Share of the leader's picture, which begins at a column, that the follower's screen shows otherwise.
fn difference(leader: &Screen, left: usize, follower: &Screen, [width, height]: [usize; 2]) -> f64 {
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let differs = |(x, y): &(usize, usize)| {
        leader.at(left + x, *y).iter().zip(follower.at(*x, *y)).any(|(a, b)| a.abs_diff(b) > 12)
    };
    all.filter(differs).count() as f64 / (width * height) as f64
}

/// Whether the leader says that its follower is there, and that it is in step.
fn follower(status: &Value) -> [bool; 2] {
    let row = &status["show"]["followers"][0];
    [1, 2].map(|i| row[i].as_bool().unwrap_or(false))
}

/// Whether two windows show the same, by what they say.
fn same(a: &Value, b: &Value) -> bool {
    let of = |status: &Value| {
        let mut settings = status["settings"].clone();
        settings["closed"] = Value::Null;
        (status["eye"].clone(), status["target"].clone(), settings)
    };
    a["converged"] == true && b["converged"] == true && of(a) == of(b)
}

#[test]
fn a_follower_shows_the_leaders_picture_and_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let [here, there] = ["leader", "follower"].map(|name| folder.path().join(name));
    [&here, &there].into_iter().for_each(|folder| std::fs::create_dir(folder).unwrap());
    let key = folder.path().join("show.key");
    let made = program().arg("key").arg(&key).output().unwrap();
    assert!(made.status.success());
    let key = key.to_str().unwrap();

    let stage = Desktop::with_screen(STAGE);
    let lead = ["--backend", "cpu", "--lead", "127.0.0.1:0", "--show-key", key];
    let mut leader = Program::open(&stage, &here, &demo(), STAGE, &lead);
    let first = leader.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["show"]["role"], "leader");
    let address = first["show"]["address"].as_str().unwrap().to_owned();
    let side = |i: usize| first["picture"][i].as_f64().unwrap() as usize;
    let size = [side(2) - side(0), side(3) - side(1)];

    // A screen as large as the leader's picture, on another machine with a copy of the data.
    let copy = there.join("copy.hdf5");
    std::fs::copy(demo(), &copy).unwrap();
    let screen = size.map(|pixels| u16::try_from(pixels).unwrap());
    let hall = Desktop::with_screen(screen);
    let follow = ["--backend", "cpu", "--follow", &address, "--show-key", key, "--name", "left"];
    let start = || Program::open(&hall, &there, &copy, screen, &follow);
    let mut led = start();
    leader.wait("a follower in step", |status| follower(status) == [true; 2]);

    // The leader turns the picture and chooses another mode; the follower shows the same, without panels and words.
    stage.focus(stage.window().unwrap());
    let [x, y] = middle(&first);
    let turn = || stage.drag([x, y], [x + 120, y + 40]);
    repeat(&leader, "a turn", turn, |status| status["eye"] != first["eye"]);
    let mode = "density-squared";
    choose(&leader, &stage, "mode", &format!("mode:{mode}"), |status| status["settings"]["mode"] == mode);
    let compare = |leader: &Program, led: &mut Program, what: &str| {
        led.wait(what, |status| same(&leader.status(), status));
        // Messages over the leader's picture fade.
        let begin = std::time::Instant::now();
        loop {
            let (on_stage, in_hall) = (stage.screenshot(), hall.screenshot());
            let differing = difference(&on_stage, side(0), &in_hall, size);
            if differing < 0.01 {
                let lit = in_hall.share(0..size[0], |pixel| pixel.iter().any(|&channel| channel > 40));
                assert!(lit > 0.05, "a picture, not a black screen: {lit}");
                return;
            }
            assert!(begin.elapsed() < PATIENCE, "{what}: {differing} of the picture differs");
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
    };
    compare(&leader, &mut led, "the leader's picture");
    keep(&stage, "network-leader.png");
    keep(&hall, "network-follower.png");

    // Keys and mouse of the audience do nothing.
    hall.focus(hall.window().unwrap());
    hall.press(TAB);
    hall.drag([120, 200], [280, 300]);
    compare(&leader, &mut led, "nothing changes");

    // Killed: the presenter is told. Started again: it catches up with what has changed.
    drop(led);
    let gone = leader.wait("a follower that is gone", |status| !follower(status)[0]);
    assert!(gone["messages"].to_string().contains("left is gone"), "{gone:#}");
    keep(&stage, "network-gone.png");
    repeat(&leader, "another turn", turn, |status| status["eye"] != gone["eye"]);
    let mut led = start();
    let back = leader.wait("a follower that is back", |status| follower(status) == [true; 2]);
    assert!(back["messages"].to_string().contains("left follows again"), "{back:#}");
    compare(&leader, &mut led, "caught up");
    assert_eq!(led.status()["show"]["role"], "follower");

    // Escape closes it, and it says so.
    hall.focus(hall.window().unwrap());
    hall.press(ESCAPE);
    assert_eq!(led.exit_code(), Some(0));
    leader.wait("a follower that has left", |status| !follower(status)[0]);
}
