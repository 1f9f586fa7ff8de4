//! Editing the regions of a plane: they are moved by their middle and resized by their rim. No drawing here.

use crate::color::transfer::{MOST_REGIONS, Plane, Region};

/// A place of the plane.
type At = (f32, f32);

/// Half the size of a region that is added.
const NEW: At = (0.15, 0.2);
/// The least and the greatest radius that is typed or made by keys.
pub const RADII: [f32; 2] = [0.001, 4.0];
/// The least radius that is dragged.
const SMALLEST: f32 = 0.01;
/// A region whose middle is dragged this far out of the plot is let go of for good.
const OUT: f32 = 0.2;

/// Which part of a region the pointer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegionPart {
    /// Its middle.
    Middle,
    /// The right end of its rim: its width.
    Width,
    /// The upper end of its rim: its height.
    Height,
}

/// What is being dragged: which part of which region, and the plane as it was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaneEdit {
    held: Option<(usize, RegionPart, Plane)>,
}

/// Where the parts of a region are.
pub fn handles(region: &Region) -> [(RegionPart, At); 3] {
    let ((p, s), (width, height)) = (region.at, region.radius);
    // A rim outside of the plot is taken hold of at the plot's edge.
    [
        (RegionPart::Middle, (p, s)),
        (RegionPart::Width, ((p + width).min(1.0), s)),
        (RegionPart::Height, (p, (s + height).min(1.0))),
    ]
}

/// The plane with a part of a region shifted so far; a middle stays in the plot, a radius within [`RADII`].
pub fn shift(plane: &Plane, (index, part): (usize, RegionPart), (right, up): At) -> Option<Plane> {
    if !(right.is_finite() && up.is_finite()) {
        return None;
    }
    let mut plane = plane.clone();
    let Region { at, radius, .. } = plane.regions.get_mut(index)?;
    let [least, most] = RADII;
    match part {
        RegionPart::Middle => *at = ((at.0 + right).clamp(0.0, 1.0), (at.1 + up).clamp(0.0, 1.0)),
        RegionPart::Width => radius.0 = (radius.0 + right).clamp(least, most),
        RegionPart::Height => radius.1 = (radius.1 + up).clamp(least, most),
    }
    Some(plane)
}

/// The part nearest to a place, of those within `reach`; of several regions at one place the uppermost.
pub fn nearest(plane: &Plane, at: At, reach: At) -> Option<(usize, RegionPart)> {
    let distance = |point: At| ((point.0 - at.0) / reach.0).hypot((point.1 - at.1) / reach.1);
    let parts = plane
        .regions
        .iter()
        .enumerate()
        .rev()
        .flat_map(|(index, region)| handles(region).map(|(part, place)| ((index, part), distance(place))));
    let found = parts.min_by(|a, b| a.1.total_cmp(&b.1));
    found.filter(|(_, distance)| *distance <= 1.0).map(|(part, _)| part)
}

/// The plane with another region, and its index; `None` where there are too many.
pub fn add(plane: &Plane, at: At) -> Option<(Plane, usize)> {
    let inside = (0.0..=1.0).contains(&at.0) && (0.0..=1.0).contains(&at.1);
    if plane.regions.len() >= MOST_REGIONS || !inside {
        return None;
    }
    let mut plane = plane.clone();
    plane.regions.push(Region::new(at, NEW));
    let index = plane.regions.len() - 1;
    Some((plane, index))
}

/// The plane without a region.
pub fn remove(plane: &Plane, index: usize) -> Option<Plane> {
    let mut plane = plane.clone();
    (index < plane.regions.len()).then(|| {
        plane.regions.remove(index);
        plane
    })
}

impl PlaneEdit {
    /// Takes hold of a part of a region.
    pub fn grab(&mut self, plane: &Plane, (index, part): (usize, RegionPart)) {
        if index < plane.regions.len() {
            self.held = Some((index, part, plane.clone()));
        }
    }

    /// The plane with the held part dragged to a place. A middle far out of the plot takes its region away; it comes back
    /// with the pointer.
    pub fn drag(&self, (p, s): At) -> Option<Plane> {
        let (index, part, plane) = self.held.as_ref()?;
        if !(p.is_finite() && s.is_finite()) {
            return None;
        }
        let mut plane = plane.clone();
        let region = plane.regions.get_mut(*index)?;
        let out = [p, s].iter().any(|x| !(-OUT..=1.0 + OUT).contains(x));
        match part {
            RegionPart::Middle if out => return remove(&plane, *index),
            RegionPart::Middle => region.at = (p.clamp(0.0, 1.0), s.clamp(0.0, 1.0)),
            RegionPart::Width => region.radius.0 = (p - region.at.0).abs().clamp(SMALLEST, 2.0),
            RegionPart::Height => region.radius.1 = (s - region.at.1).abs().clamp(SMALLEST, 2.0),
        }
        Some(plane)
    }

    /// The region that is held.
    pub fn held(&self) -> Option<usize> {
        self.held.as_ref().map(|held| held.0)
    }

    /// Lets go.
    pub fn release(&mut self) {
        self.held = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::TransferFunction;
    use proptest::prelude::*;

    #[test]
    fn regions_are_added_moved_resized_and_removed() {
        let (plane, index) = add(&Plane::default(), (0.5, 0.5)).unwrap();
        assert_eq!((index, plane.regions[0].at), (0, (0.5, 0.5)));
        assert_eq!(nearest(&plane, (0.51, 0.5), (0.03, 0.03)), Some((0, RegionPart::Middle)));
        assert_eq!(nearest(&plane, (0.64, 0.5), (0.03, 0.03)), Some((0, RegionPart::Width)));
        assert_eq!(nearest(&plane, (0.5, 0.7), (0.03, 0.03)), Some((0, RegionPart::Height)));
        assert_eq!(nearest(&plane, (0.1, 0.1), (0.03, 0.03)), None);
        let mut edit = PlaneEdit::default();
        edit.grab(&plane, (0, RegionPart::Width));
        let wide = edit.drag((0.9, 0.1)).unwrap();
        assert!((wide.regions[0].radius.0 - 0.4).abs() < 1e-6 && wide.regions[0].radius.1 == NEW.1);
        edit.grab(&plane, (0, RegionPart::Middle));
        assert_eq!(edit.drag((0.2, 1.1)).unwrap().regions[0].at, (0.2, 1.0));
        assert!(edit.drag((0.2, 1.5)).unwrap().regions.is_empty());
        assert_eq!(edit.drag((0.5, 0.5)).unwrap(), plane);
        edit.release();
        assert_eq!((edit.drag((0.5, 0.5)), edit.held()), (None, None));
        assert_eq!(remove(&plane, 0), Some(Plane::default()));
        assert_eq!(remove(&plane, 1), None);
    }

    #[test]
    fn parts_of_regions_are_shifted_but_never_out_of_the_plot() {
        let (plane, _) = add(&Plane::default(), (0.5, 0.75)).unwrap();
        let shifted = |part, by| shift(&plane, (0, part), by).unwrap().regions[0].clone();
        assert_eq!(shifted(RegionPart::Middle, (0.25, 0.125)).at, (0.75, 0.875));
        assert_eq!(shifted(RegionPart::Middle, (-9.0, 9.0)).at, (0.0, 1.0));
        let wide = shifted(RegionPart::Width, (0.1, 0.0)).radius;
        assert!((wide.0 - 0.25).abs() < 1e-6 && wide.1 == NEW.1);
        assert_eq!(shifted(RegionPart::Height, (0.0, -9.0)).radius, (NEW.0, RADII[0]));
        assert_eq!(shift(&plane, (1, RegionPart::Middle), (0.1, 0.1)), None);
        assert_eq!(shift(&plane, (0, RegionPart::Middle), (f32::NAN, 0.1)), None);
    }

    proptest! {
        #[test]
        fn whatever_is_done_it_can_be_written_and_read(
            steps in proptest::collection::vec((0..4u8, -0.6..1.6f32, -0.6..1.6f32, 0..5usize, 0..3usize), 1..40)
        ) {
            let parts = [RegionPart::Middle, RegionPart::Width, RegionPart::Height];
            let (mut plane, mut edit) = (Plane::default(), PlaneEdit::default());
            for (what, x, y, index, part) in steps {
                let next = match what {
                    0 => { edit.release(); add(&plane, (x, y)).map(|added| added.0) }
                    1 => { edit.release(); remove(&plane, index) }
                    2 => { edit.grab(&plane, (index, parts[part])); None }
                    _ => edit.drag((x, y)),
                };
                plane = next.unwrap_or(plane);
            }
            let function = TransferFunction { plane, ..TransferFunction::default() };
            prop_assert_eq!(TransferFunction::parse(&function.to_ron(), "t").unwrap(), function);
        }
    }
}
