//! The section about the program itself: convergence, frame times, what drawing costs, pages and memory.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::picture::field::PointsReport;
use crate::window::statistics::FrameClock;
use bevy_egui::egui::{self, Align2, FontId, Rect, Sense, Stroke, Ui, pos2, vec2};

/// The section.
pub static SECTION: Section =
    Section { name: "statistics", title: "Statistics", dock: Dock::Right, applies: |_| true, show };

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let (statistics, clock) = (&*state.statistics, &*state.clock);
    theme::fact(ui, "Frames", format!("{:.0} / s,  {:.1} ms", clock.fps(), clock.milliseconds()));
    frame_graph(ui, clock);
    theme::fact(ui, "Backend", statistics.backend.as_str()).on_hover_text(&statistics.adapter);
    if state.scene.is_none() {
        return;
    }
    let (text, color) = match (state.converged.0, statistics.missing) {
        (true, _) => ("converged".to_owned(), theme::GOOD),
        (false, 0) => ("drawing".to_owned(), theme::ACCENT),
        (false, missing) => (format!("{} nodes to come", number::count(missing as u64)), theme::ACCENT),
    };
    theme::fact_colored(ui, "Picture", text, color);
    let needed = statistics.nodes + statistics.missing;
    let share = if needed == 0 { 1.0 } else { statistics.nodes as f32 / needed as f32 };
    theme::bar(ui, if state.converged.0 { 1.0 } else { share.min(0.99) }, color);
    ui.add_space(2.0);
    if let Some(points) = &statistics.points {
        return field(ui, points, statistics.draw_ms);
    }
    theme::fact(ui, "Error", error(statistics.error_px));
    let particles = match statistics.sampled {
        Some(sampled) => format!("{}  of  {}", number::count(sampled), number::count(statistics.particles)),
        None => number::count(statistics.particles),
    };
    let is_surface = state.scene.as_ref().is_some_and(|scene| scene.is_about_heights(state.settings.mode));
    let [counted, rated] = if is_surface { ["Samples", "samples"] } else { ["Particles", "particles"] };
    theme::fact(ui, counted, particles);
    let mut nodes = number::count(statistics.nodes as u64);
    if statistics.hidden > 0 {
        nodes += &format!(",  {} hidden", number::count(statistics.hidden as u64));
    }
    theme::fact(ui, "Nodes", nodes);
    let drawn = statistics.sampled.unwrap_or(statistics.particles);
    if let Some(milliseconds) = statistics.draw_ms {
        theme::fact(ui, "Drawn in", format!("{milliseconds:.1} ms"));
        for (pass, milliseconds) in &statistics.passes {
            let rate = number::quantity(drawn as f64 / milliseconds.max(1e-6) * 1e3 / 1e6);
            theme::fact(ui, &format!("   {pass}"), format!("{milliseconds:.2} ms"))
                .on_hover_text(format!("{rate} million particles of the picture per second"));
        }
        if milliseconds > 0.0 && drawn > 0 {
            let rate = drawn as f64 / milliseconds * 1e3 / 1e6;
            theme::fact(ui, "Rate", format!("{} M {rated} / s", number::quantity(rate)));
        }
    }
    if is_surface {
        return;
    }
    pages(ui, state);
    memory(ui, "Memory", statistics.bytes, statistics.budget_bytes);
    if let Some([bytes, budget]) = statistics.copies {
        memory(ui, "Graphics memory", bytes, budget);
    }
}

/// What an image or a volume is drawn from, and how near that is.
fn field(ui: &mut Ui, points: &PointsReport, draw_ms: Option<f64>) {
    theme::fact(ui, "Points", number::count(points.points)).on_hover_text("Points that stand for the samples");
    let error = points.error_value;
    theme::fact(ui, "Error", format!("{}  at most", number::quantity(f64::from(error.max))))
        .on_hover_text(format!("How far values are from the samples'; root mean square {}", error.rms));
    if let Some(milliseconds) = draw_ms {
        theme::fact(ui, "Drawn in", format!("{milliseconds:.1} ms"));
    }
}

/// How many pages are in each state, as a bar of parts.
fn pages(ui: &mut Ui, state: &PanelState<'_, '_>) {
    let statistics = &*state.statistics;
    let states = [
        (statistics.pages_resident, "resident", theme::GOOD),
        (statistics.pages_loading, "loading", theme::ACCENT),
        (statistics.pages_failed, "failed", theme::BAD),
    ];
    let words: Vec<String> = states
        .iter()
        .filter(|(count, name, _)| *count > 0 || *name == "resident")
        .map(|(count, name, _)| format!("{} {name}", number::count(*count as u64)))
        .collect();
    let color = if statistics.pages_failed > 0 { theme::BAD } else { theme::TEXT };
    theme::fact_colored(ui, "Pages", words.join(",  "), color);
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 4.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, theme::WELL);
    let total: usize = states.iter().map(|state| state.0).sum();
    let mut left = rect.left();
    for (count, _, color) in states {
        let width = rect.width() * count as f32 / total.max(1) as f32;
        let part = Rect::from_min_size(pos2(left, rect.top()), vec2(width, rect.height()));
        ui.painter().rect_filled(part, 2.0, color);
        left += width;
    }
    response.on_hover_text("Pages of the file: in memory, on their way, and not to be read");
    ui.add_space(2.0);
}

fn memory(ui: &mut Ui, label: &str, bytes: u64, budget: u64) {
    let budget = budget.max(1);
    theme::fact(ui, label, format!("{}  of  {}", number::bytes(bytes), number::bytes(budget)));
    theme::bar(ui, (bytes as f64 / budget as f64) as f32, theme::ACCENT);
    ui.add_space(2.0);
}

/// The screen-space error in words.
fn error(pixels: f64) -> String {
    match pixels {
        p if !p.is_finite() => "no bound (inside a node)".to_owned(),
        p if p < 0.01 => "below 0.01 px".to_owned(),
        p => format!("{p:.2} px"),
    }
}

/// The last frames' times as bars, with the lines of 60 and 30 frames a second.
fn frame_graph(ui: &mut Ui, clock: &FrameClock) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 40.0), Sense::hover());
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 3.0, theme::WELL);
    let longest = clock.recent().fold(34.0f32, f32::max).min(500.0);
    let y = |milliseconds: f32| egui::lerp(rect.bottom()..=rect.top() + 3.0, (milliseconds / longest).min(1.0));
    let width = rect.width() / FrameClock::RECENT as f32;
    for (i, milliseconds) in clock.recent().enumerate() {
        let color = if milliseconds > 50.0 { theme::BAD } else { theme::ACCENT };
        let left = rect.left() + i as f32 * width;
        let bar = Rect::from_min_max(pos2(left, y(milliseconds)), pos2(left + width.max(1.0), rect.bottom()));
        painter.rect_filled(bar, 0.0, color.gamma_multiply(0.7));
    }
    for (milliseconds, label) in [(1000.0 / 60.0, ""), (1000.0 / 30.0, "30 / s")] {
        let at = y(milliseconds);
        painter.hline(rect.x_range(), at, Stroke::new(1.0, theme::LABEL.gamma_multiply(0.4)));
        if longest < 120.0 {
            let font = FontId::proportional(9.0);
            painter.text(pos2(rect.right() - 2.0, at - 1.0), Align2::RIGHT_BOTTOM, label, font, theme::LABEL);
        }
    }
    response.on_hover_text("Milliseconds of the last frames; the lines are 60 and 30 frames a second");
    ui.add_space(3.0);
}
