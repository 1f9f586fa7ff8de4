//! Whose paths are drawn: names of selections become ids.

use super::PathRequest;
use crate::explore::{IdSet, Members, SelectionSet, Work, ids_of};
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::PathsOf;
use crate::model::Moment;
use crate::picture::PictureError;
use crate::store::run::RunFile;
use std::sync::Arc;

/// Who is in regions, as it was found last.
#[derive(Default)]
pub(super) struct Found(Vec<(Members, Moment, IdSet)>);

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
            let ids = match set.members.ids() {
                Some(ids) => ids.clone(),
                None => self.in_region(run, &set.members, request.moment, request.interpolation)?,
            };
            all = if all.is_empty() { ids } else { all.union(&ids) };
        }
        Ok(Some(all))
    }

    fn in_region(
        &mut self,
        run: &Arc<RunFile>,
        members: &Members,
        moment: Moment,
        interpolation: Interpolation,
    ) -> Result<IdSet, PictureError> {
        if let Some((.., ids)) = self.0.iter().find(|(known, at, _)| (known, *at) == (members, moment)) {
            return Ok(ids.clone());
        }
        let periodic = run.tracks()?.box_size;
        let ids = ids_of(&run.at(moment, interpolation)?, members, periodic, Work::quiet())?;
        if self.0.len() >= REMEMBERED {
            self.0.remove(0);
        }
        self.0.push((members.clone(), moment, ids.clone()));
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
