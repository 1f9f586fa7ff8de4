//! For tests: the tables of a file format's specification, against which encoded structures are held.

/// Offset, size and name of each row of the table below a heading of the specification.
fn table(specification: &str, heading: &str) -> Vec<(usize, usize, String)> {
    let size = |kind: &str| -> usize {
        let (scalar, count) = kind.trim_end_matches(']').split_once('[').unwrap_or((kind, "1"));
        let bits: usize = scalar[1..].parse().unwrap();
        bits / 8 * count.parse::<usize>().unwrap()
    };
    let section = specification.split_once(&format!("# {heading}\n")).unwrap().1;
    section
        .lines()
        .skip_while(|line| !line.starts_with('|'))
        .take_while(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').splitn(3, '|').map(str::trim).collect();
            let name = cells[2].split(':').next().unwrap().to_owned();
            (cells[0].parse().unwrap(), size(cells[1]), name)
        })
        .collect()
}

/// The bytes of each field by name, after checking that the fields follow one another and fill `bytes`.
pub(super) fn fields<'a>(specification: &str, heading: &str, bytes: &'a [u8]) -> impl Fn(&str) -> &'a [u8] + use<'a> {
    let table = table(specification, heading);
    let end = table.iter().fold(0, |end, (offset, size, name)| {
        assert_eq!(*offset, end, "{heading}: {name}");
        end + size
    });
    assert_eq!(end, bytes.len(), "{heading}");
    move |name| {
        let (offset, size, _) = table.iter().find(|(_, _, field)| field == name).unwrap();
        &bytes[*offset..offset + size]
    }
}
