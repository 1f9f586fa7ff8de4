//! The reference data, against the numbers that other readers found in it.

use super::{GridOptions, open_grid, summarize_grid};
use crate::model::Region;
use std::path::PathBuf;

/// Name; shape; spacing; sum; values in eighths of the range; the value in the middle; the sum of the largest values along the
/// third axis.
type Volume = (&'static str, [u64; 3], [f64; 3], f64, [u64; 8], f64, f64);

const VOLUMES: [Volume; 7] = [
    (
        "bonsai.nii.gz",
        [256, 256, 256],
        [1.0; 3],
        2.259011e8,
        [14932390, 632628, 140281, 233924, 418348, 128713, 280141, 10791],
        69.0,
        7212178.0,
    ),
    (
        "engine.nii.gz",
        [256, 256, 128],
        [1.0; 3],
        1.735905e8,
        [7008936, 180504, 140160, 213111, 749353, 33454, 27849, 35241],
        136.0,
        4748945.0,
    ),
    ("fuel.nii.gz", [64, 33, 32], [1.0; 3], 509815.0, [63222, 1576, 1062, 610, 394, 376, 172, 172], 189.0, 76024.0),
    (
        "chest_ct_lidc2.nrrd",
        [256, 256, 133],
        [1.40625, 1.40625, 2.5],
        6.148918e7,
        [8207584, 192352, 117638, 96972, 53369, 18230, 9970, 20173],
        128.0,
        4172129.0,
    ),
    (
        "head_ct_headsq.nrrd",
        [64, 64, 93],
        [3.2, 3.2, 1.5],
        1.933923e8,
        [235751, 22957, 100235, 12552, 8034, 1152, 186, 61],
        669.0,
        4911120.0,
    ),
    (
        "head_male.nrrd",
        [128, 256, 256],
        [1.0; 3],
        2.956955e8,
        [4746030, 256671, 3010554, 237775, 123935, 11609, 1189, 845],
        69.0,
        2983161.0,
    ),
    (
        "egpbos-LCDM.npy",
        [128; 3],
        [1.0; 3],
        251786286.0,
        [1578, 44778, 371909, 853013, 642260, 166153, 16746, 715],
        103.0,
        2967822.0,
    ),
];

/// Name; shape; means; the pixel in the middle.
type Picture = (&'static str, [u64; 2], &'static [f64], &'static [u8]);

const PICTURES: [Picture; 8] = [
    ("astronaut.png", [512, 512], &[141.5625, 105.7594, 96.47507], &[19, 14, 7]),
    ("hubble_deep_field.jpg", [1000, 872], &[18.58181, 19.79193, 19.08963], &[47, 34, 28]),
    ("coffee.png", [600, 400], &[158.5691, 85.79403, 51.48475], &[248, 250, 255]),
    ("camera.png", [512, 512], &[129.0607], &[14]),
    ("chelsea.png", [451, 300], &[147.6731, 111.4445, 86.79786], &[190, 150, 124]),
    ("rocket.jpg", [640, 427], &[52.26574, 61.2943, 82.27114], &[132, 123, 114]),
    ("phantom.png", [400, 400], &[31.40553, 31.40553, 31.40553], &[51, 51, 51]),
    ("face.png", [1024, 768], &[110.676, 117.7298, 102.0824], &[103, 99, 114]),
];

fn folder() -> Option<PathBuf> {
    std::env::var_os("DEEPFIELD_DATA").map(PathBuf::from)
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn volumes_of_the_reference_data_are_as_others_read_them() {
    let Some(folder) = folder() else { return };
    for (name, shape, spacing, sum, eighths, middle, projection) in VOLUMES {
        let source = open_grid(&folder.join("volumes").join(name), &GridOptions::default()).unwrap();
        let summary = summarize_grid(&source).unwrap();
        let channel = &summary.channels[0];
        assert_eq!((summary.kind, &summary.shape[..]), ("volume", &shape[..]), "{name}");
        assert!(summary.spacing.iter().zip(spacing).all(|(have, want)| (have / want - 1.0).abs() < 1e-4), "{name}");
        assert!((channel.sum / sum - 1.0).abs() < 1e-6, "{name}: {}", channel.sum);
        let found: Vec<u64> = channel.histogram.chunks(8).map(|part| part.iter().sum()).collect();
        assert_eq!(found, eighths, "{name}");
        let grid = source.grid();
        let read = |region: Region| {
            let mut bytes = vec![0; (region.shape().iter().product::<u64>() * grid.sample_bytes()) as usize];
            source.read(&region, &mut bytes).unwrap();
            let mut values = Vec::new();
            grid.sample_type.decode(&bytes, 1, &mut values);
            values
        };
        let at = shape.map(|count| count / 2);
        assert_eq!(read(Region { min: at, max: at.map(|at| at + 1) }), [middle], "{name}");
        let mut all = read(grid.region());
        // NumPy's first axis is the third of others.
        let plane = (shape[0] * shape[1]) as usize;
        let rest = all.split_off(plane);
        for layer in rest.chunks(plane) {
            all.iter_mut().zip(layer).for_each(|(most, value)| *most = most.max(*value));
        }
        assert_eq!(all.iter().sum::<f64>(), projection, "{name}");
    }
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn images_of_the_reference_data_are_as_others_read_them() {
    let Some(folder) = folder() else { return };
    for (name, shape, means, middle) in PICTURES {
        let source = open_grid(&folder.join("images").join(name), &GridOptions::default()).unwrap();
        let summary = summarize_grid(&source).unwrap();
        assert_eq!((summary.kind, &summary.shape[..]), ("image", &shape[..]), "{name}");
        // Decoders of JPEG differ by their rounding.
        let (far, near) = if name.ends_with("jpg") { (0.5, 4) } else { (1e-4, 0) };
        assert_eq!(summary.channels.len(), means.len(), "{name}");
        for (channel, mean) in summary.channels.iter().zip(means) {
            assert!((channel.mean.unwrap() - mean).abs() < far, "{name}: {:?}", channel.mean);
        }
        let [x, y] = shape.map(|count| count / 2);
        let mut pixel = vec![0; middle.len()];
        source.read(&Region { min: [x, y, 0], max: [x + 1, y + 1, 1] }, &mut pixel).unwrap();
        assert!(pixel.iter().zip(middle).all(|(have, want)| have.abs_diff(*want) <= near), "{name}: {pixel:?}");
    }
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn an_elevation_of_the_reference_data_has_its_place_and_holes() {
    let Some(folder) = folder() else { return };
    let source = open_grid(&folder.join("heightfields/elev_luxembourg.tif"), &GridOptions::default()).unwrap();
    let summary = summarize_grid(&source).unwrap();
    let channel = &summary.channels[0];
    assert_eq!((&summary.shape[..], channel.min, channel.max), (&[95, 90][..], Some(141.0), Some(547.0)));
    assert_eq!(channel.no_data, 3942);
    assert!((channel.mean.unwrap() - 348.3366).abs() < 1e-4);
    assert!(summary.spacing.iter().all(|step| (step - 0.008_333_333).abs() < 1e-8));
}
