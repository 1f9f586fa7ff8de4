//! Ambient occlusion and shadows on what an adapter draws: it tells what covers the pixels of its picture, and draws what lamps see of the same nodes; the
//! processor darkens.

use super::adapter::{Adapter, AdapterFrame, AdapterJob, AdapterValues};
use crate::cpu::shadowing::{Others, Shadowing};
use crate::cpu::volume::VolumeError;
use crate::mode::LightPlan;
use crate::view::View;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Has an adapter draw a job as planned, with surfaces that darken each other as they do among others.
///
/// # Errors
/// As [`Adapter::draw`].
pub(super) fn draw(
    adapter: &mut dyn Adapter,
    (job, plan): (AdapterJob<'_>, &LightPlan),
    shadowing: &Shadowing,
    others: Option<&Others<'_>>,
) -> Result<AdapterFrame, VolumeError> {
    let (mut frame, covering) = adapter.draw_covering(&AdapterJob { light: Some(plan), ..job }, true)?;
    let AdapterValues::Light(colors, _) = &mut frame.values else { return Ok(frame) };
    let start = Instant::now();
    let casting = plan.passes.casting().map(|passes| LightPlan { passes, ..plan.clone() });
    // How it failed: a picture without some of its shadows is none.
    let painter = Mutex::new((adapter, None));
    let casters = |from: &View| {
        let light = Some(casting.as_ref()?);
        let mut painter = painter.lock().unwrap_or_else(PoisonError::into_inner);
        let (adapter, failure) = &mut *painter;
        if failure.is_some() {
            return None;
        }
        match adapter.draw_covering(&AdapterJob { view: from, light, repeat: 1, ..job }, false) {
            Ok((_, seen)) => Some(seen.depths),
            Err(error @ VolumeError::Device(_)) => {
                *failure = Some(error);
                None
            }
            // As on the processor, what is not there for a lamp casts no shadow: close up its grid may have too many slices.
            Err(_) => None,
        }
    };
    shadowing.darken_covering(job.view, &covering, colors, &casters, others);
    let (_, failure) = painter.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some(error) = failure {
        return Err(error);
    }
    let milliseconds = 1e3 * start.elapsed().as_secs_f64();
    for pass in ["darken", "frame"] {
        *frame.milliseconds.entry(pass.to_owned()).or_default() += milliseconds;
    }
    Ok(frame)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::color::Colors;
    use crate::color::transfer::{Range, TransferFunction};
    use crate::cpu::screen_spheres::front;
    use crate::cpu::shadowing::Covering;
    use crate::mode::{Depiction, LightPasses, Plan, SettingValue, Settings};
    use crate::model::{Dataset, Family, FamilyName, Kernel, Provenance, Unit};
    use crate::modes::spheres;
    use crate::picture::adapter::{Passes, draw_on};
    use crate::picture::decode::batches;
    use crate::picture::subject::Subject;
    use crate::store::{InMemory, Tree as _};
    use crate::stream::first_nodes;
    use crate::view::Projection;
    use crate::view::perspective_grid::GridError;
    use glam::DVec3;

    const SMOOTHING_LENGTH: f32 = 0.2;

    fn settings(set: &[(&str, f64)]) -> Settings {
        let threshold = [("threshold", 1.0)];
        let pairs = threshold.iter().chain(set);
        Settings(pairs.map(|(name, number)| ((*name).to_owned(), SettingValue::Number(*number))).collect())
    }

    fn transfer() -> TransferFunction {
        TransferFunction { range: Range::Fixed(1e2, 1e4), ..TransferFunction::default() }
    }

    /// A ball above a floor.
    fn tree() -> InMemory {
        let along = || (-10..=10_i32).map(|step| 0.1 * f64::from(step));
        let floor = along().flat_map(|y| along().map(move |x| DVec3::new(2.0 * x, 2.0 * y, 0.0)));
        let inside = |at: &DVec3| at.length() < 0.4;
        let ball = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| DVec3::new(x, y, z))));
        let positions: Vec<[f64; 3]> =
            floor.chain(ball.filter(inside).map(|at| at + 0.9 * DVec3::Z)).map(|at| at.to_array()).collect();
        let count = positions.len();
        InMemory::new(Dataset {
            families: vec![Family {
                name: FamilyName::Gas,
                positions,
                mass: vec![1.0; count],
                // What belongs to such masses.
                density: vec![20.0 / SMOOTHING_LENGTH.powi(3); count],
                smoothing_length: vec![SMOOTHING_LENGTH; count],
                attributes: Vec::new(),
            }],
            length_unit: Unit::default(),
            mass_unit: Unit::default(),
            kernel: Kernel::CubicSpline,
            skipped: Vec::new(),
            provenance: Provenance::default(),
        })
    }

    /// Draws spheres as the processor does and darkens nothing, until it fails.
    struct Mirror {
        /// How often it was asked.
        asked: usize,
        most: usize,
        fails: fn() -> VolumeError,
    }

    impl Adapter for Mirror {
        fn is_card(&mut self) -> bool {
            true
        }

        fn draw_covering(
            &mut self,
            job: &AdapterJob<'_>,
            is_colored: bool,
        ) -> Result<(AdapterFrame, Covering), VolumeError> {
            let Some(LightPlan { passes: LightPasses::Spheres { options, .. }, .. }) = job.light else {
                panic!("a mirror of spheres");
            };
            self.asked += 1;
            if self.asked > self.most {
                return Err((self.fails)());
            }
            let depiction = Depiction { settings: settings(&[]), ..job.depiction.clone() };
            let transfer = transfer();
            let subject = Subject::new(job.metadata, &depiction, &transfer, 1.0);
            let nodes = subject.decode(job.view, job.nodes, job.plan);
            let (mut seen, report) = front(job.view, &batches(&depiction, &nodes)?, 1.0, options)?;
            seen.smooth(job.view, options.smoothing);
            let colors = match is_colored {
                true => subject.draw(job.view, &nodes, job.plan)?.light(depiction.mode)?.colors,
                false => Colors::default(),
            };
            let frame = AdapterFrame {
                values: AdapterValues::Light(colors, report),
                splats: None,
                backend: "compute",
                adapter: String::new(),
                milliseconds: Default::default(),
                covered: None,
                note: None,
            };
            Ok((frame, seen.covering(options.smoothing)))
        }
    }

    #[test]
    fn what_an_adapter_draws_is_as_dark_as_what_the_processor_draws() {
        let tree = tree();
        let metadata = tree.metadata();
        let projection = Projection::Perspective { fov_y: 0.7 };
        let view = View::look_at(DVec3::new(1.0, -5.0, 4.0), DVec3::ZERO, DVec3::Z, projection, 48, 40).unwrap();
        let nodes = first_nodes(&tree, &view).unwrap();
        let dark = [("ambient-occlusion", 0.8), ("shadows", 0.7), ("light-size", 10.0), ("light-samples", 4.0)];
        let [dark, plain] = [settings(&dark), settings(&[])]
            .map(|settings| Depiction::new(&spheres::MODE, settings, None, metadata).unwrap());
        let (transfer, plan) = (transfer(), Plan::default());
        let subject = |depiction| Subject::new(metadata, depiction, &transfer, metadata.bounds().size().length());
        let by_processor = |depiction| {
            let drawn = subject(depiction).draw_nodes(&view, &nodes, &plan).unwrap();
            drawn.light(&spheres::MODE).unwrap().colors
        };
        let by_adapter = |most: usize, fails: fn() -> VolumeError| {
            let mut adapter = Mirror { asked: 0, most, fails };
            let passes = Passes::Compute;
            let (view, nodes, plan, depiction) = (&view, &nodes[..], &plan, &dark);
            let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
            (draw_on(&mut adapter, &subject(&dark), job), adapter.asked)
        };
        let apart = |a: &Colors, b: &Colors| {
            let pairs = a.rgba.as_flattened().iter().zip(b.rgba.as_flattened());
            pairs.filter(|(a, b)| (*a - *b).abs() > 1e-6).count()
        };
        let is_lost = || VolumeError::Device("lost".into());
        let (drawn, asked) = by_adapter(usize::MAX, is_lost);
        let (values, frame) = drawn.unwrap();
        let (found, expected) = (values.light(&spheres::MODE).unwrap().colors, by_processor(&dark));
        assert_eq!(asked, 5, "the eye, and four places of the lamp");
        assert_eq!(apart(&found, &expected), 0);
        assert!(apart(&by_processor(&plain), &expected) > 300, "nothing is dark");
        assert!(frame.milliseconds.contains_key("darken"));
        // A picture lacks none of its shadows, and what is lost is not asked again.
        for most in [0, 1, 3] {
            let (drawn, asked) = by_adapter(most, is_lost);
            assert!(matches!(drawn, Err(VolumeError::Device(_))), "{most}");
            assert_eq!(asked, most + 1);
        }
        // Where there is no picture for a lamp, nothing is in its way.
        let (drawn, asked) = by_adapter(1, || GridError::TooManySlices { near: 0.0, far: 1.0, slices: 1e9 }.into());
        let lit = drawn.unwrap().0.light(&spheres::MODE).unwrap().colors;
        let mut pairs = lit.rgba.as_flattened().iter().zip(expected.rgba.as_flattened());
        assert!(asked == 5 && apart(&lit, &expected) > 0 && pairs.all(|(lit, dark)| *lit >= *dark - 1e-6));
    }
}
