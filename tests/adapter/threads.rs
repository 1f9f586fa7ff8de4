//! What threads do on one adapter at the same time.

use bevy::tasks::block_on;
use deepfield::gpu::{DeviceOptions, device};
use std::sync::Barrier;
use wgpu::ErrorFilter;

/// Bevy's threads compile shaders within scopes of errors while a frame is within another, and none waits for the others.
#[test]
fn error_scopes_of_threads_are_their_own() {
    let gpu = device::open(&DeviceOptions::default()).unwrap();
    let device = gpu.device.wgpu_device();
    let turn = Barrier::new(2);
    std::thread::scope(|threads| {
        let first = threads.spawn(|| {
            let scope = device.push_error_scope(ErrorFilter::Validation);
            turn.wait();
            turn.wait();
            block_on(scope.pop()).is_none()
        });
        turn.wait();
        let scope = device.push_error_scope(ErrorFilter::OutOfMemory);
        turn.wait();
        // The scope that was opened first ends first.
        assert!(first.join().is_ok_and(|without_errors| without_errors));
        assert!(block_on(scope.pop()).is_none());
    });
}
