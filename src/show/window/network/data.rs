//! Where a follower has the data that the leader shows: each machine has a copy of its own, or reads what lies behind the same URL.

use crate::look::{DatasetRef, Fingerprint, Member};
use crate::model::is_url;
use bevy::math::DVec3;
use std::path::{Path, PathBuf};

/// The follower's own data, and what the presenter should know about it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// The datasets to open.
    pub members: Vec<Member>,
    /// A sentence each.
    pub notes: Vec<String>,
}

/// Finds the leader's datasets on this machine: among what the command line names, where the leader has them, or beside either; the
/// file with the leader's fingerprint where there is one. `named`: what the command line names, in the order of the datasets.
///
/// # Errors
/// In a sentence, where there is nothing to show.
pub fn find(datasets: &[DatasetRef], named: &[PathBuf]) -> Result<Found, String> {
    let mut found = Found::default();
    for (i, dataset) in datasets.iter().enumerate() {
        let path = one(dataset, named.get(i), named, &mut found.notes)?;
        let (offset, scale) = (DVec3::from(dataset.offset), dataset.scale);
        let (said, own_look) = (dataset.said.clone(), dataset.own_look.clone());
        found.members.push(Member { path, offset, scale, families: None, said, own_look });
    }
    Ok(found)
}

fn one(
    dataset: &DatasetRef,
    own: Option<&PathBuf>,
    named: &[PathBuf],
    notes: &mut Vec<String>,
) -> Result<PathBuf, String> {
    let mut places: Vec<PathBuf> = own.into_iter().chain(named).cloned().collect();
    places.push(dataset.path.clone());
    if let Some(name) = dataset.path.file_name() {
        places.extend(named.iter().filter_map(|path| path.parent()).map(|folder| folder.join(name)));
        places.push(PathBuf::from(name));
    }
    let fingerprint_of = |path: &PathBuf| Fingerprint::of(path).ok();
    let mut there = places.iter().filter_map(|path| Some((path, fingerprint_of(path)?)));
    let first = there.next();
    let same = |fingerprint: &Fingerprint| dataset.fingerprint.is_none_or(|known| known == *fingerprint);
    match first {
        Some((path, fingerprint)) if same(&fingerprint) => return Ok(path.clone()),
        Some(_) => {}
        // Why it cannot be read is told where it is opened.
        None if is_url(&dataset.path) => return Ok(dataset.path.clone()),
        None => {
            let path = dataset.path.display();
            return Err(format!(
                "the data is not here: neither {path} nor a copy beside; name it: deepfield view DATA --follow ..."
            ));
        }
    }
    if let Some((path, _)) = there.find(|(_, fingerprint)| same(fingerprint)) {
        return Ok(path.clone());
    }
    let path = first.map(|(path, _)| path.clone()).unwrap_or_default();
    notes.push(format!("{} is not the file that the leader shows ({})", path.display(), name(&dataset.path)));
    Ok(path)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::OwnLook;
    use crate::modes;

    #[test]
    fn the_file_with_the_fingerprint_is_taken_wherever_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["lead", "mine"] {
            std::fs::create_dir(at(name)).unwrap();
        }
        let leaders = at("lead/box.df");
        std::fs::write(&leaders, b"the data").unwrap();
        let fingerprint = Fingerprint::of(&leaders).ok();
        let dataset = DatasetRef {
            path: leaders.clone(),
            fingerprint,
            families: None,
            offset: [1.0, 2.0, 3.0],
            scale: Some(2.0),
            own_look: Some(OwnLook { mode: modes::find("isosurface"), ..OwnLook::default() }),
            ..DatasetRef::default()
        };
        let of = |named: &[PathBuf]| find(std::slice::from_ref(&dataset), named);
        let found = of(&[]).unwrap();
        assert!(found.members[0].path == leaders && found.notes.is_empty());
        assert_eq!((found.members[0].offset, found.members[0].scale), (DVec3::new(1.0, 2.0, 3.0), Some(2.0)));
        assert_eq!(found.members[0].own_look, dataset.own_look);
        // A copy of another name.
        std::fs::write(at("mine/copy.df"), b"the data").unwrap();
        assert_eq!(of(&[at("mine/copy.df")]).unwrap().members[0].path, at("mine/copy.df"));
        // Another file is named: one that is the same is preferred, and else it is told.
        std::fs::write(at("mine/other.df"), b"other data").unwrap();
        assert_eq!(of(&[at("mine/other.df")]).unwrap().members[0].path, leaders);
        std::fs::rename(&leaders, at("mine/box.df")).unwrap();
        assert_eq!(of(&[at("mine/other.df")]).unwrap().members[0].path, at("mine/box.df"), "beside");
        std::fs::remove_file(at("mine/box.df")).unwrap();
        let other = of(&[at("mine/other.df")]).unwrap();
        assert!(
            other.members[0].path == at("mine/other.df") && other.notes[0].contains("is not the file"),
            "{other:?}"
        );
        assert!(of(&[]).unwrap_err().contains("the data is not here"));
        // What the leader reads from afar, followers do, too; no server is asked for this one.
        let afar = DatasetRef { path: "http://data.example/box.df".into(), ..dataset.clone() };
        let found = find(std::slice::from_ref(&afar), &[]).unwrap();
        assert!(found.members[0].path == afar.path && found.notes.is_empty());
    }
}
