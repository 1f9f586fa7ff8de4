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

/// Regions whose members are remembered.
const REMEMBERED: usize = 8;

impl Found {
    /// The ids of those whose paths are drawn; `None` for all. Who is in a region is asked for the present.
    pub fn of(&mut self, run: &Arc<RunFile>, request: &PathRequest<'_>) -> Result<Option<IdSet>, PictureError> {
        let names = match request.of {
            PathsOf::All => return Ok(None),
            PathsOf::None => return Ok(Some(IdSet::default())),
            PathsOf::Selections(names) => names,
        };
        let mut all = IdSet::default();
        for name in names {
            let set = named(run, request.selections, name)?;
            let ids = match self.followed(run, &set.members)? {
                Some(followed) => followed.ids().clone(),
                None => self.in_region(run, &set.members, request.moment, request.interpolation)?,
            };
            all = if all.is_empty() { ids } else { all.union(&ids) };
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
