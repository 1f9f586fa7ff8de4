//! What screen readers and other assistive technologies ask for: to press a button, to put the keyboard on a control, to set a number.
//!
//! bevy_egui tells them what the panels show, and leaves what they ask for to others.

use bevy::a11y::{AccessibilitySystems, ActionRequest};
use bevy::prelude::*;
use bevy::window::RequestRedraw;
use bevy_egui::input::EguiInputEvent;
use bevy_egui::{PrimaryEguiContext, egui};

/// Hands over what is asked for.
pub(super) struct AssistivePlugin;

impl Plugin for AssistivePlugin {
    fn build(&self, app: &mut App) {
        app.add_message::<ActionRequest>().add_systems(PostUpdate, hand_over.after(AccessibilitySystems::Update));
    }
}

/// The panels' next pass carries it out. That comes at once: nothing else says that somebody waits for it.
fn hand_over(
    mut requests: MessageReader<ActionRequest>,
    panels: Single<Entity, With<PrimaryEguiContext>>,
    mut events: MessageWriter<EguiInputEvent>,
    mut redraws: MessageWriter<RequestRedraw>,
) {
    for request in requests.read() {
        let event = egui::Event::AccessKitActionRequest(request.0.clone());
        events.write(EguiInputEvent { context: *panels, event });
        redraws.write(RequestRedraw);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::accesskit::{self, Action, TreeId};

    #[test]
    fn a_button_is_pressed_by_its_name_in_the_tree() {
        let mut app = App::new();
        app.add_message::<EguiInputEvent>().add_message::<RequestRedraw>().add_plugins(AssistivePlugin);
        let panels = app.world_mut().spawn(PrimaryEguiContext).id();
        let ctx = egui::Context::default();
        ctx.enable_accesskit();
        let draw = |events: Vec<egui::Event>| {
            let mut is_pressed = false;
            let input = egui::RawInput { events, ..egui::RawInput::default() };
            let mut output = ctx.run_ui(input, |ui| is_pressed |= ui.button("Save").clicked());
            // Nobody draws them.
            output.textures_delta.clear();
            (is_pressed, output.platform_output.accesskit_update.unwrap().nodes)
        };
        let (is_pressed, nodes) = draw(Vec::new());
        assert!(!is_pressed);
        let (target_node, _) = nodes.into_iter().find(|(_, node)| node.label() == Some("Save")).unwrap();
        let request =
            accesskit::ActionRequest { action: Action::Click, target_tree: TreeId::ROOT, target_node, data: None };
        app.world_mut().write_message(ActionRequest(request));
        app.update();
        assert_eq!(app.world().resource::<Messages<RequestRedraw>>().len(), 1);
        let events: Vec<EguiInputEvent> = app.world_mut().resource_mut::<Messages<EguiInputEvent>>().drain().collect();
        assert!(events.iter().all(|event| event.context == panels));
        assert!(draw(events.into_iter().map(|event| event.event).collect()).0);
    }
}
