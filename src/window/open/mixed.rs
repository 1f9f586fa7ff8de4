//! Opening several kinds of data, or several of one that is no particles: as one scene, which the processor draws.

use super::heights::check_map;
use super::sketch::sketched;
use super::{Opened, Seen};
use crate::look::{HeightsSaid, Member};
use crate::mode::{SettingValue, Settings};
use crate::model::progress::Progress;
use crate::model::{ReadMethod, When};
use crate::picture::PictureError;
use crate::picture::field::MEMORY;
use crate::picture::mixed::OpenMixed;
use crate::stream::first_frame;
use crate::window::options::Opener;
use crate::window::sampled::Sampled;
use crate::window::scene::SceneField;
use std::path::Path;
use std::sync::Arc;

/// Opens datasets of which one at least is no particles; pages of those that are take at most `page_memory` bytes.
///
/// # Errors
/// When they cannot be read, or built, or do not fit together.
pub(super) fn open_mixed(
    members: Vec<Member>,
    seen: &Seen,
    (read, time): (ReadMethod, Option<When>),
    page_memory: u64,
    opener: &Opener,
    progress: &dyn Progress,
) -> Result<Opened, String> {
    let members = members.iter().map(Member::resolved).collect::<Result<Vec<_>, _>>();
    let members = members.map_err(|error| error.to_string())?;
    let look = seen.scene.as_ref().map(|opened| &opened.scene.look);
    let map = seen.map.clone().map(SettingValue::Name);
    let map = map.or_else(|| look.and_then(|look| look.settings.0.get("map").cloned()));
    let settings = Settings(map.map(|map| ("map".to_owned(), map)).into_iter().collect());
    let built = |path: &Path, said: &HeightsSaid| opener(path, said, progress).map_err(PictureError::Asked);
    let when = time.or(look.and_then(|look| look.time));
    let opened = OpenMixed::open(&members, (read, when), [MEMORY, page_memory], &settings, built);
    let (opened, notes) = opened.map_err(|error| error.to_string())?;
    for field in opened.heights() {
        check_map(&field.member.path, &field.opened.file().about().grid, seen)?;
    }
    let sampled = Sampled::Mixed(Arc::new(opened));
    let particles = sampled.mixed().and_then(|opened| opened.particles().cloned());
    // Where there are none, a few samples of the first of the others stand in.
    let (file, folder) = match particles {
        Some(file) => (file, None),
        None => {
            let (file, folder) = sketched(&sampled)?;
            (Arc::new(file), Some(Arc::new(folder)))
        }
    };
    let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
    let own = sampled.mixed().filter(|opened| opened.usual_mode().takes_fields() || opened.particles().is_none());
    let frame = match own {
        Some(opened) => opened.bounds(&settings).map_err(|error| error.to_string())?,
        None => first_frame(&*file, &families, 0.0),
    };
    Ok(Opened {
        path: members.first().map(|member| member.path.clone()).unwrap_or_default(),
        members,
        notes,
        run: None,
        tracks: None,
        field: Some(SceneField { sketch: folder, ..SceneField::new(sampled) }),
        file,
        frame,
        scene: seen.scene.clone().map(Arc::new),
        map: seen.map.clone(),
        keeps: false,
        has_more: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::{BuildOptions, build_source};
    use crate::explore::export::grid::{GridFormat, write_grid};
    use crate::heights::OpenHeights;
    use crate::heights::build::HeightBuildOptions;
    use crate::import::LoadOptions;
    use crate::look::say;
    use crate::model::{Channel, Grid, SampleType, Unit};
    use crate::modes;
    use crate::window::facts::Facts;
    use std::path::PathBuf;

    /// A field of text, and a file of particles.
    fn data(folder: &Path) -> [PathBuf; 2] {
        let [field, particles] = ["field.asc", "demo.df"].map(|name| folder.join(name));
        let head = "ncols 3\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 10\n";
        std::fs::write(&field, format!("{head}1 2 3\n4 5 -1\n")).unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &particles, &()).unwrap();
        [field, particles]
    }

    #[test]
    fn heights_are_opened_among_particles_with_what_is_said_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let [field, particles] = data(folder.path());
        let built = folder.path().join("built.df");
        let opener: Opener = Arc::new(move |path, said, progress| {
            if path.extension().is_some_and(|extension| extension == "df") {
                return Ok(path.to_owned());
            }
            let heights = OpenHeights::open(path, &said.options(ReadMethod::default()));
            let heights = heights.map_err(|error| error.to_string())?;
            let done = heights.build(&HeightBuildOptions::default(), &built, progress);
            done.map(|_| built.clone()).map_err(|error| error.to_string())
        });
        let open = |paths: [&PathBuf; 2], map: Option<&str>| {
            let mut members = paths.map(Member::new).to_vec();
            say(&mut members, &HeightsSaid { nodata: Some(-1.0), ..HeightsSaid::default() });
            let seen = Seen { scene: None, map: map.map(str::to_owned) };
            open_mixed(members, &seen, (ReadMethod::default(), None), 1 << 30, &opener, &())
        };
        for (paths, index) in [([&field, &particles], 0), ([&particles, &field], 1)] {
            let opened = open(paths, None).unwrap();
            let mixed = opened.field.as_ref().unwrap().opened.mixed().cloned().unwrap();
            let fields = mixed.heights();
            assert_eq!((fields.len(), fields[0].index, opened.members.len()), (1, index, 2));
            assert_eq!(fields[0].opened.file().about().facts.valid, 5, "what is said goes into the file");
            assert_eq!(opened.file.metadata().particles(), mixed.particles().unwrap().metadata().particles());
            assert_eq!(mixed.begins_with_heights(), index == 0);
            // The panel tells both.
            let sampled = &opened.field.as_ref().unwrap().opened;
            let facts = Facts::of(&opened.file, &sampled.of_particles(&opened.members)).with_samples(sampled);
            let (kind, fact) = &facts.sampled[0];
            assert_eq!((facts.sampled.len(), *kind, fact.index, &*fact.name), (1, "Heights", index, "field.asc"));
            assert!(facts.rows.contains(&("Datasets", "2".to_owned())) && !facts.families.is_empty());
        }
        // Fields alone: a few of their samples stand in for particles.
        let opened = open([&field, &field], None).unwrap();
        let sampled = &opened.field.as_ref().unwrap().opened;
        let facts = Facts::of(&opened.file, &sampled.of_particles(&opened.members)).with_samples(sampled);
        assert!(facts.families.is_empty() && facts.sampled.len() == 2 && sampled.has_z_up());
        let refused = open([&field, &particles], Some("globe")).err().unwrap();
        assert!(refused.starts_with(&format!("{}: ", field.display())) && refused.contains("globe"), "{refused}");
    }

    #[test]
    fn volumes_are_opened_among_particles_as_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let [_, particles] = data(folder.path());
        let mut grid = Grid::volume([6, 5, 4], SampleType::U8, Channel::numbered(1));
        grid.length_unit = Unit::new("m");
        let volume = folder.path().join("volume.nrrd");
        let samples: Vec<u8> = (0..120).collect();
        write_grid(&volume, GridFormat::Nrrd, &grid, &samples).unwrap();
        let opener: Opener = Arc::new(|path, _, _| Ok(path.to_owned()));
        for (paths, index) in [([&particles, &volume], 1), ([&volume, &particles], 0)] {
            let members = paths.map(Member::new).to_vec();
            let seen = Seen { scene: None, map: None };
            let opened = open_mixed(members, &seen, (ReadMethod::default(), None), 1 << 30, &opener, &()).unwrap();
            let sampled = &opened.field.as_ref().unwrap().opened;
            let mixed = sampled.mixed().unwrap();
            assert!(mixed.heights().is_empty() && mixed.particles().is_some() && !sampled.has_z_up());
            let facts = Facts::of(&opened.file, &sampled.of_particles(&opened.members)).with_samples(sampled);
            let (kind, fact) = &facts.sampled[0];
            assert_eq!((facts.sampled.len(), *kind, fact.index, &*fact.name), (1, "Volume", index, "volume.nrrd"));
            let is_first = index == 0;
            assert_eq!(sampled.usual_mode().name, if is_first { "volume" } else { "column-density" });
            let draws = |name: &str| sampled.is_drawn_by(modes::find(name).unwrap());
            assert!(draws("volume") && draws("slice") && draws("points") && !draws("xray") && !draws("surface"));
            // What both draw is about the first; what a picture is about has its channels.
            let told = |name: &str| sampled.is_told_by(modes::find(name).unwrap());
            assert_eq!((told("volume"), told("slice"), told("points")), (is_first, true, false));
            assert_eq!(sampled.of_particles(&["a", "b"]), if is_first { ["b"] } else { ["a"] });
            let size = opened.frame.size();
            assert_eq!((size - glam::DVec3::new(6.0, 5.0, 4.0)).length() < 1e-9, is_first, "{size}");
        }
    }
}
