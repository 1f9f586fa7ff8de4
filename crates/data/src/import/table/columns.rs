//! A table in memory: named columns of numbers of one length.

/// One column.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Column {
    /// The name as the file has it, without a unit.
    pub name: String,
    /// The unit that the name carried in brackets; empty without.
    pub unit: String,
    /// One number per row; NaN where there is none.
    pub values: Vec<f64>,
}

impl Column {
    /// An empty column; `header` is a name such as `x`, `x [kpc]` or `x (kpc)`.
    pub(super) fn new(header: &str) -> Column {
        let header = header.trim().trim_matches('"').trim();
        let bracket = header.find(['[', '(']).filter(|at| *at > 0 && header.ends_with([']', ')']));
        let (name, unit) = match bracket {
            Some(at) => (header[..at].trim(), header[at..].trim_matches(['[', ']', '(', ')']).trim()),
            None => (header, ""),
        };
        Column { name: name.into(), unit: unit.into(), values: Vec::new() }
    }

    /// The name in the form in which names are compared.
    pub(super) fn key(&self) -> String {
        self.name.to_lowercase().replace([' ', '-'], "_")
    }
}

/// The number that a field of text holds; NaN for what tables write in place of a missing one, `None` for other text.
pub(super) fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    match text.parse() {
        Ok(number) => Some(number),
        Err(_) if matches!(text.to_lowercase().as_str(), "" | "na" | "n/a" | "null" | "none" | "-" | "--") => {
            Some(f64::NAN)
        }
        Err(_) => None,
    }
}
