//! Plots as tables.

use super::{Plot, density_unit, named};
use crate::explore::binned::Weight;
use crate::explore::bins::edges;
use crate::explore::histogram::Axis;
use crate::explore::radial::Radial;
use std::fmt::Write as _;

impl Plot {
    /// The table, with a header that has names and units. Of an estimate a comment goes before it (a line that begins with #), and each bin
    /// has its error.
    pub fn csv(&self) -> String {
        match self {
            Plot::Binned(found) => {
                let ends = |axis: &Axis| ["from", "to"].map(|end| named(&format!("{} {end}", axis.field), &axis.unit));
                let mut columns: Vec<String> = found.axes.iter().flat_map(ends).collect();
                let is_count = found.weight == Weight::Count;
                // A count is there once.
                columns.extend((!is_count).then(|| named(&found.weight.to_string(), &found.weight_unit)));
                if found.estimate.is_some() {
                    columns.push(named(&format!("error of {}", found.weight), &found.weight_unit));
                }
                columns.push("count".into());
                let mut table = self.table(&columns);
                let all: Vec<Vec<f64>> = found.axes.iter().map(edges).collect();
                for (cell, (&weight, &count)) in found.weights.iter().zip(&found.counts).enumerate() {
                    // Most pairs of bins hold nothing.
                    if count == 0 && weight == 0.0 && all.len() > 1 {
                        continue;
                    }
                    let mut rest = cell;
                    let mut row = [None; 6];
                    let mut length = 0;
                    for edges in &all {
                        let bin = rest % (edges.len() - 1);
                        rest /= edges.len() - 1;
                        row[length..length + 2].copy_from_slice(&[Some(edges[bin]), Some(edges[bin + 1])]);
                        length += 2;
                    }
                    if !is_count {
                        row[length] = Some(weight);
                        length += 1;
                    }
                    if let Some(estimate) = &found.estimate {
                        row[length] = estimate.errors.get(cell).copied();
                        length += 1;
                    }
                    table.row(&row[..length], Some(count));
                }
                table.text
            }
            Plot::Scatter { fields, x, y, .. } => {
                let mut table = self.table(&fields.each_ref().map(|axis| named(&axis.field, &axis.unit)));
                x.iter().zip(y).for_each(|(&x, &y)| table.row(&[Some(x), Some(y)], None));
                table.text
            }
            Plot::Radial(found) => {
                let Radial { length_unit: length, mass_unit: mass, field_unit, estimate, .. } = found;
                let density = density_unit(mass, length);
                let mut columns = vec![
                    named("radius from", length),
                    named("radius to", length),
                    named("mass", mass),
                    named("density", &density),
                ];
                if estimate.is_some() {
                    columns.extend([named("error of mass", mass), named("error of density", &density)]);
                }
                if let Some(field) = &found.field {
                    let of = ["mean", "dispersion", "mass-weighted mean", "mass-weighted dispersion"];
                    columns.extend(of.map(|what| named(&format!("{what} {field}"), field_unit)));
                    let errors = ["error of mean", "error of mass-weighted mean"].into_iter();
                    columns.extend(
                        errors.filter(|_| estimate.is_some()).map(|what| named(&format!("{what} {field}"), field_unit)),
                    );
                }
                columns.push("count".into());
                let mut table = self.table(&columns);
                for (index, shell) in found.shells.iter().enumerate() {
                    let mut row = vec![Some(shell.from), Some(shell.to), Some(shell.mass), Some(shell.density)];
                    if let Some(estimate) = estimate {
                        let error = estimate.of_masses.errors.get(index).copied();
                        row.extend([error, error.map(|error| error / shell.volume())]);
                    }
                    if found.field.is_some() {
                        row.extend([shell.mean, shell.dispersion]);
                        row.extend([shell.mass_weighted_mean, shell.mass_weighted_dispersion]);
                        let errors = estimate.iter().flat_map(|of| [&of.mean_errors, &of.mass_weighted_mean_errors]);
                        row.extend(errors.map(|errors| errors.get(index).copied().flatten()));
                    }
                    table.row(&row, Some(shell.count));
                }
                table.text
            }
        }
    }

    /// A table without rows, below what is to be said of an estimate.
    fn table(&self, columns: &[String]) -> Table {
        let mut table = Table::new(columns);
        if let Some(words) = self.estimate_in_words() {
            table.text.insert_str(0, &format!("# {words}\n"));
        }
        table
    }
}

/// Rows of a table with a header.
struct Table {
    text: String,
}

impl Table {
    fn new(columns: &[String]) -> Table {
        let quoted = |name: &String| {
            let plain = !name.contains([',', '"', '\n', '\r']);
            if plain { name.clone() } else { format!("\"{}\"", name.replace('"', "\"\"").replace(['\n', '\r'], " ")) }
        };
        Table { text: columns.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n" }
    }

    /// Adds a row of numbers, each with as many digits as it takes to read the same one back; `None` is left empty.
    fn row(&mut self, values: &[Option<f64>], count: Option<u64>) {
        for (i, value) in values.iter().enumerate() {
            if i > 0 {
                self.text.push(',');
            }
            // Writing to a string cannot fail.
            let _ = value.iter().try_for_each(|value| write!(self.text, "{value:?}"));
        }
        let _ = count.iter().try_for_each(|count| write!(self.text, ",{count}"));
        self.text.push('\n');
    }
}
