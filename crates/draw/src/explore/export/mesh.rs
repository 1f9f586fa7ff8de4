//! Meshes of triangles in files that other programs draw: PLY (binary, little-endian), OBJ (text) and STL (binary).
//!
//! Triangles are counter-clockwise as seen from outside. Coordinates are the data's own, in its units; STL has single
//! precision always, PLY and OBJ have double precision where single would not tell neighbours apart. PLY and OBJ have a
//! normal at each vertex, PLY an attribute's mean as `value`, too. Vertices and triangles are written as they come; of
//! PLY, whose triangles stand behind all vertices, these wait in a temporary file.

use super::Out;
use super::ply::count_line;
use crate::cpu::mesh::{Piece, Vertex};
use crate::model::Unit;
use crate::store::temporary::{self, Temporary};
use glam::DVec3;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes that are collected before they are written.
const BUFFER: usize = 1 << 20;

/// What kind of file a mesh is written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// The polygon file format.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// STL: triangles alone, which share no vertices.
    Stl,
}

impl MeshFormat {
    /// The format that a file's name asks for.
    pub fn of(path: &Path) -> Option<MeshFormat> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(MeshFormat::Ply),
            "obj" => Some(MeshFormat::Obj),
            "stl" => Some(MeshFormat::Stl),
            _ => None,
        }
    }
}

/// What a file says about its mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshAbout<'a> {
    /// The value on the surface.
    pub isovalue: f64,
    /// The lattice's, length unit.
    pub spacing: f64,
    /// Unit of coordinates.
    pub length_unit: &'a Unit,
    /// What the isovalue is of, `density` or the name of a column or a channel.
    pub quantity: &'a str,
    /// Unit of that.
    pub unit: &'a str,
    /// The attribute whose mean vertices have, and what that is weighted with.
    pub attribute: Option<(&'a str, &'a str)>,
    /// Whether coordinates need double precision.
    pub is_double: bool,
    /// Steps of smoothing.
    pub smooth: u32,
}

impl MeshAbout<'_> {
    fn lines(&self) -> Vec<String> {
        let line = |text: String| text.replace(['\n', '\r'], " ");
        let MeshAbout { isovalue, spacing, length_unit, quantity, unit, attribute, .. } = self;
        let mut lines = vec![
            line(format!("isosurface of the {quantity} {isovalue} by deepfield, on a lattice of spacing {spacing}")),
            line(format!("unit of length: {length_unit}")),
            line(format!("unit of {quantity}: {unit}")),
        ];
        if self.smooth > 0 {
            lines.push(format!("smoothed in {} steps", self.smooth));
        }
        lines.extend(attribute.map(|(name, weight)| line(format!("value: mean of {name}, weighted with {weight}"))));
        lines
    }
}

/// A mesh that is being written.
pub struct MeshFile {
    format: MeshFormat,
    is_double: bool,
    has_value: bool,
    file: Temporary,
    /// Triangles of a PLY file, until all vertices are written.
    faces: Option<Temporary>,
    /// Where the numbers of vertices and of triangles are, which are known when all are written.
    counts_at: [u64; 2],
    vertices: u64,
    triangles: u64,
}

impl MeshFile {
    /// Begins a file that is to be `out`.
    ///
    /// # Errors
    /// When the folder takes no files.
    pub fn create(format: MeshFormat, out: &Path, about: &MeshAbout) -> io::Result<MeshFile> {
        temporary::clean(out, temporary::folder_of(out));
        let file = Temporary::create(out, None)?;
        let faces = if format == MeshFormat::Ply { Some(Temporary::create(out, None)?) } else { None };
        let has_value = format == MeshFormat::Ply && about.attribute.is_some();
        let (header, counts_at) = match format {
            MeshFormat::Ply => ply_header(about),
            MeshFormat::Obj => (about.lines().iter().map(|line| format!("# {line}\n")).collect(), [0; 2]),
            MeshFormat::Stl => {
                // A header that begins with "solid" is one of a text file.
                let mut header = String::from("deepfield isosurface; lengths in ");
                header.extend(about.length_unit.to_string().chars().filter(char::is_ascii).take(40));
                (format!("{header:<80}\0\0\0\0"), [80; 2])
            }
        };
        let mut to: &std::fs::File = file.file();
        to.write_all(header.as_bytes())?;
        let is_double = about.is_double;
        Ok(MeshFile { format, is_double, has_value, file, faces, counts_at, vertices: 0, triangles: 0 })
    }

    /// Writes the next piece.
    ///
    /// # Errors
    /// When nothing can be written, or the format has no numbers for so many.
    pub fn write(&mut self, piece: &Piece) -> io::Result<()> {
        self.vertices += piece.fresh.len() as u64;
        self.triangles += piece.triangles.len() as u64;
        match self.format {
            MeshFormat::Ply if self.vertices.max(self.triangles) > i32::MAX as u64 => return Err(too_many("PLY")),
            MeshFormat::Stl if self.triangles > u64::from(u32::MAX) => return Err(too_many("STL")),
            _ => {}
        }
        let mut to: Out = BufWriter::with_capacity(BUFFER, self.file.file());
        let fresh = piece.fresh.iter().map(|&place| &piece.vertices[place as usize]);
        match self.format {
            MeshFormat::Ply => {
                for vertex in fresh {
                    self.ply_vertex(&mut to, vertex)?;
                }
                let Some(faces) = &self.faces else { return to.flush() };
                let mut faces: Out = BufWriter::with_capacity(BUFFER, faces.file());
                for triangle in &piece.triangles {
                    faces.write_all(&[3])?;
                    for place in triangle {
                        faces.write_all(&(piece.numbers[*place as usize] as i32).to_le_bytes())?;
                    }
                }
                faces.flush()?;
            }
            MeshFormat::Obj => {
                for Vertex { position, normal, .. } in fresh {
                    if self.is_double {
                        writeln!(to, "v {} {} {}", position.x, position.y, position.z)?;
                    } else {
                        writeln!(to, "v {} {} {}", position.x as f32, position.y as f32, position.z as f32)?;
                    }
                    writeln!(to, "vn {:.6} {:.6} {:.6}", normal.x, normal.y, normal.z)?;
                }
                for triangle in &piece.triangles {
                    // Numbers begin with 1.
                    let [a, b, c] = triangle.map(|place| piece.numbers[place as usize] + 1);
                    writeln!(to, "f {a}//{a} {b}//{b} {c}//{c}")?;
                }
            }
            MeshFormat::Stl => {
                for triangle in &piece.triangles {
                    let corners = triangle.map(|place| piece.vertices[place as usize].position);
                    stl_triangle(&mut to, corners)?;
                }
            }
        }
        to.flush()
    }

    fn ply_vertex(&self, to: &mut Out, vertex: &Vertex) -> io::Result<()> {
        let Vertex { position, normal, value } = vertex;
        for coordinate in position.to_array() {
            if self.is_double {
                to.write_all(&coordinate.to_le_bytes())?;
            } else {
                to.write_all(&(coordinate as f32).to_le_bytes())?;
            }
        }
        for component in normal.to_array() {
            to.write_all(&component.to_le_bytes())?;
        }
        if self.has_value {
            to.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    }

    /// Writes what is left, and gives the file its name; its size, bytes.
    ///
    /// # Errors
    /// When nothing can be written, or the system refuses the name.
    pub fn finish(self, out: &Path) -> io::Result<u64> {
        let mut to: &std::fs::File = self.file.file();
        if let Some(faces) = &self.faces {
            let mut from: &std::fs::File = faces.file();
            from.rewind()?;
            io::copy(&mut from, &mut to)?;
        }
        let [vertices_at, triangles_at] = self.counts_at;
        match self.format {
            MeshFormat::Ply => {
                for (at, count) in [(vertices_at, self.vertices), (triangles_at, self.triangles)] {
                    to.seek(SeekFrom::Start(at))?;
                    to.write_all(count_line(count).as_bytes())?;
                }
            }
            MeshFormat::Stl => {
                to.seek(SeekFrom::Start(triangles_at))?;
                to.write_all(&(self.triangles as u32).to_le_bytes())?;
            }
            MeshFormat::Obj => {}
        }
        let bytes = to.metadata()?.len();
        self.file.persist(out)?;
        Ok(bytes)
    }
}

/// The header, and where in it the numbers of vertices and of triangles are.
fn ply_header(about: &MeshAbout) -> (String, [u64; 2]) {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    for line in about.lines() {
        header.push_str(&format!("comment {line}\n"));
    }
    let number = if about.is_double { "double" } else { "float" };
    header.push_str("element vertex ");
    let vertices_at = header.len() as u64;
    header.push_str(&count_line(0));
    for name in ["x", "y", "z"] {
        header.push_str(&format!("property {number} {name}\n"));
    }
    let value = about.attribute.map(|_| "value");
    for name in ["nx", "ny", "nz"].into_iter().chain(value) {
        header.push_str(&format!("property float {name}\n"));
    }
    header.push_str("element face ");
    let triangles_at = header.len() as u64;
    header.push_str(&count_line(0));
    header.push_str("property list uchar int vertex_indices\nend_header\n");
    (header, [vertices_at, triangles_at])
}

fn stl_triangle(to: &mut Out, [a, b, c]: [DVec3; 3]) -> io::Result<()> {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    for point in [normal, a, b, c] {
        for component in point.to_array() {
            to.write_all(&(component as f32).to_le_bytes())?;
        }
    }
    to.write_all(&[0; 2])
}

fn too_many(format: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("more vertices or triangles than {format} has numbers for"))
}
