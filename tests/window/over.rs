//! Splats over each other in the window: the picture is the one that the command line draws of the same scene, flat and around the eye.

use super::desktop::{Desktop, PATIENCE, Program, Screen, keep};
use crate::support::{demo, keep_demo_pages, run};
use deepfield::annotate::overlay::read_png;
use deepfield::color::Image;
use std::time::Instant;

/// As wide as a picture of all directions is for its height.
const SIZE: [u16; 2] = [480, 240];

/// Mean of a picture's values, and of their differences from a screen's: of the middle, which no words of the window cover.
fn compare(screen: &Screen, picture: &Image) -> [f64; 2] {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let (mut sum, mut difference, mut count) = (0.0, 0.0, 0.0);
    for (x, y) in (height / 4..height * 5 / 6).flat_map(|y| (width / 8..width * 3 / 4).map(move |x| (x, y))) {
        let (found, expected) = (screen.at(x, y), picture.rgba[y * width + x]);
        for k in 0..3 {
            sum += f64::from(expected[k]);
            difference += f64::from(found[k].abs_diff(expected[k]));
            count += 1.0;
        }
    }
    [sum / count, difference / count]
}

fn shows_what_is_rendered(own: &str) {
    let folder = tempfile::tempdir().unwrap();
    keep_demo_pages(folder.path());
    let scene = folder.path().join("over.scene.ron");
    let ([width, height], data) = (SIZE, demo());
    let text = format!(
        r#"(version: 2, datasets: [(path: {data:?})], mode: "column-density", settings: {{"blend": "over"}}, size: ({width}, {height}),
            panels: (shown: false, closed: []), annotations: (legend: false, scale_bar: false),
            camera: (eye: (80.0, 40.0, 60.0), target: (25.0, 25.0, 25.0)){own})"#
    );
    std::fs::write(&scene, text).unwrap();
    let drawn = run(folder.path(), &["render", "over.scene.ron", "-o", "over.png", "--backend", "cpu"]);
    assert!(drawn.status.success(), "{drawn:?}");
    let picture = read_png(&folder.path().join("over.png")).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let mut program = Program::open(&desktop, folder.path(), &scene, SIZE, &["--backend", "cpu"]);
    let status = program.wait("a picture", |status| status["converged"] == true);
    assert_eq!(status["backend"], "cpu", "{status:#}");
    let begin = Instant::now();
    loop {
        let [mean, difference] = compare(&desktop.screenshot(), &picture);
        if mean > 1.0 && difference < 0.015 * mean {
            println!("{own}: the mean value is {mean:.2}, the mean difference {difference:.3}");
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "{own}: mean {mean}, difference {difference}");
        std::thread::sleep(std::time::Duration::from_millis(500));
    }
    keep(&desktop, "over.png");
}

#[test]
fn the_processor_lays_splats_over_each_other_as_in_files() {
    shows_what_is_rendered("");
}

#[test]
fn splats_lie_over_each_other_around_the_eye_too() {
    shows_what_is_rendered(", projection: equirectangular");
}
