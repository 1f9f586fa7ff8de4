//! An adapter beside the window's own: pictures whose surfaces darken each other are drawn by it, and read back, before the processor darkens them. The
//! window's frames do not show these.

use super::super::preset::Backend;
use crate::cpu::volume::VolumeError;
use crate::mode::{Plan, Raw};
use crate::picture::Subject;
use crate::picture::adapter::{Adapter, AdapterJob, Passes, draw_on};
use crate::stream::SceneNode;
use crate::view::View;
use std::sync::{Arc, Mutex, PoisonError};

/// The adapter, while it works; whoever draws holds it.
pub(super) type Shared = Arc<Mutex<Option<Box<dyn Adapter>>>>;

/// An adapter that is there as long as such pictures are wanted.
#[derive(Default)]
pub(super) struct Beside(Option<(Backend, Shared)>);

impl Beside {
    /// What draws such pictures for somebody who asks for a backend, if they are wanted; else it is closed.
    pub fn follow(&mut self, asked: Backend, is_wanted: bool) -> Option<Shared> {
        let known = self.0.take().filter(|(known, _)| is_wanted && *known == asked);
        self.0 = match asked {
            // Discs are no surfaces.
            Backend::Cpu | Backend::Raster => None,
            Backend::Auto | Backend::Compute => known.or_else(|| {
                let opened = is_wanted.then(|| asked.beside()).flatten();
                opened.map(|adapter| (asked, Arc::new(Mutex::new(Some(adapter)))))
            }),
        };
        self.0.as_ref().map(|(_, shared)| Arc::clone(shared))
    }
}

/// Has an adapter draw nodes; `None` where there is none, or the processor is faster. One that fails is closed, and `told` says why.
///
/// # Errors
/// As [`draw_on`], but for an adapter that fails.
pub(super) fn draw(
    shared: &Shared,
    subject: &Subject<'_>,
    (view, nodes, plan): (&View, &[SceneNode], &Plan),
    told: &mut Option<String>,
) -> Result<Option<Raw>, VolumeError> {
    // Whoever panicked has left one that fails, if anything.
    let mut held = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(adapter) = held.as_deref_mut() else { return Ok(None) };
    if !adapter.is_card() {
        return Ok(None);
    }
    let &Subject { depiction, metadata, .. } = subject;
    let passes = Passes::Compute;
    let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
    match draw_on(adapter, subject, job) {
        Err(VolumeError::Device(why)) => {
            *held = None;
            *told = Some(format!("{why}; drawing with the CPU instead"));
            Ok(None)
        }
        drawn => drawn.map(|(values, _)| Some(values)),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::super::drawing::{self, Limits, Outcome};
    use super::*;
    use crate::color::Colors;
    use crate::cpu::shadowing::Covering;
    use crate::cpu::volume::{FieldRange, VolumeOptions, VolumeReport};
    use crate::mode::{Depiction, LodBudget, SettingValue, Settings};
    use crate::modes::spheres;
    use crate::picture::adapter::{AdapterFrame, AdapterValues};
    use crate::picture::look::transfer_of;
    use crate::store::{InMemory, Tree as _};
    use crate::stream::first_nodes;
    use crate::synth::{self, merger::Merger};
    use crate::view::Projection;
    use bevy::prelude::UVec2;
    use glam::DVec3;

    #[test]
    fn an_adapter_is_there_while_somebody_wants_what_it_draws() {
        let mut beside = Beside::default();
        let mut follow = |asked, is_wanted| beside.follow(asked, is_wanted);
        for asked in [Backend::Cpu, Backend::Raster] {
            assert!(follow(asked, true).is_none());
        }
        assert!(follow(Backend::Auto, false).is_none());
        let [first, second] = [(); 2].map(|()| follow(Backend::Auto, true).unwrap());
        assert!(Arc::ptr_eq(&first, &second));
        let other = follow(Backend::Compute, true).unwrap();
        assert!(!Arc::ptr_eq(&first, &other) && follow(Backend::Compute, false).is_none());
        assert_eq!(Arc::strong_count(&other), 1, "it is closed");
    }

    /// A card that draws every pixel white, or nothing.
    struct White(bool);

    impl Adapter for White {
        fn is_card(&mut self) -> bool {
            true
        }

        fn draw_covering(&mut self, job: &AdapterJob<'_>, _: bool) -> Result<(AdapterFrame, Covering), VolumeError> {
            if !self.0 {
                return Err(VolumeError::Device("no card".into()));
            }
            let (width, height) = (job.view.width, job.view.height);
            let pixels = width as usize * height as usize;
            let colors = Colors { width, height, rgba: vec![[1.0; 4]; pixels] };
            let frame = AdapterFrame {
                values: AdapterValues::Light(colors, VolumeReport::default()),
                splats: None,
                backend: "compute",
                adapter: String::new(),
                milliseconds: Default::default(),
                covered: None,
                note: None,
            };
            Ok((frame, Covering { depths: vec![f32::INFINITY; pixels], light: None, slack: 0.0 }))
        }

        fn ranges(&mut self, _: &AdapterJob<'_>, _: &VolumeOptions) -> Result<FieldRange, VolumeError> {
            Ok(FieldRange { density: [1e-3, 1e3], attribute: [0.0, 1.0] })
        }
    }

    #[test]
    fn the_processor_draws_where_an_adapter_fails() {
        let tree = InMemory::new(synth::dataset(&Merger::new(1, 200)));
        let (metadata, bounds) = (tree.metadata(), tree.metadata().bounds());
        let eye = bounds.center() + 1.5 * bounds.size().length() * DVec3::Z;
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(eye, bounds.center(), DVec3::Y, projection, 24, 16).unwrap();
        let nodes = first_nodes(&tree, &view).unwrap();
        let set = [("shadows", 0.5), ("threshold", 1e-30)];
        let settings = Settings(set.map(|(name, number)| (name.to_owned(), SettingValue::Number(number))).into());
        let depiction = Depiction::new(&spheres::MODE, settings, None, metadata).unwrap();
        let transfer = transfer_of(&Default::default(), &depiction);
        let subject = Subject::new(metadata, &depiction, &transfer, bounds.size().length());
        let draw = |adapter: Option<&Shared>| {
            let limits = Limits { lod_budget: LodBudget::NONE, plan: None, particles: u64::MAX };
            drawing::draw(&subject, &nodes, (&view, UVec2::new(24, 16)), &limits, (None, None), adapter).unwrap()
        };
        let colors = |outcome: &Outcome| {
            let Some(Raw::Light(light)) = &outcome.values else { panic!("no light") };
            light.colors.clone()
        };
        let card = |works: bool| -> Shared { Arc::new(Mutex::new(Some(Box::new(White(works))))) };
        let alone = draw(None);
        let beside = draw(Some(&card(true)));
        assert!(beside.by_adapter && colors(&beside).rgba.iter().all(|pixel| *pixel == [1.0; 4]));
        let broken = card(false);
        for told in [Some("no card; drawing with the CPU instead"), None] {
            let found = draw(Some(&broken));
            assert!(!found.by_adapter && colors(&found) == colors(&alone) && found.told.as_deref() == told);
        }
    }
}
