//! Rigs that others have measured: VESA's Multiple Projection Common Data Interchange, a ZIP archive of XML, PFM and PNG files.
//!
//! Read are the profiles `3d` and `a3` (a frustum, and a warp of its picture), `2d` (a part of a flat picture, and a warp of that), and `sl` (points of the surface that light falls on, seen from the origin); warps have rows from the top. Blend
//! maps (`alphaMap`) are read; black levels (`betaMap`) and lens distortions are named and left out.

use super::pfm::Pfm;
use super::{Area, Frustum, Mask};
use crate::annotate::overlay::decode_png;
use roxmltree::{Document, Node};
use std::io::Read;
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
    let fail = |message: String| MpcdiError { path: path.to_owned(), message };
    let mut archive = Archive::open(path).map_err(fail)?;
    let text = archive.text().map_err(fail)?;
    let document = Document::parse(&text).map_err(|error| fail(format!("its XML: {error}")))?;
    let found = all(document.root(), "region").filter(|region| attribute(*region, "xResolution").is_some());
    Ok(found.filter_map(|region| attribute(region, "id")).map(str::to_owned).collect())
}

/// Reads a region of an archive; the only one where `id` is `None`.
///
/// # Errors
/// [`MpcdiError`].
pub fn read(path: &Path, id: Option<&str>) -> Result<Region, MpcdiError> {
    let fail = |message: String| MpcdiError { path: path.to_owned(), message };
    let mut archive = Archive::open(path).map_err(fail)?;
    let text = archive.text().map_err(fail)?;
    let document = Document::parse(&text).map_err(|error| fail(format!("its XML: {error}")))?;
    region(&document, &mut archive, id).map_err(fail)
}

struct Archive(zip::ZipArchive<std::io::BufReader<std::fs::File>>);

impl Archive {
    fn open(path: &Path) -> Result<Archive, String> {
        let file = std::fs::File::open(path).map_err(|error| error.to_string())?;
        let archive = zip::ZipArchive::new(std::io::BufReader::new(file));
        archive.map(Archive).map_err(|error| format!("no ZIP archive: {error}"))
    }

    fn bytes(&mut self, name: &str, most: u64) -> Result<Vec<u8>, String> {
        let file = self.0.by_name(name).map_err(|error| format!("{name}: {error}"))?;
        let mut bytes = Vec::new();
        // The archive's own sizes may lie.
        file.take(most + 1).read_to_end(&mut bytes).map_err(|error| format!("{name}: {error}"))?;
        if bytes.len() as u64 > most {
            return Err(format!("{name}: more than {most} bytes"));
        }
        Ok(bytes)
    }

    fn text(&mut self) -> Result<String, String> {
        let names: Vec<String> = self.0.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
        let is_text = |name: &&String| name.to_ascii_lowercase().ends_with(".xml");
        let name = names.iter().find(is_text).ok_or("no XML file in it, expected mpcdi.xml")?;
        String::from_utf8(self.bytes(name, LONGEST_TEXT)?).map_err(|error| format!("{name}: {error}"))
    }
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

fn region(document: &Document<'_>, archive: &mut Archive, id: Option<&str>) -> Result<Region, String> {
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
    let geometry = match profile.as_str() {
        "2d" => {
            let buffer = node.ancestors().find(|node| node.tag_name().name().eq_ignore_ascii_case("buffer"));
            let sides = ["Xresolution", "Yresolution"].map(|name| buffer.and_then(|buffer| number_of(buffer, name)));
            let aspect = match sides {
                [Some(width), Some(height)] if width > 0.0 && height > 0.0 => width / height,
                _ => f64::from(size[0]) / f64::from(size[1]),
            };
            let [x, y, wide, tall] = ["x", "y", "xsize", "ysize"].map(|name| number_of(node, name).unwrap_or(0.0));
            let area = Area(x, y, x + wide, y + tall);
            Geometry::Flat { aspect, part: area, warp }
        }
        "3d" | "a3" | "a3d" => Geometry::Frustum(frustum(node).map_err(within)?, warp),
        "sl" => match warp {
            Some(points) => Geometry::Points(points),
            // Without points of the surface the projector stands at the eye.
            None => Geometry::Frustum(frustum(node).map_err(within)?, None),
        },
        other => return Err(format!("its profile is {other:?}, expected 2d, 3d, a3 or sl")),
    };
    let mut notes = Vec::new();
    for (name, what) in [("betaMap", "black levels"), ("distortionMap", "a lens distortion")] {
        if path_in(name).is_some() {
            notes.push(format!("region {id}: {what} ({name}) are left out"));
        }
    }
    Ok(Region { id, size, geometry, mask, notes })
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
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Write;

    const RIG: &str = r#"<?xml version="1.0"?>
<MPCDI profile="3d" geometry="1" color="1" date="2026-01-01" version="2.0"><display>
 <buffer id="dome" xResolution="4096" yResolution="2048">
  <region id="one" xResolution="1920" yResolution="1080" x="0" y="0" xsize="0.5" ysize="1">
   <frustum><yaw>-40.5</yaw><pitch>12</pitch><roll>3</roll><rightAngle>25</rightAngle><leftAngle>-30</leftAngle>
    <upAngle>20</upAngle><downAngle>-15</downAngle></frustum>
  </region>
  <region id="two" xResolution="1280" yResolution="800" x="0.5" y="0.25" xsize="0.5" ysize="0.5">
   <frustum><yaw>40</yaw><pitch>0</pitch><roll>0</roll><rightAngle>30</rightAngle><leftAngle>-30</leftAngle>
    <upAngle>20</upAngle><downAngle>-20</downAngle></frustum>
  </region>
 </buffer></display>
 <files>
  <fileset region="one">
   <geometryWarpFile><path>one.pfm</path><interpolation>linear</interpolation></geometryWarpFile>
   <alphaMap><path>one.png</path><componentDepth>1</componentDepth><bitDepth>8</bitDepth><gammaEmbedded>2.2</gammaEmbedded></alphaMap>
   <betaMap><path>black.png</path></betaMap>
  </fileset>
 </files>
</MPCDI>"#;

    fn rig(text: &str) -> Vec<u8> {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let mut pfm = b"PF\n3 2\n-1.0\n".to_vec();
        for number in [0.1f32, 0.1, 0.0, 0.5, 0.1, 0.0, 0.9, 0.1, 0.0, 0.1, 0.9, 0.0, 0.5, 0.9, 0.0, 0.9, 0.9, 0.0] {
            pfm.extend(number.to_le_bytes());
        }
        let folder = tempfile::tempdir().unwrap();
        let picture = crate::raster::Image { width: 2, height: 1, rgba: vec![[128, 128, 128, 255], [255; 4]] };
        crate::raster::output::write_png(&folder.path().join("a.png"), &picture).unwrap();
        let png = std::fs::read(folder.path().join("a.png")).unwrap();
        for (name, bytes) in [("mpcdi.xml", text.as_bytes()), ("one.pfm", &pfm), ("one.png", &png)] {
            archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
        }
        archive.finish().unwrap().into_inner()
    }

    fn written(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.mpcdi");
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    #[test]
    fn regions_have_their_frustum_warp_and_blend() {
        let (_folder, path) = written(&rig(RIG));
        assert_eq!(regions(&path).unwrap(), ["one", "two"]);
        let outputs = crate::outputs::OutputsFile::read(&path).unwrap().outputs;
        assert_eq!(outputs.len(), 2);
        let projector = crate::outputs::Projector::open(&outputs[0], path.parent().unwrap(), [640, 360]).unwrap();
        assert!(projector.notes()[0].contains("black levels"), "{:?}", projector.notes());
        let one = read(&path, Some("one")).unwrap();
        let Geometry::Frustum(frustum, Some(warp)) = &one.geometry else { panic!("{:?}", one.geometry) };
        let expected = Frustum { yaw: -40.5, pitch: 12.0, roll: 3.0, left: -30.0, right: 25.0, down: -15.0, up: 20.0 };
        assert_eq!((one.size, *frustum), ([1920, 1080], expected));
        let [u, v, _] = warp.at([0.25, 1.0]).unwrap();
        assert!((u - 0.3).abs() < 1e-6 && (v - 0.9).abs() < 1e-6);
        assert!((one.mask.unwrap().light[0] - (128f32 / 255.0).powf(2.2)).abs() < 1e-6);
        assert!(one.notes.len() == 1 && one.notes[0].contains("betaMap"), "{:?}", one.notes);
        let two = read(&path, Some("two")).unwrap();
        assert!(matches!(two.geometry, Geometry::Frustum(_, None)) && two.mask.is_none());
        let message = read(&path, None).unwrap_err().to_string();
        assert!(message.contains("rig.mpcdi") && message.contains("one, two"), "{message}");

        let (_folder, path) = written(&rig(&RIG.replace("profile=\"3d\"", "profile=\"2d\"")));
        let two = read(&path, Some("two")).unwrap();
        let Geometry::Flat { aspect, part, warp: None } = two.geometry else { panic!("{:?}", two.geometry) };
        assert_eq!((aspect, part), (2.0, Area(0.5, 0.25, 1.0, 0.75)));

        for (from, to, expected) in [
            ("<yaw>-40.5</yaw>", "<yaw>left</yaw>", "yaw is left"),
            ("<yaw>-40.5</yaw>", "", "yaw is missing"),
            ("<rightAngle>25<", "<rightAngle>-31<", "right is -31"),
            ("one.pfm", "none.pfm", "none.pfm"),
            ("profile=\"3d\"", "profile=\"4d\"", "profile is \"4d\""),
            ("</MPCDI>", "", "XML"),
        ] {
            let (_folder, path) = written(&rig(&RIG.replacen(from, to, 1)));
            let message = read(&path, Some("one")).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("rig.mpcdi"), "{message}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_bytes_break_it(at in 0..4000usize, byte: u8, cut in 0..4000usize) {
            let mut bytes = rig(RIG);
            let length = bytes.len();
            bytes[at % length] = byte;
            bytes.truncate(length - cut % length / 4);
            let (_folder, path) = written(&bytes);
            let _ = (regions(&path).is_ok(), read(&path, Some("one")).is_ok());
        }
    }
}
