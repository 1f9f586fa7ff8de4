//! XYZ and extended XYZ: frames of a line with the number of atoms, a line of comment and a line for each atom.
//!
//! Of extended XYZ the comment says with `Properties=species:S:1:pos:R:3:...` what stands in the lines of atoms, with `Lattice="..."` the
//! cell's three vectors, `Origin="x y z"` its corner and `pbc="T T F"` along which of them it repeats (along all, where it is not
//! said), and possibly `Time=`. Atoms of plain XYZ are a word and a place. The comment of either is searched for a time.

use super::cell::Cell;
use super::columns::{Layout, Named, Role, Word, role_of};
use super::lines::Lines;
use super::row::{number, words};
use super::xyz_comment::{Pairs, numbers, three_logical};
use super::{Damage, Head, Stop, Text, quoted};
use crate::import::text_head;
use std::sync::Arc;

/// The format.
pub(in crate::import) struct Xyz;

/// A line that holds a whole number and nothing else.
fn count(line: &[u8]) -> Option<u64> {
    std::str::from_utf8(line).ok()?.trim().parse().ok()
}

impl Text for Xyz {
    fn name(&self) -> &'static str {
        "xyz"
    }

    fn title(&self) -> &'static str {
        "XYZ and extended XYZ"
    }

    fn endings(&self) -> &'static [&'static str] {
        &["xyz", "extxyz"]
    }

    fn recognise(&self, head: &[u8]) -> bool {
        let text = text_head(head).unwrap_or_default();
        let mut lines = text.lines();
        let is_count = lines.next().is_some_and(|line| count(line.as_bytes()).is_some());
        let Some(comment) = lines.next().filter(|_| is_count) else { return false };
        let is_place = |line: &str| {
            let words: Vec<&[u8]> = words(line.as_bytes()).collect();
            words.len() >= 4 && words[1..4].iter().all(|word| number(word).is_some())
        };
        let says_so = comment.contains("Properties=") || comment.contains("Lattice=");
        // Of an empty frame the next one's count follows.
        says_so || lines.next().is_some_and(|line| is_place(line) || count(line.as_bytes()).is_some())
    }

    fn keeps_rows(&self) -> bool {
        true
    }

    fn head(&self, lines: &mut Lines, before: Option<&Arc<Layout>>) -> Result<Option<Head>, Stop> {
        // Empty lines between frames, as at the end of the file.
        let first = loop {
            match lines.next()? {
                None => return Ok(None),
                Some(line) if words(line).next().is_some() => break line,
                Some(_) => {}
            }
        };
        let rows = count(first).ok_or_else(|| quoted(first));
        let field = |lines: &Lines, what: &str| format!("line {}: {what}", lines.number);
        let count = rows.map_err(|found| Damage::new(field(lines, "count"), found, "the number of atoms"))?;
        let Some(comment) = lines.next()?.map(<[u8]>::to_vec) else {
            return Err(Damage::new("comment", "the end of the file", "a line of comment").into());
        };
        let pairs = Pairs::of(&comment);
        let properties = pairs.get(&["properties"]).unwrap_or_default();
        let layout = match before.filter(|before| before.stated == properties.as_bytes()) {
            Some(before) => Arc::clone(before),
            None => {
                Arc::new(layout(properties).map_err(|damage| Damage { field: field(lines, "Properties"), ..damage })?)
            }
        };
        let cell = cell(&pairs).map_err(|damage| Damage { field: field(lines, &damage.field), ..damage })?;
        let stated = |keys: &[&str]| {
            let found = pairs.get(keys).and_then(|value| number(value.trim().as_bytes()));
            found.filter(|number| number.is_finite())
        };
        let (time, number) = (stated(&["time"]), stated(&["step", "timestep"]));
        Ok(Some(Head { count, layout, time, number, cell }))
    }
}

/// The layout that `Properties` states; of plain XYZ where it is empty.
fn layout(properties: &str) -> Result<Layout, Damage> {
    if properties.is_empty() {
        let named = vec![
            Named { name: "species".into(), role: Role::Species, word: Word::Label, columns: vec![0] },
            Named {
                name: "pos".into(),
                role: Role::Position { is_scaled: false },
                word: Word::Number,
                columns: vec![1, 2, 3],
            },
        ];
        // Further columns mean something else to each program.
        return Ok(Layout { may_have_more: true, ..Layout::new(b"", named, None)? });
    }
    let parts: Vec<&str> = properties.split(':').collect();
    let (triples, rest) = parts.as_chunks::<3>();
    let expected = "NAME:TYPE:COLUMNS, of the types S, R, I or L, once or more";
    if !rest.is_empty() {
        return Err(Damage::new("Properties", quoted(properties.as_bytes()), expected));
    }
    let mut named = Vec::with_capacity(triples.len());
    let mut next = 0usize;
    for [name, kind, columns] in triples {
        // More than that is refused by the layout, too.
        let columns: usize = columns
            .parse()
            .ok()
            .filter(|columns| (1..=4096).contains(columns))
            .ok_or_else(|| Damage::new("Properties", format!("{name}:{kind}:{columns}"), "1 to 4096 columns"))?;
        let role = role_of(name, columns);
        let (role, word) = match (*kind, role) {
            ("S", Role::Species) => (Role::Species, Word::Label),
            ("S", _) => (Role::Nothing, Word::Skipped),
            // Kinds that are numbers.
            ("I" | "R", Role::Species) => (Role::Species, Word::Label),
            ("I", Role::Id) => (Role::Id, Word::Id),
            (_, Role::Id) => (Role::Other, Word::Number),
            ("I" | "R", role) => (role, Word::Number),
            ("L", _) => (Role::Other, Word::Logical),
            _ => return Err(Damage::new("Properties", format!("{name}:{kind}"), expected)),
        };
        named.push(Named { name: (*name).into(), role, word, columns: (next..next + columns).collect() });
        next += columns;
        if next > 4096 {
            return Err(Damage::new("Properties", format!("{next} columns"), "at most 4096"));
        }
    }
    // Words at the end of rows are counted, too.
    let mut layout = Layout::new(properties.as_bytes(), named, None)?;
    layout.words.resize(next, Word::Skipped);
    Ok(layout)
}

/// The cell that a comment states.
fn cell(pairs: &Pairs) -> Result<Option<Cell>, Damage> {
    let Some(stated) = pairs.get(&["lattice"]) else { return Ok(None) };
    let wrong = |field: &str, value: &str, expected| Damage::new(field, quoted(value.as_bytes()), expected);
    let edges = match numbers(stated).unwrap_or_default()[..] {
        [x, y, z] => [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]],
        [a, b, c, d, e, f, g, h, i] => [[a, b, c], [d, e, f], [g, h, i]],
        _ => return Err(wrong("Lattice", stated, "nine numbers, three vectors")),
    };
    let three = |value: &str| numbers(value).and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    let corner = match pairs.get(&["origin"]) {
        Some(value) => three(value).ok_or_else(|| wrong("Origin", value, "three numbers"))?,
        None => [0.0; 3],
    };
    let periodic = match pairs.get(&["pbc"]) {
        Some(value) => three_logical(value).ok_or_else(|| wrong("pbc", value, "T or F for each of three axes"))?,
        None => [true; 3],
    };
    Ok(Some(Cell { corner, edges, periodic }))
}
