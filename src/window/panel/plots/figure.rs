//! A chart in a panel: its frame with ticks and numbers, what is under the pointer, and the part of it that is brushed.

use super::ends::{self, Parts};
use super::marks;
use crate::annotate::number;
use crate::annotate::ticks::ticks;
use crate::annotate::{Chart, ChartAxis, Marks};
use crate::explore::plot::Part;
use crate::window::theme;
use bevy_egui::egui::{
    self, Align2, Color32, CursorIcon, FontId, PointerButton, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, pos2, vec2,
};

/// Room above the frame, for the name of the axis upwards; below it, for numbers and the name of the axis to the right; at the right.
const ABOVE: f32 = 15.0;
const BELOW: f32 = 29.0;
const RIGHT: f32 = 3.0;
/// Room of a number beside the frame: of none, and at most.
const NUMBERS: [f32; 2] = [16.0, 64.0];
/// Distance of numbers from the frame, and from each other at least.
const GAP: f32 = 4.0;

/// What a chart is shown with.
pub struct Shown {
    /// Which plot it is: another has another number.
    pub revision: u64,
    /// The part that is brushed.
    pub part: Option<Part>,
    /// Which parts can be brushed; `None` where nothing can.
    pub parts: Option<Parts>,
    /// Height of the whole figure, logical pixels.
    pub height: f32,
}

/// What the pointer or the keyboard asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Brushing {
    /// This part is brushed.
    To(Part),
    /// Nothing is.
    Clear,
}

/// The frame of a chart on the screen.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// Where it is.
    pub rect: Rect,
    /// To the right.
    pub across: ChartAxis<'a>,
    /// Upwards.
    pub up: ChartAxis<'a>,
}

impl Frame<'_> {
    /// Where values are on the screen.
    pub fn at(&self, [x, y]: [f64; 2]) -> Pos2 {
        pos2(
            egui::lerp(self.rect.x_range(), self.across.share(x) as f32),
            egui::lerp(self.rect.bottom()..=self.rect.top(), self.up.share(y) as f32),
        )
    }

    /// The values at a point of the screen; those of the edge beside the frame.
    pub fn values(&self, at: Pos2) -> [f64; 2] {
        let share = |from: f32, to: f32, at: f32| f64::from((at - from) / (to - from));
        [
            self.across.value(share(self.rect.left(), self.rect.right(), at.x)),
            self.up.value(share(self.rect.bottom(), self.rect.top(), at.y)),
        ]
    }

    /// The part between two points of the screen.
    pub fn part(&self, from: Pos2, to: Pos2, flat: bool) -> Part {
        let ([ax, ay], [bx, by]) = (self.values(from), self.values(to));
        Part { across: [ax.min(bx), ax.max(bx)], up: flat.then_some([ay.min(by), ay.max(by)]) }
    }

    /// Where a part is on the screen.
    pub fn place(&self, part: &Part) -> Rect {
        let [low, high] = part.up.unwrap_or(self.up.range);
        Rect::from_two_pos(self.at([part.across[0], low]), self.at([part.across[1], high]))
    }
}

/// Draws a chart as wide as there is room, and a line about what is under the pointer.
pub fn show(ui: &mut Ui, chart: &Chart<'_>, shown: &Shown) -> Option<Brushing> {
    let font = FontId::proportional(theme::SMALL);
    let (outer, _) = ui.allocate_exact_size(vec2(ui.available_width(), shown.height), Sense::hover());
    let painter = ui.painter().clone();
    let wide = |text: &str| theme::text_size(&painter, text, theme::SMALL).x;
    let ups = ticks(chart.up.range, chart.up.logarithmic);
    let numbers = ups.iter().filter_map(|tick| tick.label.as_deref()).map(wide).fold(NUMBERS[0], f32::max);
    let rect = Rect::from_min_max(
        pos2(outer.left() + numbers.min(NUMBERS[1]) + GAP, outer.top() + ABOVE),
        pos2(outer.right() - RIGHT, outer.bottom() - BELOW),
    );
    if !rect.is_positive() {
        return None;
    }
    let frame = Frame { rect, across: chart.across, up: chart.up };
    let response = ui.interact(rect, ui.id().with("plot frame"), Sense::click_and_drag());
    theme::register(ui, "plots:frame", rect);

    painter.rect_filled(rect, 3.0, theme::WELL);
    let inside = painter.with_clip_rect(rect);
    let is_open = !matches!(chart.marks, Marks::Cells { .. });
    let grid = Stroke::new(1.0, if is_open { theme::LINE.gamma_multiply(0.7) } else { Color32::TRANSPARENT });
    let mark = Stroke::new(1.0, theme::LABEL.gamma_multiply(0.6));
    let mut last = f32::INFINITY;
    for tick in ups {
        let y = egui::lerp(rect.bottom()..=rect.top(), tick.place as f32);
        painter.hline(rect.left() - 2.0..=rect.left(), y, mark);
        let Some(label) = tick.label.filter(|_| last - y >= theme::SMALL) else { continue };
        inside.hline(rect.x_range(), y, grid);
        painter.text(pos2(rect.left() - GAP, y), Align2::RIGHT_CENTER, label, font.clone(), theme::LABEL);
        last = y;
    }
    let mut last = f32::NEG_INFINITY;
    for tick in ticks(chart.across.range, chart.across.logarithmic) {
        let x = egui::lerp(rect.x_range(), tick.place as f32);
        painter.vline(x, rect.bottom()..=rect.bottom() + 2.0, mark);
        let Some(label) = tick.label else { continue };
        let half = 0.5 * wide(&label);
        // Those at the ends stay within the panel.
        let middle = x.max(outer.left() + half).min(outer.right() - half);
        if middle - half < last + GAP {
            continue;
        }
        inside.vline(x, rect.y_range(), grid);
        painter.text(pos2(middle, rect.bottom() + 3.0), Align2::CENTER_TOP, label, font.clone(), theme::LABEL);
        last = middle + half;
    }
    painter.text(outer.left_top(), Align2::LEFT_TOP, chart.up.title, font.clone(), theme::LABEL);
    let below = pos2(rect.center().x, outer.bottom());
    painter.text(below, Align2::CENTER_BOTTOM, chart.across.title, font, theme::LABEL);

    let pointer = response.hover_pos();
    marks::draw(ui, &inside, &frame, &chart.marks, shown, pointer);
    if let Some(part) = &shown.part {
        let place = frame.place(part);
        inside.rect_filled(place, 0.0, Color32::from_white_alpha(if is_open { 10 } else { 26 }));
        inside.rect_stroke(place, 0.0, Stroke::new(1.0, theme::TEXT), StrokeKind::Inside);
    }
    painter.rect_stroke(rect, 3.0, Stroke::new(1.0, theme::LINE), StrokeKind::Inside);
    let told = pointer.map(|at| {
        let line = Stroke::new(1.0, theme::TEXT.gamma_multiply(0.35));
        inside.vline(at.x, rect.y_range(), line);
        if shown.parts == Some(Parts::Rectangles) {
            inside.hline(rect.x_range(), at.y, line);
        }
        marks::told(&frame, &chart.marks, at)
    });
    if let Marks::Cells { colors, .. } = &chart.marks {
        key(ui, colors);
    }
    let usual = match shown.parts {
        Some(Parts::Rectangles) => "Drag a rectangle to select",
        Some(Parts::Ranges | Parts::Balls) => "Drag a range to select",
        None => "Who they are is known: nothing to select",
    };
    let (text, color) = told.as_deref().map_or((usual, theme::LABEL), |told| (told, theme::TEXT));
    ui.add(egui::Label::new(egui::RichText::new(text).size(theme::SMALL).color(color)).truncate());

    let Some(parts) = shown.parts else {
        theme::call(&response, "Plot");
        return None;
    };
    if response.hovered() {
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
    }
    let asked = ends::by_keys(ui, &response, &frame, parts, shown.part.as_ref());
    if asked.is_some() {
        return asked;
    }
    if response.clicked() {
        return Some(Brushing::Clear);
    }
    if !response.dragged_by(PointerButton::Primary) {
        return None;
    }
    let from = ui.input(|input| input.pointer.press_origin())?;
    Some(Brushing::To(frame.part(from, response.interact_pointer_pos()?, parts == Parts::Rectangles)))
}

/// What the colours of cells mean: a bar with its ends.
fn key(ui: &mut Ui, colors: &ChartAxis<'_>) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 24.0), Sense::hover());
    let bar = Rect::from_min_max(pos2(rect.left(), rect.bottom() - 8.0), pos2(rect.right(), rect.bottom() - 2.0));
    let inks = marks::colors();
    let color = |share: f32| inks[((share * inks.len() as f32) as usize).min(inks.len() - 1)];
    theme::gradient(ui.painter(), bar, false, color);
    let font = FontId::proportional(theme::SMALL);
    let [low, high] = colors.range.map(number::quantity);
    let painter = ui.painter();
    painter.text(rect.left_top(), Align2::LEFT_TOP, low, font.clone(), theme::LABEL);
    painter.text(rect.center_top(), Align2::CENTER_TOP, colors.title, font.clone(), theme::LABEL);
    painter.text(rect.right_top(), Align2::RIGHT_TOP, high, font, theme::LABEL);
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_egui::egui::{Event, Modifiers, RawInput};
    use proptest::prelude::*;

    const ACROSS: ChartAxis = ChartAxis { title: "density [g/cm^3]", range: [1.0, 1e4], logarithmic: true };
    const UP: ChartAxis = ChartAxis { title: "mass", range: [0.0, 8.0], logarithmic: false };
    const SHOWN: Shown = Shown { revision: 1, part: None, parts: Some(Parts::Ranges), height: 180.0 };

    /// A window of 300 by 300 in which the chart is shown, and what a gesture of it asks for, frame by frame.
    fn gesture(marks: Marks<'_>, shown: &Shown, frames: &[Vec<Event>]) -> Vec<Option<Brushing>> {
        let chart = Chart { title: "a.df", note: "", across: ACROSS, up: UP, marks };
        let ctx = egui::Context::default();
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(300.0, 300.0));
        let mut all = Vec::new();
        for (index, events) in frames.iter().enumerate() {
            let input = RawInput {
                screen_rect: Some(screen),
                time: Some(0.05 * index as f64),
                events: events.clone(),
                ..RawInput::default()
            };
            let mut asked = None;
            let mut output = ctx.run_ui(input, |ui| asked = show(ui, &chart, shown));
            // Nobody draws them.
            output.textures_delta.clear();
            all.push(asked);
        }
        all
    }

    fn button(pos: Pos2, pressed: bool) -> Event {
        Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
    }

    #[test]
    fn a_drag_brushes_a_range_or_a_rectangle_and_a_click_lets_go() {
        let (edges, values) = ([1.0, 10.0, 100.0, 1e3, 1e4], [8.0, 0.0, 4.0, 1.0]);
        let (from, to) = (pos2(120.0, 60.0), pos2(200.0, 110.0));
        let drag = [
            vec![],
            vec![Event::PointerMoved(from)],
            vec![button(from, true)],
            vec![Event::PointerMoved(pos2(150.0, 80.0))],
            vec![Event::PointerMoved(to)],
            vec![button(to, false)],
        ];
        let bars = Marks::Bars { edges: &edges, values: &values };
        let asked = gesture(bars, &SHOWN, &drag);
        let Some(Brushing::To(part)) = asked[4] else { panic!("{asked:?}") };
        assert!(part.up.is_none() && part.across[0] > 1.0 && part.across[0] < part.across[1] && part.across[1] < 1e4);
        let points = Marks::Points { x: &values, y: &values };
        let asked = gesture(points, &Shown { parts: Some(Parts::Rectangles), ..SHOWN }, &drag);
        let Some(Brushing::To(flat)) = asked[4] else { panic!("{asked:?}") };
        assert!(flat.up.is_some_and(|[low, high]| 0.0 < low && low < high && high < 8.0), "{flat:?}");
        let none = gesture(points, &Shown { parts: None, ..SHOWN }, &drag);
        assert!(none.iter().all(Option::is_none), "{none:?}");

        let click = [vec![], vec![Event::PointerMoved(from)], vec![button(from, true)], vec![button(from, false)]];
        let asked = gesture(bars, &SHOWN, &click);
        assert_eq!(asked.last(), Some(&Some(Brushing::Clear)), "{asked:?}");
    }

    #[test]
    fn nothing_that_is_odd_is_harmful() {
        let odd = [f64::NAN, -1.0, 0.0, f64::INFINITY, 1e308];
        let pairs = odd.map(|value| [value, value]);
        let over = [vec![], vec![Event::PointerMoved(pos2(150.0, 80.0))], vec![]];
        for marks in [
            Marks::Bars { edges: &odd, values: &odd },
            Marks::Cells { edges: [&odd, &odd], values: &odd, colors: ACROSS },
            Marks::Cells { edges: [&[], &[]], values: &[], colors: ACROSS },
            Marks::Points { x: &odd, y: &odd },
            Marks::Line { points: &pairs, spreads: &pairs },
            Marks::Line { points: &[], spreads: &[] },
        ] {
            for height in [180.0, 20.0] {
                let part = Part { across: [2.0, f64::INFINITY], up: None };
                gesture(marks, &Shown { height, part: Some(part), ..SHOWN }, &over);
            }
        }
    }

    proptest! {
        #[test]
        fn a_part_is_placed_where_it_was_drawn(
            places in prop::array::uniform4(0.01..0.99f32), flat: bool
        ) {
            let rect = Rect::from_min_max(pos2(40.0, 20.0), pos2(240.0, 170.0));
            let frame = Frame { rect, across: ACROSS, up: UP };
            let [a, b, c, d] = places;
            let (from, to) = (rect.lerp_inside(vec2(a, b)), rect.lerp_inside(vec2(c, d)));
            let place = frame.place(&frame.part(from, to, flat));
            let drawn = Rect::from_two_pos(from, to);
            let expected = if flat { drawn } else { Rect::from_x_y_ranges(drawn.x_range(), rect.y_range()) };
            prop_assert!((place.min - expected.min).length() < 0.05 && (place.max - expected.max).length() < 0.05);
        }
    }
}
