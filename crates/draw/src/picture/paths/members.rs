//! Whose paths are drawn: names of selections become ids.

use super::PathRequest;
use crate::explore::{Followed, Following, IdSet, Members, SelectionSet, Work, ids_of};
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::PathsOf;
use crate::model::Moment;
use crate::picture::PictureError;
use crate::store::run::RunFile;
use std::sync::Arc;

/// Who was meant, as it was found last.
#[derive(Default)]
pub(super) struct Found {
    /// Who is in regions.
    inside: Vec<(Members, Moment, IdSet)>,
    /// Who is followed.
    following: Option<Following>,
}

/// Whose paths are drawn.
#[derive(Clone, Default)]
pub(super) struct Whose {
    /// Those who are the same at all times.
    followed: Vec<Arc<Followed>>,
    /// Those who are in regions.
    inside: IdSet,
}

impl PartialEq for Whose {
    fn eq(&self, other: &Whose) -> bool {
        let same = |(own, other): (&Arc<Followed>, &Arc<Followed>)| Arc::ptr_eq(own, other);
        self.followed.len() == other.followed.len()
            && self.followed.iter().zip(&other.followed).all(same)
            && self.inside == other.inside
    }
}

impl Whose {
    /// Whether it is nobody.
    pub fn is_empty(&self) -> bool {
        self.followed.iter().all(|own| own.ids().is_empty()) && self.inside.is_empty()
    }

    /// Whether a particle of a family (by its number in the run) with an id is one of them.
    pub fn has(&self, family: usize, id: u64) -> bool {
        self.followed.iter().any(|own| own.has(family, id)) || self.inside.contains(id)
    }
}

/// Regions whose members are remembered.
const REMEMBERED: usize = 8;

impl Found {
    /// Those whose paths are drawn; `None` for all. Who is in a region is asked for the present.
    pub fn of(&mut self, run: &Arc<RunFile>, request: &PathRequest<'_>) -> Result<Option<Whose>, PictureError> {
        let names = match request.of {
            PathsOf::All => return Ok(None),
            PathsOf::None => return Ok(Some(Whose::default())),
            PathsOf::Selections(names) => names,
        };
        let mut all = Whose::default();
        for name in names {
            let set = named(run, request.selections, name)?;
            match self.followed(run, &set.members)? {
                Some(followed) => all.followed.push(followed),
                None => {
                    let ids = self.in_region(run, &set.members, request.moment, request.interpolation)?;
                    all.inside = if all.inside.is_empty() { ids } else { all.inside.union(&ids) };
                }
            }
        }
        Ok(Some(all))
    }

    /// Those of a selection who are the same at all times; `None` for a region.
    pub fn followed(&mut self, run: &Arc<RunFile>, members: &Members) -> Result<Option<Arc<Followed>>, PictureError> {
        if self.following.is_none() {
            self.following = Following::new(Arc::clone(run));
        }
        match &self.following {
            Some(following) => Ok(following.of(members, Work::quiet())?),
            None => Ok(None),
        }
    }

    fn in_region(
        &mut self,
        run: &Arc<RunFile>,
        members: &Members,
        moment: Moment,
        interpolation: Interpolation,
    ) -> Result<IdSet, PictureError> {
        if let Some((.., ids)) = self.inside.iter().find(|(known, at, _)| (known, *at) == (members, moment)) {
            return Ok(ids.clone());
        }
        let periodic = run.tracks()?.box_size;
        let ids = ids_of(&run.at(moment, interpolation)?, members, periodic, Work::quiet())?;
        if self.inside.len() >= REMEMBERED {
            self.inside.remove(0);
        }
        self.inside.push((members.clone(), moment, ids.clone()));
        Ok(ids)
    }
}

/// The selection of a name.
pub(super) fn named<'a>(
    run: &RunFile,
    selections: &'a [SelectionSet],
    name: &str,
) -> Result<&'a SelectionSet, PictureError> {
    selections.iter().find(|set| set.name == name).ok_or_else(|| {
        let names: Vec<&str> = selections.iter().map(|set| set.name.as_str()).collect();
        let expected = if names.is_empty() { "all or none: there are no selections".into() } else { names.join(", ") };
        PictureError::of(run.path(), format!("paths: found {name}, expected {expected}"))
    })
}
