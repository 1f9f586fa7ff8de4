//! How the particles are named on the command line that are asked for wherever they are: by ids, by where they were at another time, or
//! as a scene's selection.

use super::arguments::Given;
use super::region_options::{At, RegionOptions};
use crate::explore::{Data, Following, IdSet, Members, Work};
use crate::look::{DataKind, SceneFile, data_file};
use crate::model::{ReadMethod, When};
use crate::store::RunFile;
use crate::store::run::RunSnapshot;
use std::path::{Path, PathBuf};
use std::sync::Arc;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Which particles, other than those of a region.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct MembersOptions {
    /// The particles with the ids in this file, instead of a region.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sphere", "cuboid", "region", "ranges", "family", "at", "object", "tracked_at"])]
    pub ids: Option<PathBuf>,
    /// The particles that are in the region at this time of the run, wherever they are when it is asked.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub tracked_at: Option<When>,
    /// The selection of that name of a scene file, instead of a region.
    #[arg(long, value_name = "FILE.ron#NAME", conflicts_with_all = ["sphere", "cuboid", "region", "ranges", "family", "at", "object", "tracked_at", "ids"])]
    pub selection: Option<String>,
}

impl MembersOptions {
    /// The options, and which of them are given.
    pub fn given(&self) -> [Given; 3] {
        let MembersOptions { ids, tracked_at, selection } = self;
        [("--ids", ids.is_some()), ("--tracked-at", tracked_at.is_some()), ("--selection", selection.is_some())]
    }

    /// Whether a region alone is named.
    pub fn is_region(&self) -> bool {
        self.ids.is_none() && self.tracked_at.is_none() && self.selection.is_none()
    }

    /// The members in `data`.
    ///
    /// # Errors
    /// When a file that is named cannot be read, or has no such object or selection.
    pub fn members(&self, region: &RegionOptions, data: Data) -> Result<Members, Failure> {
        if let Some(ids) = &self.ids {
            return Ok(Members::Ids(IdSet::read(ids)?));
        }
        if let Some(selection) = &self.selection {
            let expected = "--selection: expected FILE.ron#NAME such as show.scene.ron#halo";
            let (path, name) = selection.rsplit_once('#').ok_or(expected)?;
            let scene = SceneFile::read(Path::new(path))?;
            let sets = scene.look.selections.unwrap_or_default();
            let names: Vec<&str> = sets.iter().map(|set| set.name.as_str()).collect();
            let absent = || format!("{path}: selections: found {}, expected one named {name}", names.join(", "));
            return Ok(sets.iter().find(|set| set.name == name).ok_or_else(absent)?.members.clone());
        }
        let region = region.region(data)?;
        Ok(match self.tracked_at {
            Some(at) => Members::Tracked { at, region },
            None => Members::Region(region),
        })
    }
}

/// A run with what follows selections in it.
pub struct OpenRun {
    /// The run.
    pub run: Arc<RunFile>,
    /// What follows, where it has tracks.
    pub following: Option<Following>,
    /// Who is asked for.
    pub members: Members,
}

impl OpenRun {
    /// Opens a run; `None` where the path names none.
    ///
    /// # Errors
    /// When it cannot be read, and as [`MembersOptions::members`].
    pub fn open(
        path: &Path,
        options: &MembersOptions,
        region: &RegionOptions,
        method: ReadMethod,
    ) -> Result<Option<OpenRun>, Failure> {
        let path = data_file(path)?;
        if DataKind::of(&path)? != DataKind::Run {
            return Ok(None);
        }
        let run = Arc::new(RunFile::open(&path, method)?);
        // Units alone are asked for, which all steps share.
        let members = options.members(region, Data::Pages(&run.placed_still(0)?))?;
        Ok(Some(OpenRun { following: Following::new(Arc::clone(&run)), run, members }))
    }

    /// The members at a moment where they stay the same; `None` of a region, or without tracks.
    ///
    /// # Errors
    /// When the run cannot be read, or has no such time.
    pub fn snapshot(&self, when: At, work: Work) -> Result<Option<RunSnapshot>, Failure> {
        let Some(following) = self.following.as_ref().filter(|_| self.members.stay()) else { return Ok(None) };
        let moment = self.run.moment(when.time.unwrap_or(When::Step(0)))?;
        let interpolation = when.interpolation.unwrap_or_default();
        Ok(Some(following.snapshot(&self.members, moment, interpolation, work)?.0))
    }
}
