//! The GPU backends as contenders of `bench splat`.

use super::splat::{Contender, Drawn, Failure};
use crate::gpu::depiction::request_nodes;
use crate::gpu::{Backend, HeadlessRenderer, HeadlessRequest};
use crate::mode::{Depiction, Plan, Settings};
use crate::model::Dataset;
use crate::modes::column_density;
use crate::store::{InMemory, Tree};
use crate::stream::first_nodes;
use crate::view::View;
use std::time::Duration;

/// One backend on the adapter that the environment asks for, or the fastest.
pub struct Gpu {
    backend: Backend,
    name: String,
}

impl Gpu {
    /// A backend; the adapter is opened for each picture.
    pub fn new(backend: Backend) -> Gpu {
        Gpu { backend, name: String::new() }
    }
}

/// Draws a request `repeat` times; also says backend and adapter.
///
/// # Errors
/// [`crate::gpu::GpuError`], boxed.
pub fn draw(request: &HeadlessRequest, repeat: u32) -> Result<(String, Drawn), Failure> {
    let mut renderer = HeadlessRenderer::open(request)?;
    renderer.complete()?;
    let (times, passes) = renderer.measure(repeat)?;
    let (picture, _) = renderer.accumulation(request.attribute)?;
    // What stands in brackets is the driver's version.
    let adapter = renderer.adapter().split(" (").next().unwrap_or_default();
    let drawn = Drawn {
        picture,
        times: times.into_iter().map(|milliseconds| Duration::from_secs_f64(milliseconds / 1e3)).collect(),
        passes: passes.medians().map(|(name, time)| (name.to_owned(), time)).collect(),
    };
    Ok((format!("{}, {adapter}", renderer.technique().name()), drawn))
}

impl Contender for Gpu {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn draw(&mut self, data: &Dataset, view: &View, _: bool, repeat: u32) -> Result<Drawn, Failure> {
        let tree = InMemory::new(data.clone());
        let depiction = Depiction::new(&column_density::MODE, Settings::default(), None, tree.metadata())?;
        let nodes = first_nodes(&tree, view)?;
        let request = request_nodes(view, &depiction, tree.metadata(), &nodes, &Plan::default(), self.backend);
        let (name, drawn) = draw(&request, repeat)?;
        self.name = name;
        Ok(drawn)
    }

    /// Both channels are accumulated together, always.
    fn has_single_channel(&self) -> bool {
        false
    }
}
