//! The ground: while one turns around something the eye stays above it.

use super::{Anchor, Flight, Navigation, Viewpoint};
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
use std::sync::Arc;

/// How high the eye has to be.
#[derive(Resource, Clone, Default)]
pub struct Ground {
    /// What says the least `z` at a place, if anything, for who turns around something.
    pub least: Option<Arc<dyn Fn(DVec3) -> Option<f64> + Send + Sync>>,
    /// What says how far an eye is to be lifted, whoever moves it.
    pub lift: Option<Arc<dyn Fn(DVec3) -> Option<DVec3> + Send + Sync>>,
}

/// Lifts eyes that turn around something below the ground, and where something says so all others; else who flies goes anywhere.
pub(super) fn stay_above(
    ground: Res<Ground>,
    mut cameras: Query<(&Navigation, Has<Flight>, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera)>,
) {
    for (navigation, in_flight, mut viewpoint, mut anchor, mut orbit) in &mut cameras {
        // What looks at the ground itself is asked no more often than something moves.
        if let Some(lift) = ground.lift.as_ref().filter(|_| ground.is_changed() || viewpoint.is_changed())
            && let Some(lift) = lift(viewpoint.eye)
        {
            *viewpoint = Viewpoint { eye: viewpoint.eye + lift, target: viewpoint.target + lift, ..*viewpoint };
            *anchor = anchor.adopt(&viewpoint, &mut orbit);
        }
        let Some(least) = &ground.least else { continue };
        if *navigation != Navigation::Orbit || in_flight {
            continue;
        }
        let Some(least) = least(viewpoint.eye).filter(|least| viewpoint.eye.z < *least) else { continue };
        let eye = DVec3::new(viewpoint.eye.x, viewpoint.eye.y, least);
        // An eye above what it turns around has no direction.
        if eye.distance(viewpoint.target) <= 1e-9 * viewpoint.distance() {
            continue;
        }
        let (yaw, pitch) = anchor.upright.angles((eye - viewpoint.target).normalize());
        let (_, up) = anchor.upright.back_and_up(yaw, pitch);
        *viewpoint = Viewpoint { eye, up, ..*viewpoint };
        *anchor = anchor.adopt(&viewpoint, &mut orbit);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Upright;
    use super::*;

    #[test]
    fn an_eye_below_the_ground_is_lifted_and_looks_where_it_did() {
        let mut app = App::new();
        let least = |eye: DVec3| (eye.x.abs() < 100.0).then_some(10.0);
        app.insert_resource(Ground { least: Some(Arc::new(least)), lift: None });
        app.add_systems(Update, stay_above);
        let mut add = |eye: DVec3, navigation: Navigation| {
            let viewpoint = Viewpoint { eye, target: DVec3::new(0.0, 0.0, 5.0), up: DVec3::Z, fov_y: 0.8 };
            let mut orbit = PanOrbitCamera::default();
            let anchor = Anchor { upright: Upright::Z, ..Anchor::default() }.adopt(&viewpoint, &mut orbit);
            app.world_mut().spawn((viewpoint, orbit, anchor, navigation)).id()
        };
        let below = add(DVec3::new(30.0, -40.0, 2.0), Navigation::Orbit);
        let kept = [
            add(DVec3::new(30.0, -40.0, 12.0), Navigation::Orbit),
            add(DVec3::new(130.0, -40.0, 2.0), Navigation::Orbit),
            add(DVec3::new(30.0, -40.0, 2.0), Navigation::Fly),
        ];
        let at = |app: &App, camera| *app.world().get::<Viewpoint>(camera).unwrap();
        let before = kept.map(|camera| at(&app, camera));
        app.update();
        assert_eq!(before, kept.map(|camera| at(&app, camera)));
        let lifted = at(&app, below);
        assert_eq!((lifted.eye, lifted.target.z), (DVec3::new(30.0, -40.0, 10.0), 5.0));
        assert!(lifted.up.z > 0.9 && lifted.up.dot(lifted.back()).abs() < 1e-9);
        // With a clearance nobody goes below it, and all look the same way.
        let lift = |eye: DVec3| (eye.z < 20.0).then(|| DVec3::new(0.0, 0.0, 20.0 - eye.z));
        app.insert_resource(Ground { least: None, lift: Some(Arc::new(lift)) });
        app.update();
        for (camera, before) in kept.into_iter().zip(before) {
            let after = at(&app, camera);
            let lift = DVec3::new(0.0, 0.0, 20.0 - before.eye.z);
            assert_eq!((after.eye, after.target), (before.eye + lift, before.target + lift));
        }
    }
}
