//! Adapters that stay open from picture to picture: each that is opened compiles its shaders.

use deepfield::gpu::headless::render;
use deepfield::gpu::{Backend, DeviceOptions, HeadlessFrame, HeadlessRenderer, HeadlessRequest, Payload};

/// The bits of a node's source that number pictures here; those above them number columns.
const PICTURE: u32 = 0xff_ffff;

/// One for each technique that has been asked for.
#[derive(Default)]
pub struct Adapters {
    device: DeviceOptions,
    open: Vec<(Backend, HeadlessRenderer)>,
    pictures: u32,
}

impl Adapters {
    /// Those of a device with limits of its own.
    pub fn of(device: DeviceOptions) -> Adapters {
        Adapters { device, ..Adapters::default() }
    }

    /// The adapter for a request, whose nodes get the names that they have there.
    fn opened(&mut self, request: &mut HeadlessRequest) -> &mut HeadlessRenderer {
        self.pictures += 1;
        let is_of_page = |payload: &Payload| matches!(payload, Payload::Page { .. });
        // All else than nodes of pages is named anew for each picture.
        for node in request.nodes.iter_mut().filter(|node| !is_of_page(&node.upload.payload)) {
            node.upload.id.source = (node.upload.id.source & !PICTURE) | self.pictures;
        }
        if self.open.iter().all(|(backend, _)| *backend != request.backend) {
            let opened = HeadlessRenderer::bare(&self.device, request.backend).unwrap();
            self.open.push((request.backend, opened));
        }
        &mut self.open.iter_mut().find(|(backend, _)| *backend == request.backend).unwrap().1
    }

    /// Draws a picture.
    pub fn draw(&mut self, mut request: HeadlessRequest) -> HeadlessFrame {
        render(self.opened(&mut request), request).unwrap()
    }

    /// Loads particles for other passes than those of splats; with the number that their picture gets.
    pub fn load(&mut self, mut request: HeadlessRequest) -> (&mut HeadlessRenderer, u64) {
        let number = u64::from(self.pictures) + 1;
        let renderer = self.opened(&mut request);
        renderer.load(&request).unwrap();
        (renderer, number)
    }
}
