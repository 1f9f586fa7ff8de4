//! Rigs that others have measured: VESA's Multiple Projection Common Data Interchange, a ZIP archive of XML, PFM and PNG files,
//! or the XML alone, as Christie's Mystique writes it.
//!
//! Read are the profiles `2d` (a part of a flat picture, and a warp of that), `3d` (a frustum, and a warp of its picture), `a3` and
//! `sl` (points of the surface that light falls on, seen from the origin). Blend maps (`alphaMap`) are read; black levels
//! (`betaMap`), lens distortions and the places of shader lamps are named and left out.
//!
//! Signs are as independent readers have them (the MPCDI library of Scalable Display Technologies, Unreal Engine's nDisplay, SGCT,
//! PyMPCDI, and Christie's notes on the standard): yaw turns to the right, then pitch up, then roll lowers the right side; angles
//! to the left and down are negative; shares of a picture, and regions of a buffer, are counted from the lower left corner, a
//! region's warp within the region; points have x to the right, y up and z behind; a point that is no number, or nothing but
//! zeros, is nowhere. Of the order of rows there are both kinds: the library has them from the bottom, as PFM files are defined,
//! SGCT and PyMPCDI from the top. A warp of shares is taken the way on which the picture is upright, points from the bottom,
//! unless the user says which ([`Rows`]).

use super::pfm::Pfm;
use super::{Area, Frustum, Mask, Rows};
use crate::annotate::overlay::decode_png;
use roxmltree::{Document, Node};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

/// The largest XML text, bytes.
const LONGEST_TEXT: u64 = 16 << 20;
/// The largest file in an archive, bytes.
const LARGEST: u64 = 1 << 30;

/// An archive that cannot be used: which, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: {message}", path.display())]
pub struct MpcdiError {
    /// The archive.
    pub path: PathBuf,
    /// What is wrong, and what was expected.
    pub message: String,
}

/// A region of a rig: what one projector shows.
#[derive(Clone, Debug)]
pub struct Region {
    /// Its id.
    pub id: String,
    /// Width and height of the projector's picture, pixels.
    pub size: [u32; 2],
    /// What it shows.
    pub geometry: Geometry,
    /// How it blends into its neighbours.
    pub mask: Option<Mask>,
    /// What the archive says beside that, and is left out.
    pub notes: Vec<String>,
}

/// What a projector shows.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// The picture of a frustum, warped.
    Frustum(Frustum, Option<Pfm>),
    /// A part of a flat picture.
    Flat {
        /// The whole picture's width for its height.
        aspect: f64,
        /// The part; a warp says where in it each point lies.
        part: Area,
        /// The warp.
        warp: Option<Pfm>,
    },
    /// Points on a surface, to the right, up and ahead of the eye.
    Points(Pfm),
}

/// The ids of an archive's regions.
///
/// # Errors
/// [`MpcdiError`].
pub fn regions(path: &Path) -> Result<Vec<String>, MpcdiError> {
    read_document(path, |document, _| {
        let found = all(document.root(), "region").filter(|region| attribute(*region, "xResolution").is_some());
        Ok(found.filter_map(|region| attribute(region, "id")).map(str::to_owned).collect())
    })
}

/// Reads a region of an archive, the only one where `id` is `None`; `rows` is the order of its warp's, where it is known.
///
/// # Errors
/// [`MpcdiError`].
pub fn read(path: &Path, id: Option<&str>, rows: Option<Rows>) -> Result<Region, MpcdiError> {
    read_document(path, |document, archive| region(document, archive, id, rows))
}

/// What `find` finds in an archive and its XML.
fn read_document<T>(
    path: &Path,
    find: impl FnOnce(&Document, &mut Archive) -> Result<T, String>,
) -> Result<T, MpcdiError> {
    let fail = |message: String| MpcdiError { path: path.to_owned(), message };
    let mut archive = Archive::open(path).map_err(fail)?;
    let text = archive.text().map_err(fail)?;
    let document = Document::parse(&text).map_err(|error| fail(format!("its XML: {error}")))?;
    find(&document, &mut archive).map_err(fail)
}

/// What a rig is kept in.
enum Archive {
    Zip(zip::ZipArchive<BufReader<File>>),
    /// The XML alone.
    Text(File),
}

impl Archive {
    fn open(path: &Path) -> Result<Archive, String> {
        let mut file = File::open(path).map_err(|error| error.to_string())?;
        let mut start = Vec::new();
        (&mut file).take(16).read_to_end(&mut start).map_err(|error| error.to_string())?;
        file.rewind().map_err(|error| error.to_string())?;
        let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start).trim_ascii_start();
        if start.starts_with(b"<") {
            return Ok(Archive::Text(file));
        }
        let archive = zip::ZipArchive::new(BufReader::new(file));
        archive.map(Archive::Zip).map_err(|error| format!("no ZIP archive: {error}"))
    }

    fn bytes(&mut self, name: &str, most: u64) -> Result<Vec<u8>, String> {
        let Archive::Zip(archive) = self else { return Err(format!("{name}: it has no files beside its XML")) };
        let file = archive.by_name(name).map_err(|error| format!("{name}: {error}"))?;
        // The archive's own sizes may lie.
        read_most(file, most).map_err(|message| format!("{name}: {message}"))
    }

    fn text(&mut self) -> Result<String, String> {
        let (name, bytes) = match self {
            Archive::Text(file) => ("its XML".to_owned(), read_most(file, LONGEST_TEXT)?),
            Archive::Zip(archive) => {
                let names: Vec<String> =
                    archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
                let is_text = |name: &&String| name.to_ascii_lowercase().ends_with(".xml");
                let name = names.iter().find(is_text).ok_or("no XML file in it, expected mpcdi.xml")?.clone();
                let bytes = self.bytes(&name, LONGEST_TEXT)?;
                (name, bytes)
            }
        };
        String::from_utf8(bytes).map_err(|error| format!("{name}: {error}"))
    }
}

/// All bytes of something that may not have more than so many.
fn read_most(file: impl Read, most: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > most {
        return Err(format!("more than {most} bytes"));
    }
    Ok(bytes)
}

/// All elements of that name, however letters are written.
fn all<'a, 'd>(node: Node<'a, 'd>, name: &'static str) -> impl Iterator<Item = Node<'a, 'd>> + use<'a, 'd> {
    node.descendants().filter(move |node| node.is_element() && node.tag_name().name().eq_ignore_ascii_case(name))
}

fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.attributes().find(|attribute| attribute.name().eq_ignore_ascii_case(name)).map(|attribute| attribute.value())
}

fn number(node: Node<'_, '_>, name: &'static str) -> Result<f64, String> {
    let text = match all(node, name).next() {
        Some(child) => child.text(),
        None => attribute(node, name),
    };
    let value = text.and_then(|text| text.trim().parse().ok()).filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| format!("{name} is {}, expected a number", text.unwrap_or("missing")))
}

fn region(
    document: &Document<'_>,
    archive: &mut Archive,
    id: Option<&str>,
    rows: Option<Rows>,
) -> Result<Region, String> {
    let root = document.root_element();
    let profile = attribute(root, "profile").unwrap_or("").to_ascii_lowercase();
    let found: Vec<Node<'_, '_>> = all(root, "region")
        // Files and extensions repeat the regions' names.
        .filter(|region| attribute(*region, "xResolution").is_some())
        .collect();
    let names: Vec<&str> = found.iter().filter_map(|region| attribute(*region, "id")).collect();
    let node = match id {
        Some(id) => found.iter().find(|region| attribute(**region, "id") == Some(id)),
        None => found.first().filter(|_| found.len() == 1),
    };
    let Some(&node) = node else {
        let asked = id.map_or("none is named".to_owned(), |id| format!("none is called {id}"));
        return Err(format!("of its regions {asked}; there are {}", names.join(", ")));
    };
    let id = attribute(node, "id").unwrap_or("").to_owned();
    let within = |message: String| format!("region {id}: {message}");
    let side = |name| number(node, name).map_err(within).map(|side| side.clamp(1.0, 65536.0) as u32);
    let size = [side("xResolution")?, side("yResolution")?];
    let set = all(root, "fileset").find(|set| attribute(*set, "region") == Some(id.as_str()));
    let path_in = |name: &'static str| {
        let element = set.and_then(|set| all(set, name).next())?;
        let path = all(element, "path").next().and_then(|path| path.text()).map(str::trim)?;
        (!path.is_empty()).then_some((element, path))
    };
    let warp = match path_in("geometryWarpFile") {
        Some((_, path)) => {
            let bytes = archive.bytes(path, LARGEST).map_err(within)?;
            Some(Pfm::parse(&bytes).map_err(|error| within(format!("{path}: {error}")))?)
        }
        None => None,
    };
    let mask = match path_in("alphaMap") {
        Some((element, path)) => {
            let bytes = archive.bytes(path, LARGEST).map_err(within)?;
            let image = decode_png(std::io::Cursor::new(bytes)).map_err(|error| within(format!("{path}: {error}")))?;
            let gamma = number(element, "gammaEmbedded").unwrap_or(1.0).clamp(0.1, 10.0);
            Some(Mask::of(&image, gamma))
        }
        None => None,
    };
    let mut notes = Vec::new();
    let geometry = match profile.as_str() {
        "2d" => {
            let buffer = node.ancestors().find(|node| node.tag_name().name().eq_ignore_ascii_case("buffer"));
            let sides = ["Xresolution", "Yresolution"].map(|name| buffer.and_then(|buffer| number_of(buffer, name)));
            let aspect = match sides {
                [Some(width), Some(height)] if width > 0.0 && height > 0.0 => width / height,
                _ => f64::from(size[0]) / f64::from(size[1]),
            };
            let share = |name, usual| number_of(node, name).unwrap_or(usual);
            let [x, y, wide, tall] = [share("x", 0.0), share("y", 0.0), share("xsize", 1.0), share("ysize", 1.0)];
            // Sums of single precision may be a little more than all.
            let edge = |share: f64| if (-1e-5..=1.0 + 1e-5).contains(&share) { share.clamp(0.0, 1.0) } else { share };
            let part = Area(edge(x), edge(1.0 - y - tall), edge(x + wide), edge(1.0 - y));
            if !part.is_part() {
                let found = format!("x {x}, y {y}, xsize {wide}, ysize {tall}");
                return Err(within(format!("{found}: expected a part of a buffer from 0 to 1")));
            }
            Geometry::Flat { aspect, part, warp: warp.map(|warp| upright(warp, rows)) }
        }
        "3d" => Geometry::Frustum(frustum(node).map_err(within)?, warp.map(|warp| upright(warp, rows))),
        "a3" | "a3d" | "sl" => match warp {
            Some(points) => {
                let origin = path_in("geometryWarpFile").and_then(|(element, _)| all(element, "originOf3DData").next());
                let origin = origin.and_then(|origin| origin.text()).map_or("", str::trim);
                if !origin.is_empty() && !origin.eq_ignore_ascii_case("idealEyePoint") {
                    notes.push(format!("region {id}: points are measured from {origin}, where the eye is taken to be"));
                }
                Geometry::Points(surface(points, rows))
            }
            // Without points of the surface the projector stands at the eye.
            None => {
                if all(node, "coordinateFrame").next().is_some() {
                    notes.push(format!("region {id}: where the projector stands (coordinateFrame) is left out"));
                }
                Geometry::Frustum(frustum(node).map_err(within)?, None)
            }
        },
        other => return Err(format!("its profile is {other:?}, expected 2d, 3d, a3 or sl")),
    };
    for (name, what) in [("betaMap", "black levels"), ("distortionMap", "a lens distortion")] {
        if path_in(name).is_some() {
            notes.push(format!("region {id}: {what} ({name}) are left out"));
        }
    }
    Ok(Region { id, size, geometry, mask, notes })
}

/// A warp's shares of a picture, counted from the lower left corner, as deepfield has them: from the upper left one, rows from the top.
fn upright(warp: Pfm, rows: Option<Rows>) -> Pfm {
    let from_bottom = rows.map_or_else(|| warp.rises(), |rows| rows == Rows::Bottom);
    let warp = if from_bottom { warp.turned() } else { warp };
    warp.map(|[u, v, w]| [u, 1.0 - v, w])
}

/// A surface's points to the right, up and ahead, rows from the top.
fn surface(points: Pfm, rows: Option<Rows>) -> Pfm {
    let points = if rows == Some(Rows::Top) { points } else { points.turned() };
    points.map(|[x, y, z]| if [x, y, z] == [0.0; 3] { [f32::NAN; 3] } else { [x, y, -z] })
}

fn number_of(node: Node<'_, '_>, name: &str) -> Option<f64> {
    attribute(node, name).and_then(|text| text.trim().parse().ok()).filter(|value: &f64| value.is_finite())
}

fn frustum(node: Node<'_, '_>) -> Result<Frustum, String> {
    let frustum = all(node, "frustum").next().ok_or("no frustum, expected one in this profile")?;
    let angle = |name| number(frustum, name);
    let frustum = Frustum {
        yaw: angle("yaw")?,
        pitch: angle("pitch")?,
        roll: angle("roll")?,
        left: angle("leftAngle")?,
        right: angle("rightAngle")?,
        down: angle("downAngle")?,
        up: angle("upAngle")?,
    };
    match frustum.mistake() {
        Some((name, found, expected)) => Err(format!("{name} is {found}, expected {expected}")),
        None => Ok(frustum),
    }
}

#[cfg(test)]
mod tests;
