//! The selection that the camera follows: where its centre of mass is, in the open file or among particles that move.

use super::asking::Asking;
use super::followed::FollowedSets;
use crate::explore::{Center, CenterSums, ExploreError, Members, Region, Shapes, center};
use crate::model::{Dataset, Family};
use crate::view::Periodic;
use crate::window::camera::Follow;
use crate::window::live::LiveParticles;
use crate::window::open::Opened;
use crate::window::scene::{RunNow, Scene, Settings};
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use bevy::math::DVec3;
use bevy::prelude::*;
use rayon::prelude::*;

/// The centre of what is followed.
#[derive(Resource, Default)]
pub struct FollowedSelection {
    /// Whose centre was asked for, and the file.
    asked: Option<(u32, Members)>,
    answer: Answer<Option<Center>>,
    /// The last one that is known; it stays while the next one is worked out.
    center: Option<Center>,
    live: Option<LiveRows>,
    /// A button of the panel asks to fly to it.
    pub approach: bool,
}

/// The particles among those that move which were in the selection when following began: they are followed wherever they go.
struct LiveRows {
    of: (u32, Members),
    /// By family.
    rows: Vec<Vec<u32>>,
    /// The state whose centre is known.
    state: u64,
}

impl FollowedSelection {
    /// Where what is followed is, if anything is and that is known.
    pub fn center(&self) -> Option<DVec3> {
        Some(self.center?.position)
    }

    /// Whether its centre is being worked out.
    pub fn is_coming(&self) -> bool {
        matches!(self.answer, Answer::Coming(_))
    }
}

/// Finds the centre of the selection that is followed, and tells the camera.
pub(super) fn find_center(
    mut following: ResMut<FollowedSelection>,
    mut follow: ResMut<Follow>,
    mut opened: MessageReader<Opened>,
    scene: Option<Res<Scene>>,
    settings: Res<Settings>,
    live: Res<LiveParticles>,
    sets: Res<FollowedSets>,
    mut notices: ResMut<Notices>,
) {
    let (following, follow) = (following.bypass_change_detection(), follow.bypass_change_detection());
    // A scene says where the camera stands.
    if opened.read().last().is_some_and(|opened| opened.scene.is_some()) {
        following.center = None;
        follow.settle();
    }
    let followed = settings.selections.iter().find(|set| set.follow);
    let (Some(scene), Some(set)) = (scene, followed) else {
        *following = FollowedSelection::default();
        *follow = Follow::default();
        return;
    };
    if std::mem::take(&mut following.approach) {
        // Where another one was is not where to fly to.
        following.center = None;
        follow.approach = true;
    }
    let periodic = scene.periodic.map(|periodic| periodic.edge);
    let key = (scene.generation, set.members.clone());
    match (live.particles(), &set.members) {
        // What moves is known by its place alone, not by ids.
        (Some(particles), Members::Region(region)) => {
            follow_live(following, particles, (live.state(), key), region, periodic);
        }
        // Of a run, who stays the same is where their tracks are.
        (None, members) if members.stay() && scene.following.is_some() => {
            (following.live, following.asked, following.answer) = (None, None, Answer::Nothing);
            let center = RunNow::of(&scene).and_then(|now| sets.center(members, &now));
            following.center = center.or(following.center);
        }
        _ => {
            following.live = None;
            if following.asked.as_ref() != Some(&key) {
                let (asking, members) = (Asking::about(&scene, &key.1, false), key.1.clone());
                following.answer = Answer::ask("centre", move |work| {
                    asking.ask(&members, work, |data, members, periodic| center(data, members, periodic, work))
                });
                following.asked = Some(key);
            }
            if following.answer.receive() {
                match &following.answer {
                    Answer::Here(Some(center)) => following.center = Some(*center),
                    Answer::Here(None) => notices.error(format!("{}: no particle of it is here to follow", set.name)),
                    Answer::Failed(why) => notices.error(format!("{} cannot be followed: {why}", set.name)),
                    Answer::Nothing | Answer::Coming(_) => {}
                }
            }
        }
    }
    follow.goal = following.center();
    follow.edge = periodic.filter(|_| settings.cut.periodic != Periodic::Once);
}

/// Follows particles that move.
fn follow_live(
    following: &mut FollowedSelection,
    particles: &Dataset,
    (state, key): (u64, (u32, Members)),
    region: &Region,
    periodic: Option<f64>,
) {
    following.asked = None;
    let sizes = particles.families.iter().map(Family::len);
    let fits = |live: &LiveRows| live.of == key && live.rows.len() == sizes.len();
    if !following.live.as_ref().is_some_and(fits) {
        // Regions that make no sense were refused where they came from.
        let rows = rows_in(particles, region, periodic).unwrap_or_default();
        following.live = Some(LiveRows { of: key, rows, state: u64::MAX });
    }
    let Some(rows) = following.live.as_mut().filter(|rows| rows.state != state) else { return };
    rows.state = state;
    if let Some(center) = center_of(particles, &rows.rows, periodic) {
        following.center = Some(center);
    }
}

/// The particles in a region, by family.
fn rows_in(particles: &Dataset, region: &Region, periodic: Option<f64>) -> Result<Vec<Vec<u32>>, ExploreError> {
    let shapes = Shapes::new(region, periodic)?;
    let of_family = |family: &Family| {
        let column = |name: &str| match name {
            "mass" => Some(&family.mass),
            "density" => Some(&family.density),
            "smoothing-length" => Some(&family.smoothing_length),
            name => family.attribute(name).map(|attribute| &attribute.values),
        };
        let ranges: Option<Vec<_>> = region.ranges.iter().map(|range| Some((range, column(&range.field)?))).collect();
        let Some(ranges) = ranges.filter(|_| !region.leaves_out(family.name)) else { return Vec::new() };
        let is_in = |&row: &u32| {
            let row = row as usize;
            shapes.contains(DVec3::from(family.positions[row]))
                && ranges.iter().all(|(range, values)| range.contains(f64::from(values[row])))
        };
        (0..family.len() as u32).into_par_iter().filter(is_in).collect()
    };
    Ok(particles.families.iter().map(of_family).collect())
}

/// The centre of mass of these particles.
fn center_of(particles: &Dataset, rows: &[Vec<u32>], periodic: Option<f64>) -> Option<Center> {
    /// Particles that are added up before threads share what they have.
    const RUN: usize = 1 << 15;
    let mut whole = CenterSums::new(periodic);
    for (family, rows) in particles.families.iter().zip(rows) {
        let run = |rows: &[u32]| {
            let mut sums = CenterSums::new(periodic);
            // A system may show fewer particles than before.
            for (at, mass) in rows
                .iter()
                .filter_map(|&row| Some((family.positions.get(row as usize)?, family.mass.get(row as usize)?)))
            {
                sums.add(DVec3::from(*at), f64::from(*mass));
            }
            sums
        };
        rows.par_chunks(RUN).map(run).collect::<Vec<_>>().iter().for_each(|sums| whole.join(sums));
    }
    whole.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::merger::Merger;

    #[test]
    fn particles_that_move_are_followed_wherever_they_go() {
        let mut particles = crate::synth::dataset(&Merger::new(3, 3000));
        let bounds = particles.bounds();
        let region = Region::sphere(bounds.center(), 0.3 * bounds.size().max_element())
            .with_range("mass", Some(0.0), None)
            .with_family(particles.families[0].name);
        let rows = rows_in(&particles, &region, None).unwrap();
        let shapes = Shapes::new(&region, None).unwrap();
        let family = &particles.families[0];
        let inside: Vec<usize> = (0..family.len()).filter(|&i| shapes.contains(family.positions[i].into())).collect();
        assert!(!inside.is_empty() && inside.len() < family.len());
        assert!(rows[0].iter().map(|&row| row as usize).eq(inside.iter().copied()));

        let mass: f64 = inside.iter().map(|&i| f64::from(family.mass[i])).sum();
        let moment: DVec3 = inside.iter().map(|&i| DVec3::from(family.positions[i]) * f64::from(family.mass[i])).sum();
        let mut following = FollowedSelection::default();
        let key = (1, Members::Region(region.clone()));
        follow_live(&mut following, &particles, (1, key.clone()), &region, None);
        let first = following.center().unwrap();
        assert!(first.distance(moment / mass) < 1e-9 * bounds.size().length());
        // Out of the region, all of them.
        let by = 10.0 * bounds.size();
        particles.families[0].positions.iter_mut().for_each(|at| *at = (DVec3::from(*at) + by).to_array());
        follow_live(&mut following, &particles, (2, key), &region, None);
        assert!(following.center().unwrap().distance(first + by) < 1e-9 * by.length());
    }

    #[test]
    fn a_field_that_is_not_there_selects_nothing() {
        let particles = crate::synth::dataset(&Merger::new(3, 100));
        let region = Region::whole().with_range("colour", None, Some(1.0));
        let rows = rows_in(&particles, &region, None).unwrap();
        assert!(rows.iter().all(Vec::is_empty));
        assert_eq!(center_of(&particles, &rows, None), None);
    }
}
