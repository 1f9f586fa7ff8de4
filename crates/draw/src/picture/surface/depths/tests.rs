//! Places and lines behind surfaces as these are drawn.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use super::*;
use crate::look::LookPatch;
use crate::picture::surface::fixtures::opened;
use crate::picture::surface::session::SurfaceSession;

const SIZE: (u32, u32) = (240, 160);

fn look(settings: &str) -> LookPatch {
    LookPatch { settings: ron::from_str(settings).unwrap(), ..LookPatch::default() }
}

fn depths(session: &mut SurfaceSession, look: &LookPatch, view: &View) -> SurfaceDepths {
    let picture = session.seen(look, view, None).unwrap().picture;
    SurfaceDepths::new(*view, picture.depth).unwrap()
}

#[test]
fn what_is_behind_a_ridge_is_hidden_as_high_as_it_stands() {
    let ridge = |x: f64, _: f64| 10.0 * (-(x / 6.0).powi(2)).exp();
    let mut session = opened("m", [161, 81], [-80.0, -40.0], 1.0, ridge);
    let opened = std::sync::Arc::clone(session.opened());
    for projection in [Projection::Perspective { fov_y: 0.7 }, Projection::Orthographic { height: 90.0 }] {
        // Low enough that it sees over the ridge where that is flat, and not where it stands three times as high.
        let eye = DVec3::new(-160.0, 0.0, 40.0);
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, projection, SIZE.0, SIZE.1).unwrap();
        for (settings, is_hidden) in [("{\"exaggeration\": 3.0}", true), ("{\"exaggeration\": 0.1}", false)] {
            let look = look(settings);
            let placed = opened.placed(&look.settings).unwrap();
            let seen = depths(&mut session, &look, &view);
            let at = |x: f64, y: f64| placed.world(40.0 - y, x + 80.0, ridge(x, y));
            for y in [-20.0, -3.5, 0.0, 11.0] {
                assert!(!seen.hides(at(-30.0, y)) && !seen.hides(at(-12.0, y)), "{settings}: in front, {y}");
                assert!(!seen.hides(at(0.0, y)), "{settings}: on the ridge, {y}");
                assert_eq!(seen.hides(at(18.0, y)), is_hidden, "{settings}: behind, {y}");
                assert!(seen.hides(at(18.0, y) - 20.0 * DVec3::Z), "below the ground");
                assert!(!seen.hides(at(18.0, y) + 60.0 * DVec3::Z), "above the ridge");
            }
            // A line across is hidden in one part, which begins behind the ridge.
            let line: Vec<DVec3> = (-40..=40).map(|x| at(f64::from(x), 5.0)).collect();
            let parts = pieces(&line, |place| seen.hides(place));
            let hidden: Vec<&Piece> = parts.iter().filter(|piece| piece.is_hidden).collect();
            assert_eq!(hidden.len(), usize::from(is_hidden), "{settings}: {parts:?}");
            assert!(hidden.iter().all(|piece| piece.places.iter().all(|place| place.x > -1.0)), "{settings}");
            let drawn: usize = parts.iter().map(|piece| piece.places.len() - 1).sum();
            assert_eq!(drawn, line.len() - 1, "every stretch is in one part");
        }
    }
}

#[test]
fn a_globe_hides_its_far_side() {
    let mut session =
        opened("deg", [73, 35], [-180.0, -85.0], 5.0, |x, y| 20_000.0 * (x / 30.0).sin() * y.to_radians().cos());
    let look = look("{\"map\": \"globe\", \"exaggeration\": 5.0}");
    let placed = session.opened().placed(&look.settings).unwrap();
    let eye = DVec3::new(2.6e7, 0.0, 0.0);
    let projection = Projection::Perspective { fov_y: 0.7 };
    let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, projection, SIZE.0, SIZE.1).unwrap();
    let seen = depths(&mut session, &look, &view);
    for (longitude, is_hidden) in
        [(0.0, false), (40.0, false), (-55.0, false), (110.0, true), (180.0, true), (-130.0, true)]
    {
        for latitude in [-30.0, 0.0, 25.0_f64] {
            let height = 20_000.0 * f64::sin(longitude / 30.0) * latitude.to_radians().cos();
            let place = placed.world((85.0 - latitude) / 5.0, (longitude + 180.0) / 5.0, height);
            assert_eq!(seen.hides(place), is_hidden, "{longitude} {latitude}");
        }
    }
    // Through the globe: seen at its near end alone.
    let chord: Vec<DVec3> = (0..=40).map(|step| DVec3::X * (7.5e6 - 4e5 * f64::from(step))).collect();
    let parts = pieces(&chord, |place| seen.hides(place));
    assert_eq!(parts.iter().map(|piece| piece.is_hidden).collect::<Vec<_>>(), [false, true]);
}
