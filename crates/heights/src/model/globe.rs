//! Spheres and ellipsoids that fields in degrees stand on.

/// A body about the origin whose axis is z; longitude 0 is towards x. Latitudes are geodetic: that of a place is the angle of the body's
/// normal there, and heights go along the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Globe {
    /// Radius of the equator.
    pub equator: f64,
    /// From the middle to a pole.
    pub pole: f64,
}

/// Iterations of a latitude: each makes its error about a thousand times as small.
const STEPS: u32 = 5;

/// A place of a ray, or any other: as [`Globe::geodetic`] has it before angles are made.
struct Found {
    /// Distance from the axis.
    away: f64,
    /// Sine and cosine of the latitude.
    normal: [f64; 2],
    height: f64,
}

impl Globe {
    /// A ball.
    pub fn sphere(radius: f64) -> Globe {
        Globe { equator: radius, pole: radius }
    }

    /// The same body with lengths in another unit, of which a unit is so long.
    #[must_use]
    pub fn in_unit(self, length: f64) -> Globe {
        Globe { equator: self.equator / length, pole: self.pole / length }
    }

    /// Whether it is a ball.
    pub fn is_sphere(&self) -> bool {
        self.equator == self.pole
    }

    /// The least and the largest radius of curvature of its surface.
    pub fn curvature(&self) -> [f64; 2] {
        // Along meridians at the equator, and at a pole.
        let radii = [self.pole * self.pole / self.equator, self.equator * self.equator / self.pole];
        [radii[0].min(radii[1]), radii[0].max(radii[1])]
    }

    /// The largest distance of its surface from the middle.
    pub fn reach(&self) -> f64 {
        self.equator.max(self.pole)
    }

    /// The square of the eccentricity; below 0 where it is longer from pole to pole.
    fn square(&self) -> f64 {
        1.0 - (self.pole / self.equator) * (self.pole / self.equator)
    }

    /// The length of the normal from a latitude's place to the axis, and where it ends there.
    pub fn axis(&self, latitude: f64) -> [f64; 2] {
        let sin = latitude.to_radians().sin();
        let length = self.equator / (1.0 - self.square() * sin * sin).sqrt();
        [length, -self.square() * length * sin]
    }

    /// The upright direction at a longitude and a latitude, degrees.
    pub fn up(longitude: f64, latitude: f64) -> [f64; 3] {
        let (sin, cos) = longitude.to_radians().sin_cos();
        let (up, level) = latitude.to_radians().sin_cos();
        [level * cos, level * sin, up]
    }

    /// Where a height stands at a longitude and a latitude, degrees.
    pub fn place(&self, longitude: f64, latitude: f64, height: f64) -> [f64; 3] {
        let up = Globe::up(longitude, latitude);
        if self.is_sphere() {
            return up.map(|part| (self.equator + height) * part);
        }
        let [length, middle] = self.axis(latitude);
        let [x, y, z] = up.map(|part| (length + height) * part);
        [x, y, z + middle]
    }

    fn find(&self, [x, y, z]: [f64; 3]) -> Found {
        let away = x.hypot(y);
        if self.is_sphere() {
            let length = away.hypot(z);
            let normal = if length > 0.0 { [z / length, away / length] } else { [1.0, 0.0] };
            return Found { away, normal, height: length - self.equator };
        }
        let (a, b, square) = (self.equator, self.pole, self.square());
        let unit = |[sin, cos]: [f64; 2]| {
            let length = sin.hypot(cos);
            if length > 0.0 { [sin / length, cos / length] } else { [1.0, 0.0] }
        };
        // Bowring's formula (1976) for the reduced latitude, again and again.
        let mut reduced = unit([z * a, away * b]);
        let mut normal = reduced;
        for _ in 0..STEPS {
            let [sin, cos] = reduced;
            normal = unit([z + square * a * a / b * sin.powi(3), away - square * a * cos.powi(3)]);
            reduced = unit([normal[0] * b, normal[1] * a]);
        }
        let [sin, cos] = normal;
        Found { away, normal, height: away * cos + z * sin - a * (1.0 - square * sin * sin).sqrt() }
    }

    /// Longitude, latitude and height of a place: degrees, and a length.
    pub fn geodetic(&self, place: [f64; 3]) -> [f64; 3] {
        let found = self.find(place);
        [place[1].atan2(place[0]).to_degrees(), found.normal[0].atan2(found.normal[1]).to_degrees(), found.height]
    }

    /// The height of a place, and the upright direction there.
    pub fn above(&self, place: [f64; 3]) -> (f64, [f64; 3]) {
        let Found { away, normal: [sin, cos], height } = self.find(place);
        let level = if away > 0.0 { [place[0] / away, place[1] / away] } else { [1.0, 0.0] };
        (height, [cos * level[0], cos * level[1], sin])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// There and back, and the normal is the surface's.
        #[test]
        fn places_are_found_again(
            longitude in -180.0..180.0f64,
            latitude in -90.0..90.0f64,
            height in -0.01..3.0f64,
            pole in 0.7..1.2f64,
        ) {
            for globe in [Globe::sphere(2.0), Globe { equator: 2.0, pole: 2.0 * pole }, Globe { equator: 2.0, pole: 1.993_294 }] {
                let place = globe.place(longitude, latitude, height);
                let [x, y, h] = globe.geodetic(place);
                let same = |a: f64, b: f64, most: f64| (a - b).abs() < most;
                // A tenth more or less flat than a ball is more than any body is on which there is a map.
                let most = if globe.pole / 2.0 > 0.9 && globe.pole < 2.2 { 1e-12 } else { 1e-7 };
                let turned = (x - longitude) * latitude.to_radians().cos();
                prop_assert!(same(turned, 0.0, 1e-9) && same(y, latitude, 100.0 * most) && same(h, height, 2.0 * most));
                let (again, up) = globe.above(place);
                prop_assert_eq!(again, h);
                let expected = Globe::up(longitude, latitude);
                prop_assert!((0..3).all(|k| same(up[k], expected[k], 10.0 * most)));
                // On the surface the normal is the gradient of its equation.
                let [x, y, z] = globe.place(longitude, latitude, 0.0);
                let (a, b) = (globe.equator.powi(2), globe.pole.powi(2));
                prop_assert!(same((x * x + y * y) / a + z * z / b, 1.0, 1e-12));
                let gradient = [x / a, y / a, z / b];
                let length = gradient.iter().map(|part| part * part).sum::<f64>().sqrt();
                prop_assert!((0..3).all(|k| same(gradient[k] / length, expected[k], 1e-12)));
            }
        }
    }

    #[test]
    fn the_earth_is_known() {
        // Of WGS 84 at 45 degrees: the prime vertical's radius (NIMA TR8350.2).
        let globe = Globe { equator: 6_378_137.0, pole: 6_356_752.314_245_179 };
        assert!((globe.axis(45.0)[0] - 6_388_838.290_121_148).abs() < 1e-6);
        let [x, _, z] = globe.place(0.0, 45.0, 0.0);
        assert!((x - 4_517_590.878_845_9).abs() < 1e-3 && (z - 4_487_348.408_865_9).abs() < 1e-3, "{x} {z}");
    }
}
