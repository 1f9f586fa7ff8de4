//! Tipsy's binary snapshots in both byte orders: big-endian ("standard", XDR) and native little-endian, with a header of 28
//! or 32 bytes. After the header come all gas, then all dark, then all star particles, each a record of single-precision
//! numbers.
//!
//! Tipsy's `hsmooth` is half the support radius, so that it is doubled. Codes such as ChaNGa write the gravitational
//! softening there instead; a value that is the same for every gas particle is taken for that and not for a smoothing
//! length. A gas density that is the same for every particle is taken for the placeholder of initial conditions.

use super::bytes::{Number, Order, RangeFile, Records};
use super::check::chunks;
use super::{Description, FamilyInfo, Field, FieldKind, Format, ImportError, Source};
use crate::model::{FamilyName, ReadMethod, Unit};
use std::ops::Range;
use std::path::Path;

/// The Tipsy format.
pub(super) struct Tipsy;

/// One column of a record: standard name, Tipsy's name, kind, components.
type Layout = &'static [(&'static str, &'static str, FieldKind, usize)];

const GAS: Layout = &[
    ("mass", "mass", FieldKind::Mass, 1),
    ("position", "pos", FieldKind::Position, 3),
    ("velocity", "vel", FieldKind::Velocity, 3),
    ("density", "rho", FieldKind::Density, 1),
    ("temperature", "temp", FieldKind::Other, 1),
    ("smoothing-length", "hsmooth", FieldKind::SmoothingLength, 1),
    ("metallicity", "metals", FieldKind::Other, 1),
    ("potential", "phi", FieldKind::Other, 1),
];
const DARK: Layout = &[
    ("mass", "mass", FieldKind::Mass, 1),
    ("position", "pos", FieldKind::Position, 3),
    ("velocity", "vel", FieldKind::Velocity, 3),
    ("softening", "eps", FieldKind::Other, 1),
    ("potential", "phi", FieldKind::Other, 1),
];
const STARS: Layout = &[
    ("mass", "mass", FieldKind::Mass, 1),
    ("position", "pos", FieldKind::Position, 3),
    ("velocity", "vel", FieldKind::Velocity, 3),
    ("metallicity", "metals", FieldKind::Other, 1),
    ("formation-time", "tform", FieldKind::Other, 1),
    ("softening", "eps", FieldKind::Other, 1),
    ("potential", "phi", FieldKind::Other, 1),
];

/// The families in the order of the file.
const FAMILIES: [(FamilyName, Layout); 3] =
    [(FamilyName::Gas, GAS), (FamilyName::Dark, DARK), (FamilyName::Stars, STARS)];

/// Bytes of one particle's record.
fn record(layout: Layout) -> usize {
    layout.iter().map(|(.., components)| 4 * components).sum()
}

/// The header's numbers.
struct Header {
    order: Order,
    time: f64,
    /// Gas, dark, stars.
    counts: [u64; 3],
}

impl Header {
    /// Reads a header if these bytes are one: three counts that add up to the total, in one to three dimensions.
    fn parse(head: &[u8]) -> Option<Header> {
        Order::BOTH.into_iter().filter(|_| head.len() >= 28).find_map(|order| {
            let word = |index: usize| order.u32(head, 8 + 4 * index) as u64;
            let counts = [word(2), word(3), word(4)];
            let time = order.f64(head, 0);
            let fits = counts.iter().sum::<u64>() == word(0) && word(0) > 0 && (1..=3).contains(&word(1));
            (fits && time.is_finite()).then_some(Header { order, time, counts })
        })
    }
}

impl Format for Tipsy {
    fn name(&self) -> &'static str {
        "Tipsy"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["tipsy", "std"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        Header::parse(head).is_some()
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Snapshot::open(path, method)?))
    }
}

/// An opened snapshot.
struct Snapshot {
    file: RangeFile,
    order: Order,
    description: Description,
    families: Vec<Extent>,
}

/// Where a family is.
struct Extent {
    offset: u64,
    layout: Layout,
    /// By field: first byte in a record, and the factor on its values.
    columns: Vec<(usize, f64)>,
}

impl Snapshot {
    fn open(path: &Path, method: ReadMethod) -> Result<Snapshot, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        let mut head = vec![0u8; file.length.min(32) as usize];
        file.read(0, &mut head, "header")?;
        let Some(header) = Header::parse(&head) else {
            let expected = "a total that is the sum of gas, dark and star particles";
            return Err(ImportError::malformed(path, "header", "other counts", expected));
        };
        let body: u64 =
            header.counts.iter().zip(FAMILIES).map(|(count, (_, layout))| count * record(layout) as u64).sum();
        // A header of 28 bytes is followed by a mass: zeros there are the padding of a longer header in a file that lacks
        // its last 4 bytes.
        let padding = head.get(28..32) == Some(&[0; 4]);
        let start = if padding { &[32][..] } else { &[32, 28] };
        let start = start.iter().copied().find(|start| start + body == file.length).ok_or_else(|| {
            let [gas, dark, stars] = header.counts;
            let found = format!("{} bytes", file.length);
            let expected =
                format!("{} or {} bytes for {gas} gas, {dark} dark and {stars} star particles", body + 28, body + 32);
            ImportError::malformed(path, "file length", found, expected)
        })?;
        let mut description =
            Description { time: Some(header.time), ..Description::unitless(path, "tipsy", file.length) };
        let mut families = Vec::new();
        let mut offset = start;
        for (count, (name, layout)) in header.counts.into_iter().zip(FAMILIES) {
            if count > 0 {
                let fields = layout.iter().map(|(name, stored_as, kind, components)| Field {
                    name: (*name).into(),
                    stored_as: (*stored_as).into(),
                    unit: Unit::default(),
                    components: *components,
                    kind: *kind,
                });
                description.families.push(FamilyInfo { name, count, fields: fields.collect() });
                let starts = (0..layout.len()).map(|field| (record(&layout[..field]), 1.0)).collect();
                families.push(Extent { offset, layout, columns: starts });
            }
            offset += count * record(layout) as u64;
        }
        let mut snapshot = Snapshot { file, order: header.order, description, families };
        snapshot.judge_gas()?;
        Ok(snapshot)
    }

    /// Decides what `hsmooth` and `rho` of gas are (see the top of this file).
    fn judge_gas(&mut self) -> Result<(), ImportError> {
        let Some(family) = self.description.families.iter().position(|info| info.name == FamilyName::Gas) else {
            return Ok(());
        };
        let find = |kind| self.description.families[family].find(kind);
        let (smoothing, density) = (find(FieldKind::SmoothingLength), find(FieldKind::Density));
        if let Some(field) = smoothing {
            if self.is_constant(family, field)? {
                let changed = &mut self.description.families[family].fields[field];
                (changed.name, changed.kind) = ("softening".into(), FieldKind::Other);
                let note = "gas: hsmooth is the same for all particles and is taken for the gravitational softening";
                self.description.notes.push(note.into());
            } else {
                self.families[family].columns[field].1 = 2.0;
                self.description.notes.push("gas: hsmooth is doubled to give the support radius".into());
            }
        }
        if let Some(field) = density
            && self.is_constant(family, field)?
        {
            let changed = &mut self.description.families[family].fields[field];
            (changed.name, changed.kind) = ("rho".into(), FieldKind::Other);
            self.description.notes.push("gas: rho is the same for all particles and is taken for a placeholder".into());
        }
        Ok(())
    }

    /// Whether a field has one value for all of several particles; stops at the first that differs.
    fn is_constant(&self, family: usize, field: usize) -> Result<bool, ImportError> {
        let mut values = Vec::new();
        let mut first = None;
        let count = self.description.families[family].count;
        for range in chunks(count) {
            values.resize((range.end - range.start) as usize, 0.0);
            self.read(family, field, range, &mut values)?;
            let value = *first.get_or_insert(values.first().copied().unwrap_or_default());
            if values.iter().any(|other| *other != value) {
                return Ok(false);
            }
        }
        Ok(count > 1)
    }
}

impl Source for Snapshot {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let info = self.description.check_range(family, field, &range, out.len())?;
        let extent = &self.families[family];
        let stride = record(extent.layout);
        let (column, factor) = extent.columns[field];
        let records = Records { number: Number::F32, order: self.order, stride, column, components: info.components };
        self.file.decode(extent.offset + range.start * stride as u64, records, out, &info.stored_as)?;
        if factor != 1.0 {
            out.iter_mut().for_each(|value| *value *= factor);
        }
        Ok(())
    }
}
