//! The panel's part about the program itself: convergence, frames, residency, messages.

use super::theme;
use crate::app::messages::{Messages, Severity};
use crate::app::number;
use crate::app::statistics::{Converged, FrameClock, Statistics};
use bevy_egui::egui::{self, RichText, Ui};

/// Draws the statistics.
pub fn show(ui: &mut Ui, statistics: &Statistics, converged: Converged, clock: &FrameClock, open: bool) {
    theme::section(ui, "Statistics");
    theme::fact(ui, "Frames", format!("{:.0} / s,  {:.1} ms", clock.fps(), clock.milliseconds()));
    theme::fact(ui, "Backend", statistics.backend.as_str()).on_hover_text(&statistics.adapter);
    if !open {
        return;
    }
    let (text, color) = match (converged.0, statistics.missing) {
        (true, _) => (format!("converged{}", error(statistics.error_px)), theme::GOOD),
        (false, 0) => (format!("drawing{}", error(statistics.error_px)), theme::ACCENT),
        (false, missing) => (format!("{} nodes to come", number::count(missing as u64)), theme::ACCENT),
    };
    theme::fact_colored(ui, "Picture", text, color);
    let needed = statistics.nodes + statistics.missing;
    let share = if needed == 0 { 1.0 } else { statistics.nodes as f32 / needed as f32 };
    theme::bar(ui, if converged.0 { 1.0 } else { share.min(0.99) }, color);
    ui.add_space(2.0);
    let particles = match statistics.sampled {
        Some(sampled) => format!("{}  of  {}", number::count(sampled), number::count(statistics.particles)),
        None => number::count(statistics.particles),
    };
    theme::fact(ui, "Particles drawn", particles);
    theme::fact(ui, "Nodes drawn", number::count(statistics.nodes as u64));
    if let Some(milliseconds) = statistics.draw_ms {
        theme::fact(ui, "Drawn in", format!("{milliseconds:.1} ms"));
    }
    let mut pages = format!("{} resident", number::count(statistics.pages_resident as u64));
    if statistics.pages_loading > 0 {
        pages += &format!(",  {} loading", number::count(statistics.pages_loading as u64));
    }
    if statistics.pages_failed > 0 {
        pages += &format!(",  {} failed", number::count(statistics.pages_failed as u64));
    }
    theme::fact_colored(ui, "Pages", pages, if statistics.pages_failed > 0 { theme::BAD } else { theme::TEXT });
    let budget = statistics.budget_bytes.max(1);
    theme::fact(ui, "Memory", format!("{}  of  {}", number::bytes(statistics.bytes), number::bytes(budget)));
    theme::bar(ui, (statistics.bytes as f64 / budget as f64) as f32, theme::ACCENT);
}

/// The screen-space error in words; nothing where the eye is inside a node, which has no bound then.
fn error(pixels: f64) -> String {
    match pixels {
        p if !p.is_finite() => String::new(),
        p if p < 0.01 => ",  error < 0.01 px".to_owned(),
        p => format!(",  error {p:.2} px"),
    }
}

/// Draws the latest messages, the newest first.
pub fn messages(ui: &mut Ui, messages: &Messages) {
    let latest: Vec<_> = messages.all().rev().take(4).collect();
    if latest.is_empty() {
        return;
    }
    theme::section(ui, "Messages");
    for message in latest {
        let color = match message.severity {
            Severity::Info => theme::LABEL,
            Severity::Error => theme::BAD,
        };
        ui.add(egui::Label::new(RichText::new(&message.text).size(12.0).color(color)).wrap());
    }
}
