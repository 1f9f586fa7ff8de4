//! What is shown when, and what a presenter's keys lead to.

use super::*;
use crate::model::Bounds;
use crate::tour::{Comfort, around_data, remarks};
use proptest::prelude::*;

fn surroundings(text: &str) -> Surroundings {
    Surroundings {
        file: "t.tour.ron".into(),
        text: text.into(),
        folder: "/nowhere".into(),
        framed: Bounds { min: DVec3::ZERO, max: DVec3::splat(10.0) },
        aspect: 1.5,
        times: None,
        data: None,
    }
}

fn timeline(keyframes: &str) -> Timeline {
    let text = format!("(version: 1, keyframes: [{keyframes}])");
    Timeline::new(&TourFile::parse("t.tour.ron", &text).unwrap(), &surroundings(&text)).unwrap()
}

const EXAMPLE: &str = r#"
    (label: "all", mode: "density-squared", caption: "All of it", pause: 1.0,
     cut: (slab: (axis: z, middle: 2.0, thickness: 10.0)), transfer: (range: fixed(1.0, 100.0))),
    (after: 4.0, orbit: 90.0, cut: (slab: (axis: z, middle: 4.0, thickness: 0.1)), transfer: (range: fixed(100.0, 10000.0))),
    (at: 8.0, label: "near", hold: true, around: (what: ball((5.0, 5.0, 5.0), 0.1)), move: flight, caption: "Near", easing: linear),
    (after: 2.0, mode: "volume", fade: 1.0),
    (after: 3.0, caption: ""),
"#;

#[test]
fn what_is_not_said_stays_and_numbers_are_mixed() {
    let timeline = timeline(EXAMPLE);
    assert_eq!(timeline.duration(), 13.0);
    let half = timeline.state(3.0);
    let slab = half.look.cut.unwrap().slab.unwrap();
    assert!((slab.middle - 3.0).abs() < 1e-12 && (slab.thickness - 1.0).abs() < 1e-12, "{slab:?}");
    let range = half.look.transfer.clone().unwrap().range;
    assert_eq!(range, crate::color::transfer::Range::Fixed(10.0, 1000.0));
    assert_eq!(half.look.mode.map(|mode| mode.name), Some("density-squared"));
    // Categories switch at the keyframe, and fade.
    assert_eq!(timeline.state(9.99).look.mode.map(|mode| mode.name), Some("density-squared"));
    let fading = timeline.state(10.5);
    assert_eq!(fading.look.mode.map(|mode| mode.name), Some("volume"));
    assert!(fading.look.transfer.is_none(), "another mode has other colours");
    let blend = fading.blend.unwrap();
    assert!(blend.look.mode.map(|mode| mode.name) == Some("density-squared") && blend.share == 0.5, "{}", blend.share);
    assert!(timeline.state(11.0).blend.is_none());
}

/// Highlights go on as fast as `run` says, whatever happens on the way, and do not jump.
#[test]
fn highlights_run_with_the_time() {
    for easing in ["smooth", "linear", "in", "out", "hold"] {
        let timeline = timeline(&format!(
            r#"(pause: 1.0, paths: (of: all, run: 2.0, phase: 0.25)),
               (after: 3.0, easing: {easing}, paths: (of: all, run: -4.0, phase: 0.25), pause: 0.5),
               (after: 2.0, easing: {easing}, mode: "volume", fade: 1.0)"#
        ));
        let at = |time: f64| timeline.state(time).look.paths.unwrap();
        assert_eq!((at(0.0).phase, at(1.0).phase), (0.25, 2.25));
        let step = 1e-3;
        for i in 0..6499 {
            let (first, next) = (at(f64::from(i) * step), at(f64::from(i + 1) * step));
            let moved = next.phase - first.phase;
            // Only where the keyframe is waited for speeds jump.
            let speed = if first.run == next.run { first.run } else { 0.5 * (first.run + next.run) };
            let slack = if easing == "hold" { 6.0 * step } else { 1e-5 };
            assert!((moved - speed * step).abs() <= slack, "{easing} {i}: {moved} {speed}");
        }
        let fading = timeline.state(6.6);
        assert!(fading.look.paths.is_none_or(|paths| fading.blend.unwrap().look.paths.unwrap().phase == paths.phase));
    }
}

#[test]
fn words_come_and_go() {
    let timeline = timeline(EXAMPLE);
    let at = |time| timeline.state(time).caption;
    assert_eq!((at(0.0).text.as_str(), at(0.0).opacity), ("All of it", 1.0));
    assert!(at(7.9).opacity < 0.1 && at(8.1).opacity < 0.1 && at(9.0).opacity == 1.0);
    assert_eq!((at(9.0).text.as_str(), at(13.0).opacity), ("Near", 0.0));
}

#[test]
fn keys_lead_to_labels() {
    let mut timeline = timeline(EXAMPLE);
    timeline.keys.insert('n', "near".into());
    assert_eq!((timeline.key('n'), timeline.key('x')), (Some(8.0), None));
    assert_eq!((timeline.next(0.0), timeline.next(8.0), timeline.back(9.0), timeline.back(8.0)), (8.0, 13.0, 8.0, 0.0));
}

#[test]
fn mistakes_are_named_with_their_place() {
    for (keyframes, expected) in [
        ("(),\n(mode: \"pionts\")", "t.tour.ron:2:9: mode: found pionts, expected one of column-density"),
        ("(),\n(), (pause: -1.0)", "t.tour.ron:2:6: pause: found -1"),
        ("(),\n(puase: 1.0)", "t.tour.ron:2:"),
        ("(pause: 3.0),\n(at: 2.0)", "t.tour.ron:2:2: at: found 2, expected 3 or later"),
        ("(settings: {\"radios\": 1.0}, mode: \"points\")", "radios, expected a setting of points"),
        ("(mode: \"points\"), (), (settings: {\"radius\": 99.0})", "radius: found 99, expected a number from"),
        (
            "(camera: (eye: (0.0,0.0,0.0), target: (0.0,0.0,0.0)))",
            "eye: found [0.0, 0.0, 0.0], expected a camera that sees",
        ),
        ("(around: (what: data, elevation: 100.0))", "elevation: found 100, expected -90 to 90 degrees"),
        ("(around: (what: data), camera: (eye: (0.0,0.0,1.0), target: (0.0,0.0,0.0)))", "expected one of them"),
        ("(label: \"a\"), (label: \"a\")", "label: found a, expected a name that no other keyframe has"),
        ("", "keyframes: found none"),
        ("(images: [(path: \"a.png\", height: 2.0)])", "height"),
    ] {
        let text = format!("(version: 1, keyframes: [{keyframes}])");
        let message = TourFile::parse("t.tour.ron", &text).unwrap_err().to_string();
        assert!(message.contains(expected), "{keyframes}: {message}");
    }
    for (keyframes, expected) in [
        ("(around: (what: selection(\"halo\")))", "what: found halo, expected a selection"),
        ("(around: (what: object(\"nothing\")))", "expected CATALOGUE#N"),
        ("(), (around: (what: object(\"nothing.csv#0\")))", "keyframe 2: "),
        (
            "(around: (what: object(\"https://h/a.csv?sig=s3cr3t\")))",
            "what: found https://h/a.csv, expected CATALOGUE#N",
        ),
        (
            "(around: (what: object(\"https://h/a.csv?sig=s3cr3t#0\")))",
            "https://h/a.csv: open: found a URL, expected a file or folder of this machine",
        ),
    ] {
        let text = format!("(version: 1, keyframes: [{keyframes}])");
        let tour = TourFile::parse("t.tour.ron", &text).unwrap();
        let message = Timeline::new(&tour, &surroundings(&text)).unwrap_err().to_string();
        assert!(message.contains(expected) && !message.contains("s3cr3t"), "{keyframes}: {message}");
    }
    let later = TourFile::parse("t.tour.ron", "(version: 9, keyframes: [], more: 1)").unwrap_err().to_string();
    assert!(later.contains("a later deepfield has written it"), "{later}");
    let keys =
        TourFile::parse("t.tour.ron", "(version: 1, keys: {'a': \"b\"}, keyframes: [()])").unwrap_err().to_string();
    assert!(keys.contains("keys: found b on a"), "{keys}");
}

#[test]
fn every_misspelled_field_is_refused() {
    let text = format!("(version: 1, keyframes: [{EXAMPLE}])");
    let written = TourFile::parse("t.tour.ron", &text).unwrap().to_ron();
    assert_eq!(TourFile::parse("own", &written).unwrap(), TourFile::parse("t", &text).unwrap());
    let (mut fields, mut before) = (0, 0);
    for (at, _) in written.match_indices(": ") {
        let start = written[..at].rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |start| start + 1);
        let name = &written[start..at];
        if name.is_empty() || start < before {
            continue;
        }
        before = at;
        let wrong = format!("{}{name}x{}", &written[..start], &written[at..]);
        let message = TourFile::parse("t.ron", &wrong).expect_err(&wrong).to_string();
        assert!(message.starts_with("t.ron:") && message.contains(&format!("{name}x")), "{name}: {message}");
        fields += 1;
    }
    assert!(fields > 60, "{fields}");
}

#[test]
fn fast_turns_are_told_and_stretched() {
    let keyframes = "(), (after: 1.0, orbit: 90.0), (after: 5.0)";
    let text = format!("(version: 1, keyframes: [{keyframes}])");
    let mut tour = TourFile::parse("t", &text).unwrap();
    let timeline = Timeline::new(&tour, &surroundings(&text)).unwrap();
    let found = remarks(&timeline, &Comfort::default());
    assert!(found[1].turn > 90.0 && found[1].warnings[0].contains("degrees a second"), "{found:?}");
    assert!(found[2].warnings.is_empty() && found[0].warnings.is_empty());
    tour.comfort.stretch = true;
    let stretched = Timeline::new(&tour, &surroundings(&text)).unwrap();
    let found = remarks(&stretched, &Comfort::default());
    assert!(found[1].turn < 40.1 && found[1].warnings.len() == 1, "{found:?}");
    assert!(stretched.duration() > timeline.duration() + 2.0);
}

#[test]
fn captions_that_the_font_cannot_write_are_told_once() {
    let text = "(version: 1, keyframes: [(caption: \"Sterne\"), (after: 5.0, caption: \"星 ★\"), (after: 5.0)])";
    let tour = TourFile::parse("t", text).unwrap();
    let timeline = Timeline::new(&tour, &surroundings(text)).unwrap();
    let found: Vec<Vec<String>> = remarks(&timeline, &tour.comfort).into_iter().map(|remark| remark.warnings).collect();
    assert!(found[0].is_empty() && found[2].is_empty(), "{found:?}");
    assert!(found[1].len() == 1 && found[1][0].starts_with("the font has no 星: "), "{found:?}");
}

#[test]
fn the_usual_tour_goes_round_without_a_stop() {
    let tour = around_data(10.0);
    let timeline = Timeline::new(&tour, &surroundings("")).unwrap();
    assert!((timeline.duration() - 10.0).abs() < 1e-9);
    let (first, last) = (timeline.path().pose(0.0), timeline.path().pose(9.999999));
    assert!((last.yaw - first.yaw - std::f64::consts::TAU).abs() < 1e-4, "{} {}", first.yaw, last.yaw);
    let speed = |time: f64| (timeline.path().pose(time + 1e-4).yaw - timeline.path().pose(time).yaw) / 1e-4;
    assert!((speed(0.0) - speed(9.9998)).abs() < 1e-2 && speed(0.0) > 0.3, "{} {}", speed(0.0), speed(9.9998));
    assert!(remarks(&timeline, &tour.comfort).iter().all(|remark| remark.warnings.is_empty()));
}

proptest! {
    /// A state depends on the time alone, at any time at all.
    #[test]
    fn a_state_is_a_function_of_time(time in prop_oneof![-1.0..20.0f64, Just(f64::NAN), Just(f64::INFINITY)], repeats in any::<bool>()) {
        let mut tour = TourFile::parse("t", &format!("(version: 1, keyframes: [{EXAMPLE}])")).unwrap();
        tour.repeats = repeats;
        let timeline = Timeline::new(&tour, &surroundings("")).unwrap();
        let state = timeline.state(time);
        prop_assert_eq!(&state, &timeline.state(time));
        prop_assert!((0.0..=timeline.duration()).contains(&state.time));
        prop_assert!(state.camera.view(64, 48).is_ok());
        let mode = state.look.mode.unwrap();
        prop_assert!(state.look.settings.check(mode).is_ok());
    }
}
