//! The section about the followers of a show that this window leads.

use super::Leading;
use crate::annotate::number;
use crate::show::protocol::FollowerInfo;
use crate::window::panel::{PanelState, Section, SectionData};
use crate::window::state::panels::Dock;
use crate::window::theme;
use bevy::prelude::*;
use bevy_egui::egui::{self, Color32, RichText, Ui};
use std::net::SocketAddr;
use std::time::Duration;

/// The section.
pub static SECTION: Section = Section {
    name: "show",
    title: "Show",
    dock: Dock::Right,
    applies: |state| state.data.get::<Led>().is_some(),
    show,
};

/// What the section shows, and what it asks for.
struct Led {
    address: Option<SocketAddr>,
    followers: Vec<FollowerInfo>,
    /// A follower to be forgotten.
    forget: Option<String>,
}

/// Tells the section who follows, and forgets whom the user wants to be forgotten.
pub(super) fn update_section(mut leading: ResMut<Leading>, mut data: ResMut<SectionData>) {
    let leading = leading.bypass_change_detection();
    if let Some(name) = data.get_mut::<Led>().and_then(|led| led.forget.take()) {
        leading.forget(&name);
    }
    let leader = leading.leader();
    data.put(Led { address: leader.address(), followers: leader.followers().to_vec(), forget: None });
}

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let now = state.time.elapsed();
    let Some(led) = state.data.get_mut::<Led>() else { return };
    let address = led.address.map_or_else(String::new, |address| address.to_string());
    theme::fact(ui, "Leads at", address)
        .on_hover_text("Followers: deepfield view --follow ADDRESS:PORT --show-key FILE");
    if led.followers.is_empty() {
        ui.label(RichText::new("Nobody follows yet.").size(12.0).color(theme::LABEL));
    }
    let mut forget = None;
    for (row, follower) in led.followers.iter().enumerate() {
        let (text, color) = words(follower, now);
        theme::row(ui, &follower.name, |ui| {
            if !follower.is_here && theme::button(ui, &format!("show:{row}:forget"), "\u{d7}", true, "Forget it") {
                forget = Some(follower.name.clone());
            }
            ui.add(egui::Label::new(RichText::new(text).color(color)).truncate());
        })
        .on_hover_text(format!("{},  {:.1} ms there and back", follower.address, 1e3 * follower.round_trip));
        if let Some(report) = follower.report.filter(|_| follower.is_here) {
            let rate = if report.frame_ms > 0.0 { 1e3 / report.frame_ms } else { 0.0 };
            let pages = match (report.failed, report.missing) {
                (0, 0) => String::new(),
                (0, missing) => format!(",  {} to come", number::count(missing)),
                (failed, _) => format!(",  {} pages damaged", number::count(failed)),
            };
            theme::fact(ui, "   frames", format!("{rate:.0} / s{pages}"));
        }
        if let Some(warning) = &follower.warning {
            ui.add(egui::Label::new(RichText::new(warning).size(12.0).color(theme::BAD)).wrap());
        }
    }
    led.forget = forget;
}

/// How a follower is, and the colour of that.
fn words(follower: &FollowerInfo, now: Duration) -> (String, Color32) {
    match (follower.is_here, follower.report) {
        (false, _) => {
            let seconds = now.saturating_sub(follower.since).as_secs();
            (format!("gone for {}:{:02}", seconds / 60, seconds % 60), theme::BAD)
        }
        (true, None) => ("joining".to_owned(), theme::ACCENT),
        (true, Some(report)) if report.frame == 0 => ("getting its data".to_owned(), theme::ACCENT),
        (true, Some(_)) if follower.is_in_step() => ("in step".to_owned(), theme::GOOD),
        (true, Some(_)) => (format!("{} frames behind", number::count(follower.behind)), theme::ACCENT),
    }
}
