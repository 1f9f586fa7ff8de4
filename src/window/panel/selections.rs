//! The section about selections: their colours, how they are shown, tables and plots of them.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::explore::export::Format;
use crate::explore::histogram::{FieldHistogram, Scatter};
use crate::explore::selection::COLORS;
use crate::explore::{Members, Region, SelectionSet, Show};
use crate::window::looking::drawing::swatch;
use crate::window::looking::keeping::{Asked, Plot};
use crate::window::state::answer::Answer;
use bevy_egui::egui::{self, Align2, ComboBox, FontId, Rect, RichText, Sense, TextEdit, Ui, pos2, vec2};

/// The section.
pub static SECTION: Section = Section {
    name: "selections",
    title: "Selections",
    dock: Dock::Right,
    applies: |state| state.scene.as_ref().is_some_and(|scene| !scene.is_about_heights(state.settings.mode)),
    show,
};

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let mut sets = state.settings.selections.clone();
    let (mut removed, mut followed) = (None, None);
    for (index, set) in sets.iter_mut().enumerate() {
        ui.push_id(index, |ui| {
            if row(ui, index, set) {
                removed = Some(index);
            }
            if actions(ui, index, set, state) {
                followed = Some(index);
            }
            by_ids(ui, set, state);
        });
    }
    // One at a time.
    if let Some(index) = followed {
        let follow = !sets[index].follow;
        sets.iter_mut().for_each(|set| set.follow = false);
        sets[index].follow = follow;
        state.looking.following.approach = follow;
    }
    if let Some(index) = removed {
        sets.remove(index);
    }
    if sets.is_empty() {
        let text = "Draw a sphere, a box or a lasso and keep it, or select by the values of a field:";
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)).wrap());
    }
    by_value(ui, state, &mut sets);
    if state.settings.selections != sets {
        state.settings.selections = sets;
    }
    if let Answer::Coming(coming) = &state.looking.keeping.export {
        let (_, share) = coming.progress.state();
        theme::fact(ui, "Writing the table", "");
        theme::bar(ui, share.unwrap_or(0.0), theme::ACCENT);
        ui.ctx().request_repaint();
    }
    super::over_time::show(ui, state);
    plots(ui, state);
}

/// Colour, name, how it is shown; whether it is to be removed.
fn row(ui: &mut Ui, index: usize, set: &mut SelectionSet) -> bool {
    let mut remove = false;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let color = set.rgb().unwrap_or([255; 3]);
        if swatch(ui, color).on_hover_text("Another colour").clicked() {
            let at = COLORS.iter().position(|known| *known == set.color).map_or(0, |at| (at + 1) % COLORS.len());
            set.color = COLORS[at].to_owned();
        }
        let width = (ui.available_width() - 118.0).max(50.0);
        let name = ui.add(TextEdit::singleline(&mut set.name).desired_width(width).char_limit(60));
        theme::register(ui, &format!("selection:{index}:name"), name.rect);
        let title = |show: Show| match show {
            Show::Hidden => "hidden",
            Show::Highlighted => "shown",
            Show::Alone => "alone",
        };
        let shown = ComboBox::from_id_salt("show").width(62.0).selected_text(title(set.show)).show_ui(ui, |ui| {
            for show in [Show::Highlighted, Show::Alone, Show::Hidden] {
                let choice = ui.selectable_value(&mut set.show, show, title(show));
                theme::register(ui, &format!("selection:{index}:show:{}", title(show)), choice.rect);
            }
        });
        theme::register(ui, &format!("selection:{index}:show"), shown.response.rect);
        remove = theme::button(ui, &format!("selection:{index}:remove"), "×", true, "Remove it");
    });
    remove
}

/// What can be done with one of them; whether it is to be followed, or not any more.
fn actions(ui: &mut Ui, index: usize, set: &SelectionSet, state: &mut PanelState<'_, '_>) -> bool {
    let Some(scene) = &state.scene else { return false };
    let mut toggled = false;
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.add_space(17.0);
        if theme::button(ui, &format!("selection:{index}:probe"), "Probe", true, "Sum it up over the whole data") {
            state.looking.prober.start(scene, set.members.clone(), false);
        }
        for (format, title) in [(Format::Csv, "CSV"), (Format::Parquet, "Parquet")] {
            let help = "Write its particles with ids and all fields to a table beside the data";
            let idle = !matches!(state.looking.keeping.export, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:{title}"), title, idle, help) {
                state.looking.keeping.write(scene, &set.name, &set.members, format);
            }
        }
        if scene.following.is_some() {
            let help = "Plot its mass, way, velocities and fields over the steps of the run";
            let idle = !matches!(state.looking.keeping.over_time, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:over-time"), "Over time", idle, help) {
                state.looking.keeping.over_time(scene, &set.members);
            }
        }
    });
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.add_space(17.0);
        let text = RichText::new("Follow").size(12.0);
        let follow = ui.add(egui::Button::new(text).selected(set.follow).min_size(vec2(18.0, 18.0)));
        theme::register(ui, &format!("selection:{index}:follow"), follow.rect);
        let help = "Fly to its centre of mass and stay with it: in other snapshots, and while particles move";
        toggled = follow.on_hover_text(help).clicked();
        if let Members::Region(region) = &set.members {
            let help = "Keep it by the ids of its particles, which find them again in other snapshots of the same run";
            let idle = scene.source().is_some() && !matches!(state.looking.by_ids.answer, Answer::Coming(_));
            if theme::button(ui, &format!("selection:{index}:by-id"), "By id", idle, help) {
                state.looking.by_ids.ask(scene, &set.members);
            }
            let bounds = region.bounds();
            let finite = bounds.min.is_finite() && bounds.max.is_finite();
            if theme::button(ui, &format!("selection:{index}:fly"), "Fly to", finite, "Fly to it and turn around it") {
                *state.looking.visit = crate::window::looking::Visit(Some(bounds));
            }
        }
    });
    toggled
}

/// What is known of a selection's ids: how many are here, or why nobody knows.
fn by_ids(ui: &mut Ui, set: &SelectionSet, state: &PanelState<'_, '_>) {
    let coming = |ui: &mut Ui, what: &str, progress: &crate::window::state::progress::SharedProgress| {
        theme::fact(ui, what, "");
        theme::bar(ui, progress.state().1.unwrap_or(0.0), theme::ACCENT);
        ui.ctx().request_repaint();
    };
    if let Some(who) = state.looking.followed.of(&set.members) {
        match who {
            Answer::Here(who) => {
                let count = who.as_ref().map_or(0, |who| who.ids().len());
                let text = format!("{} particles, wherever they go", number::count(count));
                ui.label(RichText::new(text).size(12.0).color(if count == 0 { theme::BAD } else { theme::LABEL }));
            }
            Answer::Coming(lookup) => coming(ui, "Looking for its particles", &lookup.progress),
            Answer::Failed(why) => {
                let text = format!("It cannot be followed: {why}");
                ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::BAD)).wrap());
            }
            Answer::Nothing => {}
        }
        return;
    }
    let Some(ids) = set.members.ids() else {
        if let Answer::Coming(ids) = &state.looking.by_ids.answer
            && state.looking.by_ids.is_asked(&set.members)
        {
            coming(ui, "Reading ids", &ids.progress);
        }
        return;
    };
    match state.looking.looked_up.of(ids) {
        Some(Answer::Here(found)) => {
            let here = match found.count == ids.len() {
                true => format!("{} ids", number::count(ids.len())),
                false => format!("{} of {} ids are here", number::count(found.count), number::count(ids.len())),
            };
            let color = if found.count == 0 { theme::BAD } else { theme::LABEL };
            ui.label(RichText::new(here).size(12.0).color(color));
        }
        Some(Answer::Coming(lookup)) => coming(ui, "Looking for its particles", &lookup.progress),
        Some(Answer::Failed(why)) => {
            let text = format!("It cannot be shown: {why}");
            ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::BAD)).wrap());
        }
        Some(Answer::Nothing) | None => {
            ui.label(RichText::new(format!("{} ids", number::count(ids.len()))).size(12.0).color(theme::LABEL));
        }
    }
}

/// A new selection by the values of a field.
fn by_value(ui: &mut Ui, state: &mut PanelState<'_, '_>, sets: &mut Vec<SelectionSet>) {
    let Some(scene) = &state.scene else { return };
    let metadata = scene.file.metadata();
    let range = &mut *state.looking.range;
    ui.add_space(3.0);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        let infos = || metadata.families.iter().flat_map(|family| family.quantities.iter().chain(&family.attributes));
        if range.field.is_empty()
            && let Some(first) = infos().next()
        {
            range.field.clone_from(&first.name);
        }
        ComboBox::from_id_salt("value field").width(74.0).truncate().selected_text(&range.field).show_ui(ui, |ui| {
            for name in names(infos().map(|info| info.name.as_str())) {
                ui.selectable_value(&mut range.field, name.to_owned(), name);
            }
        });
        for (text, hint, name) in [(&mut range.min, "from", "range:from"), (&mut range.max, "to", "range:to")] {
            let field = ui.add(TextEdit::singleline(text).desired_width(38.0).hint_text(hint).char_limit(24));
            theme::register(ui, name, field.rect);
        }
        let number = |text: &str| match text.trim() {
            "" => Some(None),
            text => text.parse::<f64>().ok().filter(|value| value.is_finite()).map(Some),
        };
        let ends = number(&range.min).zip(number(&range.max));
        let sound = ends.is_some_and(|(min, max)| {
            (min.is_some() || max.is_some()) && !matches!((min, max), (Some(min), Some(max)) if min > max)
        });
        if theme::button(ui, "range:add", "Select", sound, "Select the particles with such values")
            && let Some((min, max)) = ends
        {
            let region = Region::whole().with_range(range.field.clone(), min, max);
            sets.push(SelectionSet::new(format!("By {}", range.field), region, sets.len()));
        }
    });
}

/// Names, each once.
fn names<'a>(all: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    all.for_each(|name| {
        if !names.contains(&name) {
            names.push(name);
        }
    });
    names
}

/// A histogram or a scatter plot of what is probed, or of everything.
fn plots(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let Some(scene) = &state.scene else { return };
    let metadata = scene.file.metadata();
    let infos = metadata.families.iter().flat_map(|family| family.quantities.iter().chain(&family.attributes));
    let fields = names(infos.map(|info| info.name.as_str()));
    let Some(first) = fields.first() else { return };
    let keeping = &mut *state.looking.keeping;
    if !fields.contains(&keeping.fields.0.as_str()) {
        keeping.fields = (fields.get(1).unwrap_or(first).to_string(), None);
    }
    ui.add_space(4.0);
    theme::row(ui, "Plot", |ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        // Laid out from the right.
        let x = keeping.fields.0.clone();
        let along_x = ComboBox::from_id_salt("plot x").width(68.0).truncate().selected_text(x).show_ui(ui, |ui| {
            for name in &fields {
                let choice = ui.selectable_value(&mut keeping.fields.0, (*name).to_owned(), *name);
                theme::register(ui, &format!("plot:x:{name}"), choice.rect);
            }
        });
        theme::register(ui, "plot:x", along_x.response.rect);
        ui.label(RichText::new("over").color(theme::LABEL));
        let y = keeping.fields.1.clone().unwrap_or_else(|| "counts".to_owned());
        let along_y = ComboBox::from_id_salt("plot y").width(68.0).truncate().selected_text(y).show_ui(ui, |ui| {
            ui.selectable_value(&mut keeping.fields.1, None, "counts");
            for name in &fields {
                ui.selectable_value(&mut keeping.fields.1, Some((*name).to_owned()), *name);
            }
        });
        theme::register(ui, "plot:y", along_y.response.rect);
    });
    let members = state.looking.prober.members.clone();
    let whose = if members.is_some() { "of the region above" } else { "of all particles" };
    let (x, y) = keeping.fields.clone();
    // Everything is counted when asked for, not while the window opens.
    let asked = Asked { members, x, y, generation: scene.generation };
    let wanted = match &keeping.asked {
        Some(before) => *before != asked,
        None => asked.members.is_some() || theme::button(ui, "plot:draw", "Draw", true, "Count all particles"),
    };
    if wanted {
        keeping.plot(scene, asked);
    }
    match &keeping.plot {
        Answer::Nothing => {}
        Answer::Failed(why) => {
            ui.add(egui::Label::new(RichText::new(why).size(12.0).color(theme::BAD)).wrap());
        }
        Answer::Coming(coming) => {
            theme::bar(ui, coming.progress.state().1.unwrap_or(0.0), theme::ACCENT);
            ui.ctx().request_repaint();
        }
        Answer::Here(Plot::Histogram(histogram)) => bars(ui, histogram, whose),
        Answer::Here(Plot::Scatter(scatter)) => dots(ui, scatter, whose),
    }
}

/// The well of a plot, and a line below it.
fn well(ui: &mut Ui) -> (Rect, Rect) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 110.0), Sense::hover());
    let well = Rect::from_min_max(rect.min, pos2(rect.right(), rect.bottom() - 14.0));
    ui.painter().rect_filled(well, 3.0, theme::WELL);
    (well, rect)
}

fn labels(ui: &Ui, rect: Rect, [left, middle, right]: [&str; 3]) {
    let font = FontId::proportional(theme::SMALL);
    let painter = ui.painter();
    painter.text(rect.left_bottom(), Align2::LEFT_BOTTOM, left, font.clone(), theme::TEXT);
    painter.text(rect.center_bottom(), Align2::CENTER_BOTTOM, middle, font.clone(), theme::LABEL);
    painter.text(rect.right_bottom(), Align2::RIGHT_BOTTOM, right, font, theme::TEXT);
}

fn bars(ui: &mut Ui, histogram: &FieldHistogram, whose: &str) {
    let Some(axis) = histogram.axes.first() else { return };
    let (well, rect) = well(ui);
    let top = histogram.counts.iter().map(|&count| (count as f64).ln_1p()).fold(1e-9, f64::max);
    let width = well.width() / histogram.counts.len().max(1) as f32;
    for (bin, &count) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let height = ((count as f64).ln_1p() / top) as f32 * (well.height() - 4.0);
        let left = well.left() + width * bin as f32;
        let bar =
            Rect::from_min_max(pos2(left, well.bottom() - height), pos2(left + (width - 1.0).max(1.0), well.bottom()));
        ui.painter().rect_filled(bar, 0.0, theme::ACCENT);
    }
    labels(ui, rect, [&number::quantity(axis.min), whose, &number::quantity(axis.max)]);
}

fn dots(ui: &mut Ui, scatter: &Scatter, whose: &str) {
    let (well, rect) = well(ui);
    let [x, y] = [&scatter.x, &scatter.y].map(|values| Scale::of(values));
    for (a, b) in scatter.x.iter().zip(&scatter.y) {
        if let (Some(a), Some(b)) = (x.place(*a), y.place(*b)) {
            let at = pos2(
                egui::lerp(well.left() + 3.0..=well.right() - 3.0, a),
                egui::lerp(well.bottom() - 3.0..=well.top() + 3.0, b),
            );
            let dot = Rect::from_center_size(at, vec2(1.5, 1.5));
            ui.painter().rect_filled(dot, 0.0, theme::ACCENT.gamma_multiply(0.6));
        }
    }
    let middle = format!("{} of {}, {whose}", number::count(scatter.x.len() as u64), number::count(scatter.of));
    labels(ui, rect, [&number::quantity(x.low), &middle, &number::quantity(x.high)]);
}

/// An axis of a scatter plot: logarithmic where all values are positive and span more than two decades.
struct Scale {
    low: f64,
    high: f64,
    log: bool,
}

impl Scale {
    fn of(values: &[f64]) -> Scale {
        let finite = values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        Scale { low, high, log: low > 0.0 && high > 100.0 * low }
    }

    fn place(&self, value: f64) -> Option<f32> {
        let forth = |x: f64| if self.log { x.ln() } else { x };
        let (low, high) = (forth(self.low), forth(self.high));
        let share = if high > low { (forth(value) - low) / (high - low) } else { 0.5 };
        share.is_finite().then_some(share as f32)
    }
}
