//! Particles, fields and heights that hide light from each other.

use super::*;
use crate::color::Colors;

/// The plane z = 0, and a ball of radius 0.6 that floats 1.5 above it.
fn ball_over_plane(folder: &Path) -> [Member; 2] {
    let plane = field(folder, "plane.asc", [61, 61], [-3.0, -3.0], 0.1, |_, _| 0.0);
    let ball = particles(folder, "ball.df", &[(DVec3::new(0.0, 0.0, 1.5), 1.2, 1.0)], "m", None);
    [Member::new(plane), Member::new(ball)]
}

fn colors(session: &mut MixedSession, shot: &Shot) -> Colors {
    let Raw::Light(light) = session.draw(shot).unwrap().values else { panic!("light") };
    light.colors
}

/// The ball's shadow lies on the plane where the sun casts it, and everywhere else the plane has its own light; the window's picture is the file's.
#[test]
fn a_ball_casts_the_suns_shadow_on_a_plane() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = open(&ball_over_plane(folder.path()), "m", SessionOptions::default());
    let own = |more: &str| {
        let sun = "\"azimuth\": 90.0, \"altitude\": 45.0, \"ambient\": 0.2, \"light-size\": 0.0";
        let settings = format!("{{{sun}, \"smoothing\": 0.0, \"threshold\": 1e-6{more}}}");
        shot(Some("spheres"), &settings, [0.0, 0.0, 8.0], Some(6.0))
    };
    let shadowed = own(", \"shadows\": 1.0");
    let [plain, found] = [own(""), shadowed.clone()].map(|shot| colors(&mut session, &shot));
    let left = 0.2 / (0.2 + 0.8 * 45.0_f32.to_radians().sin());
    let (mut dark, mut bright) = (0, 0);
    for (index, (before, after)) in plain.rgba.iter().zip(&found.rgba).enumerate() {
        let [x, y] = [(index % 160) as f64 - 79.5, 59.5 - (index / 160) as f64].map(|at| 0.05 * at);
        // Beyond its edge, and where the ball is.
        if x.abs() > 2.8 || y.abs() > 2.8 || x.hypot(y) < 0.7 {
            continue;
        }
        let share = after[1] / before[1];
        // A circle of 0.6, drawn out along the sun's way.
        let away = ((x + 1.5) / 2.0_f64.sqrt()).hypot(y);
        if away < 0.5 {
            dark += 1;
            assert!((share - left).abs() < 0.02, "{x} {y}: {share}, not {left}");
        } else if away > 0.7 {
            bright += 1;
            assert!(share == 1.0, "{x} {y}: {share}");
        }
    }
    assert!(dark > 300 && bright > 8000, "{dark} {bright}");
    let view = session.draw(&shadowed).unwrap().annotation.view;
    let (image, _) = session.image(&shadowed.look, &view, None, 2.0, u64::MAX).unwrap();
    assert!(image.rgba == found.image().rgba);
}

/// A plane between the sun and the ball takes the sun's light from the ball: it has the same lamp.
#[test]
fn a_plane_casts_its_shadow_on_a_ball() {
    let folder = tempfile::tempdir().unwrap();
    let [plane, ball] = ball_over_plane(folder.path());
    // Over the ball, seen from below.
    let over = Member { offset: DVec3::Z * 3.0, ..plane.clone() };
    let aside = Member { offset: DVec3::X * 50.0, ..plane };
    let draw = |plane: Member| {
        let mut session = open(&[plane, ball.clone()], "m", SessionOptions::default());
        let settings = "{\"azimuth\": 90.0, \"altitude\": 80.0, \"ambient\": 0.25, \"light-size\": 0.0, \"shadows\": 1.0, \
                        \"smoothing\": 0.0, \"threshold\": 1e-6}";
        let mut own = shot(Some("spheres"), settings, [6.0, 0.0, 1.5], Some(3.0));
        own.camera.target = Some([0.0, 0.0, 1.5]);
        colors(&mut session, &own)
    };
    let [shaded, free] = [over, aside].map(draw);
    // The upper half of the ball, where the sun is high over it.
    let mut seen = 0;
    for (row, column) in (38..48).flat_map(|row| (75..85).map(move |column| (row, column))) {
        let [shaded, free] = [&shaded, &free].map(|colors| colors.rgba[row * 160 + column]);
        assert!(free[3] == 1.0 && shaded[3] == 1.0);
        let share = shaded[1] / free[1];
        assert!((share - 0.25).abs() < 0.05, "{row} {column}: {share}");
        seen += 1;
    }
    assert_eq!(seen, 100);
}
