//! Surfaces of particles and volumes by the program, and their files read back.

use crate::support::{self, run};
use serde_json::json;
use std::collections::HashMap;
use std::path::Path;

/// A mesh as its file has it.
struct Mesh {
    places: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
}

impl Mesh {
    fn volume(&self) -> f64 {
        let volume = |triangle: &[usize; 3]| {
            let [a, b, c] = triangle.map(|vertex| glam::DVec3::from_array(self.places[vertex]));
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.iter().map(volume).sum()
    }

    /// Each edge is between two triangles, along which they go in opposite directions.
    fn assert_closed(&self) {
        let mut edges: HashMap<(usize, usize), [u32; 2]> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                edges.entry((from.min(to), from.max(to))).or_default()[usize::from(from < to)] += 1;
            }
        }
        assert!(edges.values().all(|directions| *directions == [1, 1]));
    }
}

fn floats<const N: usize>(bytes: &[u8]) -> [f64; N] {
    std::array::from_fn(|i| f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap()).into())
}

/// A PLY file of single-precision numbers, and the value of each vertex where there is one.
fn read_ply(path: &Path) -> (Mesh, Vec<f64>) {
    let bytes = std::fs::read(path).unwrap();
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
    let header = std::str::from_utf8(&bytes[..body]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    let number = |element: &str| -> usize {
        header.lines().find_map(|line| line.strip_prefix(element)).unwrap().trim().parse().unwrap()
    };
    let (vertices, faces) = (number("element vertex "), number("element face "));
    let properties = header.lines().filter(|line| line.starts_with("property float ")).count();
    let stride = 4 * properties;
    assert!(properties == 6 || header.contains("property float value\n"), "{header}");
    let (mut mesh, mut values) = (Mesh { places: Vec::new(), normals: Vec::new(), triangles: Vec::new() }, Vec::new());
    for vertex in bytes[body..body + vertices * stride].chunks(stride) {
        let [x, y, z, nx, ny, nz] = floats(vertex);
        mesh.places.push([x, y, z]);
        mesh.normals.push([nx, ny, nz]);
        if properties > 6 {
            let [value] = floats(&vertex[24..]);
            values.push(value);
        }
    }
    let rest = &bytes[body + vertices * stride..];
    assert_eq!(rest.len(), 13 * faces);
    for face in rest.chunks(13) {
        assert_eq!(face[0], 3);
        let corner = |i: usize| i32::from_le_bytes(face[1 + 4 * i..5 + 4 * i].try_into().unwrap()) as usize;
        mesh.triangles.push([corner(0), corner(1), corner(2)]);
    }
    (mesh, values)
}

fn read_obj(path: &Path) -> Mesh {
    let text = std::fs::read_to_string(path).unwrap();
    let mut mesh = Mesh { places: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let numbers = || -> [f64; 3] { std::array::from_fn(|i| words[i + 1].parse().unwrap()) };
        match words[0] {
            "v" => mesh.places.push(numbers()),
            "vn" => mesh.normals.push(numbers()),
            "f" => mesh.triangles.push(std::array::from_fn(|i| {
                let (place, normal) = words[i + 1].split_once("//").unwrap();
                assert_eq!(place, normal);
                let place: usize = place.parse().unwrap();
                // Vertices come before the triangles that have them.
                assert!((1..=mesh.places.len()).contains(&place));
                place - 1
            })),
            word => assert_eq!(word, "#"),
        }
    }
    mesh
}

fn read_stl(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    let count = u32::from_le_bytes(bytes[80..84].try_into().unwrap()) as usize;
    assert_eq!(bytes.len(), 84 + 50 * count);
    assert!(!bytes.starts_with(b"solid"));
    let mut mesh = Mesh { places: Vec::new(), normals: Vec::new(), triangles: Vec::new() };
    for triangle in bytes[84..].chunks(50) {
        mesh.normals.push(floats(triangle));
        let first = mesh.places.len();
        mesh.places.extend([12, 24, 36].map(|at| floats::<3>(&triangle[at..])));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

fn made(folder: &Path, name: &str, more: &[&str]) -> serde_json::Value {
    let isovalue: &[&str] = if more.contains(&"--isovalue") { &[] } else { &["--isovalue", "1"] };
    let arguments = [&["surface", "cloud.g2", "-o", name, "--json", "-"][..], isovalue, more].concat();
    support::json(folder, &arguments)
}

#[test]
fn a_surface_is_the_same_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(run(folder, &["synth", "cloud", "-n", "3000", "-o", "cloud.g2"]).status.success());
    let [ply, obj, stl] = ["cloud.ply", "cloud.obj", "cloud.stl"].map(|name| made(folder, name, &[]));
    let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap_or_else(|| panic!("{key} in {of}"));
    let (mesh, values) = read_ply(&folder.join("cloud.ply"));
    assert!(values.is_empty());
    let others = [(obj, read_obj(&folder.join("cloud.obj"))), (stl, read_stl(&folder.join("cloud.stl")))];
    mesh.assert_closed();
    others[0].1.assert_closed();
    let volume = number(&ply, "volume");
    assert!(volume > 0.0 && (mesh.volume() / volume - 1.0).abs() < 1e-4, "{} {volume}", mesh.volume());
    assert_eq!(
        [number(&ply, "vertices"), number(&ply, "triangles")],
        [mesh.places.len(), mesh.triangles.len()].map(|n| n as f64)
    );
    assert_eq!(number(&ply, "boundary_edges"), 0.0);
    assert!(number(&ply, "spacing") > 0.0 && number(&ply, "area") > 0.0 && number(&ply, "components") >= 1.0);
    assert_eq!(number(&ply, "particles"), 3000.0);
    for (told, other) in &others {
        assert_eq!(other.triangles.len(), mesh.triangles.len());
        assert!((other.volume() / volume - 1.0).abs() < 1e-4, "{} {volume}", other.volume());
        for key in ["vertices", "triangles", "volume", "area", "isovalue", "cells"] {
            assert_eq!(told[key], ply[key], "{key}");
        }
    }
    // Vertex normals point to where triangles are seen from.
    let mut along = 0;
    for &[a, b, c] in &mesh.triangles {
        let [p, q, r] = [a, b, c].map(|vertex| glam::DVec3::from_array(mesh.places[vertex]));
        along += usize::from((q - p).cross(r - p).dot(glam::DVec3::from_array(mesh.normals[a])) > 0.0);
    }
    assert!(along as f64 > 0.9 * mesh.triangles.len() as f64, "{along} of {}", mesh.triangles.len());
    let length = |normal: &[f64; 3]| glam::DVec3::from_array(*normal).length();
    assert!(mesh.normals.iter().all(|normal| (length(normal) - 1.0).abs() < 1e-5));
}

#[test]
fn vertices_have_means_and_regions_have_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(run(folder, &["synth", "cloud", "-n", "3000", "-o", "cloud.g2"]).status.success());
    let all = made(folder, "all.ply", &["--attribute", "internal-energy"]);
    let (mesh, values) = read_ply(&folder.join("all.ply"));
    assert_eq!(values.len(), mesh.places.len());
    // Means are between the extremes of the particles.
    assert!(values.iter().all(|value| (1.0..11.6).contains(value)), "{values:?}");
    let part = made(folder, "part.ply", &["--box", "-2,-3,-4,0,3,4"]);
    let (half, _) = read_ply(&folder.join("part.ply"));
    half.assert_closed();
    let share = part["volume"].as_f64().unwrap() / all["volume"].as_f64().unwrap();
    assert!((0.3..0.7).contains(&share), "{share}");
    assert!(half.places.iter().all(|place| place[0] < 0.2));
    // As many cells as are allowed, and no more.
    let coarse = made(folder, "coarse.ply", &["--cells", "300000"]);
    assert!(coarse["cells"].as_u64().unwrap() <= 300_000, "{coarse}");
    assert!(coarse["finer_spacing"].as_f64().is_none_or(|finer| finer < coarse["spacing"].as_f64().unwrap()));
}

#[test]
fn fields_of_particles_have_surfaces_out_of_core_as_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(run(folder, &["synth", "cloud", "-n", "3000", "-o", "cloud.g2"]).status.success());
    let of_field = ["--field", "internal-energy", "--isovalue", "2.5", "--attribute", "density", "--spacing", "0.1"];
    let told = made(folder, "field.ply", &of_field);
    let (mesh, values) = read_ply(&folder.join("field.ply"));
    mesh.assert_closed();
    assert!(values.len() == mesh.places.len() && values.iter().all(|value| *value > 0.0));
    assert_eq!([&told["field"]["name"], &told["boundary_edges"]], [&json!("internal-energy"), &json!(0)]);
    assert!((mesh.volume() / told["volume"].as_f64().unwrap() - 1.0).abs() < 1e-4, "{} {told}", mesh.volume());
    made(folder, "paged.ply", &[&of_field[..], &["--memory", "1"]].concat());
    assert!(std::fs::read(folder.join("field.ply")).unwrap() == std::fs::read(folder.join("paged.ply")).unwrap());
    // The density by its name, and a field of a volume, which has channels.
    let densities =
        [&[] as &[&str], &["--field", "density"]].map(|more| made(folder, "density.ply", more)["volume"].clone());
    assert_eq!(densities[0], densities[1]);
    write_ball(&folder.join("ball.nrrd"));
    let refused = run(folder, &["surface", "ball.nrrd", "--isovalue", "0", "--field", "value", "-o", "out.ply"]);
    let why = String::from_utf8(refused.stderr).unwrap();
    assert!(why.contains("ball.nrrd: --field: found an image or a volume, expected particles"), "{why}");
}

/// A ball in a volume that cuts off some of it, as NRRD.
fn write_ball(path: &Path) {
    let sizes = [20, 22, 18];
    let mut bytes = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 20 22 18\nspacings: 0.5 0.5 0.5\n".to_vec();
    bytes.extend_from_slice(b"encoding: raw\nendian: little\n\n");
    for z in 0..sizes[2] {
        for y in 0..sizes[1] {
            for x in 0..sizes[0] {
                let at = glam::DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                bytes.extend_from_slice(&((7.0 - at.distance(glam::DVec3::new(9.3, 10.4, 5.2))) as f32).to_le_bytes());
            }
        }
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn volumes_have_surfaces_built_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_ball(&folder.join("ball.nrrd"));
    assert!(run(folder, &["build", "ball.nrrd", "-o", "ball.df"]).status.success());
    let made = |data: &str, name: &str, more: &[&str]| -> serde_json::Value {
        let arguments = [&["surface", data, "--isovalue", "-0.25", "-o", name, "--json", "-"][..], more].concat();
        support::json(folder, &arguments)
    };
    let told = made("ball.nrrd", "source.ply", &[]);
    made("ball.df", "built.ply", &[]);
    assert_eq!(std::fs::read(folder.join("source.ply")).unwrap(), std::fs::read(folder.join("built.ply")).unwrap());
    let (mesh, _) = read_ply(&folder.join("source.ply"));
    mesh.assert_closed();
    let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap_or_else(|| panic!("{key} in {of}"));
    assert!((mesh.volume() / number(&told, "volume") - 1.0).abs() < 1e-4, "{told}");
    assert_eq!(number(&told, "samples"), 20.0 * 22.0 * 18.0);
    assert!((number(&told, "spacing") - 0.5).abs() < 1e-12, "{told}");
    assert!(number(&told, "cap_area") > 0.0 && told["channel"]["name"].is_string(), "{told}");
    let open = made("ball.df", "open.ply", &["--open", "--smooth", "5"]);
    assert!(number(&open, "boundary_edges") > 0.0 && number(&open, "smoothed") == 5.0, "{open}");
    assert!((number(&open, "volume") / number(&told, "volume") - 1.0).abs() < 1e-4, "{open} {told}");
    let refused = run(folder, &["surface", "ball.df", "--isovalue", "0", "--spacing", "1", "-o", "out.ply"]);
    assert_eq!(refused.status.code(), Some(2));
    let why = String::from_utf8(refused.stderr).unwrap();
    assert!(why.contains("ball.df: --spacing: found an image or a volume, expected particles"), "{why}");
}

#[test]
fn what_cannot_be_written_is_told_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(run(folder, &["synth", "cloud", "-n", "500", "-o", "cloud.g2"]).status.success());
    assert!(run(folder, &["build", "cloud.g2", "-o", "cloud.df"]).status.success());
    let told = |arguments: &[&str]| {
        let output = run(folder, &[&["surface"][..], arguments].concat());
        assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}");
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(text.trim_end().lines().count(), 1, "{text}");
        text
    };
    let high = told(&["cloud.df", "--isovalue", "1e9", "-o", "out.ply"]);
    assert!(high.contains("cloud.df: --isovalue: found 1000000000, expected less than the largest density"), "{high}");
    let small = run(folder, &["surface", "cloud.df", "--isovalue", "1e9", "--memory", "1000", "-o", "out.ply"]);
    let small = String::from_utf8(small.stderr).unwrap();
    assert!(small.contains("cloud.df: --memory: found 1000 bytes, bricks take"), "{small}");
    let low = told(&["cloud.df", "--isovalue", "-1", "-o", "out.ply"]);
    assert!(low.contains("cloud.df: --isovalue: found -1, expected a density above 0"), "{low}");
    let name = told(&["cloud.df", "--isovalue", "1", "-o", "out.glb"]);
    assert!(name.contains("out.glb: expected a name that ends in .ply, .obj or .stl"), "{name}");
    let value = told(&["cloud.df", "--isovalue", "1", "--attribute", "internal-energy", "-o", "out.stl"]);
    assert!(value.contains("--attribute"), "{value}");
    let unknown = told(&["cloud.df", "--isovalue", "1", "--attribute", "heat", "-o", "out.ply"]);
    assert!(unknown.contains("heat") && unknown.contains("internal-energy"), "{unknown}");
    let fine = told(&["cloud.df", "--isovalue", "1", "--spacing", "1e-3", "--cells", "1e6", "-o", "out.ply"]);
    assert!(fine.contains("--spacing: found 0.001") && fine.contains("--cells"), "{fine}");
    assert!(["out.ply", "out.glb", "out.stl"].iter().all(|name| !folder.join(name).exists()));
}
