//! What is drawn for a command, from what, and by what: the picture that is wanted, without how the command line said it.

use crate::cpu::Method;
use crate::look::{Backend, LookPatch, Member, SceneFile, Shot};
use crate::model::FamilyName;
use std::path::{Path, PathBuf};

/// A picture for a command.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// The datasets that are drawn: one or more.
    pub members: Vec<Member>,
    /// The picture.
    pub shot: Shot,
    /// The one family that is drawn.
    pub family: Option<FamilyName>,
    /// What draws; the best there is where it is `None`.
    pub backend: Option<Backend>,
    /// Draws every source particle at full precision, in this way; the page file where it is `None`.
    pub exact: Option<Method>,
    /// Where a picture of how many splats lie over each pixel goes.
    pub overdraw: Option<PathBuf>,
    /// How many times it is drawn; 0 counts as 1.
    pub repeat: u32,
    /// What messages about settings name: the file that has them, or the data.
    pub named: PathBuf,
}

impl Request {
    /// A picture of this data.
    pub fn new(data: &Path, shot: Shot) -> Request {
        Request { members: vec![Member::new(data)], shot, named: data.to_owned(), ..Request::default() }
    }

    /// What the picture looks like.
    pub fn look(&self) -> &LookPatch {
        &self.shot.look
    }

    /// The path of the first dataset.
    pub fn path(&self) -> &Path {
        self.members.first().map_or(Path::new(""), |member| member.path.as_path())
    }

    /// How many times it is drawn.
    pub fn times(&self) -> u32 {
        self.repeat.max(1)
    }

    /// The picture that a film blends this one with: another scene of the same data, as large, drawn by the same.
    pub fn before(&self, from: &SceneFile) -> Request {
        let mut members = self.members.clone();
        if let (Some(first), Some(dataset)) = (members.first_mut(), from.datasets.first()) {
            first.families = dataset.families.clone().or_else(|| from.look.families.clone());
        }
        let mut shot = Shot::of_scene(from.clone(), Path::new(""));
        shot.size = self.shot.size;
        shot.look.background = self.shot.look.background;
        let (backend, exact, named) = (self.backend, self.exact, self.named.clone());
        Request { members, shot, backend, exact, named, ..Request::default() }
    }
}
