//! A volume's voxels as particles, or an image's pixels: what is drawn, asked and followed as particles are, a volume beside them too.
//!
//! A voxel becomes a particle of its value as density and its value times its volume as mass, with a kernel wide enough that neighbours add up
//! to the value again. What is air around a volume is left out.

use super::super::{Description, FamilyInfo, Field, FieldKind, Format, ImportError, Source};
use super::slices::pictures_in;
use super::{GridOptions, GridSource, open_grid, summarize_grid};
use crate::model::{FamilyName, Grid, ReadMethod, Region, Unit};
use glam::DVec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Values of volumes above the least one by no more than this share of the range are air.
pub const AIR: f64 = 0.02;
/// Support radius of a voxel's kernel, in the largest distance of neighbours: from here on the kernels of a grid add up to one within a
/// hundredth.
pub const SUPPORT: f64 = 2.2;

/// Volumes and images as particles. Their content is told as that of grids is, before any format of particles is asked.
pub(in crate::import) struct Voxels;

impl Format for Voxels {
    fn name(&self) -> &'static str {
        "voxels"
    }

    fn recognise(&self, _: &[u8], _: u64) -> bool {
        false
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(VoxelSource::open(path, method)?))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        if path.is_dir() { pictures_in(path) } else { Ok(vec![path.to_owned()]) }
    }
}

/// What a field of voxels is.
#[derive(Clone, Copy)]
enum Column {
    Position,
    Mass,
    SmoothingLength,
    Density,
    /// The value of a channel.
    Channel(usize),
}

/// An opened volume whose voxels are particles, or an image whose pixels are.
struct VoxelSource {
    source: GridSource,
    description: Description,
    columns: Vec<Column>,
    /// How many voxels there are before each row of samples, and in all.
    before: Vec<u64>,
    /// Values up to this are air, of volumes, and what is added to the others so that they are positive.
    air: Option<f64>,
    lifted: f64,
}

impl VoxelSource {
    fn open(path: &Path, method: ReadMethod) -> Result<VoxelSource, ImportError> {
        let source = open_grid(path, &GridOptions { read: method, ..GridOptions::default() })?;
        let (grid, about) = (source.grid().clone(), source.description().clone());
        let summary = summarize_grid(&source)?;
        let channel = &summary.channels[0];
        let (Some(min), Some(max)) = (channel.min, channel.max) else {
            return Err(ImportError::malformed(path, "samples", "no number", "at least one"));
        };
        let air = (grid.dimensions == 3).then_some(min + AIR * (max - min));
        let lifted = if min < 0.0 { -min } else { 0.0 };
        let mut voxels = VoxelSource {
            description: Description::unitless(path, "voxels", about.bytes),
            source,
            columns: Vec::new(),
            before: Vec::new(),
            air,
            lifted,
        };
        voxels.count(&grid)?;
        let count = voxels.before.last().copied().unwrap_or(0);
        if count == 0 {
            return Err(ImportError::malformed(path, "samples", "the same value everywhere", "some above the others"));
        }
        let field = |name: &str, stored_as: &str, unit: Unit, components: usize, kind: FieldKind| Field {
            name: name.into(),
            stored_as: stored_as.into(),
            unit,
            components,
            kind,
        };
        let (length, value) = (grid.length_unit.clone(), grid.channels[0].unit.clone());
        let mut fields = vec![
            (Column::Position, field("position", "index", length.clone(), 3, FieldKind::Position)),
            (Column::Mass, field("mass", "value", Unit::default(), 1, FieldKind::Mass)),
            (
                Column::SmoothingLength,
                field("smoothing-length", "spacing", length.clone(), 1, FieldKind::SmoothingLength),
            ),
            (Column::Density, field("density", "value", value, 1, FieldKind::Density)),
        ];
        for (index, channel) in grid.channels.iter().enumerate() {
            let own = field(&channel.name, &channel.name, channel.unit.clone(), 1, FieldKind::Other);
            fields.push((Column::Channel(index), own));
        }
        let description = &mut voxels.description;
        (description.files, description.length_unit) = (about.files, length);
        description.notes = about.notes;
        let all: u64 = grid.shape.iter().product();
        description.notes.push(match air {
            Some(air) => format!("{count} of {all} voxels, whose values are above {air}; the others count as air"),
            None => format!("{count} of {all} pixels"),
        });
        if lifted > 0.0 {
            description.notes.push(format!("densities are values and {lifted}, so that none is negative"));
        }
        let (columns, fields) = fields.into_iter().unzip();
        voxels.columns = columns;
        voxels.description.families.push(FamilyInfo { name: FamilyName::Gas, count, fields });
        Ok(voxels)
    }

    /// Counts the voxels of each row.
    fn count(&mut self, grid: &Grid) -> Result<(), ImportError> {
        let mut before = Vec::with_capacity((grid.shape[1] * grid.shape[2]) as usize + 1);
        before.push(0);
        let mut total = 0;
        let (mut samples, mut values) = (Vec::new(), Vec::new());
        for z in 0..grid.shape[2] {
            self.values(&grid.region().with(2, z..z + 1), 0, &mut samples, &mut values)?;
            for row in values.chunks(grid.shape[0] as usize) {
                total += row.iter().filter(|value| self.is_voxel(**value)).count() as u64;
                before.push(total);
            }
        }
        self.before = before;
        Ok(())
    }

    fn is_voxel(&self, value: f64) -> bool {
        value.is_finite() && self.air.is_none_or(|air| value > air)
    }

    /// The values of a channel in a box; NaN where there is none.
    fn values(
        &self,
        region: &Region,
        channel: usize,
        samples: &mut Vec<u8>,
        values: &mut Vec<f64>,
    ) -> Result<(), ImportError> {
        let grid = self.source.grid();
        let bytes = region.shape().iter().product::<u64>() * grid.sample_bytes();
        samples.resize(bytes as usize, 0);
        self.source.read(region, samples)?;
        values.clear();
        let about = &grid.channels[channel];
        let offset = channel * grid.sample_type.size();
        grid.sample_type.decode(samples.get(offset..).unwrap_or_default(), grid.channels.len(), values);
        for value in values {
            *value = if about.no_data == Some(*value) { f64::NAN } else { about.scale.value(*value) };
        }
        Ok(())
    }
}

impl Source for VoxelSource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        let (grid, column) = (self.source.grid(), self.columns[field]);
        let volume = grid.to_world.matrix3.determinant().abs();
        let support = SUPPORT * grid.spacing().into_iter().fold(0.0, f64::max);
        let (mut samples, mut shown, mut wanted) = (Vec::new(), Vec::new(), Vec::new());
        let mut out = out.chunks_mut(if matches!(column, Column::Position) { 3 } else { 1 });
        // Whole rows, of which the first and the last may be wanted in part.
        let mut row = self.before.partition_point(|before| *before <= range.start).saturating_sub(1) as u64;
        while row + 1 < self.before.len() as u64 && self.before[row as usize] < range.end {
            let (y, z) = (row % grid.shape[1], row / grid.shape[1]);
            let rows = (grid.shape[1] - y).min(256);
            let region = grid.region().with(1, y..y + rows).with(2, z..z + 1);
            self.values(&region, 0, &mut samples, &mut shown)?;
            if let Column::Channel(channel) = column {
                self.values(&region, channel, &mut samples, &mut wanted)?;
            }
            let voxels = shown.iter().enumerate().filter(|(_, value)| self.is_voxel(**value));
            for (number, (index, value)) in (self.before[row as usize]..).zip(voxels) {
                if !range.contains(&number) {
                    continue;
                }
                let Some(out) = out.next() else { break };
                match column {
                    Column::Position => {
                        let (x, y) = (index as u64 % grid.shape[0], y + index as u64 / grid.shape[0]);
                        let place = grid.to_world.transform_point3(DVec3::new(x as f64, y as f64, z as f64));
                        out.copy_from_slice(&place.to_array());
                    }
                    Column::Mass => out[0] = (value + self.lifted) * volume,
                    Column::SmoothingLength => out[0] = support,
                    Column::Density => out[0] = value + self.lifted,
                    Column::Channel(_) => out[0] = wanted[index],
                }
            }
            row += rows;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_are_where_their_samples_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.nrrd");
        let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\nspace dimension: 3\n\
                      space directions: (2,0,0) (0,3,0) (0,0,1)\nspace origin: (10,20,30)\n\n";
        let samples: Vec<u8> = (0..60).map(|i| if i % 7 == 3 { 100 + i } else { 0 }).collect();
        std::fs::write(&path, [header.as_bytes(), &samples].concat()).unwrap();
        let source = VoxelSource::open(&path, ReadMethod::default()).unwrap();
        let about = source.description();
        let expected: Vec<u64> = (0..60).filter(|i| i % 7 == 3).collect();
        assert_eq!(about.particles(), expected.len() as u64);
        let fields = &about.families[0].fields;
        let column = |name: &str, range: Range<u64>| {
            let field = fields.iter().position(|field| field.name == name).unwrap();
            let mut out = vec![0.0; (range.end - range.start) as usize * fields[field].components];
            source.read(0, field, range, &mut out).unwrap();
            out
        };
        // In two parts, so that one begins within a row.
        let places = [column("position", 0..4), column("position", 4..expected.len() as u64)].concat();
        for (place, i) in places.chunks(3).zip(&expected) {
            let at = [10 + 2 * (i % 5), 20 + 3 * (i / 5 % 4), 30 + i / 20].map(|x| x as f64);
            assert_eq!(place, at);
        }
        let mass = column("mass", 0..expected.len() as u64);
        assert!(mass.iter().zip(&expected).all(|(mass, i)| *mass == 6.0 * (100 + i) as f64));
        assert_eq!(column("value", 1..2), [110.0]);
        assert_eq!(column("smoothing-length", 0..1), [SUPPORT * 3.0]);
    }
}
