//! An image or a volume in the window: drawn from its samples, by the modes that draw it, as `deepfield render` draws it.

use super::desktop::{Desktop, Program, Screen, columns, keep};
use std::path::Path;

const SIZE: [u16; 2] = [640, 400];

/// A volume of a ball in haze beside a denser, smaller one.
pub(super) fn balls(path: &Path) {
    let value = |i: usize| {
        let at = [i % 40, i / 40 % 36, i / 1440].map(|x| x as f64);
        let away = |center: [f64; 3]| at.iter().zip(center).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        match (away([14.0, 16.0, 15.0]) < 100.0, away([29.0, 20.0, 16.0]) < 36.0) {
            (_, true) => 220,
            (true, _) => 120,
            _ => 10,
        }
    };
    let samples: Vec<u8> = (0..40 * 36 * 32).map(value).collect();
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 36 32\nencoding: raw\nspacings: 0.5 0.5 0.5\n\n";
    std::fs::write(path, [head.as_bytes(), &samples].concat()).unwrap();
}

/// The picture of a scene of this size as `deepfield render` writes it by a backend.
pub(super) fn render(folder: &Path, scene: &Path, backend: &str, size: [u16; 2]) -> Vec<[u8; 3]> {
    let output = folder.join("rendered.png");
    let mut render = crate::support::program();
    render.args(["render", "--backend", backend]).arg(scene).arg("-o").arg(&output).env("XDG_CACHE_HOME", folder);
    assert!(render.status().unwrap().success());
    let picture = crate::support::golden::picture_at(&output);
    assert_eq!([picture.width, picture.height], size.map(u32::from));
    picture.rgba.iter().map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
}

/// Whether a pixel is more than a little off.
pub(super) fn is_off(found: [u8; 3], expected: [u8; 3]) -> bool {
    found.iter().zip(expected).any(|(a, b)| a.abs_diff(b) > 4)
}

/// Share of the pixels in the upper three quarters of a screen of this size that are more than a little off.
pub(super) fn difference(screen: &Screen, expected: &[[u8; 3]], size: [u16; 2]) -> f64 {
    let [width, height] = size.map(usize::from);
    let off = |(i, pixel): (usize, &[u8; 3])| is_off(screen.at(i % width, i / width), *pixel);
    let compared = 3 * height / 4 * width;
    expected.iter().enumerate().take(compared).filter(|pixel| off(*pixel)).count() as f64 / compared as f64
}

#[test]
fn volumes_are_drawn_from_their_samples_as_they_are_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    balls(&folder.join("balls.nrrd"));
    // By the processor once: its pictures are those of files.
    let scenes = [
        ("volume", "", ["cpu"; 2]),
        ("xray", ", projection: dome(aperture: 180.0, tilt: 0.0)", ["compute"; 2]),
        ("volume", ", attribute: named(\"gradient\")", ["compute"; 2]),
        ("isosurface", "", ["compute"; 2]),
        ("xray", "", ["compute"; 2]),
        // Planes are the processor's.
        ("slice", "", ["compute", "cpu"]),
    ];
    for (number, (mode, more, [asked, draws])) in scenes.into_iter().enumerate() {
        let scene = folder.join("balls.scene.ron");
        let text = format!(
            "(version: 2, datasets: [(path: \"balls.nrrd\")], mode: {mode:?}, size: ({}, {}), \
             camera: (eye: (25.0, 20.0, 40.0), target: (9.0, 9.0, 8.0), fov: 30.0), panels: (shown: false, closed: []), \
             annotations: (legend: false, scale_bar: false){more})",
            SIZE[0], SIZE[1]
        );
        std::fs::write(&scene, text).unwrap();
        let expected = render(folder, &scene, "cpu", SIZE);
        let desktop = Desktop::with_screen(SIZE);
        let mut program = Program::open(&desktop, folder, &scene, SIZE, &["--backend", asked]);
        let status = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!(
            (&status["mode"], &status["levels"], &status["backend"]),
            (&mode.into(), &"samples".into(), &draws.into())
        );
        assert_eq!(status["points"]["points"], 40 * 36 * 32, "{status:#}");
        keep(&desktop, &format!("field-{number}-{mode}.png"));
        desktop.wait("the rendered picture", |screen| difference(screen, &expected, SIZE) < 0.01);
        assert!(expected.iter().filter(|pixel| pixel.iter().any(|byte| *byte > 60)).count() > 3000, "{mode}{more}");
    }
}

#[test]
fn a_volume_is_opened_and_turned() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let path = folder.join("balls.nrrd");
    balls(&path);
    for backend in ["cpu", "compute"] {
        let desktop = Desktop::with_screen([960, 600]);
        let mut program = Program::open(&desktop, folder, &path, [960, 600], &["--backend", backend]);
        let first = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!(
            (&first["mode"], &first["levels"], &first["backend"]),
            (&"volume".into(), &"samples".into(), &backend.into()),
            "{first:#}"
        );
        let lit = |screen: &Screen| screen.share(columns(&first), |pixel| pixel.iter().any(|&c| c > 40));
        desktop.wait("the volume", |screen| lit(screen) > 0.05);
        keep(&desktop, &format!("field-window-{backend}.png"));
        let [x, y] = super::desktop::middle(&first);
        let turned = super::desktop::repeat(
            &program,
            "a drag",
            || desktop.drag([x, y], [x + 60, y + 20]),
            |status| status["eye"] != first["eye"],
        );
        assert_eq!((&turned["mode"], &turned["backend"]), (&"volume".into(), &backend.into()));
    }
}

#[test]
fn an_image_is_seen_from_in_front() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let path = folder.join("image.png");
    let image = deepfield::color::Image {
        width: 120,
        height: 80,
        rgba: (0..120 * 80)
            .map(|i| if (i % 120 < 60) == (i / 120 < 40) { [220, 40, 40, 255] } else { [40, 40, 220, 255] })
            .collect(),
    };
    deepfield::color::output::write_png(&path, &image).unwrap();
    let desktop = Desktop::with_screen([960, 600]);
    let mut program = Program::open(&desktop, folder, &path, [960, 600], &[]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["mode"], "image", "{first:#}");
    let red = |screen: &Screen| screen.share(columns(&first), |[r, _, b]| r > 180 && b < 80);
    let blue = |screen: &Screen| screen.share(columns(&first), |[r, _, b]| b > 180 && r < 80);
    desktop.wait("both colours", |screen| red(screen) > 0.1 && (red(screen) / blue(screen) - 1.0).abs() < 0.1);
    keep(&desktop, "field-image.png");
    let [x, y] = super::desktop::middle(&first);
    let at = |x: i16, y: i16| desktop.screenshot().at(x as usize, y as usize);
    let [above, beside] = [at(x - 40, y - 40), at(x + 40, y - 40)];
    assert!(above[0] > 180 && beside[2] > 180, "{above:?} {beside:?}");
}
