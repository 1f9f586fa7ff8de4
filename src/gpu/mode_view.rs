//! Which mode a camera shows, for modes that bring passes of their own.

use crate::mode::{Adapter, Mode, Settings};
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};

/// The mode that a camera shows.
#[derive(Component, Clone, Debug, ExtractComponent)]
pub struct ModeView {
    /// The mode.
    pub mode: &'static Mode,
    /// Its settings.
    pub settings: Settings,
}

impl ModeView {
    /// Whether passes of the mode's plugin draw it, in place of the splat passes.
    pub fn has_passes(&self) -> bool {
        self.mode.technique.adapter() == Adapter::Plugin
    }
}

/// Gives cameras that show a mode the component by which its passes know them, made anew whenever its settings change; it is
/// extracted to the render world. Systems may change it in every frame.
pub struct ModePlugin<C: Component + ExtractComponent> {
    /// The mode.
    pub mode: &'static Mode,
    /// The component for settings of the mode.
    pub component: fn(&Settings) -> C,
}

impl<C: Component + ExtractComponent> Plugin for ModePlugin<C> {
    fn build(&self, app: &mut App) {
        let (mode, component) = (self.mode, self.component);
        let follow = move |mut commands: Commands,
                           cameras: Query<(Entity, Option<Ref<ModeView>>, Has<C>), With<Camera>>| {
            for (camera, shown, has) in &cameras {
                match shown.filter(|shown| std::ptr::eq(shown.mode, mode)) {
                    Some(shown) if shown.is_changed() || !has => {
                        commands.entity(camera).insert(component(&shown.settings));
                    }
                    Some(_) => {}
                    None if has => {
                        commands.entity(camera).remove::<C>();
                    }
                    None => {}
                }
            }
        };
        app.add_plugins(ExtractComponentPlugin::<C>::default()).add_systems(Last, follow);
    }
}
