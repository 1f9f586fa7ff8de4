//! Lines of equal height, written as vectors.

use crate::color::output::OutputError;
use crate::commands::contours::Arguments;
use crate::commands::{CommandResult, print_line};
use crate::heights::measure::{Contour, ContourError, GeoJson, Part, contours, levels};
use crate::heights::model::Heights;
use crate::model::new_file;
use std::io::{BufWriter, Write};
use std::path::Path;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Finds and writes the lines.
///
/// # Errors
/// When the heights cannot be read, or the file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, interval, base, heights, output } = arguments;
    let open = heights.open(path)?;
    let summary = open.summary()?;
    let wanted = levels([summary.min, summary.max], *interval, *base)?;
    let ending = output.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    let closed = Part::closed(&open);
    let field = closed.as_ref().map_or(&open as &dyn Heights, |closed| closed);
    let write: fn(&dyn Heights, &[f64], &mut dyn Write) -> Result<usize, ContourError> = match ending.as_str() {
        "geojson" | "json" => write_geojson,
        "csv" => write_csv,
        "svg" => write_svg,
        _ => return Err(format!("{}: expected a name that ends in .geojson, .csv or .svg", output.display()).into()),
    };
    let refused = |error: std::io::Error| named(output, error.into());
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = new_file::builder().tempfile_in(folder);
    let mut file = file.map_err(|error| refused(new_file::without_name(&error)))?;
    let count = {
        let mut out = BufWriter::new(file.as_file_mut());
        let count = write(field, &wanted, &mut out).map_err(|error| named(output, error))?;
        out.flush().map_err(refused)?;
        count
    };
    file.persist(output).map_err(|error| refused(error.error))?;
    print_line(format_args!("{count} lines at {} heights in {}", wanted.len(), output.display()))?;
    Ok(())
}

/// Why there are no lines, with the name of the file that cannot take them.
fn named(output: &Path, error: ContourError) -> Failure {
    match error {
        ContourError::Io(source) => OutputError::Io { path: output.into(), source }.into(),
        error => error.into(),
    }
}

fn write_geojson(field: &dyn Heights, wanted: &[f64], out: &mut dyn Write) -> Result<usize, ContourError> {
    let mut count = 0;
    let mut writer = GeoJson::new(out, field.grid())?;
    contours(field, wanted, |line| {
        count += 1;
        writer.line(&line)
    })?;
    writer.finish()?;
    Ok(count)
}

fn write_csv(field: &dyn Heights, wanted: &[f64], out: &mut dyn Write) -> Result<usize, ContourError> {
    let mut count = 0;
    writeln!(out, "line,level,x,y")?;
    contours(field, wanted, |Contour { level, points }| {
        count += 1;
        points.iter().try_for_each(|[x, y]| writeln!(out, "{count},{level},{x},{y}"))
    })?;
    Ok(count)
}

/// Pictures are so wide, in their own units.
const WIDTH: f64 = 1000.0;

fn write_svg(field: &dyn Heights, wanted: &[f64], out: &mut dyn Write) -> Result<usize, ContourError> {
    let grid = field.grid();
    let (from, to) = (grid.place(0.0, 0.0), grid.place(grid.rows as f64 - 1.0, grid.columns as f64 - 1.0));
    let low = [from[0].min(to[0]), from[1].min(to[1])];
    let size = [(to[0] - from[0]).abs(), (to[1] - from[1]).abs()];
    let scale = WIDTH / size[0].max(size[1]);
    let [width, height] = size.map(|side| side * scale);
    writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.2} {height:.2}\" fill=\"none\" stroke=\"black\" stroke-width=\"0.8\">"
    )?;
    let mut count = 0;
    contours(field, wanted, |line| {
        count += 1;
        write!(out, "<path d=\"")?;
        for (number, [x, y]) in line.points.iter().enumerate() {
            let letter = if number == 0 { "M" } else { "L" };
            // Up in the picture is up in y.
            write!(out, "{letter}{:.2} {:.2}", (x - low[0]) * scale, height - (y - low[1]) * scale)?;
        }
        let end = if line.is_closed() { "Z" } else { "" };
        writeln!(out, "{end}\"><title>{}</title></path>", line.level)
    })?;
    writeln!(out, "</svg>")?;
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_with_the_name_of_the_file() {
        let full = std::io::Error::other("no space left");
        let told = named(Path::new("lines.csv"), full.into()).to_string();
        assert_eq!(told, "lines.csv: cannot be written: no space left");
    }
}
