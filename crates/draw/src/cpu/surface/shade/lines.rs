//! Lines of equal height: how much of a pixel they are, by where the surface that is seen has their height.

use super::super::look::Contours;
use super::super::resolve::Hit;
use super::Shader;

/// Widths of a line from it within which a sample looks where it really is.
pub const REACH: f64 = 1.2;
/// Most steps to where a line is.
pub const SECANTS: u32 = 8;

impl Shader<'_> {
    /// The height at a place of the picture, and what a sample to the right and one down add to it on the triangle or the plane that is seen
    /// there; the sample's place is where it is met.
    fn relief(&self, hit: &Hit, [x, y]: [f64; 2]) -> Option<(f64, [f64; 2])> {
        let placed = &self.resolver.scene.placed;
        let ([row, column, here], slope) = (hit.under, hit.slope);
        if !placed.is_flat() {
            // A point is beside the sample's middle.
            let moves = self.resolver.moves(hit)?;
            let rise = moves.rise(slope)?;
            return Some((here + rise[0] * (x - moves.at[0]) + rise[1] * (y - moves.at[1]), rise));
        }
        let height = |x: f64, y: f64| {
            let (origin, direction) = self.resolver.ray([x, y])?;
            let ray = placed.ray(origin, direction)?;
            ray.on_plane([row, column], here, slope).map(|[_, _, height]| height)
        };
        const STEP: f64 = 0.25;
        let (right, below) = (height(x + STEP, y)?, height(x, y + STEP)?);
        Some((here, [(right - here) / STEP, (below - here) / STEP]))
    }

    /// The height that is seen at a place of the picture near a hit.
    fn height_at(&self, hit: &Hit, place: [f64; 2]) -> Option<f64> {
        if self.resolver.scene.placed.is_flat() {
            let near = self.resolver.height_near(hit, place);
            return near.or_else(|| Some(self.resolver.cast(place)?.under[2]));
        }
        let seen = self.seen?;
        let [x, y] = place.map(f64::floor);
        if x < 0.0 || y < 0.0 || x >= seen.width as f64 || y >= seen.height as f64 {
            return None;
        }
        let hit = self.resolver.hit(seen.at(y as usize * seen.width + x as usize)?, place)?;
        Some(self.relief(&hit, place)?.0)
    }

    /// How much of a place is a line of equal height.
    pub(super) fn line(&self, contours: &Contours, hit: &Hit, [x, y]: [f64; 2]) -> f32 {
        let parts = f64::from(self.parts);
        // A surface that is seen from its edge has all of its lines there.
        let Some((here, rise)) = self.relief(hit, [x, y]) else {
            return contours.share(contours.nearest(hit.under[2]), 0.0, f64::MAX, 1.0);
        };
        let nearest = contours.nearest(here);
        // Widths are in pixels, this is in samples.
        let steep = rise[0].hypot(rise[1]);
        let mut away = (nearest - here).abs() / steep;
        // Where the line is told to be the surface may have another slope: by secants to where it is.
        let is_single = contours.interval > contours.width * steep * parts;
        // What is well within the line stays so.
        if is_single && (0.02..REACH).contains(&(away / (contours.width * parts))) {
            let up = rise.map(|rise| rise / steep * (nearest - here).signum());
            let (mut last, mut is_found) = ((0.0, here), false);
            for _ in 0..SECANTS {
                let Some(there) = self.height_at(hit, [x + up[0] * away, y + up[1] * away]) else { break };
                let next = away + (nearest - there) * (away - last.0) / (there - last.1);
                if next.is_nan() || next <= 0.0 {
                    break;
                }
                last = (away, there);
                away = next.clamp(0.25 * away, 4.0 * away);
                if (next - last.0).abs() < 0.02 {
                    is_found = true;
                    break;
                }
            }
            // The surface ends before, or another one is in front of it.
            if !is_found {
                away = f64::INFINITY;
            }
        }
        contours.share(nearest, away / parts, steep * parts, 1.0 / parts)
    }
}
