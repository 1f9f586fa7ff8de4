//! Which of the data a look shows: families, and what is selected.

use super::{Data, Session};
use crate::explore::selection::Show;
use crate::explore::{Members, Places, Work};
use crate::import::{Source, open};
use crate::look::{LookPatch, Member, OpenData, shown_families};
use crate::mode::Coloring;
use crate::model::FamilyName;
use crate::picture::annotation::{Annotation, FollowedPlaces};
use crate::picture::error::PictureError;
use crate::store::{FamilyMetadata, Metadata};
use crate::stream::SceneSelection;

impl Session {
    /// Indices of the families that a look draws.
    pub(super) fn families(&self, look: &LookPatch) -> Result<Vec<u32>, PictureError> {
        let families = &self.tree().metadata().families;
        let (shown, missing): (Vec<bool>, _) = match (&self.data, self.options.family) {
            // Nothing else was loaded.
            (Data::Source(_), _) => (vec![true; families.len()], Vec::new()),
            (Data::Moment(_), None) => {
                let named = self.members.first().and_then(|member| member.families.as_ref()).or(look.families.as_ref());
                let is_shown = |name| named.is_none_or(|named| named.contains(name));
                let missing = named.into_iter().flatten();
                let missing = missing.filter(|name| families.iter().all(|family| family.name != **name));
                (families.iter().map(|family| is_shown(&family.name)).collect(), missing.copied().collect())
            }
            (_, Some(only)) => (families.iter().map(|family| family.name == only).collect(), vec![only]),
            (Data::Pages(file), None) => {
                let own = |member: &Member| Member {
                    families: member.families.clone().or_else(|| look.families.clone()),
                    ..member.clone()
                };
                match self.members.is_empty() {
                    true => shown_families(file, &[own(&Member::default())]),
                    false => shown_families(file, &self.members.iter().map(own).collect::<Vec<_>>()),
                }
            }
        };
        let found: Vec<u32> = (0..).zip(shown).filter_map(|(index, shown)| shown.then_some(index)).collect();
        match (found.is_empty(), missing.first()) {
            (false, _) => Ok(found),
            (true, Some(name)) => Err(PictureError::of(self.path(), format!("no particles of family {name}"))),
            (true, None) => Err(PictureError::of(self.path(), "the scene shows no family")),
        }
    }

    /// Tells, once, which families that are drawn lack the attribute that was named, and so are coloured as its mean.
    pub(super) fn tell_of_mean_colors(&mut self, coloring: &Coloring, metadata: &Metadata) {
        if self.has_told_of_attribute {
            return;
        }
        let has = |family: &FamilyMetadata| {
            family.quantities.iter().chain(&family.attributes).any(|column| column.name == coloring.name)
        };
        let drawn = self.scene.families.iter().filter_map(|index| metadata.families.get(*index as usize));
        let mut lacking: Vec<String> =
            drawn.filter(|family| !has(family)).map(|family| family.name.to_string()).collect();
        lacking.dedup();
        if lacking.is_empty() {
            return;
        }
        self.has_told_of_attribute = true;
        let (path, lacking, name) = (self.path().display(), lacking.join(", "), &coloring.name);
        let why = "which are coloured as its mean; --family draws others alone";
        self.reporter.tell(format!("{path}: attribute {name}: not in {lacking}, {why}"));
    }

    /// An annotation with a look's selections.
    pub(super) fn marked(
        &self,
        annotation: Annotation,
        look: &LookPatch,
        selection: &SceneSelection,
    ) -> Result<Annotation, PictureError> {
        let selections = look.selections.as_deref().unwrap_or_default();
        let families = &self.tree().metadata().families;
        let names: Vec<FamilyName> =
            self.scene.families.iter().filter_map(|index| Some(families.get(*index as usize)?.name)).collect();
        let following = self.opened.as_ref().and_then(OpenData::following);
        let interpolation = look.interpolation.unwrap_or_default();
        let places = following.map(|following| {
            move |members: &Members| {
                let progress = self.reporter.progress();
                let found = following.of(members, Work::told(&*progress))?;
                let places = found.map(|found| found.places(self.moment, interpolation)).transpose()?;
                Ok(Places::new(places.unwrap_or_default()))
            }
        });
        let run = places.as_ref().map(|places| places as FollowedPlaces<'_>);
        Ok(match &self.data {
            Data::Pages(file) => {
                annotation.with_selections(selections, file, &selection.nodes, run, &names, &*self.reporter)?
            }
            _ if selections.iter().all(|set| set.show == Show::Hidden) => annotation,
            Data::Source(_) | Data::Moment(_) => {
                if !matches!(&self.members[..], [only] if only.is_in_place()) {
                    let why = "a picture of particles of several or moved datasets leaves the selections out";
                    self.reporter.tell(why.into());
                    return Ok(annotation);
                }
                let opened;
                let source: &dyn Source = match &self.data {
                    Data::Source(path) => {
                        opened = open(path)?;
                        opened.as_ref()
                    }
                    Data::Moment(snapshot) => &**snapshot,
                    Data::Pages(_) => return Ok(annotation),
                };
                annotation.with_source_selections(selections, source, run, &names, &*self.reporter)?
            }
        })
    }
}
