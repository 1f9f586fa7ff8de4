//! A tour of any data: once around it, and a little into it.

use super::file::{Around, Keyframe, TourFile, What};
use crate::model::{StepTimes, When};

/// A tour around the data that takes so many seconds, 2 or more.
pub fn around_data(seconds: f64) -> TourFile {
    let look = |distance, elevation, azimuth| Around { what: What::Data, distance, azimuth, elevation, fov: 45.0 };
    let part = |share: f64, distance, elevation, azimuth, orbit| Keyframe {
        after: Some(share * seconds),
        around: Some(look(distance, elevation, azimuth)),
        orbit,
        ..Keyframe::default()
    };
    let mut tour = TourFile::new(vec![
        part(0.0, 2.9, 14.0, 0.0, 0.0),
        part(0.34, 2.3, 22.0, 110.0, 110.0),
        part(0.33, 1.6, 10.0, 230.0, 120.0),
        part(0.33, 2.9, 14.0, 360.0, 130.0),
    ]);
    tour.title = "Around the data".into();
    tour.repeats = true;
    // A short one turns as fast as it has to.
    tour.comfort.turn = tour.comfort.turn.max(700.0 / seconds.max(1.0));
    tour
}

/// Lets the data's time go evenly from the first step to the last while a tour lasts.
pub fn play_along(tour: &mut TourFile, times: &StepTimes) {
    let (Some(first), Some(last)) = (times.times.first(), times.times.last()) else { return };
    let total: f64 = tour.keyframes.iter().filter_map(|keyframe| keyframe.after).sum();
    let mut passed = 0.0;
    for keyframe in &mut tour.keyframes {
        passed += keyframe.after.unwrap_or(0.0);
        let share = if total > 0.0 { (passed / total).min(1.0) } else { 0.0 };
        // Exactly the last step at the end.
        keyframe.look.time = Some(When::Time(first * (1.0 - share) + last * share));
    }
}
