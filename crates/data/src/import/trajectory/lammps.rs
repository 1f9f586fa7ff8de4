//! Text dumps of LAMMPS (`dump atom` and `dump custom`): frames of items, `ITEM: NAME` and what it is in the lines after.
//!
//! Boxes are orthogonal (`BOX BOUNDS pp pp ff`), inclined (`BOX BOUNDS xy xz yz pp pp pp`, whose bounds are those of the box around
//! it) or general (`BOX BOUNDS abc origin pp pp pp`). Of the columns of `ATOMS`, places are the first of `x y z`, `xs ys zs` (scaled), `xu yu
//! zu` (unwrapped), `xsu ysu zsu` (both) that are there. Rows may come in any order.

use super::cell::Cell;
use super::columns::{Layout, Named, Role, Units, Word, role_of};
use super::lines::Lines;
use super::row::{number, words};
use super::{Damage, Head, Stop, Text, quoted};
use crate::import::{FieldKind, text_head};
use std::sync::Arc;

/// The format.
pub(in crate::import) struct LammpsDump;

/// Units by the name of the style, as the manual's page `units` has them.
const STYLES: &[(&str, Units)] = &[
    ("lj", Units { length: "", velocity: "", mass: "" }),
    ("real", Units { length: "Angstrom", velocity: "Angstrom/fs", mass: "u" }),
    ("metal", Units { length: "Angstrom", velocity: "Angstrom/ps", mass: "u" }),
    ("si", Units { length: "m", velocity: "m/s", mass: "kg" }),
    ("cgs", Units { length: "cm", velocity: "cm/s", mass: "g" }),
    ("electron", Units { length: "Bohr", velocity: "Bohr/(1.03275e-15 s)", mass: "u" }),
    ("micro", Units { length: "um", velocity: "um/us", mass: "pg" }),
    ("nano", Units { length: "nm", velocity: "nm/ns", mass: "ag" }),
];

/// Three columns that are one vector: its name here, what it is, whether places are scaled and unwrapped.
struct Vector(&'static str, [&'static str; 3], Role, bool);

/// The vectors; places in the order in which they are preferred.
const VECTORS: &[Vector] = &[
    Vector("position", ["x", "y", "z"], Role::Position { is_scaled: false }, false),
    Vector("position", ["xs", "ys", "zs"], Role::Position { is_scaled: true }, false),
    Vector("position", ["xu", "yu", "zu"], Role::Position { is_scaled: false }, true),
    Vector("position", ["xsu", "ysu", "zsu"], Role::Position { is_scaled: true }, true),
    Vector("image", ["ix", "iy", "iz"], Role::Image, false),
    Vector("velocity", ["vx", "vy", "vz"], Role::Velocity, false),
    Vector("force", ["fx", "fy", "fz"], Role::Quantity("force", FieldKind::Other), false),
    Vector("dipole", ["mux", "muy", "muz"], Role::Quantity("dipole", FieldKind::Other), false),
    Vector(
        "angular-velocity",
        ["omegax", "omegay", "omegaz"],
        Role::Quantity("angular-velocity", FieldKind::Other),
        false,
    ),
    Vector(
        "angular-momentum",
        ["angmomx", "angmomy", "angmomz"],
        Role::Quantity("angular-momentum", FieldKind::Other),
        false,
    ),
    Vector("torque", ["tqx", "tqy", "tqz"], Role::Quantity("torque", FieldKind::Other), false),
];

fn begins_frame(line: &[u8]) -> bool {
    // TIME and TIMESTEP.
    line.starts_with(b"ITEM: TIME") || line.starts_with(b"ITEM: UNITS")
}

impl Text for LammpsDump {
    fn name(&self) -> &'static str {
        "lammps-dump"
    }

    fn title(&self) -> &'static str {
        "LAMMPS text dump"
    }

    fn endings(&self) -> &'static [&'static str] {
        &["dump", "lammpstrj"]
    }

    fn recognise(&self, head: &[u8]) -> bool {
        text_head(head).is_some_and(|text| begins_frame(text.as_bytes()))
    }

    fn keeps_rows(&self) -> bool {
        false
    }

    fn begins(&self, line: &[u8]) -> bool {
        begins_frame(line)
    }

    fn head(&self, lines: &mut Lines, before: Option<&Arc<Layout>>) -> Result<Option<Head>, Stop> {
        // Units are stated once, before the first frame.
        let mut units = before.and_then(|before| before.units);
        let (mut time, mut number, mut count, mut cell) = (None, None, None, None);
        let mut is_begun = false;
        loop {
            let Some(line) = lines.next()?.map(<[u8]>::to_vec) else {
                let ended = || Damage::new("items", "the end of the file", "ITEM: ATOMS and rows");
                return if is_begun { Err(ended().into()) } else { Ok(None) };
            };
            if line.iter().all(u8::is_ascii_whitespace) {
                continue;
            }
            is_begun = true;
            let at = lines.number;
            let field = |what: &str| format!("line {at}: {what}");
            let item = line
                .strip_prefix(b"ITEM: ")
                .ok_or_else(|| Damage::new(field("item"), quoted(&line), "ITEM: and its name"))?;
            let name: Vec<&[u8]> = words(item).collect();
            match name[..] {
                [b"UNITS"] => {
                    let style = next(lines, "UNITS")?;
                    let known = STYLES.iter().find(|(known, _)| known.as_bytes() == style.trim_ascii());
                    let expected = "lj, real, metal, si, cgs, electron, micro or nano";
                    units = Some(known.ok_or_else(|| Damage::new(field("UNITS"), quoted(&style), expected))?.1);
                }
                [b"TIME"] => time = Some(one(&next(lines, "TIME")?, lines, "TIME")?),
                [b"TIMESTEP"] => {
                    if number.is_some() {
                        // The frame before was cut off before its rows.
                        lines.back();
                        return Err(Damage::new(field("item"), "another frame", "ITEM: ATOMS and rows").into());
                    }
                    number = Some(one(&next(lines, "TIMESTEP")?, lines, "TIMESTEP")?);
                }
                [b"NUMBER", b"OF", b"ATOMS"] => {
                    let stated = next(lines, "NUMBER OF ATOMS")?;
                    let parsed = std::str::from_utf8(&stated).ok().and_then(|text| text.trim().parse::<u64>().ok());
                    let wrong = || Damage::new(field("NUMBER OF ATOMS"), quoted(&stated), "a whole number from 0");
                    count = Some(parsed.ok_or_else(wrong)?);
                }
                [b"BOX", b"BOUNDS", ref flags @ ..] => {
                    let rows: Vec<Vec<u8>> = (0..3).map(|_| next(lines, "BOX BOUNDS")).collect::<Result<_, _>>()?;
                    let stated = bounds(flags, &rows).filter(Cell::is_finite);
                    let wrong = || {
                        let found = rows.iter().map(|row| quoted(row)).collect::<Vec<_>>().join(" ");
                        Damage::new(field("BOX BOUNDS"), found, "two numbers for each axis, three with tilts")
                    };
                    cell = Some(stated.ok_or_else(wrong)?);
                }
                [b"ATOMS", ..] => {
                    let missing =
                        |what: &str| Damage::new(field("ATOMS"), format!("no {what} before"), format!("ITEM: {what}"));
                    let count = count.ok_or_else(|| missing("NUMBER OF ATOMS"))?;
                    let number = Some(number.ok_or_else(|| missing("TIMESTEP"))?);
                    if cell.is_none() {
                        return Err(missing("BOX BOUNDS").into());
                    }
                    let same = before.filter(|before| before.stated == line && before.units == units);
                    let layout = match same {
                        Some(before) => Arc::clone(before),
                        None => Arc::new(
                            layout(&line, &name[1..], units)
                                .map_err(|damage| Damage { field: field("ATOMS"), ..damage })?,
                        ),
                    };
                    return Ok(Some(Head { count, layout, time, number, cell }));
                }
                _ => {
                    let expected = "ITEM: TIMESTEP, NUMBER OF ATOMS, BOX BOUNDS, ATOMS, TIME or UNITS";
                    return Err(Damage::new(field("item"), quoted(&line), expected).into());
                }
            }
        }
    }
}

/// The line after an item.
fn next(lines: &mut Lines, item: &str) -> Result<Vec<u8>, Stop> {
    let line = lines.next()?.map(<[u8]>::to_vec);
    line.ok_or_else(|| Damage::new(item, "the end of the file", "a line after it").into())
}

/// A line that holds one number.
fn one(line: &[u8], lines: &Lines, item: &str) -> Result<f64, Damage> {
    let found = number(line.trim_ascii()).filter(|number| number.is_finite());
    found.ok_or_else(|| Damage::new(format!("line {}: {item}", lines.number), quoted(line), "a number"))
}

/// The cell of three lines of bounds; `flags`: what stands behind `BOX BOUNDS`.
fn bounds(flags: &[&[u8]], rows: &[Vec<u8>]) -> Option<Cell> {
    let numbers = |row: &Vec<u8>| words(row).map(number).collect::<Option<Vec<f64>>>();
    let rows: Vec<Vec<f64>> = rows.iter().map(numbers).collect::<Option<_>>()?;
    let is_general = flags.starts_with(&[b"abc", b"origin"]);
    let named = if is_general {
        2
    } else {
        flags.iter().filter(|flag| [b"xy", b"xz", b"yz"].iter().any(|tilt| **flag == *tilt)).count()
    };
    // Before 2010 nothing was said of faces.
    let periodic = std::array::from_fn(|axis| flags.get(named + axis).is_some_and(|flag| *flag == b"pp"));
    if is_general {
        let [a, b, c] = [0, 1, 2].map(|row| rows.get(row).and_then(|row| <[f64; 4]>::try_from(row.as_slice()).ok()));
        let [a, b, c] = [a?, b?, c?];
        let edges = [a, b, c].map(|[x, y, z, _]| [x, y, z]);
        return Some(Cell { corner: [a[3], b[3], c[3]], edges, periodic });
    }
    let row = |axis: usize| match rows.get(axis)?[..] {
        [low, high] => Some([low, high, 0.0]),
        [low, high, tilt] => Some([low, high, tilt]),
        _ => None,
    };
    let ([x0, x1, xy], [y0, y1, xz], [z0, z1, yz]) = (row(0)?, row(1)?, row(2)?);
    // Of an inclined box, bounds are those of the box around it.
    let least = |values: &[f64]| values.iter().copied().fold(0.0, f64::min);
    let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let (x0, x1) = (x0 - least(&[xy, xz, xy + xz]), x1 - most(&[xy, xz, xy + xz]));
    let (y0, y1) = (y0 - least(&[yz]), y1 - most(&[yz]));
    let edges = [[x1 - x0, 0.0, 0.0], [xy, y1 - y0, 0.0], [xz, yz, z1 - z0]];
    Some(Cell { corner: [x0, y0, z0], edges, periodic })
}

/// The layout of rows with columns of these names.
fn layout(stated: &[u8], names: &[&[u8]], units: Option<Units>) -> Result<Layout, Damage> {
    if names.len() > 4096 {
        return Err(Damage::new("columns", names.len().to_string(), "at most 4096"));
    }
    let names: Vec<String> = names.iter().map(|name| String::from_utf8_lossy(name).into_owned()).collect();
    let find = |name: &str| names.iter().position(|known| known == name);
    let mut named = Vec::new();
    let mut taken = vec![false; names.len()];
    let (mut has_place, mut is_unwrapped) = (false, false);
    for Vector(name, columns, role, unwrapped) in VECTORS {
        let [Some(x), Some(y), Some(z)] = columns.map(find) else { continue };
        let is_place = matches!(role, Role::Position { .. });
        if is_place && has_place {
            continue;
        }
        if is_place {
            (has_place, is_unwrapped) = (true, *unwrapped);
        }
        let columns = vec![x, y, z];
        columns.iter().for_each(|column| taken[*column] = true);
        let role = role.clone();
        let stored =
            if *name == "position" { names[x].clone() + "," + &names[y] + "," + &names[z] } else { (*name).into() };
        named.push(Named { name: stored, role, word: Word::Number, columns });
    }
    for (column, name) in names.iter().enumerate().filter(|(column, _)| !taken[*column]) {
        let role = role_of(name, 1);
        let (role, word) = match role {
            Role::Id => (Role::Id, Word::Id),
            Role::Species => (Role::Species, Word::Label),
            _ if matches!(name.as_str(), "typelabel" | "proc_name") => (Role::Nothing, Word::Skipped),
            role => (role, Word::Number),
        };
        named.push(Named { name: name.clone(), role, word, columns: vec![column] });
    }
    let mut layout = Layout::new(stated, named, units)?;
    layout.is_unwrapped = is_unwrapped;
    layout.words.resize(names.len(), Word::Skipped);
    Ok(layout)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_what_the_manual_says() {
        let rows = |rows: [&str; 3]| rows.map(|row| row.as_bytes().to_vec()).to_vec();
        let cell = bounds(&[b"pp", b"pp", b"ff"], &rows(["-1 4", "0 5", "0 2.5"])).unwrap();
        assert_eq!(
            (cell.corner, cell.edges[0], cell.periodic),
            ([-1.0, 0.0, 0.0], [5.0, 0.0, 0.0], [true, true, false])
        );
        assert_eq!(cell.cube(), None);
        // xlo 0, xhi 10, xy -3, xz 2: xlo_bound = -3, xhi_bound = 12; yz 1.
        let cell =
            bounds(&[b"xy", b"xz", b"yz", b"pp", b"pp", b"pp"], &rows(["-3 12 -3", "0 11 2", "0 10 1"])).unwrap();
        assert_eq!(cell.corner, [0.0; 3]);
        assert_eq!(cell.edges, [[10.0, 0.0, 0.0], [-3.0, 10.0, 0.0], [2.0, 1.0, 10.0]]);
        assert_eq!(cell.place([0.5, 0.5, 0.5]), [4.5, 5.5, 5.0]);
        let cell = bounds(&[b"abc", b"origin", b"pp", b"pp", b"pp"], &rows(["0 2 0 1", "2 0 0 2", "0 0 2 3"])).unwrap();
        assert_eq!((cell.corner, cell.edges[1], cell.periodic), ([1.0, 2.0, 3.0], [2.0, 0.0, 0.0], [true; 3]));
        for wrong in [["0", "0 1", "0 1"], ["a 1", "0 1", "0 1"], ["0 1 2 3", "0 1", "0 1"]] {
            assert!(bounds(&[], &rows(wrong)).is_none());
        }
    }
}
