//! The datasets of a scene: where each lies, and which of its families are drawn.

use super::{HeightsSaid, OwnLook, TakenFor, data_file, is_field};
use crate::heights::is_heights;
use crate::import::ImportError;
use crate::model::{FamilyName, Placement, Unit, is_url};
use crate::store::PageFile;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A dataset to be shown, alone or with others.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Member {
    /// The source, page file or run.
    pub path: PathBuf,
    /// Where its origin lies in the scene.
    pub offset: DVec3,
    /// Scene lengths for one of its own; what the units say, where they say it, and else 1, where it is `None`.
    pub scale: Option<f64>,
    /// The families that are drawn; all where it is `None`.
    pub families: Option<Vec<FamilyName>>,
    /// What the user says of it: what it is taken for, and of heights what they are.
    pub said: HeightsSaid,
    /// How it is drawn among other data where it is an image or a volume; as usual, or as the scene's look says, without.
    pub own_look: Option<OwnLook>,
}

/// What a dataset is drawn as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemberKind {
    /// Measured heights.
    Heights,
    /// An image or a volume.
    Field,
    /// Particles.
    Particles,
}

impl Member {
    /// A whole dataset where it is.
    pub fn new(path: impl Into<PathBuf>) -> Member {
        Member { path: path.into(), ..Member::default() }
    }

    /// Whether it is taken for measured heights, built or not: as the user says, else as its content tells.
    pub fn is_of_heights(&self) -> bool {
        self.said.is_heights().unwrap_or_else(|| is_heights(&self.path))
    }

    /// What it is drawn as, built or not: as the user says, else as its content tells.
    pub fn kind(&self) -> MemberKind {
        match self.said.taken_for {
            _ if self.is_of_heights() => MemberKind::Heights,
            Some(TakenFor::Particles) => MemberKind::Particles,
            _ if is_field(&self.path) => MemberKind::Field,
            _ => MemberKind::Particles,
        }
    }

    /// Where it lies: its own unit of lengths and of masses are given, and those of the scene.
    pub fn placement(&self, (length, mass): (&Unit, &Unit), scene: (&Unit, &Unit)) -> Placement {
        let scale = self.scale.or_else(|| length.ratio(scene.0)).unwrap_or(1.0);
        let mass = mass.ratio(scene.1).unwrap_or(1.0);
        // A ratio of units that are the same may differ from 1 by rounding.
        let exact = |factor: f64| if (factor - 1.0).abs() < 1e-12 { 1.0 } else { factor };
        Placement { offset: self.offset, scale: exact(scale), mass: exact(mass) }
    }

    /// Whether it lies where it is by itself.
    pub fn is_in_place(&self) -> bool {
        self.offset == DVec3::ZERO && self.scale.is_none()
    }

    /// The same with the file that is meant in place of a folder.
    ///
    /// # Errors
    /// As [`data_file`].
    pub fn resolved(&self) -> Result<Member, ImportError> {
        Ok(Member { path: data_file(&self.path)?, ..self.clone() })
    }
}

/// Says of datasets what a user says of all heights among them; that a file is taken for something else than particles, and what it is compared with, of the first
/// alone. What was said of them before holds where he says nothing.
pub fn say(members: &mut [Member], said: &HeightsSaid) {
    for (index, member) in members.iter_mut().enumerate() {
        let is_first = index == 0;
        let taken_for = said.taken_for.filter(|kind| is_first || *kind == TakenFor::Particles);
        let own = HeightsSaid { taken_for, before: said.before.clone().filter(|_| is_first), ..said.clone() };
        member.said = own.or(&member.said);
    }
}

/// What is said of the particles in a file that is of some of these datasets: that it is taken for such, and what is derived for them.
pub fn said_of_particles(members: &[Member], path: &Path) -> HeightsSaid {
    let mut derive = Vec::new();
    for quantity in members.iter().filter(|member| member.path == path).flat_map(|member| &member.said.derive) {
        if !derive.contains(quantity) {
            derive.push(*quantity);
        }
    }
    HeightsSaid { taken_for: Some(TakenFor::Particles), derive, ..HeightsSaid::default() }
}

/// Refuses to derive attributes where none of the datasets is of particles.
///
/// # Errors
/// A sentence, where something is to be derived.
pub fn check_derived(members: &[Member]) -> Result<(), String> {
    match members.iter().find(|member| !member.said.derive.is_empty()) {
        Some(first) if members.iter().all(|member| member.kind() != MemberKind::Particles) => {
            let found = if first.is_of_heights() { "heights" } else { "an image or a volume" };
            Err(format!("{}: --derive: found {found}, expected particles with velocities", first.path.display()))
        }
        _ => Ok(()),
    }
}

/// `FILE`, `FILE@X,Y,Z` or `FILE@X,Y,Z*SCALE`, as the command line has it.
impl FromStr for Member {
    type Err = String;

    fn from_str(text: &str) -> Result<Member, String> {
        let Some((path, place)) = text.rsplit_once('@') else { return Ok(Member::new(text)) };
        let (offset, scale) = place.split_once('*').map_or((place, None), |(offset, scale)| (offset, Some(scale)));
        let numbers: Option<Vec<f64>> = offset.split(',').map(|number| number.trim().parse().ok()).collect();
        match (numbers.as_deref(), scale.map(|scale| scale.trim().parse::<f64>())) {
            (Some(&[x, y, z]), scale @ (None | Some(Ok(_)))) => {
                let (offset, scale) = (DVec3::new(x, y, z), scale.and_then(Result::ok));
                if !offset.is_finite() || scale.is_some_and(|scale| !(scale > 0.0 && scale.is_finite())) {
                    return Err(format!("{place}: expected finite coordinates and a positive scale"));
                }
                Ok(Member { offset, scale, ..Member::new(path) })
            }
            // A name may well contain the sign.
            _ if is_url(Path::new(text)) || Path::new(text).exists() => Ok(Member::new(text)),
            _ => Err(format!("{place}: expected FILE@X,Y,Z or FILE@X,Y,Z*SCALE")),
        }
    }
}

/// Whether each family of the scene is drawn, as its members say; and what they name that is not there.
pub fn shown_families(file: &PageFile, members: &[Member]) -> (Vec<bool>, Vec<FamilyName>) {
    let families = &file.metadata().families;
    let mut shown = vec![true; families.len()];
    let mut missing = Vec::new();
    for (part, member) in file.parts().zip(members) {
        let Some(names) = &member.families else { continue };
        let own = &families[part.families.clone()];
        for (shown, family) in shown[part.families.clone()].iter_mut().zip(own) {
            *shown = names.contains(&family.name);
        }
        missing.extend(names.iter().filter(|name| own.iter().all(|family| family.name != **name)));
    }
    (shown, missing)
}
