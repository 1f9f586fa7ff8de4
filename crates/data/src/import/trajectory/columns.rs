//! What the columns of a frame's rows hold, and the fields that they become.

use super::Damage;
use crate::import::{Field, FieldKind};
use crate::model::Unit;

/// The most columns that rows may have.
const MOST: usize = 1 << 12;

/// How the words of a column are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Word {
    /// A number.
    Number,
    /// `T` or `F`.
    Logical,
    /// A whole number that names the particle.
    Id,
    /// A word that names its kind.
    Label,
    /// Not at all.
    Skipped,
}

/// What columns of one name are.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Role {
    /// Places; `is_scaled`: along the edges of the cell, in their lengths.
    Position {
        /// Whether in lengths of the cell's edges.
        is_scaled: bool,
    },
    /// In which image of the cell a particle is.
    Image,
    /// Velocities.
    Velocity,
    /// Momenta, which masses make velocities of.
    Momentum,
    /// Ids.
    Id,
    /// Words that name kinds of particles.
    Species,
    /// Numbers of elements.
    AtomicNumber,
    /// A quantity of one of the standard kinds, or any other.
    Quantity(&'static str, FieldKind),
    /// Any other quantity, under its own name.
    Other,
    /// Nothing that is read.
    Nothing,
}

/// Columns of one name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Named {
    /// The name in the file.
    pub name: String,
    /// What they are.
    pub role: Role,
    /// How they are read.
    pub word: Word,
    /// Where they stand in a row.
    pub columns: Vec<usize>,
}

/// Units of the fields of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Units {
    /// Of positions.
    pub length: &'static str,
    /// Of velocities.
    pub velocity: &'static str,
    /// Of masses.
    pub mass: &'static str,
}

/// The units of atoms where a file names elements: angstroms and atomic mass units.
pub(super) const ATOMS: Units = Units { length: "Angstrom", velocity: "", mass: "u" };

/// Where the values of a field come from.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Part {
    /// Columns as they are.
    Columns(Vec<usize>),
    /// A place, possibly scaled or in an image of the cell.
    Place {
        /// The three columns.
        columns: [usize; 3],
        /// Whether in lengths of the cell's edges.
        is_scaled: bool,
        /// Columns of images.
        images: Option<[usize; 3]>,
    },
    /// The standard weight of the element that a column names.
    Weight(usize),
    /// A momentum by a mass.
    Momentum([usize; 3], Box<Part>),
    /// The column of ids.
    Id(usize),
}

/// What rows hold.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    /// The text that said so: frames with the same one have the same layout.
    pub stated: Vec<u8>,
    /// How the words of a row are read, in order.
    pub words: Vec<Word>,
    /// Whether rows may have more words, which are left out.
    pub may_have_more: bool,
    /// The fields and where they come from.
    pub fields: Vec<(Field, Part)>,
    /// The column of labels.
    pub label: Option<usize>,
    /// Whether masses are those of elements that labels name.
    pub weighs_labels: bool,
    /// Whether places are unwrapped from the periodic cell.
    pub is_unwrapped: bool,
    /// The units, where the file names them.
    pub units: Option<Units>,
    /// What is left out, one sentence each.
    pub notes: Vec<String>,
}

impl Layout {
    /// The layout of rows with these columns.
    ///
    /// # Errors
    /// Where there are no places, or too many columns.
    pub(super) fn new(stated: &[u8], named: Vec<Named>, units: Option<Units>) -> Result<Layout, Damage> {
        let width = named.iter().flat_map(|named| &named.columns).max().map_or(0, |last| last + 1);
        if width > MOST {
            return Err(Damage::new("columns", width.to_string(), format!("at most {MOST}")));
        }
        let mut layout = Layout {
            stated: stated.to_vec(),
            words: vec![Word::Skipped; width],
            may_have_more: false,
            fields: Vec::new(),
            label: None,
            weighs_labels: false,
            is_unwrapped: false,
            units,
            notes: Vec::new(),
        };
        let three = |named: &Named| <[usize; 3]>::try_from(named.columns.as_slice()).ok();
        let images = named.iter().filter(|named| named.role == Role::Image).find_map(three);
        let mass = mass_of(&named);
        for one in &named {
            for column in &one.columns {
                layout.words[*column] = one.word;
            }
            let own = |name: &str, kind| field(name, &one.name, one.columns.len(), kind);
            let (field, part) = match (&one.role, three(one)) {
                (Role::Nothing, _) => {
                    layout.notes.push(format!("{}: text, left out", one.name));
                    continue;
                }
                (Role::Position { is_scaled }, Some(columns)) => {
                    let is_scaled = *is_scaled;
                    (own("position", FieldKind::Position), Part::Place { columns, is_scaled, images })
                }
                (Role::Velocity, Some(_)) => (own("velocity", FieldKind::Velocity), Part::Columns(one.columns.clone())),
                (Role::Momentum, Some(columns)) => match &mass {
                    Some(mass) => {
                        (own("velocity", FieldKind::Velocity), Part::Momentum(columns, Box::new(mass.part.clone())))
                    }
                    None => (own(&one.name, FieldKind::Other), Part::Columns(one.columns.clone())),
                },
                (Role::Id, _) => (own("id", FieldKind::Id), Part::Id(one.columns[0])),
                (Role::Species, _) => {
                    layout.label = Some(one.columns[0]);
                    (own("species", FieldKind::Other), Part::Columns(one.columns.clone()))
                }
                (Role::AtomicNumber, _) => (own("atomic-number", FieldKind::Other), Part::Columns(one.columns.clone())),
                (Role::Quantity(name, kind), _) => (own(name, *kind), Part::Columns(one.columns.clone())),
                _ => (own(&one.name, FieldKind::Other), Part::Columns(one.columns.clone())),
            };
            layout.add(field, part);
        }
        if let Some(mass) = mass.filter(|mass| mass.is_weight) {
            layout.weighs_labels = mass.is_label;
            layout.add(field("mass", &mass.name, 1, FieldKind::Mass), mass.part);
        }
        if !layout.fields.iter().any(|(field, _)| field.kind == FieldKind::Position) {
            let found = named.iter().take(12).map(|one| one.name.as_str()).collect::<Vec<_>>().join(" ");
            return Err(Damage::new("columns", found, "those of positions"));
        }
        // Further columns of that name are numbers like others, so that each row has one id.
        let first = layout.words.iter().position(|word| *word == Word::Id);
        let others = layout.words.iter_mut().enumerate().filter(|(column, _)| Some(*column) != first);
        others.filter(|(_, word)| **word == Word::Id).for_each(|(_, word)| *word = Word::Number);
        layout.fields.sort_by_key(|(field, _)| field.kind);
        Ok(layout)
    }

    /// Adds a field, unless one of its kind or its name is there.
    fn add(&mut self, mut field: Field, part: Part) {
        let is_taken = |name: &str| self.fields.iter().any(|(other, _)| other.name == name);
        let is_kind_taken =
            field.kind != FieldKind::Other && self.fields.iter().any(|(other, _)| other.kind == field.kind);
        if is_kind_taken || is_taken(&field.name) {
            (field.name, field.kind) = (field.stored_as.clone(), FieldKind::Other);
        }
        if is_taken(&field.name) {
            self.notes.push(format!("{}: twice, the second is left out", field.stored_as));
            return;
        }
        self.fields.push((field, part));
    }
}

fn field(name: &str, stored_as: &str, components: usize, kind: FieldKind) -> Field {
    Field { name: name.into(), stored_as: stored_as.into(), unit: Unit::default(), components, kind }
}

/// Where masses come from.
struct Mass {
    name: String,
    part: Part,
    is_weight: bool,
    is_label: bool,
}

/// Those of a column, else of an atomic number, else of an element's name.
fn mass_of(named: &[Named]) -> Option<Mass> {
    let of = |role: fn(&Role) -> bool| named.iter().find(|one| role(&one.role) && one.columns.len() == 1);
    let is_mass = |role: &Role| matches!(role, Role::Quantity(_, FieldKind::Mass));
    let mass = |one: &Named, part, is_weight, is_label| Mass { name: one.name.clone(), part, is_weight, is_label };
    if let Some(one) = of(is_mass) {
        return Some(mass(one, Part::Columns(one.columns.clone()), false, false));
    }
    if let Some(one) = of(|role| *role == Role::AtomicNumber) {
        return Some(mass(one, Part::Weight(one.columns[0]), true, false));
    }
    of(|role| *role == Role::Species).map(|one| mass(one, Part::Weight(one.columns[0]), true, true))
}

/// What columns of a name are, in any of the formats; `components`: how many columns it has.
pub(super) fn role_of(name: &str, components: usize) -> Role {
    let other = |name| Role::Quantity(name, FieldKind::Other);
    match (name.to_ascii_lowercase().as_str(), components) {
        ("pos" | "position" | "positions", 3) => Role::Position { is_scaled: false },
        ("velo" | "vel" | "velocity" | "velocities", 3) => Role::Velocity,
        ("momenta" | "momentum", 3) => Role::Momentum,
        ("force" | "forces", 3) => other("force"),
        ("mass" | "masses", 1) => Role::Quantity("mass", FieldKind::Mass),
        ("id", 1) => Role::Id,
        ("species" | "element", 1) => Role::Species,
        ("z" | "numbers" | "atomic_number" | "atomic_numbers", 1) => Role::AtomicNumber,
        ("q" | "charge" | "charges", 1) => other("charge"),
        ("type", 1) => other("particle-type"),
        ("rho" | "density", 1) => Role::Quantity("density", FieldKind::Density),
        ("h" | "hsml" | "smoothing_length", 1) => Role::Quantity("smoothing-length", FieldKind::SmoothingLength),
        ("temp" | "temperature", 1) => other("temperature"),
        _ => Role::Other,
    }
}
