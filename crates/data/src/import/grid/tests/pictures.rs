//! OpenEXR, pictures in NumPy's arrays, and folders of pictures.

use super::exr_files::exr;
use super::files::{npy, png};
use super::open;
use crate::import::grid_format;
use crate::model::SampleType;
use exr::prelude::{Encoding, FlatSamples};
use std::path::Path;

#[test]
fn channels_of_exr_have_their_names_and_types() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let whole = |from: u32| FlatSamples::U32((from..from + 30).collect());
    let opened = |channels| {
        std::fs::write(&path, exr(channels, Encoding::FAST_LOSSLESS)).unwrap();
        let source = open(&path).unwrap();
        let names: Vec<String> = source.grid().channels.iter().map(|channel| channel.name.clone()).collect();
        (names.join(" "), source.grid().sample_type)
    };
    assert_eq!(opened(vec![("id", whole(7))]), ("id".into(), SampleType::U32));
    assert_eq!(opened(vec![("Y", whole(7))]), ("value".into(), SampleType::U32));
    let depth = || FlatSamples::F32(vec![1.5; 30]);
    assert_eq!(opened(vec![("id", whole(u32::MAX - 40)), ("Z", depth())]), ("Z id".into(), SampleType::F64));
    assert_eq!(opened(vec![("A", depth()), ("Y", depth())]), ("value alpha".into(), SampleType::F32));
}

#[test]
fn the_last_axis_of_an_array_may_hold_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let opened = |is_fortran, shape: &str, body: &[u8]| {
        std::fs::write(&path, npy("|u1", is_fortran, shape, body)).unwrap();
        open(&path)
    };
    let sample = |[row, column, color]: [u8; 3]| 40 * row + 5 * column + color;
    let [rows, columns]: [u8; 2] = [5, 6];
    for colors in 2..=4 {
        let shape = format!("({rows}, {columns}, {colors})");
        let all: Vec<[u8; 3]> = (0..rows)
            .flat_map(|y| (0..columns).flat_map(move |x| (0..colors).map(move |color| [y, x, color])))
            .collect();
        let body: Vec<u8> = all.iter().map(|&at| sample(at)).collect();
        let mut transposed = all.clone();
        transposed.sort_by_key(|&[y, x, color]| [color, x, y]);
        let fortran: Vec<u8> = transposed.into_iter().map(sample).collect();
        for (is_fortran, bytes) in [(false, &body), (true, &fortran)] {
            let source = opened(is_fortran, &shape, bytes).unwrap();
            let grid = source.grid();
            assert_eq!((grid.kind(), grid.shape, grid.has_colors()), ("image", [6, 5, 1], colors >= 3), "{shape}");
            let mut samples = vec![0; body.len()];
            source.read(&grid.region(), &mut samples).unwrap();
            assert_eq!(samples, body, "{shape}, {is_fortran}");
        }
    }
    // As few rows as colours: slices, as a cube's are; and more values than a colour has.
    for shape in ["(4, 5, 4)", "(4, 4, 4)", "(6, 6, 5)", "(4, 5, 6)", "(2, 5, 6)"] {
        assert_eq!(opened(false, shape, &[0; 180]).unwrap().grid().kind(), "volume", "{shape}");
    }
    let text = opened(false, "(3, 4, 5)", &[0; 60]).unwrap_err().to_string();
    let expected =
        "shape: found (3, 4, 5), expected (4, 5, 3) of an image's colours, or (3, 4, 5, 1) of a volume's 3 slices";
    assert!(text.ends_with(expected), "{text}");
    assert_eq!(opened(false, "(3, 4, 5, 1)", &[0; 60]).unwrap().grid().shape, [5, 4, 3]);
}

/// Grey pictures of which all have the value of their number.
fn slice(folder: &Path, name: &str, width: u32, value: u8) {
    let pixels = vec![value; width as usize * 3];
    std::fs::write(folder.join(name), png(width, 3, png::ColorType::Grayscale, png::BitDepth::Eight, &pixels)).unwrap();
}

#[test]
fn a_folder_of_pictures_is_a_volume() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert_eq!(grid_format(path).unwrap(), None);
    for (name, value) in [("s2.png", 2), ("s10.png", 10), ("s1.png", 1)] {
        slice(path, name, 4, value);
    }
    std::fs::write(path.join(".hidden"), "x").unwrap();
    std::fs::write(path.join("notes.txt"), "x").unwrap();
    assert_eq!(grid_format(path).unwrap(), Some("slices"));
    let source = open(path).unwrap();
    assert_eq!((source.grid().kind(), source.grid().shape), ("volume", [4, 3, 3]));
    let mut samples = vec![0; 36];
    source.read(&source.grid().region(), &mut samples).unwrap();
    assert_eq!([samples[0], samples[12], samples[35]], [1, 2, 10]);
    let about = source.description();
    assert_eq!((about.files, &*about.format), (3, "slices"));
    assert!(about.notes[0].ends_with("from s1.png to s10.png") && about.notes[1].ends_with("notes.txt"), "{about:?}");
    let said = || open(path).unwrap_err().to_string().replace(&format!("{}/", path.display()), "");
    slice(path, "t.png", 5, 3);
    assert_eq!(said(), "t.png: found 5 x 3, expected 4 x 3 as s1.png");
    std::fs::write(path.join("t.png"), png(4, 3, png::ColorType::Rgb, png::BitDepth::Eight, &[0; 36])).unwrap();
    assert_eq!(said(), "t.png: found 4 x 3 of 3 uint8, expected 4 x 3 of uint8 as s1.png");
    std::fs::write(path.join("t.png"), super::more_files::tiff(&[5, 5], &super::files::big())).unwrap();
    assert_eq!(said(), "t.png: found a volume of 6 x 5 x 2, expected an image, as slices are");
    std::fs::write(path.join("t.png"), b"\x89PNG\r\n\x1a\nbroken").unwrap();
    assert!(said().starts_with("t.png: data: found "), "{}", said());
    // Other things than pictures.
    for name in ["a", "b", "c", "d", "e"] {
        std::fs::write(path.join(name), "x").unwrap();
    }
    assert_eq!(grid_format(path).unwrap(), None);
    let text = open(path).unwrap_err().to_string();
    assert!(text.contains("folder: found 4 pictures and 6 other files, expected several PNG"), "{text}");
}

#[test]
fn pages_of_a_tiff_are_channels_where_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cells.ome.tif");
    // The page of each channel's slices.
    for (order, pages) in [("XYZCT", [[0, 1], [2, 3]]), ("XYCZT", [[0, 2], [1, 3]])] {
        let text = format!(
            "<OME><Image><Pixels DimensionOrder=\"{order}\" SizeC=\"2\" SizeZ=\"2\" SizeT=\"1\" PhysicalSizeX=\"0.5\" \
             PhysicalSizeY=\"0.25\" PhysicalSizeZ=\"2\"/></Image></OME>"
        );
        std::fs::write(&path, super::more_files::described_tiff(&text, &[5; 4], &super::files::big())).unwrap();
        let source = open(&path).unwrap();
        let grid = source.grid();
        assert_eq!((grid.shape, grid.channels.len(), grid.spacing()), ([6, 5, 2], 2, vec![0.5, 0.25, 2.0]));
        assert!(source.description().notes.is_empty(), "{:?}", source.description().notes);
        let mut found = vec![0; 240];
        source.read(&grid.region(), &mut found).unwrap();
        let (found, all) = (found.as_chunks::<2>().0, super::files::native());
        let written = all.as_chunks::<2>().0;
        for (index, sample) in found.iter().enumerate() {
            let (channel, pixel, slice) = (index % 2, index / 2 % 30, index / 60);
            assert_eq!(*sample, written[30 * pages[channel][slice] + pixel], "{order} {channel} {slice} {pixel}");
        }
    }
    let text = "ImageJ=1.53t\nimages=9\nslices=3\nframes=3\n";
    std::fs::write(&path, super::more_files::described_tiff(text, &[5; 4], &super::files::big())).unwrap();
    let source = open(&path).unwrap();
    assert_eq!((source.grid().shape, source.grid().channels.len()), ([6, 5, 4], 1));
    assert!(source.description().notes[0].starts_with("4 pages are slices"), "{:?}", source.description().notes);
}

#[test]
fn what_is_decoded_in_one_piece_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.png");
    let mut file = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    let mut head = b"IHDR".to_vec();
    [60_000_u32; 2].iter().for_each(|side| head.extend_from_slice(&side.to_be_bytes()));
    // 8 bits, colours, interlaced.
    head.extend_from_slice(&[8, 2, 0, 0, 1]);
    let mut crc = flate2::Crc::new();
    crc.update(&head);
    file.extend_from_slice(&head);
    file.extend_from_slice(&crc.sum().to_be_bytes());
    // As much as could be all of it.
    file.extend_from_slice(&(11_u32 << 20).to_be_bytes());
    file.extend_from_slice(b"IDAT");
    file.resize(12 << 20, 0);
    std::fs::write(&path, file).unwrap();
    let error = open(&path).unwrap_err().to_string();
    let expected = "IHDR: found 60000 x 60000 of 3 uint8 (10299 MiB), expected at most 4096 MiB: \
                    an interlaced PNG is decoded in one piece";
    assert!(error.ends_with(expected), "{error}");
}
