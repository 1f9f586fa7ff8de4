//! Damaged and hostile page files: every flipped bit and every truncation is found, and nothing panics.

use crate::support::page_checksums;
use deepfield::build::{BuildOptions, build};
use deepfield::codec::VqBits;
use deepfield::hierarchy::{Kinds, OctreeOptions};
use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::store::layout::{ALIGNMENT, HEADER_LEN, NODE_RECORD_LEN, PAGE_HEADER_LEN};
use deepfield::store::{PageFile, PageId, Representative, verify};
use proptest::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::OnceLock;

/// What a file has beside an octree.
#[derive(Clone, Copy, Debug)]
enum Has {
    Nothing,
    VolumeLevels,
    Clusters,
}

const KINDS: [Has; 3] = [Has::Nothing, Has::VolumeLevels, Has::Clusters];

/// The bytes of a small page file with grid, relay and leaf nodes in several pages' worth of structure.
fn sound(has: Has) -> &'static [u8] {
    static BYTES: [OnceLock<Vec<u8>>; KINDS.len()] = [const { OnceLock::new() }; KINDS.len()];
    BYTES[has as usize].get_or_init(|| {
        let pca = matches!(has, Has::Clusters);
        let volume_levels = matches!(has, Has::VolumeLevels);
        // Small leaves have no clusters.
        let (count, leaf_capacity) = if pca { (290, 90) } else { (90, 12) };
        let place = |i: usize, prime: usize| ((i * prime) % 89) as f64 / 89.0;
        let clump = |i: usize| if i.is_multiple_of(2) { 1e-3 } else { 1.0 };
        let family = |name| Family {
            name,
            positions: (0..count)
                .map(|i| [place(i, 31) * clump(i), place(i, 57) * clump(i), place(i, 101) * clump(i)])
                .collect(),
            mass: (0..count).map(|i| 1.0 + (i % 3) as f32).collect(),
            smoothing_length: (0..count).map(|i| (0.02 * clump(i)) as f32).collect(),
            density: (0..count).map(|i| 1.0 + (i % 17) as f32).collect(),
            attributes: vec![Attribute {
                name: "temperature".into(),
                unit: Unit::new("K"),
                values: (0..count).map(|i| (i % 11) as f32).collect(),
            }],
        };
        let dataset = Dataset {
            // Flipping every bit takes the square of the length: a second family is in the files without clusters.
            families: match pca {
                true => vec![family(FamilyName::Gas)],
                false => vec![family(FamilyName::Gas), family(FamilyName::Stars)],
            },
            length_unit: Unit::new("pc"),
            mass_unit: Unit::default(),
            kernel: Kernel::CubicSpline,
            skipped: Vec::new(),
            provenance: Provenance { box_size: Some(1.0), ..Provenance::default() },
        };
        // Two kinds have the versions without refined codes.
        let octree = OctreeOptions {
            vq_bits: VqBits::Twelve,
            refined: pca,
            leaf_capacity,
            volume_levels,
            ..OctreeOptions::default()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sound.df");
        let hierarchies = if pca { Kinds::of_particles() } else { Kinds::default() };
        build(dataset, &BuildOptions { octree, hierarchies, ..BuildOptions::default() }, &path, &()).unwrap();
        std::fs::read(path).unwrap()
    })
}

fn check(bytes: &[u8], path: &Path) -> bool {
    std::fs::write(path, bytes).unwrap();
    // Reading must not panic either, whatever it finds.
    if let Ok(file) = PageFile::open(path) {
        for id in 0..=file.page_count() {
            if let Ok(page) = file.read_page(PageId(id)) {
                for node in 0..page.nodes.len() {
                    if let Some(content) = page.content(node) {
                        for count in [Some(1), Some(3), None] {
                            content.clusters(count, Representative::default());
                        }
                        continue;
                    }
                    let particles = page.particles(node);
                    assert_eq!(particles.len(), page.nodes[node].particles as usize);
                    assert!((0..particles.len()).all(|i| particles.fraction(i).iter().all(|x| (0.0..1.0).contains(x))));
                    assert!(particles.words().len() <= 2 * particles.len());
                }
            }
        }
    }
    verify(path, &()).is_ok()
}

#[test]
fn every_flipped_bit_is_found() {
    flip_every_bit(sound(Has::Nothing));
}

#[test]
fn every_flipped_bit_of_a_file_with_volume_levels_is_found() {
    flip_every_bit(sound(Has::VolumeLevels));
}

#[test]
fn every_flipped_bit_of_a_file_with_clusters_is_found() {
    flip_every_bit(sound(Has::Clusters));
}

fn flip_every_bit(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flipped.df");
    assert!(check(bytes, &path));
    let mut missed = Vec::new();
    for (at, &sound) in bytes.iter().enumerate() {
        for (byte, is_flipped) in [(sound ^ 1 << (at % 8), true), (sound, false)] {
            let mut file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            file.seek(SeekFrom::Start(at as u64)).unwrap();
            file.write_all(&[byte]).unwrap();
            if is_flipped && verify(&path, &()).is_ok() {
                missed.push(at);
            }
        }
    }
    assert!(missed.is_empty(), "flips not found at {missed:?}");
}

#[test]
fn every_truncation_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.df");
    for bytes in KINDS.map(sound) {
        for len in (0..bytes.len()).step_by(53).chain(bytes.len() - 9..bytes.len()).chain(0..HEADER_LEN) {
            assert!(!check(&bytes[..len], &path), "{len}");
        }
        let longer = [bytes, &[0]].concat();
        assert!(!check(&longer, &path));
    }
}

/// Those that the format has as well as those that it has not.
#[test]
fn depths_that_nodes_do_not_have_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deeper.df");
    for sound in KINDS.map(sound) {
        for node in 0..3 {
            let at = ALIGNMENT as usize + PAGE_HEADER_LEN + node * NODE_RECORD_LEN;
            for depth in [14, 15, 21, 22, 28, 29, 53, 127, 255] {
                let mut bytes = sound.to_vec();
                bytes[at] = depth;
                page_checksums::correct(&mut bytes);
                assert!(!check(&bytes, &path), "node {node}, depth {depth}");
            }
        }
    }
}

#[test]
fn a_file_truncated_while_it_is_open_gives_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("open.df");
    std::fs::write(&path, sound(Has::Nothing)).unwrap();
    let file = PageFile::open(&path).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(ALIGNMENT + 10).unwrap();
    assert!(file.read_page(PageId(0)).unwrap_err().to_string().contains("open.df"));
}

#[test]
fn what_is_no_page_file_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other");
    std::fs::write(&path, b"\x89HDF\r\n\x1a\nand so on").unwrap();
    for path in [path.as_path(), folder.path(), Path::new("/nowhere/at.df")] {
        let message = PageFile::open(path).unwrap_err().to_string();
        assert!(message.contains(path.to_str().unwrap()) && !message.contains('\n'), "{message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..crate::cases::cases(1500) })]

    #[test]
    fn forged_files_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u32>(), Just(0), Just(u32::MAX), 0..300_u32], 1..5_usize), 1..5),
        in_footer: bool,
        has in prop::sample::select(KINDS.to_vec()),
    ) {
        let mut bytes = sound(has).to_vec();
        let footer = u64::from_le_bytes(bytes[24..32].try_into().unwrap()) as usize;
        for (at, value, width) in changes {
            let range = if in_footer { footer..bytes.len() } else { 0..bytes.len() };
            let at = range.start + at.index(range.len());
            bytes[at..].iter_mut().zip(value.to_le_bytes()).take(width).for_each(|(place, byte)| *place = byte);
        }
        page_checksums::correct(&mut bytes);
        let folder = tempfile::tempdir().unwrap();
        check(&bytes, &folder.path().join("forged.df"));
    }
}
