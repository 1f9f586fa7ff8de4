//! What the look of a scene of several kinds of data comes to for each kind.

use crate::look::{Attribute, LookPatch, Member, MemberKind, OwnLook};
use crate::mode::Mode;
use crate::modes::{self, surface};
use crate::picture::PictureError;

/// The kinds of data of a scene: that of its first dataset, and which others there are.
#[derive(Clone, Debug)]
pub(super) struct Kinds {
    /// Of each dataset, in their order; one at least.
    pub all: Vec<MemberKind>,
    /// Of each image or volume, in their order, how many dimensions it has.
    pub dimensions: Vec<usize>,
    /// The mode in which particles are drawn where none is named.
    pub of_particles: &'static Mode,
}

/// What a look says of each kind, and of which it says most.
pub(super) struct Looks {
    pub heights: LookPatch,
    /// Of each image or volume, in their order.
    pub fields: Vec<LookPatch>,
    pub particles: LookPatch,
    /// Which kind the picture is about: attribute, colours and legend are of that.
    pub about: MemberKind,
}

impl Kinds {
    /// Of the first dataset.
    pub fn first(&self) -> MemberKind {
        self.all.first().copied().unwrap_or(MemberKind::Particles)
    }

    /// Whether there is data of a kind.
    pub fn has(&self, kind: MemberKind) -> bool {
        self.all.contains(&kind)
    }

    /// Whether a mode draws one kind of them in a picture of all.
    pub fn are_drawn_by(&self, mode: &Mode) -> bool {
        self.all.iter().any(|kind| self.is_drawn_by(*kind, mode))
    }

    fn is_drawn_by(&self, kind: MemberKind, mode: &Mode) -> bool {
        match kind {
            MemberKind::Heights => mode.takes_surfaces(),
            MemberKind::Field => self.dimensions.iter().any(|dimensions| mode.takes_field_among(*dimensions)),
            MemberKind::Particles => mode.takes_particles() && mode.technique.meets_surfaces(),
        }
    }

    /// Which kind pictures in a mode are about: that of the first dataset that it draws, without one that of the first dataset.
    pub fn about(&self, mode: Option<&Mode>) -> MemberKind {
        let drawn = mode.and_then(|mode| self.all.iter().copied().find(|kind| self.is_drawn_by(*kind, mode)));
        let meant = mode.and_then(|mode| match () {
            () if mode.takes_surfaces() => Some(MemberKind::Heights),
            () if mode.takes_particles() => Some(MemberKind::Particles),
            () if mode.takes_fields() => Some(MemberKind::Field),
            () => None,
        });
        // What draws none of it is refused by those that it is meant for.
        drawn.or(meant.filter(|kind| self.has(*kind))).unwrap_or(self.first())
    }

    /// What a look says of each kind; images and volumes, in their order, may have looks of their own.
    ///
    /// # Errors
    /// Settings that none of the modes has, and modes that draw a field alone.
    pub fn looks(&self, look: &LookPatch, own: &[&Member]) -> Result<Looks, PictureError> {
        let about = self.about(look.mode);
        let chosen = |kind: MemberKind| look.mode.filter(|_| about == kind);
        let of_heights = chosen(MemberKind::Heights).unwrap_or(&surface::MODE);
        let of_particles = chosen(MemberKind::Particles).unwrap_or(self.of_particles);
        let of_field = |dimensions: usize| {
            let chosen =
                chosen(MemberKind::Field).filter(|mode| !mode.takes_fields() || mode.takes_fields_of(dimensions));
            chosen.unwrap_or_else(|| modes::of_fields(dimensions))
        };
        let mut modes: Vec<&'static Mode> = Vec::new();
        modes.extend(Some(of_heights).filter(|_| self.has(MemberKind::Heights)));
        modes.extend(self.dimensions.iter().map(|dimensions| of_field(*dimensions)));
        modes.extend(Some(of_particles).filter(|_| self.has(MemberKind::Particles)));
        let strangers = look.settings.filtered(|name| !modes.iter().any(|mode| has(mode, name)));
        let told_by = match about {
            MemberKind::Heights => of_heights,
            MemberKind::Field => self.dimensions.first().map_or(of_particles, |dimensions| of_field(*dimensions)),
            MemberKind::Particles => of_particles,
        };
        strangers.check(told_by).map_err(|error| PictureError::Asked(error.to_string()))?;
        let of_kind = |kind: MemberKind, mode: &'static Mode| {
            let look = of_mode(look, mode);
            match kind == about {
                true => look,
                // What is said of colours is said of what the picture is about.
                false => LookPatch {
                    attribute: look.attribute.filter(|own| *own == Attribute::None),
                    transfer: None,
                    ..look
                },
            }
        };
        let mut fields = Vec::new();
        for (dimensions, member) in self.dimensions.iter().zip(own) {
            let usual = of_kind(MemberKind::Field, of_field(*dimensions));
            let look = member.own_look.as_ref().map_or_else(|| usual.clone(), |own| own_look(&usual, own, *dimensions));
            for mode in [&usual, &look].into_iter().filter_map(|look| look.mode) {
                draws_among(mode, *dimensions).map_err(|why| PictureError::of(&member.path, why))?;
            }
            fields.push(look);
        }
        let heights = of_kind(MemberKind::Heights, of_heights);
        Ok(Looks { heights, fields, particles: of_kind(MemberKind::Particles, of_particles), about })
    }
}

/// Refuses modes that draw an image or a volume alone.
fn draws_among(mode: &Mode, dimensions: usize) -> Result<(), String> {
    if mode.takes_field_among(dimensions) {
        return Ok(());
    }
    let all = modes::all().into_iter().filter(|mode| mode.takes_field_among(dimensions));
    let expected: Vec<&str> = all.map(|mode| mode.name).collect();
    let kind = if dimensions == 2 { "image" } else { "volume" };
    let (found, expected) = (mode.name, expected.join(", "));
    Err(format!("mode: found {found}, which draws no {kind} among other data, expected one of {expected}"))
}

/// A look in another mode.
fn of_mode(look: &LookPatch, mode: &'static Mode) -> LookPatch {
    LookPatch { mode: Some(mode), settings: look.settings.of_mode(mode), ..look.clone() }
}

/// The look of an image or a volume that has one of its own.
fn own_look(usual: &LookPatch, own: &OwnLook, dimensions: usize) -> LookPatch {
    let mode = own.mode.unwrap_or_else(|| modes::of_fields(dimensions));
    LookPatch {
        settings: own.settings.clone(),
        attribute: own.attribute.clone(),
        transfer: own.transfer.clone(),
        mode: Some(mode),
        ..usual.clone()
    }
}

/// Whether a mode has a setting.
fn has(mode: &Mode, name: &str) -> bool {
    mode.own_settings().any(|setting| setting.name == name)
}
