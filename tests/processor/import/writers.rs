//! Writers of the binary formats, for tests only.

use std::path::{Path, PathBuf};

/// The particles of one type in one file.
#[derive(Clone, Debug, Default)]
pub struct Particles {
    pub positions: Vec<[f64; 3]>,
    pub velocities: Vec<[f64; 3]>,
    pub ids: Vec<u64>,
    pub masses: Vec<f64>,
}

/// How a Gadget file is written.
#[derive(Clone, Copy, Debug)]
pub struct GadgetStyle {
    pub big_endian: bool,
    pub format: u32,
    pub double: bool,
    pub long_ids: bool,
    /// Mass of the header's table by type, 0 for a block.
    pub table: [f64; 6],
}

struct Writer {
    style: GadgetStyle,
    bytes: Vec<u8>,
}

impl Writer {
    fn u32(&mut self, value: u32) {
        self.bytes.extend(if self.style.big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
    }

    fn record(&mut self, label: &str, content: &[u8]) {
        if self.style.format == 2 {
            self.u32(8);
            self.bytes.extend(format!("{label:<4}").as_bytes());
            self.u32(content.len() as u32 + 8);
            self.u32(8);
        }
        self.u32(content.len() as u32);
        self.bytes.extend(content);
        self.u32(content.len() as u32);
    }
}

/// The bytes of one Gadget file; `totals` and `files` are those of the whole snapshot. Gas gets blocks U, RHO and HSML of its
/// masses plus 1, 2 and 3.
pub fn gadget(style: GadgetStyle, particles: &[Particles; 6], totals: [u32; 6], files: u32) -> Vec<u8> {
    let whole = |value: u32| if style.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let double = |value: f64| if style.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let long = |value: u64| if style.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let real = |value: f64| -> Vec<u8> {
        if style.double { double(value).to_vec() } else { whole((value as f32).to_bits()).to_vec() }
    };
    let mut header = Vec::new();
    particles.iter().for_each(|family| header.extend(whole(family.positions.len() as u32)));
    style.table.iter().for_each(|mass| header.extend(double(*mass)));
    [0.25, 3.0].iter().for_each(|value| header.extend(double(*value)));
    header.extend([0u8; 8]);
    totals.iter().for_each(|total| header.extend(whole(*total)));
    header.extend(whole(0));
    header.extend(whole(files));
    header.extend(double(100.0));
    header.resize(256, 0);
    let mut writer = Writer { style, bytes: Vec::new() };
    writer.record("HEAD", &header);
    let vectors = |pick: fn(&Particles) -> &Vec<[f64; 3]>| -> Vec<u8> {
        particles.iter().flat_map(pick).flatten().flat_map(|value| real(*value)).collect()
    };
    writer.record("POS", &vectors(|family| &family.positions));
    writer.record("VEL", &vectors(|family| &family.velocities));
    let ids = particles.iter().flat_map(|family| &family.ids);
    let id = |id: &u64| if style.long_ids { long(*id).to_vec() } else { whole(*id as u32).to_vec() };
    writer.record("ID", &ids.flat_map(id).collect::<Vec<u8>>());
    let with_block = particles.iter().zip(style.table).filter(|(_, mass)| *mass == 0.0);
    let masses: Vec<u8> = with_block.flat_map(|(family, _)| &family.masses).flat_map(|mass| real(*mass)).collect();
    if !masses.is_empty() {
        writer.record("MASS", &masses);
    }
    if !particles[0].positions.is_empty() {
        for (label, plus) in [("U", 1.0), ("RHO", 2.0), ("HSML", 3.0)] {
            let values: Vec<u8> = particles[0].masses.iter().flat_map(|mass| real(mass + plus)).collect();
            writer.record(label, &values);
        }
    }
    writer.bytes
}

/// Bytes of a Tipsy file of records of single-precision numbers: 12 for gas, 9 for dark, 11 for stars.
pub fn tipsy(big_endian: bool, padded: bool, records: [&[Vec<f32>]; 3]) -> Vec<u8> {
    let whole = |value: u32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut bytes = if big_endian { 0.5f64.to_be_bytes() } else { 0.5f64.to_le_bytes() }.to_vec();
    let total: usize = records.iter().map(|family| family.len()).sum();
    for count in [total, 3, records[0].len(), records[1].len(), records[2].len()] {
        bytes.extend(whole(count as u32));
    }
    if padded {
        bytes.extend([0u8; 4]);
    }
    for value in records.iter().flat_map(|family| family.iter()).flatten() {
        bytes.extend(whole(value.to_bits()));
    }
    bytes
}

/// A file of that name and content in a folder.
pub fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}
