//! Containers that c-blosc made, which hold what the formula of `tests/data/make_blosc.py` says, and damaged ones.

use super::*;

/// A container of `tests/data/blosc`.
fn bytes_of(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/blosc");
    std::fs::read(folder.join(name)).unwrap()
}

fn content(length: usize) -> Vec<u8> {
    let numbers = (0..length as u32).map(|i| i % 32 * 1000 + i / 256);
    numbers.flat_map(u32::to_le_bytes).take(length).collect()
}

/// Containers and the bytes that are in them.
const CONTAINERS: [(&str, usize); 19] = [
    ("blosclz-plain", 5699),
    ("blosclz-bytes", 5699),
    ("blosclz-bits", 5699),
    ("lz4-plain", 5699),
    ("lz4-bytes", 5699),
    ("lz4-bits", 5699),
    ("lz4hc-plain", 5699),
    ("lz4hc-bytes", 5699),
    ("lz4hc-bits", 5699),
    ("zlib-plain", 5699),
    ("zlib-bytes", 5699),
    ("zlib-bits", 5699),
    ("zstd-plain", 5699),
    ("zstd-bytes", 5699),
    ("zstd-bits", 5699),
    ("snappy-bytes", 5699),
    ("odd-bits", 5703),
    ("copied", 100),
    ("blocks", 132_675),
];

/// The blocks of a container of `length` bytes, the last first.
fn unpacked(container: Vec<u8>, length: usize) -> Result<Vec<Vec<u8>>, ImportError> {
    let space = container.len() as u64;
    let storage = Storage::Memory(container);
    let place = Place { storage: &storage, path: Path::new("file"), field: "x", start: 0, space };
    let container = Container::open(place, length as u64)?;
    (0..(length as u64).div_ceil(container.block)).rev().map(|number| container.unpack(place, number)).collect()
}

#[test]
fn containers_hold_what_was_packed() {
    for (name, length) in CONTAINERS {
        let mut blocks = unpacked(bytes_of(&format!("{name}.blosc")), length).unwrap_or_else(|error| panic!("{error}"));
        let count = match name {
            "blocks" | "zstd-plain" | "zstd-bytes" | "zstd-bits" | "snappy-bytes" => 3,
            "copied" => 1,
            _ => 2,
        };
        assert_eq!(blocks.len(), count, "{name}");
        blocks.reverse();
        assert!(blocks.concat() == content(length), "{name}");
    }
}

#[test]
fn what_is_copied_is_read_in_pieces() {
    let length = 2 * PIECE as usize + 5;
    let head = [2, 1, COPIED, 4].into_iter();
    let numbers = [length as u32, length as u32, length as u32 + 16].into_iter().flat_map(u32::to_le_bytes);
    let mut blocks = unpacked(head.chain(numbers).chain(content(length)).collect(), length).unwrap();
    assert_eq!(blocks.iter().map(Vec::len).collect::<Vec<_>>(), [5, PIECE as usize, PIECE as usize]);
    blocks.reverse();
    assert!(blocks.concat() == content(length));
}

#[test]
fn shortened_and_altered_containers_are_survived() {
    // One of each codec, and of each order.
    for name in ["blosclz-bytes", "lz4-bits", "snappy-bytes", "zlib-bytes", "zstd-bits", "copied"] {
        let length = if name == "copied" { 100 } else { 5699 };
        let bytes = bytes_of(&format!("{name}.blosc"));
        for end in 0..bytes.len() {
            let error = unpacked(bytes[..end].to_vec(), length).unwrap_err().to_string();
            assert!(error.starts_with("file: x in BLOSC's container: found "), "{error}");
        }
        for place in 0..bytes.len() {
            for value in [0, 1, 0x7f, 0xff, bytes[place] ^ 1, bytes[place] ^ 0x80] {
                let mut altered = bytes.clone();
                altered[place] = value;
                if let Ok(blocks) = unpacked(altered, length) {
                    assert_eq!(blocks.iter().map(Vec::len).sum::<usize>(), length, "{name}");
                }
            }
        }
    }
}

#[test]
fn what_headers_may_not_say_is_told() {
    let altered = |place: usize, value: u8| {
        let mut bytes = bytes_of("lz4-bytes.blosc");
        bytes[place] = value;
        unpacked(bytes, 5699).unwrap_err().to_string()
    };
    for (place, value, expected) in [
        (0, 5, "found version 5, expected 2"),
        (2, 0x29, "found flags 0x29"),
        (2, 0xa1, "found flags 0xa1"),
        (3, 0, "with elements of 0"),
        (4, 0, "expected 5699"),
        (8, 0x42, "as LZ4 packs them"),
        (11, 0x7f, "expected blocks of 1 byte to 64 MiB"),
        (14, 1, "found a container of "),
    ] {
        let error = altered(place, value);
        assert!(error.contains(expected), "{error}");
    }
}

/// A small file cannot ask for much memory, whatever its frames make.
#[test]
fn streams_of_another_length_are_refused() {
    // A frame that says no length, with a window of 2 KiB; a block of 2048 times one byte, the last.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 8];
    frame.extend(&((2048_u32 << 3) | 3).to_le_bytes()[..3]);
    frame.push(9);
    let unpacked = |length: usize| {
        let mut out = vec![0; length];
        Codec::Zstandard.unpack(&frame, &mut out).map(|()| out)
    };
    assert_eq!(unpacked(2048), Some(vec![9; 2048]));
    assert!(unpacked(2047).is_none() && unpacked(2049).is_none());
}
