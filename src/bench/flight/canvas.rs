//! What a flight is drawn on: of sums the processor, or the GPU techniques with copies of pages in the adapter's memory. Both
//! draw what streaming has brought, as the window does.

use super::super::splat::Failure;
use crate::color::Accumulation;
use crate::color::transfer::TransferFunction;
use crate::cpu::Counts;
use crate::mode::{Depiction, Plan, Raw};
use crate::picture::Subject;
use crate::store::Tree;
use crate::stream::{CopyOptions, SceneNode, Streamer};
use crate::view::View;
use std::sync::Arc;

/// Something that draws frame after frame.
pub trait Canvas {
    /// Backend and adapter.
    fn name(&self) -> (String, String);

    /// How the streamer keeps copies for it; `None`: it draws from main memory.
    fn copies(&self) -> Option<CopyOptions>;

    /// Takes in copies that have been made, before a frame's selection.
    fn receive(&mut self, _streamer: &mut Streamer) {}

    /// Begins to copy what the frame misses, after its selection.
    fn copy(&mut self, _streamer: &mut Streamer) {}

    /// Draws what a plan leaves of the nodes, to the end.
    ///
    /// # Errors
    /// What the backend reports.
    fn draw(&mut self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<(), Failure>;

    /// The last picture, before colours.
    ///
    /// # Errors
    /// What the backend reports.
    fn picture(&mut self) -> Result<Raw, Failure>;
}

/// The CPU renderer on all threads.
pub struct CpuCanvas {
    tree: Arc<dyn Tree>,
    depiction: Depiction,
    picture: Accumulation,
}

impl CpuCanvas {
    /// Draws `tree` as `depiction` says.
    pub fn new(tree: Arc<dyn Tree>, depiction: Depiction) -> CpuCanvas {
        CpuCanvas { tree, depiction, picture: Accumulation::default() }
    }
}

impl Canvas for CpuCanvas {
    fn name(&self) -> (String, String) {
        ("cpu".into(), format!("{} threads", rayon::current_num_threads()))
    }

    fn copies(&self) -> Option<CopyOptions> {
        None
    }

    fn draw(&mut self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<(), Failure> {
        // Sums have no use for colours and diameters.
        let transfer = TransferFunction::default();
        let subject = Subject::new(self.tree.metadata(), &self.depiction, &transfer, 0.0);
        self.picture = subject.draw_nodes(view, nodes, plan)?.sums(self.depiction.mode)?.0;
        Ok(())
    }

    fn picture(&mut self) -> Result<Raw, Failure> {
        Ok(Raw::Sums(self.picture.clone(), Counts::default()))
    }
}

#[cfg(feature = "viewer")]
pub use gpu::GpuCanvas;

#[cfg(feature = "viewer")]
mod gpu {
    use super::*;
    use crate::cpu::volume::attributes::Column;
    use crate::gpu::column_tables::ColumnTables;
    use crate::gpu::content_look::ContentLook;
    use crate::gpu::depiction::{footprint, request_nodes};
    use crate::gpu::page_copies::{self, CopyState};
    use crate::gpu::{Backend, Footprint, HeadlessRenderer, ParticleScene, SplatView};

    /// The GPU techniques, without a window.
    pub struct GpuCanvas {
        tree: Arc<dyn Tree>,
        depiction: Depiction,
        look: Arc<ContentLook>,
        backend: Backend,
        footprint: Footprint,
        renderer: HeadlessRenderer,
        scene: ParticleScene,
        tables: ColumnTables,
        options: CopyOptions,
    }

    /// The name of the one file's nodes.
    const SOURCE: u32 = 0;

    impl GpuCanvas {
        /// Opens the adapter, with so many bytes for copies and for the uploads of a frame.
        ///
        /// # Errors
        /// No adapter, or one that cannot carry the backend out.
        pub fn open(
            tree: Arc<dyn Tree>,
            depiction: Depiction,
            backend: Backend,
            view: &View,
            options: CopyOptions,
        ) -> Result<GpuCanvas, Failure> {
            let metadata = tree.metadata();
            let mut renderer =
                HeadlessRenderer::open(&request_nodes(view, &depiction, metadata, &[], &Plan::default(), backend))?;
            let scene = renderer.scene().clone();
            // Room for gaps between copies, as the window leaves it.
            scene.set_budgets(options.budget + options.budget / 7, options.on_their_way / 2);
            let tables = ColumnTables::new(&scene, &depiction, metadata);
            let footprint = footprint(&depiction, metadata.kernel);
            // Shaders are compiled before the flight begins.
            renderer.complete()?;
            let look = Arc::new(ContentLook::new(depiction.clone(), metadata));
            Ok(GpuCanvas { tree, depiction, look, backend, footprint, renderer, scene, tables, options })
        }
    }

    impl Canvas for GpuCanvas {
        fn name(&self) -> (String, String) {
            (self.renderer.technique().name().into(), self.renderer.adapter().into())
        }

        fn copies(&self) -> Option<CopyOptions> {
            Some(self.options)
        }

        fn receive(&mut self, streamer: &mut Streamer) {
            let Some(copies) = &mut streamer.copies else { return };
            let waiting: Vec<_> = copies.on_their_way().collect();
            for id in waiting {
                let Some(page) = streamer.residency.page(id) else { continue };
                match page_copies::state(&self.scene, SOURCE, page) {
                    CopyState::Waiting => {}
                    CopyState::Complete => copies.arrived(id),
                    CopyState::Rejected => copies.rejected(id),
                }
            }
        }

        fn copy(&mut self, streamer: &mut Streamer) {
            let plan = streamer.plan_copies();
            for (id, nodes) in plan.remove {
                page_copies::remove(&self.scene, SOURCE, id, nodes);
            }
            for id in plan.insert {
                let Some(page) = streamer.residency.page(id) else { continue };
                page_copies::insert(&self.scene, SOURCE, page, &self.look);
            }
        }

        fn draw(&mut self, view: &View, nodes: &[SceneNode], plan: &Plan) -> Result<(), Failure> {
            let metadata = self.tree.metadata();
            let wanted = (&self.depiction, metadata, plan);
            let (items, _) = self.tables.items(&[Column::Attribute], nodes, (SOURCE, view), wanted);
            let (view, footprint, backend) = (*view, self.footprint, self.backend);
            let Plan { culling, faintest, .. } = *plan;
            let items = items.into();
            self.renderer.show(SplatView {
                view,
                footprint,
                backend,
                culling,
                faintest,
                items,
                always: true,
                keeps_last: false,
            });
            self.renderer.frame()?;
            Ok(())
        }

        fn picture(&mut self) -> Result<Raw, Failure> {
            Ok(Raw::Sums(self.renderer.accumulation(self.depiction.attribute.is_some())?.0, Counts::default()))
        }
    }
}
