//! Pictures of all directions and for two eyes in the window: as `deepfield render` writes them, around a camera that moves.

use super::desktop::{Desktop, Program, Screen, choose, keep, middle, repeat};
use serde_json::{Value, json};
use std::path::Path;

const CONTROL: u32 = 0xffe3;
const TAB: u32 = 0xff09;
const SIZE: [u16; 2] = [640, 400];
/// Of a window without panels: an adapter in software draws its faces.
const SMALL: [u16; 2] = [400, 280];

/// Renders a scene, and returns the pixels of its picture.
fn render(folder: &Path, scene: &Path) -> ([usize; 2], Vec<[u8; 3]>) {
    let output = folder.join("rendered.png");
    let mut render = crate::support::program();
    render.args(["render", "--backend", "cpu"]).arg(scene).arg("-o").arg(&output).env("XDG_CACHE_HOME", folder);
    assert!(render.status().unwrap().success());
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(output).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let channels = info.color_type.samples();
    let pixels = bytes.chunks_exact(channels).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    ([info.width as usize, info.height as usize], pixels)
}

/// Share of the pixels of a rendered picture that a screen of this size shows otherwise, where it stands in the middle with black around it.
fn difference(screen: &Screen, size: [u16; 2], ([width, height], pixels): &([usize; 2], Vec<[u8; 3]>)) -> f64 {
    let room = size.map(usize::from);
    let corner = [(room[0] - width) / 2, (room[1] - height) / 2];
    let differs = |x: usize, y: usize| {
        let inside = (corner[0]..corner[0] + width).contains(&x) && (corner[1]..corner[1] + height).contains(&y);
        let expected = match inside {
            true => pixels[(y - corner[1]) * width + x - corner[0]],
            false => [0; 3],
        };
        screen.at(x, y).iter().zip(expected).any(|(a, b)| a.abs_diff(b) > 8)
    };
    // What is told fades away in the lower left corner.
    let places: Vec<[usize; 2]> = (0..room[1]).flat_map(|y| (0..room[0]).map(move |x| [x, y])).collect();
    places.iter().filter(|[x, y]| differs(*x, *y)).count() as f64 / places.len() as f64
}

#[test]
fn a_dome_in_the_window_is_the_one_that_is_rendered_and_follows_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("box.hdf5");
    std::fs::copy(crate::support::demo(), &data).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    // Coarse, since every face of every picture takes its time.
    let arguments =
        ["--backend", "cpu", "--error-px", "6", "--projection", "dome", "--aperture", "200", "--tilt", "30"];
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &arguments);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let dome = |tilt: f64| json!({"dome": {"aperture": 200.0, "tilt": tilt}});
    assert_eq!(first["settings"]["projection"], dome(30.0), "{first:#}");
    assert!(first["particles_drawn"].as_u64() > Some(0) && first["backend"] == "cpu", "{first:#}");
    let window = desktop.window().unwrap();
    desktop.focus(window);
    desktop.press(TAB);
    program.wait("the panel is hidden", |status| status["picture"] == json!([0.0, 0.0, 640.0, 400.0]));

    // The camera flies into the data, where there is something to see all around.
    desktop.press(u32::from('f'));
    program.wait("F flies", |status| status["flying"] == true);
    let forward = desktop.keycode(u32::from('w'));
    desktop.fake_input(2, forward, [0; 2]);
    let depth = |status: &Value| status["eye"][2].as_f64().unwrap();
    let moving = program.wait("the camera is in the data", |status| depth(status) < 38.0);
    desktop.fake_input(3, forward, [0; 2]);
    assert_eq!(moving["converged"], false, "{moving:#}");
    desktop.press(u32::from('f'));
    program.wait("it orbits again", |status| status["flying"] == false);
    program.wait("the full picture", |status| status["converged"] == true);
    // Nothing is picked by pixels that are no flat picture's.
    desktop.click(middle(&first));
    let told =
        program.wait("a message", |status| status["messages"].to_string().contains("flat pictures of one eye only"));
    assert_eq!(
        (&told["looking"]["inspected"], &told["eye"]),
        (&first["looking"]["inspected"], &program.status()["eye"])
    );
    let saved = repeat(
        &program,
        "Ctrl+S saves",
        || desktop.press_with(&[CONTROL], u32::from('s')),
        |status| status["scene"].is_string(),
    );
    assert_eq!(saved["converged"], true, "{saved:#}");
    let scene = folder.path().join("box.scene.ron");
    let text = std::fs::read_to_string(&scene).unwrap();
    assert!(text.contains("dome(") && text.contains("400"), "{text}");
    let expected = render(folder.path(), &scene);
    assert_eq!(expected.0, [400; 2]);
    desktop.wait("the rendered dome", |screen| difference(screen, SIZE, &expected) < 0.005);
    keep(&desktop, "dome.png");
    assert!(desktop.screenshot().share(120..520, |pixel| pixel[0] > 60) > 0.2, "there is something to see");

    // Other projections, and two eyes.
    desktop.press(TAB);
    program.wait("the panel", |status| status["panel"] == true);
    choose(&program, &desktop, "projection", "projection:equirectangular", |status| {
        status["settings"]["projection"] == "equirectangular"
    });
    choose(&program, &desktop, "stereo", "stereo:over-under", |status| status["settings"]["stereo"].is_object());
    let both = program.wait("both eyes", |status| status["converged"] == true);
    assert_eq!(both["settings"]["stereo"]["kind"], "omnidirectional", "{both:#}");
    keep(&desktop, "pair.png");
    choose(&program, &desktop, "projection", "projection:perspective", |status| {
        status["settings"]["projection"] == "flat"
    });
    let pair = program.wait("a flat pair", |status| status["converged"] == true);
    assert_eq!(pair["settings"]["stereo"]["kind"], "off-axis", "{pair:#}");
    keep(&desktop, "flat-pair.png");
    choose(&program, &desktop, "stereo", "stereo:off", |status| status["settings"]["stereo"].is_null());
    program.wait("a flat picture", |status| status["converged"] == true);

    // The scene brings the dome back.
    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
    let tilted = ["--backend", "cpu", "--tilt", "10"];
    let mut program = Program::open(&desktop, folder.path(), &scene, SIZE, &tilted);
    let again = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(again["settings"]["projection"], dome(10.0), "the command line goes before the scene: {again:#}");
    assert_eq!(again["eye"], saved["eye"]);
}

#[test]
fn faces_in_the_window_are_drawn_by_the_adapter_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let data = crate::support::demo();
    let desktop = Desktop::with_screen(SMALL);
    let scene = folder.path().join("within.scene.ron");
    // From within the data. The adapter has no discs of a pixel's size for panoramas: the processor draws them unasked.
    let text = |mode: &str| {
        format!(
            r#"(version: 1, datasets: [(path: {data:?})], mode: "{mode}", error_px: 2.0, projection: dome(aperture: 180.0, tilt: 0.0), size: (280, 280),
                annotations: (legend: false, scale_bar: false, labels: 0), panels: (shown: false, closed: []),
                camera: (eye: (32.0, 32.0, 32.0), target: (32.0, 32.0, 0.0), up: (0.0, 1.0, 0.0), fov: 45.0))"#
        )
    };
    for (mode, backend) in [("column-density", "compute"), ("points", "cpu")] {
        std::fs::write(&scene, text(mode)).unwrap();
        let mut program = Program::open(&desktop, folder.path(), &scene, SMALL, &["--backend", "compute"]);
        let status = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!(status["backend"], backend, "{mode}: {status:#}");
        assert_eq!(status["picture"], json!([0.0, 0.0, 400.0, 280.0]), "{mode}: {status:#}");
        let expected = render(folder.path(), &scene);
        assert_eq!(expected.0, [280; 2]);
        desktop.wait("the rendered dome", |screen| difference(screen, SMALL, &expected) < 0.005);
        assert!(desktop.screenshot().share(60..340, |pixel| pixel[0] > 60) > 0.1, "{mode}: there is something to see");
        desktop.close(desktop.window().unwrap());
        assert_eq!(program.exit_code(), Some(0));
    }
}
