//! Rigs of others: what is read of them, which way up, and that no bytes break the reading.
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
  <region id="two" xResolution="1280" yResolution="800" x="0.5" y="0.5" xsize="0.5" ysize="0.5">
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

/// A map of three columns and two rows.
fn pfm(rows: [[[f32; 3]; 3]; 2]) -> Vec<u8> {
    let mut pfm = b"PF\n3 2\n-1.0\n".to_vec();
    rows.as_flattened().as_flattened().iter().for_each(|number| pfm.extend(number.to_le_bytes()));
    pfm
}

/// Narrower at the top, rows from the bottom.
const WARP: [[[f32; 3]; 3]; 2] =
    [[[0.0, 0.1, 0.0], [0.5, 0.1, 0.0], [1.0, 0.1, 0.0]], [[0.2, 0.9, 0.0], [0.5, 0.9, 0.0], [0.8, 0.9, 0.0]]];

fn rig(text: &str) -> Vec<u8> {
    rig_with(text, WARP)
}

fn rig_with(text: &str, warp: [[[f32; 3]; 3]; 2]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let folder = tempfile::tempdir().unwrap();
    let picture = crate::color::Image { width: 2, height: 1, rgba: vec![[128, 128, 128, 255], [255; 4]] };
    crate::color::output::write_png(&folder.path().join("a.png"), &picture).unwrap();
    let png = std::fs::read(folder.path().join("a.png")).unwrap();
    for (name, bytes) in [("mpcdi.xml", text.as_bytes()), ("one.pfm", &pfm(warp)), ("one.png", &png)] {
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
    let outputs = crate::show::rig::OutputsFile::read(&path).unwrap().outputs;
    assert_eq!(outputs.len(), 2);
    let projector = crate::show::rig::Projector::open(&outputs[0], path.parent().unwrap(), [640, 360]).unwrap();
    assert!(projector.notes()[0].contains("black levels"), "{:?}", projector.notes());
    let one = read(&path, Some("one"), None).unwrap();
    let Geometry::Frustum(frustum, Some(warp)) = &one.geometry else { panic!("{:?}", one.geometry) };
    let expected = Frustum { yaw: -40.5, pitch: 12.0, roll: 3.0, left: -30.0, right: 25.0, down: -15.0, up: 20.0 };
    assert_eq!((one.size, *frustum), ([1920, 1080], expected));
    let [u, v, _] = warp.at([0.25, 1.0]).unwrap();
    assert!((u - 0.25).abs() < 1e-6 && (v - 0.9).abs() < 1e-6);
    assert!((one.mask.unwrap().light[0] - (128f32 / 255.0).powf(2.2)).abs() < 1e-6);
    assert!(one.notes.len() == 1 && one.notes[0].contains("betaMap"), "{:?}", one.notes);
    let two = read(&path, Some("two"), None).unwrap();
    assert!(matches!(two.geometry, Geometry::Frustum(_, None)) && two.mask.is_none());
    let message = read(&path, None, None).unwrap_err().to_string();
    assert!(message.contains("rig.mpcdi") && message.contains("one, two"), "{message}");

    let (_folder, path) = written(&rig(&RIG.replace("profile=\"3d\"", "profile=\"2d\"")));
    let two = read(&path, Some("two"), None).unwrap();
    let Geometry::Flat { aspect, part, warp: None } = two.geometry else { panic!("{:?}", two.geometry) };
    assert_eq!((aspect, part), (2.0, Area(0.5, 0.0, 1.0, 0.5)));

    for (from, to, expected) in [
        ("<yaw>-40.5</yaw>", "<yaw>left</yaw>", "yaw is left"),
        ("<yaw>-40.5</yaw>", "", "yaw is missing"),
        ("<rightAngle>25<", "<rightAngle>-31<", "right is -31"),
        ("one.pfm", "none.pfm", "none.pfm"),
        ("profile=\"3d\"", "profile=\"4d\"", "profile is \"4d\""),
        ("</MPCDI>", "", "XML"),
    ] {
        let (_folder, path) = written(&rig(&RIG.replacen(from, to, 1)));
        let message = read(&path, Some("one"), None).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("rig.mpcdi"), "{message}");
    }
}

/// Both orders of rows are in use: the picture is upright in both, unless the user says otherwise.
#[test]
fn warps_are_upright_in_either_order_of_their_rows() {
    let [bottom, top] = WARP;
    for (rows, known) in [([bottom, top], None), ([top, bottom], None), ([top, bottom], Some(Rows::Top))] {
        let (_folder, path) = written(&rig_with(RIG, rows));
        let Geometry::Frustum(_, Some(warp)) = read(&path, Some("one"), known).unwrap().geometry else { panic!() };
        let near = |at, expected: [f64; 2]| {
            let [u, v, _] = warp.at(at).unwrap();
            assert!((u - expected[0]).abs() < 1e-6 && (v - expected[1]).abs() < 1e-6, "{known:?} {at:?}: {u} {v}");
        };
        near([0.0, 0.0], [0.2, 0.1]);
        near([1.0, 1.0], [1.0, 0.9]);
    }
    // A projector that hangs the other way round.
    let (_folder, path) = written(&rig(RIG));
    let turned = read(&path, Some("one"), Some(Rows::Top)).unwrap().geometry;
    let Geometry::Frustum(_, Some(warp)) = turned else { panic!() };
    assert!((warp.at([0.0, 0.0]).unwrap()[1] - 0.9).abs() < 1e-6);
}

/// As Unreal Engine has them: to the right, up and behind; and nowhere where all numbers are 0.
#[test]
fn points_of_a_surface_are_seen_from_the_origin() {
    let points =
        [[[-1.0, -1.0, -2.0], [0.0, -1.0, -2.0], [1.0, -1.0, -2.0]], [[-1.0, 1.0, -2.0], [0.0, 1.0, -2.0], [0.0; 3]]];
    let text = RIG.replace("profile=\"3d\"", "profile=\"a3\"");
    let text = text.replace("<interpolation>", "<originOf3DData>floorCenter</originOf3DData><interpolation>");
    let (_folder, path) = written(&rig_with(&text, points));
    let one = read(&path, Some("one"), None).unwrap();
    assert!(one.notes[0].contains("floorCenter"), "{:?}", one.notes);
    let Geometry::Points(surface) = one.geometry else { panic!("{:?}", one.geometry) };
    assert_eq!(surface.at([0.0, 0.0]), Some([-1.0, 1.0, 2.0]));
    assert_eq!(surface.at([1.0, 1.0]), None, "beside a hole");
    let from_top = read(&path, Some("one"), Some(Rows::Top)).unwrap().geometry;
    assert!(matches!(from_top, Geometry::Points(surface) if surface.at([0.0, 0.0]) == Some([-1.0, -1.0, 2.0])));
}

/// As Mystique writes it: shader lamps without a surface, and nothing but text.
#[test]
fn a_rig_may_be_its_xml_alone() {
    let start = RIG.split("<files>").next().unwrap();
    let place = "<coordinateFrame><posx>1</posx></coordinateFrame></region>";
    let text =
        format!("\u{feff}{start}</MPCDI>").replace("profile=\"3d\"", "profile=\"sl\"").replace("</region>", place);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wolf.mpcdi.xml");
    std::fs::write(&path, &text).unwrap();
    let outputs = crate::show::rig::OutputsFile::read(&path).unwrap().outputs;
    assert_eq!(outputs.iter().map(|output| output.name.as_str()).collect::<Vec<_>>(), ["one", "two"]);
    let one = read(&path, Some("one"), None).unwrap();
    assert!(matches!(one.geometry, Geometry::Frustum(frustum, None) if frustum.roll == 3.0));
    assert!(one.notes[0].contains("coordinateFrame"), "{:?}", one.notes);
    std::fs::write(&path, RIG).unwrap();
    let message = read(&path, Some("one"), None).unwrap_err().to_string();
    assert!(message.contains("no files beside its XML"), "{message}");
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]

    #[test]
    fn no_bytes_break_it(at in 0..4000usize, byte: u8, cut in 0..4000usize) {
        let mut bytes = rig(RIG);
        let length = bytes.len();
        bytes[at % length] = byte;
        bytes.truncate(length - cut % length / 4);
        let (_folder, path) = written(&bytes);
        let _ = (regions(&path).is_ok(), read(&path, Some("one"), None).is_ok());
    }
}
