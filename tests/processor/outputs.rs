//! Outputs show what the dome master of the processor shows: bent flat pictures, put together, are that picture.

use crate::support::{demo, in_repository, program};
use deepfield::annotate::overlay::read_png;
use deepfield::color::Image;
use deepfield::show::rig::{Cover, Mesh, OutputsFile, Projector};
use glam::DVec3;
use std::path::{Path, PathBuf};

fn render(arguments: &[&str], out: &Path) -> Image {
    let mut command = program();
    command
        .arg("render")
        .arg(demo())
        .arg("-o")
        .arg(out)
        .args(["--backend", "cpu", "--mode", "column-density"])
        .args(arguments);
    // One range for all pictures, given in numbers.
    command.arg("--config").arg(out.with_file_name("look.ron"));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    read_png(out).unwrap()
}

fn vector(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}

fn pixel(image: &Image, [u, v]: [f64; 2]) -> [f64; 3] {
    let place = [u * f64::from(image.width) - 0.5, v * f64::from(image.height) - 0.5];
    let most = [image.width, image.height].map(|side| f64::from(side - 1));
    let place = [0, 1].map(|k| place[k].clamp(0.0, most[k]));
    let corner = [0, 1].map(|k| place[k].floor().min(most[k] - 1.0));
    let [a, b] = [0, 1].map(|k| place[k] - corner[k]);
    let at = |dx: u32, dy: u32| image.rgba[((corner[1] as u32 + dy) * image.width + corner[0] as u32 + dx) as usize];
    std::array::from_fn(|k| {
        let [nw, ne, sw, se] = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)].map(|pixel| f64::from(pixel[k]));
        (1.0 - b) * ((1.0 - a) * nw + a * ne) + b * ((1.0 - a) * sw + a * se)
    })
}

#[test]
fn the_shipped_rigs_can_be_used() {
    let folder = in_repository("assets/outputs");
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let file = OutputsFile::read(&entry.unwrap().path()).unwrap();
        for output in &file.outputs {
            let size = output.window.map_or([1920, 1080], |(_, _, width, height)| [width, height]);
            let projector = Projector::open(output, &folder, size).unwrap();
            Cover::of(&projector, size, 0.8).unwrap();
            count += 1;
        }
    }
    assert!(count >= 10);
}

/// Four outputs that show a quarter of a dome master each are that dome master.
#[test]
fn four_outputs_are_the_dome_master() {
    let [coarse, fine] = [160, 320].map(difference);
    // Bent pictures are interpolated once more, which blurs less the finer the pixels are.
    assert!(coarse < 0.05 && fine < 0.75 * coarse, "{coarse} {fine}");
}

/// The mean difference of a dome master with sides of so many pixels, as a share of its mean.
fn difference(all: u32) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    // Values that the middle of the dome does not saturate.
    std::fs::write(path("look.ron"), "(transfer: (scale: log, range: fixed(2.0, 2000.0)))").unwrap();
    let rig = r#"(version: 1, outputs: [
        (name: "nw", shows: dome(tilt: 40.0, part: (0.0, 0.0, 0.5, 0.5))),
        (name: "ne", shows: dome(tilt: 40.0, part: (0.5, 0.0, 1.0, 0.5))),
        (name: "sw", shows: dome(tilt: 40.0, part: (0.0, 0.5, 0.5, 1.0))),
        (name: "se", shows: dome(tilt: 40.0, part: (0.5, 0.5, 1.0, 1.0))),
    ])"#;
    std::fs::write(path("rig.ron"), rig).unwrap();
    let (eye, target) = (DVec3::new(25.0, 25.0, 60.0), DVec3::new(25.0, 25.0, 25.0));
    let size = format!("{all}x{all}");
    let at = [vector(eye), vector(target)];
    let dome = ["--projection", "dome", "--tilt", "40", "--size", &size, "--eye", &at[0], "--target", &at[1]];
    let master = render(&dome, &path("master.png"));
    let [right, up, forward] = [DVec3::X, DVec3::Y, DVec3::NEG_Z];
    let world = |v: DVec3| v.x * right + v.y * up + v.z * forward;

    let file = OutputsFile::read(&path("rig.ron")).unwrap();
    let half = all / 2;
    let (mut difference, mut light) = (0.0, 0.0);
    for (output, corner) in file.outputs.iter().zip([[0, 0], [half, 0], [0, half], [half, half]]) {
        let size = [half, half];
        let projector = Projector::open(output, folder.path(), size).unwrap();
        let cover = Cover::of(&projector, size, 0.8).unwrap();
        let mesh = Mesh::of(&projector, &cover, size, 0.8);
        let [_, top, ahead] = cover.axes.map(world);
        let arguments = [
            "--size".to_owned(),
            format!("{}x{}", cover.size[0], cover.size[1]),
            "--eye".into(),
            vector(eye),
            "--target".into(),
            vector(eye + 35.0 * ahead),
            "--up".into(),
            vector(top),
            "--fov".into(),
            cover.fov_y.to_degrees().to_string(),
        ];
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let flat = render(&arguments, &path("flat.png"));
        for y in 0..half {
            for x in 0..half {
                // Bilinear in the mesh's cell, as triangles are up to the cell's own curvature.
                let share = [x, y].map(|at| (f64::from(at) + 0.5) / f64::from(half));
                let grid = [share[0] * f64::from(mesh.columns - 1), share[1] * f64::from(mesh.rows - 1)];
                let cell = grid.map(|at| at.floor());
                let [a, b] = [0, 1].map(|k| grid[k] - cell[k]);
                let point = |dx: u32, dy: u32| {
                    mesh.points[((cell[1] as u32 + dy) * mesh.columns + cell[0] as u32 + dx) as usize]
                };
                let corners = [point(0, 0), point(1, 0), point(0, 1), point(1, 1)];
                let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
                let lit = projector.mask().unwrap().at(share);
                let expected = master.rgba[((corner[1] + y) * all + corner[0] + x) as usize];
                if lit < 1.0 {
                    continue;
                }
                let place = |k: usize| {
                    corners.iter().zip(weights).map(|(corner, weight)| weight * f64::from(corner.unwrap()[k])).sum()
                };
                let found = pixel(&flat, [place(0), place(1)]);
                for k in 0..3 {
                    difference += (found[k] - f64::from(expected[k])).abs();
                    light += f64::from(expected[k]);
                }
            }
        }
    }
    assert!(light > 1e5, "the picture is not black: {light}");
    difference / light
}
