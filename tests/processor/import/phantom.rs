//! PHANTOM: full and small dumps, both byte orders, both precisions. Families follow from types, masses and densities from the header.

use super::writers::file;
use super::{message, read_all};
use deepfield::import::{FieldKind, LoadOptions, load, open, summarize};
use proptest::prelude::*;
use std::collections::BTreeMap;

const HFACT: f64 = 1.2;
/// Masses of types 1 to 7.
const MASSES: [f64; 7] = [0.5, 0.0, 0.25, 2.0, 4.0, 8.0, 16.0];

/// Id of the first particle, beyond what single and double precision hold; others count on.
const FIRST_ID: u64 = (1 << 60) + 1;

/// What is written of a particle: its type, position and smoothing length.
type Particle = (i8, [f32; 3], f32);

#[derive(Clone, Copy, Debug)]
struct Style {
    big: bool,
    double: bool,
}

impl Style {
    fn word(self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if self.big {
            bytes.reverse();
        }
        bytes
    }

    fn whole(self, value: i32) -> Vec<u8> {
        self.word(&value.to_le_bytes())
    }

    /// A number of default precision.
    fn real(self, value: f64) -> Vec<u8> {
        if self.double { self.word(&value.to_le_bytes()) } else { self.single(value as f32) }
    }

    fn single(self, value: f32) -> Vec<u8> {
        self.word(&value.to_le_bytes())
    }
}

/// A dump of particles and sinks, which are positions and radii.
fn phantom(style: Style, particles: &[Particle], sinks: &[([f32; 3], f32)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut record = |content: Vec<u8>| {
        let length = style.whole(content.len() as i32);
        bytes.extend([length.clone(), content, length].concat());
    };
    let tag = |name: &str| format!("{name:<16}").into_bytes();
    let [first, second, third] = [60_769, 60_878, 690_706].map(|number| style.whole(number));
    record([first, style.real(60_878.0), second, style.whole(1), third].concat());
    record(format!("{:<100}", "FT:Phantom:1.0 (test)").into_bytes());
    // The header: default whole numbers, five kinds of whole numbers, default reals, single and double precision.
    record(style.whole(2));
    record([tag("nparttot"), tag("ntypes")].concat());
    record([style.whole(particles.len() as i32), style.whole(7)].concat());
    (0..4).for_each(|_| record(style.whole(0)));
    record(style.whole(9));
    let names = ["time", "hfact"].into_iter().chain(["massoftype"; 7]);
    record(names.flat_map(tag).collect());
    record([1.5, HFACT].into_iter().chain(MASSES).flat_map(|value| style.real(value)).collect());
    record(style.whole(0));
    record(style.whole(1));
    record(tag("udist"));
    record(style.word(&1.495_978_707e13_f64.to_le_bytes()));
    // Blocks: default whole numbers, those of 1, 2, 4 and 8 bytes, default reals, single and double precision.
    record(style.whole(2));
    for (count, arrays) in [(particles.len(), [0, 1, 0, 0, 1, 3, 1, 0]), (sinks.len(), [0, 0, 0, 0, 0, 5, 0, 0])] {
        let numbers = arrays.into_iter().flat_map(|number| style.whole(number));
        record(style.word(&(count as i64).to_le_bytes()).into_iter().chain(numbers).collect());
    }
    let mut array = |name: &str, content: Vec<u8>| {
        record(tag(name));
        record(content);
    };
    array("itype", particles.iter().map(|particle| particle.0 as u8).collect());
    array("iorig", (FIRST_ID..).take(particles.len()).flat_map(|id| style.word(&id.to_le_bytes())).collect());
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        array(name, particles.iter().flat_map(|particle| style.real(f64::from(particle.1[axis]))).collect());
    }
    array("h", particles.iter().flat_map(|particle| style.single(particle.2)).collect());
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        array(name, sinks.iter().flat_map(|sink| style.real(f64::from(sink.0[axis]))).collect());
    }
    array("m", sinks.iter().flat_map(|_| style.real(3.0)).collect());
    array("h", sinks.iter().flat_map(|sink| style.real(f64::from(sink.1))).collect());
    bytes
}

/// A small dump.
pub fn sample() -> Vec<u8> {
    let particle = |i: u8| ([1, 1, 7, -1][usize::from(i % 4)], [f32::from(i), f32::from(i % 7), f32::from(i % 5)], 0.5);
    let particles: Vec<Particle> = (0..40).map(particle).collect();
    phantom(Style { big: false, double: true }, &particles, &[([0.0; 3], 1.0)])
}

proptest! {
    #![proptest_config(crate::cases::cases(64))]

    #[test]
    fn what_is_written_comes_back(
        particles in prop::collection::vec((prop::sample::select(vec![1_i8, 1, 3, 4, 5, 7, -1]), any::<[i8; 3]>(), 1..40_i8), 1..12),
        sinks in prop::collection::vec((any::<[i8; 3]>(), 0..3_i8), 0..3),
        big in any::<bool>(),
        double in any::<bool>(),
        step in 1..4u64,
    ) {
        let eighths = |number: i8| f32::from(number) / 8.0;
        let particles: Vec<Particle> =
            particles.into_iter().map(|(kind, at, h)| (kind, at.map(eighths), eighths(h))).collect();
        let sinks: Vec<_> = sinks.into_iter().map(|(at, h)| (at.map(eighths), eighths(h))).collect();
        prop_assume!(!sinks.is_empty() || particles.iter().any(|particle| particle.0 > 0));
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "dump_00010", &phantom(Style { big, double }, &particles, &sinks));
        let source = open(&path).unwrap();
        let about = source.description();
        prop_assert_eq!((&*about.format, about.time, &*about.length_unit.0), ("phantom", Some(1.5), "au"));
        let mut expected: BTreeMap<&str, Vec<Particle>> = BTreeMap::new();
        let mut ids: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
        for (particle, id) in particles.iter().zip(FIRST_ID..) {
            let name = match particle.0 {
                1 => "gas",
                3 => "boundary",
                4 => "stars",
                5 => "dark",
                7 => "dust",
                _ => continue,
            };
            expected.entry(name).or_default().push(*particle);
            ids.entry(name).or_default().push(id);
        }
        prop_assert_eq!(about.families.len(), expected.len() + usize::from(!sinks.is_empty()));
        for (family, info) in about.families.iter().enumerate() {
            let read = |name: &str| read_all(source.as_ref(), family, name, step);
            if info.name.as_str() == "sinks" {
                prop_assert_eq!(read("mass"), vec![3.0; sinks.len()]);
                prop_assert_eq!(read("position"), sinks.iter().flat_map(|sink| sink.0.map(f64::from)).collect::<Vec<_>>());
                // Point masses have no size, so that none has.
                let has_sizes = sinks.iter().all(|sink| sink.1 > 0.0);
                prop_assert_eq!(info.find(FieldKind::SmoothingLength).is_some(), has_sizes);
                continue;
            }
            let particles = &expected[info.name.as_str()];
            prop_assert_eq!(info.count, particles.len() as u64);
            let positions: Vec<f64> = particles.iter().flat_map(|particle| particle.1.map(f64::from)).collect();
            prop_assert_eq!(read("position"), positions);
            let mut found = vec![0; particles.len()];
            source.read_ids(family, info.find(FieldKind::Id).unwrap(), 0..info.count, &mut found).unwrap();
            prop_assert_eq!(&found, &ids[info.name.as_str()]);
            let exact = |value: f64| if double { value } else { f64::from(value as f32) };
            let mass = exact(MASSES[particles[0].0 as usize - 1]);
            prop_assert_eq!(read("mass"), vec![mass; particles.len()]);
            let twice: Vec<f64> = particles.iter().map(|particle| 2.0 * f64::from(particle.2)).collect();
            prop_assert_eq!(read("smoothing-length"), twice);
            for (density, particle) in read("density").into_iter().zip(particles) {
                let stated = mass * (exact(HFACT) / f64::from(particle.2)).powi(3);
                prop_assert!((density / stated - 1.0).abs() < 1e-12, "{} for {}", density, stated);
            }
        }
    }
}

#[test]
fn a_shortened_dump_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let particles = [(1, [1.0, 2.0, 3.0], 0.5), (7, [4.0, 5.0, 6.0], 0.5)];
    for style in [Style { big: true, double: false }, Style { big: false, double: true }] {
        let bytes = phantom(style, &particles, &[([0.0; 3], 1.0)]);
        for length in 0..bytes.len() {
            let path = file(folder.path(), "short", &bytes[..length]);
            message(&summarize(&path).err().unwrap_or_else(|| panic!("{style:?}, {length} bytes")), &path);
        }
        let path = file(folder.path(), "whole", &bytes);
        assert_eq!(load(&path, &LoadOptions::default(), &()).unwrap().len(), 3);
    }
}

#[test]
fn a_dump_without_tags_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = sample();
    let at = bytes.windows(2).position(|pair| pair == b"FT").unwrap();
    bytes[at + 1] = b' ';
    let path = file(folder.path(), "old", &bytes);
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("tags"), "{text}");
}
