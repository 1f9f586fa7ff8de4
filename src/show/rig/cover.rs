//! The flat picture from which an output's is bent: the smallest upright one around its directions, with pixels as fine as the
//! output's.

use super::Projector;
use glam::DVec3;

/// Points along a side at which directions are looked at.
const SAMPLES: usize = 33;
/// The largest tangent of the angle from the picture's middle to its edge: 80 degrees.
const WIDEST: f64 = 5.67;
/// The most pixels along a side of the picture, and for each of the output's.
const MOST: f64 = 8192.0;
const PIXELS: f64 = 4.0;

/// A flat picture in the frame of the show's camera (right, up, forward).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cover {
    /// Unit vectors to the picture's right, top and middle.
    pub axes: [DVec3; 3],
    /// Height, radians.
    pub fov_y: f64,
    /// Width and height, pixels.
    pub size: [u32; 2],
}

/// Why no flat picture covers an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CoverError {
    /// It displays nothing.
    #[error("it displays no direction")]
    Nothing,
    /// It spans too much.
    #[error(
        "it spans more than a flat picture can (160 degrees): divide it into outputs side by side, each with its part"
    )]
    Wide,
}

impl Cover {
    /// The picture for an output of `size` pixels, where `fov_y` radians are the height of the show's flat picture.
    ///
    /// # Errors
    /// [`CoverError`].
    pub fn of(projector: &Projector, size: [u32; 2], fov_y: f64) -> Result<Cover, CoverError> {
        let share = |i: usize| i as f64 / (SAMPLES - 1) as f64;
        let grid: Vec<Option<DVec3>> = (0..SAMPLES * SAMPLES)
            .map(|i| projector.direction([share(i % SAMPLES), share(i / SAMPLES)], fov_y))
            .collect();
        let directions: Vec<DVec3> = grid.iter().flatten().copied().collect();
        let mut forward = directions.iter().sum::<DVec3>().try_normalize().ok_or(CoverError::Nothing)?;
        let mut up = upwards(&grid).unwrap_or(DVec3::Y);
        let mut half = [0.0; 2];
        // The axis moves to the middle of what the picture spans.
        for _ in 0..24 {
            // Of components to the right, up and forward: forward is right x up.
            let right = up.cross(forward).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
            up = forward.cross(right);
            let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            for direction in &directions {
                let depth = direction.dot(forward);
                if depth <= 1.0 / (1.0 + 2.0 * WIDEST * WIDEST).sqrt() {
                    return Err(CoverError::Wide);
                }
                for (k, axis) in [right, up].into_iter().enumerate() {
                    let angle = (direction.dot(axis) / depth).atan();
                    (low[k], high[k]) = (low[k].min(angle), high[k].max(angle));
                }
            }
            half = [0, 1].map(|k| low[k].abs().max(high[k].abs()).tan());
            let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
            if middle.iter().all(|angle| angle.abs() < 1e-9) {
                break;
            }
            forward = (forward + middle[0].tan() * right + middle[1].tan() * up).normalize();
        }
        if half.iter().any(|tangent| *tangent > WIDEST) {
            return Err(CoverError::Wide);
        }
        let right = up.cross(forward).normalize_or(DVec3::X);
        let up = forward.cross(right);
        let mut cover = Cover { axes: [right, up, forward], fov_y: 0.0, size: [1, 1] };
        // A pixel beyond the edges, for interpolation.
        let focal = cover.focal(&grid, size);
        let room =
            |k: usize| (MOST / (2.0 * half[k].max(1e-9))).min(PIXELS * f64::from(size[k]) / (2.0 * half[k].max(1e-9)));
        let focal = focal.min(room(0)).min(room(1)).max(1.0);
        let sides = half.map(|tangent| (2.0 * tangent * focal).ceil() + 2.0);
        cover.size = sides.map(|side| side as u32);
        cover.fov_y = 2.0 * (0.5 * sides[1] / focal).atan();
        Ok(cover)
    }

    /// Pixels for a tangent of 1 that make none larger than those of an output of `size` pixels.
    fn focal(&self, grid: &[Option<DVec3>], size: [u32; 2]) -> f64 {
        let place = |direction: DVec3| {
            let [right, up, forward] = self.axes;
            [right, up].map(|axis| direction.dot(axis) / direction.dot(forward))
        };
        let step = size.map(|side| f64::from(side) / (SAMPLES - 1) as f64);
        let mut finest = 1.0f64;
        for row in 0..SAMPLES {
            for column in 0..SAMPLES {
                let at = row * SAMPLES + column;
                let Some(here) = grid[at].map(place) else { continue };
                let beside = [
                    (column + 1 < SAMPLES).then_some((at + 1, step[0])),
                    (row + 1 < SAMPLES).then_some((at + SAMPLES, step[1])),
                ];
                for (next, pixels) in beside.into_iter().flatten() {
                    if let Some(there) = grid[next].map(place) {
                        let tangents = (there[0] - here[0]).hypot(there[1] - here[1]);
                        finest = finest.max(pixels / tangents.max(1e-9));
                    }
                }
            }
        }
        finest
    }

    /// Where a direction lies in the picture: shares of its width from the left and of its height from the top; `None` behind it.
    pub fn place(&self, direction: DVec3) -> Option<[f64; 2]> {
        let [right, up, forward] = self.axes;
        let depth = direction.dot(forward);
        if depth <= 1e-6 {
            return None;
        }
        let half = (0.5 * self.fov_y).tan();
        let aspect = f64::from(self.size[0]) / f64::from(self.size[1]);
        let [x, y] = [direction.dot(right) / (half * aspect * depth), direction.dot(up) / (half * depth)];
        Some([0.5 * (1.0 + x), 0.5 * (1.0 - y)])
    }
}

/// The direction in which rows of directions go up, in the middle of what there is.
fn upwards(grid: &[Option<DVec3>]) -> Option<DVec3> {
    let mut sum = DVec3::ZERO;
    for (above, below) in grid.iter().zip(&grid[SAMPLES..]) {
        if let (Some(above), Some(below)) = (above, below) {
            sum += *above - *below;
        }
    }
    sum.try_normalize()
}
